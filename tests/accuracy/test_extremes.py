"""Extreme cases: none crashes, none is wrong, each is as exact as double precision allows."""

from __future__ import annotations

import pytest
from extremes import CASES, MARK, measure
from zoo import ROOT

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

DOCS = ROOT / "docs" / "figures" / "extremes.md"


BEYOND = ("oscillator, overdamped, c = 1e8: the fold",)
"""Where the condition number is 1e16 and the status of points is rounding."""


LONG = (
    "oscillator, stiff, k = 1e8: an orbit of S",
    "oscillator, overdamped, c = 1e4: orbits of S",
    "oscillator, overdamped, c = 1e8: orbits of S",
    "oscillator, overdamped, c = 1e8: four decades of a",
    "oscillator, overdamped, c = 1e4: four decades of a",
    *BEYOND,
)
"""What takes half a minute and more."""


def marks(name):
    among = (pytest.mark.corrupting, BEYOND), (pytest.mark.slow, LONG)
    return [mark for mark, names in among if name in names]


@pytest.mark.parametrize("name", [pytest.param(name, marks=marks(name)) for name in CASES])
@pytest.mark.quick(1)
def test_extreme(name):
    row = measure(name)
    said = row.outcome.endswith("said so") or row.outcome.startswith("refused: ")
    assert row.outcome == "solved" or said
    if row.outcome == "solved":
        assert row.error <= row.allowed
        assert not row.residual > 1e-10


def test_the_table_of_the_documentation_has_these_rows():
    lines = DOCS.read_text(encoding="utf-8").partition(MARK)[2].splitlines()
    rows = [line.split(" | ")[0].removeprefix("| ") for line in lines if line.startswith("| ")]
    assert rows[1:] == list(CASES)
    assert not any(word in line for line in lines for word in ("crash", "wrong"))
