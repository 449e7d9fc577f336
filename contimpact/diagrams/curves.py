"""Curves of bifurcations in two parameters.

A curve is the solution set of an event's equations (`contimpact.bifurcations.extended_system`) with
two free parameters: the branch's own, lambda, and a second one, mu, along which the walk is
limited. Its unknowns are the orbit, lambda, what the system adds, and mu last.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..bifurcations.at_rest import difference_gradient, sizes_of
from ..bifurcations.codimension_two import leaving_tests
from ..bifurcations.declarations import REQUESTED
from ..bifurcations.extended_system import (
    EPSILON,
    UNIT_CIRCLE,
    ExtendedSystem,
    SystemEvaluation,
    leaves_no_trace,
)
from ..bifurcations.kind import Kind, Values
from ..continuation.branch import (
    End,
    EndKind,
    Event,
    Location,
    Point,
    Points,
    Problem,
    TestFunction,
    UserFunction,
    Walk,
    join_walks,
    missed_texts,
)
from ..continuation.corrector import Arc, correct, length
from ..continuation.events import snap_to_points
from ..continuation.settings import Settings
from ..continuation.walk import Policy, both_ways, keep_interrupted, walk
from ..errors import InputError, each_once, explain_arguments, short_repr
from ..models.guards import Word
from ..models.model import Model
from ..orbits.orbit import Orbit
from ..orbits.problem import Linearisation, OrbitProblem, rounding
from ..orbits.quiet import problem_of
from ..orbits.search import repeats
from ..progress import Asked, progress_callback
from ..results.branch import Entry, all_parameters, columns_of, model_of
from ..results.curve import Codim2, Curve
from ..results.diagram import entry_first, impacts_of, orbit_record, to_orbit
from ..results.options import CURVE_SETTINGS, check_range
from ..segments.kernels import Kernels
from .curve_problem import (
    CurvePoint,
    CurveProblem,
    backend_of,
    curve_problem,
    require_curve,
    slope_of,
)
from .shorter_orbits import (
    SAME_ORBIT,
    UNLOCATED,
    RepetitionTest,
    ShorterEnd,
    crossing,
    repetition_end,
)

# Points put between those of a curve, until splines through them are as near it as asked.

DEEPEST = 8
"""How often the way between two points is halved at most."""

UNIT = 1e-9
"""How far the length of a unit tangent is from one by rounding at most."""

MARGIN = 0.1
"""How much nearer the cubic with the tangents of two points is to be in the middle between them:
a spline, which is not told the tangents, departs more, at the ends and where steps change most."""


class _WalkRefinement:
    """Puts further points between those of a walk, so that the spline through all of them is
    `within` such a part of the free parameters' spans of the curve."""

    def __init__(
        self, problem: CurveProblem, spans: Sequence[float], settings: Settings, within: float
    ) -> None:
        self.problem, self.settings, self.within = problem, settings, MARGIN * within
        self.spans = np.array(spans)
        self.last = spans[-1]

    def refined(self, walk: Walk[CurvePoint]) -> Walk[CurvePoint]:
        """Return the walk with the points between its own."""
        return replace(walk, points=Points(list(self.along(walk.points))))

    def along(self, points: Sequence[Point[CurvePoint]]) -> Iterator[Point[CurvePoint]]:
        """The points with those between them."""
        scale = self.problem.scale(points[0].unknowns, self.last)
        yield points[0]
        for left, right in itertools.pairwise(points):
            if abs(length(left.tangent, scale) - 1.0) > UNIT:  # the walk's sizes have grown
                scale = np.maximum(scale, self.problem.scale(left.unknowns, self.last))
            between = self.between(Arc(self.problem, left, right, scale, self.settings))
            yield from _chord_spacing([left, *between, right], scale)
            yield right

    def between(self, arc: Arc, depth: int = 0) -> Iterator[Point[CurvePoint]]:
        """The points between both ends of an arc: its middle, if the cubic is not near it."""
        end = arc.left.arclength + _chord(arc.left, arc.right, arc.scale)
        arc = replace(arc, right=replace(arc.right, arclength=end))
        guess = arc.near(0.5)
        middle = arc.at(0.5) if guess is not None and depth < DEEPEST else None
        if guess is None or middle is None or self.apart(guess, middle) <= self.within:
            return
        left, right = arc.halves(middle)
        yield from self.between(left, depth + 1)
        yield middle
        yield from self.between(right, depth + 1)

    def apart(self, one: Point[CurvePoint], other: Point[CurvePoint]) -> float:
        """How far two points are apart in the plane of the parameters."""
        return float(np.max(np.abs(self.place(one) - self.place(other)) / self.spans))

    def place(self, point: Point[CurvePoint]) -> Array:
        orbit = point.evaluation.orbit
        return np.asarray(orbit.unknowns[-len(self.spans) :])


def _chord(one: Point[CurvePoint], other: Point[CurvePoint], scale: Array) -> float:
    return length(other.unknowns - one.unknowns, scale)


def _chord_spacing(
    points: Sequence[Point[CurvePoint]], scale: Array
) -> Iterator[Point[CurvePoint]]:
    """The inner ones of some points, arclength growing from the first to the last by chords."""
    chords = [_chord(*pair, scale) for pair in itertools.pairwise(points)]
    first, last = points[0].arclength, points[-1].arclength
    parts = np.cumsum(chords) / sum(chords)
    for point, part in zip(points[1:-1], parts, strict=False):
        yield replace(point, arclength=first + float(part) * (last - first))


Range = tuple[float, float]

ON_LIMIT = 1e-12
"""How far beyond what a parameter admits, and as part of it from a value, rounding may put a point
of a curve."""


@explain_arguments
def follow_curve(
    entry: Entry,
    model: Model | None = None,
    second: str = "",
    first_range: tuple[float, float] | None = None,
    second_range: tuple[float, float] | None = None,
    *,
    name: str = "c1",
    values: Sequence[float] = (),
    settings: Settings = CURVE_SETTINGS,
    kernels: Kernels | None = None,
    detect: bool = True,
    within: float | None = None,
    callback: Callable[[Point], bool | None] | None = None,
    progress: Asked = False,
) -> Curve:
    """Follow the curve of a bifurcation through a catalogue entry, in both directions.

    Parameters
    ----------
    entry : Entry
        Of a kind in `CURVES`, real or ghost, from a diagram just computed or loaded.
    model : Model, optional
        The system, where its name does not tell; parameter values are taken from the entry. It may
        also stand before the entry.
    second : str
        The second parameter.
    first_range, second_range : (low, high)
        Ranges of the entry's own parameter and of the second one.
    name : str
        The curve's name.
    values : sequence of float
        Values of the second parameter to hit exactly; rows marked UZ in the column ``event``.
    settings : Settings
    kernels : Kernels, optional
        Kernels with both parameters free, if some are at hand.
    detect : bool
        Whether to look for points of codimension two.
    within : float, optional
        How near, as part of both ranges, cubic splines through the points over the arclength keep
        to the curve: further points are put between where they would not.
    callback : callable, optional
        Called with every accepted point.
    progress : bool or callable
        As of `continue_orbit`.

    Returns
    -------
    Curve
        After an interruption from the keyboard on the way, what was followed until then; its ends
        say so.

    Raises
    ------
    InputError
        For a parameter the model does not have, or ranges that do not hold the entry.
    """
    if isinstance(model, str):  # the second parameter, and no model before it
        if second:
            first_range, second_range = second, first_range
        model, second = None, model
    entry, model = entry_first(entry, model)
    require_curve(entry)
    model = model_of(entry, model)
    first = entry.parameter
    kernels = kernels or Kernels(model, first, second)
    parameters = entry.parameters
    first_range = check_range(model, first, parameters[first], first_range)
    second_range = check_range(model, second, parameters[second], second_range)
    outside = [v for v in values if not second_range[0] <= v <= second_range[1]]
    if outside:
        raise InputError("values", f"{outside[0]!r} is outside {second_range}", "widen the range")
    problem, start = curve_problem(model, entry, kernels, first_range[1] - first_range[0])
    special = problem.kind.codimension_two(problem.orbit.word) if detect else []
    ranges, label = [first_range, second_range], entry.label.removeprefix("~")
    what = f"following {name}, {entry.label}"
    with progress_callback(progress, what, second, callback) as told:
        found = walk_curve(problem, start, ranges, special, values, settings, told)
    if isinstance(found, End):
        accepted = "give another entry of the curve"
        raise InputError("entry", f"no curve starts there: {found.message}", accepted)
    if within is not None:
        spans = [high - low for low, high in ranges]
        filling = _WalkRefinement(problem, spans, settings, within)
        backward, forward = map(filling.refined, found)
        found = backward, forward
    curve = curve_from_walks(name, problem, found, special, label, entry.notation, entry.id)
    return dataclasses.replace(curve, branch=entry.branch)


def walk_curve(
    problem: CurveProblem,
    start: Array,
    ranges: Sequence[Range],
    special: Sequence[TestFunction],
    values: Sequence[float],
    settings: Settings,
    callback: Callable[[Point], bool | None] | None,
) -> tuple[Walk, Walk] | End:
    """Return the walks backward and forward from a start, or why there is no first point.

    They are within the ranges of the free parameters, limited by the last, of which some values are
    hit exactly; points of the special test functions are marked.
    """
    *others, last = problem.orbit.kernels.parameters
    named = zip(others, ranges, strict=False)
    inside = [ParameterValues(f"limit of {name}", name, limits) for name, limits in named]
    noise = ON_LIMIT * max(map(abs, values), default=0.0)
    asked = ParameterValues(REQUESTED, last, each_once(values, "values"), noise)
    again = [RepetitionTest(problem.orbit)] if problem.orbit.word.repeated() else []
    watched = [*inside, *problem.kind.curve_limits().values(), *again]

    def go(direction: int, goal: Point | None = None) -> Walk:
        return walk(
            problem,
            start,
            direction,
            parameter=last,
            limits=ranges[-1],
            tests=[*watched, asked, *special],
            settings=settings,
            callback=callback,
            goal=goal,
            policies=[LeavingEnd(problem.kind, watched), *([ShorterEnd(special)] if again else [])],
            meeting=crossing if again or problem.kind.multiplier else None,
            backend=backend_of(problem),
        )

    forward = keep_interrupted(lambda: go(+1))
    start_lost = len(forward.points) == 1 and not _is_on_curve(problem.kind, forward.points[0])
    if not forward.points or (start_lost and forward.end.kind is EndKind.VANISHED):
        return forward.end
    return both_ways(forward, last, lambda goal: go(-1, goal))


SLOW = 1e-6
"""Orbits whose impacts are all faster than this part of the fastest have the multiplier they are
solved for."""


class LeavingEnd(Policy):
    """Ends a walk where a parameter leaves its range, or where the kind says so; watched are the
    limits of each parameter but the last, and those of `Kind.curve_limits`: where one of these
    changes its sign and its zero is not located, as where the equations are singular, the walk ends
    at the last point before; and so it does where its orbits lose the multiplier of the kind."""

    def __init__(self, kind: Kind, watched: Sequence[TestFunction]) -> None:
        self.kind = kind
        self.within: dict[EndKind, Point[CurvePoint]] = {}
        limits = (test for test in watched if isinstance(test, ParameterValues))
        self.ranges = {test.kind: test.parameter for test in limits}
        self.ends = {test.kind: end for end, test in kind.curve_limits().items()}

    def accepted(
        self, point: Point[CurvePoint], events: Sequence[Event]
    ) -> tuple[End, Point] | None:
        ends, ranges = self.ends, self.ranges
        first = point.evaluation.problem.orbit.kernels.parameter
        found = [(ends[e.kind], first, e.point) for e in events if e.kind in ends]
        found += [(EndKind.RANGE, ranges[e.kind], e.point) for e in events if e.kind in ranges]
        if reached := self.kind.curve_end(point.evaluation.own):
            found.append((reached, first, point))
        lost: list[tuple[End, Point]] = []
        for test in self.kind.curve_limits().values():
            end = self.ends[test.kind]
            if np.all(test.values(point) >= 0.0):
                self.within[end] = point
            elif end in self.within:
                last = self.within[end]
                told = End.of(end, first, last.evaluation.parameter(first))
                lost.append((replace(told, message=f"{told.message}{UNLOCATED}"), last))
        if _is_on_curve(self.kind, point):
            self.within[EndKind.VANISHED] = point
        elif EndKind.VANISHED in self.within:
            found.append((EndKind.VANISHED, first, self.within[EndKind.VANISHED]))
        elif leaves_no_trace(point.evaluation.orbit):
            found.append((EndKind.VANISHED, first, point))
        for end, parameter, at in found:
            return End.of(end, parameter, at.evaluation.parameter(parameter)), at
        if lost:
            return lost[0]
        return next(
            ((repetition_end(e.point), e.point) for e in events if e.kind == RepetitionTest.kind),
            None,
        )


def _is_on_curve(kind: Kind, point: Point[CurvePoint]) -> bool:
    """Whether an orbit has the multiplier of the kind: where an impact is at rest, the equations
    are solved without it, too."""
    here = point.evaluation.orbit
    speeds = np.abs(here.problem.impacts(here.unknowns)[:, 1])
    slow = bool(np.any(speeds < SLOW * np.max(speeds, initial=0.0)))
    return not slow or kind.is_on_circle(here)


class ParameterValues(TestFunction):
    """A free parameter takes values that were asked for, or leaves its range at them."""

    def __init__(
        self, kind: str, parameter: str, wanted: Sequence[float], noise: float = 0.0
    ) -> None:
        self.kind, self.parameter, self.noise = kind, parameter, noise
        self.wanted = np.array(wanted, dtype=float)

    def values(self, point: Point) -> Array:
        return np.asarray(point.evaluation.parameter(self.parameter) - self.wanted)

    def locate(
        self, problem: Problem[CurvePoint], guess: Point[CurvePoint], index: int
    ) -> Location | None:
        """The point of a curve where the parameter has the value, to the last digit."""
        orbit = guess.evaluation.problem.orbit
        *others, last = orbit.kernels.parameters
        place = -1 if self.parameter == last else orbit.n + others.index(self.parameter)
        at, fixed = guess.unknowns.copy(), np.zeros(len(guess.unknowns))
        at[place], fixed[place] = self.wanted[index], 1.0
        here = correct(problem, at, fixed, np.ones(len(at)), CURVE_SETTINGS).evaluation
        if here is None:
            return None
        unknowns = here.unknowns.copy()
        unknowns[place] = self.wanted[index]
        return Location(unknowns, float(np.max(np.abs(here.residual))), 0.0)


# Tabulating.


def curve_from_walks(
    name: str,
    problem: CurveProblem,
    walks: tuple[Walk, Walk],
    special: Sequence[TestFunction],
    label: str,
    notation: str,
    origin: str,
) -> Curve:
    """Return two walks from one start, backward and forward, as a curve, with the points of the
    special test functions marked; label, notation and origin are those of what it was started
    from."""
    parameters, word = problem.orbit.kernels.parameters, problem.orbit.word
    last = parameters[-1]
    points, events = join_walks(*walks)
    events = snap_to_points(points, events)
    kinds = {test.kind for test in special}
    marked = [e for e in events if e.kind in kinds and not _is_shorter_end(e, walks)]
    codim2 = [_codim2(e, f"{name}.{i}", name) for i, e in enumerate(marked, start=1)]
    marks = [(e.point, e.kind) for e in events if e.kind == REQUESTED]
    marks += [(e.point, p.id) for e, p in zip(marked, codim2, strict=True)]
    missed = missed_texts(last, (m for walk in walks for m in walk.missed))
    ends, columns = (walks[0].end, walks[1].end), _columns(points, marks)
    model = problem.orbit.model
    columns |= {name: clip_rounding(model, name, columns[name]) for name in parameters}
    about = name, problem.kind.name, label, word.walls, word.period, notation, parameters
    evaluations = problem.orbit.kernel_evaluations
    return Curve(*about, columns, ends, codim2, origin, missed, evaluations=evaluations)


def _is_shorter_end(event: Event[CurvePoint], walks: Iterable[Walk]) -> bool:
    """Whether an event is not told from the end at an orbit that repeats a shorter one, where the
    equations of others are singular: the curve of the shorter orbit has that point."""
    ends = [walk.points[-1] for walk in walks if walk.end.kind is EndKind.SHORTER]
    orbit, value = event.point.evaluation.orbit, event.parameter
    return bool(ends) and (
        repeats(orbit.problem, orbit.unknowns, SAME_ORBIT)
        or any(abs(value - end.parameter) <= event.error for end in ends)
    )


def clip_rounding(model: Model, name: str, values: ArrayLike) -> Array:
    """Return values of a parameter, those that are beyond a limit by rounding put on it."""
    declared = model.declared[name]
    near = np.clip(values, declared.lower, declared.upper)
    return np.where(np.abs(near - values) <= ON_LIMIT, near, values)[()]


def _codim2(event: Event, identity: str, curve: str) -> Codim2:
    orbit = event.point.evaluation.orbit
    changes, impacts = event.details.get("changes", ""), impacts_of(orbit.problem, orbit.unknowns)
    values = all_parameters(orbit)
    for name in orbit.problem.kernels.parameters:
        values[name] = float(clip_rounding(orbit.problem.model, name, values[name]))
    place = str(changes), values, impacts
    found = Codim2(identity, curve, event.kind, *place, event.residual, event.error)
    return replace(found, **orbit_record(orbit))


def _columns(points: Sequence[Point], marks: Sequence[tuple[Point, str]]) -> dict[str, Array]:
    named = [*((p, "") for p in points), *marks]
    named = list({(p.arclength, mark): (p, mark) for p, mark in named}.values())
    named.sort(key=lambda pair: pair[0].arclength)
    sides = [1.0, -1.0]
    rows = [_row(point, sides) | {"event": mark} for point, mark in named]
    for before, row, after in zip(rows, rows[1:], rows[2:], strict=False):
        # what an orbit violates on one side of a marked point vanishes there but for rounding
        if row["event"] not in ("", REQUESTED) and before["physical"] != after["physical"]:
            row |= {"physical": 1, "reason": ""}
        if np.isnan(row.get("multiplier1_re", 0.0)):
            row["n_unstable"] = before["n_unstable"]
    columns = {}
    for name, first in rows[0].items():
        kind = {str: object, int: np.int64}.get(type(first), float)
        columns[name] = np.array([row[name] for row in rows], dtype=kind)
    return columns


def _row(point: Point[CurvePoint], sides: list[float]) -> dict[str, float | str]:
    here = point.evaluation
    orbit, kind, details = here.orbit, here.problem.kind, here.details
    row: dict[str, float | str] = {"arclength": point.arclength, **all_parameters(orbit)}
    names = columns_of(orbit.problem.word.walls, orbit.problem.m)
    row |= dict(zip(names, orbit.unknowns.tolist(), strict=False))
    multipliers, n_unstable = kind.multipliers(orbit, details)
    if kind.multiplier is not None and orbit.resting:
        away = np.abs(multipliers - kind.multiplier)
        if not np.any(away < UNIT_CIRCLE):  # C(mu) is singular for every mu: none is a multiplier
            multipliers = np.full(len(multipliers), complex(math.nan, math.nan))
    for k, mu in enumerate(multipliers.tolist(), start=1):
        row |= {f"multiplier{k}_re": mu.real, f"multiplier{k}_im": mu.imag}
    verdict = kind.verdict_on_branch(orbit, details, sides=sides)
    return row | {
        "n_unstable": n_unstable,
        "physical": int(verdict.physical),
        "reason": verdict.reason or "",
        "residual": float(np.max(np.abs(here.residual))),
    }


# Isolines of quantities of orbits in two parameters, and sensitivities of events.

Function = Callable[[Orbit], float]


@explain_arguments
def follow_isoline(
    orbit: Orbit | Entry,
    function: Function,
    model: Model | None = None,
    *,
    second: str,
    ranges: Sequence[Range],
    value: float | None = None,
    label: str = "isoline",
    name: str = "c1",
    values: Sequence[float] = (),
    settings: Settings = CURVE_SETTINGS,
    callback: Callable[[Point], bool | None] | None = None,
) -> Curve | End:
    """Follow the orbits on which a function keeps its value, in two parameters.

    Parameters
    ----------
    orbit : Orbit or Entry
        Where the curve starts, nearly if `value` is given.
    function : callable ``function(orbit) -> float``
        Smooth where the curve goes; its derivatives are differenced.
    model : Model, optional
        The system of an entry, where its name does not tell.
    second : str
        The second parameter; the first is the one with which the orbit was found.
    ranges : sequence of (low, high)
        Of both parameters; the curve ends where it leaves one.
    value : float, optional
        The value to keep; by default the one at the orbit.
    label : str
        What the curve is called, such as ``"20 V"``.
    name : str
    values : sequence of float
        Values of the second parameter to hit exactly.
    settings : Settings
    callback : callable, optional
        Called with every accepted point.

    Returns
    -------
    Curve or End
        Where its orbits also graze, or an impact of theirs loses its velocity, is in `points`. The
        end of a curve that has no point, where the value is not reached next to the orbit.

    Raises
    ------
    InputError
        For a parameter the model does not have, ranges that do not hold the orbit, or a function
        that does not return a number there.
    """
    given = to_orbit(orbit, model)
    at, first = given.model, given.problem.parameter
    if len(ranges) != 2:
        raise InputError("ranges", f"found {len(ranges)}", "give one for each of two parameters")
    names = (first, second)
    kernels = Kernels(at, *names)
    limits = [check_range(at, n, at.values[n], r) for n, r in zip(names, ranges, strict=True)]
    problem = problem_of(at, given.word, kernels)
    start = np.concatenate([given.unknowns[: problem.n], [at.values[n] for n in names]])
    kept = _number(function(given)) if value is None else float(value)
    system = Level(problem, function, kept)
    curve = CurveProblem(Isoline(system), system, {}, [limits[0][1] - limits[0][0]])
    special = curve.kind.codimension_two(given.word)
    found = walk_curve(curve, start, limits, special, values, settings, callback)
    if isinstance(found, End):
        return found
    notation = given.word.notation(at.letters)
    return curve_from_walks(name, curve, found, special, label, notation, "")


class Level(ExtendedSystem):
    """A function of the orbit has a value."""

    def __init__(self, problem: OrbitProblem, function: Function, value: float) -> None:
        super().__init__(problem)
        self.function, self.value = function, value

    def start(self, here: Linearisation) -> Array:
        return np.zeros(0)

    def assemble(self, here: Linearisation, own: Array) -> SystemEvaluation:
        x = here.unknowns
        row = difference_gradient(lambda z: self.away(self.problem.evaluate(z)), x, sizes_of(here))
        residual = np.append(here.residual, self.away(here))
        return SystemEvaluation(residual, np.vstack([here.jacobian, row]))

    def rounding(self, here: Linearisation, own: Array) -> Array:
        size = max(abs(self.value), abs(self._of(here)))
        return np.append(rounding(here).residual, EPSILON * (1.0 + len(here.unknowns) * size))

    def away(self, here: Linearisation) -> float:
        """Return how far the function is from its value on an orbit."""
        return self._of(here) - self.value

    def _of(self, here: Linearisation) -> float:
        return _number(self.function(Orbit(self.problem, here)))


class Isoline(Kind):
    """A value of a function; nothing changes there."""

    name = "isoline"

    def __init__(self, level: Level) -> None:
        self.level = level

    def test(self, problem: OrbitProblem, values: Values) -> TestFunction:
        return UserFunction(self.name, lambda point: self.level.away(point.evaluation))

    def codimension_two(self, word: Word) -> list[TestFunction]:
        return [*leaving_tests(self.name)]


def _number(found: object) -> float:
    try:
        value = np.asarray(found, dtype=float)
    except (TypeError, ValueError):
        value = np.array([np.nan])
    if value.size != 1 or not np.isfinite(value).all():
        raise InputError("function", f"it returned {short_repr(found)}", "return one finite number")
    return float(value.reshape(()))


# How the place of a bifurcation moves with a second parameter, to first order.


@explain_arguments
def sensitivity(entry: Entry, parameter: str, model: Model | None = None) -> float:
    """Return the derivative of an event's parameter value with respect to another parameter.

    It is the slope of the bifurcation's curve in the two parameters, see `follow_curve`, at the
    entry.

    Parameters
    ----------
    entry : Entry
        Of a kind that has curves, real or ghost.
    parameter : str
        Any other parameter of the model.
    model : Model, optional
        The system, where its name does not tell; parameter values are taken from the entry.

    Returns
    -------
    float
        In units of the entry's own parameter by those of the other one.

    Raises
    ------
    InputError
        For an entry without a curve, a parameter that the model does not have, or a curve that
        turns here.
    """
    if isinstance(entry, Orbit):
        raise InputError("entry", "found an orbit", "give an entry; an orbit has .sensitivity()")
    require_curve(entry)
    at = model_of(entry, model)
    at.require(parameter, "parameter")
    if parameter == entry.parameter:
        raise InputError("parameter", f"{parameter} is the entry's own", "give another one")
    problem, start = curve_problem(at, entry, Kernels(at, entry.parameter, parameter), 1.0)
    try:
        return slope_of(problem, start)
    except np.linalg.LinAlgError:
        found = f"the curve of {entry.label} turns here"
        raise InputError("entry", found, "follow the curve with follow_curve") from None
