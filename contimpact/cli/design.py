"""``contimpact design``: the orbit of which an output is largest, at a margin from its events."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..diagrams.design import design
from ..errors import InputError
from ..results.scene import load_scene, systems_of
from ..storage.files import write_text
from ..telling import telling
from .terminal import say


def command(options: argparse.Namespace) -> int:
    """Design, print, and write the table; returns the exit status."""
    scene = load_scene(options.scene, systems_of(options.system))
    if options.output and Path(options.output).suffix != ".csv":
        raise InputError("-o", f"found {options.output!r}", "give a file that ends in .csv")
    with telling(scene.name, patient=True) as tell:
        found = design(scene, progress=tell)
    say(repr(found))
    if options.output:
        write_text(Path(options.output), found.table())
        say(f"written to {options.output}")
    return 0 if found.best is not None or found.chaos is not None else 1
