"""Telling how far work has come, a line of text now and then; whoever asks decides what to show.

The text names the stage: ``following b2, 2:1: 60 points, s = 0.31``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Progress = Callable[[str], None]

EVERY = 20
"""Points of a walk between two lines."""


def silent(text: str) -> None:
    """Tell nobody."""


def counted(what: str, parameter: str, progress: Progress) -> Callable[[Any], None]:
    """Return a callback of a walk that tells how many points there are, and where it is."""
    count = 0

    def callback(point: Any) -> None:
        nonlocal count
        count += 1
        if count % EVERY == 0:
            progress(f"{what}: {count} points, {parameter} = {point.parameter:.6g}")

    return callback
