"""What the tests share: one folder of kernels for the whole run, models, and exact flights.

The exact flights are written from the equations of motion, in mpmath, without the package: a sum
of harmonics integrated twice, and the linear oscillator from its characteristic roots.
"""

from __future__ import annotations

import gc
import math
import os
import sys
from collections import Counter
from functools import cache
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # workers share the cores; NumPy reads it once

import invariants
import mpmath as mp
import pytest
from exact_flights import FORCINGS, exact_flight

from contimpact.models.guards import parse_word
from contimpact.orbits.problem import OrbitProblem
from contimpact.segments.kernels import Kernels
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator

DECIDING = {"continuation", "bifurcations", "orbits", "diagrams"}
"""The folders of tests whose results rest on floating-point decisions."""


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """No garbage is looked for in what is imported and collected, which stays, and seldom later."""
    gc.set_threshold(50_000, 20, 20)
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Mark as full what a test has beyond its quick cases, and tests of decisions as such."""
    cases = Counter()
    for item in items:
        if item.path.parent.name in DECIDING:
            item.add_marker("deciding")
        if marker := item.get_closest_marker("quick"):
            cases[item.parent.nodeid, item.originalname] += 1
            if cases[item.parent.nodeid, item.originalname] > marker.args[0]:
                item.add_marker("full")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    """Branches of a test that is marked as corrupting are not checked."""
    invariants.Watch.on = item.get_closest_marker("corrupting") is None


@pytest.fixture(scope="session", autouse=True)
def kernel_cache(pytestconfig):
    """One cache of kernels for all tests, workers and runs; ``--cache-clear`` empties it.

    Kernels and programs are found by digests of what they are made from, so that an earlier run's
    are used for unchanged sources alone.
    """
    folder = Path(pytestconfig.cache.mkdir("contimpact")) / "kernels"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CONTIMPACT_CACHE", str(folder))
        patch.setenv("CONTIMPACT_COMPILED", "never")
        yield folder


@pytest.fixture(scope="module")
def compiled_where_it_pays(kernel_cache):
    """A module's long motion is compiled where that pays; it is the same to the last bit."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CONTIMPACT_COMPILED", "auto")
        yield


@pytest.fixture(autouse=True)
def no_kernel_is_kept_in_memory():
    """As in a process of its own, whose cache can be written."""
    if kernels := sys.modules.get("contimpact.segments.kernels"):
        kernels._unwritten.clear()


@pytest.fixture(scope="session", autouse=True)
def formulas_are_set_once():
    """Matplotlib would set each formula anew in every figure."""
    from matplotlib.backends import backend_agg

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(backend_agg, "MathTextParser", cache(backend_agg.MathTextParser))
        yield


@pytest.fixture(scope="session", autouse=True)
def branches_keep_their_invariants():
    """Whatever branch a test follows is checked."""
    with pytest.MonkeyPatch.context() as patch:
        invariants.watch(patch)
        yield


@pytest.fixture
def plain_and_compiled(kernel_cache, monkeypatch):
    """Run something plainly and compiled, each program compiled once in the tests' own cache."""

    def both(run):
        results = []
        for mode in ("never", "always"):
            monkeypatch.setenv("CONTIMPACT_COMPILED", mode)
            results.append(run())
        return results

    return both


# Models


def make_pair(d=None, **given):
    """The impact pair of the paper; `d` sets the capsule's length through its definition."""
    values = {"beta": math.pi / 6, "r": 0.3, "A": 5.0, "s": 0.389} | given
    if "r_B" in given or "r_T" in given:
        del values["r"]
    model = ImpactPair(**values)
    if d is not None:
        p = model.values
        model = model.replace(s=d * p["A"] * math.pi**2 / (p["M"] * p["omega"] ** 2))
    return model


def make_oscillator(**given):
    """The one-sided oscillator; unit amplitude and stiffness unless told otherwise."""
    values = {"a": 1.0, "omega": 3.7, "c": 0.0, "k": 1.0, "sigma": 0.2, "r": 0.8}
    return Oscillator(**values | given)


@pytest.fixture(scope="session")
def pair():
    return make_pair


@pytest.fixture(scope="session")
def oscillator():
    return make_oscillator


@pytest.fixture(scope="session")
def kernels_of(kernel_cache):
    """``kernels_of(model, *parameters)``, one instance for all models of the same formulas."""
    known = {}

    def kernels(model, *parameters):
        key = (model.identity, *parameters)
        if key not in known:
            known[key] = Kernels(model, *parameters)
        return known[key]

    return kernels


@pytest.fixture(scope="session")
def problem_of(kernels_of):
    """``problem_of(model, word, *parameters)``: the orbit problem of a word."""

    def problem(model, word, *parameters):
        letters = [wall.name for wall in model.WALLS]
        return OrbitProblem(model, parse_word(word, letters), kernels_of(model, *parameters))

    return problem


@pytest.fixture(scope="session")
def forcings():
    return FORCINGS


@pytest.fixture
def exact():
    """`exact_flight`, at 60 digits for as long as the test runs."""
    with mp.workdps(60):
        yield exact_flight
