"""Every kernel of every system with closed forms or linear flights, in balls, at many arguments."""

from __future__ import annotations

import functools
import inspect

import numpy as np
import pytest
from zoo import ROOT, harmonic_pair

import contimpact
from contimpact.models.guards import following_letters
from contimpact.segments.kernel import SECTION, flat
from contimpact.segments.kernels import Kernels
from contimpact.segments.segment import Arithmetic, evaluate_in
from contimpact.systems.belt import Belt
from contimpact.systems.bouncing_ball import BouncingBall
from contimpact.systems.coupled_by_impact import CoupledByImpact
from contimpact.systems.impact_damper import ImpactDamper
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.soft_stop import SoftStop
from contimpact.systems.two_masses import TwoMasses
from contimpact.systems.two_stops import TwoStops

balls = pytest.importorskip("contimpact.segments.balls", reason="needs contimpact[certify]")
from fifty_digits import DIGITS, MP, REFERENCE, holds, reference  # noqa: E402
from flint import arb, ctx  # noqa: E402

from contimpact.segments.balls import number  # noqa: E402

PARTS, MANY, FEW = 20, 500, 2
"""Random arguments of a kernel: in each part of the tests that take minutes, and in the others."""
QUICK = (
    "impact pair",
    "harmonics",
    "light damping",
    "heavy damping",
    "bouncing ball",
    "two stops",
    "impact damper",
)


def three_masses():
    return contimpact.load_scene(ROOT / "examples" / "three_masses.toml").model


SYSTEMS = {
    "impact pair": (lambda: ImpactPair(beta=0.5, r=0.3, A=5.0, s=0.34), "s"),
    "harmonics": (
        lambda: harmonic_pair([(1, 1.0, 0.2), (3, 0.3, -0.4)], beta=0.2, r=0.6, A=4.0, s=0.4),
        "A",
    ),
    "light damping": (
        lambda: Oscillator(a=1.0, omega=2.0, c=0.1, k=1.0, sigma=0.3, r=0.8),
        "omega",
    ),
    "heavy damping": (
        lambda: Oscillator(a=1.0, omega=2.0, c=6.0, k=1.5, sigma=0.3, r=0.8),
        "sigma",
    ),
    "bouncing ball": (lambda: BouncingBall(a=0.014, omega=50.0, r=0.5, g=9.8), "a"),
    "two stops": (
        lambda: TwoStops(a=1.0, b=0.1, omega=1.7, c=0.1, k=0.3, sigma=0.5, r=0.7),
        "omega",
    ),
    "impact damper": (lambda: ImpactDamper(Omega=1.0, d=20.0, r=0.8, mu=0.1, zeta=0.01), "Omega"),
    "soft stop": (
        lambda: SoftStop(a=1.0, omega=2.0, c=0.1, k=1.0, e=0.5, k_b=20.0, c_b=0.3),
        "omega",
    ),
    "coupled by impact": (
        lambda: CoupledByImpact(
            m2=2.0, c1=0.1, c2=0.2, k1=1.0, k2=2.0, a1=1.0, omega=1.3, gap=0.2, r=0.7
        ),
        "omega",
    ),
    "two masses": (
        lambda: TwoMasses(
            c1=0.1, c2=0.05, k1=1.0, k2=0.6, a1=1.0, omega=1.8, sigma_1=1.0, sigma_2=1.0, r=0.8
        ),
        "omega",
    ),
    "belt": (lambda: Belt(a=0.2, omega=1.3, c=0.1, V=0.45, mu_0=0.4), "omega"),
    "three masses": (three_masses, "omega"),
}
"""Each with a free parameter; the frequency where there are enclosures of how motions depend on
it."""

RADII = (0.0, 0.0, 1e-30, 1e-12, 1e-6, 1e-3)
"""Of arguments, relative: a third of them are numbers, the others stand for all numbers nearby."""


@pytest.fixture(autouse=True)
def precision():
    before = ctx.prec, ctx.cap
    ctx.prec, ctx.cap = 128, 16
    yield
    ctx.prec, ctx.cap = before


@functools.cache
def kernels_of(system):
    make, free = SYSTEMS[system]
    return Kernels(make(), free)


def names_of(system):
    """The kernels that proofs evaluate."""
    guards = kernels_of(system).model.WALLS
    letters = [guard.name for guard in guards]
    first = kernels_of(system).model.MODES
    quiet = first[0].name if first else ""
    return [
        "setup",
        *(f"flight_{a}_{b}" for a in letters for b in following_letters(guards, a)),
        *(f"motion_{a}" for a in letters),
        *(f"gap_{a}_{b}" for a in letters for b in letters if a != b),
        *(f"flight_{SECTION}_{b.name}" for b in guards if quiet in b.modes),
        *(f"flight_{SECTION}_{periods}" for periods in (1, 2)),
        *(f"since_{a}" for a in letters),
    ]


def arguments(names, values, rng):
    """Random arguments, as balls and as exact numbers in them, at their ends as often as not.

    Times, durations, section coordinates and the model's parameters.
    """
    given = {name: rng.uniform(-1.5, 1.5) for name in names}
    given |= {f"p_{name}": value * rng.uniform(0.8, 1.2) for name, value in values.items()}
    given |= {"t0": rng.uniform(0.0, 4.0), "dt": 10.0 ** rng.uniform(-6.0, 0.7)}
    given["t1"] = given["t0"] + given["dt"]
    radii = rng.choice(RADII, len(given)) * np.abs(list(given.values()))
    within = rng.choice((-1.0, 1.0, rng.uniform(-1.0, 1.0)), len(given))
    ways = zip(given.items(), radii.tolist(), within.tolist(), strict=True)
    return {name: _ball_and_number(x, radius, u) for (name, x), radius, u in ways}


def _ball_and_number(x, radius, u):
    mpf = DIGITS.mpf
    return arb(x, radius), mpf(x) + mpf(radius) * mpf(u)


def missed(kernels, values, tries, seed, arithmetic=None):
    """How many of so many random arguments have results that are not in their enclosures.

    By kernel. All kernels have the same arguments, so that they share linear flights.
    """
    rng, found = np.random.default_rng(seed), dict.fromkeys(kernels, 0)
    enclosed, exact = remembering(arithmetic or balls.balls(128)), remembering(REFERENCE)
    both = {
        name: (evaluate_in(kernel, enclosed), evaluate_in(kernel, exact))
        for name, kernel in kernels.items()
    }
    of = {name: list(inspect.signature(kernel).parameters) for name, kernel in kernels.items()}
    names = sorted({name for each in of.values() for name in each})
    for _ in range(tries):
        at = arguments(names, values, rng)
        for name, (in_balls, in_digits) in both.items():
            wide, digits = zip(*_in_order(of[name], at), strict=True)
            found[name] += not all_hold(in_balls(*wide), in_digits(*digits))
    return found


def _in_order(names, at):
    """What a kernel takes: where it begins at zero, the time at its end is its duration."""
    for name in names:
        ball, exact = at["dt" if name == "t1" and "t0" not in names else name]
        yield balls.Time(ball) if name == "t0" else ball, exact


def all_hold(results, digits):
    pairs = zip(map(number, flat(results)), flat(digits), strict=True)
    return all(x.is_finite() and holds(x, y) for x, y in pairs)


def remembering(arithmetic):
    """An arithmetic that knows the last linear flights, of each shape and duration."""
    known = {}

    def flow(*given):
        key = tuple(map(_key, given))
        if key not in known:
            while len(known) > 3:
                known.pop(next(iter(known)))
            known[key] = arithmetic.names["flow"](*given)
        return known[key]

    return Arithmetic(arithmetic.names | {"flow": flow}, exact=True)


def _key(x):
    return (x.mid().man_exp(), x.rad().man_exp()) if isinstance(x, arb) else x


def all_missed(system, tries, seed):
    """By kernel."""
    kernels = kernels_of(system)
    named = {name: kernels.kernel(name) for name in names_of(system)}
    return missed(named, kernels.model.values, tries, seed)


@pytest.mark.parametrize("system", QUICK)
@pytest.mark.quick(1)
def test_enclosures_of_every_kernel_hold_fifty_digits(system):
    found = all_missed(system, FEW, 1)
    assert set(found.values()) == {0}, found


@pytest.mark.parametrize("system", ["bouncing ball", "light damping", "impact damper"])
def test_both_kinds_of_fifty_digits_agree(system):
    """Those of MPFR, with which bulk is quick, and those of mpmath."""
    pytest.importorskip("gmpy2", reason="needs gmpy2")
    kernels, rng = kernels_of(system), np.random.default_rng(2)
    for kernel in map(kernels.kernel, names_of(system)):
        names = list(inspect.signature(kernel).parameters)
        at = arguments(names, kernels.model.values, rng)
        floats = [float(exact) for _, exact in _in_order(names, at)]
        one, other = (
            flat(evaluate_in(kernel, reference(digits))(*map(digits.mpf, floats)))
            for digits in (DIGITS, MP)
        )
        for x, y in zip(one, other, strict=True):
            assert abs(MP.mpf(str(x)) - y) <= 1e-45 * (1 + abs(y))


@pytest.mark.slow
@pytest.mark.parametrize("part", range(PARTS))
@pytest.mark.parametrize("system", SYSTEMS)
def test_enclosures_of_every_kernel_hold_fifty_digits_at_many_arguments(system, part):
    found = all_missed(system, MANY, [7, part])
    assert set(found.values()) == {0}, found


@pytest.mark.parametrize(
    ("system", "function"),
    [
        ("impact pair", "cos"),
        ("light damping", "transients"),
        ("two stops", "flow"),
        ("impact damper", "flow"),
    ],
)
def test_results_rounded_to_the_nearest_are_missed(system, function):
    """A function that forgets the radii of its results."""
    names = balls.balls(128).names
    bare = {name: without_radii(f) for name, f in names.items() if name.startswith(function)}
    kernels = kernels_of(system)
    name = next(name for name in names_of(system) if "flight" in name)
    kernel = {name: kernels.kernel(name)}
    found = missed(kernel, kernels.model.values, 12, 3, Arithmetic(names | bare, exact=True))
    assert found[name] > 0


def without_radii(function):
    def bare(*given):
        found = function(*given)
        return found.mid() if isinstance(found, arb) else [x.mid() for x in found]

    return bare
