"""Telling how far work has come, a line of text now and then; whoever asks decides what to show.

The text names the stage: ``following b2, 2:1: 60 points, s = 0.31``.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

Progress = Callable[[str], None]
Asked = bool | Progress | None
"""Progress that a caller asks for: nothing, lines on standard error, or lines to a function."""

Named = TypeVar("Named", bound=Any)
EVERY = 20
"""Points of a walk between two lines."""


def ignore_progress(text: str) -> None:
    """Tell nobody."""


class RememberedProgress:
    """Progress that knows its last line: where a computation is when it is interrupted."""

    def __init__(self, tell: Progress) -> None:
        self.tell, self.last = tell, ""

    def __call__(self, text: str) -> None:
        self.last = text or self.last
        self.tell(text)


@contextlib.contextmanager
def progress_lines(progress: Asked, name: str) -> Iterator[Progress]:
    """Yield the function to call with lines of text about a piece of work."""
    if progress is True:
        from .telling import telling

        with telling(name, patient=True) as tell:
            yield tell
    else:
        yield progress or ignore_progress


def chain_callbacks(
    one: Callable[[Any], Any] | None, tell: Callable[[Any], None]
) -> Callable[[Any], Any]:
    """Return a callback that tells, and then does what the caller's does."""

    def callback(point: Any) -> Any:
        tell(point)
        return one(point) if one else None

    return callback


def tell_each(branches: Sequence[Named], what: str, progress: Progress) -> Iterator[Named]:
    """Yield branches one after another, and tell which it is."""
    for number, branch in enumerate(branches, start=1):
        progress(f"{what} {branch.id}, {number} of {len(branches)}")
        yield branch


def counting_callback(what: str, parameter: str, progress: Progress) -> Callable[[Any], None]:
    """Return a callback of a walk that tells how many points there are, and where it is."""
    count = 0

    def callback(point: Any) -> None:
        nonlocal count
        count += 1
        if count % EVERY == 0:
            where = f"{count} points, {parameter} = {point.parameter:.6g}"
            progress(f"{what}: {where}" if what else where)

    return callback
