"""Whether the shipped scenes still give the same results, to the last bit.

    python tests/same_results.py record FOLDER [SCENE ...] [--quick]
    python tests/same_results.py compare FOLDER [SCENE ...] [--quick] [--reordered] [--as CPU]

``record`` runs the scenes of ``branches/``, plain and compiled, simulates those with a table
``[simulate]``, reports on them, and keeps in a folder what was written. ``compare`` does the same
with the code of this checkout and names what differs from the recording; its exit status is 1 if
anything does. Both compare compiled results with plain ones, those of `INTEGRATED` and of scenes
with curves as reordered.
``compare branches`` compares with what is committed there, ``compare OLD --with NEW`` one recording
with another.

With ``--as avx2`` or ``--as sse`` scenes run with the arithmetic of a processor without AVX-512, or
without AVX, so that ``compare branches --as avx2 --reordered`` says whether catalogues are the same
there to their stated errors. With ``--reordered`` numbers may differ as far as reordered arithmetic
explains it, see `reordered.py`. Only the command line and the files it writes are used, so that
modules may be moved and renamed freely.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from differences import Difference, differences, is_number, results, table
from reordered import NOISE, UNCOMPARED, Judge

ROOT = Path(__file__).resolve().parent.parent
BRANCHES = ROOT / "branches"
SCENES = sorted(path.parent.name for path in BRANCHES.glob("*/scene.toml"))
QUICK = ["fig3a", "fig6_A", "fig7", "stop"]
SIMULATED_PLAINLY = ["fig3c"]
"""Simulations take minutes plainly; of the others only the compiled ones are compared."""

REPORTED = ["fig7", "stop"]
"""Scenes whose reports are compared. Those of all scenes are recorded: they hold exact values."""

UNREPORTED = ["soft_stop"]
"""It starts from an orbit without impacts, of which there are no reports."""

INTEGRATED = ["belt_free", "coco_bang_bang", "coco_piecewise", "coco_stick_slip"]
INTEGRATED += ["duffing", "impact_duffing", "pendulum"]
"""Scenes whose flights compiled code integrates itself: they differ from plain ones by rounding."""

_NEWEST = "X86_V4 AVX512_ICL AVX512_SPR"
PROCESSORS = {
    "native": {},
    "avx2": {"OPENBLAS_CORETYPE": "Haswell", "NPY_DISABLE_CPU_FEATURES": _NEWEST},
    "sse": {"OPENBLAS_CORETYPE": "Nehalem", "NPY_DISABLE_CPU_FEATURES": f"X86_V3 {_NEWEST}"},
}
"""What OpenBLAS and NumPy are asked for to compute as an older processor does."""

MODES = {"plain": "never", "compiled": "always"}
SHOWN = 3
"""Differences shown of each file."""


def main(arguments: list[str] | None = None) -> int:
    options = parsed(arguments)
    if importlib.util.find_spec("llvmlite") is None:
        MODES.pop("compiled", None)
        print("Compiled results are left out: llvmlite was not found.")
    return record(options) if options.command == "record" else compare(options)


def parsed(arguments: list[str] | None) -> argparse.Namespace:
    """Read the command line."""
    shared = argparse.ArgumentParser(add_help=False)
    shared.add_argument("folder", type=Path, metavar="FOLDER")
    shared.add_argument("scenes", nargs="*", metavar="SCENE", help=f"of {', '.join(SCENES)}")
    text = f"{', '.join(QUICK)} alone, without simulations and reports"
    shared.add_argument("--quick", action="store_true", help=text)
    text = "the checkout whose package runs (default: this one)"
    shared.add_argument("--checkout", type=Path, default=ROOT, metavar="DIR", help=text)
    text = "the processor whose arithmetic is used"
    shared.add_argument("--as", choices=PROCESSORS, default="native", dest="processor", help=text)
    text = "show all differences, not the first of each file"
    shared.add_argument("--all", action="store_true", help=text)
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(required=True, dest="command", metavar="COMMAND")
    first = commands.add_parser("record", parents=[shared], help="run scenes and keep the results")
    first.set_defaults(reordered=False)
    again = commands.add_parser("compare", parents=[shared], help="run them and compare")
    text = "accept what reordered arithmetic explains"
    again.add_argument("--reordered", action="store_true", help=text)
    text = "a recording to compare, instead of running anything"
    again.add_argument("--with", type=Path, dest="made", metavar="FOLDER", help=text)
    options = parser.parse_args(arguments)
    if unknown := sorted(set(options.scenes) - set(SCENES)):
        parser.error(f"no scene {', '.join(unknown)}; there are {', '.join(SCENES)}")
    options.scenes = options.scenes or (QUICK if options.quick else SCENES)
    return options


# Making results.


@dataclasses.dataclass(frozen=True)
class Job:
    """One command for one scene, plain or compiled: a process of its own."""

    mode: str
    scene: str
    command: str

    def __str__(self) -> str:
        return f"{self.scene}, {self.command}, {self.mode}"

    @property
    def folder(self) -> Path:
        return Path(self.mode, self.scene, self.command)

    @property
    def plain(self) -> Job:
        return dataclasses.replace(self, mode="plain")

    def run(self, folder: Path, options: argparse.Namespace) -> None:
        """Write the results into the job's folder below `folder`."""
        checkout = options.checkout
        began = time.perf_counter()
        command = [sys.executable, "-m", "contimpact", self.command]
        command += [str(BRANCHES / self.scene / "scene.toml"), "-o", str(folder / self.folder)]
        command += ["--quiet", "--no-plot", *(["-n", "1"] if self.command == "report" else [])]
        own = {"PYTHONPATH": str(checkout.resolve()), "CONTIMPACT_COMPILED": MODES[self.mode]}
        own |= PROCESSORS[options.processor]
        status = subprocess.run(command, env=os.environ | own, cwd=checkout).returncode
        if status:
            raise SystemExit(f"{self}: exit status {status}")
        print(f"{self}: {time.perf_counter() - began:.1f} s", file=sys.stderr, flush=True)


def jobs(scene: str, quick: bool) -> list[Job]:
    """Return what is run for a scene; of a plain and a compiled job the plain one first."""
    made = [Job(mode, scene, "run") for mode in MODES]
    if not quick and (BRANCHES / scene / "simulation").is_dir():
        modes = [mode for mode in MODES if mode != "plain" or scene in SIMULATED_PLAINLY]
        made += [Job(mode, scene, "simulate") for mode in modes]
    return made if quick or scene in UNREPORTED else [*made, Job("plain", scene, "report")]


def record(options: argparse.Namespace) -> int:
    """Run everything and keep what is written; returns 1 if plain and compiled results differ."""
    made, refused = Results(options.folder.resolve()), 0
    for scene in options.scenes:
        todo = jobs(scene, options.quick)
        for job in todo:
            job.run(made.folder, options)
        refused += compare_scene(todo, None, made, options)
    notes = {"commit": commit(options.checkout)}
    (made.folder / "recording.json").write_text(json.dumps(notes) + "\n", encoding="utf-8")
    print(f"recorded in {options.folder}: commit {notes['commit']}")
    return 1 if refused else 0


def commit(checkout: Path) -> str:
    """Return the commit of a checkout; ``-dirty`` says that files differ from it."""
    command = ["git", "-C", str(checkout), "describe", "--always", "--dirty", "--abbrev=12"]
    return subprocess.check_output(command, text=True).strip()


@dataclasses.dataclass(frozen=True)
class Results:
    """A folder made by ``record``, or the folder of committed results."""

    folder: Path

    @property
    def recorded(self) -> bool:
        return not any((self.folder / scene).is_dir() for scene in SCENES)

    def of(self, job: Job) -> dict[str, Path]:
        """The files of a job by their names; none if there are none."""
        if self.recorded:
            return results(self.folder / job.folder)
        committed = {"run": "", "simulate": "simulation", "report": "report"}
        return results(self.folder / job.scene / committed[job.command])

    def like(self, job: Job) -> dict[str, Path]:
        """The files of a job, or of the same one plain, whose results are the same."""
        return self.of(job) or self.of(job.plain)

    def digits(self, scene: str) -> dict[str, str]:
        """The values of a scene's events in 30 digits, by their ids."""
        path = self.of(Job("plain", scene, "report")).get("report.json")
        events = json.loads(path.read_text(encoding="utf-8"))["events"] if path else []
        return {event["id"]: event["digits"] for event in events if event["digits"]}


# Comparing them.


def compare(options: argparse.Namespace) -> int:
    """Compare everything with the reference; returns 1 if something differs."""
    reference, refused = Results(options.folder), 0
    with tempfile.TemporaryDirectory() as folder:
        made = Results(options.made or Path(folder))
        for scene in options.scenes:
            todo = [job for job in jobs(scene, options.quick) if repeated(job, reference)]
            if not todo:
                raise SystemExit(f"{options.folder} has no results of {scene}")
            for job in () if options.made else todo:
                job.run(made.folder, options)
            refused += compare_scene(todo, reference, made, options)
    return 1 if refused else 0


def repeated(job: Job, reference: Results) -> bool:
    """Whether a job is made again and compared."""
    return bool(reference.like(job)) and (job.command != "report" or job.scene in REPORTED)


def compare_scene(
    todo: list[Job], reference: Results | None, made: Results, options: argparse.Namespace
) -> int:
    """Compare results with a reference and with each other; returns how many are refused."""
    scene = todo[0].scene
    judge = Judge(reference.digits(scene)) if reference and options.reordered else None
    tally = Tally(sys.maxsize if options.all else SHOWN)
    for job in todo:
        compare_job(job, reference, made, judge, tally)
    print(f"{scene}: {tally}", flush=True)
    return tally.refused


def compare_job(
    job: Job, reference: Results | None, made: Results, judge: Judge | None, tally: Tally
) -> None:
    """Compare one job's results; those the same as the plain ones are compared in them."""
    now, plain = made.of(job), made.of(job.plain)
    curves = (BRANCHES / job.scene / "curves").is_dir()  # whose marked points are solved elsewise
    rounded = Judge({}) if curves or job.scene in INTEGRATED else None
    if job != job.plain and plain and tally.add(f"{job}, against plain", plain, now, rounded):
        return
    if reference is not None:
        before = reference.like(job)
        if not reference.recorded:
            now = {name: path for name, path in now.items() if name in before}
        tally.add(str(job), before, now, judge)


class Tally:
    """Counts what was compared and what differs, and prints the first differences.

    Parameters
    ----------
    shown : int
        How many differences of a file are printed.
    """

    def __init__(self, shown: int = SHOWN) -> None:
        self.shown = shown
        self.numbers = self.refused = 0
        self.found: list[Difference] = []

    def add(
        self, title: str, old: dict[str, Path], new: dict[str, Path], judge: Judge | None = None
    ) -> bool:
        """Compare the files of two folders; returns whether they are the same."""
        before = len(self.found)
        for name in sorted(old.keys() | new.keys()):
            cells, others = (table(files[name]) if name in files else {} for files in (old, new))
            found = differences(name, cells, others)
            refused = judge.refused(name, found, cells, others) if judge else found
            self.numbers += sum(map(is_number, others.values()))
            self.found += found
            self.refused += len(refused)
            self.show(title, refused)
        return len(self.found) == before

    def show(self, title: str, refused: list[Difference]) -> None:
        """Print the first differences of a file."""
        for one in refused[: self.shown]:
            print(f"  {title}: {one}")
        if len(refused) > self.shown:
            print(f"  {title}: {refused[0].file}: and {len(refused) - self.shown:,} more")

    def __str__(self) -> str:
        if not self.found and not self.refused:
            return f"{self.numbers:,} numbers, all the same"
        numbers = [one for one in self.found if one.ulps is not None]
        text = f"{self.numbers:,} numbers, {len(numbers):,} differ"
        if sizes := [one.ulps for one in numbers if one.name not in NOISE | UNCOMPARED]:
            text += f", by at most {max(sizes):,} ulp"
        if shares := [one.share for one in numbers if one.share is not None]:
            text += f", {max(shares):.2g} of the stated error"
        if len(self.found) > len(numbers):
            text += f"; {len(self.found) - len(numbers):,} other differences"
        return text + ("" if self.refused else "; all accepted")


if __name__ == "__main__":
    sys.exit(main())
