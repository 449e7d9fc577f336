"""Interruptions from the keyboard: what was walked until then is kept.

A walk that is interrupted raises `Interrupted`, a `KeyboardInterrupt` with what was walked. Whoever
does not know it leaves as at any interruption; whoever makes a branch of walks catches it with
`kept`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

from .branch import Walk
from .ends import End, EndKind

T = TypeVar("T")


class Interrupted(KeyboardInterrupt):
    """An interruption from the keyboard during a walk.

    Attributes
    ----------
    walk : Walk
        What was walked until then.
    """

    def __init__(self, walk: Walk) -> None:
        super().__init__()
        self.walk = walk


def kept(walk: Callable[[], Walk]) -> Walk:
    """Return a walk; one that is interrupted, as far as it has come."""
    try:
        return walk()
    except Interrupted as interruption:
        return interruption.walk


def other_way(first: Walk, parameter: str, walk: Callable[[], Walk]) -> Walk:
    """Return the walk in the other direction; none on a loop, and none after an interruption."""
    start = first.points[:1]
    if first.end.kind is EndKind.CLOSED:
        return Walk(start, (), first.end)
    if first.end.kind is EndKind.INTERRUPTED:
        return Walk(start, (), End.of(EndKind.INTERRUPTED, parameter, start[0].parameter))
    return kept(walk)


def interrupted(ends: Iterable[End]) -> bool:
    """Whether one of the ends of a branch is an interruption."""
    return any(end.kind is EndKind.INTERRUPTED for end in ends)


def undisturbed(make: Callable[[], T]) -> T:
    """Return what is made, begun again if it is interrupted.

    For what takes a moment and without which long work would be lost; a second interruption leaves.
    """
    try:
        return make()
    except KeyboardInterrupt:
        return make()
