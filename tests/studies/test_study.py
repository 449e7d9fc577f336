"""Studies in a store, asked: rows, quantities in closed form, maps and their zeros."""

from __future__ import annotations

import json
import math
import os
import pickle
import sqlite3
import tempfile
from pathlib import Path

import numpy as np
import pytest
from small_studies import study_given

import contimpact
from contimpact.cli import main
from contimpact.errors import InputError
from contimpact.studies.store import APPLICATION, STEPS, Outcome, Store
from contimpact.studies.study import QUANTITIES, Study, studies
from contimpact.studies.study_file import read_study

NAME = 'it\'s a "study"; DROP TABLE events'
GRID = {"beta": [0.1, 0.2, 0.3, 0.4], "r": [0.05, 0.15, 0.25, 0.35, 0.45]}


def event(name, kind, label, derived, ghost=False, **more):
    base = {
        "event": name,
        "branch": "b1",
        "kind": kind,
        "label": label,
        "ghost": ghost,
        "notation": "1:1",
        "word": "BT",
        "period": 1,
        "becomes": None,
        "wall": None,
        "value": derived / 0.6225,
        "derived": derived,
        "stable": True,
        "physical": True,
        "n_unstable": 0,
        "criticality": None,
        "why": None,
        "arclength": -derived,
        "residual": 0.0,
        "error": 1e-15,
    }
    return base | more


def interval(number, low, high, ends, **more):
    base = {
        "number": number,
        "branch": "b1",
        "notation": "1:1",
        "low": low / 0.6225,
        "high": high / 0.6225,
        "low_end": ends[0],
        "high_end": ends[1],
        "low_derived": low,
        "high_derived": high,
    }
    return base | more


def swept(first, number, direction, words):
    """A sweep in steps of 0.01 in d, with these words and periods."""
    step = 0.01 if direction == "up" else -0.01
    return [
        {
            "number": number + k,
            "direction": direction,
            "value": (first + k * step) / 0.6225,
            "kind": "periodic",
            "notation": "of no use",
            "word": word,
            "period": period,
            "exponent": -1.0,
            "rate": 2.0,
            "gap": 0.1,
        }
        for k, (word, period) in enumerate(words)
    ]


SWEPT = [
    *swept(0.5, 0, "down", [("BT", 1), ("BTBT", 2), (None, None), ("TBBTBB", 2), ("BBT", 1)]),
    *swept(0.4, 5, "up", [("BBT", 1)] * 3),
]
"""Two periods of 2:1, read from another impact, are first met at d = 0.47 as it falls."""


def outcome(beta, r):
    """PD at d = 0.3 and grazing at 0.3 - (r + beta - 0.5): the doubling comes first above
    r = 0.5 - beta."""
    doubling, grazing = 0.3, 0.8 - r - beta
    first = doubling > grazing
    rows = {
        "events": [
            event("e1", "PD", "PD" if first else "~PD", doubling, not first),
            event("e2", "G", f"{'~' * first}G[1:1->2:1]", grazing, first, becomes="BBT"),
            event("e3", "PD", "PD", 0.9, branch="b2", notation="2:1"),
        ],
        "intervals": [
            interval(0, max(doubling, grazing), 0.9, ("e1" if first else "e2", "range")),
            interval(1, 0.1, 0.85, ("e9", "range"), branch="b2", notation="2:1"),
        ],
        "transitions": [
            {
                "number": 0,
                "source": "1:1",
                "target": "2:1",
                "grazing": "e2",
                "mechanism": 3 if first else 2,
                "doubling": "e1",
                "fold": None,
            }
        ],
        "attractors": SWEPT,
        "energies": [{"number": k, "per_impact": 0.1, "per_time": r + k} for k in (0, 1)],
    }
    return Outcome("done", 0.1, "{}", rows, 10, 100)


def write(path, name, count=None):
    """A study whose scenes are given in closed form, with a failure and PD-G points beside it."""
    study = read_study(study_given(name, grid=GRID))
    with Store(path) as store:
        number = store.enter(study)
        for scene, values in list(zip(*study.points, strict=True))[:count]:
            placed = dict(zip(study.design.names, values.tolist(), strict=True))
            store.record(number, int(scene), placed, outcome(*values.tolist()))


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    path = tmp_path_factory.mktemp("asked") / "s.sqlite"
    write(path, NAME)
    beside = study_given("beside", grid={"beta": GRID["beta"]})
    beside["model"]["parameters"] |= {"r": 0.4, "s": 0.31}
    study = read_study(beside)
    with Store(path) as store:
        number = store.enter(study)
        for scene, beta in enumerate(GRID["beta"]):
            point = {
                "number": 0,
                "curve": "c1",
                "kind": "PD-G",
                "notation": "1:1",
                "first": "s",
                "second": "r",
                "first_value": 0.48,
                "second_value": 0.5 - beta,
                "derived": 0.3,
                "residual": 0.0,
                "error": 1e-15,
            }
            rows = {"codimension_two": [point]}
            store.record(number, scene, {"beta": beta}, Outcome("done", 0.1, "{}", rows))
        failed = {"failures": [{"kind": "budget", "reason": "slow"}]}
        store.record(
            store.enter(read_study(study_given("failed"))),
            0,
            {"beta": 0.3, "r": 0.2},
            Outcome("failed", None, "{}", failed),
        )
    return path


@pytest.fixture
def asked(store):
    with Study(store, NAME) as study:
        yield study


def test_what_a_study_is(store, asked):
    assert studies(store) == [NAME, "beside", "failed"]
    assert (asked.axes, asked.parameter, asked.derived) == (("beta", "r"), "s", "d")
    assert (len(asked), asked.total) == (20, 20)
    assert asked.given["model"]["parameters"]["A"] == 5.0
    assert contimpact.Study is Study


def test_a_study_shows_itself(store, asked):
    """In a notebook: its axes and counts as a table, and the map of what ends the 1:1 orbit."""
    shown = asked._repr_mimebundle_()
    assert shown["text/plain"] == repr(asked)
    html = shown["text/html"]
    assert "DROP TABLE" in html
    assert "<td>beta</td><td>4</td><td>0.1</td><td>0.4</td>" in html
    assert f"{len(asked.events())} events" in html
    assert '<img alt="Study' in html
    with Study(store, "beside") as one_axis:
        assert "no picture" in one_axis._repr_mimebundle_()["text/html"]


def test_a_study_is_pickled_as_the_place_of_its_store(asked):
    again = pickle.loads(pickle.dumps(asked))
    assert (again.path, again.name, len(again)) == (asked.path, asked.name, len(asked))
    again.close()


def test_a_study_gives_tables(asked):
    pytest.importorskip("pandas")
    assert len(asked.to_dataframe()) == len(asked)
    assert len(asked.to_dataframe("events")) == len(asked.events())
    with pytest.raises(InputError, match="accepted are scenes"):
        asked.to_dataframe("nothing")


def test_a_study_has_to_be_named_where_there_are_several(store, tmp_path):
    with pytest.raises(InputError, match=r"3 studies; name one of .*'beside'"):
        Study(store)
    with pytest.raises(InputError, match="no study 'none'"):
        Study(store, "none")
    with pytest.raises(InputError, match="no such file"):
        Study(tmp_path / "none.sqlite")
    assert not (tmp_path / "none.sqlite").exists()


def test_rows_are_selected_by_columns_and_axes(asked):
    assert len(asked.events()) == 60
    chosen = asked.events(label="~PD", beta=[0.1, 0.2])
    columns = chosen.arrays()
    expected = [(b, r) for b in (0.1, 0.2) for r in GRID["r"] if b + r < 0.5]
    assert list(zip(columns["beta"], columns["r"], strict=True)) == expected
    assert columns["scene"].dtype == np.int64
    assert len(chosen) == len(expected) == len(list(chosen))
    assert next(iter(chosen))["label"] == "~PD"
    assert len(asked.events(label="' OR 1=1 --")) == 0
    assert asked.scenes().arrays()["seconds"].tolist() == [0.1] * 20


def test_columns_without_rows_are_there(asked):
    columns = asked.select("curves").arrays()
    with pytest.raises(InputError, match=r"add 'attractors' to study\.keep"):
        asked.sweeps()
    assert {"scene", "beta", "r", "curve", "kind"} <= {*columns}
    assert all(len(values) == 0 for values in columns.values())


def test_rows_as_a_dataframe(asked):
    pytest.importorskip("pandas")
    frame = asked.events(kind="PD", notation="1:1").to_dataframe()
    assert len(frame) == 20
    assert frame["derived"].tolist() == [0.3] * 20


def test_failures_have_their_reasons(store):
    with Study(store, "failed") as study:
        (row,) = study.failures()
        assert (row["kind"], row["reason"], row["beta"]) == ("budget", "slow", 0.3)
        assert np.isnan(study.scenes().arrays()["seconds"]).all()


@pytest.mark.parametrize(
    "ask",
    [
        lambda study: study.select("studies"),
        lambda study: study.events(nothing=1),
        lambda study: study.events(**{"label; DROP TABLE events": 1}),
        lambda study: list(study.rows("DELETE FROM events")),
        lambda study: study.entries(0),
        lambda study: study.map("nothing"),
        lambda study: study.map("ends", axes=("beta", "A")),
        lambda study: study.map("ends", at={"A": 5.0}),
    ],
)
def test_what_cannot_be_asked(ask, asked):
    with pytest.raises(InputError):
        ask(asked)
    assert len(asked.events()) == 60


def test_what_is_kept_but_not_there_is_said(tmp_path):
    given = study_given("kept", grid=GRID)
    given["study"]["keep"] = ["catalogue"]
    study = read_study(given)
    with Store(tmp_path / "kept.sqlite") as store:
        store.enter(study)
    with Study(tmp_path / "kept.sqlite") as kept:
        with pytest.raises(InputError, match=f"scene from 0 to {kept.total - 1} that is finished"):
            kept.entries(99)
        with pytest.raises(InputError, match=r"add 'tables' to study\.keep"):
            kept.table(0, "b1")
        with pytest.raises(InputError, match=r"a query cannot be answered .*; mend the query"):
            list(kept.rows("SELEC 1"))


def test_an_axis_with_one_value_needs_none(tmp_path):
    given = study_given("one", grid=GRID | {"A": [5.0]})
    del given["model"]["parameters"]["A"]
    study = read_study(given)
    with Store(tmp_path / "one.sqlite") as store:
        number = store.enter(study)
        store.record(number, 0, {"beta": 0.1, "r": 0.2, "A": 5.0}, outcome(0.1, 0.2))
    with Study(tmp_path / "one.sqlite") as one:
        assert one.map("ends").values.tolist() == one.map("ends", at={"A": 5.0}).values.tolist()


def test_a_map_is_at_the_nearest_value_of_another_axis_and_says_which(tmp_path):
    given = study_given("two", grid=GRID | {"A": [5.0, 8.0]})
    del given["model"]["parameters"]["A"]
    study = read_study(given)
    with Store(tmp_path / "two.sqlite") as store:
        number = store.enter(study)
        for scene, force in enumerate((5.0, 8.0)):
            store.record(number, scene, {"beta": 0.1, "r": 0.2, "A": force}, outcome(0.1, 0.2))
    with Study(tmp_path / "two.sqlite") as two:
        shown = two.map("ends", at={"A": 6.0})
        assert (shown.at, shown.title, len(shown.x)) == ({"A": 5.0}, "two, A = 5", 1)
        with pytest.raises(InputError, match="at A: found 9; give 5 to 8"):
            two.map("ends", at={"A": 9.0})
        with pytest.raises(InputError, match="at: found nothing for 'A'; give values of A"):
            two.map("ends")


def of(shown):
    return {
        (round(x, 9), round(y, 9)): v
        for x, y, v in zip(shown.x, shown.y, shown.values.tolist(), strict=True)
    }


@pytest.mark.parametrize("name", [*(n for n in QUANTITIES if n != "margin"), "count:~PD"])
def test_quantities_are_those_of_the_closed_form(name, asked):
    def first(beta, r):
        return beta + r > 0.5

    expected = {
        "ends": lambda b, r: "PD" if first(b, r) else "G[1:1->2:1]",
        "mechanism": lambda b, r: "3" if first(b, r) else "2",
        "distance": lambda b, r: b + r - 0.5,
        "bistability": lambda b, r: 0.85 - max(0.3, 0.8 - r - b),
        "energy": lambda b, r: r + 1.0,
        "bound": lambda b, r: 0.47 - (0.8 - r - b) if first(b, r) else math.nan,
        "count:~PD": lambda b, r: 0 if first(b, r) else 1,
    }[name]
    found = of(asked.map(name))
    for (beta, r), value in found.items():
        wanted = expected(beta, r)
        assert value == (
            wanted if isinstance(wanted, str) else pytest.approx(wanted, abs=1e-12, nan_ok=True)
        )
    assert len(found) == 20


def test_the_zeros_of_a_map_are_its_curve_of_codimension_two(asked):
    """The distance is linear, so interpolation finds its zeros to rounding."""
    shown = asked.map("distance")
    zeros = shown.zeros()
    np.testing.assert_allclose(zeros[:, 1], 0.5 - zeros[:, 0], atol=1e-12)
    assert zeros[:, 0].tolist() == GRID["beta"]
    assert [*shown.curves] == ["PD-G"]
    assert shown.departure("PD-G") < 1e-12


def test_points_of_codimension_two_of_other_parameter_values_are_left_out(store, tmp_path):
    """The point's own A and s have to be the map's, but for what is followed."""
    with Study(store, NAME) as study:
        study.given = json.loads(json.dumps(study.given))
        study.given["model"]["parameters"]["A"] = 4.0
        assert study.map("distance").curves == {}
        study.given["model"]["parameters"]["A"] = 5.0
        study.parameter = "A"  # then s is held, and the points have another one
        assert study.map("distance").curves == {}


def test_a_part_of_a_grid_is_a_grid_and_a_sample_none(tmp_path):
    write(tmp_path / "s.sqlite", "part", 13)
    with Study(tmp_path / "s.sqlite") as study:
        shown = study.map("distance")
        assert (len(study), study.total) == (13, 20)
    xs, ys, table = shown.grid()
    assert table.shape == (len(ys), len(xs)) == (5, 3)
    assert np.isnan(table).sum() == 2
    scattered = contimpact.studies.study.Map(
        "s", "q", "t", ("beta", "r"), np.arange(9.0), np.arange(9.0), np.ones(9), False
    )
    assert scattered.grid() is None
    with pytest.raises(InputError, match="no grid"):
        scattered.zeros()
    drawn = contimpact.plots.maps.plot_map(scattered)
    (left, right), (bottom, top) = drawn.get_xlim(), drawn.get_ylim()
    assert left < scattered.x.min() < scattered.x.max() < right
    assert bottom < scattered.y.min() < scattered.y.max() < top


def test_names_of_one_kind_have_colours_of_their_own():
    """Two grazings had the same, on the map and in its legend."""
    names = ["G[1:1->2:1]", "G[1:1->1:2]", "~G[1:1->2:1]", "PD", "range", "2"]
    axes, points = ("beta", "r"), np.arange(6.0)
    shown = contimpact.studies.study.Map("s", "ends", "t", axes, points, points, names, True)
    patches = contimpact.plots.maps.plot_map(shown).get_legend().get_patches()
    assert len({patch.get_facecolor() for patch in patches}) == len(names)


@pytest.mark.full
def test_the_command_draws_the_maps_and_says_what_they_show(store, tmp_path, capsys):
    assert main(["atlas", str(store), "-o", str(tmp_path), "--study", NAME]) == 0
    out = capsys.readouterr().out
    assert "what ends stable 1:1 as d falls: G[1:1->2:1] 10, PD 10" in out
    assert "changes its sign at 4 places along r" in out
    assert "in r from PD-G computed directly" in out
    names = {path.name for path in tmp_path.iterdir()}
    stem = "it_s_a__study___DROP_TABLE_events"
    told = [q for q in QUANTITIES if q != "margin"]  # which is asked for by [margins] alone
    assert names == {f"{stem}-{q}.{kind}" for q in told for kind in ("csv", "png")}
    rows = (tmp_path / f"{stem}-ends.csv").read_text().splitlines()
    assert rows[0] == "beta,r,ends"
    assert rows[1] == "0.1,0.05,G[1:1->2:1]"


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--quantity", "nothing"], "quantity: found 'nothing'"),
        (["--at", "A"], "--at: found 'A'"),
        (["--study", "none"], "no study 'none'"),
        (["--orbit", "9:9"], "no map over two axes has a value of 9:9"),
    ],
)
def test_maps_that_cannot_be_drawn(more, message, store, tmp_path, capsys):
    more = more if "--study" in more else [*more, "--study", NAME]
    assert main(["atlas", str(store), "-o", str(tmp_path), *more]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.skipif(os.name != "posix", reason="permissions of POSIX")
def test_a_store_in_a_folder_that_cannot_be_written_is_read(store):
    """A copy of it, as after a study has ended: its log is not there."""
    with tempfile.TemporaryDirectory() as name:
        folder, me = Path(name), os.geteuid()
        copy = folder / "copy.sqlite"
        copy.write_bytes(store.read_bytes())
        copy.chmod(0o444)
        folder.chmod(0o555)
        if me == 0:
            os.seteuid(65534)  # no folder is closed to root
        try:
            with Study(copy, NAME) as study:
                assert len(study.events()) == 60
            with pytest.raises(InputError, match="cannot be written"):
                Store(copy)
        finally:
            os.seteuid(me)
            folder.chmod(0o755)


def test_a_store_of_an_older_schema_is_brought_up_to_date(tmp_path):
    path = tmp_path / "s.sqlite"
    older = sqlite3.connect(path)
    older.executescript(STEPS[0])
    older.executescript(f"PRAGMA user_version = 1; PRAGMA application_id = {APPLICATION};")
    names = "name, source, digest, record, keep, axes, parameter, scenes"
    values = ["old", "", "", json.dumps({"model": {}}), "", "beta r", "s", 0]
    older.execute(f"INSERT INTO studies ({names}) VALUES (?, ?, ?, ?, ?, ?, ?, ?)", values)
    older.commit()
    older.close()
    with Study(path) as study:
        assert len(study.select("codimension_two")) == 0
