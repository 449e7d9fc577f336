"""`check_model`: what a system states is compared, and what contradicts itself is named."""

from __future__ import annotations

import math

import pytest
from test_own_systems import ball, changed, made

from contimpact import ImpactPair, InputError, Oscillator, check_model, find_orbits
from contimpact.models.model import Symmetry
from contimpact.results.scene import read_scene
from contimpact.segments import kernels
from contimpact.segments.kernels import check_once


@pytest.mark.parametrize(
    ("model", "done"),
    [
        (
            ImpactPair(beta=0.5, r=0.3, A=5.0, s=0.34),
            "derived parameters, period, flight from B, flight from T, reset at B, reset at T",
        ),
        (
            ImpactPair(beta=0.0, r_B=0.3, r_T=0.3, A=5.0, s=0.34, forcing="cos(pi*t)+h", h=0.0),
            "derived parameters, period, flight from B, flight from T, reset at B, reset at T, "
            "symmetry at all A, s, M, omega, g",
        ),
        (
            Oscillator(a=1.0, omega=1.0, c=0.1, k=1.0, sigma=1.0, r=0.8),
            "period, flight from S, reset at S",
        ),
    ],
    ids=["pair", "level pair", "oscillator"],
)
def test_the_packages_systems_fit_together(model, done):
    assert ", ".join(check_model(model)) == done


@pytest.mark.parametrize("omega", [1e-8, 1e-4, 1e4])
def test_motion_much_slower_or_faster_than_the_forcing_fits_together(omega):
    """In a period at 1e-8 what the impact has left has decayed: accelerations are rounding."""
    check_model(Oscillator(a=1.0, omega=omega, c=2.0, k=1.0, sigma=0.3, r=0.7))


@pytest.mark.parametrize(
    ("model", "says"),
    [
        (
            lambda: changed(reset=lambda m, p, f: lambda w, x, v: [p["r"] * v[0]]),
            r"^Ball\.formulas: reset at 'P': it sends the body on into the wall: -0\.\d+ becomes",
        ),
        (
            lambda: changed(period=lambda m, p, f: -f.period),
            r"^Ball\.formulas: period: it is -0\.1256",
        ),
        (
            lambda: changed(acceleration=lambda m, p, f: lambda t, x, v: [math.cos(t)]),
            r"^Ball\.formulas: acceleration: it cannot be evaluated on symbols .*sympy\.cos",
        ),
        (
            lambda: changed(jump=lambda m, p, f: lambda w, x, v: (x, [-v[0]])),
            r"^Ball\.formulas: reset: found beside jump; give jump alone",
        ),
        (
            lambda: made(ball(DERIVED_FROM={"Gamma": ("a",)})),
            r"^Ball\.DERIVED_FROM\['Gamma'\]: Gamma depends on g, omega, too",
        ),
        (
            lambda: made(ball(symmetry=lambda self, parameter, harmonics: MIRROR)),
            r"^Ball\.symmetry in a: the .* after 'P' is .*return None where there is no symmetry",
        ),
        (
            lambda: made(ball(symmetry=lambda self, parameter, harmonics: ELSEWHERE)),
            r"^Ball\.symmetry in a: the wall 'P' has none; give each of P its image",
        ),
    ],
    ids=["reset", "period", "numbers", "jump", "derived", "symmetry", "image"],
)
def test_what_does_not_fit_is_named(model, says):
    """By the door itself, and before anything is computed, whatever kernels the cache holds."""
    find_orbits(made(ball()), "1", parameter="a")
    with pytest.raises(InputError, match=says):
        check_model(model())
    with pytest.raises(InputError, match=says):
        find_orbits(model(), "1", parameter="a")


def test_what_was_found_right_is_compared_again_when_the_class_changes():
    """With the same formulas, and what was compared of them in the cache."""
    assert "derived parameters" in check_once(made(ball()))
    with pytest.raises(InputError, match="Gamma depends on"):
        check_once(made(ball(DERIVED_FROM={"Gamma": ("a",)})))
    with pytest.raises(InputError, match="symmetry in a"):
        check_once(made(ball(symmetry=lambda self, parameter, harmonics: MIRROR)))


MIRROR = Symmetry({"P": "P"}, shift=0.5, sign=-1.0)
ELSEWHERE = Symmetry({"P": "Q"}, shift=0.5, sign=-1.0)


def test_a_pair_that_is_not_level_has_no_symmetry_of_a_level_one(monkeypatch):
    always = Symmetry({"B": "T", "T": "B"}, shift=0.5, sign=-1.0)
    monkeypatch.setattr(
        ImpactPair, "symmetry", lambda self, name, harmonics: always if name != "g" else None
    )
    assert any("symmetry" in text for text in check_model(pair_at(g=0.0)))
    with pytest.raises(InputError, match="symmetry in beta: the mean"):
        check_model(pair_at(beta=0.4))
    with pytest.raises(InputError, match="symmetry in beta: the "):
        check_model(pair_at(beta=0.4, g=0.0, forcing="cos(pi*t)+cos(2*pi*t)"))


def pair_at(**values):
    return ImpactPair(**{"beta": 0.4, "r": 0.3, "A": 5.0, "s": 0.34} | values)


def test_it_is_checked_once_for_a_model_and_its_neighbours(monkeypatch, tmp_path):
    counted = []

    def spy(model):
        counted.append(model)
        return check_model(model)

    monkeypatch.setattr("contimpact.segments.checking.check_model", spy)
    monkeypatch.setenv("CONTIMPACT_CACHE", str(tmp_path))
    model = made(ball())
    for value in (1.0, 1.1):
        near = model.replace(a=value * model.values["a"])
        for parameter in ("a", "omega"):
            kernels.Kernels(near, parameter).motion("P")
    assert len(counted) == 1
    kernels.Kernels(made(ball()), "a").motion("P")  # from the cache: it was checked then
    assert len(counted) == 1
    assert math.isfinite(model.values["a"])


def test_a_layer_that_is_thin_beside_steps_of_the_integration_is_no_contradiction():
    pytest.importorskip("heyoka", reason="needs contimpact[ode]")
    modes = {"a": {"x": "v", "v": "0.5*cos(w*t) - x - 0.2*tanh(200*v)"}}
    guards = {"S": {"within": "x <= s", "set": {"v": "-r*v"}}}
    model = {"system": "hybrid", "period": "2*pi/w", "modes": modes, "guards": guards}
    model["parameters"] = {"w": 1.2, "s": 0.6, "r": 0.9}
    follow = {"parameter": "w", "range": [1, 2], "orbits": ["1"]}
    scene = read_scene({"name": "layer", "model": model, "follow": follow})
    assert "flight from S" in check_model(scene.model)
