"""``contimpact atlas``: maps of the studies in a store over two of their axes."""

from __future__ import annotations

import argparse
import collections
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..models.expressions import number
from ..storage.files import write_text
from ..storage.texts import csv_text
from ..studies.study import QUANTITIES, Map, Study, studies
from ..telling import telling
from .console import require_output
from .terminal import say

FORMATS = ("png", "svg", "pdf")


def command(options: argparse.Namespace) -> int:
    """Draw maps; returns the exit status."""
    require_output(options)
    given = [_value(text) for text in options.at]
    at = dict(given)
    if len(at) < len(given):
        raise InputError("--at", "two values of one axis", "give one")
    names = options.study or studies(options.store)
    folder = Path(options.output)
    with telling("atlas", options.quiet, patient=True) as tell:
        for name in names:
            with Study(options.store, name) as study:
                if not options.study and len(study.axes) < 2:
                    continue  # nothing of two axes, and nobody has asked for it
                for quantity in options.quantity or QUANTITIES:
                    tell(f"{name}: {quantity}")
                    shown = study.map(quantity, axes=options.axes, orbit=options.orbit, at=at)
                    if options.quantity or _is_known(shown).any():
                        _write(shown, study, folder, options)
    return 0


def _value(text: str) -> tuple[str, float]:
    name, sign, value = text.partition("=")
    if not sign:
        raise InputError("--at", f"found {text!r}", "give a value such as A=5")
    return name.strip(), number(value, "--at")


def _is_known(shown: Map) -> np.ndarray:
    """Where there is a value."""
    if shown.named:
        return np.array([value is not None for value in shown.values])
    return np.isfinite(shown.values)


def _write(shown: Map, study: Study, folder: Path, options: argparse.Namespace) -> None:
    from ..plots.maps import file_stem, save_map
    from ..plots.texts import units_of

    stem = file_stem(shown)
    rows = zip(shown.x.tolist(), shown.y.tolist(), shown.values.tolist(), strict=True)
    write_text(folder / f"{stem}.csv", csv_text([*shown.axes, shown.quantity], rows))
    formats = tuple(options.format or FORMATS[:1])
    if not options.no_plot:
        save_map(shown, folder, formats, units_of(study.given["model"]["system"]))
    if not options.quiet:
        say(f"{shown.study}: {shown.text}: {_summary(shown)}")
        for line in _compare_zeros(shown):
            say(f"  {line}")


def _summary(shown: Map) -> str:
    known = _is_known(shown)
    if not known.any():
        return "no values"
    if shown.named:
        counts = collections.Counter(str(v) for v in shown.values[known])
        return ", ".join(f"{name} {count}" for name, count in counts.most_common())
    low, high = shown.values[known].min(), shown.values[known].max()
    return f"{low:.6g} to {high:.6g} in {known.sum()} of {len(known)} scenes"


def _compare_zeros(shown: Map) -> list[str]:
    """How far the map's zeros are from curves of codimension two."""
    if shown.named or shown.grid() is None or not len(shown.zeros()):
        return []
    y = shown.axes[1]
    known = {kind: shown.departure(kind) for kind in shown.curves}
    return [
        f"changes its sign at {len(shown.zeros())} places along {y}",
        *(
            f"at most {far:.2g} in {y} from {kind} computed directly"
            for kind, far in known.items()
            if far is not None
        ),
    ]
