"""How long whole diagrams take: first and later runs of shipped scenes, and which part takes most.

    python benchmarks/scenes.py [SCENE ...] [--against CHECKOUT] [--runs 3]

Each scene is run once in a cache that holds another model's code alone, as on a machine that has
been used, and then once more than `--runs`; pictures are left out. The table has the CPU seconds of
the first run, the median of the last ones, imports included, and what the manifest says of one of
these: wall-clock milliseconds of its parts. With `--against` a checkout of another commit does the
same in turn, with a cache of its own, and the table has the ratio of the medians.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SCENES = ["fig7", "fig8", "stiff", "two_masses", "soft_stop", "duffing", "pendulum"]
SCENES += ["impact_duffing", "coco_piecewise", "coco_bang_bang", "dry_friction"]
ANOTHER = "stop"
"""The scene of the other model."""
PARTS = ("search", "walk", "events", "switching", "tables", "export")


def run(scene: str, checkout: Path, folder: Path, mode: str = "auto") -> tuple[float, dict]:
    """Run a scene as a checkout does; return the CPU seconds and the manifest's wall-clock ones."""
    out = Path(tempfile.mkdtemp(dir=folder)) / scene
    paths = {"CONTIMPACT_CACHE": str(folder / "cache"), "XDG_CACHE_HOME": str(folder / "xdg")}
    environment = {**os.environ, **paths, "PYTHONPATH": str(checkout), "CONTIMPACT_COMPILED": mode}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # as where the package is installed
    file = ROOT / "branches" / scene / "scene.toml"
    command = [sys.executable, "-m", "contimpact", "run", str(file)]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    options = ["--no-plot", "-q", "-o", str(out)]
    subprocess.run([*command, *options], check=True, cwd=checkout, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return seconds, json.loads((out / "manifest.json").read_text("utf-8"))["seconds"]


def row(scene: str, checkouts: list[Path], folders: list[Path], runs: int) -> str:
    """Run a scene in turn as each checkout does; return its row of the table."""
    taken: list[list[float]] = [[] for _ in checkouts]
    parts: dict[str, float] = {}
    for _ in range(runs + 2):
        for one, checkout, folder in zip(taken, checkouts, folders, strict=True):
            seconds, found = run(scene, checkout, folder)
            parts = parts if checkout != ROOT else found
            one.append(seconds)
    own, *others = [statistics.median(one[2:]) for one in taken]
    cells = [scene, f"{taken[0][0]:.1f}", f"{own:.2f}", *(f"{own / other:.2f}" for other in others)]
    return " | ".join([*cells, *(f"{1e3 * parts[name]:.0f}" for name in PARTS)])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scenes", nargs="*", default=SCENES, metavar="SCENE")
    parser.add_argument("--against", type=Path, metavar="CHECKOUT")
    parser.add_argument("--runs", type=int, default=3)
    given = parser.parse_args()
    checkouts = [ROOT, *([given.against.resolve()] if given.against else [])]
    heads = ["scene", "first, s", "later, s", *(["ratio"] if given.against else []), *PARTS]
    print(f"| {' | '.join(heads)} |\n|{'---|' * len(heads)}")
    for scene in given.scenes:
        with tempfile.TemporaryDirectory() as name:
            folders = [Path(name) / str(k) for k in range(len(checkouts))]
            for checkout, folder in zip(checkouts, folders, strict=True):
                folder.mkdir()
                run(ANOTHER, checkout, folder, "always" if checkout == ROOT else "auto")
            print(f"| {row(scene, checkouts, folders, given.runs)} |", flush=True)


if __name__ == "__main__":
    main()
