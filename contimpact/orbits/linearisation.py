"""An orbit problem at one point: residual, blocks, and what follows from them."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..segments.flight import FlightGaps, flight_gaps
from .multipliers import Stability, count_unstable, stability_of
from .physicality import Verdict, findings, judge, verdict_of

if TYPE_CHECKING:
    from .problem import OrbitProblem

Array = np.ndarray[Any, Any]


class Linearisation:
    """Residual and blocks at one point; what follows from them is computed when asked for.

    Attributes
    ----------
    unknowns : ndarray of shape (n + free,)
    residual : ndarray of shape (n,)
    start, end : ndarray of shape (N, m, m)
        The blocks A_k and B_k.
    by_parameter : ndarray of shape (n, free)
    """

    def __init__(
        self, problem: OrbitProblem, unknowns: Array, residual: Array, start: Array, end: Array,
        by_parameter: Array,
    ) -> None:  # fmt: skip
        self.problem, self.unknowns = problem, unknowns
        self.residual, self.start, self.end = residual, start, end
        self.by_parameter = by_parameter

    @functools.cached_property
    def jacobian(self) -> Array:
        """The (n, n + free) Jacobian."""
        matrix = self.cyclic(1.0)
        matrix[:, self.problem.n :] = self.by_parameter
        return matrix

    def cyclic(self, mu: float) -> Array:
        """The (n, n + free) cyclic matrix, its last coupling multiplied by mu; the columns of the
        parameters are zero."""
        n, free = self.problem.n, self.problem.free
        matrix = np.zeros(n * (n + free))
        end = self.end.ravel()
        if mu != 1.0:
            end = end.copy()
            end[-(self.problem.m**2) :] *= mu
        matrix[self.problem._at_start] = self.start.ravel()
        matrix[self.problem._at_end] += end
        return matrix.reshape(n, n + free)

    @functools.cached_property
    def stability(self) -> Stability:
        """Multipliers, their products, and the determinant of a period doubling.

        The derivative of an arrival by its time is the arrival's velocity (over the duration,
        between impacts on one wall). The orbit's own is put in its place: the multipliers next to
        a grazing go with its inverse, and the kernel's carries the rounding of larger terms.
        """
        problem, end = self.problem, self.end.copy()
        rows = problem.impacts(self.unknowns)
        durations = np.diff(np.append(rows[:, 0], rows[0, 0] + self.span))
        same = np.array([a == b for a, b in problem.kinds]) & (durations != 0.0)
        different = np.array([a != b for a, b in problem.kinds])
        arriving = np.roll(rows[:, 1], -1)
        end[same, 0, 0] = arriving[same] / durations[same]
        end[different, 0, 0] = arriving[different]
        return stability_of(self.start, end)

    @property
    def multipliers(self) -> Array:
        """Multipliers, largest first; infinite where an impact velocity vanishes."""
        return self.stability.multipliers

    @property
    def span(self) -> float:
        """The orbit's period."""
        return self.problem.span(self.unknowns)

    @property
    def largest_residual(self) -> float:
        """The largest absolute residual."""
        return float(np.max(np.abs(self.residual)))

    @functools.cached_property
    def n_unstable(self) -> int:
        """Number of multipliers outside the unit circle."""
        return int(count_unstable(self.multipliers))

    @functools.cached_property
    def gaps(self) -> list[FlightGaps]:
        """The interior touches of every flight."""
        problem = self.problem
        return flight_gaps(
            problem.kernels, problem.word.walls, problem.values(self.unknowns),
            problem.impacts(self.unknowns), self.span,
        )  # fmt: skip

    @functools.cached_property
    def verdict(self) -> Verdict:
        """Whether the orbit is physical, and if not why and where."""
        return self.judge()

    def judge(self, **forgiven: Any) -> Verdict:
        """As `verdict`, with a touch or an impact forgiven; see `physicality.judge`."""
        return judge(*self._flights(), **forgiven)

    def findings(self) -> tuple[float, ...]:
        """What `physicality.verdict` says of the orbit."""
        return findings(*self._flights())

    def _flights(self) -> tuple[Any, ...]:
        problem = self.problem
        impacts = problem.impacts(self.unknowns)
        return problem.word.walls, problem.model.WALLS, impacts, self.gaps

    @functools.cached_property
    def numbers(self) -> Array:
        """What is told of a point in a row of numbers, shape (2 m + 7,): the largest residual, the
        multipliers' real and imaginary parts, and what `physicality.verdict` says."""
        parts = self.multipliers.astype(complex).view(float)
        return np.concatenate([[self.largest_residual], parts, self.findings()])

    @functools.cached_property
    def derived(self) -> Mapping[str, float]:
        """Derived parameters at this point."""
        problem = self.problem
        found = problem.derived_at(problem.values(self.unknowns))
        return dict(zip(problem.model.DERIVED, found, strict=True))


class Described(Linearisation):
    """A point whose stability and verdict are known; residual and blocks follow when asked for.

    Parameters
    ----------
    problem : OrbitProblem
    unknowns : ndarray of shape (n + 1,)
    numbers : ndarray of shape (2 m + 7,)
        As `Linearisation.numbers`; the first of the last six is not a number where the verdict was
        not asked for.
    """

    def __init__(self, problem: OrbitProblem, unknowns: Array, numbers: Array) -> None:
        self.problem, self.unknowns, self.given = problem, unknowns, numbers

    def __getattr__(self, name: str) -> Any:
        if name not in ("residual", "start", "end", "by_parameter"):
            raise AttributeError(name)
        here = self.problem.evaluate(self.unknowns)
        self.residual, self.start, self.end = here.residual, here.start, here.end
        self.by_parameter = here.by_parameter
        return getattr(self, name)

    @functools.cached_property
    def numbers(self) -> Array:
        """What is told of a point in a row of numbers."""
        if np.isnan(self.given[-6]):
            return np.concatenate([self.given[:-6], self.findings()])
        return self.given

    @property
    def multipliers(self) -> Array:
        """Multipliers, largest first; infinite where an impact velocity vanishes."""
        return self.given[1:-6].copy().view(complex)

    @functools.cached_property
    def verdict(self) -> Verdict:
        """Whether the orbit is physical, and if not why and where."""
        problem = self.problem
        return verdict_of(self.numbers[-6:].tolist(), problem.word.walls, problem.model.WALLS)

    @property
    def largest_residual(self) -> float:
        """The largest absolute residual."""
        return float(self.given[0])
