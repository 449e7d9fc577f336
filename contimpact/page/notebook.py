"""The page in a notebook: live, in a frame of its own."""

from __future__ import annotations

import html
from dataclasses import dataclass
from pathlib import Path

from ..errors import InputError, explain_arguments, printable, short_repr
from ..models.model import Model
from ..results.branch import Branch, model_at
from ..results.diagram import Diagram
from ..storage.files import write
from .data import PageView
from .document import page_text

HEIGHT = 760
"""Pixels that a frame is high."""


@dataclass(frozen=True, repr=False)
class NotebookPage:
    """A page that a notebook shows in a frame, without a network and without the kernel.

    Attributes
    ----------
    name : str
    text : str
        The page.
    height : int
        Pixels that the frame is high.
    """

    name: str
    text: str
    height: int = HEIGHT

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
    text = page_text(diagram, _model_of(first, model), shown)
    return NotebookPage(printable(diagram.name), text, height)


def _model_of(branch: Branch | None, given: Model | None) -> Model | None:
    """The model of a branch; None where its system is not known."""
    if branch is None or given is not None:
        return given
    try:
        return model_at(branch, 0)
    except InputError:
        return None
