"""Whether a model's flight, acceleration and harmonics state one motion, at random states."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from random import Random
from typing import Any

from ..errors import InputError
from ..storage.cache import logger
from .model import Model

TRIALS = 3
TOLERANCE = 1e-6
"""Of the largest velocity or acceleration: far above rounding, far below a wrong term."""
STEP = 1e-6
"""Of a flight's duration, for differences; their rounding is 1e-10, and as much is left out of
flights of a few periods of the forcing's highest harmonic."""


def check_motion(model: Model, wall: str, agreement: Callable[..., Sequence[float]]) -> None:
    """Compare the formulas of a model for the flight after a wall.

    Parameters
    ----------
    model : Model
    wall : str
    agreement : callable
        The kernel ``agreement`` of one coordinate; see `contimpact.segments.codegen`.

    Raises
    ------
    InputError
        Naming the wall and the formulas that contradict each other.
    """
    random = Random(0)
    mode = next((guard.next_mode for guard in model.WALLS if guard.name == wall), "")
    where = model.place("flight from", wall) + (f" in the mode {mode!r}" if model.MODES else "")
    compared = [_trial(model, agreement, random, where) for _ in range(TRIALS)]
    if not any(compared):
        logger(__name__).warning("%s has no value at random states: it is not checked", where)


def _trial(model: Model, agreement: Callable[..., Any], random: Random, where: str) -> bool:
    """One comparison; False where the formulas have no value."""
    values = _near(model, random)
    start = [random.uniform(-1, 1) for _ in range(model.unknowns_per_impact - 1)]
    try:
        period = agreement(0.0, *start, 0.0, *values)[0]
        phase, dt = period * random.random(), period * random.uniform(0.2, 1.2)
        step = STEP * dt
        if not step > 0.0:
            return False
        begun, behind, flown, ahead = (
            agreement(phase, *start, after, *values) for after in (0.0, dt - step, dt, dt + step)
        )
        later = agreement(phase + period, *start, dt, *values)
    except (ArithmeticError, ValueError):
        return False
    if not all(math.isfinite(n) for row in (begun, behind, flown, ahead, later) for n in row[:-1]):
        return False
    rate = ((dt + step) * ahead[2] - (dt - step) * behind[2]) / (2 * step)
    push = (ahead[3] - behind[3]) / (2 * step)
    speed = max(map(abs, (*begun[1:4], *flown[1:4], rate, dt * push, dt * flown[4])))
    for one, other, unit, found in (
        (begun[2], begun[1], speed, "its mean velocity does not begin as the velocity that reset"),
        (begun[3], begun[1], speed, "its end velocity does not begin as the velocity that reset"),
        (rate, flown[3], speed, "its mean velocity contradicts its end velocity"),
        (push, flown[4], speed / dt, "its velocity contradicts the acceleration"),
        (flown[4], later[4], speed / dt, "the acceleration does not have the forcing's period"),
        (flown[3], later[3], speed, "its end velocity does not have the forcing's period"),
        (flown[4], flown[5], speed / dt, "the harmonics contradict the acceleration"),
    ):
        if abs(one - other) > TOLERANCE * unit:
            accepted = f"check them by hand; here {_numbers(model, phase, dt, start, values)}"
            raise InputError(where, f"{found}: {one:.6g} against {other:.6g}", accepted)
    return True


def _numbers(
    model: Model, phase: float, dt: float, start: Sequence[float], values: Sequence[float]
) -> str:
    """The random numbers of a comparison, by name."""
    coordinates = ", ".join(f"{number:.6g}" for number in start)
    parameters = (f"{n} = {value:.6g}" for n, value in zip(model.values, values, strict=True))
    return (
        f"dt = {dt:.6g}, phase = {phase:.6g}, the section coordinates before the impact are "
        f"({coordinates}), {', '.join(parameters)}"
    )


def _near(model: Model, random: Random) -> list[float]:
    """Parameter values about the model's own, none of them a special one."""
    moved = {
        name: value * random.uniform(0.9, 1.1) if value else random.uniform(0.01, 0.1)
        for name, value in model.values.items()
    }
    try:
        return list(model.replace(**moved).values.values())
    except InputError:
        return list(model.values.values())
