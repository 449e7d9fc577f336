r"""Linear flights: mass, damping and stiffness matrices under a periodic force.

Importing this module imports SymPy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, Self, TypeAlias

import sympy
from sympy import Expr, Integer, pi
from sympy.simplify.fu import TR8

from ..errors import InputError, short_repr
from .symbols import whole_quotient

Matrix = Sequence[Sequence[Expr]]


class Law(sympy.Atom):
    """What a linear flight is computed from.

    `freedom` and `waves` count degrees of freedom and harmonics of the forcing. `numbers` are the
    accelerations, for each coordinate a row of factors of all positions, all velocities, the cosine
    and sine of each harmonic, and 1; then the harmonics' angular frequencies.
    """

    __slots__ = ("freedom", "numbers", "waves")

    def __new__(cls, freedom: int, waves: int, numbers: Sequence[Expr]) -> Self:
        law: Self = super().__new__(cls)
        law.freedom, law.waves, law.numbers = freedom, waves, tuple(numbers)
        return law

    def __getnewargs__(self) -> tuple[Any, ...]:
        return self.freedom, self.waves, self.numbers

    _hashable_content = __getnewargs__

    def _sympystr(self, printer: Any) -> str:
        return f"Law({', '.join(map(printer._print, self.numbers))})"

    def _sympyrepr(self, printer: Any) -> str:
        return f"Law({self.freedom}, {self.waves}, {', '.join(map(printer._print, self.numbers))})"

    @property
    def parameters(self) -> list[Expr]:
        """The symbols in it, by name."""
        return sorted(set().union(*(e.free_symbols for e in self.numbers)), key=str)


class _Flow(sympy.Function):
    """An entry of the tables of `segments.linear_flow`: ``(law, i, j, by, dt, *parameters)``.

    `by` is 0 for the entry itself, 1 for its derivative by the duration dt, and from 2 on for that
    by a parameter of the law.
    """

    def fdiff(self, argindex: int = 5) -> sympy.Expr:
        law, i, j, by, *rest = self.args
        if by != 0:
            found = "second derivatives of a linear flight"
            raise InputError("flight", found, "differentiate its kernel instead")
        return self.func(law, i, j, Integer(argindex - 4), *rest)

    def _eval_derivative(self, s: Expr) -> Expr:
        return self.fdiff(5 + self.args[4:].index(s)) if s in self.args[4:] else Integer(0)


class MeanFlow(_Flow):
    """What a coordinate of the state adds to the mean velocity of a position."""


class EndFlow(_Flow):
    """What a coordinate of the state adds to a velocity at the end."""


class Linear:
    r"""Motion by :math:`M\ddot x + C\dot x + Kx = f(t)`, for any damping, at resonance too.

    Parameters
    ----------
    mass, damping, stiffness : sequence of sequences of sympy.Expr
        Square matrices, or the entries of their diagonals; the mass matrix is regular.
    force : callable ``t -> [f_0, f_1, ...]``
        The force on each coordinate: sums of products of sines and cosines, of the given period.
        Amplitudes and phases may have parameters in them.
    period : sympy.Expr

    Attributes
    ----------
    law : Law
    inverse : sympy.Matrix
        Of the mass matrix.

    Raises
    ------
    InputError
        For matrices of other shapes, a mass matrix that is singular whatever the parameters, or a
        force that is no sum of harmonics.
    """

    def __init__(
        self,
        *,
        mass: Matrix,
        damping: Matrix,
        stiffness: Matrix,
        force: Callable[[Expr], Sequence[Expr]],
        period: Expr,
    ) -> None:
        size = len(_rows(mass, "mass"))
        m, c, k = (
            _square(_rows(given, name), size, name)
            for given, name in ((mass, "mass"), (damping, "damping"), (stiffness, "stiffness"))
        )
        self.period = sympy.sympify(period)
        t = sympy.Symbol("t'", real=True)
        given = force(t)
        if not isinstance(given, Sequence) or len(given) != size:
            accepted = f"give a list with one force for each degree of freedom: {size}"
            raise InputError("force", f"found {short_repr(given)}", accepted)
        waves = [harmonics_of(e, t, self.period, f"force[{i}]") for i, e in enumerate(given)]
        self.orders = sorted({n for wave in waves for n in wave if n > 0})
        self.inverse = inverse = _inverse(m)
        columns = [part for n in self.orders for part in ((n, 0), (n, 1))] + [(0, 0)]
        pushes = sympy.Matrix([[wave.get(n, (0, 0))[i] for n, i in columns] for wave in waves])
        table = (-inverse * k).row_join(-inverse * c).row_join(inverse * pushes)
        self.rows = [[sympy.together(e) for e in table.row(i)] for i in range(size)]
        frequencies = [2 * pi * n / self.period for n in self.orders]
        self.law = Law(size, len(self.orders), [e for row in self.rows for e in row] + frequencies)

    @cached_property
    def _parameters(self) -> list[Expr]:
        return self.law.parameters

    def _coordinates(self, t: Expr, x: Sequence[Expr], v: Sequence[Expr]) -> list[Expr]:
        angles = [2 * pi * n * t / self.period for n in self.orders]
        waves = [wave(angle) for angle in angles for wave in (sympy.cos, sympy.sin)]
        return [*x, *v, *waves, Integer(1)]

    def flight(
        self, t0: Expr, x0: Sequence[Expr], v0: Sequence[Expr], dt: Expr
    ) -> tuple[list[Expr], list[Expr]]:
        """Return mean velocities and end velocities, as `Formulas.flight` does."""
        state = self._coordinates(t0, x0, v0)

        def row(kind: type[sympy.Function], i: int) -> Expr:
            entries = (
                kind(self.law, Integer(i), Integer(j), Integer(0), dt, *self._parameters)
                for j in range(len(state))
            )
            return sympy.Add(*(entry * x for entry, x in zip(entries, state, strict=True)))

        size = range(self.law.freedom)
        return [row(MeanFlow, i) for i in size], [row(EndFlow, i) for i in size]

    def acceleration(self, t: Expr, x: Sequence[Expr], v: Sequence[Expr]) -> list[Expr]:
        """Return the accelerations, as `Formulas.acceleration` does."""
        state = self._coordinates(t, x, v)
        return [sympy.Add(*(a * b for a, b in zip(row, state, strict=True))) for row in self.rows]


def _rows(given: Matrix | Sequence[Expr], name: str) -> list[list[Expr]]:
    """The rows of a matrix, from its rows or its diagonal."""
    if isinstance(given, sympy.MatrixBase):
        return given.tolist()
    if not isinstance(given, Sequence) or isinstance(given, str):
        raise InputError(name, f"found {short_repr(given)}", "give a list of rows, a list each")
    if any(isinstance(row, Sequence) and not isinstance(row, str) for row in given):
        return [list(row) if isinstance(row, Sequence) else [row] for row in given]
    return [[e if i == j else 0 for j in range(len(given))] for i, e in enumerate(given)]


def _square(rows: list[list[Expr]], size: int, name: str) -> sympy.Matrix:
    if len(rows) != size or any(len(row) != size for row in rows):
        accepted = f"give {size} rows of {size} entries"
        raise InputError(name, f"found rows of {short_repr([len(row) for row in rows])}", accepted)
    return sympy.Matrix(size, size, lambda i, j: sympy.sympify(rows[i][j]))


def _inverse(mass: sympy.Matrix) -> sympy.Matrix:
    if mass.is_diagonal():
        if any(e == 0 for e in mass.diagonal()):
            raise InputError("mass", "the matrix is singular", "give every coordinate a mass")
        return sympy.diag(*(1 / e for e in mass.diagonal()))
    determinant = sympy.factor(mass.det())
    if determinant == 0:
        raise InputError("mass", "the matrix is singular", "give a regular one")
    return mass.adjugate() / determinant


Rows: TypeAlias = tuple[list[list[Expr]], dict[int, list[tuple[Expr, Expr]]]]
"""Factors of positions and velocities, and of the cosine and the sine of each harmonic."""


def rows_of(
    accelerations: Sequence[Expr], state: Sequence[Expr], t: Expr, period: Expr
) -> Rows | None:
    """Return the rows of a linear law from accelerations in the positions and velocities of `state`
    and in the time t; None where they are not linear."""
    factors = [[sympy.diff(e, x) for x in state] for e in accelerations]
    if any(e.has(t, *state) for row in factors for e in row):
        return None
    rest = [sympy.sympify(e).xreplace(dict.fromkeys(state, Integer(0))) for e in accelerations]
    try:
        found = [harmonics_of(e, t, period, "acceleration") for e in rest]
    except InputError:
        return None
    orders = sorted(set().union(*found))
    none = Integer(0), Integer(0)
    return factors, {n: [waves.get(n, none) for waves in found] for n in orders}


def law_of(rows: Rows, orders: Sequence[int], period: Expr) -> Law:
    """Return the law of a linear flight with harmonics of the given orders."""
    factors, waves = rows
    none = [(Integer(0), Integer(0))] * len(factors)
    pushes = [waves.get(n, none) for n in orders]
    means = waves.get(0, none)
    table = (
        [*row, *(c for push in pushes for c in push[i]), means[i][0]]
        for i, row in enumerate(factors)
    )
    numbers = [sympy.together(e) for row in table for e in row]
    return Law(len(factors), len(orders), [*numbers, *(2 * pi * n / period for n in orders)])


def harmonics_of(e: Expr, t: Expr, period: Expr, where: str) -> dict[int, tuple[Expr, Expr]]:
    """Return the factors (of the cosine, of the sine) of each harmonic of a function of t.

    Raises InputError if it is no sum of harmonics of that period.
    """
    found: dict[int, tuple[Expr, Expr]] = {}
    for term in sympy.Add.make_args(sympy.expand(TR8(sympy.expand(sympy.sympify(e))))):
        factor, order, parts = term, 0, (Integer(1), Integer(0))
        if term.has(t):
            factor, wave = term.as_independent(t, as_Add=False)
            order, parts = _wave(wave, t, period, where)
        known = found.get(order, (Integer(0), Integer(0)))
        found[order] = tuple(a + factor * b for a, b in zip(known, parts, strict=True))
    return found


def _wave(wave: Expr, t: Expr, period: Expr, where: str) -> tuple[int, tuple[Expr, Expr]]:
    """The order of a sine or cosine of t, and its factors of cosine and sine."""
    accepted = f"give a sum of products of sines and cosines of the period {period}"
    angle = sympy.expand(wave.args[0]) if isinstance(wave, sympy.sin | sympy.cos) else None
    if angle is None or not angle.is_polynomial(t) or sympy.degree(angle, t) != 1:
        raise InputError(where, f"found {_time_text(wave, t)}", accepted)
    order = whole_quotient(angle.coeff(t, 1) * period / (2 * pi))
    if not order:
        raise InputError(
            where, f"{_time_text(wave, t)} does not have the period {period}", accepted
        )
    phase, sign = angle.coeff(t, 0), 1 if order > 0 else -1
    cosine, sine = sympy.cos(phase), sympy.sin(phase)
    if isinstance(wave, sympy.cos):
        return abs(order), (cosine, -sign * sine)
    return abs(order), (sine, sign * cosine)


def _time_text(wave: Expr, t: Expr) -> str:
    """A function of t as its author wrote it."""
    return short_repr(str(wave.xreplace({t: sympy.Symbol("t")})))
