"""Impacts at random, for systems of several coordinates."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .run import State

if TYPE_CHECKING:
    from .automaton import Automaton

TRIES = 10_000
GROWTH = 1.01
"""By which the range of positions grows with each trial that lies beyond a guard."""


def random_impact(automaton: Automaton, generator: np.random.Generator) -> State:
    """Return an impact at random: guard, phase, and a state within the guards of its mode.

    Velocities are up to `Automaton.fastest`, positions first up to what that gives in a period.
    """
    wall = int(generator.integers(len(automaton.guards)))
    phase = float(generator.uniform(0.0, automaton.period))
    speed, side = automaton.fastest, automaton.guards[wall].side
    reach = 0.1 * speed * automaton.period
    section: tuple[float, ...] = ()
    for _ in range(TRIES):
        others = generator.uniform(-1.0, 1.0, 2 * automaton.size - 2)
        others[::2] *= reach
        others[1::2] *= speed
        velocity = side * float(generator.uniform(0.0, speed))
        section = (velocity, *others.tolist())
        if _within(automaton, wall, section):
            break
        reach *= GROWTH
    return State(wall, phase, section[0], others=section[1:])


def _within(automaton: Automaton, wall: int, section: tuple[float, ...]) -> bool:
    """Whether a state before an impact is within the other guards of its mode."""
    x, _ = automaton.before(wall, section)
    own = set(automaton.guards[wall].modes)
    return all(
        guard.side * (place - row @ np.array(x)) >= 0.0
        for k, (guard, row, place) in enumerate(
            zip(automaton.guards, automaton.rows, automaton.positions, strict=True)
        )
        if k != wall and own & set(guard.modes)
    )
