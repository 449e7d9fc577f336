"""Events located on an arc in one go: as they are found step by step, by dense linear algebra."""

from __future__ import annotations

import importlib.util
import math

import numpy as np
import pytest

from contimpact import ImpactPair, find_orbits
from contimpact.bifurcations.event_solver import solver_of
from contimpact.bifurcations.extended_system import ReachedTest
from contimpact.bifurcations.kind import test_functions as functions_of
from contimpact.bifurcations.scalar_systems import FLIGHT, TOUCH
from contimpact.continuation.branch import TestFunction
from contimpact.diagrams.orbit_branch import continue_born, continue_orbit
from contimpact.diagrams.orbit_walks import walk_orbits
from contimpact.models.guards import Word
from contimpact.systems.soft_stop import SoftStop

needs_llvmlite = pytest.mark.skipif(
    importlib.util.find_spec("llvmlite") is None, reason="the extra 'fast' is not installed"
)

SOFT = {"a": 1.0, "omega": 1.3, "c": 0.1, "k": 1.0, "e": 0.5, "k_b": 20.0, "c_b": 0.3}
CASES = {
    "pair": (ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.7), "1:1", "s", (0.08, 0.72)),
    "pair, 2:1": (ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34), "2:1", "s", (0.08, 1.0)),
    "pair along A": (ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34), "1:1", "A", (2.0, 9.0)),
    "soft stop": (SoftStop(**SOFT), Word("CR", 1), "omega", (0.5, 1.5)),
}


def walks(orbit, limits):
    tests = functions_of(orbit.problem, ("FB", "BP", "PD", "G", "V", "T"), {})
    at = orbit.problem, orbit.unknowns
    return [walk_orbits(*at, way, limits=limits, tests=tests) for way in (1, -1)]


def orbit_of(case):
    model, word, parameter, limits = CASES[case]
    return find_orbits(model, word, parameter=parameter)[0], limits


def events_of(found):
    return [event for walk in found for event in walk.events]


QUICK = [pytest.param(case, marks=pytest.mark.full) if "soft" in case else case for case in CASES]


@pytest.mark.parametrize("case", QUICK)
def test_events_are_those_found_step_by_step(case, monkeypatch):
    monkeypatch.setenv("CONTIMPACT_COMPILED", "never")
    orbit, limits = orbit_of(case)
    at_once = walks(orbit, limits)
    for kind in functions_of(orbit.problem, ("FB", "PD", "G", "V", "T"), {}):
        monkeypatch.setattr(type(kind), "locate_on", TestFunction.locate_on)
    stepwise = walks(orbit, limits)
    assert [walk.missed for walk in at_once] == [walk.missed for walk in stepwise]
    pairs = list(zip(events_of(at_once), events_of(stepwise), strict=True))
    assert {"PD", "G", "FB", "V"} & {event.kind for event, _ in pairs}
    for one, other in pairs:
        assert (one.kind, one.method) == (other.kind, other.method)
        assert one.details.keys() == other.details.keys()
        assert abs(one.parameter - other.parameter) <= one.error + other.error
        assert one.error <= 2.0 * other.error + 1e-15
        here, there = one.point, other.point
        assert here.unknowns == pytest.approx(there.unknowns, abs=1e-9)
        assert here.tangent == pytest.approx(there.tangent, rel=1e-6, abs=1e-7)
        assert here.orientation == pytest.approx(there.orientation, rel=1e-5, abs=1e-9)
        assert here.arclength == pytest.approx(there.arclength, abs=1e-9)
        by_blocks = here.evaluation.stability.multipliers
        assert here.evaluation.multipliers == pytest.approx(by_blocks, rel=1e-6)


@pytest.mark.parametrize("kind", ["V", "T"])
@pytest.mark.parametrize("index", range(3))
def test_what_vanishes_is_as_by_dense_linear_algebra(kind, index):
    """Its gradient and the bound of its rounding, also on the flight that closes the orbit."""
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
    orbit = find_orbits(model, "2:1", parameter="omega")[0]
    problem, here = orbit.problem, orbit.problem.evaluate(orbit.unknowns)
    (test,) = functions_of(problem, (kind,), {})
    solver = solver_of(problem, test.form(problem, index))
    system, search, _ = solver.lists
    system.counts[FLIGHT], system.counts[TOUCH] = test.form(problem, index)[1:3]
    z = [*orbit.unknowns.tolist(), 0.0]
    evaluate, bound = solver.functions[:2]
    evaluate(system, z)
    bound(system, z, search.off)
    dense = ReachedTest(problem, test, index)
    side = np.array([*np.ones(problem.n), test.sides[index] if kind == "V" else 1.0])
    told, own = dense.assemble(here, np.zeros(0)), np.array(system.jacobian)[:, :-1]
    assert own == pytest.approx(side[:, None] * told.jacobian, rel=1e-12, abs=1e-12)
    assert system.residual == pytest.approx(side * told.residual, abs=1e-14)
    assert search.off[:-1] == pytest.approx(dense.rounding(here, np.zeros(0)), rel=0.5)


@pytest.mark.full
def test_a_contact_that_vanishes_is_no_doubling():
    """There the cyclic matrix is singular for every multiplier."""
    quiet = find_orbits(SoftStop(**SOFT).replace(omega=2.0), "0", parameter="omega")[0]
    (touch,) = continue_orbit(quiet, "omega", (1.0, 2.0), events=["G"]).events[:1]
    born = continue_born(touch, SoftStop(**SOFT), (1.0, 2.0), events=["FB", "PD", "V"])
    at = [event.kind for event in born.events if abs(event.value - touch.value) < 1e-11]
    assert at == ["V"]


@needs_llvmlite
@pytest.mark.full
@pytest.mark.parametrize("case", CASES)
def test_they_are_the_same_compiled_to_the_last_bit(case, plain_and_compiled):
    orbit, limits = orbit_of(case)
    plain, fast = plain_and_compiled(lambda: events_of(walks(orbit, limits)))
    for one, other in zip(plain, fast, strict=True):
        assert np.array_equal(one.point.unknowns, other.point.unknowns)
        assert np.array_equal(one.point.tangent, other.point.tangent)
        numbers = (
            (e.point.orientation, e.point.arclength, e.residual, e.error) for e in (one, other)
        )
        assert next(numbers) == next(numbers)
        assert one.details == other.details
        assert np.array_equal(one.point.evaluation.multipliers, other.point.evaluation.multipliers)
