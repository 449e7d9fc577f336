r"""How far a stable orbit is from the events that end it, in tolerances w of chosen parameters p.

The equations E(x, p) = 0 of an event hold on a surface of the parameters. With psi the left null
vector of E_x, its normal in y = (p - p_0)/w is g = psi E_y, of length one. The surface's point
nearest to y = 0 is sought by sequential quadratic programming,

.. math:: B\,\delta y + \mu g = -y, \qquad g \cdot \delta y = -\psi \cdot E, \qquad
          E_x\,\delta x = -E - E_y\,\delta y,

with B, the Hessian of the Lagrangian, by damped updates (Powell 1978). With B = 1 it is the
iteration of Hasofer, Lind, Rackwitz and Fiessler in structural reliability.

Searches begin at the orbit, and at the ends of lines in the parameters on which it is followed
until it is lost; each event found is kept if the orbit stays observable on the line to it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array
from ..bifurcations.declarations import USUAL
from ..bifurcations.extended_system import CONVERGED, ExtendedSystem, Solution, moves, surroundings
from ..bifurcations.kind import Change, Kind, kind_of
from ..continuation.branch import Details, Event, Point
from ..display import limit_lines
from ..errors import InputError, count_text, explain_arguments, short_repr
from ..models.model import Model
from ..orbits.orbit import Orbit
from ..orbits.problem import Linearisation
from ..orbits.quiet import problem_of
from ..orbits.search import solve_near
from ..results.branch import Branch, Entry, orbit_at
from ..results.diagram import to_orbit
from ..results.options import MarginOptions, tolerance_sizes
from ..segments.kernels import Kernels
from .curve_problem import CurveProblem, equations_of, slope_of
from .orbit_walks import AT_IMAGE, OFF_IMAGE, symmetric_end

ITERATIONS, APPROACH, APPROACHED = 80, 20, 1e-3
"""Iterations at most, and those after which residuals are below this, if any event is near."""

LOOSE, HALVINGS = 0.05, 10
"""Residuals that a step may lead to from smaller ones, and how often it is halved for that."""

STATIONARY = 1e-9
"""Part of the distance by which the nearest point may be off along the surface."""

ROUNDED = 2.0**-48
"""How far astray rounding leads, as a part of the parameters: sixteen units in the last place."""

FARTHEST = 0.3
"""How far a step of the search may move the orbit, in its natural sizes."""

LINES = 8
"""Lines in random directions, for each parameter."""

NEARBY = 0.3
"""Part of a line's length, to first order, within which events are sought from its end."""

ASIDE = 0.5
"""How far from an event's value a multiplier is at most where the event is sought."""

STEPS = 16
"""Steps of a line at least."""

SMALLEST = 1e-7
"""Part of a line below which a step is refused for good: the orbit is lost there."""

OFF = 0.03
"""How far an orbit on a line may be from where its tangent leads, in natural sizes."""

JUMP = 0.25
"""How much the size of a multiplier may change in a step of a line."""

AGAIN = 1e-6
"""Part of the distance within which two events are the same."""

BEFORE, SAME = 1.0 - 1e-6, 0.003
"""Part of the line to an event that is followed, and how near its end is to the event's orbit."""


@dataclass(frozen=True, eq=False)
class EventMargin:
    """The point of an event's surface in parameters that is nearest to an orbit."""

    label: str
    """The event, as in catalogues."""
    distance: float
    """Its distance, in tolerances."""
    direction: Mapping[str, float]
    """From the orbit to it, in tolerances of each parameter, of length one."""
    orbit: Orbit
    """The orbit at the event."""
    kind: str
    details: Mapping[str, Any]
    """Where on the orbit it happens: flight, wall, impact, time of a touch."""
    tolerances: Mapping[str, float]

    @property
    def place(self) -> tuple[Any, ...]:
        """What tells events apart."""
        return _place(self.kind, self.details)

    @property
    def parameters(self) -> Mapping[str, float]:
        """All parameters at the event."""
        return self.orbit.parameters

    def sensitivity(self, parameter: str) -> float:
        """Return the exact derivative of the distance by any parameter of the orbit it is of.

        Raises
        ------
        InputError
            For a parameter the model does not have.
        """
        model = self.orbit.model
        model.require(parameter, "parameter")
        rates = {n: self.direction[n] / w for n, w in self.tolerances.items()}
        if parameter in rates:
            return -rates[parameter]
        name = max(rates, key=lambda n: abs(self.direction[n]))
        problem = problem_of(model, self.orbit.word, Kernels(model, name, parameter))
        values = [model.values[name], model.values[parameter]]
        here = problem.evaluate(np.append(self.orbit.unknowns[: problem.n], values))
        kind = kind_of(self.kind)
        system = equations_of(kind, problem, self.details)
        curve = CurveProblem(kind, system, self.details, [1.0])
        return rates[name] * slope_of(curve, curve.packed(here.unknowns, system.start(here)))

    def of(self, orbit: Orbit) -> EventMargin:
        """Return the event's point nearest to another orbit, along which isolines follow it.

        Parameters
        ----------
        orbit : Orbit
            Of the same branch, nearby.

        Raises
        ------
        InputError
            If a search that begins at this point finds none.
        """
        found = Search(orbit, self.tolerances, np.inf).again(self)
        if found is None:
            raise InputError("orbit", f"{self.label} is not found from it", "give a nearer one")
        return found

    def __repr__(self) -> str:
        place = ", ".join(f"{n} = {self.orbit[n]:.9g}" for n in self.tolerances)
        return f"{self.label} at distance {self.distance:.6g}: {place}"


@dataclass(frozen=True, eq=False)
class Margins:
    """The events nearest to a stable orbit in parameters; see `contimpact.find_margins`."""

    orbit: Orbit
    tolerances: Mapping[str, float]
    within: float
    """How far was looked, in tolerances."""
    events: tuple[EventMargin, ...]
    """One of each kind and place on the orbit, the nearest first."""
    notes: tuple[str, ...]
    """Where the orbit is lost nearer than at any event found, as where the model ends, or at a
    pitchfork that one of the parameters unfolds; empty if there is no such place."""

    @property
    def nearest(self) -> EventMargin | None:
        """The nearest event; None if there is none."""
        return self.events[0] if self.events else None

    def __repr__(self) -> str:
        units = ", ".join(f"{name} {value:g}" for name, value in self.tolerances.items())
        none = [] if self.events else [f"  no event within {self.within:g}"]
        rows = [f"  {event!r}" for event in self.events]
        return limit_lines(f"Margins for {units}:", rows, [*none, *(f"  {n}" for n in self.notes)])


@explain_arguments
def find_margins(
    orbit: Orbit | Entry,
    tolerances: Mapping[str, float | str],
    model: Model | None = None,
    *,
    within: float = 100.0,
) -> Margins:
    """Find how far parameters may change until a stable orbit ends, and at which event.

    Parameters
    ----------
    orbit : Orbit, Entry or (Branch, row)
        Stable and physical.
    tolerances : mapping
        Of each parameter that may change, the change that is one unit of distance: a number, or a
        part of the value such as ``"5%"``.
    model : Model, optional
        The system of an entry or a branch, where its name does not tell.
    within : float
        The distance up to which events are looked for.

    Returns
    -------
    Margins
        The nearest points of the events on which the orbit ends: on the straight line to each, it
        was followed and stays observable. They are minima that searches from the orbit, and from
        the ends of lines along each parameter and in random directions, have found; that there is
        no nearer one is not proven.

    Raises
    ------
    InputError
        For an orbit that is not physical and stable, a parameter the model does not have, or a
        tolerance that is not positive.
    """
    given = to_orbit(orbit, model)
    if not (given.physical and given.stable):
        found = given.reason or f"its multipliers are {given.multipliers}"
        raise InputError("orbit", found, "give a stable physical orbit")
    sizes = tolerance_sizes(tolerances, given.model)
    if not 0.0 < within < np.inf:
        raise InputError("within", short_repr(within), "give a positive number")
    return Search(given, sizes, within).margins()


def fill_margins(
    branch: Branch, options: MarginOptions, model: Model, entries: Mapping[str, Entry]
) -> list[str]:
    """Fill a branch's columns ``margin``, all NaN, and ``margin_event``, row by row, for its stable
    orbits, and return notes.

    At events that end these the margin is zero, and where no event is within the range it is
    infinite. `entries` are the diagram's, by their names.
    """
    margins, events = branch["margin"], branch["margin_event"]
    shown = branch.stable & branch.physical
    beside = shown | np.append(shown[1:], False) | np.append(False, shown[:-1])
    known, lost = dict[tuple[str, ...], Kernels](), list[str]()
    for row in np.flatnonzero(beside).tolist():
        entry = entries.get(str(branch["event"][row]))
        if entry is not None and not entry.ghost and entry.kind in USUAL:
            margins[row], events[row] = 0.0, entry.label
            continue
        if not shown[row]:
            continue
        orbit = orbit_at(branch, row, model)
        sizes = {name: t.at(orbit[name]) for name, t in options.tolerances.items()}
        sizes = {name: size for name, size in sizes.items() if size > 0.0}
        names = tuple(sizes)
        kernels = known.setdefault(names, Kernels(model, *names))
        found = Search(orbit, sizes, options.within, kernels).margins()
        margins[row] = np.inf if found.nearest is None else found.nearest.distance
        events[row] = "" if found.nearest is None else found.nearest.label
        lost += found.notes
    return [f"margins at {count_text(len(lost), 'row')}: the orbit is {lost[0]}"] if lost else []


class _Lost(NamedTuple):
    """The last observable orbit on a line, and what is beyond."""

    here: Linearisation
    distance: float
    why: str


@dataclass(frozen=True, eq=False)
class _Found:
    kind: Kind
    details: Details
    y: Array
    solution: Solution

    @property
    def distance(self) -> float:
        return float(np.linalg.norm(self.y))

    @property
    def place(self) -> tuple[Any, ...]:
        return _place(self.kind.name, self.details)


def _place(kind: str, details: Mapping[str, Any]) -> tuple[Any, ...]:
    return kind, *(details.get(name) for name in ("flight", "wall", "impact"))


class Search:
    """The search for the nearest events of one orbit."""

    def __init__(
        self,
        orbit: Orbit,
        tolerances: Mapping[str, float],
        within: float,
        kernels: Kernels | None = None,
    ) -> None:
        model = orbit.model
        for name in tolerances:
            model.require(name, "tolerances")
        self.orbit, self.tolerances, self.within = orbit, tolerances, within
        self.units = np.array(list(tolerances.values()))
        self.problem = problem_of(model, orbit.word, kernels or Kernels(model, *tolerances))
        n, self.center = self.problem.n, np.array([model.values[name] for name in tolerances])
        self.start = self.problem.evaluate(np.append(orbit.unknowns[:n], self.center))
        self.kinds = [kind_of(name) for name in USUAL]
        self.images = symmetric_end(self.problem) if orbit.word.walls else None
        self.own = self.images.images(self.start.unknowns, OFF_IMAGE) if self.images else []
        self.found, self.tried, self.lost = list[_Found](), list[_Found](), list[_Lost]()
        self.kept: dict[tuple[Any, ...], EventMargin] = {}

    def margins(self) -> Margins:
        """Search from the orbit, from where it is lost along each parameter, and from the ends of
        lines in random directions, no longer than the nearest event is far."""
        size = len(self.units)
        self.found += self.around(self.start, np.inf)
        for line in (sign * row for row in np.eye(size) for sign in (1.0, -1.0)):
            self.look(self.within * line)
        self.keep()
        for line in np.random.default_rng(0).normal(size=(LINES * size if size > 1 else 0, size)):
            self.look(BEFORE * self.nearest / np.linalg.norm(line) * line)
            self.keep()
        events = sorted(self.kept.values(), key=lambda event: event.distance)
        notes: dict[str, str] = {}
        for end in sorted(self.lost, key=lambda end: end.distance):
            if end.distance + 2.0 * SMALLEST * self.within < self.nearest:
                notes.setdefault(end.why.split(" (")[0], self.note(end))
        return Margins(
            self.orbit, self.tolerances, self.within, tuple(events), tuple(notes.values())
        )

    @property
    def nearest(self) -> float:
        """The distance of the nearest event kept, or that up to which is looked."""
        return min((event.distance for event in self.kept.values()), default=self.within)

    def look(self, y: Array) -> _Lost | None:
        """Search from the end of a line, or from where the orbit is lost on it."""
        end = self.lost_on(y)
        if end is not None:
            self.lost.append(end)
        distance = float(np.linalg.norm(y)) if end is None else end.distance
        self.found += self.around(self.end, NEARBY * distance)
        return end

    def keep(self) -> None:
        """Keep the nearest events found at each place that the orbit, followed to them, reaches."""
        while self.found:
            one = min(self.found, key=lambda each: each.distance)
            self.found.remove(one)
            self.tried.append(one)
            if one.place in self.kept and self.kept[one.place].distance <= one.distance:
                continue
            if (end := self.lost_on(BEFORE * one.y)) is not None:
                self.lost.append(end)
                self.found += self.around(self.end, NEARBY * end.distance)
            elif self.reaches(one) and (event := self.event(one)) is not None:
                self.kept[one.place] = event

    def note(self, end: _Lost) -> str:
        at = zip(self.tolerances, end.here.unknowns[self.problem.n :], strict=True)
        place = ", ".join(f"{name} = {value:.9g}" for name, value in at)
        return f"lost at distance {end.distance:.6g}, {place}, at no event found: {end.why}"

    # Lines.

    def lost_on(self, y: Array, steps: int = STEPS) -> _Lost | None:
        """Follow the orbit to y; return where it is lost, None if it is observable all along."""
        self.end, fraction = self.start, 0.0
        step, far = 1.0 / steps, float(np.linalg.norm(y))
        while fraction < 1.0:
            step = min(step, 1.0 - fraction)
            there, why = self.moved(self.end, self.center + (fraction + step) * self.units * y)
            if there is None:
                step *= 0.5
                if step < SMALLEST:
                    return _Lost(self.end, fraction * far, why)
                continue
            self.end, fraction = there, fraction + step
            step = min(2.0 * step, 1.0 / steps)
        return None

    def moved(self, here: Linearisation, free: Array) -> tuple[Linearisation | None, str]:
        """The observable orbit next to one, at other parameters, or why there is none."""
        n, problem = self.problem.n, self.problem
        jacobian, change = here.jacobian, free - here.unknowns[n:]
        try:
            along = -np.linalg.solve(jacobian[:, :n], jacobian[:, n:] @ change)
            guess = np.append(here.unknowns[:n] + along, free)
            problem.model_at(guess)
        except np.linalg.LinAlgError:
            return None, "the orbit turns back"
        except InputError as error:
            return None, f"the model ends ({error})"
        try:
            return self.solved(here, guess)
        except ArithmeticError as error:  # motions turn or decay too often, or overflow
            return None, f"the model ends ({error})"

    def solved(self, here: Linearisation, guess: Array) -> tuple[Linearisation | None, str]:
        """The observable orbit that a guess leads to, or why there is none."""
        there = solve_near(self.problem, guess)
        if there is None or self.apart(there.unknowns, guess) > OFF:
            return None, "no orbit is found beyond"
        if not there.verdict.physical:
            return None, f"the orbit is unphysical beyond ({there.verdict.reason})"
        if there.n_unstable:
            return None, "the orbit is unstable beyond"
        images = self.images.images(there.unknowns, AT_IMAGE) if self.images else []
        if not {*images} <= {*self.own}:
            return None, "the orbit is one of shorter period, or symmetric, beyond"
        jump = np.abs(np.abs(there.multipliers) - np.abs(here.multipliers))
        if not np.max(jump, initial=0.0) < JUMP:
            return None, "its multipliers grow without bound"
        return there, ""

    def apart(self, one: Array, other: Array) -> float:
        """The distance of orbits in natural sizes, parameters left out."""
        sizes = self.problem.scale(other, np.full(self.problem.free, np.inf))
        return float(np.linalg.norm(self.problem.difference(one, other) / sizes))

    def reaches(self, found: _Found) -> bool:
        """Whether the line followed last ends at an event's orbit."""
        return self.apart(self.end.unknowns, found.solution.unknowns) < SAME

    # Events.

    def around(self, here: Linearisation, near: float) -> Iterator[_Found]:
        """The events nearest to the centre that are not known, as searches from an orbit find them,
        those to first order so near to it."""
        kinds = [kind for kind in self.kinds if _is_near(kind, here)]
        for kind, details in [(k, d) for k in kinds for d in k.places(here)]:
            found = self.sought(kind, details, here, near)
            if found is not None and not any(
                np.linalg.norm(found.y - other.y) <= AGAIN * found.distance
                for other in (*self.found, *self.tried)
                if other.place == found.place
            ):
                yield found

    def sought(
        self, kind: Kind, details: Details, here: Linearisation, near: float
    ) -> _Found | None:
        """The nearest event of a kind at a place of the orbit; None if the search fails."""
        system = kind.equations(self.problem, details)
        if system is None:
            return None
        try:
            with np.errstate(divide="ignore", invalid="ignore"):  # where a flight vanishes
                solution = _minimise(system, here, self.center, self.units, near)
        except (ArithmeticError, ValueError, np.linalg.LinAlgError):
            return None
        if solution is None or kind.curve_end(solution.own) is not None:
            return None
        n = self.problem.n
        y = (solution.unknowns[n:] - self.center) / self.units
        beyond = self.center + (1.0 + AGAIN) * self.units * y
        try:
            self.problem.model_at(np.append(solution.unknowns[:n], beyond))
        except InputError:  # the model ends there: without losses, all pairs are on the circle
            return None
        found = _Found(kind, {**details, **system.details(solution.own)}, y, solution)
        return found if 0.0 < found.distance <= self.within else None

    def again(self, event: EventMargin) -> EventMargin | None:
        """An event of a neighbouring orbit, as it is of this one; None if the search fails."""
        n, values = self.problem.n, self.orbit.model.values
        place = [
            event.orbit[name] if name in event.tolerances else values[name]
            for name in self.tolerances
        ]
        here = self.problem.evaluate(np.append(event.orbit.unknowns[:n], place))
        found = self.sought(kind_of(event.kind), event.details, here, np.inf)
        if found is None:
            return None
        direction = dict(zip(self.tolerances, (found.y / found.distance).tolist(), strict=True))
        orbit = Orbit(self.problem, found.solution.here)
        moved = replace(event, distance=found.distance, direction=direction, orbit=orbit)
        return replace(moved, details=found.details, tolerances=self.tolerances)

    def event(self, found: _Found) -> EventMargin | None:
        """What was found as an event on a branch; None where its kind does not accept it."""
        n, here, kind = self.problem.n, found.solution.here, found.kind
        model, word = self.problem.model_at(here.unknowns), self.orbit.word
        name = self.orbit.parameter
        problem = problem_of(model, word, Kernels(model, name))
        there = problem.evaluate(np.append(here.unknowns[:n], model.values[name]))
        point = Point(there, np.zeros(n + 1), 0.0, 0.0, 0)
        residual = found.solution.residual
        event = Event(kind.name, point, residual, 0.0, "newton", found.details)
        if not kind.test(problem, {}).accept(event):
            return None
        return EventMargin(
            kind.label(False, word, kind.next_word(event), model.letters),
            found.distance,
            dict(zip(self.tolerances, (found.y / found.distance).tolist(), strict=True)),
            Orbit(problem, there),
            kind.name,
            found.details,
            self.tolerances,
        )


def _is_near(kind: Kind, here: Linearisation) -> bool:
    """Whether an orbit has a multiplier near that of a kind, or a pair near the unit circle, if it
    has to."""
    multipliers = here.multipliers
    if kind.multiplier is not None:
        return bool(np.any(np.abs(multipliers - kind.multiplier) < ASIDE))
    pairs = multipliers[multipliers.imag != 0.0]
    near = bool(np.any(np.abs(np.abs(pairs) - 1.0) < ASIDE))
    return near or kind.changes is not Change.STABILITY


def _minimise(
    system: ExtendedSystem, here: Linearisation, center: Array, units: Array, near: float
) -> Solution | None:
    """Return the solution of a system nearest to parameters; None if the search does not settle."""
    sizes = system.problem.scale(here.unknowns, np.inf)
    own, is_near = system.start(here), surroundings(here, sizes)
    found = nearest_point(
        system.problem, system.assemble, here, own, center, units, system.sizes_at, near, is_near
    )
    return None if found is None else Solution(system, *found)


def nearest_point(
    problem: Any,
    assemble: Callable[[Any, Array], Any],
    here: Any,
    own: Array,
    center: Array,
    units: Array,
    sizes_at: Callable[[Any, Any, Array], Array],
    near: float = np.inf,
    is_near: Callable[[Array], bool] = lambda unknowns: True,
) -> tuple[Any, Array, Any] | None:
    """Return where equations hold nearest to parameters: the point, own unknowns, the equations;
    None if the search does not settle.

    The problem, an `OrbitProblem` or a `Connection`, has ``n`` unknowns and then ``free``
    parameters; `assemble` gives the residual and the Jacobian at a point, such as `here`, and the
    own unknowns; `sizes_at` gives natural sizes of the residual there. `center` are the parameters
    and `units` what changes of them count as one. `near` is how far off the equations may be at
    first, to first order, and `is_near` says whether unknowns are still those that are sought.
    """
    n, free = problem.n, problem.free
    hessian = np.eye(free)
    sizes = problem.scale(here.unknowns, np.inf)
    before: tuple[Array, Array] | None = None
    mu, settled = 0.0, False
    at = assemble(here, own)
    rows = sizes_at(at, here, own)
    for iteration in range(ITERATIONS):
        residual, jacobian = at.residual / rows, at.jacobian / rows[:, None]
        inner = np.delete(jacobian, range(n, n + free), axis=1)
        columns = moves(inner.T, np.ones(len(rows)))
        outer, largest = jacobian[:, n : n + free] * units, float(np.max(np.abs(residual)))
        psi = np.linalg.svd(inner / columns)[0][:, -1]
        if before and psi @ outer @ before[1] < 0.0:
            psi = -psi
        slope = float(np.linalg.norm(psi @ outer))
        if not slope > 0.0:  # no parameter moves it, as at a pitchfork of symmetric orbits
            return None
        normal, off = psi @ outer / slope, float(psi @ residual) / slope
        y = (here.unknowns[n:] - center) / units
        if (not before and abs(off) > near) or (iteration > APPROACH and largest > APPROACHED):
            return None
        if before:
            step = y - before[0]
            hessian = updated_hessian(hessian, step, step + mu * (normal - before[1]))
        astray = max(abs(off), float(np.linalg.norm(y - (normal @ y) * normal)))
        least = ROUNDED * float(np.max(np.abs(here.unknowns[n:] / units)))
        near_enough = max(STATIONARY * float(np.linalg.norm(y)), least)
        if largest < CONVERGED and astray <= near_enough:
            if settled:
                return here, own, at
            settled = True  # one step more: directions are only as good as they are stationary
        bordered = np.block([[hessian, normal[:, None]], [normal[None], np.zeros((1, 1))]])
        *moved, mu = np.linalg.solve(bordered, -np.append(y, off))
        right = -residual - outer @ np.array(moved)
        along = np.linalg.lstsq(inner / columns, right, rcond=None)[0] / columns
        length = float(np.linalg.norm(along[:n] / sizes[:n]))
        part = min(1.0, FARTHEST / length) if length > 0.0 else 1.0
        before, allowed = (y, normal), max(LOOSE, largest)
        for _ in range(HALVINGS):
            unknowns = here.unknowns + part * np.append(along[:n], units * np.array(moved))
            if not is_near(unknowns):
                return None
            there = problem.evaluate(unknowns)
            at = assemble(there, own + part * along[n:])
            if np.max(np.abs(at.residual) / rows) <= allowed:
                break
            part *= 0.5
        else:
            return None
        here, own = there, own + part * along[n:]
    return None


def updated_hessian(hessian: Array, step: Array, bend: Array) -> Array:
    """The damped update of Powell, which keeps the Hessian positive definite."""
    product = hessian @ step
    size, given = float(step @ product), float(step @ bend)
    if not size > 0.0:
        return hessian
    if given < 0.2 * size:
        part = 0.8 * size / (size - given)
        bend = part * bend + (1.0 - part) * product
        given = float(step @ bend)
    return hessian - np.outer(product, product) / size + np.outer(bend, bend) / given
