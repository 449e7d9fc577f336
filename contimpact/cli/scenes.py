"""Other commands of scenes: ``contimpact new``, ``systems``, ``fit``, ``design``, ``report``."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from ..errors import InputError
from ..results.options import FORMATS
from ..results.result_folder import hold_folder
from ..results.scene import load_scene, systems_of
from ..storage.files import write_text
from ..telling import telling
from .console import Interruption, defer_interruptions
from .terminal import complain, say


def new(options: argparse.Namespace) -> int:
    """Print a scene to start from, or the names of all systems; returns the exit status."""
    from ..results.new_scene import new_scene
    from ..systems import list_systems, summary

    if options.kind is not None:
        say(new_scene(options.kind))
        return 0
    for name, kind in list_systems().items():
        say(f"{name:<18} {summary(kind)} ({kind.__name__})")
    return 0


def fit(options: argparse.Namespace) -> int:
    """Estimate parameters from measured impacts, and draw residuals; returns the exit status."""
    from ..orbits.fitting import fit as fit_impacts

    scene = load_scene(options.scene, systems_of(options.system))
    target = Path(options.output or "")
    kind = target.suffix.lower().lstrip(".")
    if options.output and kind not in FORMATS:
        raise InputError("-o", f"format {kind!r}", f"accepted are {', '.join(FORMATS)}")
    deviations = dict(map(_deviation, options.deviation))
    with telling(scene.name, patient=True) as tell:
        tell("fitting")
        found = fit_impacts(
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
        from ..plots.orbit import plot_fit

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
        raise InputError("--deviation", repr(text), "give time=NUMBER or velocity=NUMBER, above 0")
    return name, number


def design(options: argparse.Namespace) -> int:
    """Look for the orbit of which an output is largest, at a margin from its events; returns the
    exit status."""
    from ..diagrams.design import design as find_design
    from ..diagrams.explore import INTERRUPTED

    scene = load_scene(options.scene, systems_of(options.system))
    if options.output and Path(options.output).suffix != ".csv":
        raise InputError("-o", f"found {options.output!r}", "give a file that ends in .csv")
    with telling(scene.name, patient=True) as tell:
        found = find_design(scene, progress=tell)
    with defer_interruptions(Interruption()):
        say(repr(found))
        if options.output:
            write_text(Path(options.output), found.table())
            say(f"written to {options.output}")
    if found.interrupted:
        complain(f"{INTERRUPTED} ({found.interrupted}); what is shown was found until then")
        return 1
    return 0 if found.best is not None or found.chaos is not None else 1


def report(options: argparse.Namespace) -> int:
    """Measure error against run time; returns the exit status."""
    from ..accuracy.report import report as measure
    from ..accuracy.report import write_report

    scene = load_scene(options.scene, systems_of(options.system))
    with hold_folder(options.output) as folder:
        with telling(scene.name, options.quiet) as tell:
            data = measure(scene, options.repetitions, tell)
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
