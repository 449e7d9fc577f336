"""The ghost atlas that comes with the package: its tables are what its scenes give."""

from __future__ import annotations

import csv
import itertools
import math

import numpy as np
import pytest
from differences import text_of
from zoo import ROOT

from contimpact import follow, load_study, read_scene

ATLAS = ROOT / "branches" / "atlas"
NAMES = ("A5", "s05")
FAR = {"A5": 1e-4, "s05": 2e-3}
"""How far straight lines between the angles may be from the curve: s05 has half as many."""
CROSSINGS = {
    "A5": {math.pi / 18: 0.394006503, math.pi / 9: 0.295513665, math.pi / 6: 0.185725166},
    "s05": {
        math.pi / 18: 0.429318118,
        math.pi / 9: 0.372079625,
        math.pi / 6: 0.304161346,
        math.pi / 4: 0.151180589,
    },
}
"""Where PD meets grazing on Figs. 6(a) and (b), found on curves in (s, r) and (A, r): r by beta."""


def rows(study, table):
    return list(csv.DictReader(text_of(ATLAS / "tables" / f"{study}-{table}.csv").splitlines()))


@pytest.mark.parametrize("name", NAMES)
def test_every_scene_is_there(name):
    study = load_study(ATLAS / f"{name}.toml")
    found = rows(name, "scenes")
    assert [int(row["scene"]) for row in found] == study.points[0].tolist()
    assert {row["status"] for row in found} == {"done"}
    placed = np.array([[float(row["beta"]), float(row["r"])] for row in found])
    np.testing.assert_allclose(placed, study.points[1], rtol=1e-11)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.full
def test_scenes_drawn_at_random_give_their_rows_again(name):
    """Every event with its label, ghosts among them; each row has twelve digits."""
    study = load_study(ATLAS / f"{name}.toml")
    numbers, values = study.points
    drawn = {int(i) for i in np.random.default_rng(7).integers(len(study), size=2)}
    held = {i: [] for i in drawn}
    for row in rows(name, "events"):
        if int(row["scene"]) in drawn:
            held[int(row["scene"])].append((row["label"], row["notation"], float(row["value"])))
    for i in drawn:
        diagram = follow(read_scene(study.scene_at(values[i], int(numbers[i]))))
        found = [(e.label, e.notation, e.value) for e in diagram.entries]
        assert [row[:2] for row in found] == [row[:2] for row in held[i]]
        for one, other in zip(found, held[i], strict=True):
            assert one[2] == pytest.approx(other[2], rel=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_the_border_between_doubling_and_grazing_is_that_of_codimension_two(name):
    """Straight lines between scenes and between angles: their error is of second order."""
    table = csv.DictReader(text_of(ATLAS / "maps" / f"{name}-distance.csv").splitlines())
    points = [tuple(map(float, row.values())) for row in table]
    border = []
    for beta, column in itertools.groupby(points, key=lambda point: point[0]):
        for (_, one, low), (_, other, high) in itertools.pairwise(list(column)):
            if low < 0.0 < high:
                border.append((beta, one + (other - one) * low / (low - high)))
    for beta, r in CROSSINGS[name].items():
        assert np.interp(beta, *np.transpose(border)) == pytest.approx(r, abs=FAR[name])
