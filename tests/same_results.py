"""Whether the shipped scenes still give the same results, to the last bit.

    python tests/same_results.py record FOLDER [SCENE ...]
    python tests/same_results.py compare FOLDER [SCENE ...] [--quick] [--reordered]

``record`` runs the scenes of ``branches/``, plain and compiled, simulates those with a table
``[simulate]``, reports on them, and keeps in a folder what was written. ``compare`` does the same
again with the code of this checkout and names every cell that differs; its exit status is 1 if one
does. It also compares the compiled results with the plain ones. ``compare branches`` compares with
what is committed there.

With ``--reordered`` numbers may differ where arithmetic was reordered, see `reordered.py`. Only the
command line and the files it writes are used, so modules may be moved and renamed freely.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from differences import Difference, differences, is_number, results, table
from reordered import Judge

ROOT = Path(__file__).resolve().parent.parent
BRANCHES = ROOT / "branches"
SCENES = sorted(path.parent.name for path in BRANCHES.glob("*/scene.toml"))
QUICK = ["fig3a", "fig6a", "fig7", "stop"]
REPORTED = ["fig7", "stop"]
"""Scenes whose reports are compared; of the others they serve as the exact values of events."""

MODES = {"plain": "never", "compiled": "always"}
SHOWN = 8
"""Differences shown for each file."""


def main(arguments: list[str] | None = None) -> int:
    options = parsed(arguments)
    return options.does(options)


def parsed(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    shared = argparse.ArgumentParser(add_help=False)
    shared.add_argument("folder", type=Path, metavar="FOLDER")
    shared.add_argument("scenes", nargs="*", metavar="SCENE", help=f"of {', '.join(SCENES)}")
    shared.add_argument(
        "--quick", action="store_true",
        help=f"only run {', '.join(QUICK)}: no simulations, no reports",
    )  # fmt: skip
    shared.add_argument(
        "--checkout", type=Path, default=ROOT, help="whose package to run (default: this one)"
    )
    record_parser = commands.add_parser("record", parents=[shared], help="run, and keep results")
    record_parser.set_defaults(does=record)
    compare_parser = commands.add_parser("compare", parents=[shared], help="run, and compare")
    compare_parser.add_argument(
        "--reordered", action="store_true", help="accept what reordered arithmetic explains"
    )
    compare_parser.add_argument("--keep", type=Path, help="folder for the new results")
    compare_parser.set_defaults(does=compare)
    options = parser.parse_args(arguments)
    if unknown := set(options.scenes) - set(SCENES):
        parser.error(f"no scene {', '.join(sorted(unknown))}; there are {', '.join(SCENES)}")
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

    def run(self, folder: Path, checkout: Path) -> None:
        """Write the results into the job's folder below `folder`."""
        began = time.perf_counter()
        command = [sys.executable, "-m", "contimpact", self.command]
        command += [str(BRANCHES / self.scene / "scene.toml"), "-o", str(folder / self.folder)]
        command += ["--quiet", "--no-plot", *(["-n", "1"] if self.command == "report" else [])]
        own = {"PYTHONPATH": str(checkout), "CONTIMPACT_COMPILED": MODES[self.mode]}
        status = subprocess.run(command, env=os.environ | own, cwd=checkout).returncode
        if status:
            raise SystemExit(f"{self}: exit status {status}")
        print(f"{self}: {time.perf_counter() - began:.1f} s", file=sys.stderr, flush=True)


def jobs(scenes: list[str], quick: bool) -> list[Job]:
    """What is run for some scenes."""
    made = []
    for scene in scenes:
        made += [Job(mode, scene, "run") for mode in MODES]
        if not quick and (BRANCHES / scene / "simulation").is_dir():
            made += [Job(mode, scene, "simulate") for mode in MODES]
        if not quick:
            made.append(Job("plain", scene, "report"))
    return made


def record(options: argparse.Namespace) -> int:
    """Run everything and keep what is written."""
    folder = options.folder.resolve()
    for job in jobs(options.scenes, options.quick):
        job.run(folder, options.checkout)
    notes = {"commit": commit(options.checkout), "scenes": options.scenes}
    (folder / "recording.json").write_text(json.dumps(notes) + "\n", encoding="utf-8")
    print(f"recorded in {folder}, of commit {notes['commit']}")
    return 0


def commit(checkout: Path) -> str:
    """Return the commit of a checkout; ``-dirty`` says that files differ from it."""
    command = ["git", "-C", str(checkout), "describe", "--always", "--dirty", "--abbrev=12"]
    return subprocess.check_output(command, text=True).strip()


# Comparing them.


def compare(options: argparse.Namespace) -> int:
    """Run everything again and compare it; returns 1 if something differs."""
    reference = Reference(options.folder.resolve())
    repeated = [job for job in jobs(options.scenes, options.quick) if reference.repeats(job)]
    if missing := set(options.scenes) - {job.scene for job in repeated}:
        raise SystemExit(f"{options.folder} has no {', '.join(sorted(missing))}")
    with tempfile.TemporaryDirectory() as temporary:
        made = (options.keep or Path(temporary)).resolve()
        for job in repeated:
            job.run(made, options.checkout)
        counts = [
            compare_scene(scene, [job for job in repeated if job.scene == scene], reference, made,
                          options.reordered)
            for scene in options.scenes
        ]  # fmt: skip
    return 1 if any(counts) else 0


@dataclasses.dataclass(frozen=True)
class Reference:
    """A folder made by ``record``, or the folder of committed results."""

    folder: Path

    @property
    def recorded(self) -> bool:
        return (self.folder / "recording.json").exists()

    def of(self, job: Job) -> Path:
        """The results of a job."""
        if self.recorded:
            return self.folder / job.folder
        return self.folder / job.scene / {"run": "", "simulate": "simulation"}.get(job.command, "-")

    def repeats(self, job: Job) -> bool:
        """Whether a job is made again and compared."""
        return self.of(job).is_dir() and (job.command != "report" or job.scene in REPORTED)

    def digits(self, scene: str) -> dict[str, str]:
        """The values of a scene's events in 30 digits, by their ids."""
        path = self.of(Job("plain", scene, "report")) / "report.json"
        events = json.loads(path.read_text(encoding="utf-8"))["events"] if path.exists() else []
        return {event["id"]: event["digits"] for event in events if event["digits"]}


def compare_scene(
    scene: str, made_again: list[Job], reference: Reference, made: Path, reordered: bool
) -> int:
    """Compare all of one scene and say so; returns how many differences are not accepted."""
    judge = Judge(reference.digits(scene)) if reordered else None
    tally = Tally()
    for job in made_again:
        now = results(made / job.folder)
        before = results(reference.of(job))
        if not reference.recorded:
            now = {name: path for name, path in now.items() if name in before}
        tally.add(f"{job}", before, now, judge)
        if job.mode == "compiled":
            plain = dataclasses.replace(job, mode="plain")
            tally.add(
                f"{job} against plain", results(made / plain.folder), results(made / job.folder)
            )
    print(f"{scene}: {tally}", flush=True)
    return tally.refused


class Tally:
    """Counts of what was compared and of what differs, which it prints."""

    def __init__(self) -> None:
        self.numbers = self.refused = 0
        self.found: list[Difference] = []

    def add(
        self, title: str, old: dict[str, Path], new: dict[str, Path], judge: Judge | None = None
    ) -> None:
        """Compare the files of two folders."""
        for name in sorted(old.keys() | new.keys()):
            before, now = (table(files[name]) if name in files else {} for files in (old, new))
            self.numbers += sum(map(is_number, now.values()))
            found = differences(name, before, now)
            self.found += found
            refused = [one for one in found if not (judge and judge.accepts(one, before, now))]
            if judge and name == "catalogue.json":
                refused += judge.wrong(name, now)
            self.refused += len(refused)
            show(title, refused)

    def __str__(self) -> str:
        numbers = [one for one in self.found if one.ulps is not None]
        text = f"{self.numbers:,} numbers, "
        if not self.found and not self.refused:
            return text + "all the same"
        text += f"{len(numbers):,} differ"
        if numbers:
            text += f", by at most {max(one.ulps for one in numbers):,} ulp"
        if shares := [one.share for one in numbers if one.share is not None]:
            text += f", {max(shares):.2g} of the stated error"
        if others := len(self.found) - len(numbers):
            text += f"; {others:,} other differences"
        return text + f"; {self.refused:,} not accepted"


def show(title: str, refused: list[Difference]) -> None:
    """Print the first differences of a file."""
    for one in refused[:SHOWN]:
        print(f"  {title}: {one}")
    if len(refused) > SHOWN:
        print(f"  {title}: {refused[0].file}: and {len(refused) - SHOWN:,} more")


if __name__ == "__main__":
    sys.exit(main())
