"""Which process wrote something, and whether it is still running."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import sys
from dataclasses import dataclass
from pathlib import Path

ENDED = "ended"
"""In place of the start of a process that has ended and waits for its parent to take notice."""


@dataclass(frozen=True)
class Process:
    """A process: its host, its number, and when it started, in the system's own clock.

    The start tells a process from a later one with the same number. It is empty where the system
    does not say.
    """

    host: str
    pid: int
    start: str

    @property
    def name(self) -> str:
        """A short name for use in names of files."""
        return f"{digest_of(self.host)}-{self.pid}-{self.start or 0}"

    def here(self) -> bool:
        """Whether it runs, or ran, on this machine."""
        return self.host == host()

    def running(self) -> bool:
        """Whether it is running, if it is one of this machine; true where that cannot be told."""
        return running(self.pid, self.start)


def this_process() -> Process:
    """Return this process."""
    return _process(os.getpid())


@functools.cache
def _process(pid: int) -> Process:
    return Process(host(), pid, start_of(pid))


@functools.cache
def host() -> str:
    """Return the machine's name."""
    import socket

    return socket.gethostname()


def digest_of(name: str) -> str:
    """Return a machine's name as eight hexadecimal digits."""
    return hashlib.sha256(name.encode()).hexdigest()[:8]


def running(pid: int, start: str) -> bool:
    """Whether a process of this machine is running; true where that cannot be told."""
    if pid <= 0:
        return False
    if sys.platform == "win32":  # os.kill would end it there
        return True
    try:
        with contextlib.suppress(PermissionError):  # somebody else's
            os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    now = start_of(pid)
    return not (now and start) or now == start


def start_of(pid: int) -> str:
    """Return when a process started, in ticks since the machine did; empty if that is not told."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    fields = text.rpartition(")")[2].split()
    return ENDED if fields[0] in "ZX" else fields[19]
