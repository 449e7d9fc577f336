"""Hybrid systems that a scene states: laws of motion for each mode, and guards between the modes.

A state variable whose rate is another variable is a coordinate of second order with that for its
velocity; all others are coordinates of first order.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Self

from ..errors import InputError
from ..models.machine import TIME, StatedSystem
from ..models.model import Formulas, Geometry, Guard, Mode, Parameter, Wall
from ..models.stated_modes import (
    StatedGuard,
    StatedMode,
    StatedModes,
    check_masses,
    modes_of,
    usable_definitions,
)


class HybridSystem(StatedSystem):
    """Modes, guards and resets that a scene states: a hybrid system.

    The class of an instance has the parameters, modes and guards that its statement names.

    Parameters
    ----------
    machine : str
        As `contimpact.models.stated_modes.StatedModes.text`.
    **parameters : float
        A value for each parameter of it.
    """

    SYSTEM = "hybrid"
    machine: ClassVar[StatedModes]

    @classmethod
    def class_of(cls, text: str) -> type[Self]:
        """Return the class of a text; see `StatedSystem`."""
        return _class_of(text)  # type: ignore[return-value]

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The names of the coordinates, of the mode that has most."""
        return self.machine.coordinates

    def validate(self) -> None:
        """Refuse masses below zero."""
        check_masses(self.machine, self.values)

    def state_names(self, mode: str) -> list[tuple[str, str]]:
        """Return the names in the mode's laws."""
        stated, sections = self.machine.mode(mode), self.machine.sections
        speeds = stated.velocities(sections)
        return [(n, speeds.get(n, f"rate of {n}")) for n in stated.coordinates(sections)]

    @property
    def tori(self) -> bool:
        """Whether tori can be born on orbits."""
        return self.DEGREES_OF_FREEDOM > 1 or not self.autonomous

    def formulas(self, symbols: Mapping[str, Any]) -> Formulas:
        """Motion in each mode, in closed form where it is linear, and what guards change."""
        given = self.machine
        reader = _Reader(given, symbols)
        motions = {mode.name: reader.motion(mode) for mode in given.modes}
        guards = {guard.name: guard for guard in given.guards}
        return Formulas(
            period=reader.period,
            walls={n: reader.read(g.position, f"guards.{n}.within", {}) for n, g in guards.items()},
            jump=lambda name, x, v: reader.jump(guards[name], x, v),
            flight={name: motion.flight for name, motion in motions.items()},
            acceleration={name: motion.acceleration for name, motion in motions.items()},
            mass={mode.name: reader.mass(mode) for mode in given.modes} if given.mass else None,
        )


class _Reader:
    """The statement's expressions in symbols."""

    def __init__(self, given: StatedModes, symbols: Mapping[str, Any]) -> None:
        self.given, self.symbols = given, symbols
        self.period = self.read(given.period, "period", {})

    def read(self, text: str, where: str, names: Mapping[str, Any]) -> Any:
        from ..models.expressions import sympy_expression

        return sympy_expression(text, where, {**self.symbols, **names})

    def motion(self, mode: StatedMode) -> Any:
        from ..models.nonlinear import Motion

        speeds, coordinates = self._parts(mode)

        def laws(t: Any, x: Sequence[Any], v: Sequence[Any]) -> list[Any]:
            names = {**self._state(mode, x, v), TIME: t}
            names |= self._defined(mode, names)
            texts = dict(mode.laws)
            return [
                self.read(texts[speeds.get(name, name)], f"modes.{mode.name}", names)
                for name in coordinates
            ]

        orders = [2 if name in speeds else 1 for name in coordinates]
        return Motion(laws, orders, self.period)

    def mass(self, mode: StatedMode) -> list[list[Any]]:
        """The matrix of the kinetic energy in a mode, as large as that of the largest one."""
        texts = dict(self.given.mass)
        masses = [
            self.read(texts.get(name, "0"), f"mass.{name}", {})
            for name in mode.coordinates(self.given.sections)
        ]
        size = range(self.given.degrees_of_freedom)
        return [[masses[i] if i == j < len(masses) else 0 for j in size] for i in size]

    def _parts(self, mode: StatedMode) -> tuple[dict[str, str], tuple[str, ...]]:
        sections = self.given.sections
        return mode.velocities(sections), mode.coordinates(sections)

    def _state(self, mode: StatedMode, x: Sequence[Any], v: Sequence[Any]) -> dict[str, Any]:
        """The state variables, from positions and the velocities of second order."""
        speeds, coordinates = self._parts(mode)
        names = dict(zip(coordinates, x, strict=True))
        second = [speeds[name] for name in coordinates if name in speeds]
        return names | dict(zip(second, v, strict=True))

    def _defined(self, mode: StatedMode, names: Mapping[str, Any]) -> dict[str, Any]:
        """The definitions that can be evaluated on a state, and without the time at a guard."""
        texts, found = dict(self.given.definitions), dict[str, Any]()
        for name in usable_definitions(self.given, mode):
            known = {**names, **found}
            if _names_known(texts[name], {*known, *self.symbols}):
                found[name] = self.read(texts[name], f"define.{name}", known)
        return found

    def jump(
        self, guard: StatedGuard, x: Sequence[Any], v: Sequence[Any]
    ) -> tuple[list[Any], list[Any]]:
        """Positions, and velocities of second order, after a guard."""
        before, after = self.given.mode(guard.modes[0]), self.given.mode(guard.to)
        speeds, coordinates = self._parts(before)
        second = [s for s, name in zip(v, coordinates, strict=True) if name in speeds]
        names = self._state(before, x, second)
        known = names | self._defined(before, names)
        where = f"guards.{guard.name}.set"
        names |= {name: self.read(text, where, known) for name, text in guard.after}
        speeds, coordinates = self._parts(after)
        return [names[c] for c in coordinates], [
            names[speeds[c]] for c in coordinates if c in speeds
        ]


def _names_known(text: str, names: set[str]) -> bool:
    from ..models.expressions import CONSTANTS, FUNCTIONS, names_in

    return set(names_in(text)) <= {*names, *FUNCTIONS, *CONSTANTS}


@functools.cache
def _class_of(text: str) -> type[HybridSystem]:
    """Return the class of a hybrid system, by its text."""
    given = modes_of(text)
    size, modes = given.degrees_of_freedom, tuple(_mode(mode, given) for mode in given.modes)
    attributes = {
        "__doc__": HybridSystem.__doc__,
        "__module__": __name__,
        "PARAMETERS": tuple(Parameter(n, "", f"parameter {n}") for n in given.parameters),
        "MODES": modes,
        "WALLS": tuple(_guard(guard, size) for guard in given.guards),
        "DEGREES_OF_FREEDOM": size,
        "AUTONOMOUS": given.autonomous,
        "GEOMETRY": None if any(mode.first_order for mode in modes) else Geometry(),
        "OPTIONS": {"machine": text},
        "machine": given,
    }
    try:
        return type("HybridSystem", (HybridSystem,), attributes)
    except InputError as error:
        inside = next((i for i in ("guards", "modes") if i.upper() in error.where), "parameters")
        inside = "guards" if error.where.endswith("WALLS") else inside
        raise InputError(inside, error.found, error.accepted) from None


def _mode(mode: StatedMode, given: StatedModes) -> Mode:
    coordinates, speeds = mode.coordinates(given.sections), mode.velocities(given.sections)
    first = tuple(i for i, name in enumerate(coordinates) if name not in speeds)
    return Mode(mode.name, len(coordinates), first)


def _guard(guard: StatedGuard, size: int) -> Guard:
    row = guard.row + (0.0,) * (size - len(guard.row))
    if guard.modes == (guard.to,):
        return Wall(guard.name, guard.side, guard.modes[0], coordinate=row)
    return Guard(guard.name, guard.side, guard.modes, guard.to, row, guard.past)
