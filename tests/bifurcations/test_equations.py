"""The equations of events by the kernels alone, in any arithmetic, against those of doubles."""

import numpy as np
import pytest
from zoo import TWO_MASSES

from contimpact.bifurcations.kind import Equations, kind_of
from contimpact.models.guards import Word
from contimpact.orbits.quiet import QuietProblem
from contimpact.orbits.search import find_orbits
from contimpact.segments.derivatives import Series, series
from contimpact.segments.kernels import Kernels
from contimpact.segments.segment import FLOATS
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.two_masses import TwoMasses

JETS = series(FLOATS)
FREE = {"a": 0.0, "omega": 1.0, "c": -0.1, "k": 1.0, "sigma": 1.0, "r": 0.8, "period": "free"}
FORCED = Oscillator(a=0.3, omega=1.3, c=0.1, k=1.0, sigma=0.5, r=0.8)
TOUCH = {"flight": 0, "touch_time": 0.7}
DETAILS = {"V": {"impact": 0}, "T": {"flight": 0}}


def forced():
    return find_orbits(ImpactPair(beta=np.pi / 6, r=0.3, A=5.0, s=0.34), "BT", parameter="s")[0]


def free():
    return find_orbits(Oscillator(**FREE), "S", parameter="c")[0]


def masses():
    return find_orbits(TwoMasses(**TWO_MASSES), "A", parameter="omega", starts=64)[0]


def quiet():
    problem = QuietProblem(FORCED, Word("", 2), Kernels(FORCED, "omega"))
    return problem.evaluate(np.array([0.2, 0.4, 1.3]))


def slopes(system, x, residual):
    """The Jacobian of a system, column by column."""
    columns = []
    for i, value in enumerate(x):
        rows = system([*x[:i], Series([value, 1.0]), *x[i + 1 :]])
        parts = [r.coefficients if isinstance(r, Series) else [r, 0.0] for r in rows]
        assert [float(p[0]) for p in parts] == pytest.approx(residual, rel=1e-9, abs=1e-9)
        columns.append([float(p[1]) for p in parts])
    return np.array(columns).T


def nearby(make):
    """A point that is no orbit, so that nothing vanishes by being one."""
    here = make()
    problem = here.problem
    here = here if make is quiet else here.linearisation
    moved = here.unknowns + 1e-3 * np.cos(np.arange(len(here.unknowns)))
    return problem.evaluate(moved)


@pytest.mark.parametrize("kind", ["FB", "PD", "BP", "NS", "G", "V", "T", "UZ"])
@pytest.mark.parametrize("make", [forced, free, masses, quiet])
def test_jacobians_by_hand_are_those_of_series(make, kind):
    if kind in "VT" and make is quiet:
        pytest.skip("it has no impacts")
    if kind == "NS" and make is not masses:
        pytest.skip("it has no pair")
    here = nearby(make)
    problem = here.problem
    wall = problem.model.letters[0]
    requested = {problem.parameter: 0.3}
    details = {"G": {**TOUCH, "wall": wall}, "UZ": {"requested": requested}} | DETAILS
    found = kind_of(kind).equations(problem, details.get(kind, {}))
    own = found.start(here)
    if kind == "BP":
        own[0] = 0.01
    at = found.assemble(here, own)
    orbit = Equations(problem, JETS)
    system, guess = kind_of(kind).in_many_digits(orbit, here.unknowns, details.get(kind, {}))
    assert len(guess) == len(own)
    by_series = slopes(system, [*here.unknowns.tolist(), *own.tolist()], at.residual)
    size = np.max(np.abs(by_series))
    assert at.jacobian == pytest.approx(by_series, rel=1e-8, abs=1e-9 * size)
