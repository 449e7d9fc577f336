"""What systems accept as parameters, and how they say no."""

from __future__ import annotations

import math

import numpy as np
import pytest

from contimpact.errors import InputError
from contimpact.systems import SYSTEMS, system, systems_in
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator

PAIR = {"beta": 0.5, "r": 0.3, "A": 5.0, "s": 0.4}
OSCILLATOR = {"a": 1.0, "omega": 2.0, "c": 0.1, "k": 1.0, "sigma": 0.5, "r": 0.8}


def without(values, *names):
    return {name: value for name, value in values.items() if name not in names}


def refused(where, build, *args, **kwargs):
    with pytest.raises(InputError) as caught:
        build(*args, **kwargs)
    assert caught.value.where == where
    assert isinstance(caught.value, ValueError)
    return str(caught.value)


# Defaults and order


def test_defaults_are_the_papers():
    model = ImpactPair(**PAIR)
    assert model.values == PAIR | {"M": 0.1245, "omega": 5 * math.pi, "g": 9.8}
    assert list(model.values) == ["beta", "r", "A", "s", "M", "omega", "g"]
    assert model.options == {"forcing": "cos(pi*t)"}
    assert model.unknowns_per_impact == 2


def test_values_are_floats():
    model = ImpactPair(beta=0, r=1, A=5, s=np.float64(0.5))
    assert all(type(value) is float for value in model.values.values())


def test_the_order_given_does_not_matter():
    one, other = ImpactPair(**PAIR), ImpactPair(**dict(reversed(PAIR.items())))
    assert list(one.values.items()) == list(other.values.items())
    assert one.identity == other.identity


def test_split_restitution():
    model = ImpactPair(**without(PAIR, "r"), r_B=0.2, r_T=0.9)
    assert list(model.values) == ["beta", "r_B", "r_T", "A", "s", "M", "omega", "g"]
    assert set(model.declared) == set(model.values)
    assert model.identity != ImpactPair(**PAIR).identity


# Refusals


@pytest.mark.parametrize("name", PAIR)
def test_pair_missing(name):
    message = refused(name, ImpactPair, **without(PAIR, name))
    assert "missing" in message


@pytest.mark.parametrize("name", OSCILLATOR)
def test_oscillator_missing(name):
    assert "missing" in refused(name, Oscillator, **without(OSCILLATOR, name))


def test_missing_restitution_says_both_ways():
    message = refused("r", ImpactPair, **without(PAIR, "r"))
    assert "r_B and r_T" in message


@pytest.mark.parametrize(("given", "missing"), [("r_B", "r_T"), ("r_T", "r_B")])
def test_half_a_split(given, missing):
    refused(missing, ImpactPair, **without(PAIR, "r"), **{given: 0.3})


@pytest.mark.parametrize("given", [{"r_B": 0.3}, {"r_T": 0.3}, {"r_B": 0.3, "r_T": 0.3}])
def test_restitution_given_twice(given):
    message = refused("r", ImpactPair, **PAIR, **given)
    assert "given together with" in message


@pytest.mark.parametrize("name", ["rho", "R", "r_X", "", "gbar", "d"])
def test_unknown(name):
    message = refused(name, ImpactPair, **PAIR | {name: 1.0})
    assert "r_B" in message


OUT_OF_RANGE = [
    ("r", -0.1),
    ("r", -5e-324),
    ("r", 1.0000000000000002),
    ("r", 1.1),
    ("A", 0.0),
    ("A", -0.0),
    ("A", -5.0),
    ("s", 0),
    ("s", -0.1),
    ("beta", 1.6),
    ("beta", -1.6),
    ("M", 0.0),
    ("omega", 0.0),
    ("g", -9.8),
]


@pytest.mark.parametrize(("name", "value"), OUT_OF_RANGE)
def test_out_of_range(name, value):
    message = refused(name, ImpactPair, **PAIR | {name: value})
    assert repr(float(value)) in message
    assert "it must be" in message


@pytest.mark.parametrize("name", ["beta", "r", "A", "s", "M", "omega", "g"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_not_finite(name, value):
    refused(name, ImpactPair, **PAIR | {name: value})


@pytest.mark.parametrize("name", OSCILLATOR)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_oscillator_not_finite(name, value):
    refused(name, Oscillator, **OSCILLATOR | {name: value})


@pytest.mark.parametrize(
    "value", [True, False, "five", "", None, 1j, [5.0], {}, b"5", np.array([5.0])]
)
@pytest.mark.parametrize("name", ["A", "r"])
def test_not_a_number(name, value):
    message = refused(name, ImpactPair, **PAIR | {name: value})
    assert f"found {value!r}" in message or (isinstance(value, str) and repr(value) in message)


def test_split_values_are_checked():
    message = refused("r_T", ImpactPair, **without(PAIR, "r"), r_B=0.2, r_T=1.2)
    assert "r_T" in message


@pytest.mark.parametrize("edge", [{"r": 0}, {"r": 1}, {"beta": math.pi / 2}, {"g": 0}])
def test_edges_are_inside(edge):
    assert ImpactPair(**PAIR | edge)


@pytest.mark.parametrize(
    "given",
    [
        {"c": 0.0, "omega": 1.0},
        {"c": -0.0, "omega": 1.0},
        {"c": 0, "omega": 0.1, "k": 0.01},  # 0.1**2 is not 0.01, but by a rounding
        {"c": 0, "omega": 3.0, "k": 9.0},
    ],
)
def test_undamped_resonance(given):
    assert "resonance" in refused("omega", Oscillator, **OSCILLATOR | given)


@pytest.mark.parametrize(
    "given",
    [
        {"c": 1e-300, "omega": 1.0},
        {"c": -0.1, "omega": 1.0},
        {"c": 0.0, "omega": 1.0 + 1e-12},
        {"c": 0.0, "omega": 2.0},
        {"a": -1.0},
        {"a": 0.0},
        {"sigma": -3.0},
    ],
)
def test_beside_undamped_resonance(given):
    assert Oscillator(**OSCILLATOR | given)


@pytest.mark.parametrize("k", [0.0, -1.0])
def test_stiffness_is_positive(k):
    refused("k", Oscillator, **OSCILLATOR | {"k": k})


# Neighbours


def test_replace_leaves_the_original_alone():
    model = ImpactPair(**PAIR)
    other = model.replace(A=6, s=0.5)
    assert (other.values["A"], other.values["s"]) == (6.0, 0.5)
    assert type(other.values["A"]) is float
    assert model.values == ImpactPair(**PAIR).values
    assert list(other.values) == list(model.values)
    assert other.identity == model.identity
    assert type(other) is ImpactPair


def test_replace_nothing():
    model = ImpactPair(**PAIR)
    assert model.replace().values == model.values


@pytest.mark.parametrize(("name", "value"), [*OUT_OF_RANGE, ("A", math.nan), ("A", True)])
def test_replace_checks(name, value):
    refused(name, ImpactPair(**PAIR).replace, **{name: value})


@pytest.mark.parametrize("name", ["r_B", "forcing", "d", "nothing"])
def test_replace_unknown(name):
    message = refused(name, ImpactPair(**PAIR).replace, **{name: 0.3})
    assert "it has beta, r, A, s, M, omega, g" in message


def test_replace_split():
    model = ImpactPair(**without(PAIR, "r"), r_B=0.2, r_T=0.9).replace(r_T=0.8)
    assert (model.values["r_B"], model.values["r_T"]) == (0.2, 0.8)
    refused("r", model.replace, r=0.5)


def test_require():
    model = ImpactPair(**PAIR)
    assert model.require("s", "follow.parameter").unit == "m"
    refused("follow.parameter", model.require, "x", "follow.parameter")


# Printing and identity


def test_repr_can_be_read_back():
    model = ImpactPair(**PAIR, forcing="sin(pi*t)")
    text = repr(model)
    assert text.startswith("ImpactPair(forcing='sin(pi*t)', beta=0.5, r=0.3, A=5, s=0.4, M=0.1245")
    again = eval(text, {"ImpactPair": ImpactPair})
    # Numbers are shown to 12 digits.
    assert list(again.values.values()) == pytest.approx(list(model.values.values()), rel=1e-11)
    assert again.options == model.options
    assert repr(Oscillator(**OSCILLATOR)) == (
        "Oscillator(a=1, omega=2, c=0.1, k=1, sigma=0.5, r=0.8)"
    )


def test_identity_is_of_formulas_not_of_values():
    model = ImpactPair(**PAIR)
    assert model.identity == model.replace(A=7.0).identity
    assert model.identity != ImpactPair(**PAIR, forcing="sin(pi*t)").identity
    assert model.identity != Oscillator(**OSCILLATOR).identity


# Symmetry

ODD, EVEN = [0.0, 1, 1.0, 0.0, 3, 0.2, 0.1], [0.0, 1, 1.0, 0.0, 2, 0.2, 0.0]


def test_symmetry_of_the_level_pair():
    """Ends exchanged half a period later, velocities reversed."""
    model = ImpactPair(**PAIR | {"beta": 0})
    symmetry = model.symmetry("s", ODD)
    assert symmetry.walls == {"B": "T", "T": "B"}
    assert (symmetry.shift, symmetry.sign) == (0.5, -1.0)
    assert model.symmetry("g", ODD) is not None


@pytest.mark.parametrize(
    ("given", "parameter", "harmonics"),
    [
        ({"beta": 0}, "beta", ODD),
        ({"beta": 0}, "s", EVEN),
        ({"beta": 0}, "s", [0.1, *ODD[1:]]),
        ({"beta": 0.5, "g": 0}, "g", ODD),
        ({"beta": 0, "r_B": 0.3, "r_T": 0.4}, "s", ODD),
        ({"beta": 0, "r_B": 0.3, "r_T": 0.3}, "r_B", ODD),
    ],
)
def test_no_symmetry(given, parameter, harmonics):
    values = PAIR | given if "r_B" not in given else without(PAIR, "r") | given
    assert ImpactPair(**values).symmetry(parameter, harmonics) is None


def test_equal_ends_are_symmetric():
    model = ImpactPair(**without(PAIR, "r") | {"beta": 0, "r_B": 0.3, "r_T": 0.3})
    assert model.symmetry("s", ODD) is not None


def test_the_oscillator_has_no_symmetry():
    assert Oscillator(**OSCILLATOR).symmetry("omega", [math.nan]) is None


# The list of systems


def test_systems_by_name():
    assert system("impact-pair") is ImpactPair
    assert system("oscillator") is Oscillator
    assert [system(name).SYSTEM for name in SYSTEMS] == list(SYSTEMS)


def test_a_system_is_one_file(tmp_path):
    """Whatever else is in the folder; a base class without a name is none."""
    lines = [f'class {name}(Model):\n    """A {name}."""\n' for name in ("Base", "Swing", "Slide")]
    text = "\n\n".join(
        [lines[0], *(f'{a}\n    SYSTEM = "my-{i}"\n' for i, a in enumerate(lines[1:]))]
    )
    (tmp_path / "swings.py").write_text(text, encoding="utf-8")
    (tmp_path / "data.py").write_text("class Data:\n    size = 3\n", encoding="utf-8")
    found = systems_in([str(tmp_path)])
    assert found == {"my-0": "swings:Swing", "my-1": "swings:Slide"}


def test_no_such_system():
    message = refused("model.system", system, "impact pair", "model.system")
    assert "impact-pair" in message


def test_derived_parameters_depend_on_what_is_declared(pair):
    """`DERIVED_FROM` is what stands in the formulas."""
    sympy = pytest.importorskip("sympy")
    model = pair()
    symbols = {name: sympy.Symbol(name) for name in model.values}
    formulas = model.formulas(symbols)
    for name in model.DERIVED:
        free = {str(symbol) for symbol in formulas.derived[name].free_symbols}
        assert free == set(model.DERIVED_FROM[name])
        for parameter in model.values:
            assert (name in model.varying(parameter)) == (parameter in free)


def test_units(pair, oscillator):
    assert [pair().unit(name) for name in ("s", "d", "q")] == ["m", "dimensionless", ""]
    assert oscillator().unit("a") == ""


def test_a_derived_parameter_is_refused_with_those_it_is_derived_from():
    model = ImpactPair(beta=0.5, r=0.3, A=5.0, s=0.5)
    with pytest.raises(InputError, match="'d': it is derived from A, s, M, omega; it has"):
        model.replace(d=0.2)
