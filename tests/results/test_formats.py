"""AUTO's and MATLAB's formats read back to the branch's numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.io import loadmat

from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.orbits.search import find_orbits
from contimpact.results.formats import write_auto, write_mat
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator


@pytest.fixture(scope="module")
def branch():
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
    orbit = next(o for o in find_orbits(model, "1:1", parameter="s") if o.physical)
    return continue_orbit(orbit, range=(0.3, 0.45), events=("FB", "PD", "G"))


def test_auto(branch, tmp_path):
    write_auto(branch, tmp_path / "b.fig7")
    lines = (tmp_path / "b.fig7").read_text().splitlines()
    assert lines[0].split()[:4] == ["0", "PT", "TY", "LAB"]
    table = np.array([[float(word) for word in line.split()] for line in lines[1:]])
    assert len(table) == len(branch)
    np.testing.assert_allclose(table[:, 4], branch["s"], rtol=1e-10)
    np.testing.assert_allclose(table[:, 7::2], branch.velocities, rtol=1e-10)
    assert np.array_equal(table[:, 1] > 0, branch.stable)
    types = dict(zip(branch["event"], table[:, 2], strict=True))
    doubling = next(e for e in branch.events if e.kind == "PD")
    assert types[doubling.id] == 7
    assert table[0, 2] == table[-1, 2] == 9


def test_auto_without_impacts(tmp_path):
    """The steady motion in closed form: a/(k - omega^2 + i c omega)."""
    model = Oscillator(a=1.0, omega=2.5, c=0.1, k=1.0, sigma=1.0, r=0.8)
    (orbit,) = find_orbits(model, "0", parameter="omega")
    write_auto(continue_orbit(orbit, range=(2.0, 3.0), events=()), tmp_path / "b.zero")
    omega, norm, x, v = np.loadtxt(tmp_path / "b.zero", skiprows=1)[:, 4:].T
    steady = 1.0 / (1.0 - omega**2 + 0.1j * omega)
    np.testing.assert_allclose([x, v], [steady.real, -omega * steady.imag], rtol=1e-8)
    np.testing.assert_allclose(norm, np.hypot(x, v), rtol=1e-9)


def test_mat(branch, tmp_path):
    write_mat(branch, tmp_path / "branch.mat")
    content = loadmat(tmp_path / "branch.mat")
    assert content["word"][0] == "BT"
    for name in ("s", "d", "v1", "multiplier1_re", "n_unstable"):
        np.testing.assert_array_equal(content[name][:, 0], branch[name])
