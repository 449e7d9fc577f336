"""What the tests share: one folder of kernels for the whole run, models, and exact flights.

The exact flights are written from the equations of motion, in mpmath, without the package: a sum
of harmonics integrated twice, and the linear oscillator from its characteristic roots.
"""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path

import invariants
import mpmath as mp
import pytest
from program_text import run_as_texts

from contimpact.models.word import parse_word
from contimpact.orbits.problem import OrbitProblem
from contimpact.segments.kernels import Kernels
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Mark as full what a test has beyond its quick cases."""
    cases = Counter()
    for item in items:
        if marker := item.get_closest_marker("quick"):
            cases[item.parent.nodeid, item.originalname] += 1
            if cases[item.parent.nodeid, item.originalname] > marker.args[0]:
                item.add_marker("full")


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


@pytest.fixture(scope="session", autouse=True)
def branches_keep_their_invariants():
    """Whatever branch a test follows is checked."""
    with pytest.MonkeyPatch.context() as patch:
        invariants.watch(patch)
        yield


@pytest.fixture(autouse=True)
def corrupting(request, monkeypatch):
    """Branches of a test so marked are not checked."""
    if request.node.get_closest_marker("corrupting"):
        monkeypatch.setattr(invariants.Watch, "on", False)


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


@pytest.fixture(params=["text", pytest.param("compiled", marks=pytest.mark.slow)])
def plain_and_program(request, plain_and_compiled, monkeypatch):
    """Run something plainly and as the text of a program; and compiled, among slow tests."""

    def both(run):
        plain = run()
        made = run_as_texts(monkeypatch)
        text = run()
        assert made
        return plain, text

    if request.param == "text":
        return both
    pytest.importorskip("numba", reason="the extra 'fast' is not installed")
    return plain_and_compiled


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


# Exact flights


def _bessel_series():
    """exp(cos x)/3 = [I_0(1) + 2 sum of I_k(1) cos k x]/3."""
    return mp.besseli(0, 1) / 3, [(k, 2 * mp.besseli(k, 1) / 3, 0) for k in range(1, 40)]


FORCINGS = {
    "cos(pi*t)": lambda: (0, [(1, 1, 0)]),
    "sin(pi*t)": lambda: (0, [(1, 0, 1)]),
    "cos(pi*t)**3": lambda: (0, [(1, mp.mpf(3) / 4, 0), (3, mp.mpf(1) / 4, 0)]),
    "cos(pi*t+0.3)+sin(4*pi*t)/5-1/8": lambda: (
        -mp.mpf(1) / 8,
        [(1, mp.cos(mp.mpf(0.3)), -mp.sin(mp.mpf(0.3))), (4, 0, mp.mpf(1) / 5)],
    ),
    "cos(pi*t)*cos(2*pi*t)*sin(3*pi*t)": lambda: (
        0,
        [(k, 0, mp.mpf(1) / 4) for k in (2, 4, 6)],
    ),
    "exp(cos(pi*t))/3": _bessel_series,
}
"""Forcing texts and, for each, mean and [(k, a_k, b_k), ...], known in closed form."""


def pair_flight(values, forcing, a, b, t0, v0, t1, v1):
    """Residual of an impact pair's flight and the sizes of its terms.

    Velocity and displacement from the integrals F1 and F2 of the forcing, as in equations (11) and
    (12) of the paper; the displacement is divided by the duration between impacts on one wall.
    """
    mean, series = FORCINGS[forcing]()
    length = values["M"] * values["omega"] ** 2 * values["s"] / (values["A"] * mp.pi**2)
    constant = values["M"] * values["g"] * mp.sin(values["beta"]) / values["A"] + mean
    wall = {"B": length / 2, "T": -length / 2}
    r = values["r"] if "r" in values else values[f"r_{a}"]
    after, dt = -r * v0, t1 - t0

    def once(t):
        return sum(
            (p * mp.sin(k * mp.pi * t) - q * mp.cos(k * mp.pi * t)) / (k * mp.pi)
            for k, p, q in series
        )

    def twice(t):
        return -sum(
            (p * mp.cos(k * mp.pi * t) + q * mp.sin(k * mp.pi * t)) / (k * mp.pi) ** 2
            for k, p, q in series
        )

    velocity = after + constant * dt + once(t1) - once(t0)
    shift = (after - once(t0)) * dt + constant * dt**2 / 2 + twice(t1) - twice(t0)
    position = shift / dt if a == b else wall[a] + shift - wall[b]
    pushes = [
        (mp.hypot(p, q) * min(dt / 2, 1 / (k * mp.pi)), mp.hypot(p, q) * min(dt, 2 / (k * mp.pi)))
        for k, p, q in series
    ]
    mean_size = abs(after) + abs(constant) * dt / 2 + sum(push[0] for push in pushes)
    position_size = mean_size if a == b else length + dt * mean_size
    velocity_size = abs(after) + abs(constant) * dt + sum(push[1] for push in pushes) + abs(v1)
    return [position, velocity - v1], [position_size, velocity_size]


def oscillator_flight(values, a, b, t0, v0, t1, v1):
    """Residual of an oscillator's flight (it has one wall) and the sizes of its terms.

    Steady response in complex amplitudes; the transient from the roots of s^2 + c s + k.
    """
    amplitude, w, c, k, sigma, r = (values[n] for n in ("a", "omega", "c", "k", "sigma", "r"))
    response = amplitude / mp.mpc(k - w**2, c * w)

    def steady(t):
        return mp.re(response * mp.expj(w * t)), mp.re(1j * w * response * mp.expj(w * t))

    dt = t1 - t0
    half = mp.sqrt(mp.mpc(c**2 / 4 - k))
    p0, rate0 = steady(t0)
    x, v = sigma - p0, -r * v0 - rate0
    decay = mp.exp(-c / 2 * dt)
    if half == 0:
        one, other = x, v + c / 2 * x
        now = decay * (one + other * dt)
        speed = decay * (other - c / 2 * (one + other * dt))
    else:
        one, other = x, (v + c / 2 * x) / half
        now = decay * (one * mp.cosh(half * dt) + other * mp.sinh(half * dt))
        speed = -c / 2 * now + decay * half * (
            one * mp.sinh(half * dt) + other * mp.cosh(half * dt)
        )
    p1, rate1 = steady(t1)
    position, velocity = mp.re(now) + p1, mp.re(speed) + rate1
    size = abs(x) + abs(v) + abs(response) * (1 + w) + abs(v1)
    return [(position - sigma) / dt, velocity - v1], [size / min(dt, 1), size]


def exact_flight(model, a, b, ends, changes=None):
    """Residual of a flight and the sizes of its terms, in mpmath, from the model's own doubles.

    Parameters
    ----------
    ends : (t0, v0, t1, v1)
    changes : dict, optional
        Parameter values to use in place of the model's.
    """
    values = {name: mp.mpf(value) for name, value in model.values.items()} | (changes or {})
    ends = [mp.mpf(end) for end in ends]
    if isinstance(model, ImpactPair):
        return pair_flight(values, model.options["forcing"], a, b, *ends)
    return oscillator_flight(values, a, b, *ends)


@pytest.fixture(scope="session")
def forcings():
    return FORCINGS


@pytest.fixture
def exact():
    """`exact_flight`, at 60 digits for as long as the test runs."""
    with mp.workdps(60):
        yield exact_flight
