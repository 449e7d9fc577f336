"""Restitution: the state after an impact, and the flight that leaves with it.

The law is a system's `Formulas.reset`, or `Formulas.jump`; it is applied here and nowhere else.
Kernels of flights and of motions are written from what comes out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import sympy
from sympy import Expr

from ..errors import InputError, shown
from .guards import Guard, Mode, Row, orders_of
from .symbols import DT, PHASE, T0, own

T = TypeVar("T")


@dataclass(frozen=True)
class Departure:
    """The flight that leaves a guard at `PHASE` and has lasted for `DT`.

    Attributes
    ----------
    position, velocity : tuple
        After the impact.
    mean, end : tuple
        Mean velocities and end velocities.
    acceleration : tuple
        Accelerations at the end, by the equations of motion.
    by_state : tuple
        The same in the time `T0`, and positions and velocities as `state_symbols` names them.
    """

    position: tuple[Expr, ...]
    velocity: tuple[Expr, ...]
    mean: tuple[Expr, ...]
    end: tuple[Expr, ...]
    acceleration: tuple[Expr, ...]
    by_state: tuple[Expr, ...]

    @property
    def now(self) -> list[Expr]:
        """Positions at the end."""
        return [x + DT * u for x, u in zip(self.position, self.mean, strict=True)]


def along(row: Row, state: Sequence[Expr]) -> Expr:
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

    Raises
    ------
    InputError
        For a reset, a flight or an acceleration of another form than a system has to give.
    """
    size = len(position)
    before, after = (orders_of(modes, m, size) for m in (guard.modes[0], guard.next_mode))
    x, v = (
        [part for part, order in zip(state, before, strict=True) if order]
        for state in (position, velocity)
    )
    left = state_after(formulas, guard.name, x, v, where, (before, after))
    return departure(formulas, guard.next_mode, after, *left, where)


def on_symbols(where: str, stated: Callable[..., T], *given: Any) -> T:
    """Evaluate a formula that the author of a system wrote, on SymPy's symbols.

    Raises
    ------
    InputError
        Where it calls what knows numbers alone.
    """
    try:
        return stated(*given)
    except TypeError as error:
        found = f"it cannot be evaluated on symbols ({shown(str(error).splitlines()[0])})"
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
    """Return the flight from a state in a mode, in all coordinates of the system.

    Coordinates that the mode does not have are at rest at zero.

    Parameters
    ----------
    orders : sequence of int
        Of all coordinates in the mode; see `Mode.orders`.
    position, velocity : sequence
        Of the coordinates that it has; velocities of those of second order.
    """
    present = [order for order in orders if order]
    size, second = len(present), [i for i, order in enumerate(present) if order == 2]
    flight, acceleration = of_mode(formulas.flight, mode), of_mode(formulas.acceleration, mode)
    flown = on_symbols(f"{where}: flight", flight, PHASE, position, list(velocity), DT)
    if not isinstance(flown, Sequence) or len(flown) != 2:
        accepted = "give mean velocities and end velocities, a list each"
        raise InputError(f"{where}: flight", f"found {shown(flown)}", accepted)
    mean, end = (_listed(part, size, f"{where}: flight") for part in flown)
    now = [x + DT * u for x, u in zip(position, mean, strict=True)]

    def law(t: Expr, x: Sequence[Expr], v: Sequence[Expr]) -> tuple[Expr, ...]:
        here = f"{where}: acceleration"
        return _listed(on_symbols(here, acceleration, t, x, [v[i] for i in second]), size, here)

    x, v = state_symbols(size)
    laws = law(T0, x, v)
    by_state = _accelerations(laws, present, x, v)
    pushed = law(PHASE + DT, now, end)
    if len(second) < size:
        flying = dict(zip([T0, *x, *v], [PHASE + DT, *now, *end], strict=True))
        pushed = tuple(sympy.sympify(e).xreplace(flying) for e in by_state)
    begun = tuple(velocity)
    if len(second) < size:
        flying = dict(zip([T0, *x], [PHASE, *position], strict=True))
        flying |= {v[i]: speed for i, speed in zip(second, velocity, strict=True)}
        rates = [s if order == 2 else e for e, s, order in zip(laws, v, present, strict=True)]
        begun = tuple(sympy.sympify(e).xreplace(flying) for e in rates)
    parts = (tuple(position), begun, mean, end, pushed, by_state)
    return Departure(*(_in_all(part, orders) for part in parts))


def _accelerations(
    law: Sequence[Expr], orders: Sequence[int], x: Sequence[Expr], v: Sequence[Expr]
) -> tuple[Expr, ...]:
    """Accelerations from laws of second order and of first, whose rates of change they are."""
    rates = dict(zip(x, v, strict=True)) | {T0: sympy.S.One}
    rates |= {v[i]: law[i] for i, order in enumerate(orders) if order == 2}
    return tuple(
        e if order == 2 else sympy.Add(*(sympy.diff(e, s) * rate for s, rate in rates.items()))
        for e, order in zip(law, orders, strict=True)
    )


def _in_all(part: Sequence[Expr], orders: Sequence[int]) -> tuple[Expr, ...]:
    """One entry for each coordinate of the system, zero for those that a mode does not have."""
    own = iter(part)
    return tuple(next(own) if order else sympy.S.Zero for order in orders)


def state_symbols(size: int) -> tuple[list[Expr], list[Expr]]:
    """Return symbols of so many positions and velocities."""
    return [own(f"position{i}") for i in range(size)], [own(f"velocity{i}") for i in range(size)]


def of_mode(given: Any, mode: str) -> Any:
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
    """Return positions and velocities after an impact, those that are the state of the next mode.

    Parameters
    ----------
    orders : (before, after), optional
        Of all coordinates in both modes, where they are not all of second order.
    """
    before, after = orders or ((2,) * len(position),) * 2
    present = [order for order in after if order]
    sizes = len(present), present.count(2)
    if formulas.jump is not None:
        jumped = on_symbols(f"{where}: jump", formulas.jump, name, position, velocity)
        if not isinstance(jumped, Sequence) or len(jumped) != 2:
            accepted = "give positions and velocities, a list each"
            raise InputError(f"{where}: jump", f"found {shown(jumped)}", accepted)
        here = f"{where}: jump at {name!r}"
        return _listed(jumped[0], sizes[0], here), _listed(jumped[1], sizes[1], here)
    if tuple(before) != tuple(after):
        found = f"{name!r} leads to a mode of other coordinates"
        raise InputError(f"{where}: jump", found, "give positions and velocities after it")
    left: Sequence[Expr] = [v for v, order in zip(velocity, present, strict=True) if order == 2]
    if formulas.reset is not None:
        left = on_symbols(f"{where}: reset", formulas.reset, name, position, velocity)
    return position, _listed(left, sizes[1], f"{where}: reset")


def _listed(given: Any, size: int, where: str) -> tuple[Any, ...]:
    """One expression for each degree of freedom."""
    if not isinstance(given, Sequence) or len(given) != size:
        accepted = f"give a list with one entry for each degree of freedom: {size}"
        raise InputError(where, f"found {shown(given)}", accepted)
    return tuple(sympy.sympify(e) for e in given)
