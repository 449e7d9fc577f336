"""Arithmetics of one's own, from outside the package: complex numbers, for derivatives by an
imaginary step (Squire and Trapp, SIAM Review 40, 1998), and longer floats."""

import cmath
import math

import mpmath
import numpy as np
import pytest

from contimpact import InputError
from contimpact.bifurcations.extended_system import solve
from contimpact.bifurcations.kind import Equations, kind_of
from contimpact.orbits.search import find_orbits
from contimpact.segments.linear_flow import make_flow
from contimpact.segments.segment import FUNCTIONS, PLAIN, Arithmetic
from contimpact.systems.bouncing_ball import BouncingBall
from contimpact.systems.impact_damper import ImpactDamper
from contimpact.systems.impact_pair import ImpactPair

STEP = 1e-30


class Clock(complex):
    """The time of an impact, which a kernel reduces to the forcing's period."""

    def __mod__(self, period):
        return self - math.floor(self.real / complex(period).real) * period


def stumpff(k, q):
    """c_k by its power series, for the moderate arguments of short flights."""
    term = total = (0 * q + 1) / math.factorial(k)
    for j in range(1, 60):
        term *= -q / ((2 * j + k - 1) * (2 * j + k))
        total += term
    return total


COMPLEX = Arithmetic(
    {name: getattr(cmath, name) for name in FUNCTIONS if hasattr(cmath, name)}
    | {f"stumpff{k}": lambda q, k=k: stumpff(k, q) for k in range(8)}
    | {f"stumpffs{n}": lambda q, n=n: tuple(stumpff(k, q) for k in range(1, n + 1)) for n in (3, 5)}
    | PLAIN,
    number=complex,
    time=Clock,
)


@pytest.fixture(scope="module")
def here():
    return find_orbits(ImpactPair(beta=np.pi / 6, r=0.3, A=5.0, s=0.34), "BT", parameter="s")[
        0
    ].linearisation


def jacobian(system, x):
    """The derivatives of a system by imaginary steps, in which nothing cancels."""
    columns = [
        [row.imag / STEP for row in system([*x[:i], x[i] + 1j * STEP, *x[i + 1 :]])]
        for i in range(len(x))
    ]
    return np.array(columns).T


@pytest.mark.parametrize("kind", ["FB", "PD", "BP", "V", "T", "G"])
def test_events_are_linearised_by_imaginary_steps(here, kind):
    problem = here.problem
    details = {"flight": 0, "impact": 0, "wall": "B", "touch_time": 0.7}
    if kind == "V":
        del details["flight"]
    found = kind_of(kind).equations(problem, details)
    own = found.start(here)
    orbit = Equations(problem, COMPLEX)
    system, guess = kind_of(kind).in_many_digits(orbit, here.unknowns, details)
    assert len(guess) == len(own)
    by_steps = jacobian(system, [*here.unknowns.tolist(), *own.tolist()])
    size = np.max(np.abs(by_steps))
    assert found.assemble(here, own).jacobian == pytest.approx(
        by_steps, rel=1e-10, abs=1e-11 * size
    )


def exponential_series(one, z, product):
    """The sums of z^k/(k + 1)! and of (k + 1) z^k/(k + 2)!, of matrices smaller than one."""
    power, mean, slope = one, 0, 0
    for k in range(20):
        mean = mean + power / math.factorial(k + 1)
        slope = slope + power * ((k + 1) / math.factorial(k + 2))
        power = product(power, z)
    return mean, slope


def test_linear_flights_take_a_function_of_their_own():
    """Without `flow` in it the arithmetic is refused, and the message names what is missing."""
    damper = ImpactDamper(Omega=1.0, d=20.0, r=0.8, mu=0.1, zeta=0.01)
    orbit = find_orbits(damper, "RL", parameter="d")[0].linearisation
    kind, details = kind_of("T"), {"flight": 0}
    rest = COMPLEX.names | {"floor": lambda x: math.floor(x.real)}

    def by_steps(names):
        equations = Equations(orbit.problem, Arithmetic(names, number=complex, time=Clock))
        system, _ = kind.in_many_digits(equations, orbit.unknowns, details)
        return jacobian(system, orbit.unknowns.tolist())

    with pytest.raises(InputError, match="it has no flow, which the kernel flight_R_L uses"):
        by_steps(rest)
    found = by_steps(rest | {"flow": make_flow(exponential_series)})
    exact = kind.equations(orbit.problem, details).assemble(orbit, np.zeros(0)).jacobian
    assert exact == pytest.approx(found, rel=1e-10, abs=1e-11 * np.max(np.abs(found)))


LONG = np.longdouble
INVERSE = {f"a{name}": getattr(np, f"arc{name}") for name in ("sin", "cos", "tan")}
LONGER = Arithmetic(
    {name: getattr(np, name) for name in FUNCTIONS if name not in INVERSE}
    | {f"stumpff{k}": lambda q, k=k: stumpff(k, q) for k in range(8)}
    | {f"stumpffs{n}": lambda q, n=n: tuple(stumpff(k, q) for k in range(1, n + 1)) for n in (3, 5)}
    | {"pi": LONG("3.14159265358979323846264338327950288"), "ratio": lambda p, q: LONG(p) / LONG(q)}
    | INVERSE
    | PLAIN,
    exact=True,
    number=LONG,
)


def test_a_fold_is_solved_for_in_longer_floats():
    """Of the bouncing ball, in closed form: a omega^2 = pi g (1 - r)/(1 + r).

    Measured: 6e-19 from it with 80 bits, in place of 8e-16 with doubles.
    """
    omega, r, g = 2.0, 0.4, 9.0
    with mpmath.workdps(30):
        exact = mpmath.pi * g * (1 - mpmath.mpf(r)) / ((1 + mpmath.mpf(r)) * omega**2)
    ball = BouncingBall(a=1.001 * float(exact), omega=omega, r=r, g=g)
    here = find_orbits(ball, "1", parameter="a")[0].linearisation
    found = solve(kind_of("FB").equations(here.problem, {}), here)
    system, own = kind_of("FB").in_many_digits(Equations(here.problem, LONGER), found.unknowns, {})
    x = np.array([*found.unknowns, *found.own], dtype=LONG)
    assert len(own) == len(found.own)
    for _ in range(3):  # with the inverse in doubles each makes some twelve digits more
        residual = np.array(system(list(x)), dtype=LONG)
        x -= np.linalg.inv(found.at.jacobian).astype(LONG) @ residual
    with mpmath.workdps(30):
        off = mpmath.mpf(str(x[2])) - exact
    assert abs(off) < 20 * float(np.finfo(LONG).eps) * exact
