"""``contimpact range``: which attractors a folder knows, where, and how far their ends are."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from ..diagrams.ranges import load_ranges, ranges_text
from ..results.catalogue import scene_in
from ..results.result_folder import kept_still
from ..results.scene import systems_of
from ..storage.files import is_there, write_all
from ..telling import telling
from .terminal import say


def command(options: argparse.Namespace) -> int:
    """Print the attractors along the parameter, or at some values; returns the exit status."""
    folder, systems = Path(options.folder), systems_of(options.system)
    with kept_still(folder), telling(folder.name, patient=True) as tell:
        tell("reading")
        alone = is_there(folder / "sweep.csv") and not is_there(folder / "catalogue.json")
        found = load_ranges(folder, scene_in(folder, systems).model if alone else None)
    for value in options.at:
        say(found.describe(value))
    if not options.at:
        say(repr(found))
    if options.output:
        target = Path(options.output)
        write_all(target.parent, {target.name: partial(ranges_text, found)})
        say(f"written to {target}")
    return 0
