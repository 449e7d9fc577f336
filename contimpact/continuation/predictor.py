"""The predictor: where the next point is guessed, along the tangent or the chord behind."""

from __future__ import annotations

from typing import TypeVar

from ..arrays import Array, Vector
from .branch import Point
from .metric import norm

Value = TypeVar("Value", float, Array)
"""A number, or many at once."""


def predict(
    z: Vector,
    tangent: Vector,
    chord: Vector,
    secant: bool,
    step: float,
    scale: Vector,
    guess: Vector,
) -> None:
    """Fill `guess` with the point one step ahead of z.

    Written in the plain subset of Python that `contimpact.compiling` compiles.

    Parameters
    ----------
    z, tangent, chord : vector
        The point, its unit tangent, and the way from the point before.
    secant : bool
        Whether to go on along the chord.
    step : float
    scale : vector
    guess : vector
    """
    if not secant:
        for i in range(len(z)):
            guess[i] = z[i] + step * tangent[i]
        return
    size = norm(chord, scale)
    for i in range(len(z)):
        guess[i] = z[i] + step * (chord[i] / size)


def cubic(left: Value, right: Value, rate: Value, next_rate: Value, span: float, s: float) -> Value:
    """Return a value of the cubic through two values with their rates, at a fraction s."""
    t = 1.0 - s
    return (
        left * t * t * (1.0 + 2.0 * s)
        + right * s * s * (1.0 + 2.0 * t)
        + span * s * t * (t * rate - s * next_rate)
    )


def hermite(left: Point, right: Point, span: float, fraction: float) -> Array:
    """Return a value of the cubic through two points with their tangents."""
    return cubic(left.unknowns, right.unknowns, left.tangent, right.tangent, span, fraction)
