"""Bounds of rounding errors against many digits: of kernels, and of the events found with them."""

from __future__ import annotations

import importlib.util
import math
from fractions import Fraction

import numpy as np
import pytest
from zoo import ROOT

from contimpact.accuracy.reference import Reference
from contimpact.bifurcations.kind import test_functions as make_tests
from contimpact.continuation.branch import UserFunction
from contimpact.continuation.settings import Settings
from contimpact.diagrams.orbit_walks import walk_both_ways
from contimpact.models.guards import Word
from contimpact.orbits.problem import OrbitProblem
from contimpact.orbits.search import find_orbits
from contimpact.segments.bounded import BoundedNumber, bounds_of_kernel
from contimpact.segments.kernel import flat
from contimpact.segments.kernels import Kernels
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator

KINDS = ("FB", "BP", "PD", "NS", "G", "V", "T", "UZ")


def test_a_difference_of_near_numbers_keeps_the_errors_of_its_terms():
    third = BoundedNumber(1.0) / 3
    left = third * 3 - 1
    assert abs(Fraction(third.value) - Fraction(1, 3)) <= Fraction(third.error)
    assert abs(left.value) <= left.error


def test_whole_turns_are_exact_and_their_length_is_not():
    turned = BoundedNumber(1e6) % (2 * BoundedNumber(math.pi, 1e-16))
    assert 1e5 * 1e-16 < turned.error < 1e-8


def bouncing_ball():
    path = ROOT / "examples" / "bouncing_ball.py"
    spec = importlib.util.spec_from_file_location("bouncing_ball", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.BouncingBall(a=1.3 * 9.8 / 2500, omega=50.0, r=0.5)


MODELS = {
    "pair": lambda: ImpactPair(beta=0.7, r_B=0.3, r_T=0.8, A=5.0, s=0.389),
    "rich pair": lambda: ImpactPair(
        beta=0.2, r=0.3, A=5.0, s=0.389, forcing="cos(pi*t)+0.3*sin(7*pi*t)+0.1"
    ),
    "oscillator": lambda: Oscillator(a=1.0, omega=1.7, c=0.3, k=1.0, sigma=0.4, r=0.8),
    "resonance": lambda: Oscillator(a=1.0, omega=1.0, c=0.1, k=1.0, sigma=1.0, r=0.8),
    "overdamped": lambda: Oscillator(a=1.0, omega=1.7, c=40.0, k=1.0, sigma=0.01, r=0.8),
    "heavily overdamped": lambda: Oscillator(a=1e8, omega=1.7, c=1e8, k=1.0, sigma=0.3, r=0.8),
    "bouncing ball": bouncing_ball,
}


@pytest.mark.parametrize("name", MODELS)
def test_no_kernel_is_off_by_more_than_its_bound(name):
    model = MODELS[name]()
    parameter = next(iter(model.values))
    walls = "".join(w.name for w in model.WALLS)
    problem = OrbitProblem(model, Word(walls), Kernels(model, parameter))
    exact = Reference(problem, 40)
    rng = np.random.default_rng(0)
    ratios = []
    for a, b in problem.kinds:
        for _ in range(10):
            t0, v0, v1 = rng.normal(size=3).tolist()
            point = [t0, v0, t0 + rng.uniform(0.05, 5.0), v1, *model.values.values()]
            values, bounds = bounds_of_kernel(problem.kernels.flight(a, b), point)
            truth = exact.kernel(a, b)(*map(exact.ctx.mpf, point))
            off = [abs(float(t - v)) for t, v in zip(flat(truth), flat(values), strict=True)]
            pairs = list(zip(off, flat(bounds), strict=True))
            assert all(o <= bound for o, bound in pairs)
            ratios += [o / bound for o, bound in pairs if bound]
    assert 0.005 < np.median(ratios) < 0.5  # bounds, but not useless ones


# Events of random branches, every kind, located by Newton's method and by bracketing.


def random_pair(rng):
    waves = "".join(
        f"{rng.uniform(-0.4, 0.4):+.2f}*{wave}({rng.integers(2, 6)}*pi*t)"
        for wave in rng.choice(["sin", "cos"], rng.integers(0, 3))
    )
    ends = {"r": rng.uniform(0.05, 0.95)}
    if rng.random() < 0.4:
        ends = {f"r_{wall}": rng.uniform(0.05, 0.95) for wall in "BT"}
    model = ImpactPair(
        beta=rng.choice([0.0, rng.uniform(-1.5, 1.5)]),
        A=rng.uniform(2, 12),
        s=rng.uniform(0.1, 0.8),
        forcing=f"cos(pi*t){waves}",
        **ends,
    )
    reach = {"s": (0.05, 1.2), "A": (1.0, 20.0), "beta": (-1.5, 1.5)}
    return (
        model,
        ["1:1", "2:1", "1:1/2T", "1:0", "2:2/2T"],
        reach | dict.fromkeys(ends, (0.01, 0.99)),
    )


def random_oscillator(rng):
    model = Oscillator(
        a=rng.uniform(0.2, 2),
        omega=rng.uniform(0.5, 3),
        c=rng.uniform(-0.2, 0.5),
        k=rng.choice([1.0, rng.uniform(0.2, 4)]),
        sigma=rng.uniform(-0.5, 1.0),
        r=rng.uniform(0.1, 0.95),
    )
    reach = {
        "a": (0.05, 3.0),
        "omega": (0.3, 5.0),
        "c": (-0.5, 6.0),
        "sigma": (-1.0, 1.5),
        "r": (0.01, 0.99),
        "k": (0.1, 5.0),
    }
    return model, ["S", "SS", "S/2T", "S/3T"], reach


def random_ball(rng):
    model = bouncing_ball().replace(r=rng.uniform(0.1, 0.9), a=rng.uniform(0.8, 2) * 9.8 / 2500)
    return model, ["1", "2", "1/2T"], {"a": (0.001, 0.02), "omega": (20.0, 90.0), "r": (0.05, 0.95)}


USERS = {
    "speed": lambda z, wanted: z[1] - wanted,
    "product": lambda z, wanted: z[1] * z[1] - wanted,
    "time": lambda z, wanted: z[0] - wanted,
}


def truly(exact, event, wanted):
    """The event's parameter in many digits, or None."""
    if event.kind not in USERS:
        found = exact.event(event.kind, event.point.unknowns, event.details)
        return found.parameter if found else None
    function = USERS[event.kind]

    def system(x):
        return [*exact.residual(x), function(x, wanted[event.kind])]

    found = exact._solve(system, event.point.unknowns.tolist())
    return found[0][-1] if found else None


def ratios_of(seed):
    """Kind, method and true error over reported error of the events of two random branches."""
    rng = np.random.default_rng(seed)
    model, words, reach = [random_pair, random_oscillator, random_ball][seed % 3](rng)
    parameter = str(rng.choice(list(reach)))
    value = model.values[parameter]
    low, high = min(reach[parameter][0], value), max(reach[parameter][1], value)
    kernels = Kernels(model, parameter)
    found = find_orbits(model, str(rng.choice(words)), kernels=kernels, starts=32, rounds=2)
    for orbit in found[:2]:
        wanted = {
            n: float(f(orbit.unknowns, 0.0) * rng.uniform(0.7, 1.3)) for n, f in USERS.items()
        }
        users = [
            UserFunction(name, lambda p, f=f, w=wanted[name]: f(p.unknowns, w))
            for name, f in USERS.items()
        ]
        derived = {
            n: [v] for n, v in orbit.derived.items() if orbit.problem.kernels.depends("setup")
        }
        tests = make_tests(orbit.problem, KINDS, {parameter: [0.5 * (low + high)], **derived})
        run = walk_both_ways(
            orbit.problem, orbit.unknowns, (low, high), tests + users, Settings(max_points=200)
        )
        exact = Reference(orbit.problem)
        for event in run.events:
            truth = truly(exact, event, wanted)
            if truth is not None:
                off = abs(float(truth - event.parameter))
                yield event.kind, event.method, off / event.error if event.error else 1e9 * off


def check(seeds):
    rows = [row for seed in seeds for row in ratios_of(seed)]
    assert not [row for row in rows if not row[2] <= 0.8]
    return rows


@pytest.mark.full
def test_reported_errors_are_bounds():
    rows = check([3, 14, 19, 23, 32])
    assert len(rows) >= 30
    assert {method for _, method, _ in rows} == {"newton", "bracket"}


@pytest.mark.slow
def test_reported_errors_are_bounds_at_hundreds_of_random_events():
    """Every kind but the rarest, T; the median keeps the bounds from being useless."""
    rows = check(range(60))
    assert len(rows) >= 300
    assert {kind for kind, _, _ in rows} >= {*KINDS, *USERS} - {"T", "NS", "BP"}
    assert np.median([ratio for _, _, ratio in rows]) > 1e-3
