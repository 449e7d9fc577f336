"""Names of scenes, and the folders that results have in a run of several scenes.

A name is any text of one line. Its folder is the name itself, with what not every file system can
hold in it as ``%`` and two hexadecimal digits for each byte, as in addresses: no two names have one
folder. Names that would be too long so are cut, and end with a digest of the whole.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence

from ..errors import InputError, shown

LONGEST_NAME = 200
"""Bytes of a name in UTF-8, and of a folder."""

_DIGEST = 16
_UNSAFE = re.compile(r'[/\\<>:"|?*]|%(?=[0-9A-Fa-f]{2})|^\.|[. ]\Z')
_RESERVED = re.compile(r"(?:con|prn|aux|nul|com\d|lpt\d)(?:\.|$)", re.IGNORECASE)
"""Names of devices, with or without an ending."""


def checked_name(name: str) -> str:
    """Return a scene's name, or raise `InputError` if it cannot be one."""
    if not name.strip() or not name.isprintable():
        accepted = "give a text of one line without control characters"
        raise InputError("name", f"found {shown(name)}", accepted)
    if len(name.encode()) > LONGEST_NAME:
        raise InputError(
            "name", f"found {shown(name)}", f"give a name of at most {LONGEST_NAME} bytes in UTF-8"
        )
    return name


def folder_of(name: str) -> str:
    """Return what the folder of a scene's results is called."""
    safe = _UNSAFE.sub(lambda found: _escaped(found[0]), name)
    if _RESERVED.match(safe):
        safe = _escaped(safe[0]) + safe[1:]
    if len(safe.encode()) <= LONGEST_NAME:
        return safe
    from hashlib import sha256

    digest = sha256(name.encode()).hexdigest()[:_DIGEST]
    kept = safe.encode()[: LONGEST_NAME - _DIGEST - 1].decode(errors="ignore")
    return f"{kept}-{digest}"


def _escaped(text: str) -> str:
    return "".join(f"%{byte:02X}" for byte in text.encode())


def require_own_folders(names: Sequence[str]) -> None:
    """Refuse two names with one folder, capital and small letters being alike on some systems.

    Raises
    ------
    InputError
        If there are such names.
    """
    known: dict[str, str] = {}
    for name in names:
        folder = unicodedata.normalize("NFC", folder_of(name)).casefold()
        if (other := known.get(folder)) is not None:
            found = f"two scenes are called {shown(name)}"
            if other != name:
                found = f"{shown(other)} and {shown(name)} are one folder on some systems"
            raise InputError("SCENE", found, "give each its own name")
        known[folder] = name
