"""Where the orbits of a curve become shorter ones, run several times: there the curve ends."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..arrays import Array
from ..bifurcations.at_rest import points_at_rest
from ..bifurcations.codimension_two import repeat_orbit
from ..bifurcations.extended_system import CONVERGED, solve
from ..bifurcations.kind import kind_of
from ..continuation.branch import (
    End,
    EndKind,
    Event,
    Location,
    MissedEvent,
    Point,
    Points,
    Problem,
    TestFunction,
    Walk,
)
from ..continuation.corrector import inner_product, length
from ..continuation.crossing_branches import Meeting
from ..continuation.walk import Policy
from ..errors import InputError
from ..models.guards import Word
from ..orbits.problem import Linearisation, OrbitProblem
from ..orbits.quiet import problem_of
from ..orbits.search import reduce_period, repeats
from .curve_problem import CurvePoint, CurveProblem, double_of

# Beyond, the same orbits come again, whole periods later. So ends the fold of a doubled orbit at a
# GPD, where the doubling changes its direction. Its grazing ends at a PD-G, and the zero velocity
# of one of its impacts at a PD-V: beyond, the other half of the orbit passes the guard. Two
# solutions of the curve's equations cross there, so that the end is solved for on the orbit that is
# run twice.

SAME_ORBIT = 1e-6
"""How near an orbit is to a shorter one where it is one."""

NEAR = 0.1
"""How far from a point the end of its curve is looked for, in the curve's metric."""

ROUNDING = 1e-14

AT_REST = "PD-V"
"""The point at which curves of orbits of any number of laps may end, as C(mu) is singular for every
mu: at the others a multiplier is -1, and doubled orbits alone begin."""

OWN_ITERATIONS = 6
"""Newton's steps from the guess of what an event adds to its orbit, that orbit being exact."""


class RepetitionTest(TestFunction[CurvePoint]):
    """The orbit becomes a shorter one: impacts that are to be the same have the same section
    coordinates, by natural sizes: at touches all velocities are rounding."""

    kind = "shorter"
    noise = rounding = 1e-9  # on a curve of shorter orbits it is zero everywhere

    def __init__(self, problem: OrbitProblem) -> None:
        self.impacts = len(problem.word.repeated()[-1])

    def values(self, point: Point[CurvePoint]) -> Array:
        orbit, problem = point.evaluation.orbit, point.evaluation.orbit.problem
        rows = problem.impacts(orbit.unknowns)[:, 1:]
        sizes = orbit.sizes[1][: problem.n].reshape(-1, problem.m)[:, 1:].max(axis=0)
        apart = (rows - np.roll(rows, self.impacts, axis=0))[: self.impacts]
        return np.asarray(apart / sizes).ravel()

    def locate(
        self, problem: Problem[CurvePoint], guess: Point[CurvePoint], index: int
    ) -> Location | None:
        return solve_repetition(guess.evaluation)

    def accept(self, event: Event[CurvePoint]) -> bool:
        orbit = event.point.evaluation.orbit
        return repeats(orbit.problem, orbit.unknowns, SAME_ORBIT)


def repetition_end(point: Point[CurvePoint]) -> End:
    """Return the end of a curve at an orbit that repeats a shorter one."""
    orbit = point.evaluation.orbit
    return _end_at(point, reduce_period(orbit.problem, orbit.unknowns, SAME_ORBIT)[0].word)


def _end_at(point: Point[CurvePoint], word: Word) -> End:
    problem = point.evaluation.orbit.problem
    first, times = problem.kernels.parameter, len(problem.word) // len(word)
    told = {"word": word.notation(problem.model.letters), "times": times}
    return End.of(EndKind.SHORTER, first, point.evaluation.parameter(first), **told)


def crossing(problem: Problem[CurvePoint], guess: Point, scale: Array) -> Meeting | None:
    """Return where another curve crosses next to a point: that of the orbit run twice, or that of
    all orbits with an impact at rest that leaves no trace."""
    here = guess.evaluation
    resting = points_at_rest(here.problem, here)
    for found in itertools.chain([solve_repetition(here)], resting):
        if found is not None and length(found.unknowns - guess.unknowns, scale) <= NEAR:
            return Meeting(found.unknowns, 0.0, ROUNDING, (1.0, 1.0), 1.0)
    return None


def solve_repetition(here: CurvePoint) -> Location | None:
    """Solve for the point nearest to one of a curve, for all that their errors tell, where its
    orbit is a shorter one, run several times: one of codimension two on the curve of PD of that
    orbit. None if there is none."""
    problem, kind, found = here.orbit.problem, here.problem.kind, []
    if not problem.word.walls:
        return None
    scale = here.problem.scale(here.unknowns, abs(here.unknowns[-1]))
    for word in problem.word.repeated():
        short = problem_of(problem.model, word, problem.kernels)
        mean, away = _mean_part(here.orbit, short)
        if length(away, scale[: problem.n]) <= NEAR:
            at = short.evaluate(mean)
            names = [
                n for n in kind.shorter_at if n == AT_REST or 2 * len(word) == len(problem.word)
            ]
            found += [_repetition_at(here, at, name) for name in names]
            problem.kernel_evaluations += short.kernel_evaluations
    return min(
        (location for location in found if location is not None),
        key=lambda one: length(one.unknowns - here.unknowns, scale) + one.error / scale[-1],
        default=None,
    )


def _repetition_at(here: CurvePoint, mean: Linearisation, name: str) -> Location | None:
    """The point of the curve where its orbit is one run several times that is next to `mean` and is
    of codimension two, of that name, on the curve of its PD."""
    curve = here.problem
    try:
        system = double_of(mean, name, kind_of("PD"), {}).system
    except InputError:  # the mean has no such point near: it touches nothing
        return None
    solution = solve(system, mean)
    if solution is None:
        return None
    times = len(here.orbit.problem.word) // len(mean.problem.word)
    orbit = repeat_orbit(mean.problem.evaluate(solution.unknowns), times)
    own = curve.system.start(orbit)
    own *= np.sign(own @ here.own) or 1.0
    at = curve.system.assemble(orbit, own)  # the time of a touch is a guess as yet
    for _ in range(OWN_ITERATIONS):
        by_own = at.jacobian[:, len(orbit.unknowns) :]
        asked = at.residual + by_own @ (here.own - own)  # of several solutions the nearest
        own = here.own - np.linalg.lstsq(by_own, asked, rcond=SAME_ORBIT)[0]
        at = curve.system.assemble(orbit, own)
    units = curve.system.sizes_at(at, orbit, own)
    if not np.all(np.abs(at.residual) < CONVERGED * units):  # the orbit has another multiplier
        return None
    return Location(curve.packed(orbit.unknowns, own), solution.residual, solution.error)


def _mean_part(here: Linearisation, short: OrbitProblem) -> tuple[Array, Array]:
    """The mean of the parts of an orbit that nearly repeats a shorter one, as one of its word, and
    how far each impact is from it: no repeated orbit is nearer."""
    parts, span = _parts(here, len(short.word))
    mean = parts.mean(axis=0)
    return short.with_impacts(mean, span, here.unknowns), (parts - mean).ravel()


def _parts(here: Linearisation, count: int) -> tuple[Array, float]:
    """The parts of an orbit of so many impacts each, on one clock, and how long each lasts."""
    rows = here.problem.impacts(here.unknowns)
    times = len(rows) // count
    span = here.problem.span(here.unknowns) / times
    parts = rows.reshape(times, count, -1).copy()
    parts[:, :, 0] -= span * np.arange(times)[:, None]
    return parts, span


def _passed_word(before: Point[CurvePoint], after: Point[CurvePoint]) -> Word | None:
    """The word of the shorter orbit that a curve passes between two points: its parts, at all
    impacts at once, change places; without impacts there are none to tell."""
    orbits = [point.evaluation.orbit for point in (before, after)]
    size = orbits[0].sizes[1][: orbits[0].problem.n]
    for word in sorted(filter(len, orbits[0].problem.word.repeated()), key=len):
        parts = (_parts(orbit, len(word))[0] for orbit in orbits)
        first, last = ((part - part.mean(axis=0)).ravel() / size for part in parts)
        change = last - first
        way = np.clip(-(first @ change) / ((change @ change) or 1.0), 0.0, 1.0)
        ends = min(np.linalg.norm(first), np.linalg.norm(last))
        longer = ends > RepetitionTest.noise  # on a curve of shorter orbits all is rounding
        if longer and np.linalg.norm(first + way * change) < THROUGH * ends:
            return word
    return None


class ShorterEnd(Policy):
    """Ends a walk from which no step leads on at the orbit run twice that is next to its last one:
    there curves cross, and steps over the crossing may fail. What is missed so near to it of tests
    that vanish there is that zero. A walk that passes such an orbit, which is not located, ends
    before it: the orbits beyond are known."""

    def __init__(self, tests: Sequence[TestFunction]) -> None:
        self.tests = tests
        self.before: Point[CurvePoint] | None = None

    def accepted(
        self, point: Point[CurvePoint], events: Sequence[Event]
    ) -> tuple[End, Point] | None:
        before, self.before = self.before, point
        word = None if before is None else _passed_word(before, point)
        if before is None or word is None:
            return None
        end = _end_at(before, word)
        return replace(end, message=f"{end.message}{UNLOCATED}"), before

    def ended(self, walk: Walk) -> Walk:
        last = walk.points[-1]
        found = solve_repetition(last.evaluation) if walk.end.kind is EndKind.STEP else None
        if found is None:
            return walk
        problem = last.evaluation.problem
        away = found.unknowns - last.unknowns
        scale = problem.scale(found.unknowns, abs(found.unknowns[-1]))
        distance = length(away, scale)
        if not _cosine(problem, away, last.tangent, scale) > AHEAD or distance > BESIDE_SHORTER:
            return walk
        here = problem.evaluate(found.unknowns)
        reached = replace(last, evaluation=here, arclength=last.arclength + distance, iterations=0)
        assert isinstance(walk.points, Points)
        places = np.array([point.arclength for point in walk.points])
        first = max(int(np.searchsorted(places, reached.arclength - BESIDE_SHORTER)) - 1, 0)
        beside = [*walk.points[first:], reached]
        walk.points.extend(reached, 0, 1)
        missed = [one for one in walk.missed if not self._is_end(one, beside)]
        return replace(walk, end=repetition_end(reached), missed=missed)

    def _is_end(self, missed: MissedEvent, beside: Sequence[Point]) -> bool:
        """Whether what is missed lies between points, and its test vanishes at the last one."""
        values = [point.parameter for point in beside]
        if not all(min(values) <= value <= max(values) for value in missed.parameters):
            return False
        tests = [test for test in self.tests if test.kind == missed.kind]
        first, last = (np.concatenate([t.at(beside[k]) for t in tests]) for k in (0, -1))
        return bool(np.any(np.abs(last) < VANISHED * np.abs(first)))


def _cosine(problem: CurveProblem, one: Array, other: Array, scale: Array) -> float:
    """The cosine of the angle of two directions of a curve, as ones of its orbit: what the event
    adds is not unique where that is a shorter one, and so tells no direction."""
    a, b, sizes = (problem.unpacked(row)[0] for row in (one, other, scale))
    return inner_product(a, b, sizes) / (length(a, sizes) * length(b, sizes))


UNLOCATED = ", or up to a step beyond: that place is not located"
"""What is said of an end where a limit is passed, and not located."""

THROUGH = 0.1
"""How much nearer to a shorter orbit the way between two points is than they are, if it passes."""

VANISHED = 1e-2
"""Part of its value beside an end below which a test function vanishes there."""

BESIDE_SHORTER, AHEAD = 1e-2, 0.9
"""Distance to the orbit run twice at which a curve ends there, if no step leads on, and cosine of
the angle at which it is ahead. Beside a GPD what tells the curve of folds from that of the doubling
falls with the fourth power of the distance, to rounding at 1e-3."""
