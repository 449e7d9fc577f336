"""A scene simulated: sweeps, random starts, transitions, and the comparison with its branches.

Results are kept in a `Checkpoint` as they are found, so that an interrupted run can be resumed. It
then gives the same result: each value of a sweep depends only on the one before, and random starts
depend on the seed and the value's number.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import count_text
from ..progress import Progress, RememberedProgress, ignore_progress
from ..results.catalogue import diagram_files
from ..results.options import Settling, SimulateOptions
from ..results.result_folder import ROWS
from ..results.scene import Scene
from ..segments.kernels import Kernels
from ..simulation.attractor import Attractor, Kind
from ..simulation.files import (
    Checkpoint,
    Trial,
    coverage_text,
    energy_text,
    fingerprint,
    losses_text,
    sweep_text,
    transitions_text,
)
from ..simulation.sweep import Row, Simulators, Sweep, find_attractors, same_attractor, sweep_rows
from ..simulation.transitions import (
    Transition,
    all_changes,
    explain_transition,
    transitions_between,
)
from ..storage import Content, write_all

if TYPE_CHECKING:
    from ..results.diagram import Diagram
    from ..simulation.integrity import BasinFractions
    from ..simulation.simulator import Simulator
    from ..simulation.sweep import Basins, Coverage
    from .crisis_location import Crisis, NoCrisis

STAGES = (
    "branches",
    "sweep",
    "random",
    "swept",
    "crises",
    "transitions",
    "coverage",
    "portraits",
    "basins",
    "fractions",
)
"""After `swept` there are pictures: what follows may take long."""


@dataclass
class Simulation:
    """What `simulate` found."""

    scene: Scene
    sweep: Sweep
    transitions: list[Transition] = field(default_factory=list)
    crises: list[Crisis | NoCrisis] = field(default_factory=list)
    diagram: Diagram | None = None
    """The scene's branches, where [simulate] asks for them."""
    coverage: Coverage | None = None
    """Likewise."""
    portraits: list[Row] = field(default_factory=list)
    """Attractors at the values at which portraits are requested."""
    basins: list[Basins] = field(default_factory=list)
    fractions: BasinFractions | None = None
    interrupted: str | None = None
    """The stage at which the run was interrupted."""
    stopped: str | None = None
    """What was being done then: how far the stage was, at which value."""
    notes: list[str] = field(default_factory=list)
    """Notes of the branches on what they may lack, and on values that have not settled."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Per stage."""
    resumed: int = 0
    """Rows that an earlier run had found."""
    lost: str | None = None
    """Why what was found could not be kept as it was found, if so."""

    @property
    def counts(self) -> dict[str, int]:
        """Numbers of rows, by kind, and of transitions where they were looked for."""
        kinds = [row.attractor.kind.value for row in self.sweep.rows]
        counts = {kind.value: kinds.count(kind.value) for kind in Kind}
        periods = sum(row.attractor.periods for row in self.sweep.rows)
        found = {"attractors": len(kinds)} | {k: n for k, n in counts.items() if n}
        found["periods"] = periods
        if self.scene.simulate is not None and self.scene.simulate.transitions:
            found["transitions"] = len(self.transitions)
        return found


def simulate(
    scene: Scene,
    folder: Path,
    *,
    resume: bool = False,
    progress: Progress | None = None,
    show: Callable[[Simulation], None] | None = None,
) -> Simulation:
    """Simulate a scene with a table [simulate]; what is found is kept in the folder as it is
    found.

    `resume` continues from what is kept there: an `InputError` if that belongs to another scene, or
    is not of one run. `show` is called with the sweeps before transitions between them are located,
    which may take long. An interruption from the keyboard returns what was done until then.
    """
    return _Director(scene, folder, resume, progress or ignore_progress, show).run()


class _Director:
    def __init__(
        self,
        scene: Scene,
        folder: Path,
        resume: bool,
        progress: Progress,
        show: Callable[[Simulation], None] | None,
    ) -> None:
        assert scene.simulate is not None
        self.scene, self.progress, self.show = scene, RememberedProgress(progress), show
        self.options: SimulateOptions = scene.simulate
        kernels = Kernels(scene.model, scene.parameter)
        if self.options.losses:
            from ..simulation.energy import require_masses

            require_masses(scene.model, kernels, "simulate.losses")
        if self.options.crises:
            from .crisis_location import require_one_coordinate

            require_one_coordinate(scene.model, kernels, "simulate.crises")
        digest = fingerprint(scene.resolved())
        self.kept = Checkpoint(folder / ROWS, digest, resume, scene.model)
        self.values = self.options.rising()
        self.kept.check(self.options.sweeps(), set(self.values if self.options.starts else ()))
        self.simulators = Simulators(scene.model, scene.parameter, kernels)
        if self.options.fractions:
            from ..simulation.integrity import require_starts

            simulator = self.simulators.at(self.options.fractions[0])
            require_starts(simulator, self.options.box)
        sweep = Sweep(scene.model, scene.parameter, [])
        self.result = Simulation(scene, sweep, resumed=len(self.kept.rows))

    def run(self) -> Simulation:
        for stage in STAGES:
            began = time.perf_counter()
            try:
                getattr(self, stage)()
            except KeyboardInterrupt:
                self.result.interrupted = self.result.interrupted or stage
                last = re.sub(r", about \d+ s left", "", self.progress.last)
                self.result.stopped = self.result.stopped or last
                if stage in ("sweep", "random"):
                    self.result.sweep = replace(self.result.sweep, interrupted=True)
            self.result.seconds[stage] = time.perf_counter() - began
            if self.result.interrupted:
                break
        self.progress("")
        self.result.lost = self.kept.lost
        return self.result

    def branches(self) -> None:
        if self.options.branches:
            from ..results.diagram import INTERRUPTED
            from .explore import follow

            diagram = follow(replace(self.scene, crises=False), self.progress)
            self.result.diagram = diagram
            self.result.notes += diagram.statistics["notes"]
            failure = diagram.statistics["failure"]
            if failure == INTERRUPTED:
                raise KeyboardInterrupt
            if failure:
                self.result.notes.append(f"branches: {failure}; what was followed is written")

    # Sweeps.

    def sweep(self) -> None:
        """Each direction, going on after the rows there are."""
        self.simulators.kernels.require_room(self.scene.model)
        options, rows = self.options, self.result.sweep.rows
        clock = _Clock("sweep", len(options.sweeps()) * options.values, self.progress)
        for direction, values in options.sweeps():
            known = [row for row in self.kept.rows if row.direction == direction]
            rows += known
            clock.skip(len(known))
            start = known[-1].attractor if known else None
            left = values[len(known) :]
            named = f"{direction} in {self.scene.parameter}"
            for row in sweep_rows(
                self.simulators, left, start, options.settling, options.seed, direction
            ):
                self.kept.keep(row)
                rows.append(row)
                clock.tick(f"{named} = {row.value:.6g}: {row.attractor.notation}")

    def random(self) -> None:
        """Attractors that random starts find besides those of the sweeps."""
        options, rows = self.options, self.result.sweep.rows
        rows += [row for row in self.kept.rows if row.direction == "random"]
        if not options.starts:
            return
        clock = _Clock("random starts", options.values, self.progress)
        for number, value in enumerate(self.values):
            if value in self.kept.tried:
                clock.skip(1)
                continue
            known = [row.attractor for row in rows if row.value == value]
            simulator, rng = self.simulators.at(value), (options.seed, number)
            found = find_attractors(
                simulator, options.starts, rng=rng, settling=options.settling, known=known
            )
            for attractor in found:
                row = Row("random", value, attractor)
                self.kept.keep(row)
                rows.append(row)
            self.kept.keep_tried(value)
            clock.tick(f"{self.scene.parameter} = {value:.6g}")

    # What follows from them.

    @cached_property
    def changes(self) -> list[tuple[Row, Row]]:
        """The neighbouring rows between which transitions are to be located."""
        asked = self.options.transitions
        about = self.result.sweep, self.simulators, self.options.settling
        pairs = all_changes(*about) if asked else []
        if isinstance(asked, bool):
            return pairs
        return [pair for pair in pairs if {row.attractor.period for row in pair} & {*asked}]

    def swept(self) -> None:
        """Note what has not settled, and show the sweeps, unless all transitions are known."""
        self.result.notes += _notes_on_unsettled(self.result.sweep)
        left = [pair for pair in self.changes if _key_of(pair) not in self.kept.changes]
        if left and self.show is not None:
            self.result.interrupted = "transitions"  # if nothing follows
            self.result.stopped = f"transitions: 0 of {len(left)}"
            self.show(self.result)
            self.result.interrupted = self.result.stopped = None

    def crises(self) -> None:
        if self.options.crises and self.result.diagram is not None:
            from .crises import add_crises, collect_crises

            self.progress("locating crises")
            found, diagram = self.result.crises, self.result.diagram
            try:
                collect_crises(self.result.sweep, diagram, found)
            finally:
                self.result.diagram = add_crises(diagram, found)

    def transitions(self) -> None:
        sweep, diagram = self.result.sweep, self.result.diagram
        pairs = self.changes
        clock = _Clock("transitions", len(pairs), self.progress, self.seconds_each())
        simulators = _KeptSimulators(self.simulators, clock, self.kept)
        for before, after in pairs:
            key = _key_of((before, after))
            if key not in self.kept.changes:
                found = transitions_between(
                    simulators, before, after, self.options.width, self.options.settling
                )
                self.kept.keep_changes(*key, list(found))
                clock.tick(f"{self.scene.parameter} = {after.value:.6g}")
            else:
                clock.skip(1)
            self.result.transitions += [
                explain_transition(t, diagram, sweep) if diagram else t
                for t in self.kept.changes[key]
            ]

    def seconds_each(self) -> float:
        """How long it takes to locate a transition, by the time for a value of the sweep."""
        values = max(len(self.result.sweep.rows) - self.result.resumed, 1)
        span = (self.values[-1] - self.values[0]) / max(len(self.values) - 1, 1)
        halvings = math.log2(max(span / self.options.width, 1.0))
        return halvings * self.result.seconds.get("sweep", 0.0) / values

    def coverage(self) -> None:
        if self.result.diagram is not None:
            from ..simulation.sweep import cover

            self.progress("matching attractors with branches")
            kernels = self.simulators.kernels
            self.result.coverage = cover(self.result.sweep, self.result.diagram, kernels)

    def portraits(self) -> None:
        """The attractor at each requested value, reached from the first sweep's row before it."""
        first = self.options.sweeps()[0][0]
        for value in self.options.portraits:
            self.progress(f"portrait at {self.scene.parameter} = {value:.6g}")
            self.result.portraits.append(self.at(value, first))

    def at(self, value: float, direction: str) -> Row:
        """The attractor at a value, reached from a sweep's row before it."""
        rows = self.result.sweep.of(direction)
        sign = 1.0 if rows[-1].value >= rows[0].value else -1.0
        earlier = [row for row in rows if sign * (value - row.value) >= 0.0] or rows[:1]
        start, options = earlier[-1].attractor, self.options
        return next(
            sweep_rows(self.simulators, [value], start, options.settling, options.seed, direction)
        )

    def basins(self) -> None:
        from ..simulation.sweep import basins

        for value in self.options.basins:
            shown = f"basins at {self.scene.parameter} = {value:.6g}"
            known: list[Attractor] = []
            for direction, _ in self.options.sweeps():
                attractor = self.at(value, direction).attractor
                if attractor.settled and not any(
                    same_attractor(attractor, other) for other in known
                ):
                    known.append(attractor)
            simulator = self.simulators.at(value)

            def report(done: int, total: int, shown: str = shown) -> None:
                self.progress(f"{shown}: {done} of {count_text(total, 'start')}")

            shape, settling = (self.options.grid,) * 2, self.options.settling
            found = basins(simulator, shape=shape, settling=settling, known=known, callback=report)
            if found.attractors:
                self.result.basins.append(found)
            if found.interrupted:
                raise KeyboardInterrupt

    def fractions(self) -> None:
        options = self.options
        if options.fractions:
            from ..simulation.integrity import basin_fractions

            self.result.fractions = basin_fractions(
                self.scene.model,
                self.scene.parameter,
                options.fractions,
                starts=options.fraction_starts,
                box=options.box,
                refine=options.refine,
                settling=options.settling,
                rng=options.seed,
                progress=self.progress,
            )
            if self.result.fractions.interrupted:
                raise KeyboardInterrupt


def _notes_on_unsettled(sweep: Sweep) -> Iterator[str]:
    """What is not known of a sweep whose motion has not settled at some values."""
    for way in sweep.directions:
        rows = sweep.of(way)
        unsettled = [row for row in rows if not row.attractor.settled]
        advice = "more simulate.periods or, for complex motion, simulate.impacts may tell it"
        for why in dict.fromkeys(row.attractor.broken_off for row in unsettled):
            values = [row.value for row in unsettled if row.attractor.broken_off == why]
            yield (
                f"{way}: {len(values)} of {count_text(len(rows), 'motion')} did not settle, the "
                f"first at {sweep.parameter} = {values[0]:.6g}; no attractor is known there: "
                f"{why or advice}"
            )


def _key_of(pair: tuple[Row, Row]) -> tuple[str, float]:
    """What a change between two rows is known by."""
    return pair[1].direction, pair[1].value


class _Clock:
    """Progress of a stage, with an estimate of the time left: from the pieces done, or from the
    seconds that each is expected to take."""

    def __init__(self, stage: str, total: int, progress: Progress, each: float = 0.0) -> None:
        self.stage, self.total, self.progress = stage, total, progress
        self.done, self.timed, self.each = 0, 0, each
        self.began = time.perf_counter()
        if total:
            progress(self.place)

    @property
    def place(self) -> str:
        """How far it is, and how long the rest takes."""
        each = (time.perf_counter() - self.began) / self.timed if self.timed else self.each
        left = f", about {each * (self.total - self.done):.0f} s left" if each else ""
        return f"{self.stage}: {self.done} of {self.total}{left}"

    def skip(self, count: int) -> None:
        self.done += count

    def working(self, text: str) -> None:
        """Tell what is done for the next piece."""
        self.progress(f"{self.place}; {text}")

    def tick(self, text: str) -> None:
        self.done += 1
        self.timed += 1
        self.progress(f"{self.place}; {text}")


class _KeptSimulators(Simulators):
    """Simulators that tell which value is tried, and keep what attractors lead to there."""

    def __init__(self, own: Simulators, clock: _Clock, kept: Checkpoint) -> None:
        super().__init__(own.model, own.parameter, own.kernels)
        self.clock, self.kept = clock, kept

    def at(self, value: float) -> Simulator:
        self.clock.working(f"trying {self.parameter} = {value:.9g}")
        return super().at(value)

    def lead(self, attractor: Attractor, value: float, settling: Settling) -> Attractor | None:
        """What was found before an interruption is not sought again."""
        known = self.kept.next_trial(value, settling.periods)
        if known is not None:
            return known.attractor
        found = super().lead(attractor, value, settling)
        self.kept.keep_trial(Trial(value, settling.periods, found))
        return found


def write_simulation(result: Simulation, folder: Path) -> list[str]:
    """Write the tables of a simulation, also of an interrupted one; returns the files' names."""
    scene = result.scene
    stopped = result.stopped or result.interrupted
    files: dict[str, Content] = {"sweep.csv": lambda: sweep_text(result.sweep, stopped)}
    assert scene.simulate is not None
    if scene.simulate.transitions:
        files["transitions.json"] = partial(
            transitions_text, result.transitions, scene.parameter, scene.simulate.width
        )
    if scene.simulate.crises:
        from .crises import crises_text

        files["crises.json"] = partial(crises_text, result.crises, scene.parameter)
    if result.fractions is not None:
        from ..simulation.integrity import fractions_text

        files["fractions.csv"] = partial(fractions_text, result.fractions)
    if result.coverage is not None:
        files["coverage.json"] = partial(coverage_text, result.coverage, scene.parameter)
    if scene.simulate.losses:
        kernels = Kernels(scene.model, scene.parameter)
        files["losses.csv"] = partial(losses_text, result.sweep, kernels)
    if scene.energy is not None:
        files["energy.csv"] = partial(energy_text, scene.energy, result.sweep, result.diagram)
    if result.diagram is not None:
        files |= diagram_files(result.diagram)
    return sorted(write_all(folder, files))
