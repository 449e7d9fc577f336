"""What a page embeds: packed numbers, orbits as cubics, members, rows of events, attractors."""

from __future__ import annotations

import base64
import dataclasses
import json

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from zoo import ROOT

from contimpact.errors import InputError
from contimpact.page import data as tracks
from contimpact.page.data import PageView, pack_column, page_data, read_sweep, script_json
from contimpact.page.document import fractions_in
from contimpact.results.branch import Branch
from contimpact.results.catalogue import Bound, Motion, load_diagram
from contimpact.results.diagram import Diagram
from contimpact.results.scene import read_scene
from contimpact.simulation.files import sweep_text
from contimpact.simulation.sweep import sweep
from contimpact.systems.belt import Belt
from contimpact.systems.soft_stop import SoftStop
from contimpact.systems.two_masses import TwoMasses

TYPES = {"f8": "<f8", "f4": "<f4", "u4": "<u4", "u1": "u1"}


def unpacked(column, length):
    """What the script makes of a column."""
    if isinstance(column, float):
        return np.full(length, column)
    return np.frombuffer(base64.b64decode(column[3:]), TYPES[column[:2]])


@pytest.fixture(scope="module")
def data(small, small_scene):
    return page_data(small, small_scene.model, PageView("d", source="a test"))


def test_numbers_come_back_to_the_bit():
    values = np.array([0.1, -np.inf, np.nan, 1e-300])
    assert unpacked(pack_column(values), 4).tobytes() == values.tobytes()
    assert pack_column(np.full(7, 0.3)) == 0.3
    assert isinstance(pack_column(np.full(2, np.inf)), str)
    assert unpacked(pack_column(np.arange(3), "u4"), 3).tolist() == [0, 1, 2]


def test_no_text_becomes_markup():
    hostile = "</script><script>alert(1)</script><!--\u2028\x00&\u202e"
    text = script_json({"name": hostile, hostile: [1.0, float("nan"), None]})
    assert not set("<>&\u2028\u202e\x00") & set(text)
    found = json.loads(text)
    assert found["name"].startswith("</script><script>alert(1)</script><!--")
    assert list(found.values())[1] == [1.0, None, None]


def test_columns_are_those_of_the_branches(small, data):
    for branch, record in zip(small.branches, data["branches"], strict=True):
        rows = len(branch)
        assert record["rows"] == rows
        assert np.array_equal(unpacked(record["columns"]["s"], rows), branch["s"])
        speeds = unpacked(record["velocities"], rows).reshape(rows, -1)
        assert np.array_equal(speeds, branch.velocities)
        reasons = np.array(record["reasons"])[unpacked(record["reason"], rows).astype(int)]
        assert reasons.tolist() == branch["reason"].tolist()


def test_margins_and_outputs_are_columns(small, small_margins, data):
    """Branches without them have none, and are as they were but for empty texts."""
    assert data["quantities"] == []
    assert data["shown"]["margin"] is None
    diagram, scene = small_margins
    found = page_data(diagram, scene.model, PageView("d", margin=1.0))
    assert found["quantities"] == ["margin", "size"]
    assert found["shown"]["margin"] == 1.0
    for branch, record in zip(diagram.branches, found["branches"], strict=True):
        rows = len(branch)
        for name in ("margin", "size"):
            assert np.array_equal(
                unpacked(record["columns"][name], rows), branch[name], equal_nan=True
            )
        events = np.array(record["nearest"])[unpacked(record["margin_event"], rows).astype(int)]
        assert events.tolist() == branch["margin_event"].tolist()


def test_events_stand_on_their_rows(small, data):
    assert [entry["id"] for entry in data["entries"]] == [entry.id for entry in small.entries]
    for entry in data["entries"]:
        assert small[entry["branch"]]["s"][entry["row"]] == entry["parameters"]["s"]


def test_stable_runs_stand_on_their_rows(small, data):
    assert data["reading"]["stable"]
    for run in data["reading"]["stable"]:
        values = small[run["branch"]]["s"][run["rows"]]
        assert values.tolist() == [run["low"], run["high"]]


def states(record, number):
    """States of all orbits along one flight, and the flights' nodes."""
    kept = record["tracks"]
    nodes, rows = kept["nodes"], record["rows"]
    if kept["rows"] is not None:
        rows = len(unpacked(kept["rows"], 0))
    table = unpacked(kept["states"], 2 * rows * sum(nodes)).reshape(rows, -1, 2)
    first = sum(nodes[:number])
    return table[:, first : first + nodes[number]]


def hermite(x, v, duration, u):
    """The cubic through states at equal steps, at a fraction u of the whole."""
    steps = len(x) - 1
    i = min(int(u * steps), steps - 1)
    s, h = u * steps - i, duration / steps
    blend = (1 + 2 * s) * (1 - s) ** 2, s * (1 - s) ** 2 * h, s**2 * (3 - 2 * s), s**2 * (s - 1) * h
    return blend[0] * x[i] + blend[1] * v[i] + blend[2] * x[i + 1] + blend[3] * v[i + 1]


def test_orbits_are_those_of_the_equation_of_motion(small, data):
    """Against an integration of Z'' = cos(pi t) + gbar from the impact on."""
    for branch, record in zip(small.branches, data["branches"], strict=True):
        for row in (0, len(branch) // 2, len(branch) - 1):
            d, gbar = branch["d"][row], branch["gbar"][row]
            times = [*branch.times[row], branch.times[row][0] + 2.0 * branch.period]
            for k, wall in enumerate(branch.word):
                x, v = states(record, k)[row].T
                place = {"B": d / 2, "T": -d / 2}[wall]
                start = [place, -0.3 * branch.velocities[row][k]]
                done = solve_ivp(
                    lambda t, y, gbar=gbar: [y[1], np.cos(np.pi * t) + gbar],
                    (times[k], times[k + 1]),
                    start,
                    rtol=1e-10,
                    atol=1e-12,
                    dense_output=True,
                )
                for u in (0.0, 0.13, 0.5, 0.77, 1.0):
                    length = times[k + 1] - times[k]
                    there = done.sol(times[k] + u * length)[0]
                    assert hermite(x, v, length, u) == pytest.approx(there, abs=5e-4 * d)


def test_every_coordinate_is_that_of_the_equations_of_motion(masses, masses_scene):
    """Against an integration of both masses from an impact to the next, at the orbits' nodes."""
    p = masses_scene.model.values

    def law(t, y, omega):
        x, w, v, u = y
        middle = p["c2"] * (v - u) + p["k2"] * (x - w)
        push = p["a1"] * np.cos(omega * t) - p["c1"] * v - p["k1"] * x
        return [v, u, push - middle, middle]

    record = page_data(masses, masses_scene.model, PageView("omega"))["branches"][0]
    branch, kept = masses.branches[0], record["tracks"]
    assert kept["coordinates"] == ["x1", "x2"]
    assert kept["hits"] == {"A": [0], "B": [1]}
    assert kept["walls"] == {"A": 1.0, "B": 1.0}
    rows, nodes = len(branch), kept["nodes"][0]
    table = unpacked(kept["states"], 4 * rows * nodes).reshape(rows, nodes, 2, 2)
    for row in (0, rows // 2, rows - 1):
        omega, time = branch["omega"][row], branch["t1"][row]
        x, v = branch["x1_1"][row], branch["v1_1"][row]
        start = [1.0, x, -0.8 * branch["v1"][row], v]
        times = time + np.linspace(0.0, 2.0 * np.pi / omega, nodes)
        done = solve_ivp(
            law, times[[0, -1]], start, args=(omega,), t_eval=times, rtol=1e-10, atol=1e-12
        )
        assert table[row, :, :, 0] == pytest.approx(done.y[:2].T, abs=1e-6)
        assert table[row, :, :, 1] == pytest.approx(done.y[2:].T, abs=1e-5)


def test_a_wall_on_a_combination_is_of_its_coordinates_and_one_on_a_multiple_is_moved():
    """2 x <= 1 is a wall at a half; x - y <= 1 stands at no place of either."""
    guards = {
        "A": {"within": "2*x <= 1", "restitution": "r"},
        "K": {"within": "x - y <= 1", "restitution": "r"},
    }
    stated = {"coordinates": ["x", "y"], "mass": [["1", "0"], ["0", "1"]], "guards": guards}
    stated |= {"stiffness": [["1", "0"], ["0", "2"]], "force": ["cos(t)", "0"], "period": "2*pi"}
    stated |= {"damping": [["0.1", "0"], ["0", "0.1"]], "parameters": {"r": 0.7}}
    follow = {"parameter": "r", "range": [0.5, 0.9], "orbits": ["A"]}
    model = read_scene(
        {"name": "rod", "model": {"system": "linear", **stated}, "follow": follow}
    ).model
    made = tracks.Tracks(model)
    orbits = tracks.Orbits("A", 1, {"r": np.array([0.6, 0.7])}, np.zeros((2, 1, 4)))
    _, places = made.clock_and_walls(orbits)
    assert model.coordinates == ("x", "y")
    assert made.hits == {"A": [0], "K": [0, 1]}
    assert places["A"].tolist() == [0.5, 0.5]


def test_the_oscillators_orbits_close(kernel_cache):
    """A system whose acceleration depends on the state: flights end where the next one begins."""
    from contimpact import Oscillator, continue_orbit, find_orbits

    model = Oscillator(a=1.0, omega=1.0, c=0.1, k=1.0, sigma=1.0, r=0.8)
    branch = continue_orbit(find_orbits(model, "1", parameter="a")[0], "a", range=(0.5, 1.2))
    record = page_data(Diagram("stop", [branch]), model, PageView("a"))["branches"][0]
    x, v = states(record, 0)[:, -1].T
    assert x == pytest.approx(np.ones(len(branch)), abs=1e-6)
    assert v == pytest.approx(branch["v1"], abs=1e-5)


def test_of_very_many_orbits_some_are_kept(small, small_scene, monkeypatch):
    monkeypatch.setattr(tracks, "BUDGET", 1000)
    data = page_data(small, small_scene.model, PageView("d"))
    assert data["every"] > 1
    for branch, record in zip(small.branches, data["branches"], strict=True):
        rows = unpacked(record["tracks"]["rows"], 0).astype(int)
        events = [e["row"] for e in data["entries"] if e["branch"] == branch.id]
        assert {0, len(branch) - 1, *events} <= set(rows.tolist())
        assert len(rows) < len(branch)
        assert states(record, 0)[:, 0, 0] == pytest.approx(branch["d"][rows] / 2, rel=1e-6)


def test_without_its_system_a_diagram_has_no_orbits_and_says_so(small):
    data = page_data(small, None, PageView("d"))
    assert all(record["tracks"] is None for record in data["branches"])
    assert "impact-pair" in data["unknown"]


def other_value(branch, place, value):
    columns = {**branch.columns, "r": np.full(len(branch), value)}
    events = [dataclasses.replace(e, id=f"{e.id}{place}") for e in branch.events]
    return dataclasses.replace(branch, id=f"b{place}", columns=columns, events=events)


def test_members_are_told_apart_by_what_no_branch_varies(small, small_scene):
    first: Branch = small.branches[0]
    branches = [first, other_value(first, 8, 0.2), other_value(first, 9, 0.3)]
    data = page_data(Diagram("family", branches), small_scene.model, PageView("d"))
    assert data["members"] == [
        {"fixed": {"r": 0.2}, "branches": [1]},
        {"fixed": {"r": 0.3}, "branches": [0, 2]},
    ]
    assert data["own"] == 1
    assert "r" not in data["fixed"]
    assert "d" not in data["fixed"]


@pytest.fixture(scope="module")
def swept(small_scene, tmp_path_factory):
    model = small_scene.model
    path = tmp_path_factory.mktemp("swept") / "sweep.csv"
    values = np.linspace(0.45, 0.36, 6)
    path.write_text(sweep_text(sweep(model, "s", values)), encoding="utf-8")
    return path


def test_attractors_are_read_and_have_orbits(small, small_scene, swept):
    found = read_sweep(swept, small_scene.model)
    assert {"1:1", "1:1/2T"} <= {one.notation for one in found}
    assert sum(map(len, found)) == 6
    data = page_data(small, small_scene.model, PageView("d"), found)
    first = next(one for one in data["swept"] if one["notation"] == "1:1")
    places = states(first, 0)[:, 0, 0]
    assert places == pytest.approx(unpacked(first["columns"]["d"], first["rows"]) / 2, rel=1e-6)


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("contimpact.sweep/1", "contimpact.sweep/9"),
        lambda text: text.replace(",B,", ",Q,"),
        lambda text: text.replace("0.", "nan"),
        lambda text: text[: len(text) // 3],
    ],
)
def test_a_damaged_table_of_attractors_is_refused(swept, small_scene, tmp_path, change):
    damaged = tmp_path / "sweep.csv"
    damaged.write_text(change(swept.read_text(encoding="utf-8")), encoding="utf-8")
    with pytest.raises(InputError, match=r"sweep\.csv"):
        read_sweep(damaged, small_scene.model)


def test_attractors_of_no_branch_have_their_ends_on_every_axis(small, small_scene):
    low, high = Bound(0.3, 0.0, None, "the sweep ends"), Bound(0.36, 1e-9, "e7", "CR e7")
    chaos = Motion("1:1/C", None, low, high, 2, [0.31, 0.35], [0.6, 0.7])
    (found,) = page_data(small, small_scene.model, PageView("d"), motions=[chaos])["motions"]
    assert (found["notation"], found["branch"]) == ("1:1/C", None)
    assert found["columns"]["s"] == [0.3, 0.36]
    assert found["columns"]["d"] == [small_scene.model.replace(s=s)["d"] for s in (0.3, 0.36)]
    assert found["said"] == "impacts at up to 0.7; ends: 0.3: the sweep ends; 0.36: CR e7"


def test_what_is_seen_beyond_a_grazing_is_on_the_page():
    diagram = load_diagram(ROOT / "branches/fig7")
    texts = page_data(diagram, None, PageView("s"))["reading"]["scenarios"]
    entry = next(e for e in diagram.entries if e.scenario is not None)
    found = next(text["text"] for text in texts if text["entry"] == entry.id)
    assert found.startswith(entry.scenario.name)


FRACTIONS = """# {"schema": "contimpact.fractions/1", "parameter": "s", "starts": 10}
s,motion,notation,count,fraction,low,high
0.3,1,1:1,10,1.0,0.69,1.0
0.36,1,1:1/C,6,0.6,0.26,0.88
0.36,2,2:1,4,0.4,0.12,0.74
"""


def test_basin_fractions_are_bands_over_all_that_derives(small, small_scene, tmp_path):
    (tmp_path / "fractions.csv").write_text(FRACTIONS, encoding="utf-8")
    found = page_data(small, small_scene.model, PageView("d"), fractions=fractions_in(tmp_path))
    bands = found["fractions"]
    assert bands["columns"]["s"] == [0.3, 0.36]
    assert bands["columns"]["d"] == [small_scene.model.replace(s=s)["d"] for s in (0.3, 0.36)]
    assert [m["name"] for m in bands["motions"]] == ["1:1, 1:1/C", "2:1"]
    assert [m["parts"] for m in bands["motions"]] == [[1.0, 0.6], [0.0, 0.4]]
    assert bands["motions"][1]["high"] == [0.0, 0.74]
    assert page_data(small, small_scene.model, PageView("d"))["fractions"] is None
    (tmp_path / "fractions.csv").write_text(FRACTIONS.replace("0.6,", "x,"), encoding="utf-8")
    with pytest.raises(InputError, match=r"fractions\.csv"):
        fractions_in(tmp_path)


def test_areas_of_a_panel(small_map, small_scene):
    """With the rings of their polygons, what they say, and where a run doubts it."""
    (panel,) = page_data(small_map, small_scene.model, PageView("d"))["panels"]
    (area,) = panel["areas"]
    assert area["id"] == "a1"
    assert area["says"] == "1:1 until PD (supercritical), mechanism 3"
    assert area["polygon"] == [[list(point) for point in small_map.areas[0].polygon[0]]]
    assert area["doubt"] == "0.3, 0.2: no stable orbit of the scene's words"
    assert area["orbits"] == [{"notation": "1:1", "ends": "PD"}]


def test_what_a_machine_is_drawn_with(small_scene):
    """From its class; nothing where coordinates are no displacements."""

    def machine(model):
        return page_data(Diagram("x", []), model, PageView("x"))["machine"]

    pair = machine(small_scene.model)
    assert (pair["direction"], list(pair["contained"])) == ("beta", [(0, -1)])
    assert [pair["guards"][wall]["side"] for wall in "BT"] == [1, -1]
    soft = machine(SoftStop(a=1.0, omega=0.9, c=0.1, k=1.0, e=0.5, k_b=20.0, c_b=0.3))["guards"]
    assert {name: guard["soft"] for name, guard in soft.items()} == {"C": True, "R": False}
    assert machine(Belt(a=0.2, omega=1.3, c=0.1, V=0.3, mu_0=0.4)) is None
    assert machine(None) is None


def test_a_sweep_alone_has_its_own_parameters(small_scene, tmp_path):
    table = tmp_path / "sweep.csv"
    table.write_text(sweep_text(sweep(small_scene.model, "s", [0.39, 0.38])), encoding="utf-8")
    found = read_sweep(table, small_scene.model)
    data = page_data(Diagram("x", []), small_scene.model, PageView("d"), found)
    assert (data["parameter"], data["varying"]) == ("s", ["s", "d"])
    assert data["fixed"]["beta"] == small_scene.model["beta"]
    assert not {"s", "d", "gbar"} & set(data["fixed"])


def test_a_point_of_two_curves_has_one_name():
    """It was PD-G in one row of the table and G-PD in another, or both in one."""
    diagram = load_diagram(ROOT / "branches" / "fig6a")
    page = page_data(diagram, None, PageView("d", source="a test"))
    for curve, shown in zip(diagram.curves, page["curves"], strict=True):
        kinds = [{"G-PD": "PD-G"}.get(point.kind, point.kind) for point in curve.points]
        assert [point["kind"] for point in shown["points"]] == kinds
    assert {point.kind for curve in diagram.curves for point in curve.points} >= {"PD-G", "G-PD"}


def test_no_state_of_a_flight_is_computed_twice(monkeypatch):
    """Of a flight of several coordinates: each half of a step once; and a matrix for each orbit,
    not for each instant."""
    from contimpact.segments import linear_flow

    model = TwoMasses(**TwoMasses.EXAMPLE.values)
    given = {name: np.full(3, value) for name, value in model.values.items()}
    impacts = np.tile([0.3, 1.0, 0.5, -0.2], (3, 1, 1))
    flown, made = [], []
    flow, own = linear_flow.flow_of_arrays, linear_flow.generators
    monkeypatch.setattr(linear_flow, "generators", lambda *g: made.append(0) or own(*g))
    monkeypatch.setitem(
        tracks.ARRAYS.names,
        "flow",
        lambda d, h, k, dt, *g: flown.append(dt) or flow(d, h, k, dt, *g),
    )
    record = tracks.Tracks(model).record(tracks.Orbits("A", 1, given, impacts), np.arange(3))
    assert sum(dt.shape[1] for dt in flown) == 2 * record["nodes"][0] - 1
    assert len(made) == 3 * len(flown)
