"""Which bifurcation comes first: the competition of curves in two parameters.

For a family member and a word, every curve is read as one quantity over the second parameter: the
system's principal derived parameter, or the branch's parameter. As it falls, the orbit first meets
the highest curve that is no ghost; where curves cross, the order changes.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array
from ..bifurcations.names import CROSSINGS, REQUESTED
from .curve import Curve
from .recovery import imported_system

if TYPE_CHECKING:
    from .curve import Check
    from .diagram import Diagram

SAME_EDGE = 1e-9
"""Edges of regions closer than this part of the whole are one."""


@dataclass(frozen=True)
class Region:
    """A range of the second parameter in which one bifurcation comes first.

    Attributes
    ----------
    fixed : mapping of str to float
        The family's parameter.
    notation : str
        The orbit.
    second : str
    low, high : float
    first : str
        Label of the bifurcation that comes first.
    checked : sequence of float
        Values at which a one-parameter run says so too. Without any, other curves may come first.
    doubtful : sequence of float
        Values at which a one-parameter run says otherwise.
    period : int
        Of the orbit.
    """

    fixed: Mapping[str, float]
    notation: str
    second: str
    low: float
    high: float
    first: str
    checked: Sequence[float] = ()
    doubtful: Sequence[float] = ()
    period: int = 1

    @property
    def said(self) -> str:
        """What one-parameter runs say of it, in words; empty where they agree."""
        if self.doubtful:
            places = ", ".join(f"{value:.6g}" for value in self.doubtful)
            return f"a run says otherwise at {self.second} = {places}"
        return "" if self.checked else "not checked by a run"


def competition(diagram: Diagram) -> list[Region]:
    """Return which bifurcation comes first on the curves of a diagram, region by region."""
    kind = imported_system(diagram.branches[0].system) if diagram.branches else None
    along = (kind and kind.PRINCIPAL) or diagram.curves[0].parameters[0]
    return regions(diagram.curves, along, diagram.checks)


def regions(curves: Sequence[Curve], along: str, checks: Sequence[Check] = ()) -> list[Region]:
    """Return the regions of all members and words.

    Parameters
    ----------
    curves : sequence of Curve
    along : str
        The column that falls.
    checks : sequence of Check
        What one-parameter runs say.
    """
    groups: dict[Any, list[Curve]] = {}
    for curve in curves:
        key = (tuple(curve.fixed.items()), curve.word, curve.period)
        groups.setdefault(key, []).append(curve)
    found = [region for group in groups.values() for region in _regions(group, along)]
    return [_compared(region, checks) for region in found]


def _compared(region: Region, checks: Sequence[Check]) -> Region:
    """A region with what the runs inside it say."""
    inside = [
        check
        for check in checks
        if (dict(check.fixed), check.notation, check.second)
        == (dict(region.fixed), region.notation, region.second)
        and region.low < check.value < region.high
    ]
    agree = sorted(c.value for c in inside if c.first == region.first)
    return replace(region, checked=agree, doubtful=sorted({c.value for c in inside} - {*agree}))


def _regions(group: Sequence[Curve], along: str) -> list[Region]:
    second = group[0].parameters[1]
    crossings = [p.parameters[second] for c in group for p in c.points if p.kind in CROSSINGS]
    low = min(float(c[second].min()) for c in group)
    high = max(float(c[second].max()) for c in group)
    edges = _apart([low, high, *crossings, *_ends(group, second)], SAME_EDGE * (high - low))
    found: list[Region] = []
    for left, right in itertools.pairwise(edges):
        label = _first_at(group, second, along, 0.5 * (left + right))
        if label is None:
            continue
        if found and found[-1].first == label and found[-1].high == left:
            left = found.pop().low
        one = group[0]
        found.append(Region(one.fixed, one.notation, second, left, right, label, period=one.period))
    return found


def _apart(values: Sequence[float], distance: float) -> list[float]:
    """Values in order, without those that are another one found twice: on both curves of two."""
    kept: list[float] = []
    for value in sorted(values):
        if not kept or value - kept[-1] > distance:
            kept.append(value)
    return kept


def _ends(group: Sequence[Curve], second: str) -> list[float]:
    """Where curves end or turn, or become ghosts."""
    found = []
    for curve in group:
        x, ghost = curve[second], ghostly(curve)
        turns = np.nonzero(np.diff(x)[:-1] * np.diff(x)[1:] < 0.0)[0] + 1
        changes = np.nonzero(ghost[1:] != ghost[:-1])[0] + 1
        found += [float(x[row]) for row in (0, -1, *turns, *changes)]
    return found


def ghostly(curve: Curve) -> Array:
    """Return whether a curve is a ghost between each point and the next.

    At a point of codimension two a multiplier or a gap is at its limit: rounding decides its own
    status, which therefore tells nothing of either side.
    """
    ghost, marked = curve.ghost, ~np.isin(curve["event"].astype(str), ("", REQUESTED))
    unknown = ghost | marked
    alone = marked[:-1] & marked[1:]
    return np.where(alone, ghost[:-1] & ghost[1:], unknown[:-1] & unknown[1:])


def _first_at(group: Sequence[Curve], second: str, along: str, value: float) -> str | None:
    best, label = -np.inf, None
    for curve in group:
        for height in real_heights(curve, second, along, value):
            if height > best:
                best, label = height, curve.label
    return label


def real_heights(curve: Curve, second: str, along: str, value: float) -> list[float]:
    """Return a column's values wherever a curve that is no ghost passes a parameter's value."""
    x, y, ghost = curve[second] - value, curve[along], ghostly(curve)
    rows = np.nonzero((x[:-1] >= 0.0) != (x[1:] >= 0.0))[0]
    return [
        float(y[i] + (y[i + 1] - y[i]) * x[i] / (x[i] - x[i + 1])) for i in rows if not ghost[i]
    ]
