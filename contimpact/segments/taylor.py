"""Integrated flights in compiled programs: Taylor's method in the plain subset of Python.

What `integration` has heyoka do, for one field and for derivatives by some directions: the same
equations, order and steps, but that derivatives by the duration follow without an equation, so that
results differ by rounding alone. `taylor_text` writes the text for a field; here are the functions
that it calls, the kernels that call it, and the programs of single flights.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array, Table, Vector, tail
from ..syntax import parse
from .compiling import load, mode
from .integration import (
    CLOSE,
    KEPT,
    LOOKS,
    MOST_STEPS,
    MOVED,
    NEAR,
    NOISE,
    NONE_LEFT,
    SCALE,
    SHORTEST_STEP,
    SOME_STEPS,
    UNIT,
    StepLimitError,
    allowed_steps,
    charge_steps,
    integrator,
    statement,
)
from .kernel import ELEMENTARY, Family, Kernel, declaration, function_of
from .oscillation import (
    COEFFICIENTS,
    DEGREE,
    HALVINGS,
    START,
    WIDTH,
    Ends,
    Excursion,
    FollowedFlight,
    excursion_on_steps,
    record_break,
    zeros_of_all,
)
from .taylor_text import Writer

if TYPE_CHECKING:
    from .machine_code import Program

ORDER = DEGREE
"""Order of the series: heyoka's for errors at rounding."""

SMALLEST = 1.0 / SCALE
"""Size of a state below which errors are no longer relative to it."""


def step_length(order: int, size: float, last: float, before: float, left: float) -> float:
    """Return the length of a step.

    By Jorba and Zou's (2005) estimate of the radius of convergence, from the largest coefficients
    of the last order and of the one before beside the largest number of the state; at most what is
    left.
    """
    size, part = max(size, SMALLEST), math.exp(-2.0) * math.exp(-0.7 / (order - 1))
    if last > 0.0:
        left = min(left, part * (size / last) ** (1.0 / order))
    if before > 0.0:
        left = min(left, part * (size / before) ** (1.0 / (order - 1)))
    return left


@dataclass(frozen=True, eq=False)
class BySeries:
    """A function of plain text, and how many numbers of scratch space it takes."""

    space: int
    make: Callable[[], Kernel]
    """Makes the function, which nobody asks for where a compiled program is in the cache."""

    @functools.cached_property
    def function(self) -> Kernel:
        """The function."""
        return self.make()


@functools.cache
def flight_by_series(
    field: str, directions: str, along: int = 0, tolerance: float = UNIT
) -> BySeries:
    """Return what `Integrator` does for a field and directions, as a plain function.

    It takes the numbers of `Statement.names`, scratch space, the largest number of steps, whose
    errors are about the `tolerance`, as in `Integrator`, and the largest part of the flight that a
    step takes. It returns NaN where these do not suffice or the flow ceases to be finite, and says
    at the head of the space how many they are. With `along` it takes so many derivatives of all
    numbers along a direction behind these, and returns those of the results behind the results.

    Raises NotImplementedError for a field with an operation that has no series here.
    """
    writer = Writer(field, tuple(directions.split()), along)
    order = math.ceil(1.0 - 0.5 * math.log(tolerance))
    more = {"ORDER": order, "CLOSE": max(CLOSE * UNIT, NEAR * tolerance)}
    return _by_series(writer, "flight", writer.flight("flight"), more, step_length)


@functools.cache
def path_by_series(field: str) -> BySeries:
    """Return a plain function that fills in the pieces of a flight by a field; see `follow_step`.

    It takes the numbers of `Statement.names`, whose duration is positive, scratch space, the
    weights of the coordinates in each of some gap coordinates, how many these are, and what is
    filled in; it returns how many pieces there are, -1 if they would be too many. Raises
    NotImplementedError as `flight_by_series` does.
    """
    writer = Writer(field, ())
    called = step_length, follow_step, begin_path
    return _by_series(writer, "path", writer.path("path"), {}, *called)


@functools.cache
def steps_by_series(field: str) -> BySeries:
    """Return a plain function that fills in the steps of a flight by a field; see `record_step`.

    It takes the numbers of `Statement.names`, scratch space, and the table that is filled in; it
    returns how many steps there are, as a negative number if they would be too many or the flow
    ceases to be finite.
    Raises NotImplementedError as `flight_by_series` does.
    """
    writer = Writer(field, ())
    return _by_series(writer, "steps", writer.steps("steps"), {}, step_length, record_step)


def _by_series(
    writer: Writer, name: str, text: str, more: dict[str, float], *called: Callable[..., object]
) -> BySeries:
    """A function by its text."""
    numbers = NUMBERS | {"STRIDE": writer.stride, **more}
    make = functools.partial(_function_by_series, writer, name, text, numbers, called)
    return BySeries((int(numbers["ORDER"]) + 1 + writer.further) * writer.stride, make)


def _function_by_series(
    writer: Writer,
    name: str,
    text: str,
    numbers: dict[str, float],
    called: Sequence[Callable[..., object]],
) -> Kernel:
    """A function from its text, which has a module and names of its own, so that the programs that
    call it share its machine code."""
    texts = dict(writer.helpers)
    if writer.hides:
        texts |= {"force": writer.force(), "misses": writer.misses()}
    texts[name] = text
    own = re.compile(rf"\b({'|'.join(texts)})(?=\()")
    whole = _PLACEHOLDER.sub(lambda found: repr(numbers[found[0]]), "\0".join(texts.values()))
    mark = hashlib.sha256(whole.encode()).hexdigest()[:16]
    declared = declaration(Family.SERIES, ()) if writer.directions else ""
    names: dict[str, Any] = {"math": math, "tail": tail} | {one.__name__: one for one in called}
    for helper, lines in zip(texts, own.sub(rf"\1_{mark}", whole).split("\0"), strict=True):
        marked, file = f"{helper}_{mark}", f"<{helper} by {writer.field}>"
        function = function_of(marked, declared + lines, file, ELEMENTARY, names)
        function.__module__ = f"{__name__}.{mark}"
        names[marked] = function
    return function


NUMBERS: dict[str, float] = {
    "ORDER": ORDER,
    "LOOKS": LOOKS,
    "CLOSE": CLOSE * UNIT,
    "NOISE": NOISE,
    "MORE": 1.0 + MOVED * UNIT,
    "LESS": 1.0 - MOVED * UNIT,
    "SHORTEST_STEP": SHORTEST_STEP,
    "MOST_STEPS": MOST_STEPS,
}
_PLACEHOLDER = re.compile("|".join(rf"\b{name}\b" for name in [*NUMBERS, "STRIDE"]))


@functools.cache
def has_series(field: str) -> bool:
    """Whether all operations of a field have series here."""
    try:
        path_by_series(field)
    except NotImplementedError:
        return False
    return True


# Kernels that integrate, as they are compiled: with scratch space as a last argument.


@functools.lru_cache(KEPT)
def flight_kernel(kernel: Kernel) -> BySeries:
    """Return a kernel whose calls of `integration.flown` are replaced by functions of plain text.

    Raises NotImplementedError as `flight_by_series` does.
    """
    function, flights = _function_of(kernel), dict[str, BySeries]()
    for call in ast.walk(function):
        if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "flown":
            name = f"flown_{len(flights)}"
            flights[name] = flight_by_series(*map(ast.literal_eval, call.args[:2]))
            call.func, call.args[:2] = ast.Name(name, ast.Load()), []
            call.args += [ast.Name("space", ast.Load()), *map(ast.Constant, (MOST_STEPS, 1.0))]
    return _kernel_with(kernel, function, ["space"], flights)


@functools.lru_cache(KEPT)
def path_kernel(kernel: Kernel) -> BySeries:
    """Return the kernel ``field`` of a wall as a function of what the kernel takes, the flight's
    duration and what `path_by_series` takes, which fills in the pieces of the flight."""
    function, result, field, numbers = _taken_apart(kernel)
    found = path_by_series(field)
    more = ["length", "space", "weights", "count", "way"]
    length, *others = (ast.Name(name, ast.Load()) for name in more)
    result.value = ast.Call(ast.Name("path", ast.Load()), [length, *numbers.elts, *others], [])
    return _kernel_with(kernel, function, more, {"path": found})


def departure_kernel(kernel: Kernel) -> Kernel:
    """Return the kernel ``field`` of a wall as one of what its flight starts with: the time,
    positions, velocities, and the field's parameters."""
    function, result, _, numbers = _taken_apart(kernel)
    result.value = numbers
    return _kernel_with(kernel, function, [], {}).function


def start_kernel(kernel: Kernel, freedom: int) -> Kernel:
    """Return the kernel ``field`` of a wall as one of the positions from which its flight starts,
    as many as there are coordinates: those that the mode does not have are at zero."""
    function, result, field, numbers = _taken_apart(kernel)
    own = statement(field).freedom
    rest = [ast.Constant(0.0) for _ in range(freedom - own)]
    result.value = ast.Tuple([*numbers.elts[1 : 1 + own], *rest], ast.Load())
    return _kernel_with(kernel, function, [], {}).function


def field_of(kernel: Kernel) -> str:
    """Return the text of the field that a kernel ``field`` returns."""
    return _taken_apart(kernel)[2]


def _taken_apart(kernel: Kernel) -> tuple[ast.FunctionDef, ast.Return, str, ast.Tuple]:
    """A kernel ``field``, its last line, and what it returns: the field and the numbers."""
    *_, result = (function := _function_of(kernel)).body
    assert isinstance(result, ast.Return)
    assert isinstance(result.value, ast.Tuple)
    field, numbers = result.value.elts
    assert isinstance(numbers, ast.Tuple)
    return function, result, str(ast.literal_eval(field)), numbers


def _function_of(kernel: Kernel) -> ast.FunctionDef:
    return next(node for node in parse(kernel.text).body if isinstance(node, ast.FunctionDef))


def _kernel_with(
    kernel: Kernel, function: ast.FunctionDef, more: Sequence[str], called: dict[str, BySeries]
) -> BySeries:
    """A kernel from its changed tree, which takes more arguments."""

    def make() -> Kernel:
        function.args.args += [ast.arg(name) for name in more]
        text = ast.unparse(ast.fix_missing_locations(function))
        name, names = kernel.__name__, kernel.__globals__
        own = {name: found.function for name, found in called.items()}
        return function_of(name, text, f"<{name} by series>", names, {**kernel.functions, **own})

    return BySeries(max((found.space for found in called.values()), default=0), make)


# Flights from their start to their end, as polynomials.


def begin_path(count: int, way: FollowedFlight) -> None:
    """Begin to fill in a flight."""
    for g in range(count):
        way.found[g], way.signs[g] = 0.0, 0.0


def follow_step(
    d: int,
    stride: int,
    w: Vector,
    length: float,
    at: float,
    h: float,
    weights: Vector,
    count: int,
    made: int,
    way: FollowedFlight,
) -> int:
    """Fill in the pieces of one step of a flight, and when accelerations change sign in it.

    A step is cut until no gap coordinate's acceleration has more than one zero in a piece, as in
    `oscillation.follow_all`. The series of the mean velocities stand at the beginnings of the rows
    of `w`, which are overwritten. Returns how many pieces there are with those before; -1 for more
    than there are places for.
    """
    most, scale = len(way.steps) // count, length
    for k in range(ORDER + 1):
        for i in range(d):
            w[stride * k + i] *= scale
        scale *= h
    for i in range(d):
        way.moving[i] = way.forces[i]
    place, width = 0.0, 1.0
    while place < 1.0:
        if made == most:
            return -1
        width = min(width, 1.0 - place)
        begin, lasts = length * (at + h * place), length * h * width
        for i in range(d):
            shift_series(stride, i, w, place, width, way.own[i])
            way.own[i][START], way.own[i][WIDTH] = begin, lasts
            way.forces[i] = lasts * lasts * way.moving[i]
        if zeros_of_all(d, weights, count, made, way) > 1.0 and width > 0.5**HALVINGS:
            width *= 0.5
            continue
        for g in range(count):
            record_break(g, count, made, begin + lasts, way)
        place += width
        width *= 2.0
        made += 1
    return made


EXCURSION = 8
"""Numbers of scratch space of `excursion_by_path`, before those of the path."""


def excursion_by_path(
    path: Callable[..., int],
    head: Vector,
    values: Vector,
    ends: Ends,
    steps: Table,
    breaks: Vector,
    space: Vector,
) -> Excursion:
    """As `oscillation.excursion_by_law`, for a flight of one coordinate that is integrated.

    ``path(head, values, length, space, way)`` is that of `path_kernel`; `steps` has a row more than
    there may be pieces.
    """
    most = len(steps) - 1
    found, signs, zeros, moving, forces = space[0:], space[1:], space[2:], space[3:], space[5:]
    way = FollowedFlight(steps[most:], steps[:most], breaks, found, signs, zeros, moving, forces)
    made = path(head, values, ends[0], space[EXCURSION:], way)
    return excursion_on_steps(made, int(found[0]), values, ends, steps, breaks)


def shift_series(stride: int, i: int, w: Vector, place: float, width: float, row: Vector) -> None:
    """Fill in the row of a piece of a step: a polynomial by powers of the part of the piece.

    `place` and `width` are where the piece begins and its width, as parts of the step.
    """
    last, scale = COEFFICIENTS + ORDER, 1.0
    for k in range(ORDER + 1):
        row[last - k] = w[stride * k + i]
    if place != 0.0:
        for k in range(ORDER):
            for j in range(COEFFICIENTS + 1, last + 1 - k):
                row[j] += place * row[j - 1]
    if width != 1.0:
        for k in range(ORDER + 1):
            row[last - k] *= scale
            scale *= width


# Compiled programs of single flights.

ROWS = 2**10
"""Largest number of steps of a flight whose polynomials a program finds."""


def flight_identity(
    field: str, directions: str, along: int = 0, tolerance: float = UNIT
) -> tuple[str, ...]:
    """Return the identity of the program of `run_flights`."""
    return FLOWN, field, directions, str(along), str(tolerance)


FLOWN, DENSE = "flown", "flown densely"
"""Begin the identities of programs: of flights, and of the polynomials of flights."""


def run_flights(
    field: str,
    directions: str,
    rows: Array,
    along: int = 0,
    tolerance: float = UNIT,
    limits: Array | None = None,
) -> Array | None:
    """Return the results of flights, a row each, by a compiled program, if that is there or pays.

    They are NaN where a flight does not stay finite or takes more than `SOME_STEPS`, unless those
    that failed have left so many of `MOST_STEPS`, as in `BatchIntegrator.each`. `limits` are
    the largest part of a flight that a step takes, and the numbers of steps of the last flight and
    of all, which are filled in.
    """
    if not _has_programs(field):
        return None
    flight = flight_by_series(field, directions, along, tolerance)
    identity, count = flight_identity(field, directions, along, tolerance), rows.shape[1]
    # it pays at once: heyoka's integrator takes as long to compile
    run = load(identity, "FffF", lambda: _program(_FLIGHTS, count, flight), after=0.0)
    if run is None:
        return None
    size = 2 * (along + 1) * statement(field).freedom * (1 + len(directions.split()))
    found = np.empty((len(rows), size))
    if not allowed_steps(1):
        raise StepLimitError(NONE_LEFT)
    limits = np.array([1.0, 0.0, 0.0]) if limits is None else limits
    run(np.ascontiguousarray(rows), limits, np.empty(flight.space), found)
    charge_steps(int(limits[2]))
    return found


def polynomials_of(field: str, numbers: Sequence[float]) -> tuple[Array, Array, Array]:
    """Return a flight as polynomials, as `Integrator.dense` does: by a compiled program, if that
    is there or pays."""
    if _has_programs(field):
        steps = steps_by_series(field)
        run = load((DENSE, field), "ffF", lambda: _program(_STEPS, len(numbers), steps), after=0.0)
        d = statement(field).freedom
        found, made = np.empty((ROWS, 1 + 2 * d * (ORDER + 1))), 0
        if run is not None:
            made = run(np.array(numbers), np.empty(steps.space), found)
            charge_steps(abs(made))
        if made > 0 and np.isfinite(found[:made]).all():
            means, speeds = np.split(found[:made, 1:].reshape(made, 2 * d, -1), 2, axis=1)
            return np.append(found[:made, 0], 1.0), means, speeds
    return integrator(field).dense(numbers)


def _has_programs(field: str) -> bool:
    return mode() != "never" and has_series(field)


def _program(text: str, count: int, called: BySeries) -> Program:
    """A program of flights that takes so many numbers for each of them."""
    from .machine_code import Program

    program = Program({})
    numbers = ", ".join(f"x[{i}]" for i in range(count))
    steps = {"most": MOST_STEPS, "some": SOME_STEPS}
    program.glue(text.format(numbers=numbers, **steps), flight=called.function)
    return program


_FLIGHTS = """
def entry(rows, limits, space, found):
    left = {most}
    for k in range(len(rows)):
        x, out = rows[k], found[k]
        results = flight({numbers}, space, max({some}, left), limits[0])
        limits[1] = space[0]
        limits[2] += space[0]
        if results[0] - results[0] != 0.0:
            left -= int(space[0])
        for i in range(len(out)):
            out[i] = results[i]
    return 0
"""
_STEPS = """
def entry(x, space, found):
    return flight({numbers}, space, found)
"""


def record_step(
    d: int, stride: int, w: Vector, at: float, h: float, made: int, found: Table
) -> int:
    """Fill in a row: where a step of length h begins, and the polynomials of the state in it.

    Their coefficients are by powers of the part of the step; the series of the state stand at the
    beginnings of the rows of `w`. Returns how many rows there are; -1 for more than there are
    places for.
    """
    if made == len(found):
        return -1
    row, scale = found[made], 1.0
    row[0] = at
    for k in range(ORDER + 1):
        for i in range(2 * d):
            row[1 + (ORDER + 1) * i + k] = scale * w[stride * k + i]
        scale *= h
    return made + 1
