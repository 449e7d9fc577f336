"""Integrated segments, long ones computed by multiple shooting.

Rounding errors grow along a flight as all differences do. Where that comes to more than
`kernel.LONG`, the flight is computed by multiple shooting, and its residual is the same up to a
regular matrix: rows are combined such that none of them is large.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array, Number, lapack
from .derivatives import FLOAT_SERIES, Series
from .integrated_flight import rounding_scale
from .integration import KEPT, integrator, statement
from .kernel import SECTION, Blocks, CombinedBlocks, Row, differences_grow
from .segment import ELSEWHERE, Arithmetic, KernelSource, Numbers, Segment, evaluate_in
from .track import IntegratedTrack, join_flights

# Long flights in pieces: multiple shooting between where a flight leaves and where it arrives.
#
# States :math:`s_1, \ldots, s_{J-1}` between the ends are unknowns of the flight alone. Each piece
# leads from one to the next, the last one to the arrival (J = 3; rows are pieces, columns states)::
#
#     [ -1         ]   [ s_1 ]   [ s_1 - fly_1(leave)          ]
#     [ F_2   -1   ]   [ s_2 ] ~ [ s_2 - fly_2(s_1)            ]
#     [      E F_3 ]             [ -(arrival of fly_3(s_2))    ]
#
# No piece grows by much, so that none of its derivatives is large, whatever the growth of the
# whole.
# The states follow from both ends by Gauss and Newton's method: what grows is held by the arrival,
# what decays by the start. What is left are as many rows as there are columns short, combinations
# of the equations in which the states have no part. They are told by the QR factors of the product
# of all pieces, :math:`F_j Q_{j-1} = Q_j R_j`, which keep its large and its small growth apart
# (Ascher, Mattheij and Russell, Numerical Solution of Boundary Value Problems, 1995, ch. 4 and 6).

PIECE_GROWS, PIECE_MAY = 30.0, 3e3
"""Largest growth over a piece where pieces are chosen, and in the end."""

TRUSTED = 1e7
"""Growth up to which states flown to from one end are a guess of those of the flight."""

SIZE = 1e3
"""Scale of the combined rows, chosen so that an accepted residual stays small beside the decayed
terms, which determine the multipliers and the parameter of a homoclinic orbit."""

MOST_PIECES, SHORTEST = 400, 2.0**-12
"""Largest number of pieces of a flight, and the shortest piece as a part of it."""

ITERATIONS, SETTLED = 25, 1e-13
"""Iterations of the Gauss-Newton method, and the step, as a part of the states, below which they
are known to rounding where steps become no smaller."""


class SplitFailure(ArithmeticError):
    """No states between the ends of a flight have been found."""


@dataclass(frozen=True, eq=False)
class IntegratedFlight:
    """What a flight is integrated from."""

    field: str
    """Vector field as given by `integration.text_of`."""
    directions: tuple[str, ...]
    """Directions by which pieces are differentiated: duration, time, state and parameters, in that
    order."""
    begin: float
    length: float
    """`begin`, `length`: when it leaves, and its duration."""
    given: Array
    """Values of the field's parameters."""

    @property
    def freedom(self) -> int:
        """Degrees of freedom."""
        return statement(self.field).freedom

    def numbers(self, first: float, last: float, state: Array) -> list[float]:
        """Return what a piece between two parts of the flight is integrated from."""
        begin = self.begin + first * self.length
        return [(last - first) * self.length, begin, *state.tolist(), *self.given.tolist()]

    def fly(self, first: float, last: float, state: Array) -> tuple[Array, Array]:
        """Return the state at the end of a piece, and its derivatives by the directions."""
        numbers = self.numbers(first, last, state)
        found = np.array(integrator(self.field, self.directions)(numbers))
        return self._covered(numbers[0], state, found)

    def _covered(self, length: float, state: Array, found: Array) -> tuple[Array, Array]:
        """The state at the end, and its derivatives, from mean and end velocities and theirs."""
        d = self.freedom
        means, ends = found.reshape(-1, 2, d).swapaxes(0, 1)
        moved = length * means[1:]
        moved[0] += means[0]
        moved[2 : 2 + d] += np.eye(d)
        there = np.concatenate([state[:d] + length * means[0], ends[0]])
        return there, np.concatenate([moved, ends[1:]], axis=1).T

    def off(self, first: float, last: float, state: Array) -> tuple[Array, Array]:
        """Return bounds of the rounding errors of what `fly` returns."""
        numbers, names = self.numbers(first, last, state), " ".join(self.directions)
        found = np.array(integrator(self.field, self.directions)(numbers))
        sizes = rounding_scale(self.field, names, numbers, found)
        unit = 2.0 * np.finfo(float).eps
        end, table = self._covered(abs(numbers[0]), np.abs(state), sizes)
        return unit * end, unit * table

    def factor(self, table: Array) -> Array:
        """Return the derivatives of the state at a piece's end by that at its start."""
        return table[:, 2 : 2 + 2 * self.freedom]


def growth(factor: Array) -> float:
    """Return by how much a flight with these derivatives of its state may enlarge a difference of
    states whose velocities are scaled so that positions make as much of velocities as these make
    of positions: the smallest norm for any unit of time, and, by LAPACK's balancing, nearly that
    for any units of several coordinates."""
    if not np.all(np.isfinite(factor)):
        return math.inf
    d = len(factor) // 2
    by_rates, by_places = (float(np.max(np.abs(e))) for e in (factor[:d, d:], factor[d:, :d]))
    if by_rates > 0.0:
        scale = math.sqrt(by_places) / math.sqrt(by_rates) if by_places > 0.0 else 1.0 / by_rates
    else:
        scale = by_places or 1.0
    units = np.repeat([1.0, 2.0 ** round(math.log2(scale))], d)
    factor = factor * (units / units[:, None])
    if d > 1:
        factor = lapack().dgebal(factor, scale=1)[0]
    return float(np.linalg.norm(factor, 2))


@dataclass(frozen=True, eq=False)
class Pieces:
    """A flight in pieces."""

    flight: IntegratedFlight
    parts: Array
    """Beginnings and ends of pieces as parts of the flight, shape (J + 1,)."""
    states: Array
    """States with which pieces begin, shape (J, 2 * freedom)."""
    ends: Array
    """States to which pieces lead, shape (J, 2 * freedom)."""
    tables: list[Array]
    """Derivatives of these, as of `IntegratedFlight.fly`."""
    arrival: Array
    """Derivatives of the last equations by the state to which the last piece leads: E, shape (2 *
    freedom, 2 * freedom)."""
    residuals: list[Array]
    """Residuals of the equations of each piece."""

    @property
    def factors(self) -> list[Array]:
        """The derivatives of each piece's equations by the state it begins with."""
        size = 2 * self.flight.freedom
        found = [table[:, 2 : 2 + size] for table in self.tables]
        return [*found[:-1], self.arrival @ found[-1]]

    def least(self, right: Sequence[Array]) -> Array:
        """Return the states between the ends by which equations with these values are met best."""
        carried, tops = right[0], []
        for (turned, _, _), below in zip(self._triangular, right[1:], strict=True):
            both = turned.T @ np.concatenate([carried, below])
            tops.append(both[: len(carried)])
            carried = both[len(carried) :]
        state, states = np.zeros(len(carried)), []
        for (_, triangle, beside), top in zip(self._triangular[::-1], tops[::-1], strict=True):
            state = np.linalg.solve(triangle, top - beside @ state)
            states.append(state)
        return np.array(states[::-1])

    @functools.cached_property
    def _triangular(self) -> list[tuple[Array, Array, Array]]:
        """QR factors of the derivatives of all equations by the states between the ends.

        Of each state's column, of which the piece before it has left a part: the orthogonal factor
        of that part and the piece behind, the triangle, and what is right of it.
        """
        size, factors = len(self.arrival), self.factors
        carried, found = -np.eye(size), []
        for factor in factors[1:]:
            turned, triangle = np.linalg.qr(np.concatenate([carried, factor]), mode="complete")
            beside = -turned[size:].T
            found.append((turned, triangle[:size], beside[:size]))
            carried = beside[size:]
        return found

    def combinations(self) -> list[Array]:
        """Return the factors of each piece's equations in rows without the states between.

        Rows are of size `SIZE`, and in the order of their growth; together they keep the
        orientation of the last equations.
        """
        turned, triangles, factors = np.eye(len(self.arrival)), [], self.factors
        turns = []
        for factor in factors:
            turned, triangle = np.linalg.qr(factor @ turned)
            signs = np.where(np.diag(triangle) < 0.0, -1.0, 1.0)
            turned, triangle = turned * signs, triangle * signs[:, None]
            turns.append(turned)
            triangles.append(triangle)
        rows = [_scaled_row(i, triangles) for i in range(len(turned))]
        if np.linalg.det(turned) < 0.0:
            rows[-1] = -rows[-1]
        together = SIZE * np.stack(rows, axis=1)
        return [row @ turn.T for row, turn in zip(together, turns, strict=True)]

    def track(self) -> IntegratedTrack:
        """Return the whole flight as polynomials."""
        flight, d = self.flight, self.flight.freedom
        begins = [flight.numbers(a, b, s)[1:] for a, b, s in self._each()]
        lengths = np.diff(self.parts) * flight.length
        tracks = [
            IntegratedTrack(flight.field, numbers, float(length))
            for numbers, length in zip(begins, lengths, strict=True)
        ]
        return join_flights(tracks, self.parts[:-1] * flight.length, self.states[:, :d])

    def off(self) -> list[tuple[Array, Array]]:
        """Return bounds of the rounding errors of each piece's end and derivatives."""
        return [self.flight.off(*each) for each in self._each()]

    def _each(self) -> list[tuple[float, float, Array]]:
        return list(
            zip(self.parts[:-1].tolist(), self.parts[1:].tolist(), self.states, strict=True)
        )


def _scaled_row(i: int, triangles: Sequence[Array]) -> Array:
    """A row of the products of all triangles behind each piece, the largest of them of size 1."""
    row = np.zeros(len(triangles[0]))
    row[i] = 1.0
    rows, sizes = [row], [0.0]
    for triangle in reversed(triangles[1:]):
        row = row @ triangle
        size = float(np.linalg.norm(row)) or 1.0
        row = row / size
        rows.append(row)
        sizes.append(sizes[-1] + np.log(size))
    powers = np.exp(np.array(sizes) - max(sizes))
    return (np.array(rows) * powers[:, None])[::-1]


class Shooting:
    """The states between the ends of a flight.

    It leaves with the state `start`; `arrival` is E, and `short` the residual of the arrival where
    the last piece leads to the state 0. States have 2 * freedom numbers.
    """

    def __init__(
        self, flight: IntegratedFlight, start: Array, arrival: Array, short: Array
    ) -> None:
        self.flight, self.start = flight, start
        self.arrival, self.short = arrival, short

    def solve(self, known: Pieces | None = None) -> Pieces:
        """Return the flight in pieces.

        Where what is flown to from both ends does not meet, those of a flight nearby, if one is
        known, are a better guess than a straight line between.

        Raises ArithmeticError if no states have been found.
        """
        parts, states, meet = self._guess()
        if known is not None and not meet:
            parts, states = known.parts, known.states
        try:
            return self._refined(parts, states)
        except np.linalg.LinAlgError as error:
            raise SplitFailure(f"a long flight: {error}") from None

    def _refined(self, parts: Array, states: Array) -> Pieces:
        """The flight in pieces none of which grows by too much."""
        while True:
            found = self._newton(parts, states)
            long = [growth(self.flight.factor(table)) > PIECE_MAY for table in found.tables]
            if not any(long):
                return found
            parts, states = self._halved(found, long)

    def _halved(self, found: Pieces, long: Sequence[bool]) -> tuple[Array, Array]:
        parts, states = [0.0], list[Array]()
        for (first, last, state), halve in zip(found._each(), long, strict=True):
            states.append(state)
            if halve:
                middle = 0.5 * (first + last)
                parts.append(middle)
                states.append(self.flight.fly(first, middle, state)[0])
            parts.append(last)
        if min(np.diff(parts)) < SHORTEST:
            raise SplitFailure(f"a long flight asks for pieces below {SHORTEST} of it")
        return np.array(parts), np.array(states)

    def _newton(self, parts: Array, states: Array) -> Pieces:
        """Gauss and Newton's method for the states between the ends."""
        states = states.copy()
        states[0] = self.start
        before = np.inf
        for _ in range(ITERATIONS):
            here = self._at(parts, states)
            step = -here.least(here.residuals)
            sizes = np.maximum(np.max(np.abs(states), axis=0), np.finfo(float).tiny)
            moved = float(np.max(np.abs(step) / sizes))
            if moved == 0.0 or (moved < SETTLED and not moved < 0.5 * before):
                return here
            if not moved < 10.0 * min(before, 1.0):
                break
            before = moved
            states[1:] += step
        raise SplitFailure("the pieces of a long flight do not meet")

    def _at(self, parts: Array, states: Array) -> Pieces:
        """The pieces that begin with these states."""
        if len(states) > MOST_PIECES:
            raise SplitFailure(f"a long flight asks for more than {MOST_PIECES} pieces")
        each = zip(parts[:-1].tolist(), parts[1:].tolist(), states, strict=True)
        flown = [self.flight.fly(*one) for one in each]
        ends = np.array([end for end, _ in flown])
        residuals = [*(ends[:-1] - states[1:]), self.short + self.arrival @ ends[-1]]
        tables = [table for _, table in flown]
        return Pieces(self.flight, parts, states, ends, tables, self.arrival, residuals)

    def _guess(self) -> tuple[Array, Array, bool]:
        """States flown to from both ends, as far as these can be trusted, and between them; and
        whether they meet."""
        meet = True
        there = [self._swept(0.0, self.start)]
        if there[0][-1][0] < 1.0:
            there.append(self._swept(1.0, np.linalg.solve(self.arrival, -self.short))[::-1])
            first, last = there[0][-1][0], there[1][0][0]
            middle = 0.5 * (first + last)
            meet = first >= last
            if meet:
                there = [
                    [each for each in there[0] if each[0] <= middle],
                    [each for each in there[1] if each[0] > middle],
                ]
            else:
                there.insert(1, _interpolate_states(there[0][-1], there[1][0]))
        nodes = [each for sweep in there for each in sweep]
        nodes = nodes[:-1] if nodes[-1][0] == 1.0 else nodes
        if len(nodes) < 2:
            nodes.append((0.5, self.flight.fly(0.0, 0.5, self.start)[0]))
        return np.array([*(part for part, _ in nodes), 1.0]), np.array([s for _, s in nodes]), meet

    def _swept(self, part: float, state: Array) -> list[tuple[float, Array]]:
        """States flown to from one end, until they have grown too much."""
        found, product = [(part, state)], np.eye(len(state))
        way = 1.0 - 2.0 * part
        size = 0.0625
        while 0.0 <= part + way * SHORTEST <= 1.0:
            goal = min(max(part + way * size, 0.0), 1.0)
            try:
                end, table = self.flight.fly(part, goal, state)
            except ArithmeticError:
                end, table = state, np.full((len(state), 2 + len(state)), np.inf)
            factor = self.flight.factor(table)
            grown = growth(factor)
            if grown > PIECE_GROWS and size > SHORTEST:
                size *= 0.5
                continue
            if grown == np.inf:
                break
            product = factor @ product
            if not growth(product) < TRUSTED:
                break
            part, state = goal, end
            found.append((part, state))
            size = min(0.125, 2.0 * size) if grown < PIECE_GROWS**0.5 else size
        return found


def _interpolate_states(
    one: tuple[float, Array], other: tuple[float, Array]
) -> list[tuple[float, Array]]:
    """States on the straight line from one to another."""
    count = min(MOST_PIECES // 2, max(4, int((other[0] - one[0]) / 0.01)))
    weights = np.linspace(0.0, 1.0, count + 1)[1:-1]
    return [
        (one[0] + w * (other[0] - one[0]), one[1] + w * (other[1] - one[1]))
        for w in weights.tolist()
    ]


CANCELS = 32.0 * float(np.finfo(float).eps)
"""Part of its terms that a sum of them leaves which vanishes but for rounding."""


class EvaluatedKernel(NamedTuple):
    """A kernel evaluated on series: what its flight is integrated from, and its residual."""

    field: str
    directions: str
    numbers: Array
    residual: Array


class IntegratedForm(Segment):
    """The flight from one wall to another, integrated."""

    def __init__(self, kernels: KernelSource, start: str, end: str) -> None:
        super().__init__(kernels, start, end)
        self._kept: Split | None = None
        self._whole = functools.lru_cache(KEPT)(self._flight)
        self._m = kernels.model.unknowns_per_impact
        names = list(kernels.model.values)
        self._free = [names.index(name) for name in kernels.parameters]

    @functools.cached_property
    def divided(self) -> bool:
        """Whether the equation of the gap coordinate is divided by the flight's duration."""
        names = [guard.name for guard in self._kernels.model.WALLS]
        if self._walls[0] == SECTION:
            return False
        left, reached = (names.index(letter) for letter in self._walls)
        return self._kernels.passages.arrivals[left][reached] != ELSEWHERE

    def blocks(self, start: Numbers, end: Numbers, values: Numbers) -> Blocks:
        """Return residual and first derivatives; rows are combined where the flight is long."""
        pieces = self.pieces(start, end, values)
        if not isinstance(pieces, Split):
            return pieces
        return CombinedBlocks(*pieces.blocks())

    def whole(self, start: Numbers, end: Numbers, values: Numbers) -> Blocks:
        """Return `blocks` of a flight that is not long."""
        found = self._whole(*map(float, (*start, *end)), *map(float, values))
        if self._grows(found):
            raise SplitFailure("a long flight is computed in pieces")
        return found

    def _grows(self, whole: Blocks) -> bool:
        return differences_grow(whole[1], whole[2], self._m, self._walls[0] != SECTION)

    def second(self, start: Numbers, end: Numbers, along: Numbers, values: Numbers) -> Blocks:
        """Return the derivatives of `blocks` along a direction."""
        pieces = self.pieces(start, end, values)
        if not isinstance(pieces, Split):
            return super().second(start, end, along, values)
        return pieces.second(np.array(along, dtype=float))

    def third(self, start: Numbers, end: Numbers, along: Numbers, values: Numbers) -> Row:
        """Return the third derivatives of the residual along a direction."""
        pieces = self.pieces(start, end, values)
        if not isinstance(pieces, Split):
            return super().third(start, end, along, values)
        held = [0.0] * len(self._free)
        return tuple((6.0 * pieces.along(np.array([*along, *held]), 3)[-1]).tolist())

    def over(self, arithmetic: Arithmetic) -> Callable[[Numbers, Numbers, Numbers], Blocks]:
        """Return `blocks` for the numbers of another arithmetic, in which flights are whole; but
        bounds of rounding errors are those of `blocks`."""
        from .bounded import BOUNDED

        whole = super().over(arithmetic)
        if arithmetic is not BOUNDED:
            return whole

        def bounded(start: Numbers, end: Numbers, values: Numbers) -> Blocks:
            pieces = self.pieces(*([float(x) for x in part] for part in (start, end, values)))
            if not isinstance(pieces, Split):
                return whole(start, end, values)
            return pieces.bounded([float(getattr(x, "error", 0.0)) for x in (*start, *end)])

        return bounded

    def long_track(self, start: Numbers, end: Numbers, values: Numbers) -> IntegratedTrack | None:
        """Return the flight as polynomials if it is computed in pieces."""
        pieces = self.pieces(start, end, values)
        return pieces.pieces.track() if isinstance(pieces, Split) else None

    def pieces(self, start: Numbers, end: Numbers, values: Numbers) -> Split | Blocks:
        """Return the flight in pieces if it asks for it, and else its blocks."""
        ends, given = [float(x) for x in (*start, *end)], [float(x) for x in values]
        whole, failed = None, None
        try:
            whole = self._whole(*ends, *given)
            if not self._grows(whole):
                return whole
        except ArithmeticError as error:
            failed = error
        if self._kept is not None and (self._kept.ends, self._kept.values) == (ends, given):
            return self._kept
        try:
            self._kept = Split(self, ends, given, self._kept)
        except (ArithmeticError, np.linalg.LinAlgError):
            if whole is None:
                assert failed is not None
                raise failed from None
            return whole
        return self._kept

    def seen(
        self, ends: Sequence[Sequence[Number]], values: Sequence[Any], arrived: Sequence[Any] | None
    ) -> EvaluatedKernel:
        """Evaluate the kernel on series (coefficients of unknowns and of parameter values).

        Its flight arrives with the coefficients `arrived` of mean and end velocities; zero by
        default.
        """
        asked: list[Any] = []

        def flown(field: str, directions: str, *numbers: Any) -> list[Any]:
            count = 2 * statement(field).freedom
            given = [0.0] * count if arrived is None else [Series(row) for row in arrived]
            asked[:] = field, directions, numbers
            return [*given, *[0.0] * (count * len(directions.split()))]

        names = {**FLOAT_SERIES.names, "flown": flown}
        size = len(ends[0])
        moving = [Series(row) for row in ends]
        parameters = [Series(x) if isinstance(x, list) else x for x in values]
        rows = evaluate_in(self._flight, Arithmetic(names))(*moving, *parameters)[0]
        field, directions, numbers = asked
        return EvaluatedKernel(
            field, directions, _coefficients(numbers, size), _coefficients(rows, size)
        )


def _coefficients(numbers: Sequence[Any], size: int) -> Array:
    """Coefficients of series and numbers, a row for each."""
    rest = [0.0] * (size - 1)
    rows = (x.coefficients if isinstance(x, Series) else [x, *rest] for x in numbers)
    return np.array([[float(c) for c in row] for row in rows])


class Split:
    """A flight in pieces at given ends, and what its blocks are made of; `known` is one nearby."""

    def __init__(
        self, form: IntegratedForm, ends: list[float], values: list[float], known: Split | None
    ) -> None:
        self.form, self.ends, self.values = form, ends, values
        self.m, self.free = form._m, form._free
        self.size = len(ends) + len(self.free)
        here = form.seen([[x, 0.0] for x in ends], values, None)
        names = statement(here.field).names
        d = self.d = statement(here.field).freedom
        state = 2 + 2 * d
        self.moving = [i for i in range(state, len(names)) if names[i] in here.directions.split()]
        directions = *names[:state], *(names[i] for i in self.moving)
        length, begin, *start = here.numbers[:state, 0].tolist()
        if not length > 0.0:
            raise ArithmeticError("a flight has no duration")
        given = here.numbers[state:, 0]
        flight = IntegratedFlight(here.field, tuple(directions), begin, length, given)
        self.by_arrived = np.array([self._by_arrived(i) for i in range(2 * d)]).T
        arrival = self.by_arrived.copy()
        arrival[:, :d] /= length
        short = here.residual[:, 0] - arrival[:, :d] @ np.array(start[:d])
        shooting = Shooting(flight, np.array(start), arrival, short)
        self.pieces: Pieces = shooting.solve(known.pieces if known else None)
        self.rows = self.pieces.combinations()

    def _by_arrived(self, i: int) -> Array:
        """How the residual changes with a number with which the flight arrives."""
        arrived = [[0.0, float(k == i)] for k in range(2 * self.d)]
        return self.form.seen([[x, 0.0] for x in self.ends], self.values, arrived).residual[:, 1]

    def _given(self, direction: Array, degree: int) -> tuple[list[list[float]], list[Any]]:
        """Unknowns and parameters that move along a direction."""
        rest, values = [0.0] * (degree - 1), list[Any](self.values)
        for place, rate in zip(self.free, direction[len(self.ends) :].tolist(), strict=True):
            values[place] = [values[place], rate, *rest]
        return [[x, q, *rest] for x, q in zip(self.ends, direction.tolist(), strict=False)], values

    def _arrived(self, degree: int, length: Array, way: Array, speeds: Array) -> list[list[float]]:
        """Coefficients of mean and end velocities, of those of what the flight covers."""
        means = [(Series(row) / Series(length)).coefficients for row in way.tolist()]
        return [*means, *speeds.tolist()]

    # First derivatives.

    def _changes(self) -> list[list[Array]]:
        """How each piece's numbers change with each unknown, but for the states between."""
        found = []
        for direction in np.eye(self.size):
            seen = self.form.seen(*self._given(direction, 1), None).numbers[:, 1]
            found.append(self._numbers(seen))
        return found

    def _numbers(self, change: Array) -> list[Array]:
        """The same of one change of the numbers of the whole flight.

        The times between pieces are held: the first one alone begins at another time, and the last
        one alone ends at another.
        """
        d, count = self.d, len(self.rows)
        length, begin, start = change[0], change[1], change[2 : 2 + 2 * d]
        moving, still = change[self.moving], np.zeros(2 * d)
        found = [np.concatenate([[0.0, 0.0], still, moving]) for _ in range(count)]
        found[0][0], found[0][1], found[0][2 : 2 + 2 * d] = -begin, begin, start
        found[-1][0] = begin + length
        return found

    def _first(self) -> list[list[Array]]:
        """How each piece's equations change with each unknown, the states between held."""
        pieces, d = self.pieces, self.d
        result, flight = [], pieces.flight
        way = pieces.ends[-1, :d] - pieces.states[0, :d]
        far = np.abs(pieces.ends[-1, :d]) + np.abs(pieces.states[0, :d])
        arrived = np.concatenate([way / flight.length, pieces.ends[-1, d:]])
        constant = [[float(x), 0.0] for x in arrived]
        slopes = self.by_arrived[:, :d] / flight.length
        for direction, numbers in zip(np.eye(self.size), self._changes(), strict=True):
            seen = self.form.seen(*self._given(direction, 1), constant)
            rows = [table @ n for table, n in zip(pieces.tables, numbers, strict=True)]
            start, longer = seen.numbers[2 : 2 + d, 1], seen.numbers[0, 1] / flight.length
            direct = seen.residual[:, 1] - slopes @ (start + way * longer)
            if self.form.divided:  # a multiple of the residual makes no difference
                direct[0] += pieces.residuals[-1][0] * longer
            sizes = np.abs(start) + far * abs(longer)
            sizes = np.abs(seen.residual[:, 1]) + np.abs(slopes) @ sizes
            direct[np.abs(direct) <= CANCELS * sizes] = 0.0
            rows[-1] = pieces.arrival @ rows[-1] + direct
            result.append(rows)
        return result

    def _combined(self, rows: Sequence[Array]) -> Array:
        return np.sum([w @ row for w, row in zip(self.rows, rows, strict=True)], axis=0)

    def blocks(self) -> Blocks:
        """Return residual and first derivatives."""
        columns = np.array([self._combined(rows) for rows in self._first()]).T
        return self._laid_out(self._combined(self.pieces.residuals), columns)

    def _laid_out(self, residual: Array, columns: Array) -> Blocks:
        m = self.m
        parts = columns[:, :m], columns[:, m : 2 * m], columns[:, 2 * m :]
        start, end, free = (tuple(part.ravel().tolist()) for part in parts)
        return tuple(residual.tolist()), start, end, free

    # Higher derivatives.

    def along(self, direction: Array, degree: int) -> Array:
        """Return the coefficients of the residual along a direction, up to an order, in rows."""
        states = np.zeros((degree + 1, *self.pieces.states.shape))
        states[0] = self.pieces.states
        found = np.zeros((degree + 1, len(self.rows[0])))
        for order in range(1, degree + 1):
            rows = self._order(direction, states[: order + 1])
            found[order] = self._combined(rows)
            states[order, 1:] = -self.pieces.least(rows)
        return found

    def _order(self, direction: Array, states: Array) -> list[Array]:
        """The coefficients of the highest order of each piece's equations."""
        pieces, d, degree = self.pieces, self.d, len(states) - 1
        flight, given = pieces.flight, self._given(direction, degree)
        numbers = self.form.seen(*given, None).numbers
        function = integrator(flight.field, (), degree)
        rows = []
        for j, (first, last) in enumerate(
            zip(pieces.parts[:-1].tolist(), pieces.parts[1:].tolist(), strict=True)
        ):
            begin, length = np.zeros(degree + 1), np.zeros(degree + 1)
            begin[0], length[0] = (
                flight.begin + first * flight.length,
                (last - first) * flight.length,
            )
            state = states[:, j].T.copy()
            if j == 0:
                begin[1:], length[1:] = numbers[1, 1:], -numbers[1, 1:]
                state = numbers[2 : 2 + 2 * d]
            if j == len(pieces.states) - 1:
                length[1:] += numbers[1, 1:] + numbers[0, 1:]
            given_rows: list[Any] = [length, begin, *state, *numbers[2 + 2 * d :]]
            flown = np.array(function.of_series(given_rows), dtype=float)
            covered = [(Series(length) * Series(u)).coefficients for u in flown[:d].tolist()]
            rows.append(np.concatenate([state[:d] + np.array(covered), flown[d:]]))
        way = rows[-1][:d] - numbers[2 : 2 + d]
        arrived = self._arrived(degree, numbers[0], way, rows[-1][d:])
        last = self.form.seen(*given, arrived).residual
        return [*(row[:, -1] for row in rows[:-1]), last[:, -1]]

    def second(self, along: Array) -> Blocks:
        """Return the derivatives of `blocks` along a direction, by those along sums with others."""
        size = float(np.max(np.abs(along)))
        if size == 0.0:
            return self._laid_out(
                np.zeros(len(self.rows[0])), np.zeros((len(self.rows[0]), self.size))
            )
        columns = []
        for other in size * np.eye(self.size):
            both = (self.along(along + sign * other, 2)[2] for sign in (1.0, -1.0))
            one, apart = both
            columns.append(0.5 * (one - apart) / size)
        return self._laid_out(self.along(along, 1)[1], np.array(columns).T)

    # Rounding.

    def bounded(self, off: Sequence[float]) -> Blocks:
        """Return the blocks with bounds of their errors, of those of the unknowns."""
        from .bounded import BoundedNumber

        blocks = self.blocks()
        errors = self._errors(np.array(off), blocks)
        residual, start, end, free = (
            tuple(map(BoundedNumber, part, error.ravel().tolist()))
            for part, error in zip(blocks, errors, strict=True)
        )
        return residual, start, end, free

    def _errors(self, off: Array, blocks: Blocks) -> tuple[Array, ...]:
        pieces, unit = self.pieces, 2.0 * np.finfo(float).eps
        weights = [np.abs(w) for w in self.rows]
        weights[-1] = weights[-1] @ np.abs(pieces.arrival)
        bounds = pieces.off()
        first, changes = self._first(), self._changes()
        residual = sum(w @ end for w, (end, _) in zip(weights, bounds, strict=True))
        start, end = (np.abs(np.reshape(part, (self.m, self.m))) for part in blocks[1:3])
        residual = residual + np.hstack([start, end]) @ off
        columns = []
        for rows, numbers in zip(first, changes, strict=True):
            states = np.vstack([np.zeros(2 * self.d), -pieces.least(rows)])
            error = np.zeros(len(residual))
            for w, table, (_, less), number, state in zip(
                weights, pieces.tables, bounds, numbers, states, strict=True
            ):
                moved = np.abs(number)
                moved[2 : 2 + 2 * self.d] += np.abs(state)
                error += w @ (less @ moved + unit * np.abs(table) @ moved)
            columns.append(error)
        by = np.array(columns).T
        return residual, by[:, : self.m], by[:, self.m : 2 * self.m], by[:, 2 * self.m :]
