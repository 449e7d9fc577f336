r"""Linear flights from impact to impact, plainly and compiled.

A flight is cut into pieces of one length, on each of which the state X of `segments.linear_flow` is
its Taylor polynomial. Tables made once for each law lead from X at the beginning of a piece to the
polynomial of every gap coordinate, displacement by displacement,

.. math:: n \cdot x(sh) - n \cdot x(0) = \sum_{k=1}^{K} c_k s^k, \qquad
          c_k = \frac{h^k}{k!}\,(n, 0)\,G^k X,

and to X at its end. Bounds by the coefficients say that a piece is clear of all guards, or that the
velocity or the acceleration has one sign on it; otherwise it is halved. `segments.flight` then
finds the first arrival by Newton's iteration inside a bracket, so that none is missed.

The functions up to `make_flights` are in the plain subset of Python that `contimpact.compiling`
compiles: vectors are lists in plain Python, arrays in compiled code, and both have the same bits. A
flight on which a wall is held or released, or that is not resolved here, is left to the
`automaton`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..arrays import INTEGERS, VECTOR, Array, Vector
from ..segments.flight import hit_between
from ..segments.linear_flow import Shape, generator_of, mean_of, scales_of
from ..segments.segment import Kernel
from ..segments.track import turns_of
from .motions import REPEATED
from .run import (
    BEYOND,
    COLUMNS,
    DONE,
    FLIGHTS,
    LEFT,
    LONG,
    NO_IMPACT,
    AnyFlights,
    Engine,
    Runs,
    Setting,
    arrivals,
    flights_class,
    formulas,
    glue_entry,
    is_beyond,
    make_flights,
    section_place,
)

if TYPE_CHECKING:
    from ..segments.kernels import Kernels
    from ..segments.machine_code import Program

TERMS = 18
"""Powers of the polynomials."""
PARTS = 500
"""Parts of a piece at most; what is not resolved then is left to the `automaton`."""


FIELDS = {
    **FLIGHTS,
    "width": INTEGERS,
    "count": INTEGERS,
    "piece": VECTOR,
    "tables": VECTOR,
    "steps": VECTOR,
}
"""Of each law (l,), besides: the size of X, the pieces of a period, and their duration; of each law
and row `TERMS` coefficients for each coordinate of X; and of each law what each coordinate of X
gains on a piece by each."""
Flights: Any = flights_class("Flights", FIELDS)


def space_of(flights: AnyFlights) -> int:
    """Return how many numbers of scratch space `make_flights` takes."""
    _, width, gaps, rows, _ = flights.sizes
    return int(4 * width + 3 * gaps + TERMS * (rows + 1))


# In the plain subset of Python.
#
# Scratch space holds X, what it becomes, X a period before, and the section coordinates, each in
# the largest size of X; the arrivals at each gap coordinate (time, velocity, side); the polynomial
# of each row, and one more.


def polynomial_place(flights: AnyFlights, row: int) -> int:
    """Return where the polynomial of a row stands in scratch space."""
    return int(4 * flights.sizes[1] + 3 * flights.sizes[2] + TERMS * row)


def displacement(head: tuple[int], s: float, space: Vector) -> tuple[float, float, float]:
    """Return displacement, velocity and acceleration from a polynomial in scratch space."""
    x, v, a = 0.0, 0.0, 0.0
    for k in range(head[0] + TERMS - 1, head[0] - 1, -1):
        a = a * s + v
        v = v * s + x
        x = x * s + space[k]
    return s * x, x + s * v, 2.0 * (v + s * a)


def coefficients(flights: AnyFlights, law: int, row: int, to: int, space: Vector) -> None:
    """Fill in the polynomial of a row on a piece."""
    width = flights.sizes[1]
    at = (law * flights.sizes[3] + row) * width * TERMS
    for k in range(TERMS):
        space[to + k] = 0.0
    for j in range(flights.width[law]):
        x = space[j]
        for k in range(TERMS):
            space[to + k] += x * flights.tables[at + k]
        at += TERMS


def shift(space: Vector, at: int, to: int, begin: float, length: float) -> float:
    """Fill in a polynomial on a part of its piece; returns the displacement at its beginning."""
    for k in range(TERMS):
        space[to + k] = space[at + k]
    # powers of s - begin, by Horner's scheme again and again; the displacement at s = 0 is zero
    value = 0.0
    for k in range(TERMS - 1, -1, -1):
        value = (value + space[to + k]) * begin
    for first in range(TERMS):
        for k in range(TERMS - 2, max(first - 1, 0) - 1, -1):
            space[to + k] += begin * space[to + k + 1]
    power = length
    for k in range(TERMS):
        space[to + k] *= power
        power *= length
    return value


OPEN, CLEAR, MONOTONE = range(3)
"""What is known of a part of a piece."""


def look(space: Vector, at: int, origin: float, low: float, high: float) -> int:
    """Return whether a polynomial on [0, 1] keeps clear of both walls, or has a velocity or an
    acceleration of one sign."""
    c1, c2 = space[at], space[at + 1]
    rest, slopes, bends = 0.0, 0.0, 0.0
    for k in range(2, TERMS):
        size = abs(space[at + k])
        rest += size
        slopes += (k + 1) * size
        bends += (k + 1) * k * size
    end = c1 + c2
    if (
        origin + min(0.0, 0.5 * c1, end) - rest > low
        and origin + max(0.0, 0.5 * c1, end) + rest < high
    ):
        return CLEAR
    end = c1 + 2.0 * c2
    if min(c1, end) >= slopes or max(c1, end) <= -slopes:
        return MONOTONE
    third = abs(6.0 * space[at + 2])
    end = 2.0 * c2 + 6.0 * space[at + 2]
    bends -= third
    if min(2.0 * c2, end) >= bends or max(2.0 * c2, end) <= -bends:
        return MONOTONE
    return OPEN


def first_in_piece(
    space: Vector, at: int, to: int, rising: bool, low: float, high: float
) -> tuple[int, float, float]:
    """Return side, time and velocity of the first arrival on a piece, with certainty.

    The side is 0 for none, and 2 where the piece is not resolved. The polynomial is at the place
    `at`, with room for another one at `to`; the rest is as in `segments.flight.first_arrival`.
    """
    if not abs(space[at]) + abs(space[at + 1]) < math.inf:
        return 2, 0.0, 0.0
    kind = look(space, at, 0.0, low, high)
    if kind == CLEAR:
        return 0, 1.0, 0.0
    begin, length, parts = 0.0, 1.0, 0
    left = (0.0, space[at], 2.0 * space[at + 1])
    while begin < 1.0:
        if parts > 0:
            start = shift(space, at, to, begin, length)
            kind = look(space, to, start, low, high)
        parts += 1
        if kind == OPEN:
            if parts > PARTS:
                return 2, begin, 0.0
            length *= 0.5
        else:
            end = begin + length
            right = displacement((at,), end, space)
            turned = right[1] != 0.0 and (right[1] > 0.0) != rising
            if kind == MONOTONE:
                side, s, speed = hit_between(
                    displacement, (at,), space, begin, left, end, right, turned, rising, low, high
                )
                if side != 0:
                    return side, s, speed
            rising = rising != turned
            begin, left = end, right
            while length < 1.0 and math.fmod(begin, 2.0 * length) == 0.0:
                length *= 2.0
    return 0, 1.0, 0.0


def advance(flights: AnyFlights, law: int, space: Vector) -> None:
    """Move X to the end of a piece."""
    n, width = flights.width[law], flights.sizes[1]
    at, to = law * width * width, width
    for i in range(n):
        gained = 0.0
        for j in range(n):
            gained += flights.steps[at + j] * space[j]
        space[to + i] = space[i] + gained
        at += width
    for i in range(n):
        space[i] = space[to + i]


def arrive(flights: AnyFlights, law: int, wall: int, s: float, speed: float, space: Vector) -> None:
    """Fill in the section coordinates of an arrival on a piece."""
    d, piece, section, j = flights.sizes[0], flights.piece[law], section_place(flights), 0
    space[section] = speed / piece
    for i in range(d):
        if i != flights.pivot[wall]:
            row = flights.unit[i]
            at = polynomial_place(flights, row)
            coefficients(flights, law, row, at, space)
            x, v, _ = displacement((at,), s, space)
            space[section + 1 + j] = space[i] + x
            space[section + 2 + j] = v / piece
            j += 2


def begin_on_piece(
    flights: AnyFlights, row: int, stretch: tuple[int], space: Vector
) -> tuple[float, float]:
    """Return velocity, in pieces, and acceleration of a gap coordinate; fills in its polynomial."""
    at, law = polynomial_place(flights, row), stretch[0]
    coefficients(flights, law, row, at, space)
    return space[at], (2.0 * space[at + 1]) / (flights.piece[law] * flights.piece[law])


def first_on_piece(
    flights: AnyFlights, row: int, _: Any, rising: bool, low: float, high: float, space: Vector
) -> tuple[int, float, float]:
    """Return side, time and velocity of the first arrival of a gap coordinate."""
    at, spare = polynomial_place(flights, row), polynomial_place(flights, flights.sizes[3])
    return first_in_piece(space, at, spare, rising, low, high)


def fly_linear(
    leave: Callable[..., Any], flights: AnyFlights, wall: int, phase: float, space: Vector
) -> tuple[int, int, float, int]:
    """Make one flight, as the ``fly`` of `make_flights`.

    ``leave(wall, phase, values, space)`` fills in X after an impact.
    """
    width, law = flights.sizes[1], flights.law[wall]
    section, n, d = section_place(flights), flights.width[law], flights.sizes[0]
    velocity, period, piece = space[section], flights.clock[0], flights.piece[law]
    fastest = space[section + 2 * d - 1]
    if abs(velocity) <= flights.slow[wall]:
        return LEFT, wall, phase, 0
    leave(wall, phase, flights.values, space)
    if is_beyond(flights, wall, law, space):
        return BEYOND, wall, phase, 0
    left, begun = wall, 2 * width
    for j in range(n):
        space[begun + j] = space[j]
    repeats, pieces = False, float(flights.count[law])
    for turn in range(min(flights.sizes[4], LONG)):
        for k in range(flights.count[law]):
            reached, s, speed = arrivals(
                begin_on_piece, first_on_piece, flights, (law,), left, velocity, pieces, space
            )
            if reached == -2:
                return LEFT, wall, phase, 0
            if reached >= 0:
                arrive(flights, law, reached, s, speed, space)
                return DONE, reached, phase + (turn * period + (k + s) * piece), 0
            advance(flights, law, space)
            left = -1
        for j in range(2 * d, n):  # a whole period later
            space[j] = space[begun + j]
        apart, size = 0.0, 0.0
        for j in range(n):
            apart = max(apart, abs(space[j] - space[begun + j]))
            size = max(size, abs(space[j]))
            space[begun + j] = space[j]
        for j in range(d, 2 * d):
            if not abs(space[j]) <= fastest:
                return LEFT, wall, phase, 0
        repeats = apart <= REPEATED * size
        if repeats:
            break
    return (NO_IMPACT if repeats or flights.sizes[4] <= LONG else LEFT), wall, phase, 0


# Runs of systems whose flights are all linear: their vectors, plain and compiled.

TAIL = 1e-17
"""Size of the first power left out, beside the state, in the units of the coordinates."""


class Law(NamedTuple):
    """The motion of a mode."""

    mode: str
    shape: Shape
    numbers: tuple[float, ...]
    """`shape`, `numbers`: as of `segments.linear_flow.flow`, without directions."""


def piece_count(shape: Shape, generator: Array, period: float) -> int:
    """Return into how many pieces a period is cut, so that the powers left out are none.

    Raises OverflowError for numbers beyond the range of floats, or motions that turn too often.
    """
    scales, size = scales_of(shape, generator), turns_of(shape, generator, period)
    if size == 0.0:
        return 1
    turned = generator * (scales / scales[:, None]) * (period / size)  # of norm 1
    power = np.linalg.matrix_power(turned, TERMS + 1)
    reach = float(np.abs(power).sum(axis=0).max()) / math.factorial(TERMS + 1) / TAIL
    return max(1, math.ceil(size * max(reach, 1e-30) ** (1.0 / (TERMS + 1))))


def tables_of(law: Law, rows: Array, period: float, width: int) -> tuple[int, Array, Array]:
    """Return pieces, table and steps of a law; X is filled up with zeros to a width."""
    generator = generator_of(law.shape, law.numbers)
    count, n = piece_count(law.shape, generator, period), law.shape.size
    piece = period / count
    turned = generator * piece
    vector = np.zeros((len(rows), n))
    vector[:, : law.shape.freedom] = rows
    table = np.zeros((len(rows), width, TERMS))
    for k in range(TERMS):
        vector = (vector @ turned) / (k + 1.0)
        table[:, :n, k] = vector
    steps = np.zeros((width, width))
    steps[:n, :n] = piece * mean_of(law.shape, generator, piece)
    if not (np.all(np.isfinite(table)) and np.all(np.isfinite(steps))):
        raise OverflowError("a linear flight grows beyond the range of floats")
    return count, table, steps


ARGUMENTS = "".join(FIELDS.values()) + VECTOR + INTEGERS + VECTOR + COLUMNS + INTEGERS
"""Kinds of the entry's arguments: the fields of `Flights`, then those of `make_flights`, of one
motion or, without rows, of many, one after the other."""

FLY = """
def fly(flights, wall, phase, space):
    return fly_linear(leave, flights, wall, phase, space)
"""


def leaving_text(laws: Sequence[Law], given: int, place: int) -> str:
    """Return the text of ``leave``: it fills in X after an impact.

    The laws are those after each guard; the section coordinates are at `place`.
    """
    lines = ["def leave(wall, phase, p, space):"]
    for wall, law in enumerate(laws):
        d, size = law.shape.freedom, law.shape.size
        section = [f"space[{place + j}]" for j in range(2 * d - 1)]
        numbers = ", ".join([*section, *(f"p[{i}]" for i in range(given))])
        lines += [f"    if wall == {wall}:", f"        x = law_{wall}(phase, {numbers})[3]"]
        lines += [f"        space[{j}] = x[{j}]" for j in range(size)]
    return "\n".join(lines)


def leaving(kernels: Sequence[Kernel], place: int) -> Callable[..., None]:
    """Return the same as a function, from the law after each guard."""

    def leave(wall: int, phase: float, p: Sequence[float], space: list[float]) -> None:
        law = kernels[wall]
        count = law.__code__.co_argcount - 1 - len(p)
        state = law(phase, *space[place : place + count], *p)[3]
        space[: len(state)] = state

    return leave


def program_of(kernels: Sequence[Kernel], leaving: str) -> Program:
    """Return the program that simulates from impact to impact."""
    from ..segments.machine_code import Program

    program = Program({})
    program.glue(leaving, **{f"law_{wall}": kernel for wall, kernel in enumerate(kernels)})
    program.glue(FLY, fly_linear=fly_linear)
    glue_entry(program, Flights)
    return program


def flights_of(given: Setting) -> AnyFlights:
    """Return a system as vectors, as lists; its laws are of the kind `Law`.

    Raises OverflowError for laws beyond the range of floats, or motions that turn too often.
    """
    laws: list[Law] = list(dict.fromkeys(given.laws))
    width = max(law.shape.size for law in laws)
    rows = np.array(given.all_rows)
    made = [tables_of(law, rows, given.period, width) for law in laws]
    return Flights(
        **given.vectors(width),
        width=[law.shape.size for law in laws],
        count=[count for count, _, _ in made],
        piece=[given.period / count for count, _, _ in made],
        tables=np.array([table for _, table, _ in made]).ravel().tolist(),
        steps=np.array([steps for _, _, steps in made]).ravel().tolist(),
    )


def laws_of(kernels: Kernels, values: Sequence[float]) -> list[Law] | None:
    """Return the law of the flight after each guard, which may be in closed form, or lead along a
    surface; None if one follows no law of all coordinates."""
    model, found = kernels.model, []
    size = model.DEGREES_OF_FREEDOM
    for guard in model.WALLS:
        if kernels.integrated(guard.name):
            return None
        law = kernels.law(guard.name)
        if law.__code__.co_argcount != 2 * size + len(values):
            return None
        given = law(0.0, *[1.0] * (2 * size - 1), *values)
        if len(given) == 1 or given[0] != size:
            return None
        shape = Shape(int(given[0]), int(given[1]), 0)
        found.append(Law(guard.next_mode, shape, tuple(map(float, given[2]))))
    return found


class LinearRuns(Runs):
    """Runs of a system whose flights all follow `laws_of`, plainly or compiled.

    Raises OverflowError as `flights_of`.
    """

    fields = "".join(FIELDS.values())

    def __init__(self, given: Setting) -> None:
        self.flights = flights_of(given)
        kernels = [given.kernels.law(guard.name) for guard in given.kernels.model.WALLS]
        self.size = 2 * self.flights.sizes[0] - 1
        width = self.flights.sizes[1]
        text = leaving_text(given.laws, len(given.values), 3 * width)
        self.leave = leaving(kernels, 3 * width)
        identity = ("simulate linear flights", text, *formulas(kernels))
        build = functools.partial(program_of, kernels, text)
        self.engine = Engine.of(identity, ARGUMENTS, build)

    def room(self) -> list[Array]:
        return [np.zeros(space_of(self.flights))]

    def make_plainly(self, at: Any, when: Any, columns: Sequence[Any], span: Any) -> int:
        fly = functools.partial(fly_linear, self.leave)
        given: Any = ([0.0] * space_of(self.flights), at, when, *columns, span)
        return make_flights(fly, self.flights, *given)


def runs_of(given: Setting) -> Runs | None:
    """Return what makes the flights of a system on which no wall is held; None where some follow
    laws and others are integrated, or none of both."""
    laws = laws_of(given.kernels, given.values)
    if laws is not None:
        try:
            return LinearRuns(given._replace(laws=laws))
        except OverflowError:
            return None
    from .integrated_flights import IntegratedRuns, has_compiled_flights

    return IntegratedRuns(given) if has_compiled_flights(given.kernels) else None
