"""What normal forms say of grazings against simulated motion; all 30 are in docs/figures."""

from __future__ import annotations

import importlib.util

import pytest
from zoo import ROOT

import contimpact as ci
from contimpact.bifurcations.grazing import CHAOS, IMMEDIATE, JUMP, OVERLAP

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")


def figure(name):
    """A script of docs/figures as a module."""
    path = ROOT / "docs" / "figures" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def pair(word, s, **parameters):
    """An impact pair, an orbit, and the range of s in which that grazes."""
    return ci.ImpactPair(s=s, **parameters), word, "s", (s - 0.03, s + 0.001)


def stop(word, sigma, **parameters):
    """An oscillator with one stop likewise."""
    model = ci.Oscillator(k=1.0, sigma=sigma, **parameters)
    return model, word, "sigma", (sigma - 0.1, sigma + 0.001)


FIG7 = {"beta": "pi/6", "r": 0.3, "A": 5.0}
CASES = {
    "2:1 of Fig. 7": (JUMP, pair("2:1", 0.3, **FIG7)),
    "3:1 of Fig. 7": (OVERLAP, pair("3:1", 0.27, **FIG7)),
    "2:1": (CHAOS, pair("2:1", 0.355, beta=0.533646916, r=0.356058469, A=7.03928913)),
    "2:1, larger multiplier": (
        IMMEDIATE,
        pair("2:1", 0.3297, beta=0.252367882, r=0.491114585, A=7.8844232),
    ),
    "stop": (OVERLAP, stop("1", 0.5, a=3.4068814, omega=1.35466549, c=2.4381966, r=0.347127434)),
}
"""By name: the scenario, and the branch that grazes."""


@pytest.mark.parametrize(
    "case",
    [pytest.param(c, marks=pytest.mark.slow if c == "stop" else pytest.mark.full) for c in CASES],
)
def test_simulations_show_what_normal_forms_say(case):
    name, (model, word, parameter, limits) = CASES[case]
    grazings = figure("grazings")
    orbits = ci.find_orbits(model, word, parameter)
    orbit = next(o for o in orbits if o.physical and o.stable)
    branch = ci.continue_orbit(orbit, parameter, range=limits, events=["G"])
    (entry,) = grazings.real(branch)
    assert entry.scenario.name == name
    found = list(grazings.probes(entry))
    assert len(found) >= 2
    assert [(want, seen) for _, _, want, seen in found if want != seen] == []
