"""List every end of complex motion in the sweeps of Figs. 8 and 10, and what explains it.

    python docs/figures/ends.py [FIGURE:R ...]

Writes ``ends.csv.xz`` beside this file, or its rows of figures and restitutions as 10c:0.75 again,
and prints how many ends there are of each kind; takes about twenty minutes of two processors. The
text of an end that nothing explains is what was tried.
"""

import csv
import io
import lzma
import multiprocessing
import sys
import tempfile
import tomllib
from collections import Counter
from pathlib import Path

from contimpact.diagrams.crises import CrisisSearch
from contimpact.diagrams.crisis_location import Crisis
from contimpact.diagrams.explore import follow
from contimpact.diagrams.scene_simulation import simulate
from contimpact.results.scene import read_scene
from contimpact.segments.kernels import Kernels

HERE = Path(__file__).parent
BRANCHES = HERE.parents[1] / "branches"
SCENES = {
    "8": "fig8/scene.toml",
    "10a": "fig10/a.toml",
    "10b": "fig10/b.toml",
    "10c": "fig10/c.toml",
}
COLUMNS = ("figure", "r", "kind", "label", "value", "error", "text")
UNUSED = ("study", "energy", "plot")


def scenes(figure):
    """Yield the figure, and its scene at each of its restitutions, followed more deeply."""
    given = tomllib.loads((BRANCHES / SCENES[figure]).read_text("utf-8"))
    grid = given.get("study", {}).get("grid", {}).get("r")
    data = {name: table for name, table in given.items() if name not in UNUSED}
    data["follow"] |= {"switch": ["G", "PD"], "depth": 2, "survey": True, "max_branches": 16}
    simulated = {n: v for n, v in data["simulate"].items() if n != "portraits"}
    data["simulate"] = simulated | {"transitions": False, "branches": False}
    count = grid["count"] if grid else 1
    for k in range(count):
        if grid:
            r = grid["from"] + (grid["to"] - grid["from"]) * k / (count - 1)
            data["model"]["parameters"]["r"] = round(r, 12)
        yield figure, read_scene(data)


def name_of(given):
    """Return the figure and the restitution of a scene as text."""
    figure, scene = given
    values = scene.model.values
    return f"{figure}:{values.get('r_B', values.get('r'))}"


def rows(given):
    """Return a row for each end of complex motion in a scene."""
    (_, scene), (figure, r), found = given, name_of(given).split(":"), []
    with tempfile.TemporaryDirectory() as folder:
        sweep = simulate(scene, Path(folder)).sweep
    kernels = Kernels(sweep.model, sweep.parameter)
    search = CrisisSearch(sweep, follow(scene), kernels)
    for end in search.found_at(search.ends()):
        if isinstance(end, Crisis):
            found.append((figure, r, "CR", end.label, end.value, end.error, str(end)))
        elif (entry := end.entry) is not None:
            known = entry.kind, entry.label, entry.value, entry.error
            found.append((figure, r, *known, end.reason))
        else:
            found.append((figure, r, "", "", "", "", end.reason))
    print(figure, r, len(found), flush=True)
    return found


def main():
    """Write the table."""
    chosen, path = set(sys.argv[1:]), HERE / "ends.csv.xz"
    given = {name_of(pair): pair for figure in SCENES for pair in scenes(figure)}
    again = [name for name in given if name in chosen or not chosen]
    known = list(csv.reader(io.StringIO(lzma.decompress(path.read_bytes()).decode())))[1:]
    found = [row for row in known if f"{row[0]}:{row[1]}" not in again]
    with multiprocessing.Pool() as pool:
        for made in pool.imap(rows, [given[name] for name in again]):
            found += made
    found.sort(key=lambda row: list(given).index(f"{row[0]}:{row[1]}"))
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([COLUMNS, *found])
    path.write_bytes(lzma.compress(text.getvalue().encode()))
    print(len(found), Counter(kind for _, _, kind, *_ in found))


if __name__ == "__main__":
    main()
