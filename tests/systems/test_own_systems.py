"""Systems of one's own: any name for a parameter, and no kernels of formulas that have changed."""

from __future__ import annotations

import dataclasses
import math
import os
import subprocess
import sys
import textwrap

import pytest
import sympy

from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.errors import InputError
from contimpact.models.linear import Linear
from contimpact.models.model import COLUMNS, Formulas, Model, Parameter, Wall
from contimpact.models.symbolic import harmonic_means
from contimpact.orbits.search import find_orbits
from contimpact.results.branch import Entry
from contimpact.schema import table_columns
from contimpact.segments.checking import check_model
from contimpact.segments.kernels import Kernels
from contimpact.simulation.sweep import attractor_columns

R, OMEGA, G = 0.5, 50.0, 9.8
FOLD = math.pi * (1 - R) / (1 + R)
"""Gamma = a omega^2/g at the fold of the bouncing ball's 1:1 orbit, in closed form."""


def ball(amplitude="a", restitution="r", **attributes):
    """A ball on a vibrating table, its parameters called as one likes."""

    def formulas(self, symbols):
        a, omega, r, g = symbols.values()

        def flight(t0, x0, v0, dt):
            once, twice = harmonic_means(0, a * omega**2, omega, t0, dt)
            return [v0[0] + dt * (twice - g / 2)], [v0[0] + dt * (once - g)]

        return Formulas(
            period=2 * sympy.pi / omega,
            walls={"P": sympy.Integer(0)},
            derived={"Gamma": a * omega**2 / g},
            reset=lambda wall, x, v: [-r * v[0]],
            flight=flight,
            acceleration=lambda t, x, v: [a * omega**2 * sympy.sin(omega * t) - g],
            harmonics=(-g, [(1, 0, a * omega**2)]),
        )

    body = {
        "SYSTEM": "ball",
        "WALLS": (Wall("P", side=-1),),
        "DERIVED": ("Gamma",),
        "PARAMETERS": (
            Parameter(amplitude, "m", "the amplitude", lower=0, above_lower=True),
            Parameter("omega", "rad/s", "the frequency", lower=0, above_lower=True),
            Parameter(restitution, "", "the restitution", lower=0, upper=1),
            Parameter("g", "m/s^2", "gravity", G, lower=0, above_lower=True),
        ),
        "formulas": formulas,
    }
    return type("Ball", (Model,), body | attributes)


def made(kind, gamma=1.3):
    amplitude, restitution = (kind.PARAMETERS[i].name for i in (0, 2))
    return kind(**{amplitude: gamma * G / OMEGA**2, "omega": OMEGA, restitution: R})


def test_two_walls_on_one_surface_are_refused():
    def formulas(self, symbols):
        one = ball().formulas(self, symbols)
        return dataclasses.replace(one, walls={"P": symbols["g"], "Q": symbols["g"]})

    walls = Wall("P", side=-1), Wall("Q", side=-1)
    with pytest.raises(InputError, match=r"walls: 'Q' is on the surface of 'P', in one mode"):
        Kernels(made(ball(WALLS=walls, formulas=formulas)), "a").setup(1.0, 1.0, 1.0, 1.0)


# Names


@pytest.mark.parametrize(
    "name",
    [
        "phase",
        "dt",
        "turn",
        "t0",
        "v0",
        "w0",
        "q0",
        "c1_w3",
        "duration",
        "p_a",
        "lambda",
        "sin",
        "pi",
        "floor",
        "square",
        "stumpff1",
        "nan",
        "loaded",
        "p",
        "call",
        "\u0394",
    ],
)
@pytest.mark.quick(2)
def test_a_parameter_may_have_any_name(name):
    """The same orbits as where it is called `a`; sums may be in another order."""
    plain, other = (find_orbits(made(ball(n)), "1", parameter=n) for n in ("a", name))
    assert len(plain) == len(other) == 2
    for one, same in zip(plain, other, strict=True):
        assert same.times == pytest.approx(one.times, rel=1e-12)
        assert same.multipliers == pytest.approx(one.multipliers, rel=1e-12)


@pytest.mark.parametrize("name", ["phase", "lambda"])
def test_a_branch_in_a_parameter_of_any_name(name):
    model = made(ball(name))
    value = model.values[name]
    branch = continue_orbit(
        find_orbits(model, "1", parameter=name)[0], name, (0.5 * value, 2 * value)
    )
    kinds = {event.kind: event.parameters["Gamma"] for event in branch.events}
    assert kinds["FB"] == pytest.approx(FOLD, rel=1e-12)
    doubling = math.hypot(FOLD, 2 * (1 + R**2) / (1 + R) ** 2)
    assert kinds["PD"] == pytest.approx(doubling, rel=1e-12)


@pytest.mark.parametrize("name", ["", "a b", "1a", "a'", "a.b", "\ufb01", None, 3])
def test_names_that_are_no_identifiers_are_refused(name):
    with pytest.raises(InputError, match=r"^Ball\.PARAMETERS: the name"):
        ball(name)


@pytest.mark.parametrize("name", ["t1", "v12", "time1", "arclength", "physical", "multiplier1_re"])
def test_names_of_columns_are_refused(name):
    with pytest.raises(InputError, match="column of that name"):
        ball(name)


def test_the_columns_of_all_tables_are_known(tmp_path):
    model = made(ball())
    branch = continue_orbit(
        find_orbits(model, "1", parameter="a")[0], "a", (0.9 * model.values["a"], 0.01)
    )
    own, several = {*model.values, *model.DERIVED}, attractor_columns(4)
    columns = {*branch.columns, *table_columns(Entry), *several} - own
    for column in columns:
        with pytest.raises(InputError, match="column of that name"):
            ball(column)
    multipliers = {f"multiplier{k}_{part}" for k in range(1, 5) for part in ("re", "im")}
    assert {*table_columns(Entry), *several} - COLUMNS <= {*multipliers, "exponent3", "exponent4"}


# The contract


@pytest.mark.parametrize(
    ("attributes", "says"),
    [
        ({"WALLS": (Wall("Left", side=-1),)}, r"Ball\.WALLS: a wall is called 'Left'.*letter"),
        ({"WALLS": (Wall("P_1", side=-1),)}, r"Ball\.WALLS: a wall is called 'P_1'"),
        ({"WALLS": (Wall("_", side=-1),)}, r"Ball\.WALLS: a wall is called '_'"),
        ({"WALLS": (Wall("P", side=0),)}, r"wall 'P' has side 0; give \+1 where"),
        ({"WALLS": (Wall("P", 1), Wall("P", -1))}, r"each name once"),
        ({"WALLS": ()}, r"at least one wall"),
        ({"WALLS": ("P",)}, r"give a tuple of Wall"),
        ({"PARAMETERS": ("a",)}, r"give a tuple of Parameter"),
        ({"DERIVED": ("r",)}, r"Ball\.DERIVED: the name 'r' twice"),
        ({"OPTIONS": {"system": "x"}}, r"Ball\.OPTIONS: the name 'system' twice"),
        ({"EXPRESSIONS": {"forcing": ("t",)}}, r"Ball\.EXPRESSIONS: unknown name 'forcing'"),
        ({"DERIVED_UNITS": {"gamma": ""}}, r"Ball\.DERIVED_UNITS: unknown name 'gamma'"),
        ({"DERIVED_FROM": {"Gamma": ("b",)}}, r"DERIVED_FROM\['Gamma'\]: unknown name 'b'"),
        ({"DEGREES_OF_FREEDOM": 0}, r"DEGREES_OF_FREEDOM: found 0"),
    ],
)
def test_a_class_that_cannot_work_is_refused_when_it_is_defined(attributes, says):
    with pytest.raises(InputError, match=says):
        ball(**attributes)


def test_a_class_without_walls_is_refused_when_it_is_used():
    kind = type("Bare", (Model,), {"SYSTEM": "x", "PARAMETERS": (), "formulas": lambda s, p: None})
    with pytest.raises(InputError, match=r"Bare\.WALLS: missing"):
        kind()


def changed(**changes):
    """The ball with some of its formulas replaced."""
    right = ball().formulas

    def formulas(self, symbols):
        found = right(self, symbols)
        return Formulas(
            **{**vars(found), **{n: make(self, symbols, found) for n, make in changes.items()}}
        )

    return made(ball(formulas=formulas))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"walls": lambda m, p, f: {"Q": 0}}, r"formulas: walls: found 'Q'; .*WALLS: 'P'"),
        ({"derived": lambda m, p, f: {}}, r"formulas: derived: found none; .*DERIVED: 'Gamma'"),
        ({"reset": lambda m, p, f: lambda w, x, v: []}, r"reset: found \[\]; .*freedom: 1"),
        ({"flight": lambda m, p, f: lambda *g: [g[3]]}, r"flight: found .*mean velocities"),
        ({"acceleration": lambda m, p, f: lambda t, x, v: 1}, r"acceleration: found 1; "),
        ({"harmonics": lambda m, p, f: (0, [(1, 0, 1), (1, 1, 0)])}, r"harmonics: orders \[1, 1\]"),
        ({"harmonics": lambda m, p, f: (0, [(0.5, 0, 1)])}, r"harmonics: orders \[0\.5\]"),
        ({"period": lambda m, p, f: sympy.Symbol("T")}, r"period: found 'T'; use the symbols"),
        ({"period": lambda m, p, f: m.values["omega"]}, r"reads self\.values\['omega'\]"),
        ({"period": lambda m, p, f: abs(p["omega"])}, r"period: found 'Abs\(omega\)'"),
        ({"period": lambda m, p, f: 3 * sympy.pi / p["omega"]}, r"forcing's period"),
        (
            {"reset": lambda m, p, f: lambda w, x, v: [-p["r"] * v[0] * sympy.erf(x[0] + 1)]},
            r"reset at 'P': found 'erf\(1\)'",
        ),
        (
            {"acceleration": lambda m, p, f: lambda t, x, v: [-p["g"]]},
            r"flight from 'P': its velocity contradicts the acceleration",
        ),
        ({"harmonics": lambda m, p, f: (-p["g"], [])}, r"the harmonics contradict the acc"),
        (
            {
                "flight": lambda m, p, f: (
                    lambda t, x, v, dt: (f.flight(t, x, v, dt)[0], [-p["g"] * dt])
                )
            },
            r"its end velocity does not begin as",
        ),
        (
            {"flight": lambda m, p, f: lambda t, x, v, dt: ([v[0]], f.flight(t, x, v, dt)[1])},
            r"its mean velocity contradicts its end velocity",
        ),
        (
            {"flight": lambda m, p, f: lambda t, x, v, dt: ([2 * v[0]], f.flight(t, x, v, dt)[1])},
            r"its mean velocity does not begin as",
        ),
    ],
)
def test_formulas_that_contradict_each_other_are_refused(changes, says):
    with pytest.raises(InputError, match=says):
        find_orbits(changed(**changes), "1", parameter="a")


def test_e_is_a_number_that_kernels_know():
    model = changed(derived=lambda m, p, f: {"Gamma": sympy.E * p["a"]})
    assert Kernels(model, "a").setup(*model.values.values()).derived[0] == pytest.approx(
        math.e * model.values["a"], rel=1e-15
    )


# Formulas that change

GAIN = {"one": 1.0}


def test_formulas_that_change_are_derived_anew(monkeypatch):
    """A number of a module, a closure, a base class: all that a formula reaches."""
    for gain in (1.0, 3.0):
        monkeypatch.setitem(GAIN, "one", gain)
        model = changed(derived=lambda m, p, f: {"Gamma": GAIN["one"] * p["a"]})
        assert (
            Kernels(model, "a").setup(*model.values.values()).derived[0] == gain * model.values["a"]
        )


def test_a_class_has_one_identity():
    one, other = made(ball()), made(ball())
    assert one.identity == one.identity == other.identity == one.replace(a=1.0).identity
    assert one.identity != made(ball("b")).identity


def test_a_class_without_a_file_leaves_one_file_for_each_kernel(tmp_path, monkeypatch):
    monkeypatch.setenv("CONTIMPACT_CACHE", str(tmp_path))
    for _ in range(3):
        namespace = {"ball": ball, "made": made}
        exec("model = made(type('Mine', (ball(),), {}))", namespace)
        find_orbits(namespace["model"], "1", parameter="a")
    assert sorted(file.name.split("-")[2] for file in tmp_path.iterdir()) == ["flight_P_P", "setup"]


SYSTEM = """
import helper
import sympy
from contimpact.models.model import Formulas, Model, Parameter, Wall

class Falling(helper.Base):
    SYSTEM = "falling"
    WALLS = (Wall("P", side=-1),)
    PARAMETERS = (Parameter("r", "", "the restitution", lower=0, upper=1),)

    def formulas(self, symbols):
        g = helper.GAIN * self.pull()
        r = symbols["r"]
        return Formulas(
            period=sympy.Integer(1), walls={"P": sympy.Integer(0)},
            reset=lambda wall, x, v: [-r * v[0]],
            flight=lambda t0, x0, v0, dt: ([v0[0] - g * dt / 2], [v0[0] - g * dt]),
            acceleration=lambda t, x, v: [-g],
        )

if __name__ == "__main__":
    from contimpact.segments.kernels import Kernels
    model = Falling(r=0.5)
    kernels = Kernels(model, "r")
    print(kernels.motion("P")(0.0, 0.0, 1.0, 0.5)[2], *kernels.generated)
"""

HELPER = """
from contimpact.models.model import Model

GAIN = {gain}

class Base(Model):
    def pull(self):
        return {pull}
"""


@pytest.mark.full
def test_a_helper_or_a_base_class_that_changes_is_seen(tmp_path):
    """In processes of their own, with one cache."""

    def run(gain, pull):
        (tmp_path / "helper.py").write_text(textwrap.dedent(HELPER.format(gain=gain, pull=pull)))
        (tmp_path / "own.py").write_text(SYSTEM)
        environment = os.environ | {
            "CONTIMPACT_CACHE": str(tmp_path / "cache"),
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        done = subprocess.run(
            [sys.executable, str(tmp_path / "own.py")],
            env=environment,
            check=True,
            capture_output=True,
            text=True,
        )
        return done.stdout.split()

    assert run(1, 2) == ["-2.0", "motion_P"]
    assert run(1, 2) == ["-2.0"]
    assert run(3, 2) == ["-6.0", "motion_P"]
    assert run(3, 5) == ["-15.0", "motion_P"]
    assert run(1, 2) == ["-2.0"]


class Shifted(Model):
    """A linear flight about another position than zero, which is stated by shifting it."""

    SYSTEM = "shifted"
    WALLS = (Wall("S", side=1),)
    PARAMETERS = tuple(Parameter(name, "", name) for name in ("k", "omega", "e"))

    def formulas(self, symbols):
        k, omega, e = symbols.values()
        motion = Linear(
            mass=[[1]],
            damping=[[0]],
            stiffness=[[k]],
            force=lambda t: [sympy.cos(omega * t)],
            period=2 * sympy.pi / omega,
        )
        return Formulas(
            period=motion.period,
            walls={"S": e},
            reset=lambda wall, x, v: [-v[0] / 2],
            flight=lambda t, x, v, dt: motion.flight(t, [x[0] - e], v, dt),
            acceleration=lambda t, x, v: motion.acceleration(t, [x[0] - e], v),
        )


def test_a_shifted_linear_flight_is_refused():
    """Flight and acceleration agree, but simulations would take the law for that of x itself."""
    with pytest.raises(InputError, match=r"its linear law gives the acceleration .* not"):
        check_model(Shifted(k=2.0, omega=1.3, e=0.5))
