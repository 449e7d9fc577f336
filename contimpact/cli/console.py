"""What the commands share: progress, interruptions, options."""

from __future__ import annotations

import argparse
import contextlib
import signal
import sys
import threading
from collections.abc import Callable, Iterator

from ..errors import InputError


def progress(quiet: bool) -> Callable[[str], None]:
    """One line on standard error, rewritten in place, if that is a terminal."""
    if quiet or not sys.stderr.isatty():
        return lambda text: None

    def show(text: str) -> None:
        sys.stderr.write(f"\r\x1b[K{text[:100]}")
        sys.stderr.flush()

    return show


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Put interruptions off until what was computed is on disk."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before if before is not None else signal.SIG_DFL)


def require_output(options: argparse.Namespace) -> None:
    """Refuse an empty name of a folder."""
    if not options.output:
        raise InputError("-o", "empty", "give the path of a folder")
