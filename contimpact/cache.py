"""The folder of what is generated once and kept: kernels, and compiled code."""

from __future__ import annotations

import logging
import os
import sys
from pathlib import Path

log = logging.getLogger(__name__)


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
        log.warning("kernels and compiled code are not cached: %s", error)
        return None
    return folder
