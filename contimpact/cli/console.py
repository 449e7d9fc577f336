"""What commands share: their folder, progress, manifest and page."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..progress import Progress
from ..results.diagram import Diagram
from ..results.result_folder import Files, manifest_text, sealed_names
from ..results.scene import Scene
from ..storage import digests, is_there, write_all
from . import ENDING

if TYPE_CHECKING:
    from ..models.model import Model
    from ..results.catalogue import Motion


class Interruption:
    """Whether the keyboard has interrupted, and whether that is to be raised at once."""

    happened = False
    raising = False


@contextlib.contextmanager
def defer_interruptions(interruption: Interruption) -> Iterator[None]:
    """Defer interruptions until what was computed is on disk; remember that there was one."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def note(*signalled: Any) -> None:
        interruption.happened = True
        if interruption.raising:
            interruption.raising = False
            raise KeyboardInterrupt

    heard = [n for n in ENDING if signal.getsignal(n) is not signal.SIG_IGN]
    before = {number: signal.signal(number, note) for number in heard}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler if handler is not None else signal.SIG_DFL)


def draw_pictures(
    interruption: Interruption,
    files: Files,
    tell: Progress,
    draw: Callable[[], None],
    module: str = "",
) -> bool:
    """Draw pictures; returns whether nothing has interrupted.

    Within a `defer_interruptions` block, an interruption ends the drawing at once, and after an
    earlier one nothing is drawn. Pictures that are complete by then are recorded among the files.
    The module that draws is imported before: what an interruption leaves of matplotlib cannot be
    imported again.
    """
    before = _states(files.folder)
    try:
        if module and not interruption.happened:
            importlib.import_module(module, __package__)
        interruption.raising = True
        if interruption.happened:
            raise KeyboardInterrupt
        tell("drawing")
        draw()
        interruption.raising = False
    except KeyboardInterrupt:
        interruption.raising, interruption.happened = False, True
        for name, state in _states(files.folder).items():
            if before.get(name) != state and name not in files.written:
                files.note(name, None)
        return False
    return True


def _states(folder: Path) -> dict[str, tuple[int, int]]:
    """The files of a folder, each with what changes when it is rewritten."""
    states: dict[str, tuple[int, int]] = {}
    with contextlib.suppress(OSError):  # the folder is removed meanwhile
        for path in folder.iterdir():
            state = path.stat()
            states |= {path.name: (state.st_ino, state.st_mtime_ns)} if path.is_file() else {}
    return states


# The manifest, which ends what a command writes to a folder.


def write_manifest(
    scene: Scene, files: Files, left_out: Sequence[str], statistics: Mapping[str, Any]
) -> None:
    """Write the manifest; what could not be written is said."""

    def text() -> str:
        found = digests(files.folder, sealed_names(files.written))
        known = {**statistics, "not_written": files.not_written()}
        return manifest_text(scene.resolved(), scene.given, left_out, known, files.written, found)

    files.close(text)


# The page, as the commands write it; what makes it is imported when it is asked for.


def page_wanted(scene: Scene, options: argparse.Namespace) -> bool:
    """Return whether the scene or the command line asks for the page."""
    return bool(scene.plot.html or options.html)


def motions_in(folder: Path, diagram: Diagram, model: Model, tell: Progress) -> Sequence[Motion]:
    """Return the attractors along the parameter, where a folder has branches along one parameter
    and a simulation."""
    along = {branch.parameter for branch in diagram.branches}
    if len(along) != 1 or not is_there(folder / "sweep.csv"):
        return []
    from ..diagrams.ranges import ranges_in

    tell("ranges of attractors")
    return ranges_in(folder, diagram, model).motions


def add_page(scene: Scene, diagram: Diagram, files: Files, tell: Progress) -> None:
    """Write the page of a run; the attractors of a simulation in the folder are a layer of it."""
    from ..page.data import PageView, remarks_in
    from ..page.document import NAME, page_of_folder
    from ..results.catalogue import simulation_remarks

    plot = scene.plot
    remarks = remarks_in(diagram.statistics, diagram.coverage)
    remarks += simulation_remarks(files.folder)
    begins = plot.x, plot.xlim, plot.ylim, plot.unphysical
    shown = PageView(*begins, scene.source, remarks, plot.margin)
    motions = motions_in(files.folder, diagram, scene.model, tell)
    given = files.folder, diagram, scene.model, shown, tell, motions
    files.add(lambda: write_all(files.folder, {NAME: lambda: page_of_folder(*given)}))
