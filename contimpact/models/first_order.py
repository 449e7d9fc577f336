"""Flights of first order: motion by a vector field.

Importing this module imports SymPy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import sympy

from ..errors import InputError
from .linear import Linear
from .nonlinear import Nonlinear, state_symbols

Rates = Callable[[Any, Sequence[Any]], Sequence[Any]]


class FirstOrder:
    r"""Motion by :math:`\dot x = f(t, x)`.

    It is that by :math:`\ddot x = f_t + f_x\dot x` which begins with :math:`\dot x = f`: in closed
    form where f is linear in x with constant factors under harmonic forcing, otherwise integrated.

    Parameters
    ----------
    rates : callable ``(t, x) -> [f_0, f_1, ...]``
    size : int
        How many coordinates there are.
    period : sympy.Expr
    """

    def __init__(self, rates: Rates, size: int, period: Any) -> None:
        self.rates = rates
        t, *state = state_symbols(size)
        x, v = state[:size], state[size:]
        given = [sympy.sympify(e) for e in rates(t, x)]
        slopes = [[sympy.diff(e, s) for s in x] for e in given]
        pushes = [sympy.diff(e, t) for e in given]
        linear = not any(e.has(t, *x) for row in slopes for e in row)
        self.motion: Linear | Nonlinear | None = None
        if linear:
            self.motion = _linear(slopes, pushes, t, period)
        if self.motion is None:
            along = (sympy.Add(*(a * b for a, b in zip(row, v, strict=True))) for row in slopes)
            whole = [push + e for push, e in zip(pushes, along, strict=True)]
            self.motion = Nonlinear(_function(whole, [t, *state]), size)

    def flight(
        self, t0: Any, x0: Sequence[Any], v0: Sequence[Any], dt: Any
    ) -> tuple[list[Any], list[Any]]:
        """Return mean velocities and end velocities, as `Formulas.flight` does."""
        assert self.motion is not None
        return self.motion.flight(t0, x0, list(self.rates(t0, x0)), dt)

    def acceleration(self, t: Any, x: Sequence[Any], v: Sequence[Any]) -> list[Any]:
        """Return the rates of all coordinates, as `Formulas.acceleration` does."""
        return list(self.rates(t, x))


def _linear(slopes: Any, pushes: Sequence[Any], t: Any, period: Any) -> Linear | None:
    """The motion in closed form; None where its forcing is no sum of harmonics."""
    size = len(slopes)
    try:
        return Linear(
            mass=sympy.eye(size).tolist(),
            damping=[[-e for e in row] for row in slopes],
            stiffness=sympy.zeros(size, size).tolist(),
            force=lambda at: [e.xreplace({t: at}) for e in pushes],
            period=period,
        )
    except InputError:
        return None


def _function(whole: Sequence[Any], symbols: Sequence[Any]) -> Any:
    def force(t: Any, x: Sequence[Any], v: Sequence[Any]) -> list[Any]:
        given = dict(zip(symbols, [t, *x, *v], strict=True))
        return [sympy.sympify(e).xreplace(given) for e in whole]

    return force
