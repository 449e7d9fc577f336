"""What commands print, and how they are ended from outside."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Iterator
from typing import Any, NoReturn, TextIO

from ..storage.files import terminal_text

# A request to end (SIGTERM), as schedulers send it, is taken as Ctrl-C.
#
# What was computed is written.

ENDING = (signal.SIGINT, signal.SIGTERM)
"""Signals that ask a command to end."""


@contextlib.contextmanager
def raise_on_termination() -> Iterator[None]:
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


def say(text: str, stream: TextIO | None = None) -> None:
    """Print lines of text, to standard output if nothing else is said."""
    stream = stream or sys.stdout
    print(terminal_text(text, getattr(stream, "encoding", None)), file=stream, flush=True)


def complain(message: object) -> None:
    """Write a message to standard error."""
    say(f"contimpact: {message}", sys.stderr)
