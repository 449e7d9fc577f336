"""One process at a time writes to a folder.

The lock is a file in the folder. Where the system has locks on files, it is held by one of these,
which ends with its process however that ends; the file's content only says who holds it. Elsewhere
the content decides: a lock is stale if its process has ended, told from a later process of the
same number by when it started.
"""

from __future__ import annotations

import contextlib
import json
import os
import stat
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..errors import InputError
from .files import reason
from .processes import Process, this_process

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

LOCK = "contimpact.lock"
LONGEST = 4096
"""Bytes that are read of a lock."""


@contextlib.contextmanager
def locked(folder: Path, name: str = LOCK) -> Iterator[None]:
    """Keep other processes from writing to a folder, or to what a lock of another name is for.

    Raises
    ------
    InputError
        If another one does, or the folder cannot be written.
    """
    path = folder / name
    try:
        descriptor = _taken(path)
    except OSError as error:
        raise InputError(
            str(path), f"cannot be written ({reason(error)})", "give another folder"
        ) from None
    try:
        yield
    finally:
        _give_back(path, descriptor)


def _taken(path: Path) -> int:
    """The lock's file, open and ours."""
    while True:
        descriptor = _opened(path)
        try:
            if not _ours(descriptor):
                raise _busy(path, _record(descriptor))
            if _in_place(descriptor, path):
                _sign(descriptor, path)
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)  # given back between opening and locking it


def _opened(path: Path) -> int:
    """The lock's file; a link, or anything that is no plain file, is refused."""
    flags = os.O_RDWR | os.O_CREAT
    flags |= getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
    descriptor = os.open(path, flags, 0o666)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError("not a plain file")
    return descriptor


def _ours(descriptor: int) -> bool:
    """Take the lock; false if somebody else has it."""
    try:
        if fcntl is not None:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return not _held(_record(descriptor))
    return not _held(_record(descriptor))


def _held(record: dict[str, Any]) -> bool:
    """Whether the process that wrote a lock may be running."""
    try:
        holder = Process(str(record["host"]), int(record["pid"]), str(record["start"]))
    except (KeyError, TypeError, ValueError):
        return False
    return not holder.here() or holder.running()


def _in_place(descriptor: int, path: Path) -> bool:
    """Whether an open file is still the one of this name."""
    try:
        return os.path.samestat(os.fstat(descriptor), os.lstat(path))
    except FileNotFoundError:
        return False


def _sign(descriptor: int, path: Path) -> None:
    """Say in the lock who holds it."""
    me = this_process()
    since = time.strftime("%Y-%m-%d %H:%M:%S")
    text = json.dumps({"pid": me.pid, "host": me.host, "start": me.start, "since": since})
    try:
        os.ftruncate(descriptor, 0)
        os.lseek(descriptor, 0, os.SEEK_SET)
        os.write(descriptor, text.encode() + b"\n")
    except OSError:  # a full disk
        path.unlink()
        raise


def _record(descriptor: int) -> dict[str, Any]:
    """What a lock says; empty if that makes no sense."""
    os.lseek(descriptor, 0, os.SEEK_SET)
    try:
        record = json.loads(os.read(descriptor, LONGEST))
    except (ValueError, RecursionError):
        return {}
    return record if isinstance(record, dict) else {}


def _busy(path: Path, record: dict[str, Any]) -> InputError:
    who = ", ".join(f"{name} {record[name]}" for name in ("pid", "host", "since") if name in record)
    remedy = "wait until it has ended, or give another folder"
    if fcntl is None or record.get("host") != this_process().host:
        remedy += f" (if it has ended for certain, remove {path.name})"
    return InputError(str(path.parent), f"another contimpact is writing to it ({who})", remedy)


def _give_back(path: Path, descriptor: int) -> None:
    """Remove the lock's file while nobody else can hold it."""
    with contextlib.suppress(OSError):
        if fcntl is None:
            os.close(descriptor)
            path.unlink()
        else:
            path.unlink()
            os.close(descriptor)
