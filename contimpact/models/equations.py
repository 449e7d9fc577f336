"""The equations of a model, evaluated once on SymPy's symbols, impacts included.

Importing this module imports SymPy. Kernels are written from these equations and nothing else, so
that their digest identifies all that kernels depend on.
"""

from __future__ import annotations

import copy
import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import sympy
from sympy import Expr

from ..errors import InputError, count_text, short_repr
from .expressions import FUNCTIONS
from .guards import AMBIGUOUS, Guard, Mode, Row, orders_of, pivot, rival_guards, state_before
from .linear import Law
from .nonlinear import Field, accelerations_of
from .symbols import DT, INDICES, PHASE, T0, Double, HarmonicSum, exact, primed_symbol

# Restitution: the state after an impact, and the flight that leaves with it.
#
# The law is a system's `Formulas.reset`, or `Formulas.jump`; it is applied here and nowhere else.
# Kernels of flights and of motions are written from what comes out.

T = TypeVar("T")


@dataclass(frozen=True)
class Departure:
    """The flight that leaves a guard at `PHASE` and has lasted for `DT`."""

    position: tuple[Expr, ...]
    velocity: tuple[Expr, ...]
    """`position`, `velocity`: after the impact."""
    mean: tuple[Expr, ...]
    end: tuple[Expr, ...]
    """`mean`, `end`: mean velocities and end velocities."""
    acceleration: tuple[Expr, ...]
    """Accelerations at the end, by the equations of motion."""
    by_state: tuple[Expr, ...]
    """The same in the time `T0`, and positions and velocities as `state_symbols` names them."""
    rates: tuple[Expr, ...]
    """In these symbols, the velocities, which are laws of coordinates of first order."""

    @property
    def now(self) -> list[Expr]:
        """Positions at the end."""
        return [x + DT * u for x, u in zip(self.position, self.mean, strict=True)]


def combine_rows(row: Row, state: Sequence[Expr]) -> Expr:
    """Return a linear combination of positions or velocities."""
    return sum((c * part for c, part in zip(row, state, strict=True) if c), sympy.S.Zero)


def after_impact(
    formulas: Any,
    guard: Guard,
    position: Sequence[Expr],
    velocity: Sequence[Expr],
    modes: Sequence[Mode],
    where: str,
) -> Departure:
    """Return what an impact at a guard leaves, from positions and velocities before it.

    Formulas are given the coordinates that the mode before has, and state those of the next.

    Raises InputError for a reset, a flight or an acceleration of another form than a system has to
    give.
    """
    size = len(position)
    before, after = (orders_of(modes, m, size) for m in (guard.modes[0], guard.next_mode))
    x, v = (
        [part for part, order in zip(state, before, strict=True) if order]
        for state in (position, velocity)
    )
    left = state_after(formulas, guard.name, x, v, where, (before, after))
    return departure(formulas, guard.next_mode, after, *left, where)


def evaluate_on_symbols(where: str, stated: Callable[..., T], *given: Any) -> T:
    """Evaluate a formula that the author of a system wrote, on SymPy's symbols.

    Raises InputError where it calls what knows numbers alone.
    """
    try:
        return stated(*given)
    except TypeError as error:
        found = f"it cannot be evaluated on symbols ({short_repr(str(error).splitlines()[0])})"
        accepted = (
            "use SymPy's functions, such as sympy.cos, not those of math or numpy, and no "
            "conditions: what differs from place to place is a mode of its own"
        )
        raise InputError(where, found, accepted) from error


def departure(
    formulas: Any,
    mode: str,
    orders: Sequence[int],
    position: Sequence[Expr],
    velocity: Sequence[Expr],
    where: str,
) -> Departure:
    """Return the flight from a state in a mode, in all coordinates of the system; see
    `Mode.orders`.

    The state has positions of the mode's coordinates, and velocities of those of second order.
    Coordinates that the mode does not have are at rest at zero.
    """
    present = [order for order in orders if order]
    size, second = len(present), [i for i, order in enumerate(present) if order == 2]
    flight, acceleration = (
        mode_value(formulas.flight, mode),
        mode_value(formulas.acceleration, mode),
    )
    flown = evaluate_on_symbols(f"{where}: flight", flight, PHASE, position, list(velocity), DT)
    if not isinstance(flown, Sequence) or len(flown) != 2:
        accepted = "give mean velocities and end velocities, a list each"
        raise InputError(f"{where}: flight", f"found {short_repr(flown)}", accepted)
    mean, end = (_expression_list(part, size, f"{where}: flight") for part in flown)
    now = [x + DT * u for x, u in zip(position, mean, strict=True)]

    def law(t: Expr, x: Sequence[Expr], v: Sequence[Expr]) -> tuple[Expr, ...]:
        here = f"{where}: acceleration"
        return _expression_list(
            evaluate_on_symbols(here, acceleration, t, x, [v[i] for i in second]), size, here
        )

    x, v = state_symbols(size)
    laws = law(T0, x, v)
    by_state = accelerations_of(laws, present, T0, x, v)
    rates = tuple(s if order == 2 else e for e, s, order in zip(laws, v, present, strict=True))
    pushed = law(PHASE + DT, now, end)
    if len(second) < size:
        flying = dict(zip([T0, *x, *v], [PHASE + DT, *now, *end], strict=True))
        pushed = tuple(sympy.sympify(e).xreplace(flying) for e in by_state)
    begun = tuple(velocity)
    if len(second) < size:
        flying = dict(zip([T0, *x], [PHASE, *position], strict=True))
        flying |= {v[i]: speed for i, speed in zip(second, velocity, strict=True)}
        begun = tuple(sympy.sympify(e).xreplace(flying) for e in rates)
    parts = (tuple(position), begun, mean, end, pushed, by_state, rates)
    return Departure(*(_pad_coordinates(part, orders) for part in parts))


def _pad_coordinates(part: Sequence[Expr], orders: Sequence[int]) -> tuple[Expr, ...]:
    """One entry for each coordinate of the system, zero for those that a mode does not have."""
    own = iter(part)
    return tuple(next(own) if order else sympy.S.Zero for order in orders)


def state_symbols(size: int) -> tuple[list[Expr], list[Expr]]:
    """Return symbols of so many positions and velocities."""
    return [primed_symbol(f"position{i}") for i in range(size)], [
        primed_symbol(f"velocity{i}") for i in range(size)
    ]


def mode_value(given: Any, mode: str) -> Any:
    """Return what a system of one mode or of several states of one."""
    return given[mode] if isinstance(given, Mapping) else given


def state_after(
    formulas: Any,
    name: str,
    position: Sequence[Expr],
    velocity: Sequence[Expr],
    where: str,
    orders: tuple[Sequence[int], Sequence[int]] | None = None,
) -> tuple[Sequence[Expr], Sequence[Expr]]:
    """Return positions and velocities after an impact, those that are the state of the next mode;
    orders are those of all coordinates in both modes, where they are not all of second order."""
    before, after = orders or ((2,) * len(position),) * 2
    present = [order for order in after if order]
    sizes = len(present), present.count(2)
    if formulas.jump is not None:
        jumped = evaluate_on_symbols(f"{where}: jump", formulas.jump, name, position, velocity)
        if not isinstance(jumped, Sequence) or len(jumped) != 2:
            accepted = "give positions and velocities, a list each"
            raise InputError(f"{where}: jump", f"found {short_repr(jumped)}", accepted)
        here = f"{where}: jump at {name!r}"
        return _expression_list(jumped[0], sizes[0], here), _expression_list(
            jumped[1], sizes[1], here
        )
    if tuple(before) != tuple(after):
        found = f"{name!r} leads to a mode of other coordinates"
        raise InputError(f"{where}: jump", found, "give positions and velocities after it")
    left: Sequence[Expr] = [v for v, order in zip(velocity, present, strict=True) if order == 2]
    if formulas.reset is not None:
        left = evaluate_on_symbols(f"{where}: reset", formulas.reset, name, position, velocity)
    return position, _expression_list(left, sizes[1], f"{where}: reset")


def _expression_list(given: Any, size: int, where: str) -> tuple[Any, ...]:
    """One expression for each degree of freedom."""
    if not isinstance(given, Sequence) or len(given) != size:
        accepted = f"give a list with one entry for each degree of freedom: {size}"
        raise InputError(where, f"found {short_repr(given)}", accepted)
    return tuple(sympy.sympify(e) for e in given)


def _vanishes(e: Expr) -> bool:
    """Whether an expression is zero whatever its symbols are.

    Most are not, as their values at one place show: SymPy would simplify them first.
    """
    places = enumerate(sorted(e.free_symbols, key=str), 2)
    there = e.xreplace({symbol: sympy.sqrt(k) / (k + 1) for k, symbol in places}).evalf()
    if there.is_finite and (abs(there) > 1e-9) is sympy.true:
        return False
    return e == 0 or bool(e.equals(0))


ELEMENTARY = frozenset(
    (*FUNCTIONS, "Stumpff", "Transient", "MeanTransient", "MeanFlow", "EndFlow", "Flown")
)
"""Names of the functions that kernels can evaluate."""


@dataclass(frozen=True)
class Equations:
    """A model's formulas in its parameters, section coordinates, `PHASE` and `DT`."""

    parameters: Mapping[str, Any]
    start: tuple[Any, ...]
    end: tuple[Any, ...]
    """`start`, `end`: section coordinates before the impacts at which a flight starts and ends."""
    period: Any
    walls: Mapping[str, Any]
    derived: Mapping[str, Any]
    """`walls`, `derived`: in the model's order."""
    guards: Mapping[str, Guard]
    departures: Mapping[str, Departure]
    """Departures, by the guard that is left."""
    state: tuple[Any, ...]
    back: tuple[Any, ...]
    """`state`, `back`: positions and velocities in turn on the section t = 0, and when the flight
    is back there."""
    quiet: Departure
    """The flight from the section, in the first mode."""
    harmonics: tuple[Any, ...]
    """The mean and then k, a_k, b_k, where the acceleration depends on time alone; else NaN."""
    mass: Mapping[str, tuple[tuple[Any, ...], ...]] | None = None
    """The matrix of the kinetic energy by mode, where it is known."""

    def before(self, wall: str, section: Sequence[Any]) -> tuple[list[Any], list[Any]]:
        """Return positions and velocities before an impact, from its section coordinates."""
        return state_before(self.pivot(wall)[1], self.walls[wall], section)

    def pivot(self, wall: str) -> tuple[int, tuple[Any, ...]]:
        """Return the coordinate that a guard's surface gives, and the row of its gap coordinate."""
        row = tuple(map(exact, self.guards[wall].row((len(self.start) + 1) // 2)))
        return pivot(row), row

    def returns(self, a: str, b: str) -> bool:
        """Whether a flight ends on the surface it leaves."""
        _, row = self.pivot(a)
        left = combine_rows(row, self.departures[a].position)
        return self.pivot(b)[1] == row and sympy.expand(left - self.walls[b]) == 0

    def lands(self, a: str, b: str) -> bool:
        """Whether a touch of one guard, by its jump, leads onto the surface of another."""
        _, row = self.pivot(b)
        left = sympy.sympify(combine_rows(row, self.departures[a].position)).subs(self.start[0], 0)
        followed = self.guards[a].next_mode in self.guards[b].modes
        return followed and sympy.expand(left - self.walls[b]) == 0

    def begins(self, a: str, b: str) -> int:
        """Whether a flight begins on the surface of a guard of its mode, on a side that the
        impact's velocity does not tell: 1 where its rate does, 2 where that vanishes always,
        else 0.

        The velocity tells where the rate is that times a function of the parameters, as after
        `-r*v`.
        """
        _, row = self.pivot(b)
        left = self.departures[a]
        followed = self.guards[a].next_mode in self.guards[b].modes and not self.guards[a].past
        if not followed or sympy.expand(combine_rows(row, left.position) - self.walls[b]) != 0:
            return 0
        rate, speed = sympy.expand(combine_rows(row, left.velocity)), self.start[0]
        if _vanishes(rate):
            return 2
        factor = sympy.expand(rate.coeff(speed))
        told = sympy.expand(rate - factor * speed) == 0
        return int(not (told and factor.free_symbols <= set(self.parameters.values())))

    def bends(self, a: str, b: str) -> bool:
        """Whether an impact changes the rate of another gap coordinate, of a guard that the modes
        before and after it both have: it may be largest there, at a corner."""
        one, other = self.guards[a], self.guards[b]
        shared = {*one.modes} & {*other.modes} and one.next_mode in other.modes
        if not shared or one.coordinate == other.coordinate:
            return False
        ends = zip(self.departures[a].velocity, self.before(a, self.start)[1], strict=True)
        change = combine_rows(self.pivot(b)[1], [v - u for v, u in ends])
        return bool(sympy.expand(change) != 0)

    @cached_property
    def digest(self) -> str:
        """A digest of all formulas, in their order."""
        texts = (f"{what} {name}: {sympy.srepr(e)}" for what, name, e in self)
        return hashlib.sha256("\n".join(texts).encode()).hexdigest()

    def __iter__(self) -> Iterator[tuple[str, str, Any]]:
        """Every formula, and what it is called in an error, with the name it is of."""
        yield "period", "", self.period
        yield from (("walls", name, e) for name, e in self.walls.items())
        yield from (("derived", name, e) for name, e in self.derived.items())
        for wall, left in self.departures.items():
            yield from (("jump at", wall, e) for e in left.position)
            yield from (("reset at", wall, e) for e in left.velocity)
            yield from (("flight from", wall, e) for e in (*left.mean, *left.end))
            yield from (("acceleration after", wall, e) for e in left.acceleration)
        yield from (("flight", "", e) for e in (*self.quiet.mean, *self.quiet.end))
        yield from (("harmonics", "", e) for e in self.harmonics)
        matrices = (self.mass or {}).values()
        yield from (("mass", "", e) for matrix in matrices for row in matrix for e in row)


def equations_of(model: Any) -> Equations:
    """Return the model's formulas on symbols; all `replace` makes of a model share them.

    Raises InputError if `Model.formulas` contradicts the class, or says what kernels cannot
    evaluate.
    """
    if "equations" not in model.shared:
        found = _evaluate_formulas(model)
        for what, name, e in found:
            _check(e, _Reading(model, found, what, name))
        model.shared["equations"] = found
    return model.shared["equations"]


class _Unread(dict[str, float]):
    """Parameter values that a formula must not read: kernels serve all values."""

    def __init__(self, names: Sequence[str], where: str) -> None:
        super().__init__(dict.fromkeys(names))  # type: ignore[arg-type]
        self.where = where

    def __getitem__(self, name: str) -> float:
        accepted = "use the symbol that it is given: one kernel serves all values"
        raise InputError(self.where, f"it reads self.values[{name!r}]", accepted)

    def get(self, name: str, default: Any = None) -> Any:
        return self[name]

    def values(self) -> Any:
        return [self[name] for name in self]

    def items(self) -> Any:
        return [(name, self[name]) for name in self]


class _Symbols(dict[str, Any]):
    """The parameters' symbols by name; asked for another name, they say which there are."""

    def __init__(self, names: Sequence[str], where: str) -> None:
        super().__init__({name: sympy.Symbol(name, real=True) for name in names})
        self.where = where

    def __missing__(self, name: str) -> Any:
        accepted = f"its parameters are {', '.join(self)}"
        raise InputError(self.where, f"no parameter {short_repr(name)}", accepted)


def _evaluate_formulas(model: Any) -> Equations:
    where = f"{type(model).__name__}.formulas"
    view = copy.copy(model)
    view.values = _Unread(list(model.values), where)
    parameters = _Symbols(list(model.values), where)
    formulas = evaluate_on_symbols(where, view.formulas, parameters)
    if not hasattr(formulas, "flight"):
        raise InputError(where, f"it returns {short_repr(formulas)}", "return Formulas(...)")
    if formulas.jump is not None and formulas.reset is not None:
        accepted = "give jump alone: it states positions and velocities after an impact"
        raise InputError(f"{where}: reset", "found beside jump", accepted)
    _check_modes(formulas, [mode.name for mode in model.MODES], where)
    walls = _name_expressions(formulas.walls, model.letters, "WALLS", f"{where}: walls")
    size = model.DEGREES_OF_FREEDOM
    state = tuple(primed_symbol(f"{n}{i}_0") for i in range(size) for n in "xv")
    section = ["v"] if size == 1 else [n for i in range(size) for n in (f"x{i}_", f"v{i}_")][1:]
    found = Equations(
        parameters,
        tuple(primed_symbol(f"{n}0") for n in section),
        tuple(primed_symbol(f"{n}1") for n in section),
        sympy.sympify(formulas.period),
        walls,
        _name_expressions(formulas.derived, model.DERIVED, "DERIVED", f"{where}: derived"),
        {guard.name: guard for guard in model.WALLS},
        {},
        state,
        tuple(primed_symbol(f"{n}{i}_1") for i in range(size) for n in "xv"),
        _quiet_flight(formulas, model, state, where),
        _harmonics(formulas, f"{where}: harmonics"),
        _masses(formulas, model, f"{where}: mass"),
    )
    departures = {
        name: after_impact(formulas, guard, *found.before(name, found.start), model.MODES, where)
        for name, guard in found.guards.items()
    }
    found = Equations(**{**vars(found), "departures": departures})
    for one, other, factor in rival_guards(model.WALLS, size):
        if sympy.expand(walls[other.name] - exact(factor) * walls[one.name]) == 0:
            what = f"{other.name!r} is on the surface of {one.name!r}, in one mode and direction"
            raise InputError(f"{where}: walls", what, AMBIGUOUS)
    for name in () if model.MODES else walls:
        if not found.returns(name, name):
            what = f"an impact at {name!r} leaves its surface"
            raise InputError(f"{where}: jump", what, "declare MODES, and a Guard for it")
    return found


def _quiet_flight(formulas: Any, model: Any, state: Sequence[Any], where: str) -> Departure:
    """The flight from the section t = 0, in the first mode; velocities of first order follow."""
    mode = model.first_mode
    orders = orders_of(model.MODES, mode, model.DEGREES_OF_FREEDOM)
    speeds = [v for v, order in zip(state[1::2], orders, strict=True) if order == 2]
    places = [x for x, order in zip(state[::2], orders, strict=True) if order]
    return departure(formulas, mode, orders, places, speeds, where)


def _check_modes(formulas: Any, modes: Sequence[str], where: str) -> None:
    """Refuse motions that are not stated, or not for each mode."""
    accepted = f"give one for each mode: {', '.join(map(repr, modes))}"
    for name in ("flight", "acceleration"):
        given = getattr(formulas, name)
        if given is None:
            raise InputError(f"{where}: {name}", "missing", "give flight and acceleration")
        if modes and not (isinstance(given, Mapping) and set(given) == set(modes)):
            found = ", ".join(map(repr, given)) if isinstance(given, Mapping) else short_repr(given)
            raise InputError(f"{where}: {name}", f"found {found or 'none'}", accepted)
    if modes and formulas.harmonics is not None:
        accepted = "leave them out: they are used in systems of one mode"
        raise InputError(f"{where}: harmonics", f"{count_text(len(modes), 'mode')}", accepted)


def _name_expressions(
    given: Mapping[str, Any], names: Sequence[str], said: str, where: str
) -> dict[str, Any]:
    """Expressions in the order of the names that the class declares."""
    if set(given) != set(names):
        accepted = f"give those in {said}: {', '.join(map(repr, names)) or 'none'}"
        raise InputError(where, f"found {', '.join(map(repr, given)) or 'none'}", accepted)
    return {name: sympy.sympify(given[name]) for name in names}


def _harmonics(formulas: Any, where: str) -> tuple[Any, ...]:
    if formulas.harmonics is None:
        return (sympy.nan,)
    constant, series = formulas.harmonics
    orders = [term[0] for term in series]
    if not all(k == int(k) >= 1 for k in orders) or len(set(orders)) < len(orders):
        raise InputError(where, f"orders {short_repr(orders)}", "give different whole numbers >= 1")
    return (sympy.sympify(constant), *(sympy.sympify(n) for term in series for n in term))


def _masses(formulas: Any, model: Any, where: str) -> dict[str, Any] | None:
    """The matrix of the kinetic energy by mode; 1 for one coordinate where nothing is said."""
    size, given = model.DEGREES_OF_FREEDOM, formulas.mass
    if given is None and size > 1:
        return None
    modes = dict.fromkeys(m for g in model.WALLS for m in (*g.modes, g.next_mode))
    if isinstance(given, Mapping) and not set(modes) <= set(given):
        accepted = f"give one for each mode: {', '.join(map(repr, modes))}"
        raise InputError(where, f"found {', '.join(map(repr, given)) or 'none'}", accepted)
    found = [((sympy.S.One,),) if given is None else mode_value(given, mode) for mode in modes]
    return {mode: _mass(rows, size, where) for mode, rows in zip(modes, found, strict=True)}


def _mass(given: Any, size: int, where: str) -> tuple[tuple[Any, ...], ...]:
    """A symmetric matrix, from its rows."""
    rows = tuple(tuple(sympy.sympify(e) for e in row) for row in given)
    if [len(row) for row in rows] != [size] * size:
        accepted = f"give {size} rows of {size} entries"
        raise InputError(where, f"found rows of {short_repr([len(row) for row in rows])}", accepted)
    for i in range(size):
        for j in range(i):
            if sympy.simplify(rows[i][j] - rows[j][i]) != 0:
                pair = f"{short_repr(str(rows[i][j]))} and {short_repr(str(rows[j][i]))}"
                found = f"{pair} beyond the diagonal"
                raise InputError(where, found, "give a symmetric matrix")
    return rows


@dataclass(frozen=True)
class _Reading:
    """A formula that is checked: what it is called, and how its symbols are in messages."""

    model: Any
    found: Equations
    what: str
    name: str

    def refuse(self, part: Any) -> InputError:
        """The error for a part that kernels cannot evaluate."""
        where = self.model.place(self.what, self.name)
        said = short_repr(str(part.xreplace(self._names())))
        if self.model.STATED:
            said = "a division by zero" if part is sympy.zoo else said
            found = f"{said} arises in what is stated" + (f" at {self.name}" if self.name else "")
            accepted = (
                "use expressions that are real and smooth there, and a parameter for a position "
                "at which they are not"
            )
            return InputError(where, found, accepted)
        accepted = f"use the symbols given, numbers, pi, + - * / ** and {', '.join(FUNCTIONS)}"
        return InputError(where, f"found {said}", accepted)

    def _names(self) -> dict[Any, Any]:
        """The names that states have where the system is stated, by symbol."""
        model, found = self.model, self.found
        guard = found.guards.get(self.name)
        if guard is None:
            pairs = model.state_names(model.first_mode)
            by_symbol = dict(zip(found.state, (n for pair in pairs for n in pair), strict=False))
        else:
            pairs = model.state_names(guard.modes[0])
            place, _ = found.pivot(guard.name)
            others = [pair for i, pair in enumerate(pairs) if i != place]
            names = [pairs[place][1], *(n for pair in others for n in pair)]
            by_symbol = dict(zip(found.start, names, strict=False))
        by_symbol |= {PHASE: "t", DT: "dt"}
        return {symbol: sympy.Symbol(name) for symbol, name in by_symbol.items()}


def _check(e: Any, reading: _Reading, inside: Sequence[Any] = ()) -> None:
    """Refuse symbols, functions and numbers that kernels know nothing of."""
    found = reading.found
    known = {*found.parameters.values(), *found.start, *found.state, PHASE, DT, *INDICES, *inside}
    for part in sympy.preorder_traversal(e):
        if isinstance(part, HarmonicSum | sympy.Tuple):
            continue
        if part in known or part in (sympy.pi, sympy.E):
            continue
        if part.is_Rational or part.is_Float or isinstance(part, Double):
            continue
        if part.is_Add or part.is_Mul or part.is_Pow or part is sympy.nan:
            continue
        if isinstance(part, Field):
            for acceleration in part.accelerations:
                _check(acceleration, reading, part.state)
            continue
        if isinstance(part, Law):
            for number in part.numbers:
                _check(number, reading)
            continue
        if type(part).__name__ not in ELEMENTARY:
            raise reading.refuse(part)
