r"""Linear machines that a scene states: :math:`M\ddot x + C\dot x + Kx = f(t)` within guards.

An impact at a guard with the gap coordinate :math:`n \cdot x` changes the velocities by an impulse
along n, such that the gap coordinate's velocity is multiplied by -r:

.. math:: v^+ = v - (1 + r)\frac{n \cdot v}{n \cdot M^{-1} n}\,M^{-1} n .

Impacts between bodies thus keep their momentum.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Self

from ..errors import InputError
from ..models.machine import TIME, Machine, StatedGuard, StatedSystem, check_values, machine_of
from ..models.model import Formulas, Parameter, Wall


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

    @classmethod
    def class_of(cls, text: str) -> type[Self]:
        """Return the class of a text; see `StatedSystem`."""
        return _class_of(text)  # type: ignore[return-value]

    def validate(self) -> None:
        """Refuse masses, restitutions and periods that no machine has."""
        check_values(self.machine, self.values)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The names of the coordinates."""
        return self.machine.coordinates

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


@functools.cache
def _class_of(text: str) -> type[LinearMachine]:
    """Return the class of a machine, by its text."""
    machine = machine_of(text)
    names = {g.restitution.strip() for g in machine.guards}
    restitutions = [n for n in machine.parameters if n in names]
    parameters = tuple(
        Parameter(n, "", f"parameter {n}", lower=0, upper=1)
        if n in restitutions
        else Parameter(n, "", f"parameter {n}")
        for n in machine.parameters
    )
    attributes = {
        "__doc__": LinearMachine.__doc__,
        "__module__": __name__,
        "PARAMETERS": parameters,
        "WALLS": tuple(Wall(g.name, g.side, coordinate=g.row) for g in machine.guards),
        "DEGREES_OF_FREEDOM": len(machine.coordinates),
        "OPTIONS": {"machine": text},
        "machine": machine,
    }
    try:
        return type("LinearMachine", (LinearMachine,), attributes)
    except InputError as error:
        inside = "guards" if error.where.endswith("WALLS") else "parameters"
        raise InputError(inside, error.found, error.accepted) from None
