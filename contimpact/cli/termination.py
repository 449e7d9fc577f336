"""A request to end (SIGTERM), as schedulers send it, is taken as Ctrl-C.

What was computed is written.
"""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from typing import Any, NoReturn

ENDING = (signal.SIGINT, signal.SIGTERM)
"""What asks a command to end."""


@contextlib.contextmanager
def as_interruption() -> Iterator[None]:
    """Raise `KeyboardInterrupt` where the process is asked to end, if nobody else has a handler."""
    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _interrupt(*signalled: Any) -> NoReturn:
    raise KeyboardInterrupt
