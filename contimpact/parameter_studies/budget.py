"""A scene's budget of time: what ends a scene that hangs."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Iterator
from typing import Any

from ..progress import Progress, silent

LATE = 2.0
GRACE = 10.0
"""A process of our own is ended after so many budgets and, besides, so many seconds."""
AGAIN = 1.0
"""Seconds after which the timer rings again: what it raises is lost within callbacks of C."""


class BudgetError(BaseException):
    """A scene has used up its budget; nothing on the way takes it for a numerical error."""


@contextlib.contextmanager
def limited(seconds: float | None, fatal: bool = False) -> Iterator[Progress]:
    """End what is done within the block when it takes too long.

    In a process's main thread a timer interrupts Python wherever it is. Elsewhere the function that
    is yielded looks at the clock whenever progress is told to it.

    Parameters
    ----------
    seconds : float or None
        None for no limit.
    fatal : bool
        Whether to end the process if it does not return to Python even then.

    Raises
    ------
    BudgetError
        After that time.
    """
    if seconds is None:
        yield silent
        return
    deadline = time.monotonic() + seconds

    def tell(text: str) -> None:
        if time.monotonic() > deadline:
            raise BudgetError

    with _watched(LATE * seconds + GRACE if fatal else None), _alarm(seconds):
        yield tell


@contextlib.contextmanager
def _alarm(seconds: float) -> Iterator[None]:
    main = threading.current_thread() is threading.main_thread()
    if not (main and hasattr(signal, "setitimer")):
        yield
        return

    def ring(*signalled: Any) -> None:
        raise BudgetError

    before = signal.signal(signal.SIGALRM, ring)
    try:
        signal.setitimer(signal.ITIMER_REAL, seconds, AGAIN)
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@contextlib.contextmanager
def _watched(seconds: float | None) -> Iterator[None]:
    """End the process after a time, by a thread that needs no Python."""
    if seconds is None:
        yield
        return
    import faulthandler
    import os

    with open(os.devnull, "w") as nowhere:
        faulthandler.dump_traceback_later(seconds, exit=True, file=nowhere)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()
