"""Which bifurcation comes first: the competition of curves in two parameters.

For a family member and an orbit, every curve is read as the first parameter over the second one,
or as a derived parameter that is the first one rescaled. As it falls, the orbit meets the curve
with the largest value first that is no ghost; where curves cross, the order changes. Of orbits of
one word runs tell which curves are whose: those that one branch meets. Without runs all are one.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array
from ..bifurcations.declarations import CROSSINGS, REQUESTED
from .curve import Curve
from .tables import first_unknown

if TYPE_CHECKING:
    from .curve import Check, CheckedOrbit

BIRTHS = ("FB", "V")
"""Kinds at which an orbit comes into being as often as it ends: others compete without them."""
LOOKS = 8
"""Places between two special points at which it is asked what comes first."""
HALVINGS = 40
SAME_EDGE = 1e-9
"""Edges of regions closer than this part of the whole are one."""


@dataclass(frozen=True)
class Region:
    """A range of the second parameter in which one bifurcation comes first as another one falls.

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
    along : str
        The parameter that falls.
    branch : str
        The orbit among those of its word, by a branch: that on which the curve began that comes
        first; empty where a file of an earlier version does not say.
    curves : sequence of str
        The curves that come first, in turn.
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
    along: str = ""
    branch: str = ""
    curves: tuple[str, ...] = ()

    @property
    def said(self) -> str:
        """What one-parameter runs say of it, in words; empty where they agree."""
        if self.doubtful:
            places = ", ".join(f"{value:.6g}" for value in self.doubtful)
            return f"a run says otherwise at {self.second} = {places}"
        return "" if self.checked else "not checked by a run"


def panels(curves: Sequence[Curve]) -> list[list[Curve]]:
    """Return the curves by member of the family and pair of parameters."""
    groups: dict[Any, list[Curve]] = {}
    for curve in curves:
        groups.setdefault((tuple(curve.fixed.items()), curve.parameters), []).append(curve)
    return list(groups.values())


def falling(panel: Sequence[Curve]) -> str:
    """Return the column that falls: the first parameter as it is best known.

    It is a derived parameter that is the first one, or its reciprocal, times a constant, such as
    ``d`` of the impact pair where s or A is followed; the first one itself if there is none.
    """
    first = panel[0].parameters[0]
    values = np.concatenate([c[first] for c in panel])
    for name in parameters_of(panel[0]):
        if name in panel[0].parameters or np.ptp(values) == 0.0:
            continue
        others = np.concatenate([c[name] for c in panel])
        with np.errstate(all="ignore"):
            constants = (others / values, others * values)
        if np.ptp(others) > 0.0 and any(np.ptp(c) < 1e-9 * abs(c[0]) for c in constants):
            return name
    return first


def parameters_of(curve: Curve) -> list[str]:
    """Return the names of all parameters, derived ones included."""
    names = list(curve.columns)
    return names[names.index("arclength") + 1 : first_unknown(names)]


def regions(
    curves: Sequence[Curve], along: str | None = None, checks: Sequence[Check] = ()
) -> list[Region]:
    """Return the regions of all members and words.

    Parameters
    ----------
    curves : sequence of Curve
    along : str, optional
        The column that falls; that of `falling` by default.
    checks : sequence of Check
        What one-parameter runs say.
    """
    found: list[Region] = []
    for panel in panels(competing(curves)):
        column = along or falling(panel)
        words = dict.fromkeys((curve.word, curve.period) for curve in panel)
        for word in words:
            own = [c for c in panel if (c.word, c.period) == word]
            found += _regions(own, column, [c for c in checks if _of(c, own[0], word)])
    return [_compared(region, checks) for region in found]


def _of(check: Check, curve: Curve, word: tuple[str, int]) -> bool:
    """Whether a run is one of a word, for the member and the second parameter of a curve."""
    about = dict(check.fixed), check.second, (check.word, check.period)
    return about == (dict(curve.fixed), curve.parameters[1], word)


def lanes(found: Sequence[Region]) -> list[int]:
    """Return in which lane each region is drawn, so that those of two orbits of a word that share
    values stand beside each other."""
    taken: list[tuple[str, list[Region]]] = []
    numbers = []
    for region in found:
        free = (
            number
            for number, (notation, others) in enumerate(taken)
            if notation == region.notation
            and all(region.low >= one.high or region.high <= one.low for one in others)
        )
        number = next(free, len(taken))
        if number == len(taken):
            taken.append((region.notation, []))
        taken[number][1].append(region)
        numbers.append(number)
    return numbers


def competing(curves: Sequence[Curve]) -> Sequence[Curve]:
    """Return the curves that say what comes first.

    Folds and zero velocities, at which an orbit may just as well be born, are left out of the
    curves of an orbit that has others; `Area` tells which they are.
    """
    having = {(c.word, c.period) for c in curves if c.kind not in BIRTHS}
    return [c for c in curves if c.kind not in BIRTHS or (c.word, c.period) not in having]


def _compared(region: Region, checks: Sequence[Check]) -> Region:
    """A region with what the runs inside it say."""
    inside = [
        check
        for check in checks
        if (dict(check.fixed), check.notation, check.second)
        == (dict(region.fixed), region.notation, region.second)
        and region.low < check.value < region.high
    ]
    agree = sorted(c.value for c in inside if _agrees(c, region))
    return replace(region, checked=agree, doubtful=sorted({c.value for c in inside} - {*agree}))


def _agrees(check: Check, region: Region) -> bool:
    """Whether a run says the same of one of its orbits."""
    if not check.orbits:
        return check.first == region.first
    return any(o.first == region.first and o.curve in region.curves for o in check.orbits)


def _regions(group: Sequence[Curve], along: str, checks: Sequence[Check]) -> list[Region]:
    second = group[0].parameters[1]
    crossings = [p.parameters[second] for c in group for p in c.points if p.kind in CROSSINGS]
    low = min(float(c[second].min()) for c in group)
    high = max(float(c[second].max()) for c in group)
    edges = _apart([low, high, *crossings, *_ends(group, second)], SAME_EDGE * (high - low))
    labels = [curve.label for curve in group]
    rows: list[_Row] = []
    for left, right in itertools.pairwise(edges):
        for start, end, firsts in _pieces(
            lambda value: _firsts_at(group, second, along, value, checks), left, right
        ):
            before = [row for row in rows if row.high == start]
            for curve, row in zip(firsts, _continued(firsts, before, labels), strict=True):
                if row is None:
                    rows.append(_Row([curve], start, end))
                else:
                    row.high, row.curves = end, [*row.curves, curve]
    return [row.region(group, along) for row in rows]


@dataclass
class _Row:
    """A region as it grows: the places of the curves that come first, in turn."""

    curves: list[int]
    low: float
    high: float

    def region(self, group: Sequence[Curve], along: str) -> Region:
        curve, names = group[self.curves[0]], [group[place].id for place in self.curves]
        about = curve.fixed, curve.notation, curve.parameters[1], self.low, self.high, curve.label
        branch, curves = curve.branch, tuple(dict.fromkeys(names))
        return Region(*about, period=curve.period, along=along, branch=branch, curves=curves)


def _continued(firsts: Firsts, before: Sequence[_Row], labels: Sequence[str]) -> list[_Row | None]:
    """The rows that curves continue: those of the same curve, else the only one of its label."""
    own = {row.curves[-1]: row for row in before}
    ended = [labels[curve] for curve in own if curve not in firsts]
    begun = [labels[curve] for curve in firsts if curve not in own]
    once = {label for label in begun if begun.count(label) == ended.count(label) == 1}
    by_label = {labels[c]: row for c, row in own.items() if c not in firsts and labels[c] in once}
    return [own.get(curve, by_label.get(labels[curve])) for curve in firsts]


Firsts = tuple[int, ...]
"""The places of the curves that come first, one of each orbit."""


def _pieces(
    firsts_at: Callable[[float], Firsts], left: float, right: float
) -> Iterator[tuple[float, float, Firsts]]:
    """A range between special points, in parts: curves of different orbits cross unmarked."""
    places = left + (right - left) * (np.arange(LOOKS) + 0.5) / LOOKS
    seen = [(place, firsts_at(place)) for place in places.tolist()]
    low, firsts = left, seen[0][1]
    for (before, _), (after, further) in itertools.pairwise(seen):
        if further != firsts:
            cut = _exchange(firsts_at, firsts, before, after)
            yield low, cut, firsts
            low, firsts = cut, further
    yield low, right, firsts


def _exchange(
    firsts_at: Callable[[float], Firsts], firsts: Firsts, low: float, high: float
) -> float:
    """Where these no longer come first, by bisection."""
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if firsts_at(middle) == firsts else (low, middle)
    return high


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


def _firsts_at(
    group: Sequence[Curve], second: str, along: str, value: float, checks: Sequence[Check]
) -> Firsts:
    """The curves that come first at a value of the second parameter, one of each orbit."""
    orbits = _orbits_near(value, checks)
    best: dict[int | None, tuple[float, int]] = {}
    for place, curve in enumerate(group):
        for height in real_heights(curve, second, along, value):
            orbit = _orbit_of(curve.id, height, orbits)
            if orbit not in best or height > best[orbit][0]:
                best[orbit] = height, place
    return tuple(sorted({place for _, place in best.values()}))


def _orbits_near(value: float, checks: Sequence[Check]) -> Sequence[CheckedOrbit]:
    """What the nearest run says of orbits."""
    known = [check for check in checks if check.orbits]
    return min(known, key=lambda check: abs(check.value - value)).orbits if known else ()


def _orbit_of(curve: str, height: float, orbits: Sequence[CheckedOrbit]) -> int | None:
    """The orbit of which a curve passes a place: the nearest place at which a run has met it."""
    places = [
        (abs(place - height), number)
        for number, orbit in enumerate(orbits)
        for place in orbit.curves.get(curve, ())
    ]
    return min(places)[1] if places else None


def real_heights(curve: Curve, second: str, along: str, value: float) -> list[float]:
    """Return a column's values wherever a curve that is no ghost passes a parameter's value."""
    x, ghost = curve[second] - value, ghostly(curve)
    rows = np.nonzero((x[:-1] >= 0.0) != (x[1:] >= 0.0))[0].tolist()
    return [_height(curve, x, curve[along], row) for row in rows if not ghost[row]]


def _height(curve: Curve, x: Array, y: Array, row: int) -> float:
    """Where x is zero between a row and the next, y on cubics in arclength through four rows."""
    first = max(0, min(row - 1, len(x) - 4))
    near = slice(first, first + 4)
    s = (curve["arclength"][near] - curve["arclength"][row]).tolist()
    if len(s) < 4 or not all(one < other for one, other in itertools.pairwise(s)):
        return float(y[row] + (y[row + 1] - y[row]) * x[row] / (x[row] - x[row + 1]))
    across, up = _differences(s, x[near].tolist()), _differences(s, y[near].tolist())
    low, high = 0.0, s[row + 1 - first]
    rises = x[row + 1] >= 0.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        below = (_cubic(s, across, middle) >= 0.0) != rises
        low, high = (middle, high) if below else (low, middle)
    return _cubic(s, up, high)


def _differences(s: Sequence[float], values: Sequence[float]) -> list[float]:
    """The divided differences of Newton's interpolation."""
    found = list(values)
    for order in range(1, len(s)):
        for i in range(len(s) - 1, order - 1, -1):
            found[i] = (found[i] - found[i - 1]) / (s[i] - s[i - order])
    return found


def _cubic(s: Sequence[float], differences: Sequence[float], at: float) -> float:
    total = 0.0
    for place, difference in zip(reversed(s), reversed(differences), strict=True):
        total = total * (at - place) + difference
    return total
