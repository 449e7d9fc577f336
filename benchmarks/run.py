"""Measures contimpact, AUTO-07p and natural continuation side by side.

    python benchmarks/run.py [--runs 7] [--only NAME ...] [-o FOLDER] [--history]

All contestants are measured in turn, round after round, on one thread each. Seconds depend on the
machine; ratios are formed within a round. See README.md next to this file.
"""

from __future__ import annotations

import argparse
import csv
import datetime
import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import auto07p
import branch
import figure6
import natural
import simulation
import words
from agreement import checks
from contestant import COMPILED, Workspace, interleaved, say
from report import Results

SUBJECTS = {
    "branch": branch,
    "auto": auto07p,
    "natural": natural,
    "words": words,
    "simulation": simulation,
    "figure6": figure6,
}

HISTORY = Path(__file__).resolve().parent / "history.csv"
"""Ratios so far: day, commit, rounds, table, row, what it is a multiple of, and the median."""


def main() -> int:
    options = parsed()
    with tempfile.TemporaryDirectory() as folder:
        results = measure(Workspace(Path(folder)), options.only, options.runs)
    print(results.as_text())
    if options.output:
        write(results, options.output)
    if options.history:
        remember(results)
    return 0 if all(check.holds for check in results.checks) else 1


def parsed() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=7, help="rounds (default: %(default)s)")
    parser.add_argument(
        "--only",
        nargs="+",
        choices=SUBJECTS,
        default=list(SUBJECTS),
        metavar="NAME",
        help=f"measure these only, of {', '.join(SUBJECTS)}",
    )
    parser.add_argument("-o", "--output", type=Path, help="folder for results.json and results.md")
    parser.add_argument("--history", action="store_true", help=f"add the ratios to {HISTORY.name}")
    options = parser.parse_args()
    if options.runs < 1:
        parser.error("--runs: give at least 1")
    return options


def measure(workspace: Workspace, subjects: list[str], runs: int) -> Results:
    """Measure some subjects in interleaved rounds, and check what was computed."""
    results = Results(runs)
    if not COMPILED:
        results.skipped.append("The rows of compiled code are left out: llvmlite was not found.")
    if "auto" in subjects and (reason := auto07p.missing()):
        results.skipped.append(f"AUTO's rows and all ratios to it are left out: {reason}.")
        subjects = [name for name in subjects if name != "auto"]
    for note in results.skipped:
        say(note)
    if "branch" in subjects:
        say("first processes, nothing cached")
        results.first = branch.first_runs(workspace)
    entered = [one for name in subjects for one in SUBJECTS[name].contestants(workspace)]
    before = load()
    results.measured = interleaved(entered, runs)
    results.load = (*before, *load())
    results.checks = checks(workspace, subjects)
    return results


def load() -> tuple[float, ...]:
    """Return how many processes the machine ran in the last minute, where it can tell."""
    return os.getloadavg()[:1] if hasattr(os, "getloadavg") else ()


def remember(results: Results) -> None:
    """Add the medians of the ratios to AUTO to the history, a line each."""
    head = ["git", "-C", str(HISTORY.parent), "describe", "--always", "--dirty"]
    commit = subprocess.run(head, check=True, capture_output=True, text=True).stdout.strip()
    day = datetime.date.today().isoformat()
    with HISTORY.open("a", encoding="utf-8", newline="") as file:
        lines = csv.writer(file, lineterminator="\n")
        for table, rows in results.as_data()["ratios"].items():
            for row, references in rows.items():
                for reference, found in references.items():
                    ratio = f"{statistics.median(found):.3g}"
                    lines.writerow([day, commit, len(found), table, row, reference, ratio])


def write(results: Results, folder: Path) -> None:
    """Write results.json and results.md."""
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(results.as_data(), indent=1)
    (folder / "results.json").write_text(text + "\n", encoding="utf-8")
    (folder / "results.md").write_text(results.as_text(), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
