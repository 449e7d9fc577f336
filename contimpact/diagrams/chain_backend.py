"""The backend for orbits of any coordinates and periods, plain or compiled."""

from __future__ import annotations

import contextlib
import functools
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import ARRAYS, Array, Containers, Vector
from ..bifurcations.extended_system import OneOrbit
from ..continuation.branch import Block
from ..continuation.step import HEAD
from ..models.guards import Row, orders_of
from ..orbits.cyclic_chain import (
    AT_END,
    AT_START,
    BY_RATE,
    FINDINGS,
    GAPS,
    PERIODS,
    WATCHED,
    ChainVectors,
    block_size,
    chain_step,
    evaluate_chain,
    evaluate_section,
    follow_law,
    kept_size,
    measure_chain,
    measure_section,
    observe_chain,
    tangent_of_chain,
)
from ..orbits.problem import Linearisation, OrbitProblem
from ..orbits.status import known_multipliers, pencil_multipliers, products_of, stability_of
from ..segments.compiling import timed_plainly
from ..segments.kernel import SECTION, Blocks
from ..segments.oscillation import MOST, ROW
from ..segments.segment import AT_SECTION, ELSEWHERE
from ..segments.touches import coordinates
from .orbit_backend import Functions, OrbitBackend, observing, plainly

if TYPE_CHECKING:
    from ..segments.machine_code import Program

MOST_COORDINATES = 4
"""Up to which steps in plain Python, or in machine code without a library, pay."""


class ChainBackend(OrbitBackend[ChainVectors]):
    """See `OrbitBackend`; for up to `MOST_COORDINATES` coordinates, and periods that are free.

    Steps themselves follow flights by linear laws, and, where they are compiled, those that are
    integrated; for gaps of others the points of a batch are looked at one by one.
    """

    ARGUMENTS = (
        "iiiiii" + "ffff" + "i" + "fff" + "FFFF" + "ffffff" + "FF" + "ffffff" + "ff" + "ffff" + "FF"
    )

    def __init__(self, problem: OrbitProblem, gaps: bool, doubling: bool) -> None:
        super().__init__(problem, gaps, doubling)
        self.by_laws = all(map(problem.kernels.linear, dict.fromkeys(problem.word.walls)))

    def follows(self, compiled: bool) -> bool:
        """Whether steps tell gaps."""
        kernels, guards = self.problem.kernels, self.problem.model.WALLS
        by_paths = compiled and kernels.has_paths and self.whole
        slides = any(guard.past for guard in guards)
        return self.gaps and not slides and (self.by_laws or by_paths)

    @functools.cached_property
    def whole(self) -> bool:
        """Whether modes have all coordinates."""
        model, size = self.problem.model, self.problem.model.DEGREES_OF_FREEDOM
        modes = {guard.next_mode for guard in model.WALLS}
        return all(all(orders_of(model.MODES, mode, size)) for mode in modes)

    @functools.cached_property
    def watched(self) -> list[int]:
        """What flights are watched for, by the wall they leave and another; see `cyclic_chain`."""
        kernels, walls = self.problem.kernels, range(self.walls)
        passages, bits = kernels.passages, [0] * self.walls**2
        for a in walls:
            jumps, ahead = self.jumps[a], kernels.guards_ahead(a)
            resting, behind = passages.resting(a), kernels.guards_behind(a)
            for b in walls:
                watched = passages.watched[a][b]
                begins = watched if jumps else b in ahead
                by_rate = b in passages.beginning(a) or b in resting
                bits[self.walls * a + b] = (
                    WATCHED * watched
                    + AT_START * begins
                    + BY_RATE * by_rate
                    + AT_END * (b in behind)
                )
        return bits

    @functools.cached_property
    def jumps(self) -> list[int]:
        """Of each wall, whether a flight begins elsewhere than on the wall it leaves."""
        arrivals = self.problem.kernels.passages.arrivals
        return [int(arrivals[a][a] == ELSEWHERE) for a in range(self.walls)]

    @functools.cached_property
    def coordinates(self) -> dict[Row, list[int]]:
        """The numbers of the walls on each gap coordinate."""
        return coordinates(self.problem.model)

    @functools.cached_property
    def laws(self) -> dict[str, int]:
        """Of each wall that is left, how many harmonics its law has, where flights follow laws."""
        if not self.by_laws:
            return {}
        kernels, start = self.problem.kernels, [0.0] * self.problem.m
        given = *start, *self.problem.model.values.values()
        return {a: int(kernels.law(a)(*given)[1]) for a in dict.fromkeys(self.problem.word.walls)}

    def path(self) -> dict[str, Sequence[float]]:
        return super().path() | {"watched": self.watched}

    @functools.cached_property
    def described(self) -> int:
        return 1 + FINDINGS + 2 * self.problem.m**2 + 2

    def vectors(self, made_by: Containers) -> ChainVectors:
        vector, table = made_by
        count, m, many = self.count, self.problem.m, len(self.coordinates)
        d = self.problem.model.DEGREES_OF_FREEDOM
        size = 2 * d + 2 * max(self.laws.values(), default=0) + 1
        measured = {i: g for g, found in enumerate(self.coordinates.values()) for i in found}

        def zeros(count: int) -> Vector:
            return vector([0.0] * count)

        common = self.common(made_by, m, many)
        common["counts"][GAPS] = int(self.follows(compiled=made_by is ARRAYS))
        return ChainVectors(
            **common,
            measured=vector([measured.get(i, -1) for i in range(len(self.jumps))]),
            weights=vector([float(c) for row in self.coordinates for c in row]),
            jumps=vector(self.jumps),
            ends=zeros(max(2 * m, size)),
            law=zeros((d + 1) * size),
            reduced=zeros(2 * m * m + 2 * m + 2),
            blocks=table(count, block_size(m)),
            kept=table(count, kept_size(m)),
            work=table(2 * m, 3 * m + 2),
            own=table(d, ROW),
            steps=table(0, ROW),
            breaks=zeros(2 * MOST * many),
            found=zeros(many),
            signs=zeros(many),
            zeros=zeros(many),
            moving=zeros(2 * d),
            forces=zeros(d + many),
        )

    @functools.cached_property
    def arrays(self) -> ChainVectors:
        given = self.vectors(ARRAYS)
        return given._replace(
            values=np.append(given.values, np.zeros(self.space)),
            steps=np.zeros((MOST * len(self.coordinates), ROW)),
        )

    @functools.cached_property
    def functions(self) -> Functions[ChainVectors]:
        kernels, m = self.problem.kernels, self.problem.m
        named = self.problem.model.letters
        flights: dict[int, Callable[..., Any]] = {}

        def flight(kind: int, ends: Vector, values: Vector) -> Blocks:
            if kind not in flights:
                flights[kind] = kernels.noticed(*(named[i] for i in divmod(kind, len(named))))
            found: Blocks = flights[kind](*ends[: 2 * m], *values)
            return found

        def law(wall: int, ends: Vector, values: Vector) -> Vector:
            return kernels.law(named[wall])(*ends[:m], *values)

        def follow(orbit: ChainVectors, wall: int, z: Vector, at: int, length: float) -> int:
            return follow_law(law, orbit, wall, z, at, length)

        evaluate = plainly(evaluate_chain, self.problem, flight)
        observe = observing(observe_chain, measure_chain, follow)
        return evaluate, chain_step, tangent_of_chain, observe

    @property
    def dear(self) -> bool:
        return not self.by_laws

    def resolve(self, z: Vector, row: Vector, at: int) -> None:
        """Fill in gaps and verdict of flights that steps do not follow."""
        here = Linearisation(self.problem, np.array(z))
        orbit, gaps = OneOrbit(here), at + self.described
        measured = [*orbit.gaps.ravel().tolist(), *orbit.slowest.ravel().tolist()]
        row[gaps : gaps + len(measured)] = measured
        row[at + 1 : at + 1 + FINDINGS] = list(here.findings)

    @functools.cached_property
    def variant(self) -> str | None:
        if self.obstacle:
            return None
        return "path" if self.problem.kernels.has_paths else "chain"

    @functools.cached_property
    def obstacle(self) -> str:
        kernels, guards = self.problem.kernels, self.problem.model.WALLS
        if kernels.has_paths or (
            all(kernels.linear(guard.name) for guard in guards)
            and len(set(self.laws.values())) == 1
        ):
            return ""
        if not self.by_laws:
            return "modes of which one has a closed form, and is not linear"
        return "modes that move by laws of different kinds"

    def written(self) -> Program:
        from .orbit_program import chain_program_of as program_of

        return program_of(self.problem.kernels)

    def block(self, rows: Array) -> Block:
        if self.gaps:
            self._look_at(rows)
        return super().block(rows)

    def told(self, rows: Array) -> tuple[Array, tuple[Array, Array, Array]]:
        m = self.problem.m
        pencils = rows[:, 1 + FINDINGS : 1 + FINDINGS + 2 * m * m].reshape(-1, 2, m, m)
        span, doubling = rows[:, self.described - 2], rows[:, self.described - 1]
        values, products, doubling = self.stability(pencils, doubling)
        described = np.hstack([rows[:, :1], values.view(float), rows[:, 1 : 1 + FINDINGS]])
        return described, (span, doubling, products)

    def stability(self, pencils: Array, doubling: Array) -> tuple[Array, Array, Array]:
        """Multipliers, their products, and the determinants of period doublings, from the pencils
        of the points and the determinants that steps have recorded."""
        values = pencil_multipliers(pencils[:, 0], pencils[:, 1])
        values = known_multipliers(values, self.problem.lost, int(self.problem.autonomous))
        return values, products_of(values), doubling

    def _look_at(self, rows: Array) -> None:
        """Fill in gaps and verdicts where they are not told; points beyond the range have no
        period."""
        n, kernels = self.problem.n + 1, self.problem.kernels
        at = 2 * n + HEAD
        kernels.whole = not kernels.long  # which the steps have noticed
        compiling_helps = self.follows(compiled=True)
        try:
            with timed_plainly(self.program) if compiling_helps else contextlib.nullcontext():
                for row in rows:
                    if math.isnan(row[at + 1]) and row[at + self.described - 2] != 0.0:
                        self.resolve(row[:n], row, at)
        finally:
            kernels.whole = False


class SectionBackend(ChainBackend):
    """The same for orbits without impacts whose flight is integrated: from the section, which is
    a guard behind all others on no gap coordinate, back to it."""

    def __init__(self, problem: OrbitProblem, gaps: bool, doubling: bool) -> None:
        super().__init__(problem, gaps, doubling)
        self.by_laws, self.count = False, 1

    def vectors(self, made_by: Containers) -> ChainVectors:
        given = super().vectors(made_by)
        given.counts[PERIODS] = 1  # also where the period is one of the unknowns
        return given

    def follows(self, compiled: bool) -> bool:
        model, size = self.problem.model, self.problem.model.DEGREES_OF_FREEDOM
        return self.gaps and compiled and all(orders_of(model.MODES, model.first_mode, size))

    @functools.cached_property
    def coordinates(self) -> dict[Row, list[int]]:
        mode, found = self.problem.model.first_mode, super().coordinates
        guards = self.problem.model.WALLS
        return {
            row: walls
            for row, walls in found.items()
            if any(mode in guards[i].modes for i in walls)
        }

    @functools.cached_property
    def jumps(self) -> list[int]:
        return [1] * (self.walls + 1)

    def path(self) -> dict[str, Sequence[float]]:
        guards, mode = self.problem.model.WALLS, self.problem.model.first_mode
        met = [WATCHED * (mode in guard.modes and not guard.past) for guard in guards]
        return {
            "kinds": [0],
            "word": [self.walls],
            "arrivals": [AT_SECTION],
            "watched": [0] * self.walls**2 + met,
            "leaving": [0.0] * (self.walls + 1),
            "velocities": [],
        }

    @functools.cached_property
    def functions(self) -> Functions[ChainVectors]:
        problem, m = self.problem, self.problem.m
        kernels, periods, free = problem.kernels, problem.word.period, problem.autonomous
        noticed = kernels.noticed(SECTION, str(periods))

        def flight(z: Vector, values: Vector) -> Blocks:
            rows, start, end, by = noticed(z[0], 0.0 if free else z[1], *z[2:m], *z[:m], *values)
            return rows, tuple(problem.leaves(start).tolist()), end, by

        def spans(z: Vector, period: float) -> tuple[float, float]:
            return (z[1], z[1]) if free else (periods * period, period)

        def follow(orbit: ChainVectors, wall: int, z: Vector, at: int, length: float) -> int:
            return -1

        evaluate = plainly(evaluate_section, problem, flight, spans)
        observe = observing(observe_chain, measure_section, follow)
        return evaluate, chain_step, tangent_of_chain, observe

    @functools.cached_property
    def variant(self) -> str | None:
        return None if self.obstacle else f"section {self.problem.word.period}"

    @functools.cached_property
    def obstacle(self) -> str:
        return "" if self.problem.kernels.has_path(SECTION) else "a field that has no series"

    @functools.cached_property
    def space(self) -> int:
        from .orbit_program import space_from_section

        return space_from_section(self.problem.kernels, self.problem.word.period)

    def written(self) -> Program:
        from .orbit_program import section_program_of as program_of

        return program_of(self.problem.kernels, self.problem.word.period)

    def stability(self, pencils: Array, doubling: Array) -> tuple[Array, Array, Array]:
        """The same, as at single points."""
        lost, held = self.problem.lost, int(self.problem.autonomous)
        found = [stability_of(*pencil[:, None]).without(lost, held) for pencil in pencils]
        return (
            np.array([one.multipliers for one in found]),
            np.array([one.products for one in found]),
            np.array([one.doubling for one in found]),
        )
