"""``contimpact simulate``: tables, pictures, interruption and resumption, refused scenes."""

from __future__ import annotations

import csv
import functools
import json
import shutil
import subprocess
import sys
import tomllib

import numpy as np
import pytest
from zoo import SMALL

from contimpact import cli
from contimpact.diagrams import scene_simulation
from contimpact.errors import InputError
from contimpact.plots.attractors import plot_sweep
from contimpact.results.result_folder import ROWS, WRITTEN, own_files
from contimpact.results.scene import read_scene
from contimpact.simulation.files import sweep_of

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

SCENE = SMALL.replace('["PD", "G"]', '["FB", "PD", "G"]')
SCENE += """[plot]
x = "d"
formats = ["png"]
[simulate]
range = [0.33, 0.39]
values = 7
direction = "both"
periods = 300
impacts = 600
width = 1e-3
"""
TABLES = ("sweep.csv", "transitions.json", "rows.jsonl")


@pytest.fixture
def scene_file(tmp_path):
    def write(text=SCENE, **tables):
        path = tmp_path / "scene.toml"
        extra = "".join(f"{value}\n" for value in tables.values())
        path.write_text(text + extra, encoding="utf-8")
        return str(path)

    return write


def run(*arguments):
    return cli.main(["simulate", *map(str, arguments)])


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """``simulated(text)``: the folder of a run of a scene, made once."""

    @functools.cache
    def result(text):
        folder = tmp_path_factory.mktemp("simulated")
        path = folder / "scene.toml"
        path.write_text(text, encoding="utf-8")
        assert run(path, "-o", folder / "out", "--no-plot", "-q") == 0
        return folder / "out"

    return result


def table(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    return json.loads(lines[0].removeprefix("# ")), list(csv.DictReader(lines[1:]))


@pytest.mark.full
def test_tables(scene_file, tmp_path, capsys):
    out = tmp_path / "out"
    assert run(scene_file(), "-o", out, "--no-plot") == 0
    head, rows = table(out / "sweep.csv")
    assert head == {"schema": "contimpact.sweep/1", "parameter": "s"}
    assert [row["direction"] for row in rows] == ["down"] * 7 + ["up"] * 7
    first = rows[0]
    assert (first["kind"], first["notation"], first["word"]) == ("periodic", "1:1", "BT")
    assert (first["wall1"], first["wall2"]) == ("B", "T")
    assert float(first["v1"]) > 0 > float(first["v2"])
    assert float(first["exponent_sum"]) == pytest.approx(2 * np.log(0.3), abs=1e-6)
    assert float(first["d"]) == pytest.approx(0.6225 * 0.39)
    transitions = json.loads((out / "transitions.json").read_text(encoding="utf-8"))
    assert transitions["schema"] == "contimpact.transitions/1"
    assert transitions["transitions"][0]["label"] == "PD[1:1->1:1/2T]"
    manifest = json.loads((out / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["counts"]["attractors"] == 14
    assert manifest["interrupted"] is None
    assert manifest["scene"]["resolved"]["simulate"]["values"] == 7
    assert not (out / "catalogue.json").exists()
    assert "down: 1:1" in capsys.readouterr().out


@pytest.mark.full
def test_branches_energy_and_pictures(scene_file, tmp_path):
    out = tmp_path / "out"
    text = SCENE.replace("values = 7", "values = 4\nbranches = true").replace("both", "down")
    tables = {
        "more": "portraits = [0.389, 0.34]\nbasins = [0.34]\ngrid = 3\n"
        "losses = true\nfractions = [0.34, 0.36]\nfraction_starts = 4\ncrises = true\n",
        "energy": "[energy]\nm = 0.004",
    }
    assert run(scene_file(text, **tables), "-o", out, "-q") == 0
    names = {p.name for p in out.iterdir()}
    pictures = {"attractors", "exponents", "energy", "portrait1", "portrait2", "basins1"}
    assert {f"{name}.png" for name in pictures} <= names
    assert {"catalogue.json", "coverage.json", "energy.csv", "sweep.csv"} <= names
    head, rows = table(out / "energy.csv")
    assert head["schema"] == "contimpact.energy/1"
    assert head["membrane"]["m"] == 0.004
    assert {row["from"] for row in rows} >= {"down", "b1"}
    coverage = json.loads((out / "coverage.json").read_text(encoding="utf-8"))
    assert coverage["schema"] == "contimpact.coverage/1"
    assert coverage["matches"]
    manifest = json.loads((out / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["scene"]["resolved"]["energy"]["m"] == 0.004
    assert set(manifest["files"]) <= {str(p.relative_to(out)) for p in out.rglob("*")}
    # a later run of another scene removes all that this one has written
    assert {"losses.csv", "fractions.csv", "fractions.png", "crises.json"} <= set(manifest["files"])
    assert set(manifest["files"]) - set(own_files(out, WRITTEN)) == {ROWS}


@pytest.mark.full
def test_the_sweep_is_shown_before_its_transitions_are_located(scene_file, tmp_path, monkeypatch):
    """Pictures and tables are there when the first transition is sought, and stay where the
    keyboard ends it; `plot` draws the attractors again."""
    out = tmp_path / "out"
    there = []

    def interrupted(*given):
        there.extend(path.name for path in out.iterdir())
        manifest = json.loads((out / "manifest.json").read_text(encoding="utf-8"))
        assert manifest["interrupted"] == "transitions"
        raise KeyboardInterrupt

    monkeypatch.setattr(scene_simulation, "transitions_between", interrupted)
    assert run(scene_file(SCENE.replace("both", "down")), "-o", out, "-q") == 1
    wanted = {"attractors.png", "exponents.png", "sweep.csv", "manifest.json"}
    assert wanted <= set(there)
    assert wanted <= {path.name for path in out.iterdir()}
    assert cli.main(["plot", str(out), "-o", str(tmp_path / "again.png")]) == 0
    assert (tmp_path / "again.png").stat().st_size > 10_000


@pytest.mark.full
def test_transitions_of_the_periods_asked_for(scene_file, tmp_path):
    """Only changes from or to one of them are located; the other rows are the same."""
    found = {}
    for periods in ("true", "[2]", "[7]"):
        out = tmp_path / periods.strip("[]")
        text = SCENE.replace("both", "down").replace("width", f"transitions = {periods}\nwidth")
        assert run(scene_file(text), "-o", out, "-q", "--no-plot") == 0
        listed = json.loads((out / "transitions.json").read_text(encoding="utf-8"))
        found[periods] = [t["label"] for t in listed["transitions"]]
    assert found["true"][0] == found["[2]"][0] == "PD[1:1->1:1/2T]"
    assert len(found["[2]"]) <= len(found["true"])
    assert found["[7]"] == []


def test_values_at_which_the_motion_did_not_settle_are_noted(scene_file, tmp_path, capsys):
    """Beside a doubling; what more time may tell is said in the manifest, too."""
    text = SCENE.replace("[0.33, 0.39]", "[0.3829, 0.3831]").replace("values = 7", "values = 2")
    text = text.replace('"both"', '"down"').replace("width", "transitions = false\nwidth")
    text = text.replace("periods = 300", "periods = 60")
    assert run(scene_file(text), "-o", tmp_path / "out", "--no-plot") == 0
    (note,) = (line for line in capsys.readouterr().out.splitlines() if "settle," in line)
    assert note.startswith("down: 1 of 2 motions did not settle, the first at s = 0.3829;")
    assert "simulate.periods" in note
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text(encoding="utf-8"))
    assert note in manifest["notes"]


def test_periods_of_transitions_are_whole_numbers():
    text = SCENE.replace("width", "transitions = [1, 0.5]\nwidth")
    with pytest.raises(InputError, match=r"simulate\.transitions: .*a list of periods"):
        read_scene(tomllib.loads(text))


@pytest.mark.parametrize("drawing", [False, True])
@pytest.mark.full
def test_an_interruption_is_named_with_its_place(
    drawing, scene_file, tmp_path, monkeypatch, capsys
):
    """Within the sweep, and while the sweep is drawn before its transitions are located."""

    def interrupted(*given):
        raise KeyboardInterrupt

    kept = scene_simulation.Checkpoint.keep
    made = []

    def keep(self, row):
        kept(self, row)
        made.append(row)
        if len(made) == 2:
            raise KeyboardInterrupt

    if drawing:
        monkeypatch.setattr("contimpact.plots.attractors.save_simulation", interrupted)
    else:
        monkeypatch.setattr(scene_simulation.Checkpoint, "keep", keep)
    assert run(scene_file(SCENE.replace("both", "down")), "-o", tmp_path, "-q") == 1
    manifest = json.loads((tmp_path / "manifest.json").read_text(encoding="utf-8"))
    stage, place = ("transitions", "0 of ") if drawing else ("sweep", "1 of ")
    assert manifest["interrupted"] == stage
    assert manifest["stopped"].startswith(f"{stage}: {place}")
    assert f"interrupted ({stage}): {place}" in capsys.readouterr().err
    assert table(tmp_path / "sweep.csv")[1]


INTERRUPTED_IMPORT = """
import importlib.util, signal, sys
from contimpact.cli import main

class Interrupting:
    def find_spec(name, path, target=None):
        if name != "matplotlib.collections":
            return None
        sys.meta_path.remove(Interrupting)
        spec = importlib.util.find_spec(name)
        load = spec.loader.exec_module
        def interrupted(module):
            load(module)
            signal.raise_signal(signal.SIGINT)
        spec.loader.exec_module = interrupted
        return spec

sys.meta_path.insert(0, Interrupting)
sys.exit(main())
"""


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
@pytest.mark.full
def test_an_interruption_while_matplotlib_is_imported(scene_file, tmp_path):
    """What it leaves of matplotlib cannot be imported again, as for the pictures at the end."""
    path, out = scene_file(SCENE.replace("both", "down")), tmp_path / "out"
    given = ["simulate", str(path), "-o", str(out), "-q"]
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED_IMPORT, *given], capture_output=True, text=True
    )
    assert done.returncode == 1
    (said,) = done.stderr.splitlines()
    assert said.startswith("contimpact: interrupted (transitions): 0 of ")
    assert (out / "attractors.png").stat().st_size > 5000


@pytest.mark.parametrize("after", [2, 9, 14, 29])
@pytest.mark.full
def test_interrupted_and_resumed(scene_file, simulated, tmp_path, monkeypatch, capsys, after):
    """Stopped after some rows, or after the sweeps, and resumed: the same bytes as in one go."""
    text = SCENE + "starts = 2\n"
    path, whole, parts = scene_file(text), simulated(text), tmp_path / "parts"
    kept = scene_simulation.Checkpoint._append
    made = []

    def interrupting(self, record):
        kept(self, record)
        made.append(record)
        if len(made) == after:
            raise KeyboardInterrupt

    monkeypatch.setattr(scene_simulation.Checkpoint, "_append", interrupting)
    assert run(path, "-o", parts, "--no-plot", "-q") == 1
    assert "--resume" in capsys.readouterr().err
    assert len(table(parts / "sweep.csv")[1]) <= after
    manifest = json.loads((parts / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["interrupted"]
    monkeypatch.undo()
    with open(parts / "rows.jsonl", "a", encoding="utf-8") as file:
        file.write('{"row": {"direc')  # a line cut short by the interruption
    assert run(path, "-o", parts, "--no-plot", "-q", "--resume") == 0
    for name in TABLES:
        assert (parts / name).read_bytes() == (whole / name).read_bytes(), name


@pytest.mark.full
def test_a_finished_run_is_resumed_without_work(scene_file, simulated, tmp_path, monkeypatch):
    path, out = scene_file(), shutil.copytree(simulated(SCENE), tmp_path / "out")
    before = {name: (out / name).read_bytes() for name in TABLES}

    def forbidden(*_):
        raise AssertionError("nothing is left to simulate")

    monkeypatch.setattr("contimpact.simulation.sweep.settle", forbidden)
    monkeypatch.setattr("contimpact.simulation.sweep.settle_again", forbidden)
    assert run(path, "-o", out, "--no-plot", "-q", "--resume") == 0
    assert {name: (out / name).read_bytes() for name in TABLES} == before


@pytest.mark.full
def test_another_scene_is_not_resumed(scene_file, simulated, tmp_path, capsys):
    out = shutil.copytree(simulated(SCENE), tmp_path / "out")
    other = scene_file(SCENE.replace("r = 0.3", "r = 0.31"))
    assert run(other, "-o", out, "--no-plot", "-q", "--resume") == 2
    assert "another scene" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["plot", "range"])
def test_what_reads_a_killed_simulation_says_how_to_go_on(simulated, tmp_path, capsys, command):
    """It asked for a folder made by contimpact run. What is killed leaves its rows alone."""
    shutil.copy(simulated(SCENE) / "rows.jsonl", tmp_path)
    assert cli.main([command, str(tmp_path)]) == 2
    assert f"contimpact simulate SCENE -o {tmp_path} --resume" in capsys.readouterr().err


def test_without_a_table_there_is_nothing_to_simulate(scene_file, tmp_path, capsys):
    assert run(scene_file(SCENE.split("[simulate]")[0]), "-o", tmp_path / "out") == 2
    assert "[simulate]" in capsys.readouterr().err


REFUSED = {
    "simulate.valeus": "valeus = 3",
    "simulate.values": "values = 1",
    "simulate.direction": 'direction = "left"',
    "simulate.range": "range = [-1.0, 0.3]",
    "simulate.portraits[1]": "portraits = [0.3, -0.2]",
    "simulate.width": "width = 0",
    "simulate.tolerance": "tolerance = -1",
    "simulate.starts": "starts = -1",
    "simulate.grid": "grid = 1",
    "simulate.branches": "branches = 1",
    "energy.m": "[energy]\nm = 0",
    "energy.R_b": "[energy]\nR_b = 0.0063",
    "energy.mass": "[energy]\nmass = 1",
}


@pytest.mark.parametrize("where", REFUSED)
def test_refused_keys(where):
    text = SCENE.split("[simulate]")[0] + "[simulate]\n" + REFUSED[where]
    with pytest.raises(InputError) as error:
        read_scene(tomllib.loads(text))
    assert error.value.where == where


def test_defaults():
    """The range of the branches, 101 values, falling; a millionth of the range as width."""
    scene = read_scene(tomllib.loads(SCENE.split("[simulate]")[0] + "[simulate]\n"))
    options = scene.simulate
    assert options.range == (0.3, 0.4)
    assert (options.values, options.direction, options.branches) == (101, "down", False)
    assert options.width == pytest.approx(1e-7)
    ((direction, values),) = options.sweeps()
    assert (direction, values[0], values[-1]) == ("down", 0.4, 0.3)
    assert read_scene(scene.resolved()).resolved() == scene.resolved()


def test_the_oscillator_has_no_membranes():
    given = {
        "name": "x",
        "model": {
            "system": "oscillator",
            "parameters": {"a": 1, "omega": 2, "c": 0.2, "k": 1, "sigma": 0, "r": 0.6},
        },
        "follow": {"parameter": "sigma", "range": [-0.1, 0.1], "orbits": ["1"]},
    }
    read_scene(given | {"simulate": {}})
    with pytest.raises(InputError, match="membranes"):
        read_scene(given | {"energy": {}})


@pytest.mark.full
def test_run_imports_no_simulation_and_no_matplotlib(scene_file, tmp_path):
    """What a scene does not ask for is not imported, by run and by simulate."""
    code = (
        "import sys; from contimpact.cli import main; status = main(sys.argv[1:]); "
        "print(*sorted(m for m in sys.modules if m.startswith(('contimpact', 'matplotlib'))))"
    )

    def imported(path, *arguments):
        result = subprocess.run(
            [sys.executable, "-c", code, *arguments, path, "-o", str(tmp_path / "out")],
            capture_output=True,
            text=True,
            check=True,
        )
        return result.stdout.splitlines()[-1].split()

    attracting = SCENE.replace("s = 0.34", "s = 0.4")  # elsewhere a run looks for what attracts
    plain = imported(scene_file(attracting.split("[simulate]")[0]), "run", "--no-plot")
    assert "contimpact.diagrams.explore" in plain
    places = {f"contimpact.attractors.{name}" for name in ("sweep", "attractor", "energy")}
    absent = places | {"contimpact.simulation.simulator", "matplotlib"}
    assert not absent & set(plain)
    with_table = imported(scene_file(attracting), "run", "--no-plot")
    assert not {"contimpact.simulation.sweep", "contimpact.simulation.energy", "matplotlib"} & set(
        with_table
    )
    few = SCENE.replace("values = 7", "values = 2\ntransitions = false")
    simulated = imported(scene_file(few), "simulate", "--no-plot")
    assert "contimpact.simulation.sweep" in simulated
    assert not {"contimpact.simulation.energy", "contimpact.diagrams.explore", "matplotlib"} & set(
        simulated
    )


@pytest.mark.parametrize("rows", [0, 2])
def test_what_is_drawn_of_an_interrupted_simulation_says_so(
    scene_file, tmp_path, monkeypatch, capsys, rows
):
    """Also after the branches were followed into the same folder."""
    path, out = scene_file(SCENE + "branches = true\n"), str(tmp_path / "out")
    kept, made = scene_simulation.Checkpoint.keep, []

    def keep(self, row):
        if len(made) == rows:
            raise KeyboardInterrupt
        made.append(row)
        kept(self, row)

    monkeypatch.setattr(scene_simulation.Checkpoint, "keep", keep)
    assert run(path, "-o", out, "--no-plot", "-q") == 1
    monkeypatch.undo()
    head, found = table(tmp_path / "out" / "sweep.csv")
    assert head["interrupted"].startswith("sweep: ")
    assert len(found) == rows
    assert cli.main(["run", path, "-o", out, "--no-plot", "--html", "-q"]) == 0
    capsys.readouterr()
    said = f"the simulation ended early ({head['interrupted']})"
    assert said in (tmp_path / "out" / "diagram.html").read_text(encoding="utf-8")
    assert cli.main(["range", out]) == 0
    assert said in capsys.readouterr().out
    assert cli.main(["plot", out]) == 0
    assert said in capsys.readouterr().err
    read = sweep_of(tmp_path / "out" / "sweep.csv", read_scene(tomllib.loads(SCENE)).model)
    assert read.interrupted
    if rows:
        labels = [text.get_text() for text in plot_sweep(read).get_legend().get_texts()]
        assert "interrupted: values or directions are missing" in labels


def test_values_without_attractors_are_those_of_at(simulated, capsys):
    folder = simulated(SCENE)
    assert cli.main(["range", str(folder), "--at", "99"]) == 2
    assert "--at: found 99.0 for s; give one from" in capsys.readouterr().err
    assert cli.main(["range", str(folder), "-q"]) == 0
    assert capsys.readouterr().out == ""


def test_a_simulation_that_has_no_attractor_yet_is_not_drawn(
    scene_file, tmp_path, monkeypatch, capsys
):
    def interrupted(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr(scene_simulation.Checkpoint, "keep", interrupted)
    assert run(scene_file(), "-o", tmp_path / "out", "-q") == 1
    assert cli.main(["plot", str(tmp_path / "out")]) == 2
    assert "no attractors" in capsys.readouterr().err
