"""Restitution: the state after an impact, and the flight that leaves with it.

The law is a system's `Formulas.reset`, or `Formulas.jump`; it is applied here and nowhere else.
Kernels of flights and of motions are written from what comes out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import sympy

from ..errors import InputError, shown
from .guards import Guard, Row
from .symbols import DT, PHASE, T0, own

if TYPE_CHECKING:
    from .model import Formulas


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

    position: tuple[Any, ...]
    velocity: tuple[Any, ...]
    mean: tuple[Any, ...]
    end: tuple[Any, ...]
    acceleration: tuple[Any, ...]
    by_state: tuple[Any, ...]

    @property
    def now(self) -> list[Any]:
        """Positions at the end."""
        return [x + DT * u for x, u in zip(self.position, self.mean, strict=True)]


def along(row: Row, state: Sequence[Any]) -> Any:
    """Return a linear combination of positions or velocities."""
    return sum((c * part for c, part in zip(row, state, strict=True) if c), sympy.S.Zero)


def after_impact(
    formulas: Formulas, guard: Guard, position: Sequence[Any], velocity: Sequence[Any], where: str
) -> Departure:
    """Return what an impact at a guard leaves, from positions and velocities before it.

    Raises
    ------
    InputError
        For a reset, a flight or an acceleration of another form than a system has to give.
    """
    position, after = state_after(formulas, guard.name, position, velocity, where)
    return departure(formulas, guard.next_mode, position, after, where)


def departure(
    formulas: Formulas, mode: str, position: Sequence[Any], velocity: Sequence[Any], where: str
) -> Departure:
    """Return the flight from a state in a mode."""
    size = len(position)
    flown = of_mode(formulas.flight, mode)(PHASE, position, list(velocity), DT)
    if not isinstance(flown, Sequence) or len(flown) != 2:
        accepted = "give mean velocities and end velocities, a list each"
        raise InputError(f"{where}: flight", f"found {shown(flown)}", accepted)
    mean, end = (_listed(part, size, f"{where}: flight") for part in flown)
    now = [x + DT * u for x, u in zip(position, mean, strict=True)]
    law = of_mode(formulas.acceleration, mode)
    states = (PHASE + DT, now, list(end)), (T0, *state_symbols(size))
    pushed = (_listed(law(*state), size, f"{where}: acceleration") for state in states)
    return Departure(tuple(position), tuple(velocity), mean, end, *pushed)


def state_symbols(size: int) -> tuple[list[Any], list[Any]]:
    """Return symbols of so many positions and velocities."""
    return [own(f"position{i}") for i in range(size)], [own(f"velocity{i}") for i in range(size)]


def of_mode(given: Any, mode: str) -> Any:
    """Return what a system of one mode or of several states of one."""
    return given[mode] if isinstance(given, Mapping) else given


def state_after(
    formulas: Formulas, name: str, position: Sequence[Any], velocity: Sequence[Any], where: str
) -> tuple[Sequence[Any], Sequence[Any]]:
    """Return positions and velocities after an impact."""
    size = len(position)
    if formulas.jump is not None:
        jumped = formulas.jump(name, position, velocity)
        if not isinstance(jumped, Sequence) or len(jumped) != 2:
            accepted = "give positions and velocities, a list each"
            raise InputError(f"{where}: jump", f"found {shown(jumped)}", accepted)
        return tuple(_listed(part, size, f"{where}: jump") for part in jumped)  # type: ignore[return-value]
    if formulas.reset is None:
        return position, _listed(velocity, size, where)
    return position, _listed(formulas.reset(name, position, velocity), size, f"{where}: reset")


def _listed(given: Any, size: int, where: str) -> tuple[Any, ...]:
    """One expression for each degree of freedom."""
    if not isinstance(given, Sequence) or len(given) != size:
        accepted = f"give a list with one entry for each degree of freedom: {size}"
        raise InputError(where, f"found {shown(given)}", accepted)
    return tuple(sympy.sympify(e) for e in given)
