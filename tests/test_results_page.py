"""The numbers of docs/results.md and its tables are those of the committed exports."""

from __future__ import annotations

import csv
import functools
import json
import math
import re

import pytest
from differences import text_of
from zoo import ROOT

import contimpact as ci

PAGES = ("results.md", "figures/results.md")
PAGE = "\n".join((ROOT / "docs" / name).read_text(encoding="utf-8") for name in PAGES)
NUMBER = re.compile(r"\d+\.\d+(?:e-\d+)?")
FIGURES = ("fig3a", "fig3b", "fig3c", "fig3d", "fig5b", "fig5b_r025", "fig7", "fig8")


@functools.cache
def export(name, file):
    return json.loads(text_of(ROOT / "branches" / name / file))


def entries(name):
    return export(name, "catalogue.json")["entries"]


def value(entry):
    return entry["parameters"][entry["parameter"]]


def simulated(name, file):
    lines = text_of(ROOT / "branches" / name / "simulation" / file).splitlines()
    return list(csv.DictReader(lines[1:]))  # the first one has the schema


def tables(heading):
    """The rows of each table of a section, without the two of its head."""
    section = PAGE.split(f"## {heading}\n")[1].split("\n## ")[0]
    found = re.findall(r"(?:^\|.*\n)+", section, re.MULTILINE)
    return [
        [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()[2:]]
        for table in found
    ]


def says(text, number):
    """Whether a text is a number, rounded to as many decimals."""
    half = 0.5 * 10.0 ** -len(text.partition(".")[2])
    return abs(float(text) - number) <= half + 4.0 * math.ulp(number)


CRITICAL = [
    (name, row)
    for name, table in zip(("fig7", "fig8", ""), tables("Critical values"), strict=True)
    for row in table
]


@pytest.mark.parametrize(("name", "row"), CRITICAL)
def test_critical_values(name, row):
    """Value, d and estimate are those of an entry of the kind; deviations are below estimates."""
    if not name:
        name, row = f"fig3{row[0][1]}", row[1:]
    kind, given = re.match(r"~?(\w+)", row[0])[1], NUMBER.search(row[1])[0]
    fits = [e for e in entries(name) if e["kind"] == kind and says(given, value(e))]
    assert fits, row
    assert any(says(row[2], entry["parameters"]["d"]) for entry in fits)
    assert any(float(row[3]) == float(f"{entry['error']:.0e}") for entry in fits)
    assert float(row[4]) < float(row[3])


def test_number_of_events():
    told = re.search(r"for all (\d+) events of the scenes of Figs. 3, 5, 7 and 8", PAGE)
    assert int(told[1]) == sum(len(entries(name)) for name in FIGURES)


@pytest.mark.parametrize("row", tables("Mechanisms of transitions")[0])
def test_exact_values_of_mechanisms(row):
    """Each value is that of an event of the kind, ghost or not as it is written."""
    name = "fig" + re.sub("[()]", "", row[0])
    for told in row[4].split(";"):
        sign, kind = re.search(r"(~?)\b(FB|PD|G)\b", told).groups()
        given = NUMBER.findall(told)[-1]
        fits = [e for e in entries(name) if e["kind"] == kind and says(given, value(e))]
        assert bool(sign) in {entry["ghost"] for entry in fits}, told


def test_periodic_attractors_on_branches():
    page = " ".join(PAGE.split())
    told = re.search(r"Of (\d+) periodic attractors (\d+) lie on followed branches", page)
    most = re.search(r"and differ from them by at most (\S+)\. ", page)[1]
    names = [name for name in FIGURES if (ROOT / "branches" / name / "simulation").is_dir()]
    periodic = [r for n in names for r in simulated(n, "sweep.csv") if r["kind"] == "periodic"]
    matches = [m for n in names for m in export(n, "simulation/coverage.json")["matches"]]
    assert [int(count) for count in told.groups()] == [len(periodic), len(matches)]
    assert float(most) - 1e-14 < max(match["distance"] for match in matches) < float(most)


def voltages(rows, column, middle):
    """The value of the line through two rows at a value of d, the first one the nearer."""
    (near, x), (far, y) = ((float(row[column]), float(row["d"])) for row in rows)
    return near + (far - near) * (middle - x) / (y - x)


@pytest.mark.parametrize("row", tables("Energy")[0])
def test_voltages_on_both_sides(row):
    """On lines through two rows each; the last two transitions have one row between them."""
    name, way = {"11(a)": ("fig7", "down"), "11(b)": ("fig8", "up")}[row[0]]
    rows = [r for r in simulated(name, "energy.csv") if r["from"] == way]
    rows.sort(key=lambda r: -float(r["d"]))
    names = [r["notation"].replace("1:1/C", "complex") for r in rows]
    (k,) = (i for i in range(1, len(rows)) if names[i - 1 : i + 1] == row[1].split(" to "))
    middle = 0.5 * (float(rows[k - 1]["d"]) + float(rows[k]["d"]))
    assert says(row[2], middle)
    for column, told in zip(("U_I", "U_T"), row[3:], strict=True):
        if ":2 to " in row[1]:
            found = [float(rows[k - 1][column]), float(rows[k][column])]
        else:
            sides = (rows[k - 1], rows[k - 2]), (rows[k], rows[k + 1])
            found = [voltages(side, column, middle) for side in sides]
        assert [float(text) for text in told.split(" to ")] == pytest.approx(found, abs=0.51)


CLAIMS = tables("Claim by claim")[0]
EVENT = r"(~?)\b(FB|PD|G)(\[[^\]]+\])?(?: of (\S+))? (s|A|d|omega) = (\d+\.\d{4,})"
POINT = r"\b(PD-G|FB-G) r = (\d+\.\d{4,})"
CHANGE = r"\bchange (s|A) = (\d+\.\d{4,})"


def is_event(found, names):
    ghost, kind, label, word, name, text = found
    return any(
        says(text, entry["parameters"][name])
        for scene in names
        for entry in entries(scene)
        if (entry["kind"], entry["ghost"]) == (kind, bool(ghost)) and name in entry["parameters"]
        if word in ("", entry["notation"]) and label in ("", entry["label"].lstrip("~")[1:])
    )


def is_point(found, names):
    kind, text = found
    curves = [curve for scene in names for curve in export(scene, "catalogue.json")["curves"]]
    points = [point for curve in curves for point in curve["codimension2"]]
    return any(p["kind"] == kind and says(text, p["parameters"]["r"]) for p in points)


def is_change(found, names):
    rows = [r for n in names for r in export(n, "simulation/transitions.json")["transitions"]]
    return any(says(found[1], row["value"]) for row in rows)


@pytest.mark.parametrize("row", CLAIMS, ids=lambda row: row[0])
def test_claims(row):
    """Each value of a claim is that of an event, a point or a transition of a scene it names."""
    assert row[1] in ("reproduced", "differs", "contradicted")
    names = [n for n in re.findall(r"`(\w+)`", row[3]) if (ROOT / "branches" / n).is_dir()]
    checks = ((EVENT, is_event), (POINT, is_point), (CHANGE, is_change))
    found = [(hit, check) for sign, check in checks for hit in re.findall(sign, row[2])]
    assert [hit for hit, check in found if not check(hit, names)] == []
    assert len(found) == len(re.findall(r"\d\.\d{4,}", row[2]))
    assert found or not names or "](figures/results.md#" in row[2]


def test_every_figure_has_a_claim():
    told = " ".join(row[0] for row in CLAIMS)
    assert {int(n) for n in re.findall(r"Fig\. (\d+)", told)} == {*range(1, 13)}


def test_phases_of_impacts():
    """Of 2:1 from the capsule's minimum: past it for large r."""
    found = re.search(r"the phases are ([-+.\d, ]+): impacts", " ".join(PAGE.split()))[1]
    phases = []
    for r in (0.3, 0.4, 0.5, 0.6, 0.7):
        pair = ci.ImpactPair(beta=math.pi / 6, r=r, A=5.0, s=0.2 / 0.6225)
        orbit = next(o for o in ci.find_orbits(pair, "2:1", parameter="s") if o.stable)
        phases.append(math.remainder(math.pi * orbit.times[0], 2 * math.pi))
    assert all(says(text, phase) for text, phase in zip(found.split(", "), phases, strict=True))
