"""Integrated flights from impact to impact, compiled: first arrivals on Taylor polynomials.

A flight is followed in windows by `segments.taylor`, so that little of it lies beyond the guard
that ends it, where the flow may cease to be finite. In each the gap coordinates are polynomials in
pieces between whose accelerations' zeros `segments.flight` finds the first arrival, so that none is
missed. A flight that begins at rest, ends the impacts on a wall, is over at once or is not resolved
is left to plain Python, which integrates by heyoka; see `flights`.

The functions up to `fly_integrated` are in the plain subset of Python that `contimpact.compiling`
compiles.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import INTEGERS, TABLE, VECTOR, Array, Vector
from ..models.guards import orders_of
from ..segments.flight import first_hit
from ..segments.integration import statement
from ..segments.kernels import Kernels
from ..segments.oscillation import MOST, ROW, FollowedFlight, motion_of_gap, row_of, row_of_compiled
from ..segments.segment import Kernel
from ..segments.taylor import departure_kernel, has_series, path_by_series
from .flights import FIRST, LEAST, NUDGE
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
    section_place,
)

if TYPE_CHECKING:
    from ..segments.machine_code import Program


FIELDS = {**FLIGHTS, "begins": INTEGERS, "freedom": INTEGERS, "weights": VECTOR}
"""A field stands in place of a law. Besides: of each wall whether the flight after it begins on the
surface of each other one (w w,); of each field its coordinates, the others being at zero (l,), and
the factors of its coordinates in each row (l q d,)."""
ROOM = {
    **{name: TABLE if name in ("own", "steps") else VECTOR for name in FollowedFlight._fields},
    "numbers": VECTOR,
    "series": VECTOR,
}
"""Fields in which a flight is made: those of a `segments.oscillation.FollowedFlight`, what a window
starts with, as of `segments.taylor.path_by_series`, and scratch space of the series."""
IntegratedFlights: Any = flights_class("IntegratedFlights", FIELDS | ROOM)


Stretch = tuple[int, int, float]
"""The law of a window, its steps, and its length."""


def begin_on_steps(
    flights: AnyFlights, row: int, stretch: Stretch, space: Vector
) -> tuple[float, float]:
    """Return velocity and acceleration of a row where a window begins."""
    head = row, flights.sizes[3], stretch[1]
    _, speed, force = motion_of_gap(head, 0.0, flights.steps)
    return speed, force


def first_on_steps(
    flights: AnyFlights,
    row: int,
    stretch: Stretch,
    rising: bool,
    low: float,
    high: float,
    space: Vector,
) -> tuple[int, float, float]:
    """Return side, time and velocity of the first arrival of a gap coordinate in a window."""
    first, head = 2 * MOST * row, (row, flights.sizes[3], stretch[1])
    last = first + int(flights.found[row])
    if last == first + 2 * MOST:
        return 2, 0.0, 0.0
    flights.breaks[last] = stretch[2]
    breaks = flights.breaks[first : last + 1]
    found = first_hit(motion_of_gap, head, flights.steps, breaks, 0.0, rising, low, high)
    return found[0], found[1], found[2]


def may_pass_at_once(flights: AnyFlights, left: int, stretch: Stretch, space: Vector) -> bool:
    """Whether a flight begins on the surface of a guard of its mode, with a velocity towards it."""
    for k in range(len(flights.sides)):
        if flights.begins[len(flights.sides) * left + k] != 0:
            speed, _ = begin_on_steps(flights, flights.row[k], stretch, space)
            if flights.sides[k] * speed > 0.0:
                return True
    return False


def fly_integrated(
    begin: Callable[..., Any],
    path: Callable[..., int],
    flights: AnyFlights,
    wall: int,
    phase: float,
    space: Vector,
) -> tuple[int, int, float, int]:
    """Make one flight, as the ``fly`` of `make_flights`.

    ``begin(wall, phase, section, values, numbers)`` fills in what the flight starts with, and
    ``path(law, length, numbers, series, factors, rows, way)`` how it goes on for a while.
    """
    d, rows, period = flights.sizes[0], flights.sizes[3], flights.clock[0]
    law, numbers, section = flights.law[wall], flights.numbers, section_place(flights)
    velocity, fastest = space[section], space[section + 2 * d - 1]
    if abs(velocity) <= flights.slow[wall]:
        return LEFT, wall, phase, 0
    n, weights = flights.freedom[law], flights.weights[law * rows * d :]
    begin(wall, phase, space[section:], flights.values, numbers)
    way = FollowedFlight(
        flights.own,
        flights.steps,
        flights.breaks,
        flights.found,
        flights.signs,
        flights.zeros,
        flights.moving,
        flights.forces,
    )
    for i in range(d):
        space[i] = numbers[1 + i] if i < n else 0.0
    if is_beyond(flights, wall, law, space):
        return BEYOND, wall, phase, 0
    left, began, passed, length = wall, numbers[0], 0.0, FIRST * period
    while passed < min(flights.sizes[4], LONG) * period:
        made = path(law, length, numbers, flights.series, weights, rows, way)
        if made < 0:
            length *= 0.5
            if length < LEAST * period:
                return LEFT, wall, phase, 0
            continue
        stretch = law, made, length
        if left >= 0 and may_pass_at_once(flights, left, stretch, space):
            return LEFT, wall, phase, 0
        reached, dt, speed = arrivals(
            begin_on_steps, first_on_steps, flights, stretch, left, velocity, period, space
        )
        if reached == -2 or (reached >= 0 and passed + dt <= NUDGE * period):
            return LEFT, wall, phase, 0
        at = dt if reached >= 0 else length
        j = section
        space[j] = speed
        for i in range(d):
            x, v, _ = motion_of_gap((flights.unit[i], rows, made), at, flights.steps)
            if reached < 0 and i < n:
                numbers[1 + i] += x
                numbers[1 + n + i] = v
                space[i] = numbers[1 + i]
                if not abs(v) <= fastest:
                    return LEFT, wall, phase, 0
            elif reached >= 0 and i != flights.pivot[reached]:
                space[j + 1], space[j + 2] = space[i] + x, v
                j += 2
        if reached >= 0:
            return DONE, reached, phase + (passed + dt), 0
        passed += length
        numbers[0] = began + passed
        left, length = -1, min(2.0 * length, period)
    return (NO_IMPACT if flights.sizes[4] <= LONG else LEFT), wall, phase, 0


# Runs of systems whose flights are all integrated.

ARGUMENTS = "".join((FIELDS | ROOM).values()) + VECTOR + INTEGERS + VECTOR + COLUMNS + INTEGERS
"""Kinds of the entry's arguments, as in `linear_flights`."""

FLY = """
def fly(flights, wall, phase, space):
    return fly_integrated(any_start, any_path, flights, wall, phase, space)
"""


def program_of(
    kernels: Sequence[Kernel], fields: Sequence[str], law: Sequence[int], section: int
) -> Program:
    """Return the program that simulates from impact to impact, from the kernels ``field`` of all
    walls, the fields of the modes, which of these comes after each wall, and the number of section
    coordinates."""
    from ..segments.machine_code import Program

    program = Program({row_of: row_of_compiled})
    starts = {f"begin_{wall}": departure_kernel(kernel) for wall, kernel in enumerate(kernels)}
    lines = ["def any_start(wall, phase, y, p, numbers):"]
    for wall, (name, kernel) in enumerate(starts.items()):
        stated = statement(fields[law[wall]])
        size = len(stated.names) - 1
        others = range(kernel.__code__.co_argcount - 1 - section)
        given = ", ".join([*(f"y[{i}]" for i in range(section)), *(f"p[{i}]" for i in others)])
        lines += [f"    if wall == {wall}:", f"        x{wall} = {name}(phase, {given})"]
        lines += [f"        numbers[{i}] = x{wall}[{i}]" for i in range(size)]
    program.glue("\n".join(lines), **starts)
    paths = {f"path_{k}": path_by_series(field).function for k, field in enumerate(fields)}
    lines = ["def any_path(law, length, numbers, series, weights, count, way):"]
    for k, field in enumerate(fields):
        given = ", ".join(f"numbers[{i}]" for i in range(len(statement(field).names) - 1))
        lines += [] if k + 1 == len(fields) else [f"    if law == {k}:"]
        indent = "    " if k + 1 == len(fields) else "        "
        lines.append(f"{indent}return path_{k}(length, {given}, series, weights, count, way)")
    program.glue("\n".join(lines), **paths)
    program.constant("FollowedFlight", FollowedFlight)
    program.glue(FLY, fly_integrated=fly_integrated)
    glue_entry(program, IntegratedFlights)
    return program


def _padded(rows: Sequence[tuple[float, ...]], n: int) -> list[float]:
    """The factors of the first n coordinates in each row, with room for all."""
    found = [c for row in rows for c in row[:n]]
    return found + [0.0] * (len(rows) * len(rows[0]) - len(found))


class IntegratedRuns(Runs):
    """Compiled runs of a system of which `has_compiled_flights`; its laws are those fields."""

    fields, dear = "".join(FIELDS.values()), True

    def __init__(self, given: Setting) -> None:
        kernels = given.kernels
        guards, d = kernels.model.WALLS, kernels.model.DEGREES_OF_FREEDOM
        own = [kernels.field(guard.name) for guard in guards]
        laws = [(guard.next_mode, kernels.field_text(guard.name)) for guard in guards]
        given = given._replace(laws=laws)
        common, rows = given.vectors(2 * d), given.all_rows
        law, fields = common["law"], [field for _, field in dict.fromkeys(given.laws)]
        sizes = [statement(field).freedom for field in fields]
        self.flights = IntegratedFlights(
            **common,
            freedom=sizes,
            weights=[c for n in sizes for c in _padded(rows, n)],
            begins=[
                int(other in kernels.passages.beginning(k))
                for k in range(len(guards))
                for other in range(len(guards))
            ],
            **dict.fromkeys(ROOM, ()),
        )
        self.size, self.rows = 2 * d - 1, len(rows)
        self.count = max(len(statement(field).names) for field in fields)
        self.series = max(path_by_series(field).space for field in fields)
        identity = ("simulate integrated flights", str(law), *formulas(own))
        build = functools.partial(program_of, own, fields, law, self.size)
        self.engine = Engine.of(identity, ARGUMENTS, build)

    def room(self) -> list[Array]:
        d, rows = self.flights.sizes[0], self.rows
        sizes = (d, ROW), (rows * MOST, ROW), 2 * MOST * rows + 1, rows, rows, rows, 2 * d, d
        space = 8 * d + 3 * self.flights.sizes[2]
        return [np.zeros(size) for size in (*sizes, self.count, self.series, space)]

    def make_plainly(self, at: Any, when: Any, columns: Sequence[Any], span: Any) -> int:
        at[2] = LEFT
        return 0


def has_compiled_flights(kernels: Kernels) -> bool:
    """Whether all flights of a system are integrated and have series, and each mode has all
    coordinates but the last ones."""
    model, size = kernels.model, kernels.model.DEGREES_OF_FREEDOM
    for guard in model.WALLS:
        if not kernels.integrated(guard.name):
            return False
        field = kernels.field_text(guard.name)
        orders = orders_of(model.MODES, guard.next_mode, size)
        n = statement(field).freedom
        if not has_series(field) or 0 in orders[:n] or any(orders[n:]):
            return False
    return True
