"""What a script keeps is the same when it is read back."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import contimpact as ci
from contimpact.scenes.simulate_tables import Settling

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
    return {
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
    ("name", "path", "where"),
    [("branch.csv", "b.json", "path"), ("orbit.json", "o.csv", "path")],
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
