"""Commands of scenes: ``check``, ``new``, ``systems``, ``fit``, ``design`` and ``report``."""

from __future__ import annotations

import argparse
import math
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..errors import InputError, printable
from ..models.guards import is_rotation, name_orbit
from ..progress import Progress, telling
from ..results.options import FORMATS, CurveOptions
from ..results.result_folder import hold_folder, prepare_folder
from ..results.scene import Scene, load_scene, systems_of
from ..storage import write_text
from . import complain, say
from .console import Interruption, defer_interruptions


def new(options: argparse.Namespace) -> int:
    """Print a scene to start from, or the names of all systems; returns the exit status."""
    from ..results.scene import new_scene
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
    _require_place(options)
    deviations = dict(map(_deviation, options.deviation))
    with telling(scene.name, options.quiet, patient=True) as tell:
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
    if not options.quiet:
        say(repr(found))
    elif found.reason is not None:
        complain(found.reason)
    if options.output:
        from ..plots.diagram import write_figure
        from ..plots.orbit import plot_fit

        write_figure(plot_fit(found)[0].figure, target, kind, scene.name)
        if not options.quiet:
            say(f"written to {target}")
    return 0 if found.reason is None else 1


def _require_place(options: argparse.Namespace) -> None:
    """Refuse a file that cannot be written before anything is computed for it."""
    if options.output:
        target = Path(options.output)
        prepare_folder(target.parent, [target.name])


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
    from ..results.diagram import INTERRUPTED

    scene = load_scene(options.scene, systems_of(options.system))
    if options.output and Path(options.output).suffix != ".csv":
        raise InputError("-o", f"found {options.output!r}", "give a file that ends in .csv")
    _require_place(options)
    with telling(scene.name, options.quiet, patient=True) as tell:
        found = find_design(scene, progress=tell)
    failed = found.best is None and found.chaos is None
    with defer_interruptions(Interruption()):
        if not options.quiet:
            say(repr(found))
        elif failed:
            complain(repr(found))
        if options.output:
            write_text(Path(options.output), found.table())
            if not options.quiet:
                say(f"written to {options.output}")
    if found.interrupted:
        complain(f"{INTERRUPTED} ({found.interrupted}); what is shown was found until then")
        return 1
    return 1 if failed else 0


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
            + ("; report.md says why not the others" if fair["confirmed"] < fair["events"] else "")
        )
        say(f"written to {folder}: {', '.join(files)}")
    return 0


# ``contimpact check``: validate a scene and say what would run.

WIDTH = 100
"""Of the lines that state the system."""


def check(options: argparse.Namespace) -> int:
    """Validate a scene; returns the exit status."""
    scene = load_scene(options.scene, systems_of(options.system))
    with telling(scene.name, patient=True) as tell:
        compared = _comparison_lines(scene)
        derived, orbits = _start_lines(scene, tell)
    say(f"scene {scene.name}" + (f": {printable(scene.source)}" if scene.source else ""))
    for heading, text in scene.model.statement():
        shown = f"  {heading:<8} {printable(text)}"
        say(textwrap.fill(shown, WIDTH, subsequent_indent=" " * 11, break_long_words=False))
    for name, value in zip(scene.model.DERIVED, derived, strict=False):
        say(f"           {name} = {value:.12g}")
    say(f"  checked  {', '.join(compared)}")
    low, high = scene.range
    say(f"  follow   {scene.parameter} from {scene.start:.12g} within [{low:.12g}, {high:.12g}]")
    for line in orbits:
        say(f"  orbits   {line}")
    say(f"  events   {', '.join(scene.events) or 'none'}")
    for name, values in scene.values.items():
        say(f"           {name} = {', '.join(f'{v:.12g}' for v in values)}")
    if scene.curves is not None:
        say(f"  curves   {_curves_asked(scene.curves)}")
    for text in scene.left_out():
        say(f"  left out {text}")
    return 0


def _comparison_lines(scene: Scene) -> list[str]:
    """What the model states that was compared."""
    from ..diagrams.starting_orbits import error_at_key
    from ..segments.kernels import check_once

    try:
        return check_once(scene.model)
    except InputError as error:
        raise error_at_key(error, scene) from None


def _start_lines(scene: Scene, tell: Progress) -> tuple[Sequence[float], list[str]]:
    """The derived parameters at the start, and what is said of the orbits there."""
    from ..diagrams.starting_orbits import error_at_key
    from ..segments.kernels import Kernels

    kernels = Kernels(scene.model, scene.parameter)
    try:
        kernels.require_room(scene.model)
        derived = kernels.setup(*scene.model.values.values()).derived
        if scene.simulate is not None and scene.simulate.losses:
            from ..simulation.energy import require_masses

            require_masses(scene.model, kernels, "simulate.losses")
        return derived, _orbits(scene, kernels, tell)
    except InputError as error:
        raise error_at_key(error, scene) from None


def _orbits(scene: Scene, kernels: Any, tell: Progress) -> list[str]:
    """How many orbits each word has at the start; refused where a run would be."""
    from ..diagrams.starting_orbits import add_settled, not_found, refusal, search_at, word_of

    letters = scene.model.letters
    lines, missing = [], []
    searched = {}
    for word in scene.orbits:
        tell(f"looking for {word} at {scene.parameter} = {scene.start:.6g}")
        searched[word] = search_at(scene, kernels, word, scene.start)
    orbits = {word: done.orbits for word, done in searched.items()}
    orbits, settled = add_settled(scene, kernels, orbits, tell)
    for word, found in orbits.items():
        done = searched[word]
        unphysical = sum(not orbit.physical for orbit in found)
        shown = f"{len(found)} at the start"
        shown += f", {unphysical} of them unphysical" if unphysical else ""
        if found and not done.settled:
            shown += f"; numerics.rounds = {scene.rounds} ended the search, there may be more"
        if not found:
            missing.append(here := not_found(scene, kernels, word, tell))
            shown += here.but
            shown += "" if here.family else f"; {here.nearby or here.nowhere}"
        lines.append(f"{name_orbit(word.notation(letters), str(word), 'word ')}: {shown}")
    surveyed = scene.survey and any(each.elsewhere for each in missing)
    if len(missing) == len(scene.orbits) and not surveyed:
        raise refusal(missing, settled)
    if settled is not None:
        place = f"{scene.parameter} = {scene.start:.9g}"
        lines += settled.remarks(place, any(not word.walls for word in scene.orbits))
        words = dict.fromkeys(word_of(orbit) for orbit in settled.orbits)
        lines += [
            f"simulation settles on {word} at {place}, which is not in follow.orbits"
            for word in words
            if not any(
                word.period == own.period and is_rotation(word.walls, own.walls)
                for own in scene.orbits
            )
        ]
    return lines


def _curves_asked(curves: CurveOptions) -> str:
    low, high = curves.range
    text = f"{', '.join(curves.kinds)} in {curves.parameter} within [{low:.12g}, {high:.12g}]"
    if curves.family is not None:
        name, values = curves.family
        text += f", for {name} = {', '.join(f'{v:.6g}' for v in values)}"
    if curves.cover:
        text += f"; covered by lines, until {curves.cover} each way meet nothing new"
    return text + ("; divided into areas" if curves.areas else "")
