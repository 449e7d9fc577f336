"""Compiled and plain searches find the same orbits, to the last bit."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest
from zoo import two_masses

from contimpact.models.guards import parse_word
from contimpact.orbits.quiet import problem_of
from contimpact.orbits.search import find_orbits
from contimpact.orbits.starts import compiled_starts, solve_rounds
from contimpact.segments.kernels import Kernels
from contimpact.systems.oscillator import Oscillator

needs_llvmlite = pytest.mark.skipif(
    importlib.util.find_spec("llvmlite") is None, reason="the extra 'fast' is not installed"
)


def same(plain, fast):
    return [o.unknowns.tolist() for o in plain] == [o.unknowns.tolist() for o in fast]


@needs_llvmlite
@pytest.mark.parametrize("word", ["1:1", "2:1", "1:1/2T", "2:1/2T", "1:0", "BTBTBTBT/4T"])
@pytest.mark.quick(3)
def test_orbits_of_the_pair(pair, kernels_of, plain_and_compiled, word):
    for given in ({"d": 0.242}, {"d": 0.12484, "A": 12.466, "r": 0.25}):
        kernels, model = kernels_of(pair(), "s"), pair(**given)
        plain, fast = plain_and_compiled(lambda m=model, k=kernels: find_orbits(m, word, kernels=k))
        assert same(plain, fast)
    assert word != "1:1" or len(plain) == 4


@needs_llvmlite
@pytest.mark.full
def test_orbits_of_random_oscillators(plain_and_compiled):
    kernels = Kernels(Oscillator(a=1.0, omega=2.0, c=0.1, k=1.0, sigma=0.1, r=0.5), "omega")
    rng, found = np.random.default_rng(4), 0
    for _ in range(12):
        damping, omega = float(rng.uniform(0, 0.3)), float(rng.uniform(1.5, 5.0))
        sigma, r = float(rng.uniform(-0.2, 0.5)), float(rng.uniform(0.2, 0.95))
        model = Oscillator(a=1.0, omega=omega, c=damping, k=1.0, sigma=sigma, r=r)
        for word in ("S", "SS/2T"):
            plain, fast = plain_and_compiled(
                lambda m=model, w=word: find_orbits(m, w, kernels=kernels)
            )
            assert same(plain, fast)
            found += len(plain)
    assert found > 12


@needs_llvmlite
def test_the_same_starts_lead_to_the_same_solutions(pair, kernels_of, plain_and_compiled):
    """In the same order, to a hundredth of what two solutions may differ by."""
    problem = problem_of(pair(d=0.12), parse_word("2:2", "BT"), kernels_of(pair(), "s"))
    plain, fast = plain_and_compiled(
        lambda: solve_rounds(problem, np.random.default_rng(1), 128, 2)
    )
    for one, other in zip(plain, fast, strict=True):
        assert len(one) >= 10
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-11)


def test_linear_machines_are_searched_on_arrays(monkeypatch):
    monkeypatch.setenv("CONTIMPACT_COMPILED", "always")
    model = two_masses()
    word = parse_word("A", model.letters)
    assert compiled_starts(problem_of(model, word, Kernels(model, "omega"))) is None
