"""Test functions of orbits, and the extended systems whose zeros are events.

======  ===================================================  ====================================
kind    equations                                            unknowns besides orbit and parameters
======  ===================================================  ====================================
FB      F = 0, C(1) q = 0, (q.q - 1)/2 = 0                   q, the eigenvector of the multiplier 1
PD      F = 0, C(-1) q = 0, (q.q - 1)/2 = 0                  q, the eigenvector of -1
NS      F = 0, C_0 q_k + C_1 q_{k+1} = 0 for k = 0, 1 with   q_0, q_1, kappa = cos(theta)
        q_2 = 2 kappa q_1 - q_0, |q| = 1, phase of q
BP      F + nu psi = 0, J' psi = 0, psi.psi - 1 = 0          nu (zero at a branch point), psi
G       F = 0, flight from its impact to the touch = 0       the touch: its time, and the section
                                                             coordinates other than its velocity
        F = 0, rate where a flight begins on a surface = 0
V       F = 0, v_k = 0
T       F = 0, t_{k+1} - t_k = 0
UZ      F = 0, parameter - value = 0
======  ===================================================  ====================================

C(mu) is the cyclic block matrix with its last coupling multiplied by mu; J the Jacobian including
the first parameter. With one free parameter a system is square and its solution an event; with two,
its solutions are a curve. FB and PD after Seydel (1979), BP after Moore (1980).
"""

from __future__ import annotations

import functools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..continuation.branch import (
    Between,
    Block,
    Details,
    Event,
    Location,
    Point,
    Problem,
    TestFunction,
)
from ..continuation.crossing_branches import Meeting
from ..orbits.problem import Linearisation, OrbitProblem, rounding
from ..segments.bounded import bounds_of
from ..segments.kernel import SECTION
from ..segments.segment import Segment
from .event_solver import LocatedPoint, solver_of
from .scalar_systems import CONVERGED, EPSILON, FAR, FIRST_ORDER, NEWTON_ITERATIONS, ScalarForm

# Test functions of orbits: written once, for a single orbit and for all those of a batch.

OrbitPoint: TypeAlias = Point[Linearisation]
OrbitEvent: TypeAlias = Event[Linearisation]
"""Event on a branch of periodic orbits."""


@dataclass(frozen=True, eq=False)
class ManyOrbits:
    """P orbits on a branch, those of a batch.

    `unknowns` and `tangents` are of shape (P, n + 1), `orientations`, `doubling` and `spans`, the
    orbits' periods, (P,), and `products` (P, pairs); see `contimpact.orbits.status.Stability`.
    `gaps`, the smallest interior gap of each flight to each wall, NaN if there is none, are
    (P, N, W), `slowest` (P, N), as of `contimpact.segments.flight.excursions`, and `derived`
    parameters (P, D).
    """

    unknowns: Array
    tangents: Array
    orientations: Array
    spans: Array
    doubling: Array
    products: Array
    gaps: Array
    slowest: Array
    derived: Array


class OneOrbit:
    """As `ManyOrbits`, for a single orbit, of which what is costly is computed when it is asked
    for. Without a point it has no tangent."""

    def __init__(self, here: Linearisation, point: OrbitPoint | None = None) -> None:
        self.here, self.unknowns = here, here.unknowns[None]
        none = np.full(len(here.unknowns), np.nan)
        self.tangents = (none if point is None else point.tangent)[None]
        self.orientations = np.array([np.nan if point is None else point.orientation])

    @property
    def spans(self) -> Array:
        return np.array([self.here.span])

    @property
    def doubling(self) -> Array:
        return np.array([self.here.stability.doubling])

    @property
    def products(self) -> Array:
        return self.here.stability.products[None]

    @property
    def gaps(self) -> Array:
        gaps = [[np.nan if t is None else t.gap for t in f.touches] for f in self.here.gaps]
        return np.array([gaps])

    @property
    def slowest(self) -> Array:
        return np.array([[flight.slowest for flight in self.here.gaps]])

    @property
    def derived(self) -> Array:
        return np.array([list(self.here.derived.values())])


Orbits: TypeAlias = ManyOrbits | OneOrbit


class OrbitTest(TestFunction[Linearisation]):
    """A test function of orbits.

    Implementers give `kind`, `of`, and, where they can, `locate`. `needs` names what of `Orbits`
    a batch has only where it is asked for: ``"doubling"`` and ``"gaps"``, with ``"slowest"``.
    """

    needs: tuple[str, ...] = ()

    @abstractmethod
    def of(self, orbits: Orbits) -> Array:
        """Return the values, shape (P, q)."""

    def measured(self, orbits: Orbits) -> Array:
        """Return the values in units in which those that are rounding are told."""
        return self.of(orbits)

    def values(self, point: OrbitPoint) -> Array:
        return self._existing(self.measured(OneOrbit(point.evaluation, point)))[0]

    def batch(self, block: Block) -> Array:
        assert isinstance(block.measured, ManyOrbits)
        return self._existing(self.measured(block.measured))

    def _existing(self, values: Array) -> Array:
        if not self.vanishing:
            return values
        return np.where(np.abs(values) < self.vanishing, np.nan, values)


@dataclass(frozen=True)
class SystemEvaluation:
    """An extended system at one point."""

    residual: Array
    """Shape (q,)."""
    derivatives: Array | Callable[[], Array]
    """The Jacobian, or what makes it where second derivatives of flights make it dear: the last
    iterate is seen to be one by its residual alone."""

    @functools.cached_property
    def jacobian(self) -> Array:
        """Columns by the orbit's unknowns and parameters, then by the system's own unknowns."""
        return self.derivatives() if callable(self.derivatives) else self.derivatives


class ExtendedSystem(ABC):
    """The defining equations of one kind of event, on the orbits of one problem.

    Those that are scalar code as well have a `form`.
    """

    form: ScalarForm | None = None

    def __init__(self, problem: OrbitProblem) -> None:
        self.problem = problem

    @abstractmethod
    def start(self, here: Linearisation) -> Array:
        """Return a guess of the system's own unknowns at an orbit near the event."""

    @abstractmethod
    def assemble(self, here: Linearisation, own: Array) -> SystemEvaluation:
        """Return the system at an orbit and its own unknowns."""

    @abstractmethod
    def rounding(self, here: Linearisation, own: Array) -> Array:
        """Return bounds of the rounding errors of the residuals there, shape (q,)."""

    def scale(self, own: Array, sizes: Array) -> Array:
        """Return natural sizes of the system's own unknowns, given those of the orbit's."""
        return np.ones(len(own))

    def own_sizes(self, own: Array, sizes: Array) -> Array:
        """Return sizes of the system's own unknowns as the equations see them, given those of the
        orbit's."""
        return np.abs(own)

    def sizes(self, jacobian: Array, sizes: Array) -> Array:
        """Return natural sizes of the residuals, given those of all unknowns."""
        return moves(jacobian, sizes)

    def sizes_at(self, at: SystemEvaluation, here: Linearisation, own: Array) -> Array:
        """Return natural sizes of the residuals at a point."""
        n = self.problem.n
        sizes = self.problem.scale(here.unknowns, np.full(self.problem.free, np.inf))[:n]
        unknowns = np.hstack([sizes, here.unknowns[n:], self.own_sizes(own, sizes)])
        return self.sizes(at.jacobian, unknowns)

    def details(self, own: Array) -> Details:
        """Return what the system's own unknowns tell of where on the orbit it is."""
        return {}


def moves(jacobian: Array, sizes: Array) -> Array:
    """Return how far unknowns that move by their sizes move equations, as powers of two."""
    largest = np.max(np.abs(jacobian * sizes), axis=1)
    return np.asarray(2.0 ** np.frexp(np.where(largest > 0.0, largest, 1.0))[1])


@dataclass(frozen=True)
class Solution:
    """A solved square system: the orbit, and the system's own unknowns."""

    system: ExtendedSystem
    here: Linearisation
    own: Array
    at: SystemEvaluation
    known_error: float | None = None
    """The parameter's, where it came with the solution."""

    @property
    def unknowns(self) -> Array:
        """The orbit's."""
        return self.here.unknowns

    @property
    def residual(self) -> float:
        """The largest one."""
        return float(np.max(np.abs(self.at.residual)))

    @property
    def error(self) -> float:
        """A bound of the parameter's error."""
        if self.known_error is not None:
            return self.known_error
        return self.error_of(len(self.unknowns) - 1)

    def error_of(self, place: int) -> float:
        """Bound the error of an unknown; infinite where it has no bound.

        Its row of the inverse Jacobian against residual and rounding, both taken at their largest:
        what cannot be told from zero in double precision.
        """
        try:
            row = np.linalg.solve(self.at.jacobian.T, np.eye(len(self.at.residual))[place])
            return float(np.abs(row) @ self._off)
        except (ArithmeticError, ValueError, np.linalg.LinAlgError):
            return float("inf")

    @functools.cached_property
    def _off(self) -> Array:
        rounding_errors = self.system.rounding(self.here, self.own)
        return FIRST_ORDER * np.abs(self.at.residual) + rounding_errors


CHORD = 1e-3
"""Where a step leaves less of the residual than this part, the next one takes the same Jacobian:
it leaves as little, and second derivatives of flights cost much more than residuals."""


def solve(system: ExtendedSystem, here: Linearisation, far: float = FAR) -> Solution | None:
    """Solve a system with one free parameter to rounding; None if Newton's iteration fails.

    It fails where it leaves the surroundings of its guess, be it for another event further away.
    """
    if (solver := solver_of(system.problem, system.form)) and system.form:
        found = solver.solve(system.form, here, system.start(here), far)
        if found is None:
            return None
        if found.known:
            at = SystemEvaluation(found.residual, found.jacobian)
            return Solution(system, found.here, found.own, at, found.error)
    problem, orbit = system.problem, len(here.unknowns)
    sizes = problem.scale(here.unknowns, np.full(problem.free, np.inf))
    near = surroundings(here, sizes, far)
    x, best = np.concatenate([here.unknowns, system.start(here)]), None
    try:
        at = system.assemble(here, x[orbit:])
        units = system.sizes_at(at, here, x[orbit:])
        for _ in range(NEWTON_ITERATIONS):
            size = float(np.max(np.abs(at.residual) / units))
            if not np.isfinite(size) or (
                best is not None and size >= 0.5 * best[0] < 0.5 * CONVERGED
            ):
                break
            if best is None or size > CHORD * best[0]:
                jacobian = at.jacobian / units[:, None]
            best = (size, x, at, here)
            x = x - np.linalg.solve(jacobian, at.residual / units)
            if not near(x[:orbit]):
                break
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # it may diverge
                here = problem.evaluate(x[:orbit])
                at = system.assemble(here, x[orbit:])
        if best is None or best[0] >= CONVERGED:
            return None
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        return None
    _, x, at, here = best
    return Solution(system, here, x[orbit:], at)


def surroundings(here: Linearisation, sizes: Array, far: float = FAR) -> Callable[[Array], bool]:
    """Return whether unknowns are those of an orbit like one, given their natural sizes."""
    problem, begin = here.problem, here.unknowns
    span = problem.span(begin)

    def near(unknowns: Array) -> bool:
        with np.errstate(invalid="ignore", over="ignore"):  # where they have diverged
            away = float(np.linalg.norm((unknowns - begin) / sizes))
        return away < far and abs(problem.span(unknowns)) < FAR * span

    return near


def located(
    system: ExtendedSystem, guess: OrbitPoint, details: Callable[[Solution], Details] | None = None
) -> Location | None:
    """Solve a system from a point as a test function does; None if that fails."""
    solution = solve(system, guess.evaluation)
    if solution is None:
        return None
    told = details(solution) if details else {}
    return Location(solution.unknowns, solution.residual, solution.error, told, solution.here)


def event_on(
    kind: str,
    form: ScalarForm,
    arc: Between,
    fraction: float,
    details: Callable[[LocatedPoint], Details],
) -> OrbitEvent | None:
    """Locate an event on an arc in one go, as a test function does; None if that fails."""
    solver = solver_of(arc.left.evaluation.problem, form)
    found = solver.locate(form, arc, fraction) if solver else None
    if found is None:
        return None
    return Event(kind, found.point, found.residual, found.error, "newton", details(found))


def rounding_of_product(matrix: Array, bounds: Array, vector: Array) -> Array:
    """Bound the rounding of a product with a matrix whose entries have errors of their own."""
    terms = np.count_nonzero(matrix, axis=1)
    return bounds @ np.abs(vector) + EPSILON * terms * (np.abs(matrix) @ np.abs(vector))


def rounding_of_length(vector: Array) -> float:
    """Bound the rounding of half the difference of a vector's squared length from one."""
    return EPSILON * len(vector) * float(vector @ vector)


# Orbits with a given multiplier: the cyclic matrix is singular. FB and PD share its equations.

UNIT_CIRCLE = 1e-2
"""How near to its critical value a located event's multiplier is at least."""

ROUNDING = 1e-14
"""Rounding of the scaled determinants."""


QUOTIENT = 1e-12
"""Rounding of a multiplier, times the least trace of an impact, by which it is divided."""


NO_TRACE = 1e-7
"""Trace of an impact that is rounding: times of touches are known to the square root of it only."""


def trace_of(here: Linearisation, moved: Array) -> float:
    """Return the least that unknowns of impacts, moved by their natural sizes in all, change the
    flights before and after by, at their other ends, beside the sizes of the equations.

    For impacts that change their state it is about one, however slow they are. An impact that
    changes neither velocity nor acceleration, as the end of a contact with a soft stop, leaves no
    trace where its velocity vanishes: then C(mu) is singular, whatever mu, so that determinants of
    C(mu) have the trace as a factor, besides those of the multipliers.
    """
    problem, (rows, sizes) = here.problem, here.sizes
    own = here.cyclic(0.0)
    around = here.cyclic(1.0) - own
    if problem.autonomous:  # the first impact is held in time, and all others move instead
        around[:, 0] = -own[:, : problem.n : problem.m].sum(axis=1)
    both = np.hstack([own[:, moved].T, around[:, moved].T]) / np.tile(rows, 2)
    return float(np.linalg.norm(both * sizes[moved, None], -2))


def least_trace(here: Linearisation) -> float:
    """Return the trace of the impact that leaves the least; infinite without impacts."""
    m = here.problem.m
    impacts = (np.arange(m * k, m * k + m) for k in range(len(here.problem.word)))
    return min((trace_of(here, moved) for moved in impacts), default=math.inf)


def is_near(here: Linearisation, values: ArrayLike, target: float, known: bool = False) -> bool:
    """Whether one of some multipliers, or of products of some, is where an event of the orbit needs
    it; `known` says that it is there but for rounding, or else nowhere near.

    Determinants also vanish where flights do: at r = 0 impacts merge, and no multiplier is near.
    Where the velocity of an impact is rounding, as at a V, so are multipliers, which have it as a
    divisor. Where an impact leaves little trace, a determinant vanishes by that, if the multiplier
    is further away.
    """
    apart = np.abs(np.asarray(values) - target)
    away = float(np.min(apart[np.isfinite(apart)], initial=math.inf))
    if here.resting or not away < UNIT_CIRCLE:
        return False
    trace = least_trace(here)
    return away < trace or (known and away * trace < QUOTIENT)


def leaves_no_trace(here: Linearisation) -> bool:
    """Whether an impact leaves no trace, as nearly as is known."""
    return least_trace(here) < NO_TRACE


def vanishes(here: Linearisation, value: float, terms: float) -> bool:
    """Whether a value of an orbit with a critical multiplier vanishes beside the terms it is the
    sum of, and not by the trace of an impact: it has that for a factor."""
    return abs(value) <= least_trace(here) ** 1.5 * terms


def has_multiplier(event: OrbitEvent, target: float) -> bool:
    """Whether a multiplier is where the event needs one."""
    here = event.point.evaluation
    return is_near(here, here.multipliers, target)


def null_vectors(here: Linearisation, mu: float) -> tuple[Array, Array]:
    """Return the left and the right null vector of C(mu), which lacks one rank.

    They are oriented together: their product is a positive multiple of the adjugate, which does not
    vanish along a curve of such matrices.
    """
    left, right = here.singular_vectors(here.cyclic(mu)[:, : here.problem.n])
    sign = np.linalg.slogdet(left)[0] * np.linalg.slogdet(right)[0]
    return sign * unit_vector(left[-1]), unit_vector(right[-1])


def unit_vector(vector: Array) -> Array:
    """Return the vector of length one in the same direction."""
    return np.asarray(vector / np.linalg.norm(vector))


class SingularCycle(ExtendedSystem):
    """C(mu) is singular: mu is a multiplier. FB for mu = 1, PD for mu = -1."""

    def __init__(self, problem: OrbitProblem, mu: float) -> None:
        super().__init__(problem)
        self.mu, self.form = mu, ScalarForm("singular", mu=mu)

    def start(self, here: Linearisation) -> Array:
        cycle = here.cyclic(self.mu)[:, : self.problem.n]
        return unit_vector(here.singular_vectors(cycle)[1][-1])

    def own_sizes(self, own: Array, sizes: Array) -> Array:
        return np.max(np.abs(own) / sizes) * sizes

    def assemble(self, here: Linearisation, own: Array) -> SystemEvaluation:
        problem, n = self.problem, self.problem.n
        orbit = len(here.unknowns)
        cycle = here.cyclic(self.mu)[:, :n]

        def derivatives() -> Array:
            along = np.concatenate([own, np.zeros(orbit - n)])
            found = np.zeros((2 * n + 1, orbit + n))
            found[:n, :orbit] = here.jacobian
            found[n : 2 * n, :orbit] = problem.second_along(here.unknowns, along, self.mu)
            found[n : 2 * n, orbit:] = cycle
            found[2 * n, orbit:] = own
            return found

        residual = here.residual, cycle @ own, [0.5 * (own @ own - 1.0)]
        return SystemEvaluation(np.concatenate(residual), derivatives)

    def rounding(self, here: Linearisation, own: Array) -> Array:
        bounds, n = rounding(here), self.problem.n
        product = rounding_of_product(here.cyclic(self.mu)[:, :n], bounds.cyclic(1.0)[:, :n], own)
        return np.concatenate([bounds.residual, product, [rounding_of_length(own)]])


class SingularTest(OrbitTest):
    """A test function that vanishes where `mu` is a multiplier; implementers give `of` alone."""

    mu: float

    def locate_on(self, arc: Between, fraction: float, index: int) -> OrbitEvent | None:
        form = ScalarForm("singular", mu=self.mu)
        return event_on(self.kind, form, arc, fraction, lambda _: {"index": index})

    def locate(
        self, problem: Problem[Linearisation], guess: OrbitPoint, index: int
    ) -> Location | None:
        return located(SingularCycle(guess.evaluation.problem, self.mu), guess)

    def accept(self, event: OrbitEvent) -> bool:
        return has_multiplier(event, self.mu)


# Whether branches of orbits cross, or pass each other: what unfolds the crossing, and its error.
#
# The equations stand in `contimpact.continuation.crossing_branches`.

UPRIGHT = 1e-6
"""A branch whose direction at a branch point changes the parameter by less is not told from one
that stands upright there: their folds lie within the square of this."""

BESIDE = 1e-3
"""How near to such a branch point a fold is not told from it."""
AWAY = 10.0
"""How many times further a step to a branch point has to go to tell that there is none: of 60 folds
it goes 0.0136 at least, from branch points 2e-5 at most."""


class Crossing(ExtendedSystem):
    """Two branches cross, with respect to the first free parameter; nu measures how far from it."""

    def start(self, here: Linearisation) -> Array:
        """The column of the parameter tells nothing: it vanishes with the orbit at a rest."""
        return np.concatenate([[0.0], null_vectors(here, 1.0)[0]])

    def assemble(self, here: Linearisation, own: Array) -> SystemEvaluation:
        problem, n = self.problem, self.problem.n
        orbit = len(here.unknowns)
        nu, psi = own[0], own[1:]
        square = here.jacobian[:, : n + 1]

        def derivatives() -> Array:
            found = np.zeros((2 * n + 2, orbit + n + 1))
            found[:n, :orbit] = here.jacobian
            found[:n, orbit] = psi
            found[:n, orbit + 1 :] = nu * np.eye(n)
            for i, direction in enumerate(np.eye(orbit)[: n + 1], n):
                found[i, :orbit] = psi @ problem.second_along(here.unknowns, direction)
            found[n : 2 * n + 1, orbit + 1 :] = square.T
            found[2 * n + 1, orbit + 1 :] = 2.0 * psi
            return found

        residual = here.residual + nu * psi, square.T @ psi, [psi @ psi - 1.0]
        return SystemEvaluation(np.concatenate(residual), derivatives)

    def rounding(self, here: Linearisation, own: Array) -> Array:
        bounds, n, psi = rounding(here), self.problem.n, own[1:]
        shifted = bounds.residual + EPSILON * (np.abs(here.residual) + np.abs(own[0] * psi))
        product = rounding_of_product(
            here.jacobian[:, : n + 1].T, bounds.jacobian[:, : n + 1].T, psi
        )
        return np.concatenate([shifted, product, [2.0 * rounding_of_length(psi)]])


def unfolding_of(solution: Solution) -> dict[str, float]:
    """Return what unfolds a crossing of branches, with its error."""
    return {"nu": float(solution.own[0]), "nu_error": solution.error_of(len(solution.unknowns))}


def branches_cross(details: Details) -> bool:
    """Whether branches cross, as far as can be told."""
    return abs(details["nu"]) <= details["nu_error"]


def crossing_near(
    problem: Problem[Linearisation], guess: OrbitPoint, scale: Array
) -> Meeting | None:
    """Return where two branches cross, or pass each other, next to a point; None if nowhere.

    `scale` has the sizes of the unknowns, by which the distance is measured.
    """
    solution = solve(Crossing(guess.evaluation.problem), guess.evaluation)
    if solution is None:
        return None
    sizes, _ = np.linalg.eigh(form_at(solution, scale)[0])
    if not sizes[0] < 0.0 < sizes[1]:
        return None
    told, residuals = unfolding_of(solution), solution.here.problem.residual_sizes(scale)
    own, other = abs(sizes[::-1] if told["nu"] > 0.0 else sizes).tolist()
    unit = 1.0 / float(np.max(np.abs(solution.own[1:]) / residuals))
    return Meeting(solution.unknowns, told["nu"], told["nu_error"], (own, other), unit)


def form_at(solution: Solution, scale: Array) -> tuple[Array, Array]:
    """Return the form psi . F_zz on the null space of a crossing, and the null vectors in rows."""
    here, size = solution.here, len(solution.here.residual) + 1
    rows = here.problem.residual_sizes(scale)
    null = np.linalg.svd(here.jacobian * scale / rows[:, None])[2][-2:] * scale
    second = solution.at.jacobian[size - 1 : 2 * size - 1, :size]
    form = null @ second @ null.T
    return 0.5 * (form + form.T), null


def stands_upright(event: OrbitEvent) -> bool:
    """Whether two branches cross at an event, one of them with the parameter at rest.

    Orbits that shrink to a rest there are never near to it in their own sizes: the parameter tells.
    """
    point = event.point
    units = point.evaluation.problem.natural_units(point.unknowns)
    crossing = Crossing(point.evaluation.problem)
    if leads_away(crossing, point.evaluation, units):
        return False
    solution = solve(crossing, point.evaluation)
    if solution is None:
        return False
    away = np.abs(solution.unknowns - point.unknowns)
    if np.max(away / units) > BESIDE and away[-1] > event.error + solution.error:
        return False
    if not branches_cross(unfolding_of(solution)):
        return False
    form, null = form_at(solution, units)
    upright = null @ np.eye(len(point.unknowns))[-1]  # a direction at right angles to this is
    size = float(np.linalg.norm(upright))
    if size == 0.0:
        return True
    sideways = np.array([-upright[1], upright[0]]) / size
    return abs(float(sideways @ form @ sideways)) <= UPRIGHT * float(np.max(np.abs(form)))


def leads_away(crossing: Crossing, here: Linearisation, units: Array) -> bool:
    """Whether a step of Newton's iteration for a crossing leaves the surroundings of an orbit, in
    the parameter, too: no crossing is beside it."""
    try:
        at = crossing.assemble(here, crossing.start(here))
        step = np.linalg.solve(at.jacobian, at.residual)
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        return False
    away = np.abs(step[: len(units)] / units)
    return bool(np.max(away) > AWAY * BESIDE and away[-1] > BESIDE)


# A function of the unknowns with a known gradient reaches zero: V, T and UZ share this.


class ScalarTest(OrbitTest):
    """A function of the unknowns with a known gradient: F = 0 and this function = 0."""

    @abstractmethod
    def gradient(self, problem: OrbitProblem, z: Array, index: int) -> Array:
        """Return the gradient of one of the values, shape (n + 1,)."""

    def form(self, problem: OrbitProblem, index: int) -> ScalarForm | None:
        """Return what tells the equations of a value from others, where they are scalar code."""
        return None

    def locate_on(self, arc: Between, fraction: float, index: int) -> OrbitEvent | None:
        problem = arc.left.evaluation.problem
        form = self.form(problem, index)
        if form is None:
            return None
        details = {"index": index, **self.described(problem, index)}
        return event_on(self.kind, form, arc, fraction, lambda _: details)

    def locate(
        self, problem: Problem[Linearisation], guess: OrbitPoint, index: int
    ) -> Location | None:
        system = ReachedTest(guess.evaluation.problem, self, index)
        return located(system, guess, lambda solution: self.described(system.problem, index))

    def details(self, point: OrbitPoint, index: int) -> Details:
        problem = point.evaluation.problem
        return {"index": index, **self.described(problem, index)}

    def described(self, problem: OrbitProblem, index: int) -> Details:
        """What to record of a zero."""
        return {}

    def noise_of(self, problem: OrbitProblem, z: Array, index: int) -> float:
        """Return a bound of the function's rounding error; zero where it is an unknown itself."""
        return 0.0


class ReachedTest(ExtendedSystem):
    """One of a test's functions vanishes."""

    def __init__(self, problem: OrbitProblem, test: ScalarTest, index: int) -> None:
        super().__init__(problem)
        self.test, self.index = test, index

    def start(self, here: Linearisation) -> Array:
        return np.zeros(0)

    def assemble(self, here: Linearisation, own: Array) -> SystemEvaluation:
        value = self.test.of(OneOrbit(here))[0, self.index]
        gradient = self.test.gradient(self.problem, here.unknowns, self.index)
        return SystemEvaluation(
            np.append(here.residual, value), np.vstack([here.jacobian, gradient])
        )

    def rounding(self, here: Linearisation, own: Array) -> Array:
        noise = self.test.noise_of(self.problem, here.unknowns, self.index)
        return np.append(rounding(here).residual, noise)


# An orbit touches a wall inside a flight: G, and a merged touch of sliding.


class Arrival(ExtendedSystem):
    """A flight leaves with one of the orbit's and arrives at a guard; of the unknowns there those
    numbered in `free` are the system's own."""

    def __init__(
        self, problem: OrbitProblem, flight: int, segment: Segment, free: Sequence[int]
    ) -> None:
        super().__init__(problem)
        self.flight, self.segment, self.free = flight, segment, list(free)
        self.left = slice(problem.m * flight, problem.m * flight + problem.m)

    @abstractmethod
    def ends(self, here: Linearisation, own: Array) -> tuple[list[float], list[float]]:
        """Return the unknowns at both ends of the flight."""

    def assemble(self, here: Linearisation, own: Array) -> SystemEvaluation:
        n, m = self.problem.n, self.problem.m
        orbit = len(here.unknowns)
        arrival, start, end, by_parameter = self.arrival(here, own)
        self.problem.kernel_evaluations += 1
        jacobian = np.zeros((n + m, orbit + m - 1))
        jacobian[:n, :orbit] = here.jacobian
        jacobian[n:, self.left] = start
        jacobian[n:, n:orbit] = by_parameter
        jacobian[n:, orbit:] = end[:, self.free]
        return SystemEvaluation(np.concatenate([here.residual, arrival]), jacobian)

    def rounding(self, here: Linearisation, own: Array) -> Array:
        values = self.problem.values(here.unknowns)
        arrival, _, _, _ = bounds_of(self.segment, *self.ends(here, own), values)[1]
        return np.concatenate([rounding(here).residual, arrival])

    def sizes(self, jacobian: Array, sizes: Array) -> Array:
        found, n, m = super().sizes(jacobian, sizes), self.problem.n, self.problem.m
        least = found[:n].reshape(-1, m).min(axis=0)  # where the flight vanishes, so do its blocks
        found[n:] = np.maximum(found[n:], least)
        return found

    def arrival(self, here: Linearisation, own: Array) -> tuple[Array, Array, Array, Array]:
        """Return residual and derivatives of the flight."""
        m, values = self.problem.m, self.problem.values(here.unknowns)
        rows, leaving, *ends = self.segment.blocks(*self.ends(here, own), values)
        start, end, free = map(np.array, (self.problem.leaves(leaving), *ends))
        return np.array(rows), start.reshape(m, m), end.reshape(m, m), free.reshape(m, -1)


def touch_form(problem: OrbitProblem, flight: int, wall: str) -> ScalarForm | None:
    """Return what tells a touch from others; None for an orbit without impacts."""
    if not problem.word.walls:
        return None
    walls = problem.model.letters
    touch = len(walls) * walls.index(problem.word.walls[flight]) + walls.index(wall)
    return ScalarForm("touching", flight, touch)


class TouchingFlight(Arrival):
    """A flight reaches a wall with zero velocity."""

    def __init__(self, problem: OrbitProblem, flight: int, wall: str, time: float) -> None:
        left = problem.word.walls[flight : flight + 1] or SECTION
        segment = problem.kernels.segment(left, wall)
        super().__init__(problem, flight, segment, [0, *range(2, problem.m)])
        self.wall, self.time = wall, time
        self.form = touch_form(problem, flight, wall)

    def touch(self, own: Array) -> Array:
        """Return the touch as an impact: its time and section coordinates."""
        touch = np.zeros(self.problem.m)
        touch[self.free] = own
        return touch

    def start(self, here: Linearisation) -> Array:
        own = np.zeros(len(self.free))
        own[0] = self.time
        if len(own) > 1:  # the other coordinates, from the (near) linear flight equations
            out, _, end, _ = self.arrival(here, own)
            own[1:] -= np.linalg.lstsq(end[:, self.free[1:]], out, rcond=None)[0]
        return own

    def scale(self, own: Array, sizes: Array) -> Array:
        others = super().scale(own, sizes)
        others[0] = sizes[0]
        return others

    def own_sizes(self, own: Array, sizes: Array) -> Array:
        return np.append(sizes[0], np.abs(own[1:]))

    def details(self, own: Array) -> Details:
        return {"touch_time": float(own[0])}

    def ends(self, here: Linearisation, own: Array) -> tuple[list[float], list[float]]:
        _, left = self.problem.leaving(here.unknowns, self.flight)
        return left, self.touch(own).tolist()
