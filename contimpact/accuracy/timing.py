"""Repeated timings: the median, the least and the most."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from statistics import median
from typing import Any


def timed(
    task: Callable[[], Any], repetitions: int, per: float = 1.0
) -> tuple[Any, dict[str, float]]:
    """Run a task several times; returns its result and median, least and most seconds per unit."""
    seconds = []
    for _ in range(repetitions):
        began = time.perf_counter()
        result = task()
        seconds.append((time.perf_counter() - began) / per)
    return result, spread(seconds)


def spread(seconds: Sequence[float]) -> dict[str, float]:
    """Return the median, the least and the most of some timings."""
    return {"median": median(seconds), "low": min(seconds), "high": max(seconds)}
