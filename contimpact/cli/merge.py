"""``contimpact catalogue``: merge the catalogues of several folders."""

from __future__ import annotations

import argparse

from ..results.formats import FILES, merge, write_merged
from ..results.result_folder import hold_folder
from ..telling import telling
from .console import require_output
from .terminal import say


def command(options: argparse.Namespace) -> int:
    """Merge catalogues; returns the exit status."""
    require_output(options)
    with telling("catalogue", patient=True) as tell:
        tell("reading")
        merged = merge(options.folders)
    with hold_folder(options.output, FILES) as folder:
        files = write_merged(merged, folder)
    count, scenes = len(merged["entries"]), len(merged["sources"])
    say(f"{count} entries of {scenes} scenes written to {folder}: {', '.join(files)}")
    return 0
