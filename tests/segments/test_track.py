"""Linear flights as polynomials: their states, and every extremum of every coordinate."""

from __future__ import annotations

import math

import numpy as np
import pytest
from zoo import TWO_MASSES

from contimpact.segments.kernels import Kernels
from contimpact.segments.segment import ARRAYS, evaluate_in
from contimpact.segments.touches import interior_touches
from contimpact.segments.track import DEGREE, sign_changes, track_of
from contimpact.systems.two_masses import TwoMasses

STATE = [0.3, -0.2, 0.7, 0.1, math.cos(0.4), math.sin(0.4), 1.0]


def masses(**given):
    return TwoMasses(**(TWO_MASSES | given))


@pytest.mark.parametrize("stiffness", [1.0, 1e6])
@pytest.mark.parametrize("length", [1e-9, 0.3, 7.0])
def test_states_are_those_of_the_flow(stiffness, length):
    """Measured: 3e-16 for each unit of the angle."""
    model = masses(k1=stiffness)
    kernels, values = Kernels(model, "omega"), list(model.values.values())
    track = track_of(kernels.law("A")(0.2, 0.7, 0.1, -0.3, *values), length)
    for row, other in (((1, 0), "A"), ((0, 1), "B")):
        curve, kernel = track.along(row), kernels.gap("A", other)
        for dt in np.linspace(0.0, length, 9).tolist():
            exact = kernel(0.2, 0.7, 0.1, -0.3, dt, *values)
            sizes = (1.0, math.sqrt(stiffness), stiffness)
            for found, truth, size in zip(curve((), dt, ()), exact, sizes, strict=True):
                assert abs(found - truth) < 2e-15 * size * (3.0 + length * math.sqrt(stiffness))


def polynomial(*roots):
    """Coefficients of a product, of the degree that tracks have."""
    found = np.polynomial.polynomial.polyfromroots(roots)
    return np.pad(found, (0, DEGREE + 1 - len(found)))


@pytest.mark.parametrize(
    "roots",
    [
        (),
        (0.3,),
        (0.2, 0.7),
        (0.5, 0.5 + 1e-6),
        (0.1, 0.1001, 0.9),
        (1e-9,),
        (1.0 - 1e-12,),
        (0.25, 0.5, 0.75),
        tuple(np.linspace(0.03, 0.99, 9)),
    ],
)
def test_every_change_of_sign_is_found(roots):
    found = sign_changes(np.array([polynomial(*roots, -3.0)]))
    assert found == pytest.approx(roots, abs=1e-9)


def test_a_zero_between_two_pieces_is_found_once_at_least():
    falling = polynomial(1.0)
    rising = polynomial(0.0)
    found = sign_changes(np.array([falling, rising]))
    assert found
    assert found == pytest.approx([1.0] * len(found))


@pytest.mark.full
def test_touches_of_several_modes():
    """A small fast motion on a slow one: all extrema of both coordinates, against a fine mesh."""
    model = masses(k2=900.0, sigma_1=0.9, sigma_2=0.8, c1=0.0, c2=0.0)
    kernels, values = Kernels(model, "omega"), list(model.values.values())
    assert kernels.linear("A")
    leave, span = np.array([[0.2, 0.7, 0.85, -0.3]]), 6.0
    (flight,) = interior_touches(kernels, "A", values, leave, span)
    times = np.linspace(0.0, span, 4001)[1:-1]
    for wall, position, touch in zip("AB", (0.9, 0.8), flight.touches, strict=True):
        x = evaluate_in(kernels.gap("A", wall), ARRAYS)(*leave[0], times, *values)[0]
        inside = (x[1:-1] > x[:-2]) & (x[1:-1] >= x[2:])
        assert np.count_nonzero(inside) > 3
        nearest = position - np.max(x[1:-1][inside])
        assert nearest - 1e-3 < touch.gap <= nearest + 1e-12
