"""Restitution: the velocities after an impact, and the flight that leaves with them.

The law is a system's `Formulas.reset`; it is applied here and nowhere else. Kernels of flights and
of motions are written from what comes out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import sympy

from ..errors import InputError, shown
from .symbols import DT, PHASE

if TYPE_CHECKING:
    from .model import Formulas


@dataclass(frozen=True)
class Departure:
    """The flight that leaves a wall at `PHASE` and has lasted for `DT`.

    Attributes
    ----------
    position : tuple
        Start positions.
    velocity : tuple
        Velocities after the impact.
    mean, end : tuple
        Mean velocities and end velocities.
    acceleration : tuple
        Accelerations at the end, by the equations of motion.
    """

    position: tuple[Any, ...]
    velocity: tuple[Any, ...]
    mean: tuple[Any, ...]
    end: tuple[Any, ...]
    acceleration: tuple[Any, ...]

    @property
    def now(self) -> list[Any]:
        """Positions at the end."""
        return [x + DT * u for x, u in zip(self.position, self.mean, strict=True)]


def after_impact(
    formulas: Formulas, wall: str, position: Sequence[Any], velocity: Sequence[Any], where: str
) -> Departure:
    """Return what an impact at a wall leaves, from positions and velocities before it.

    Raises
    ------
    InputError
        For a reset, a flight or an acceleration of another form than a system has to give.
    """
    size = len(position)
    after = _listed(formulas.reset(wall, position, velocity), size, f"{where}: reset")
    flight = formulas.flight(PHASE, position, list(after), DT)
    if not isinstance(flight, Sequence) or len(flight) != 2:
        accepted = "give mean velocities and end velocities, a list each"
        raise InputError(f"{where}: flight", f"found {shown(flight)}", accepted)
    mean, end = (_listed(part, size, f"{where}: flight") for part in flight)
    now = [x + DT * u for x, u in zip(position, mean, strict=True)]
    pushed = formulas.acceleration(PHASE + DT, now, list(end))
    acceleration = _listed(pushed, size, f"{where}: acceleration")
    return Departure(tuple(position), after, mean, end, acceleration)


def _listed(given: Any, size: int, where: str) -> tuple[Any, ...]:
    """One expression for each degree of freedom."""
    if not isinstance(given, Sequence) or len(given) != size:
        accepted = f"give a list with one entry for each degree of freedom: {size}"
        raise InputError(where, f"found {shown(given)}", accepted)
    return tuple(sympy.sympify(e) for e in given)
