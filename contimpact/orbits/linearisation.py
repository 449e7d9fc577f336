"""An orbit problem at one point: residual, blocks, and what follows from them."""

from __future__ import annotations

import functools
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..arrays import Array, Number
from ..models.guards import Guard
from ..segments.flight import FlightGaps
from ..segments.segment import ELSEWHERE, MEETING
from .block_cyclic import BRIEF
from .multipliers import (
    Stability,
    count_unstable,
    determinant,
    stability_of,
    stability_of_orbit,
)
from .physicality import AT_REST, Verdict, findings, verdict_of

if TYPE_CHECKING:
    from .problem import OrbitProblem


class CyclicBlocks(NamedTuple):
    """Residual and blocks of all segments of an orbit.

    Attributes
    ----------
    residual : ndarray of shape (n,)
    start, end : ndarray of shape (N, m, m)
        The blocks A_k and B_k.
    by_parameter : ndarray of shape (n, free)
    together : bool
        Whether rows of a flight are combinations of its equations; see `layout.Together`.
    """

    residual: Array
    start: Array
    end: Array
    by_parameter: Array
    together: bool = False


class Summary(NamedTuple):
    """What a branch keeps of a point, as a row of 2 m + 7 numbers; or of many, as rows.

    Attributes
    ----------
    largest_residual : float
    multipliers : ndarray of complex, shape (m,)
        Largest first.
    findings : ndarray of shape (6,)
        What `physicality.verdict` returns; the first is NaN where that was not asked for.
    """

    largest_residual: Number
    multipliers: Array
    findings: Array

    @classmethod
    def of(cls, rows: Array) -> Summary:
        """Return the summary in a row, or those in rows."""
        multipliers = np.ascontiguousarray(rows[..., 1:-6]).view(complex)
        return cls(rows[..., 0], multipliers, rows[..., -6:])

    @property
    def row(self) -> Array:
        """The summary of one point as a row."""
        parts = self.multipliers.astype(complex).view(float)
        return np.concatenate([[self.largest_residual], parts, self.findings])


class Linearisation:
    """An orbit problem at one point; what follows from it is computed when asked for.

    Parameters
    ----------
    problem : OrbitProblem
    unknowns : ndarray of shape (n + free,)
    blocks : CyclicBlocks, optional
        Evaluated when asked for if not given.
    summary : Summary, optional
        What is known of the point already.
    """

    def __init__(
        self,
        problem: OrbitProblem,
        unknowns: Array,
        blocks: CyclicBlocks | None = None,
        summary: Summary | None = None,
    ) -> None:
        self.problem, self.unknowns, self._known = problem, unknowns, summary
        if blocks is not None:
            self.blocks = blocks

    @functools.cached_property
    def blocks(self) -> CyclicBlocks:
        """Residual and blocks."""
        return self.problem.evaluate(self.unknowns).blocks

    @property
    def residual(self) -> Array:
        """The residual, shape (n,)."""
        return self.blocks.residual

    @property
    def start(self) -> Array:
        """The blocks A_k, shape (N, m, m)."""
        return self.blocks.start

    @property
    def end(self) -> Array:
        """The blocks B_k, shape (N, m, m)."""
        return self.blocks.end

    @property
    def by_parameter(self) -> Array:
        """Derivatives of the residual with respect to the free parameters, shape (n, free)."""
        return self.blocks.by_parameter

    @functools.cached_property
    def jacobian(self) -> Array:
        """The (n, n + free) Jacobian."""
        matrix = self.cyclic(1.0)
        matrix[:, self.problem.n :] = self.by_parameter
        return matrix

    def cyclic(self, mu: float) -> Array:
        """The (n, n + free) cyclic matrix, its last coupling multiplied by mu; the columns of the
        parameters are zero."""
        end = self.end.ravel()
        if mu != 1.0:
            end = end.copy()
            end[-(self.problem.m**2) :] *= mu
        return self.problem.cyclic(self.start.ravel(), end)

    @functools.cached_property
    def stability(self) -> Stability:
        """Multipliers, their products, and the determinant of a period doubling.

        The derivative of an arrival by its time is the arrival's velocity (over the duration,
        back on the surface left). The orbit's own is put in its place: the multipliers next to
        a grazing go with its inverse, and the kernel's carries the rounding of larger terms.
        """
        problem, start = self.problem, self.held
        if problem.arrivals and self.blocks.together:
            return self.told(self._in_pieces(start))
        if not problem.arrivals:  # without impacts
            return self.told(stability_of(start, self.end))
        if problem.m == 2:
            found = stability_of_orbit(
                start, self.end, problem.arrivals, self.unknowns.tolist(), self.span
            )
            return self.told(found)
        end = self.end.copy()
        rows = problem.impacts(self.unknowns)
        durations = np.diff(np.append(rows[:, 0], rows[0, 0] + self.span))
        arrivals = np.array(problem.arrivals)
        brief = (arrivals == MEETING) & (np.abs(durations) < BRIEF * self.span)
        same = (arrivals != ELSEWHERE) & (durations != 0.0) & ~brief
        different = arrivals == ELSEWHERE
        arriving = np.roll(rows[:, 1], -1)
        end[same, 0, 0] = arriving[same] / durations[same]
        end[different, 0, 0] = arriving[different]
        return self.told(stability_of(start, end))

    def _in_pieces(self, start: Array) -> Stability:
        """The same where flights are computed in pieces.

        Without forcing, the derivatives by both times are opposite: those of the end where the row
        is smaller are the exact ones. Of one degree of freedom the other multiplier of all
        directions is then 1, so that their product is the one asked for, whatever its size.
        """
        found = stability_of(start, self.end)
        if not (self.problem.autonomous and self.problem.m == 2):
            return found
        start, end = self.start.copy(), self.end.copy()
        by_start = np.abs(start[:, :, 1]) < np.abs(end[:, :, 1])
        later = np.where(by_start, -start[:, :, 0], end[:, :, 0])
        start[:, :, 0], end[:, :, 0] = -later, later
        values = np.array([determinant(start, end), 0.0], dtype=complex)
        return replace(found, multipliers=values)

    @property
    def held(self) -> Array:
        """The blocks A_k of the multipliers; see `OrbitProblem.held`."""
        return self.problem.held(self.start)

    @property
    def by_blocks(self) -> Stability:
        """Stability by the blocks as they are, where an impact is at rest or a flight vanishes."""
        return self.told(stability_of(self.held, self.end))

    def told(self, found: Stability) -> Stability:
        """Return what blocks tell of stability, less what is known without them."""
        return found.without(self.problem.lost, int(self.problem.autonomous))

    @property
    def multipliers(self) -> Array:
        """Multipliers, largest first; infinite where an impact velocity vanishes."""
        return self._known.multipliers if self._known else self.stability.multipliers

    @property
    def span(self) -> float:
        """The orbit's period."""
        return self.problem.span(self.unknowns)

    @property
    def largest_residual(self) -> float:
        """The largest absolute residual."""
        known = self._known
        return float(known.largest_residual if known else np.max(np.abs(self.residual)))

    @functools.cached_property
    def n_unstable(self) -> int:
        """Number of multipliers outside the unit circle."""
        return int(count_unstable(self.multipliers))

    @functools.cached_property
    def gaps(self) -> list[FlightGaps]:
        """The interior touches of every flight."""
        return self.problem.gaps(self.unknowns)

    @functools.cached_property
    def verdict(self) -> Verdict:
        """Whether the orbit is physical, and if not why and where."""
        problem = self.problem
        return verdict_of(self.findings, problem.word.walls, problem.model.WALLS)

    def judge(
        self,
        forgive_touches: Collection[tuple[int, str]] = (),
        forgive_impacts: Collection[int] = (),
    ) -> Verdict:
        """As `verdict`, with touches or impacts forgiven; see `physicality.findings`."""
        found = findings(*self._flights(), forgive_touches, forgive_impacts)
        return verdict_of(found, self.problem.word.walls, self.problem.model.WALLS)

    @property
    def resting(self) -> list[int]:
        """The impacts whose velocity is rounding beside the speeds along the flights."""
        problem = self.problem
        speed = float(problem.scale(self.unknowns, 1.0)[1])
        velocities = problem.impacts(self.unknowns)[: len(problem.word), 1]
        return np.nonzero(np.abs(velocities) < AT_REST * speed)[0].tolist()

    @functools.cached_property
    def findings(self) -> Sequence[float]:
        """What `physicality.verdict` says of the orbit."""
        if self._known and not np.isnan(self._known.findings[0]):
            return self._known.findings.tolist()
        return findings(*self._flights())

    def _flights(self) -> tuple[str, Sequence[Guard], Array, Sequence[FlightGaps]]:
        problem = self.problem
        impacts = problem.impacts(self.unknowns)
        return problem.word.walls, problem.model.WALLS, impacts, self.gaps

    @functools.cached_property
    def numbers(self) -> Array:
        """The row of the point's `Summary`."""
        return Summary(self.largest_residual, self.multipliers, np.array(self.findings)).row

    @functools.cached_property
    def derived(self) -> Mapping[str, float]:
        """Derived parameters at this point."""
        problem = self.problem
        found = problem.derived_at(problem.values(self.unknowns))
        return dict(zip(problem.model.DERIVED, found, strict=True))
