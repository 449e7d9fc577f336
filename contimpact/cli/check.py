"""``contimpact check``: validate a scene and say what would run."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Sequence

from ..diagrams.starting_orbits import add_settled, error_at_key, not_found, refusal, search_at
from ..errors import InputError, printable
from ..models.word import name_orbit
from ..progress import Progress
from ..results.options import CurveOptions
from ..results.scene import Scene, load_scene, systems_of
from ..segments.kernels import Kernels, check_once
from ..telling import telling
from .terminal import say

WIDTH = 100
"""Of the lines that state the system."""


def command(options: argparse.Namespace) -> int:
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
    try:
        return check_once(scene.model)
    except InputError as error:
        raise error_at_key(error, scene) from None


def _start_lines(scene: Scene, tell: Progress) -> tuple[Sequence[float], list[str]]:
    """The derived parameters at the start, and what is said of the orbits there."""
    kernels = Kernels(scene.model, scene.parameter)
    try:
        derived = kernels.setup(*scene.model.values.values()).derived
        if scene.simulate is not None and scene.simulate.losses:
            from ..simulation.energy import require_masses

            require_masses(scene.model, kernels, "simulate.losses")
        return derived, _orbits(scene, kernels, tell)
    except InputError as error:
        raise error_at_key(error, scene) from None


def _orbits(scene: Scene, kernels: Kernels, tell: Progress) -> list[str]:
    """How many orbits each word has at the start; refused where a run would be."""
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
            missing.append(not_found(scene, kernels, word, tell))
            shown += missing[-1].but
            shown += f"; {missing[-1].nearby or missing[-1].nowhere}"
        lines.append(f"{name_orbit(word.notation(letters), str(word), 'word ')}: {shown}")
    surveyed = scene.survey and any(each.elsewhere for each in missing)
    if len(missing) == len(scene.orbits) and not surveyed:
        raise refusal(missing, settled)
    if settled is not None:
        place = f"{scene.parameter} = {scene.start:.9g}"
        lines += settled.remarks(place, any(not word.walls for word in scene.orbits))
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
