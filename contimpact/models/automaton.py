"""Whether the modes and guards of a system's class fit together, checked when it is defined."""

from __future__ import annotations

import math
import numbers
from collections.abc import Iterable
from typing import Any

from ..errors import InputError, shown
from .guards import Guard, Wall, orders_of, slides_at


def check_modes(kind: Any, where: str) -> None:
    """Check `DEGREES_OF_FREEDOM`, `MODES` and `WALLS` of a system's class.

    Raises
    ------
    InputError
        Naming the attribute.
    """
    size = kind.DEGREES_OF_FREEDOM
    if not _is_count(size):
        found = f"found {shown(size)}"
        raise InputError(f"{where}.DEGREES_OF_FREEDOM", found, "give a whole number >= 1")
    modes = _modes(kind.MODES, size, f"{where}.MODES")
    if not hasattr(kind, "WALLS"):
        return
    place = f"{where}.WALLS"
    require_all(kind.WALLS, ("name", "side", "modes", "coordinate"), place, "Wall or Guard")
    for guard in kind.WALLS:
        _check_letter(guard, place)
        _check_graph(guard, modes, place)
        _check_coordinate(guard, size, place)
        _check_sizes(guard, kind.MODES, size, place)
        _check_crossing(guard, kind.WALLS, place)
    names = [guard.name for guard in kind.WALLS]
    if not names or len(set(names)) < len(names):
        accepted = "give at least one wall, each name once"
        raise InputError(place, f"found {shown(names)}", accepted)
    for mode in modes:
        _check_passage(mode, mode == modes[0], kind.WALLS, place)


def _modes(modes: Any, size: int, where: str) -> list[str]:
    """The names of the modes; one without a name where none are declared."""
    require_all(modes, ("name", "degrees_of_freedom"), where, "Mode")
    names = [mode.name for mode in modes]
    if not all(isinstance(name, str) and name for name in names) or len({*names}) < len(names):
        raise InputError(where, f"found {shown(names)}", "give each mode a name of its own")
    for mode in modes:
        own = size if mode.degrees_of_freedom is None else mode.degrees_of_freedom
        if not _is_count(own):
            raise InputError(
                where, f"mode {mode.name!r} has {shown(own)}", "give a whole number >= 1"
            )
        if own > size:
            found = f"mode {mode.name!r} has {own} degrees of freedom, the system {size}"
            raise InputError(where, found, "declare DEGREES_OF_FREEDOM those of the largest mode")
        first = getattr(mode, "first_order", ())
        if not isinstance(first, tuple) or not set(first) <= set(range(own)):
            found = f"mode {mode.name!r} has the coordinates of first order {shown(first)}"
            raise InputError(where, found, f"give a tuple of numbers from 0 to {own - 1}")
    return names or [""]


def _check_letter(guard: Guard, where: str) -> None:
    if not (isinstance(guard.name, str) and len(guard.name) == 1 and guard.name.isalpha()):
        accepted = "give a single letter: words are written in them"
        raise InputError(where, f"a wall is called {shown(guard.name)}", accepted)
    if guard.side not in (1, -1):
        accepted = "give +1 where the body stays below the wall, -1 where it stays above"
        raise InputError(where, f"wall {guard.name!r} has side {shown(guard.side)}", accepted)


def _check_graph(guard: Guard, modes: list[str], where: str) -> None:
    """The modes that a guard ends and the one it leads to."""
    known = "declare modes in MODES" if modes == [""] else f"the modes are {', '.join(modes)}"
    for name in (*guard.modes, guard.next_mode):
        if name not in modes:
            raise InputError(where, f"{guard.name!r} has the mode {shown(name)}", known)
    if isinstance(guard, Wall) and not guard.rigid:
        found = f"wall {guard.name!r} leads from {shown(guard.mode)} to {guard.next_mode!r}"
        accepted = "give a Guard, or a wall for each mode: a Wall leads back to the mode it ends"
        raise InputError(where, found, accepted)
    if guard.to is None and len(guard.modes) != 1:
        found = f"{guard.name!r} ends {len(guard.modes)} modes"
        raise InputError(where, found, "say which mode it leads to")


def _check_coordinate(guard: Guard, size: int, where: str) -> None:
    given: Any = guard.coordinate
    found = f"{guard.name!r} has the coordinate {shown(given)}"
    if isinstance(given, int) and not isinstance(given, bool):
        if not 0 <= given < size:
            raise InputError(where, found, f"give a number from 0 to {size - 1}")
        return
    numeric = isinstance(given, tuple) and all(
        isinstance(c, numbers.Real) and math.isfinite(c) for c in given
    )
    if not numeric or len(given) != size or not any(given):
        accepted = f"give the number of a position, or {size} coefficients, not all zero"
        raise InputError(where, found, accepted)


def _check_sizes(guard: Guard, modes: Any, size: int, where: str) -> None:
    """The modes that a guard ends have the same state, and its gap coordinate in it."""
    ended = {orders_of(modes, name, size) for name in guard.modes}
    if len(ended) > 1:
        found = f"{guard.name!r} ends modes of different coordinates"
        raise InputError(where, found, "give a guard for each of them")
    (orders,) = ended
    row = guard.row(size)
    if any(factor and not order for factor, order in zip(row, orders, strict=True)):
        found = (
            f"{guard.name!r} lies on a coordinate that the mode {guard.modes[0]!r} does not have"
        )
        raise InputError(where, found, "give one of its own")


def _check_crossing(guard: Guard, guards: Iterable[Guard], where: str) -> None:
    """Where it leads through a surface, another guard leads to sliding."""
    past = getattr(guard, "past", "")
    if past and slides_at(tuple(guards), guard) is None:
        found = f"{guard.name!r} leads on past {shown(past)}"
        accepted = "give a guard on the same surface, and name one that ends the mode it leads to"
        raise InputError(where, found, accepted)


def _check_passage(mode: str, first: bool, guards: Iterable[Guard], where: str) -> None:
    """Every mode is reached and left; in the first one the system may begin."""
    if not any(mode in guard.modes for guard in guards):
        raise InputError(where, f"mode {mode!r} is ended by no guard", "give it a guard")
    if not first and not any(mode == guard.next_mode for guard in guards):
        raise InputError(where, f"mode {mode!r} is reached by no guard", "lead a guard to it")


def _is_count(number: Any) -> bool:
    return isinstance(number, int) and not isinstance(number, bool) and number >= 1


def require_all(given: Any, attributes: Iterable[str], where: str, kind: str) -> None:
    try:
        fits = all(hasattr(item, name) for item in given for name in attributes)
    except TypeError:
        fits = False
    if not fits:
        raise InputError(where, f"found {shown(given)}", f"give a tuple of {kind}")
