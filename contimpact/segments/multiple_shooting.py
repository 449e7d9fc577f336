r"""Long flights in pieces: multiple shooting between where a flight leaves and where it arrives.

States :math:`s_1, \ldots, s_{J-1}` between the ends are unknowns of the flight alone. Each piece
leads from one to the next, the last one to the arrival (J = 3; rows are pieces, columns states)::

    [ -1         ]   [ s_1 ]   [ s_1 - fly_1(leave)          ]
    [ F_2   -1   ]   [ s_2 ] ~ [ s_2 - fly_2(s_1)            ]
    [      E F_3 ]             [ -(arrival of fly_3(s_2))    ]

No piece grows by much, so that none of its derivatives is large, whatever the growth of the whole.
The states follow from both ends by Gauss and Newton's method: what grows is held by the arrival,
what decays by the start. What is left are as many rows as there are columns short, combinations
of the equations in which the states have no part. They are told by the QR factors of the product
of all pieces, :math:`F_j Q_{j-1} = Q_j R_j`, which keep its large and its small growth apart
(Ascher, Mattheij and Russell, Numerical Solution of Boundary Value Problems, 1995, ch. 4 and 6).
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from .integrated_track import IntegratedTrack, joined
from .integration import rounded_beside
from .taylor import integrator, statement

PIECE_GROWS, PIECE_MAY = 30.0, 3e3
"""By how much a piece is let grow where pieces are chosen, and at most in the end."""

TRUSTED = 1e7
"""Growth up to which states flown to from one end are a guess of those of the flight."""

SIZE = 1e3
"""Of the rows in which flights are long: what residual is accepted must not be a large part of what
they decay to, on which multipliers and the parameter of a homoclinic orbit depend."""

MOST_PIECES, SHORTEST = 400, 2.0**-12
"""Of a flight, and the shortest as a part of it."""

ITERATIONS, SETTLED = 25, 1e-13
"""Of Gauss and Newton's method, and its step, as part of the states, below which they are known to
rounding where steps become no smaller."""


class NotSplit(ArithmeticError):
    """No states between the ends of a flight have been found."""


@dataclass(frozen=True, eq=False)
class IntegratedFlight:
    """What a flight is integrated from.

    Attributes
    ----------
    field : str
        As of `taylor.text_of`.
    directions : tuple of str
        What pieces are differentiated by: duration, time, state and parameters, in that order.
    begin, length : float
        When it leaves, and its duration.
    given : ndarray
        Values of the field's parameters.
    """

    field: str
    directions: tuple[str, ...]
    begin: float
    length: float
    given: Array

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
        d, numbers = self.freedom, self.numbers(first, last, state)
        found = np.array(integrator(self.field, self.directions)(numbers)).reshape(-1, 2, d)
        (mean, end), tables = found[0], found[1:]
        moved = numbers[0] * tables[:, 0]
        moved[0] += mean
        moved[2 : 2 + d] += np.eye(d)
        return (
            np.concatenate([state[:d] + numbers[0] * mean, end]),
            np.concatenate([moved, tables[:, 1]], axis=1).T,
        )

    def off(self, first: float, last: float, state: Array) -> tuple[Array, Array]:
        """Return bounds of the rounding errors of what `fly` returns."""
        d, numbers = self.freedom, self.numbers(first, last, state)
        names = " ".join(self.directions)
        found = np.array(integrator(self.field, self.directions)(numbers))
        sizes = rounded_beside(self.field, names, numbers, found).reshape(-1, 2, d)
        unit = 2.0 * np.finfo(float).eps
        moved = abs(numbers[0]) * sizes[1:, 0]
        moved[0] += sizes[0, 0]
        moved[2 : 2 + d] += np.eye(d)
        end = np.concatenate([np.abs(state[:d]) + abs(numbers[0]) * sizes[0, 0], sizes[0, 1]])
        return unit * end, unit * np.concatenate([moved, sizes[1:, 1]], axis=1).T

    def growth(self, table: Array) -> float:
        """Return by how much a piece with these derivatives may enlarge a difference of states."""
        return float(np.linalg.norm(table[:, 2 : 2 + 2 * self.freedom], 2))


@dataclass(frozen=True, eq=False)
class Pieces:
    """A flight in pieces.

    Attributes
    ----------
    flight : IntegratedFlight
    parts : ndarray of shape (J + 1,)
        Where pieces begin and end, as parts of the flight.
    states : ndarray of shape (J, 2 * freedom)
        With which they begin.
    ends : ndarray of shape (J, 2 * freedom)
        To which they lead.
    tables : list of ndarray
        Derivatives of these, as of `IntegratedFlight.fly`.
    arrival : ndarray of shape (2 * freedom, 2 * freedom)
        Derivatives of the last equations by the state to which the last piece leads: E.
    residuals : list of ndarray
        Of the equations of each piece.
    """

    flight: IntegratedFlight
    parts: Array
    states: Array
    ends: Array
    tables: list[Array]
    arrival: Array
    residuals: list[Array]

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
        rows = [_scaled(i, triangles) for i in range(len(turned))]
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
        return joined(tracks, self.parts[:-1] * flight.length, self.states[:, :d])

    def off(self) -> list[tuple[Array, Array]]:
        """Return bounds of the rounding errors of each piece's end and derivatives."""
        return [self.flight.off(*each) for each in self._each()]

    def _each(self) -> list[tuple[float, float, Array]]:
        return list(
            zip(self.parts[:-1].tolist(), self.parts[1:].tolist(), self.states, strict=True)
        )


def _scaled(i: int, triangles: Sequence[Array]) -> Array:
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

    Parameters
    ----------
    flight : IntegratedFlight
    start : ndarray of shape (2 * freedom,)
        The state it leaves with.
    arrival : ndarray of shape (2 * freedom, 2 * freedom)
        E.
    short : ndarray of shape (2 * freedom,)
        The residual of the arrival where the last piece leads to the state 0.
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

        Raises
        ------
        ArithmeticError
            If no states have been found.
        """
        parts, states, meet = self._guess()
        if known is not None and not meet:
            parts, states = known.parts, known.states
        try:
            return self._refined(parts, states)
        except np.linalg.LinAlgError as error:
            raise NotSplit(f"a long flight: {error}") from None

    def _refined(self, parts: Array, states: Array) -> Pieces:
        """The flight in pieces none of which grows by too much."""
        while True:
            found = self._newton(parts, states)
            long = [self.flight.growth(table) > PIECE_MAY for table in found.tables]
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
            raise NotSplit(f"a long flight asks for pieces below {SHORTEST} of it")
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
        raise NotSplit("the pieces of a long flight do not meet")

    def _at(self, parts: Array, states: Array) -> Pieces:
        """The pieces that begin with these states."""
        if len(states) > MOST_PIECES:
            raise NotSplit(f"a long flight asks for more than {MOST_PIECES} pieces")
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
                there.insert(1, _between(there[0][-1], there[1][0]))
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
            factor = table[:, 2 : 2 + len(state)]
            growth = float(np.linalg.norm(factor, 2)) if np.all(np.isfinite(factor)) else np.inf
            if growth > PIECE_GROWS and size > SHORTEST:
                size *= 0.5
                continue
            if growth == np.inf:
                break
            product = factor @ product
            if not np.linalg.norm(product, 2) < TRUSTED:
                break
            part, state = goal, end
            found.append((part, state))
            size = min(0.125, 2.0 * size) if growth < PIECE_GROWS**0.5 else size
        return found


def _between(one: tuple[float, Array], other: tuple[float, Array]) -> list[tuple[float, Array]]:
    """States on the straight line from one to another."""
    count = min(MOST_PIECES // 2, max(4, int((other[0] - one[0]) / 0.01)))
    weights = np.linspace(0.0, 1.0, count + 1)[1:-1]
    return [
        (one[0] + w * (other[0] - one[0]), one[1] + w * (other[1] - one[1]))
        for w in weights.tolist()
    ]
