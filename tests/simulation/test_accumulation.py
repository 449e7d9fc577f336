"""Impacts that accumulate on a stop of two masses, and the sojourn after them, in thirty digits.

Where a jump leads away from its guard none accumulate, however slow they are.
"""

from __future__ import annotations

import itertools
import tomllib

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from zoo import ROOT

from contimpact.errors import InputError
from contimpact.results.scene import load_scene, read_scene
from contimpact.simulation.run import Outcome
from contimpact.simulation.simulator import Simulator
from contimpact.systems.two_masses import TwoMasses

VALUES = {
    "c1": 0.0,
    "c2": 0.0,
    "k1": 1.0,
    "k2": 0.6,
    "a1": 0.6,
    "omega": 0.5,
    "sigma_1": -0.4,
    "sigma_2": 50.0,
    "r": 0.6,
}


class Modal:
    """Two undamped masses of one, pressed against the first stop, in thirty digits."""

    def __init__(self, p):
        self.ctx = ctx = mpmath.mp.clone()
        ctx.dps = 30
        self.p = p = {name: ctx.mpf(str(value)) for name, value in p.items()}
        k1, k2 = p["k1"], p["k2"]
        squares, self.modes = ctx.eigsy(ctx.matrix([[k1 + k2, -k2], [-k2, k2]]))
        self.frequencies = [ctx.sqrt(w) for w in squares]

    def forced(self, w, push, t):
        """The response of an oscillator to a push by cos omega t, and its rate."""
        ctx, omega = self.ctx, self.p["omega"]
        size = push / (w * w - omega * omega)
        return size * ctx.cos(omega * t), -size * omega * ctx.sin(omega * t)

    def oscillated(self, w, push, t0, q, v, t):
        """An oscillator's place and velocity."""
        ctx = self.ctx
        (f0, g0), (f, g) = self.forced(w, push, t0), self.forced(w, push, t)
        c, s = ctx.cos(w * (t - t0)), ctx.sin(w * (t - t0))
        return f + (q - f0) * c + (v - g0) / w * s, g - w * (q - f0) * s + (v - g0) * c

    def flown(self, t0, x, v, t):
        """Places and velocities at t."""
        found = [self.ctx.matrix(2, 1), self.ctx.matrix(2, 1)]
        for i, w in enumerate(self.frequencies):
            mode = self.modes[:, i]
            q, u = (mode.T * self.ctx.matrix(part) for part in (x, v))
            q, u = self.oscillated(w, mode[0] * self.p["a1"], t0, q[0], u[0], t)
            found = [found[0] + q * mode, found[1] + u * mode]
        return found

    def force(self, t, x):
        """The acceleration of the first mass."""
        push = self.p["a1"] * self.ctx.cos(self.p["omega"] * t)
        return push - (self.p["k1"] + self.p["k2"]) * x[0] + self.p["k2"] * x[1]

    def accumulated(self, t, x, v):
        """The end of the impacts, from before one of them; place and velocity of mass two then."""
        sigma, r = self.p["sigma_1"], self.p["r"]
        while True:
            x, v = [sigma, x[1]], [-r * v[0], v[1]]
            dt = -2 * v[0] / self.force(t, x)
            if dt < 1e-14:
                dt /= 1 - r
                y, u = self.flown(t, x, v, t + dt)
                return t + dt, y[1], u[1]
            start = t
            t = self.ctx.findroot(
                lambda s, start=start, x=x, v=v: (
                    (self.flown(start, x, v, s)[0][0] - sigma) / (s - start)
                ),
                (t + dt, t + dt * (1 + self.ctx.mpf("1e-3"))),
            )
            y, u = self.flown(start, x, v, t)
            x, v = [y[0], y[1]], [u[0], u[1]]

    def released(self, t0, y, v):
        """When the force on the first mass, at rest on its stop, vanishes."""
        w, sigma = self.ctx.sqrt(self.p["k2"]), self.p["sigma_1"]

        def force(t):
            place, _ = self.oscillated(w, 0, t0, y - sigma, v, t)
            return self.force(t, [sigma, sigma + place])

        times = [t0 + k * self.ctx.mpf("0.01") for k in range(2000)]
        pair = next(p for p in itertools.pairwise(times) if force(p[0]) > 0 >= force(p[1]))
        return self.ctx.findroot(force, pair, solver="anderson")


def test_chatter_ends_and_sticking_is_released_when_thirty_digits_say():
    simulator = Simulator(TwoMasses(**VALUES))
    start = simulator.state("A", 0.1, 0.3, [0.2, -0.1])
    run = simulator.run(start, impacts=80)
    end = int(np.nonzero(run.released)[0][0])
    last, after = run.states()[end - 1], run.states()[end]
    exact = Modal(VALUES)
    when, y, v = exact.accumulated(exact.ctx.mpf("0.1"), [-0.4, 0.2], [0.3, -0.1])
    force = float(exact.force(exact.ctx.mpf(last.phase), [exact.p["sigma_1"], last.others[0]]))
    rest = 2.0 * 0.6 * last.velocity / (force * (1.0 - 0.6))
    assert 0.0 < rest < 1e-9 * simulator.period
    assert last.phase + rest == pytest.approx(float(when), abs=1e-14)
    assert run.turns[end] == 0
    assert after.phase == pytest.approx(float(exact.released(when, y, v)), abs=1e-14)
    assert after.held == 1
    assert simulator.run(after, impacts=1).held[0] == 0


AWAY = {"S": {"within": "x <= s", "set": {"x": "-s", "v": ".9*v"}}}
BACK = {"L": {"within": "x >= -s", "set": {"x": "s", "v": ".9*v"}}}
LAWS = {"sin(x)": np.sin, "0.1*x": lambda x: 0.1 * x}


def jumped(law, t, v, back):
    """The next passages (guard, time, velocity) after one of S, by SciPy's DOP853."""
    x, v, found = -2.0, 0.9 * v, []
    for _ in range(3):
        gaps = [lambda t, y: y[0] - 2.0, lambda t, y: -2.0 - y[0]]
        for gap in gaps:
            gap.terminal, gap.direction = True, 1

        def field(t, y):
            return [y[1], 1.5 * np.cos(0.8 * t) - LAWS[law](y[0]) - 0.1 * y[1]]

        tight = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
        end = solve_ivp(field, (t, t + 99.0), [x, v], events=gaps[: 1 + back], **tight)
        t, v, at = end.t[-1], end.y[1, -1], [len(times) for times in end.t_events].index(1)
        found.append(("SL"[at], t, v))
        x, v = (2.0 if at else -2.0), 0.9 * v
    return found


@pytest.mark.parametrize("mode", ["never", "always"])
@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("velocity", [0.0, 1e-10, 1.0])
@pytest.mark.quick(2)
def test_where_a_jump_leads_away_no_impacts_accumulate(velocity, law, back, mode, monkeypatch):
    """A slow one was held at the guard it had left, or ended the run; where the other guard is on
    the surface it leads to, plain runs stayed where they began."""
    pytest.importorskip("heyoka")
    monkeypatch.setenv("CONTIMPACT_COMPILED", mode)
    scene = {
        "name": "jumps",
        "model": {
            "system": "hybrid",
            "period": "2*pi/w",
            "parameters": {"w": 0.8, "a": 1.5, "s": 2.0},
            "modes": {"free": {"x": "v", "v": f"a*cos(w*t) - {law} - 0.1*v"}},
            "guards": AWAY | (BACK if back else {}),
        },
        "follow": {"parameter": "w", "range": [0.7, 0.9], "orbits": ["S"]},
    }
    simulator = Simulator(read_scene(scene).model)
    run = simulator.run(simulator.state("S", 0.3, velocity), impacts=3)
    walls, times, velocities = zip(*jumped(law, 0.3, velocity, back), strict=True)
    assert run.word == "".join(walls)
    assert run.turns * run.period + run.phases == pytest.approx(times, abs=1e-9)
    assert run.velocities == pytest.approx(velocities, abs=1e-9)


def test_a_run_ends_where_impacts_accumulate_on_guards_of_two_modes():
    """The bodies of COCO's example stick and slip in turn against the stop, for ever shorter: after
    some fifty periods time stood still, and runs and settling went on for ever."""
    pytest.importorskip("heyoka")
    model = load_scene(ROOT / "branches" / "coco_stick_slip" / "scene.toml").model
    simulator = Simulator(model.replace(V=0.6))
    start = simulator.random_state(np.random.default_rng(0))
    run = simulator.run(start, periods=100)
    assert run.outcome is Outcome.ACCUMULATING
    assert len(run) < 1000
    assert np.ptp(run.times[-100:]) < 1e-5


@pytest.mark.parametrize("other", ["", 'u = "v - u"'], ids=["one coordinate", "several"])
def test_a_reset_without_a_value_at_low_velocities_is_named(other):
    """The message was "model: math domain error at low velocity"."""
    scene = tomllib.loads(f"""
name = "fast"
model.system = "hybrid"
model.period = "2*pi"
model.parameters = {{ r = 0.5 }}
follow = {{ parameter = "r", range = [0.1, 0.9], orbits = ["S"] }}
[model.modes.m]
x = "v"
v = "cos(t) - x - v"
{other}
[model.guards.S]
within = "x <= 0"
set = {{ v = "-r*v*sqrt(v - 1/100)" }}
""")
    model = read_scene(scene).model
    with pytest.raises(
        InputError, match=r"model\.guards\.S: motion at low velocities has no value"
    ):
        Simulator(model)
