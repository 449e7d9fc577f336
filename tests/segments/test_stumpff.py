"""Stumpff functions against a hypergeometric series at 40 digits.

c_0, c_1, c_2 have zeros, where no relative bound holds: an argument is known to half a unit in its
last place, which moves c_k by q c_k' eps/2. Errors are therefore measured against |c_k| + |q c_k'|.
"""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest
import sympy

from contimpact.models.symbolic import Stumpff
from contimpact.segments.transients import HIGHEST, STUMPFF_ARRAY, STUMPFF_SCALAR

ORDERS = range(HIGHEST + 1)

# Largest errors measured, scalar or array: 5.4e-16 where |q| < 4 (c_2, a square); beyond, the
# recurrence subtracts c_{k-2} from nearly itself and loses more with every k, up to 6.9e-13 for
# c_9 next to the threshold. Series of c_10 and c_11 are summed further, up to 20, beyond which they
# lose 1.3e-14 and 3.9e-14. Bounds are twice what was measured on arguments denser than these.
WITHIN = 1.2e-15
BEYOND = {
    0: 8e-16,
    1: 8e-16,
    2: 8e-16,
    3: 1.2e-15,
    4: 3e-15,
    5: 7e-15,
    6: 2.5e-14,
    7: 8e-14,
    8: 4e-13,
    9: 1.4e-12,
    10: 3e-14,
    11: 1e-13,
}


def reference(k, q):
    """1F2(1; (k+1)/2, (k+2)/2; -q/4)/k!, the defining series of c_k summed by mpmath."""
    q = mp.mpf(q)
    return mp.hyp1f2(1, mp.mpf(k + 1) / 2, mp.mpf(k + 2) / 2, -q / 4) / mp.factorial(k)


def size(k, q):
    slope = (k * reference(k + 2, q) - reference(k + 1, q)) / 2
    return abs(reference(k, q)) + abs(q * slope)


def both_signs(values):
    return np.concatenate([values, -values])


NEAR = both_signs(
    np.concatenate([np.logspace(-300, -12, 25), np.logspace(-12, np.log10(3.99), 60)])
)
THRESHOLD = both_signs(
    np.concatenate(
        [end + np.linspace(-1e-3, 1e-3, 21) for end in (4, 20)]
        + [[np.nextafter(4, 0), np.nextafter(4, 9)]]
    )
)
FAR = both_signs(np.concatenate([np.linspace(4.001, 100, 60), np.logspace(2, 5.5, 40)]))


def worst(k, arguments):
    """Largest errors of the scalar and of the array function, as parts of `size`."""
    scalar, array = STUMPFF_SCALAR[f"stumpff{k}"], STUMPFF_ARRAY[f"stumpff{k}"](arguments)
    errors = [0.0, 0.0]
    with mp.workdps(40):
        for q, from_array in zip(arguments.tolist(), array.tolist(), strict=True):
            exact, scale = reference(k, q), size(k, q)
            errors[0] = max(errors[0], float(abs(scalar(q) - exact) / scale))
            errors[1] = max(errors[1], float(abs(from_array - exact) / scale))
    return errors


@pytest.mark.parametrize("k", ORDERS)
def test_small_arguments(k):
    assert max(worst(k, NEAR)) < WITHIN


@pytest.mark.parametrize("k", ORDERS)
def test_around_the_end_of_the_series(k):
    assert max(worst(k, THRESHOLD)) < BEYOND[k]


@pytest.mark.parametrize("k", ORDERS)
@pytest.mark.quick(3)
def test_large_arguments(k):
    assert max(worst(k, FAR)) < BEYOND[k]


@pytest.mark.parametrize("k", range(3, HIGHEST + 1))
def test_relative_error_where_there_are_no_zeros(k):
    """For k > 2 the functions are positive: below |q| = 100 the bound holds relative to them."""
    arguments = np.concatenate([NEAR, THRESHOLD, FAR[np.abs(FAR) < 100]])
    scalar = STUMPFF_SCALAR[f"stumpff{k}"]
    with mp.workdps(40):
        error = max(float(abs(scalar(q) / reference(k, q) - 1)) for q in arguments.tolist())
    assert error < max(2e-15, BEYOND[k])  # measured: 9e-16 for k = 3 to 6.9e-13 for k = 9


@pytest.mark.parametrize("k", ORDERS)
@pytest.mark.parametrize("q", [0.0, -0.0, 5e-324, -5e-324, 1e-300])
def test_at_zero(k, q):
    assert STUMPFF_SCALAR[f"stumpff{k}"](q) == 1 / math.factorial(k)
    assert STUMPFF_ARRAY[f"stumpff{k}"](q) == 1 / math.factorial(k)


@pytest.mark.parametrize("k", ORDERS)
def test_no_jump_where_the_series_ends(k):
    for threshold in (4.0, -4.0):
        beside = np.nextafter(threshold, 0.0)
        here, there = (STUMPFF_SCALAR[f"stumpff{k}"](float(q)) for q in (threshold, beside))
        assert here == pytest.approx(there, rel=BEYOND[k])


@pytest.mark.parametrize("k", ORDERS)
def test_arrays_of_any_shape(k):
    q = np.array([[-30.0, -4.0, -1.0], [0.0, 2.0, 50.0]])
    function = STUMPFF_ARRAY[f"stumpff{k}"]
    values = function(q)
    assert values.shape == q.shape
    assert function(q.tolist()).shape == q.shape
    assert function(2.0).shape == ()
    flat = [STUMPFF_SCALAR[f"stumpff{k}"](x) for x in q.ravel().tolist()]
    # The same formula; NumPy's sine and sinh differ from the C library's in the last place.
    np.testing.assert_allclose(values.ravel(), flat, rtol=max(1e-15, BEYOND[k]))


@pytest.mark.parametrize("k", range(HIGHEST - 1))
@pytest.mark.parametrize("q", [-20.0, -0.3, 0.0, 1.7, 60.0])
def test_derivative_rule(k, q):
    """What kernels are differentiated with: c_k' = (k c_{k+2} - c_{k+1})/2."""
    x = sympy.Symbol("x")
    rule = Stumpff(sympy.Integer(k), x).diff(x)
    with mp.workdps(40):
        slope = mp.diff(lambda y: reference(k, y), q)
        by_rule = (k * reference(k + 2, q) - reference(k + 1, q)) / 2
        assert abs(slope - by_rule) < mp.mpf(10) ** -18
    assert sympy.simplify(rule - (k * Stumpff(k + 2, x) - Stumpff(k + 1, x)) / 2) == 0
