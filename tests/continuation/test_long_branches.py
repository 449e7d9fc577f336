"""Branches of very many points are read in one pass and drawn without a loop over their points."""

from __future__ import annotations

import dataclasses
import tracemalloc

import numpy as np
import pytest
from mutations import SCENE, written

from contimpact.cli import main
from contimpact.results.catalogue import BLOCK, branch_text, load_diagram, read_branch
from contimpact.results.diagram import Diagram

ROWS = 20 * BLOCK + 7


@pytest.fixture(scope="module")
def branch(tmp_path_factory):
    """A branch with its rows repeated; the arclength goes on."""
    folder = tmp_path_factory.mktemp("long")
    scene = written(SCENE, folder / "scene.toml")
    assert main(["run", scene, "-o", str(folder / "out"), "-q"]) == 0
    short = load_diagram(folder / "out").branches[0]
    row = np.arange(ROWS) % len(short)
    columns = {name: column[row] for name, column in short.columns.items()}
    columns["arclength"] = np.linspace(0.0, 1.0, ROWS)
    columns["event"] = np.array([""] * ROWS, dtype=object)
    return dataclasses.replace(short, columns=columns, events=[])


@pytest.mark.full
def test_tables_are_read_in_one_pass(branch, tmp_path):
    """No more than the columns is kept, whatever the length of the file."""
    path = tmp_path / "b.csv"
    path.write_text(branch_text(branch), encoding="utf-8")
    tracemalloc.start()
    try:
        again = read_branch(path)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert again == branch
    assert peak < 2.0 * path.stat().st_size


@pytest.mark.full
def test_points_between_are_computed_together(branch, monkeypatch):
    from contimpact.plots import diagram, lines

    calls = []
    cubic = lines._cubic
    monkeypatch.setattr(lines, "_cubic", lambda *args: calls.append(1) or cubic(*args))
    diagram.plot_diagram(Diagram("long", [branch]))
    assert 0 < len(calls) <= len(branch.word)
