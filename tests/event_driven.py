"""Random hybrid scenes, and their orbits by an event-driven integration of the scene's own text.

Nothing of the package is used: a flight is integrated by DOP853, from the state that a guard's
`set` leaves to where the next guard's surface is reached, and looked at for what the scene forbids.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np
import sympy
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar

TIGHT = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13, "dense_output": True}
NEAR = 1e-8
"""Gaps and rates nearer to zero than this decide nothing."""
LOOKS = 300
"""At how many instants of a flight a gap is looked at before its minima are closed in."""


def random_scene(seed):
    """Two or three modes, guards on velocities or positions; a table as of TOML."""
    draw = np.random.default_rng(seed)
    kind = ("slip", "stick", "position", "wall")[seed % 4]
    between = {
        "a": (0.8, 1.5),
        "w": (0.5, 1.6),
        "z": (0.03, 0.2),
        "F": (0.1, 0.4),
        "H": (0.1, 0.4),
        "V": (-0.15, 0.15),
        "e": (-0.3, 0.6),
        "r": (0.4, 0.9),
        "k": (0.5, 4.0),
        "n": (0.0, 0.4),
    }
    p = {name: round(float(draw.uniform(*limits)), 3) for name, limits in between.items()}
    cubic = " - n*x**3" if seed % 8 >= 4 else ""
    force = f"a*cos(w*t) - x{cubic} - 2*z*v"
    word, parameter = "AB", str(draw.choice(["w", "a", "F", "z"]))
    if kind == "slip":
        modes = {"up": {"x": "v", "v": f"{force} - F"}, "down": {"x": "v", "v": f"{force} + H"}}
        guards = {
            "A": {"mode": "up", "within": "v >= V", "to": "down"},
            "B": {"mode": "down", "within": "v <= V", "to": "up"},
        }
    elif kind == "stick":
        rate = "-a*w*sin(w*t)"
        law = {"v": "u", "u": f"{rate} - v - 2*z*u"}
        modes = {"forward": law, "stick": {"f": rate}, "backward": law}
        # f is what holds the body: at most F, at least -F; the speed vanishes where it sticks
        guards = {
            "S": {"mode": "forward", "within": "v >= 0", "to": "stick", "set": {"f": "u + F"}},
            "P": {
                "mode": "stick",
                "within": "f <= F",
                "to": "forward",
                "set": {"v": 0, "u": 0},
            },
            "A": {
                "mode": "stick",
                "within": "f >= -F",
                "to": "backward",
                "set": {"v": 0, "u": 0},
            },
            "B": {"mode": "backward", "within": "v <= 0", "to": "stick", "set": {"f": "u - F"}},
            "C": {
                "mode": "forward",
                "within": "v >= 0",
                "to": "backward",
                "set": {"u": "u + 2*F"},
                "past": "A",
            },
            "D": {
                "mode": "backward",
                "within": "v <= 0",
                "to": "forward",
                "set": {"u": "u - 2*F"},
                "past": "P",
            },
        }
        word, parameter = str(draw.choice(["DSA", "DC", "PSAB"])), str(draw.choice(["w", "a", "F"]))
    elif kind == "position":
        modes = {
            "left": {"x": "v", "v": force},
            "right": {"x": "v", "v": f"{force} - k*(x - e) - F"},
        }
        jump = str(draw.choice(["v - H", "v", "v - H*v*v"]))
        guards = {
            "A": {"mode": "left", "within": "x <= e", "to": "right", "set": {"v": jump}},
            "B": {"mode": "right", "within": "x >= e", "to": "left"},
        }
    else:
        modes = {"up": {"x": "v", "v": f"{force} - F"}, "down": {"x": "v", "v": f"{force} + H"}}
        guards = {
            "A": {"mode": "up", "within": "v >= V", "to": "down"},
            "B": {"mode": "down", "within": "v <= V", "to": "up"},
            "W": {"mode": "up", "within": "x <= e", "to": "down", "set": {"v": "-r*v"}},
        }
        word = str(draw.choice(["WB", "AB"]))
    texts = [text for laws in modes.values() for text in laws.values()]
    texts += [guard["within"] for guard in guards.values()]
    texts += [str(text) for guard in guards.values() for text in guard.get("set", {}).values()]
    said = set(re.findall(r"[A-Za-z]+", " ".join(texts)))
    p = {name: value for name, value in p.items() if name in said}
    parameter = parameter if parameter in p else "w"
    middle = p[parameter]
    return {
        "name": f"random {seed} ({kind})",
        "model": {
            "system": "hybrid",
            "period": "2*pi/w",
            "parameters": p,
            "modes": modes,
            "guards": guards,
        },
        "follow": {
            "parameter": parameter,
            "range": [0.6 * middle, 1.5 * middle],
            "orbits": [word],
            "max_branches": 3,
        },
        "detect": {"events": ["FB", "BP", "PD", "NS", "G", "V", "T"]},
        "numerics": {"max_step": 0.02, "max_points": 150, "starts": 64, "rounds": 2},
    }


@dataclass
class Surface:
    """A guard: where it ends its mode, h = 0, from h < 0."""

    name: str
    mode: str
    to: str
    past: str
    gap: object
    change: dict


class Walker:
    """A scene's motion at parameter values."""

    def __init__(self, table, values):
        self.values = values
        self.modes = {mode: tuple(laws) for mode, laws in table["modes"].items()}
        named = {n: sympy.Symbol(n) for laws in self.modes.values() for n in laws}
        names = {**{n: sympy.Symbol(n) for n in values}, **named, "t": sympy.Symbol("t")}

        def read(text):
            return sympy.sympify(str(text), locals=names).subs(
                {names[n]: v for n, v in values.items()}
            )

        def function(text, mode):
            state = [names[n] for n in self.modes[mode]]
            return sympy.lambdify([names["t"], *state], read(text), "math")

        self.laws = {
            mode: [function(text, mode) for text in laws.values()]
            for mode, laws in table["modes"].items()
        }
        self.guards = {}
        for name, guard in table["guards"].items():
            mode = guard["mode"]
            for sign in ("<=", ">="):
                if sign in guard["within"]:
                    left, right = guard["within"].split(sign)
                    text = f"({left}) - ({right})" if sign == "<=" else f"({right}) - ({left})"
            change = {n: function(e, mode) for n, e in guard.get("set", {}).items()}
            found = Surface(name, mode, guard["to"], guard.get("past", ""), None, change)
            found.gap = function(text, mode)
            self.guards[name] = found

    def field(self, mode):
        laws = self.laws[mode]
        return lambda t, y: [law(t, *y) for law in laws]

    def after(self, name, t, y):
        """The state in the next mode."""
        guard = self.guards[name]
        before = dict(zip(self.modes[guard.mode], y, strict=True))
        changed = {n: e(t, *y) for n, e in guard.change.items()}
        return [float(changed.get(n, before.get(n, math.nan))) for n in self.modes[guard.to]]

    def flight(self, left, right, t, y, arrival):
        """A flight after a guard, to where the next one's surface is reached near a time."""
        mode = self.guards[left].to
        reach = arrival + 0.02 * (arrival - t) + 1e-6
        flown = solve_ivp(self.field(mode), (t, reach), y, **TIGHT)
        gap = self.guards[right].gap

        def h(s):
            return gap(s, *flown.sol(s))

        width = 1e-9
        while width < 0.02 * (arrival - t):
            one, other = max(t, arrival - width), arrival + width
            if h(one) * h(other) <= 0.0:
                end = brentq(h, one, other, xtol=1e-15)
                return flown.sol, end, flown.sol(end)
            width *= 4.0
        return flown.sol, None, None

    def walk(self, word, t, y, arrivals):
        """From before the first impact of a word until before it returns, at about these times."""
        flights = []
        for k, (left, right) in enumerate(zip(word, word[1:] + word[:1], strict=True)):
            start, begun = t, self.after(left, t, y)
            sol, t, y = self.flight(left, right, start, begun, arrivals[k])
            flights.append((left, right, start, begun, sol, t))
            if t is None:
                return flights, None, None
        return flights, t, y

    def rate(self, guard, t, y, mode):
        """The first and second derivative of a gap along the mode's flow."""
        field, gap = self.field(mode), self.guards[guard].gap
        d = 1e-4
        flown = solve_ivp(field, (t, t + 4 * d), y, **TIGHT)
        back = solve_ivp(field, (t, t - 4 * d), y, **TIGHT)
        value = {
            k: gap(t + k * d, *(flown if k >= 0 else back).sol(t + k * d)) for k in range(-2, 3)
        }
        first = (8 * (value[1] - value[-1]) - (value[2] - value[-2])) / (12 * d)
        second = (-value[2] + 16 * value[1] - 30 * value[0] + 16 * value[-1] - value[-2]) / (
            12 * d * d
        )
        return first, second

    def faults(self, flights):
        """What the scene forbids on flights, and what is too near to be decided."""
        wrong, close = [], []

        def judge(what, amount, near=NEAR):
            if amount > near:
                wrong.append((what, amount))
            elif amount > -near:
                close.append(what)

        for left, right, start, begun, sol, end in flights:
            mode = self.guards[left].to
            if end is None or end - start < 1e-7:
                judge(f"{left}{right} lasts", 0.0 if end is not None else 1.0)
                continue
            past = self.guards[left].past
            if past:  # sliding has to begin beyond its limit
                slides = next(
                    g
                    for g in self.guards.values()
                    if g.mode == self.guards[left].mode
                    and not g.past
                    and g.to == self.guards[past].mode
                )
                before = self.before[left, start]
                judge(
                    f"{left} where {slides.name} slides",
                    -self.guards[past].gap(start, *self.after(slides.name, start, before)),
                )
            for guard in self.guards.values():
                if guard.mode != mode or guard.past:
                    continue
                first = guard.gap(start, *begun)
                on = abs(first) < 1e-9
                if on:
                    rate, bend = self.rate(guard.name, start, begun, mode)
                    judge(
                        f"{left} leaves by {guard.name}", rate if abs(rate) > 1e-7 else bend, 1e-5
                    )
                else:
                    judge(f"{left} begins beyond {guard.name}", first)
                reached = guard.name == right or abs(guard.gap(end, *sol(end))) < 1e-9
                if reached:
                    rate, bend = self.rate(guard.name, end, list(sol(end)), mode)
                    judge(f"{right} from outside", -rate, 1e-6)
                else:
                    judge(f"{right} reached beyond {guard.name}", guard.gap(end, *sol(end)))
                times = np.linspace(start, end, LOOKS + 1)
                found = np.array([guard.gap(s, *sol(s)) for s in times])
                for i in range(1, LOOKS):
                    if found[i] >= max(found[i - 1], found[i + 1]) and found[i] > -0.05:
                        top = minimize_scalar(
                            lambda s, g=guard, f=sol: -g.gap(s, *f(s)),
                            bounds=(times[i - 1], times[i + 1]),
                            method="bounded",
                            options={"xatol": 1e-10 * (end - start)},
                        )
                        judge(f"{left}{right} passes {guard.name}", -float(top.fun))
        return wrong, close

    def orbit(self, word, impacts, period):
        """Walk an orbit from its impacts, states before them as (time, state); flights, and by how
        much it does not close."""
        self.before = {}
        flights, worst, scale = [], 0.0, 1.0 + max(np.max(np.abs(y)) for _, y in impacts)
        following = [*impacts[1:], (impacts[0][0] + period, impacts[0][1])]
        for k, (t, y) in enumerate(impacts):
            left, right = word[k], word[(k + 1) % len(word)]
            self.before[left, t] = y
            begun = self.after(left, t, y)
            sol, end, state = self.flight(left, right, t, begun, following[k][0])
            flights.append((left, right, t, begun, sol, end))
            if end is None:
                return flights, math.inf
            worst = max(
                worst, abs(end - following[k][0]), *np.abs(np.subtract(state, following[k][1]))
            )
        return flights, worst / scale

    def multipliers(self, word, impacts, period, pivots):
        """By central differences of the map from before the first impact to before its return."""
        (t, y), surface = impacts[0], pivots
        arrivals = [s for s, _ in impacts[1:]] + [t + period]
        free = [i for i in range(len(y)) if i != surface]

        def image(z):
            state = np.array(y, dtype=float)
            state[free] = z[1:]
            _, end, found = self.walk(word, z[0], list(state), arrivals)
            return None if end is None else np.array([end - period, *np.asarray(found)[free]])

        here = np.array([t, *np.asarray(y)[free]])
        columns = []
        for i in range(len(here)):
            d = np.zeros(len(here))
            d[i] = 1e-5
            ends = [image(here + s * d) for s in (1, -1, 2, -2)]
            if any(end is None for end in ends):
                return None
            columns.append((8 * (ends[0] - ends[1]) - (ends[2] - ends[3])) / 12e-5)
        return np.linalg.eigvals(np.transpose(columns))
