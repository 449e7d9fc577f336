"""What a walk costs, counted: evaluations, iterations, and calls of Python; no clock is asked.

The branch of the benchmarks: the 1:1 orbit of the impact pair down to d = 0.05, which passes a
period doubling and a grazing.
"""

from __future__ import annotations

import importlib.util
import math
import sys

import numpy as np
import pytest
from invariants import Watch

from contimpact import ImpactPair, Settings
from contimpact.bifurcations.kind import test_functions as functions_of
from contimpact.diagrams.orbit_walks import walk_orbits
from contimpact.models.guards import Word
from contimpact.orbits.problem import OrbitProblem
from contimpact.segments.kernels import Kernels

START = (
    0.3289672464099905,
    0.9099069905380301,
    1.4248536390000661,
    -0.7221992982303381,
    0.45 / 0.6225,
)
LIMITS = 0.05 / 0.6225, START[-1]
STEPS = {"fixed": Settings(step=0.001024, max_step=0.001024, max_points=5000), "own": Settings()}
ALL = "FB", "BP", "PD", "G", "V", "T"
FLIGHTS, LOCATED = 2, {"PD": 12, "G": 11}
"""Flights of the orbit; evaluations of flights that the location of an event in fixed steps takes:
those of the guess, and a system of four flights twice (PD) or of three thrice (G); and those of the
sizes by which the trace of an impact is measured (PD)."""

without_llvmlite = importlib.util.find_spec("llvmlite") is None
needs_llvmlite = pytest.mark.skipif(without_llvmlite, reason="the extra 'fast' is not installed")
COMPILED = needs_llvmlite, pytest.mark.full


KNOWN = {}


class Effort:
    """One walk, and what it took."""

    def __init__(self, kinds, steps):
        pair = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=START[-1])
        problem = OrbitProblem(pair, Word("BT", 1), Kernels(pair, "s"))
        self.walk(problem, kinds, steps)  # what is loaded, or compiled, once
        before, calls = problem.kernel_evaluations, 0

        def count(frame, event, argument):
            nonlocal calls
            calls += event in ("call", "c_call")

        told = sys.getprofile()
        sys.setprofile(count)
        try:
            found, tests = self.walk(problem, kinds, steps)
        finally:
            sys.setprofile(told)
        self.calls, self.kernels = calls, problem.kernel_evaluations - before
        self.points, self.iterations = len(found.points), found.corrector_iterations
        self.tests = {test.kind: test.evaluations for test in tests}
        self.events = sorted(event.kind for event in found.events)
        assert not found.missed

    @staticmethod
    def walk(problem, kinds, steps):
        tests = functions_of(problem, kinds, {})
        given = {"limits": LIMITS, "tests": tests, "settings": STEPS[steps]}
        return walk_orbits(problem, np.array(START), -1, **given), tests


@pytest.fixture
def effort(monkeypatch, kernel_cache):
    """Walks of one mode, each made once; what tests check of every walk is not counted."""
    monkeypatch.setattr(Watch, "on", False)

    def measured(mode, kinds, steps="fixed"):
        monkeypatch.setenv("CONTIMPACT_COMPILED", mode)
        if (mode, kinds, steps) not in KNOWN:
            KNOWN[mode, kinds, steps] = Effort(kinds, steps)
        return KNOWN[mode, kinds, steps]

    return measured


MODES = pytest.mark.parametrize("mode", ["never", pytest.param("always", marks=COMPILED)])


@MODES
@pytest.mark.parametrize("steps", STEPS)
@pytest.mark.parametrize(
    "kinds", [("FB",), ("FB", "BP"), ("V",), ("T",), ("FB", "BP", "V", "T")], ids="+".join
)
@pytest.mark.full
def test_kinds_of_which_no_event_lies_there_cost_nothing(effort, mode, kinds, steps):
    """The status changes at a PD and at a G that nobody asked for: neither is looked for."""
    none, some = effort(mode, (), steps), effort(mode, kinds, steps)
    assert some.events == []
    assert (some.points, some.iterations) == (none.points, none.iterations)
    assert some.kernels == none.kernels
    assert some.tests == dict.fromkeys(kinds, some.points)


@MODES
def test_evaluations_of_a_point_in_fixed_steps(effort, mode):
    """The guess and the point to which one iteration leads; at either end a few more."""
    none = effort(mode, ())
    assert none.points == 1188
    assert none.iterations == none.points
    assert none.kernels <= 2 * FLIGHTS * none.points + 2 * FLIGHTS


@MODES
@pytest.mark.parametrize("kinds", [("PD",), ("G",), ("PD", "G"), ALL], ids="+".join)
@pytest.mark.full
def test_evaluations_of_an_event(effort, mode, kinds):
    """Every test function once a point; what is located costs alike, whatever is asked besides."""
    none, some = effort(mode, ()), effort(mode, kinds)
    assert some.events == sorted({"PD", "G"} & {*kinds})
    assert some.tests == dict.fromkeys(kinds, some.points)
    assert some.kernels - none.kernels <= sum(LOCATED[kind] for kind in some.events)


CALLS = {
    ("never", (), "own"): 9820,
    ("never", ("FB", "BP"), "own"): 10300,
    ("never", ALL, "own"): 16400,
    ("always", (), "own"): 1110,
    ("always", ("FB", "BP"), "own"): 1500,
    ("always", ALL, "own"): 2800,
    ("always", (), "fixed"): 2310,
    ("always", ("FB", "BP"), "fixed"): 2850,
    ("always", ALL, "fixed"): 5180,
}
"""Calls of functions, Python's and built in ones, of a walk as a whole: a sixth more than there
are, for other versions of Python and NumPy."""


@pytest.mark.parametrize(
    ("mode", "kinds", "steps"),
    [pytest.param(*key, marks=COMPILED if key[0] == "always" else ()) for key in CALLS],
)
def test_calls_of_a_walk(effort, mode, kinds, steps):
    """What all numbers have in common that no evaluation shows: bookkeeping."""
    found = effort(mode, kinds, steps)
    assert 0.4 * CALLS[mode, kinds, steps] < found.calls < CALLS[mode, kinds, steps]
