"""Margins as a column of branches, shaded in diagrams, and over a plane."""

from __future__ import annotations

import csv
import math

import numpy as np
import pytest
from matplotlib.colors import to_rgba
from mutations import written

import contimpact as ci
from contimpact.plots.lines import BAND
from contimpact.results.catalogue import read_branch
from contimpact.studies.executors import processes
from contimpact.studies.run import run_study
from contimpact.studies.store import Store
from contimpact.studies.study import Study
from contimpact.studies.study_file import read_study

SCENE = {
    "name": "margins",
    "model": {
        "system": "impact-pair",
        "parameters": {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.34},
    },
    "follow": {"parameter": "s", "range": [0.28, 0.4], "orbits": ["1:1", "2:1"], "depth": 0},
    "numerics": {"max_step": 0.1},
    "margins": {"tolerances": {"s": "2%"}, "within": 3.0},
    "plot": {"margin": 1.0, "y": "margin"},
}


FEW_ROWS = {"numerics": {"max_step": 0.4}}


@pytest.fixture(scope="module")
def diagram():
    return ci.follow(SCENE)


@pytest.mark.full
def test_along_a_branch_it_is_the_distance_to_the_catalogues_events(diagram):
    """The 1:1 ends at its PD, the 2:1 at its FB or at the grazing below the range."""
    wider = {**SCENE, "follow": {**SCENE["follow"], "range": [0.2, 0.4]}, "plot": {}}
    del wider["margins"]
    ends = [e for e in ci.follow(wider).entries if not e.ghost]
    seen = set()
    for branch in diagram.branches:
        observable = branch.stable & branch.physical
        assert np.isnan(branch["margin"][~observable & (branch["event"] == "")]).all()
        for row in np.flatnonzero(observable & (branch["event"] == "")):
            s = branch["s"][row]
            own = [e for e in ends if e.branch == branch.id]
            away = {e.label: abs(e.value - s) / (0.02 * s) for e in own}
            nearest = min(away, key=away.get)
            expected = away[nearest] if away[nearest] <= 3.0 else math.inf
            assert branch["margin"][row] == pytest.approx(expected, rel=1e-9)
            assert branch["margin_event"][row] == (nearest if away[nearest] <= 3.0 else "")
            seen.add(branch["margin_event"][row])
        for entry in branch.events:
            (row,) = np.flatnonzero(branch["event"] == entry.id)
            assert branch["margin"][row] == 0.0 or entry.ghost
    assert seen == {"PD", "FB", "G[2:1->3:1]", ""}


@pytest.mark.full
def test_rows_in_several_parameters_are_those_of_a_single_search():
    given = {**SCENE, "margins": {"tolerances": {"s": 0.005, "r": "4%", "beta": "1%"}}}
    given["model"] = {**SCENE["model"], "parameters": {"beta": 0, "r": 0.5, "A": 5.0, "s": 0.5}}
    given["follow"] = {**SCENE["follow"], "orbits": ["1:1"], "range": [0.499, 0.501]}
    given |= {"numerics": {"step": 0.5, "max_step": 0.5}}
    given["margins"]["within"] = 40.0
    branches = ci.follow(given).branches
    (branch,) = (b for b in branches if (b.stable & b.physical).any())
    found = ci.find_margins(branch.orbit(0), {"s": 0.005, "r": 0.02}, within=40.0)
    assert branch["margin"][0] == pytest.approx(found.nearest.distance, rel=1e-9)
    assert branch["margin_event"][0] == found.nearest.label


@pytest.mark.full
def test_files_hold_them(diagram, tmp_path):
    branch = diagram.branches[-1]
    ci.save(branch, tmp_path / "one.csv")
    again = read_branch(tmp_path / "one.csv")
    assert np.array_equal(again["margin"], branch["margin"], equal_nan=True)
    assert again["margin_event"].tolist() == branch["margin_event"].tolist()
    assert np.isinf(branch["margin"]).any()


def test_no_tolerances():
    with pytest.raises(ci.InputError, match=r"margins\.tolerances: empty"):
        ci.follow({**SCENE, "margins": {"tolerances": {}}})


@pytest.mark.full
def test_stretches_of_small_margins_are_shaded(diagram):
    """They end where the margin is the one stated, between rows linearly."""
    ax = ci.plot_diagram(diagram, margin=1.0)
    colour = to_rgba(BAND["color"], BAND["alpha"])
    bands = [line for line in ax.lines if line.get_linewidth() == BAND["linewidth"]]
    assert {to_rgba(line.get_color(), line.get_alpha()) for line in bands} == {colour}
    places = np.concatenate([np.asarray(line.get_xdata(), dtype=float) for line in bands])
    fold = next(e for e in diagram.entries if e.kind == "FB" and not e.ghost)
    beside = np.sort(places[(places > 0.34) & (places <= fold.value + 1e-9)])
    assert beside[-1] == fold.value
    assert beside[0] == pytest.approx(fold.value / 1.02, abs=2e-4)
    texts = [text.get_text() for text in ax.get_legend().get_texts()]
    assert "margin below 1" in texts
    assert "unstable" in texts
    along = ci.plot_diagram(diagram, y="margin").get_legend().get_texts()  # of stable orbits alone
    assert "unstable" not in [text.get_text() for text in along]
    assert not [line for line in ci.plot_diagram(diagram).lines if line.get_linewidth() == 8.0]


@pytest.mark.full
def test_a_run_draws_what_the_scene_asks_for(tmp_path, capsys):
    given = {**SCENE, **FEW_ROWS, "plot": {**SCENE["plot"], "formats": ["svg"]}}
    file = written(given, tmp_path / "s.toml")
    from contimpact.cli import main

    assert main(["run", file, "-o", str(tmp_path / "out"), "-q"]) == 0
    assert "margin (tolerances)" in (tmp_path / "out" / "diagram.svg").read_text("utf-8")
    assert "margin" in ci.load_diagram(tmp_path / "out").branches[0].columns


@pytest.mark.full
def test_an_interruption_keeps_what_was_found():
    def tell(text):
        if text == "margins along b2":
            raise KeyboardInterrupt

    found = ci.follow({**SCENE, **FEW_ROWS}, progress=tell)
    assert found.statistics["failure"] == "interrupted"
    first, second = found.branches[:2]
    assert np.isfinite(first["margin"]).any()
    assert np.isnan(second["margin"]).all()
    assert any("margins are missing" in note for note in second.notes)


@pytest.mark.parametrize(
    ("changes", "where"),
    [
        ({"margins": {}}, r"margins\.tolerances"),
        ({"margins": {"tolerances": {"q": 1}}}, r"margins\.tolerances\.q"),
        ({"margins": {"tolerances": {"s": 1}, "within": 0}}, r"margins\.within"),
        ({"margins": None}, r"plot\.margin: no table \[margins\]"),
        ({"margins": None, "plot": {"y": "margin"}}, r"plot\.y"),
        ({"output": {"margin": "v"}}, r"output\.margin"),
    ],
)
def test_refusals(changes, where):
    given = {key: table for key, table in {**SCENE, **changes}.items() if table is not None}
    with pytest.raises(ci.InputError, match=where):
        ci.read_scene(given)


@pytest.mark.slow
def test_the_largest_along_the_orbit_is_a_quantity_of_studies(tmp_path):
    """In one parameter it is the distance to the nearer end of the stable interval, of that row at
    which it is largest."""
    given = {key: table for key, table in SCENE.items() if key != "plot"}
    given |= {"margins": {"tolerances": {"s": 0.01}, "within": 4.0}, "numerics": {"max_step": 0.4}}
    given["follow"] = {**SCENE["follow"], "range": [0.25, 0.4], "orbits": ["2:1"]}
    given["model"] = {"system": "impact-pair", "parameters": {"beta": "pi/6", "s": 0.34}}
    study = {"keep": ["tables", "readings"], "grid": {"r": [0.28, 0.3], "A": [5.0, 5.1]}}
    with Store(tmp_path / "s.sqlite") as store:
        run_study(read_study({**given, "study": study}), store, processes(1))
    with Study(tmp_path / "s.sqlite") as found:
        shown = found.map("margin", orbit="2:1")
        assert shown.axes == ("r", "A")
        for scene, value in zip(range(4), shown.values, strict=True):
            (row,) = found.intervals(scene=scene, notation="2:1")
            lines = found.table(scene, row["branch"]).splitlines()[1:]
            rows = [one for one in csv.DictReader(lines) if one["n_unstable"] == "0"]
            places = np.array([float(one["s"]) for one in rows if one["physical"] == "1"])
            away = np.minimum(places - row["low"], row["high"] - places) / 0.01
            assert value == pytest.approx(min(4.0, away.max()), rel=1e-9)
        assert len(set(shown.values.tolist())) > 1
    with pytest.raises(ci.InputError, match=r"study\.keep: \[margins\] without tables"):
        read_study({**given, "study": {**study, "keep": []}})


@pytest.mark.full
def test_the_largest_mean_of_an_output_is_a_quantity_of_studies(tmp_path):
    """Before impacts it is the mean of the rows' velocities."""
    given = {key: table for key, table in SCENE.items() if key not in ("plot", "margins")}
    given["output"] = {"speed": {"before_impacts": "-sqrt(v**2)"}}
    given["follow"] = {**SCENE["follow"], "range": [0.25, 0.4], "orbits": ["2:1"]}
    given["model"] = {"system": "impact-pair", "parameters": {"beta": "pi/6", "s": 0.34}}
    study = {"keep": ["tables"], "grid": {"r": [0.28, 0.3], "A": [5.0, 5.1]}}
    for name, kept in (("s", study), ("none", {"keep": [], "grid": {"r": [0.3], "A": [5.0]}})):
        with Store(tmp_path / f"{name}.sqlite") as store:
            run_study(read_study({**given, "study": kept}), store, processes(1))
    with Study(tmp_path / "s.sqlite") as found:
        shown = found.map("output:speed", orbit="2:1")
        assert shown.text == "largest speed of stable 2:1 along s"
        for scene, value in zip(range(4), shown.values, strict=True):
            means = [
                -sum(abs(float(one[f"v{k}"])) for k in (1, 2, 3)) / 3
                for row in found.branches(scene=scene, notation="2:1")
                for one in csv.DictReader(found.table(scene, row["branch"]).splitlines()[1:])
                if (one["n_unstable"], one["physical"]) == ("0", "1")
            ]
            assert value == pytest.approx(max(means), rel=1e-12)
        with pytest.raises(ci.InputError, match="no output 'P' in margins; it has speed"):
            found.map("output:P")
    with (
        Study(tmp_path / "none.sqlite") as found,
        pytest.raises(ci.InputError, match=r"add 'tables' to study\.keep"),
    ):
        found.map("output:speed")


@pytest.mark.full
def test_diagrams_without_margins_have_nothing_to_shade(diagram):
    branch = ci.continue_orbit(diagram.branches[0].orbit(-1), "s", (0.39, 0.4), events=[])
    with pytest.raises(ci.InputError, match="no branch has margins"):
        ci.plot_diagram(branch, margin=1.0)
