r"""Two vector fields on both sides of a surface, and sliding on it.

With h(x) = n.x - level, and the rates :math:`L_\pm = n\cdot f_\pm` at which each field moves h,
the motion slides where :math:`L_- > 0 > L_+`, by Filippov's convex combination

.. math:: f_s = \tfrac12(f_- + f_+) + \tfrac{u}{2}(f_+ - f_-), \qquad
          u = \frac{L_- + L_+}{L_- - L_+},

in which u is Utkin's equivalent control. One field is tangent to the surface at each of the limits
of sliding: f_- where u = -1 (P), f_+ where u = 1 (A). In the place of the coordinate that the
surface gives stands h on both sides of it, and u in sliding.

Importing this module imports SymPy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import sympy

from ..errors import InputError
from .guards import pivot
from .model import Formulas
from .nonlinear import Motion, state_symbols
from .switching import ABOVE, BELOW, SLIDING

Rates = Callable[[Any, Sequence[Any]], Sequence[Any]]


class Filippov:
    """The formulas of a system of `switching_modes` and `switching_guards`, from its period and the
    vector fields ``(t, x) -> [f_0, f_1, ...]`` where h < 0 and where h > 0, of that period in t.
    The surface, at `level`, has the factors `normal` of the coordinates.

    Raises InputError where the fields move h by rates whose difference vanishes or depends on the
    time.
    """

    def __init__(
        self, below: Rates, above: Rates, normal: Sequence[Any], level: Any, period: Any
    ) -> None:
        self.below, self.above = below, above
        self.normal, self.level, self.period = tuple(normal), level, period
        self.place = pivot(self.normal)
        t, *state = state_symbols(len(self.normal))
        apart = self._apart(t, state[: len(self.normal)])
        if apart == 0 or apart.has(t):
            found = f"the fields differ across it by {apart}"
            raise InputError("surface", found, "give fields that differ there, at all times alike")

    def formulas(self, **more: Any) -> Formulas:
        """Return the system's formulas; more of them, such as `derived`, are handed on."""
        flows = {BELOW: self._side(self.below), ABOVE: self._side(self.above)}
        flows[SLIDING] = self._flow(self._slide)
        return Formulas(
            period=self.period,
            walls={"S": 0, "P": -1, "A": 1, "B": 0, "C": 0, "D": 0},
            jump=self._jump,
            flight={mode: flow.flight for mode, flow in flows.items()},
            acceleration={mode: flow.acceleration for mode, flow in flows.items()},
            **more,
        )

    def _flow(self, rates: Rates) -> Motion:
        return Motion(lambda t, x, v: rates(t, x), (1,) * len(self.normal), self.period)

    def _side(self, field: Rates) -> Motion:
        def rates(t: Any, c: Sequence[Any]) -> list[Any]:
            found = list(field(t, self._state(c, c[self.place])))
            found[self.place] = self._across(found)
            return found

        return self._flow(rates)

    def _state(self, c: Sequence[Any], h: Any) -> list[Any]:
        """The system's own coordinates."""
        others = (
            n * x for i, (n, x) in enumerate(zip(self.normal, c, strict=True)) if i != self.place
        )
        own = (h + self.level - sympy.Add(*others)) / self.normal[self.place]
        return [own if i == self.place else x for i, x in enumerate(c)]

    def _across(self, rates: Sequence[Any]) -> Any:
        """The rate of h."""
        return sympy.Add(*(n * rate for n, rate in zip(self.normal, rates, strict=True)))

    def _apart(self, t: Any, c: Sequence[Any]) -> Any:
        """L_- - L_+ on the surface."""
        x = self._state(c, sympy.S.Zero)
        return sympy.cancel(self._across(self.below(t, x)) - self._across(self.above(t, x)))

    def _slide(self, t: Any, c: Sequence[Any]) -> list[Any]:
        given = dict(zip(self._symbols, [t, *c], strict=True))
        return [sympy.sympify(e).xreplace(given) for e in self._sliding]

    @cached_property
    def _symbols(self) -> list[Any]:
        t, *state = state_symbols(len(self.normal))
        return [t, *state[: len(self.normal)]]

    @cached_property
    def _sliding(self) -> list[Any]:
        """The rates of u and the other coordinates, in `_symbols`."""
        t, *c = self._symbols
        x = self._state(c, sympy.S.Zero)
        below, above = (list(map(sympy.sympify, f(t, x))) for f in (self.below, self.above))
        control = sympy.cancel((self._across(below) + self._across(above)) / self._apart(t, c))
        rates = [
            sympy.cancel((a + b + control * (b - a)) / 2) for a, b in zip(below, above, strict=True)
        ]
        moved = (sympy.diff(control, s) * rate for s, rate in zip(c, rates, strict=True))
        rates[self.place] = sympy.diff(control, t) + sympy.Add(*moved)
        return rates

    def _jump(self, guard: str, x: Sequence[Any], v: Sequence[Any]) -> tuple[list[Any], list[Any]]:
        """u where sliding begins, by the rate of h before; h = 0 on both sides."""
        after = list(x)
        after[self.place] = sympy.S.Zero
        if guard in "SB":
            side = -1 if guard == "S" else 1
            apart = self._apart(self._symbols[0], after)
            after[self.place] = side + 2 * v[self.place] / apart
        return after, []
