"""Flights by laws of first and second order, in closed form where there is one.

Importing this module imports SymPy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import sympy

from ..errors import InputError
from .linear import Linear
from .nonlinear import Nonlinear, state_symbols

Laws = Callable[[Any, Sequence[Any], Sequence[Any]], Sequence[Any]]
"""From the time, all positions and the velocities of second order: rates and accelerations."""


class Motion:
    r"""Motion by :math:`\dot x_i = f_i` or :math:`\ddot x_i = f_i`, coordinate by coordinate.

    A law of first order is that of second order :math:`\ddot x_i = \dot f_i` which begins with
    :math:`\dot x_i = f_i`. Flights are in closed form where all laws are linear with constant
    factors under harmonic forcing, otherwise integrated.

    Parameters
    ----------
    laws : callable ``(t, x, v) -> [f_0, f_1, ...]``
        Of the velocities it is given those of the coordinates of second order.
    orders : sequence of int
        1 or 2 for each coordinate.
    period : sympy.Expr
    """

    def __init__(self, laws: Laws, orders: Sequence[int], period: Any) -> None:
        self.laws, self.orders = laws, tuple(orders)
        size = len(self.orders)
        t, *state = state_symbols(size)
        whole = self._accelerations(t, state[:size], state[size:])
        self.motion = _linear(whole, t, state, period) or Nonlinear(
            _function(whole, [t, *state]), size
        )

    def _accelerations(self, t: Any, x: Sequence[Any], v: Sequence[Any]) -> list[Any]:
        given = [sympy.sympify(e) for e in self.laws(t, x, self._second(v))]
        rates = dict(zip(x, v, strict=True)) | {t: sympy.S.One}
        rates |= {s: e for s, e, order in zip(v, given, self.orders, strict=True) if order == 2}
        return [
            e if order == 2 else sympy.Add(*(sympy.diff(e, s) * r for s, r in rates.items()))
            for e, order in zip(given, self.orders, strict=True)
        ]

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
