"""Files written whole or not at all, and never through a link.

Everything that contimpact writes goes through `put`: a new file beside the target takes the
target's name once it is whole. A link at the target is replaced, not followed.
"""

from __future__ import annotations

import contextlib
import errno
import lzma
import os
import re
import stat
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import BinaryIO, cast

from ..errors import InputError, NotWrittenError
from .processes import digest_of, host, running, this_process

Content = Callable[[], str | bytes]
"""Makes the content of a file."""

FOR_ALL = 0o666
"""Permissions of results, before the user's umask."""

LEFT = re.compile(r"\..*\.([0-9a-f]{8})-(\d+)-(\w+)-\d+\.tmp", re.DOTALL)
PACKED = ".xz"
"""Ending of a file that is stored compressed: it is read in place of one without."""
LARGEST_RECORD = 2**28
"""Bytes of a JSON file, or of the record in a table's first line."""
DAY = 86400.0
"""Seconds after which a temporary file of another machine is taken to be left behind."""


# Writing.


def put(path: Path, content: bytes, mode: int = 0o600, *, durable: bool = False) -> None:
    """Put a whole file in place at once: another process may be writing or reading it.

    Parameters
    ----------
    path : Path
    content : bytes
    mode : int
        Its permissions, before the umask.
    durable : bool
        Whether it is to be on the disk before it takes its name, so that it survives a machine
        that stops.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    temporary = temporary_beside(path)
    try:
        with open(os.open(temporary, _NEW, mode), "wb") as file:
            file.write(content)
            if durable:
                file.flush()
                os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


_NO_LINK = getattr(os, "O_NOFOLLOW", 0)
_SAFE = _NO_LINK | getattr(os, "O_BINARY", 0) | getattr(os, "O_NONBLOCK", 0)
_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | _SAFE


def temporary_beside(path: Path) -> Path:
    """Return a name for a temporary file of this process, see `remove_leftovers`."""
    own = f"{this_process().name}-{time.monotonic_ns()}"
    return path.with_name(f".{path.name[:40]}.{own}.tmp")


def write(path: Path, content: str | bytes) -> None:
    """Write a file whole or not at all.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    try:
        _write(path, content)
    except OSError as error:
        raise InputError(
            str(path), f"cannot be written ({reason(error)})", "give another place"
        ) from None


def append(path: Path, content: bytes) -> None:
    """Add to a file that is there.

    Raises
    ------
    OSError
        If it cannot be written, or is a link.
    """
    with open(os.open(path, os.O_WRONLY | os.O_APPEND | _SAFE), "wb", buffering=0) as file:
        if file.write(content) != len(content):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all, in a folder that is made if need be.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            str(path), f"cannot be written ({reason(error)})", "give another folder"
        ) from None
    write(path, text)


def write_all(folder: Path, contents: Mapping[str, Content]) -> list[str]:
    """Write files to a folder, each of them that can be written.

    Parameters
    ----------
    folder : Path
    contents : mapping
        What makes each file's content, by the file's name relative to the folder. Folders in it
        are made; one that is a link is refused.

    Returns
    -------
    list of str
        The names.

    Raises
    ------
    NotWrittenError
        In the end, if some could not be written.
    """
    written: list[str] = []
    failed: dict[str, str] = {}
    for name, content in contents.items():
        try:
            make_inside(folder, Path(name).parent)
            _write(folder / name, content())
        except OSError as error:
            failed[name] = reason(error)
        else:
            written.append(name)
    if failed:
        raise NotWrittenError(str(folder), written, failed)
    return written


def _write(path: Path, content: str | bytes) -> None:
    """Write a result; the records, which tell what is whole, are on the disk from then on."""
    data = content.encode() if isinstance(content, str) else content
    put(path, data, FOR_ALL, durable=path.suffix == ".json")


def make_inside(folder: Path, inner: Path) -> None:
    """Make a folder inside another one.

    Raises
    ------
    OSError
        If it cannot be made, or is a link: what is written there would land elsewhere.
    """
    for part in inner.parts:
        folder = folder / part
        if folder.is_symlink():
            raise NotADirectoryError(f"{folder.name} is a link")
        folder.mkdir(exist_ok=True)


# Reading.


def read_plain(path: Path, most: int = -1) -> tuple[bytes, os.stat_result]:
    """Return the content and the status of a plain file: no folder, pipe or device.

    Parameters
    ----------
    path : Path
    most : int
        Bytes to read at most; all if negative.

    Raises
    ------
    OSError
        If it cannot be read.
    """
    with open_plain(path) as file:
        return file.read(most), os.fstat(file.fileno())


def is_there(path: Path) -> bool:
    """Return whether a file can be read, as it is or from its compressed form."""
    return path.exists() or path.with_name(path.name + PACKED).exists()


@contextlib.contextmanager
def open_plain(path: Path) -> Iterator[BinaryIO]:
    """Open a plain file, or where there is none its compressed form, for reading."""
    packed = path.with_name(path.name + PACKED)
    if not os.path.lexists(path) and packed.exists():
        with open_plain(packed) as file, lzma.open(file) as content:
            try:
                yield cast(BinaryIO, content)
            except (lzma.LZMAError, EOFError) as error:
                raise OSError(f"damaged: {error}") from None
        return
    descriptor = os.open(path, os.O_RDONLY | _SAFE & ~_NO_LINK)
    if not stat.S_ISREG(mode := os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise IsADirectoryError("a folder") if stat.S_ISDIR(mode) else OSError("not a plain file")
    with open(descriptor, "rb") as file:
        yield file


def read_bounded(path: Path, most: int = LARGEST_RECORD) -> bytes:
    """Return the content of a plain file of at most `most` bytes.

    Raises
    ------
    OSError, ValueError
        If it is no such file or cannot be read; if it is too long.
    """
    return bounded(read_plain(path, most + 1)[0], most)


def bounded(content: bytes, most: int) -> bytes:
    """Return what was read, or raise `ValueError` if it is longer than admitted."""
    if len(content) > most:
        raise ValueError(f"longer than {most} bytes")
    return content


def reason(error: Exception) -> str:
    """Return why the system refused something, in its words."""
    return str(getattr(error, "strerror", None) or error)


# What killed processes leave behind.


def remove_leftovers(folder: Path) -> None:
    """Remove temporary files and folders of processes that have ended."""
    try:
        names = os.listdir(folder)
    except OSError:
        return
    for name in names:
        if (match := LEFT.fullmatch(name)) and _left(folder / name, *match.groups()):
            _remove(folder / name)


def _remove(path: Path) -> None:
    """Remove a file or a folder; what cannot be removed stays."""
    import shutil

    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
        return
    with contextlib.suppress(OSError):
        path.unlink()


def _left(path: Path, machine: str, pid: str, start: str) -> bool:
    """Whether a temporary file's process has ended."""
    if machine == digest_of(host()):
        return not running(int(pid), "" if start == "0" else start)
    try:
        return time.time() - path.lstat().st_mtime > DAY
    except OSError:
        return False
