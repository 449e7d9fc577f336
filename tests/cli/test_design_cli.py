"""``contimpact design``: what it prints, its table, and what it refuses."""

from __future__ import annotations

import csv

import pytest
from zoo import SMALL

from contimpact.cli import main

DESIGN = """
[output]
P = { before_impacts = "U**2", per = "time" }

[design]
maximise = "P"
starts = 2
restarts = 1
bounds = { s = [0.42, 0.5] }
tolerances = { s = "1%" }
"""


@pytest.fixture
def scene(tmp_path):
    file = tmp_path / "scene.toml"
    file.write_text(SMALL + DESIGN)
    return file


def test_the_best_is_printed_and_written(scene, capsys):
    """1:1 gives the more the longer the capsule is, and no event is near."""
    table = scene.with_suffix(".csv")
    assert main(["design", str(scene), "-o", str(table)]) == 0
    assert "limited by bound s = 0.5" in capsys.readouterr().out
    (row,) = csv.DictReader(table.read_text().splitlines())
    assert (row["is"], row["word"], float(row["s"])) == ("best", "BT", 0.5)


def test_refusals(scene, capsys):
    assert main(["design", str(scene), "-o", "table.png"]) == 2
    assert "give a file that ends in .csv" in capsys.readouterr().err
    scene.write_text(SMALL)
    assert main(["design", str(scene)]) == 2
    assert "design: missing" in capsys.readouterr().err
