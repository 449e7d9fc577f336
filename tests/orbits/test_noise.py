"""Fluctuations under noise, against simulation from closed forms, and against sensitivities."""

from __future__ import annotations

import math

import numpy as np
import pytest
from zoo import TWO_MASSES

from contimpact.errors import InputError
from contimpact.orbits.search import find_orbits
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.two_masses import TwoMasses

PI = math.pi


def stable(word, **parameters):
    """A physical stable orbit of the pair at beta = pi/6, A = 5 N."""
    model = ImpactPair(beta=PI / 6, **{"r": 0.3, "A": 5.0, **parameters})
    return next(o for o in find_orbits(model, word, parameter="s") if o.stable and o.physical)


def simulated(orbit, noise, motions, laps, left_out=30):
    """The covariances of so many motions, by flights written out here, and their number."""
    rng, given = np.random.default_rng(7), orbit.model.values
    walls, times = orbit.word.walls, [*orbit.times, orbit.times[0] + 2.0]
    t, v = np.full(motions, times[0]), np.full(motions, orbit.velocities[0])
    found = [[] for _ in walls]
    for lap in range(laps):
        for k, wall in enumerate(walls):
            if lap >= left_out:
                found[k].append([t - times[k] - 2.0 * lap, v - orbit.velocities[k]])
            r, force, s = (
                given[n] + noise.get(n, 0.0) * rng.standard_normal(motions) for n in ("r", "A", "s")
            )
            d = given["M"] * given["omega"] ** 2 * s / (force * PI**2)
            g = given["M"] * given["g"] * math.sin(given["beta"]) / force
            start, goal = (0.5 if w == "B" else -0.5 for w in (wall, walls[(k + 1) % len(walls)]))
            left, u = -r * v, np.full(motions, times[k + 1] + 2.0 * lap)
            for _ in range(8):
                dt = u - t
                x = (start - goal) * d + left * dt + g * dt**2 / 2.0 - np.sin(PI * t) / PI * dt
                x += (np.cos(PI * t) - np.cos(PI * u)) / PI**2
                speed = left + g * dt + (np.sin(PI * u) - np.sin(PI * t)) / PI
                u = u - x / speed
            t, v = u, left + g * (u - t) + (np.sin(PI * u) - np.sin(PI * t)) / PI
    return [np.cov(np.concatenate(rows, axis=1)) for rows in found], motions * (laps - left_out)


@pytest.mark.parametrize(
    ("word", "s", "noise", "motions"),
    [
        ("1:1", 0.45, {"r": 1e-3, "A": 3e-3, "s": 1e-4}, 500),
        pytest.param("1:1", 0.45, {"r": 2e-3}, 4000, marks=pytest.mark.full),
        pytest.param("2:1", 0.32, {"r": 1e-3, "A": 2e-3}, 4000, marks=pytest.mark.full),
    ],
)
def test_covariances_are_those_of_simulated_motions(word, s, noise, motions):
    """Within five standard errors; impacts of one motion are correlated over a few periods."""
    orbit = stable(word, s=s)
    found = orbit.fluctuations(noise)
    assert found.trusted
    seen, count = simulated(orbit, noise, motions, 280)
    slowest = max(abs(orbit.multipliers)) ** 2
    error = 5.0 * math.sqrt(2.0 / count * (1.0 + slowest) / (1.0 - slowest))
    for covariance, sample in zip(found.covariances, seen, strict=True):
        sizes = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
        assert np.max(np.abs(sample - covariance) / sizes) < error
    assert np.allclose(found.times**2, found.covariances[:, 0, 0])


def test_margins_are_those_of_the_gap_in_closed_form():
    """A flight from B past B: the gap's derivatives by what leaves, and by the restitution."""
    orbit = stable("1:1", s=0.39)
    found = orbit.fluctuations({"r": 1e-4})
    nearest, k = found.margins[0], 0
    touch = orbit.linearisation.gaps[k].touches["BT".index("B")]
    t, v, r = orbit.times[k], orbit.velocities[k], 0.3
    dt = touch.time - t
    g = orbit.derived["gbar"]
    by_state = np.array([r * v - (math.cos(PI * t) + g) * dt, -r * dt])
    variance = by_state @ found.covariances[k] @ by_state + (1e-4 * v * dt) ** 2
    assert nearest.what == "gap in flight 1 to B"
    assert nearest.distance == touch.gap
    assert nearest.deviation == pytest.approx(math.sqrt(variance), rel=1e-6)
    assert nearest.sigmas == pytest.approx(nearest.distance / math.sqrt(variance), rel=1e-6)


def test_beside_a_grazing_first_order_is_not_trusted():
    orbit = stable("1:1", s=0.39)
    far = orbit.fluctuations({"r": 1e-4})
    near = orbit.fluctuations({"r": 1e-4 * far.margins[0].sigmas})
    assert far.trusted
    assert not near.trusted
    assert near.margins[0].sigmas == pytest.approx(1.0)
    assert "too near for first order" in repr(near)


@pytest.mark.parametrize(("length", "time"), [(1e-6, 1.0), (1.0, 1e3), (1e3, 1e3)])
def test_fluctuations_are_the_same_in_any_units(length, time):
    """Gaps were differenced by steps larger than the parameters, and first order never trusted."""

    def found(length, time):
        a, sigma, rate = 0.5 * length / time**2, 0.1 * length, 1.0 / time
        model = Oscillator(a=a, omega=rate, c=0.2 * rate, k=rate**2, sigma=sigma, r=0.8)
        orbit = next(o for o in find_orbits(model, "1", parameter="omega") if o.stable)
        noise = {"a": 0.01 * a, "sigma": 0.1 * sigma, "r": 0.01, "omega": 1e-3 * rate}
        return orbit.fluctuations(noise)

    one, other = found(1.0, 1.0), found(length, time)
    assert one.trusted
    assert other.trusted
    assert [m.sigmas for m in other.margins] == pytest.approx(
        [m.sigmas for m in one.margins], rel=1e-8
    )
    assert other.times == pytest.approx(time * one.times, rel=1e-9)


def test_a_lasting_change_moves_several_coordinates_as_their_sensitivity_says():
    """Noise that is the same at each impact is a change of the parameter."""
    model = TwoMasses(**TWO_MASSES)
    orbit = next(o for o in find_orbits(model, "A", parameter="omega") if o.stable and o.physical)
    found = orbit.fluctuations({"r": 1.0})
    assert found.covariances.shape == (1, 4, 4)
    here, moved = orbit.linearisation, orbit.sensitivity("r")
    step = -np.linalg.solve(here.end[0], here.start[0])
    assert np.allclose(sorted(abs(np.linalg.eigvals(step))), sorted(abs(orbit.multipliers)))
    closed = found.covariances[0] - step @ found.covariances[0] @ step.T
    (largest,) = np.linalg.eigvalsh(closed)[-1:]
    assert np.linalg.matrix_rank(closed, tol=1e-9 * largest) == 1
    pushed = np.linalg.eigh(closed)[1][:, -1] * math.sqrt(largest)
    lasting = np.linalg.solve(np.eye(4) - step, pushed)
    sign = np.sign(lasting[0] * moved.times[0])
    assert sign * lasting[:2] == pytest.approx([moved.times[0], moved.velocities[0]], rel=1e-7)


def test_refusals():
    orbit = stable("1:1", s=0.45)
    other = next(
        o for o in find_orbits(orbit.model, "1:1", parameter="s") if not o.stable or not o.physical
    )
    for wrong, noise, said in [
        (orbit, {}, "standard deviations"),
        (orbit, {"r": -1.0}, "standard deviations"),
        (orbit, {"r": "1%"}, "standard deviations"),
        (orbit, 0.1, "noise: 0.1; give standard deviations"),
        (orbit, {"q": 0.1}, "has no parameter 'q'"),
        (other, {"r": 0.1}, "physical|multipliers"),
    ]:
        with pytest.raises(InputError, match=said):
            wrong.fluctuations(noise)
