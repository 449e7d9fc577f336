"""Lines across a map of curves, in both directions, until they meet no bifurcation off a curve.

Curves say nothing of those they do not pass. A run along a line meets whatever crosses it, so
lines are laid, the sides of the rectangle first and then ever denser, and a curve is started from
every entry that lies on none, until as many lines as asked for in a row have met nothing new.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from ..models.model import Model
from ..models.word import Word
from ..progress import Progress
from ..records.curve import Coverage
from ..records.entry import Entry
from ..scenes.scene import Scene
from ..segments.kernels import Kernels
from .runs import run_along

GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
INSIDE = 1e-6
"""How far inside a side its line runs, as part of the range."""

SEARCHED = 5
"""Values along a line at which orbits are looked for."""

MOST_ROUNDS = 8
"""As many times the lines asked for are the most that are laid in each direction."""


class Lines:
    """The lines across the map of one word.

    Parameters
    ----------
    scene : Scene
    model : Model
        The member of the family.
    word : Word
    kernels : Kernels
        With the first parameter free.
    covered : callable ``covered(entry) -> bool``
        Whether a curve passes through an entry.
    start : callable ``start(entry) -> str``
        Starts curves on the branch through an entry; returns why none passes it, if none does.
    progress : callable
    """

    def __init__(
        self,
        scene: Scene,
        model: Model,
        word: Word,
        kernels: Kernels,
        covered: Callable[[Entry], bool],
        start: Callable[[Entry], str],
        progress: Progress,
    ) -> None:
        assert scene.curves is not None
        self.scene, self.options, self.model, self.word = scene, scene.curves, model, word
        self.covered, self.start, self.progress = covered, start, progress
        first, second = scene.parameter, scene.curves.parameter
        self.ways = {
            second: (kernels, scene.range, self.options.range),
            first: (Kernels(model, second), self.options.range, scene.range),
        }
        self.laid: dict[str, list[float]] = {second: [], first: []}
        self.entries = self.started = self.evaluations = 0
        self.uncovered: list[dict[str, Any]] = []

    def cover(self, fixed: Mapping[str, float]) -> Coverage:
        """Lay lines until the last ones meet nothing new, and say what was met."""
        quiet, wanted = 0, 2 * self.options.cover
        for held, value in self.lines():
            quiet = 0 if self.run(held, value) else quiet + 1
            if quiet >= wanted:
                break
        walls = [wall.name for wall in self.scene.model.WALLS]
        return Coverage(
            dict(fixed),
            self.word.walls,
            self.word.period,
            self.word.notation(walls),
            self.laid,
            self.entries,
            self.started,
            self.uncovered,
            quiet >= wanted,
        )

    def lines(self) -> Iterator[tuple[str, float]]:
        """Which parameter to hold, and at what value: the sides, then each way in turn."""
        parts = [INSIDE, 1.0 - INSIDE, *((GOLDEN * np.arange(1, 1 + self.most)) % 1.0).tolist()]
        for part in parts:
            for held, (_, _, limits) in self.ways.items():
                yield held, _across(limits, part)

    @property
    def most(self) -> int:
        return MOST_ROUNDS * self.options.cover

    def run(self, held: str, value: float) -> bool:
        """Make one run; whether it met an entry on no curve."""
        kernels, limits, _ = self.ways[held]
        self.progress(f"{self.word}: line at {held} = {value:.6g}")
        self.laid[held].append(value)
        model = self.model.replace(**{held: value})
        searched = [_across(limits, part) for part in np.arange(1, SEARCHED + 1) / (SEARCHED + 1)]
        runs = run_along(self.scene, model, self.word, kernels, limits, searched)
        self.evaluations += runs[0].problem.kernel_evaluations if runs else 0
        found = [e for run in runs for e in run.branch("b0", kinds=self.options.kinds).events]
        met = [self.meet(entry) for entry in found if self.wanted(entry)]
        return any(met)

    def wanted(self, entry: Entry) -> bool:
        return entry.physical or self.options.unphysical

    def meet(self, entry: Entry) -> bool:
        """Whether an entry is on no curve yet; one is started there."""
        entry = dataclasses.replace(entry, parameter=self.scene.parameter)
        self.entries += 1
        if self.covered(entry):
            return False
        reason = self.start(entry)
        self.started += not reason
        if reason:
            place = {n: entry.parameters[n] for n in (entry.parameter, self.options.parameter)}
            self.uncovered.append({"kind": entry.kind, **place, "reason": reason})
        return True


def _across(limits: tuple[float, float], part: float) -> float:
    """Part of the way across a range, in logarithms where it is wide and all is positive."""
    low, high = limits
    if low > 0.0 and high > 4.0 * low:
        return float(min(max(low * (high / low) ** part, low), high))
    return float(low + (high - low) * part)
