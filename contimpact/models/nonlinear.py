"""Flights that are integrated, and the choice between these and linear ones.

Importing this module imports SymPy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, Self

import sympy
from sympy import Expr, Integer

from ..errors import InputError
from .linear import Linear
from .symbols import primed_symbol

MEAN, END = 0, 1


class Field(sympy.Atom):
    """What a flight is integrated from.

    There is an acceleration for each coordinate, in the symbols of `Field.state` and the
    parameters; where rates are given, there is one for each coordinate of first order, and None for
    others. Velocities differ from rates by constants.
    """

    __slots__ = ("accelerations", "rates")
    is_commutative = True

    def __new__(cls, accelerations: Sequence[Expr], rates: Sequence[Expr | None] = ()) -> Self:
        field: Self = super().__new__(cls)
        field.accelerations, field.rates = tuple(accelerations), tuple(rates)
        return field

    def __getnewargs__(self) -> tuple[Any, ...]:
        return self.accelerations, self.rates

    _hashable_content = __getnewargs__

    def _sympystr(self, printer: Any) -> str:
        return f"Field({', '.join(map(printer._print, self._expressions))})"

    def _sympyrepr(self, printer: Any) -> str:
        accelerations, rates = (
            ", ".join("None" if e is None else printer._print(e) for e in given)
            for given in self.__getnewargs__()
        )
        return f"Field([{accelerations}], [{rates}])"

    @property
    def _expressions(self) -> list[Expr]:
        return [*self.accelerations, *(e for e in self.rates if e is not None)]

    @property
    def state(self) -> tuple[Expr, ...]:
        """The symbols of time, positions and velocities."""
        return state_symbols(len(self.accelerations))

    @property
    def parameters(self) -> list[Expr]:
        """The other symbols in it, by name."""
        found = set().union(*(e.free_symbols for e in self._expressions))
        return sorted(found - set(self.state), key=str)


def state_symbols(freedom: int) -> tuple[Expr, ...]:
    """Return the symbols in which accelerations are stated: time, positions and velocities."""
    places = range(freedom)
    return (
        primed_symbol("t"),
        *(primed_symbol(f"x{i}") for i in places),
        *(primed_symbol(f"v{i}") for i in places),
    )


class Flown(sympy.Function):
    """A number that integration gives: ``(field, kind, i, by, dt, t, *x, *v, *parameters)``.

    `kind` is 0 for the mean velocity of the coordinate i, 1 for its velocity at the end of the
    flight. `by` is 0 for the number itself, k for its derivative by the k-th of the arguments that
    begin with the duration dt.
    """

    def fdiff(self, argindex: int = 5) -> sympy.Expr:
        field, kind, i, by, *rest = self.args
        if by != 0:
            found = "second derivatives of a flight that is integrated"
            raise InputError("flight", found, "differentiate its kernel instead")
        return self.func(field, kind, i, Integer(argindex - 4), *rest)

    def _eval_derivative(self, s: Expr) -> Expr:
        moving = ((k, sympy.diff(a, s)) for k, a in enumerate(self.args[4:], 5))
        return sympy.Add(*(rate * self.fdiff(k) for k, rate in moving if rate != 0))


class Nonlinear:
    r"""Motion by :math:`\ddot x = f(t, x, \dot x)`, whatever the expressions.

    It is integrated by Taylor's method, for which the package heyoka has to be installed.

    Parameters
    ----------
    force : callable ``(t, x, v) -> [f_0, f_1, ...]``
        The acceleration of each coordinate, from time, positions and velocities; smooth, and of the
        system's period in t.
    degrees_of_freedom : int
        How many coordinates there are.
    rates : sequence of sympy.Expr or None
        In the symbols of `state_symbols`, for coordinates that move by laws of first order: what
        their accelerations are the derivatives of. It is faster to integrate.

    Raises
    ------
    InputError
        If it does not give an acceleration for each coordinate, or uses others.
    """

    def __init__(
        self,
        force: Callable[[Expr, Sequence[Expr], Sequence[Expr]], Sequence[Expr]],
        degrees_of_freedom: int = 1,
        rates: Sequence[Expr | None] = (),
    ) -> None:
        self.force = force
        t, *state = state_symbols(degrees_of_freedom)
        accepted = f"give one for each degree of freedom: {degrees_of_freedom}"
        try:
            given = list(force(t, state[:degrees_of_freedom], state[degrees_of_freedom:]))
        except IndexError:
            accepted += ", or another number as degrees_of_freedom="
            raise InputError("acceleration", "it uses a further coordinate", accepted) from None
        if len(given) != degrees_of_freedom:
            raise InputError("acceleration", f"found {len(given)}", accepted)
        self.field = Field([sympy.sympify(e) for e in given], rates)

    @cached_property
    def _parameters(self) -> list[Expr]:
        return self.field.parameters

    def flight(
        self, t0: Expr, x0: Sequence[Expr], v0: Sequence[Expr], dt: Expr
    ) -> tuple[list[Expr], list[Expr]]:
        """Return mean velocities and end velocities, as `Formulas.flight` does."""
        given = (dt, t0, *x0, *v0, *self._parameters)

        def number(kind: int, i: int) -> Expr:
            return Flown(self.field, Integer(kind), Integer(i), Integer(0), *given)

        places = range(len(x0))
        means = [number(MEAN, i) for i in places]
        return means, [number(END, i) for i in places]

    def acceleration(self, t: Expr, x: Sequence[Expr], v: Sequence[Expr]) -> list[Expr]:
        """Return the accelerations, as `Formulas.acceleration` does."""
        return [sympy.sympify(e) for e in self.force(t, x, v)]


# Flights by laws of first and second order, in closed form where there is one.

Laws = Callable[[Any, Sequence[Any], Sequence[Any]], Sequence[Any]]
"""Map from the time, all positions and the velocities of second order to rates and
accelerations."""


class Motion:
    r"""Motion by :math:`\dot x_i = f_i` or :math:`\ddot x_i = f_i`, coordinate by coordinate.

    A law of first order is that of second order :math:`\ddot x_i = \dot f_i` which begins with
    :math:`\dot x_i = f_i`. Flights are in closed form where all laws are linear with constant
    factors under harmonic forcing, otherwise integrated.

    Parameters
    ----------
    laws : callable ``(t, x, v) -> [f_0, f_1, ...]``
        From time, all positions, and the velocities of the coordinates of second order.
    orders : sequence of int
        1 or 2 for each coordinate.
    period : sympy.Expr
        The system's.
    """

    def __init__(self, laws: Laws, orders: Sequence[int], period: Any) -> None:
        self.laws, self.orders = laws, tuple(orders)
        size = len(self.orders)
        t, *state = state_symbols(size)
        given = [sympy.sympify(e) for e in laws(t, state[:size], self._second(state[size:]))]
        whole = accelerations_of(given, self.orders, t, state[:size], state[size:])
        first = [
            None if order == 2 else e.as_independent(t, *state, as_Add=True)[1]
            for e, order in zip(given, self.orders, strict=True)
        ]
        self.motion = _linear(whole, t, state, period) or Nonlinear(
            _function(whole, [t, *state]), size, first if any(first) else ()
        )

    def _second(self, v: Sequence[Any]) -> list[Any]:
        """The velocities that are part of the state."""
        return [s for s, order in zip(v, self.orders, strict=True) if order == 2]

    def flight(
        self, t0: Any, x0: Sequence[Any], v0: Sequence[Any], dt: Any
    ) -> tuple[list[Any], list[Any]]:
        """Return mean velocities and end velocities, as `Formulas.flight` does."""
        own, rates = iter(v0), self.laws(t0, x0, v0)
        begun = [
            next(own) if order == 2 else e for e, order in zip(rates, self.orders, strict=True)
        ]
        return self.motion.flight(t0, x0, begun, dt)

    def acceleration(self, t: Any, x: Sequence[Any], v: Sequence[Any]) -> list[Any]:
        """Return rates and accelerations, as `Formulas.acceleration` does."""
        return list(self.laws(t, x, v))


def accelerations_of(
    laws: Sequence[Any], orders: Sequence[int], t: Any, x: Sequence[Any], v: Sequence[Any]
) -> tuple[Any, ...]:
    """Return accelerations from laws of second order and of first, whose rates of change they
    are."""
    rates = dict(zip(x, v, strict=True)) | {t: sympy.S.One}
    rates |= {s: e for s, e, order in zip(v, laws, orders, strict=True) if order == 2}
    return tuple(
        e if order == 2 else sympy.Add(*(sympy.diff(e, s) * rate for s, rate in rates.items()))
        for e, order in zip(laws, orders, strict=True)
    )


def _linear(whole: Sequence[Any], t: Any, state: Sequence[Any], period: Any) -> Linear | None:
    """The motion in closed form; None unless it is linear under a sum of harmonics."""
    size = len(whole)
    factors = [[sympy.diff(e, s) for s in state] for e in whole]
    if any(factor.has(t, *state) for row in factors for factor in row):
        return None
    rest = dict.fromkeys(state, sympy.S.Zero)
    try:
        return Linear(
            mass=sympy.eye(size).tolist(),
            stiffness=[[-e for e in row[:size]] for row in factors],
            damping=[[-e for e in row[size:]] for row in factors],
            force=lambda at: [sympy.expand(e).xreplace({**rest, t: at}) for e in whole],
            period=period,
        )
    except InputError:
        return None


def _function(whole: Sequence[Any], symbols: Sequence[Any]) -> Any:
    def force(t: Any, x: Sequence[Any], v: Sequence[Any]) -> list[Any]:
        given = dict(zip(symbols, [t, *x, *v], strict=True))
        return [sympy.sympify(e).xreplace(given) for e in whole]

    return force
