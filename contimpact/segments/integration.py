"""Integration of flights by Taylor's method, in numbers of any precision, alone or side by side."""

from __future__ import annotations

import ast
import contextlib
import functools
import hashlib
import importlib.util
import math
import sys
import types
from collections.abc import Iterator, Sequence
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array
from ..errors import NotInstalledError
from ..models.expressions import FUNCTIONS
from ..storage import kept_object
from ..syntax import parse, parse_expression

# Flights that are integrated: :math:`\ddot x = f(t, x, \dot x)` by Taylor's method.
#
# A flight of duration D from (t_0, x_0, v_0) is written in the time s = (t - t_0)/D from 0 to 1,
# with the mean velocity u so far in the place of the position:
#
# .. math:: u' = v, \qquad v' = D\,f(t_0 + sD,\; x_0 + Du,\; v), \qquad u(0) = 0,\; v(0) = v_0 .
#
# u(1) is the mean velocity of the flight, which does not cancel however short it is, nor do its
# derivatives; there is nothing special about D = 0 or D < 0, and everything a flight depends on is
# a parameter of the equations or an initial velocity. Derivatives come from the variational
# equations, truncated series from those with respect to the series' small quantity.
#
# The integrator is heyoka (Biscani and Izzo, 2021), with its order and its steps chosen for errors
# at rounding. Compiled integrators are kept for the life of the process.
#
# Steps are chosen by the series' last coefficients. What is below rounding where a step begins has
# no part in these, however large it is later in the step: tanh(100 v) away from v = 0, exp(100 x)
# away from a wall, x^7 where x = 0. Where a field may have such parts, the force is compared with
# the polynomials at some places of each step, and a step on which they differ is halved.

SCALE = 2.0**100
"""Scale of the state: heyoka bounds errors relative to its largest component, or to 1 where that is
larger."""
MOST_STEPS = 200_000
"""Largest number of steps of a flight; c = 1e4 asks for some 1e4 over one period."""
SOME_STEPS = 10_000
"""Largest number of steps of a flight among many, whatever the others ask for."""
KEPT = 64
"""Flights that are kept: gaps, sizes and stability of an orbit ask for the same ones."""

UNIT = 2.0**-53
"""Unit of rounding."""
LOOKS = 8
"""Places in a step, at equal distances, the last of them its end, at which the force is compared
with the polynomials."""
CLOSE = 2.0**8
"""By how many units of rounding they may differ, as a part of the largest velocity."""
NEAR = 4.0
"""By how many times the tolerance of steps, where that is more."""
NOISE = 16.0
"""The same as a part of how much the force differs where its arguments do by `MOVED`."""
MOVED = 4.0
"""Units of rounding."""
SHORTEST_STEP = 2.0**-48
"""Shortest part of a flight that a step takes: where a motion runs away within a finite time, or
comes to where the law has no value, steps go down to where the state does not change. A force that
jumps is passed by longer ones."""


@dataclass
class StepBudget:
    """Steps of integration that flights may still take."""

    left: int


_budget: ContextVar[StepBudget | None] = ContextVar("budget", default=None)


@contextlib.contextmanager
def limited_steps(most: int) -> Iterator[StepBudget]:
    """Let flights take so many steps of integration in all, and no more than are left of those
    within which this is asked for; later ones raise StepLimitError."""
    budget = StepBudget(most := allowed_steps(most))
    token = _budget.set(budget)
    try:
        yield budget
    finally:
        _budget.reset(token)
        charge_steps(most - budget.left)


def allowed_steps(most: int) -> int:
    """Return how many steps a flight may ask for, which may take so many by itself."""
    budget = _budget.get()
    return most if budget is None else min(most, max(budget.left, 0))


def charge_steps(steps: int) -> None:
    """Take steps from the budget, if there is one."""
    budget = _budget.get()
    if budget is not None:
        budget.left -= steps


class StepLimitError(OverflowError):
    """A flight asks for too many steps."""


NONE_LEFT = "flights have taken all steps of integration that they may"
"""What the error says where a budget is used up."""


class Statement(NamedTuple):
    """A field, as its text states it."""

    parameters: tuple[str, ...]
    accelerations: tuple[str, ...]
    rates: tuple[str, ...] = ()
    """Of coordinates of first order, whose velocities differ from them by constants; empty for
    others."""

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


def text_of(
    parameters: Sequence[str], accelerations: Sequence[str], rates: Sequence[str] = ()
) -> str:
    """Return the text of a field, in which kernels hold it."""
    first = f" | {'; '.join(rates)}" * any(rates)
    return f"{' '.join(parameters)}: {'; '.join(accelerations)}{first}"


@functools.cache
def statement(field: str) -> Statement:
    """Return what a text states."""
    parameters, _, laws = field.partition(": ")
    accelerations, *rates = (tuple(part.split("; ")) for part in laws.split(" | "))
    return Statement(tuple(parameters.split()), accelerations, *rates)


LARGEST_DEGREE = 5
"""Degree of a polynomial up to which its part in the last two coefficients is seen: where x = v t
at first, x'' = -x^n has series with each (n + 1)st term, two of them of orders 19 and 20 only up to
that n."""


@functools.cache
def may_hide(field: str) -> bool:
    """Whether a field may have parts below rounding at one place and large nearby.

    Polynomials of low degree do not, nor do sines and cosines, which are flat nowhere, nor
    quotients: the part of a pole in far coefficients is its residue's, and so is its effect on what
    passes it. That of a root is not: sqrt(e**2 + x**2) is -x on one side and x on the other.
    """
    constants = "pi", *statement(field).parameters
    trees = map(parse_expression, statement(field).accelerations)
    return any(_degree(tree, constants) > LARGEST_DEGREE for tree in trees)


def _degree(node: ast.expr, constants: Sequence[str]) -> float:
    """How many factors of an expression may vanish, the time and the state among them; infinity
    with functions that may be flat."""

    def of(node: ast.expr) -> float:
        return _degree(node, constants)

    match node:
        case ast.Constant():
            return 0.0
        case ast.Name(id=name):
            return 0.0 if name in constants else 1.0
        case ast.UnaryOp(operand=operand):
            return of(operand)
        case ast.BinOp(left=left, op=ast.Add() | ast.Sub(), right=right):
            return max(of(left), of(right))
        case ast.BinOp(left=left, op=ast.Mult() | ast.Div(), right=right):
            return of(left) + of(right)
        case ast.BinOp(left=left, op=ast.Pow(), right=ast.Constant(value=int() as n)):
            return abs(n) * of(left)
        case ast.Call(func=ast.Name(id="square" | "cube" as name), args=[argument]):
            return (2 if name == "square" else 3) * of(argument)
        case ast.Call(func=ast.Name(id="sin" | "cos"), args=[argument]) if of(argument) <= 1.0:
            return of(argument)
    parts = [part for part in ast.iter_child_nodes(node) if isinstance(part, ast.expr)]
    if isinstance(node, ast.Call):
        parts = node.args
    return 0.0 if all(of(part) == 0.0 for part in parts) else math.inf


def require() -> None:
    """Raise `NotInstalledError` if the package that integrates is not there."""
    if importlib.util.find_spec("heyoka") is None:
        found = "its flights are integrated by the package heyoka, which is not installed"
        raise NotInstalledError("system", found, "pip install contimpact[ode]")


@functools.cache
def _heyoka() -> Any:
    """heyoka, without SymPy unless that is there already.

    It imports SymPy for a conversion that nobody asks for here, which takes longer than all else.
    """
    hidden = "sympy" not in sys.modules
    if hidden:
        sys.modules["sympy"] = None  # type: ignore[assignment]
    try:
        import heyoka
    finally:
        if hidden:
            del sys.modules["sympy"]
    return heyoka


def real_number(text: str, bits: int) -> Any:
    """Return a number of so many bits from its digits."""
    return _heyoka().real(text, bits)


class _Step(NamedTuple):
    """A step that an integrator has taken, of a flight from 0 to 1, or one in each of its lanes."""

    end: Any
    length: Any
    terms: Array
    """Coefficients of the series, shape (equations, order + 1)."""


class Integrator:
    """The flow of a field, compiled, with derivatives by some directions of `Statement.names`.

    It integrates series truncated at `degree` (0 for numbers) in numbers of `bits` (0 for doubles);
    errors of steps in doubles are about the `tolerance`.
    """

    def __init__(
        self,
        field: str,
        directions: tuple[str, ...],
        degree: int,
        bits: int,
        tolerance: float = UNIT,
    ) -> None:
        require()
        self.hy = hy = _heyoka()
        self.field, self.directions, self.degree, self.bits = field, directions, degree, bits
        self.stated, self._hides = statement(field), may_hide(field)
        numbers = map(str, (degree, bits, tolerance))
        identity = hy.__version__, type(self).__name__, field, *directions, *numbers
        self._unit = 2.0**-bits if bits else UNIT
        self._tolerance = self._unit if bits else tolerance
        keys, self._adaptive, self._force = kept_object(
            "integrator", (*identity, _own_text()), self._built
        )
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
        self._looks = np.array([self._number(i / LOOKS) for i in range(1, LOOKS + 1)])
        powers = self._looks ** self._orders[:, None]
        slopes = self._orders[1:, None].astype(powers.dtype) * powers[:-1]
        self._powers = np.hstack([powers, np.vstack([0 * powers[:1], slopes])])
        self._unit = 2.0**-bits if bits else UNIT
        outcome = hy.taylor_outcome
        self._arrived = outcome.time_limit
        self._going = {outcome.time_limit, outcome.success, outcome.step_limit}

    def _built(self) -> tuple[list[tuple[str, str, int]], Any, Any]:
        """What each equation is of, the integrator of the equations, and, if it is asked for, a
        function of the state for the rates of velocities."""
        system, keys = self._equations()
        d = self.stated.freedom
        state, rates = zip(*system[: 2 * d], strict=True)
        force = self.hy.cfunc(rates[d:], vars=state, **self._kind()) if self._hides else None
        if self.degree:
            system, keys = self._series(system, keys)
        return keys, self._compiled(system), force

    def _kind(self) -> dict[str, Any]:
        """The kind of numbers."""
        if not self.bits:
            return {}
        return {"fp_type": self.hy.real, "prec": self.bits, "compact_mode": True}

    def _manner(self, system: list[Any]) -> dict[str, Any]:
        """How many equations are compiled: their code in loops, unless they are few."""
        return {"compact_mode": len(system) > MOST_IN_LINE, **self._kind()}

    def _compiled(self, system: list[Any]) -> Any:
        rare = self.degree > 0 or self.bits > 0
        return self.hy.taylor_adaptive(system, opt_level=0 if rare else 1, **self._manner(system))

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
        forces = (_heyoka_expression(e, hy, now, self.bits) for e in stated.accelerations)
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
            system = _rename_variables(
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
        return _rename_variables(
            hy, whole, {str(e): _name(k) for (e, _), k in zip(whole, keys, strict=True)}
        ), keys

    # Integration.

    def __call__(
        self, numbers: Sequence[Any], longest: float = math.inf, most: int = MOST_STEPS
    ) -> list[Any]:
        """Return mean and end velocities, and then the same of their derivatives by each
        direction.

        The numbers are those of `Statement.names`; a step takes at most the part `longest` of the
        flight. Raises ArithmeticError if the flow ceases to be finite on the way, or asks for more
        than `most` steps.
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
        """Return the flow as polynomials, one for each step, whose ends are parts of the flight.

        The coefficients, of shape (steps, freedom, order + 1), are those of the mean velocities
        times the part of the flight, and of the velocities, by powers of the time since the step's
        start as a part of the step.
        """
        d, taken = self.stated.freedom, list[_Step]()
        self._given[:] = numbers[: self._used]
        self._begin(numbers[2 + d : 2 + 2 * d])
        self._propagate(kept=taken)
        ends, lengths, terms = (np.array(column) for column in zip(*taken, strict=True))
        terms = terms * lengths[:, None, None] ** self._orders / SCALE
        rows = self._rows[:, 0]
        return np.append(0.0, ends), terms[:, rows[:d]], terms[:, rows[d : 2 * d]]

    def _begin(self, speeds: Sequence[Any]) -> None:
        self._adaptive.time = self._number(0.0)
        self._state[:] = self._blank
        self._leave(self._state, speeds)

    def _leave(self, state: Array, speeds: Sequence[Any] | Array) -> None:
        """Fill in the velocities with which a flight leaves, where all else is zero."""
        for i, speed in enumerate(speeds):
            state[self._places[f"w{i}", "", 0]] = speed * self._scale
            place = self._places.get((f"w{i}", f"v{i}", 0))
            if place is not None:
                state[place] = self._scale

    def _propagate(
        self, longest: float = math.inf, most: int = MOST_STEPS, kept: list[_Step] | None = None
    ) -> None:
        """Take the steps of a flight, which are added to those `kept`."""
        most, width, self.steps = allowed_steps(most), longest, 0
        if not most:
            raise StepLimitError(NONE_LEFT)
        count, end, taken = AT_ONCE, self._number(1.0), list[_Step]()

        def take(adaptive: Any) -> bool:
            taken.append(_Step(adaptive.time, adaptive.last_h, adaptive.tc.copy()))
            return True

        watched = self._hides or kept is not None
        more: dict[str, Any] = {"callback": take, "write_tc": True} if watched else {}
        while self.steps < most:
            said, _, _, steps, *_ = self._adaptive.propagate_until(
                end,
                max_steps=min(count, most - self.steps),
                max_delta_t=self._number(width),
                **more,
            )
            self.steps += steps
            charge_steps(steps)
            sound = self._count_sound(taken)
            if kept is not None:
                kept += taken[:sound]
            if sound < len(taken):
                end_of_step, length, terms = taken[sound]
                self._adaptive.time, self._state[:] = end_of_step - length, terms[:, 0]
                width, count = 0.5 * float(length), 1
                going = width > SHORTEST_STEP
            elif said == self._arrived:
                return
            else:
                width, count = longest, AT_ONCE
                going = said in self._going and float(self._adaptive.last_h) >= SHORTEST_STEP
            if not going:
                raise OverflowError("a flight does not stay finite")
            taken.clear()
        raise StepLimitError(f"a flight asks for more than {most} steps of integration")

    def _count_sound(self, taken: Sequence[_Step]) -> int:
        """How many steps there are before one that misses a part of the force."""
        if not taken or not self._hides:
            return len(taken)
        ends, lengths, terms = map(np.array, zip(*taken, strict=True))
        missed = self._missed(ends, lengths, terms, self._given[:: self.degree + 1, None])
        return len(taken) if missed is None else int(np.argmax(missed))

    @np.errstate(over="ignore", invalid="ignore")
    def _missed(self, ends: Array, lengths: Array, terms: Array, given: Array) -> Array | None:
        """Which steps miss a part of the force; None if none does.

        Their series have the shape (steps, equations, order + 1), the numbers that are `given` the
        shape (numbers, 1 or steps). The force has to be as close to what the series say as errors
        at rounding let them be: `CLOSE` beside the velocities, or `NOISE` where the force itself is
        rounded by more.
        """
        d, largest = self.stated.freedom, np.abs(terms[:, :, 0]).max(axis=1)
        powers = np.vander(lengths, len(self._orders), increasing=True)
        terms = terms[:, self._rows[: 2 * d, 0]] * powers[:, None]
        found = terms @ self._powers
        largest = np.maximum(largest, np.abs(found).max(axis=(1, 2)))
        states, slopes = found[:, :, :LOOKS], found[:, d:, LOOKS:]
        states, slopes = states.transpose(1, 0, 2), slopes.transpose(1, 0, 2)
        times = (ends - lengths)[:, None] + lengths[:, None] * self._looks
        pars = np.empty((self._force.nparams, *times.shape), dtype=terms.dtype)
        pars[:] = given[: len(pars), :, None]
        pushes = self._forces(states, pars, times) * lengths[:, None]
        off = np.abs(pushes - slopes)
        close = (largest * self._number(max(CLOSE * self._unit, NEAR * self._tolerance)))[:, None]
        if (off <= close).all():
            return None
        more = self._number(1.0) + self._number(MOVED * self._unit)
        given = pars.copy()
        given[1 : 2 + d] *= more
        moved = np.concatenate([states[:d] * more, states[d:] / more])
        others = self._forces(states, given, times), self._forces(moved, pars, times * more)
        noise = sum(np.abs(other * lengths[:, None] - pushes) for other in others)
        missed: Array = ~(off <= close + noise * self._number(NOISE)).all(axis=(0, 2))
        return missed if missed.any() else None

    def _forces(self, states: Array, pars: Array, times: Array) -> Array:
        """The rates of velocities, shape (freedom, n, m); states have (2 * freedom, n, m)."""
        inputs, pars = (np.ascontiguousarray(e.reshape(len(e), -1)) for e in (states, pars))
        found: Array = self._force(inputs=inputs, pars=pars, time=times.ravel())
        return found.reshape(-1, *times.shape)

    def _number(self, value: Any) -> Any:
        return self.hy.real(value, self.bits) if self.bits else float(value)


MOST_IN_LINE = 20
"""Equations of which each gets code of its own. That takes seconds to compile for the variational
equations of two coordinates, ten times as long as in loops, and saves half of a flight's time."""

LARGEST_PRODUCT = 64
"""Largest whole power that is a product."""


@functools.cache
def _own_text() -> str:
    """Digest of this file, from which the equations are made."""
    return hashlib.sha256(Path(__file__).read_bytes()).hexdigest()


def _name(key: tuple[str, str, int]) -> str:
    return "_".join(map(str, key))


def _rename_variables(hy: Any, system: Sequence[Any], names: dict[str, str]) -> list[Any]:
    """A system whose variables have other names: those of variational ones are reserved."""
    flat = [e for pair in system for e in pair]
    renamed = hy.rename_variables(flat, names)
    return list(zip(renamed[::2], renamed[1::2], strict=True))


def _heyoka_expression(text: str, hy: Any, names: dict[str, Any], bits: int) -> Any:
    """An acceleration as heyoka's expression."""

    def number(value: float) -> Any:
        return hy.expression(hy.real(value, bits) if bits else float(value))

    def of_any(function: Any) -> Any:
        return lambda x: function(x if isinstance(x, hy.expression) else number(x))

    def ratio(above: int, below: int) -> Any:
        quotient = hy.real(above, bits) / hy.real(below, bits) if bits else above / below
        return hy.expression(quotient)

    functions = {name: of_any(getattr(hy, name)) for name in FUNCTIONS}

    def power(x: Any, y: Any) -> Any:
        """Whole powers as products: heyoka's series of others divide by x."""
        if not isinstance(y, int) or not 1 < abs(y) <= LARGEST_PRODUCT:
            return x**y
        half = power(x, abs(y) // 2)
        whole = half * half * x if y % 2 else half * half
        return whole if y > 0 else 1.0 / whole

    known = {"pi": hy.pi, "ratio": ratio, "power": power}
    known |= {"square": lambda x: x * x, "cube": lambda x: x * x * x}
    found = types.FunctionType(_code(text), {"__builtins__": {}, **functions, **known, **names})()
    return found if isinstance(found, hy.expression) else hy.expression(float(found))


class _Powers(ast.NodeTransformer):
    """Calls of ``power`` in the place of powers."""

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        self.generic_visit(node)
        if not isinstance(node.op, ast.Pow):
            return node
        return ast.Call(ast.Name("power", ast.Load()), [node.left, node.right], [])


def _code(text: str) -> types.CodeType:
    """The code of a function that returns what an expression says."""
    tree = _Powers().visit(parse(f"def force():\n return {text}"))
    module = compile(ast.fix_missing_locations(tree), "<field>", "exec")
    return next(c for c in module.co_consts if isinstance(c, types.CodeType))


@functools.cache
def integrator(
    field: str, directions: tuple[str, ...] = (), degree: int = 0, bits: int = 0
) -> Integrator:
    """Return the integrator of a field; it is compiled when it is first asked for."""
    return Integrator(field, directions, degree, bits)


# Many flights integrated side by side, as searches ask for them.


class BatchIntegrator(Integrator):
    """An `Integrator` compiled for as many flights as the processor computes at once."""

    def __init__(self, field: str, directions: tuple[str, ...], tolerance: float = UNIT) -> None:
        super().__init__(field, directions, 0, 0, tolerance)
        self.lanes = self._state.shape[1]

    def _compiled(self, system: list[Any]) -> Any:
        blank = np.zeros((len(system), self.hy.recommended_simd_size()))
        tolerance = {} if self._tolerance == UNIT else {"tol": self._tolerance}
        return self.hy.taylor_adaptive_batch(
            system, blank, opt_level=1, **tolerance, **self._manner(system)
        )

    def each(self, rows: Array) -> Array:
        """Return what an `Integrator` does for each row of the numbers of `Statement.names`.

        Where one flight ends, another takes its place, the longest first.
        """
        found = np.full((len(rows), len(self._rows)), np.nan)
        usable = np.flatnonzero(np.all(np.isfinite(rows), axis=1))
        waiting = usable[np.argsort(np.abs(rows[usable, 0]), kind="stable")].tolist()
        inside, steps, left = [-1] * self.lanes, [0] * self.lanes, MOST_STEPS
        times = np.zeros(self.lanes)
        self._given[:] = self._state[:] = 0.0  # lanes without a flight have one of no duration
        taken, owners, missed = list[_Step](), list[list[int]](), set[int]()

        def take(adaptive: Any) -> bool:
            taken.append(_Step(adaptive.time.copy(), adaptive.last_h.copy(), adaptive.tc.copy()))
            owners.append(inside.copy())
            return True

        more = {"callback": take, "write_tc": True} if self._hides else {}
        while most := allowed_steps(AT_ONCE):
            for lane in (k for k, row in enumerate(inside) if row < 0 and waiting):
                inside[lane], steps[lane] = waiting.pop(), 0
                self._put(lane, rows[inside[lane]])
            if max(inside) < 0:
                break
            self._adaptive.set_time(times)
            self._adaptive.propagate_until(1.0, max_steps=most, **more)
            if len(taken) > 2 * AT_ONCE:
                missed |= self._rows_missed(rows, owners, taken)
                owners.clear()
                taken.clear()
            times = self._adaptive.time.copy()
            for lane, (said, _, _, count) in enumerate(self._adaptive.propagate_res):
                charge_steps(count)
                steps[lane] += count
                stuck = self._adaptive.last_h[lane] < SHORTEST_STEP and times[lane] < 1.0
                lost = stuck or said not in self._going or steps[lane] > max(left, SOME_STEPS)
                if inside[lane] >= 0 and (lost or times[lane] == 1.0):
                    if lost:
                        left -= steps[lane]
                    else:
                        found[inside[lane]] = self._state[self._rows[:, 0], lane] / SCALE
                    inside[lane], self._given[:, lane], self._state[:, lane] = -1, 0.0, 0.0
                if inside[lane] < 0:
                    times[lane] = 0.0
        if again := sorted(missed | self._rows_missed(rows, owners, taken)):
            found[again] = integrator(self.field, self.directions).each(rows[again])
        return found

    def _rows_missed(
        self, rows: Array, owners: Sequence[Sequence[int]], taken: Sequence[_Step]
    ) -> set[int]:
        """The rows of which a flight, in the lanes of such steps, misses a part of the force."""
        if not taken:
            return set()
        ends, lengths, terms = (np.array(column) for column in zip(*taken, strict=True))
        lanes = np.array(owners)
        used = lanes >= 0
        owner, terms = lanes[used], np.moveaxis(terms, -1, 1)[used]
        missed = self._missed(ends[used], lengths[used], terms, rows[owner].T)
        return set() if missed is None else set(owner[missed].tolist())

    def _put(self, lane: int, row: Array) -> None:
        """Begin a flight in a lane."""
        d = self.stated.freedom
        self._given[:, lane] = row[: self._used]
        self._leave(self._state[:, lane], row[2 + d : 2 + 2 * d])


AT_ONCE = 64
"""Steps that flights take side by side before others take the places of those that have ended."""


@functools.cache
def batch_integrator(
    field: str, directions: tuple[str, ...] = (), tolerance: float = UNIT
) -> BatchIntegrator:
    """Return the integrator of many flights; it is compiled when it is first asked for."""
    return BatchIntegrator(field, directions, tolerance)
