"""The folder of what is generated once and kept: kernels, and compiled code.

What is in it is executed. So only what this user alone can have written is taken from it: the
folder and every file must belong to the user, and nobody else may be allowed to write them.
"""

from __future__ import annotations

import functools
import os
import sys
from pathlib import Path
from typing import Any

from .files import put, read_plain, reason, remove_leftovers


def logger(name: str) -> Any:
    """Return a logger; `logging` is imported when there is something to say."""
    import logging

    return logging.getLogger(name)


def cache_folder() -> Path | None:
    """Return the folder, or None if it cannot be used or could be written by others.

    ``CONTIMPACT_CACHE`` names it; otherwise it is the platform's folder for caches.
    """
    try:
        folder = _absolute_folder()
    except (OSError, RuntimeError) as error:  # no home; a working folder that is gone
        _warn(f"no folder for them is known ({error}); name one by CONTIMPACT_CACHE")
        return None
    if fault := _fault(folder):
        _warn(f"{folder} {fault}; name another folder by CONTIMPACT_CACHE")
        return None
    _remove_leftovers(folder)
    return folder


def _fault(folder: Path) -> str | None:
    """Why a folder is not used; it is made if need be."""
    try:
        _make_folder(folder)
        return distrust_reason(folder.stat())
    except (OSError, ValueError) as error:
        return f"cannot be used ({reason(error)})"


def _absolute_folder() -> Path:
    """The folder's absolute path: a relative one could be taken for an option or a library."""
    if named := os.environ.get("CONTIMPACT_CACHE"):
        return Path(named).expanduser().absolute()
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home()) / "contimpact" / "cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "contimpact"
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (given if given.is_absolute() else Path.home() / ".cache") / "contimpact"


def _make_folder(folder: Path) -> None:
    """Make a folder, and those above it, for this user alone, whatever the umask."""
    if folder.is_dir():
        return
    _make_folder(folder.parent)
    try:
        folder.mkdir(0o700)
    except FileExistsError:  # another process was quicker, or it is a file
        if not folder.is_dir():
            raise
    else:
        folder.chmod(0o700)


def distrust_reason(status: os.stat_result) -> str | None:
    """Return why a file or folder is not relied on; None if only this user can have written it."""
    if not hasattr(os, "geteuid"):  # Windows: the user's folders are closed to others
        return None
    if status.st_uid != os.geteuid():
        return f"belongs to another user (number {status.st_uid})"
    if status.st_mode & 0o022:
        return "may be written by others, so empty it and take their permission away"
    return None


@functools.cache
def _warn(why: str) -> None:
    """Say once in a process why nothing is cached."""
    logger(__name__).warning("kernels and compiled code are not cached: %s", why)


@functools.cache
def _remove_leftovers(folder: Path) -> None:
    """Remove, once in a process, what killed ones have left behind."""
    remove_leftovers(folder)


def store_file(path: Path, content: bytes) -> None:
    """Put a file into the cache, for this user alone.

    Raises OSError if it cannot be written.
    """
    put(path, content, 0o600)


def load_file(path: Path) -> bytes:
    """Return the content of a file in the cache.

    Raises OSError if it cannot be read, or somebody else could have written it.
    """
    content, status = read_plain(path)
    if fault := distrust_reason(status):
        raise PermissionError(f"it {fault}")
    return content
