"""``contimpact fit``: estimate parameters of a scene from measured impacts."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from ..errors import InputError
from ..orbits.fitting import fit
from ..results.options import FORMATS
from ..results.scene import load_scene, systems_of
from ..telling import telling
from .terminal import say


def command(options: argparse.Namespace) -> int:
    """Fit, print, and draw the residuals; returns the exit status."""
    scene = load_scene(options.scene, systems_of(options.system))
    target = Path(options.output or "")
    kind = target.suffix.lower().lstrip(".")
    if options.output and kind not in FORMATS:
        raise InputError("-o", f"format {kind!r}", f"accepted are {', '.join(FORMATS)}")
    deviations = dict(map(_deviation, options.deviation))
    with telling(scene.name, patient=True) as tell:
        tell("fitting")
        found = fit(
            scene.model,
            options.orbit or scene.orbits,
            options.data,
            options.parameter,
            deviations=deviations or None,
            clock=not options.no_clock,
            rng=scene.seed,
        )
    say(repr(found))
    if options.output:
        from ..plots.diagram import write_figure
        from ..plots.fit import plot_fit

        write_figure(plot_fit(found)[0].figure, target, kind, scene.name)
        say(f"written to {target}")
    return 0 if found.reason is None else 1


def _deviation(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if name not in ("time", "velocity") or not 0.0 < number < math.inf:
        raise InputError("--deviation", repr(text), "give time=NUMBER or velocity=NUMBER")
    return name, number
