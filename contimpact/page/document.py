"""The page as one file: template, styles, scripts and data, under a policy that forbids requests.

In a notebook it is live, in a frame of its own.

Nothing in the file is loaded from elsewhere. The policy in its head admits the two scripts and the
style sheet by their digests and nothing else; data stand in a block that is never executed.
"""

from __future__ import annotations

import base64
import hashlib
import html
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import InputError, explain_arguments, printable, short_repr
from ..models.model import Model
from ..progress import Progress
from ..results.branch import Branch, model_at
from ..results.catalogue import Motion, Share, read_fractions
from ..results.diagram import Diagram
from ..results.quantities import NO_WALL, WALLS, WALLS_ON_DARK
from ..storage import is_there, write
from .data import PageView, SweepSeries, page_data, read_sweep, script_json

NAME = "diagram.html"
FOLDER = Path(__file__).parent
LIBRARY = "vendor/d3.min.js"
SCRIPTS = (
    *("data", "state", "numbers", "shape", "chart", "diagram", "pointer", "labels", "bands"),
    *("motion", "machine", "orbit", "moving", "catalogue", "plane", "areas", "files", "main"),
)
"""Our own scripts, in the order in which they stand on each other."""
PALETTE = {
    name: " ".join(f"--wall{k}: {colour.lower()};" for k, colour in enumerate(colours)) + further
    for name, colours, further in (
        ("walls", WALLS, f" --none: {NO_WALL};"),
        ("walls_on_dark", WALLS_ON_DARK, ""),
    )
}
"""The colours of walls as the style sheet declares them, those of pictures."""


def page_text(data: Mapping[str, Any]) -> str:
    """Return the page of what `data.page_data` returns."""
    style = _fill_template(_asset("page.css"), PALETTE)
    library = _asset(LIBRARY)
    script = "\n".join(
        ["(() => {", '"use strict";', *(_asset(f"scripts/{name}.js") for name in SCRIPTS), "})();"]
    )
    parts = {
        "policy": _policy([library, script], [style]),
        "title": html.escape(f"{printable(data['name'])} - contimpact"),
        "style": style,
        "library": library,
        "data": script_json(data),
        "script": script,
    }
    return _fill_template(_asset("page.html"), parts)


def _fill_template(template: str, parts: Mapping[str, str]) -> str:
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], template)


def page_of_folder(
    folder: Path,
    diagram: Diagram,
    model: Model | None,
    shown: PageView,
    progress: Progress,
    motions: Sequence[Motion],
) -> str:
    """Return the page of a folder of results, with what a simulation has left in it."""
    swept, fractions = attractors_in(folder, model), fractions_in(folder)
    return page_text(page_data(diagram, model, shown, swept, progress, fractions, motions))


def attractors_in(folder: Path, model: Model | None) -> list[SweepSeries]:
    """Return the attractors that a simulation has left in a folder, if one has."""
    path = folder / "sweep.csv"
    return read_sweep(path, model) if model is not None and is_there(path) else []


def fractions_in(folder: Path) -> tuple[str, list[Share]] | None:
    """Return the basin fractions that a simulation has left in a folder, if one has."""
    path = folder / "fractions.csv"
    return read_fractions(path) if is_there(path) else None


def _asset(name: str) -> str:
    """A file of the package, with the line ends that browsers see."""
    return (FOLDER / name).read_bytes().decode().replace("\r\n", "\n")


def _policy(scripts: Sequence[str], styles: Sequence[str]) -> str:
    """A content security policy: our scripts and styles, pictures made by them, nothing else."""
    return "; ".join(
        [
            "default-src 'none'",
            f"script-src {' '.join(map(_digest, scripts))}",
            f"style-src {' '.join(map(_digest, styles))}",
            "img-src blob: data:",
            "base-uri 'none'",
            "form-action 'none'",
        ]
    )


def _digest(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


# The page in a notebook: live, in a frame of its own.

HEIGHT = 760
"""Pixels that a frame is high."""


@dataclass(frozen=True, repr=False)
class NotebookPage:
    """A page that a notebook shows in a frame, without a network and without the kernel."""

    name: str
    text: str
    """The page."""
    height: int = HEIGHT
    """Pixels that the frame is high."""

    def __repr__(self) -> str:
        size = len(self.text.encode()) / 1e6
        return f"Page of {self.name}: {size:.1f} MB, shown where it ends a cell of a notebook"

    def _repr_html_(self) -> str:
        page = html.escape(self.text).encode("ascii", "xmlcharrefreplace").decode()
        return (
            f'<iframe title="{html.escape(self.name)}" sandbox="allow-scripts allow-downloads" '
            f'style="width: 100%; height: {self.height:d}px; border: 0" '
            f'srcdoc="{page}"></iframe>'
        )

    def save(self, path: str | Path) -> None:
        """Write the page to a file.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        write(Path(path), self.text)


@explain_arguments
def view(
    diagram: Diagram | Branch,
    model: Model | None = None,
    *,
    x: str | None = None,
    xlim: tuple[float, float] | None = None,
    ylim: tuple[float, float] | None = None,
    unphysical: str = "period-1",
    height: int = HEIGHT,
) -> NotebookPage:
    """Return the page of a diagram for a notebook: a click on the diagram moves the orbit.

    Parameters
    ----------
    diagram : Diagram or Branch
    model : Model, optional
        The system, where its name does not tell; without one that is known no orbits are drawn.
    x : str, optional
        Parameter on the x axis, the one that is followed unless set.
    xlim, ylim : tuple of float, optional
        Limits of the axes.
    unphysical : {"none", "period-1", "all"}
        Which unphysical orbits are drawn.
    height : int
        Pixels that the frame is high.

    Returns
    -------
    NotebookPage
        Shows itself where it ends a cell; its `save` writes the page to a file.

    Raises
    ------
    InputError
        For a diagram without branches and curves, or a parameter that it does not have.
    """
    if isinstance(diagram, Branch):
        diagram = Diagram(diagram.id, [diagram])
    if not diagram.branches and not diagram.curves:
        raise InputError("diagram", "there is nothing in it", "give one with branches or curves")
    first = diagram.branches[0] if diagram.branches else None
    known = list(first.parameters) if first else []
    chosen = x or (first.parameter if first else diagram.curves[0].parameters[0])
    if first and chosen not in known:
        raise InputError("x", f"no branch has {short_repr(chosen)}", f"give {', '.join(known)}")
    shown = PageView(chosen, xlim, ylim, unphysical)
    text = page_text(page_data(diagram, _model_of(first, model), shown))
    return NotebookPage(printable(diagram.name), text, height)


def _model_of(branch: Branch | None, given: Model | None) -> Model | None:
    """The model of a branch; None where its system is not known."""
    if branch is None or given is not None:
        return given
    try:
        return model_at(branch, 0)
    except InputError:
        return None
