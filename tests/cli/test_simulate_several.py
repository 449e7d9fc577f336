"""``contimpact simulate`` for two masses: tables with all coordinates, branches, basins, page."""

from __future__ import annotations

import csv
import json

import pytest

from contimpact import cli

SCENE = """
name = "pair"
[model]
system = "two-masses"
[model.parameters]
c1 = 0.1
c2 = 0.05
k1 = 1.0
k2 = 0.6
a1 = 1.0
omega = 1.0
sigma_1 = 1.0
sigma_2 = 1.0
r = 0.8
[follow]
parameter = "omega"
range = [0.97, 1.0]
orbits = ["AB"]
switch = []
[detect]
events = ["PD"]
[plot]
formats = ["png"]
html = true
[simulate]
values = 2
transient = 40
periods = 100
branches = true
losses = true
transitions = false
portraits = [1.0]
basins = [1.0]
grid = 2
"""


def table(path):
    head, *lines = path.read_text(encoding="utf-8").splitlines()
    return json.loads(head.removeprefix("# ")), list(csv.DictReader(lines))


@pytest.mark.full
def test_a_sweep_of_two_masses(tmp_path, capsys):
    path, out = tmp_path / "scene.toml", tmp_path / "out"
    path.write_text(SCENE, encoding="utf-8")
    assert cli.main(["simulate", str(path), "-o", str(out)]) == 0
    _, rows = table(out / "sweep.csv")
    assert [row["word"] for row in rows] == ["AB", "AB"]
    assert {"exponent4", "multiplier4_im", "x1_2", "v1_2"} <= set(rows[0])
    assert not (out / "transitions.json").exists()
    manifest = json.loads((out / "manifest.json").read_text(encoding="utf-8"))
    assert "transitions" not in manifest["counts"]  # none were looked for
    matches = json.loads((out / "coverage.json").read_text(encoding="utf-8"))["matches"]
    assert len(matches) == 2
    assert max(match["distance"] for match in matches) < 1e-9
    head, lost = table(out / "losses.csv")
    assert head == {"schema": "contimpact.losses/1", "parameter": "omega"}
    for row, taken in zip(rows, lost, strict=True):
        expected = [0.18 * float(row[f"v{k}"]) ** 2 for k in (1, 2)]
        assert [float(taken["E1"]), float(taken["E2"])] == pytest.approx(expected, rel=1e-12)
    pictures = ("attractors", "exponents", "portrait1", "basins1")
    assert all((out / f"{name}.png").stat().st_size > 5000 for name in pictures)
    assert (out / "diagram.html").exists()
    assert "basins at omega = 1: 1:1 100.0%" in capsys.readouterr().out
    assert cli.main(["simulate", str(path), "-o", str(out), "--resume", "--no-plot", "-q"]) == 0
