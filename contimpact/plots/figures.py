"""Figures that notebooks show by themselves, without a backend."""

from __future__ import annotations

import io
from typing import Any

import matplotlib.figure

DOTS = 100
"""Per inch, in notebooks."""


class Figure(matplotlib.figure.Figure):
    """A figure that is its own picture in Jupyter."""

    def _repr_png_(self) -> bytes:
        return png_of(self)


def png_of(figure: Any, dots: float = DOTS) -> bytes:
    """Return a figure as PNG."""
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=dots)
    return content.getvalue()
