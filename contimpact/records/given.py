"""What a user gave to be followed, as an orbit."""

from __future__ import annotations

from typing import Any

from ..continuation.branch import Event, Point
from ..errors import InputError, shown
from ..models.model import Model
from ..orbits.orbit import Orbit
from ..orbits.problem import Linearisation
from .branch import Branch
from .diagram import Diagram
from .entry import Entry
from .recovery import event_of_branch

FOLLOWED = (
    "give an orbit of find_orbits, an entry, branch.orbit(row), or diagram.orbit('e5') by its name"
)


def as_diagram(given: object) -> Diagram:
    """Return the diagram meant by a diagram, a branch, or several branches.

    Raises
    ------
    InputError
        For anything else.
    """
    if isinstance(given, Diagram):
        return given
    branches = [given] if isinstance(given, Branch) else given
    if isinstance(branches, list | tuple) and all(isinstance(one, Branch) for one in branches):
        return Diagram(", ".join(dict.fromkeys(one.notation for one in branches)), branches)
    raise InputError("diagram", _found(given), "give a diagram, a branch, or a list of branches")


def named(given: object) -> object:
    """Return the entry that a pair (branch or diagram, name) means, and anything else as it is."""
    if not (isinstance(given, tuple) and len(given) == 2 and isinstance(given[1], str)):
        return given
    holder, name = given
    if isinstance(holder, Branch):
        return event_of_branch(holder, name)
    return holder.entry(name) if isinstance(holder, Diagram) else given


def as_orbit(given: object, model: Model | None = None) -> Orbit:
    """Return the orbit meant by an orbit, an entry, an event, a point, or a pair (branch, row).

    Raises
    ------
    InputError
        For anything else, or where the record and the model do not fit.
    """
    if isinstance(given, Orbit):
        return given
    if isinstance(given, Entry):
        return given.orbit(model)
    if isinstance(given, tuple) and len(given) == 2 and isinstance(given[0], Branch):
        return given[0].orbit(given[1], model)
    point = given.point if isinstance(given, Event) else given
    here = point.evaluation if isinstance(point, Point) else None
    if isinstance(here, Linearisation):
        return Orbit(here.problem, here)
    raise InputError("orbit", _found(given), FOLLOWED)


def _found(given: object) -> str:
    """What was given in the place of an orbit, in words."""
    if isinstance(given, Branch):
        return f"found the branch {given.id}, which has {len(given)} orbits"
    if isinstance(given, Diagram):
        return f"found the diagram {given.name}"
    if isinstance(given, list | tuple) and any(isinstance(item, Orbit) for item in given):
        return f"found a list of {len(given)}, not one of its orbits"
    return f"found {shown(given)}"


def entry_first(entry: Any, model: Any) -> tuple[Any, Any]:
    """Return an entry and its model, which may have been given the other way round."""
    return (model, entry) if isinstance(entry, Model) else (entry, model)
