"""``contimpact view``: open the page of a folder in the browser."""

from __future__ import annotations

import argparse
import webbrowser
from pathlib import Path

from ..results.result_folder import kept_still
from ..telling import telling
from .plot import draw_page
from .terminal import complain, say


def command(options: argparse.Namespace) -> int:
    """Write the page of a folder anew and open it; returns the exit status.

    A page that is there already is not opened: in a folder of somebody else it may be anything.
    """
    target = Path(options.folder) / "diagram.html"
    with kept_still(target.parent), telling(target.parent.name, patient=True) as tell:
        tell("reading")
        draw_page(target.parent, target, None, tell)
    say(f"written to {target}")
    if webbrowser.open(target.resolve().as_uri()):
        return 0
    complain(f"no browser could be started; open {target} in one")
    return 1
