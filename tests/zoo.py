"""Systems, scenes and closed forms that several tests use."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import mpmath as mp
import numpy as np

from contimpact.models.model import Formulas, Guard, Mode, Model, Parameter, Wall
from contimpact.results.scene import read_scene
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator

ROOT = Path(__file__).parent.parent
"""The checkout."""


def example(name):
    """A script of the examples, as a module."""
    path = ROOT / "examples" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def tool(name):
    """A script in ``tools``, as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def unknowns_of(problem, times, sections, value=None):
    """Unknowns from impact times (N,), section coordinates (N, m - 1) and the parameters."""
    sections = np.reshape(sections, (len(times), -1))
    free = [problem.model.values[name] for name in problem.kernels.parameters]
    rows = np.column_stack([times, sections])
    return np.append(rows.ravel(), free if value is None else value)


def harmonic_pair(waves, **given):
    """The impact pair under a_i cos(k_i pi t) + b_i sin(k_i pi t), given as a list of (k, a, b)."""
    terms = [
        f"({float(factor)!r})*{wave}({k}*pi*t)"
        for k, a, b in waves
        for wave, factor in (("cos", a), ("sin", b))
        if factor
    ]
    return ImpactPair(forcing=" + ".join(terms), **given)


def scene_table(parameters=None, **tables):
    """What a scene of 1:1 at Fig. 7's parameters asks for, with other values in its tables."""
    given = {
        "name": "t",
        "model": {
            "system": "impact-pair",
            "parameters": {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.34, **(parameters or {})},
        },
        "follow": {"parameter": "s", "range": [0.08, 1.05], "orbits": ["1:1"]},
    }
    for name, values in tables.items():
        own = given.get(name, {})
        given[name] = {**own, **values} if isinstance(values, dict) else values
    return given


def scene(detect=None, follow=None, **changes):
    """That scene, two switches deep."""
    detect = {"events": ["FB", "PD", "G"], **(detect or {})}
    follow = {"switch": ["G", "PD"], "depth": 2, **(follow or {})}
    return read_scene(scene_table(detect=detect, follow=follow, **changes))


SMALL = """
name = "small"
[model]
system = "impact-pair"
[model.parameters]
beta = "pi/6"
r = 0.3
A = 5.0
s = 0.34
[follow]
parameter = "s"
range = [0.3, 0.4]
orbits = ["1:1"]
[detect]
events = ["PD", "G"]
"""
"""One parameter range, two orbits at the start, a period doubling and a ghost grazing."""


TWO_MASSES = {"c1": 0.1, "c2": 0.05, "k1": 1.0, "k2": 0.6, "a1": 1.0, "omega": 1.3}
TWO_MASSES |= {"sigma_1": 0.5, "sigma_2": 0.4, "r": 0.8}
"""Parameters of the package's `two-masses`."""


class TwoMasses(Model):
    """Two equal masses in a row, the first one against a stop.

    x1'' + c x1' + k1 x1 + k2 (x1 - x2) = a cos(omega t), x2'' + c x2' + k2 (x2 - x1) = 0,
    x1 <= sigma: two oscillators in the coordinates that diagonalise the stiffness.
    """

    SYSTEM = "two-equal-masses"
    WALLS = (Wall("A", side=+1),)
    DEGREES_OF_FREEDOM = 2
    PARAMETERS = tuple(
        Parameter(name, "", f"parameter {name}", lower=0)
        for name in ("a", "omega", "c", "k1", "k2", "sigma", "r")
    )

    def formulas(self, symbols):
        import sympy

        a, omega, _, k1, k2, sigma, r = symbols.values()
        middle, spread = k1 / 2 + k2, sympy.sqrt(k1**2 / 4 + k2**2)
        cosine, sine = (sympy.sqrt((1 + s * k1 / (2 * spread)) / 2) for s in (1, -1))
        modes = [
            Oscillator.formulas(
                None,
                {
                    "a": a * part,
                    "omega": omega,
                    "c": self.damping(symbols["c"], k),
                    "k": k,
                    "sigma": sigma,
                    "r": r,
                },
            ).flight
            for part, k in ((cosine, middle + spread), (sine, middle - spread))
        ]

        def to_modes(x):
            return cosine * x[0] - sine * x[1], sine * x[0] + cosine * x[1]

        def from_modes(y):
            return [cosine * y[0] + sine * y[1], -sine * y[0] + cosine * y[1]]

        def flight(t0, x0, v0, dt):
            parts = [
                mode(t0, [x], [v], dt)
                for mode, x, v in zip(modes, to_modes(x0), to_modes(v0), strict=True)
            ]
            return tuple(from_modes([part[i][0] for part in parts]) for i in (0, 1))

        return Formulas(
            period=2 * sympy.pi / omega,
            walls={"A": sigma},
            reset=lambda wall, x, v: [-r * v[0], v[1]],
            flight=flight,
            acceleration=lambda t, x, v: [
                a * sympy.cos(omega * t)
                - k1 * x[0]
                - k2 * (x[0] - x[1])
                - self.damped(symbols, v)[0],
                -k2 * (x[1] - x[0]) - self.damped(symbols, v)[1],
            ],
        )

    def damping(self, c, k):
        """Of a mode of stiffness k."""
        return c

    def damped(self, symbols, v):
        """The forces of damping."""
        return [symbols["c"] * x for x in v]


class ProportionalMasses(TwoMasses):
    """The same, with damping by c times the stiffness."""

    SYSTEM = "two-proportional-masses"

    def damping(self, c, k):
        return c * k

    def damped(self, symbols, v):
        c, k1, k2 = (symbols[name] for name in ("c", "k1", "k2"))
        return [c * (k1 * v[0] + k2 * (v[0] - v[1])), c * k2 * (v[1] - v[0])]


def two_masses(**given):
    """Two equal masses at values where they hit the stop once in a period."""
    values = {"a": 1.0, "omega": 1.3, "c": 0.1, "k1": 1.0, "k2": 0.6, "sigma": 0.5, "r": 0.8}
    return TwoMasses(**(values | given))


def adding_sliding(values, guess):
    """Where sticking is divided of a body on a belt that slips and sticks once, by closed forms.

    The friction that holds the body touches its lower limit. `guess` is the amplitude and when the
    body slips, sticks and touches; returned as these are, to thirty digits.
    """
    omega, c, V, mu = (mp.mpf(values[name]) for name in ("omega", "c", "V", "mu_0"))
    root, period = mp.sqrt(1 - c**2 / 4), 2 * mp.pi / omega

    def residual(a, slips, sticks, touches):
        response = a / mp.mpc(1 - omega**2, c * omega)

        def steady(t):
            return mp.re(response * mp.expj(omega * t)), mp.re(
                1j * omega * response * mp.expj(omega * t)
            )

        def holds(x, t):
            return x + c * V - a * mp.cos(omega * t)

        begin = mu - holds(0, slips)
        (p, q), dt = steady(slips), sticks - slips
        x, v = begin - mu - p, V - q
        e, cos, sin = mp.exp(-c * dt / 2), mp.cos(root * dt), mp.sin(root * dt) / root
        p, q = steady(sticks)
        end = mu + p + e * (x * cos + (v + c * x / 2) * sin)
        speed = q + e * (v * cos - (x + c * v / 2) * sin)
        back = end + V * (slips + period - sticks)
        touch = holds(end + V * (touches - sticks), touches) + mu
        return [speed - V, back - begin, touch, V + a * omega * mp.sin(omega * touches)]

    with mp.workdps(30):
        return [*mp.findroot(residual, guess)]


PRELOADED = {"a": 1.0, "w": 0.41, "c": 0.1, "k": 1.0, "e": 0.5, "P": -0.3, "kb": 5.0, "cb": 0.4}


class Preloaded(Model):
    """x'' + c x' + k x = a cos wt - [x > e](P + kb (x - e) + cb x'); a magnet where P < 0."""

    SYSTEM = "preloaded"
    MODES = (Mode("free"), Mode("pressed"))
    WALLS = (Guard("C", +1, "free", "pressed"), Guard("R", -1, "pressed", "free"))
    PARAMETERS = tuple(Parameter(name, "", name) for name in PRELOADED)

    def formulas(self, symbols):
        import sympy

        from contimpact.models.linear import Linear

        a, w, c, k, e, P, kb, cb = (symbols[p.name] for p in self.PARAMETERS)
        period = 2 * sympy.pi / w

        def linear(damping, stiffness, force):
            given = {"mass": [[1]], "damping": [[damping]], "stiffness": [[stiffness]]}
            return Linear(**given, period=period, force=lambda t: [a * sympy.cos(w * t) + force])

        free, pressed = linear(c, k, 0), linear(c + cb, k + kb, kb * e - P)
        return Formulas(
            period=period,
            walls={"C": e, "R": e},
            flight={"free": free.flight, "pressed": pressed.flight},
            acceleration={"free": free.acceleration, "pressed": pressed.acceleration},
        )


def between_soft_stops(**parameters):
    """A forced oscillator between two soft stops, whose contacts A to B and L to R last."""
    law = "a*cos(w*t) - x - 0.1*v"
    laws = {"free": law, "right": f"{law} - 50*(x - 1/2)", "left": f"{law} - 50*(x + 1/2)"}
    guards = {
        "A": {"mode": "free", "within": "x <= 1/2", "to": "right"},
        "B": {"mode": "right", "within": "x >= 1/2", "to": "free"},
        "L": {"mode": "free", "within": "x >= -1/2", "to": "left"},
        "R": {"mode": "left", "within": "x <= -1/2", "to": "free"},
    }
    model = {
        "system": "hybrid",
        "period": "2*pi/w",
        "parameters": parameters,
        "modes": {mode: {"x": "v", "v": text} for mode, text in laws.items()},
        "guards": guards,
    }
    follow = {"parameter": "w", "range": [0.5, 2.0], "orbits": ["ABLR"]}
    return read_scene({"name": "between soft stops", "model": model, "follow": follow}).model


ROCKING_BLOCK = {
    "name": "rocking block",
    "model": {
        "system": "hybrid",
        "period": "2*pi/w",
        "parameters": {"b": 0.1, "w": 2.0, "r": 0.9},
        "modes": {
            "right": {"x": "v", "v": "x - 1 + b*cos(w*t)"},
            "left": {"x": "v", "v": "x + 1 + b*cos(w*t)"},
        },
        "guards": {
            "N": {"mode": "right", "within": "x >= 0", "to": "left", "set": {"v": "r*v"}},
            "P": {"mode": "left", "within": "x <= 0", "to": "right", "set": {"v": "r*v"}},
        },
    },
    "follow": {"parameter": "b", "range": [0.0, 1.0], "orbits": ["NP"]},
}
"""Hogan's slender rocking block; beyond |x| = 1 it falls over."""
