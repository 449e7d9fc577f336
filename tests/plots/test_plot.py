"""The diagram as a picture: what is drawn, with which marks, and what is left alone."""

from __future__ import annotations

import copy
import dataclasses
import json
import re
import subprocess
import sys
import tomllib

import matplotlib
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.colors import to_hex, to_rgb
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from zoo import ROOT

from contimpact import InputError, follow, plot_diagram, read_scene
from contimpact.bifurcations.declarations import KINDS
from contimpact.bifurcations.kind import kind_of
from contimpact.plots import lines
from contimpact.plots.diagram import COLOURS, STYLES, _part_lines, save_diagram
from contimpact.plots.lines import label_text
from contimpact.results.diagram import Diagram
from contimpact.results.quantities import NO_WALL

BRANCHES = ROOT / "branches"
MARKERS = {name: kind_of(name).look.marker for name in KINDS}


def scene_of(name, **detect):
    """A shipped scene without switching: the branches of the orbits at its start."""
    text = (BRANCHES / name / "scene.toml").read_text(encoding="utf-8")
    given = tomllib.loads(text)
    given["follow"]["orbits"] = ["1"] if name == "stop" else ["1:1", "2:1"]
    for key in ("switch", "depth", "survey"):
        given["follow"].pop(key, None)
    given["detect"] = {"events": ["FB", "PD", "G"], **detect}
    return read_scene(given)


@pytest.fixture(scope="module")
def fig7():
    return follow(scene_of("fig7"))


@pytest.fixture(scope="module")
def drawn(fig7):
    """Its diagram, for all who look at it alone."""
    return plot_diagram(fig7)


@pytest.fixture(scope="module")
def enlarged(fig7):
    """A part of it, along the capsule's length."""
    return plot_diagram(fig7, x="d", xlim=(0.13, 0.25))


@pytest.fixture(scope="module")
def stop():
    return follow(scene_of("stop", events=["FB", "PD", "V"]))


def curves(ax):
    """The lines that are branches: drawn in a wall's colour, without markers."""
    walls = {colour.lower() for colour in COLOURS}
    return [
        line
        for line in ax.lines
        if to_hex(line.get_color()) in walls and line.get_marker() in ("None", None, "")
    ]


def marks(ax):
    """The lines that are events: markers without a line."""
    return [line for line in ax.lines if line.get_marker() not in ("None", None, "")]


def style_of(line):
    """solid, dashed or dotted, from the dashes as they are drawn."""
    dashes = line._dash_pattern[1]
    if dashes is None:
        return "stable"
    return "unstable" if dashes[0] > 2.0 * dashes[1] else "unphysical"


def labels(ax):
    """The labels of events; walls and orbits are named beside their curves."""
    return [text for text in ax.texts if text.get_gid() == "event"]


def labels_of(ax):
    return [text.get_text() for text in labels(ax)]


# A figure


def test_figure_from_fig7(drawn):
    assert isinstance(drawn, matplotlib.axes.Axes)
    assert isinstance(drawn.figure, Figure)
    assert drawn.get_xlabel() == "$s$"
    assert "velocity" in drawn.get_ylabel()
    assert len(curves(drawn)) >= 2 + 3
    low, high = drawn.get_xlim()
    assert low < 0.08 < 0.99 < high


def test_figure_from_the_stop(stop):
    ax = plot_diagram(stop)
    assert ax.get_xlabel() == "$a$"
    assert curves(ax)
    assert {to_hex(line.get_color()) for line in curves(ax)} == {COLOURS[0].lower()}
    kinds = {line.get_marker() for line in marks(ax)}
    assert kinds == {MARKERS[kind] for kind in {entry.kind for entry in stop.entries}}


def test_given_axes_are_drawn_on_and_returned(fig7, stop):
    figure = Figure()
    left, right = figure.subplots(1, 2)
    assert plot_diagram(fig7, left) is left
    assert len(left.lines) > 0
    assert len(right.lines) == 0
    assert plot_diagram(stop, ax=right) is right
    assert figure.axes == [left, right]


def test_no_new_figure_where_axes_are_given(fig7, monkeypatch):
    ax = Figure().subplots()

    def refuse(*arguments, **options):
        raise AssertionError("a figure was made")

    monkeypatch.setattr(matplotlib.figure.Figure, "__init__", refuse)
    assert plot_diagram(fig7, ax) is ax


@pytest.mark.full
def test_global_settings_are_not_changed(fig7, tmp_path):
    before = copy.deepcopy(dict(matplotlib.rcParams))
    plot_diagram(fig7)
    save_diagram(fig7, tmp_path, ["svg", "png"])
    assert dict(matplotlib.rcParams) == before


def test_users_settings_are_respected(fig7):
    with matplotlib.rc_context({"axes.facecolor": "0.9", "font.size": 7.0}):
        ax = plot_diagram(fig7)
    assert to_rgb(ax.get_facecolor()) == pytest.approx((0.9, 0.9, 0.9))
    assert ax.xaxis.label.get_size() == 7.0


@pytest.mark.full
def test_pyplot_and_other_heavy_modules_are_not_imported():
    code = (
        "import sys, matplotlib, contimpact.plots.diagram, contimpact.cli, contimpact\n"
        "contimpact.plot_diagram(contimpact.Diagram('x', []))\n"
        "backend = matplotlib.rcParams._get_backend_or_none()\n"
        "print([m for m in ('matplotlib.pyplot', 'sympy', 'tkinter') if m in sys.modules], backend)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split(" ")[0].strip() == "[]"
    assert done.stderr == ""


def test_the_diagram_is_not_changed(fig7):
    before = [{n: v.copy() for n, v in b.columns.items()} for b in fig7.branches]
    plot_diagram(fig7, x="d", xlim=(0.13, 0.25))
    for branch, columns in zip(fig7.branches, before, strict=True):
        for name, values in columns.items():
            assert np.array_equal(branch[name], values, equal_nan=values.dtype.kind == "f")


# Lines


def test_every_point_is_drawn_once_with_its_style(fig7):
    """Along each impact of each branch: lines in order, from end to end, styled by the status."""
    ax = plot_diagram(fig7, unphysical="all")
    drawn = {}
    for line in curves(ax):
        style = style_of(line)
        for x, y in zip(*line.get_data(), strict=True):
            drawn.setdefault((float(x), float(y)), set()).add(style)
    for branch in fig7.branches:
        for k in range(len(branch.word)):
            rows = zip(branch["s"].tolist(), branch[f"v{k + 1}"].tolist(), strict=True)
            for row, point in enumerate(rows):
                assert point in drawn
                if branch["event"][row]:
                    continue
                status = "unphysical"
                if branch.physical[row]:
                    status = "stable" if branch.stable[row] else "unstable"
                assert status in drawn[point]


def test_styles_differ_without_colour():
    """Solid, dashed, dotted, and dashes with dots where the status is unknown; nothing else tells
    the states apart in print."""
    assert list(STYLES) == ["stable", "unstable", "unphysical", "unknown"]
    assert len(STYLES["unknown"][1]) == 4
    assert STYLES["stable"] in ("-", "solid")
    dashed, dotted = STYLES["unstable"][1], STYLES["unphysical"][1]
    assert dashed[0] > 2 * dashed[1]
    assert dotted[0] < dotted[1]


def test_all_three_styles_are_in_fig7(drawn):
    assert {style_of(line) for line in curves(drawn)} == set(STYLES) - {"unknown"}


@pytest.mark.full
def test_status_changes_at_the_event(fig7):
    """Lines of two styles meet at the marker of the event between them, not a point beside it."""
    branch = next(b for b in fig7.branches if b.word == "BT")
    entry = next(e for e in branch.events if e.kind == "PD")
    ax = plot_diagram(fig7, unphysical="all")
    for impact in entry.impacts:
        meeting = {
            style_of(line)
            for line in curves(ax)
            for x, y in (line.get_xydata()[0], line.get_xydata()[-1])
            if x == entry.value and y == impact["velocity"]
        }
        assert meeting == {"stable", "unstable"}


@pytest.mark.full
def test_walls_have_colours_of_their_own(drawn):
    colours = {to_hex(line.get_color()) for line in curves(drawn)}
    assert colours == {colour.lower() for colour in COLOURS[:2]}
    texts = [text.get_text() for text in drawn.get_legend().get_texts()]
    assert {"wall B", "wall T", "stable", "unstable", "unphysical"} <= set(texts)


@pytest.mark.parametrize("choice", ["all", "period-1", "none"])
def test_unphysical_orbits_can_be_left_out(fig7, choice):
    ax = plot_diagram(fig7, unphysical=choice)
    styles = {style_of(line) for line in curves(ax)}
    assert ("unphysical" in styles) == (choice != "none")
    assert {"stable", "unstable"} <= styles


# Events


def test_ghosts_are_hollow(fig7, drawn):
    expected = []
    for entry in fig7.entries:
        places = [(i["wall"], i["velocity"]) for i in entry.impacts]
        places += [(entry.wall, 0.0)] if entry.kind == "G" else []
        expected += [(MARKERS[entry.kind], entry.value, speed, entry.ghost) for _, speed in places]
    found = []
    for line in marks(drawn):
        face = line.get_markerfacecolor()
        hollow = face == "white"
        assert hollow or to_rgb(face) == to_rgb(line.get_color())
        assert to_rgb(line.get_markeredgecolor()) == to_rgb(line.get_color())
        (x,), (y,) = line.get_data()
        found.append((line.get_marker(), x, y, hollow))
    assert sorted(found) == sorted(expected)
    assert {hollow for *_, hollow in found} == {True, False}


def test_kinds_have_markers_of_their_own():
    assert set(MARKERS) == {"FB", "BP", "PD", "NS", "G", "V", "T", "UZ"}
    assert len({*MARKERS.values(), kind_of("a user's own").look.marker}) == len(MARKERS) + 1


def test_legend_names_the_kinds_shown(drawn):
    texts = [t.get_text() for t in drawn.get_legend().get_texts()]
    assert {"FB", "PD", "G"} <= set(texts)
    assert any("ghost" in text for text in texts)
    assert "UZ" not in texts
    assert "BP" not in texts


def test_legend_without_ghosts(fig7):
    branch = fig7.branches[0]
    real = dataclasses.replace(branch, events=[e for e in branch.events if not e.ghost])
    texts = [t.get_text() for t in plot_diagram(Diagram("x", [real])).get_legend().get_texts()]
    assert not any("ghost" in text for text in texts)


# Labels


def plain(text):
    """A label without what only serves its setting."""
    return re.sub(r"\\mathrm\{(\w+)\}", r"\1", text).replace("\\,", "").strip("$")


def test_labels_as_in_table_1(enlarged):
    """G with the old count below and the new one above; a tilde over ghosts."""
    assert sorted(map(plain, labels_of(enlarged))) == sorted(
        [r"\widetilde{PD}$(2:1)", r"G_{2:1}^{3:1}", r"\widetilde{G}_{1:1}^{2:1}", "FB", "PD$(1:1)"]
    )


@pytest.mark.parametrize(
    ("kind", "ghost", "label", "wanted"),
    [
        ("PD", False, "PD", "PD"),
        ("PD", True, "~PD", r"\widetilde{PD}"),
        ("FB", True, "~FB", r"\widetilde{FB}"),
        ("G", False, "G[1:1->2:1]", "G_{1:1}^{2:1}"),
        ("G", True, "~G[2:1->2:2]", r"\widetilde{G}_{2:1}^{2:2}"),
        ("G", True, "~G[1:1/2T->(3:2)/2T]", r"\widetilde{G}_{1:1/2T}^{(3:2)/2T}"),
        ("V", False, "V", "V"),
        ("V", True, "~V[1:1->1:0]", r"\widetilde{V}_{1:1}^{1:0}"),
    ],
)
def test_label_text(fig7, kind, ghost, label, wanted):
    entry = dataclasses.replace(fig7.entries[0], kind=kind, ghost=ghost, label=label)
    text = label_text(entry)
    assert text.startswith("$")
    assert text.endswith("$")
    assert plain(text) == wanted


def test_labels_stand_over_their_value_and_apart(fig7, enlarged):
    enlarged.figure.draw_without_rendering()
    values = {round(e.parameters["d"], 9) for e in fig7.entries}
    boxes = []
    for text in labels(enlarged):
        assert round(text.xy[0], 9) in values
        boxes.append(Text.get_window_extent(text))
    for i, box in enumerate(boxes):
        assert box.y0 >= enlarged.get_window_extent().y1
        for other in boxes[i + 1 :]:
            assert not box.overlaps(other)


def test_labels_leave_room_for_the_power_of_ten_of_the_ordinate():
    """It stood on labels, and on their leaders, that reach beyond the frame to the left."""
    values = {"a": 1, "omega": 1.7, "c": 0.1, "k": 0, "sigma": 0.47, "r": 0.7}
    scene = {
        "name": "small",
        "model": {"system": "two-stops", "parameters": values},
        "follow": {"parameter": "sigma", "range": [0.46, 0.5], "orbits": ["RL"]},
        "output": {"small": "x**2/50"},
    }
    ax = plot_diagram(follow(read_scene(scene)), y="small", xlim=(0.4686, 0.5))
    ax.figure.canvas.draw()
    power = ax.yaxis.get_offset_text()
    assert "{10^" in power.get_text()
    taken = power.get_window_extent()
    events = [Text.get_window_extent(text) for text in labels(ax)]
    assert min(box.x0 for box in events) < ax.bbox.x0
    assert not any(box.overlaps(taken) for box in events)
    assert taken.x0 > 0.0


def test_labels_can_be_left_out(fig7):
    ax = plot_diagram(fig7, labels=False)
    assert labels_of(ax) == []
    assert marks(ax)


def test_labels_outside_the_limits_are_left_out(fig7):
    ax = plot_diagram(fig7, x="d", xlim=(0.23, 0.25))
    assert [plain(text) for text in labels_of(ax)] == ["PD"]
    assert {line.get_marker() for line in marks(ax)} == {MARKERS["PD"]}
    assert "FB" not in [text.get_text() for text in ax.get_legend().get_texts()]


# Axes


@pytest.mark.parametrize("x", ["s", "d", "arclength", "smallest_gap"])
def test_any_column_on_the_x_axis(fig7, x):
    ax = plot_diagram(fig7, x=x)
    drawn = np.concatenate([line.get_xdata() for line in curves(ax)])
    there = np.concatenate([branch[x] for branch in fig7.branches])
    assert np.all(np.isin(there[~np.isnan(there)], drawn))
    assert np.nanmin(there) - 1e-6 <= np.nanmin(drawn)
    assert np.nanmax(drawn) <= np.nanmax(there) + 1e-3
    assert ax.get_xlabel()
    if x in fig7.entries[0].parameters:
        assert marks(ax)


@pytest.mark.full
def test_limits(fig7):
    ax = plot_diagram(fig7, x="d", xlim=(0.13, 0.25), ylim=(-1.0, 1.0))
    assert ax.get_xlim() == (0.13, 0.25)
    assert ax.get_ylim() == (-1.0, 1.0)


@pytest.mark.full
def test_velocities_in_sight_set_the_limits(fig7):
    """Not those of the parts of branches outside the x limits."""
    wide = plot_diagram(fig7, x="d").get_ylim()
    narrow = plot_diagram(fig7, x="d", xlim=(0.2, 0.25)).get_ylim()
    assert wide[0] <= narrow[0] < 0.0 < narrow[1] <= wide[1]
    assert narrow[1] < wide[1]
    for line in curves(plot_diagram(fig7, x="d", xlim=(0.2, 0.25))):
        x, y = line.get_data()
        assert np.all(np.abs(y[(x > 0.2) & (x < 0.25)]) < max(np.abs(narrow)))


@pytest.mark.parametrize(
    ("options", "label"),
    [
        ({"unit": "m"}, "$s$ (m)"),
        ({}, "$s$"),
        ({"x": "d"}, "$d$"),
        ({"x": "beta", "unit": "rad"}, r"$\beta$ (rad)"),
        ({"x": "gbar"}, r"$\bar{g}$"),
    ],
)
def test_x_label(fig7, options, label):
    branch = fig7.branches[0]
    varying = dict(branch.columns) | dict.fromkeys(("beta", "gbar"), branch["s"])
    first = Diagram("first", [dataclasses.replace(branch, columns=varying)])
    assert plot_diagram(first, **options).get_xlabel() == label


def test_a_parameter_that_does_not_vary_is_no_axis(fig7):
    with pytest.raises(InputError, match="x: beta does not vary along the branches"):
        plot_diagram(fig7, x="beta")


# Extremes


@pytest.mark.full
def test_a_scene_without_events(fig7):
    quiet = follow(scene_of("fig7", events=[]))
    assert quiet.entries == []
    ax = plot_diagram(quiet)
    assert curves(ax)
    assert marks(ax) == []
    assert labels_of(ax) == []
    ax.figure.draw_without_rendering()


def test_a_branch_of_one_point(fig7):
    branch = fig7.branches[0]
    columns = {name: values[:1] for name, values in branch.columns.items()}
    ax = plot_diagram(Diagram("point", [dataclasses.replace(branch, columns=columns, events=[])]))
    ax.figure.draw_without_rendering()


def test_an_event_of_an_unknown_kind(fig7):
    """A user's own function."""
    branch = fig7.branches[0]
    entry = dataclasses.replace(branch.events[0], kind="energy", label="energy", ghost=False)
    ax = plot_diagram(Diagram("x", [dataclasses.replace(branch, events=[entry])]))
    assert len(marks(ax)) == len(entry.impacts)
    ax.figure.draw_without_rendering()


def test_limits_without_anything_in_them(fig7):
    ax = plot_diagram(fig7, x="d", xlim=(50.0, 60.0))
    assert labels_of(ax) == []
    ax.figure.draw_without_rendering()


# Files


@pytest.mark.full
def test_saved_files(fig7, tmp_path):
    names = save_diagram(fig7, tmp_path, ["svg", "png", "pdf"], x="d", xlim=(0.13, 0.25))
    assert names == ["diagram.svg", "diagram.png", "diagram.pdf"]
    assert (tmp_path / "diagram.svg").read_text(encoding="utf-8").startswith("<?xml")
    assert (tmp_path / "diagram.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "diagram.pdf").read_bytes().startswith(b"%PDF")
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)


@pytest.mark.full
def test_svg_is_the_same_every_time(fig7, tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        save_diagram(fig7, tmp_path / name, ["svg"])
    one, two = ((tmp_path / name / "diagram.svg").read_bytes() for name in ("one", "two"))
    assert one == two
    assert b"<dc:date>" not in one


@pytest.mark.full
def test_svg_of_another_process_is_the_same(fig7, tmp_path):
    """Nothing in it depends on the process: no salt, no order of a set."""
    scene = json.dumps(scene_of("fig7").given)
    code = (
        "import json, sys, pathlib, contimpact\n"
        "from contimpact.plots.diagram import save_diagram\n"
        f"diagram = contimpact.follow(contimpact.read_scene(json.loads({scene!r})))\n"
        "save_diagram(diagram, pathlib.Path(sys.argv[1]), ['svg'])"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=True)
    (tmp_path / "here").mkdir()
    save_diagram(fig7, tmp_path / "here", ["svg"])
    here = (tmp_path / "here" / "diagram.svg").read_bytes()
    assert (tmp_path / "diagram.svg").read_bytes() == here


def test_legend_lines_are_legend_lines(fig7):
    """The legend's handles are its own, not artists of the axes drawn twice."""
    ax = plot_diagram(fig7)
    handles = ax.get_legend().legend_handles
    assert all(isinstance(handle, Line2D) for handle in handles)
    assert not set(map(id, handles)) & set(map(id, ax.lines))


# What makes a figure readable


def test_walls_differ_in_lightness():
    """What is left of colours in print without them."""
    light = [float(np.dot(to_rgb(colour), (0.299, 0.587, 0.114))) for colour in COLOURS[:2]]
    assert abs(light[0] - light[1]) > 0.2


def test_walls_are_named_beside_their_curves(fig7):
    ax = plot_diagram(fig7, x="d", xlim=(0.13, 0.25))
    names = {text.get_text(): text for text in ax.texts if text.get_gid() == "wall"}
    assert set(names) == {"B", "T"}
    assert names["B"].xy == pytest.approx((0.25, 0.696), abs=1e-2)
    assert names["T"].xy[1] < 0.0
    assert to_hex(names["T"].get_color()) == COLOURS[1].lower()


@pytest.mark.full
def test_orbits_are_named_on_their_stable_stretches(fig7):
    """Each stretch once, next to a curve of its own, over no line, no marker and no other name."""
    ax = plot_diagram(fig7, x="d", xlim=(0.13, 0.25))
    ax.figure.draw_without_rendering()
    names = [text for text in ax.texts if text.get_gid() == "orbit"]
    assert sorted(text.get_text() for text in names) == ["1:1", "2:1"]
    stable = {b.notation: b["d"][b.stable & b.physical] for b in fig7.branches}
    boxes = [Text.get_window_extent(text) for text in names]
    assert not boxes[0].overlaps(boxes[1])
    for text, box in zip(names, boxes, strict=True):
        (left, _), (right, _) = ax.transData.inverted().transform(box.get_points())
        assert np.min(stable[text.get_text()]) < 0.5 * (left + right) < 0.25
        for line in curves(ax):
            path = line.get_path().interpolated(20)
            x, y = ax.transData.transform(path.vertices).T
            assert not np.any((box.x0 < x) & (x < box.x1) & (box.y0 < y) & (y < box.y1))


def test_a_branch_without_impacts_is_drawn(stop):
    """At velocity zero, in the colour of no wall, as far as it is stable."""
    free = next((b for b in stop.branches if not b.word), None)
    lacking = dataclasses.replace(stop.branches[0], id="b9", word="", notation="0", events=[])
    ax = plot_diagram(Diagram("x", [free or lacking]))
    assert "no impact" in [t.get_text() for t in ax.get_legend().get_texts()]
    drawn = [line for line in ax.lines if to_hex(line.get_color()) == NO_WALL.lower()]
    assert drawn
    assert all(not np.any(line.get_ydata()) for line in drawn)


@pytest.mark.full
def test_branches_that_are_unphysical_throughout_are_left_out(fig7):
    """As long as others have physical orbits; all shows them."""
    first = fig7.branches[0]
    ghostly = dataclasses.replace(
        first, id="b9", columns=first.columns | {"physical": np.zeros(len(first), bool)}, events=[]
    )
    some = len(curves(plot_diagram(fig7)))
    assert len(curves(plot_diagram(Diagram("x", [*fig7.branches, ghostly])))) == some
    assert (
        len(curves(plot_diagram(Diagram("x", [*fig7.branches, ghostly]), unphysical="all"))) > some
    )
    assert curves(plot_diagram(Diagram("x", [ghostly])))


@pytest.mark.full
def test_the_sign_of_velocities_is_told(fig7, stop):
    assert plot_diagram(fig7).get_ylabel().endswith("positive at B, negative at T")
    assert plot_diagram(stop).get_ylabel().endswith("positive at S")


def test_signs_at_many_walls_are_told_in_lines_that_fit(stop, monkeypatch):
    monkeypatch.setattr(lines, "_signs", lambda diagram, names: [f"at {n}" for n in names])
    label = lines.ordinate_label(stop, "velocity", "ABCDEF")
    assert label.splitlines()[1:] == ["at A, at B, at C, at D", "at E, at F"]


@pytest.mark.full
def test_axes_have_one_size(fig7, stop):
    axes = [plot_diagram(d) for d in (fig7, stop, Diagram("x", []))]
    sizes = [ax.get_position().size * ax.figure.get_size_inches() for ax in axes]
    assert sizes[1] == pytest.approx(sizes[0])
    assert sizes[2] == pytest.approx(sizes[0])
    heights = [ax.figure.get_figheight() for ax in axes]
    assert heights[0] > heights[2]  # there is no room for labels where there are none


@pytest.mark.full
def test_the_legend_lists_what_is_drawn(fig7):
    def texts(**options):
        return {t.get_text() for t in plot_diagram(fig7, **options).get_legend().get_texts()}

    assert "unphysical" not in texts(unphysical="none")
    assert "unstable" in texts(unphysical="none")
    handles = plot_diagram(fig7).get_legend().legend_handles
    assert handles[-1].get_label() == "hollow: ghost"
    assert handles[-1].get_marker() not in MARKERS.values()


def test_folds_are_smooth(fig7):
    """Between neighbouring drawn points the direction hardly turns."""
    ax = plot_diagram(fig7, x="d")
    wide, high = (np.ptp(limits) for limits in (ax.get_xlim(), ax.get_ylim()))
    for line in curves(ax):
        steps = np.diff(line.get_xydata() / (wide, high), axis=0)
        steps = steps[np.hypot(*steps.T) > 1e-3]
        turns = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
        assert np.all(np.abs(turns) < 0.6)


def test_labels_of_several_orbits_name_them(fig7):
    entry = dataclasses.replace(fig7.entries[0], kind="FB", label="FB", ghost=False)
    assert label_text(entry) == r"$\mathrm{FB}$"
    assert label_text(entry, orbit=True) == rf"$\mathrm{{FB}}$({entry.notation})"


def test_grazings_of_doubled_orbits_are_labelled_as_in_table_1(fig7):
    entry = dataclasses.replace(fig7.entries[0], kind="G", period=2, label="G[x->y]", ghost=False)
    assert plain(label_text(entry)) == "PD_{G}"
    ghost = dataclasses.replace(entry, ghost=True)
    assert plain(label_text(ghost)) == r"\widetilde{PD}_{G}"


def test_an_empty_diagram_can_be_drawn():
    plot_diagram(Diagram("x", [])).figure.draw_without_rendering()


@pytest.mark.parametrize("kind", ["E=5%", "a{b", "#", "$"])
@pytest.mark.full
def test_any_name_of_a_users_event_can_be_drawn(fig7, kind):
    branch = fig7.branches[0]
    event = dataclasses.replace(branch.events[0], kind=kind, label=kind)
    ax = plot_diagram(Diagram("x", [dataclasses.replace(branch, events=[event])]))
    ax.figure.draw_without_rendering()


@pytest.mark.parametrize(
    "options",
    [
        {"x": "q"},
        {"x": "event"},
        {"unphysical": "zzz"},
        {"xlim": (np.nan, 1.0)},
        {"ylim": (0.0, np.inf)},
        {"xlim": (1.0, 1.0)},
        {"xlim": (1.0, 0.0)},
    ],
)
def test_what_cannot_be_drawn_is_refused(fig7, options):
    with pytest.raises(InputError) as caught:
        plot_diagram(fig7, **options)
    assert caught.value.where == next(iter(options))


@pytest.mark.full
def test_pdf_is_the_same_every_time(fig7, tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        save_diagram(fig7, tmp_path / name, ["pdf"])
    one, two = ((tmp_path / name / "diagram.pdf").read_bytes() for name in ("one", "two"))
    assert one == two
    assert b"CreationDate" not in one


def test_dotted_lines_that_lie_on_each_other_are_drawn_once():
    """Each filled the gaps of the other: they looked solid."""
    axes = Axes(Figure(dpi=100), (0.1, 0.1, 0.8, 0.8))
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(0.0, 1.0)
    x = np.linspace(0.0, 1.0, 41)
    curves = [(x, x**2), (x[13:], x[13:] ** 2), (x, 0.3 + 0.2 * x), (x[:1], x[:1])]
    lines = [Line2D(*curve) for curve in curves]
    for line in lines:
        axes.add_line(line)
    _part_lines(axes, lines)
    kept = [np.isfinite(line.get_xdata()).sum() for line in lines]
    gaps = [np.isnan(line.get_xdata()).sum() for line in lines]
    assert kept == [41, 28, 41, 1]  # points stay, what is between them does not
    assert gaps == [0, 27, 0, 0]
