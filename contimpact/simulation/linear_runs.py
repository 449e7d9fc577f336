"""Runs of systems whose flights are all linear: their vectors, plain and compiled.

`linear_flights` has the loop from impact to impact. A flight that it leaves, on which a wall is
held or released, is made by the `automaton`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..arrays import INTEGERS, VECTOR, Array
from ..models.guards import pivot
from ..segments.arithmetic import Kernel
from ..segments.compiling import timed_plainly
from ..segments.linear_flow import (
    Shape,
    generator_of,
    mean_rates,
    norm_in_units,
    scales_of,
    series_of_floats,
)
from ..segments.segment import ELSEWHERE, Passages
from ..segments.track import MOST_PIECES
from .linear_flights import LEFT, TERMS, Flights, make_flights, space_of
from .one_coordinate import DTYPES, Engine, array, formulas
from .run import Call, Outcome, State

if TYPE_CHECKING:
    from ..segments.machine_code import Program

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
    scales = scales_of(shape, generator)
    size = norm_in_units(shape, generator) * period
    if not size < math.inf:
        raise OverflowError("a linear flight with numbers beyond the range of floats")
    if size > MOST_PIECES:
        raise OverflowError(f"a linear flight that turns by {size:.3g} radians")
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
    steps[:n, :n] = piece * mean_rates(generator, piece, series_of_floats)[0]
    if not (np.all(np.isfinite(table)) and np.all(np.isfinite(steps))):
        raise OverflowError("a linear flight grows beyond the range of floats")
    return count, table, steps


FIELDS = VECTOR * 2 + INTEGERS + VECTOR + INTEGERS * 3 + VECTOR * 3 + INTEGERS * 6 + VECTOR
FIELDS += INTEGERS * 2 + VECTOR
"""Kinds of the fields of `Flights`."""
ROW = INTEGERS * 2 + VECTOR * 2
"""Kinds of the columns that `make_flights` fills."""
ARGUMENTS = FIELDS + VECTOR + INTEGERS + VECTOR + ROW + INTEGERS
"""Kinds of the entry's arguments: the fields of `Flights`, then those of `make_flights`, of one
motion or, without rows, of many, one after the other."""

ENTRY = """
def entry({fields}, space, state, when, walls, turns, phases, sections, span):
    flights = Flights({fields})
    made, size = 0, 2 * sizes[0] + 1
    for k in range(len(state) // 3):
        made += make_flights(
            leave, flights, space, state[3 * k : 3 * k + 3], when[size * k : size * k + size],
            walls, turns, phases, sections, span[2 * k : 2 * k + 2]
        )
    return made
"""

FEW = 1024
"""Impacts made at once plainly."""


def leaving_text(laws: Sequence[Law], given: int, place: int) -> str:
    """Return the text of ``leave``: it fills in X after an impact.

    Parameters
    ----------
    laws : sequence of Law
        After each guard.
    given : int
        Parameter values.
    place : int
        Of the section coordinates.
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
    program.constant("Flights", Flights)
    entry = ENTRY.format(fields=", ".join(Flights._fields))
    program.glue(entry, make_flights=make_flights)
    return program


_ENGINES: dict[tuple[str, ...], Engine] = {}


def engine_of(kernels: Sequence[Kernel], leaving: str) -> Engine:
    """Return the engine for these laws; simulators of the same formulas share it."""
    identity = ("simulate linear flights", leaving, *formulas(kernels))
    build = functools.partial(program_of, kernels, leaving)
    return _ENGINES.setdefault(identity, Engine(identity, ARGUMENTS, build))


class Setting(NamedTuple):
    """What a system's vectors are made of."""

    rows: Sequence[tuple[float, ...]]
    """The gap coordinate of each guard."""
    sides: Sequence[int]
    positions: Sequence[float]
    restitution: Sequence[float]
    passages: Passages
    laws: Sequence[Law]
    """`sides`, `positions`, `restitution`, `laws`: of each guard, and of the flight after it."""
    values: Sequence[float]
    period: float
    longest: int


def flights_of(given: Setting) -> Flights:
    """Return a system as vectors, as lists.

    Raises OverflowError for laws beyond the range of floats, or motions that turn too often.
    """
    laws = list(dict.fromkeys(given.laws))
    d, width = laws[0].shape.freedom, max(law.shape.size for law in laws)
    gaps = list(dict.fromkeys(given.rows))
    units = [tuple(float(i == j) for j in range(d)) for i in range(d)]
    rows = list(dict.fromkeys([*gaps, *units]))
    made = [tables_of(law, np.array(rows), given.period, width) for law in laws]
    walls = range(len(given.rows))

    def nearest(law: Law, row: tuple[float, ...], side: int) -> int:
        watched = given.passages.watched[given.laws.index(law)]
        there = (k for k in walls if watched[k] and given.rows[k] == row and given.sides[k] == side)
        return min(there, key=lambda k: (side * given.positions[k], k), default=-1)

    passages = given.passages
    return Flights(
        values=list(given.values),
        clock=[given.period],
        sizes=[d, width, len(gaps), len(rows), given.longest],
        factors=[c for row in rows for c in row],
        unit=[rows.index(unit) for unit in units],
        width=[law.shape.size for law in laws],
        count=[count for count, _, _ in made],
        piece=[given.period / count for count, _, _ in made],
        tables=np.array([table for _, table, _ in made]).ravel().tolist(),
        steps=np.array([steps for _, _, steps in made]).ravel().tolist(),
        below=[nearest(law, row, -1) for law in laws for row in gaps],
        above=[nearest(law, row, +1) for law in laws for row in gaps],
        law=[laws.index(law) for law in given.laws],
        row=[rows.index(row) for row in given.rows],
        pivot=[pivot(row) for row in given.rows],
        sides=list(given.sides),
        positions=list(given.positions),
        leaving=[int(side) for side in passages.leaving],
        stays=[int(passages.arrivals[k][k] != ELSEWHERE) for k in walls],
        restitution=list(given.restitution),
    )


class LinearRuns:
    """Runs of a system whose flights are all linear, plainly or compiled.

    Parameters
    ----------
    given : Setting
    kernels : sequence of Kernel
        The law after each guard.

    Raises OverflowError as `flights_of`.
    """

    def __init__(self, given: Setting, kernels: Sequence[Kernel]) -> None:
        self.flights = flights_of(given)
        self.size = 2 * self.flights.sizes[0] - 1
        width = self.flights.sizes[1]
        text = leaving_text(given.laws, len(given.values), 3 * width)
        self.leave = leaving(kernels, 3 * width)
        self.engine = engine_of(kernels, text)

    @functools.cached_property
    def _arrays(self) -> list[Array]:
        """The vectors as arrays, for compiled code."""
        return [array(numbers, kind) for numbers, kind in zip(self.flights, FIELDS, strict=True)]

    def make(
        self, state: State, span: tuple[int, int], asked: int, record: bool, fastest: float
    ) -> tuple[State, Outcome | None, int, list[Any]]:
        """Make impacts as `Automaton.make`; the outcome is None where a flight is left to it."""
        fast = self.engine.program(asked)
        most = span[0] if fast else min(span[0], FEW)
        rows = most if record else 0
        shapes = (rows, rows, rows, rows * self.size)
        columns: list[Any] = [
            np.empty(n, DTYPES[kind]) if fast else [0] * n
            for n, kind in zip(shapes, ROW, strict=True)
        ]
        at: Any = [int(state.wall), int(state.turns), 0]
        when: Any = [float(state.phase), *(float(y) for y in state.section), fastest]
        room = space_of(self.flights)
        if fast:
            at, when = array(at, INTEGERS), array(when, VECTOR)
            limits = array((most, span[1]), INTEGERS)
            made = fast(*self._arrays, np.zeros(room), at, when, *columns, limits)
        else:
            with timed_plainly(self.engine.identity):
                given = ([0.0] * room, at, when, *columns, (most, span[1]))
                made = make_flights(self.leave, self.flights, *given)
            self.engine.plain += made
        section = tuple(float(y) for y in when[1:-1])
        end = State(int(at[0]), float(when[0]), section[0], int(at[1]), section[1:])
        outcome = None if at[2] == LEFT else OUTCOMES[at[2]]
        return end, outcome, made, self._columns(columns, made if record else 0)

    def batch(self, asked: int) -> Call | None:
        """Return compiled code for many motions; None where the work is not worth it."""
        fast = self.engine.program(asked)
        if fast is None:
            return None
        room, none = space_of(self.flights), [np.empty(0, DTYPES[kind]) for kind in ROW]
        return lambda at, when, limits: fast(*self._arrays, np.zeros(room), at, when, *none, limits)

    def _columns(self, columns: Sequence[Any], made: int) -> list[Any]:
        """The columns in the order of `run.columns_of`."""
        walls, turns, phases = (np.asarray(column[:made]) for column in columns[:3])
        sections = np.asarray(columns[3][: made * self.size], float).reshape(made, self.size)
        none = np.zeros(made, np.int64)
        return [walls, turns, phases, sections[:, 0], none > 0, sections[:, 1:], none]


OUTCOMES = tuple(Outcome)
"""Outcomes by their numbers in `linear_flights`."""
