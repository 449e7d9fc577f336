"""The numbers of docs/report.md are those of the reports beside its figures, of this version."""

from __future__ import annotations

import json
import re

import pytest
from zoo import ROOT

import contimpact

PAGE = (ROOT / "docs" / "report.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip(" `") for cell in line.strip("|").split("|")]
    for line in re.findall(r"^\| `.*$", PAGE, re.MULTILINE)
]


def report(scene):
    path = ROOT / "docs" / "figures" / f"report-{scene.replace('_', '-')}.json"
    return json.loads(path.read_text(encoding="utf-8"))


def at(rows, setting):
    return next(row for row in rows if row["setting"] == setting)


def two_digits(number):
    return float(f"{number:.1e}")


@pytest.mark.parametrize("row", [row for row in ROWS if len(row) == 7], ids=lambda row: row[0])
def test_continuation_and_shooting(row):
    methods = {m["name"]: m["rows"] for m in report(row[0])["methods"]}
    found = []
    for name in ("tolerance, tangent predictor", "shooting, solve_ivp"):
        entry = at(methods[name], 1e-13)
        found += [two_digits(entry["error"]), two_digits(entry["seconds"]["median"])]
        found.append(entry["evaluations"])
    assert [float(cell) for cell in row[1:]] == found


@pytest.mark.parametrize("row", [row for row in ROWS if len(row) == 5], ids=lambda row: row[0])
def test_events_and_simulation(row):
    made = report(row[0])
    honesty, simulation = made["honesty"], made["simulation"]
    assert row[1] == f"{honesty['within_estimate']} of {honesty['events']}"
    integrated = at(simulation["solve_ivp"], 1e-13)["error"]
    found = [honesty["largest_ratio"], simulation["simulator"]["error"], integrated]
    assert [float(cell) for cell in row[2:]] == [two_digits(number) for number in found]


def test_version():
    told = re.search(r"made by contimpact (\S+) with", PAGE)[1]
    scenes = {row[0] for row in ROWS}
    assert {report(scene)["machine"]["contimpact"] for scene in scenes} == {told}
    assert told == contimpact.__version__
