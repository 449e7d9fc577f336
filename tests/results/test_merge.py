"""Catalogues of several scenes in one table."""

from __future__ import annotations

import csv
import json

import pytest
from zoo import ROOT

from contimpact.cli import main
from contimpact.errors import InputError
from contimpact.results.formats import merge

BRANCHES = ROOT / "branches"


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    base = tmp_path_factory.mktemp("merge")
    scenes = [str(BRANCHES / name / "scene.toml") for name in ("fig5b", "stop")]
    assert main(["run", *scenes, "-o", str(base), "-q", "--no-plot"]) == 0
    return [base / "fig5b", base / "stop"]


def test_entries_keep_their_scene_and_sources_their_provenance(folders, tmp_path, capsys):
    assert main(["catalogue", *map(str, folders), "-o", str(tmp_path)]) == 0
    assert "2 scenes" in capsys.readouterr().out
    content = json.loads((tmp_path / "catalogues.json").read_text())
    assert content["schema"] == "contimpact.catalogues/1"
    assert [s["scene"] for s in content["sources"]] == ["fig5b", "stop"]
    assert all(s["versions"]["contimpact"] and len(s["sha256"]) == 64 for s in content["sources"])
    counts = {}
    for entry in content["entries"]:
        counts[entry["scene"]] = counts.get(entry["scene"], 0) + 1
    for folder in folders:
        alone = json.loads((folder / "catalogue.json").read_text())
        assert counts[folder.name] == len(alone["entries"])
    rows = list(csv.DictReader((tmp_path / "catalogues.csv").read_text().splitlines()))
    assert len(rows) == len(content["entries"])
    for row, entry in zip(rows, content["entries"], strict=True):
        assert float(row["value"]) == entry["parameters"][entry["parameter"]]
    lines = (tmp_path / "catalogues.md").read_text().splitlines()
    assert len(lines) == len(rows) + 2


def test_the_same_catalogue_twice_counts_once(folders):
    assert merge([folders[0], folders[0]])["entries"] == merge([folders[0]])["entries"]


def test_an_interrupted_source_is_named(folders, tmp_path, capsys):
    content = json.loads((folders[0] / "catalogue.json").read_text())
    content["interrupted"] = "following b2"
    (tmp_path / "catalogue.json").write_text(json.dumps(content))
    merged = tmp_path / "merged"
    assert main(["catalogue", str(tmp_path), str(folders[1]), "-o", str(merged)]) == 0
    assert "ended early (following b2)" in capsys.readouterr().err
    sources = json.loads((merged / "catalogues.json").read_text())["sources"]
    assert [source.get("interrupted") for source in sources] == ["following b2", None]


def test_another_schema_is_refused(folders, tmp_path):
    content = json.loads((folders[0] / "catalogue.json").read_text())
    content["schema"] = "contimpact.catalogue/2"
    (tmp_path / "catalogue.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match="catalogue/2"):
        merge([folders[1], tmp_path])


def test_two_scenes_of_one_name_are_refused(folders, tmp_path):
    content = json.loads((folders[0] / "catalogue.json").read_text())
    content["entries"] = []
    (tmp_path / "catalogue.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match="second, different"):
        merge([folders[0], tmp_path])


def test_a_folder_without_a_catalogue_is_refused(tmp_path, capsys):
    assert main(["catalogue", str(tmp_path), "-o", str(tmp_path / "out")]) == 2
    assert "catalogue.json" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
