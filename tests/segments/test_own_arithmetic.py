"""An arithmetic of one's own, from outside the package: complex numbers, for derivatives by an
imaginary step (Squire and Trapp, SIAM Review 40, 1998)."""

import cmath
import math

import numpy as np
import pytest

from contimpact.bifurcations.kind import Equations
from contimpact.bifurcations.registry import kind_of
from contimpact.orbits.search import find_orbits
from contimpact.segments.arithmetic import FUNCTIONS, PLAIN, Arithmetic
from contimpact.systems.impact_pair import ImpactPair

STEP = 1e-30


class Clock(complex):
    """The time of an impact, which a kernel reduces to the forcing's period."""

    def __mod__(self, period):
        return self - math.floor(self.real / period) * period


def stumpff(k, q):
    """c_k by its power series, for the moderate arguments of short flights."""
    term = total = 1.0 / math.factorial(k)
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
