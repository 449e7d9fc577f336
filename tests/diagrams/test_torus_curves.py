"""Curves of Neimark-Sacker bifurcations against their closed form."""

from __future__ import annotations

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
from zoo import ROOT, scene

from contimpact.bifurcations.codimension_two import Resonance
from contimpact.bifurcations.kind import kind_of
from contimpact.bifurcations.torus import NS
from contimpact.diagrams.curve_problem import curve_problem
from contimpact.diagrams.curves import follow_curve
from contimpact.diagrams.explore import follow
from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.models.guards import Word
from contimpact.orbits.problem import OrbitProblem
from contimpact.orbits.search import find_orbits
from contimpact.results.catalogue import load_entries
from contimpact.segments.kernels import Kernels
from contimpact.systems.oscillator import Oscillator

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
@pytest.mark.full
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


@pytest.mark.full
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
    problem, z = curve_problem(entry.orbit().model, entry, kernels, 1.0)
    exact, h = problem.evaluate(z).jacobian, 1e-6
    for i, step in enumerate(h * np.eye(len(z))):
        rate = (problem.evaluate(z + step).residual - problem.evaluate(z - step).residual) / (2 * h)
        assert rate == pytest.approx(exact[:, i], abs=1e-7 * (1 + np.max(np.abs(exact[:, i]))))


class _Double:
    """An orbit with a matrix of one round, all of its unknowns and equations of one size."""

    autonomous = False

    def __init__(self, matrix):
        self.matrix, self.problem = np.array(matrix), self
        self.n = len(self.matrix)
        self.sizes = np.ones(self.n), np.ones(self.n)

    def cyclic(self, mu):
        return self.matrix - mu * np.eye(self.n)


@pytest.mark.parametrize(("mu", "kind"), [(1.0, "FB"), (-1.0, "PD")])
@pytest.mark.parametrize(("beside", "alone"), [(1e-3, True), (1.0, True), (0.0, False)])
def test_a_pair_leaves_the_axis_where_a_double_multiplier_has_one_eigenvector(
    mu, kind, beside, alone
):
    """A Jordan block, and two multipliers that have nothing to do with each other."""
    generator = np.random.default_rng(7)
    block = np.diag([mu, mu, 0.3, -0.4])
    block[0, 1] = beside
    basis = generator.normal(size=(4, 4))
    matrix = basis @ block @ np.linalg.inv(basis)
    (test, other) = (t for t in _double_tests(kind) if isinstance(t, Resonance))
    event = SimpleNamespace(point=SimpleNamespace(evaluation=_At(_Double(matrix))))
    assert (test.accept(event), other.accept(event)) == (alone, not alone)
    assert ("no curve of NS" in test.changes, "no curve of NS" in other.changes) == (False, True)


def _double_tests(kind):
    return kind_of(kind).codimension_two(Word("S", 1))


@pytest.mark.full
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
    start = Resonance("R1" if mu > 0 else "R2", mu).born(_At(here), 0)[0]
    system = NS().equations(problem, {})
    own = system.start(here)
    assert own[-1] == pytest.approx(mu, abs=1e-6)
    at = system.assemble(here, own)
    assert np.max(np.abs(at.residual)) < 1e-7
    sizes = np.linalg.svd(at.jacobian, compute_uv=False)
    assert sizes[-1] > 1e-4 * sizes[0]  # regular there: the curve goes on to neutral saddles
    assert start.leaves is None


RESONANCES = {
    "R1": ("FB", "S/2T", 2.22, 0.6, [0.5, 1.0], [-0.3, -0.1], 0.75),
    "R2": ("PD", "S", 2.33, 0.8, [-0.3, 0.6], [-0.35, -0.05], 0.3),
}


@pytest.fixture(scope="module", params=sorted(RESONANCES))
def resonant(request):
    """The map of an oscillator that gains as much in flight as it loses at impacts at one damping:
    there, for all places of the stop, is the curve of NS, and on it another curve has a resonance.
    """
    kind, word, omega, r, across, along, sigma = RESONANCES[request.param]
    values = {"a": 1.0, "omega": omega, "c": -0.2, "k": 1.0, "sigma": sigma, "r": r}
    given = scene(
        model={"system": "oscillator", "parameters": values},
        follow={"parameter": "sigma", "range": across, "orbits": [word], "switch": []},
        detect={"events": ["FB", "PD", "NS"]},
        curves={"parameter": "c", "range": along, "kinds": ["FB", "PD", "NS"], "cover": 1},
        numerics={"starts": 16},
    )
    periods = given.orbits[0].period
    return request.param, kind, damping(omega, r) / periods, follow(given)


@pytest.mark.full
def test_a_map_has_the_curve_that_begins_at_a_resonance(resonant):
    name, kind, exact, diagram = resonant
    (point,) = (p for c in diagram.curves if c.kind == kind for p in c.points if p.kind == name)
    assert point.parameters["c"] == pytest.approx(exact, abs=1e-11)
    (torus,) = (c for c in diagram.curves if c.kind == "NS")
    apart = np.abs(torus["multiplier1_im"]) > 1e-2  # at the resonance itself c is a double root
    assert np.count_nonzero(~apart) == 1
    assert torus["c"][apart] == pytest.approx(exact, abs=1e-12)
    assert torus["c"] == pytest.approx(exact, abs=1e-7)
    ends = [row for row, e in zip((0, -1), torus.ends, strict=True) if e.kind.name == "RESONANCE"]
    away = [abs(torus["sigma"][row] - point.parameters["sigma"]) for row in ends]
    assert min(away) < 1e-6
    (told,) = diagram.coverage
    assert told.born >= 1
    assert not told.uncovered
    assert told.complete


@pytest.mark.full
def test_nothing_is_said_to_be_missed_at_a_resonance(resonant):
    """Along the curve of PD its criticality is told on both sides."""
    assert not any(curve.missed for curve in resonant[-1].curves)


def test_a_pair_of_two_others_is_no_resonance():
    """A fold of an orbit that also has a pair on the unit circle."""
    circle = np.exp([0.7j, -0.7j])
    values = {"pair": [*circle, 1.0, 0.3], "double": [2.0, 1.0, 1.0, 0.3]}
    told = {
        name: float(Resonance("R1", 1.0).of(_At(_Orbit(np.array(mu)))))
        for name, mu in values.items()
    }
    assert told["double"] == 0.0
    assert abs(told["pair"]) > 0.01


@dataclasses.dataclass
class _Orbit:
    multipliers: object


@dataclasses.dataclass
class _At:
    orbit: object


def test_it_ends_where_its_pair_meets_and_does_not_come_back():
    """The impact damper: with an angle among the unknowns the equations were singular at its R1,
    which was missed, and the curve ran back along itself."""
    entries = load_entries(ROOT / "branches" / "impact_damper")
    entry = next(e for e in entries if e.kind == "NS")
    curve = follow_curve(entry, None, "Omega", (20.0, 30.0), (0.9, 1.05))
    assert curve.missed == []
    (row,) = (k for k, end in zip((0, -1), curve.ends, strict=True) if end.kind.name == "RESONANCE")
    second, third = (
        complex(curve[f"multiplier{i}_re"][row], curve[f"multiplier{i}_im"][row]) for i in (2, 3)
    )
    assert second + third == pytest.approx(2.0, abs=1e-9)
    assert second * third == pytest.approx(1.0, abs=1e-9)
    assert np.count_nonzero(np.abs(curve["multiplier2_im"]) < 0.02) == 1
