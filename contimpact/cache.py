"""The folder of what is generated once and kept: kernels, and compiled code."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any


def logger(name: str) -> Any:
    """Return a logger; `logging` is imported when there is something to say."""
    import logging

    return logging.getLogger(name)


def cache_folder() -> Path | None:
    """Return the folder, or None if it cannot be used.

    ``CONTIMPACT_CACHE`` names it; otherwise it is the platform's folder for caches.
    """
    if named := os.environ.get("CONTIMPACT_CACHE"):
        folder = Path(named)
    elif sys.platform == "win32":
        folder = Path(os.environ.get("LOCALAPPDATA", Path.home())) / "contimpact" / "cache"
    elif sys.platform == "darwin":
        folder = Path.home() / "Library" / "Caches" / "contimpact"
    else:
        folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "contimpact"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        logger(__name__).warning("kernels and compiled code are not cached: %s", error)
        return None
    return folder
