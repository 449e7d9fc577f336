"""Whether stated laws repeat after the period that is stated, and after which they would.

Laws are evaluated at random times, states and parameter values, without SymPy.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from random import Random
from typing import Protocol, TypeAlias

from ..errors import InputError, shortened
from .expressions import number

Timed: TypeAlias = Callable[[float], float]
"""A law as a function of the time alone."""
TIMES, FAR = 7, 1e3
MOST = 12
"""How many times a period, or what part of it, is tried in its place."""
TOLERANCE = 1e-6
"""Of what a law varies by in time."""
ROUNDING = 1e-12
"""Of a law's size."""


class Stated(Protocol):
    """What a scene states."""

    @property
    def period(self) -> str:
        """An expression of the parameters."""

    def in_time(self, values: Mapping[str, float]) -> dict[str, Timed]:
        """Return the laws in which the time stands, by their keys, at a state and the values."""

    def angles(self, values: Mapping[str, float]) -> Sequence[Timed]:
        """Return what the sines and cosines of the time are of."""


def check_period(stated: Stated, values: Mapping[str, float]) -> None:
    """Refuse a period of the forcing that is none, where a system is stated.

    Branches may lead to where there is none, and end on the way.

    Raises
    ------
    InputError
        With the place in the scene's table.
    """
    period = number(stated.period, "period", values)
    if not period > 0.0:
        raise InputError("period", f"it is {period:.6g}", "give the period of the forcing, above 0")
    said = f"it is {period:.6g} ({shortened(stated.period)}), after which"
    laws = stated.in_time(values)
    if wrong := _not_repeating(laws, period):
        accepted = "give one after which all laws repeat"
        for factor, other in _others(period, stated.angles(values)):
            if not _not_repeating(laws, other):
                accepted = f"they repeat after {other:.6g}"
                accepted += f", {factor} times as long" if factor else ""
                break
        raise InputError("period", f"{said} {wrong} does not repeat", accepted)
    random = Random(6)
    near = {n: v * random.uniform(0.9, 1.1) if v else 0.1 for n, v in values.items()}
    try:
        period = number(stated.period, "period", near)
    except InputError:
        return
    if period > 0.0 and (wrong := _not_repeating(stated.in_time(near), period)):
        found = f"{said} {wrong} repeats at these values of the parameters alone"
        raise InputError("period", found, "give the period as an expression of the parameters")


def _others(period: float, angles: Sequence[Timed]) -> list[tuple[str, float]]:
    """Periods that are tried in the place of one, from the shortest on: small multiples of it, and
    of those of sines and cosines."""
    numbers = range(1, MOST + 1)
    factors = sorted({Fraction(m, n) for m in numbers for n in numbers})
    found = [(str(factor), float(factor) * period) for factor in factors]
    rates = [abs(angle(1.0) - angle(0.0)) for angle in angles]
    found += [("", k * 2 * math.pi / rate) for rate in rates if rate > 0.0 for k in numbers]
    return sorted(found, key=lambda pair: pair[1])


def _not_repeating(laws: Mapping[str, Timed], period: float) -> str | None:
    """The key of a law that takes other values one period later."""
    return next((name for name, law in laws.items() if not _repeats(law, period)), None)


def _repeats(law: Timed, period: float) -> bool:
    random = Random(5)
    parts = [random.uniform(-1.0, 1.0) for _ in range(TIMES)]
    times = [period * part for part in parts]
    try:
        now, later = [law(t) for t in times], [law(t + period) for t in times]
        varied, size = max(now) - min(now), max(map(abs, (*now, *later)))
        apart = max(abs(a - b) for a, b in zip(now, later, strict=True))
        if apart > TOLERANCE * varied + ROUNDING * size:
            return False
        if varied > ROUNDING * size:
            return True
        elsewhere = [law(FAR * part) for part in parts]  # nothing happens in so short a time
    except InputError:  # without a value there
        return True
    return max(elsewhere) - min(elsewhere) <= ROUNDING * size


def at_times(text: str, values: Mapping[str, float], time: str) -> Timed:
    """Return an expression as a function of the time."""
    return lambda t: number(text, "period", {**values, time: t})
