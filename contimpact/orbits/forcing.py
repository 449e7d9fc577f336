"""Whether motions depend on the time: where periods are free they must not."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from itertools import islice

import numpy as np

from ..errors import InputError
from ..models.guards import following
from ..models.model import Model
from ..segments.kernels import Kernels
from ..segments.segment import Segment

PROBES = 3
"""States at which it is seen whether a motion depends on the time."""

DURATIONS = tuple(0.25**k for k in range(6))
"""Of the flights from them, as long as too few have a value."""

NO_TIME = 1e-12
"""Part of a flight's velocity by which it may change with the time, where it should not."""

ASIDE = 0.1
"""By how much a followed parameter is moved to see whether it brings a forcing."""


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
