"""Numbers of a statement reach kernels as the doubles that they were written as."""

from __future__ import annotations

import ast
import copy
import math
import pickle
import random
import re

import pytest
import sympy

from contimpact.errors import InputError
from contimpact.models.expressions import sympy_expression
from contimpact.models.machine import row_of
from contimpact.models.symbolic import fourier_series
from contimpact.models.symbols import exact, whole_quotient
from contimpact.orbits.search import find_orbits
from contimpact.results.scene import read_scene
from contimpact.segments.codegen import KernelWriter, Printer
from contimpact.segments.segment import kernel_of

TEMPTING = ["0.66666667", "0.333333333333", "1.00000000001", "2.7182818", "0.70710678", "0.1"]


def written(rng):
    """The text of a double: of few digits, of all, and close to nice numbers."""
    digits = rng.choice((2, 3, 6, 8, 12, 17))
    text = f"{rng.uniform(0.05, 20.0):.{digits}g}"
    return rng.choice((text, text, rng.choice(TEMPTING)))


def computed(e):
    """What a kernel in floats makes of a number."""
    text = f"def f():\n    return {Printer().doprint(e)}\n"
    return kernel_of("f", text, "<f>")()


def doubles(text):
    """The constants of a kernel that are no short quotients, as floats."""
    found = ((int(p), int(q)) for p, q in re.findall(r"ratio\((\d+), (\d+)\)", text))
    return {p / q for p, q in found if max(p, q) > 2**20}


def long(texts):
    """Those of some numbers that are no short quotients."""
    return {float(text) for text in texts if not exact(float(text)).is_Rational}


@pytest.mark.full
def test_every_double_is_printed_as_itself():
    rng = random.Random(1)
    for _ in range(3000):
        value = rng.choice((1, -1)) * rng.uniform(1, 10) * 10.0 ** rng.randint(-250, 250)
        value = float(f"{value:.{rng.randint(1, 17)}g}")
        assert computed(exact(value)) == value == computed(sympy_expression(repr(value), "x", {}))
    for value in (0, 1, -3, 0.5, -1.25, 2**53, 2**53 + 2, 10**30, 1e-300, 5e-324, 1e300):
        assert computed(exact(value)) == float(value)


def test_few_bits_are_a_quotient_of_whole_numbers():
    assert exact(0.5) == sympy.Rational(1, 2)
    assert exact(-3.0) == sympy.Integer(-3)
    assert sympy_expression("2/3", "x", {}) == sympy.Rational(2, 3)


def test_a_double_is_a_constant_with_a_value():
    x = sympy.Symbol("x", real=True)
    tenth = exact(0.1)
    assert tenth == exact(0.1) != exact(0.2)
    assert tenth * x - tenth * x == 0 == sympy.diff(tenth, x)
    assert pickle.loads(pickle.dumps(tenth * x)) == copy.deepcopy(tenth * x) == tenth * x
    assert sympy.sqrt(tenth**2) == tenth
    assert tenth.evalf(40) == sympy.Rational(0.1).evalf(40)
    assert max([exact(-0.7), exact(0.6)], key=abs) == exact(-0.7)


@pytest.mark.parametrize("seed", range(6))
def test_all_numbers_of_a_hybrid_scene_reach_its_kernels(seed):
    rng = random.Random(seed)
    texts = [written(rng) for _ in range(9)]
    k, c, a, w, r, position, row, shift, after = texts
    nonlinear = f" - {after}*x**3" if seed % 2 else ""
    scene = {
        "name": "n",
        "model": {
            "system": "hybrid",
            "period": f"2*pi/{w}",
            "parameters": {"d": 0.1},
            "define": {"drive": f"{a}*cos({w}*t)"},
            "modes": {"f": {"x": "v", "v": f"drive - {c}*v - {k}*(x - {shift}){nonlinear}"}},
            "guards": {"S": {"within": f"{row}*x <= d + {position}", "set": {"v": f"-{r}*v"}}},
        },
        "follow": {"parameter": "d", "range": [0, 1], "orbits": ["S"]},
    }
    writer = KernelWriter(read_scene(scene).model, ("d",))
    text = writer.write("flight_S_S") + writer.write("motion_S") + writer.write("setup")
    used = {w, c, k, a, r, position, row, shift} | ({after} if nonlinear else set())
    assert doubles(text) == long(used)


@pytest.mark.parametrize("seed", range(3))
def test_all_numbers_of_a_linear_machine_reach_its_kernels(seed):
    rng = random.Random(100 + seed)
    texts = [written(rng) for _ in range(10)]
    m, n, c, k, a, w, r, position, one, other = texts
    r = f"0.{rng.randint(10**7, 10**8)}"
    scene = {
        "name": "n",
        "model": {
            "system": "linear",
            "coordinates": ["x", "y"],
            "mass": [float(m), n],
            "damping": [[c, 0], [0, "q"]],
            "stiffness": [[float(k), 0], [0, 1]],
            "force": [f"{a}*sin({w}*t)", 0],
            "period": f"2*pi/{w}",
            "parameters": {"d": 0.1, "q": 0.1},
            "guards": {"S": {"within": f"{one}*x - {other}*y <= d + {position}", "restitution": r}},
        },
        "follow": {"parameter": "d", "range": [0, 1], "orbits": ["S"]},
    }
    writer = KernelWriter(read_scene(scene).model, ("d",))
    text = writer.write("flight_S_S") + writer.write("motion_S") + writer.write("loss_S")
    assert doubles(text) == long((m, n, c, k, a, w, r, position, one, other))


@pytest.mark.parametrize("text", TEMPTING)
def test_coefficients_of_forcings_are_doubles(text):
    _, ((order, cosine, sine),) = fourier_series(f"{text}*cos(pi*t)", "forcing", sympy.Integer(2))
    assert (order, computed(cosine), computed(sine)) == (1, float(text), 0)


@pytest.mark.full
def test_events_are_those_of_the_double():
    """Zero velocity of the oscillator, in closed form."""
    given = {
        "system": "hybrid",
        "period": "2*pi/w",
        "parameters": {"w": 2.33, "d": -0.1},
        "modes": {"f": {"x": "v", "v": "cos(w*t) - 0.1*v - 0.66666667*x"}},
        "guards": {"S": {"within": "x <= d", "set": {"v": "-0.8*v"}}},
    }
    scene = read_scene(
        {
            "name": "n",
            "model": given,
            "follow": {"parameter": "d", "range": [-0.3, 0.4], "orbits": ["S"]},
        }
    )
    from contimpact.diagrams.explore import follow

    k, c, w = float("0.66666667"), 0.1, 2.33
    places = [abs(e.value) for e in follow(scene).events if e.kind == "V"]
    assert places
    for place in places:
        assert place == pytest.approx(1 / math.hypot(k - w * w, c * w), rel=1e-14)


@pytest.mark.parametrize(("one", "other", "order"), [("0.1", "0.3", 3), ("0.7", "0.7", 1)])
def test_frequencies_are_multiples_to_the_rounding_of_doubles(one, other, order):
    assert whole_quotient(exact(float(other)) / exact(float(one))) == order
    w = sympy.Symbol("w", real=True)
    assert whole_quotient(exact(float(other)) * w / (exact(float(one)) * w)) == order


def test_other_frequencies_are_refused():
    assert whole_quotient(exact(0.30000001) / exact(0.1)) is None
    assert whole_quotient(sympy.Symbol("w")) is None
    with pytest.raises(InputError, match="period"):
        fourier_series("cos(3.14159*t)", "forcing", sympy.Integer(2))


def test_a_forcing_of_frequencies_in_decimals_has_closed_flights():
    given = {
        "system": "hybrid",
        "period": "2*pi/0.1",
        "parameters": {"d": 0.5},
        "modes": {"f": {"x": "v", "v": "cos(0.3*t) + 0.2*cos(0.1*t) - 0.1*v - 0.7*x"}},
        "guards": {"S": {"within": "x <= d", "set": {"v": "-0.8*v"}}},
    }
    scene = {
        "name": "n",
        "model": given,
        "follow": {"parameter": "d", "range": [0, 1], "orbits": ["S"]},
    }
    model = read_scene(scene).model
    text = KernelWriter(model, ("d",)).write("flight_S_S")
    assert any(
        isinstance(n, ast.Call) and getattr(n.func, "id", "") == "flow"
        for n in ast.walk(ast.parse(text))
    )
    assert find_orbits(model, "S", parameter="d")


@pytest.mark.parametrize(
    ("text", "row"),
    [
        ("0.66666667*x", (0.66666667, 0.0)),
        ("-(x - y)/3", (-1 / 3, 1 / 3)),
        ("2*(0.1*x + y*pi)", (0.2, 2 * math.pi)),
        ("x + 1e-13*x**2", None),
        ("x + 1e-13", None),
        ("x*y", None),
        ("1/x", None),
        ("sin(x)", None),
        ("x - x", None),
        ("2**x", None),
    ],
)
def test_factors_of_a_guard_are_those_written(text, row):
    if row is None:
        with pytest.raises(InputError, match=r"guards\.S\.within"):
            row_of(text, "guards.S.within", ("x", "y"))
    else:
        assert row_of(text, "guards.S.within", ("x", "y")) == row


def test_powers_of_negative_numbers_have_no_value():
    """Python's own are complex numbers."""
    x = sympy.Symbol("x'", real=True)
    text = f"def f(x):\n    return {Printer().doprint(x ** exact(0.3))}\n"
    assert kernel_of("f", text, "<f>")(2.0) == 2.0**0.3
    with pytest.raises(ValueError, match="math domain error"):
        kernel_of("f", text, "<f>")(-2.0)
