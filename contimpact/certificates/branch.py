"""The certificate of a branch: one smooth curve, and every event on it recorded.

Tubes are laid from orbit to orbit along the branch's table, as long as they go. Each is searched
for zeros of the test functions, and each zero has to be an entry. Where a proof fails the tube is
cut; what is left open is named with its piece of the parameter.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from flint import ctx

from ..bifurcations.registry import kind_of
from ..continuation.ends import EndKind
from ..models.model import Model
from ..models.word import Word
from ..orbits.problem import Array, OrbitProblem
from ..progress import Progress, ignore_progress
from ..results.branch import Branch, Entry, model_at
from ..schema import record
from ..segments.kernels import Kernels
from .birth import prove_birth
from .equations import BallProblem
from .event import EventCertificate
from .examination import BITS, DEEPEST, Examination, Findings, Piece, certified_entry
from .tube import (
    Budget,
    Node,
    Segment,
    halve_segment,
    nodes_of,
    points_of,
    prove_tube,
    scale_of,
    split,
    tubes_along,
)

BIRTH = 5
"""How often the first step of a branch born at a period doubling is halved."""
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
            found += [f"  {name}: {_piece_text(self.parameter, p)}: {p.what}" for p in pieces]
        return found + [f"  {name} is not proven to lie on the branch" for name in self.strange]

    def record(self) -> dict[str, Any]:
        """Return the certificate as plain data."""
        names = [field.name for field in fields(self)]
        return record(self, (*names, "complete"))


def _percent(share: float) -> str:
    """A share, rounded down: what is open shows."""
    return f"{math.floor(1e4 * share) / 1e2:.2f} %"


def _piece_text(parameter: str, piece: Piece) -> str:
    return f"{parameter} from {piece.start:.9g} to {piece.end:.9g}"


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
    began, budget = time.perf_counter(), Budget(seconds)
    with _branch_precision():
        problem = problem_of(branch, model, kernels)
        points = points_of(branch, problem)
        scale = scale_of(problem, points)
        alike = [e for e in entries if certificates[e.id].located and _belongs_to(problem, e)]
        own = [entry for entry in alike if entry.branch == branch.id]
        crossings = {e.id: e.value for e in alike if kind_of(e.kind).crossing}
        places = [certified_entry(entry, certificates[entry.id], problem) for entry in own]
        work = Examination(problem, kinds, places, budget)
        nodes = nodes_of(problem, points, scale)
        if branch.ends[0].kind is EndKind.BORN and len(nodes) > 1:
            _born(work, Segment(work.space, nodes[0], nodes[1], scale), BIRTH)
            nodes = nodes[1:]
        for segment, tube in tubes_along(work.space, nodes, scale, progress, budget):
            work.account(segment, tube)
        return _certificate(branch, work, own, crossings, time.perf_counter() - began)


def _belongs_to(problem: OrbitProblem, entry: Entry) -> bool:
    """Whether an entry has the word and the parameters of a branch, all but the followed one."""
    values = problem.model.values.items()
    same = all(entry.parameters[n] == v for n, v in values if n != problem.parameter)
    return same and (entry.word, entry.period) == (problem.word.walls, problem.word.period)


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
    began = time.perf_counter()
    with _branch_precision():
        problem = problem_of(branch, model, kernels)
        points = points_of(branch, problem)
        scale = scale_of(problem, points)
        alike = [e for e in entries if certificates[e.id].located and _belongs_to(problem, e)]
        own = [entry for entry in alike if entry.branch == branch.id]
        crossings = {e.id: e.value for e in alike if kind_of(e.kind).crossing}
        places = [certified_entry(entry, certificates[entry.id], problem) for entry in own]
        work = Examination(problem, record.kinds, places)
        stored = list(_stored_tubes(record, work.space, scale))
        if branch.ends[0].kind is EndKind.BORN and stored:
            _born(work, stored.pop(0)[0], 0)
        for segment, box in stored:
            tube = prove_tube(segment, box) if box is not None else None
            work.account(segment, tube, DEEPEST)
        _reaches(work.found, points, scale)
        return _certificate(branch, work, own, crossings, time.perf_counter() - began)


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
    branch: Branch,
    work: Examination,
    own: Sequence[Entry],
    crossings: Mapping[str, float],
    seconds: float,
) -> BranchCertificate:
    found = work.found
    found.link()
    found.name_crossings(crossings)
    total = sum(segment.length for segment, _ in found.tubes)
    sought = [c.id for c in own if c.kind in work.kinds]
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
