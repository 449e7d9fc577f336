r"""G: a flight touches a wall between its impacts; beyond, it passes the wall.

The touch, as an impact of zero velocity, makes a longer word, whose Jacobian is regular there: its
null vector is the tangent of the branch that is born, which is physical on one side.

A grazing is supercritical where the orbit with one impact more exists for parameter values at which
the old one is unphysical, and subcritical where both exist together; a fold then follows on the new
branch. The slope of the new impact's velocity decides, with that of the old orbit's gap:

.. math:: \frac{dv}{d\lambda} = \frac{\dot v}{\dot\lambda}\Big|_{new}, \qquad
          \dot g \propto -\sigma\,\partial R_x \cdot \dot z\,|_{old},

both exact, from the tangents: at a touch the gap does not depend on its time, and R_x is the
position residual of the flight to the touch. Where rounding decides on the sign of the parameter's
rate, as where a flight forgets what was before it, the parameter goes with the square of the new
velocity: its second derivative along the new branch decides, and the slope is infinite.

A soft stop without a jump in force is felt with the third power of the velocity of contact only:
the parameter goes with its square, by which the flight passes the stop. The old orbit becomes the
new one, and the slope is infinite.

Where the touch begins to slide (a body on a belt sticks), the parameter goes with the square of the
velocity, too, but either way: its second derivative along the new branch decides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from ..continuation.branch import Between, Location, Point, TestFunction
from ..continuation.ends import EndKind
from ..continuation.problem import Problem
from ..models.guards import way_back
from ..models.word import Word
from ..orbits.physicality import PASSES, Verdict
from ..orbits.problem import Array, Linearisation, OrbitProblem
from ..orbits.quiet import problem_of
from ..segments.flight import Touch
from ..segments.segment import ELSEWHERE
from .arc_location import PASSING
from .codimension_two import CurvePoint, touch_points
from .event_solver import LocatedPoint
from .extended_system import (
    ExtendedSystem,
    OrbitEvent,
    OrbitPoint,
    Orbits,
    OrbitTest,
    event_on,
    located,
    places_of,
)
from .grazing_scenario import scenario_of
from .kind import (
    SUB,
    SUPER,
    Change,
    Details,
    Equations,
    Kind,
    Look,
    Scenario,
    Start,
    System,
    Values,
    null_vector_start,
    rate_error,
)
from .sliding import (
    ADDING,
    SlidingTouch,
    interrupted_sliding_start,
    is_brief,
    near_touches,
    onset_of,
    onsets_of_word,
    sliding_kind_of_touch,
    tolerated_touches,
    touch_form,
    violations,
)

AT_END = 1e-6
"""A touch nearer to its flight's end, as part of the period, is that end."""

FLAT = 1e-8
"""A parameter's rate below this part of the tangent is zero."""

SMALL = 1e-4
"""Part of the tangent below which the error of a parameter's rate is looked at; it takes second
derivatives."""

ROUNDING = 1e-14
"""Rounding of gaps as part of the distance between walls."""


class Grazing(OrbitTest):
    """The smallest interior gap of each flight and wall."""

    kind = "G"
    needs = ("gaps",)

    def __init__(self, problem: OrbitProblem) -> None:
        walls = problem.model.letters
        self.places = [(k, wall) for k in range(len(problem.segments)) for wall in walls]
        self.beginnings = onsets_of_word(problem)
        positions = problem.kernels.setup(*problem.model.values.values()).walls
        self.rounding = ROUNDING * max(abs(position) for position in positions)
        self.guides = len(problem.segments)

    def of(self, orbits: Orbits) -> Array:
        """Gaps, and where sliding begins, how far from its limits; then, to see where extrema of a
        flight are born, how nearly it turns elsewhere."""
        gaps = orbits.gaps.reshape(len(orbits.gaps), -1)
        margins = np.array([[one.margin(z) for one in self.beginnings] for z in orbits.unknowns])
        return np.concatenate([gaps, margins, orbits.slowest], axis=1)

    def guided(self, left: Array, right: Array) -> Array:
        """Flights that turn nowhere at either end of an arc may do so between."""
        own = len(self.places)
        gaps = np.vstack([left[:own], right[:own]])
        return np.all(np.isnan(gaps.reshape(2, self.guides, -1)), axis=(0, 2))

    @staticmethod
    def touch(evaluation: Linearisation, index: int) -> Touch | None:
        walls = len(evaluation.problem.model.WALLS)
        return evaluation.gaps_of(index // walls).touches[index % walls]

    def locate(
        self, problem: Problem[Linearisation], guess: OrbitPoint, index: int
    ) -> Location | None:
        if index >= len(self.places):
            return self.beginnings[index - len(self.places)].locate(guess)
        flight, wall = self.places[index]
        problem, touch = guess.evaluation.problem, self.touch(guess.evaluation, index)
        if touch is None:
            return None
        system = SlidingTouch(problem, flight, wall, touch.time)
        found = located(
            system, guess, lambda s: self._described(flight, wall, system.touch(s.own)[0])
        )
        if found is None:
            return None
        start, arrival = problem.times_around(found.unknowns, flight)
        within = start < found.details["touch_time"] < arrival
        return found if within and self.nearest(problem, found, index) else None

    def locate_on(self, arc: Between, fraction: float, index: int) -> OrbitEvent | None:
        if index >= len(self.places):
            return None
        flight, wall = self.places[index]
        form = touch_form(arc.left.evaluation.problem, flight, wall)
        if form is None:
            return None

        def details(found: LocatedPoint) -> Details:
            return {"index": index, **self._described(flight, wall, float(found.own[0]))}

        return event_on(self.kind, form, arc, fraction, details)

    def nearest(self, problem: OrbitProblem, found: Location, index: int) -> bool:
        """Whether a flight does not pass the wall where it touches it at one of several extrema."""
        here = found.evaluation
        if not isinstance(here, Linearisation):
            here = problem.evaluate(found.unknowns)
        touch = self.touch(here, index)
        return touch is None or touch.gap > -PASSING

    def enters(self, point: OrbitPoint, index: int) -> bool:
        """An extremum comes from the next flight, across an impact on another coordinate."""
        if index >= len(self.places):
            return False
        here, touch = point.evaluation, self.touch(point.evaluation, index)
        ends = here.problem.times_around(here.unknowns, self.places[index][0])
        return touch is not None and min(abs(touch.time - end) for end in ends) < AT_END * here.span

    def accept(self, event: OrbitEvent) -> bool:
        """Where the flight that begins takes no time, it is that which vanishes: a T; and so it is
        where sliding touches the limit at which it ends then. Where the impact before it is at
        rest, that vanishes: a V."""
        details, here = event.details, event.point.evaluation
        problem, flight = here.problem, event.details["flight"]
        if "impact" in details:
            begun = onset_of(problem, details)
            at_rest = begun is not None and begun.on_surface and details["impact"] in here.resting
            around = flight, (flight - 1) % len(problem.word)
            return not (at_rest or any(is_brief(problem, here.unknowns, k) for k in around))
        ends = problem.times_around(here.unknowns, flight)
        apart, impact = min(
            (abs(details["touch_time"] - end), flight + i) for i, end in enumerate(ends)
        )
        if apart > AT_END * here.span:
            return True
        return sliding_kind_of_touch(problem, details) != ADDING and not _is_slow(here, impact)

    def details(self, point: OrbitPoint, index: int) -> Details:
        if index >= len(self.places):
            told = self.beginnings[index - len(self.places)].details(point.unknowns)
            return {"index": index, **told}
        flight, wall = self.places[index]
        touch = self.touch(point.evaluation, index)
        assert touch is not None, "only a gap that exists has a zero"
        return {"index": index, **self._described(flight, wall, touch.time)}

    @staticmethod
    def _described(flight: int, wall: str, time: float) -> Details:
        return {"flight": flight, "wall": wall, "touch_time": float(time)}


class TouchLimit(TestFunction[CurvePoint]):
    """Along a curve, the touch reaches the impact at either end of its flight."""

    kind = "touch"

    def values(self, point: Point[CurvePoint]) -> Array:
        here: CurvePoint = point.evaluation
        if "impact" in here.details:
            return np.array([1.0, 1.0])
        problem, flight = here.orbit.problem, here.details["flight"]
        start, arrival = problem.times_around(here.orbit.unknowns, flight)
        if not problem.word.walls:  # an orbit without impacts has no ends
            return np.array([1.0, 1.0])
        touch = here.details["touch_time"]
        return np.array([touch - start, arrival - touch])


class G(Kind):
    """Grazing."""

    name = Grazing.kind
    changes = Change.PHYSICALITY
    finding = PASSES
    needed = ("flight", "wall", "touch_time")
    shorter_at = ("PD", "PD-G")
    look = Look("o", "#009E73", hatch="//////")

    def test(self, problem: OrbitProblem, values: Values) -> TestFunction[Linearisation]:
        return Grazing(problem)

    def equations(self, problem: OrbitProblem, details: Details) -> ExtendedSystem:
        begun = onset_of(problem, details)
        if begun is not None:
            return begun.equations()
        return SlidingTouch(problem, details["flight"], details["wall"], details["touch_time"])

    def places(self, here: Linearisation) -> list[Details]:
        return places_of(Grazing(here.problem), here)

    def in_many_digits(self, orbit: Equations, unknowns: Array, details: Details) -> System | None:
        inside = onset_of(orbit.problem, details) is None
        return orbit.grazing(unknowns, details) if inside else None

    def born(self, event: OrbitEvent) -> Start | None:
        here: Linearisation = event.point.evaluation
        problem, rows = here.problem, here.problem.impacts(here.unknowns)
        begun = onset_of(problem, event.details)
        if begun is not None:
            return begun.born(here.unknowns)
        word = word_with_touches(event)
        if word is None:
            return None
        for flight, wall, time in _last_first(touches_at(event)):
            system = SlidingTouch(problem, flight, wall, time)
            touch = system.touch(system.start(here))
            letters = _excursion(problem, flight, wall) or ""
            rows = _insert_impacts(
                rows, flight, _excursion_impacts(problem, here.unknowns, letters, touch)
            )
        longer = problem_of(problem.model, word, problem.kernels)
        unknowns = longer.with_impacts(rows, here.span, here.unknowns)
        if self.sliding(event) == ADDING:
            return interrupted_sliding_start(longer, unknowns, event.details["flight"] + 1)
        start = null_vector_start(longer, unknowns)
        return start if start is None or _new_speed(event, start) >= 0.0 else start.reversed()

    def continues(self, event: OrbitEvent) -> bool:
        """A touch of a soft stop becomes a contact."""
        model = event.point.evaluation.problem.model
        return not model.guard(event.details["wall"]).rigid

    def next_word(self, event: OrbitEvent) -> Word | None:
        begun = onset_of(event.point.evaluation.problem, event.details)
        if begun is not None:
            return begun.next_word()
        return word_with_touches(event)

    def sliding(self, event: OrbitEvent) -> str | None:
        return sliding_kind_of_touch(event.point.evaluation.problem, event.details)

    def criticality(
        self, event: OrbitEvent, before: OrbitPoint, after: OrbitPoint
    ) -> tuple[str | None, float | None]:
        start = self.born(event)
        if start is None:
            return None, None
        begun = onset_of(event.point.evaluation.problem, event.details)
        if begun is not None:
            return begun.criticality(event, start), None
        speed, rate = _new_speed(event, start), float(start.tangent[-1])
        if count_added_impacts(event) > 1 and abs(rate) < FLAT * np.max(np.abs(start.tangent)):
            return _sliding_criticality(event, start) or SUPER, None
        small = abs(rate) < SMALL * np.max(np.abs(start.tangent))
        if small and abs(rate) <= rate_error(start):
            return _bend_criticality(event, start), None
        slope = speed / rate
        old, new = _gap_slope(event), speed * rate
        if old == 0.0 or new == 0.0:
            return None, slope
        return (SUB if (old > 0.0) == (new > 0.0) else SUPER), slope

    def scenario(self, event: OrbitEvent) -> Scenario:
        return scenario_of(event, self.born(event), len(touches_at(event)))

    def verdict(self, here: Linearisation, details: Details) -> Verdict:
        own = {(details["flight"], details["wall"])}
        if "impact" not in details:
            own -= violations(here)
        touches = tolerated_touches(here) | own
        return here.judge(forgive_touches=touches, forgive_impacts=here.resting)

    def symbol(self, period: int) -> str:
        """On orbits of the period 2T, 4T, ... it is PD_G."""
        return "PD_G" if period > 1 and period & (period - 1) == 0 else self.name

    def curve_limits(self) -> Mapping[EndKind, TestFunction[CurvePoint]]:
        return {EndKind.TOUCH: TouchLimit()}

    def codimension_two(self, word: Word) -> list[TestFunction[CurvePoint]]:
        return touch_points(_since_impact, _orbit_with_touch, lambda here: here.orbit)


def _is_slow(here: Linearisation, impact: int) -> bool:
    """Whether the velocity of an impact is as small as touches at its time make it."""
    problem = here.problem
    if not problem.word.walls:
        return False
    velocity = problem.impacts(here.unknowns)[impact % len(problem.word), 1]
    return bool(abs(velocity) < AT_END * problem.scale(here.unknowns, 1.0)[1])


# Touches.


def touches_at(event: OrbitEvent) -> list[tuple[int, str, float]]:
    """Return (flight, wall, time) of every touch at a grazing, the event's own first."""
    own = (event.details["flight"], event.details["wall"], event.details["touch_time"])
    found = near_touches(event.point.evaluation)
    return [own, *((t.flight, t.wall, t.time) for t in found if (t.flight, t.wall) != own[:2])]


def _last_first(touches: list[tuple[int, str, float]]) -> list[tuple[int, str, float]]:
    """In this order, inserting one does not move the places of the others."""
    return sorted(touches, key=lambda touch: (touch[0], touch[2]), reverse=True)


def word_with_touches(event: OrbitEvent) -> Word | None:
    """Return the word of a grazing orbit with its touches counted as impacts.

    None where a touch leads to another mode, and no short way back.
    """
    problem: OrbitProblem = event.point.evaluation.problem
    word = problem.word
    for flight, wall, _ in _last_first(touches_at(event)):
        letters = _excursion(problem, flight, wall)
        if letters is None:
            return None
        word = word.insert(flight, letters)
    return word


def count_added_impacts(event: OrbitEvent) -> int:
    """Return how many impacts the event's own touch becomes."""
    details, problem = event.details, event.point.evaluation.problem
    return len(_excursion(problem, details["flight"], details["wall"]) or "")


def _excursion(problem: OrbitProblem, flight: int, wall: str) -> str | None:
    """The letters of the shortest excursion beyond a guard that is touched."""
    guards, passages = problem.model.WALLS, problem.kernels.passages
    mode = problem.model.first_mode
    if problem.word.walls:
        mode = problem.model.guard(problem.word.walls[flight]).next_mode
    touched = problem.model.letters.index(wall)
    there = [g.name for i, g in enumerate(guards) if passages.meets_at_rest(touched, i)]
    return way_back(guards, wall, mode, "".join(there))


def _excursion_impacts(
    problem: OrbitProblem, unknowns: Array, letters: str, touch: Array
) -> list[Array]:
    """The impacts of an excursion that takes no time, from the touch with which it begins.

    Behind a touch the next mode may run towards its guard, as friction does towards its limit.
    """
    kernels, values, rows = problem.kernels, problem.values(unknowns), [touch]
    for a, b in pairwise(letters):
        row = touch.copy()
        if kernels.arrival(a, b) == ELSEWHERE:
            row[1] = kernels.gap(a, b)(*rows[-1], 0.0, *values)[1]
        rows.append(row)
    return rows


def _insert_impacts(rows: Array, flight: int, added: Sequence[Array]) -> Array:
    """Impacts with others put behind the one that a flight leaves."""
    place = min(flight + 1, len(rows))
    return np.vstack([rows[:place], *added, rows[place:]])


# Slopes.


def _new_speed(event: OrbitEvent, start: Start) -> float:
    """The rate of the new impact's velocity towards its wall, along the new branch."""
    problem = start.problem
    rows = problem.impacts(start.unknowns)
    impact = int(np.argmin(np.abs(rows[:, 0] - event.details["touch_time"])))
    return _side(problem, event) * float(start.tangent[problem.m * impact + 1])


def _sliding_criticality(event: OrbitEvent, start: Start) -> str | None:
    """The criticality where the excursion ends on another surface; None where it does not."""
    problem, details = start.problem, event.details
    letters = _excursion(event.point.evaluation.problem, details["flight"], details["wall"]) or ""
    return (
        None
        if problem.kernels.arrival(*letters[:2]) != ELSEWHERE
        else _bend_criticality(event, start)
    )


def _bend_criticality(event: OrbitEvent, start: Start) -> str:
    """The criticality where the parameter rests along the new branch."""
    problem = start.problem
    jacobian = problem.evaluate(start.unknowns).jacobian
    left = np.linalg.svd(jacobian[:, : problem.n])[0][:, -1]
    bent = problem.second_along(start.unknowns, start.tangent) @ start.tangent
    bend = -float(left @ bent) / float(left @ jacobian[:, -1])
    return SUB if (_gap_slope(event) > 0.0) == (bend > 0.0) else SUPER


def _gap_slope(event: OrbitEvent) -> float:
    """The sign of the derivative of the old orbit's gap by the parameter."""
    here: Linearisation = event.point.evaluation
    along = event.point.tangent
    places = (event.details[name] for name in ("flight", "wall", "touch_time"))
    system = SlidingTouch(here.problem, *places)
    _, start, _, by_parameter = system.arrival(here, system.start(here))
    rate = float(start[0] @ along[system.left] + by_parameter[0, 0] * along[-1])
    return float(-_side(here.problem, event) * rate * along[-1])


def _side(problem: OrbitProblem, event: OrbitEvent) -> float:
    return problem.model.guard(event.details["wall"]).side


# Along curves.


def _since_impact(here: CurvePoint) -> tuple[int, float]:
    if "impact" in here.details:
        raise ArithmeticError("nothing is touched inside a flight")
    orbit, flight = here.orbit, here.details["flight"]
    start, _ = orbit.problem.times_around(orbit.unknowns, flight)
    return flight, here.details["touch_time"] - start


def _orbit_with_touch(here: CurvePoint) -> Linearisation:
    """The grazing orbit as one of the longer word."""
    if "impact" in here.details:
        raise ArithmeticError("nothing is touched inside a flight")
    orbit, problem = here.orbit, here.orbit.problem
    flight, wall = here.details["flight"], here.details["wall"]
    touch, letters = np.insert(here.own, 1, 0.0), _excursion(problem, flight, wall) or wall
    added = _excursion_impacts(problem, orbit.unknowns, letters, touch)
    longer = problem_of(problem.model, problem.word.insert(flight, letters), problem.kernels)
    rows = _insert_impacts(problem.impacts(orbit.unknowns), flight, added)
    problem.kernel_evaluations += len(longer.word)
    return longer.evaluate(longer.with_impacts(rows, orbit.span, orbit.unknowns))
