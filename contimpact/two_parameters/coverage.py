"""Lines across a map of curves, in both directions, until they meet no bifurcation off a curve.

Curves say nothing of those they do not pass. A run along a line meets whatever crosses it, so
lines are laid: the sides of the rectangle first and then ever denser, until as many as asked for in
a row have met nothing new; then between neighbours on which different numbers of branches have
physical orbits, for there a word appears or vanishes; then from where something comes near to zero
on a line and turns back, for beside it may be a closed curve that no line crosses. A curve is
started from every entry that lies on none.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..models.model import Model
from ..models.word import Word, is_rotation
from ..orbit_continuation.orbit_branch import Run
from ..orbits.problem import Array
from ..orbits.quiet import problem_of
from ..orbits.search import solve_near
from ..progress import Progress
from ..results.branch import Entry
from ..results.curve import Coverage
from ..results.scene import Scene
from ..segments.kernels import Kernels
from .line_runs import across, at_value, crossing_runs, physical, run_on_line, switched_runs
from .near_misses import Descents, NearMiss, near_misses

GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
INSIDE = 1e-6
"""How far inside a side its line runs, as part of the range."""

MOST_ROUNDS = 8
"""As many times the lines asked for are the most that are laid in each direction."""

NARROWEST = 0.1
"""Neighbouring lines nearer than this part of the range are not looked between."""


@dataclass
class Met:
    """What lines have met of the orbits of one word."""

    word: Word
    entries: int = 0
    started: int = 0
    born: int = 0
    off: list[tuple[Entry, str]] = field(default_factory=list)


@dataclass(frozen=True)
class Line:
    """A line: the parameter that is held, how far across its range, its value, and the runs of the
    scene's word, with how many of them have physical orbits; then those switched to."""

    held: str
    part: float
    value: float
    runs: Sequence[Run]
    real: int
    born: Sequence[Run] = ()


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
    further : callable ``further() -> sequence of Entry``
        Starts curves from points of codimension two on those that are new; returns the entries that
        it started from.
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
        further: Callable[[], Sequence[Entry]],
        progress: Progress,
    ) -> None:
        assert scene.curves is not None
        self.scene, self.options, self.model, self.word = scene, scene.curves, model, word
        self.covered, self.start, self.further, self.progress = covered, start, further, progress
        first, second = scene.parameter, scene.curves.parameter
        self.ways = {
            second: (kernels, scene.range, self.options.range),
            first: (Kernels(model, second), self.options.range, scene.range),
        }
        self.laid: list[Line] = []
        self.looked = 0
        ranges = {held: way[2] for held, way in self.ways.items()}
        self.descents = Descents(ranges, self.cross)
        self.met = [Met(word)]
        self.followed: Counter[tuple[str, int]] = Counter()
        self.left_out: list[str] = []
        self.evaluations = 0
        self.generator = np.random.default_rng(scene.seed)

    def cover(self, fixed: Mapping[str, float]) -> list[Coverage]:
        """Lay lines until the last ones meet nothing new, and say what was met of each word."""
        self.begin_further()
        wanted = 2 * self.options.cover
        quiet, regular = 0, self.lines()
        while quiet < wanted:
            held, part = next(regular, (None, 0.0))
            if held is None:
                break
            quiet = 0 if self.run(held, part) else quiet + 1
            if quiet >= wanted and (self.look_between() or self.descend()):
                quiet = 0
        return [self.said(met, dict(fixed), quiet >= wanted) for met in self.met]

    def lines(self) -> Iterator[tuple[str, float]]:
        """Which parameter to hold, and how far across: the sides, then each way in turn."""
        most = MOST_ROUNDS * self.options.cover
        for part in [INSIDE, 1.0 - INSIDE, *((GOLDEN * np.arange(1, 1 + most)) % 1.0).tolist()]:
            for held in self.ways:
                yield held, part

    def look_between(self) -> bool:
        """Lay lines between neighbours that differ; whether one met an entry on no curve."""
        met = [self.run(*place) for place in self.between()]
        return any(met)

    def between(self) -> Iterator[tuple[str, float]]:
        """Places half way between neighbours with different numbers of branches, ever nearer."""
        for held in self.ways:
            while place := self._differing(held):
                yield held, place

    def _differing(self, held: str) -> float | None:
        """Half way between the neighbours farthest apart that differ; None where all are near."""
        own = sorted((line for line in self.laid if line.held == held), key=lambda x: x.part)
        pairs = itertools.pairwise(own)
        apart = [(b.part - a.part, a) for a, b in pairs if a.real != b.real]
        width, left = max(apart, key=lambda pair: pair[0], default=(0.0, None))
        return left.part + 0.5 * width if left and width > NARROWEST else None

    def run(self, held: str, part: float) -> bool:
        """Lay one line; whether it met an entry on no curve."""
        kernels, limits, other = self.ways[held]
        value = across(other, part)
        self.progress(f"{self.word}: line at {held} = {value:.6g}")
        problem = problem_of(self.model.replace(**{held: value}), self.word, kernels)
        known = self.known(held, value)
        runs = crossing_runs(self.scene, problem, limits, known, self.generator)
        born, unswitched = switched_runs(self.scene, runs, limits)
        if unswitched:
            limit = f"follow.max_branches = {self.scene.max_branches}"
            at = f"events at {held} = {value:.6g}"
            self.left_out.append(f"the branches of {unswitched} {at} ({limit})")
        real = sum(bool(np.any(physical(run.points))) for run in runs)
        self.laid.append(Line(held, part, value, runs, real, born))
        self.evaluations += problem.kernel_evaluations
        self.evaluations += sum(run.problem.kernel_evaluations for run in born)
        return self.meet_on([*runs, *born])

    def meet_on(self, runs: Sequence[Run]) -> bool:
        """Whether an entry of some runs is on no curve."""
        self.followed.update((run.problem.word.walls, run.problem.word.period) for run in runs)
        found = [e for run in runs for e in run.branch("b0", kinds=self.options.kinds).events]
        met = [self.meet(entry) for entry in found if self.wanted(entry)]
        return any(met)

    # Near misses on lines, from which closed curves between them are reached.

    def descend(self) -> bool:
        """Follow orbits from the near misses of lines to events; whether one is on no curve."""
        lines, self.looked = self.laid[self.looked :], len(self.laid)
        misses = [
            (miss, line)
            for line in lines
            for run in (*line.runs, *line.born)
            for miss in near_misses(run, self.options.kinds)
        ]
        misses.sort(key=lambda pair: pair[0].size)
        self.progress(f"{self.word}: {len(misses)} near misses on {len(lines)} lines")
        runs = (r for m, line in misses for r in self.descents.runs(m, line.held, line.value))
        met = [self.meet_on([run]) for run in runs]
        return any(met)

    def cross(self, miss: NearMiss, held: str, place: Mapping[str, float]) -> Run | None:
        """Follow the orbit of a near miss while a parameter is held."""
        kernels, limits, _ = self.ways[held]
        problem = problem_of(self.model.replace(**{held: place[held]}), miss.word, kernels)
        start = np.append(miss.unknowns[:-1], place[kernels.parameter])
        here = solve_near(problem, start)
        run = None if here is None else run_on_line(self.scene, problem, here.unknowns, limits)
        self.evaluations += problem.kernel_evaluations
        return run

    def known(self, held: str, value: float) -> Iterator[Array]:
        """Orbits that lines across this one have met at its value, with their own value last."""
        for line in self.laid:
            if line.held != held:
                for run in line.runs:
                    for unknowns in at_value(run, value):
                        yield np.append(unknowns[:-1], line.value)

    @staticmethod
    def wanted(entry: Entry) -> bool:
        """Whether an entry is to be on a curve: unphysical orbits are without number."""
        return entry.physical

    def meet(self, entry: Entry) -> bool:
        """Whether an entry is on no curve yet; one is started there."""
        entry = dataclasses.replace(entry, parameter=self.scene.parameter)
        met = self.of(entry)
        met.entries += 1
        if self.covered(entry):
            return False
        reason = self.start(entry)
        if reason:
            met.off.append((entry, reason))
        else:
            met.started += 1
            self.begin_further()
        return True

    def begin_further(self) -> None:
        """Start from points of codimension two until there is no new curve."""
        while found := self.further():
            for entry in found:
                self.of(entry).born += 1

    def of(self, entry: Entry) -> Met:
        """What was met of an entry's word."""
        word = Word(entry.word, entry.period)
        known = next((met for met in self.met if _same_word(met.word, word)), None)
        if known is None:
            self.met.append(known := Met(word))
        return known

    def said(self, met: Met, fixed: dict[str, float], complete: bool) -> Coverage:
        """The statement on one word; entries that later curves pass are off none."""
        walls = self.scene.model.letters
        word, names = met.word, (self.scene.parameter, self.options.parameter)
        off: list[dict[str, object]] = [
            {"kind": e.kind, **{n: e.parameters[n] for n in names}, "reason": reason}
            for e, reason in met.off
            if not self.covered(e)
        ]
        lines = {held: [x.value for x in self.laid if x.held == held] for held in self.ways}
        about = fixed, word.walls, word.period, word.notation(walls), lines
        own = (Word(*key) for key in self.followed.elements())
        branches = sum(_same_word(word, other) for other in own)
        switched = not _same_word(word, self.word)
        complete = complete and (branches > 0 or not switched)
        counts = met.entries, met.started, off, complete
        left_out = [] if switched else self.left_out
        return Coverage(*about, *counts, met.born, switched, branches, left_out)


def _same_word(one: Word, other: Word) -> bool:
    return one.period == other.period and is_rotation(one.walls, other.walls)
