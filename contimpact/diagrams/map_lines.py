"""Lines across a map: runs along them, near misses, and how well curves cover it.

Curves say nothing of those they do not pass. A run along a line meets whatever crosses it, so
lines are laid: the sides of the rectangle first and then ever denser, until as many as asked for in
a row have met nothing new; then between neighbours on which different numbers of branches have
physical orbits, for there a word appears or vanishes; then from where something comes near to zero
on a line and turns back, for beside it may be a closed curve that no line crosses. A curve is
started from every entry that lies on none.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from ..arrays import Array
from ..bifurcations.extended_system import solve
from ..bifurcations.kind import Start, kind_of, primitive_start, switch, test_functions
from ..continuation.branch import End, EndKind, Event, Points, TestFunction
from ..continuation.corrector import correct, first_tangent
from ..continuation.settings import Settings
from ..continuation.walk import reraise_interruption
from ..models.guards import Word, is_rotation
from ..models.model import Model
from ..orbits.orbit import Orbit
from ..orbits.problem import Linearisation, OrbitProblem, Summary
from ..orbits.quiet import problem_of
from ..orbits.search import (
    find_orbits,
    reduce_period,
    repeats,
    rotate_to_word,
    search_for,
    solve_near,
)
from ..orbits.status import PASSES, PHYSICAL, WRONG_WAY
from ..progress import Progress
from ..results.branch import Branch, Entry, columns_of, details_of, orbit_of
from ..results.curve import BIRTHS, NOT_SOLVED, Coverage, Curve
from ..results.scene import Scene
from ..segments.kernels import Kernels
from .curve_problem import equations_of
from .orbit_walks import Run, first_step, run_born, symmetric_end, walk_both_ways

# One-parameter runs across a map of curves: what the curves are started from and checked against.
#
# A run is at one value of the second parameter, for one member of the family: orbits of every word
# of the scene are looked for at several values of the first parameter, and their branches followed.

SAME_CURVE = 1e-8
NEAR_CURVE = 1e-3
SAME_END = 1e-6
BENT = 0.25
"""How far a curve is from the straight way between two of its points at most, as part of that."""

Range = tuple[float, float]


def run_along(
    scene: Scene,
    model: Model,
    word: Word,
    kernels: Kernels,
    limits: tuple[float, float],
    searched: Sequence[float],
    tests: list[TestFunction] | None = None,
    wanted: Callable[[Orbit], bool] = lambda orbit: True,
) -> list[Run]:
    """Follow every wanted orbit of a word that is found at the values `searched` of a parameter.

    The parameter is free in the kernels and varies within `limits`; the model gives the values of
    the others. The tests are those of `tests_of` by default.
    """
    problem = problem_of(model, word, kernels)
    tests = tests_of(scene, problem) if tests is None else tests
    runs: list[Run] = []
    for value in searched:
        at = model.replace(**{kernels.parameter: value})
        found = find_orbits(
            at, word, kernels=kernels, rng=scene.seed, starts=scene.starts, rounds=scene.rounds
        )
        for orbit in found:
            if wanted(orbit) and not any(run.holds(orbit.unknowns) for run in runs):
                runs.append(walk_both_ways(problem, orbit.unknowns, limits, tests, scene.settings))
                reraise_interruption(runs[-1].ends)
    return runs


def run_through(scene: Scene, model: Model, entry: Entry, kernels: Kernels) -> Run:
    """Follow the branch of the first parameter through the orbit of an entry.

    From a step beside it: on the entry itself the walk could not tell which way it crosses.
    """
    orbit = orbit_of(entry, model, kernels)
    beside = _orbit_beside(orbit.problem, orbit.unknowns, scene, scene.range)
    return run_on_line(scene, orbit.problem, beside, scene.range)


def run_with(scene: Scene, model: Model, entry: Entry, kernels: Kernels) -> Run:
    """Follow the branch through the orbit of an entry, with that as its only event.

    For where the test function sees no crossing: all orbits of the branch may be on the curve.
    """
    orbit = orbit_of(entry, model, kernels)
    run = run_on_line(scene, orbit.problem, orbit.unknowns, scene.range)
    place = int(np.argmin(np.max(np.abs(run.points.unknowns - orbit.unknowns), axis=1)))
    told = entry.residual, entry.error, entry.method, details_of(entry)
    return dataclasses.replace(run, events=[Event(entry.kind, run.points[place], *told)])


def run_on_line(scene: Scene, problem: OrbitProblem, start: Array, limits: Range) -> Run:
    """Follow an orbit both ways, to where its branch becomes an image of itself."""
    about = tests_of(scene, problem), scene.settings
    run = walk_both_ways(problem, start, limits, *about, stop=symmetric_end(problem))
    reraise_interruption(run.ends)
    return run


def _orbit_beside(problem: OrbitProblem, unknowns: Array, scene: Scene, limits: Range) -> Array:
    """An orbit one step further on the branch through another one, if that step can be made."""
    _, tangent = _tangent_at(problem, unknowns, limits)
    if tangent is None:
        return unknowns
    start = Start(problem, unknowns, tangent, branching=False, both_ways=True)
    for direction in (+1, -1):
        walk = first_step(start, limits, scene.settings, direction, gaps=False)
        if len(walk.points) > 1 and limits[0] < walk.points[-1].parameter < limits[1]:
            return walk.points[-1].unknowns
    return unknowns


def _tangent_at(
    problem: OrbitProblem, unknowns: Array, limits: Range
) -> tuple[Array, Array | None]:
    """Natural sizes at an orbit, and the direction of its branch if there is one."""
    scale = problem.scale(unknowns, limits[1] - limits[0])
    return scale, first_tangent(problem, problem.evaluate(unknowns).jacobian, scale)


def tests_of(scene: Scene, problem: OrbitProblem) -> list[TestFunction]:
    """Return the test functions of a run: of the kinds with curves, then the scene's others."""
    assert scene.curves is not None
    others = [kind for kind in scene.events if kind not in scene.curves.kinds]
    return test_functions(problem, [*scene.curves.kinds, *others], {})


def orbit_at_start(branch: Branch, scene: Scene) -> Array | None:
    """Impacts of a physical orbit of the branch at the scene's start, nearly; None without one."""
    away = branch[branch.parameter] - scene.start
    passes = (away[:-1] * away[1:] <= 0.0) & branch.physical[:-1] & branch.physical[1:]
    if not np.any(passes):
        return None
    row = int(np.argmax(passes))
    span = away[row + 1] - away[row]
    part = -away[row] / span if span else 0.0
    impacts = np.stack([branch.times, branch.velocities], axis=2).reshape(len(branch), -1)
    return np.asarray(impacts[row] + part * (impacts[row + 1] - impacts[row]))


def first_bifurcation(entries: Sequence[Entry], kinds: Sequence[str], along: str) -> Entry | None:
    """Return the real bifurcation with the largest value of a column."""
    others = [kind for kind in kinds if kind not in BIRTHS] or kinds
    real = [e for e in entries if e.kind in others and not e.ghost]
    return max(real, key=lambda e: e.parameters[along], default=None)


def passes_entry(curve: Curve, entry: Entry, model: Model, kernels: Kernels) -> bool:
    """Whether a curve of the same member passes through an entry.

    Wherever the curve passes the entry's value of the second parameter, its orbit there is solved
    for, with the first parameter free, and compared.
    """
    if (curve.kind, curve.period) != (entry.kind, entry.period):
        return False
    if not is_rotation(curve.word, entry.word):
        return False
    here = orbit_of(entry, model, kernels)
    problem, compared = here.problem, _Compared(curve)
    first, second = curve.parameters
    if any(
        compared.same_bifurcation(problem, entry, guess, here.unknowns, size)
        for name in (second, first)
        for guess, size in compared.crossings(name, entry.parameters[name], problem)
    ):
        return True
    near = [
        (np.append(guess[:-1], entry.parameters[second]), size)
        for guess, size in compared.crossings(first, entry.parameters[first], problem)
        if compared.distance(problem, guess, here.unknowns) < NEAR_CURVE
    ]
    return bool(near) and _passes_across(compared, entry, model, near)


def _passes_across(
    compared: _Compared, entry: Entry, model: Model, near: Sequence[tuple[Array, float]]
) -> bool:
    """The same with the second parameter free: where the curve keeps its value, the first one is
    not told by the equations."""
    second = compared.curve.parameters[1]
    turned = dataclasses.replace(entry, parameter=second)
    here = orbit_of(turned, model, Kernels(model, second))
    return any(
        compared.same_bifurcation(here.problem, turned, guess, here.unknowns, size)
        for guess, size in near
    )


@dataclass(frozen=True)
class _Compared:
    """A curve to compare with orbits: in their natural units, and parameters in the largest value
    on the curve."""

    curve: Curve

    def units(self, problem: OrbitProblem, unknowns: Array) -> Array:
        units = problem.natural_units(unknowns).copy()
        largest = [float(np.max(np.abs(self.curve[n]))) for n in problem.kernels.parameters]
        units[problem.n :] = [value or 1.0 for value in largest]
        return units

    def distance(self, problem: OrbitProblem, one: Array, other: Array) -> float:
        difference = problem.difference(one, other) / self.units(problem, other)
        return float(np.max(np.abs(difference)))

    def crossings(
        self, name: str, value: float, problem: OrbitProblem, physical: bool = False
    ) -> list[tuple[Array, float]]:
        """Orbits where the curve passes a parameter's value, nearly, the problem's free parameter
        last, and the distance of its points around it; if asked for, where one of these is
        physical."""
        curve = self.curve
        own = problem_of(problem.model, Word(curve.word, curve.period), problem.kernels)
        away = curve[name] - value
        names = columns_of(curve.word, problem.m)
        rows = np.column_stack([curve[name] for name in [*names, problem.parameter]])
        wanted = (curve["physical"] > 0) | (not physical)
        found = []
        crossed = (away[:-1] * away[1:] <= 0.0) & (away[:-1] != away[1:])
        for i in np.nonzero(crossed & (wanted[:-1] | wanted[1:]))[0]:
            way = rows[i + 1] - rows[i]
            at = rows[i] + away[i] / (away[i] - away[i + 1]) * way
            guess = rotate_to_word(own, at, problem.word)
            assert guess is not None, "the words are rotations of each other"
            found.append((guess, float(np.max(np.abs(way / self.units(own, at))))))
        return found

    def same_bifurcation(
        self, problem: OrbitProblem, entry: Entry, guess: Array, unknowns: Array, size: float
    ) -> bool:
        """Whether the bifurcation next to a guess is that of an entry."""
        away = problem.difference(guess, unknowns)
        off = self.distance(problem, guess, unknowns)
        if off > size + NEAR_CURVE:
            return False
        system = equations_of(kind_of(entry.kind), problem, details_of(entry))
        solution = solve(system, problem.evaluate(unknowns + away))
        if solution is None:
            return off < NEAR_CURVE
        return self.distance(problem, solution.unknowns, unknowns) < SAME_CURVE

    def is_on_way(self, problem: OrbitProblem, unknowns: Array, left: Array, right: Array) -> bool:
        """Whether an orbit is as near the straight way between two as the curve through them is."""
        units = self.units(problem, left)
        way = problem.difference(right, left) / units
        away = problem.difference(unknowns, left) / units
        part = np.clip(way @ away / (way @ way or 1.0), 0.0, 1.0)
        size = float(np.max(np.abs(way)))
        return bool(np.max(np.abs(away - part * way)) < SAME_END + BENT * size)


def same_curve(one: Curve, other: Curve, problem: OrbitProblem) -> bool:
    """Whether two curves have the same ends, in either direction, and meet between them.

    The problem is that of the first one's word, with both parameters free.
    """
    about = [(c.kind, c.period, dict(c.fixed)) for c in (one, other)]
    if about[0] != about[1] or not is_rotation(one.word, other.word):
        return False
    rows, others = _orbits(one, problem), _orbits(other, problem)
    compared = _Compared(other)
    ends, (first, last) = rows[[0, -1]], others[[0, -1]]
    if not any(
        all(compared.distance(problem, *pair) < SAME_END for pair in zip(ends, turned, strict=True))
        for turned in ((first, last), (last, first))
    ):
        return False
    middle = rows[len(rows) // 2]
    return any(compared.is_on_way(problem, middle, *pair) for pair in itertools.pairwise(others))


def _orbits(curve: Curve, problem: OrbitProblem) -> Array:
    """The orbits of a curve as unknowns of a problem with its parameters free."""
    own = problem_of(problem.model, Word(curve.word, curve.period), problem.kernels)
    names = [*columns_of(curve.word, problem.m), *curve.parameters]
    rows = np.column_stack([curve[name] for name in names])
    return np.array([rotate_to_word(own, row, problem.word) for row in rows])


# Near misses: where on a line what vanishes at an event comes nearest to zero, and turns back.
#
# A closed curve that no line crosses is seen from the lines beside it: the determinant of the
# event, or its gap, has an extremum there. From the extremum the orbit is followed across the line,
# and along again where it comes nearest to zero on the way, until an event is met or nothing is
# nearer: a descent to the extremum in both parameters, one coordinate at a time.

MOST_STEPS = 8
"""How often a descent turns at most."""

NEARER = 0.999
"""A step that brings less than this is the last."""

TURNS = 1e-6
"""An extremum by less than this part of its size is rounding."""

SAME_PLACE = 0.02
"""Descents that come as near to each other, as parts of both ranges, go on as one,"""
SAME_ORBIT = 0.1
"""if their orbits' velocities differ by less than this part of the largest."""


@dataclass(frozen=True)
class NearMiss:
    """An extremum on a line."""

    word: Word
    kind: str
    """Kind of the event that is missed."""
    index: int
    """Index of the value among several that vanish at events of this kind."""
    size: float
    """How far from zero it is."""
    unknowns: Array
    """The orbit, the line's free parameter last."""
    velocities: Array
    """Velocities of its impacts."""

    def like(self, other: NearMiss) -> bool:
        """Whether the same is missed on orbits that are not far from each other."""
        same = (self.word, self.kind, self.index) == (other.word, other.kind, other.index)
        if not same:
            return False
        apart = np.max(np.abs(self.velocities - other.velocities), initial=0.0)
        return bool(apart <= SAME_ORBIT * np.max(np.abs(self.velocities), initial=0.0))


def near_misses(run: Run, kinds: Sequence[str]) -> list[NearMiss]:
    """Return the near misses on a run, of the kinds for which one is told; of those that change
    what is physical where the orbit violates nothing else, nearly."""
    points, problem = run.points, run.problem
    rows = points.unknowns
    physical = Summary.of(points.numbers).findings[:, 0] == PHYSICAL
    near = np.convolve(physical, np.ones(3), "same") > 0.0
    return [
        NearMiss(
            problem.word,
            kind,
            index,
            float(abs(values[row])),
            rows[row],
            problem.impacts(rows[row])[:, 1],
        )
        for kind in kinds
        if kind in VANISHING
        for index, values in enumerate(VANISHING[kind](points).T)
        for row in _turning_places(values)
        if near[row] or _violates_no_more(points[row].evaluation, kind_of(kind).finding)
    ]


def _violates_no_more(orbit: Linearisation, finding: int | None) -> bool:
    """Whether an orbit would be physical but for findings of one sort; True for none."""
    if finding == PASSES:
        passed = {(t.flight, t.wall) for f in orbit.gaps for t in f.touches if t is not None}
        return orbit.judge(forgive_touches=passed).physical
    if finding == WRONG_WAY:
        return orbit.judge(forgive_impacts=range(len(orbit.problem.word))).physical
    return True


def _turning_places(values: Array) -> list[int]:
    """Where a value is nearest to zero between two others of its sign."""
    left, middle, right = values[:-2], values[1:-1], values[2:]
    one_sign = (np.sign(left) == np.sign(middle)) & (np.sign(middle) == np.sign(right))
    nearest = np.abs(middle) * (1.0 + TURNS) < np.minimum(np.abs(left), np.abs(right))
    return (1 + np.nonzero(one_sign & nearest)[0]).tolist()


def _multipliers(points: Points) -> Array:
    values = Summary.of(points.numbers).multipliers
    return np.where(np.isfinite(values), values, np.nan)


def _apart_from(multiplier: float, points: Points) -> Array:
    """A bounded function that vanishes where a multiplier has this value; NaN where one is
    infinite."""
    values = multiplier * _multipliers(points)
    with np.errstate(invalid="ignore"):
        return np.prod((1.0 - values) / (1.0 + np.abs(values)), axis=1).real[:, None]


def _torus(points: Points) -> Array:
    """How far complex pairs are from the unit circle; others tell nothing."""
    values = _multipliers(points)
    pairs = np.where(values.imag > 0.0, np.abs(values) - 1.0, np.nan)
    order = np.argsort(np.abs(pairs), axis=1, kind="stable")[:, :1]  # not-a-number goes last
    return np.take_along_axis(pairs, order, axis=1)


def _gaps(points: Points) -> Array:
    return np.array(
        [
            [np.nan if t is None else t.gap for flight in p.evaluation.gaps for t in flight.touches]
            for p in points
        ]
    )


VANISHING: dict[str, Callable[[Points], Array]] = {
    "FB": partial(_apart_from, 1.0),
    "PD": partial(_apart_from, -1.0),
    "NS": _torus,
    "G": _gaps,
    "V": lambda points: np.array([p.evaluation.problem.impacts(p.unknowns)[:, 1] for p in points]),
}
"""Values that vanish at events of a kind, along the points of a run: shape (P, values)."""


# The branches that cross one line of a map: found on other lines, by search, and by switching.

AT_ONE_VALUE = 32
"""Starts of a search at one value: many values with few starts each see more of a line than few
values with many."""

FEWEST_VALUES = 5

SAME_ORBIT_ON_LINES, BESIDE = 1e-7, 1e-3
"""How near one orbit is to another that it is, and how far from a crossing one of its branches is
looked for, in natural sizes."""


def crossing_runs(
    runs: list[Run],
    scene: Scene,
    problem: OrbitProblem,
    limits: Range,
    generator: np.random.Generator,
) -> None:
    """Follow every orbit of a word that a search finds at values scattered along a line, until it
    finds nothing new.

    One parameter has the problem's value, the other varies within `limits`. `runs` are those
    followed there; the new ones are added.
    """
    count = max(FEWEST_VALUES, scene.starts // AT_ONE_VALUE)
    for _ in range(scene.rounds):
        before = len(runs)
        for part in (np.arange(count) + generator.uniform(size=count)) / count:
            model = problem.model.replace(**{problem.parameter: place_across(limits, part)})
            there = problem_of(model, problem.word, problem.kernels)
            for orbit in search_for(there, generator, AT_ONE_VALUE, 1).orbits:
                if not any(run.has(problem, orbit.unknowns) for run in runs):
                    runs.append(run_on_line(scene, problem, orbit.unknowns, limits))
            problem.kernel_evaluations += there.kernel_evaluations
        if len(runs) == before:
            break


def _nearby_orbit(problem: OrbitProblem, guess: Array, limits: Range) -> Array | None:
    """The orbit of the branch next to a guess, at a fold too; None if there is none."""
    try:
        scale, tangent = _tangent_at(problem, guess, limits)
        if tangent is None:  # branches cross there: one of them is beside
            kernel = np.linalg.svd(problem.evaluate(guess).jacobian * scale)[2][-1]
            guess = guess + BESIDE * scale * kernel
            scale, tangent = _tangent_at(problem, guess, limits)
        if tangent is None:
            return None
        here = correct(problem, guess, tangent / scale**2, scale, Settings()).evaluation
        return None if here is None else here.unknowns
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        return None


def follow_switches(scene: Scene, runs: Sequence[Run], limits: Range) -> tuple[list[Run], int]:
    """Follow the branches born at events of runs, as often in turn as the scene switches.

    Those of unphysical orbits are left out. Returns also at how many events the limit on branches
    kept it from switching.
    """
    found: list[Run] = []
    last, unswitched = list(runs), 0
    for _ in range(scene.depth if scene.switch else 0):
        new: list[Run] = []
        for event in _births(scene, last):
            if len(runs) + len(found) + len(new) >= scene.max_branches:
                unswitched += 1
                continue
            run = _switch_run(scene, event, [*runs, *found, *new], limits)
            new += [] if run is None else [run]
        found += new
        last = new
    return found, unswitched


def _births(scene: Scene, runs: Sequence[Run]) -> Iterator[Event]:
    """The events at which to switch."""
    for event in (event for run in runs for event in run.events if event.kind in scene.switch):
        kind, here = kind_of(event.kind), event.point.evaluation
        if kind.verdict(here, event.details).physical:
            yield event


def _switch_run(scene: Scene, event: Event, known: Sequence[Run], limits: Range) -> Run | None:
    """The run along the branch born at an event, unless it is known."""
    start = switch(event)
    if start is None:
        return None
    start = primitive_start(start)
    probe = first_step(start, limits, scene.settings)
    if not probe.points:
        return None
    problem, unknowns = reduce_period(start.problem, probe.points[-1].unknowns, SAME_ORBIT_ON_LINES)
    if any(run.has(problem, unknowns) for run in known):
        return None
    stop = symmetric_end(start.problem)
    tests = tests_of(scene, start.problem)
    born = End.of(EndKind.BORN, start.problem.parameter, event.parameter, entry="", parent="")
    run = run_born(start, born, limits, tests, scene.settings, stop=stop)
    if isinstance(run, End):
        return None
    reraise_interruption(run.ends)
    return run


def place_across(limits: Range, part: float) -> float:
    """Part of the way across a range, in logarithms where it is wide and all is positive."""
    low, high = limits
    if low > 0.0 and high > 4.0 * low:
        return float(min(max(low * (high / low) ** part, low), high))
    return float(low + (high - low) * part)


def orbits_at_value(run: Run, value: float) -> Iterator[Array]:
    """Orbits on a run at a value of its parameter, nearly."""
    rows = run.rows
    behind, ahead = rows[:-1, -1], rows[1:, -1]
    for i in np.nonzero(((behind - value) * (ahead - value) <= 0.0) & (behind != ahead))[0]:
        part = (value - behind[i]) / (ahead[i] - behind[i])
        yield rows[i] + part * (rows[i + 1] - rows[i])


GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
INSIDE = 1e-6
"""How far inside a side its line runs, as part of the range."""

MOST_ROUNDS = 8
"""Largest number of rounds: so many times the lines asked for may be surveyed in each direction."""

NARROWEST = 0.1
"""Neighbouring lines nearer than this part of the range are not looked between."""


@dataclass
class LineSurvey:
    """What lines have met of the orbits of one word."""

    word: Word
    entries: int = 0
    started: int = 0
    born: int = 0
    off: list[tuple[Entry, str]] = field(default_factory=list)


@dataclass
class Line:
    """A line: the parameter that is held, how far across its range, its value, the runs of the
    scene's word, then those of other words, and what of elsewhere was looked for on it."""

    held: str
    part: float
    value: float
    runs: list[Run] = field(default_factory=list)
    born: list[Run] = field(default_factory=list)
    seen: set[int | str] = field(default_factory=set)

    @property
    def real(self) -> int:
        """How many runs of the scene's word have physical orbits."""
        found = (Summary.of(run.points.numbers).findings[:, 0] for run in self.runs)
        return sum(bool(np.any(findings == PHYSICAL)) for findings in found)


class Lines:
    """The lines across the map of one word, of one member of the family.

    The kernels have the first parameter free. ``curves()`` returns the member's curves,
    ``covered(entry)`` whether one passes through an entry. ``start(entry)`` starts curves on the
    branch through an entry and returns why none passes it, if none does; ``further()`` starts
    curves from points of codimension two on those that are new and returns the entries that it
    started from.
    """

    def __init__(
        self,
        scene: Scene,
        model: Model,
        word: Word,
        kernels: Kernels,
        curves: Callable[[], Sequence[Curve]],
        covered: Callable[[Entry], bool],
        start: Callable[[Entry], str],
        further: Callable[[], Sequence[Entry]],
        progress: Progress,
    ) -> None:
        assert scene.curves is not None
        self.scene, self.options, self.model, self.word = scene, scene.curves, model, word
        self.curves, self.covered, self.start = curves, covered, start
        self.further, self.progress = further, progress
        first, second = scene.parameter, scene.curves.parameter
        self.ways = {
            second: (kernels, scene.range, self.options.range),
            first: (Kernels(model, second), self.options.range, scene.range),
        }
        self.laid: list[Line] = []
        self.looked = 0
        self.seen: list[tuple[Array, NearMiss]] = []
        self.met = [LineSurvey(word)]
        self.followed: Counter[tuple[str, int]] = Counter()
        self.left_out: list[str] = []
        self.lost: list[tuple[Word, str]] = []
        self.evaluations = 0
        self.generator = np.random.default_rng(scene.seed)

    def cover(self, fixed: Mapping[str, float]) -> list[Coverage]:
        """Lay lines until the last ones meet nothing new, and say what was met of each word."""
        self.begin_further()
        wanted = 2 * self.options.cover
        quiet, regular = 0, self.lines()
        while quiet < wanted:
            held, part = next(regular, (None, 0.0))
            if held is None:
                break
            quiet = 0 if self.run(held, part) else quiet + 1
            if quiet >= wanted:
                met = [self.run(*place) for place in self.between()]
                quiet = 0 if any(met) or self.descend() or self.catch_up() else quiet
        return [self.said(met, dict(fixed), quiet >= wanted) for met in self.met]

    def lines(self) -> Iterator[tuple[str, float]]:
        """Which parameter to hold, and how far across: the sides, then each way in turn."""
        most = MOST_ROUNDS * self.options.cover
        for part in [INSIDE, 1.0 - INSIDE, *((GOLDEN * np.arange(1, 1 + most)) % 1.0).tolist()]:
            for held in self.ways:
                yield held, part

    def between(self) -> Iterator[tuple[str, float]]:
        """Places half way between neighbours with different numbers of branches, ever nearer."""
        for held in self.ways:
            while place := self._differing(held):
                yield held, place

    def _differing(self, held: str) -> float | None:
        """Half way between the neighbours farthest apart that differ; None where all are near."""
        own = sorted((line for line in self.laid if line.held == held), key=lambda x: x.part)
        pairs = itertools.pairwise(own)
        apart = [(b.part - a.part, a) for a, b in pairs if a.real != b.real]
        width, left = max(apart, key=lambda pair: pair[0], default=(0.0, None))
        return left.part + 0.5 * width if left and width > NARROWEST else None

    def run(self, held: str, part: float) -> bool:
        """Lay one line; whether it met an entry on no curve."""
        kernels, limits, other = self.ways[held]
        value = place_across(other, part)
        self.progress(f"{self.word}: line at {held} = {value:.6g}")
        problem = problem_of(self.model.replace(**{held: value}), self.word, kernels)
        line = Line(held, part, value)
        self.carry(line, own=True)
        crossing_runs(line.runs, self.scene, problem, limits, self.generator)
        line.born, unswitched = follow_switches(self.scene, line.runs, limits)
        if unswitched:
            limit = f"follow.max_branches = {self.scene.max_branches}"
            at = f"events at {held} = {value:.6g}"
            self.left_out.append(f"the branches of {unswitched} {at} ({limit})")
        self.evaluations += problem.kernel_evaluations
        self.evaluations += sum(run.problem.kernel_evaluations for run in line.born)
        self.carry(line, own=False)
        self.laid.append(line)
        return self.meet_on([*line.runs, *line.born])

    def catch_up(self) -> bool:
        """Follow on every line what later lines and curves have shown to cross it; whether an entry
        was on no curve."""
        met = []
        for line in self.laid:
            new = [run for own in (True, False) for run in self.carry(line, own)]
            met.append(self.meet_on(new))
        return any(met)

    def carry(self, line: Line, own: bool) -> list[Run]:
        """Follow on a line the orbits known elsewhere, of the scene's word or of others, unless
        they are followed there."""
        kernels, limits, _ = self.ways[line.held]
        model, new = self.model.replace(**{line.held: line.value}), []
        for source, word in list(self.sources(line)):
            key = source.id if isinstance(source, Curve) else id(source[0])
            if _same_word(word, self.word) != own or key in line.seen:
                continue
            line.seen.add(key)
            problem = problem_of(model, self.word if own else word, kernels)
            if isinstance(source, Curve):
                starts = self.on_curve(source, line, problem)
            else:
                starts = self.on_run(*source, line, problem, own)
            runs = line.runs if own else line.born
            for unknowns in starts:
                known = any(run.has(problem, unknowns) for run in (*line.runs, *line.born))
                if not (known or repeats(problem, unknowns, SAME_ORBIT_ON_LINES)):
                    runs.append(run_on_line(self.scene, problem, unknowns, limits))
                    new.append(runs[-1])
            self.evaluations += problem.kernel_evaluations
        return new

    def sources(self, line: Line) -> Iterator[tuple[Curve | tuple[Run, float], Word]]:
        """What may cross a line: runs on lines across it, with the values held there, and curves;
        with their words."""
        for other in self.laid:
            if other.held != line.held:
                for run in (*other.runs, *other.born):
                    yield (run, other.value), run.problem.word
        for curve in self.curves():
            yield curve, Word(curve.word, curve.period)

    def on_run(
        self, run: Run, held: float, line: Line, problem: OrbitProblem, own: bool
    ) -> Iterator[Array]:
        """Orbits on a line where a run crosses it; of words not the scene's those that are physical
        alone."""
        for unknowns in orbits_at_value(run, line.value):
            here = solve_near(problem, np.append(unknowns[:-1], held))
            if here is not None and (own or here.verdict.physical):
                yield here.unknowns

    def on_curve(self, curve: Curve, line: Line, problem: OrbitProblem) -> Iterator[Array]:
        """Orbits beside those on a line where the physical part of a curve crosses it."""
        limits = self.ways[line.held][1]
        for guess, _ in _Compared(curve).crossings(line.held, line.value, problem, physical=True):
            here = _nearby_orbit(problem, guess, limits)
            if here is None:
                at = f"{line.held} = {line.value:.6g}, {problem.parameter} = {guess[-1]:.6g}"
                self.lost.append((problem.word, f"the branch through {curve.id} at {at}"))
            elif limits[0] <= here[-1] <= limits[1]:
                yield _orbit_beside(problem, here, self.scene, limits)

    def meet_on(self, runs: Sequence[Run]) -> bool:
        """Whether an entry of some runs is on no curve."""
        self.followed.update((run.problem.word.walls, run.problem.word.period) for run in runs)
        found = [e for run in runs for e in run.branch("b0", kinds=self.options.kinds).events]
        met = [self.meet(entry) for entry in found if entry.physical]  # others are without number
        return any(met)

    # Near misses on lines, from which closed curves between them are reached.

    def descend(self) -> bool:
        """Follow orbits from the near misses of lines to events; whether one is on no curve."""
        lines, self.looked = self.laid[self.looked :], len(self.laid)
        misses = [
            (miss, line)
            for line in lines
            for run in (*line.runs, *line.born)
            for miss in near_misses(run, self.options.kinds)
        ]
        misses.sort(key=lambda pair: pair[0].size)
        self.progress(f"{self.word}: {len(misses)} near misses on {len(lines)} lines")
        runs = (r for m, line in misses for r in self.descent(m, line.held, line.value))
        met = [self.meet_on([run]) for run in runs]
        return any(met)

    def descent(self, miss: NearMiss, held: str, value: float) -> Iterator[Run]:
        """Follow from a near miss on a line that holds a parameter at a value to an event, or to
        where nothing is nearer."""
        for _ in range(MOST_STEPS):
            free = next(name for name in self.ways if name != held)
            place = {held: value, free: float(miss.unknowns[-1])}
            run = None if self.known(miss, place) else self.cross(miss, free, place)
            if run is None:
                return
            yield run
            further = [one for one in near_misses(run, [miss.kind]) if one.index == miss.index]
            held, value = free, place[free]
            nearest = min(further, key=lambda one: one.size, default=miss)
            if nearest.size > NEARER * miss.size or any(e.kind == miss.kind for e in run.events):
                return
            miss = nearest

    def known(self, miss: NearMiss, place: Mapping[str, float]) -> bool:
        """Whether a descent has been next to a near miss; from now on one has."""
        limits = {held: way[2] for held, way in self.ways.items()}.items()
        parts = np.array([(place[name] - low) / (high - low) for name, (low, high) in limits])
        if any(np.max(np.abs(parts - p)) < SAME_PLACE and miss.like(m) for p, m in self.seen):
            return True
        self.seen.append((parts, miss))
        return False

    def cross(self, miss: NearMiss, held: str, place: Mapping[str, float]) -> Run | None:
        """Follow the orbit of a near miss while a parameter is held."""
        kernels, limits, _ = self.ways[held]
        problem = problem_of(self.model.replace(**{held: place[held]}), miss.word, kernels)
        start = np.append(miss.unknowns[:-1], place[kernels.parameter])
        here = solve_near(problem, start)
        run = None
        if here is not None and not repeats(problem, here.unknowns, SAME_ORBIT_ON_LINES):
            run = run_on_line(self.scene, problem, here.unknowns, limits)
        self.evaluations += problem.kernel_evaluations
        return run

    def meet(self, entry: Entry) -> bool:
        """Whether an entry is on no curve yet; one is started there."""
        entry = dataclasses.replace(entry, parameter=self.scene.parameter)
        met = self.of(entry)
        met.entries += 1
        if self.covered(entry):
            return False
        reason = self.start(entry)
        if reason:
            met.off.append((entry, reason))
        else:
            met.started += 1
            self.begin_further()
        return True

    def begin_further(self) -> None:
        """Start from points of codimension two until there is no new curve."""
        while found := self.further():
            for entry in found:
                self.of(entry).born += 1

    def of(self, entry: Entry) -> LineSurvey:
        """What was met of an entry's word."""
        word = Word(entry.word, entry.period)
        known = next((met for met in self.met if _same_word(met.word, word)), None)
        if known is None:
            self.met.append(known := LineSurvey(word))
        return known

    def said(self, met: LineSurvey, fixed: dict[str, float], quiet: bool) -> Coverage:
        """The statement on one word; entries that later curves pass are off none."""
        walls = self.scene.model.letters
        word, names = met.word, (self.scene.parameter, self.options.parameter)
        off: list[dict[str, object]] = [
            {"kind": e.kind, **{n: e.parameters[n] for n in names}, "reason": reason}
            for e, reason in met.off
            if not self.covered(e)
        ]
        lines = {held: [x.value for x in self.laid if x.held == held] for held in self.ways}
        about = fixed, word.walls, word.period, word.notation(walls), lines
        own = (Word(*key) for key in self.followed.elements())
        branches = sum(_same_word(word, other) for other in own)
        switched = not _same_word(word, self.word)
        lost = [f"{what} ({NOT_SOLVED})" for other, what in self.lost if _same_word(word, other)]
        left_out = lost if switched else [*self.left_out, *lost]
        complete = quiet and not left_out and (branches > 0 or not switched)
        counts = met.entries, met.started, off, complete
        reason = None if complete else quiet
        return Coverage(*about, *counts, met.born, switched, branches, left_out, reason)


def _same_word(one: Word, other: Word) -> bool:
    return one.period == other.period and is_rotation(one.walls, other.walls)
