"""The equations of a curve in two parameters, and the points of codimension two on it.

A point of codimension two on a curve solves the equations of two events of one orbit, with the
orbit's own once; where the second condition is no event of that orbit (a cusp, a touch without
acceleration), the value that vanishes there is the last equation. The residuals are exact; the
derivatives of such a value alone are differenced, so that Newton's method converges linearly, at
the rate of the difference's error, to the same solution.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arrays import ARRAYS, LISTS, Array, Containers, Vector
from ..bifurcations.at_rest import difference_gradient, sizes_of
from ..bifurcations.codimension_two import CurveStart, CurveTest
from ..bifurcations.declarations import CURVES
from ..bifurcations.event_solver import (
    EVALUATE,
    FUNCTIONS,
    add_kernels,
    flights_of,
    is_scalar,
    vectors_of,
)
from ..bifurcations.extended_system import EPSILON, ExtendedSystem, SystemEvaluation
from ..bifurcations.kind import CurvePoint as AnyCurvePoint
from ..bifurcations.kind import Kind, Values, kind_of
from ..bifurcations.scalar_systems import (
    BLOCK,
    ON_CURVE,
    SystemVectors,
    newton_step,
    size_on_curve,
    solve_bordered,
)
from ..continuation.branch import Block, Details, EndKind, Event, Point, TestFunction
from ..continuation.step import EVALUATIONS, Backend, Batch, Position, batch_of, columns, take_steps
from ..errors import InputError, short_repr
from ..models.model import Model
from ..orbits.problem import Linearisation, OrbitProblem
from ..orbits.status import Verdict
from ..results.branch import Entry, details_of, orbit_of
from ..segments.compiling import CompiledProgram, load, mode, timed_plainly
from ..segments.kernels import Kernels
from ..segments.machine_code import Program
from .orbit_backend import plainly
from .orbit_walks import SwitchingBackend

# An extended system with further free parameters, as a problem the continuer follows.


class CurveProblem:
    """An extended system with one free parameter more than it has equations for, to be continued.

    Its kind is one of those in `CURVES`, or several at once; the system is on an `OrbitProblem`
    with two free parameters, or as many as make its solutions a curve. Details say where on the
    orbit it happens (flight, wall, impact); spans are natural sizes of the free parameters but the
    last, along which the walk is limited.
    """

    def __init__(
        self, kind: Kind, system: ExtendedSystem, details: Details, spans: Sequence[float]
    ) -> None:
        self.kind, self.system, self.details = kind, system, dict(details)
        self.orbit = system.problem
        self.spans = list(spans)

    def packed(self, orbit: Array, own: Array) -> Array:
        """Return the curve's unknowns: the last parameter goes last."""
        return np.concatenate([orbit[:-1], own, orbit[-1:]])

    def unpacked(self, unknowns: Array) -> tuple[Array, Array]:
        """Return the orbit's unknowns with all free parameters, and the system's own."""
        inner = self.orbit.n + self.orbit.free - 1
        return np.append(unknowns[:inner], unknowns[-1]), unknowns[inner:-1]

    def evaluate(self, unknowns: Array) -> CurvePoint:
        """Evaluate the system."""
        orbit, own = self.unpacked(unknowns)
        here = self.orbit.evaluate(orbit)
        at = self.system.assemble(here, own)
        found = CurvePoint(self, unknowns, at.residual, here, own)
        found.jacobian = self.in_order(at.jacobian)
        return found

    def in_order(self, jacobian: Array) -> Array:
        """Return the system's Jacobian with the last parameter's column last."""
        last = self.orbit.n + self.orbit.free - 1
        return jacobian[:, [*range(last), *range(last + 1, jacobian.shape[1]), last]]

    def rounding(self, here: CurvePoint) -> Array:
        """Return bounds of the rounding errors of the residuals at a point."""
        return self.system.rounding(here.orbit, here.own)

    def scale(self, unknowns: Array, span: float) -> Array:
        """Return natural sizes: those of the orbit, one for unit vectors, times for touches."""
        orbit, own = self.unpacked(unknowns)
        sizes = self.orbit.scale(orbit, [*self.spans, span])
        return self.packed(sizes, self.system.scale(own, sizes))

    def residual_sizes_at(self, here: CurvePoint, scale: Array) -> Array:
        """Return natural sizes of the residuals at a point, given those of the unknowns."""
        n, own = self.orbit.n, here.own
        moved = np.append(scale[:n], here.orbit.unknowns[n:])
        unknowns = self.packed(moved, self.system.own_sizes(own, scale[:n]))
        return ON_CURVE * self.system.sizes(here.jacobian, unknowns)

    def difference(self, one: Array, other: Array) -> Array:
        """Return one - other, orbits compared as orbits."""
        orbit, own = self.unpacked(one)
        orbit_other, own_other = self.unpacked(other)
        return self.packed(self.orbit.difference(orbit, orbit_other), own - own_other)


@dataclass(eq=False)
class CurvePoint:
    """A curve's system at one point, with the orbit's linearisation."""

    problem: CurveProblem
    unknowns: Array
    residual: Array
    orbit: Linearisation
    own: Array

    @functools.cached_property
    def jacobian(self) -> Array:
        """The system's Jacobian, made when asked for if it is not there."""
        return self.problem.in_order(self.problem.system.assemble(self.orbit, self.own).jacobian)

    def parameter(self, name: str) -> float:
        """Return the value of a free parameter."""
        names = self.problem.orbit.kernels.parameters
        return float(self.orbit.unknowns[self.problem.orbit.n + names.index(name)])

    @property
    def details(self) -> Details:
        """Where on the orbit it happens, the time of a touch included."""
        return {**self.problem.details, **self.problem.system.details(self.own)}


def require_curve(entry: Entry) -> None:
    """Raise `InputError` if this is no entry, or events of its kind have no curves."""
    if getattr(entry, "kind", None) not in CURVES:
        found = f"{short_repr(entry)} has no curve"
        raise InputError("entry", found, f"accepted are entries of {', '.join(CURVES)}")


def curve_problem(
    model: Model, entry: Entry, kernels: Kernels, first_span: float
) -> tuple[CurveProblem, Array]:
    """Return the problem of the curve through a catalogue entry, and where it starts."""
    at = orbit_of(entry, model, kernels)
    problem, orbit = at.problem, at.unknowns
    kind, details = kind_of(entry.kind), details_of(entry)
    system = equations_of(kind, problem, details)
    curve = CurveProblem(kind, system, details, [first_span])
    return curve, curve.packed(orbit, system.start(problem.evaluate(orbit)))


def slope_of(curve: CurveProblem, at: Array) -> float:
    """Return the derivative of the first parameter by the last one along a curve.

    Raises numpy.linalg.LinAlgError where the curve turns in the last one.
    """
    jacobian = curve.evaluate(at).jacobian
    return float(-np.linalg.solve(jacobian[:, :-1], jacobian[:, -1])[curve.orbit.n])


def equations_of(kind: Kind, problem: OrbitProblem, details: Details) -> ExtendedSystem:
    """Return the exact equations of an event of a kind that has curves."""
    system = kind.equations(problem, details)
    assert system is not None, "every kind that has curves has equations"
    return system


MUTUAL = ("G-PD", "G-FB")
"""Points on curves of grazing orbits that are seen from the curves of PD and FB as well."""

SAMPLES = 500
"""Instants of a flight at which its touch is looked for."""


class SimultaneousEvents(ExtendedSystem):
    """Two events of one orbit at once; the first one's own unknowns, `size` of them, go first."""

    def __init__(self, one: ExtendedSystem, other: ExtendedSystem, size: int) -> None:
        super().__init__(one.problem)
        self.one, self.other, self.size = one, other, size

    def start(self, here: Linearisation) -> Array:
        return np.concatenate([self.one.start(here), self.other.start(here)])

    def assemble(self, here: Linearisation, own: Array) -> SystemEvaluation:
        n, orbit = self.problem.n, len(here.unknowns)
        first = self.one.assemble(here, own[: self.size])
        second = self.other.assemble(here, own[self.size :])
        rows = len(first.residual)
        jacobian = np.zeros((rows + len(second.residual) - n, orbit + len(own)))
        jacobian[:rows, : orbit + self.size] = first.jacobian
        jacobian[rows:, :orbit] = second.jacobian[n:, :orbit]
        jacobian[rows:, orbit + self.size :] = second.jacobian[n:, orbit:]
        return SystemEvaluation(np.concatenate([first.residual, second.residual[n:]]), jacobian)

    def rounding(self, here: Linearisation, own: Array) -> Array:
        first = self.one.rounding(here, own[: self.size])
        second = self.other.rounding(here, own[self.size :])
        return np.concatenate([first, second[self.problem.n :]])

    def scale(self, own: Array, sizes: Array) -> Array:
        first = self.one.scale(own[: self.size], sizes)
        return np.concatenate([first, self.other.scale(own[self.size :], sizes)])

    def own_sizes(self, own: Array, sizes: Array) -> Array:
        first = self.one.own_sizes(own[: self.size], sizes)
        return np.concatenate([first, self.other.own_sizes(own[self.size :], sizes)])

    def details(self, own: Array) -> Details:
        return {**self.one.details(own[: self.size]), **self.other.details(own[self.size :])}


@dataclass(frozen=True)
class _CurvePoint:
    """What test functions of curves ask of a point."""

    orbit: Linearisation
    own: Array
    details: Details

    @property
    def unknowns(self) -> Array:
        return self.orbit.unknowns

    @property
    def residual(self) -> Array:
        return self.orbit.residual

    @property
    def jacobian(self) -> Array:
        return self.orbit.jacobian


class VanishingTest(ExtendedSystem):
    """An event at which a test function of its curve vanishes besides."""

    def __init__(self, one: ExtendedSystem, test: CurveTest, index: int, details: Details) -> None:
        super().__init__(one.problem)
        self.one, self.test, self.index, self.told = one, test, index, dict(details)

    def start(self, here: Linearisation) -> Array:
        return self.one.start(here)

    def assemble(self, here: Linearisation, own: Array) -> SystemEvaluation:
        first = self.one.assemble(here, own)
        x = np.concatenate([here.unknowns, own])
        row = difference_gradient(self._value, x, self._sizes(here, own))
        return SystemEvaluation(
            np.append(first.residual, self._value(x)), np.vstack([first.jacobian, row])
        )

    def rounding(self, here: Linearisation, own: Array) -> Array:
        first = self.one.rounding(here, own)
        value = abs(self._value(np.concatenate([here.unknowns, own])))
        return np.append(first, max(value, EPSILON * len(first)))

    def scale(self, own: Array, sizes: Array) -> Array:
        return self.one.scale(own, sizes)

    def own_sizes(self, own: Array, sizes: Array) -> Array:
        return self.one.own_sizes(own, sizes)

    def details(self, own: Array) -> Details:
        return self.one.details(own)

    def _sizes(self, here: Linearisation, own: Array) -> Array:
        orbit = sizes_of(here)
        return np.concatenate([orbit, self.one.scale(own, orbit)])

    def _value(self, x: Array) -> float:
        n, problem = self.problem.n + self.problem.free, self.problem
        own = x[n:]
        here = _CurvePoint(problem.evaluate(x[:n]), own, {**self.told, **self.one.details(own)})
        return float(np.atleast_1d(self.test.of(here))[self.index])


class DoubleEvent(Kind):
    """A kind of event at points of its curves where another one happens, or nearly."""

    def __init__(self, name: str, one: Kind, other: Kind | None) -> None:
        self.name, self.changes = name, one.changes
        self.kinds = [one] if other is None else [one, other]

    def test(self, problem: OrbitProblem, values: Values) -> TestFunction:
        return self.kinds[0].test(problem, values)

    def critical(self, multipliers: Array) -> list[int]:
        return sorted({place for kind in self.kinds for place in kind.critical(multipliers)})

    def is_on_circle(self, here: Linearisation) -> bool:
        return all(kind.is_on_circle(here) for kind in self.kinds)

    def verdict(self, here: Linearisation, details: Details) -> Verdict:
        """Touches and impacts of zero velocity are forgiven."""
        own = next((kind for kind in self.kinds if kind.finding is not None), self.kinds[0])
        return own.verdict(here, details)

    def curve_limits(self) -> Mapping[EndKind, TestFunction]:
        return {end: test for kind in self.kinds for end, test in kind.curve_limits().items()}

    def curve_end(self, own: Array) -> EndKind | None:
        return self.kinds[0].curve_end(own)


class ParameterTurn(TestFunction):
    """The last parameter turns back."""

    kind = "turn"

    def values(self, point: Point) -> Array:
        return point.tangent[-1:]

    def details(self, point: Point, index: int) -> Details:
        return {"index": index, "changes": "two points of codimension two meet and vanish"}


class OtherKindTest(TestFunction):
    """A test function of one of two kinds' curves, on the curve where both happen, which has that
    name; `own` are that kind's own unknowns, and the values `without` vanish all along."""

    def __init__(self, name: str, test: CurveTest, own: slice, without: Sequence[int] = ()) -> None:
        self.kind, self.test, self.own, self.without = f"{name}, {test.kind}", test, own, without

    def values(self, point: Point) -> Array:
        values = self.test.values(self.of_one(point))
        values[list(self.without)] = np.nan
        return values

    def of_one(self, point: Point) -> Point[_CurvePoint]:
        """Return a point as one of that kind's curve."""
        here: AnyCurvePoint = point.evaluation
        return replace(point, evaluation=_CurvePoint(here.orbit, here.own[self.own], here.details))

    def enters(self, point: Point, index: int) -> bool:
        return self.test.enters(self.of_one(point), index)

    def accept(self, event: Event) -> bool:
        return self.test.accept(replace(event, point=self.of_one(event.point)))

    def details(self, point: Point, index: int) -> Details:
        return self.test.details(self.of_one(point), index)


@dataclass(frozen=True)
class DoubleSystem:
    """The equations of a point of codimension two, and what to look for on its curve."""

    kind: DoubleEvent
    system: ExtendedSystem
    details: Details
    tests: Sequence[TestFunction]


def double_of(
    here: Linearisation, name: str, kind: Kind, details: Details, changes: str = ""
) -> DoubleSystem:
    """Return the equations of a point of codimension two, such as ``PD-G``, on a curve of a kind,
    from the orbit there and the curve's details. What changes there tells points of one name apart.

    Raises InputError if curves of this kind have no such points.
    """
    one, at, test, index = _vanishing_test(here, name, kind, details, changes)
    told = at.details
    second = test.other(at, index)
    if second is not None:
        other = kind_of(second[0])
        smooth_last = kind.finding is not None and other.finding is None
        pair = (other, kind) if smooth_last else (kind, other)
        return _pair(here, *pair, {**told, **second[1]})
    own = slice(0, len(at.own))
    tests = [
        OtherKindTest(name, t, own) for t in _curve_tests(kind, here.problem) if t.kind != name
    ]
    system = VanishingTest(one, test, index, told)
    return DoubleSystem(DoubleEvent(name, kind, None), system, told, [*tests, ParameterTurn()])


def starts_at(
    here: Linearisation, name: str, kind: Kind, details: Details, changes: str = ""
) -> list[CurveStart]:
    """Return the curves that start at a point of codimension two, or pass it.

    Parameters as of `double_of`.
    """
    _, at, test, index = _vanishing_test(here, name, kind, details, changes)
    return test.born(at, index)


def _vanishing_test(
    here: Linearisation, name: str, kind: Kind, details: Details, changes: str
) -> tuple[ExtendedSystem, _CurvePoint, CurveTest, int]:
    """The curve's equations at a point, and which value of which test function vanishes there."""
    told = _event_place(here, details)
    one = equations_of(kind, here.problem, told)
    at = _CurvePoint(here, one.start(here), told)
    return one, at, *_smallest_test(at, kind, name, changes)


def _pair(here: Linearisation, kind: Kind, other: Kind, details: Details) -> DoubleSystem:
    """Two events of one orbit at once."""
    problem, name = here.problem, f"{kind.name}-{other.name}"
    one, two = (equations_of(k, problem, details) for k in (kind, other))
    size = len(one.start(here))
    tests: list[TestFunction] = []
    for test in (t for t in _curve_tests(kind, problem) if t.pole != other.name):
        vanishing = [_place(problem, details)] if test.kind == name else []
        tests.append(OtherKindTest(name, test, slice(0, size), [*vanishing, *test.at_rest(here)]))
    mutual = {*MUTUAL, f"{other.name}-{kind.name}"}
    theirs = (t for t in _curve_tests(other, problem) if t.pole != kind.name)
    tests += [OtherKindTest(name, t, slice(size, None)) for t in theirs if t.kind not in mutual]
    return DoubleSystem(
        DoubleEvent(name, kind, other),
        SimultaneousEvents(one, two, size),
        details,
        [*tests, ParameterTurn()],
    )


def _place(problem: OrbitProblem, details: Details) -> int:
    """Which of the values of a test function belongs to an impact, a flight, or a touch on one, if
    one of them does."""
    if "impact" in details:
        return int(details["impact"])
    if "wall" not in details:
        return int(details.get("flight", 0))
    walls = problem.model.letters
    return int(details["flight"]) * len(walls) + walls.index(details["wall"])


def _event_place(here: Linearisation, details: Details) -> Details:
    """Where on the orbit the curve's event is, the time of its touch as it is here."""
    told = dict(details)
    if "touch_time" in told and "impact" in told:  # where motion begins on its limit
        told["touch_time"] = float(here.problem.impacts(here.unknowns)[told["impact"], 0])
    elif "touch_time" in told:
        told["touch_time"] = _time_of_touch(here, told["flight"], told["wall"])
    return told


def _time_of_touch(here: Linearisation, flight: int, wall: str) -> float:
    """The time at which a flight comes nearest to lying on a wall with no velocity.

    Its smallest gap may be another one, where the flight passes the wall.
    """
    problem = here.problem
    values = problem.values(here.unknowns)
    begin, end = problem.times_around(here.unknowns, flight)
    away = problem.kernels.setup(*values).walls[problem.model.letters.index(wall)]
    left, row = problem.leaving(here.unknowns, flight)
    motion = problem.kernels.gap_after(left, wall)
    inside = np.linspace(0.0, end - begin, SAMPLES + 2)[1:-1]
    tracks = [motion(*row, dt, *values)[:2] for dt in inside.tolist()]
    gap, velocity = np.transpose(tracks) - [[away], [0.0]]
    nearest = np.argmin((gap / np.ptp(gap)) ** 2 + (velocity / np.ptp(velocity)) ** 2)
    return float(begin + inside[nearest])


def _curve_tests(kind: Kind, problem: OrbitProblem) -> list[CurveTest]:
    return [test for test in kind.codimension_two(problem.word) if isinstance(test, CurveTest)]


def _smallest_test(at: _CurvePoint, kind: Kind, name: str, changes: str) -> tuple[CurveTest, int]:
    """The test function that vanishes at a point, and which of its values."""
    tests = _curve_tests(kind, at.orbit.problem)
    point = Point(at, at.own, math.nan, 0.0, 0)
    found = [
        (abs(value), place, test, index)
        for place, test in enumerate(tests)
        if test.kind == name and changes in ("", test.changes)
        for index, value in enumerate(test.values(point))
        if np.isfinite(value)
    ]
    if not found:
        known = ", ".join(dict.fromkeys(test.kind for test in tests))
        raise InputError(
            "point", f"{short_repr(name)} on a curve of {kind.name}", f"accepted: {known}"
        )
    return min(found)[2:]


# Steps along curves in two parameters, plainly or compiled.

SMALLEST = -700.0
"""The least logarithm of a determinant."""


def tangent_of_curve(
    curve: SystemVectors, z: Vector, row: Vector, scale: Vector, out: Vector
) -> float:
    """Fill `out` with the unit tangent at the point last evaluated that goes on along `row`.

    Returns the determinant of the Jacobian bordered by the tangent, columns by their scales and
    rows by their lengths; NaN where no tangent is defined.
    """
    n = len(z)
    sign, logarithm = solve_bordered(curve, row, 0.0, 1.0, out)
    size = 0.0
    for i in range(n):
        part = out[i] / scale[i]
        size += part * part
    size = math.sqrt(size)
    if not (sign != 0.0 and size > 0.0 and size - size == 0.0):
        return math.nan
    for i in range(n):
        out[i] /= size
        logarithm += math.log(scale[i])
    for i in range(n - 1):
        given, length = curve.jacobian[i], 0.0
        for j in range(n):
            part = given[j] * scale[j]
            length += part * part
        if not length > 0.0:
            return 0.0
        logarithm -= 0.5 * math.log(length)
    # the border is row / scale^2; with the tangent itself in its place it is longer by `size`
    return sign * math.exp(max(logarithm + math.log(size), SMALLEST))


def observe_curve(
    curve: SystemVectors, z: Vector, tangent: Vector, orientation: float, row: Vector, at: int
) -> None:
    """Record flights and residuals in a row."""
    for k in range(len(curve.kinds)):
        block = curve.blocks[k]
        for i in range(BLOCK):
            row[at + i] = block[i]
        at += BLOCK
    for i in range(len(curve.residual)):
        row[at + i] = curve.residual[i]


# The program that takes steps along curves of one kind for any word of a model, for compiling.


def program_of(kernels: Kernels, variant: str) -> Program:
    """Return the program that takes steps along curves of any word of a model.

    Both parameters of the kernels are free; the variant is "singular" for FB and PD, "touching" for
    G.
    """
    from .orbit_program import glue_steps

    program = Program({})
    add_kernels(program, kernels, variant, "any")
    evaluate, _ = FUNCTIONS[variant]
    called = newton_step, tangent_of_curve, evaluate, size_on_curve, observe_curve
    text, observe = EVALUATE[variant], observe_curve.__name__
    return glue_steps(program, kernels, SystemVectors, text, *called, observe=observe)


AT_ONCE = 8
"""Steps made at a time by compiled code; those beyond the end of a curve are made in vain."""

ARGUMENTS = "ii" + "ffffff" + "FFF" + "ffffff" + "FF"
"""Kinds of the entry's arguments: those of `SystemVectors`, then those of `StepVectors`."""


class CurveBackend(Backend):
    """A curve's problem as steps ask for it, by the equations `variant`; use `backend_of`."""

    def __init__(self, problem: CurveProblem, variant: str) -> None:
        self.problem, self.variant = problem, variant
        self.count = len(problem.orbit.word)
        self.made: dict[bytes, CurvePoint] = {}

    def vectors(self, size: int, made_by: Containers) -> SystemVectors:
        """The problem as vectors and tables."""
        orbit, form = self.problem.orbit, self.problem.system.form
        assert form is not None
        second = list(orbit.model.values).index(orbit.kernels.parameters[1])
        return vectors_of(orbit, form, size, second, made_by)

    def advance(self, position: Position, most: int) -> Batch:
        """Take steps until one is proposed or refused, `most` at most; plainly, one."""
        n, fast = len(position.scale), self.compiled
        made_by, most = (ARRAYS, min(most, AT_ONCE)) if fast else (LISTS, 1)
        curve = self.vectors(n, made_by)
        curve.sizes[:] = position.scale[: self.problem.orbit.n].tolist()
        vectors = position.vectors(BLOCK * self.count + n - 1, most, made_by)
        if fast:
            made = fast(*curve, *vectors)
        else:
            functions = self.evaluate, newton_step, tangent_of_curve, observe_curve
            with timed_plainly(self.program):
                made = take_steps(*functions, curve, tuple(vectors))
        flights = int(vectors.state[EVALUATIONS]) * self.flights
        self.problem.orbit.kernel_evaluations += flights
        return batch_of(position, self.problem, vectors, made, lambda rows: self.block(rows, n))

    @property
    def flights(self) -> int:
        """Flights evaluated at a point, those of second derivatives among them."""
        return 2 * self.count if self.variant == "singular" else self.count + 1

    def block(self, rows: Array, n: int) -> Block:
        """The points in the rows of `take_steps`."""
        return Block(*columns(rows, n), self.point)

    def point(self, unknowns: Array, described: Array) -> CurvePoint:
        """The point of a row, made once: what is asked of it is kept with it."""
        key = unknowns.tobytes()
        if key not in self.made:
            orbit, own = self.problem.unpacked(unknowns)
            blocks = flights_of(described[: BLOCK * self.count].reshape(-1, BLOCK), 2)
            here = Linearisation(self.problem.orbit, orbit, blocks)
            residual = described[BLOCK * self.count :]
            self.made[key] = CurvePoint(self.problem, unknowns, residual, here, own)
        return self.made[key]

    @functools.cached_property
    def evaluate(self) -> Callable[[SystemVectors, Vector], float]:
        """The plain evaluation."""
        kernels = self.problem.orbit.kernels
        flights = kernels.flights, *[kernels.seconds] * (self.variant == "singular")
        function, _ = FUNCTIONS[self.variant]

        def evaluate(*given: Any) -> float:
            *_, curve, z = given
            return size_on_curve(curve, z, function(*given))

        plain: Any = plainly(evaluate, self.problem.orbit, *flights)
        return plain

    @functools.cached_property
    def compiled(self) -> CompiledProgram | None:
        """Compiled code, where there is any and it pays."""
        kernels, variant = self.problem.orbit.kernels, self.variant
        integrated = any(kernels.integrated(wall.name) for wall in kernels.model.WALLS)
        if mode() == "never" or integrated:
            return None
        return load(self.program, ARGUMENTS, lambda: program_of(kernels, variant))

    @property
    def program(self) -> tuple[str, ...]:
        """What tells its program from others."""
        return self.problem.orbit.kernels.identity, self.variant, "curves"


def backend_of(problem: CurveProblem) -> CurveBackend | SwitchingBackend | None:
    """Return a curve's problem for several steps at a time.

    None where there is none: for other equations, more than one degree of freedom or two free
    parameters, free periods, long words, and flights that are no straight-line code.
    """
    orbit = problem.orbit
    form = problem.system.form
    if form is None or orbit.free != 2 or not is_scalar(orbit):
        return None
    backend = CurveBackend(problem, form.variant)
    if not any(orbit.kernels.flown(*kind) for kind in orbit.kinds):
        return backend
    return SwitchingBackend(backend, problem, orbit.kernels)
