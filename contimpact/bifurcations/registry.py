"""The kinds of events by their names: the package's, and those of a user's own."""

from __future__ import annotations

import functools
import importlib
from collections.abc import Iterator, Sequence

from ..continuation.branch import TestFunction
from ..orbits.problem import Linearisation, OrbitProblem
from .declarations import FILES, unknown_kind
from .extended_system import OrbitEvent
from .kind import Kind, Start, Values


class UnknownKind(Kind):
    """An event of which only the name is known: that of a user's function."""

    tilde = False

    def __init__(self, name: str) -> None:
        self.name = name

    def test(self, problem: OrbitProblem, values: Values) -> TestFunction[Linearisation]:
        raise unknown_kind(self.name, "events")


def kind_of(name: str) -> Kind:
    """Return a kind by its name.

    A kind that is not declared is found by its class, once that is imported; one defined anew, as
    in a notebook, takes the place of the earlier one.
    """
    if name in FILES:
        return _load_kind(name)
    own = [kind for kind in _subclasses(Kind) if getattr(kind, "name", None) == name]
    return own[-1]() if own else UnknownKind(name)


@functools.cache
def _load_kind(name: str) -> Kind:
    kind: Kind = getattr(importlib.import_module(f".{FILES[name]}", __package__), name)()
    return kind


def _subclasses(kind: type) -> Iterator[type[Kind]]:
    """All subclasses, in the order of their definition."""
    subclasses: Sequence[type[Kind]] = kind.__subclasses__()
    for one in subclasses:
        yield one
        yield from _subclasses(one)


def test_functions(
    problem: OrbitProblem, kinds: Sequence[str], values: Values
) -> list[TestFunction[Linearisation]]:
    """Return the test functions of the kinds asked for; nothing else is evaluated.

    Raises InputError for a kind that does not exist, or a requested value of what does not vary.
    """
    return [kind_of(kind).test(problem, values) for kind in dict.fromkeys(kinds)]


test_functions.__test__ = False  # type: ignore[attr-defined]


def switch(event: OrbitEvent) -> Start | None:
    """Return the start of the branch born at an event of a kind in `SWITCHES`; None where nothing
    can start: a dropped impact was the only one, or the tangent is not defined (a degenerate
    event)."""
    return kind_of(event.kind).born(event)
