"""Random hybrid scenes, and their orbits by an event-driven integration of the scene's own text.

Nothing of the package is used: a flight is integrated by DOP853, from the state that a guard's
`set` leaves to where the next guard's surface is reached, and looked at for what the scene forbids.
"""

from __future__ import annotations

import copy
import math
import re
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import sympy
from scipy.integrate import ode, solve_ivp
from scipy.optimize import brentq, minimize_scalar

ERRORS = {"rtol": 1e-12, "atol": 1e-13}
TIGHT = {"method": "DOP853", "dense_output": True} | ERRORS
NEAR = 1e-8
"""Gaps and rates nearer to zero than this decide nothing."""
STEP = 3e-4
"""Of times and states, in differences of the fourth order."""
FAR = 10.0
"""An orbit between two is not farther from their chord than this many times its length."""
LOOKS = 300
"""At how many instants of a flight a gap is looked at before its minima are closed in."""


def random_scene(seed):
    """Two or three modes, guards on velocities or positions, sticking; a table as of TOML."""
    draw = np.random.default_rng(seed)
    kind = ("slip", "stick", "position", "wall", "three", "stick")[seed % 6]
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
    cubic = " - n*x**3" if seed % 12 >= 6 else ""
    force = f"a*cos(w*t) - x{cubic} - 2*z*v"
    word, parameter = ["AB"], str(draw.choice(["w", "a", "F", "z"]))
    modes = {"up": {"x": "v", "v": f"{force} - F"}, "down": {"x": "v", "v": f"{force} + H"}}
    turns = {
        "A": {"mode": "up", "within": "v >= V", "to": "down"},
        "B": {"mode": "down", "within": "v <= V", "to": "up"},
    }
    jump = str(draw.choice(["v - H", "v", "v - H*v*v"]))
    right = {
        "A": {"mode": "left", "within": "x <= e", "to": "right", "set": {"v": jump}},
        "B": {"mode": "right", "within": "x >= e", "to": "left"},
    }
    beyond = {"x": "v", "v": f"{force} - k*(x - e) - F"}
    if kind == "slip":
        guards = turns
    elif kind == "stick":
        modes, guards, word = sticking(draw, p)
        parameter = str(draw.choice(["w", "a", "F"]))
    elif kind == "position":
        modes, guards = {"left": {"x": "v", "v": force}, "right": beyond}, right
    elif kind == "three":
        modes = {
            "left": {"x": "v", "v": force},
            "right": beyond,
            "far": {"x": "v", "v": f"{force} - k*(x + H) + F"},
        }
        p["e"] = abs(p["e"])
        guards = right | {
            "L": {"mode": "left", "within": "x >= -H", "to": "far"},
            "R": {"mode": "far", "within": "x <= -H", "to": "left", "set": {"v": "v*r"}},
        }
        word = [str(draw.choice(["ABLR", "AB", "LR"])), "ABLR"]
    else:
        guards = turns | {
            "W": {"mode": "up", "within": "x <= e", "to": "down", "set": {"v": "-r*v"}}
        }
        word = [str(draw.choice(["WB", "AB"]))]
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
            "orbits": list(dict.fromkeys(word)),
            "max_branches": 3,
        },
        "detect": {"events": ["FB", "BP", "PD", "NS", "G", "V", "T"]},
        "numerics": {"max_step": 0.02, "max_points": 150, "starts": 64, "rounds": 2},
    }


def sticking(draw, p):
    """A body on a belt of speed V, by the rates of its velocity: it sticks while what holds it, f,
    is at most E, the friction F in slip or more."""
    p["F"] = round(p["a"] * float(draw.uniform(0.1, 0.6)), 3)
    p["E"] = round(p["F"] * float(draw.choice([1.0, draw.uniform(1.0, 1.4)])), 3)
    p["V"] = float(draw.choice([0.0, p["V"]]))
    rate = "-a*w*sin(w*t)"
    law = {"v": "u", "u": f"{rate} - v - 2*z*u"}
    modes = {"forward": law, "stick": {"f": f"{rate} - V"}, "backward": law}
    guards = {
        "S": {"mode": "forward", "within": "v >= V", "to": "stick", "set": {"f": "u + F"}},
        "P": {
            "mode": "stick",
            "within": "f <= E",
            "to": "forward",
            "set": {"v": "V", "u": "E - F"},
        },
        "A": {
            "mode": "stick",
            "within": "f >= -E",
            "to": "backward",
            "set": {"v": "V", "u": "F - E"},
        },
        "B": {"mode": "backward", "within": "v <= V", "to": "stick", "set": {"f": "u - F"}},
        "C": {
            "mode": "forward",
            "within": "v >= V",
            "to": "backward",
            "set": {"u": "u + 2*F"},
            "past": "A",
        },
        "D": {
            "mode": "backward",
            "within": "v <= V",
            "to": "forward",
            "set": {"u": "u - 2*F"},
            "past": "P",
        },
    }
    some = ["SABP", *draw.choice(["CD", "SP", "AB", "DSA", "CBP"], 2, replace=False).tolist()]
    return modes, guards, some


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
    """A scene's motion; `at` gives it parameter values."""

    def __init__(self, table):
        self.modes = {mode: tuple(laws) for mode, laws in table["modes"].items()}
        self.parameters = list(table["parameters"])
        names = {n: sympy.Symbol(n) for n in {*self.parameters, "t"}.union(*self.modes.values())}

        def function(text, mode=None):
            state = ["t", *self.modes[mode]] if mode else []
            given = [names[n] for n in [*self.parameters, *state]]
            return sympy.lambdify(given, sympy.sympify(text, locals=names), "math")

        self.formulas = {
            mode: function([str(text) for text in laws.values()], mode)
            for mode, laws in table["modes"].items()
        }
        self.surfaces, self.forcing = {}, function(table["period"])
        for name, guard in table["guards"].items():
            mode = guard["mode"]
            for sign in ("<=", ">="):
                if sign in guard["within"]:
                    left, right = guard["within"].split(sign)
                    text = f"({left}) - ({right})" if sign == "<=" else f"({right}) - ({left})"
            change = {n: function(str(e), mode) for n, e in guard.get("set", {}).items()}
            past = guard.get("past", "")
            self.surfaces[name] = Surface(
                name, mode, guard["to"], past, function(text, mode), change
            )

    def at(self, values):
        """The motion at parameter values."""
        found, p = copy.copy(self), [values[name] for name in self.parameters]
        found.laws = {mode: partial(law, *p) for mode, law in self.formulas.items()}
        found.guards = {
            name: replace(
                one,
                gap=partial(one.gap, *p),
                change={n: partial(e, *p) for n, e in one.change.items()},
            )
            for name, one in self.surfaces.items()
        }
        found.period = self.forcing(*p)
        return found

    def field(self, mode):
        law = self.laws[mode]
        return lambda t, y: law(t, *y)

    def after(self, name, t, y):
        """The state in the next mode."""
        guard = self.guards[name]
        before = dict(zip(self.modes[guard.mode], y, strict=True))
        changed = {n: e(t, *y) for n, e in guard.change.items()}
        return [float(changed.get(n, before.get(n, math.nan))) for n in self.modes[guard.to]]

    def flown(self, mode, t, y, end):
        """The state at a time, earlier or later; a flight that fails warns, which is an error."""
        if end == t:
            return np.array(y)
        flying = ode(self.field(mode)).set_integrator("dop853", nsteps=100_000, **ERRORS)
        return flying.set_initial_value(y, t).integrate(end)

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

    def residual(self, word, z, turns):
        """By how much impacts (t, *y) in a row, states before them, miss their surfaces and each
        other; times are given, so that it is smooth where a velocity or a flight vanishes."""
        impacts, parts = self.unpacked(word, z), []
        following = [*impacts[1:], (impacts[0][0] + turns * self.period, impacts[0][1])]
        for name, (t, y), (end, arrived) in zip(word, impacts, following, strict=True):
            begun = self.after(name, t, y)
            reached = self.flown(self.guards[name].to, t, begun, end)
            parts += [*(reached - arrived), self.guards[name].gap(t, *y)]
        return np.array(parts)

    def unpacked(self, word, z):
        """Impacts of numbers in a row."""
        impacts, i = [], 0
        for name in word:
            n = len(self.modes[self.guards[name].mode])
            impacts.append((z[i], np.array(z[i + 1 : i + 1 + n])))
            i += n + 1
        return impacts

    def slope(self, guard, t, y):
        """The rate of a gap, which is linear, along the flow of the mode that it ends."""
        one = self.guards[guard]
        rates = self.field(one.mode)(t, y)
        return one.gap(t, *np.add(y, rates)) - one.gap(t, *y)

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

    def sliding(self, through):
        """The guard on the same surface that leads to sliding, of one that leads through it."""
        mode, slid = self.guards[through].mode, self.guards[self.guards[through].past].mode
        return next(
            g.name for g in self.guards.values() if (g.mode, g.to, g.past) == (mode, slid, "")
        )

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
                slides, before = self.sliding(left), self.before[left, start]
                judge(
                    f"{left} where {slides} slides",
                    -self.guards[past].gap(start, *self.after(slides, start, before)),
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

    def multipliers(self, word, impacts, turns):
        """Those of the map from the first impact to its return, beside zeros, by differences of
        flights of given times: a change of arrival keeps the state on its surface."""
        following = [*impacts[1:], (impacts[0][0] + turns * self.period, impacts[0][1])]
        product = np.eye(1 + len(impacts[0][1]))
        for k, ((t, y), (end, arrived)) in enumerate(zip(impacts, following, strict=True)):
            mode, here = self.guards[word[k]].to, np.array([t, *y])

            def image(z, k=k, end=end, mode=mode):
                return self.flown(mode, z[0], self.after(word[k], z[0], z[1:]), end)

            steps = STEP * np.eye(len(here))
            columns = [
                8 * (image(here + d) - image(here - d)) - image(here + 2 * d) + image(here - 2 * d)
                for d in steps
            ]
            moved = np.transpose(columns) / (12 * STEP)
            gap = partial(self.guards[word[(k + 1) % len(word)]].gap, end)
            normal = np.array([gap(*(arrived + e)) - gap(*arrived) for e in np.eye(len(arrived))])
            rates = np.array(self.field(mode)(end, arrived))
            later = -(normal @ moved) / (normal @ rates)
            product = np.vstack([later, moved + np.outer(rates, later)]) @ product
        return np.linalg.eigvals(product)


def row_of(impacts):
    """Impacts as numbers in a row."""
    return np.array([x for t, y in impacts for x in (t, *y)])


class Between:
    """The orbits of a walked word between two of them, at parts of the way."""

    def __init__(self, walker, values, parameter, word, ends, turns):
        self.walker, self.values, self.parameter = walker, values, parameter
        self.word, self.turns = word, turns
        self.ends = [np.append(row_of(impacts), p) for impacts, p in ends]
        self.chord = np.subtract(*self.ends[::-1])
        self.matrix = None

    def at(self, z):
        """The walker at a row's parameter, and the impacts."""
        here = self.walker.at({**self.values, self.parameter: z[-1]})
        return here, here.unpacked(self.word, z)

    def missed(self, z):
        return self.at(z)[0].residual(self.word, z, self.turns)

    def derivative(self, z):
        steps = 1e-6 * np.eye(len(z))
        columns = [(self.missed(z + d) - self.missed(z - d)) / 2e-6 for d in steps]
        return np.vstack([np.transpose(columns), self.chord])

    def orbit(self, part):
        """The orbit in the plane across the way, by Newton's iteration; None where it fails."""
        guess = self.ends[0] + part * self.chord
        z = guess.copy()
        for attempt in range(16):
            if self.matrix is None or attempt == 6:
                self.matrix = self.derivative(z)
            off = np.append(self.missed(z), self.chord @ (z - guess))
            step = np.linalg.solve(self.matrix, off)
            z -= step
            if np.max(np.abs(step)) < 1e-11 * (1.0 + np.max(np.abs(z))):
                return z
            if not np.max(np.abs(z - guess)) < FAR * np.max(np.abs(self.chord)):
                return None
        return None

    def zero(self, function):
        """Where a function of walker and impacts vanishes on the way: the parameter; None where its
        sign is the same at both ends, NaN where an orbit between them is not found, as where
        velocity and duration vanish together: the equations are singular there."""

        def value(part):
            z = self.orbit(part)
            if z is None:
                raise ArithmeticError
            return function(*self.at(z))

        if not function(*self.at(self.ends[0])) * function(*self.at(self.ends[1])) < 0.0:
            return None
        try:
            return self.orbit(brentq(value, 0.0, 1.0, xtol=1e-13))[-1]
        except (ArithmeticError, ValueError, TypeError, UserWarning, np.linalg.LinAlgError):
            return math.nan
