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

import contextlib
import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import cast

import numpy as np

from ..continuation.branch import Between, EndKind, Location, Point, Problem, TestFunction
from ..errors import InputError
from ..models.guards import Guard, Word, is_path, way_back
from ..orbits.problem import Array, Linearisation, OrbitProblem
from ..orbits.quiet import problem_of
from ..orbits.status import PASSES, Verdict, count_unstable
from ..segments.flight import Touch
from ..segments.segment import ELSEWHERE
from .at_rest import Curve, solve_touch_at_impact
from .codimension_two import CurveTest, touch_points
from .event_solver import LocatedPoint
from .extended_system import (
    ExtendedSystem,
    OrbitEvent,
    OrbitPoint,
    Orbits,
    OrbitTest,
    TouchingFlight,
    event_on,
    located,
    touch_form,
)
from .kind import (
    SUB,
    SUPER,
    Change,
    CurvePoint,
    Details,
    Equations,
    Kind,
    Look,
    Scenario,
    Start,
    System,
    Values,
    Window,
    declared,
    null_vector_start,
    rate_error,
)
from .scalar_systems import PASSING
from .sliding import (
    ADDING,
    TOUCHING,
    RestingStart,
    SlidingOnset,
    interrupted_sliding_start,
    is_brief,
    is_same_orbit,
    is_sliding,
    near_touches,
    onset_of,
    onsets_of_word,
    resting_starts,
    sliding_kind_of_touch,
    tolerated_touches,
    violations,
)

AT_END = 1e-5
"""A touch nearer to its flight's end, as part of the period, is that end: an impact that runs the
wrong way is as deep as its velocity squared, which is rounding where that is a millionth."""

BORN = 1e-11
"""Two extrema are born where the flight turns slower than this part of its speeds without an
acceleration: as a bracket closes in on it, that is rounding."""

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
        self.resting = resting_starts(problem)
        self.beginnings: list[SlidingOnset | RestingStart] = [
            *onsets_of_word(problem),
            *self.resting,
        ]
        self.left = [self.places.index((one.impact, one.wall)) for one in self.resting]
        positions = problem.kernels.setup(*problem.model.values.values()).walls
        self.rounding = ROUNDING * max(abs(position) for position in positions)
        self.guides = len(problem.segments)

    def of(self, orbits: Orbits) -> Array:
        """Gaps, and where sliding begins, how far from its limits; then, to see where extrema of a
        flight are born, how nearly it turns elsewhere.

        A flight that begins beyond its wall from rest has a negative gap to it, which has no zero
        until the acceleration vanishes with which it begins: not a number.
        """
        gaps = orbits.gaps.reshape(len(orbits.gaps), -1)
        margins = np.array([[one.margin(z) for one in self.beginnings] for z in orbits.unknowns])
        if self.resting:
            gaps = gaps.copy()
            beyond = margins[:, -len(self.resting) :] <= 0.0
            gaps[:, self.left] = np.where(beyond, np.nan, gaps[:, self.left])
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
        system = TouchingFlight(problem, flight, wall, touch.time)
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
        """An extremum comes from the next flight, across an impact on another coordinate; or two
        are born beyond the wall, where the flight is on either side of the point; or the flight
        leaves or reaches the wall at rest: on one side of the point it does so the wrong way, and
        how far it goes beyond is told by that."""
        if index >= len(self.places):
            return False
        here, touch = point.evaluation, self.touch(point.evaluation, index)
        if touch is None:
            return False
        flight, problem = self.places[index][0], here.problem
        ends = problem.times_around(here.unknowns, flight)
        if min(abs(touch.time - end) for end in ends) < AT_END * here.span:
            return True
        speeds = problem.scale(here.unknowns, 1.0)[1 : problem.n : problem.m]
        rates = _rates_at_ends(here, flight, self.places[index][1])
        if any(abs(rate) < AT_END * np.max(speeds) for rate in rates):
            return True
        born = abs(here.gaps_of(flight).slowest) < BORN * np.max(speeds, initial=0.0)
        return bool(born and touch.gap < -self.rounding)

    def accept(self, event: OrbitEvent) -> bool:
        """Where the flight that begins takes no time, it is that which vanishes: a T; and so it is
        where sliding touches the limit at which it ends then. Where an impact beside the touch is
        at rest, or the one beyond it after a flight that takes no time, that vanishes: a V."""
        details, here = event.details, event.point.evaluation
        problem, flight = here.problem, event.details["flight"]
        around = flight, (flight - 1) % max(len(problem.word), 1)
        if "impact" in details:
            begun = onset_of(problem, details)
            at_rest = begun is not None and begun.on_surface and details["impact"] in here.resting
            beside = {*around, details["impact"]}
            return not (at_rest or any(is_brief(problem, here.unknowns, k) for k in beside))
        from_rest = details["index"] >= len(self.places)
        if from_rest and any(is_brief(problem, here.unknowns, k) for k in around):
            return False
        ends = problem.times_around(here.unknowns, flight)
        apart, way = min((abs(details["touch_time"] - end), i) for i, end in enumerate(ends))
        if apart > AT_END * here.span:
            return True
        slow = _is_slow(here, flight + way)
        if problem.word.walls:
            start, end = problem.times_around(
                here.unknowns, (flight + 2 * way - 1) % len(problem.word)
            )
            brief = abs(end - start) < AT_END * here.span
            slow |= brief and _is_slow(here, flight + 3 * way - 1)
        return sliding_kind_of_touch(problem, details) != ADDING and not slow

    def details(self, point: OrbitPoint, index: int) -> Details:
        if index >= len(self.places):
            told = self.beginnings[index - len(self.places)].details(point.unknowns)
            return {"index": index, **told}
        flight, wall = self.places[index]
        touch = self.touch(point.evaluation, index)
        assert touch is not None, "only a gap that exists has a zero"
        return {"index": index, **self._described(flight, wall, touch.time)}

    def place_on_orbit(self, index: int) -> str:
        if index >= len(self.places):
            return ""
        flight, wall = self.places[index]
        return f"flight {flight + 1} at {wall}"

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

    def locate(
        self, problem: Problem[CurvePoint], guess: Point[CurvePoint], index: int
    ) -> Location | None:
        return solve_touch_at_impact(cast(Curve, problem), guess.evaluation, bool(index))


class TangentBeginning(CurveTest):
    """Along a curve of motion that begins on a limit of its mode, it is tangent to the limit."""

    kind = "DG"
    changes = "the motion begins on its limit with zero rate: beyond, it leaves to the other side"

    def of(self, here: CurvePoint) -> float:
        begun = onset_of(here.orbit.problem, here.details)
        return math.nan if begun is None else begun.tangency(here.orbit.unknowns)


@declared(place=5, born=True, curves=True)
class G(Kind):
    """Grazing."""

    name = Grazing.kind
    changes = Change.PHYSICALITY
    finding = PASSES
    needed = ("flight", "wall", "touch_time")
    shorter_at = ("PD-G",)
    look = Look("o", "#009E73", hatch="//////")

    def test(self, problem: OrbitProblem, values: Values) -> TestFunction[Linearisation]:
        return Grazing(problem)

    def equations(self, problem: OrbitProblem, details: Details) -> ExtendedSystem:
        begun = onset_of(problem, details)
        if begun is not None:
            return begun.equations()
        return TouchingFlight(problem, details["flight"], details["wall"], details["touch_time"])

    def in_many_digits(self, orbit: Equations, unknowns: Array, details: Details) -> System | None:
        begun = onset_of(orbit.problem, details)
        if begun is None:
            return orbit.grazing(unknowns, details)
        place = details["impact"], details["wall"]
        return orbit.leaving_without_rate(*place) if begun.on_surface else None

    def born(self, event: OrbitEvent) -> Start | None:
        here: Linearisation = event.point.evaluation
        begun = onset_of(here.problem, event.details)
        if begun is not None:
            return begun.born(here.unknowns)
        there = _orbit_with_touches(event)
        if there is None or not is_same_orbit(there):
            return None
        longer, unknowns = there.problem, there.unknowns
        if self.sliding(event) == ADDING:
            return interrupted_sliding_start(longer, unknowns, event.details["flight"] + 1)
        start = null_vector_start(longer, unknowns)
        if start is None:
            return contacts_start(longer, unknowns, [touch[1:] for touch in touches_at(event)])
        return start if _new_speed(event, start) >= 0.0 else start.reversed()

    def continues(self, event: OrbitEvent) -> bool:
        """A touch of a soft stop becomes a contact."""
        model = event.point.evaluation.problem.model
        return not model.guard(event.details["wall"]).rigid

    def next_word(self, event: OrbitEvent) -> Word | None:
        begun = onset_of(event.point.evaluation.problem, event.details)
        if begun is not None:
            return begun.next_word()
        there = _orbit_with_touches(event)
        return None if there is None or not is_same_orbit(there) else there.problem.word

    def nothing(self, event: OrbitEvent) -> str:
        begun = onset_of(event.point.evaluation.problem, event.details)
        there = None if begun is not None else _orbit_with_touches(event)
        if there is None or is_same_orbit(there):
            return super().nothing(event)
        return "nothing starts there: what a touch changes does not vanish with its velocity"

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
        letters = _own_excursion(event)
        if len(letters) > 1 and abs(rate) < FLAT * np.max(np.abs(start.tangent)):
            elsewhere = start.problem.kernels.arrival(*letters[:2]) == ELSEWHERE
            return _bend_criticality(event, start) if elsewhere else SUPER, None
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
        touches = touch_points(_since_impact, _orbit_with_touch, lambda here: here.orbit)
        return [*touches, TangentBeginning()]


def _is_slow(here: Linearisation, impact: int) -> bool:
    """Whether the velocity of an impact is as small as touches at its time make it."""
    problem = here.problem
    if not problem.word.walls:
        return False
    impact %= len(problem.word)
    velocity = problem.impacts(here.unknowns)[impact, 1]
    size = problem.scale(here.unknowns, 1.0)[problem.m * impact + 1]
    return bool(abs(velocity) < AT_END * size)


def _rates_at_ends(here: Linearisation, flight: int, wall: str) -> list[float]:
    """Return the rates of a wall's gap coordinate at those ends of a flight that are on it."""
    problem, walls = here.problem, here.problem.word.walls
    if not walls:
        return []
    guards, size = problem.model.guard, problem.model.DEGREES_OF_FREEDOM
    left, reached = walls[flight], walls[(flight + 1) % len(walls)]
    row, impacts = guards(wall).row(size), problem.impacts(here.unknowns)
    rates = []
    if guards(left).row(size) == row:
        gap, values = problem.kernels.gap(left, wall), problem.values(here.unknowns)
        rates.append(float(gap(*impacts[flight].tolist(), 0.0, *values)[1]))
    if guards(reached).row(size) == row:
        rates.append(float(impacts[(flight + 1) % len(walls), 1]))
    return rates


# Touches.


def touches_at(event: OrbitEvent) -> list[tuple[int, str, float]]:
    """Return (flight, wall, time) of every touch at a grazing, the event's own first."""
    own = (event.details["flight"], event.details["wall"], event.details["touch_time"])
    found = near_touches(event.point.evaluation)
    return [own, *((t.flight, t.wall, t.time) for t in found if (t.flight, t.wall) != own[:2])]


def _last_first(touches: list[tuple[int, str, float]]) -> list[tuple[int, str, float]]:
    """In this order, inserting one does not move the places of the others."""
    return sorted(touches, key=lambda touch: (touch[0], touch[2]), reverse=True)


def _orbit_with_touches(event: OrbitEvent) -> Linearisation | None:
    """Return the orbit as one of the word with its touches counted as impacts, which it is none of
    where a touch is a jump.

    None where a touch leads to another mode, and no short way back, or to one whose laws have no
    series on the guard.
    """
    here: Linearisation = event.point.evaluation
    problem, word, rows = here.problem, here.problem.word, here.problem.impacts(here.unknowns)
    for flight, wall, time in _last_first(touches_at(event)):
        touch = _touch_as_impact(here, flight, wall, time)
        letters = _excursion(here, flight, wall, touch)
        if letters is None:
            return None
        word = word.insert(flight, letters)
        added = _excursion_impacts(problem, here.unknowns, letters, touch)
        rows = _insert_impacts(rows, flight, added)
    longer = problem_of(problem.model, word, problem.kernels)
    try:
        return longer.evaluate(longer.with_impacts(rows, here.span, here.unknowns))
    except ArithmeticError:
        return None


def _own_excursion(event: OrbitEvent) -> str:
    """The impacts that the event's own touch becomes."""
    here = event.point.evaluation
    flight, wall, time = (event.details[name] for name in G.needed)
    return _excursion(here, flight, wall, _touch_as_impact(here, flight, wall, time)) or ""


def _touch_as_impact(here: Linearisation, flight: int, wall: str, time: float) -> Array:
    system = TouchingFlight(here.problem, flight, wall, time)
    return system.touch(system.start(here))


def _excursion(here: Linearisation, flight: int, wall: str, touch: Array) -> str | None:
    """The letters of the shortest excursion beyond a guard that is touched.

    It may end at once because the touch is on the surface of the next guard, too: so it is where
    that is a limit of sliding, at which the field outside is tangent.
    """
    problem = here.problem
    guards, passages = problem.model.WALLS, problem.kernels.passages
    mode = problem.model.first_mode
    if problem.word.walls:
        mode = problem.model.guard(problem.word.walls[flight]).next_mode
    touched = problem.model.letters.index(wall)
    begun, least = problem.model.guard(wall).next_mode, TOUCHING * problem.size_of_gaps(here)
    values = problem.values(here.unknowns)
    given, places = (*touch.tolist(), 0.0, *values), problem.kernels.setup(*values).walls

    def meets(i: int, guard: Guard) -> bool:
        return passages.meets_at_rest(touched, i) or (
            begun in guard.modes
            and is_sliding(problem.model, begun)
            and abs(problem.kernels.gap(wall, guard.name)(*given)[0] - places[i]) < least
        )

    there = [guard.name for i, guard in enumerate(guards) if meets(i, guard)]
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
        if len(row) > 2:  # the other coordinates of the next guard, of which equations are linear
            found = kernels.segment(a, b).blocks(rows[-1].tolist(), row.tolist(), values)
            residual, by_end = np.array(found[0]), np.array(found[2]).reshape(len(row), -1)
            row[2:] -= np.linalg.lstsq(by_end[:, 2:], residual)[0]
        rows.append(row)
    return rows


def _insert_impacts(rows: Array, flight: int, added: Sequence[Array]) -> Array:
    """Impacts with others put behind the one that a flight leaves."""
    place = min(flight + 1, len(rows))
    return np.vstack([rows[:place], *added, rows[place:]])


SINGULAR = 1e-10
"""Singular values of a Jacobian below this part of the largest are zero."""


def contacts_start(
    problem: OrbitProblem, unknowns: Array, touches: Sequence[tuple[str, float]]
) -> Start | None:
    """Return the start where several contacts begin at once, as a symmetry makes them.

    At a soft stop the square of a contact's velocity goes with the parameter. Each touch adds a
    direction to the Jacobian's kernel, along which the parameter rests; to second order the squares
    of their velocities have a fixed ratio. None where these squares have different signs, as no
    orbit has all of the contacts then, and where the kernel is another one.
    """
    here, count = problem.evaluate(unknowns), len(touches)
    rows, scale = here.sizes
    sizes = np.linalg.svd(here.jacobian * scale / rows[:, None])[1]
    if count < 2 or int(np.sum(sizes <= SINGULAR * sizes[0])) != count - 1:
        return None
    left, right = here.singular_vectors(here.jacobian)
    columns = [_speed_column(problem, unknowns, time) for _, time in touches]
    speeds = right[-count:, columns]
    if not np.linalg.cond(speeds) < 1e6:
        return None
    along = np.linalg.solve(speeds, right[-count:])
    bent = [problem.second_along(unknowns, one) @ one for one in along]
    squares = np.linalg.svd(left[1 - count :] @ np.transpose(bent))[2][-1]
    if not (np.all(squares > 0.0) or np.all(squares < 0.0)):
        return None
    sides = [problem.model.guard(wall).side for wall, _ in touches]
    tangent = sides * np.sqrt(np.abs(squares)) @ along
    return Start(problem, unknowns, tangent, branching=True, both_ways=False)


# Slopes.


def _new_speed(event: OrbitEvent, start: Start) -> float:
    """The rate of the new impact's velocity towards its wall, along the new branch."""
    column = _speed_column(start.problem, start.unknowns, event.details["touch_time"])
    return _side(start.problem, event) * float(start.tangent[column])


def _speed_column(problem: OrbitProblem, unknowns: Array, time: float) -> int:
    """The place among the unknowns of the velocity of the first impact at a time."""
    impact = int(np.argmin(np.abs(problem.impacts(unknowns)[:, 0] - time)))
    return problem.m * impact + 1


def _bend_criticality(event: OrbitEvent, start: Start) -> str:
    """The criticality where the parameter rests along the new branch."""
    problem = start.problem
    here = problem.evaluate(start.unknowns)
    jacobian = here.jacobian
    left = here.singular_vectors(jacobian[:, : problem.n])[0][-1]
    bent = problem.second_along(start.unknowns, start.tangent) @ start.tangent
    bend = -float(left @ bent) / float(left @ jacobian[:, -1])
    return SUB if (_gap_slope(event) > 0.0) == (bend > 0.0) else SUPER


def _gap_slope(event: OrbitEvent) -> float:
    """The sign of the derivative of the old orbit's gap by the parameter."""
    along = event.point.tangent
    side = _side(event.point.evaluation.problem, event)
    return float(-side * _rate_at_touch(event, along) * along[-1])


def _rate_at_touch(event: OrbitEvent, along: Array) -> float:
    """The rate along a direction of where the old orbit's flight is at the touch."""
    here: Linearisation = event.point.evaluation
    system = TouchingFlight(here.problem, *(event.details[name] for name in G.needed))
    _, start, _, by_parameter = system.arrival(here, system.start(here))
    return float(start[0] @ along[system.left] + by_parameter[0, 0] * along[-1])


def _side(problem: OrbitProblem, event: OrbitEvent) -> float:
    return problem.model.guard(event.details["wall"]).side


# Along curves.


def _since_impact(here: CurvePoint) -> tuple[int, str, float]:
    if "impact" in here.details:
        raise ArithmeticError("nothing is touched inside a flight")
    orbit, flight = here.orbit, here.details["flight"]
    start, _ = orbit.problem.times_around(orbit.unknowns, flight)
    return flight, here.details["wall"], here.details["touch_time"] - start


def _orbit_with_touch(here: CurvePoint) -> Linearisation:
    """The grazing orbit as one of the longer word."""
    if "impact" in here.details:
        raise ArithmeticError("nothing is touched inside a flight")
    orbit, problem = here.orbit, here.orbit.problem
    flight, wall = here.details["flight"], here.details["wall"]
    touch = np.insert(here.own, 1, 0.0)
    letters = _excursion(orbit, flight, wall, touch) or wall
    added = _excursion_impacts(problem, orbit.unknowns, letters, touch)
    word = problem.word.insert(flight, letters)
    if not is_path(problem.model.WALLS, word.walls):
        raise ArithmeticError("no flight leads back from the touch")
    longer = problem_of(problem.model, word, problem.kernels)
    rows = _insert_impacts(problem.impacts(orbit.unknowns), flight, added)
    problem.kernel_evaluations += len(longer.word)
    return longer.evaluate(longer.with_impacts(rows, orbit.span, orbit.unknowns))


# What is seen beyond the grazing of a stable orbit, from Nordmark's normal form.
#
# Let y be the smallest gap of a flight to the wall that it grazes, and t the time of it. An impact
# at y < 0 leaves both as if the flight had come to its smallest gap earlier, by
#
# .. math:: (1 + r)\, v / \alpha, \qquad v = \sqrt{-2 \alpha y},
#
# alpha the acceleration away from the wall; changes of y itself are of higher order. The rest of
# the cycle is smooth. With A its linearisation in (y, t), of the trace tau and the determinant
# delta,
#
# .. math:: u \mapsto A u \;\; (y \ge 0), \qquad
#           u \mapsto A \bigl(u - (0,\, (1 + r) \sqrt{-2 y / \alpha})\bigr) \;\; (y < 0)
#
# beside the orbit, which is at y = -epsilon beyond its grazing. An impact at y < 0 changes the n-th
# gap after it by
#
# .. math:: \kappa\, U_n \sqrt{-y}, \qquad
#           U_0 = 0, \quad U_1 = 1, \quad U_{n+1} = \tau U_n - \delta U_{n-1} .
#
# All follows from tau, delta and the sign of kappa; its square is the unit of epsilon. Where an
# image U_n is on the side of the wall, a gap of epsilon becomes one of its root: the motion *jumps*
# to an attractor that does not shrink to the grazing orbit. Otherwise, with kappa > 0 and real
# multipliers, the larger one lambda > 0, the motion stays near. Orbits with one impact in n cycles
# have the depth w^2, epsilon = w^2 + kappa b_n w, and are stable in *windows* between a period
# doubling and a grazing one cycle before the impact. For large n these are
#
# .. math:: \tfrac34 < \epsilon / (\kappa U_n)^2 < (1 - \lambda) / \lambda^2,
#
# so that they overlap for lambda < 1/4, leave chaos between for lambda < 2/3, and are empty above.
# What is neglected moves their ends by parts of the order of U_n. A jump is finite, so that on its
# end the terms neglected have as much influence.
#
# References: A. B. Nordmark, Phys. Rev. E 55 (1997) 266; W. Chin, E. Ott, H. E. Nusse and C.
# Grebogi, Phys. Rev. E 50 (1994) 4427; M. H. Fredriksson and A. B. Nordmark, Proc. R. Soc. Lond. A
# 453 (1997) 1261; di Bernardo, Budd, Champneys and Kowalczyk, Piecewise-smooth Dynamical Systems
# (2008), chapters 4 and 6.

OVERLAP, CHAOS, IMMEDIATE, JUMP, UNDECIDED = (
    "overlapping period adding",
    "period adding with chaos between",
    "immediate chaos",
    "jump",
    "not decided",
)
"""Names of scenarios."""

OVERLAPPING, EMPTY = 1.0 / 4.0, 2.0 / 3.0
"""Multipliers below which windows overlap, and above which they are empty, for large n."""

FIRST_WINDOWS = 5
"""Windows given."""

LONGEST = 40
"""Most cycles per impact of the orbits tried."""

SUPERSTABLE = 1e-9
"""Multipliers below this tell no scenario: all images of an impact vanish together. Nor do those
as near to one."""


def scenario_of(event: OrbitEvent, start: Start | None, touches: int) -> Scenario:
    """Return what is seen beyond a grazing of so many touches at once; the start is that of the
    branch with the touch as an impact."""
    here: Linearisation = event.point.evaluation
    if start is None or (reason := _refusal(event, touches)):
        return Scenario(UNDECIDED, reason if start is not None else "no branch is born")
    multipliers = here.multipliers
    trace, determinant = float(np.sum(multipliers).real), float(np.prod(multipliers).real)
    longer = start.problem.evaluate(start.unknowns)
    if here.blocks.together or longer.blocks.together:
        return Scenario(UNDECIDED, "flights are computed in pieces", trace, determinant)
    try:
        coefficient, rate = square_root_coefficient(event, longer), gap_rate(event)
    except (ArithmeticError, np.linalg.LinAlgError):
        return Scenario(UNDECIDED, "the linearised flights are singular", trace, determinant)
    given = trace, determinant, coefficient, rate
    largest = float(np.max(np.abs(multipliers)))
    if largest < SUPERSTABLE or largest > 1.0 - SUPERSTABLE:
        what = "all multipliers vanish" if largest < 0.5 else "a multiplier is of size one"
        return Scenario(UNDECIDED, what, *given)
    if not (math.isfinite(coefficient) and coefficient and math.isfinite(rate) and rate):
        return Scenario(UNDECIDED, "the square root or the gap's rate vanishes", *given)
    name, found = predict(trace, determinant, coefficient > 0.0)
    scale, value = -(coefficient**2) / rate, float(here.unknowns[-1])
    short, long = here.problem.word, longer.problem.word
    seen = []
    for n, ends in found:
        low, high = sorted(value + scale * end for end in ends)
        known = [_end(here.problem, end) for end in (low, high)]
        finite = sum(map(math.isfinite, (low, high)))
        if low < value < high or finite + known.count(None) == 2:
            word = Word(short.walls * (n - 1) + long.walls, n * short.period)
            seen.append(Window(n, word.notation(here.problem.model.letters), *known))
    return Scenario(name, None, *given, tuple(seen))


def _end(problem: OrbitProblem, value: float) -> float | None:
    """The end of a window; None where the model does not admit this value of the parameter."""
    with contextlib.suppress(InputError):
        problem.model.replace(**{problem.parameter: value})
        return value
    return None


def _refusal(event: OrbitEvent, touches: int) -> str:
    """Why the normal form does not apply, or an empty text."""
    here: Linearisation = event.point.evaluation
    problem = here.problem
    guard = problem.model.guard(event.details["wall"])
    if problem.autonomous:  # the time of an impact matters where other coordinates move
        alone = problem.model.DEGREES_OF_FREEDOM == 1
        several = "the normal form is not computed for several coordinates"
        return f"without forcing, {'an impact leaves no square root' if alone else several}"
    if not problem.paired:
        return f"the return map has {problem.m - problem.lost} dimensions"
    if not guard.rigid:
        return "the wall gives way"
    if touches != 1 or "impact" in event.details:
        return f"{touches} touches at once" if touches != 1 else "the touch begins a flight"
    if problem.lost or count_unstable(here.multipliers):
        return "the orbit is not stable" if not problem.lost else "the orbit slides"
    return ""


# The normal form of an orbit.


def square_root_coefficient(event: OrbitEvent, longer: Linearisation) -> float:
    """Return kappa: a gap y < 0 at the touch becomes kappa sqrt(-y) a cycle later. The longer orbit
    has the touch as an impact."""
    problem = longer.problem
    count = len(problem.word)
    touch = (event.details["flight"] + 1) % count
    last = (touch - 1) % count
    side = float(problem.model.guard(event.details["wall"]).side)
    away = side * float(longer.end[last, 1, 0] / longer.end[last, 1, 1])  # alpha
    moved = np.array([-1.0 / away, side])  # time and velocity of an impact, over its speed
    for k in range(touch, touch + count - 1):
        moved = -np.linalg.solve(longer.end[k % count], longer.start[k % count] @ moved)
    gap = -side * float(longer.start[last, 0] @ moved)
    if problem.arrivals[last] != ELSEWHERE:  # its row is over the duration
        begin, end = problem.times_around(longer.unknowns, last)
        gap *= end - begin
    return gap * math.sqrt(2.0 * away) if away > 0.0 else math.nan


def gap_rate(event: OrbitEvent) -> float:
    """Return the derivative of the grazing flight's smallest gap by the parameter."""
    here: Linearisation = event.point.evaluation
    problem, details = here.problem, event.details
    guard: Guard = problem.model.guard(details["wall"])
    jacobian, n = here.jacobian, problem.n
    along = np.append(-np.linalg.solve(jacobian[:, :n], jacobian[:, n]), 1.0)
    rate, flight = _rate_at_touch(event, along), details["flight"]
    if problem.word.walls:
        left = problem.word.walls[flight]
        if problem.kernels.arrival(left, details["wall"]) != ELSEWHERE:
            rate *= details["touch_time"] - problem.times_around(here.unknowns, flight)[0]
    return -guard.side * rate


# What the normal form does.


def predict(
    trace: float, determinant: float, away: bool
) -> tuple[str, list[tuple[int, tuple[float, float]]]]:
    """Return the scenario of a normal form with a stable orbit, and its windows: cycles per impact,
    and the range of epsilon over the square of kappa, as of `Scenario`. It is `away` where kappa >
    0: a cycle after the impact the gap is larger."""
    discriminant = trace * trace - 4.0 * determinant
    larger = 0.5 * (trace + math.sqrt(discriminant)) if discriminant >= 0.0 else math.nan
    found = windows(trace, determinant, away)
    if not (away and larger > 0.0 and trace > 0.0):
        return JUMP, [(n, ends) for n, ends in found if ends[0] < 0.0 < ends[1]]
    if larger >= EMPTY:
        return IMMEDIATE, found[:FIRST_WINDOWS]
    return (OVERLAP if larger < OVERLAPPING else CHAOS), found[:FIRST_WINDOWS]


def windows(trace: float, determinant: float, away: bool) -> list[tuple[int, tuple[float, float]]]:
    r"""Return where orbits with one impact in n cycles are stable in a normal form: each n, and the
    range of epsilon over the square of kappa.

    With s the sign of kappa, w the root of the impact's depth over kappa, T_n the trace of A^n and
    D_n = 1 - T_n + delta^n, the orbit has

    .. math:: \epsilon = w^2 + s b_n w, \qquad b_n = U_n / D_n,

    the trace :math:`T_n - s U_n / (2 w)` and the determinant delta^n. Its gap after j < n cycles is
    :math:`s a_j w - \epsilon` with :math:`a_j = (U_j + \delta^j U_{n-j}) / D_n`.
    """
    sign = 1.0 if away else -1.0
    images, traces = images_of(trace, determinant, LONGEST)
    found = []
    for n in range(1, LONGEST + 1):
        power = determinant**n
        regular = 1.0 - traces[n] + power
        image = sign * images[n]
        bend = image / regular
        least = image / (1.0 + traces[n] + power) if image > 0.0 else -bend
        others = (
            sign * (images[j] + determinant**j * images[n - j]) / regular for j in range(1, n)
        )
        low, high = 0.5 * least, min(others, default=math.inf) - bend
        if 0.0 < low < high:
            found.append((n, (low * (low + bend), high * (high + bend))))
    return found


def images_of(trace: float, determinant: float, count: int) -> tuple[list[float], list[float]]:
    """Return U_n, and the traces of A^n, for n from 0 to a number."""
    images, traces = [0.0, 1.0], [2.0, trace]
    for _ in range(count - 1):
        images.append(trace * images[-1] - determinant * images[-2])
        traces.append(trace * traces[-1] - determinant * traces[-2])
    return images, traces
