"""AUTO-07p on the branch: the bare executable, the command ``@r``, and ``@r`` with the compiler."""

from __future__ import annotations

import os
import re
import shutil
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from string import Template

from contestant import HERE, THREADS, Contestant, Sample, Workspace, timed

NAME = "impact_pair"
STEPS = {
    "fixed": {"DS": 0.001, "DSMIN": 0.001, "DSMAX": 0.001, "IADS": 0},
    "adaptive": {"DS": 0.01, "DSMIN": 1e-7, "DSMAX": 0.1, "IADS": 1},
}
LEVELS = (2, 0)
"""Output levels IID: the default and the leanest."""

RUNS = {"fixed": 15, "adaptive": 41, "command": 5}
"""Executions in one round, of the bare executable and of the command; their median counts."""

MANY = 9999


def folder() -> Path | None:
    """Return the folder of the installed AUTO: ``AUTO_DIR``, or what its launcher names."""
    launcher = shutil.which("auto-07p")
    named = os.environ.get("AUTO_DIR", "")
    if not named and launcher:
        text = Path(launcher).read_text(encoding="utf-8", errors="replace")
        found = re.search(r"^\s*AUTO_DIR=(/\S+)", text, re.MULTILINE)
        named = found[1] if found else ""
    return Path(named) if named and (Path(named) / "cmds" / "@r").exists() else None


def missing() -> str:
    """Return what is not installed, or nothing."""
    if folder() is None:
        return "AUTO-07p was not found (is AUTO_DIR set?)"
    return "" if shutil.which("gfortran") else "gfortran was not found"


def contestants(workspace: Workspace) -> list[Contestant]:
    """Return those of this subject."""
    runs = [Auto(workspace.folder, steps, level) for steps in STEPS for level in LEVELS]
    return [Contestant(f"AUTO, {run.steps}, IID = {run.level}", run.measure) for run in runs]


@dataclass(frozen=True)
class Auto:
    """AUTO in a folder of its own, with one kind of steps and one output level."""

    parent: Path
    steps: str
    level: int

    @property
    def folder(self) -> Path:
        return self.parent / f"auto-{self.steps}-{self.level}"

    def measure(self) -> list[Sample]:
        """Compile and run, run by the command, run bare, and start up for one point."""
        self.prepare()
        whole = self.command()
        points = len(self.points())
        command = [self.command() for _ in range(RUNS["command"])]
        pairs = [(self.bare(1), self.bare(MANY)) for _ in range(RUNS[self.steps])]
        return [
            self.sample("bare less start-up", median(b - a for a, b in pairs), points),
            self.sample("start-up alone (NMX = 1)", median(a for a, _ in pairs), 1),
            self.sample("bare executable", median(b for _, b in pairs), points),
            self.sample("command @r", median(command), points),
            self.sample("@r with compiling", whole, points),
        ]

    def sample(self, what: str, seconds: float, points: int) -> Sample:
        """Return a row of the table."""
        return Sample(self.steps, row(what, self.level), seconds, points)

    def prepare(self) -> None:
        """Put equations and constants into an empty folder, which leaves AUTO all to compile."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.folder.mkdir()
        shutil.copy(HERE / "auto" / f"{NAME}.f90", self.folder)
        (self.folder / f"c.{NAME}").write_text(self.constants(MANY))

    def constants(self, most: int) -> str:
        """Return the constants file for so many points at most."""
        text = (HERE / "auto" / f"c.{NAME}").read_text()
        return Template(text).substitute(STEPS[self.steps], IID=self.level, NMX=most)

    def command(self) -> float:
        """Time ``@r``."""
        installed = folder()
        assert installed is not None
        path = f"{installed / 'cmds'}{os.pathsep}{os.environ['PATH']}"
        settings = single() | {"AUTO_DIR": str(installed), "PATH": path}
        return timed([str(installed / "cmds" / "@r"), NAME], cwd=self.folder, env=settings)

    def bare(self, most: int) -> float:
        """Time the executable, which reads its constants from fort.2."""
        (self.folder / "fort.2").write_text(self.constants(most))
        return timed([str(self.folder / f"{NAME}.exe")], cwd=self.folder, env=single())

    def points(self) -> list[list[float]]:
        """Return the points of the last run: the unknowns and the parameter."""
        return [[float(x) for x in (*row[6:10], row[4])] for row in self.rows()]

    def reported(self) -> list[int]:
        """Return the types of the special points among them."""
        return [int(row[2]) for row in self.rows() if row[2] != "0"]

    def rows(self) -> list[list[str]]:
        """Return the lines of fort.7 that are points."""
        rows = [line.split() for line in (self.folder / "fort.7").read_text().splitlines()]
        return [row for row in rows if row[0] != "0"]


def single() -> dict[str, str]:
    """Return an environment with one thread."""
    return os.environ | dict.fromkeys(THREADS, "1")


def row(what: str, level: int) -> str:
    """Return the name of a row."""
    return f"AUTO, {what}, IID = {level}"
