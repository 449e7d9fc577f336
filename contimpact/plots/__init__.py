"""All pictures. The only modules that import matplotlib.

Pictures are drawn on the canvas of their format; no backend is asked for, so one that does not
exist, named in ``MPLBACKEND``, does no harm.
"""

from __future__ import annotations

import contextlib
import os
import sys


def _import_matplotlib() -> None:
    """Import matplotlib, which cannot be imported while ``MPLBACKEND`` names no backend."""
    named = os.environ.pop("MPLBACKEND", None)
    try:
        import matplotlib
    finally:
        if named is not None:
            os.environ["MPLBACKEND"] = named
    if named:
        with contextlib.suppress(ValueError):
            matplotlib.rcParams["backend"] = named


if "matplotlib" not in sys.modules:
    _import_matplotlib()
