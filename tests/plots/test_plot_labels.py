"""Labels of events: inside the figure, none over another, leaders apart, the rest counted."""

from __future__ import annotations

import dataclasses
import html
import io
import itertools
import re
import tomllib

import matplotlib
import matplotlib.figure
import numpy as np
import pytest
from matplotlib.text import Text
from zoo import ROOT

from contimpact import InputError, follow, plot_diagram, read_scene
from contimpact.plots import lines as placing
from contimpact.plots.diagram import new_figure, write_heading
from contimpact.plots.lines import (
    Piece,
    fixed_values,
    symbol,
    text_width,
    units_of,
    value_text,
    values_text,
)
from contimpact.results.diagram import Diagram
from contimpact.results.options import LABELS

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

SCENE = ROOT / "branches" / "fig7" / "scene.toml"


@pytest.fixture(scope="module")
def fig7():
    given = tomllib.loads(SCENE.read_text(encoding="utf-8"))
    given["follow"].update(orbits=["1:1", "2:1"], switch=[], depth=1)
    return follow(read_scene(given))


@pytest.fixture(scope="module")
def crowded(fig7):
    """Sixty events on twenty-five branches, half of them within a hundredth of the range, ghosts
    and long orbits too."""
    rng = np.random.default_rng(3)
    branch = fig7.branches[0]
    low, high = branch["s"].min(), branch["s"].max()
    entries = []
    for k in range(60):
        model = fig7.entries[k % len(fig7.entries)]
        share = rng.uniform(0.1, 0.9) if k % 2 else 0.3 + 0.01 * rng.uniform()
        entries.append(
            dataclasses.replace(
                model,
                id=f"e{k}",
                notation=f"{k % 7}:1",
                period=1 + k % 3,
                ghost=bool(k % 5 == 0),
                parameters=model.parameters | {"s": low + share * (high - low)},
            )
        )
    branches = [
        dataclasses.replace(branch, id=f"b{k + 1}", events=entries[k::25]) for k in range(25)
    ]
    return Diagram("crowded", branches)


def boxes_of(ax):
    ax.figure.draw_without_rendering()
    return [text.get_window_extent() for text in ax.texts if text.get_gid() == "event"]


def leaders_of(ax):
    return [
        line.get_transform().transform(line.get_xydata())
        for line in ax.lines
        if line.get_gid() == "leader"
    ]


def crossing(one, other):
    """Whether two leaders, of which both rise, change their order on the way up."""
    heights = np.linspace(one[0, 1], min(one[-1, 1], other[-1, 1]), 50)
    apart = [np.interp(heights, line[:, 1], line[:, 0]) for line in (one, other)]
    difference = np.round(apart[0] - apart[1], 6)
    return difference.min() < 0.0 < difference.max()


@pytest.mark.full
def test_labels_of_a_crowded_diagram_stay_in_the_figure_and_apart(crowded):
    ax = plot_diagram(crowded)
    boxes = boxes_of(ax)
    assert len(boxes) > 20
    width, height = ax.figure.get_size_inches() * ax.figure.dpi
    for box in boxes:
        assert box.x0 >= 0.0
        assert box.x1 <= width
        assert box.y0 >= ax.get_window_extent().y1
        assert box.y1 <= height
    for one, other in itertools.combinations(boxes, 2):
        assert not one.overlaps(other)


@pytest.mark.full
def test_leaders_neither_cross_nor_run_through_labels(crowded):
    ax = plot_diagram(crowded)
    boxes, leaders = boxes_of(ax), leaders_of(ax)
    assert len(leaders) == len(boxes)
    assert not any(crossing(*pair) for pair in itertools.combinations(leaders, 2))
    for line in leaders:
        (x, bottom), (_, top) = line[1:]
        for box in boxes:
            assert not (box.x0 < x < box.x1 and bottom < box.y0 and box.y1 < top)


@pytest.mark.full
def test_what_finds_no_room_is_counted_in_the_legend(crowded):
    ax = plot_diagram(crowded)
    (note,) = [t.get_text() for t in ax.get_legend().get_texts() if "room" in t.get_text()]
    assert int(note.split()[3]) > 0
    few = plot_diagram(crowded, labels="period-1")
    assert len(boxes_of(few)) < len(boxes_of(ax))


def test_real_events_of_short_orbits_come_first(fig7):
    """Of two labels at one place with room for one, the ghost is left out."""
    spots = placing.arrange_labels([50.0] * 9, [100.0] * 9, (0.0, 110.0))
    kept = [k for k, spot in enumerate(spots) if spot]
    assert kept[0] == 0
    assert 1 <= len(kept) < 9
    order = [label.rank for label in placing._labels(fig7.entries, "s")]
    assert order == sorted(order)
    assert [rank[0] for rank in order] == sorted(e.ghost for e in fig7.entries)


@pytest.mark.parametrize("seed", range(25))
def test_places_at_random(seed):
    """Whatever the places and widths: inside, apart, leaders in order, labels over their ports."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 40))
    places = rng.choice([*rng.uniform(0.0, 400.0, count), *rng.normal(200.0, 3.0, count)], count)
    widths = rng.uniform(10.0, 80.0, count)
    spots = [
        s for s in placing.arrange_labels(places.tolist(), widths.tolist(), (-20.0, 420.0)) if s
    ]
    assert spots
    for spot in spots:
        assert -20.0 <= spot.left <= spot.port + 1e-9
        assert spot.port - 1e-9 <= spot.right <= 420.0
        assert abs(spot.port - spot.place) <= placing.FARTHEST
    for one, other in itertools.combinations(spots, 2):
        assert (one.place - other.place) * (one.port - other.port) >= -1e-9
        if one.row == other.row:
            assert one.right <= other.left or other.right <= one.left
        else:
            high, low = (one, other) if one.row > other.row else (other, one)
            assert not low.left < high.port < low.right


def test_a_lonely_label_stands_in_the_middle_over_its_value():
    (spot,) = placing.arrange_labels([100.0], [30.0], (0.0, 400.0))
    assert (spot.port, spot.left, spot.row) == (100.0, 85.0, 0)


@pytest.mark.full
def test_which_events_are_labelled(fig7):
    counts = {which: len(boxes_of(plot_diagram(fig7, labels=which))) for which in LABELS}
    assert counts["none"] == 0 < counts["real"] < counts["all"]
    assert LABELS == placing.CHOICES
    with pytest.raises(InputError) as caught:
        plot_diagram(fig7, labels="some")
    assert caught.value.where == "labels"


def test_the_scene_says_which_events_are_labelled():
    given = tomllib.loads(SCENE.read_text(encoding="utf-8"))
    assert read_scene(given).plot.labels == "all"
    given["plot"]["labels"] = "real"
    assert read_scene(given).plot.labels == "real"
    assert read_scene(read_scene(given).resolved()).plot.labels == "real"
    given["plot"]["labels"] = "few"
    with pytest.raises(InputError) as caught:
        read_scene(given)
    assert caught.value.where == "plot.labels"


# Headings


@pytest.mark.full
def test_a_heading_of_nothing_is_written():
    """As above curves of a system all of whose parameters are followed."""
    assert text_width("") == text_width(" ") == 0.0
    write_heading(new_figure(), "")


def test_the_heading_gives_name_and_fixed_parameters(fig7):
    (text,) = [t.get_text() for t in plot_diagram(fig7).figure.texts if t.get_gid() == "heading"]
    assert text.startswith(r"fig7: $\beta$ = $\pi/6$ rad, $r$ = 0.3, $A$ = 5 N, $M$ = 0.1245 kg")
    assert "$s$" not in text
    assert "bar{g}" not in text


@pytest.mark.parametrize(
    "name", ["<script>alert(1)</script>", "a\\b/c", "5 $ and 7 $", "$x_1$", "a\\$b", "end\\"]
)
@pytest.mark.full
def test_the_heading_shows_any_name_as_it_is(fig7, name):
    figure = plot_diagram(dataclasses.replace(fig7, name=name)).figure
    with matplotlib.rc_context({"svg.fonttype": "none"}):
        figure.savefig(drawn := io.BytesIO(), format="svg")
    group = re.search(r'<g id="heading">(.*?)</g>\s*</g>', drawn.getvalue().decode(), re.S)[1]
    text = html.unescape(re.sub(r"<!--.*?-->|<[^>]*>|\n", "", group, flags=re.S))
    assert "".join(text.split()).startswith("".join(name.split()) + ":=")  # symbols follow behind


def test_parameters_that_differ_between_branches_are_not_fixed(fig7):
    one = fig7.branches[0]
    other = dataclasses.replace(one, columns={**one.columns, "A": one["A"] + 1.0})
    assert "A" in fixed_values([one])
    assert "A" not in fixed_values([one, other])
    assert fixed_values([]) == {}


def test_an_unknown_system_has_no_units():
    assert units_of("somebody's own") == {}
    assert units_of("impact-pair")["r_B"] == units_of("impact-pair")["r"]
    assert units_of("impact-pair")["A"] == "N"


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (np.pi, r"$\pi$"),
        (-np.pi / 6, r"$-\pi/6$"),
        (7 * np.pi / 18, r"$7\pi/18$"),
        (0.0, "0"),
        (5 * np.pi, r"$5\pi$"),
        (0.3, "0.3"),
        (1e-9, "1e-09"),
        (3.14, "3.14"),
        (200 * np.pi, r"$200\pi$"),
        (1e10, "1e+10"),  # 79577471546 pi/25 to thirteen digits
    ],
)
def test_values(value, text):
    assert value_text(value) == text
    assert values_text({"r_B": value}, {"r_B": "m/s^2"}) == f"$r_{{B}}$ = {text} m/s\u00b2"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("", ""),
        ("s", "$s$"),
        ("omega", r"$\omega$"),
        ("t1", "$t_{1}$"),
        ("k_max", "$k_{max}$"),
        ("arclength", "arclength"),
        ("smallest_gap", "smallest_gap"),
        ("multiplier1_re", "multiplier1_re"),
    ],
)
def test_symbols(name, text):
    assert symbol(name) == text


def test_names_of_orbits_keep_off_the_letters_of_walls():
    """On a short stable stretch near the frame, where its wall's letter stands, too."""
    figure = matplotlib.figure.Figure()
    ax = figure.add_subplot(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    stretch = np.linspace(0.95, 0.9695, 20)
    piece = Piece("R", "stable", stretch, np.full(20, 0.5), "(1)/2T")
    ax.plot(piece.places, piece.values)
    placing.name_walls(ax, [piece], {"R": "tab:blue"})
    assert placing.name_orbits(ax, [piece]) == 0
    figure.draw_without_rendering()
    letter, name = (Text.get_window_extent(text) for text in ax.texts)
    assert not letter.overlaps(name)


@pytest.mark.parametrize("top", [0.5, 0.9, 0.96])
def test_letters_of_walls_keep_off_the_frame(top):
    figure = matplotlib.figure.Figure()
    ax = figure.add_subplot(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
    piece = Piece("U", "stable", np.linspace(0.5, 0.95, 20), np.linspace(0.2, top, 20), "1:1")
    placing.name_walls(ax, [piece], {"U": "tab:blue"})
    figure.draw_without_rendering()
    (letter,) = map(Text.get_window_extent, ax.texts)
    assert letter.y1 < ax.get_window_extent().y1 - 2.0
