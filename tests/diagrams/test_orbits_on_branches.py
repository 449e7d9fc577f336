"""Whether an orbit lies on a branch that is known by its points."""

from __future__ import annotations

import math

import numpy as np
import pytest

import contimpact as ci
from contimpact.continuation.settings import Settings
from contimpact.diagrams.orbit_walks import walk_both_ways
from contimpact.models.guards import Word
from contimpact.orbits.problem import OrbitProblem
from contimpact.segments.kernels import Kernels
from contimpact.systems.bouncing_ball import BouncingBall

OMEGA, R, G = 50.0, 0.5, 9.8
FOLD = math.pi * G * (1.0 - R) / (OMEGA**2 * (1.0 + R))
"""The least amplitude at which the ball is thrown as fast as it loses: cos(omega t) = FOLD/a."""


def impact(problem, cosine, sine):
    """The orbit with one impact in a period at a phase, a = FOLD/cosine."""
    amplitude = FOLD / cosine
    time = math.atan2(sine, cosine) / OMEGA
    speed = -math.pi * G / OMEGA - amplitude * OMEGA * cosine
    return np.array([time, speed, amplitude])


@pytest.fixture(scope="module")
def run():
    """The branch around its fold, whose place is not located: only its points are known."""
    model = BouncingBall(a=1.02 * FOLD, omega=OMEGA, r=R, g=G)
    problem = OrbitProblem(model, Word("P", 1), Kernels(model, "a"))
    start = impact(problem, 1.0 / 1.02, -math.sqrt(1.0 - 1.02**-2))
    limits = (0.5 * FOLD, 1.2 * FOLD)
    return walk_both_ways(problem, start, limits, [], Settings())


@pytest.mark.parametrize("sine", [*np.linspace(-0.1, 0.1, 41), 1e-4, -1e-4, 1e-6, 0.3, -0.3])
def test_orbits_of_a_branch_are_on_it_next_to_its_fold_too(run, sine):
    found = impact(run.problem, math.sqrt(1.0 - sine**2), sine)
    assert np.max(np.abs(run.problem.evaluate(found).residual)) < 1e-12
    assert run.holds(found)


def test_what_is_no_orbit_of_it_is_not_on_it(run):
    """Next to the fold, off by a thousandth."""
    found = impact(run.problem, 1.0, 0.0)
    assert not run.holds(found * np.array([1.0, 1.001, 1.0]) + np.array([1e-4, 0.0, 0.0]))


def test_a_branch_point_that_a_walk_starts_on_is_said_to_be_one():
    """It advised a smaller min_step where the first step was refused."""
    pair = ci.ImpactPair(beta=1.2326, r_B=0.4383, A=12.923, r_T=0.1689, s=0.4267)
    orbit = ci.find_orbits(pair, "1:1/2T", "s")[1]
    branch = ci.continue_orbit(orbit, "s", range=(0.2, 0.7), events=["BP"])
    assert branch.ends[1].message.startswith("became 1:1, run 2 times")
    for parameter in ("A", "r_B"):
        span = 0.7 * pair[parameter], 1.3 * pair[parameter]
        found = ci.continue_orbit(branch.orbit(-1), parameter, range=span)
        said = "two directions leave the first point" in found.ends[1].message
        assert said == (len(found) == 1)  # rounding may show one of the directions
