"""Flights of one coordinate in steps: closed forms, and no zero of the acceleration lost."""

from __future__ import annotations

import functools
import importlib.util
import itertools
import math

import numpy as np
import pytest

from contimpact.segments.flight import excursion_alone
from contimpact.segments.oscillation import (
    COEFFICIENTS,
    MOST,
    ROW,
    START,
    WIDTH,
    follow,
    motion_along_steps,
    motion_in_step,
)


def flown(kappa, gamma, waves, rest, state, length):
    """The steps and breaks of a flight under a_i cos(w_i t) + b_i sin(w_i t) + rest."""
    pushes = [c for a, b, _ in waves for c in (a, b)]
    numbers = (kappa, gamma, *pushes, rest, *(w for _, _, w in waves))
    start = (*state, *(c for _ in waves for c in (1.0, 0.0)), 1.0)
    steps, breaks = [], [0.0] * (2 * MOST)
    made, found = follow(len(waves), numbers, start, length, steps, breaks)
    return steps[: max(made, 0)], breaks[:found], made


def exact(kappa, gamma, waves, rest, state):
    """Displacement, velocity and acceleration by complex amplitudes; kappa is not zero."""

    def steady(t):
        total = np.array([-rest / kappa, 0.0, 0.0])[:, None] * np.ones_like(t)
        for a, b, w in waves:
            wave = complex(a, -b) * np.exp(1j * w * t) / (-(w**2) - 1j * w * gamma - kappa)
            total = total + np.array([wave, 1j * w * wave, -(w**2) * wave]).real
        return total

    root = np.sqrt(complex(gamma**2 + 4.0 * kappa))
    one, two = (gamma + root) / 2.0, (gamma - root) / 2.0
    x, v = state - steady(np.zeros(1))[:2, 0]
    first = (v - two * x) / (one - two)
    parts = ((first, one), (x - first, two))

    def at(t):
        free = [sum(c * r**n * np.exp(r * t) for c, r in parts).real for n in range(3)]
        return (steady(t) + free - np.array([[state[0]], [0.0], [0.0]])).T

    return at


@pytest.mark.parametrize("seed", range(16))
def test_motion_and_every_zero_of_the_acceleration(seed):
    rng = np.random.default_rng(seed)
    frequency = 10.0 ** rng.uniform(-1, 2)
    kappa, gamma = -(frequency**2), -2.0 * frequency * rng.choice([0.0, 0.1, 0.9, 1.5])
    waves = [(*rng.normal(size=2), rng.uniform(0.1, 20.0)) for _ in range(rng.integers(0, 4))]
    state, rest, length = rng.normal(size=2), rng.normal(), rng.uniform(0.01, 10.0)
    at = exact(kappa, gamma, waves, rest, state)
    steps, breaks, made = flown(kappa, gamma, waves, rest, state, length)
    assert made == len(steps) > 0
    times = np.linspace(0.0, length, 1001)
    found = np.array([motion_along_steps(steps, t, ()) for t in times])
    truth = at(times)
    sizes = np.abs(truth).max(axis=0)
    assert np.all(np.abs(found - truth) < 1e-12 * len(steps) * sizes)
    certain = np.abs(truth[:, 2]) > 1e-9 * sizes[2]
    signs, places = truth[certain, 2] > 0.0, times[certain]
    changes = np.flatnonzero(signs[1:] != signs[:-1])
    assert len(breaks) >= len(changes)
    for i in changes:
        assert any(places[i] <= t <= places[i + 1] for t in breaks)
    assert breaks == sorted(breaks)
    assert np.all(np.abs(at(np.array(breaks))[:, 2]) < 1e-7 * sizes[2])


@pytest.mark.parametrize("depth", [1e-2, 1e-5, 1e-9, 1e-14])
def test_two_zeros_close_together(depth):
    """The acceleration cos t + 1 - depth, free of the state, dips below zero at t = pi."""
    _, breaks, _ = flown(0.0, 0.0, [(1.0, 0.0, 1.0)], 1.0 - depth, (0.0, 1.0), 6.0)
    half = math.acos(1.0 - depth)
    assert breaks == pytest.approx([math.pi - half, math.pi + half], abs=1e-6 * half + 1e-8)


def test_a_touch_of_zero_costs_no_more_than_halvings():
    steps, _, _ = flown(0.0, 0.0, [(1.0, 0.0, 1.0)], 1.0, (0.0, 1.0), 6.0)
    assert len(steps) < 200


def test_rest_and_uniform_motion_are_one_step_each():
    for state in ((0.0, 0.0), (0.3, 2.0)):
        steps, breaks, _ = flown(0.0, 0.0, [], 0.0, state, 5.0)
        assert (len(steps), breaks) == (1, [])
        assert motion_along_steps(steps, 5.0, ()) == (5.0 * state[1], state[1], 0.0)
    steps, breaks, _ = flown(-1e6, 0.0, [], 0.3e6, (0.3, 0.0), 1e-2)  # at rest within rounding
    assert len(steps) < 100
    assert breaks == []


def test_steps_meet():
    steps, _, _ = flown(-4.0, -0.1, [(1.0, 0.5, 7.0)], 0.2, (0.1, -1.0), 9.0)
    for one, other in itertools.pairwise(steps):
        assert len(one) == ROW
        assert one[START] + one[WIDTH] == pytest.approx(other[START], rel=1e-15)
        assert motion_in_step(one, other[START])[:2] == pytest.approx(
            (other[-1], other[-2] / other[WIDTH]), abs=1e-15
        )
        assert other[COEFFICIENTS + 1] != 0.0


@pytest.mark.parametrize(("kappa", "gamma"), [(-1e12, 0.0), (-1.0, -1e5), (math.nan, 0.0)])
def test_flights_too_stiff_are_given_up(kappa, gamma):
    assert flown(kappa, gamma, [], 0.0, (0.1, 1.0), 5.0)[2] == -1


@pytest.mark.skipif(importlib.util.find_spec("llvmlite") is None, reason="needs contimpact[fast]")
@pytest.mark.parametrize("seed", range(4))
def test_a_compiled_excursion_is_the_plain_one(plain_and_compiled, seed):
    """To the last bit; where the steps are too many, too."""
    rng = np.random.default_rng(seed)
    waves = rng.integers(4)
    stiff = -(10.0 ** rng.uniform(0.0, 6.0))
    numbers = (stiff, -rng.random(), *rng.normal(size=2 * waves + 1), *rng.uniform(0.5, 9.0, waves))
    start = (*rng.normal(size=2), *[1.0, 0.0] * waves, 1.0)
    for length in (0.7, 6.0, 5e3):
        about = length, rng.normal(), 1.0, -1.0
        law = "law", float(waves), numbers, start
        run = functools.partial(excursion_alone, law, about)
        plain, compiled = plain_and_compiled(run)
        assert np.array_equal(plain, compiled, equal_nan=True)
    assert plain[4] == math.inf
