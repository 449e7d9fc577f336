r"""Systems that a scene states: linear machines, and hybrid systems of several modes.

A linear machine moves by :math:`M\ddot x + C\dot x + Kx = f(t)` within guards. An impact at a guard
with the gap coordinate :math:`n \cdot x` changes the velocities by an impulse along n, such that
the gap coordinate's velocity is multiplied by -r; impacts between bodies thus keep their momentum:

.. math:: v^+ = v - (1 + r)\frac{n \cdot v}{n \cdot M^{-1} n}\,M^{-1} n .

A hybrid system has laws of motion for each mode, and guards between the modes. A state variable
whose rate is another variable is a coordinate of second order with that for its velocity; all
others are coordinates of first order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from ..errors import InputError
from ..models.expressions import CONSTANTS, FUNCTIONS, names_in
from ..models.machine import TIME, Machine, StatedGuard, StatedSystem, check_values, statement_of
from ..models.model import Example, Formulas, Geometry, Guard, Mode, Parameter, Symmetry, Wall
from ..models.stated_modes import StatedGuard as ModeGuard
from ..models.stated_modes import (
    StatedMode,
    StatedModes,
    check_guard_images,
    guard_images,
    symmetric_shift,
    usable_definitions,
)
from ..models.stated_modes import check_values as check_values_of_laws

_LINEAR = """\
coordinates = ["x1", "x2"]           # M x'' + C x' + K x = f(t)
mass        = ["m1", "m2"]           # matrices: a list of rows, or of the diagonal
damping     = [["c", "-c"], ["-c", "c"]]
stiffness   = [["k1 + k2", "-k2"], ["-k2", "k2"]]
force       = ["a*cos(omega*t)", 0]  # expressions of t and the parameters
period      = "2*pi/omega"           # of the forcing

[model.guards]                       # rigid stops and impacts between bodies; a letter each
A = { within = "x1 <= sigma", restitution = "r" }
K = { within = "x2 - x1 <= gap", restitution = "r" }
"""


class LinearMachine(StatedSystem):
    """Matrices, forces and guards that a scene states: a linear machine.

    The class of an instance has the parameters and guards that its statement names.

    Parameters
    ----------
    machine : str
        As `contimpact.models.machine.Machine.text`.
    **parameters : float
        A value for each parameter of it.
    """

    SYSTEM = "linear"
    machine: ClassVar[Machine]
    EXAMPLE = Example(
        {"m1": 1.0, "m2": 0.5, "c": 0.1, "k1": 1.0, "k2": 0.6, "a": 1.0, "omega": 1.5}
        | {"sigma": 1.0, "gap": 0.8, "r": 0.7},
        ("omega", 1.2, 1.8),
        ["A", "K"],
        ("gap", 0.5, 1.2),
        _LINEAR,
    )

    @classmethod
    def attributes_of(cls, text: str) -> dict[str, Any]:
        """Return the attributes of the class of a text."""
        machine = statement_of(Machine, text)
        restitutions = {g.restitution.strip() for g in machine.guards}
        bounds = {n: (None, 0.0, 1.0) if n in restitutions else () for n in machine.parameters}
        return {
            "PARAMETERS": tuple(Parameter(n, "", f"parameter {n}", *b) for n, b in bounds.items()),
            "WALLS": tuple(Wall(g.name, g.side, coordinate=g.row) for g in machine.guards),
            "DEGREES_OF_FREEDOM": len(machine.coordinates),
            "machine": machine,
        }

    def validate(self) -> None:
        """Refuse masses, restitutions and periods that no machine has."""
        check_values(self.machine, self.values)

    def state_names(self, mode: str) -> list[tuple[str, str]]:
        """Return the coordinates' names."""
        return [(name, f"rate of {name}") for name in self.machine.coordinates]

    def formulas(self, symbols: Mapping[str, Any]) -> Formulas:
        """Linear flights, and impulses along the guards."""
        import sympy

        from ..models.expressions import sympy_expression
        from ..models.linear import Linear
        from ..models.symbols import exact

        stated = self.machine

        def read(text: str, where: str, more: Mapping[str, Any] | None = None) -> Any:
            return sympy_expression(text, where, {**symbols, **(more or {})})

        def matrix(name: str) -> list[list[Any]]:
            rows = enumerate(getattr(stated, name))
            return [[read(e, f"{name}[{i}][{j}]") for j, e in enumerate(row)] for i, row in rows]

        matrices = {name: matrix(name) for name in ("mass", "damping", "stiffness")}
        try:
            motion = Linear(
                **matrices,
                force=lambda t: [
                    read(e, f"force[{i}]", {TIME: t}) for i, e in enumerate(stated.force)
                ],
                period=read(stated.period, "period"),
            )
        except InputError as error:
            raise error.within("model") from None
        guards = {guard.name: guard for guard in stated.guards}

        def reset(wall: str, x: Sequence[Any], v: Sequence[Any]) -> list[Any]:
            guard = guards[wall]
            row = sympy.Matrix([exact(c) for c in guard.row])
            pushed = motion.inverse * row
            speed = row.dot(sympy.Matrix(list(v)))
            restitution = read(guard.restitution, f"guards.{wall}.restitution")
            impulse = sympy.cancel(1 / row.dot(pushed)) * (1 + restitution) * speed
            after = (
                _hit(guard, i, one, restitution) or one - sympy.cancel(part) * impulse
                for i, (one, part) in enumerate(zip(v, pushed, strict=True))
            )
            return list(after)

        return Formulas(
            period=motion.period,
            walls={name: read(g.position, f"guards.{name}.within") for name, g in guards.items()},
            reset=reset,
            flight=motion.flight,
            acceleration=motion.acceleration,
            mass=matrices["mass"] if sympy.Matrix(matrices["mass"]).is_symmetric() else None,
        )


def _hit(guard: StatedGuard, i: int, velocity: Any, restitution: Any) -> Any:
    """The velocity after impact of a coordinate that is the gap coordinate."""
    alone = [c for c in guard.row if c] == [guard.row[i]]
    return -restitution * velocity if alone else None


_HYBRID = """\
period = "2*pi/omega"                # of the forcing

[model.define]                       # names for expressions in laws and resets
force = "a*cos(omega*t) - c*v - k*x"

[model.modes.free]                   # rates of the state; a rate that is a variable is its velocity
x = "v"
v = "force"

[model.modes.contact]                # other laws hold while the spring behind x = e is touched
x = "v"
v = "force - k_b*(x - e)"

[model.guards.C]                     # where a mode ends, and which one follows
mode   = "free"
within = "x <= e"
to     = "contact"

[model.guards.R]
mode   = "contact"
within = "x >= e"
to     = "free"

[model.guards.S]                     # a rigid stop: the mode goes on, and the velocity jumps
mode   = "contact"
within = "x <= sigma"
set    = { v = "-r*v" }
"""


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
    EXAMPLE = Example(
        {"a": 1.0, "omega": 1.5, "c": 0.1, "k": 1.0, "e": 0.5, "k_b": 20.0, "sigma": 0.7, "r": 0.7},
        ("omega", 0.6, 2.0),
        ["0", "CR", "CSR"],
        ("sigma", 0.6, 0.9),
        _HYBRID,
    )

    @classmethod
    def attributes_of(cls, text: str) -> dict[str, Any]:
        """Return the attributes of the class of a text."""
        given = statement_of(StatedModes, text)
        check_guard_images(given)
        size, modes = given.degrees_of_freedom, tuple(_mode(mode, given) for mode in given.modes)
        return {
            "PARAMETERS": tuple(Parameter(n, "", f"parameter {n}") for n in given.parameters),
            "MODES": modes,
            "WALLS": tuple(_guard(guard, size) for guard in given.guards),
            "DEGREES_OF_FREEDOM": size,
            "AUTONOMOUS": given.autonomous,
            "GEOMETRY": None if any(mode.first_order for mode in modes) else Geometry(),
            "machine": given,
        }

    def validate(self) -> None:
        """Refuse laws without a value, and masses below zero."""
        check_values_of_laws(self.machine, self.values)

    def state_names(self, mode: str) -> list[tuple[str, str]]:
        """Return the names in the mode's laws."""
        stated, sections = self.machine.mode(mode), self.machine.sections
        speeds = stated.velocities(sections)
        return [(n, speeds.get(n, f"rate of {n}")) for n in stated.coordinates(sections)]

    @property
    def timeless(self) -> bool:
        """Whether the time stands in no law."""
        return self.machine.autonomous

    @property
    def tori(self) -> bool:
        """Whether tori can be born on orbits."""
        return super().tori or not self.autonomous

    def symmetry(self, parameter: str, harmonics: Sequence[float]) -> Symmetry | None:
        """The one that is stated, if it holds whatever value the parameter has."""
        shift = symmetric_shift(self.machine, self.values, parameter)
        if shift is None:
            return None
        return Symmetry(guard_images(self.machine), shift=shift, sign=-1.0)

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
            if set(names_in(texts[name])) <= {*known, *self.symbols, *FUNCTIONS, *CONSTANTS}:
                found[name] = self.read(texts[name], f"define.{name}", known)
        return found

    def jump(
        self, guard: ModeGuard, x: Sequence[Any], v: Sequence[Any]
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


def _mode(mode: StatedMode, given: StatedModes) -> Mode:
    coordinates, speeds = mode.coordinates(given.sections), mode.velocities(given.sections)
    first = tuple(i for i, name in enumerate(coordinates) if name not in speeds)
    return Mode(mode.name, len(coordinates), first)


def _guard(guard: ModeGuard, size: int) -> Guard:
    row = guard.row + (0.0,) * (size - len(guard.row))
    if guard.modes == (guard.to,):
        return Wall(guard.name, guard.side, guard.modes[0], coordinate=row)
    return Guard(guard.name, guard.side, guard.modes, guard.to, row, guard.past)
