r"""Krawczyk's test: a zero of a system exists, and is the only one, in a box.

For a box X with midpoint x, a matrix Y near the inverse of f'(x), and a matrix J that encloses f'
on X, let

.. math:: K = x - Y f(x) + (I - Y J)(X - x) .

If K lies in the interior of X, there is exactly one zero of f in X, it lies in K, and f' is regular
on X (Krawczyk 1969; Moore 1977; Neumaier, Interval Methods for Systems of Equations, 1990, ch. 5).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
from flint import arb, arb_mat, ctx

from .equations import BallProblem, Balls

Function: TypeAlias = Callable[[list[Any]], list[Any]]

STEPS = 12
"""Newton steps at most; doubles are right to some digits from the beginning."""

ROUNDING = 1e-18
"""Steps below this that fall no more are those of rounding, where a system is ill-conditioned."""

WIDTHS = (1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)
"""Radii of boxes tried, relative, the widest first: the wider, the more the uniqueness says."""


def refined(space: BallProblem, system: Function, guess: Sequence[float]) -> Balls | None:
    """Return a zero to the digits of the context, by Newton's iteration; nothing is proven by it.

    None where the iteration does not converge.
    """
    x, before = [arb(value) for value in guess], arb(1)
    inverse = preconditioner(space, system, x)
    for _ in range(STEPS if inverse is not None else 0):
        step = (inverse * column([f.mid() for f in system(x)])).entries()
        if not all(s.is_finite() for s in step):
            return None
        x = [(value - s).mid() for value, s in zip(x, step, strict=True)]
        size = max(abs(s).upper() / (1 + abs(v)).lower() for s, v in zip(step, x, strict=True))
        if size < arb(2) ** (12 - ctx.prec) or (size < ROUNDING and 2 * size > before):
            return x
        before = size
    return None


def preconditioner(space: BallProblem, system: Function, x: Balls) -> Any:
    """Return the inverse of the Jacobian in doubles, as an exact matrix; None without one."""
    matrix = as_doubles(space.linearised(system, [value.mid() for value in x]))
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return None
    return arb_mat(inverse.tolist()) if np.isfinite(inverse).all() else None


def as_doubles(matrix: Any) -> Any:
    """Return the midpoints of an ``arb_mat``."""
    return np.array([[float(x.mid()) for x in row] for row in matrix.tolist()])


def krawczyk(space: BallProblem, system: Function, box: Balls, inverse: Any = None) -> Balls | None:
    """Return K for a box, if the test proves exactly one zero in it, else None.

    Parameters
    ----------
    space : BallProblem
    system : callable
    box : list of arb
    inverse : arb_mat, optional
        Y, any exact matrix; by default the inverse of the Jacobian at the midpoint, in doubles.
    """
    middle = [value.mid() for value in box]
    inverse = preconditioner(space, system, middle) if inverse is None else inverse
    if inverse is None:
        return None
    offset = column([b - m for b, m in zip(box, middle, strict=True)])
    defect = _identity(len(box)) - inverse * space.linearised(system, box)
    change = (defect * offset - inverse * column(system(middle))).entries()
    image = [m + c for m, c in zip(middle, change, strict=True)]
    inside = (b.contains_interior(i) for b, i in zip(box, image, strict=True))
    return image if all(inside) else None


def column(values: Sequence[Any]) -> Any:
    return arb_mat([[value] for value in values])


def _identity(size: int) -> Any:
    return arb_mat([[int(i == j) for j in range(size)] for i in range(size)])


def proven(
    space: BallProblem, system: Function, guess: Sequence[float]
) -> tuple[Balls, Balls] | None:
    """Return a box with exactly one zero around a guess, and a small one that holds the zero.

    The box holds the guess. None where the test fails.
    """
    found = refined(space, system, guess)
    if found is None:
        return None
    inverse = preconditioner(space, system, found)
    for width in WIDTHS:
        box = [_around(x, g, width) for x, g in zip(found, guess, strict=True)]
        if krawczyk(space, system, box, inverse) is not None:
            small = _smallest(space, system, found, inverse)
            return None if small is None else (box, small)
    return None


def _around(x: Any, guess: float, width: float) -> Any:
    """A ball around a zero that holds the guess."""
    least = 2 * abs(x - guess).upper()
    return x + arb(0, 1) * max(float(least), width * max(1.0, abs(guess)))


def _smallest(space: BallProblem, system: Function, x: Balls, inverse: Any) -> Balls | None:
    """The smallest box, nearly, on which the test succeeds: again on what it gives, made wider."""
    for slack in (16, 24, 32, 44):
        radius = arb(2) ** (slack - ctx.prec)
        box = [value + arb(0, 1) * radius * (1 + abs(value)) for value in x]
        image = krawczyk(space, system, box, inverse)
        if image is not None:
            tight = [i.mid() + arb(0, 1) * 8 * i.rad() for i in image]
            return tight if krawczyk(space, system, tight, inverse) is not None else box
    return None
