"""The manifest of a folder of results: what was asked, what ran, its cost, what was left out."""

from __future__ import annotations

import platform
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from .. import __version__
from ..segments.compiling import mode, ran_plainly, used
from ..storage.texts import json_text
from .result_folder import MANIFEST


def manifest_text(
    scene: Mapping[str, Any],
    given: Mapping[str, Any],
    left_out: Sequence[str],
    statistics: Mapping[str, Any],
    files: Sequence[str],
    digests: Mapping[str, str],
) -> str:
    """Return ``manifest.json``: what was asked, what ran, what it cost, what was left out.

    `digests` are those of the catalogue and the tables beside it.
    """
    versions = {"contimpact": __version__, "python": platform.python_version()}
    for name in ("numpy", "scipy", "sympy", "matplotlib"):
        if name in sys.modules:
            versions[name] = sys.modules[name].__version__
    return json_text(
        {
            "schema": MANIFEST,
            "versions": versions,
            "scene": {"given": given, "resolved": scene},
            **statistics,
            "compiled": {"mode": mode(), "programs": used(), "plainly": ran_plainly()},
            "modules": _modules(),
            "left_out": list(left_out),
            "files": sorted(set(files)),
            "sha256": dict(digests),
        }
    )


def _modules() -> list[str]:
    """The package's modules that were imported, and the libraries among its dependencies."""
    own = [name for name in sys.modules if name.split(".")[0] == "contimpact"]
    libraries = ("numpy", "scipy", "sympy", "mpmath", "matplotlib", "numba")
    return sorted(own) + [name for name in libraries if name in sys.modules]
