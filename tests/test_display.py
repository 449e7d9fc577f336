"""How results show themselves: ten lines, tables that are text and no markup, data frames."""

from __future__ import annotations

import base64
import dataclasses
import math
import re
import sys

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from zoo import scene_table

import contimpact as ci
from contimpact.display import LINES, Summary, limit_lines, picture_of, table_of
from contimpact.errors import count_text
from contimpact.results.options import Settling
from contimpact.simulation.sweep import Row, Sweep

SCRIPT = "<script>alert(1)"
QUICK = Settling(transient=20, periods=200, impacts=400)


@pytest.fixture(scope="module")
def diagram():
    scene = scene_table(
        name=SCRIPT, follow={"range": [0.3, 0.4], "switch": ["G"]}, detect={"events": ["PD", "G"]}
    )
    return ci.follow(ci.read_scene(scene))


@pytest.fixture(scope="module")
def results(diagram):
    entry = diagram.entries[0]
    few = ci.Settings(max_points=4)
    curve = ci.follow_curve(entry, None, "r", (0.3, 0.4), (0.2, 0.4), settings=few)
    pair = entry.orbit().model
    sweep = ci.sweep(pair, "s", [0.4, 0.39, 0.375], settling=QUICK)
    return {
        "Diagram": diagram,
        "Branch": diagram["b1"],
        "Entry": entry,
        "Orbit": entry.orbit(),
        "Curve": curve,
        "Sweep": sweep,
    }


NAMES = ["Diagram", "Branch", "Entry", "Orbit", "Curve", "Sweep"]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.full
def test_a_notebook_shows_text_table_and_picture(results, name):
    shown = results[name]._repr_mimebundle_()
    assert shown["text/plain"] == repr(results[name])
    assert len(repr(results[name]).splitlines()) <= LINES
    text = shown["text/html"]
    assert text.startswith("<div><p><strong>")
    assert "<script" not in text
    data = base64.b64decode(re.search(r"base64,([^\"]+)", text)[1])
    assert data.startswith(b"\x89PNG")
    assert len(text) < 200_000


def test_texts_are_no_markup(diagram):
    assert "&lt;script&gt;alert(1)" in diagram._repr_html_()
    table = table_of(Summary("<b>", ["<i>"], [("<u>", 0.1, None)], ["a & b"]))
    assert re.findall(r"<(?!/?(?:div|p|strong|table|thead|tbody|tr|th|td)\b)", table) == []
    assert "<td>0.1</td><td></td>" in table


def test_long_tables_say_what_they_leave_out():
    table = table_of(Summary("many", ["n"], [(k,) for k in range(50)]))
    assert table.count("<td>") == 20
    assert "... and 30 more" in table


@pytest.mark.full
def test_a_figure_is_its_own_picture(diagram, results):
    """Without pyplot nothing else would draw it in a notebook."""
    figures = [
        ci.plot_diagram(diagram).figure,
        ci.plot_curves([results["Curve"]])[0].figure,
        ci.plot_orbit(results["Orbit"])[0].figure,
        ci.plot_sweep(results["Sweep"]).figure,
    ]
    assert all(figure._repr_png_().startswith(b"\x89PNG") for figure in figures)


def test_what_has_no_picture_says_so():
    @dataclasses.dataclass
    class Odd:
        def summary(self):
            return Summary("odd", [], [])

    assert picture_of(Odd()).startswith("<p>no picture: picture: found test_what_has")


def test_every_text_has_ten_lines(results):
    branch, orbit = results["Branch"], results["Orbit"]
    rich = dataclasses.replace(
        branch, events=[*branch.events] * 20, missed=["PD between"] * 5, notes=["a", "b"]
    )
    shown = repr(rich).splitlines()
    assert len(shown) == LINES
    assert shown[1].startswith("  start: ")
    assert shown[-4].startswith("  end:   ")
    assert shown[-1] == "  ... and 5 more remarks"
    assert any(re.fullmatch(r"  \.\.\. and \d+ more", line) for line in shown)
    pair = orbit.model
    long = ci.find_orbits(pair, "B" * 11 + "T", starts=8, rounds=1)
    for one in long:
        assert len(repr(one).splitlines()) == LINES
    rows = results["Sweep"].rows
    odd = [
        Row(way, row.value, dataclasses.replace(row.attractor, notation=f"{k}:1"))
        for way in ("up", "down")
        for k, row in enumerate([*rows] * 20)
    ]
    text = repr(Sweep(pair, "s", odd))
    assert max(map(len, text.splitlines())) < 200
    assert "and 48 more" in text
    assert limit_lines("head", ["row"] * 30).count("\n") == LINES - 1


def test_frames_hold_the_same_numbers(results):
    pytest.importorskip("pandas")
    diagram, branch, entry = results["Diagram"], results["Branch"], results["Entry"]
    assert branch.to_dataframe()["s"].tolist() == branch["s"].tolist()
    assert results["Curve"].to_dataframe()["r"].tolist() == results["Curve"]["r"].tolist()
    points = diagram.to_dataframe()
    assert len(points) == sum(map(len, diagram))
    for branch in diagram:
        own = points[points["branch"] == branch.id]
        assert own["d"].tolist() == branch["d"].tolist()
        assert set(own["notation"]) == {branch.notation}
    events = diagram.to_dataframe("events")
    assert events["id"].tolist() == [e.id for e in diagram.entries]
    assert events["s"].tolist() == [e.value for e in diagram.entries]
    assert entry.to_dataframe()["label"].tolist() == [entry.label]
    assert results["Orbit"].to_dataframe()["velocity"].tolist() == list(results["Orbit"].velocities)
    sweep = results["Sweep"]
    assert sweep.to_dataframe()["s"].tolist() == [row.value for row in sweep.rows]
    with pytest.raises(ci.InputError, match="accepted are 'points', 'events'"):
        diagram.to_dataframe("entries")


@pytest.mark.parametrize("name", NAMES)
def test_without_pandas_a_line_says_what_to_install(results, name, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ci.InputError, match=r"pip install 'contimpact\[data\]'"):
        results[name].to_dataframe()


def test_a_missing_column_is_named(results):
    with pytest.raises(KeyError, match="no column 'speed'; it has arclength"):
        results["Branch"]["speed"]
    with pytest.raises(KeyError, match=r"no column \['s'\]"):
        results["Branch"][["s"]]


def test_rows_that_an_array_selects(results):
    branch = results["Branch"]
    rows = branch[branch.stable]
    assert list(rows) == list(branch.columns)
    assert rows["s"].tolist() == branch["s"][branch.stable].tolist()


def test_the_path_of_an_orbit(results):
    """Against the equation of motion, integrated from impact to impact."""
    orbit = results["Orbit"]
    gbar, half = orbit.parameters["gbar"], orbit.parameters["d"] / 2.0
    path = orbit.path(points=50)
    assert orbit.period == 2.0
    assert path.t[[0, -1]] == pytest.approx([orbit.times[0], orbit.times[0] + 2.0])
    flights = [np.split(column, 2) for column in path]
    following = np.roll(orbit.velocities, -1)
    for t, x, v, arriving in zip(*flights, following, strict=True):
        assert abs(abs(x[[0, -1]]) - half).max() < 1e-14
        assert v[-1] == pytest.approx(arriving, abs=1e-12)
        exact = solve_ivp(
            lambda t, y: [y[1], math.cos(math.pi * t) + gbar],
            (t[0], t[-1]),
            [x[0], v[0]],
            t_eval=t,
            rtol=1e-11,
            atol=1e-12,
        )
        assert np.max(np.abs(exact.y - [x, v])) < 1e-8


@pytest.mark.parametrize(
    ("count", "said"),
    [(0, "0 branches"), (1, "1 branch"), (2, "2 branches"), (1000, "1000 branches")],
)
def test_one_thing_is_not_several(count, said):
    """A diagram of one branch had `1 branches`, a note on one motion `1 motions`."""
    assert count_text(count, "branch", "branches") == said
    assert count_text(count, "motion") == said.replace("branches", "motions").replace(
        "branch", "motion"
    )


def test_a_diagram_of_one_branch_says_so(diagram):
    alone = dataclasses.replace(diagram, branches=diagram.branches[:1])
    assert repr(alone).split(": ")[1].startswith("1 branch, ")
