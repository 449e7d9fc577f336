"""Two masses with a stop each: orbits against modal superposition, events, and simulation."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from zoo import TWO_MASSES, ProportionalMasses

from contimpact.accuracy.reference import Reference
from contimpact.bifurcations.kind import switch
from contimpact.bifurcations.kind import test_functions as functions
from contimpact.continuation.branch import EndKind
from contimpact.continuation.settings import Settings
from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.diagrams.orbit_walks import walk_both_ways
from contimpact.orbits.search import find_orbits
from contimpact.results.diagram import impacts_of
from contimpact.segments.bounded import many_digits
from contimpact.segments.kernel import flat
from contimpact.segments.segment import evaluate_in
from contimpact.systems.two_masses import TwoMasses


def masses(**given):
    return TwoMasses(**(TWO_MASSES | given))


@pytest.fixture(scope="module")
def impacting():
    """An orbit on which both masses hit their stops."""
    return find_orbits(masses(), "AB", parameter="omega", starts=64)[0]


@pytest.mark.full
def test_orbits_are_those_of_modal_superposition():
    """Damping proportional to stiffness, and the second stop out of reach."""
    damping, given = 0.07, {"k1": 1.0, "k2": 0.6, "omega": 1.3, "r": 0.8}
    modal = ProportionalMasses(a=1.0, c=damping, sigma=0.5, **given)
    both = masses(c1=damping * 1.0, c2=damping * 0.6, sigma_1=0.5, sigma_2=1e3, **given)
    for word in ("A", "AA/3T"):
        one, other = (find_orbits(m, word, parameter="omega", starts=64) for m in (modal, both))
        assert len(one) == len(other) > 0
        for a, b in zip(one, other, strict=True):
            assert a.unknowns == pytest.approx(b.unknowns, abs=1e-10)
            assert np.poly(a.multipliers) == pytest.approx(np.poly(b.multipliers), abs=1e-9)
            for closed, linear in zip(a.linearisation.gaps, b.linearisation.gaps, strict=True):
                touch, other = closed.touches[0], linear.touches[0]
                assert (touch is None) == (other is None)
                if touch is not None:
                    assert touch.gap == pytest.approx(other.gap, abs=1e-10)
                    assert touch.time == pytest.approx(other.time, abs=1e-10)


def test_product_of_multipliers(impacting):
    """Of each impact r^2, and of the flights what damping takes."""
    found = np.prod(impacting.multipliers)
    rate = (TWO_MASSES["c1"] + TWO_MASSES["c2"]) + TWO_MASSES["c2"]
    truth = TWO_MASSES["r"] ** 4 * math.exp(-rate * 2.0 * math.pi / TWO_MASSES["omega"])
    assert found == pytest.approx(truth, rel=1e-12)


@pytest.mark.full
def test_jacobian_against_differences_in_thirty_digits(impacting):
    ctx = mpmath.mp.clone()
    ctx.dps = 30
    problem = impacting.problem
    kernel = problem.kernels.flight("A", "B")
    ends = [float(x) for x in problem.impacts(impacting.unknowns).ravel()]
    values = problem.values(impacting.unknowns)
    exact = evaluate_in(kernel, many_digits(ctx))

    def residual(given):
        return np.array(flat(exact(*given)))[:4]

    _, start, end, by_parameter = kernel(*ends, *values)
    columns = [*np.reshape(start, (4, 4)).T, *np.reshape(end, (4, 4)).T, np.array(by_parameter)]
    places = [*range(8), 8 + list(problem.model.values).index("omega")]
    given, h = [ctx.mpf(x) for x in (*ends, *values)], ctx.mpf(10) ** -10
    for place, column in [*zip(places, columns, strict=True)][::2]:
        ahead, behind = (
            residual([x + s * h * (i == place) for i, x in enumerate(given)]) for s in (1, -1)
        )
        slope = ((ahead - behind) / (2 * h)).astype(float)
        assert column == pytest.approx(slope, rel=1e-12, abs=1e-12)


@pytest.mark.full
def test_an_orbit_in_many_digits(impacting):
    assert (
        Reference(impacting.problem).orbit(impacting.unknowns).distance(impacting.unknowns) < 1e-12
    )


def test_events_and_switching():
    """Period doubling and grazing of the first mass's orbit; the second mass's first impact."""
    orbit = find_orbits(masses(), "A", parameter="omega", starts=64)[0]
    tests = functions(orbit.problem, ["FB", "PD", "G"], {})
    run = walk_both_ways(orbit.problem, orbit.unknowns, (0.97, 1.45), tests, Settings())
    assert {event.kind for event in run.events} == {"PD", "G"}
    assert all(event.error < 1e-11 for event in run.events)
    grazing = next(event for event in run.events if event.kind == "G")
    assert grazing.details["wall"] == "B"
    here = grazing.point.evaluation
    touch = next(t for t in here.gaps[0].touches if t and t.wall == "B")
    assert abs(touch.gap) < 1e-12
    longer = switch(grazing)
    assert longer.problem.word.walls in ("AB", "BA")
    assert np.max(np.abs(longer.problem.evaluate(longer.unknowns).residual)) < 1e-12
    doubling = next(event for event in run.events if event.kind == "PD")
    assert np.min(np.abs(doubling.point.evaluation.multipliers + 1.0)) < 1e-9


def test_a_catalogue_lists_all_positions_and_velocities(impacting):
    """From B's impact on with B's own position, and the first mass's as the other coordinate."""
    first, second = impacts_of(impacting.problem, impacting.unknowns)
    assert first["positions"][0] == TWO_MASSES["sigma_1"]
    assert second["positions"][1] == TWO_MASSES["sigma_2"]
    assert first["positions"][1] == first["x1_"]
    assert second["positions"][0] == second["x1_"]
    assert second["velocities"] == [second["v1_"], second["velocity"]]


@pytest.mark.slow
def test_a_closed_branch_with_impacts_of_both_masses():
    """AB/3T with the stops further away: a loop, observable on a part of it."""
    found = find_orbits(masses(sigma_1=1.0, sigma_2=1.0), "AB/3T", parameter="omega", starts=64)
    assert found
    settings = Settings(max_points=1500)
    branches = [continue_orbit(found[0], "omega", (0.9, 2.2), events=[], settings=settings)]
    for orbit in found[1:]:
        if not any(np.any(b["physical"]) for b in branches):
            branches.append(
                continue_orbit(orbit, "omega", (0.9, 2.2), events=[], settings=settings)
            )
    loop = next(b for b in branches if np.any(b["physical"]))
    assert {end.kind for end in loop.ends} == {EndKind.CLOSED}
    assert np.any((loop["physical"] == 1) & (loop["n_unstable"] == 0))
    assert 0.9 < np.min(loop["omega"]) < np.max(loop["omega"]) < 2.0
