"""A scene's diagram: its orbits, their branches, and those that are born on them.

Branches are followed breadth first: the scene's orbits, then what is born at their events, physical
events before unphysical ones, down to the scene's depth and within its budget. A branch that is
already known (the word rotated, time shifted by whole periods, or the image under the model's
symmetry) is not followed twice; the second way to it is recorded as a meeting.
"""

from __future__ import annotations

import collections
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array
from ..bifurcations.kind import Start, kind_of, primitive_start, switch, test_functions
from ..continuation.branch import End, EndKind, Event, TestFunction
from ..continuation.settings import Settings
from ..continuation.walk import is_interrupted, reraise_interruption
from ..errors import InputError, explain_arguments, short_repr
from ..models.guards import Word
from ..orbits.orbit import Orbit
from ..orbits.problem import Linearisation, OrbitProblem
from ..orbits.quiet import problem_of
from ..orbits.search import SAME_ORBIT, Search, mirror_orbit, reduce_period
from ..progress import Asked, Progress, RememberedProgress, progress_lines, walk_progress
from ..results.branch import Branch, Entry
from ..results.diagram import ENDING, INTERRUPTED, Diagram, Limits, failure_of, with_statistics
from ..results.quantities import fill_outputs, output_columns
from ..results.scene import Scene, load_scene, read_scene
from ..segments.kernels import Kernels
from .orbit_walks import Run, add_stop_test, first_step, run_born, symmetric_end, walk_both_ways
from .starting_orbits import (
    NotFound,
    add_settled,
    attracts,
    error_at_key,
    refusal,
    search_at,
    search_elsewhere,
    survey_values,
)

if TYPE_CHECKING:
    from .starting_orbits import Settled

# Branches with what leads away from them: branches born at their events, and others they meet.


@dataclass(frozen=True)
class Birth:
    """A branch waiting to be followed: where it starts, and the entry it is born at."""

    event: Event
    entry: Entry
    depth: int


STAGES = ("kernels", "search", "walk", "events", "switching", "tables")
NOT_SWITCHED = "events not switched at"
MARGINAL = 1e-9
"""How far from the unit circle a multiplier is on it, within rounding."""


@explain_arguments
def follow(scene: Scene | str | Path | Mapping[str, Any], progress: Asked = None) -> Diagram:
    """Compute the diagram of a scene.

    Parameters
    ----------
    scene : Scene, str, Path or mapping
        From `load_scene`; or the path of a scene file, or its content.
    progress : bool or callable
        Whether to tell on standard error what is being done, or a function to call with a line of
        text now and then.

    Returns
    -------
    Diagram

    Raises
    ------
    InputError
        If the scene cannot be read, or none of the words it names has an orbit at its start, nor,
        with a survey, at other values.

    Notes
    -----
    An interruption or a numerical failure ends the computation early; what was computed is
    returned, and ``statistics["failure"]`` says what happened, ``statistics["stopped"]`` what
    was being done then. Words without an orbit at the start
    are listed in ``statistics["not_found"]``. Limits of the scene that cut something off are listed
    in ``limits``, with what they left out.
    """
    if isinstance(scene, str | Path):
        scene = load_scene(scene)
    elif isinstance(scene, Mapping):
        scene = read_scene(scene)
    elif not isinstance(scene, Scene):
        accepted = "give a scene, or the path of one; orbits are followed by continue_orbit"
        raise InputError("scene", f"found {short_repr(scene)}", accepted)
    with progress_lines(progress, scene.name) as told:
        tell = RememberedProgress(told)
        explorer = _Explorer(scene, tell)
        diagram = explorer.run()
        if scene.crises:
            diagram = _add_part(_add_crises, scene, diagram, tell)
        if scene.curves is not None:
            diagram = _add_part(_add_map, scene, diagram, tell)
        if not diagram.branches and not diagram.statistics["failure"]:
            explorer.look_elsewhere()
            raise refusal(list(explorer.lacking.values()), explorer.settled)
        diagram = _stopped_at(diagram, tell.last)
        if scene.outputs or scene.margins is not None:
            diagram = _with_columns(scene, diagram, tell)
    return diagram


def _add_part(
    add: Callable[[Scene, Diagram, RememberedProgress], Diagram],
    scene: Scene,
    diagram: Diagram,
    tell: RememberedProgress,
) -> Diagram:
    """The diagram with what is added to one that has not ended early, or as it is where that ends
    early itself, without a part to keep: as while its modules are imported."""
    if diagram.statistics["failure"]:
        return diagram
    try:
        return add(scene, diagram, tell)
    except ENDING as error:
        return _cut_short(diagram, error)


def _cut_short(diagram: Diagram, error: BaseException) -> Diagram:
    """The diagram with what has ended its computation early."""
    return with_statistics(diagram, failure=failure_of(error, diagram.branches))


def _add_crises(scene: Scene, diagram: Diagram, tell: RememberedProgress) -> Diagram:
    from .crises import add_crises, locate_in_scene

    crises: list[Any] = []
    try:
        locate_in_scene(scene, diagram, crises, tell)
    except ENDING as error:
        diagram = _cut_short(diagram, error)
    return add_crises(diagram, crises)


def _add_map(scene: Scene, diagram: Diagram, tell: RememberedProgress) -> Diagram:
    from .map_explorer import add_map

    return add_map(scene, diagram, tell)


def _stopped_at(diagram: Diagram, last: str) -> Diagram:
    """The diagram with what was being done when its computation ended early, if it did."""
    if not (failure := diagram.statistics["failure"]):
        return diagram
    stopped = last if failure == INTERRUPTED else f"{failure}, while {last}"
    if before := diagram.statistics.get("stopped"):
        stopped = f"{before}; then {stopped}"
    return with_statistics(diagram, stopped=stopped)


def _with_columns(scene: Scene, diagram: Diagram, tell: RememberedProgress) -> Diagram:
    """The diagram with outputs' means and margins as columns of branches.

    Nothing is computed after an interruption. What that or a failure leaves out is NaN, and a note
    on the branch says so.
    """
    outputs, margins, model = scene.outputs, scene.margins, scene.model
    entries = {entry.id: entry for entry in diagram.entries}
    fill: dict[str, Callable[[Branch], list[str]]] = {}
    if outputs:
        fill["means of outputs"] = lambda branch: fill_outputs(branch, outputs, model)
    if margins is not None:

        def with_margins(branch: Branch) -> list[str]:
            from .margins import fill_margins

            return fill_margins(branch, margins, model, entries)

        fill["margins"] = with_margins
    found = [_with_blanks(branch, scene) for branch in diagram.branches]
    left = [(what, number) for what in fill for number in range(len(found))]
    if diagram.statistics["failure"] != INTERRUPTED:
        try:
            while left:
                what, number = left[0]
                branch = found[number]
                tell(f"{what} along {branch.id}")
                found[number] = replace(branch, notes=[*branch.notes, *fill[what](branch)])
                del left[0]
        except ENDING as error:
            diagram = _stopped_at(_cut_short(diagram, error), tell.last)
    for what, number in left:
        note = f"{what} are missing: the run ended before all were computed"
        found[number] = replace(found[number], notes=[*found[number].notes, note])
    return replace(diagram, branches=found)


def _with_blanks(branch: Branch, scene: Scene) -> Branch:
    """The branch with columns for what is yet to be computed."""
    names = [*output_columns(scene.outputs), *["margin"] * (scene.margins is not None)]
    columns = {**branch.columns, **{name: np.full(len(branch), np.nan) for name in names}}
    if scene.margins is not None:
        columns["margin_event"] = np.full(len(branch), "", dtype=object)
    return replace(branch, columns=columns)


@dataclass
class _Explorer:
    """The computation of a scene's diagram, as far as it has come."""

    scene: Scene
    progress: Progress
    runs: list[Run] = field(default_factory=list)
    branches: list[Branch] = field(default_factory=list)
    waiting: list[Birth] = field(default_factory=list)
    left: list[Birth] = field(default_factory=list)
    opens: dict[str, list[str]] = field(default_factory=dict)
    meetings: dict[str, list[str]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    limits: Limits = field(default_factory=Limits)
    surveyed: str = "none"
    settled: Settled | None = None
    lacking: dict[Word, NotFound] = field(default_factory=dict)
    left_out: collections.Counter[Word] = field(default_factory=collections.Counter)
    probes: int = 0
    tested: list[TestFunction] = field(default_factory=list)
    failure: str | None = None
    seconds: dict[str, float] = field(default_factory=lambda: dict.fromkeys(STAGES, 0.0))

    def run(self) -> Diagram:
        scene = self.scene
        began = time.perf_counter()
        self.kernels = Kernels(scene.model, scene.parameter)
        if scene.crises:
            from .crisis_location import require_one_coordinate

            require_one_coordinate(scene.model, self.kernels, "detect.crises")
        try:
            self.kernels.require_room(scene.model)
            for word in scene.orbits:
                self.problem(word)
        except InputError as error:
            raise error_at_key(error, scene) from None
        self.symmetry = scene.model.symmetry(
            scene.parameter, self.kernels.harmonics(*scene.model.values.values())
        )
        self.seconds["kernels"] += time.perf_counter() - began
        started = self.orbits_at_start()
        elsewhere = scene.curves is not None and scene.curves.cover
        try:
            for orbit in started:
                self.follow_orbit(orbit)
            self.follow_births()
            if scene.survey:
                self.survey()
                self.follow_births()
            elif not elsewhere:
                self.look_elsewhere()
                self.follow_births()
            self.note_left()
            self.note_settled()
            self.note_values()
            self.note_marginal()
        except ENDING as error:
            self.failure = failure_of(error, self.runs)
        if not self.runs and not self.failure and not elsewhere:
            raise refusal(list(self.lacking.values()), self.settled)
        return Diagram(
            scene.name,
            [self.with_openings(branch) for branch in self.branches],
            statistics=self.statistics(),
            survey=self.surveyed,
            limits=self.limits.listed() or (),
        )

    def problem(self, word: Word) -> OrbitProblem:
        return problem_of(self.scene.model, word, self.kernels)

    # Orbits found by simulation and by search.

    def note_settled(self) -> None:
        """Note on which orbits simulations settle that lie on no branch, and what else they do."""
        if self.settled is None:
            return
        from .starting_orbits import word_of

        place = f"{self.scene.parameter} = {self.scene.start:.9g}"
        quiet = any(not run.problem.word.walls for run in self.runs)
        self.notes += self.settled.remarks(place, quiet)
        for orbit in self.settled.orbits:
            if self.known(orbit.problem, orbit.unknowns) is None:
                self.notes.append(
                    f"simulation settles on {word_of(orbit)} at {place}, which is on no followed "
                    "branch: add it to follow.orbits"
                )

    def orbits_at_start(self) -> list[Orbit]:
        """The orbits of all words at the start; words without any are kept in mind."""
        searched = {word: self.search(word, self.scene.start) for word in self.scene.orbits}
        began = time.perf_counter()
        orbits, self.settled = add_settled(self.scene, self.kernels, searched, self.progress)
        self.seconds["search"] += time.perf_counter() - began
        for word in (word for word, each in orbits.items() if not each):
            lacking = NotFound.of(self.scene, self.kernels, word)
            self.lacking[word] = replace(lacking, unphysical=self.left_out[word])
        found = [orbit for each in orbits.values() for orbit in each]
        if len(found) > self.scene.max_branches:  # words in turn, of each what attracts first
            for each in orbits.values():
                each.sort(key=lambda orbit: not attracts([orbit]))
            turns = [(turn, orbit) for each in orbits.values() for turn, orbit in enumerate(each)]
            turns.sort(key=lambda one: (one[0], not attracts([one[1]])))
            found = [orbit for _, orbit in turns]
        return found

    def search(
        self, word: Word, value: float, find: Callable[..., Search] = search_at
    ) -> list[Orbit]:
        began = time.perf_counter()
        self.progress(f"looking for {self.place(word, value)}")
        found = find(self.scene, self.kernels, word, value)
        self.seconds["search"] += time.perf_counter() - began
        orbits = [o for o in found.orbits if o.physical or self.throughout(word)]
        for _ in range(len(found.orbits) - len(orbits)):
            self.left_out[word] += 1
            self.leave_out("orbits not followed", self.place(word, value))
        if word in self.lacking:
            self.lacking[word] = self.lacking[word].also_at(value, len(orbits))
        if found.orbits and not found.settled:
            what = "searches it ended before two rounds in a row found nothing new"
            self.limits.reached("numerics.rounds", self.scene.rounds, what, self.place(word, value))
        return orbits

    def place(self, word: Word, value: float) -> str:
        """A word and where orbits of it are looked for."""
        return f"{word} at {self.scene.parameter} = {value:.9g}"

    def look_elsewhere(self) -> None:
        """Look at other values for words without an orbit at the start: to report them, and to
        follow them if the unphysical ones are not, along which the others would be found."""
        for word in self.lacking:
            for value in survey_values(self.scene):
                for orbit in self.search(word, value, search_elsewhere):
                    if self.lacking[word].unphysical:
                        self.follow_orbit(orbit)

    def follow_orbit(self, orbit: Orbit) -> None:
        """Follow an orbit both ways, unless it lies on a branch already known."""
        if self.known(orbit.problem, orbit.unknowns) is not None:
            return
        if not self.in_budget():
            place = self.place(orbit.problem.word, orbit.value)
            self.limits.reached(*self.budget(), "orbits not followed", place)
            return
        name = self.next_name()
        tests = self.tests(orbit.problem)
        settings = self.settings()
        tell = self.walk_progress(orbit.problem, name)
        scene = self.scene
        began = time.perf_counter()
        stop = symmetric_end(orbit.problem, self.known)
        about = orbit.problem, orbit.unknowns, scene.range, tests, settings
        run = walk_both_ways(*about, None, stop, self.throughout(orbit.problem.word), tell)
        self.keep(run, name, None, 0, began)

    def survey(self) -> None:
        """Look across the range for more orbits of every word met so far, or named alone."""
        met = dict.fromkeys([*(run.problem.word for run in self.runs), *self.lacking])
        words = self.scene.orbits if self.scene.survey == "orbits" else met
        self.surveyed = "cut short"
        for value in survey_values(self.scene):
            for word in words:
                if not self.in_budget():
                    what = "the survey ended before"
                    self.limits.reached(*self.budget(), what, self.place(word, value))
                    continue
                for orbit in self.search(word, value):
                    self.follow_orbit(orbit)
        if self.in_budget():
            self.surveyed = "done" if self.scene.survey is True else "orbits"

    # Branches born at events.

    def follow_births(self) -> None:
        while self.waiting and self.in_budget():
            depth = min(birth.depth for birth in self.waiting)
            order = [b for b in self.waiting if b.depth == depth]
            birth = next((b for b in order if b.entry.physical), order[0])
            self.waiting.remove(birth)
            self.follow_birth(birth)
        for birth in self.waiting:
            self.limits.reached(*self.budget(), NOT_SWITCHED, _entry_text(birth.entry))
        self.waiting = []

    def follow_birth(self, birth: Birth) -> None:
        """Follow the branch born at an event; if it is known, record the meeting."""
        entry, began = birth.entry, time.perf_counter()
        start = switch(birth.event)
        if start is None:
            self.note(entry, kind_of(entry.kind).nothing(birth.event))
            return
        start = primitive_start(start)
        if start.note:
            self.note(entry, start.note)
        known = self.first_step_known(start)
        self.seconds["switching"] += time.perf_counter() - began
        if known is not None:
            self.record(entry, known)
            return
        name, began = self.next_name(), time.perf_counter()
        run = self.run_from(start, entry, name)
        if isinstance(run, End):
            self.note(entry, run.message)
        elif len(run.points) == 1 and all(w.end.kind is not EndKind.RANGE for w in run.walks):
            self.note(entry, run.walks[1].end.message)
        elif known := self.run_known(run):
            self.record(entry, known)
        else:
            self.keep(run, name, entry, birth.depth, began)
            return
        reraise_interruption([run] if isinstance(run, End) else run.ends)

    def note(self, entry: Entry, text: str) -> None:
        self.notes.append(f"{_entry_text(entry)}: {text}")

    def first_step_known(self, start: Start) -> str | None:
        """The known branch the first step from a start leads to, if any."""
        self.probes += 1
        probe = first_step(start, self.scene.range, self.settings())
        return self.known(start.problem, probe.points[-1].unknowns) if probe.points else None

    def run_from(self, start: Start, entry: Entry, name: str) -> Run | End:
        """Walk from a start until the branch ends, or runs into its own image."""
        problem, place = start.problem, {"entry": entry.id, "parent": entry.branch}
        born = End.of(EndKind.BORN, self.scene.parameter, entry.value, **place)
        tests, settings = self.tests(problem), self.settings()
        stop, tell = symmetric_end(problem, self.known), self.walk_progress(problem, name)
        scene = self.scene
        about = start, born, scene.range, tests, settings
        return run_born(*about, stop, None, self.throughout(problem.word), tell)

    def run_known(self, run: Run) -> str | None:
        """The known branch a walk went along, where its first step was too short to tell."""
        lengths = run.points.arclengths
        inside = np.searchsorted(lengths, lengths[-1] * np.array([1 / 3, 2 / 3])).tolist()
        one, other = (self.known(run.problem, run.points[i].unknowns) for i in inside)
        return one if one == other else None

    # Recognition.

    def known(self, problem: OrbitProblem, unknowns: Array) -> str | None:
        """The branch an orbit lies on, itself or its mirror image."""
        images = [reduce_period(problem, unknowns, SAME_ORBIT)]
        if self.symmetry is not None and (image := mirror_orbit(*images[0], self.symmetry)):
            images.append(image)
        for branch, run in zip(self.branches, self.runs, strict=True):
            if any(run.has(*image) for image in images):
                return branch.id
        return None

    def record(self, entry: Entry, branch: str) -> None:
        """Record that switching at an entry leads to a branch."""
        self.opens.setdefault(entry.id, []).append(branch)
        self.meetings.setdefault(branch, []).append(entry.id)

    def with_openings(self, branch: Branch) -> Branch:
        """A branch that knows what opens at its entries and what it meets."""
        events = [replace(e, opens=tuple(self.opens.get(e.id, ()))) for e in branch.events]
        return replace(branch, events=events, meetings=list(self.meetings.get(branch.id, [])))

    # Bookkeeping.

    def next_name(self) -> str:
        return f"b{len(self.branches) + 1}"

    def points(self) -> int:
        return sum(len(run.points) for run in self.runs)

    def in_budget(self) -> bool:
        return len(self.runs) < self.scene.max_branches and self.points() < self.scene.max_points

    def budget(self) -> tuple[str, int]:
        """The key and the value of the limit that was reached."""
        if len(self.runs) >= self.scene.max_branches:
            return "follow.max_branches", self.scene.max_branches
        return "follow.max_points", self.scene.max_points

    def settings(self) -> Settings:
        left = max(self.scene.max_points - self.points(), 2)
        settings = self.scene.settings
        return replace(settings, max_points=min(settings.max_points, left))

    def tests(self, problem: OrbitProblem) -> list[TestFunction]:
        """The scene's test functions, and what tells where a branch runs into its own image."""
        tests = test_functions(problem, self.scene.events, self.scene.values)
        tests = add_stop_test(tests, symmetric_end(problem))
        self.tested += tests
        return tests

    def walk_progress(self, problem: OrbitProblem, name: str) -> Callable[[int, float], None]:
        shown = problem.word.notation(self.scene.model.letters)
        return walk_progress(f"following {name}, {shown}", self.scene.parameter, self.progress)

    def keep(self, run: Run, name: str, entry: Entry | None, depth: int, began: float) -> None:
        """Tabulate a branch and queue what is born on it; an interruption goes on after that."""
        walked = time.perf_counter()
        in_events = sum(w.seconds_in_events for w in run.walks)
        self.seconds["events"] += in_events
        self.seconds["walk"] += walked - began - in_events
        first = 1 + sum(len(branch.events) for branch in self.branches)
        origin = entry.id if entry else None
        interrupted = is_interrupted(run.ends)
        try:
            branch = run.branch(name, origin, first, kinds=self.scene.events)
        except KeyboardInterrupt:  # the branch is walked, after all
            branch = run.branch(name, origin, first, kinds=self.scene.events)
            interrupted = True
        self.runs.append(run)
        self.branches.append(branch)
        if entry is not None:
            self.opens.setdefault(entry.id, []).append(name)
        events = [e for e in run.events if e.kind in self.scene.events]
        for event, made in zip(events, branch.events, strict=True):
            if made.id != origin:
                self.queue(event, made, depth)
        if ended := [walk for walk in run.walks if walk.end.kind is EndKind.POINTS]:
            key, value = "numerics.max_points", self.scene.settings.max_points
            if all(len(walk.points) < value for walk in ended):
                key, value = "follow.max_points", self.scene.max_points
            self.limits.reached(key, value, "branches ended by it", name)
        self.seconds["tables"] += time.perf_counter() - walked
        if interrupted:
            raise KeyboardInterrupt

    def queue(self, event: Event[Linearisation], entry: Entry, depth: int) -> None:
        """Queue what starts at an event: a branch born there, one switch deeper; where impacts
        exchange their order, that is no switch, and only physical motions are followed. What is
        not asked for is remembered where the motion itself continues on another word."""
        asked = event.kind in self.scene.switch
        if not (self.scene.unphysical or entry.physical):
            if asked and kind_of(event.kind).deeper(event) is not None:
                self.leave_out(NOT_SWITCHED, _entry_text(entry))
            return
        kind = kind_of(event.kind)
        deeper = kind.deeper(event) if asked else None
        if not asked:
            if entry.physical and entry.becomes and kind.continues(event):
                self.left.append(Birth(event, entry, depth))
        elif deeper == 0 and entry.physical:
            self.waiting.append(Birth(event, entry, depth))
        elif deeper and depth < self.scene.depth:
            self.waiting.append(Birth(event, entry, depth + deeper))
        elif deeper:
            self.limits.reached("follow.depth", self.scene.depth, NOT_SWITCHED, _entry_text(entry))

    def throughout(self, word: Word) -> bool:
        """Whether orbits are followed where they are unphysical: those without impacts always, as
        they have one branch of which every picture shows the physical part."""
        return self.scene.unphysical or not word.walls

    def leave_out(self, what: str, name: str) -> None:
        """Record what is not followed since it is unphysical."""
        self.limits.reached("follow.unphysical", False, what, name)

    def note_left(self) -> None:
        """Note where motions continue on branches that were not followed."""
        for birth in self.left:
            entry, start = birth.entry, switch(birth.event)
            if start is None:
                self.note(entry, kind_of(entry.kind).nothing(birth.event))
            elif self.first_step_known(start) is None:
                text = f"the motion continues as {entry.becomes}, which was not followed"
                self.note(entry, f"{text}: add {entry.kind} to follow.switch")

    def note_values(self) -> None:
        """Note requested values that no branch takes."""
        requested = [e.requested for branch in self.branches for e in branch.events if e.requested]
        for name, values in self.scene.values.items():
            taken = [found[name] for found in requested if name in found]
            missed = [f"{value:.9g}" for value in values if float(value) not in taken]
            if missed:
                self.notes.append(f"no branch takes {name} = {', '.join(missed)} (detect.values)")

    def note_marginal(self) -> None:
        """Note branches whose orbits count as stable but attract nothing."""
        names = []
        for branch in self.branches:
            seen = branch.stable & branch.physical
            largest = np.fmax.reduce(np.abs(branch.multipliers[seen]), axis=1, initial=0.0)
            if len(largest) > 2 and abs(np.sort(largest)[len(largest) // 2] - 1.0) < MARGINAL:
                names.append(branch.id)
        if names:
            text = "multipliers lie on the unit circle, as where nothing is lost: orbits called"
            self.notes.append(f"{', '.join(names)}: {text} stable attract nothing")

    def not_found(self) -> list[NotFound]:
        """The words of which no orbit at the start was found, nor a branch that passes it."""
        return [
            lacking
            for word, lacking in self.lacking.items()
            if not any(run.passes(word, self.scene.start) for run in self.runs)
        ]

    def statistics(self) -> dict[str, Any]:
        lacking = self.not_found()
        limits = map(str, self.limits.listed())
        walks = [walk for run in self.runs for walk in run.walks]
        problems = {id(run.problem): run.problem for run in self.runs}
        evaluations = collections.Counter[str]()
        for test in self.tested:
            evaluations[test.kind] += test.evaluations
        return {
            "seconds": self.seconds,
            "counts": {
                "branches": len(self.runs),
                "points": self.points(),
                "corrector_iterations": sum(w.corrector_iterations for w in walks),
                "rejected_steps": sum(w.rejected_steps for w in walks),
                "switches_tried": self.probes,
                "kernel_evaluations": sum(p.kernel_evaluations for p in problems.values()),
            },
            "test_functions": dict(evaluations),
            "kernels": {"loaded": self.kernels.loaded, "generated": self.kernels.generated},
            "not_found": [each.as_record() for each in lacking],
            "notes": [
                *self.notes,
                *limits,
                *(each.told(bool(self.scene.survey)) for each in lacking),
            ],
            "failure": self.failure,
        }


def _entry_text(entry: Entry) -> str:
    return f"{entry.id} ({entry.label})"
