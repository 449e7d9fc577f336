"""The folds of `pendulum.py` in thirty digits, by Taylor series and nothing of contimpact.

    python benchmarks/reference_folds.py

At a fold the orbit's monodromy matrix has the eigenvalue 1: that is solved for together with the
orbit, by Newton's method whose derivatives are differences over 1e-14.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mpmath import cos, det, eye, fdot, lu_solve, matrix, mp, mpf, pi, sin

A, C = mpf(3) / 20, mpf(1) / 10
GUESSES = (("0.255", "1.568", "0.78063"), ("0.775", "0.4125", "0.87216"))
"""Angle and velocity at t = 0, and omega."""

DIGITS, ORDER, STEPS, ITERATIONS = 34, 30, 48, 6
DIFFERENCE = "1e-14"


def main() -> None:
    mp.dps = DIGITS
    for guess in GUESSES:
        print(mp.nstr(fold([mpf(g) for g in guess]), 30))


def fold(z: Sequence[Any]) -> Any:
    """Return omega at the fold near a guess."""
    for _ in range(ITERATIONS):
        here = residual(z)
        jacobian = matrix(3, 3)
        for k in range(3):
            moved = [x + (mpf(DIFFERENCE) if i == k else 0) for i, x in enumerate(z)]
            jacobian[:, k] = (residual(moved) - here) / mpf(DIFFERENCE)
        step = lu_solve(jacobian, -here)
        z = [x + dx for x, dx in zip(z, step, strict=True)]
    if max(abs(s) for s in step) > mpf(10) ** -28:
        raise ArithmeticError("Newton's method did not converge")
    return z[2]


def residual(z: Sequence[Any]) -> Any:
    """What a period changes of the state, and det(M - 1)."""
    x, v, omega = z
    h, one = 2 * pi / omega / STEPS, eye(2)
    state = [x, v, *one[:, 0], *one[:, 1]]
    for step in range(STEPS):
        state = advanced(state, step * h, omega, h)
    monodromy = matrix([[state[2], state[4]], [state[3], state[5]]])
    return matrix([state[0] - x, state[1] - v, det(monodromy - one)])


def advanced(state: Sequence[Any], t: Any, omega: Any, h: Any) -> list[Any]:
    """Angle, velocity and two solutions of the variational equations, one step later."""
    x, v, *varied = ([s] for s in state)
    sine, cosine = [sin(x[0])], [cos(x[0])]
    forcing = A, omega * t  # A cos(omega t + k pi/2) omega^k / k! is the k-th coefficient.
    for k in range(ORDER):
        size = forcing[0] * cos(forcing[1] + k * pi / 2)
        forcing = forcing[0] * omega / (k + 1), forcing[1]
        x.append(v[k] / (k + 1))
        v.append((size - C * v[k] - sine[k]) / (k + 1))
        for y, w in (varied[:2], varied[2:]):
            bent = fdot(cosine, reversed(y))
            y.append(w[k] / (k + 1))
            w.append((-C * w[k] - bent) / (k + 1))
        slopes = [j * x[j] for j in range(1, k + 2)]
        rates = fdot(slopes, reversed(cosine)), fdot(slopes, reversed(sine))
        sine.append(rates[0] / (k + 1))
        cosine.append(-rates[1] / (k + 1))
    return [mp.polyval(s[::-1], h) for s in (x, v, *varied)]


if __name__ == "__main__":
    main()
