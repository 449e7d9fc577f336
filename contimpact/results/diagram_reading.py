"""What a diagram says: where orbits are stable, where two of them are, and how one follows another.

Everything is derived from the branches and entries that were computed: what was not followed is not
read. Mechanisms are those of section 4.1 of the paper, for transitions from n:m to one impact more
per period:

1. a stable orbit grazes, and the new one is stable at once;
2. a stable orbit grazes onto an unstable one, which turns at a fold into a stable one;
3. the orbit has doubled its period before it would graze; the doubled orbits graze (PD_G) or their
   transients do (TG), bounded by the ghost grazing, while the new orbit is already stable or is
   stable from its grazing on;
4. as 3, but nothing that was followed of the old family is stable where the new orbit is born at a
   fold. The paper says that the fold quenches the complex motion in between; in Fig. 7 a boundary
   crisis ends it. It is read where crises were located.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from math import inf, isclose
from typing import Any, Protocol

import numpy as np

from ..bifurcations.doubling import PD
from ..bifurcations.fold import FB
from ..bifurcations.grazing import JUMP, G
from ..bifurcations.kind import Scenario
from ..continuation.branch import EndKind
from ..errors import explain_arguments
from .branch import UNKNOWN, Branch, Entry, find_imported_system


@dataclass(frozen=True)
class Interval:
    """A run of stable physical orbits on a branch.

    `low` and `high` are values of the followed parameter; `bounds` name what ends the run there: an
    entry, the end of the branch, or None where the status changes between points at no event that
    was looked for.
    """

    branch: str
    notation: str
    low: float
    high: float
    bounds: tuple[str | None, str | None]
    rows: tuple[tuple[int, int], ...] = field(default=(), repr=False, compare=False)
    """First and last row of each part of the branch that it consists of."""


@dataclass(frozen=True)
class Bistability:
    """Two stable physical orbits at the same parameter values."""

    branches: tuple[str, str]
    notations: tuple[str, str]
    low: float
    high: float


@dataclass(frozen=True)
class GrazingTransition:
    """A way from an orbit to one with one impact more."""

    source: str
    target: str
    """`source`, `target`: notations."""
    mechanism: int | None
    """1 to 4; None if the branches that were followed do not decide."""
    entry: str
    """The grazing."""
    grazing: float
    """Its parameter value."""
    doubling: str | None
    doubling_value: float | None
    """`doubling`, `doubling_value`: the period doubling at which the source loses stability before,
    if it does."""
    fold: str | None
    fold_value: float | None
    """`fold`, `fold_value`: the fold on the new branch between the grazing and its stable orbits,
    if any."""
    doubled_grazings: Sequence[tuple[str, float]]
    """Grazings of the source's period-doubled branches, the analytic counterpart of PD_G."""


@dataclass(frozen=True)
class CrisisEnd:
    """An attractor that ends, or changes, in a crisis."""

    entry: str
    """The crisis."""
    parameter: str
    value: float
    attractor: str
    orbit: str
    """`attractor`, `orbit`: notations, the second of the unstable orbit."""
    type: str | None
    """``boundary``, ``interior`` or ``merging``; None if the motion beyond has not settled."""
    after: str
    """What the motion settles on beyond."""
    grazing: bool
    """Whether the attractor touches with the image of a grazing. Otherwise the value is that of the
    nearest tangency found: a rarer one may end the motion before."""

    def __str__(self) -> str:
        place = f"{self.parameter} = {self.value:.9g}{'' if self.grazing else ' at the latest'}"
        if self.type is None:
            what = (
                f"the chaos {self.attractor} meets the unstable {self.orbit} at {place} in a crisis"
            )
            unknown = "of a type that simulation does not show"
            return f"{what} ({self.entry}), {unknown}; beyond: {self.after}"
        verbs = {"interior": "widens", "merging": "merges with another one"}
        does, article = verbs.get(self.type, "ends"), "an" if self.type == "interior" else "a"
        what = f"the chaos {self.attractor} {does} at {place} in {article} {self.type} crisis"
        return f"{what} on the unstable {self.orbit} ({self.entry}); beyond: {self.after}"


@dataclass(frozen=True)
class GrazingScenario:
    """What is seen beyond the grazing of an observable orbit, to leading order."""

    entry: str
    """The grazing."""
    parameter: str
    value: float
    notation: str
    """The orbit that grazes."""
    scenario: Scenario
    followed: tuple[float, float] = (-inf, inf)
    """Least and largest value of the parameter on all branches."""

    def __str__(self) -> str:
        place = f"beyond {self.entry}, {self.notation} at {self.parameter} = {self.value:.9g}"
        name, windows = self.scenario.name, self.scenario.windows
        if self.scenario.reason:
            return f"{place}: {name}: {self.scenario.reason}"
        if name == JUMP:
            ends = " or ".join(window.notation for window in windows) or "an attractor elsewhere"
            return f"{place}: {name}, perhaps to {ends}"
        ranges = [
            f"{w.notation} {w.low:.9g} to {w.high:.9g}"
            + ("" if w.low < self.followed[1] and w.high > self.followed[0] else BEYOND)
            for w in windows
            if w.low is not None and w.high is not None
        ]
        listed = f"; windows, to leading order: {', '.join(ranges[:SHOWN])}" if ranges else ""
        return f"{place}: {name}{listed}"


BEYOND = " (beyond all branches)"
"""Remark on a window that no branch reaches, far from the grazing perhaps."""

SHOWN = 3
"""Windows of period adding in a sentence; the catalogue has more."""

SURVEYS = {
    "done": "surveyed for the words that were followed: orbits of others may exist on no followed "
    "branch",
    "none": "not surveyed: orbits on no followed branch may exist; follow.survey = true in a scene "
    "looks for them",
    "orbits": "surveyed for the words of follow.orbits alone: orbits of others may exist on no "
    "followed branch",
    "cut short": "surveyed in part: orbits on no followed branch may exist; the limit that ended "
    "the survey is reported",
    "unknown": "orbits on no followed branch may exist: it is not recorded whether a survey looked "
    "for them",
}
"""Remark beside a list of stable ranges, by how far the diagram was surveyed."""


@dataclass(frozen=True)
class Reading:
    """Everything that was read from a diagram."""

    stable: Sequence[Interval]
    bistable: Sequence[Bistability]
    transitions: Sequence[GrazingTransition]
    survey: str = "none"
    """Whether orbits were looked for across the range; if not, `stable` may be incomplete; one of
    "none", "cut short", "orbits", "done", "unknown"."""
    unknown: Sequence[Interval] = ()
    """Stretches between two events of which no recorded orbit gives the status, as in files of
    earlier versions."""
    crises: Sequence[CrisisEnd] = ()
    """Where complex motion ends in crises, as far as they were located."""
    scenarios: Sequence[GrazingScenario] = ()
    """What is seen beyond grazings of observable orbits; none of files of earlier versions."""
    labels: Mapping[str, str] = field(default_factory=dict, repr=False)
    """The label of each event by its name, for words; the catalogue has them with its entries."""
    places: Mapping[str, str] = field(default_factory=dict, repr=False)
    """Where each branch is, for words, if not all are at the same values; see `places_of`."""

    @property
    def incomplete(self) -> str:
        """Why the list of stable ranges may be incomplete, in words."""
        return SURVEYS[self.survey]

    def as_record(self) -> dict[str, Any]:
        """Return plain data."""
        lists = asdict(self)
        del lists["survey"], lists["labels"], lists["places"]  # the catalogue's own keys
        for interval in (*lists["stable"], *lists["unknown"]):
            del interval["rows"]
        for name in ("crises", "scenarios"):
            if not lists[name]:
                del lists[name]
        for scenario in lists.get("scenarios", ()):
            del scenario["followed"]
        return lists

    def __str__(self) -> str:
        lines = [sentence_of(i) for i in self.unknown]
        lines += [
            f"stable   {i.branch:4} {i.notation:10} {i.low:.9g} to {i.high:.9g}"
            + f"  ({' to '.join(map(self._bound, i.bounds))}){self.places.get(i.branch, '')}"
            for i in self.stable
        ]
        lines += [] if self.stable else ["stable   none of the orbits that were followed"]
        lines += [
            f"bistable {' and '.join(b.branches):9} {' and '.join(b.notations)}: "
            f"{b.low:.9g} to {b.high:.9g}{self.places.get(b.branches[0], '')}"
            for b in self.bistable
        ]
        lines.append(self.incomplete)
        lines += [sentence(t) for t in self.transitions]
        lines += map(str, self.scenarios)
        lines += map(str, self.crises)
        return "\n".join(lines)

    def _bound(self, name: str | None) -> str:
        """What ends a stable range, in words."""
        label = self.labels.get(name or "")
        return f"{label} {name}" if label else name or "status changes"


class DiagramSurvey(Protocol):
    """What is read of a diagram: its branches, its entries, and how far it was surveyed."""

    @property
    def branches(self) -> Sequence[Branch]:
        """All branches, parents before their children."""

    @property
    def entries(self) -> Sequence[Entry]:
        """All events on them."""

    @property
    def survey(self) -> str:
        """Whether orbits were looked for across the range."""


@explain_arguments
def read(diagram: DiagramSurvey) -> Reading:
    """Read a diagram.

    Parameters
    ----------
    diagram : Diagram

    Returns
    -------
    Reading
    """
    stable = stable_intervals(diagram)
    member = {b.id: tuple(float(b[name][0]) for name in b.constant) for b in diagram.branches}
    grazings = [e for e in diagram.entries if e.kind == G.name and e.physical and e.order == 1]
    known = {branch.id for branch in diagram.branches}
    transitions = [
        _transition(diagram, stable, entry)
        for entry in grazings
        if entry.period <= 1 and entry.opens and entry.opens[0] in known
    ]
    unknown = [interval for branch in diagram.branches for interval in unknown_intervals(branch)]
    labels = {entry.id: entry.label for entry in diagram.entries}
    crises = [
        CrisisEnd(
            *(e.id, e.parameter, e.value, str(e.crisis.get("attractor")), e.notation),
            *(e.crisis.get("type"), str(e.crisis.get("after"))),
            e.crisis.get("grazing") is not None,
        )
        for e in diagram.entries
        if e.crisis is not None
    ]
    scenarios = [
        GrazingScenario(
            *(e.id, e.parameter, e.value, e.notation, e.scenario),
            _reached(diagram.branches, e.parameter),
        )
        for e in diagram.entries
        if e.scenario is not None
    ]
    return Reading(
        *(stable, _bistable(stable, member), transitions, diagram.survey, unknown, crises),
        *(scenarios, labels, places_of(diagram.branches)),
    )


def _reached(branches: Sequence[Branch], parameter: str) -> tuple[float, float]:
    """The least and the largest value of a parameter on all branches."""
    values = np.concatenate([branch[parameter] for branch in branches])
    return float(np.min(values)), float(np.max(values))


@explain_arguments
def places_of(branches: Sequence[Branch]) -> dict[str, str]:
    """Return in words, for each branch, the values of the parameters that no branch varies and not
    all share, derived ones left out; nothing where all share them."""
    kinds = map(find_imported_system, {branch.system for branch in branches})
    derived = {name for kind in kinds if kind for name in kind.DERIVED}
    constant = [{name: float(b[name][0]) for name in b.constant} for b in branches]
    names = [
        name
        for name in (constant[0] if constant else ())
        if name not in derived and len({one.get(name) for one in constant}) > 1
        if all(name in one for one in constant)
    ]
    if not names:
        return {}
    told = [", ".join(f"{name} = {one[name]:.6g}" for name in names) for one in constant]
    return {branch.id: f" at {text}" for branch, text in zip(branches, told, strict=True)}


TURNED = 1e-6
"""Part of a run by which the parameter goes beyond its values at both ends where it turns."""

SAME_VALUE = 1e-9
"""Values of the parameter that differ by less than this part are told apart by rounding alone."""


@explain_arguments
def stable_intervals(branch: Branch | DiagramSurvey) -> list[Interval]:
    """Return the runs of stable physical orbits of a branch.

    Parameters
    ----------
    branch : Branch or Diagram

    Returns
    -------
    list of Interval
        In order of arclength; of a diagram those of each branch.
    """
    if not isinstance(branch, Branch):
        return [interval for one in branch.branches for interval in stable_intervals(one)]
    good = branch.stable & branch.physical
    good[branch.between] = False
    edges = np.nonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))[0]
    values = branch[branch.parameter]
    found = []
    for first, beyond in edges.reshape(-1, 2).tolist():
        ends = [_bound(branch, first, -1), _bound(branch, beyond - 1, +1)]
        ends[1:1] = _turns(branch, *(row for row, _ in ends))
        for two in itertools.pairwise(ends):
            places = [(float(values[row]), name) for row, name in two]
            (low, low_name), (high, high_name) = sorted(places, key=lambda place: place[0])
            bounds, rows = (low_name, high_name), ((two[0][0], two[1][0]),)
            found.append(Interval(branch.id, branch.notation, low, high, bounds, rows))
    joined = _join_intervals(found)
    return _join_at_seam(joined) if branch.ends[0].kind is EndKind.CLOSED else joined


def _turns(branch: Branch, first: int, last: int) -> list[tuple[int, str | None]]:
    """The rows between two at which the parameter turns and stability does not change, with what is
    there: a branch that is born at a pitchfork and followed both ways turns at its birth."""
    values = branch[branch.parameter][first : last + 1]
    ends = sorted((values[0], values[-1]))
    least = max(TURNED * float(np.ptp(values)), SAME_VALUE * float(np.max(np.abs(values))))
    for place in (int(np.argmin(values)), int(np.argmax(values))):
        if max(ends[0] - values[place], values[place] - ends[1]) > least:
            row = first + place
            name = str(branch["event"][row]) or (
                EndKind.BORN.name.lower() if branch.origin else None
            )
            return [*_turns(branch, first, row), (row, name), *_turns(branch, row, last)]
    return []


def unknown_intervals(branch: Branch) -> list[Interval]:
    """Return the stretches between two events that no row of the branch tells the status of."""
    values, names, neither = branch[branch.parameter], branch["event"], branch.between
    found = []
    for row in np.nonzero((branch.status == UNKNOWN) & neither[:-1])[0].tolist():
        rows = sorted((row, row + 1), key=lambda k: float(values[k]))
        low, high = (float(values[k]) for k in rows)
        bounds = tuple(str(names[k]) or branch.ends[0].kind.name.lower() for k in rows)
        found.append(Interval(branch.id, branch.notation, low, high, (bounds[0], bounds[1])))
    return found


def _bound(branch: Branch, row: int, direction: int) -> tuple[int, str | None]:
    """The row at which a run really ends: the event next to it, or the branch's end.

    A point within an event's error of it has a status of rounding.
    """
    beside = row + direction
    born = beside == 0 and branch.ends[0].kind is EndKind.BORN
    if born and branch["event"][0] == "":
        return 0, EndKind.BORN.name.lower()
    if not 0 <= beside < len(branch):
        return row, branch.ends[0 if direction < 0 else 1].kind.name.lower()
    errors = {entry.id: entry.error for entry in branch.events}
    values = branch[branch.parameter]
    for place in (beside, beside + direction):
        name = str(branch["event"][place]) if 0 <= place < len(branch) else ""
        if name and (place == beside or abs(values[place] - values[beside]) <= errors[name]):
            return place, name
    return row, None


def _join_intervals(intervals: list[Interval]) -> list[Interval]:
    """Join runs that an event interrupts without ending them (a requested value, a neutral one)."""
    joined: list[Interval] = []
    for interval in intervals:
        last = joined[-1] if joined else None
        rows = (*last.rows, *interval.rows) if last else ()
        if last is not None and interval.low == last.high:
            bounds = (last.bounds[0], interval.bounds[1])
            joined[-1] = replace(last, high=interval.high, bounds=bounds, rows=rows)
        elif last is not None and interval.high == last.low:
            bounds = (interval.bounds[0], last.bounds[1])
            joined[-1] = replace(last, low=interval.low, bounds=bounds, rows=rows)
        else:
            joined.append(interval)
    return joined


def _join_at_seam(intervals: list[Interval]) -> list[Interval]:
    """Join the first and the last run of a closed branch where they meet at its first point."""
    if len(intervals) < 2:
        return intervals
    first, *others, last = intervals
    low, high = sorted((first, last), key=lambda interval: interval.low)
    closed = EndKind.CLOSED.name.lower()
    if (low.bounds[1], high.bounds[0]) != (closed, closed) or not isclose(low.high, high.low):
        return intervals
    bounds = (low.bounds[0], high.bounds[1])
    rows = (*first.rows, *last.rows)
    return [replace(first, low=low.low, high=high.high, bounds=bounds, rows=rows), *others]


def _bistable(
    stable: Sequence[Interval], member: Mapping[str, tuple[float, ...]]
) -> list[Bistability]:
    found: list[Bistability] = []
    for i, one in enumerate(stable):
        for other in stable[i + 1 :]:
            low, high = max(one.low, other.low), min(one.high, other.high)
            same = SAME_VALUE * max(abs(low), abs(high))
            names = (one.branch, other.branch), (one.notation, other.notation)
            known = any(
                b.branches == names[0] and abs(b.low - low) + abs(b.high - high) < same
                for b in found
            )
            if high - low > same and member[one.branch] == member[other.branch] and not known:
                found.append(Bistability(*names, low, high))
    return found


def _transition(
    diagram: DiagramSurvey, stable: Sequence[Interval], grazing: Entry
) -> GrazingTransition:
    branches = {branch.id: branch for branch in diagram.branches}
    source, target = branches[grazing.branch], branches[grazing.opens[0]]
    at_once, fold = _begins_stable(target, grazing)
    # the nearest real period doubling along the branch
    real = [] if grazing.stable else [e for e in source.events if e.kind == PD.name and not e.ghost]
    doubling = min(real, key=lambda e: abs(e.arclength - grazing.arclength), default=None)
    doubled = _doubled_branches(diagram, doubling)
    family = {source.id, *(b.id for b in doubled)}
    mechanism = None
    if grazing.stable:
        mechanism = 1 if at_once else (2 if fold else None)
    elif doubling is not None and fold is not None:
        still = any(i.branch in family and i.low < fold.value < i.high for i in stable)
        mechanism = 3 if still else 4
    elif doubling is not None and at_once:
        mechanism = 3
    return GrazingTransition(
        source.notation,
        target.notation,
        mechanism,
        grazing.id,
        grazing.value,
        doubling.id if doubling else None,
        doubling.value if doubling else None,
        fold.id if fold else None,
        fold.value if fold else None,
        [(e.id, e.value) for b in doubled for e in b.events if e.kind == G.name and e.physical],
    )


def _begins_stable(target: Branch, grazing: Entry) -> tuple[bool, Entry | None]:
    """Whether the new branch begins stable where it is physical; else its fold to stability."""
    entries = {e.id: e for e in target.events}
    start = _row_of(target, grazing)
    for direction in (+1, -1):
        rows = range(start + direction, len(target) if direction > 0 else -1, direction)
        for count, row in enumerate(rows):
            entry = entries.get(str(target["event"][row]))
            if entry is not None and entry.kind == FB.name:
                after = row + direction
                gained = 0 <= after < len(target) and bool(target.stable[after])
                return False, entry if gained else None
            if entry is None and not target.physical[row]:
                break
            if entry is None and target.stable[row]:
                return count == 0, None
    return False, None


def _row_of(target: Branch, grazing: Entry) -> int:
    """The row of the new branch next to the orbit that grazes."""
    speeds = np.sort([*(impact["velocity"] for impact in grazing.impacts), 0.0])
    if target.velocities.shape[1] != len(speeds):
        return 0
    apart = np.abs(np.sort(target.velocities, axis=1) - speeds).max(axis=1)
    values = target[target.parameter]
    span = float(np.ptp(values)) or 1.0
    return int(np.argmin(apart + np.abs(values - grazing.value) / span))


def _doubled_branches(diagram: DiagramSurvey, doubling: Entry | None) -> list[Branch]:
    """The branches born at a period doubling, and at theirs in turn."""
    names = list(doubling.opens) if doubling else []
    entries = {e.id: e for e in diagram.entries}
    for branch in diagram.branches:  # parents come before their children
        born = entries.get(branch.origin or "")
        if born is not None and born.kind == PD.name and born.branch in names:
            names.append(branch.id)
    return [branch for branch in diagram.branches if branch.id in names]


def sentence_of(unknown: Interval) -> str:
    """Return in words where it is not known whether orbits are stable and physical."""
    first, last = unknown.bounds
    return (
        f"unknown  {unknown.branch:4} {unknown.notation:10} {unknown.low:.9g} to {unknown.high:.9g}"
        f"  ({first} to {last}): no orbit between these events is recorded; run the scene again, "
        "or follow the branch with a smaller max_step"
    )


def sentence(t: GrazingTransition) -> str:
    """Return a transition in words."""
    parts = [f"transition {t.source} -> {t.target}: mechanism {t.mechanism or 'not decided'}"]
    if t.doubling:
        parts.append(f"PD {t.doubling} at {t.doubling_value:.9g}")
    parts.append(f"grazing {t.entry} at {t.grazing:.9g}")
    if t.fold:
        parts.append(f"FB {t.fold} at {t.fold_value:.9g}")
    if t.doubled_grazings:
        values = ", ".join(f"{name} at {value:.9g}" for name, value in t.doubled_grazings)
        parts.append(f"grazing of the doubled orbits (PD_G): {values}")
    return "; ".join(parts)
