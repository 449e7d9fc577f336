"""The certificate of a branch: one smooth curve, and every event on it recorded.

Tubes are laid from orbit to orbit along the branch's table, as long as they go. Each is searched
for zeros of the test functions, and each zero has to be an entry. Where a proof fails the tube is
cut; what is left open is named with its piece of the parameter.
"""

from __future__ import annotations

import contextlib
import itertools
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from flint import arb, ctx

from ..bifurcations.kind import kind_of
from ..continuation.branch import EndKind
from ..errors import InputError
from ..models.guards import Word
from ..models.model import Model
from ..orbits.problem import Array, OrbitProblem
from ..progress import Progress, ignore_progress
from ..results.branch import Branch, Entry, model_at, orbit_of
from ..schema import record
from ..segments.kernels import Kernels
from .birth import Birth, meet, prove_birth
from .equations import BallProblem, Balls, prove_zero
from .event import EventCertificate
from .orbit import Limit, limits, open_cells
from .tube import (
    Budget,
    Node,
    Segment,
    Tube,
    halve_segment,
    nodes_of,
    points_of,
    prove_tube,
    scale_of,
    split,
    tubes_along,
)
from .zeros import (
    MULTIPLIERS,
    Cell,
    FlightCoordinate,
    Patch,
    Test,
    flights_along,
    is_regular,
    narrow_cell,
    test_at,
    zeros,
)

# What the tubes of a branch are searched for: every zero in them has to be an entry.

BITS = 64
"""Precision of tubes, whose widths are far above rounding."""
DEEPEST = 6
"""How often a tube is halved on which something stays open."""

ASIDE = 1e-6
"""How far from its event an entry may be recorded, in natural sizes and in u."""

NO_TUBE = "no tube is proven"

FAILURES = (ArithmeticError, ValueError)


@dataclass(frozen=True)
class Piece:
    """A piece of a branch, by the followed parameter at its ends, and what is said of it; where an
    event is missing, by the parameter's least and largest value, which a fold lies next to."""

    start: float
    end: float
    what: str


@dataclass(frozen=True)
class CertifiedEntry:
    """An entry that is certified, and what is needed to find it on a tube."""

    id: str
    kind: str
    z: Balls
    flight: int | None = None
    wall: str | None = None
    touch: Any = None


def certified_entry(
    entry: Entry, certificate: EventCertificate, problem: OrbitProblem
) -> CertifiedEntry:
    """Return a certified entry as it is looked for on tubes."""
    inner = [arb(text) for text in certificate.inner]
    z = inner[: problem.n + 1]
    if entry.touch_time is None or entry.impact is not None:  # it touches inside no flight
        return CertifiedEntry(entry.id, entry.kind, z)
    return CertifiedEntry(entry.id, entry.kind, z, entry.flight, entry.wall, inner[problem.n + 1])


@dataclass
class Findings:
    """What is found along the tubes of a branch."""

    tubes: list[tuple[Segment, Tube | Birth | None]] = field(default_factory=list)
    events: list[str] = field(default_factory=list)
    missing: list[Piece] = field(default_factory=list)
    unproven: list[Piece] = field(default_factory=list)
    open_length: float = 0.0

    def leave_open(self, segment: Segment, what: str) -> None:
        """Note a segment on which something is not proven; neighbours of a kind are one piece."""
        piece, last = _piece(segment, what), self.unproven[-1] if self.unproven else None
        if last is not None and (last.end, last.what) == (piece.start, what):
            piece = replace(self.unproven.pop(), end=piece.end)
        self.unproven.append(piece)
        self.open_length += segment.length

    def name_crossings(self, values: Mapping[str, float]) -> None:
        """Say of pieces without a tube which branch points lie there: no tube leads through one."""
        for i, piece in enumerate(self.unproven):
            low, high = sorted((piece.start, piece.end))
            inside = [name for name, value in values.items() if low <= value <= high]
            if inside and piece.what == NO_TUBE:
                crossing = f"branches cross there, at {' and '.join(inside)}"
                self.unproven[i] = replace(piece, what=crossing)

    def link(self) -> None:
        """Consecutive tubes have to hold the same orbit at their common node."""
        for (segment, one), (_, other) in itertools.pairwise(self.tubes):
            if one is None or not isinstance(other, Tube):
                continue
            if not meet(one, other):
                self.leave_open(segment, "its tube is not proven to meet the next one")


def _piece(segment: Segment, what: str) -> Piece:
    start, end = (float(node.unknowns[-1]) for node in (segment.first, segment.last))
    return Piece(start, end, what)


class Examination:
    """What the tubes of a branch are searched for: the kinds that a tube can be searched for, and
    what is known; `uncertified` are orbits of entries that are not proven to be where they are
    recorded. When the budget is spent, tubes are not cut any more."""

    def __init__(
        self,
        problem: OrbitProblem,
        kinds: Sequence[str],
        known: Sequence[CertifiedEntry],
        budget: Budget | None = None,
        uncertified: Mapping[str, Balls] = MappingProxyType({}),
    ) -> None:
        self.space = BallProblem(problem, BITS)
        own = [(name, kind_of(name)) for name in kinds]
        self.kinds = [
            name
            for name, kind in own
            if (kind.multiplier in MULTIPLIERS and not kind.crossing) or "touch_time" in kind.needed
        ]
        self.known, self.uncertified = known, uncertified
        self.budget, self.found = budget or Budget(), Findings()
        self.touching = any("touch_time" in kind_of(name).needed for name in self.kinds)
        self.limits = limits(problem)

    def account(self, segment: Segment, tube: Tube | None, depth: int = 0) -> None:
        """Search a tube; without one, note that nothing is proven there."""
        if tube is None:
            self.found.tubes.append((segment, None))
            self.found.leave_open(segment, self.budget.message if self.budget.spent else NO_TUBE)
            return
        self.examine(segment, tube, depth)

    def begin(self, birth: Birth) -> list[str]:
        """Return what is not excluded on the curve on which the branch is born; without anything
        it is accounted for."""
        left = [
            f"zeros of the test function of {'/'.join(kinds)} are not excluded"
            for mu, kinds in _kinds_by_multiplier(self.kinds).items()
            if (
                birth.turns if mu == 1.0 else not _clear_of_zeros(birth, test_at(birth.segment, mu))
            )
        ]
        if self.touching:
            for flight in range(len(self.space.problem.word)):
                found = (
                    patch
                    for one in flights_along(birth, flight)
                    for patch in one.patches(())
                    if not one.passes(patch.wall, patch.along)
                )
                if next(found, None) is not None:
                    left.append(f"touches of flight {flight + 1} are not excluded")
            left += [_limit_text(one) for one in self.limits]
        if not left:
            self.found.tubes.append((birth.segment, birth))
        return left

    def examine(self, segment: Segment, tube: Tube, depth: int = 0) -> None:
        """Account for every zero in a tube; cut it where something stays open."""
        events, missing, left = self._searched(tube)
        deeper = left and depth < DEEPEST and not self.budget.spent
        if deeper and (parts := _cut_tube(segment)) is not None:
            for part, own in parts:
                self.examine(part, own, depth + 1)
            return
        if left and not self.budget.spent:
            events, missing, left = self._searched(tube.narrowed())
        self.found.tubes.append((segment, tube))
        self.found.events += events
        values = [float(segment.doubles(u)[-1]) for u in np.linspace(-1.0, 1.0, 17)]
        self.found.missing += [Piece(min(values), max(values), what) for what in missing]
        if left and self.budget.spent:
            left.append(self.budget.message)
        if left:
            self.found.leave_open(segment, "; ".join(dict.fromkeys(left)))

    def _searched(self, tube: Tube) -> tuple[list[str], list[str], list[str]]:
        """What `_events` finds; open where a function has no enclosure."""
        try:
            return self._events(tube)
        except FAILURES as error:
            return [], [], [f"a test function has no enclosure ({error})"]

    def _events(self, tube: Tube) -> tuple[list[str], list[str], list[str]]:
        """Entries in a tube, what is proven to be there besides, and what is open."""
        placed = [(one, u) for one in self.known if (u := entry_place(tube, one)) is not None]
        events: list[str] = []
        missing: list[str] = []
        left: list[str] = []
        for mu, kinds in _kinds_by_multiplier(self.kinds).items():
            name = "/".join(kinds)
            own = [(one.id, u) for one, u in placed if kind_of(one.kind).multiplier == mu]
            for cell in zeros(tube, name, test_at(tube.segment, mu)):
                inside = [i for i, u in own if cell.left < u[0] and u[1] < cell.right]
                events += inside
                if cell.what == "open" or len(inside) > 1:
                    left.append(f"zeros of the test function of {name} are not told apart")
                elif not inside and not _is_multiplier_zero(
                    tube, name, test_at(tube.segment, mu), cell
                ):
                    left.append("flights vanish there, and their multipliers with them")
                elif not inside and (beside := self._uncertified_in(tube, cell.left, cell.right)):
                    left.append(f"a zero of the test function of {name} is not told from {beside}")
                elif not inside:
                    at = float(tube.state(arb(0.5 * (cell.left + cell.right)))[-1].mid())
                    missing.append(f"a zero of the test function of {name} near {at:.9g}")
        if self.touching:
            self._touches(tube, placed, events, missing, left)
        return events, missing, left

    def _touches(
        self,
        tube: Tube,
        placed: Sequence[tuple[CertifiedEntry, tuple[float, float]]],
        events: list[str],
        missing: list[str],
        left: list[str],
    ) -> None:
        whole = tube.state(arb(0, 1))
        left += [
            _limit_text(one) for one in self.limits if one.margin(self.space, whole).contains(0)
        ]
        for flight in range(len(self.space.problem.word)):
            own = [(one, u) for one, u in placed if one.touch is not None and one.flight == flight]
            spots = [(one, u, _fraction(one, self.space)) for one, u in own]
            for along in flights_along(tube, flight):
                self._touches_along(along, spots, events, missing, left)

    def _touches_along(
        self,
        along: FlightCoordinate,
        spots: Sequence[tuple[CertifiedEntry, tuple[float, float], Any]],
        events: list[str],
        missing: list[str],
        left: list[str],
    ) -> None:
        """Account for the touches of one gap coordinate of a flight."""
        own = [spot for spot in spots if spot[0].wall in along.met]
        near = [(str(one.wall), 0.5 * (u[0] + u[1]), float(s.mid())) for one, u, s in own]
        for patch in along.patches(near):
            inside = [one.id for one, u, s in own if _is_inside(patch, one, u, s)]
            if patch.single and len(inside) == 1:
                events += inside
            elif not along.passes(patch.wall, patch.along):
                where = f"of flight {along.flight + 1} and wall {patch.wall}"
                assert isinstance(along.tube, Tube)
                if beside := self._uncertified_in(along.tube, *_widen(patch.along)):
                    left.append(f"touches {where} are not told from {beside}")
                elif patch.single and not own and self._exists(along, patch):
                    missing.append(f"a touch {where}")
                else:
                    left.append(f"touches {where} are not excluded")
                return

    def _uncertified_in(self, tube: Tube, left: float, right: float) -> str:
        """The entries recorded on a part of a tube that are not proven to be there, in words."""
        places = ((name, recorded_place(tube, z)) for name, z in self.uncertified.items())
        names = [name for name, u in places if u is not None and left - ASIDE < u < right + ASIDE]
        return f"{' and '.join(names)}, not certified" if names else ""

    def _exists(self, along: FlightCoordinate, patch: Patch) -> bool:
        """Whether a touch in a patch is proven to exist."""
        tube, problem = along.tube, self.space.problem
        assert isinstance(tube, Tube)
        u = 0.5 * sum(patch.along)
        z = np.array([float(x.mid()) for x in tube.state(arb(u))])
        rows = self.space.impacts(z.tolist())
        start, later = (float(arb(rows[patch.flight + i][0]).mid()) for i in (0, 1))
        time_ = start + 0.5 * sum(patch.at) * (later - start)
        where = {"flight": patch.flight, "wall": patch.wall, "touch_time": time_}
        system, own = self.space.grazing(z, where)
        found = prove_zero(self.space, system, [*z.tolist(), *own])
        if found is None:
            return False
        inner = found[1]
        one = CertifiedEntry(
            "", "", inner[: problem.n + 1], patch.flight, patch.wall, inner[problem.n + 1]
        )
        at = entry_place(tube, one)
        wide = Patch(patch.flight, patch.wall, _widen(patch.along), _widen(patch.at), True)
        return at is not None and _is_inside(wide, one, at, _fraction(one, self.space))


def _limit_text(limit: Limit) -> str:
    return f"it is not excluded that impact {limit.impact + 1} comes to the limit {limit.wall}"


def _clear_of_zeros(birth: Birth, function: Test) -> bool:
    """Whether a function of the flights is proven to have no zero on a curve."""

    def clear(left: float, right: float) -> bool:
        flights = birth.segment.space.flights(birth.state(arb(left).union(arb(right))))
        return not function(flights).contains(0)

    return next(open_cells((-1.0, 1.0), clear, DEEPEST, 0.5), None) is None


def _widen(ends: tuple[float, float]) -> tuple[float, float]:
    size = 20.0 * (ends[1] - ends[0])
    return ends[0] - size, ends[1] + size


def _kinds_by_multiplier(kinds: Sequence[str]) -> dict[float, list[str]]:
    found: dict[float, list[str]] = {}
    for name in kinds:
        mu = kind_of(name).multiplier
        if mu is not None:
            found.setdefault(mu, []).append(name)
    return found


def _is_multiplier_zero(tube: Tube, name: str, test: Test, cell: Cell) -> bool:
    """Whether a zero of a test function is one of a multiplier's, for all that can be."""
    left, right = narrow_cell(tube, name, test, cell)
    state = tube.state(arb(left).union(arb(right)))
    return is_regular(tube.segment, tube.segment.space.flights(state))


def _fraction(one: CertifiedEntry, space: BallProblem) -> Any:
    """Where in its flight an entry touches, from 0 to 1."""
    rows = space.impacts(one.z)
    assert one.flight is not None
    start, later = rows[one.flight][0], rows[one.flight + 1][0]
    return (one.touch - start) / (later - start)


def _is_inside(patch: Patch, one: CertifiedEntry, u: tuple[float, float], s: Any) -> bool:
    return bool(
        one.wall == patch.wall
        and patch.along[0] < u[0]
        and u[1] < patch.along[1]
        and s > patch.at[0]
        and s < patch.at[1]
    )


def _cut_tube(segment: Segment) -> list[tuple[Segment, Tube]] | None:
    """Two tubes in place of one; None if they are not proven."""
    parts = halve_segment(segment)
    if parts is None:
        return None
    tubes = [prove_tube(part) for part in parts]
    if any(tube is None for tube in tubes):
        return None
    return [(part, tube) for part, tube in zip(parts, tubes, strict=True) if tube is not None]


def entry_place(tube: Tube, one: CertifiedEntry) -> tuple[float, float] | None:
    """Return between which u an entry is proven to lie on the branch; None if it is not."""
    segment = tube.segment
    z = _shift_to_branch_clock(segment, one.z)
    reach = np.array([float(x.mid()) for x in z])
    ends = segment.first.unknowns, segment.last.unknowns
    far = np.max(np.abs(reach - 0.5 * (ends[0] + ends[1])) / segment.scale)
    if far > 2.0 * segment.length:
        return None

    def ahead(u: Any) -> Any:
        """l(u) . (z - p(u)), falling along the branch."""
        row = [a + b * u for a, b in zip(*segment.row, strict=True)]
        return sum((r * (x - p) for r, x, p in zip(row, z, segment.at(u), strict=True)), arb(0))

    left, right = -1.0, 1.0
    if not (ahead(arb(left)) > 0 and ahead(arb(right)) < 0):
        return None
    for _ in range(48):
        middle = 0.5 * (left + right)
        if float(ahead(arb(middle)).mid()) > 0.0:
            left = middle
        else:
            right = middle
    at = left, right
    for width in (1e-13, 1e-11, 1e-9):  # a wider piece of the branch leaves a narrow box
        left, right = max(at[0] - width, -1.0), min(at[1] + width, 1.0)
        if ahead(arb(left)) > 0 and ahead(arb(right)) < 0:
            break
    else:
        return None
    spread = segment.at(arb(left).union(arb(right)))
    beside = (abs(x - p) < float(h) for x, p, h in zip(z, spread, tube.box, strict=True))
    return (left, right) if all(beside) else None


def recorded_place(tube: Tube, z: Balls) -> float | None:
    """Return the u of the place on the branch that is nearest to a recorded orbit, which nothing is
    proven of; None if it lies elsewhere."""
    segment = tube.segment
    at = np.array([float(x.mid()) for x in _shift_to_branch_clock(segment, z)])
    grid = np.linspace(-1.0 - ASIDE, 1.0 + ASIDE, 65)
    for _ in range(8):
        points = np.array([[float(x.mid()) for x in segment.at(arb(u))] for u in grid])
        far = np.max(np.abs(points - at) / segment.scale, axis=1)
        k = int(np.argmin(far))
        nearest, step = float(grid[k]), float(grid[1] - grid[0])
        grid = np.linspace(nearest - step, nearest + step, 9)
    return nearest if far[k] < ASIDE + np.max(tube.box / segment.scale) else None


def _shift_to_branch_clock(segment: Segment, z: Balls) -> Balls:
    """An orbit whole periods later or earlier, as the branch counts times."""
    space, m = segment.space, segment.space.problem.m
    period = space.setup(space.values(z)).period
    change = segment.first.unknowns[0] - float(z[0].mid())
    turns = round(change / float(arb(period).mid()))
    shifted = list(z)
    for i in range(0, space.problem.n, m):
        shifted[i] = z[i] + turns * period
    return shifted


BIRTH = 5
"""How often the first step of a branch born at a period doubling is halved."""
QUIET = "proofs along branches are for orbits with impacts"
CAP = 16
"""Terms of power series, more than any of these has."""


@dataclass(frozen=True)
class BranchCertificate:
    """What is proven of a branch."""

    id: str
    word: str
    period: int
    parameter: str
    kinds: Sequence[str]
    """Kinds whose events are proven to be complete."""
    start: float
    end: float
    """`start`, `end`: the followed parameter at the ends of what is covered."""
    tubes: int = 0
    share: float = 0.0
    """Share of the branch's length on which nothing is left open."""
    events: Sequence[str] = ()
    """Entries proven to lie on the branch."""
    missing: Sequence[Piece] = ()
    """Events proven to be there that no entry records."""
    strange: Sequence[str] = ()
    """Entries that are not proven to lie on the branch."""
    unproven: Sequence[Piece] = ()
    nodes: Sequence[Sequence[float]] = ()
    tangents: Sequence[Sequence[float]] = ()
    boxes: Sequence[Sequence[float]] = ()
    """`nodes`, `tangents`, `boxes`: the tubes: where they begin and end, the branch's directions
    there, and half widths. An empty box stands for a tube that is not proven."""
    seconds: float = 0.0

    @property
    def complete(self) -> bool:
        """Whether the branch is proven to hold the events recorded, and no others."""
        return bool(self.kinds) and not (self.missing or self.strange or self.unproven)

    @property
    def refuted(self) -> bool:
        """Whether the catalogue is proven to lack an event, or has one that is not there."""
        return bool(self.missing or self.strange)

    def lines(self) -> list[str]:
        """Return what is proven, in words."""
        kinds = ", ".join(self.kinds) or "no kind of event"
        values = [node[-1] for node in self.nodes] or [self.start, self.end]
        where = f"{self.parameter} from {min(values):.9g} to {max(values):.9g}"
        head = f"{self.id} {self.word}/{self.period}T"
        if self.complete:
            return [f"{head}: complete for {kinds}, {where}, in {self.tubes} tubes"]
        found = [
            f"{head}: {_percent(self.share)} proven for {kinds}, {where}, in {self.tubes} tubes"
        ]
        for name, pieces in (("missing", self.missing), ("unproven", self.unproven)):
            found += [
                f"  {name}: {self.parameter} from {p.start:.9g} to {p.end:.9g}: {p.what}"
                for p in pieces
            ]
        return found + [f"  {name} is not proven to lie on the branch" for name in self.strange]

    def record(self) -> dict[str, Any]:
        """Return the certificate as plain data."""
        return {**record(self), "complete": self.complete}


def _percent(share: float) -> str:
    """A share, rounded down: what is open shows."""
    return f"{math.floor(1e4 * share) / 1e2:.2f} %"


def problem_of(branch: Branch, model: Model | None, kernels: Kernels | None) -> OrbitProblem:
    """Return the orbit problem of a branch."""
    at = model_at(branch, 0, model)
    kernels = kernels or Kernels(at, branch.parameter)
    return OrbitProblem(at, Word(branch.word, branch.period), kernels)


def certify_branch(
    branch: Branch,
    entries: Sequence[Entry],
    certificates: Mapping[str, EventCertificate],
    kinds: Sequence[str],
    model: Model | None = None,
    kernels: Kernels | None = None,
    progress: Progress = ignore_progress,
    seconds: float = math.inf,
) -> BranchCertificate:
    """Prove that a branch is one smooth curve on which every event is recorded.

    `entries` are its events, and perhaps those of other branches, which may cross it;
    `certificates` are theirs, by name, and `kinds` those of events that it was searched for. What
    is left after `seconds` of processor time is unproven.
    """
    if not branch.word:
        return without_certificate(branch, QUIET)
    began, budget = time.perf_counter(), Budget(seconds)
    with _branch_precision():
        problem = problem_of(branch, model, kernels)
        own, crossings = _events_on(branch, problem, entries, certificates)
        uncertified = _uncertified_orbits(problem, entries, certificates)
        work = Examination(problem, kinds, own, budget, uncertified)
        points = points_of(branch, problem)
        scale = scale_of(problem, points)
        nodes = nodes_of(problem, points, scale)
        if branch.ends[0].kind is EndKind.BORN and len(nodes) > 1:
            _born(work, Segment(work.space, nodes[0], nodes[1], scale), BIRTH)
            nodes = nodes[1:]
        for segment, tube in tubes_along(work.space, nodes, scale, progress, budget):
            work.account(segment, tube)
        return _certificate(branch, work, crossings, time.perf_counter() - began)


def _belongs_to(problem: OrbitProblem, entry: Entry) -> bool:
    """Whether an entry has the word and the parameters of a branch, all but the followed one."""
    values = problem.model.values.items()
    same = all(entry.parameters[n] == v for n, v in values if n != problem.parameter)
    return same and (entry.word, entry.period) == (problem.word.walls, problem.word.period)


def _events_on(
    branch: Branch,
    problem: OrbitProblem,
    entries: Sequence[Entry],
    certificates: Mapping[str, EventCertificate],
) -> tuple[list[CertifiedEntry], dict[str, float]]:
    """The events of a branch, and where crossings lie, those recorded on other branches as well."""
    alike = [e for e in entries if certificates[e.id].located and _belongs_to(problem, e)]
    own = [certified_entry(e, certificates[e.id], problem) for e in alike if e.branch == branch.id]
    return own, {e.id: e.value for e in alike if kind_of(e.kind).crossing}


def _uncertified_orbits(
    problem: OrbitProblem, entries: Sequence[Entry], certificates: Mapping[str, EventCertificate]
) -> dict[str, Balls]:
    """The orbits of entries of a branch's word that are not proven to be where they are recorded,
    whatever branch has them; those of damaged entries are none."""
    found = {}
    for entry in entries:
        if certificates[entry.id].located:
            continue
        with contextlib.suppress(InputError, LookupError, TypeError, AttributeError):
            if _belongs_to(problem, entry):
                orbit = orbit_of(entry, problem.model, problem.kernels)
                found[entry.id] = [arb(x) for x in orbit.linearisation.unknowns.tolist()]
    return found


def without_certificate(branch: Branch, why: str) -> BranchCertificate:
    """Return what is said of a branch that nothing is proven of."""
    values = branch[branch.parameter]
    start, end = float(values[0]), float(values[-1])
    whole = Piece(start, end, why)
    return BranchCertificate(
        branch.id, branch.word, branch.period, branch.parameter, (), start, end, unproven=(whole,)
    )


def _born(work: Examination, first: Segment, left: int) -> None:
    """Account for the first step of a branch that is born at a period doubling."""
    birth = prove_birth(first)
    if birth is not None and not work.begin(birth):
        return
    parts = halve_segment(first) if left > 0 else None
    if parts is None:
        work.account(first, None)
        return
    near, far = parts
    _born(work, near, left - 1)
    for segment, tube in split(far, DEEPEST, work.budget):
        work.account(segment, tube)


def verify_branch(
    branch: Branch,
    record: BranchCertificate,
    entries: Sequence[Entry],
    certificates: Mapping[str, EventCertificate],
    model: Model | None = None,
    kernels: Kernels | None = None,
) -> BranchCertificate:
    """Prove anew what a certificate says of a branch, from its tubes; none is searched for.

    Parameters are those of `certify_branch`, and the certificate.

    Raises ValueError if the record is damaged.
    """
    if not branch.word:
        return without_certificate(branch, QUIET)
    began = time.perf_counter()
    with _branch_precision():
        problem = problem_of(branch, model, kernels)
        own, crossings = _events_on(branch, problem, entries, certificates)
        uncertified = _uncertified_orbits(problem, entries, certificates)
        work = Examination(problem, record.kinds, own, uncertified=uncertified)
        points = points_of(branch, problem)
        scale = scale_of(problem, points)
        stored = list(_stored_tubes(record, work.space, scale))
        if branch.ends[0].kind is EndKind.BORN and stored:
            _born(work, stored.pop(0)[0], 0)
        for segment, box in stored:
            tube = prove_tube(segment, box) if box is not None else None
            work.account(segment, tube, DEEPEST)
        _reaches(work.found, points, scale)
        return _certificate(branch, work, crossings, time.perf_counter() - began)


def _stored_tubes(
    record: BranchCertificate, space: BallProblem, scale: Array
) -> Iterator[tuple[Segment, Array | None]]:
    """The tubes of a record."""
    pairs = list(zip(record.nodes, record.tangents, strict=True))
    if not len(record.boxes) == len(pairs) - 1 > 0:
        raise ValueError(f"{len(record.boxes)} boxes between {len(pairs)} nodes")
    nodes = [Node(np.array(z, dtype=float), np.array(t, dtype=float)) for z, t in pairs]
    if any(node.unknowns.shape != scale.shape for node in nodes):
        raise ValueError(f"nodes of other than {len(scale)} unknowns")
    for first, last, box in zip(nodes, nodes[1:], record.boxes, strict=False):
        given = np.array(box, dtype=float)
        yield Segment(space, first, last, scale), given if len(box) == len(scale) else None


def _reaches(found: Findings, points: Array, scale: Array) -> None:
    """The tubes of a record run from the first orbit of the table to its last one."""
    ends = found.tubes[0][0].first, found.tubes[-1][0].last
    for node, point in zip(ends, (points[0], points[-1]), strict=True):
        if np.max(np.abs(node.unknowns - point) / scale) > 1e-9:
            found.leave_open(found.tubes[-1][0], "the tubes do not reach the ends of the branch")


class _branch_precision:
    """Arb's context while tubes are laid."""

    def __enter__(self) -> None:
        self.before = ctx.prec, ctx.cap
        ctx.prec, ctx.cap = BITS, CAP

    def __exit__(self, *raised: object) -> None:
        ctx.prec, ctx.cap = self.before


def _certificate(
    branch: Branch, work: Examination, crossings: Mapping[str, float], seconds: float
) -> BranchCertificate:
    found = work.found
    found.link()
    found.name_crossings(crossings)
    total = sum(segment.length for segment, _ in found.tubes)
    sought = [c.id for c in work.known if c.kind in work.kinds]
    lost = [name for name in sought if name not in found.events]
    segments = [segment for segment, _ in found.tubes]
    nodes = [segments[0].first, *(segment.last for segment in segments)]
    return BranchCertificate(
        branch.id,
        branch.word,
        branch.period,
        branch.parameter,
        tuple(work.kinds),
        float(nodes[0].unknowns[-1]),
        float(nodes[-1].unknowns[-1]),
        sum(tube is not None for _, tube in found.tubes),
        max(0.0, 1.0 - found.open_length / total) if total else 0.0,
        tuple(dict.fromkeys(found.events)),
        tuple(found.missing),
        () if found.unproven else tuple(lost),
        tuple(found.unproven),
        tuple(tuple(node.unknowns.tolist()) for node in nodes),
        tuple(tuple(node.tangent.tolist()) for node in nodes),
        tuple(() if t is None else tuple(t.box.tolist()) for _, t in found.tubes),
        seconds,
    )
