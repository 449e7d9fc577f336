"""What a script keeps is the same when it is read back."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from zoo import ROOT

import contimpact as ci
from contimpact.results.options import Settling
from contimpact.simulation.attractor import Kind

QUICK = Settling(transient=20, periods=200, impacts=400)


@pytest.fixture(scope="module")
def pair():
    return ci.ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)


@pytest.fixture(scope="module")
def kept(pair):
    orbits = ci.find_orbits(pair, "1:1", parameter="s")
    orbit = next(o for o in orbits if o.physical)
    branch = ci.continue_orbit(orbit, range=(0.3, 0.4), events=["PD", "G"])
    few = ci.Settings(max_points=4)
    entry = branch.events[0]
    curve = ci.follow_curve(entry, None, "r", (0.3, 0.4), (0.2, 0.4), settings=few)
    sweep = ci.sweep(pair, "s", [0.4, 0.375, 0.36], settling=QUICK)
    simulator = ci.Simulator(pair)
    run = simulator.run(simulator.state("B", 0.1, 0.6), impacts=30)
    return {
        "run.json": run,
        "runs.json": [run, simulator.run(run.end, periods=3)],
        "diagram": ci.Diagram("mine", [branch]),
        "branch.csv": branch,
        "curve.csv": curve,
        "entry.json": entry,
        "entries.json": [*branch.events],
        "orbit.json": orbit,
        "orbits.json": orbits,
        "sweep.json": sweep,
    }


def plain(result):
    """What makes two results equal that have no equality of their own."""
    if isinstance(result, list):
        return [plain(one) for one in result]
    if isinstance(result, ci.Orbit):
        about = result.model.values, result.problem.parameter, str(result.word)
        return (*about, result.unknowns.tolist(), result.multipliers.tolist())
    if hasattr(result, "rows"):
        rows = [json.dumps(row.as_record()) for row in result.rows]
        return (result.model.values, result.parameter, rows)
    return result


@pytest.mark.parametrize(
    "name",
    [
        "diagram",
        "branch.csv",
        "curve.csv",
        "entry.json",
        "entries.json",
        "orbit.json",
        "orbits.json",
        "sweep.json",
        "run.json",
        "runs.json",
    ],
)
def test_what_is_saved_is_loaded(kept, name, tmp_path):
    ci.save(kept[name], tmp_path / name)
    again = ci.load(tmp_path / name)
    assert type(again) is type(kept[name])
    assert plain(again) == plain(kept[name])


def test_a_loaded_orbit_is_continued(kept, tmp_path):
    ci.save(kept["orbit.json"], tmp_path / "o.json")
    branches = [
        ci.continue_orbit(o, range=(0.33, 0.4), events=["PD"])
        for o in (ci.load(tmp_path / "o.json"), kept["orbit.json"])
    ]
    assert branches[0] == branches[1]


@pytest.mark.parametrize(
    ("name", "path", "where"), [("branch.csv", "b.json", "path"), ("orbit.json", "o.csv", "path")]
)
def test_a_file_has_the_ending_of_its_format(kept, name, path, where, tmp_path):
    with pytest.raises(ci.InputError, match=f"^{where}: found '{path}'; give a name that ends in"):
        ci.save(kept[name], tmp_path / path)


@pytest.mark.parametrize("other", [1, "text", [], [1], None])
def test_anything_else_is_refused(other, tmp_path):
    with pytest.raises(ci.InputError, match=r"^result: found"):
        ci.save(other, tmp_path / "x.json")
    assert list(tmp_path.iterdir()) == []


DAMAGED = {
    "schema": '{"schema": "other/1"}',
    "empty": "",
    "text": "[1, 2]",
    "kind": '{"schema": "contimpact.kept/1", "kind": "models", "items": []}',
    "none": '{"schema": "contimpact.kept/1", "kind": "orbits", "several": false, "items": []}',
}


@pytest.mark.parametrize("text", DAMAGED.values(), ids=DAMAGED)
def test_damaged_files_are_refused(text, tmp_path):
    (tmp_path / "x.json").write_text(text, encoding="utf-8")
    with pytest.raises(ci.InputError, match=r"x\.json"):
        ci.load(tmp_path / "x.json")


def test_numbers_that_are_no_orbit_are_refused(kept, tmp_path):
    path = tmp_path / "o.json"
    ci.save(kept["orbit.json"], path)
    record = json.loads(path.read_text(encoding="utf-8"))
    record["items"][0]["unknowns"][1] += 1e-3
    path.write_text(json.dumps(record), encoding="utf-8")
    with pytest.raises(ci.InputError, match="no orbit of this model"):
        ci.load(path)
    record["items"][0]["unknowns"].pop()
    path.write_text(json.dumps(record), encoding="utf-8")
    with pytest.raises(ci.InputError, match="give 5"):
        ci.load(path)


def test_an_own_system_is_given_as_model(kept, pair, tmp_path):
    path = tmp_path / "o.json"
    ci.save(kept["orbit.json"], path)
    text = path.read_text(encoding="utf-8").replace('"impact-pair"', '"mine"')
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ci.InputError, match="imported classes are the system 'mine'"):
        ci.load(path)
    assert np.array_equal(ci.load(path, pair).unknowns, kept["orbit.json"].unknowns)


def test_a_run_goes_on_where_it_was_kept(kept, pair, tmp_path):
    ci.save(kept["run.json"], tmp_path / "run.json")
    again = ci.load(tmp_path / "run.json")
    one, other = (ci.Simulator(pair).run(run.end, impacts=10) for run in (again, kept["run.json"]))
    assert one == other
    assert one != kept["run.json"]


def test_runs_of_several_coordinates_are_kept(tmp_path):
    model = ci.load_scene(ROOT / "branches" / "two_masses" / "scene.toml").model
    simulator = ci.Simulator(model)
    run = simulator.run(simulator.random_state(np.random.default_rng(1)), impacts=5)
    ci.save(run, tmp_path / "run.json")
    assert ci.load(tmp_path / "run.json") == run
    assert ci.load(tmp_path / "run.json").others.shape == run.others.shape


@pytest.mark.parametrize(
    "damage",
    [{"walls": [9]}, {"phases": [0.1]}, {"outcome": "ENDLESS"}, {"end": {}}, {"period": None}],
)
def test_damaged_runs_are_refused(kept, damage, tmp_path):
    ci.save(kept["run.json"], tmp_path / "run.json")
    record = json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))
    record["items"][0] |= damage
    (tmp_path / "run.json").write_text(json.dumps(record), encoding="utf-8")
    with pytest.raises(ci.InputError, match="damaged"):
        ci.load(tmp_path / "run.json")


def test_an_attractor_is_an_orbit_that_can_be_followed(kept, pair):
    attractor = kept["sweep.json"].rows[0].attractor
    orbit = attractor.orbit(pair, "s")
    assert orbit.stable
    assert orbit.velocities == pytest.approx(attractor.velocities, abs=1e-12)
    assert len(ci.continue_orbit(orbit, "s", range=(0.38, 0.42), events=[])) > 1
    with pytest.raises(ci.InputError, match="model: an attractor without"):
        attractor.orbit(ci.Oscillator(a=1.0, omega=1.0, c=0.1, k=1.0, sigma=1.0, r=0.8))
    with pytest.raises(ci.InputError, match="found complex; give one that is periodic"):
        dataclasses.replace(attractor, kind=Kind.COMPLEX, word=None, period=None).orbit(pair)
