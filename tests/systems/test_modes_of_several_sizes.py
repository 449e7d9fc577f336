"""Modes of different dimension: a body on a belt, which slips by two numbers and sticks by one."""

from __future__ import annotations

import math

import numpy as np
import pytest
import sympy
from scipy.integrate import solve_ivp
from zoo import example

from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.errors import InputError
from contimpact.models.guards import Guard, Mode
from contimpact.models.linear import Linear
from contimpact.models.model import Formulas, Model, Parameter
from contimpact.orbits.search import find_orbits
from contimpact.segments.checking import check_model

Belt = example("belt").Belt


VALUES = {"a": 0.2, "omega": 1.3, "c": 0.1, "V": 0.3, "mu": 0.3, "mu_s": 0.5}


@pytest.fixture(scope="module")
def orbit():
    """Stick and slip once in a period."""
    (found,) = find_orbits(Belt(**VALUES), "PS", parameter="omega")
    return found


def slip_and_stick(start, values):
    """From the start of a slip, its position on the surface: when it ends, x' - V and x'' before,
    and when the next one starts; by integration of the body's own position."""
    a, w, c, V, mu, mu_s = (values[n] for n in ("a", "omega", "c", "V", "mu", "mu_s"))
    exact = {"method": "DOP853", "rtol": 3e-14, "atol": 1e-15}
    x = mu_s - c * V + a * math.cos(w * start)

    def slipping(t, y):
        return [y[1], a * math.cos(w * t) - c * y[1] - y[0] + mu]

    def as_fast(t, y):
        return y[1] - V

    def held(t, y):
        return y[0] + c * V - a * math.cos(w * t) - mu_s

    as_fast.terminal, as_fast.direction, held.terminal = True, 1.0, True
    slip = solve_ivp(slipping, (start, start + 20.0), [x, V], events=as_fast, **exact)
    end, (x, v) = slip.t[-1], slip.y[:, -1]
    approach = slipping(end, [x, v])[1]
    assert abs(mu - approach) < mu_s  # it sticks
    stick = solve_ivp(lambda t, y: [V], (end, end + 20.0), [x], events=held, **exact)
    return end, approach, stick.t[-1]


def test_what_is_stated_agrees():
    assert check_model(Belt(**VALUES)) == [
        "period",
        "flight from P",
        "flight from S",
        "passage at P",
        "passage at S",
    ]


def test_a_law_of_first_order_that_contradicts_its_flight_is_found():
    class Slower(Belt):
        def formulas(self, symbols):
            found = super().formulas(symbols)
            found.acceleration["stick"] = lambda t, x, v: [symbols["V"]]
            return found

    with pytest.raises(InputError, match=r"flight from 'S' in the mode 'stick': its mean"):
        check_model(Slower(**VALUES))


def test_stick_and_slip_against_integration(orbit):
    (slip, _), (stick, approach) = orbit.linearisation.problem.impacts(orbit.unknowns)
    end, speed, again = slip_and_stick(slip, VALUES)
    assert orbit.linearisation.verdict.physical
    assert (end, speed) == pytest.approx((stick, approach), abs=1e-10)
    assert again - slip == pytest.approx(2.0 * math.pi / VALUES["omega"], abs=1e-10)


def test_one_multiplier_is_zero_and_the_other_that_of_the_map_of_times(orbit):
    lost, kept = sorted(orbit.multipliers, key=abs)
    assert lost == 0.0
    start, step = orbit.unknowns[0], 1e-4
    ahead, behind = (slip_and_stick(start + h, VALUES)[2] for h in (step, -step))
    assert kept == pytest.approx((ahead - behind) / (2.0 * step), abs=1e-6)


@pytest.mark.full
def test_along_a_branch(orbit):
    """An isola, physical where the body comes up to the belt's speed from below."""
    branch = continue_orbit(orbit, "omega", (0.6, 1.6), events=["FB", "PD", "G", "V"])
    assert {end.kind.name for end in branch.ends} == {"CLOSED"}
    columns = branch.columns
    assert np.all(columns["multiplier2_re"] == 0.0)
    assert np.all(columns["multiplier2_im"] == 0.0)
    assert np.array_equal(columns["physical"] == 1, columns["v2"] >= -1e-12)
    slow, fast = sorted(branch.events, key=lambda e: e.parameters["omega"])
    assert (slow.kind, fast.kind, slow.becomes, fast.becomes) == ("V", "V", None, None)
    row = int(np.argmin(np.abs(columns["omega"] - 0.9)))
    omega, start, stick, approach = (columns[n][row] for n in ("omega", "t1", "t2", "v2"))
    end, speed, again = slip_and_stick(start, VALUES | {"omega": omega})
    assert (end, speed) == pytest.approx((stick, approach), abs=1e-10)
    assert again - start == pytest.approx(2.0 * math.pi / omega, abs=1e-10)


class Docking(Model):
    """Two oscillators that join where they meet (K), and part where the first comes back (R)."""

    SYSTEM = "docking"
    DEGREES_OF_FREEDOM = 2
    MODES = (Mode("apart"), Mode("joined", 1))
    WALLS = (
        Guard("K", side=+1, mode="apart", to="joined", coordinate=(1, -1)),
        Guard("R", side=-1, mode="joined", to="apart", coordinate=0),
    )
    PARAMETERS = tuple(
        Parameter(name, "", f"the parameter {name}")
        for name in ("a", "omega", "m", "c", "k", "gap", "e")
    )

    def formulas(self, symbols):
        a, omega, m, c, k, gap, e = symbols.values()

        def force(t):
            return a * sympy.cos(omega * t)

        period = 2 * sympy.pi / omega
        apart = Linear(
            mass=[[1, 0], [0, m]],
            damping=[[c, 0], [0, c]],
            stiffness=[[1, 0], [0, k]],
            force=lambda t: [force(t), 0],
            period=period,
        )
        joined = Linear(
            mass=[[1 + m]],
            damping=[[2 * c]],
            stiffness=[[1 + k]],
            force=lambda t: [force(t) + k * gap],
            period=period,
        )

        def jump(guard, x, v):
            if guard == "K":
                return [x[0]], [(v[0] + m * v[1]) / (1 + m)]
            return [x[0], x[0] - gap], [v[0], v[0]]

        return Formulas(
            period=period,
            walls={"K": gap, "R": e},
            jump=jump,
            flight={"apart": apart.flight, "joined": joined.flight},
            acceleration={"apart": apart.acceleration, "joined": joined.acceleration},
        )


DOCK = {"a": 1.0, "omega": 0.8, "m": 1.5, "c": 0.2, "k": 1.0, "gap": 0.2, "e": 0.3}


@pytest.fixture(scope="module")
def docked():
    """Joined for a part of each period."""
    found = find_orbits(Docking(**DOCK), "KR", parameter="omega", starts=64)
    (one,) = (o for o in found if o.linearisation.verdict.physical)
    return one


def around(start, x, v):
    """From a joined state, over a period: the state, and both impacts on the way."""
    a, w, m, c, k, gap, e = DOCK.values()
    exact = {"method": "DOP853", "rtol": 3e-14, "atol": 1e-15}
    last = start + 2.0 * math.pi / w

    def joined(t, y):
        push = a * math.cos(w * t) - 2 * c * y[1] - y[0] - k * (y[0] - gap)
        return [y[1], push / (1 + m)]

    def apart(t, y):
        one = a * math.cos(w * t) - c * y[1] - y[0]
        return [y[1], one, y[3], (-c * y[3] - k * y[2]) / m]

    def back(t, y):
        return y[0] - e

    def met(t, y):
        return y[0] - y[2] - gap

    back.terminal, back.direction, met.terminal, met.direction = True, -1.0, True, 1.0
    one = solve_ivp(joined, (start, last), [x, v], events=back, **exact)
    t, (x, v) = one.t[-1], one.y[:, -1]
    release = [t, v, 0.0, 0.0]
    two = solve_ivp(apart, (t, last), [x, v, x - gap, v], events=met, **exact)
    t, (x, v, y, u) = two.t[-1], two.y[:, -1]
    three = solve_ivp(joined, (t, last), [x, (v + m * u) / (1 + m)], **exact)
    return three.y[:, -1], [t, v - u, y, u], release


def test_bodies_that_join_against_integration(docked):
    meeting, release = docked.linearisation.problem.impacts(docked.unknowns)
    assert np.all(np.abs(release[2:]) < 1e-300)  # of a body that has no motion of its own
    kernel = docked.problem.kernels.gap("K", "R")
    start = release[0] - 0.3
    values = docked.problem.values(docked.unknowns)
    x, v, _ = kernel(*meeting.tolist(), start - meeting[0], *values)
    period = 2.0 * math.pi / DOCK["omega"]
    state, met, released = around(start, x, v)
    assert state == pytest.approx((x, v), abs=1e-10)
    assert released == pytest.approx(release, abs=1e-10)
    assert (met[0] - period, *met[1:]) == pytest.approx(meeting, abs=1e-10)
    assert np.count_nonzero(docked.multipliers == 0.0) == 2
    step = 1e-5
    rows = [
        (around(start, x + h, v + k)[0] - around(start, x - h, v - k)[0]) / (2.0 * step)
        for h, k in ((step, 0.0), (0.0, step))
    ]
    assert np.poly(docked.multipliers[:2]).real == pytest.approx(np.poly(np.array(rows)), abs=1e-6)


@pytest.mark.full
def test_along_a_branch_of_bodies_that_join(docked):
    branch = continue_orbit(docked, "e", (0.2, 0.4), events=["FB", "PD", "NS", "G"])
    for i in (3, 4):
        assert np.all(branch.columns[f"multiplier{i}_re"] == 0.0)
        assert np.all(branch.columns[f"multiplier{i}_im"] == 0.0)
    assert {end.kind.name for end in branch.ends} == {"RANGE"}
