"""``contimpact report``: measure error against run time."""

from __future__ import annotations

import argparse

from ..accuracy.output import write_report
from ..accuracy.report import report
from ..results.result_folder import hold_folder
from ..results.scene import load_scene, systems_of
from ..telling import telling
from .terminal import say


def command(options: argparse.Namespace) -> int:
    """Measure a scene; returns the exit status."""
    scene = load_scene(options.scene, systems_of(options.system))
    with hold_folder(options.output) as folder:
        with telling(scene.name, options.quiet) as tell:
            data = report(scene, options.repetitions, tell)
        formats = () if options.no_plot else scene.plot.formats
        files = write_report(data, folder, formats)
    if not options.quiet:
        fair = data["honesty"]
        say(
            f"{fair['confirmed']} of {fair['events']} events confirmed in {data['digits']} digits, "
            f"{fair['within_estimate']} within their estimated error"
        )
        say(f"written to {folder}: {', '.join(files)}")
    return 0
