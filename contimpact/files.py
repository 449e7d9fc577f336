"""Files written whole or not at all."""

from __future__ import annotations

import os
import time
from pathlib import Path

from .errors import InputError


def put(path: Path, content: bytes) -> None:
    """Put a whole file in place at once: another process may be writing or reading it.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    own = f"{os.getpid()}-{time.monotonic_ns()}"
    temporary = path.with_name(f".{path.name[:80]}.{own}.tmp")
    try:
        with open(temporary, "xb") as file:
            file.write(content)
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all, in a folder that is made if need be.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        put(path, text.encode())
    except OSError as error:
        raise InputError(
            str(path), f"cannot be written ({reason(error)})", "give another folder"
        ) from None


def reason(error: Exception) -> str:
    """Return why the system refused something, in its words."""
    return str(getattr(error, "strerror", None) or error)
