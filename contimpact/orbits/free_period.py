r"""Orbits of systems without forcing: their period T is an unknown.

Neither has the clock of such an orbit a phase. It is set such that the orbit closes at t = 0: the
first passage is at t_1 = -T, and no unknown is added. That passage is a Poincare section, so that
no other condition fixes the phase. The last flight arrives at t = 0, whatever the unknowns are; its
column of t_1 vanishes (N = 3)::

    [ A1 B1      | L1 ]
    [    A2 B2   | L2 ]      B3' is B3 without its first column
    [ B3'   A3   | L3 ]

The multipliers are those of the section's return map, m - 1 of them. In their pencil the first
passage's time is held, and when the orbit returns is what follows: the first column is left out of
A1, not of B3. The multiplier 1 of the flow's direction becomes a 0 in that place, and is left out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..models.guards import following
from ..models.model import Model
from ..models.word import Word
from ..segments.kernels import Kernels
from ..segments.segment import Segment
from .problem import OrbitProblem

PROBES = 3
"""States at which it is seen whether a motion depends on the time."""

DURATIONS = tuple(0.25**k for k in range(6))
"""Of the flights from them, as long as too few have a value."""

NO_TIME = 1e-12
"""Part of a flight's velocity by which it may change with the time, where it should not."""

ASIDE = 0.1
"""By how much a followed parameter is moved to see whether it brings a forcing."""


class FreePeriodProblem(OrbitProblem):
    """The equations of a word in a system without forcing; see `OrbitProblem`."""

    autonomous = True

    def __init__(self, model: Model, word: Word, kernels: Kernels) -> None:
        super().__init__(model, word, kernels)
        require_no_forcing(model, kernels)

    def period(self, unknowns: Array) -> float:
        """Return the orbit's period."""
        return self.span(unknowns)

    def span(self, unknowns: Array) -> float:
        """Return the orbit's period."""
        return -float(unknowns[0])

    def closing(self, first: Any, period: Any) -> Any:
        """Return when an orbit closes: at t = 0."""
        return 0.0 * first

    def cyclic(self, start: Array, end: Array) -> Array:
        """Return the (n, n + free) cyclic matrix of flattened blocks."""
        end = end.copy()
        end[-self.m * self.m :: self.m] = 0.0
        return super().cyclic(start, end)

    def returned(self, moved: Sequence[float], mu: float) -> list[float]:
        """Return how the arrival at impact 1 moves: not in time."""
        return [0.0, *super().returned(moved[1:], mu)]

    def placed(self, rows: Array, span: float) -> Array:
        """Return an orbit's impacts in the clock in which it closes at t = 0."""
        rows = rows.copy()
        rows[:, 0] -= rows[0, 0] + span
        return rows

    def held(self, start: Array) -> Array:
        """Return the blocks A_k with the first passage's time held."""
        start = start.copy()
        start[0, :, 0] = 0.0
        return start

    def laps(self, first: Array, second: Array) -> Array:
        """Return the direction of the word run twice: one lap closes where the next starts."""
        first = first.copy()
        first[:: self.m] += second[0]
        return super().laps(first, second)


def require_no_forcing(model: Model, kernels: Kernels) -> None:
    """Raise `InputError` if motions depend on the time, or do so beside a followed parameter."""
    forced, unseen = _forced(kernels, model.values)
    if forced:
        found = f"it is free, and the flight {forced} depends on the time"
        accepted = "take the forcing away, as by a = 0, or leave the period to the forcing"
        raise InputError("period", found, accepted)
    if unseen:
        found = f"it is free, and the flight {unseen} has no value at random states, by which it "
        found += "is seen whether it depends on the time"
        raise InputError("period", found, "give parameter values at which it has")
    for name in kernels.parameters:
        value = model.values[name]
        aside = ASIDE * (abs(value) or 1.0)
        forced, unseen = _forced(kernels, {**model.values, name: value + aside})
        if unseen:
            forced, unseen = _forced(kernels, {**model.values, name: value - aside})
        if forced:
            found = f"motions depend on the time where {name} is not {value!r}"
            accepted = "follow another one: without forcing alone the period is free"
            raise InputError("parameter", found, accepted)
        if unseen:
            found = f"beside {name} = {value!r} the flight {unseen} has no value at random "
            found += "states, by which it is seen whether it depends on the time"
            raise InputError("parameter", found, "follow another one, or from another value")


def _forced(kernels: Kernels, values: Mapping[str, float]) -> tuple[str, str]:
    """A flight that changes where it is moved in time, or else one of which that cannot be seen."""
    guards, unseen = kernels.model.WALLS, ""
    for guard in guards:
        segment = kernels.segment(guard.name, following(guards, guard.name)[0])
        changes = list(islice(_changes(segment, kernels.model, list(values.values())), PROBES))
        if any(change > NO_TIME for change in changes):
            return segment.name, ""
        if not changes:
            unseen = segment.name
    return "", unseen


def _changes(segment: Segment, model: Model, values: list[float]) -> Iterator[float]:
    """By which parts of their velocities flights from random states change if moved in time.

    The long ones first: where a law has a pole, only short ones may have a value.
    """
    m = model.unknowns_per_impact
    for duration in DURATIONS:
        for one, other in np.random.default_rng(0).normal(size=(PROBES, 2, m - 1)).tolist():
            try:
                _, leaving, arriving, _ = segment.blocks([-duration, *one], [0.0, *other], values)
            except (ArithmeticError, ValueError):
                continue
            pairs = list(zip(leaving[::m], arriving[::m], strict=True))
            change = max(abs(by_start + by_end) for by_start, by_end in pairs)
            largest = max(abs(by_end) for _, by_end in pairs)
            if largest > 0.0 and math.isfinite(change / largest):
                yield change / largest
