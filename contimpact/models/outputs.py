"""Outputs: named expressions in the state, the time and the parameters of a model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from ..errors import InputError, short_repr
from .expressions import CONSTANTS, FUNCTIONS, check_expression, names_in
from .model import Model

TIME, VOLTAGE = "t", "U"
CONTACT = ("duration", "deflection", "speed", "restitution")
"""What is known of a contact: see `contimpact.orbits.outputs.Contact`."""


class Harvester(Protocol):
    """What gives an impact a voltage; see `contimpact.Membrane`."""

    def scale(self, parameters: Mapping[str, Any]) -> Any:
        """Return the dimensional velocity of one unit of the model's."""

    def voltage(self, velocity: Any) -> Any:
        """Return the voltages of impacts at dimensional velocities."""

    def slope(self, velocity: Any) -> Any:
        """Return the derivative of the voltage by the velocity."""


@dataclass(frozen=True)
class Output:
    """A named expression in the state of a system."""

    name: str
    expression: str
    at_impacts: bool = False
    """Whether its mean is that of its values before impacts, instead of that over time."""
    contacts: str = ""
    """Letters of guards at which contacts begin: its mean is that over these contacts, and it is an
    expression in `CONTACT` and the parameters."""
    per_time: bool = False
    """Whether it is their sum in a unit of time instead."""
    harvester: Harvester | None = None
    """What gives an impact the voltage ``U``."""

    def variables(self, model: Model) -> list[str]:
        """Return the names it may use."""
        if self.contacts:
            return [*CONTACT, *model.values, *model.DERIVED]
        return [*variables_of(model), *([VOLTAGE] if self.harvester else [])]


def variables_of(model: Model) -> list[str]:
    """Return the names that outputs may use: the state's in every mode, ``t``, all parameters."""
    modes = [state_names(model, mode.name) for mode in model.MODES] or [state_names(model, "")]
    state = [name for name in modes[0] if name and all(name in names for names in modes)]
    return [*state, TIME, *model.values, *model.DERIVED]


def require_membranes(system: Model | type[Model] | None) -> None:
    """Refuse a known system whose impacts hit no membranes of an energy harvester."""
    if system is not None and not system.MEMBRANES:
        found = f"the system {system.SYSTEM} has no membranes"
        raise InputError("energy", found, "use the impact pair")


def check_output(output: Output, model: Model, where: str) -> None:
    """Raise InputError if an output is no expression in the names of the model."""
    if output.harvester is not None:
        require_membranes(model)
    known = output.variables(model)
    taken = variables_of(model) if output.contacts else known
    if not set(output.contacts) <= set(model.letters):
        found = f"contacts with {short_repr(output.contacts)}"
        raise InputError(where, found, f"give letters of guards: {', '.join(model.letters)}")
    if not output.name.isidentifier() or output.name in {*taken, *FUNCTIONS, *CONSTANTS}:
        found = f"an output cannot be called {short_repr(output.name)}"
        accepted = f"give a name of letters and digits other than {', '.join(taken)}"
        raise InputError(where, found, accepted)
    lacking = [
        (name, mode.name)
        for name in names_in(output.expression if not output.contacts else "")
        if name not in known and any(name in state_names(model, m.name) for m in model.MODES)
        for mode in model.MODES
        if name not in state_names(model, mode.name)
    ]
    for name, mode in lacking[:1]:
        found = f"{name!r}, which the mode {mode} does not have"
        raise InputError(where, found, f"names of all modes are {', '.join(known)}")
    check_expression(output.expression, where, known)


def state_names(model: Model, mode: str) -> list[str]:
    """Names of a mode's positions and then velocities: its own where these are names, else ``x``
    and ``v``, numbered where there are several; none of rates that are no part of the state."""
    pairs = model.state_names(mode)
    first = next((m.first_order for m in model.MODES if m.name == mode), ())
    numbers = [str(i + 1) if len(pairs) > 1 else "" for i in range(len(pairs))]
    positions = [
        x if x.isidentifier() else f"x{i}" for (x, _), i in zip(pairs, numbers, strict=True)
    ]
    speeds = [v if v.isidentifier() else f"v{i}" for (_, v), i in zip(pairs, numbers, strict=True)]
    speeds = ["" if i in first else v for i, v in enumerate(speeds)]
    taken = {*positions, *model.values, *model.DERIVED, TIME}
    return [*positions, *("" if v in taken else v for v in speeds)]
