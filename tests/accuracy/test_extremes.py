"""Extreme cases: none crashes, none is wrong, each is as exact as double precision allows."""

from __future__ import annotations

import pytest
from extremes import CASES, MARK, measure
from zoo import ROOT

from contimpact.errors import InputError
from contimpact.following.orbit_branch import continue_orbit
from contimpact.orbits.search import find_orbits
from contimpact.systems.oscillator import Oscillator

DOCS = ROOT / "docs" / "extremes.md"


@pytest.mark.parametrize("name", CASES)
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


@pytest.mark.parametrize(("k", "c"), [(1.0, 4.1e4), (1.0, -1e8), (1e-4, 500.0)])
def test_damping_beside_which_the_stiffness_is_lost_is_refused(k, c):
    given = {"a": 1.0, "omega": 1.3, "sigma": 0.0, "r": 0.8}
    with pytest.raises(InputError, match="the stiffness is lost"):
        Oscillator(k=k, c=c, **given)
    orbit = find_orbits(Oscillator(k=k, c=0.1, **given), "S", parameter="c")[0]
    with pytest.raises(InputError, match=r"range\.c: .*the stiffness is lost"):
        continue_orbit(orbit, "c", (min(c, 0.0), max(c, 1.0)))
