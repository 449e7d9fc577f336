"""Rectangles divided by curves of known shape: cells, joined areas and their polygons."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from contimpact.diagrams.areas import CHORD, Tracer
from contimpact.diagrams.arrangement import Path, slabs
from contimpact.results.curve import Area


def path(name, x, y, kept=None, marked=(), s=None):
    """A curve through points, by default over the length of the polyline."""
    points = np.column_stack([x, y])
    steps = np.hypot(*np.diff(points, axis=0).T) if s is None else np.diff(s)
    plain = np.ones(len(x), bool)
    marks = np.isin(np.arange(len(x)), marked)
    kept = np.ones(len(x) - 1, bool) if kept is None else kept
    return Path(
        name, points, np.concatenate([[0.0], np.cumsum(steps)]), plain & ~marks, marks, kept
    )


def graph(name, function, low=0.0, high=1.0, number=81, **more):
    x = np.linspace(low, high, number)
    return path(name, x, function(x), s=x, **more)


def divided(paths, content):
    """The areas whose cells have the same `content` in their middles."""
    cut = slabs(paths)
    contents = [[content(*slab.middle(j, 0.5)) for j in slab.cells] for slab in cut]
    return cut, Tracer(cut, contents).outlines(), contents


def holding(found, x, y):
    """The numbers of the areas whose polygons hold a point."""
    named = [Area("a", {}, "x", "y", [], o.rings, o.borders, o.part, [], 0) for o in found]
    return [k for k, area in enumerate(named) if area.holds(x, y)]


def test_two_lines_that_cross():
    """Four triangles, each a quarter; every edge bears the name of its line."""
    paths = [graph("up", lambda x: x), graph("down", lambda x: 1.0 - x)]
    cut, found, _ = divided(paths, lambda x, y: (y > x, y > 1.0 - x))
    assert [slab.left for slab in cut] == pytest.approx([0.0, 0.5], abs=1e-9)
    assert [o.part for o in found] == pytest.approx([0.25] * 4, abs=1e-9)
    assert all({name for _, name in o.borders[0]} == {"up", "down", "side"} for o in found)
    assert all(len(o.rings[0]) == 4 for o in found)


def test_a_circle_is_an_area_and_a_hole():
    turn = 1.0 + np.linspace(0.0, 2.0 * np.pi, 200)
    circle = path("c", 0.5 + 0.3 * np.cos(turn), 0.5 + 0.3 * np.sin(turn))
    _, found, _ = divided([circle], lambda x, y: np.hypot(x - 0.5, y - 0.5) < 0.3)
    inside, outside = sorted(found, key=lambda o: o.part)
    assert inside.part == pytest.approx(0.09 * np.pi, abs=np.pi * CHORD)
    assert inside.part + outside.part == pytest.approx(1.0, abs=1e-12)
    assert len(outside.rings) == 2
    assert outside.borders[1] == [(0, "c")]
    ring = inside.rings[0]
    away = np.abs(np.hypot(*(ring - 0.5).T) - 0.3)
    assert away.max() < 1e-7  # corners lie on the curve
    sides = np.abs(np.hypot(*(0.5 * (ring[:-1] + ring[1:]) - 0.5).T) - 0.3)
    assert sides.max() < CHORD + 1e-7
    fewest = np.pi / np.arccos(1.0 - CHORD / 0.3)  # of chords that depart by so much
    assert len(ring) - 1 < 1.1 * fewest + 4.0


@pytest.mark.parametrize("bend", [3.0, 30.0])
def test_points_are_dense_where_a_curve_is_bent(bend):
    """A step as steep as one likes: it departs from no side by more."""
    x = np.linspace(0.0, 1.0, 201)
    step = path("step", x, 0.5 + 0.3 * np.tanh(bend * (x - 0.5)))
    points = np.vstack([arc.between(arc.low, arc.high, CHORD) for arc in step.arcs()])
    s = np.linspace(0.0, step.arclengths[-1], 100_001)
    (x, y), (along, up) = step.spline(s).T, step.spline(s, 1).T
    away = np.abs(np.interp(x, *points.T) - y) * along / np.hypot(along, up)
    assert 0.5 * CHORD < away.max() < CHORD + 1e-9
    assert 100 < len(points) < 2000


def test_curves_that_touch_do_not_cross():
    """Two parabolas that meet at x = 0.3, where a point of the first one is marked."""
    low = graph("low", lambda x: 0.5 - 0.5 * (x - 0.3) ** 2, marked=[24])
    high = graph("high", lambda x: 0.5 + 0.5 * (x - 0.3) ** 2)

    def content(x, y):
        return np.sign(y - 0.5) * (abs(y - 0.5) > 0.5 * (x - 0.3) ** 2)

    cut, found, _ = divided([low, high], content)
    assert [slab.left for slab in cut] == pytest.approx([0.0, 0.3])
    between = [(0.3**3) / 3.0, (0.7**3) / 3.0]
    outside = 0.5 - 0.5 * sum(between)
    assert sorted(o.part for o in found) == pytest.approx(
        sorted([*between, outside, outside]), abs=3 * CHORD
    )


def test_what_lies_one_on_another_is_one_border():
    paths = [graph("a", lambda x: 0.3 + 0.2 * x), graph("b", lambda x: 0.3 + 0.2 * x, 0.2, 0.7)]
    cut, found, _ = divided(paths, lambda x, y: y > 0.3 + 0.2 * x)
    assert [len(slab.bounds) for slab in cut] == [3, 3, 3]
    names = {name for o in found for _, name in o.borders[0]}
    assert names == {"a", "a b", "side"}


def test_upright_curves_and_ghosts_divide_nothing():
    upright = path("u", np.full(9, 0.5), np.linspace(0.0, 1.0, 9))
    ghost = graph("g", lambda x: 0.5 + 0.0 * x, kept=np.zeros(80, bool))
    cut, found, _ = divided([upright, ghost], lambda x, y: x > 0.5)
    assert [slab.left for slab in cut] == [0.0, 0.5]
    assert [o.part for o in found] == pytest.approx([0.5, 0.5])
    assert "line" in {name for _, name in found[0].borders[0]}


def test_nothing_divides_a_square_without_curves():
    short = path("s", np.array([0.5, 0.5]), np.array([0.5, 0.5]))
    for paths in ([], [short]):
        cut, (whole,), _ = divided(paths, lambda x, y: "all")
        assert len(cut) == 1
        assert whole.part == 1.0
        assert whole.borders == [[(0, "side")]]
        assert len(whole.rings[0]) == 5


def waves(seed, number=6):
    rng = np.random.default_rng(seed)
    numbers = rng.uniform((0.2, 0.05, 3.0, 0.0), (0.8, 0.4, 9.0, 6.0), (number, 4))
    return [lambda x, n=n: n[0] + n[1] * np.sin(n[2] * x + n[3]) for n in numbers]


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.full
def test_random_waves(seed):
    """Cells are found by their content; polygons fill the square, each point in one alone."""
    functions = waves(seed)

    def content(x, y):
        return tuple(bool(y > f(x)) for f in functions)

    paths = [graph(f"w{k}", f, number=121) for k, f in enumerate(functions)]
    cut, found, contents = divided(paths, content)
    assert sum(o.part for o in found) == pytest.approx(1.0, abs=1e-12)
    for x, y in np.random.default_rng(seed).uniform(0.0, 1.0, (100, 2)):
        near = min(abs(y - f(x)) for f in functions)
        number = next(k for k, slab in enumerate(cut) if slab.left <= x <= slab.right)
        cell = number, cut[number].cell(x, y)
        assert contents[cell[0]][cell[1]] == content(x, y) or near < 1e-6
        owners = holding(found, x, y)
        steep = 10.0 * CHORD
        assert len(owners) == 1 or near < steep
        assert cell in found[owners[0]].cells or near < steep


def test_no_crossing_is_missed_between_points():
    """Two crossings between neighbouring points of either curve."""
    one = graph("a", lambda x: 0.5 + 0.0 * x, number=5)
    other = graph("b", lambda x: 0.5 + 0.3 * (x - 0.4) * (x - 0.45), number=5)
    cut = slabs([one, other])
    assert {0.4, 0.45} <= {round(slab.left, 9) for slab in cut}
    order = [[bound.names for bound in slab.bounds[1:-1]] for slab in cut]
    assert all(a != b for a, b in itertools.pairwise(order))
