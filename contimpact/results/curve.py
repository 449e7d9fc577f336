"""Curves in two parameters, the areas between them, and how curves compete."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array
from ..bifurcations.declarations import CROSSINGS, REQUESTED
from ..bifurcations.kind import kind_of
from ..continuation.branch import End
from ..display import Summary, limit_lines
from ..errors import count_text
from ..schema import attribute, documented
from .branch import Columns

# Areas of two parameters in which the same stable orbits end in the same way.

Ring = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class StableOrbit:
    """A stable physical orbit of an area, and what ends it."""

    word: str
    period: int
    notation: str
    """`word`, `period`, `notation`: the orbit."""
    ends: str | None
    """Label of the bifurcation that it meets first as the parameter along the y axis falls; why its
    branch ends if it meets none; None where it goes on to the end of the range."""
    kind: str | None = None
    """Kind of the bifurcation."""
    criticality: str | None = None
    mechanisms: Sequence[int] = ()
    """How it gives way to an orbit with one impact more, 1 to 4 as in `GrazingTransition`: all that
    runs inside the area show, none if they do not decide."""

    def __str__(self) -> str:
        told = f"{self.notation} until {self.ends}" if self.ends else f"{self.notation} throughout"
        told += f" ({self.criticality})" if self.criticality else ""
        many = " or ".join(map(str, self.mechanisms))
        return told + (f", mechanism {many}" if many else "")


@dataclass(frozen=True)
class Doubt:
    """A place in an area where a run sees something else: what is stable there and how it ends, or
    that it ends on no curve, in words."""

    across: float
    along: float
    says: str


@dataclass(frozen=True)
class Area:
    """A part of a rectangle of two parameters, its borders those of curves."""

    id: str
    fixed: Mapping[str, float]
    """The family's parameter."""
    across: str
    along: str
    """`across`, `along`: the parameters: the second one, and the one that falls."""
    orbits: Sequence[StableOrbit]
    """Orbits that are stable in it: several where there is bistability, none where no orbit of the
    scene's words is stable."""
    polygon: Sequence[Ring]
    """Coordinates of a GeoJSON polygon: points (across, along), the outer ring first,
    counter-clockwise, then holes; the last point of a ring is its first."""
    borders: Sequence[Sequence[tuple[int, str]]]
    """The number of a point of each ring and what the border is from there on: a curve's name (or
    several, of curves that lie one on another), ``side`` of the rectangle, or ``line``, a vertical
    line below which the order of the curves changes."""
    part: float
    """Part of the rectangle that it covers."""
    places: Sequence[tuple[float, float]]
    """Points (across, along) in it, one for each of its cells, at which runs have looked."""
    checked: int
    """Cells in it of which all runs say the same, two at least."""
    doubtful: Sequence[Doubt] = ()
    """Places where another run says something else."""
    departure: float = 0.0
    """The largest distance, in the parameter that falls, between an end of a stable orbit in a run
    and the curve."""

    @property
    def bistable(self) -> bool:
        """Whether several orbits are stable."""
        return len(self.orbits) > 1

    def holds(self, across: float, along: float) -> bool:
        """Return whether a point lies in its polygon."""
        crossed = sum(_count_crossings(np.asarray(ring), across, along) for ring in self.polygon)
        return crossed % 2 == 1

    def __str__(self) -> str:
        held = text_of_orbits(self.orbits)
        told = (
            f"{self.id}  {fixed_text(self.fixed)}{held}: {100.0 * self.part:.3g} % of the rectangle"
        )
        if self.doubtful:
            places = [f"{d.across:.6g}, {d.along:.6g}: {d.says}" for d in self.doubtful]
            told += f"; a run says otherwise at ({self.across}, {self.along}) = {places[0]}"
            told += f" and {len(places) - 1} more" if len(places) > 1 else ""
        return told


def fixed_text(fixed: Mapping[str, float], after: str = "  ") -> str:
    """Return a member of a family in words, with something after each value."""
    return "".join(f"{name} = {value:.6g}{after}" for name, value in fixed.items())


def text_of_orbits(orbits: Sequence[StableOrbit]) -> str:
    """Return what is stable somewhere. Orbits of other words than the scene's are not looked at."""
    return " and ".join(map(str, orbits)) or "no stable orbit of the scene's words"


def panel_areas(
    areas: Sequence[Area], fixed: Mapping[str, float], across: str, along: str
) -> list[Area]:
    """Return the areas of one member of a family in one plane that have stable orbits."""
    return [
        area
        for area in areas
        if (dict(area.fixed), area.across, area.along) == (dict(fixed), across, along)
        and area.orbits
    ]


def _count_crossings(ring: np.ndarray, x: float, y: float) -> int:
    """How often a ring crosses the line upwards from a point."""
    (a, b), (c, d) = ring[:-1].T, ring[1:].T
    passes = (a <= x) != (c <= x)
    with np.errstate(all="ignore"):
        heights = b + (d - b) * (x - a) / (c - a)
    return int(np.sum(passes & (heights > y)))


@dataclass(frozen=True)
class Codim2:
    """A point of codimension two on a curve, as the catalogue records it."""

    id: str
    curve: str
    kind: str
    """`id`, `curve`, `kind`: PD-G, FB-G, BP-G, G-FB, G-PD, CP (cusp), GPD, DG (touch with zero
    acceleration), R1, R2, FB-PD (fold-flip), ..."""
    changes: str
    """Change that happens there."""
    parameters: Mapping[str, float]
    impacts: Sequence[Mapping[str, Any]]
    residual: float
    error: float
    """`residual`, `error`: of the curve's equations; a bound of the error of the second
    parameter."""
    orbit_period: float | None = attribute(default=None, silent=True)
    state: Sequence[float] | None = attribute(default=None, silent=True)
    """`orbit_period`, `state`: as of entries: where the period is free, and without impacts."""


@documented
@dataclass(frozen=True, eq=False)
class Curve(Columns):
    """A curve of bifurcations, as a table."""

    id: str = attribute("its name, such as `c1`")
    kind: str = attribute("the kind of bifurcation")
    label: str = attribute("the label of the entry it was started from")
    word: str = attribute("walls of its orbits in order")
    period: int = attribute("in forcing periods")
    notation: str = attribute("the orbit, as n:m/pT")
    parameters: tuple[str, ...] = attribute(
        "the branch's parameter and the second one; on curves of points of codimension two "
        "also the third one"
    )
    columns: Mapping[str, Array] = attribute(
        "as of a branch; `n_unstable`, `physical` and `reason` leave the bifurcation itself out"
    )
    ends: tuple[End, End] = attribute("how it ends at its first and at its last point")
    points: Sequence[Codim2] = attribute(
        "the points of codimension two on it, in order", name="codimension2"
    )
    origin: str = attribute("the entry it was started from", name="from")
    missed: Sequence[str] = attribute(
        "points of codimension two that may be missing, with the reason", ()
    )
    fixed: Mapping[str, float] = attribute("values of a family's parameters", {})
    evaluations: int = field(default=0, compare=False)
    """Flights evaluated to follow it; not written to files."""
    branch: str = attribute(
        "the branch of the entry it was started from; empty in files of earlier versions", ""
    )

    @property
    def ghost(self) -> Array:
        """Whether the bifurcation is a ghost, point by point."""
        return np.asarray((self["n_unstable"] > 0) | (self["physical"] == 0))

    @property
    def ghost_pieces(self) -> Array:
        """Whether it is one from each point on; at a marked point the next one tells."""
        ghost = self.ghost
        if "event" in self.columns:
            marked = np.nonzero(self["event"][:-1] != "")[0]
            ghost[marked] = ghost[marked + 1]
        return ghost

    def summary(self) -> Summary:
        """Return the curve's points of codimension two and its ends in short."""
        names = self.parameters
        rows = [
            (p.id, p.kind, *(p.parameters[n] for n in names), f"{p.error:.1g}", p.changes)
            for p in self.points
        ]
        notes = [f"end: {end.message}" for end in self.ends]
        notes += [f"not located: {text}" for text in self.missed]
        return Summary(self._head(), ("", "point", *names, "error", "changes"), rows, notes)

    def _head(self) -> str:
        what = f"{self.label} in ({', '.join(self.parameters)})"
        return self._head_of(what, self.parameters[-1])

    def __repr__(self) -> str:
        points = [f"  {p.kind:6} {self._place(p)}: {p.changes}" for p in self.points]
        tail = [f"  end: {end.message}" for end in self.ends]
        tail += [f"  not located: {len(self.missed)}"] if self.missed else []
        return limit_lines(self._head(), points, tail)

    def _place(self, point: Codim2) -> str:
        return ", ".join(f"{name} = {point.parameters[name]:.12g}" for name in self.parameters)


@dataclass(frozen=True)
class CheckedOrbit:
    """What a one-parameter run says of one of the orbits of a word: of one branch."""

    first: str
    curve: str
    """`first`, `curve`: label of its first real bifurcation, and the curve that passes there; empty
    without one."""
    curves: Mapping[str, Sequence[float]]
    """The curves on which its real bifurcations lie, and the values of the parameter that falls."""


@dataclass(frozen=True)
class Check:
    """What a one-parameter run says comes first."""

    fixed: Mapping[str, float]
    """The family's parameter."""
    word: str
    period: int
    notation: str
    """`word`, `period`, `notation`: the orbit."""
    second: str
    value: float
    """Value of the second parameter."""
    first: str | None
    """Label of the first real bifurcation, as the parameter that `regions` go by falls."""
    orbits: Sequence[CheckedOrbit] = ()
    """The same of each branch; none in files of earlier versions."""


@dataclass(frozen=True)
class Coverage:
    """What lines across a map of curves say of its completeness."""

    fixed: Mapping[str, float]
    """The family's parameter."""
    word: str
    period: int
    notation: str
    """`word`, `period`, `notation`: the orbit."""
    lines: Mapping[str, Sequence[float]]
    """Values of each of the two parameters at which it was held in runs."""
    entries: int
    """Entries that these runs met, all on curves but those below."""
    started: int
    """Curves that were started from them."""
    uncovered: Sequence[Mapping[str, Any]]
    """Entries that lie on no curve: `kind`, the two parameters, and `reason`."""
    complete: bool
    """Whether the last lines met nothing that was not on a curve, none left anything out, and each
    followed the physical orbits of this word that others, or curves, had shown to cross it."""
    born: int = 0
    """Curves that were started at points of codimension two on others."""
    switched: bool = False
    """Whether these orbits were reached by switching from those of a word of the scene."""
    branches: int | None = None
    """How many branches of these orbits the lines followed; absent in earlier files."""
    left_out: Sequence[str] = field(default_factory=list)
    """What lines left out, with the limit of the scene or the reason, and the line."""
    quiet: bool | None = attribute(default=None, silent=True)
    """Where it is not complete, whether the last lines met nothing that was not on a curve; absent
    in earlier files."""

    @property
    def place(self) -> str:
        """The member of the family, in words."""
        return fixed_text(self.fixed)

    def __str__(self) -> str:
        lines = " and ".join(
            f"{count_text(len(v), 'line')} at values of {n}" for n, v in self.lines.items()
        )
        entries = count_text(self.entries, "entry", "entries")
        told = f"{self.notation}: {entries} on {lines}, {count_text(self.started, 'curve')} started"
        told += f", {self.born} more at points of codimension two" if self.born else ""
        if self.switched:
            told += "; reached by switching alone, not searched for"
        if self.switched and self.branches == 0:
            told += (
                "; no line followed these orbits, so further curves of theirs may be missing: "
                "name the word in follow.orbits, or raise follow.depth"
            )
        elif not (self.complete or self.quiet):
            told += "; the last lines still met new curves: give curves.cover a larger number"
        if self.uncovered:
            places = ", ".join(
                " ".join(f"{k} = {v:.6g}" if isinstance(v, float) else str(v) for k, v in u.items())
                for u in self.uncovered[:SHOWN]
            )
            more = f" and {len(self.uncovered) - SHOWN} more" if len(self.uncovered) > SHOWN else ""
            told += f"; on no curve: {places}{more}"
        if self.left_out:
            more = f" and {len(self.left_out) - SHOWN} more" if len(self.left_out) > SHOWN else ""
            told += f"; left out: {', '.join(self.left_out[:SHOWN])}{more}"
            if self.quiet and any(NOT_SOLVED in what for what in self.left_out):
                told += (
                    "; where orbits were not solved, give a smaller curves.max_step, or slightly "
                    "other ranges, which lay the lines elsewhere"
                )
        return told


SHOWN = 4
"""Entries on no curve that are named."""

NOT_SOLVED = "not solved"
"""What is said of orbits that a line left out because no step led on to them."""


# Which bifurcation comes first: the competition of curves in two parameters.
#
# For a family member and an orbit, every curve is read as the first parameter over the second one,
# or as a derived parameter that is the first one rescaled. As it falls, the orbit meets the curve
# with the largest value first that is no ghost; where curves cross, the order changes. Of orbits of
# one word runs tell which curves are whose: those that one branch meets. Without runs all are one.

BIRTHS = ("FB", "V")
"""Kinds at which an orbit comes into being as often as it ends: others compete without them."""
LOOKS = 8
"""Places between two special points at which it is asked what comes first."""
HALVINGS = 40
SAME_EDGE = 1e-9
"""Edges of regions closer than this part of the whole are one."""


@dataclass(frozen=True)
class Region:
    """A range of the second parameter in which one bifurcation comes first as another one falls."""

    fixed: Mapping[str, float]
    """The family's parameter."""
    notation: str
    """The orbit."""
    second: str
    low: float
    high: float
    first: str
    """Label of the bifurcation that comes first."""
    checked: Sequence[float] = ()
    """Values at which a one-parameter run says so too. Without any, other curves may come first."""
    doubtful: Sequence[float] = ()
    """Values at which a one-parameter run says otherwise."""
    period: int = 1
    """Period of the orbit."""
    along: str = ""
    """The parameter that falls."""
    branch: str = ""
    """The orbit among those of its word, by a branch: that on which the curve began that comes
    first; empty where a file of an earlier version does not say."""
    curves: tuple[str, ...] = ()
    """The curves that come first, in turn."""

    @property
    def said(self) -> str:
        """What one-parameter runs say of it, in words; empty where they agree."""
        if self.doubtful:
            places = ", ".join(f"{value:.6g}" for value in self.doubtful)
            return f"a run says otherwise at {self.second} = {places}"
        return "" if self.checked else "not checked by a run"


# How curves are told from each other.

FURTHER = ("#000000", "#7B3294", "#8C510A", "#1B4F9C", "#C51B7D", "#5F6B00", "#808080")
"""Colours of further bifurcations of a kind."""


class Key(NamedTuple):
    """What a colour stands for: a bifurcation of an orbit."""

    kind: str
    label: str
    notation: str


def key_of(curve: Curve) -> Key:
    """Return the bifurcation that a curve is of."""
    return Key(curve.kind, curve.label, curve.notation)


def keys_of(curves: Sequence[Curve]) -> list[Key]:
    """Return the bifurcations: of grazings of an orbit those first after which it hits the first
    wall more often, so that G is green to 3:1 and black to 2:2, as in the paper's Fig. 6."""
    kinds = list(dict.fromkeys(curve.kind for curve in curves))
    words = list(dict.fromkeys(curve.notation for curve in curves))

    def rank(key: Key) -> tuple[int, int, list[int]]:
        onto = key.label.partition("->")[2]
        counts = [-int(number) for number in re.findall(r"\d+", onto)]
        return words.index(key.notation), kinds.index(key.kind), counts

    return sorted(dict.fromkeys(map(key_of, curves)), key=rank)


def colour_of(key: Key, keys: Sequence[Key]) -> str:
    """Return the kind's colour for the first bifurcation of a kind; a colour of its own for each
    other."""
    firsts = {other.kind: other for other in reversed(keys)}
    if firsts[key.kind] == key:
        return kind_of(key.kind).look.colour
    others = [other for other in keys if firsts[other.kind] != other]
    return FURTHER[others.index(key) % len(FURTHER)]


# Curves by their panels.


def panels(curves: Sequence[Curve]) -> list[list[Curve]]:
    """Return the curves by member of the family and pair of parameters."""
    groups: dict[Any, list[Curve]] = {}
    for curve in curves:
        groups.setdefault((tuple(curve.fixed.items()), curve.parameters), []).append(curve)
    return list(groups.values())


def falling_column(panel: Sequence[Curve]) -> str:
    """Return the column that falls: the first parameter as it is best known.

    It is a derived parameter that is the first one, or its reciprocal, times a constant, such as
    ``d`` of the impact pair where s or A is followed; the first one itself if there is none.
    """
    first = panel[0].parameters[0]
    values = np.concatenate([c[first] for c in panel])
    for name in panel[0].parameter_columns:
        if name in panel[0].parameters or np.ptp(values) == 0.0:
            continue
        others = np.concatenate([c[name] for c in panel])
        with np.errstate(all="ignore"):
            constants = (others / values, others * values)
        if np.ptp(others) > 0.0 and any(np.ptp(c) < 1e-9 * abs(c[0]) for c in constants):
            return name
    return first


def regions(
    curves: Sequence[Curve], along: str | None = None, checks: Sequence[Check] = ()
) -> list[Region]:
    """Return the regions of all members and words along the column that falls, by default that of
    `falling_column`; `checks` are what one-parameter runs say."""
    found: list[Region] = []
    for panel in panels(competing_curves(curves)):
        column = along or falling_column(panel)
        words = dict.fromkeys((curve.word, curve.period) for curve in panel)
        for word in words:
            own = [c for c in panel if (c.word, c.period) == word]
            about = dict(own[0].fixed), own[0].parameters[1], word
            runs = [c for c in checks if (dict(c.fixed), c.second, (c.word, c.period)) == about]
            found += _regions(own, column, runs)
    return [_compare_region(region, checks) for region in found]


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


def competing_curves(curves: Sequence[Curve]) -> Sequence[Curve]:
    """Return the curves that say what comes first.

    Folds and zero velocities, at which an orbit may just as well be born, are left out of the
    curves of an orbit that has others; `Area` tells which they are.
    """
    having = {(c.word, c.period) for c in curves if c.kind not in BIRTHS}
    return [c for c in curves if c.kind not in BIRTHS or (c.word, c.period) not in having]


def _compare_region(region: Region, checks: Sequence[Check]) -> Region:
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
    ends = _ends(group, second)
    edges = unique_values([*ends, *crossings], SAME_EDGE * (max(ends) - min(ends)))
    labels = [curve.label for curve in group]
    rows: list[_Row] = []
    for left, right in itertools.pairwise(edges):
        for start, end, firsts in _pieces(
            lambda value: _firsts_at(group, second, along, value, checks), left, right
        ):
            before = [row for row in rows if row.high == start]
            for curve, row in zip(firsts, _continued_rows(firsts, before, labels), strict=True):
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


def _continued_rows(
    firsts: Firsts, before: Sequence[_Row], labels: Sequence[str]
) -> list[_Row | None]:
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
            cut = _bisect(firsts_at, firsts, before, after)
            yield low, cut, firsts
            low, firsts = cut, further
    yield low, right, firsts


def _bisect(of: Callable[[float], object], value: object, low: float, high: float) -> float:
    """Where a function no longer has the value that it has at the lower end."""
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if of(middle) == value else (low, middle)
    return high


def unique_values(values: Sequence[float], distance: float) -> list[float]:
    """Return values in order, without those that are another one found twice."""
    kept: list[float] = []
    for value in sorted(values):
        if not kept or value - kept[-1] > distance:
            kept.append(value)
    return kept


def _ends(group: Sequence[Curve], second: str) -> list[float]:
    """Where curves end or turn, or become ghosts."""
    found = []
    for curve in group:
        x, ghost = curve[second], ghost_mask(curve)
        turns = np.nonzero(np.diff(x)[:-1] * np.diff(x)[1:] < 0.0)[0] + 1
        changes = np.nonzero(ghost[1:] != ghost[:-1])[0] + 1
        found += [float(x[row]) for row in (0, -1, *changes)]
        found += [_turn(curve, x, row) for row in turns.tolist()]
    return found


def _turn(curve: Curve, x: Array, row: int) -> float:
    """Where a curve turns beside a row: the extremum of a quartic in arclength."""
    plain = np.nonzero(curve["event"].astype(str) == "")[0]
    place = int(np.searchsorted(plain, row))
    near = plain[max(0, place - 2) : place + 3]
    s = curve["arclength"][near] - curve["arclength"][row]
    if len(near) < 3 or not np.all(np.diff(s) > 0.0):
        return float(x[row])
    quartic = np.polynomial.Polynomial.fit(s, x[near], len(near) - 1)
    roots = quartic.deriv().roots()
    inside = roots.real[
        (np.abs(roots.imag) < SAME_EDGE) & (s[0] < roots.real) & (roots.real < s[-1])
    ]
    return float(quartic(min(inside, key=abs))) if len(inside) else float(x[row])


def ghost_mask(curve: Curve) -> Array:
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
    x, ghost = curve[second] - value, ghost_mask(curve)
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
    falls = not x[row + 1] >= 0.0
    place = _bisect(lambda at: _cubic(s, across, at) >= 0.0, falls, 0.0, s[row + 1 - first])
    return _cubic(s, up, place)


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
