"""What a point costs where flights are integrated, beside closed forms and beside AUTO-07p.

    python benchmarks/pendulum.py [--runs 5]

The pendulum without impacts, in omega over two folds, by contimpact and by AUTO's collocation; the
linear oscillator with a stop by its closed form and as if it had none. All take turns; ratios are
formed within a round. Seconds are those of the processor. See README.md next to this file.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Any

import auto07p
import numpy as np
from contestant import HERE, Contestant, Measured, Sample, Workspace, interleaved, say, timed
from report import machine_text
from table import both, each, grid, number, over, whole

from contimpact import Formulas, Oscillator, Settings, find_orbits
from contimpact.bifurcations.kind import test_functions
from contimpact.continuation.branch import Walk
from contimpact.diagrams.orbit_walks import walk_orbits
from contimpact.models.guards import Word
from contimpact.models.nonlinear import Nonlinear
from contimpact.orbits.problem import Array, OrbitProblem
from contimpact.orbits.quiet import problem_of
from contimpact.orbits.search import solve_near
from contimpact.segments.kernels import Kernels
from contimpact.systems.pendulum import Pendulum

PENDULUM = {"a": 0.15, "omega": 1.2, "c": 0.1, "sigma": 3.0, "r": 0.8}
RANGE = (0.5, 1.2)
"""The branch starts at the upper end; `auto/pendulum.f90` and `auto/c.pendulum` repeat these."""

FOLDS = (0.7806326535189843716, 0.8721575691379171749)
"""Omega at the folds, by `reference_folds.py`."""

MESHES = ((20, 4), (50, 4), (100, 4))
"""Intervals NTST and collocation points NCOL of AUTO."""

KINDS = ("FB", "BP", "PD", "NS")
LOOKS = {"": False, ", and touches of the stop": True}
FIRST = "contimpact, FB, BP, PD, NS as AUTO"

OSCILLATOR = {"a": 1.0, "omega": 0.8, "c": 0.1, "k": 1.0, "sigma": 1.0, "r": 0.8}
WORDS = {"0": (0.8, 1.6), "S": (0.8, 1.6)}
WALKS, RUNS, MANY = 3, 3, 9999
"""Walks, and executions of AUTO, in one round, whose medians count; more points than there are."""


class Integrated(Oscillator):
    """The linear oscillator with a stop, as if its flights had no closed form."""

    SYSTEM = "integrated-oscillator"

    def formulas(self, symbols: Any) -> Formulas:
        """As the oscillator's, but for the flight."""
        known = super().formulas(symbols)
        return Formulas(**vars(known) | {"flight": Nonlinear(known.acceleration).flight})


FLIGHTS = {"closed form": Oscillator, "integrated": Integrated}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=5, help="rounds (default: %(default)s)")
    runs = parser.parse_args().runs
    with tempfile.TemporaryDirectory() as folder:
        print(measured(Workspace(Path(folder)), runs))


def measured(workspace: Workspace, runs: int) -> str:
    """Let all measure in turn; returns the tables."""
    head = f"{machine_text()}. Rounds: {runs}; medians, and the least and the largest."
    parts, entered = ["# Integrated flights", head], [own(workspace)]
    runners = [] if auto07p.missing() else [Auto(workspace.folder, *mesh) for mesh in MESHES]
    for run in runners:
        run.prepare()
        entered.append(Contestant(run.row, run.measure))
    if reason := auto07p.missing():
        parts.append(f"AUTO's rows are left out: {reason}.")
        say(parts[-1])
    samples = interleaved(entered, runs)
    errors = {FIRST + more: workspace.call("pendulum.errors", more) for more in LOOKS}
    errors |= {run.row: distances(run.folds()) for run in runners}
    parts += ["## The pendulum without impacts, two folds", pendulum_table(samples, errors)]
    parts += ["## The linear oscillator with a stop", oscillator_table(samples)]
    apart = {word: workspace.call("pendulum.apart", word) for word in WORDS}
    said = ", ".join(f"{d:.1e} for word {word}" for word, d in apart.items())
    return "\n\n".join([*parts, f"Closed form and integration differ at most by {said}."])


def own(workspace: Workspace) -> Contestant:
    """Return the contestant that is contimpact, plain: integrated flights are compiled anyway."""
    return Contestant(
        "contimpact", lambda: [Sample(*row) for row in workspace.call("pendulum.walks")]
    )


@dataclass(frozen=True)
class Auto:
    """AUTO in a folder of its own, with one mesh."""

    parent: Path
    intervals: int
    points: int

    @property
    def row(self) -> str:
        return f"AUTO, NTST = {self.intervals}, NCOL = {self.points}"

    @property
    def folder(self) -> Path:
        return self.parent / f"auto-{self.intervals}-{self.points}"

    def prepare(self) -> None:
        """Compile, by the command ``@r`` for one point."""
        self.folder.mkdir()
        shutil.copy(HERE / "auto" / "pendulum.f90", self.folder)
        self.write("c.pendulum", 1)
        installed = auto07p.folder()
        assert installed is not None
        path = f"{installed / 'cmds'}{os.pathsep}{os.environ['PATH']}"
        settings = auto07p.single() | {"AUTO_DIR": str(installed), "PATH": path}
        timed([str(installed / "cmds" / "@r"), "pendulum"], cwd=self.folder, env=settings)

    def write(self, name: str, most: int) -> None:
        """Write the constants for so many points at most."""
        text = Template((HERE / "auto" / "c.pendulum").read_text())
        mesh = {"NTST": self.intervals, "NCOL": self.points, "NMX": most}
        (self.folder / name).write_text(text.substitute(mesh))

    def measure(self) -> list[Sample]:
        """Time the executable less its start-up, which is a run for one point."""
        seconds = [-self.run(1) + self.run(MANY) for _ in range(RUNS)]
        return [Sample("pendulum", self.row, statistics.median(seconds), len(self.rows()))]

    def run(self, most: int) -> float:
        """Return the processor's seconds of a run."""
        self.write("fort.2", most)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        timed([str(self.folder / "pendulum.exe")], cwd=self.folder, env=auto07p.single())
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    def rows(self) -> list[list[str]]:
        """Return the lines of fort.7 that are points."""
        rows = [line.split() for line in (self.folder / "fort.7").read_text().splitlines()]
        return [row for row in rows if row[0] != "0"]

    def folds(self) -> list[float]:
        """Return omega at the folds, which have the type 5."""
        return [float(row[4]) for row in self.rows() if row[2] == "5"]


def distances(found: Sequence[float]) -> list[float]:
    """Return how far folds are from the reference; it is an error if they are not two."""
    if len(found) != len(FOLDS):
        raise RuntimeError(f"folds at {found}, not near {FOLDS}")
    return [abs(one - other) for one, other in zip(sorted(found), FOLDS, strict=True)]


def pendulum_table(samples: Measured, errors: dict[str, list[float]]) -> str:
    """Return costs and errors, with contimpact's first row as the unit."""
    rows = samples["pendulum"]
    unit = rows[FIRST]
    lines = [
        [row, *cost(s), both(over(each(s), each(unit))), both(over(whole(s), whole(unit)))]
        for row, s in rows.items()
    ]
    lines = [[*line, f"{max(errors[line[0]]):.1e}"] for line in lines]
    header = ["", "points", "us per point", "per point, ratio", "whole, ratio", "error of folds"]
    return grid(header, lines)


def oscillator_table(samples: Measured) -> str:
    """Return costs, with the closed form as the unit."""
    rows = samples["oscillator"]
    lines = [
        [name, *cost(rows[name]), both(over(each(rows[name]), each(rows[unit])))]
        for word in WORDS
        for unit in (oscillator_row(word, "closed form"),)
        for name in (oscillator_row(word, flight) for flight in FLIGHTS)
    ]
    return grid(["", "points", "us per point", "per point, ratio"], lines)


def oscillator_row(word: str, flight: str) -> str:
    """Return the name of a row."""
    return f"word {word}, {flight}"


def cost(samples: Sequence[Sample]) -> list[str]:
    """Return the cells for the number of points and the cost of one."""
    micro = statistics.median(each(samples)) * 1e6
    return [str(samples[0].count), number(micro)]


# In the child.


def walks() -> list[tuple[str, str, float, int]]:
    """Time all walks of contimpact."""
    start = pendulum()
    return [
        *(
            ("pendulum", FIRST + more, *median_walk(lambda t=t: follow(*start, RANGE, KINDS, t)))
            for more, t in LOOKS.items()
        ),
        *(
            ("oscillator", oscillator_row(word, flight), *median_walk(oscillator(word, flight)))
            for word in WORDS
            for flight in FLIGHTS
        ),
    ]


def median_walk(task: Callable[[], Walk]) -> tuple[float, int]:
    """Return the processor's seconds of a walk and its points, after one that does not count."""
    points, seconds = len(task().points), []
    for _ in range(WALKS):
        began = time.process_time()
        task()
        seconds.append(time.process_time() - began)
    return statistics.median(seconds), points


def pendulum() -> tuple[OrbitProblem, Array, int]:
    """Return equations, start and direction, from the response of small oscillations."""
    problem = problem_of(Pendulum(**PENDULUM), Word("", 1), Kernels(Pendulum(**PENDULUM), "omega"))
    found = solve_near(problem, np.array([-0.3, 0.1, PENDULUM["omega"]]))
    assert found is not None
    return problem, found.unknowns, -1


def oscillator(word: str, flight: str) -> Callable[[], Walk]:
    """Return the walk up in omega, events on, from the first orbit that the closed form has."""
    found = find_orbits(Oscillator(**OSCILLATOR), word, parameter="omega")[0]
    system = FLIGHTS[flight](**OSCILLATOR)
    problem = problem_of(system, found.word, Kernels(system, "omega"))
    kinds = (*KINDS, "G", "V") if word != "0" else KINDS
    return lambda: follow(problem, found.unknowns, 1, WORDS[word], kinds, True)


def follow(
    problem: OrbitProblem,
    unknowns: Array,
    direction: int,
    limits: tuple[float, float],
    kinds: Sequence[str],
    touches: bool,
) -> Walk:
    """Walk through the range, with events located on the way."""
    tests = test_functions(problem, kinds, {})
    given: dict[str, Any] = {"limits": limits, "settings": Settings()}
    return walk_orbits(problem, unknowns, direction, tests=tests, gaps=touches, **given)


def errors(more: str) -> list[float]:
    """Return how far the pendulum's folds are from the reference."""
    walked = follow(*pendulum(), RANGE, KINDS, LOOKS[more])
    return distances([event.parameter for event in walked.events if event.kind == "FB"])


def apart(word: str) -> float:
    """Return how far the orbits of both flights are from each other, at the points of one."""
    closed, integrated = (oscillator(word, flight)() for flight in FLIGHTS)
    rows = [[p.unknowns for p in walked.points] for walked in (closed, integrated)]
    return float(np.max(np.abs(np.subtract(*rows))))


if __name__ == "__main__":
    sys.exit(main())
