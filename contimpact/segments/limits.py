"""Whether the motion after a guard begins within the guards of its mode.

A guard at which the motion comes to a switching surface leads to sliding, or, if sliding would
begin beyond the limit it names (`Guard.past`), through the surface. Where a flight begins on the
surface of a guard of its mode, the rate there says whether it leaves the mode at once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from ..models.guards import Guard, slides_at
from .kernels import Kernels
from .passages import ELSEWHERE

AT_REST = 1e-10
"""A rate below this part of what the acceleration makes in a period is rounding."""


def limits_of(kernels: Kernels, letter: str) -> list[tuple[str, str, float]]:
    """Return the limits that decide whether a guard is the one that is met.

    Returns
    -------
    list of (begun, limit, sign)
        The guard at which the motion would begin, its limit, and the side of it where it has to
        begin: +1 within, -1 beyond.
    """
    guards, passages = kernels.model.WALLS, kernels.passages
    place = kernels.model.letters.index(letter)
    guard = guards[place]
    if guard.past:
        sliding = slides_at(guards, guard)
        assert sliding is not None, "checked when the class is defined"
        return [(sliding.name, guard.past, -1.0)]
    tangent = [(letter, guards[k].name, 1.0) for k in passages.beginning(place)]
    if passages.arrivals[place][place] != ELSEWHERE:
        ahead = [
            (letter, guards[k].name, 1.0)
            for k in kernels.guards_ahead(place)
            # where a flight between the two vanishes, both are passed at once: a V
            if not (passages.meets_at_rest(place, k) or passages.meets_at_rest(k, place))
        ]
        return [*tangent, *ahead]
    limits = [
        other.name
        for k, other in enumerate(guards)
        if passages.watched[place][k]
        and other.coordinate == guard.coordinate
        and not passages.meets_at_rest(place, k)
        and k not in passages.beginning(place)
    ]
    return [*tangent, *((letter, limit, 1.0) for limit in limits)]


def on_surface(kernels: Kernels, begun: str, limit: str) -> bool:
    """Whether the motion after a guard begins on the surface of its limit, so that its rate tells
    on which side it goes on."""
    letters = kernels.model.letters
    return letters.index(limit) in kernels.passages.beginning(letters.index(begun))


def margin(
    kernels: Kernels,
    begun: str,
    limit: str,
    leave: Sequence[float],
    values: Sequence[float],
    positions: Sequence[float],
) -> float:
    """Return how far within a limit the motion would begin, or on its surface how fast it goes
    there; negative beyond it. Not a number where that is rounding, as it is along all of a branch
    where sliding ends.

    Parameters
    ----------
    leave : sequence of float
        The unknowns of the impact.
    values, positions : sequence of float
        Of the parameters, and of the guards.
    """
    position = positions[kernels.model.letters.index(limit)]
    begin, rate, curvature = kernels.gap(begun, limit)(*leave, 0.0, *values)
    gap = position - begin
    if on_surface(kernels, begun, limit):
        least = AT_REST * abs(curvature) * kernels.setup(*values).period
        gap = -rate if abs(rate) > least else math.nan
    return kernels.model.guard(limit).side * float(gap)


def not_past(
    kernels: Kernels,
    guard: Guard,
    leave: Sequence[float],
    values: Sequence[float],
    positions: Sequence[float],
) -> Iterator[tuple[str, float]]:
    """Yield the limit that a guard leads past, and by what (negative) gap it does not."""
    if guard.past:
        ((sliding, limit, _),) = limits_of(kernels, guard.name)
        within = margin(kernels, sliding, limit, leave, values, positions)
        if within > 0.0:
            yield limit, -within
