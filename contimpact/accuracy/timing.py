"""Repeated timings within a budget: the median, the least and the most.

Seconds are those of the processor, which other programs that run meanwhile do not change.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from statistics import median
from typing import Any, TypeVar

SECONDS = 20.0
"""A part of a report that has taken so long is not repeated, nor measured at more places."""

T = TypeVar("T")


def timed(
    task: Callable[[], Any], repetitions: int, per: float = 1.0
) -> tuple[Any, dict[str, float]]:
    """Run a task several times; returns its result and median, least and most seconds per unit.

    It is not repeated any more after `SECONDS`.
    """
    seconds: list[float] = []
    result = None
    for _ in within_budget(range(repetitions)):
        began = time.process_time()
        result = task()
        seconds.append((time.process_time() - began) / per)
    return result, spread(seconds)


def within_budget(items: Iterable[T], seconds: float | None = None) -> Iterator[T]:
    """Yield items until what is done with them has taken `SECONDS`; one at least."""
    end = time.process_time() + (SECONDS if seconds is None else seconds)
    for item in items:
        yield item
        if time.process_time() > end:
            break


def spread(seconds: Sequence[float]) -> dict[str, float]:
    """Return the median, the least and the most of some timings."""
    return {"median": median(seconds), "low": min(seconds), "high": max(seconds)}
