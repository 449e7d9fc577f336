"""Text to number and to SymPy expression: what is read, and all that is refused."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from contimpact.errors import InputError
from contimpact.models.expressions import (
    CONSTANTS,
    FUNCTIONS,
    LARGEST_EXPONENT,
    LONGEST_TEXT,
    Extent,
    UnboundedError,
    check_expression,
    number,
    sympy_expression,
    values_of,
)

t = sympy.Symbol("t", real=True)

NUMBERS = {
    "5": 5.0,
    "  -2.5e-3 ": -0.0025,
    "pi": math.pi,
    "pi/6": math.pi / 6,
    "-pi/2": -math.pi / 2,
    "5*pi": 5 * math.pi,
    "+3": 3.0,
    "--3": 3.0,
    "2**-3": 0.125,
    "-2**2": -4.0,
    "2**3**2": 512.0,
    "(1 + 2)*3 - 4/8": 8.5,
    "sin(pi/6)": math.sin(math.pi / 6),
    "sqrt(2)/2": math.sqrt(2) / 2,
    "exp(-1)*log(10)": math.exp(-1) * math.log(10),
    "atan(1)*4": math.pi,
    "2**64": 2.0**64,
    "1e-400": 0.0,
}

NOT_EXPRESSIONS = [
    "",
    "   ",
    "(",
    "1 +",
    "1 2",
    "pi pi",
    "x",
    "__import__('os')",
    "__import__('os').system('true')",
    "eval('1')",
    "open('file')",
    "().__class__",
    "(1).real",
    "pi.real",
    "sin.__globals__",
    "lambda: 1",
    "(lambda: 1)()",
    "[1]",
    "(1, 2)",
    "1, 2",
    "{1: 2}",
    "{1}",
    "[1][0]",
    "[x for x in (1,)]",
    "sum(x for x in (1, 2))",
    "1 if 1 else 2",
    "1 < 2",
    "1 and 2",
    "not 1",
    "~1",
    "1 // 2",
    "5 % 3",
    "1 << 70",
    "1 ^ 2",
    "1 @ 2",
    "1j",
    "True",
    "None",
    "...",
    "'1'",
    "b'1'",
    "f'{1}'",
    "x := 1",
    "(x := 1)",
    "x = 1",
    "1; 2",
    "import os",
    "await 1",
    "yield",
    "sin",
    "sin + 1",
    "pi()",
    "pi(1)",
    "sin()",
    "sin(1, 2)",
    "sin(x=1)",
    "sin(*[1])",
    "sin(1)(2)",
    "gamma(1)",
    "nan",
    "inf",
    "-inf",
    "1\n+ 2",
    "1\0",
    "\u200b1",
]

NO_REAL_NUMBER = [
    "1/0",
    "0/0",
    "0**-1",
    "sqrt(-1)",
    "log(0)",
    "log(-1)",
    "acos(2)",
    "(-8)**(1/3)",
    "1e400",
    "-1e400",
    "1e308*10",
    "exp(1000)",
    "1e999 - 1e999",
    "(10**64)**64",
]


@pytest.mark.parametrize(("text", "value"), NUMBERS.items())
def test_number(text, value):
    # One function call or operation per node, in the same order: equal but for the last digit.
    assert number(text, "here") == pytest.approx(value, rel=3e-16)


@pytest.mark.parametrize("text", NUMBERS)
def test_both_readers_agree(text):
    # SymPy evaluates to 17 digits; e.g. sin(pi/6) is 1/2 there and 0.49999999999999994 here.
    expected = number(text, "here")
    assert float(sympy_expression(text, "here", {})) == pytest.approx(expected, rel=5e-16)


@pytest.mark.parametrize("text", NOT_EXPRESSIONS)
def test_refused_by_both(text):
    with pytest.raises(InputError, match=r"^model\.beta: "):
        number(text, "model.beta")
    with pytest.raises(InputError, match=r"^model\.forcing: "):
        sympy_expression(text, "model.forcing", {"t": t})


@pytest.mark.parametrize("text", NO_REAL_NUMBER)
def test_not_a_finite_real_number(text):
    with pytest.raises(InputError, match="give a finite number"):
        number(text, "here")


@pytest.mark.parametrize("sign", ["", "-"])
def test_exponents(sign):
    assert number(f"1**{sign}{LARGEST_EXPONENT}", "here") == 1.0
    for reader in (lambda text: number(text, "x"), lambda text: sympy_expression(text, "x", {})):
        for exponent in (LARGEST_EXPONENT + 1, 10**9, "1e400", "9**9**9"):
            with pytest.raises(InputError, match=r"exponent|accepted"):
                reader(f"1.1**({sign}{exponent})")


def test_exponent_of_a_variable():
    assert sympy_expression("t**64", "here", {"t": t}) == t**64
    with pytest.raises(InputError, match="an exponent of 65"):
        sympy_expression("t**65", "here", {"t": t})


def test_length():
    assert number("1" + " " * (LONGEST_TEXT - 1), "here") == 1.0
    with pytest.raises(InputError, match=f"an expression of {LONGEST_TEXT + 1} characters"):
        number("1" + " " * LONGEST_TEXT, "here")


@pytest.mark.parametrize(
    "text",
    [
        "(" * 990 + "1" + ")" * 990,
        "-" * 1900 + "1",
        "1+" * 990 + "1",
        "2**" * 600 + "1",
        "sin(" * 390 + "1" + ")" * 390,
    ],
    ids=["brackets", "signs", "sum", "powers", "calls"],
)
def test_deep_nesting_is_refused_or_evaluated(text):
    # How deep a tree may be depends on Python's own limits; it must never be another exception.
    for reader in (lambda text: number(text, "x"), lambda text: sympy_expression(text, "x", {})):
        try:
            value = float(reader(text))
        except InputError:
            continue
        assert math.isfinite(value)


def test_error_is_short_and_says_what_is_accepted():
    with pytest.raises(InputError) as caught:
        number("frobnicate(1) + " + "1 + " * 400 + "1", "model.parameters.beta")
    error = caught.value
    assert error.where == "model.parameters.beta"
    assert "frobnicate(1)" in error.found
    assert "..." in error.found
    assert all(name in error.accepted for name in (*FUNCTIONS, *CONSTANTS))
    assert len(str(error)) < 400
    assert str(error.within("scene")) == "scene." + str(error)


def test_symbols_are_named_in_the_error():
    with pytest.raises(InputError, match=r"\bt\b.*\bu\b"):
        sympy_expression("w", "here", {"t": t, "u": sympy.Symbol("u")})


def test_sympy_expression():
    read = sympy_expression("cos(pi*t)**3 - 2*t/3", "here", {"t": t})
    assert sympy.simplify(read - (sympy.cos(sympy.pi * t) ** 3 - 2 * t / 3)) == 0
    assert read.free_symbols == {t}


def test_symbol_may_not_be_called():
    with pytest.raises(InputError):
        sympy_expression("t(1)", "here", {"t": t})


@pytest.mark.parametrize("name", FUNCTIONS)
def test_functions(name):
    # At 1/2 every function is real and smooth; libraries differ by a unit in the last place.
    assert number(f"{name}(1/2)", "here") == getattr(math, name)(0.5)
    assert float(sympy_expression(f"{name}(1/2)", "here", {})) == pytest.approx(
        getattr(math, name)(0.5), rel=4e-16
    )


def test_numbers_do_not_import_sympy():
    code = (
        "import sys; from contimpact.models.expressions import number; number('sin(pi/6)**2', 'x');"
        "sys.exit('sympy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@settings(deadline=None, derandomize=True, max_examples=200, database=None)
@given(st.text(max_size=40))
@pytest.mark.full
def test_any_text_is_a_number_or_refused(text):
    try:
        value = number(text, "here")
    except InputError:
        return
    assert math.isfinite(value)


TREES = st.recursive(
    st.floats(0.001, 1000.0).map(repr) | st.integers(1, 99).map(str) | st.just("pi"),
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from("+-*/"), inner).map(lambda e: f"({e[0]} {e[1]} {e[2]})"),
        inner.map(lambda e: f"-({e})"),
        inner.map(lambda e: f"sin({e})"),
        inner.map(lambda e: f"({e})**2"),
    ),
    max_leaves=8,
)


@settings(deadline=None, derandomize=True, max_examples=200, database=None)
@given(TREES)
def test_arithmetic_is_pythons(text):
    try:
        expected = eval(text, {"sin": math.sin, "pi": math.pi})
    except ArithmeticError:
        expected = math.nan
    if math.isfinite(expected):
        assert number(text, "here") == pytest.approx(expected, rel=1e-15)
    else:
        with pytest.raises(InputError):
            number(text, "here")


ENDLESS = [
    "(((9+t-t)**64)**64)**64",
    "((((9+t-t)**8)**8)**8)**8",
    "2**(t-t+10**9)",
    "2**((t+1)*10**9-t*10**9)",
    "cos(pi*t)**(10**9*cos(t-t))",
    "cos(pi*t)**(t/t)",
    "(t**64)**2",
    "sin(" * 60 + "pi*t" + ")" * 60,
    "sinh(sinh(sinh(99+t-t)))",
    "exp(exp(exp(9*cos(pi*t))))",
    "(" * 60 + "1+cos(pi*t)" + ")**2" * 60,
]


@pytest.mark.parametrize("text", ENDLESS)
def test_expressions_without_end_are_refused_before_they_are_evaluated(text):
    with pytest.raises(InputError, match=r"^forcing: .* beyond |powers of powers|deep in"):
        check_expression(text, "forcing", ("t",))


@pytest.mark.parametrize(
    ("text", "most"),
    [
        ("cos(pi*t)+cos(2*pi*t+0.3)", 10),
        ("cos(pi*t)**64", 100),  # 65 terms
        ("(1+cos(pi*t))**64", 1e4),  # 2145 terms
        ("+".join(["cos(pi*t)"] * 100), 400),
    ],
)
def test_the_work_of_expanding_is_estimated(text, most):
    assert 0.1 * most < check_expression(text, "here", ("t",)) <= most


@settings(deadline=None, derandomize=True, max_examples=200, database=None)
@given(TREES, st.floats(-3, 3))
def test_an_extent_holds_the_values(text, where):
    """What bounds exponents and arguments has to be a bound."""
    text = text.replace("pi", "t")
    extent = Extent(-3.0, 3.0)
    functions = {"sin": lambda x: x.of("sin") if isinstance(x, Extent) else math.sin(x)}
    try:
        value = eval(text, {"sin": math.sin, "t": where})
        bound = eval(text, functions | {"t": extent})
    except (ArithmeticError, UnboundedError):
        return
    if isinstance(bound, Extent):
        slack = 1e-9 * abs(value)
        assert bound.low - slack <= value <= bound.high + slack


def test_values_of_an_expression_on_arrays():
    times = np.linspace(0.0, 2.0, 7)
    found = values_of("asin(cos(pi*t)/2)**2 - 2**sin(t)", "here", {"t": times})
    assert found == pytest.approx(np.arcsin(np.cos(np.pi * times) / 2) ** 2 - 2 ** np.sin(times))


@pytest.mark.parametrize("text", ["Abs(x)", "2*sign(x)", "Max(x, 0)", "heaviside (x)"])
def test_functions_that_are_not_smooth_are_refused_with_what_to_state_instead(text):
    with pytest.raises(InputError, match="a mode for each side"):
        check_expression(text, "here", ("x",))


def test_a_division_by_zero_is_refused_where_it_is_written():
    with pytest.raises(InputError, match=r"here: 'x/\(1-1\)' has no finite real value"):
        check_expression("x/(1-1)", "here", ("x",))
