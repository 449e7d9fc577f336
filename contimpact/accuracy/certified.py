"""What proofs cost: seconds for each entry, and for each tube of a branch."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any

from ..diagrams.explore import follow
from ..errors import InputError
from ..results.scene import Scene
from .timing import spread


def certified(scene: Scene, progress: Callable[[str], None]) -> dict[str, Any] | None:
    """Return what it costs to certify a scene; None where it has no [certify].

    Raises
    ------
    InputError
        If what proofs are made with is not installed.
    """
    if scene.certify is None:
        return None
    if importlib.util.find_spec("flint") is None:
        lacking = "python-flint, which proofs are made with, is not installed"
        raise InputError("certify", lacking, "pip install contimpact[certify]")
    from ..certificates.certify import certify

    found = certify(follow(scene), options=scene.certify, progress=progress)
    return {
        "entries": len(found.entries),
        "certified": len(found.entries) - len(found.rejected),
        "radius": max((c.certified_radius or 0.0 for c in found.entries), default=0.0),
        "per_entry": spread([c.seconds for c in found.entries]) if found.entries else None,
        "branches": [
            {
                "id": c.id,
                "word": c.word,
                "period": c.period,
                "complete": c.complete,
                "share": c.share,
                "tubes": c.tubes,
                "per_tube": c.seconds / max(c.tubes, 1),
            }
            for c in found.branches
        ],
    }
