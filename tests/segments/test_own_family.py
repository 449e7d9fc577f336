"""A family of flights of one's own: its kernels and its functions come from outside the package."""

import math

import mpmath
import numpy as np
import pytest

from contimpact import continue_orbit, find_orbits
from contimpact.accuracy.reference import Reference
from contimpact.bifurcations.kind import kind_of
from contimpact.diagrams.orbit_walks import walk_orbits
from contimpact.models.guards import Word
from contimpact.orbits.problem import OrbitProblem
from contimpact.segments.kernels import Kernels
from contimpact.segments.segment import kernel_of
from contimpact.simulation.simulator import Simulator
from contimpact.systems.bouncing_ball import BouncingBall

FREE_FALL = "# family: closed form; parameters: a, omega, r, g\n"
FLIGHT = """
def flight_P_P(t0, v0, t1, v1, p_a, p_omega, p_r, p_g):
    phase = t0 % (2*pi/p_omega)
    dt = t1 - t0
    begins, ends = p_omega*phase, p_omega*(phase + dt)
    c0, s0, c1, s1 = cos(begins), sin(begins), cos(ends), sin(ends)
    mean, speed, slower = thrown(dt, -p_r*v0, p_g)
    way, rate = (s1 - s0)/dt, p_a*p_omega
    return (
        (mean + rate*c0 - p_a*way, speed + rate*(c0 - c1) - v1),
        (p_g/2 - rate*p_omega*s0 + (rate*c0 - p_a*way)/dt, -p_r, p_g - rate*p_omega*s0, -p_r),
        (slower/2 - (rate*c1 - p_a*way)/dt, 0.0, slower + rate*p_omega*s1, -1.0),
        (p_omega*c0 - way, p_omega*(c0 - c1)),
    )
"""
MOTION = """
def motion_P(t0, v0, dt, p_a, p_omega, p_r, p_g):
    phase = t0 % (2*pi/p_omega)
    begins, ends = p_omega*phase, p_omega*(phase + dt)
    mean, speed, slower = thrown(dt, -p_r*v0, p_g)
    rate = p_a*p_omega
    x = dt*(mean + rate*cos(begins)) - p_a*(sin(ends) - sin(begins))
    return x, speed + rate*(cos(begins) - cos(ends)), slower + rate*p_omega*sin(ends)
"""
TEXTS = {"flight_P_P": FLIGHT, "motion_P": MOTION}
OMEGA, R, G = 2.0, 0.4, 9.0
FOLD = math.pi * G * (1 - R) / ((1 + R) * OMEGA**2)
"""Amplitude below which no ball bounces once a period: a omega cos(omega t) = g T (1 - r)/2(1 + r)
at the impact."""


def thrown(dt, u, g):
    """Mean velocity, last velocity and acceleration of a ball thrown upwards."""
    return u - g * dt / 2, u - g * dt, -g


class Thrown(Kernels):
    """Flights in another family than the one that formulas give."""

    def kernel(self, name):
        if name not in TEXTS:
            return super().kernel(name)
        return kernel_of(name, FREE_FALL + TEXTS[name], "<thrown>", {"thrown": thrown})


def ball(a):
    return BouncingBall(a=a, omega=OMEGA, r=R, g=G)


@pytest.fixture
def problem():
    model = ball(1.3 * FOLD)
    return OrbitProblem(model, Word("P"), Thrown(model, "a"))


def bouncing(a, late=1.0):
    """The unknowns of an orbit, in closed form."""
    period = 2 * math.pi / OMEGA
    return np.array([late * math.acos(FOLD / a) / OMEGA, -G * period / (1 + R), a])


def test_orbits_solve_its_equations_with_their_derivatives(problem):
    z = bouncing(1.2 * FOLD)
    own, given = problem, OrbitProblem(problem.model, problem.word, Kernels(problem.model, "a"))
    here, formulas = own.evaluate(z), given.evaluate(z)
    assert np.max(np.abs(here.residual)) < 1e-14 * G
    assert here.jacobian == pytest.approx(formulas.jacobian, rel=1e-13, abs=1e-13)
    along = np.array([0.3, -0.8, 0.5])
    second, third = own.second_along(z, along), own.third_along(z, along[:2])
    assert second == pytest.approx(given.second_along(z, along), rel=1e-11, abs=1e-11)
    assert third == pytest.approx(given.third_along(z, along[:2]), rel=1e-10, abs=1e-10)
    assert here.verdict.physical
    assert np.all(np.abs(here.residual) <= own.rounding(here))


@pytest.mark.parametrize("mode", ["never", "always"])
@pytest.mark.full
def test_a_branch_is_followed_around_its_fold(problem, monkeypatch, mode):
    if mode == "always":
        pytest.importorskip("llvmlite", reason="needs contimpact[fast]")
    monkeypatch.setenv("CONTIMPACT_COMPILED", mode)
    tests = [kind_of("FB").test(problem, {})]
    start, limits = bouncing(1.3 * FOLD), (0.5 * FOLD, 1.4 * FOLD)
    found = walk_orbits(problem, start, -1, limits=limits, tests=tests)
    assert [event.kind for event in found.events] == ["FB"]
    assert found.events[0].parameter == pytest.approx(FOLD, rel=1e-13)
    last = found.points[-1].unknowns
    assert last[:2] == pytest.approx(bouncing(last[2], -1.0)[:2], rel=1e-9)


def test_orbits_are_found_and_followed(problem):
    """Measured: the period doubling within 1e-15, where cos = 2 (1 + r^2)/(1 + r)^2 G/a omega^2."""
    orbits = find_orbits(problem.model, "P", kernels=problem.kernels)
    (orbit,) = (orbit for orbit in orbits if orbit.stable)
    assert orbit.unknowns == pytest.approx(bouncing(1.3 * FOLD), rel=1e-12)
    branch = continue_orbit(orbit, range=(1.1 * FOLD, 1.4 * FOLD), events=["PD"])
    doubling = math.hypot(FOLD, 2 * (1 + R**2) / (1 + R) ** 2 * G / OMEGA**2)
    assert [entry.value for entry in branch.events] == [pytest.approx(doubling, rel=1e-13)]


def test_in_many_digits(problem):
    found = Reference(problem, 40).event("FB", bouncing(1.000001 * FOLD))
    with mpmath.workdps(40):
        fold = mpmath.pi * G * (1 - mpmath.mpf(R)) / ((1 + mpmath.mpf(R)) * OMEGA**2)
        assert abs(found.parameter - fold) < 1e-38


def test_in_balls(problem):
    flint = pytest.importorskip("flint", reason="needs contimpact[certify]")
    from contimpact.certificates.equations import BallProblem, prove_zero

    with flint.ctx.workprec(128):
        space = BallProblem(problem, 128)
        z = np.array([0.0, *bouncing(FOLD * (1 + 1e-15))[1:]])
        system, null = space.singular(z, 1.0)
        _, inner = prove_zero(space, system, [*z.tolist(), *null])
        r = flint.arb(R)
        assert abs(inner[2] - flint.arb.pi() * G * (1 - r) / ((1 + r) * OMEGA**2)) < 1e-30


def test_simulated(problem):
    z = bouncing(1.3 * FOLD)
    simulator = Simulator(problem.model, problem.kernels)
    run = simulator.run(simulator.state("P", z[0], z[1]), impacts=5)
    assert run.velocities == pytest.approx(np.full(5, z[1]), rel=1e-12)
