"""Curves in two parameters as a picture: panels, axes and their units, what stands for what."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch

from contimpact import plot_codim2, plot_curves
from contimpact.bifurcations.declarations import CURVES
from contimpact.bifurcations.kind import kind_of
from contimpact.continuation.branch import End, EndKind
from contimpact.errors import InputError
from contimpact.plots.curves import legend_beside, save_curves
from contimpact.plots.diagram import legend_mark, new_figure
from contimpact.results.catalogue import catalogue_text
from contimpact.results.curve import Area, Codim2, Curve, StableOrbit, regions
from contimpact.results.diagram import Diagram

UNITS = {"s": "m", "A": "N", "d": "dimensionless", "a": "kg"}
END = End(EndKind.RANGE, 1.0, "")


def curve(pair, kind="PD", label=None, notation="1:1", fixed=None, **columns):
    """A curve with eleven points; columns that are not given keep a value of their own."""
    ramp = np.linspace(0.0, 1.0, 11)
    numbers = {"r": 0.3 + 0.0 * ramp, "A": 5.0 + 0.0 * ramp, "s": 0.4 + 0.0 * ramp}
    numbers |= dict(fixed or {})
    numbers |= {name: np.broadcast_to(values, 11) for name, values in columns.items()}
    numbers = {name: np.broadcast_to(values, 11).copy() for name, values in numbers.items()}
    numbers.setdefault("d", 3.1125 * numbers["s"] / numbers["A"])
    rest = {
        "t1": ramp,
        "n_unstable": np.zeros(11, int),
        "physical": np.ones(11, int),
        "event": np.full(11, "", dtype=object),
    }
    return Curve(
        "c1",
        kind,
        label or kind,
        "B" * int(notation[0]) + "T",
        1,
        notation,
        pair,
        {"arclength": ramp} | numbers | rest,
        (END, END),
        [],
        "e1",
        fixed=fixed or {},
    )


RAMP = np.linspace(0.0, 1.0, 11)
IN_R = curve(("s", "r"), s=0.3 + 0.1 * RAMP, r=0.2 + 0.3 * RAMP)
IN_A = curve(("s", "A"), s=0.3 + 0.1 * RAMP, A=4.0 + 2.0 * RAMP)


def test_each_pair_of_parameters_has_a_panel():
    axes = plot_curves([IN_R, IN_A], units=UNITS)
    assert [ax.get_xlabel() for ax in axes] == ["$r$", "$A$ (N)"]
    assert [ax.get_ylabel() for ax in axes] == ["$d$ (dimensionless)", "$s$ (m)"]
    for ax, one in zip(axes, (IN_R, IN_A), strict=True):
        (line,) = [line for line in ax.lines if len(line.get_xdata()) > 1]
        assert np.array_equal(line.get_xdata(), one[one.parameters[1]])
    assert not axes[0].get_shared_x_axes().joined(*axes)


def test_d_is_not_shown_where_it_is_not_the_first_parameter_rescaled():
    """Along s and A it depends on both; along A alone it is its reciprocal."""
    assert plot_curves([IN_A])[0].get_ylabel() == "$s$"
    over = curve(("A", "r"), A=4.0 + RAMP, r=0.2 + 0.3 * RAMP)
    assert plot_curves([over])[0].get_ylabel() == "$d$"


@pytest.mark.parametrize(("drawn", "along"), [([IN_R], "d"), ([IN_A], "s"), ([IN_R, IN_A], "ds")])
def test_what_comes_first_is_read_along_the_y_axis(drawn, along):
    """In the picture, in the catalogue and in what is printed."""
    assert [ax.get_ylabel() for ax in plot_curves(drawn)] == [f"${name}$" for name in along]
    assert [region.along for region in regions(drawn)] == list(along)
    told = json.loads(catalogue_text(Diagram("x", [], curves=drawn)))["competition"]
    assert [region["along"] for region in told] == list(along)


def test_the_order_is_that_of_the_y_axis():
    """At any s the order along A is the reverse of the order along d."""
    low = curve(("A", "s"), "PD", A=4.0 + RAMP, s=0.3 + 0.1 * RAMP)
    high = curve(("A", "s"), "BP", A=6.0 + RAMP, s=0.3 + 0.1 * RAMP)
    assert plot_curves([low, high])[0].get_ylabel() == "$A$"
    assert [region.first for region in regions([low, high])] == ["BP"]
    assert [region.first for region in regions([low, high], "d")] == ["PD"]


def test_curves_of_different_orbits_exchange_places_where_they_cross():
    """Nothing marks the place: no point of codimension two, no end, no point of a table."""
    doubling = curve(("s", "r"), s=0.3 + 0.1 * RAMP, r=RAMP)
    grazing = curve(("s", "r"), "G", "G[1:1->2:1]", s=0.37 - 0.2 * RAMP, r=RAMP)
    first, second = regions([doubling, grazing])
    assert (first.first, second.first) == ("G[1:1->2:1]", "PD")
    assert first.high == second.low == pytest.approx(0.07 / 0.3, abs=1e-12)
    assert (first.low, second.high) == (0.0, 1.0)


def test_where_an_orbit_is_born_is_not_what_it_meets_first():
    """A fold above a period doubling is where the orbit begins."""
    doubling = curve(("s", "r"), s=0.3 + 0.1 * RAMP, r=RAMP)
    fold = curve(("s", "r"), "FB", s=0.5 + 0.1 * RAMP, r=RAMP)
    assert [region.first for region in regions([doubling, fold])] == ["PD"]
    assert [region.first for region in regions([fold])] == ["FB"]


def area(*orbits, fixed=None, across="r", along="d", name="a1"):
    """A triangle."""
    ring = [(0.2, 0.2), (0.4, 0.2), (0.3, 0.3), (0.2, 0.2)]
    kinds = {"PD": "PD", "G[1:1->2:1]": "G", None: None}
    held = [StableOrbit("BT", 1, "1:1", ends, kinds[ends]) for ends in orbits]
    return Area(name, fixed or {}, across, along, held, [ring], [[(0, "c1")]], 0.1, [], 1)


def tinted(ax):
    return [patch for patch in ax.patches if isinstance(patch, PathPatch)]


def test_areas_are_tinted_below_the_curves():
    """Each by what ends its orbit, hatched by kind, crossed where several are stable."""
    grazing = curve(("s", "r"), "G", "G[1:1->2:1]", s=0.3 + 0.1 * RAMP, r=RAMP)
    areas = [area("PD"), area("G[1:1->2:1]"), area("PD", "PD"), area(None), area()]
    (ax,) = plot_curves([IN_R, grazing], areas=areas)
    patches = tinted(ax)
    assert len(patches) == 5  # one twice, one not at all
    assert all(patch.get_zorder() < line.get_zorder() for patch in patches for line in ax.lines)
    assert [patch.get_hatch() for patch in patches] == [None, "//////", None, "xxxx", None]
    light = [sum(patch.get_facecolor()[:3]) for patch in patches]
    assert len({round(value, 3) for value in light[:2]}) == 2
    names = [text.get_text() for text in ax.figure.legends[0].get_texts()]
    assert names[2:] == [
        r"stable until $\mathrm{PD}$",
        r"stable until $\mathrm{G}_{1:1}^{\,2:1}$",
        "stable throughout",
        "several stable orbits",
    ]
    assert len(ax.patches) == len(patches)  # no band


def test_a_second_grazing_is_told_without_colours():
    """Hatched the other way."""
    both = ("G[1:1->2:1]", "G[1:1->1:2]")
    lines = [curve(("s", "r"), "G", name, s=0.3 + 0.1 * RAMP, r=RAMP) for name in both]
    orbits = [StableOrbit("BT", 1, "1:1", name, "G") for name in both]
    areas = [dataclasses.replace(area(None), orbits=[orbit]) for orbit in orbits]
    (ax,) = plot_curves(lines, areas=areas)
    assert [patch.get_hatch() for patch in tinted(ax)] == ["//////", "\\\\\\\\\\\\"]


def test_areas_stand_in_their_own_panel():
    members = [curve(("s", "r"), fixed={"beta": b}, s=0.3 + 0.1 * RAMP, r=RAMP) for b in (0.1, 0.2)]
    elsewhere = [area("PD", fixed={"beta": 0.2}, across="A"), area("PD", fixed={"beta": 0.3})]
    first, second = plot_curves(members, areas=[area("PD", fixed={"beta": 0.2}), *elsewhere])
    assert [len(tinted(ax)) for ax in (first, second)] == [0, 1]
    assert first.patches  # a band, where there are no areas


def test_parameters_of_any_system():
    """No name is expected; a derived one is found by what it is."""
    other = curve(("a", "k"), a=1.0 + RAMP, k=2.0 + RAMP, width=5.0 * (1.0 + RAMP), d=RAMP**2)
    assert plot_curves([other], units=UNITS)[0].get_ylabel() == "width"
    plain = curve(("a", "k"), a=1.0 + RAMP, k=2.0 + RAMP, d=1.0 + RAMP**2)
    assert plot_curves([plain], units=UNITS)[0].get_ylabel() == "$a$ (kg)"


def test_what_is_asked_for_stands_on_the_y_axis():
    axes = plot_curves([IN_R, IN_A], along="s")
    assert [ax.get_ylabel() for ax in axes] == ["$s$", ""]  # one axis for both
    with pytest.raises(InputError) as caught:
        plot_curves([IN_R], along="q")
    assert caught.value.where == "along"
    assert "r, A, s, d" in str(caught.value)


def test_what_cannot_be_drawn_is_refused():
    with pytest.raises(InputError):
        plot_curves([])
    with pytest.raises(InputError) as caught:
        plot_curves([IN_R, IN_A], axes=Figure().subplots())
    assert caught.value.where == "axes"


def test_members_share_an_axis_where_none_is_squeezed():
    near = [curve(("s", "r"), fixed={"beta": b}, s=0.3 + 0.1 * RAMP, r=RAMP) for b in (0.1, 0.2)]
    far = curve(("s", "r"), fixed={"beta": 0.3}, s=0.3 + 9.0 * RAMP, r=RAMP)
    axes = plot_curves(near)
    assert axes[0].get_ylim() == axes[1].get_ylim()
    squeezed = plot_curves([*near, far])
    assert squeezed[0].get_ylim()[1] < 0.5 * squeezed[2].get_ylim()[1]
    assert [ax.get_title() for ax in squeezed] == [rf"$\beta$ = {b}" for b in (0.1, 0.2, 0.3)]


def test_shared_axes_hold_the_curves_of_all_members():
    low, high = (
        curve(("s", "r"), fixed={"A": a}, s=top * (0.9 + 0.1 * RAMP), r=0.2 + 0.3 * RAMP)
        for a, top in ((5.0, 0.4), (6.0, 0.5))
    )
    for ax in plot_curves([low, high], along="s"):
        bottom, top = ax.get_ylim()
        assert bottom < low["s"].min() < high["s"].max() < top


def test_orbits_are_told_apart():
    """Two period doublings differ in colour and name, and their bands lie side by side."""
    two = curve(("s", "r"), notation="2:1", s=0.2 + 0.1 * RAMP, r=RAMP)
    one = curve(("s", "r"), s=0.3 + 0.1 * RAMP, r=RAMP)
    (ax,) = plot_curves([one, two])
    lines = [line for line in ax.lines if len(line.get_xdata()) > 1]
    assert len({line.get_color() for line in lines}) == 2
    names = [t.get_text() for t in ax.figure.legends[0].get_texts()]
    assert names[:2] == [r"$\mathrm{PD}$(1:1)", r"$\mathrm{PD}$(2:1)"]
    assert "ghost" not in names
    assert len({patch.get_y() for patch in ax.patches}) == 2
    named = [text for text in ax.texts if text.get_gid() == "orbit"]
    assert [text.get_text().strip() for text in named] == ["2:1", "1:1"]
    assert len({text.get_position()[1] for text in named}) == 2


def test_bands_stand_below_the_curves():
    rows = [curve(("s", "r"), notation=f"{n}:1", s=0.1 * n + 0.1 * RAMP, r=RAMP) for n in (1, 2, 3)]
    (ax,) = plot_curves(rows)
    lowest = min(np.min(line.get_ydata()) for line in ax.lines)
    tops = [patch.get_window_extent().y1 for patch in ax.patches]
    assert len(set(tops)) == 3
    assert max(tops) < ax.transData.transform((0.0, lowest))[1]


def test_labels_are_set_as_in_table_1():
    grazing = curve(("s", "r"), "G", "G[1:1->2:1]", s=0.3 + 0.1 * RAMP, r=RAMP)
    (ax,) = plot_curves([grazing])
    names = [t.get_text() for t in ax.figure.legends[0].get_texts()]
    assert names[0] == r"$\mathrm{G}_{1:1}^{\,2:1}$"
    assert names[-1] == "first as $d$ falls\n(half as high: not checked)"


def test_a_kind_without_a_colour_of_its_own_is_drawn():
    (ax,) = plot_curves([curve(("s", "r"), "my_kind $", s=0.3 + 0.1 * RAMP, r=RAMP)])
    ax.figure.canvas.draw()
    (line,) = [line for line in ax.lines if len(line.get_xdata()) > 1]
    assert line.get_color() not in [kind_of(kind).look.colour for kind in CURVES]
    assert ax.figure.legends[0].get_texts()[0].get_text() == r"my_kind \$"


def test_curves_in_three_parameters_are_drawn_as_projections():
    """On each pair of the three, the first one as d."""
    one = curve(("s", "r", "beta"), "PD-G", s=0.3 + 0.1 * RAMP, r=0.2 + RAMP, beta=1.0 + RAMP)
    axes = plot_codim2([one], units={"beta": "rad", "d": "dimensionless"})
    labels = [(ax.get_xlabel(), ax.get_ylabel()) for ax in axes]
    d = "$d$ (dimensionless)"
    assert labels == [(r"$\beta$ (rad)", "$r$"), (r"$\beta$ (rad)", d), ("$r$", d)]
    for ax, (across, along) in zip(axes, (("beta", "r"), ("beta", "d"), ("r", "d")), strict=True):
        (line,) = ax.lines
        assert np.array_equal(line.get_xdata(), one[across])
        assert np.array_equal(line.get_ydata(), one[along])
    with pytest.raises(InputError):
        plot_codim2([one, IN_R])


def test_the_file_names_what_is_fixed(tmp_path):
    assert save_curves([IN_R], tmp_path, ["png"], units=UNITS) == ["curves.png"]
    assert (tmp_path / "curves.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.full
def test_each_pair_of_parameters_has_its_picture(tmp_path):
    names = ["curves-s-r.png", "curves-s-A.png"]
    assert save_curves([IN_R, IN_A], tmp_path, ["png"], units=UNITS) == names
    assert all((tmp_path / name).exists() for name in names)


def test_points_of_codimension_two_have_marks_of_their_own():
    """R3 and R4 of one curve had the same one."""
    kinds = "PD-G G-PD FB-G BP-G PD-V FB-V BP-V PD-T FB-T BP-T G-FB DG CP GPD R1 R2 R3 R4".split()
    kinds += ["FB-BP", "PD-PD", "NS-NS", "FB-PD", "PD-FB", "FB-NS", "NS-FB", "PD-NS", "NS-PD"]
    place = {"s": 0.35, "r": 0.35, "d": 0.22}
    points = [Codim2(f"c1.{k}", "c1", k, "", place, [], 0.0, 0.0) for k in kinds]
    axes = plot_curves([dataclasses.replace(IN_R, points=points)])
    legend = np.ravel(axes)[0].figure.legends[0]
    marks = {
        text.get_text(): handle.get_marker()
        for text, handle in zip(legend.get_texts(), legend.legend_handles, strict=True)
        if text.get_text() in kinds
    }
    assert set(marks) == {*kinds} - {"G-PD", "PD-FB", "NS-FB", "NS-PD"}
    assert len(set(marks.values())) == len(marks)


def test_a_long_legend_stands_in_columns_within_the_figure():
    """Of a map with 17 curves markers and areas were below the figure's lower edge."""
    figure = new_figure(7.2, 3.4)
    figure.add_subplot()
    legend_beside(figure, [legend_mark(label=f"curve {k}") for k in range(30)], fontsize=7.5)
    figure.draw_without_rendering()
    (legend,) = figure.legends
    extent = legend.get_window_extent()
    assert 0.0 <= extent.y0 < extent.y1 <= figure.bbox.height
    assert extent.x1 <= figure.bbox.width
