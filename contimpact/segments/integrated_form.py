"""Segments that are integrated: as a whole, or in pieces where they grow too much.

Rounding errors grow along a flight as all differences do. Where that comes to more than `LONG`, the
flight is computed by `multiple_shooting`, and its residual is the same up to a regular matrix: rows
are combined such that none of them is large.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array, Number
from .arithmetic import FLOATS, Arithmetic, evaluate_in
from .closed_form import ClosedForm
from .integrated_track import IntegratedTrack
from .layout import SECTION, Blocks, Row, Together
from .multiple_shooting import IntegratedFlight, Pieces, Shooting
from .passages import ELSEWHERE
from .segment import KernelSource, Numbers
from .series import Series, series
from .taylor import integrator, statement

LONG = 1e3
"""Growth of a flight from which on it is computed in pieces."""


CANCELS = 32.0 * float(np.finfo(float).eps)
"""Part of its terms that a sum of them leaves which vanishes but for rounding."""


class Seen(NamedTuple):
    """A kernel evaluated on series: what its flight is integrated from, and its residual."""

    field: str
    directions: str
    numbers: Array
    residual: Array


class IntegratedForm(ClosedForm):
    """The flight from one wall to another, integrated; see `segment.Segment`."""

    def __init__(self, kernels: KernelSource, start: str, end: str) -> None:
        super().__init__(kernels, start, end)
        self._kept: Split | None = None
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
        return Together(*pieces.blocks())

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
            whole = self._flight(*start, *end, *values)
            if not grows(whole, self._m):
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
    ) -> Seen:
        """Evaluate the kernel on series, its flight arriving with these numbers.

        Parameters
        ----------
        ends : sequence of sequence
            Coefficients of each unknown of the start and the end.
        values : sequence
            Parameter values, coefficients where they move.
        arrived : sequence or None
            Coefficients of mean and end velocities; zero by default.
        """
        asked: list[Any] = []

        def flown(field: str, directions: str, *numbers: Any) -> list[Any]:
            count = 2 * statement(field).freedom
            given = [0.0] * count if arrived is None else [Series(row) for row in arrived]
            asked[:] = field, directions, numbers
            return [*given, *[0.0] * (count * len(directions.split()))]

        names = {**SERIES.names, "flown": flown}
        size = len(ends[0])
        moving = [Series(row) for row in ends]
        parameters = [Series(x) if isinstance(x, list) else x for x in values]
        rows = evaluate_in(self._flight, Arithmetic(names))(*moving, *parameters)[0]
        field, directions, numbers = asked
        return Seen(field, directions, _coefficients(numbers, size), _coefficients(rows, size))


SERIES = series(FLOATS)


def grows(blocks: Blocks, m: int) -> bool:
    """Whether differences grow too much along a flight.

    The derivatives by an unknown of the start are compared with those by the same one of the end.
    """
    _, leaving, arriving, _ = blocks
    for i in range(m):
        one = max(abs(x) for x in leaving[i::m])
        if one > LONG and one > LONG * max(abs(x) for x in arriving[i::m]):
            return True
    return False


def _coefficients(numbers: Sequence[Any], size: int) -> Array:
    """Coefficients of series and numbers, a row for each."""
    rest = [0.0] * (size - 1)
    rows = (x.coefficients if isinstance(x, Series) else [x, *rest] for x in numbers)
    return np.array([[float(c) for c in row] for row in rows])


class Split:
    """A flight in pieces at given ends, and what its blocks are made of.

    Parameters
    ----------
    form : IntegratedForm
    ends : list of float
        Unknowns of the start and of the end.
    values : list of float
    known : Split or None
        A flight nearby.
    """

    def __init__(
        self,
        form: IntegratedForm,
        ends: list[float],
        values: list[float],
        known: Split | None,
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
        from .bounded import Bounded

        blocks = self.blocks()
        errors = self._errors(np.array(off), blocks)
        residual, start, end, free = (
            tuple(map(Bounded, part, error.ravel().tolist()))
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
