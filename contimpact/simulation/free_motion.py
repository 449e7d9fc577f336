"""Motions that meet no guard: the periodic motion they settle on, as it passes the section t = 0.

A linear mode has one, the fixed point of its map over a forcing period, if that contracts. Of other
flights of one coordinate the motion itself is looked at, after as many periods as a flight may
last.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array
from .automaton import Automaton
from .linear_motion import LinearMotion
from .run import State

if TYPE_CHECKING:
    from .simulator import Simulator

CONTRACTS = 1.0 - 1e-9
"""A map contracts if its multipliers are below this; undamped they are one within rounding."""

REPEATED = 1e-9
"""A motion that differs by less from one period to the next has settled, by its size."""


def free_motion(
    simulator: Simulator, mode: str, left: State | None = None
) -> tuple[float, ...] | None:
    """Return position and velocity of each coordinate at t = 0, x0, v0, x1, v1, ...

    Parameters
    ----------
    simulator : Simulator
    mode : str
        In which the motion goes on.
    left : State, optional
        Its last impact.

    Returns
    -------
    tuple of float or None
        None if it settles on no motion of the forcing's period, or on none that is known.
    """
    machine = simulator.machine
    walls = [k for k, guard in enumerate(simulator.model.WALLS) if guard.next_mode == mode]
    if isinstance(machine, Automaton) and all(machine.linear[k] for k in walls):
        return _fixed_point(machine.motion(mode, 0), simulator.period)
    if simulator.model.DEGREES_OF_FREEDOM == 1 and left is not None:
        return _repeating(simulator, left)
    return None


def later(
    simulator: Simulator, mode: str, motion: tuple[float, ...], time: float
) -> tuple[list[float], list[float]] | None:
    """Return position and velocity some time after t = 0, guards passed through.

    None if the mode is not linear.
    """
    place, speed = list(motion[::2]), list(motion[1::2])
    machine = simulator.machine
    walls = [k for k, guard in enumerate(simulator.model.WALLS) if guard.next_mode == mode]
    if time == 0.0:
        return place, speed
    if not (isinstance(machine, Automaton) and all(machine.linear[k] for k in walls)):
        return None
    law, d = machine.motion(mode, 0), len(place)
    moved = law.track(law.embedded(place, speed, 0.0), simulator.period).at(time)
    return moved[:d].tolist(), moved[d : 2 * d].tolist()


def _fixed_point(motion: LinearMotion, period: float) -> tuple[float, ...] | None:
    """Where the affine map over a period leads back to, if it contracts."""
    d = motion.shape.freedom
    none = np.zeros(d)
    forced = motion.track(motion.embedded(none, none, 0.0), period).at(period)[: 2 * d]
    derivative = motion.flowed(period)
    if not float(np.max(np.abs(np.linalg.eigvals(derivative)))) < CONTRACTS:
        return None
    found: Array = np.linalg.solve(np.eye(2 * d) - derivative, forced)
    return tuple(found.reshape(2, d).T.ravel().tolist())


def _repeating(simulator: Simulator, left: State) -> tuple[float, ...] | None:
    """The motion after its longest flight, if it is the same a period before."""
    guard, kernel = (
        simulator.model.WALLS[left.wall],
        simulator.kernels.motion(simulator.letters[left.wall]),
    )
    place, (by,) = simulator.positions[left.wall], guard.row(1)
    ends = []
    for periods in (simulator.longest_flight - 1, simulator.longest_flight):
        dt = periods * simulator.period - left.phase
        try:
            moved, speed = kernel(left.phase, left.velocity, dt, *simulator.values)[:2]
        except ArithmeticError:
            return None
        ends.append(np.array([(place + moved) / by, speed / by], dtype=float))
    apart = float(np.max(np.abs(ends[1] - ends[0])))
    if not apart <= REPEATED * (1.0 + float(np.max(np.abs(ends[1])))):
        return None
    return tuple(ends[1].tolist())
