r"""Design: the stable physical orbit of which an output is largest, at a margin from its events.

In parameters p within bounds, with f the mean of an output and D_j the distance to event j,

.. math:: \max f(p) \quad\text{subject to}\quad D_j(p) \ge m,\; g_i(p) \le g_i^{max},

is solved by sequential quadratic programming in a trust region (Nocedal and Wright 2006, ch. 18) on
the orbit's manifold. All derivatives are exact: that of D_j is along the line to the nearest point
of the event's surface. Events are those known at the last iterate; where it settles, all are
searched for once more, and the iteration continues if one is too near. Multipliers of the
constraints that are active say what each costs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from ..arrays import Array
from ..errors import InputError, explain_arguments
from ..models.expressions import values_of
from ..models.guards import Word
from ..models.model import Model
from ..models.outputs import TIME, VOLTAGE, state_names
from ..orbits.orbit import Orbit
from ..orbits.outputs import largest_values, means_of, slopes_of_means
from ..orbits.problem import Linearisation, OrbitProblem
from ..orbits.quiet import problem_of
from ..orbits.search import find_orbits
from ..progress import Asked, RememberedProgress, progress_lines
from ..results.options import DesignOptions
from ..results.scene import Scene, load_scene, read_scene
from ..segments.kernels import Kernels
from ..simulation.attractor import Attractor
from ..simulation.attractor import Kind as MotionKind
from ..simulation.integrity import basin_fractions, require_starts
from ..simulation.settle import settle
from ..simulation.simulator import Simulator
from ..simulation.sweep import is_orbit
from ..storage import csv_text
from .margins import EventMargin, Margins, Search, updated_hessian
from .quadratic_program import least_quadratic

ITERATIONS, SEARCHES = 60, 8
"""Steps between two searches for events, and searches, at most."""

STEPS = 4
"""Steps at least by which the orbit is followed to the end of one."""

RADIUS, SMALLEST = 0.1, 1e-9
"""Trust region at first, and the one at which the iteration ends, in parts of the bounds."""

SETTLED = 1e-8
"""Part of the output by which a step has to raise it."""

PENALTY, LARGEST = 1.0, 1e4
"""Of a violated constraint, in parts of the output, and up to which it is raised tenfold."""

SAME = 1e-6
"""Part of the output by which those of one orbit, or of mirror images, may differ."""

KEPT = 1e-7
"""By how much less than its bound a constraint may be."""

BEYOND = 1.0
"""How much farther than the margin events are searched for, in tolerances."""

ACTIVE = 1e-5
"""By how much a constraint that holds may be slack."""

PERIODS, BATCHES, STUDENT = 400, 20, 2.093
"""Forcing periods of complex motion that are simulated at a point, ten times as many at the best;
parts whose means give the interval of 95 %, and Student's quantile for these."""

FAILING = ArithmeticError, np.linalg.LinAlgError, InputError
"""What ends one start, margin or simulation; the others are computed."""

Found = TypeVar("Found")

VANISHING = 1e-6
"""A tolerance below this part of a parameter's range is left out: it allows no change."""


@dataclass(frozen=True)
class ActiveConstraint:
    """A constraint that holds an optimum."""

    name: str
    """An event, or a bound such as ``s = 0.8``."""
    price: float
    """How much the output rises if the constraint is relaxed by one unit: of the margin, of the
    parameter or of the limited output."""

    def __str__(self) -> str:
        return f"{self.name} (price {self.price:.4g})"


@dataclass(frozen=True, eq=False)
class Optimum:
    """A local optimum of one word."""

    orbit: Orbit
    parameters: Mapping[str, float]
    """Those that were optimised."""
    value: float
    margin: float
    """The one asked for."""
    active: tuple[ActiveConstraint, ...]
    margins: Margins | None
    """All events nearby; None where no margin is asked for."""
    settled: bool
    """Whether no step to first order raises the output."""
    fraction: tuple[float, float, float] | None = None
    """Part of random starts that lead to the orbit, and its interval of 95 %."""

    @property
    def limited_by(self) -> str:
        """The constraints that hold it."""
        return ", ".join(map(str, self.active)) or "nothing"


@dataclass(frozen=True, eq=False)
class ChaoticMotion:
    """The complex motion that gives most of those that a search without gradients has met."""

    parameters: Mapping[str, float]
    notation: str
    value: float
    interval: tuple[float, float]
    """Of 95 %, from the means of parts of a simulation that the search has not used."""
    simulations: int

    def __repr__(self) -> str:
        place = ", ".join(f"{name} = {value:.6g}" for name, value in self.parameters.items())
        interval = "{:.6g} to {:.6g}".format(*self.interval)
        return f"Complex motion {self.notation}: {self.value:.6g} ({interval})  {place}"


@dataclass(frozen=True, eq=False)
class Design:
    """The answer of `contimpact.design`."""

    names: tuple[str, ...]
    output: str
    best: Optimum | None
    """None where no orbit satisfies all constraints."""
    others: tuple[Optimum, ...]
    """Further optima, the best first, those whose basin is too small among them."""
    trade_off: tuple[Optimum, ...]
    """The best for each margin asked for."""
    chaos: ChaoticMotion | None = None
    notes: tuple[str, ...] = field(default=())
    failed: tuple[str, ...] = field(default=())
    """What a numerical failure has ended, a start or a margin, and why; others are computed."""
    interrupted: str = ""
    """What was being done when the keyboard interrupted: what comes later is missing, and of a best
    found before all starts were improved there may be better ones."""

    def _lines(self, one: Optimum, head: str = "") -> list[str]:
        place = ", ".join(f"{name} = {value:.9g}" for name, value in one.parameters.items())
        text = f"{head}{self.output} = {one.value:.9g}  {one.orbit.notation}  {place}"
        if one.fraction:
            text += "  reached by {:.1%} of starts ({:.1%} to {:.1%})".format(*one.fraction)
        lines = [text, f"    limited by {one.limited_by}"]
        lines += [f"    {note}" for note in one.margins.notes] if one.margins else []
        return lines if one.settled else [*lines, "    not settled: a better one is near"]

    def table(self) -> str:
        """Return the optima as CSV: the best, others, and those of each margin."""
        head = ["is", "margin", self.output, "word", *self.names, "settled", "limited_by"]
        best = [] if self.best is None else [self.best]
        groups = {"best": best, "other": self.others, "margin": self.trade_off}
        rows = [
            (
                what,
                one.margin,
                one.value,
                str(one.orbit.word),
                *one.parameters.values(),
                one.settled,
                one.limited_by,
            )
            for what, group in groups.items()
            for one in group
        ]
        rows += [("failed", *[""] * (len(head) - 2), text) for text in self.failed]
        if self.interrupted:
            rows.append(("interrupted", *[""] * (len(head) - 2), self.interrupted))
        return csv_text(head, rows)

    def __repr__(self) -> str:
        rows = [] if self.best is None else self._lines(self.best)
        head = rows.pop(0) if rows else "No orbit satisfies the constraints"
        if self.interrupted:
            head = head if rows else "No best yet"
            head = f"Incomplete, interrupted at {self.interrupted}\n{head}"
        for one in self.others:
            rows += self._lines(one, "  other: ")
        for one in self.trade_off:
            rows += self._lines(one, f"  margin {one.margin:g}: ")
        rows += [f"failed: {text}" for text in self.failed]
        return "\n".join([head, *rows, *self.notes, *([repr(self.chaos)] if self.chaos else [])])


@explain_arguments
def design(scene: Scene | Mapping[str, Any] | str, *, progress: Asked = False) -> Design:
    """Find the stable physical orbit of which an output is largest, over several parameters.

    Parameters
    ----------
    scene : Scene, mapping or path
        With a table ``[design]``; its words are those of ``follow.orbits``.
    progress : bool or callable
        Whether to say what is computed.

    Returns
    -------
    Design
        The best of local optima from random starts, with the constraints that hold it. There may
        be better ones that no start has led to. After an interruption by the keyboard, what was
        found until then.

    Raises
    ------
    InputError
        For a scene that is not valid or has no ``[design]``.
    """
    if not isinstance(scene, Scene):
        scene = read_scene(scene) if isinstance(scene, Mapping) else load_scene(scene)
    if scene.design is None:
        raise InputError("design", "missing", "say what to maximise in a table [design]")
    with progress_lines(progress, f"design {scene.name}") as told:
        return _Designer(scene, scene.design, RememberedProgress(told)).design()


@dataclass(frozen=True, eq=False)
class _Iterate:
    """An orbit with all that a step needs of it, in parts of the bounds."""

    here: Linearisation
    value: float
    slope: Array
    events: Mapping[tuple[Any, ...], EventMargin]
    names: tuple[str, ...]
    slack: Array
    """By how much constraints are satisfied, shape (c,); the margins' in tolerances, those of
    limits in parts of the limit."""
    slack_slopes: Array
    units: Array
    """Of the constraints in units of the user's."""


class _Designer:
    """The search for one scene's design."""

    def __init__(self, scene: Scene, asked: DesignOptions, tell: RememberedProgress) -> None:
        self.scene, self.asked, self.tell = scene, asked, tell
        self.names = tuple(asked.bounds)
        self.low, high = np.array(list(asked.bounds.values())).T
        self.spans = high - self.low
        outputs = {output.name: output for output in scene.outputs}
        self.output = outputs[asked.maximise]
        self.limits = {outputs[name]: most for name, most in asked.limits.items()}
        self.known: dict[tuple[str, ...], Kernels] = {}
        self.rng = np.random.default_rng(scene.seed)
        self.notes, self.failed = list[str](), list[str]()
        self.box = scene.simulate.box if scene.simulate else None
        if asked.fraction:
            require_starts(Simulator(scene.model), self.box)

    def design(self) -> Design:
        """Optimise each word from the best random starts, then at each margin."""
        found, curve = list[Optimum](), list[Optimum]()
        chosen, chaos, interrupted = None, None, ""
        try:
            self.improve(found)
            found.sort(key=lambda one: -one.value)
            chosen = self.first_reached(found)
            curve.extend(self.curve(found) if found else [])
            chaos = self.attempt("complex motion", self.chaotic) if self.asked.chaos else None
        except KeyboardInterrupt:
            interrupted = self.tell.last or "the beginning"
            found.sort(key=lambda one: -one.value)
            if chosen is None and found and not self.asked.fraction:
                chosen = 0
        best = None if chosen is None else found.pop(chosen)
        return Design(
            self.names,
            self.output.name,
            best,
            tuple(found),
            tuple(curve),
            chaos,
            tuple(self.notes),
            tuple(self.failed),
            interrupted,
        )

    def attempt(self, what: str, compute: Callable[[], Found]) -> Found | None:
        """What a computation finds; None where it fails, which `failed` then says."""
        try:
            return compute()
        except FAILING as error:
            self.failed.append(f"{what}: {type(error).__name__}: {error}")
            return None

    def improve(self, found: list[Optimum]) -> None:
        """Add each word's optima from the best random starts; note words without any."""
        for word in self.scene.orbits:
            starts = sorted(self.starts(word), key=lambda start: -start[0])
            name = word.notation(self.scene.model.letters)
            if not starts:
                self.notes.append(f"no stable physical {name} at {self.asked.starts} random points")
            for number, (_, here) in enumerate(starts[: self.asked.restarts], 1):
                start = f"{name}, start {number}"
                self.tell(start)
                one = self.attempt(start, partial(self.optimum, here, self.asked.margin, start))
                if one is not None and not any(self.same(one, other) for other in found):
                    found.append(one)

    def starts(self, word: Word) -> Iterator[tuple[float, Linearisation]]:
        """Stable physical orbits at random points within the bounds, with their values."""
        for number in range(1, self.asked.starts + 1):
            what = f"orbits of {word} at random point {number}"
            self.tell(what)
            point = self.low + self.spans * self.rng.uniform(size=len(self.names))
            found = self.attempt(what, partial(self.orbits_at, word, point))
            yield from found or ()

    def orbits_at(self, word: Word, point: Array) -> list[tuple[float, Linearisation]]:
        """Stable physical orbits at a point within the bounds, with their values."""
        model = self.scene.model.replace(**dict(zip(self.names, point.tolist(), strict=True)))
        problem = self.problem(model, word)
        each = [
            problem.evaluate(np.append(orbit.unknowns[: problem.n], point))
            for orbit in find_orbits(model, word, starts=64, rounds=2, rng=self.rng)
            if orbit.stable and orbit.physical
        ]
        return [(means_of(here, [self.output], model)[0].value, here) for here in each]

    def problem(self, model: Model, word: Word) -> OrbitProblem:
        """The orbits of a word in the design's parameters."""
        return problem_of(model, word, self.kernels(self.names))

    def kernels(self, names: Iterable[str]) -> Kernels:
        """Kernels with some free parameters; those of a model serve it at all its values."""
        names = tuple(names)
        if names not in self.known:
            self.known[names] = Kernels(self.scene.model, *names)
        return self.known[names]

    def margins(self, here: Linearisation, within: float) -> Search:
        """The search for the events near an orbit."""
        tolerances, orbit = self.tolerances(here), Orbit(here.problem, here)
        return Search(orbit, tolerances, within, self.kernels(tolerances))

    def same(self, one: Optimum, other: Optimum) -> bool:
        """Whether two optima are one to what is printed."""
        apart = [abs(one.orbit[name] - other.orbit[name]) for name in self.names]
        same = one.orbit.notation == other.orbit.notation
        same = same and bool(np.isclose(one.value, other.value, rtol=SAME, atol=0.0))
        return same and bool(np.all(np.array(apart) < 1e-4 * self.spans))

    def first_reached(self, found: list[Optimum]) -> int | None:
        """The first optimum that enough random starts lead to; each looked at has its fraction."""
        if not self.asked.fraction:
            return 0 if found else None
        for number, one in enumerate(found):
            what = f"basin of {one.orbit.notation} at {self.output.name} = {one.value:.9g}"
            self.tell(what)
            fraction = one.fraction or self.attempt(what, partial(self.fraction, one))
            found[number] = replace(one, fraction=fraction)
            if fraction is not None and fraction[0] >= self.asked.fraction:
                return number
        return None

    def curve(self, found: Sequence[Optimum]) -> Iterator[Optimum]:
        """The best optimum for each margin, from those at the margin asked for."""
        for margin in self.asked.margins:
            what = f"margin {margin:g}"
            self.tell(what)
            each: list[Optimum | None] = list(found)
            if margin != self.asked.margin:
                each = [self.attempt(what, partial(self.again, one, margin)) for one in found]
            kept = sorted((one for one in each if one is not None), key=lambda one: -one.value)
            chosen = self.first_reached(kept)
            if chosen is not None:
                yield kept[chosen]
            else:
                self.notes.append(f"{what}: no orbit that was found satisfies the constraints")

    def again(self, one: Optimum, margin: float) -> Optimum | None:
        """The optimum at another margin that one leads to."""
        problem = self.problem(one.orbit.model, one.orbit.word)
        values = [one.orbit[name] for name in self.names]
        here = problem.evaluate(np.append(one.orbit.unknowns[: problem.n], values))
        return self.optimum(here, margin, f"margin {margin:g}, from {one.orbit.notation}")

    def fraction(self, one: Optimum) -> tuple[float, float, float]:
        """The part of random starts that lead to an optimum's orbit, or to its mirror image if this
        gives the same output, and its interval."""
        name, orbit = self.names[0], one.orbit
        starts = self.asked.fraction_starts
        found = basin_fractions(
            orbit.model, name, [orbit[name]], starts=starts, box=self.box, rng=self.scene.seed
        )
        if found.interrupted:
            raise KeyboardInterrupt
        wanted = [k for k, there in found.attractors[0].items() if self.is_twin(there, one)]
        each = np.sum(found.counts[:, wanted], axis=1, keepdims=True)
        both = replace(found, counts=each)
        low, high = both.intervals
        return float(both.fractions[0, 0]), float(low[0, 0]), float(high[0, 0])

    def is_twin(self, attractor: Attractor, one: Optimum) -> bool:
        """Whether an attractor is an optimum's orbit, or has its speeds and its output."""
        orbit = one.orbit
        if attractor.kind is not MotionKind.PERIODIC or attractor.period != orbit.word.period:
            return False
        if is_orbit(attractor, orbit.word, orbit.problem.impacts(orbit.unknowns)):
            return True
        speeds, there = np.sort(np.abs(orbit.velocities)), np.sort(np.abs(attractor.velocities))
        if len(there) != len(speeds) or not np.allclose(there, speeds, rtol=1e-4):
            return False
        twin = attractor.orbit(orbit.model, orbit.parameter)
        value = means_of(twin.linearisation, [self.output], twin.model)[0].value
        return bool(np.isclose(value, one.value, rtol=SAME, atol=0.0))

    # A local optimum.

    def optimum(self, here: Linearisation, margin: float, start: str) -> Optimum | None:
        """The local optimum that an orbit leads to; None, with a note that names the start, if it
        violates a constraint."""
        events: dict[tuple[Any, ...], EventMargin] = {}
        margins, settled = None, False
        for _ in range(SEARCHES):
            if margin:
                margins = self.margins(here, margin + BEYOND).margins()
                events |= {event.place: event for event in margins.events}
            at = self.iterate(here, events, margin)
            if settled and np.min(at.slack, initial=0.0) >= -KEPT:
                break
            at, settled = self.climb(at, margin)
            here, events = at.here, dict(at.events)
            if not margin:
                break
        else:
            settled = False  # events may be nearer than those of the last search
        if np.min(at.slack, initial=0.0) < -KEPT:
            worst = int(np.argmin(at.slack))
            short = -at.slack[worst] * at.units[worst]
            self.notes.append(
                f"{start}: it ends where {at.names[worst]} is violated by {short:.3g}"
            )
            return None
        digits = np.round(self.parts(here), 12)  # a bound reached but for rounding is reached
        place = dict(zip(self.names, (self.low + digits * self.spans).tolist(), strict=True))
        return Optimum(self.orbit(here), place, at.value, margin, self.active(at), margins, settled)

    def orbit(self, here: Linearisation) -> Orbit:
        """The orbit with the scene's parameter free alone, as others expect it."""
        name, n = self.scene.parameter, here.problem.n
        model = here.problem.model_at(here.unknowns)
        problem = problem_of(model, here.problem.word, self.kernels([name]))
        return Orbit(problem, problem.evaluate(np.append(here.unknowns[:n], model.values[name])))

    def tolerances(self, here: Linearisation) -> dict[str, float]:
        """The tolerances at an orbit's parameters; those that allow no change are left out."""
        values = here.problem.model_at(here.unknowns).values
        sizes = dict(zip(self.names, self.spans.tolist(), strict=True))
        found = {name: t.at(values[name]) for name, t in self.asked.tolerances.items()}
        return {n: w for n, w in found.items() if w > VANISHING * sizes.get(n, 0.0)}

    def iterate(
        self, here: Linearisation, events: Mapping[tuple[Any, ...], EventMargin], margin: float
    ) -> _Iterate:
        """What a step needs of an orbit; the events are those nearest to it."""
        model = here.problem.model_at(here.unknowns)
        value = means_of(here, [self.output], model)[0].value
        slope = slopes_of_means(here, [self.output], model)[0] * self.spans
        names, slack, slopes, units = list[str](), list[float](), list[Array](), list[float]()
        for event in events.values():
            names.append(event.label)
            slack.append(event.distance - margin)
            slopes.append(self.moved_distance(event, model) * self.spans)
            units.append(1.0)
        for output, most in self.limits.items():
            unit = abs(most) or 1.0
            for at, by in zip(*largest_values(here, output, model), strict=True):
                names.append(f"{output.name} = {most:g}")
                slack.append((most - float(at)) / unit)
                slopes.append(-by * self.spans / unit)
                units.append(unit)
        by_point = np.array(slopes).reshape(-1, len(self.names))
        return _Iterate(
            here,
            value,
            slope,
            dict(events),
            tuple(names),
            np.array(slack),
            by_point,
            np.array(units),
        )

    def moved_distance(self, event: EventMargin, model: Model) -> Array:
        """How an event's distance moves with the parameters, tolerances included."""
        found = [event.sensitivity(name) for name in self.names]
        for k, name in enumerate(self.names):
            if name in event.direction:
                width = event.tolerances[name]
                growth = self.asked.tolerances[name].slope(model.values[name])
                found[k] -= event.distance * event.direction[name] ** 2 / width * growth
        return np.array(found)

    def climb(self, at: _Iterate, margin: float) -> tuple[_Iterate, bool]:
        """Raise the output step by step; return where it ends, and whether it has settled."""
        size, radius = abs(at.value) or 1.0, RADIUS
        penalty = max(PENALTY, 2.0 * float(np.max(self.prices(at)[0], initial=0.0)) / size)
        hessian = unbent = np.eye(len(self.names))
        learnt = False  # whether the step, or its length, comes from what earlier steps have shown
        for _ in range(ITERATIONS):
            step, gain = self.step(at, hessian, radius, size, penalty)
            if gain < SETTLED:
                if self.step(at, unbent, RADIUS, size, penalty)[1] >= SETTLED:
                    if not learnt:
                        return at, False
                    hessian, radius, learnt = unbent, RADIUS, False  # learnt elsewhere
                elif np.min(at.slack, initial=0.0) >= -KEPT or penalty >= LARGEST:
                    return at, True
                else:
                    penalty *= 10.0
                continue
            there = self.moved(at, step, margin)
            risen = -np.inf
            if there is not None:
                risen = _merit(there, size, penalty) - _merit(at, size, penalty)
            if there is None or not risen > 0.1 * gain:
                radius = 0.25 * float(np.max(np.abs(step)))
                if radius < SMALLEST:
                    return at, False
                continue
            learnt = True
            if risen > 0.75 * gain and np.max(np.abs(step)) > 0.9 * radius:
                radius = min(2.0 * radius, 0.5)
            hessian = self.bent(hessian, at, there, step, size)
            at = there
        return at, False

    def bent(
        self, hessian: Array, at: _Iterate, there: _Iterate, step: Array, size: float
    ) -> Array:
        """The Hessian after a step; at first where other events constrain."""
        if there.names != at.names:
            return np.eye(len(self.names))
        prices = self.prices(there)[0] / size
        downhill = [-x.slope / size - prices @ x.slack_slopes for x in (at, there)]
        return updated_hessian(hessian, step, downhill[1] - downhill[0])

    def step(
        self, at: _Iterate, hessian: Array, radius: float, size: float, penalty: float
    ) -> tuple[Array, float]:
        """The step that raises the output most to second order, and by how much, penalties for
        violated constraints included."""
        points = self.parts(at.here)
        low, high = np.maximum(-radius, -points), np.minimum(radius, 1.0 - points)
        box = np.minimum(low, 0.0), np.maximum(high, 0.0)
        constraints = at.slack, at.slack_slopes
        step, cost = least_quadratic(-at.slope / size, hessian, penalty, constraints, box)
        return step, penalty * float(np.sum(np.maximum(0.0, -at.slack))) - cost

    def parts(self, here: Linearisation) -> Array:
        """The parameters, as parts of the ranges within their bounds."""
        return (here.unknowns[here.problem.n :] - self.low) / self.spans

    def moved(self, at: _Iterate, step: Array, margin: float) -> _Iterate | None:
        """The orbit after a step, and the events near it; None if either is lost."""
        here = at.here
        spans = dict(zip(self.names, self.spans.tolist(), strict=True))
        search = Search(Orbit(here.problem, here), spans, np.inf, self.kernels(spans))
        if search.lost_on(step, steps=STEPS) is not None:
            return None
        model = here.problem.model_at(search.end.unknowns)
        problem = self.problem(model, here.problem.word)
        there = problem.evaluate(search.end.unknowns)
        events = {}
        if at.events:
            near = self.margins(there, np.inf)
            for place, event in at.events.items():
                found = near.again(event)
                if found is None:  # it may be none there, as a branch point without the symmetry
                    near = self.margins(there, margin + BEYOND)
                    events = {event.place: event for event in near.margins().events}
                    break
                events[place] = found
        return self.iterate(there, events, margin)

    def prices(self, at: _Iterate) -> tuple[Array, Array]:
        """Multipliers of the constraints and of the bounds, below and above; by least squares,
        those of constraints that do not hold zero."""
        from scipy.optimize import nnls

        parts, identity = self.parts(at.here), np.eye(len(self.names))
        rows = np.vstack([at.slack_slopes, identity, -identity])
        slack = np.concatenate([at.slack, parts, 1.0 - parts])
        near = np.nonzero(slack < ACTIVE)[0]
        found = np.zeros(len(slack))
        size = float(np.max(np.abs(at.slope))) or 1.0
        if len(near):
            found[near] = nnls(-rows[near].T, at.slope / size)[0] * size
        return found[: len(at.slack)], found[len(at.slack) :]

    def active(self, at: _Iterate) -> tuple[ActiveConstraint, ...]:
        """The constraints that hold an optimum, with their prices."""
        prices, bounds = self.prices(at)
        found = [
            ActiveConstraint(name, float(price / unit))
            for name, price, unit in zip(at.names, prices, at.units, strict=True)
        ]
        ends = np.concatenate([self.low, self.low + self.spans])
        for k, (end, price) in enumerate(zip(ends.tolist(), bounds.tolist(), strict=True)):
            name, span = self.names[k % len(self.names)], self.spans[k % len(self.names)]
            found.append(ActiveConstraint(f"bound {name} = {end:.6g}", float(price / span)))
        least = SETTLED * (float(np.max(np.abs(at.slope))) or 1.0)
        kept = zip(found, [*prices, *bounds], strict=True)
        return tuple(one for one, price in kept if price > least)

    # Complex motion.

    def chaotic(self) -> ChaoticMotion | None:
        """The complex motion that gives most, by differential evolution."""
        from scipy.optimize import differential_evolution

        def cost(point: Array) -> float:
            where = ", ".join(f"{n} = {v:.6g}" for n, v in zip(self.names, point, strict=True))
            motion = partial(self.of_motion, point, PERIODS)
            there = self.attempt(f"motion at {where}", motion)
            return np.inf if there is None else -there[0]

        population = max(4, 5 * len(self.names))
        found = differential_evolution(
            cost,
            [*zip(self.low, self.low + self.spans, strict=True)],
            popsize=5,
            maxiter=max(1, self.asked.chaos // population - 1),
            rng=self.rng,
            polish=False,
        )
        if not np.isfinite(found.fun):
            self.notes.append(f"no complex motion in {found.nfev} simulations")
            return None
        value, off, notation = self.of_motion(found.x, 10 * PERIODS)
        place = dict(zip(self.names, found.x.tolist(), strict=True))
        return ChaoticMotion(place, notation, value, (value - off, value + off), found.nfev)

    def of_motion(self, point: Array, periods: int) -> tuple[float, float, str]:
        """The output on complex motion, half its interval, and what it is called."""
        model = self.scene.model.replace(**dict(zip(self.names, point.tolist(), strict=True)))
        simulator = Simulator(model)
        attractor = settle(simulator)
        if attractor.kind is not MotionKind.COMPLEX or attractor.state is None:
            return -np.inf, 0.0, ""
        run = simulator.run(attractor.state, periods=periods)
        hits = ~run.released
        setup = dict(zip(model.letters, simulator.positions, strict=True))
        names = state_names(model, model.first_mode)
        x = np.array(list(setup.values()))[run.walls[hits]]
        known: dict[str, Any] = {names[0]: x, names[1]: run.velocities[hits], TIME: run.times[hits]}
        known |= model.parameters
        if self.output.harvester is not None:
            speed = self.output.harvester.scale(known) * known[names[1]]
            known[VOLTAGE] = self.output.harvester.voltage(speed)
        used = {name: known[name] for name in self.output.variables(model)}
        values = np.broadcast_to(values_of(self.output.expression, self.output.name, used), x.shape)
        if self.output.per_time:
            turns = run.turns[hits] - run.turns[0]
            sums = np.bincount(turns * BATCHES // periods, values, BATCHES)[:BATCHES]
            means = sums * BATCHES / (periods * simulator.period)
        else:
            means = np.array([part.mean() for part in np.array_split(values, BATCHES)])
        half = STUDENT * float(means.std(ddof=1)) / np.sqrt(BATCHES)
        return float(means.mean()), half, attractor.notation


def _merit(at: _Iterate, size: float, penalty: float) -> float:
    return at.value / size - penalty * float(np.sum(np.maximum(0.0, -at.slack)))
