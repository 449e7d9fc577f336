"""``contimpact design``: what it prints, its table, and what it refuses."""

from __future__ import annotations

import csv
import errno
import os

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


def test_a_place_that_cannot_be_written_is_refused_before_the_search(scene, capsys, monkeypatch):
    def searching(*given, **named):
        raise AssertionError("nothing is searched for in vain")

    monkeypatch.setattr("contimpact.diagrams.design.design", searching)
    for place in (scene / "table.csv", scene.parent / "folder.csv"):
        (scene.parent / "folder.csv").mkdir(exist_ok=True)
        assert main(["design", str(scene), "-o", str(place)]) == 2
        assert str(place.parent) in capsys.readouterr().err


def test_a_full_disk_is_no_wrong_input(scene, capsys, monkeypatch):
    """The best is printed all the same."""

    def full(*given, **named):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("contimpact.storage.put", full)
    assert main(["design", str(scene), "-o", str(scene.parent / "table.csv")]) == 1
    said = capsys.readouterr()
    assert "limited by bound s = 0.5" in said.out
    assert "not written (No space left on device): table.csv" in said.err
    assert "free disk space" in said.err
