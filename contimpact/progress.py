"""Telling how far work has come, a line of text now and then; whoever asks decides what to show.

The text names the stage: ``following b2, 2:1: 60 points, s = 0.31``.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TextIO, TypeVar

from .errors import count_text
from .storage import terminal_text

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
        with telling(name, patient=True) as tell:
            yield tell
    else:
        yield progress or ignore_progress


@contextlib.contextmanager
def progress_callback(
    progress: Asked, what: str, parameter: str, callback: Callable[[Any], Any] | None
) -> Iterator[Callable[[Any], Any] | None]:
    """Yield the callback of a walk, which first tells how far it is if that was asked for."""
    with progress_lines(progress, what) as tell:
        count = counting_callback("", parameter, tell)

        def told(point: Any) -> Any:
            count(point)
            return callback(point) if callback else None

        yield told if progress else callback


def tell_each(branches: Sequence[Named], what: str, progress: Progress) -> Iterator[Named]:
    """Yield branches one after another, and tell which it is."""
    for number, branch in enumerate(branches, start=1):
        progress(f"{what} {branch.id}, {number} of {len(branches)}")
        yield branch


def walk_progress(what: str, parameter: str, progress: Progress) -> Callable[[int, float], None]:
    """Return a callback that takes how many points a walk has recorded and the parameter of the
    last of them, and tells every `EVERY` points how many there are, and where it is."""
    count = 0

    def tell(points: int, value: float) -> None:
        nonlocal count
        count += points
        if count % EVERY < points:
            where = f"{count_text(count, 'point')}, {parameter} = {value:.6g}"
            progress(f"{what}: {where}" if what else where)

    return tell


def counting_callback(what: str, parameter: str, progress: Progress) -> Callable[[Any], None]:
    """Return a callback of a walk that tells how many points there are, and where it is."""
    tell = walk_progress(what, parameter, progress)
    return lambda point: tell(1, point.parameter)


# Progress on standard error: what is being done, for how long, and that it has not ended.

BEAT = 0.25
"""Seconds after which a terminal's line is rewritten."""
PAUSE = 2.0
"""Seconds between two lines at least, where there is no terminal."""
QUIET = 30.0
"""Seconds after which a line is repeated there, if there is nothing new to tell."""


class Teller:
    """Shows the newest line of text it was called with; every line begins with its name.

    On a terminal it is one line, rewritten in place. Elsewhere the first text is written at once,
    or after the pause if `patient`, then the newest at most every `PAUSE` seconds, by a thread of
    its own: what takes long is named even if nothing new is said meanwhile.
    """

    def __init__(self, name: str, stream: TextIO, patient: bool = False) -> None:
        self.name, self.stream, self.patient = name, stream, patient
        self.live = stream.isatty()
        self.began = self.written = time.monotonic()
        self.text = self.shown = ""
        self.lock, self.done = threading.Lock(), threading.Event()
        self.thread: threading.Thread | None = None

    def __call__(self, text: str) -> None:
        """Tell what is being done."""
        self.text = text or self.text
        if self.text and self.thread is None:
            if not self.patient:
                self.write()
            self.thread = threading.Thread(target=self.watch, daemon=True)
            self.thread.start()

    def watch(self) -> None:
        """Write what is new, or that nothing is, from time to time."""
        while not self.done.wait(BEAT if self.live else PAUSE):
            quiet = time.monotonic() - self.written >= QUIET
            if self.live or quiet or self.text != self.shown:
                self.write()

    def write(self) -> None:
        """Write the newest text, with the seconds since the beginning."""
        self.shown, self.written = self.text, time.monotonic()
        line = f"{self.name}, {self.written - self.began:.0f} s: {self.shown}"
        self.put(line[: self.width() - 1] if self.live else f"{line}\n")

    def say(self, message: str) -> None:
        """Write a message that stays."""
        self.put(f"{message}\n")

    def put(self, text: str) -> None:
        """Write text, on a terminal in place of the line that is there."""
        text = terminal_text(text, getattr(self.stream, "encoding", None))
        with self.lock, contextlib.suppress(OSError, ValueError):  # the work goes on all the same
            self.stream.write(f"\r\x1b[K{text}" if self.live else text)
            self.stream.flush()

    def width(self) -> int:
        with contextlib.suppress(OSError, ValueError):
            return os.get_terminal_size(self.stream.fileno()).columns or 80
        return 80

    def close(self) -> None:
        """End the thread, and clear the terminal's line."""
        self.done.set()
        if self.thread is not None:
            self.thread.join()
        if self.live and self.thread is not None:
            self.put("")


@contextlib.contextmanager
def telling(name: str, quiet: bool = False, patient: bool = False) -> Iterator[Callable[..., None]]:
    """Show progress within a block, with what the library logs: kernels derived, code compiled.

    Yields the function to call with a line of text.
    """
    if quiet or sys.stderr is None or sys.stderr.closed:
        yield lambda text: None
        return
    teller = Teller(name, sys.stderr, patient)
    try:
        with _log_told(teller):
            yield teller
    finally:
        teller.close()


@contextlib.contextmanager
def _log_told(teller: Teller) -> Iterator[None]:
    """Show what the library logs: notices as progress, warnings as messages that stay."""
    import logging

    class Handler(logging.Handler):
        def emit(self, record: Any) -> None:
            if record.levelno >= logging.WARNING:
                teller.say(f"contimpact: {self.format(record)}")
            else:
                teller(record.getMessage())

    log, handler = logging.getLogger("contimpact"), Handler()
    level = log.level
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.setLevel(level)
