"""The page, as the commands write it; what makes it is imported when it is asked for."""

from __future__ import annotations

import argparse

from ..results.diagram import Diagram
from ..results.result_folder import Files
from ..results.scene import Scene


def page_wanted(scene: Scene, options: argparse.Namespace) -> bool:
    """Return whether the scene or the command line asks for the page."""
    return bool(scene.plot.html or options.html)


def add_page(scene: Scene, diagram: Diagram, files: Files) -> None:
    """Write the page of a run; the attractors of a simulation in the folder are a layer of it."""
    from ..page.data import Shown, remarks_in
    from ..page.document import save_page

    plot = scene.plot
    remarks = remarks_in(diagram.statistics, diagram.coverage)
    shown = Shown(plot.x, plot.xlim, plot.ylim, plot.unphysical, scene.source, remarks)
    files.add(lambda: save_page(diagram, scene.model, files.folder, shown))
