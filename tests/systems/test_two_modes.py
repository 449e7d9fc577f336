"""A system of one's own with two modes, as the documentation has it, and mistakes in it."""

from __future__ import annotations

import ast
import dataclasses
import importlib.util
import math
import re

import numpy as np
import pytest
import sympy
from zoo import ROOT

from contimpact import InputError, Simulator, check_model, find_orbits, settle
from contimpact.models.model import Guard
from contimpact.simulation.automaton import Automaton

PATH = ROOT / "examples" / "bilinear.py"
VALUES = {"a": 1.0, "omega": 1.5, "c": 0.2, "k_l": 1.0, "k_r": 4.0}


def loaded():
    found = importlib.util.spec_from_file_location("bilinear", PATH)
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


Bilinear = loaded().Bilinear


def test_it_takes_less_than_fifty_lines():
    text = PATH.read_text("utf-8")
    tree = ast.parse(text)
    end = next(node.lineno for node in tree.body if isinstance(node, ast.If))
    assert end < 50


def test_with_equal_springs_it_is_the_harmonic_response():
    model = Bilinear(**VALUES | {"k_r": 1.0})
    assert "passage at P" in check_model(model)
    (orbit,) = (o for o in find_orbits(model, "PN", parameter="omega") if o.stable and o.physical)
    size = 1.5 / math.hypot(1.0 - 1.5**2, 0.2 * 1.5)
    assert orbit.velocities == pytest.approx([size, -size], rel=1e-12)


@pytest.mark.full
def test_a_simulation_settles_on_its_orbit():
    model = Bilinear(**VALUES)
    (orbit,) = (o for o in find_orbits(model, "PN", parameter="omega") if o.stable and o.physical)
    simulator = Simulator(model)
    found = settle(simulator, simulator.state("P", 0.0, 1.0))
    assert (found.word, found.period) == ("PN", 1)
    assert found.velocities == pytest.approx(orbit.velocities, abs=1e-12)
    rate = sum(math.log(abs(mu)) for mu in found.multipliers)
    assert rate == pytest.approx(-0.2 * simulator.period, rel=1e-10)


P, N = Bilinear.WALLS


@pytest.mark.parametrize(
    ("walls", "says"),
    [
        ((P,), "WALLS: mode 'right' is ended by no guard; give it a guard"),
        (
            (Guard("P", 1, "left", "rigth"), N),
            "'P' has the mode 'rigth'; the modes are left, right",
        ),
    ],
)
def test_guards_that_do_not_fit_are_refused_where_they_are_defined(walls, says):
    with pytest.raises(InputError, match=re.escape(says)):
        type("Bilinear", (Bilinear,), {"WALLS": walls})


def one(formulas, symbols):
    return dataclasses.replace(formulas, flight={"left": formulas.flight["left"]})


def exchanged(formulas, symbols):
    left, right = formulas.acceleration.values()
    return dataclasses.replace(formulas, acceleration={"left": right, "right": left})


def apart(formulas, symbols):
    return dataclasses.replace(formulas, walls={"P": sympy.Integer(0), "N": sympy.Integer(1)})


def back(formulas, symbols):
    return dataclasses.replace(formulas, reset=lambda wall, x, v: [-v[0]])


MISTAKES = [
    (one, "formulas: flight: found 'left'; give one for each mode: 'left', 'right'"),
    (exchanged, "flight from 'P' in the mode 'right': its velocity contradicts the acceleration"),
    (apart, "formulas: walls: 'P' leads into the mode 'right' 1 beyond 'N'"),
    (back, "jump at 'P': the body leaves the mode 'right' at once by 'N'"),
    (lambda f, s: s["k"], "no parameter 'k'; its parameters are a, omega, c, k_l, k_r"),
    (lambda f, s: None, "formulas: it returns None; return Formulas(...)"),
]


@pytest.mark.parametrize(("change", "says"), MISTAKES, ids=[says[:20] for _, says in MISTAKES])
def test_formulas_that_do_not_fit_are_named(change, says):
    class Wrong(Bilinear):
        SYSTEM = "wrong"

        def formulas(self, symbols):
            return change(super().formulas(symbols), symbols)

    with pytest.raises(InputError, match=re.escape(says)):
        check_model(Wrong(**VALUES))


def test_a_word_that_the_graph_does_not_have_is_refused_with_what_could_follow():
    with pytest.raises(InputError, match="PP has P after P; after P can come N"):
        find_orbits(Bilinear(**VALUES), "PP", parameter="omega")


class Hysteretic(Bilinear):
    """The spring changes where x rises through zero, and back only below -0.2."""

    SYSTEM = "hysteretic"

    def formulas(self, symbols):
        found = super().formulas(symbols)
        return dataclasses.replace(found, walls=found.walls | {"N": -sympy.Rational(1, 5)})


@pytest.mark.full
def test_modes_may_begin_within_their_guards():
    """No guard of the mode lies on the surface at which it begins."""
    model = Hysteretic(**VALUES)
    assert "passage at N" in check_model(model)
    orbits = [o for o in find_orbits(model, "PN", parameter="omega") if o.stable and o.physical]
    simulator = Simulator(model)
    assert isinstance(simulator.machine, Automaton)
    found = settle(simulator, simulator.state("P", 0.0, 1.0))
    assert found.word == "PN"
    near = [o for o in orbits if o.velocities == pytest.approx(found.velocities, abs=1e-10)]
    assert len(near) == 1
    assert np.poly(found.multipliers) == pytest.approx(np.poly(near[0].multipliers), abs=1e-10)
