"""How results show themselves: short texts, tables and pictures in notebooks, data frames.

A result says what it is as a `Summary`; everything else follows. Functions that draw pictures
register themselves with `draw_result`, loaded when a notebook asks for one: what holds results
knows of no pictures.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import InputError, did_you_mean, explain_arguments, missing, printable, short_repr

LINES = 10
"""Largest number of lines in a text that shows a result."""
ROWS = 20
"""Largest number of rows in a table of a notebook."""
DRAWN = (
    "branches, diagrams, curves, orbits, events, attractors, runs, sweeps, basins, fractions, "
    "ranges, manifolds, fits and studies"
)


@dataclass(frozen=True)
class Summary:
    """A result in short: what it is, a table, and remarks."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]
    notes: Sequence[str] = ()


class Named:
    """What answers an attribute that it does not have with what gives it instead."""

    if not TYPE_CHECKING:  # where types are read, an attribute that is not there is a mistake

        def __getattr__(self, name: str) -> Any:
            raise missing(self, name)


class ParameterItems(Named):
    """What has values of parameters, which are its items."""

    parameters: Any
    """Mapping of names to values."""

    __iter__ = None
    """Parameters are looked up; what is iterated over is said elsewhere."""

    def __getitem__(self, name: str) -> float:
        """Return the value of a parameter, or of a derived parameter."""
        known: Mapping[str, float] = self.parameters
        if isinstance(name, str) and name in known:
            return known[name]
        kind, hint = type(self).__name__.lower(), did_you_mean(str(name), known)
        text = f"{kind} has no parameter {short_repr(name)}{hint}"
        raise KeyError(f"{text}; it has {', '.join(known) or 'none'}")

    def __contains__(self, name: object) -> bool:
        return name in self.parameters

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.parameters)


class NotebookResult(Named):
    """What shows itself in a notebook as a table and a picture, and can be plotted."""

    def summary(self) -> Summary:
        """Return what the result is in short: a title, a table, and remarks."""
        raise NotImplementedError

    def plot(self, *x: Any, **options: Any) -> Any:
        """Draw the result; see `contimpact.plot`."""
        return plot(self, *x, **options)

    def _repr_html_(self) -> str:
        return table_of(self.summary())

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> dict[str, Any]:
        """What Jupyter shows: the table with the picture, or the text where there is no HTML."""
        text = self._repr_html_() + picture_of(self)
        return {"text/plain": repr(self), "text/html": text}


def limit_lines(
    head: str, rows: Sequence[str], tail: Sequence[str] = (), ahead: Sequence[str] = ()
) -> str:
    """Return a text of at most `LINES` lines; of the rows the last ones are left out and counted.

    Lines `ahead` stand before the rows, those of the `tail` after them.
    """
    room = LINES - 1 - len(ahead) - len(tail)
    if len(rows) > room:
        kept = max(room - 1, 1)
        rows = [*rows[:kept], f"  ... and {len(rows) - kept} more"]
    return "\n".join(map(printable, [head, *ahead, *rows, *tail]))


def table_of(summary: Summary) -> str:
    """Return a summary as HTML; whatever is in it is text, not markup."""
    head = "".join(f"<th>{_cell(name)}</th>" for name in summary.columns)
    rows = ["".join(f"<td>{_cell(cell)}</td>" for cell in row) for row in summary.rows[:ROWS]]
    left = len(summary.rows) - len(rows)
    notes = [*([f"... and {left} more"] if left > 0 else []), *summary.notes]
    body = "".join(f"<tr>{row}</tr>" for row in rows)
    below = "".join(f"<p>{_cell(note)}</p>" for note in notes)
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>" if rows else ""
    return f"<div><p><strong>{_cell(summary.title)}</strong></p>{table}{below}</div>"


def _cell(value: Any) -> str:
    import html

    text = f"{value:.10g}" if isinstance(value, float) else str("" if value is None else value)
    return html.escape(printable(text))


@explain_arguments
def plot(result: Any, *x: Any, **options: Any) -> Any:
    """Draw a result.

    Parameters
    ----------
    result : Branch, Orbit, Diagram, Curve, Entry, Attractor, Run, Sweep, Basins, Manifold, Study
        Branches, curves, or orbits and events also as a list.
    *x
        Of branches, diagrams and sweeps what is on the x axis; of a study the quantity.
    **options
        Of the function that draws it: `plot_diagram` for branches and diagrams, `plot_orbit` for
        orbits and events, `plot_curves`, `plot_sweep`, `plot_basins`, `plot_manifold`; `model` of
        attractors and runs that were read from a file; for a study, `quantity` and the options of
        `Study.map`.

    Returns
    -------
    matplotlib.axes.Axes
        Of the picture; several where that function returns several.

    Raises
    ------
    InputError
        If it cannot be drawn.
    """
    from . import load_painters

    load_painters()
    return draw_result(result, *x, **options)


@functools.singledispatch
def draw_result(result: Any, *x: Any, **options: Any) -> Any:
    """Draw a result and return the axes.

    Raises InputError if it cannot be drawn.
    """
    found = f"found {short_repr(result)}"
    if isinstance(result, str | Path):
        raise InputError("picture", found, "give a result, as contimpact.load reads it")
    raise InputError("picture", found, f"there are pictures of {DRAWN}")


def picture_of(result: Any) -> str:
    """Return a result's picture as an HTML image, or why there is none."""
    import base64

    try:
        axes = plot(result)
    except InputError as error:
        return f"<p>no picture: {_cell(error)}</p>"
    figure = (axes[0] if isinstance(axes, Sequence) else axes).figure
    data = base64.b64encode(figure._repr_png_()).decode()
    title = _cell(result.summary().title)
    return f'<img alt="{title}" style="max-width: 100%" src="data:image/png;base64,{data}">'


def frame(columns: Mapping[str, Any] | Sequence[Mapping[str, Any]]) -> Any:
    """Return columns, or rows as mappings, as a pandas DataFrame.

    Raises InputError if pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        found = "pandas is not installed"
        raise InputError("to_dataframe", found, "pip install 'contimpact[data]'") from None
    return pandas.DataFrame(columns if not isinstance(columns, Mapping) else dict(columns))
