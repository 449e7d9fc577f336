"""``contimpact design``: the orbit of which an output is largest, at a margin from its events."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..diagrams.design import design
from ..diagrams.explore import INTERRUPTED
from ..errors import InputError
from ..results.scene import load_scene, systems_of
from ..storage.files import write_text
from ..telling import telling
from .console import Interruption, defer_interruptions
from .terminal import complain, say


def command(options: argparse.Namespace) -> int:
    """Design, print, and write the table; returns the exit status."""
    scene = load_scene(options.scene, systems_of(options.system))
    if options.output and Path(options.output).suffix != ".csv":
        raise InputError("-o", f"found {options.output!r}", "give a file that ends in .csv")
    with telling(scene.name, patient=True) as tell:
        found = design(scene, progress=tell)
    with defer_interruptions(Interruption()):
        say(repr(found))
        if options.output:
            write_text(Path(options.output), found.table())
            say(f"written to {options.output}")
    if found.interrupted:
        complain(f"{INTERRUPTED} ({found.interrupted}); what is shown was found until then")
        return 1
    return 0 if found.best is not None or found.chaos is not None else 1
