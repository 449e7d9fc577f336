"""``contimpact report``: measure error against run time."""

from __future__ import annotations

import argparse

from ..accuracy.output import write_report
from ..accuracy.report import report
from ..result_folder import held
from ..scene import load_scene
from .console import progress


def command(options: argparse.Namespace) -> int:
    """Measure a scene; returns the exit status."""
    scene = load_scene(options.scene)
    tell = progress(options.quiet)
    with held(options.output) as folder:
        data = report(scene, options.repetitions, tell)
        tell("")
        formats = () if options.no_plot else scene.plot.formats
        files = write_report(data, folder, formats)
    if not options.quiet:
        fair = data["honesty"]
        print(
            f"{fair['confirmed']} of {fair['events']} events confirmed in {data['digits']} digits, "
            f"{fair['within_estimate']} within their estimated error"
        )
        print(f"written to {folder}: {', '.join(files)}")
    return 0
