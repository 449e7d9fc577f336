"""Reading what others may have written: files that are files, and no more of them than admitted."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

LARGEST_RECORD = 2**28
"""Bytes of a JSON file, or of the record in a table's first line."""


@contextlib.contextmanager
def open_file(path: str | Path) -> Iterator[BinaryIO]:
    """Open a file for reading; pipes and devices, which may never end, are refused.

    Raises
    ------
    OSError
        If it is no file, or cannot be read.
    """
    with open(path, "rb", opener=_without_waiting) as file:
        if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
            raise OSError(errno.EINVAL, "not a file")
        yield file


def _without_waiting(path: str, flags: int) -> int:
    """Open a pipe that nobody writes to without waiting for somebody who does."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def read_bytes(path: str | Path, most: int = LARGEST_RECORD) -> bytes:
    """Return the content of a file of at most `most` bytes.

    Raises
    ------
    OSError, ValueError
        If it is no file or cannot be read; if it is too long.
    """
    with open_file(path) as file:
        return bounded(file.read(most + 1), most)


def bounded(content: bytes, most: int) -> bytes:
    """Return what was read, or raise `ValueError` if it is longer than admitted."""
    if len(content) > most:
        raise ValueError(f"longer than {most} bytes")
    return content
