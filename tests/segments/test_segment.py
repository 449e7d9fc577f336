"""The seam between orbits and segments: any answerer will do, for any number of unknowns."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from zoo import two_masses, unknowns_of

from contimpact.accuracy.reference import Reference
from contimpact.models.guards import Word
from contimpact.orbits.problem import OrbitProblem
from contimpact.orbits.search import find_orbits
from contimpact.segments.bounded import many_digits
from contimpact.segments.kernel import flat, refill
from contimpact.segments.kernels import Kernels


class InManyDigits:
    """A segment that computes in thirty digits and answers in floats."""

    def __init__(self, segment):
        self.name, self.segment = segment.name, segment
        self.ctx = mpmath.mp.clone()
        self.ctx.dps = 30

    def blocks(self, start, end, values):
        given = ([self.ctx.mpf(x) for x in part] for part in (start, end, values))
        found = self.segment.over(many_digits(self.ctx))(*given)
        return refill(found, map(float, flat(found)))

    def track(self, start, dt, values):
        return self.segment.track(start, dt, values)


class Source(Kernels):
    """Segments of another kind."""

    def segment(self, start, end):
        return InManyDigits(super().segment(start, end))


def test_an_orbit_problem_takes_the_segments_it_is_given(pair):
    model = pair()
    own = OrbitProblem(model, Word("BBT"), Kernels(model, "s"))
    other = OrbitProblem(model, Word("BBT"), Source(model, "s"))
    assert [segment.name for segment in other.segments] == ["BB", "BT", "TB"]
    z = unknowns_of(own, [0.1, 0.5, 1.4], [0.7, 0.3, -0.5])
    one, two = own.evaluate(z), other.evaluate(z)
    assert np.max(np.abs(one.residual - two.residual)) < 1e-15
    assert one.jacobian == pytest.approx(two.jacobian, rel=1e-13, abs=1e-14)


@pytest.mark.full
def test_two_masses():
    """Four unknowns per impact: an orbit, its Jacobian and second derivatives in many digits."""
    orbit = find_orbits(two_masses(), "1", parameter="a", starts=64, rounds=3)[0]
    problem, z = orbit.problem, orbit.unknowns
    reference = Reference(problem)
    found = reference.orbit(z)
    assert found.distance(z) < 1e-13
    rng = np.random.default_rng(1)
    q = rng.normal(size=problem.n + 1)
    second = problem.second_along(z, q)
    h = 1e-6
    ahead, behind = (problem.evaluate(z + s * h * q).jacobian for s in (1, -1))
    assert second == pytest.approx((ahead - behind) / (2 * h), abs=2e-8 * np.max(np.abs(second)))
