"""Systems that scenes state themselves: each by one text, of which its class is made."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Self

from .model import Model
from .repetition import check_period


class StatedSystem(Model):
    """A system by the text of its statement, which the class of an instance has read.

    Parameters
    ----------
    machine : str
        The text.
    **parameters : float
        A value for each parameter of it.
    """

    PARAMETERS = ()
    STATED = True
    OPTIONS: ClassVar[Mapping[str, str]] = {"machine": ""}

    def __new__(cls, /, **given: Any) -> Self:
        kind = cls if hasattr(cls, "machine") else cls.class_of(str(given.get("machine", "")))
        return object.__new__(kind)

    def __init__(self, /, **given: Any) -> None:
        super().__init__(**given)
        check_period(type(self).machine, self.values)  # type: ignore[attr-defined]

    def __copy__(self) -> Self:
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        return other

    def __reduce__(self) -> tuple[Any, ...]:
        return _made, (type(self).__base__, self.options["machine"], dict(self.values))

    def place(self, what: str, name: str = "") -> str:
        """Return the key of a scene."""
        if not name:
            return f"model.{what}" if what in ("period", "mass") else "model"
        guard = next(g for g in type(self).machine.guards if g.name == name)  # type: ignore[attr-defined]
        set_there = ".set" if getattr(guard, "after", ()) else ""
        key = {"walls": ".within", "reset": set_there, "jump": set_there}.get(what.split()[0], "")
        return f"model.guards.{name}{key}"

    @classmethod
    @abstractmethod
    def class_of(cls, text: str) -> type[Self]:
        """Return the class of a statement, which holds it as `machine`."""


def _made(kind: type[StatedSystem], text: str, values: Mapping[str, float]) -> StatedSystem:
    return kind(machine=text, **values)
