"""Systems stated by two vector fields and a surface; sliding is derived."""

from __future__ import annotations

import math

import numpy as np
import pytest
import sympy
from scipy.integrate import solve_ivp
from zoo import adding_sliding

import contimpact as ci
from contimpact.errors import InputError
from contimpact.models.filippov import Filippov
from contimpact.models.model import Model, Parameter
from contimpact.models.switching import switching_guards, switching_modes
from contimpact.simulation.simulator import Simulator
from contimpact.systems.belt import Belt

VALUES = {"a": 0.54, "omega": 0.5, "c": 0.1, "V": 0.1, "mu_0": 0.5}


class Stated(Model):
    """The body on the belt, by its position and velocity."""

    SYSTEM = "stated-belt"
    DEGREES_OF_FREEDOM = 2
    MODES = switching_modes(2)
    WALLS = switching_guards(1)
    PARAMETERS = tuple(Parameter(name, "", name) for name in VALUES)

    def formulas(self, symbols):
        a, omega, c, V, mu = symbols.values()

        def field(sign):
            return lambda t, x: [
                x[1],
                a * sympy.cos(omega * t) - c * x[1] - self.spring(x[0]) - sign * mu,
            ]

        return Filippov(field(-1), field(1), (0, 1), V, 2 * sympy.pi / omega).formulas()

    def spring(self, x):
        return x


class Hardening(Stated):
    SYSTEM = "hardening-belt"

    def spring(self, x):
        return x + x**3


class Relay(Model):
    """A relay that switches where x + y/2 changes sign, and takes two states down differently."""

    SYSTEM = "relay"
    DEGREES_OF_FREEDOM = 2
    MODES = switching_modes(2)
    WALLS = switching_guards(0)
    PARAMETERS = tuple(Parameter(name, "", name) for name in ("a", "omega", "k"))

    def formulas(self, symbols):
        a, omega, k = symbols.values()

        def field(sign):
            return lambda t, x: [
                x[1] - sign * k,
                a * sympy.cos(omega * t) - x[0] - x[1] / 5 + sign * k / 2,
            ]

        return Filippov(field(-1), field(1), (1, 0.5), 0, 2 * sympy.pi / omega).formulas()


def one(kind, word, **values):
    model = kind(**VALUES | values)
    found = ci.find_orbits(model, word, parameter="a", starts=20, rounds=1)
    return next(orbit for orbit in found if orbit.physical)


@pytest.mark.parametrize(("word", "a", "zeros"), [("PS", 0.54, 3), ("PSAB", 0.6, 3), ("0", 0.1, 2)])
@pytest.mark.full
def test_it_is_the_belt(word, a, zeros):
    """Orbits and multipliers; the directions that there are not have the multiplier zero."""
    found, truth = one(Stated, word, a=a), one(Belt, word, a=a)
    assert found.times == pytest.approx(truth.times, abs=1e-12)
    kept = found.multipliers[: 4 - zeros]
    assert np.sort_complex(kept) == pytest.approx(
        np.sort_complex(truth.multipliers[: 4 - zeros]), abs=1e-11
    )
    assert np.all(found.multipliers[4 - zeros :] == 0.0)
    if word != "0":
        places = [k for k, letter in enumerate(word) if letter in "SB"]
        assert found.velocities[places] == pytest.approx(truth.velocities[places], abs=1e-12)


@pytest.mark.full
def test_its_sliding_bifurcations_are_the_belts():
    ends = []
    for kind in (Stated, Belt):
        branch = ci.continue_orbit(one(kind, "PS"), "a", (0.53, 0.56), events=["G"])
        ends.append([(e.label, e.sliding, e.criticality) for e in branch.events])
        (event,) = branch.events
        a, *_, touch = adding_sliding(VALUES, [event.value, *event.times, event.touch_time])
        assert abs(event.value - a) <= event.error < 1e-13
        assert event.touch_time == pytest.approx(float(touch), abs=1e-12)
    assert ends[0] == ends[1] == [("G[PS->PSAB]", "adding-sliding", "supercritical")]


def filippov_by_integration(t, x, a, omega, k, impacts):
    """Letters and times of a relay, from a state at which it comes to sliding."""
    n = np.array([1.0, 0.5])

    def field(sign, t, x):
        push = a * math.cos(omega * t)
        return np.array([x[1] - sign * k, push - x[0] - x[1] / 5 + sign * k / 2])

    def rates(t, x):
        return n @ field(-1, t, x), n @ field(1, t, x)

    def slide(t, x):
        low, high = rates(t, x)
        u = (low + high) / (low - high)
        return 0.5 * (field(-1, t, x) * (1 - u) + field(1, t, x) * (1 + u))

    mode, made = 0, []
    while len(made) < impacts:
        if mode == 0:
            events = [lambda t, x: rates(t, x)[0], lambda t, x: rates(t, x)[1]]
            flow, more = slide, {"max_step": 0.02}
        else:
            events = [lambda t, x, begin=t, mode=mode: n @ x if t > begin else mode]
            flow, more = (lambda t, x, mode=mode: field(mode, t, x)), {"first_step": 1e-5}
        for event in events:
            event.terminal, event.direction = True, -mode if mode else 0.0
        part = solve_ivp(
            flow, (t, t + 60), x, "DOP853", events=events, rtol=3e-14, atol=1e-15, **more
        )
        assert part.status == 1
        t, x = float(part.t[-1]), part.y[:, -1]
        if mode == 0:
            mode = -1 if len(part.t_events[0]) else 1
            made.append(("P" if mode < 0 else "A", t))
        else:
            low, high = rates(t, x)
            slides = low > 0.0 > high
            made.append(((("S" if slides else "C") if mode < 0 else ("B" if slides else "D")), t))
            mode = 0 if slides else -mode
    return made


@pytest.mark.full
def test_a_relay_against_integration():
    """On an oblique surface: sliding, its ends, and passages."""
    values = {"a": 1.2, "omega": 0.6, "k": 0.8}
    simulator = Simulator(Relay(**values))
    y, t = -0.1, 0.4  # on the surface x = -y/2, below it before
    low = (
        y
        + values["k"]
        + 0.5 * (values["a"] * math.cos(values["omega"] * t) + y / 2 - y / 5 - values["k"] / 2)
    )
    speed_y = values["a"] * math.cos(values["omega"] * t) + y / 2 - y / 5 - values["k"] / 2
    run = simulator.run(simulator.state("S", t, low, (y, speed_y)), impacts=12)
    made = filippov_by_integration(t, [-y / 2, y], **values, impacts=12)
    assert run.word == "".join(letter for letter, _ in made)
    assert {*run.word} == {*"ACD"}
    assert run.times == pytest.approx([when for _, when in made], abs=1e-9)


@pytest.mark.full
def test_integrated_flights():
    """A spring that hardens: slip has no closed form."""
    pytest.importorskip("heyoka", reason="needs contimpact[ode]")
    orbit = one(Hardening, "PS", a=0.3)
    assert np.count_nonzero(orbit.multipliers) == 1
    times, period = orbit.times, 2 * math.pi / VALUES["omega"]
    V, mu, w = VALUES["V"], VALUES["mu_0"], VALUES["omega"]
    x = orbit.unknowns[2]

    def slips(t, y):
        return [y[1], 0.3 * math.cos(w * t) - 0.1 * y[1] - y[0] - y[0] ** 3 + mu]

    def comes(t, y, begin=times[0]):
        return y[1] - V if t > begin else -1.0

    comes.terminal, comes.direction = True, 1.0
    part = solve_ivp(
        slips, (times[0], times[0] + period), [x, V], "DOP853", events=comes, rtol=1e-13, atol=1e-14
    )
    assert part.t[-1] == pytest.approx(times[1], abs=1e-10)
    back = part.y[0, -1] + V * (times[0] + period - times[1])
    assert back == pytest.approx(x, abs=1e-10)
    force = back + back**3 + 0.1 * V - 0.3 * math.cos(w * times[0])
    assert force == pytest.approx(mu, abs=1e-10)


def test_what_is_refused():
    def field(sign):
        return lambda t, x: [x[1], -x[0] - sign * (1 + sympy.cos(t) / 2)]

    with pytest.raises(InputError, match="the fields differ across it by"):
        Filippov(field(-1), field(1), (0, 1), 0, 2 * sympy.pi)
