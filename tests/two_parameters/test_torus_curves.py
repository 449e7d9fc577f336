"""Curves of Neimark-Sacker bifurcations against their closed form."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from contimpact.bifurcations.codimension_two import Resonance
from contimpact.bifurcations.torus import NS
from contimpact.models.word import Word
from contimpact.orbit_continuation.orbit_branch import continue_orbit
from contimpact.orbits.problem import OrbitProblem
from contimpact.orbits.search import find_orbits
from contimpact.segments.kernels import Kernels
from contimpact.systems.oscillator import Oscillator
from contimpact.two_parameters.curves import follow_curve
from contimpact.two_parameters.problem import curve_problem

OMEGA, R = 1.5, 0.8


def damping(omega, r):
    """r^2 exp(-c T) = 1."""
    return math.log(r) * omega / math.pi


def entry_at(omega=OMEGA, r=R, sigma=0.0):
    exact = damping(omega, r)
    model = Oscillator(a=1.0, omega=omega, c=0.9 * exact, k=1.0, sigma=sigma, r=r)
    for orbit in find_orbits(model, "S", parameter="c"):
        branch = continue_orbit(orbit, range=(1.5 * exact, 0.5 * exact), events=("NS",))
        if branch.events:
            return branch.events[0]
    raise AssertionError("no NS")


@pytest.mark.parametrize(("second", "wanted"), [("r", [0.7, 0.85, 0.95]), ("omega", [1.45, 1.6])])
def test_against_the_closed_form(second, wanted):
    entry = entry_at()
    limits = {"r": (0.6, 0.97), "omega": (1.4, 1.7)}[second]
    curve = follow_curve(entry, None, second, (-1.0, -0.001), limits, values=wanted)
    assert curve.kind == "NS"
    for value in wanted:
        rows = np.nonzero(np.abs(curve[second] - value) < 1e-13)[0]
        assert len(rows)
        exact = damping(**({"omega": OMEGA, "r": R} | {second: value}))
        assert curve["c"][rows] == pytest.approx(exact, abs=1e-13)
    every = [damping(w, r) for w, r in zip(curve["omega"], curve["r"], strict=True)]
    assert curve["c"] == pytest.approx(every, abs=1e-12)


def test_it_ends_where_the_pair_is_real():
    """As sigma grows, the multipliers of the fast orbit meet on the real axis: R1 or R2."""
    entry = entry_at(sigma=0.1)
    curve = follow_curve(entry, None, "sigma", (-1.0, -0.001), (-1.0, 3.0))
    ends = {end.kind.name for end in curve.ends}
    assert "RESONANCE" in ends
    row = 0 if curve.ends[0].kind.name == "RESONANCE" else -1
    pair = [
        complex(curve[f"multiplier{i}_re"][row], curve[f"multiplier{i}_im"][row]) for i in (1, 2)
    ]
    assert pair[0] == pytest.approx(pair[1], abs=1e-5)
    assert abs(pair[0]) == pytest.approx(1.0, abs=1e-5)


def test_jacobian_against_differences():
    entry = entry_at(sigma=0.1)
    kernels = Kernels(entry.orbit().model, "c", "sigma")
    problem, z = curve_problem(entry.orbit().model, entry, "sigma", kernels, 1.0)
    exact, h = problem.evaluate(z).jacobian, 1e-6
    for i, step in enumerate(h * np.eye(len(z))):
        rate = (problem.evaluate(z + step).residual - problem.evaluate(z - step).residual) / (2 * h)
        assert rate == pytest.approx(exact[:, i], abs=1e-7 * (1 + np.max(np.abs(exact[:, i]))))


def test_it_begins_at_the_resonance():
    """Beside the R1 or R2 on the curve of folds or doublings the curve of NS is entered, and it is
    the one that was followed from an NS."""
    entry = entry_at(sigma=0.1)
    curve = follow_curve(entry, None, "sigma", (-1.0, -0.001), (-1.0, 3.0))
    row = 0 if curve.ends[0].kind.name == "RESONANCE" else -1
    at = {name: float(curve[name][row]) for name in ("c", "sigma")}
    model = entry.orbit().model.replace(**at)
    pairs = Kernels(model, "c", "sigma")
    problem = OrbitProblem(model, Word("S", 1), pairs)
    here = problem.evaluate(np.array([curve["t1"][row], curve["v1"][row], at["c"], at["sigma"]]))
    mu = float(np.sign(here.multipliers[0].real))
    start = Resonance("R1" if mu > 0 else "R2", f"{mu:.0f}").born(_At(here), 0)[0]
    system = NS().equations(problem, {})
    own = system.start(here)
    assert own[-1] == pytest.approx(0.0 if mu > 0 else math.pi, abs=1e-3)
    _, moved = start.leaves(system, own)
    step = 1e-2
    beside = own + step * moved
    off = system.assemble(here, beside).residual
    assert np.max(np.abs(off)) < 10.0 * step**2


@dataclasses.dataclass
class _At:
    orbit: object
