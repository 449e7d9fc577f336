r"""Flights that are integrated: :math:`\ddot x = f(t, x, \dot x)` by Taylor's method.

A flight of duration D from (t_0, x_0, v_0) is written in the time s = (t - t_0)/D from 0 to 1, with
the mean velocity u so far in the place of the position:

.. math:: u' = v, \qquad v' = D\,f(t_0 + sD,\; x_0 + Du,\; v), \qquad u(0) = 0,\; v(0) = v_0 .

u(1) is the mean velocity of the flight, which does not cancel however short it is, nor do its
derivatives; there is nothing special about D = 0 or D < 0, and everything a flight depends on is a
parameter of the equations or an initial velocity. Derivatives come from the variational equations,
truncated series from those with respect to the series' small quantity.

The integrator is heyoka (Biscani and Izzo, 2021), with its order and its steps chosen for errors
at rounding. Compiled integrators are kept for the life of the process.
"""

from __future__ import annotations

import functools
import importlib.util
import math
import types
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array
from ..errors import NotInstalledError
from ..models.expressions import FUNCTIONS

SCALE = 2.0**100
"""Of the state: heyoka bounds errors beside the largest of it, or beside 1 where that is larger."""
MOST_STEPS = 200_000
"""Of a flight; c = 1e4 asks for some 1e4 over one period."""
SOME_STEPS = 10_000
"""Of a flight among many, whatever the others ask for."""


class Statement(NamedTuple):
    """A field, as its text states it.

    Attributes
    ----------
    parameters : tuple of str
    accelerations : tuple of str
    """

    parameters: tuple[str, ...]
    accelerations: tuple[str, ...]

    @property
    def freedom(self) -> int:
        """Degrees of freedom."""
        return len(self.accelerations)

    @property
    def names(self) -> tuple[str, ...]:
        """What a flight depends on, in order."""
        places = range(self.freedom)
        state = *(f"x{i}" for i in places), *(f"v{i}" for i in places)
        return "dt", "t", *state, *self.parameters


def text_of(parameters: Sequence[str], accelerations: Sequence[str]) -> str:
    """Return the text of a field, in which kernels hold it."""
    return f"{' '.join(parameters)}: {'; '.join(accelerations)}"


@functools.cache
def statement(field: str) -> Statement:
    """Return what a text states."""
    parameters, _, accelerations = field.partition(":")
    return Statement(tuple(parameters.split()), tuple(accelerations.strip().split("; ")))


def require() -> None:
    """Raise `NotInstalledError` if the package that integrates is not there."""
    if importlib.util.find_spec("heyoka") is None:
        found = "its flights are integrated by the package heyoka, which is not installed"
        raise NotInstalledError("system", found, "pip install contimpact[ode]")


class Integrator:
    """The flow of a field, compiled.

    Parameters
    ----------
    field : str
    directions : tuple of str
        Of `Statement.names`: what derivatives are taken by.
    degree : int
        Of the truncated series that it integrates; 0 for numbers.
    bits : int
        Of the numbers; 0 for doubles.
    """

    def __init__(self, field: str, directions: tuple[str, ...], degree: int, bits: int) -> None:
        require()
        import heyoka as hy

        self.hy = hy
        self.stated, self.directions, self.degree = statement(field), directions, degree
        self.bits = bits
        system, keys = self._equations()
        if degree:
            system, keys = self._series(system, keys)
        self._adaptive = self._compiled(system)
        self._places = {key: i for i, key in enumerate(keys)}
        self._scale = self._number(SCALE)
        self._blank = [self._number(0.0)] * len(keys)
        self._state, self._given = self._adaptive.state, self._adaptive.pars
        self._used = len(self._given)
        d = self.stated.freedom
        self.wanted = [
            [
                [self._places[f"{letter}{i}", table, order] for order in range(degree + 1)]
                for letter in "uw"
                for i in range(d)
            ]
            for table in ("", *directions)
        ]
        self._rows = np.array(self.wanted).reshape(-1, degree + 1)
        self.steps = 0
        self._orders = np.arange(self._adaptive.order + 1.0)
        outcome = hy.taylor_outcome
        self._arrived, self._stepped = {outcome.time_limit}, {outcome.time_limit, outcome.success}

    def _compiled(self, system: list[Any]) -> Any:
        kind: dict[str, Any] = {}
        if self.bits:
            kind = {"fp_type": self.hy.real, "prec": self.bits, "compact_mode": True}
        rare = self.degree > 0 or self.bits > 0
        return self.hy.taylor_adaptive(system, opt_level=0 if rare else 1, **kind)

    # The equations.

    def _equations(self) -> tuple[list[Any], list[tuple[str, str, int]]]:
        """The equations and the variational ones, and what each of them is of."""
        hy, stated = self.hy, self.stated
        given = {name: hy.par[i] for i, name in enumerate(stated.names)}
        places = range(stated.freedom)
        means = hy.make_vars(*(f"u{i}" for i in places), *(f"w{i}" for i in places))
        names, dt = [str(e) for e in means], given["dt"]
        means, speeds = means[: stated.freedom], means[stated.freedom :]
        now = {**given, "t": given["t"] + dt * hy.time}
        for i in places:
            now[f"x{i}"] = given[f"x{i}"] + dt * (means[i] / SCALE)
            now[f"v{i}"] = speeds[i] / SCALE
        forces = (_evaluated(e, hy, now, self.bits) for e in stated.accelerations)
        pushes = [(w, SCALE * (dt * f)) for w, f in zip(speeds, forces, strict=True)]
        system = [*zip(means, speeds, strict=True), *pushes]
        keys = [(name, "", 0) for name in names]
        if self.directions:
            by = [given[name] for name in self.directions]
            whole = hy.var_ode_sys(system, args=by, order=1).sys
            known = {
                f"∂[({k}, 1)]{name}": (name, direction, 0)
                for k, direction in enumerate(self.directions)
                for name in names
            }
            keys += [known[str(e)] for e, _ in whole[len(names) :]]
            system = _renamed(
                hy, whole, {str(whole[i][0]): _name(keys[i]) for i in range(len(keys))}
            )
        return system, keys

    def _series(
        self, system: list[Any], keys: list[tuple[str, str, int]]
    ) -> tuple[list[Any], list[tuple[str, str, int]]]:
        """The same for parameters that are polynomials in a small quantity."""
        hy, size, names = self.hy, self.degree + 1, self.stated.names
        small = hy.par[size * len(names)]
        moved = {}
        for i in range(len(names)):
            value = hy.par[size * i + self.degree]
            for k in range(self.degree - 1, -1, -1):
                value = hy.par[size * i + k] + small * value
            moved[hy.par[i]] = value
        system = [(e, hy.subs(rate, moved)) for e, rate in system]
        whole = hy.var_ode_sys(system, args=[small], order=self.degree).sys
        known = {
            f"∂[(0, {order})]{e}": (key[0], key[1], order)
            for (e, _), key in zip(system, keys, strict=True)
            for order in range(1, size)
        }
        keys = keys + [known[str(e)] for e, _ in whole[len(keys) :]]
        return _renamed(
            hy, whole, {str(e): _name(k) for (e, _), k in zip(whole, keys, strict=True)}
        ), keys

    # Integration.

    def __call__(
        self, numbers: Sequence[Any], longest: float = math.inf, most: int = MOST_STEPS
    ) -> list[Any]:
        """Return mean and end velocities, and then the same of their derivatives by each direction.

        Parameters
        ----------
        numbers : sequence
            One for each of `Statement.names`.
        longest : float
            Part of the flight that a step may take.
        most : int
            How many steps it may ask for.

        Raises
        ------
        ArithmeticError
            If the flow ceases to be finite on the way, or asks for too many steps.
        """
        self._given[:] = numbers[: self._used]
        d = self.stated.freedom
        self._begin(numbers[2 + d : 2 + 2 * d])
        self._propagate(longest, most)
        found = self._state[self._rows[:, 0]]
        return [x / self._scale for x in found] if self.bits else (found / SCALE).tolist()

    def each(self, rows: Array) -> Array:
        """Return the same for each row of numbers; NaN where a call raises an error.

        Many flights that ask for too many steps share those of one among them.
        """
        found = np.full((len(rows), len(self._rows)), np.nan)
        left = MOST_STEPS
        for i, row in enumerate(rows.tolist()):
            self.steps = 0
            try:
                found[i] = self(row, most=max(left // 4, SOME_STEPS))
            except ArithmeticError:
                left -= self.steps
        return found

    def of_series(self, rows: Sequence[Sequence[Any]]) -> list[list[Any]]:
        """Return the same as coefficients, from coefficients; the first are those of order 0."""
        size, d = self.degree + 1, self.stated.freedom
        given = [self._number(c) for row in rows for c in row] + [self._number(0.0)]
        self._given[:] = given[: self._used]
        speeds = rows[2 + d : 2 + 2 * d]
        self._begin([row[0] for row in speeds])
        factors = [math.factorial(k) for k in range(size)]
        for i, row in enumerate(speeds):
            for k in range(1, size):
                place = self._places[f"w{i}", "", k]
                self._state[place] = self._scale * factors[k] * row[k]
        self._propagate()
        state = self._state if self.bits else self._state.tolist()
        return [
            [state[p] / (self._scale * n) for p, n in zip(row, factors, strict=True)]
            for row in self._rows.tolist()
        ]

    def dense(self, numbers: Sequence[float]) -> tuple[Array, Array, Array]:
        """Return the flow as polynomials, one for each step.

        Returns
        -------
        times : ndarray of shape (steps + 1,)
            Parts of the flight.
        means, speeds : ndarray of shape (steps, freedom, order + 1)
            Coefficients of the mean velocities times the part of the flight, and of the velocities,
            by powers of the time since the step's start as a part of the step.
        """
        d = self.stated.freedom
        self._given[:] = numbers[: self._used]
        self._begin(numbers[2 + d : 2 + 2 * d])
        times, found = [0.0], list[Array]()
        step, adaptive, terms = self._adaptive.step, self._adaptive, self._adaptive.tc
        while times[-1] < 1.0:  # continuous output would be compiled anew each time
            said, length = step(max_delta_t=1.0 - times[-1], write_tc=True)
            self._check(said, self._stepped, len(found))
            found.append(terms * (length**self._orders))
            times.append(adaptive.time)
        terms = np.array(found) / SCALE
        return np.array(times), terms[:, self._rows[:d, 0]], terms[:, self._rows[d : 2 * d, 0]]

    def _begin(self, speeds: Sequence[Any]) -> None:
        self._adaptive.time = self._number(0.0)
        state = self._state
        state[:] = self._blank
        for i, speed in enumerate(speeds):
            state[self._places[f"w{i}", "", 0]] = speed * self._scale
            place = self._places.get((f"w{i}", f"v{i}", 0))
            if place is not None:
                state[place] = self._scale

    def _propagate(self, longest: float = math.inf, most: int = MOST_STEPS) -> None:
        more = {"max_delta_t": longest} if longest < math.inf else {}
        said, _, _, self.steps, _, _ = self._adaptive.propagate_until(
            self._number(1.0), max_steps=most, **more
        )
        self._check(said, self._arrived, self.steps, most)

    def _check(self, said: Any, fine: Any, steps: int, most: int = MOST_STEPS) -> None:
        """Raise an error where integration has not come to its end."""
        if steps >= most:
            raise OverflowError(f"a flight asks for more than {most} steps of integration")
        if said not in fine:
            raise OverflowError("a flight does not stay finite")

    def _number(self, value: Any) -> Any:
        return self.hy.real(value, self.bits) if self.bits else float(value)


def _name(key: tuple[str, str, int]) -> str:
    return "_".join(map(str, key))


def _renamed(hy: Any, system: Sequence[Any], names: dict[str, str]) -> list[Any]:
    """A system whose variables have other names: those of variational ones are reserved."""
    flat = [e for pair in system for e in pair]
    renamed = hy.rename_variables(flat, names)
    return list(zip(renamed[::2], renamed[1::2], strict=True))


def _evaluated(text: str, hy: Any, names: dict[str, Any], bits: int) -> Any:
    """An acceleration as heyoka's expression."""

    def number(value: float) -> Any:
        return hy.expression(hy.real(value, bits) if bits else float(value))

    def of_any(function: Any) -> Any:
        return lambda x: function(x if isinstance(x, hy.expression) else number(x))

    def ratio(above: int, below: int) -> Any:
        quotient = hy.real(above, bits) / hy.real(below, bits) if bits else above / below
        return hy.expression(quotient)

    functions = {name: of_any(getattr(hy, name)) for name in FUNCTIONS}

    known = {"pi": hy.pi, "ratio": ratio, "power": lambda x, y: x**y}
    known |= {"square": lambda x: x * x, "cube": lambda x: x * x * x}
    found = types.FunctionType(_code(text), {"__builtins__": {}, **functions, **known, **names})()
    return found if isinstance(found, hy.expression) else hy.expression(float(found))


def _code(text: str) -> types.CodeType:
    """The code of a function that returns what an expression says."""
    module = compile(f"def force():\n return {text}", "<field>", "exec")
    return next(c for c in module.co_consts if isinstance(c, types.CodeType))


@functools.cache
def integrator(
    field: str, directions: tuple[str, ...] = (), degree: int = 0, bits: int = 0
) -> Integrator:
    """Return the integrator of a field; it is compiled when it is first asked for."""
    return Integrator(field, directions, degree, bits)
