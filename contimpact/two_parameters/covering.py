"""What lines across a map ask of its curves: whether they pass an entry, and to start more."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from ..models.model import Model
from ..models.word import Word
from ..orbit_continuation.orbit_branch import Run
from ..progress import Progress
from ..results.branch import Branch, Entry
from ..results.curve import Codim2, Coverage, Curve
from ..results.diagram import Limits
from ..results.options import CurveOptions
from ..results.scene import Scene
from ..segments.kernels import Kernels
from .births import entries_born
from .coverage import Lines
from .runs import passes, run_through, run_with


class CurveMap(Protocol):
    """A scene's curves as they are followed.

    Attributes
    ----------
    scene, options
    kernels, pairs : Kernels
        With the first parameter free, and with both.
    branches, curves : list
        As far as they are followed.
    evaluations : int
    limits : Limits
        Those that were reached.
    progress : callable
    """

    scene: Scene
    options: CurveOptions
    kernels: Kernels
    pairs: Kernels
    branches: list[Branch]
    evaluations: int
    limits: Limits

    @property
    def progress(self) -> Progress:
        """What to call with lines of text."""

    def of_member(self, fixed: Mapping[str, float]) -> list[Curve]:
        """Return the curves of a member of the family."""

    def start_from(
        self, run: Run, model: Model, fixed: Mapping[str, float]
    ) -> list[tuple[Entry, str | None]]:
        """Follow curves from entries of a run that lie on none; return all, and their curves."""

    def wanted(self, entry: Entry) -> bool:
        """Whether a curve starts at an entry."""


class Covering:
    """The map of one member of the family, as lines cover it."""

    def __init__(self, curves: CurveMap, model: Model, fixed: Mapping[str, float]) -> None:
        self.map, self.model, self.fixed = curves, model, fixed
        self.seen: set[str] = set()
        self.births: dict[tuple[str, int], int] = {}

    def cover(self, word: Word) -> list[Coverage]:
        """Lay lines for a word of the scene, and say what they met."""
        own = self.map
        about = own.scene, self.model, word, own.kernels
        lines = Lines(*about, self.covered, self.start, self.further, own.progress)
        found = lines.cover(self.fixed)
        own.evaluations += lines.evaluations
        return found

    def covered(self, entry: Entry) -> bool:
        """Whether a curve passes through an entry."""
        own = self.map
        curves = own.of_member(self.fixed)
        return any(passes(curve, entry, self.model, own.kernels) for curve in curves)

    def start(self, entry: Entry) -> str:
        """Follow the curves of the branch through an entry; returns why its own is not there."""
        own = self.map
        second = own.options.parameter
        there = self.model.replace(**{second: entry.parameters[second]})
        for through in (run_through, run_with):
            run = through(own.scene, there, entry, own.kernels)
            own.evaluations += run.problem.kernel_evaluations
            if run.interrupted:
                raise KeyboardInterrupt
            own.start_from(run, there, self.fixed)
            if self.covered(entry):
                return ""
        return "no curve through it could be followed"

    def further(self) -> list[Entry]:
        """Start curves from points of codimension two; returns the entries they started from."""
        own = self.map
        ranges = [own.scene.range, own.options.range]
        entries = {entry.id: entry for branch in own.branches for entry in branch.events}
        started = []
        for curve, point in self.points():
            origin = entries.get(curve.origin)
            if origin is None:
                continue
            about = origin, point, self.model, own.options.kinds, own.pairs, ranges
            for entry in entries_born(*about):
                wanted = own.wanted(entry) and self.near_enough(entry, curve)
                if wanted and not self.covered(entry) and not self.start(entry):
                    started.append(entry)
        return started

    def near_enough(self, entry: Entry, curve: Curve) -> bool:
        """Whether an entry's word is born from one of the scene in as few steps as it reaches."""
        before = self.births.get((curve.word, curve.period), 0)
        own = before + ((entry.word, entry.period) != (curve.word, curve.period))
        reach = self.map.options.reach
        if own > reach:
            if not self.covered(entry):
                name = f"{entry.label} of {entry.notation}"
                what = "curves not started at points of codimension two"
                self.map.limits.reached("curves.reach", reach, what, name)
            return False
        known = self.births.setdefault((entry.word, entry.period), own)
        self.births[entry.word, entry.period] = min(known, own)
        return True

    def points(self) -> list[tuple[Curve, Codim2]]:
        """The points of codimension two that were not started from yet."""
        curves = self.map.of_member(self.fixed)
        new = [(c, p) for c in curves for p in c.points if p.id not in self.seen]
        self.seen |= {point.id for _, point in new}
        return new
