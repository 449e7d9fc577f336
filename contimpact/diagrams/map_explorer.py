"""A scene's map in two parameters: all its curves, followed until lines find no more.

Those through points of codimension two, and those born on others, are among them.
"""

from __future__ import annotations

import dataclasses
import itertools
import time
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from ..arrays import Array
from ..bifurcations.codimension_two import CurveStart
from ..bifurcations.kind import kind_of, test_functions
from ..bifurcations.requested import RequestedValues
from ..continuation.branch import End, EndKind, Event, Point
from ..continuation.corrector import correct, first_tangent, length
from ..continuation.settings import Settings
from ..continuation.walk import Options, reraise_interruption
from ..errors import InputError, explain_arguments
from ..models.guards import Word
from ..models.model import Model
from ..orbits.problem import Linearisation, OrbitProblem
from ..orbits.quiet import problem_of
from ..orbits.search import SAME_ORBIT, repeats, solve_near
from ..progress import Progress, counting_callback, ignore_progress
from ..results.branch import Branch, Entry, details_of, model_of, orbit_of
from ..results.curve import (
    Area,
    Check,
    CheckedOrbit,
    Codim2,
    Coverage,
    Curve,
    Region,
    falling_column,
    fixed_text,
    regions,
)
from ..results.diagram import ENDING, Diagram, Limits, entry_of, failure_of, with_statistics
from ..results.options import CURVE_SETTINGS, CurveOptions, check_range
from ..results.scene import Scene
from ..segments.kernels import Kernels
from .areas import Divider
from .curve_problem import (
    CurvePoint,
    CurveProblem,
    double_of,
    equations_of,
    require_curve,
    starts_at,
)
from .curves import Range, clip_rounding, curve_from_walks, follow_curve, walk_curve
from .map_lines import (
    Lines,
    first_bifurcation,
    orbit_at_start,
    passes_entry,
    run_along,
    run_through,
    run_with,
    same_curve,
)
from .orbit_walks import Run, walk_both_ways, walk_orbits

ELSEWHERE = 1e-4
"""A curve's first point differs less from where it was to start, as part of its unknowns."""

SAME_VALUE = 1e-12
SAME_POINT = 1e-8
"""How far apart values, and coordinates as part of their ranges, of one point may be."""


@explain_arguments
def follow_codim2(
    entry: Entry,
    point: Codim2,
    model: Model | None = None,
    *,
    second: str,
    third: str,
    ranges: Sequence[Range],
    name: str = "c1",
    values: Sequence[float] = (),
    settings: Settings = CURVE_SETTINGS,
    kernels: Kernels | None = None,
    detect: bool = True,
    callback: Callable[[Point], bool | None] | None = None,
) -> Curve | End:
    """Follow a point of codimension two in a third parameter, in both directions.

    Parameters
    ----------
    entry : Entry
        From which the curve was started that has the point: its kind and place on the orbit.
    point : Codim2
        Of `Curve.points`.
    model : Model, optional
        The system, where its name does not tell; parameter values are taken from the point.
    second, third : str
        The curve's second parameter, and a further one.
    ranges : sequence of (low, high)
        Of the first, the second and the third parameter; the curve ends where it leaves one.
    name : str
    values : sequence of float
        Values of the third parameter to hit exactly.
    settings : Settings
    kernels : Kernels, optional
        With all three parameters free, if some are at hand.
    detect : bool
        Whether to look for points of codimension three, and for turns, where two points meet.
    callback : callable, optional
        Called with every accepted point.

    Returns
    -------
    Curve or End
        With three `parameters`; what is special on it in `points`. The end of a curve that has no
        point, where its equations are not solved at the start.

    Raises
    ------
    InputError
        For a parameter the model does not have, ranges that do not hold the point, or a point
        that is not on a curve of the entry's kind.
    """
    require_curve(entry)
    first = entry.parameter
    at = model_at_point(entry, point, model)
    names = (first, second, third)
    if len(ranges) != len(names):
        raise InputError("ranges", f"found {len(ranges)}", "give one for each of three parameters")
    limits = [
        check_range(at, n, at.values.get(n, 0.0), r) for n, r in zip(names, ranges, strict=True)
    ]
    here = orbit_at(entry, point, at, kernels or Kernels(at, *names))
    double = double_of(here, point.kind, kind_of(entry.kind), details_of(entry), point.changes)
    spans = [high - low for low, high in limits[:-1]]
    problem = CurveProblem(double.kind, double.system, double.details, spans)
    start = problem.packed(here.unknowns, double.system.start(here))
    special = double.tests if detect else []
    found = walk_curve(problem, start, limits, special, values, settings, callback)
    if isinstance(found, End):
        return found
    away = problem.difference(found[1].points[0].unknowns, start)[: problem.orbit.n]
    if np.max(np.abs(away)) > ELSEWHERE * np.max(np.abs(start[: problem.orbit.n])):
        why = "the equations lead to another orbit"
        return End.of(EndKind.START, third, start[-1], why=why)
    about = problem.kind.name, entry.notation, point.id
    return curve_from_walks(name, problem, found, special, *about)


def orbit_at(entry: Entry, point: Codim2, model: Model, kernels: Kernels) -> Linearisation:
    """Return the orbit of a point of codimension two; the curve that has the point was started from
    the entry."""
    names = "parameters", "impacts", "orbit_period", "state"
    there = dataclasses.replace(entry, **{name: getattr(point, name) for name in names})
    return orbit_of(there, model, kernels).linearisation


def model_at_point(entry: Entry, point: Codim2, model: Model | None) -> Model:
    """Return the model at a point's parameter values."""
    at = model_of(entry, model)
    given = point.parameters.items()
    own = {n: float(clip_rounding(at, n, v)) for n, v in given if n in at.values}
    return at.replace(**own)


def passes_through(entry: Entry, point: Codim2, curve: Curve) -> bool:
    """Whether a curve that hits a point's value of the third parameter passes through the point."""
    *others, third = curve.parameters
    if (entry.word, entry.period) != (curve.word, curve.period):
        return False
    if {*point.kind.split("-")} != {*curve.kind.split("-")}:
        return False
    value = point.parameters[third]
    away = np.abs(curve[third] - value) > SAME_VALUE * max(abs(value), np.ptp(curve[third]))
    for name in others:
        away |= np.abs(curve[name] - point.parameters[name]) > SAME_POINT * np.ptp(curve[name])
    return not bool(np.all(away))


# Curves that start at points of codimension two on other curves, or pass these.
#
# At a GPD the fold of the doubled orbit begins, at a G-FB the fold of the orbit with one impact
# more, at a PD-G the grazing of the doubled orbit, at R1 and R2 the curve of NS; the grazing of a
# PD-G and the fold of an FB-G are on curves of their own. (Through a cusp the one curve of both
# folds passes.) At such a point solutions cross or multipliers coincide, so that a curve is entered
# a little beside.

BESIDE = (0.05, 0.02, 0.005, 0.001)
"""How far beside the point a curve is entered, tried in turn; in the curve's metric."""

NEARLY = 1e-3
"""How near to a shorter orbit one is taken for it; points beside a PD-G are known no better."""


def entries_born(
    entry: Entry,
    point: Codim2,
    model: Model,
    kinds: Sequence[str],
    kernels: Kernels,
    ranges: Sequence[Range],
) -> Iterator[Entry]:
    """Yield events beside a point of codimension two, on the curves of other events, of these
    kinds, that meet there: one for each direction in which a curve leaves, within the ranges of
    both parameters. The curve that has the point was started from the entry."""
    at = model_at_point(entry, point, model)
    here = orbit_at(entry, point, at, kernels)
    starts = starts_at(here, point.kind, kind_of(entry.kind), details_of(entry), point.changes)
    for start in starts:
        if start.kind in kinds and not _repeats(start):
            for found in _points_beside(start, ranges):
                yield _entry_at(found, point.id)


def _repeats(start: CurveStart) -> bool:
    """Whether the orbits are shorter ones run several times, with a curve of their own: where one
    doubles its period, the double has the multiplier 1 as at a fold."""
    here = start.here
    return start.leaves is None and repeats(here.problem, here.unknowns, NEARLY)


def _points_beside(start: CurveStart, ranges: Sequence[Range]) -> Iterator[CurvePoint]:
    """Points of a curve in both directions from its start, where they lie within the ranges."""
    here = start.here
    system = equations_of(kind_of(start.kind), here.problem, start.details)
    own = system.start(here)
    (low, high), (first, last) = ranges
    curve = CurveProblem(kind_of(start.kind), system, start.details, [high - low])
    middle = curve.packed(here.unknowns, own)
    scale = curve.scale(middle, last - first)
    if start.leaves is None:
        tangent = first_tangent(curve, curve.evaluate(middle).jacobian, scale)
    else:
        tangent = curve.packed(*start.leaves(system, own))
    if tangent is None:
        return
    tangent = tangent / length(tangent, scale)
    for direction in (1.0, -1.0):
        found = _first_curve_point(curve, middle, direction * tangent, scale, ranges)
        if found is not None:
            yield found


def _first_curve_point(
    curve: CurveProblem, middle: Array, tangent: Array, scale: Array, ranges: Sequence[Range]
) -> CurvePoint | None:
    """The point of a curve at a small distance, by which its equations are regular."""
    for distance in BESIDE:
        guess = middle + distance * tangent
        solved = correct(curve, guess, tangent / scale**2, scale, CURVE_SETTINGS).evaluation
        if not isinstance(solved, CurvePoint) or curve.kind.curve_end(solved.own):
            continue
        if repeats(curve.orbit, solved.orbit.unknowns, SAME_ORBIT):  # the curve of a shorter orbit
            continue
        names = curve.orbit.kernels.parameters
        values = [solved.parameter(name) for name in names]
        if all(low <= v <= high for v, (low, high) in zip(values, ranges, strict=True)):
            return solved
    return None


def _entry_at(point: CurvePoint, origin: str) -> Entry:
    """A point of a curve as an event in the first parameter."""
    problem, unknowns = point.problem.orbit, point.orbit.unknowns
    first, second = problem.kernels.parameters
    model = problem.model.replace(**{second: point.parameter(second)})
    single = problem_of(model, problem.word, Kernels(model, first))
    here = single.evaluate(unknowns[: problem.n + 1])
    at = Point(here, np.zeros(problem.n + 1), np.nan, 0.0, 0)
    residual = float(np.max(np.abs(point.residual)))
    kind = point.problem.kind.name
    event = Event(kind, at, residual, np.nan, "newton", point.details)
    return entry_of(event, f"{origin} beside", origin, at, at)


# A scene's curves: started at the entries of its diagram, for every member of its family.

SEARCHED = 6
"""Values of the first parameter at which a run looks for orbits, besides the scene's own: evenly in
logarithms where all values are positive."""

MOST_ROUNDS = 6
"""How often what the curves say is checked against runs, and curves are started where it fails."""


ON_EDGE = 1e-9
"""Points nearer than this part of a range to its limits are not followed out of it."""

CLOSE = 1e-7
"""How near, as part of both ranges, splines keep to the curves that divide areas."""

NARROWEST = 1e-4
"""Ranges below this part of the whole are not checked on their own."""


@dataclasses.dataclass
class _CurveExplorer:
    scene: Scene
    options: CurveOptions
    diagram: Diagram
    progress: Progress
    branches: list[Branch] = dataclasses.field(default_factory=list)
    curves: list[Curve] = dataclasses.field(default_factory=list)
    notes: list[str] = dataclasses.field(default_factory=list)
    limits: Limits = dataclasses.field(default_factory=Limits)
    points: list[Curve] = dataclasses.field(default_factory=list)
    checks: list[Check] = dataclasses.field(default_factory=list)
    coverage: list[Coverage] = dataclasses.field(default_factory=list)
    evaluations: int = 0

    def run(self) -> Diagram:
        began = time.perf_counter()
        scene, options = self.scene, self.options
        self.kernels = Kernels(scene.model, scene.parameter)
        self.pairs = Kernels(scene.model, scene.parameter, options.parameter)
        self.branches = list(self.diagram.branches)
        failure = None
        try:
            for member, branches in self.members():
                for entry in (entry for branch in branches for entry in branch.events):
                    if self.wanted(entry):
                        member.follow(entry, member.model)
                for word in scene.orbits if options.start else ():
                    member.check(word)
                for word in scene.orbits if options.cover else ():
                    self.coverage += member.cover(word)
            if not options.cover:
                self.notes.append(self.uncovered())
            if options.third:
                self.follow_points(*options.third)
        except ENDING as error:
            failure = failure_of(error, self.branches)
        known, limits = self.diagram.statistics, self.limits.listed()
        loaded = known.get("kernels", {"loaded": [], "generated": []})
        counts = {
            "curve_points": sum(len(curve) for curve in self.curves),
            "curve_kernel_evaluations": sum(c.evaluations for c in self.curves),
            "family_kernel_evaluations": self.evaluations,
        }
        kernels = {
            how: [*loaded[how], *(f"{name} (two parameters)" for name in getattr(self.pairs, how))]
            for how in ("loaded", "generated")
        }
        diagram = with_statistics(
            self.diagram,
            [*self.notes, *map(str, limits)],
            seconds=known.get("seconds", {}) | {"curves": time.perf_counter() - began},
            counts=known.get("counts", {}) | counts,
            kernels=kernels,
            failure=failure,
        )
        return dataclasses.replace(
            diagram,
            branches=self.branches,
            curves=self.curves,
            checks=self.checks or (),
            codim2_curves=self.points or (),
            coverage=self.coverage or (),
            limits=[*diagram.limits, *limits] or (),
        )

    def wanted(self, entry: Entry) -> bool:
        """Whether a curve starts at an entry."""
        options = self.options
        return entry.kind in (options.kinds if entry.physical else options.unphysical)

    # The family: the scene's orbits carried to each value, and their branches there.

    def members(self) -> Iterator[tuple[_Member, list[Branch]]]:
        """The family's members, and the branches of each."""
        scene, family = self.scene, self.options.family
        if family is None:
            yield _Member(self, {}), list(self.diagram.branches)
            return
        name, values = family
        carried = [self.carry(branch, name, values) for branch in self.diagram.branches]
        own = [b for b in self.diagram.branches if orbit_at_start(b, self.scene) is not None]
        for value in values:
            member = _Member(self, {name: value})
            if value == scene.model.values[name]:
                yield member, own
                continue
            members = []
            for reached in carried:
                if value in reached:
                    self.progress(f"{name} = {value:.6g}: branch of {scene.parameter}")
                    members.append(self.branch_at(member.model, *reached[value]))
                    self.branches.append(members[-1])
                    reraise_interruption(members[-1].ends)
            yield member, members

    def carry(
        self, branch: Branch, name: str, values: tuple[float, ...]
    ) -> dict[float, tuple[OrbitProblem, Array]]:
        """A branch's orbit at the scene's start, followed in the family's parameter."""
        scene = self.scene
        start = orbit_at_start(branch, scene)
        if start is None:
            self.notes.append(f"branch {branch.id} is not physical at the start: not in the family")
            return {}
        model = scene.model
        kernels = Kernels(model, name)
        word = next(w for w in scene.orbits if w.walls == branch.word and w.period == branch.period)
        problem = problem_of(model, word, kernels)
        own = model.values[name]
        reached = {}
        for direction in (-1, 1):
            wanted = [v for v in values if (v - own) * direction > 0]
            if not wanted:
                continue
            limits = (min(own, *wanted), max(own, *wanted))
            test = RequestedValues(problem, {name: wanted})
            at, settings = np.append(start, own), dataclasses.replace(scene.settings, max_step=0.1)
            options: Options = {"limits": limits, "settings": settings}
            done = walk_orbits(problem, at, direction, tests=[test], gaps=False, **options)
            points = {round(e.parameter, 14): e.point.unknowns for e in done.events}
            points[round(done.end.value, 14)] = done.points[-1].unknowns
            why = done.end.message
            if done.end.kind is EndKind.RANGE:  # at the value where it has begun
                furthest = max((p.parameter for p in done.points), key=lambda v: abs(v - own))
                why = f"the branch turns back at {name} = {furthest:.6g}"
            for value in wanted:
                if round(value, 14) in points:
                    reached[value] = (problem, points[round(value, 14)])
                else:
                    note = f"{name} = {value:.9g} was not reached from {own:.9g}: {why}"
                    self.notes.append(note)
        self.evaluations += problem.kernel_evaluations
        return reached

    def branch_at(self, model: Model, problem: OrbitProblem, unknowns: Array) -> Branch:
        scene = self.scene
        here = problem_of(model, problem.word, self.kernels)
        start = np.append(unknowns[:-1], scene.start)
        settled = solve_near(here, start)
        tests = test_functions(here, scene.events, scene.values)
        at = start if settled is None else settled.unknowns
        run = walk_both_ways(here, at, scene.range, tests, scene.settings)
        first = 1 + sum(len(branch.events) for branch in self.branches)
        branch = run.branch(f"b{len(self.branches) + 1}", None, first, scene.events)
        self.evaluations += here.kernel_evaluations
        return branch

    # The curves.

    def end_of(self, curve: Curve) -> None:
        """Record a curve that the limit of points ended; let an interruption go on."""
        if any(end.kind is EndKind.POINTS for end in curve.ends):
            most = self.options.settings.max_points
            self.limits.reached("curves.max_points", most, "curves ended by it", curve.id)
        reraise_interruption(curve.ends)

    def uncovered(self) -> str:
        """What a map without lines leaves out."""
        second = self.options.parameter
        values = sorted({self.scene.model.values[second], *self.options.start})
        at = ", ".join(f"{value:.6g}" for value in values)
        return (
            f"the map has the curves that pass {second} = {at} on the branches found there; "
            "others were not looked for: set curves.cover"
        )

    # Points of codimension two in a third parameter.

    def follow_points(self, third: str, limits: tuple[float, float]) -> None:
        """Follow every point of codimension two that lies on no curve of such points yet."""
        options, scene = self.options, self.scene
        names = (scene.parameter, options.parameter, third)
        kernels = Kernels(scene.model, *names)
        entries = {entry.id: entry for branch in self.branches for entry in branch.events}
        found = [(entries[c.origin], p) for c in self.curves for p in c.points]
        values = sorted({p.parameters[third] for _, p in found})
        for entry, point in found:
            edges = zip(names, (scene.range, options.range), strict=False)
            places = [(point.parameters[n], *edge) for n, edge in edges]
            if any(min(v - low, high - v) <= ON_EDGE * (high - low) for v, low, high in places):
                continue
            if any(passes_through(entry, point, curve) for curve in self.points):
                continue
            name = f"d{len(self.points) + 1}"
            shown = f"curve {name}: {point.kind} in ({', '.join(names)})"
            self.progress(shown)
            curve = follow_codim2(
                entry,
                point,
                scene.model,
                second=options.parameter,
                third=third,
                ranges=[scene.range, options.range, limits],
                name=name,
                values=values,
                settings=options.settings,
                kernels=kernels,
                callback=counting_callback(shown, third, self.progress),
            )
            if isinstance(curve, End):
                self.notes.append(f"{point.id} {point.kind} is not followed: {curve.message}")
                continue
            self.points.append(curve)
            self.end_of(curve)


class _Member:
    """A member of the family: its curves, as entries, runs and lines across the map start them."""

    def __init__(self, explorer: _CurveExplorer, fixed: dict[str, float]) -> None:
        self.map, self.fixed, self.model = explorer, fixed, explorer.scene.model.replace(**fixed)
        self.seen: set[str] = set()
        self.births: dict[tuple[str, int], int] = {}

    def curves(self) -> list[Curve]:
        """The curves of the member."""
        return [curve for curve in self.map.curves if dict(curve.fixed) == self.fixed]

    def passing(self, entry: Entry, model: Model) -> str | None:
        """The curve that passes through an entry, if one does."""
        passes = (c.id for c in self.curves() if passes_entry(c, entry, model, self.map.kernels))
        return next(passes, None)

    def follow(self, entry: Entry, model: Model) -> str | None:
        """Return the curve through an entry, followed unless one of this member passes it already;
        None if there is none."""
        own, options, scene = self.map, self.map.options, self.map.scene
        value = entry.parameters[options.parameter]
        if (known := self.passing(entry, model)) is not None:
            return known
        name = f"c{len(own.curves) + 1}"
        shown = f"curve {name}: {entry.label} in ({scene.parameter}, {options.parameter})"
        own.progress(shown)
        wanted = {*options.values, *options.start, scene.model.values[options.parameter], value}
        callback = counting_callback(shown, options.parameter, own.progress)
        plane = options.parameter, scene.range, options.range
        try:
            curve = follow_curve(
                entry,
                model,
                *plane,
                name=name,
                values=sorted(wanted),
                settings=options.settings,
                kernels=own.pairs,
                within=CLOSE if options.areas else None,
                callback=callback,
            )
        except InputError as error:
            own.notes.append(f"no curve of {entry.id} {entry.label}: {error.found}")
            return None
        curve = dataclasses.replace(curve, fixed=self.fixed)
        problem = problem_of(model, Word(curve.word, curve.period), own.pairs)
        same = next(
            (other.id for other in self.curves() if same_curve(curve, other, problem)), None
        )
        if same is not None:
            return same
        own.curves.append(curve)
        own.end_of(curve)
        return curve.id

    # One-parameter runs: further curves, and what comes first.

    def check(self, word: Word) -> None:
        """Run at the values asked for, then half way between crossings until runs agree."""
        own, done, named = self.map, set[float](), f"{fixed_text(self.fixed, ', ')}{word}"
        wanted = {*own.options.start, self.model.values[own.options.parameter]}
        for _ in range(MOST_ROUNDS):
            for value in sorted(wanted - done):
                self.check_at(value, word)
            done |= wanted
            wanted = self.unchecked(word) - done
            if not wanted:
                break
        else:
            own.notes.append(
                f"{named}: after {MOST_ROUNDS} rounds of one-parameter runs some ranges are not "
                "checked: give more values in curves.start"
            )
        self.note_uncovered(word)

    def check_at(self, value: float, word: Word) -> None:
        """One run: start curves where none passes, and keep what it says comes first."""
        own, scene, second = self.map, self.map.scene, self.map.options.parameter
        own.progress(f"{fixed_text(self.fixed, ', ')}{word}: run at {second} = {value:.6g}")
        there = self.model.replace(**{second: value})
        low, high = scene.range
        spaced = np.geomspace if low > 0.0 else np.linspace
        searched = [scene.start, *spaced(low, high, SEARCHED + 2)[1:-1].tolist()]
        runs = run_along(scene, there, word, own.kernels, scene.range, searched)
        met = [self.start_from(run, there) for run in runs]
        own.evaluations += runs[0].problem.kernel_evaluations if runs else 0
        along, kinds = self.along(), own.options.kinds
        first = first_bifurcation([entry for one in met for entry, _ in one], kinds, along)
        orbits = [self.checked(one, along) for one in met]
        notation = word.notation(scene.model.letters)
        about = self.fixed, word.walls, word.period, notation, second, value
        own.checks.append(
            Check(*about, first.label if first else None, [o for o in orbits if o.curves])
        )

    def checked(self, met: Sequence[tuple[Entry, str | None]], along: str) -> CheckedOrbit:
        """What a run says of its orbit: the curves on which its real bifurcations lie."""
        curves: dict[str, list[float]] = {}
        for entry, curve in met:
            if curve is not None and not entry.ghost:
                curves.setdefault(curve, []).append(entry.parameters[along])
        first = first_bifurcation([entry for entry, _ in met], self.map.options.kinds, along)
        on = next((curve for entry, curve in met if entry is first and curve), "")
        return CheckedOrbit(first.label if first else "", on, curves)

    def start_from(self, run: Run, model: Model) -> list[tuple[Entry, str | None]]:
        """Follow curves from entries of a run that lie on none, and keep its branch if there are.

        Returns all its entries, and the curve on which each lies.
        """
        own = self.map
        offset, before = sum(len(branch.events) for branch in own.branches), len(own.curves)
        branch = run.branch(f"b{len(own.branches) + 1}", None, offset + 1, own.scene.events)
        met = [(e, self.follow(e, model) if own.wanted(e) else None) for e in branch.events]
        if len(own.curves) > before:
            own.branches.append(branch)
        return met

    def unchecked(self, word: Word) -> set[float]:
        """The middle of every range in which no run has seen what the curves say, if anything."""
        own = self.regions_of(word)
        low, high = self.map.options.range
        edges = sorted([low, high, *(e for region in own for e in (region.low, region.high))])
        checks = [check.value for check in self.checks_of(word)]
        return {
            0.5 * (left + right)
            for left, right in itertools.pairwise(edges)
            if right - left > NARROWEST * (high - low)
            and not any(left < value < right for value in checks)
        }

    def note_uncovered(self, word: Word) -> None:
        """Say where a run sees something that no curve does."""
        own = self.regions_of(word)
        for check in self.checks_of(word):
            covered = any(region.low <= check.value <= region.high for region in own)
            if check.first is not None and not covered:
                self.map.notes.append(
                    f"{fixed_text(self.fixed, ', ')}{check.notation}: {check.first} comes first at "
                    f"{check.second} = {check.value:.6g}, on no curve that was followed"
                )

    def checks_of(self, word: Word) -> list[Check]:
        """The runs of a word."""
        own = self.fixed, word.walls, word.period
        return [c for c in self.map.checks if (dict(c.fixed), c.word, c.period) == own]

    def regions_of(self, word: Word) -> list[Region]:
        """What the curves of a word say comes first, in order."""
        own = [c for c in self.curves() if (c.word, c.period) == (word.walls, word.period)]
        found = regions(own, self.along(), self.map.checks)
        return sorted(found, key=lambda region: region.low)

    def along(self) -> str:
        """The column that falls."""
        own = self.curves()
        return falling_column(own) if own else self.map.scene.parameter

    # Lines.

    def cover(self, word: Word) -> list[Coverage]:
        """Lay lines for a word of the scene, and say what they met."""
        own = self.map
        about = own.scene, self.model, word, own.kernels
        asked = self.curves, self.covered, self.start, self.further
        lines = Lines(*about, *asked, own.progress)
        found = lines.cover(self.fixed)
        own.evaluations += lines.evaluations
        return found

    def covered(self, entry: Entry) -> bool:
        """Whether a curve passes through an entry."""
        return self.passing(entry, self.model) is not None

    def start(self, entry: Entry) -> str:
        """Follow the curves of the branch through an entry; returns why its own is not there."""
        own = self.map
        second = own.options.parameter
        there = self.model.replace(**{second: entry.parameters[second]})
        for through in (run_through, run_with):
            run = through(own.scene, there, entry, own.kernels)
            own.evaluations += run.problem.kernel_evaluations
            self.start_from(run, there)
            if self.covered(entry):
                return ""
        return "no curve through it could be followed"

    def further(self) -> list[Entry]:
        """Start curves from points of codimension two; returns the entries they started from."""
        own = self.map
        ranges = [own.scene.range, own.options.range]
        entries = {entry.id: entry for branch in own.branches for entry in branch.events}
        started = []
        new = [(c, p) for c in self.curves() for p in c.points if p.id not in self.seen]
        self.seen |= {point.id for _, point in new}
        for curve, point in new:
            origin = entries.get(curve.origin)
            if origin is None:
                continue
            about = origin, point, self.model, own.options.kinds, own.pairs, ranges
            for entry in entries_born(*about):
                wanted = own.wanted(entry) and self.near_enough(entry, curve)
                if wanted and not self.covered(entry) and not self.start(entry):
                    started.append(entry)
        return started

    def near_enough(self, entry: Entry, curve: Curve) -> bool:
        """Whether an entry's word is born from one of the scene in as few steps as it reaches."""
        before = self.births.get((curve.word, curve.period), 0)
        own = before + ((entry.word, entry.period) != (curve.word, curve.period))
        reach = self.map.options.reach
        if own > reach:
            if not self.covered(entry):
                name = f"{entry.label} of {entry.notation}"
                what = "curves not started at points of codimension two"
                self.map.limits.reached("curves.reach", reach, what, name)
            return False
        known = self.births.setdefault((entry.word, entry.period), own)
        self.births[entry.word, entry.period] = min(known, own)
        return True


def add_map(scene: Scene, diagram: Diagram, progress: Progress | None = None) -> Diagram:
    """Return the diagram of a scene with ``curves`` with these, and with areas if the scene asks
    for them. Its branches are those of the scene's own parameter values; for a family, the branches
    of its members are added."""
    assert scene.curves is not None
    diagram = _CurveExplorer(scene, scene.curves, diagram, progress or ignore_progress).run()
    if not scene.curves.areas or diagram.statistics["failure"]:
        return diagram
    return add_areas(scene, diagram, progress)


def add_areas(scene: Scene, diagram: Diagram, progress: Progress | None = None) -> Diagram:
    """Return a diagram of curves with the areas between them, for every member of the family."""
    assert scene.curves is not None
    began = time.perf_counter()
    kernels, names, failure = Kernels(scene.model, scene.parameter), itertools.count(1), None
    areas: list[Area] = []
    notes: list[str] = []
    name, values = scene.curves.family or ("", ())
    try:
        for fixed in [{name: value} for value in values] or [{}]:
            own = [curve for curve in diagram.curves if dict(curve.fixed) == fixed]
            model = scene.model.replace(**fixed)
            divider = Divider(scene, model, own, fixed, kernels, progress or ignore_progress)
            found, told = divider.divided(names)
            areas += found
            notes += told
    except ENDING as error:
        failure = failure_of(error, diagram.branches)
    seconds = diagram.statistics["seconds"] | {"areas": time.perf_counter() - began}
    diagram = with_statistics(diagram, notes, seconds=seconds, failure=failure)
    return dataclasses.replace(diagram, areas=areas or ())
