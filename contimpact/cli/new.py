"""``contimpact new`` and ``contimpact systems``: a scene to start from, and all systems."""

from __future__ import annotations

import argparse

from ..results.new_scene import new_scene
from ..systems import list_systems, summary
from .terminal import say


def command(options: argparse.Namespace) -> int:
    """Print a scene, or the names of all systems; returns the exit status."""
    if options.kind is not None:
        say(new_scene(options.kind))
        return 0
    for name, kind in list_systems().items():
        say(f"{name:<18} {summary(kind)} ({kind.__name__})")
    return 0
