r"""How many multipliers lie outside the unit circle, counted along the circle.

The multipliers are the roots of :math:`p(\mu) = \det C(\mu)`, the cyclic matrix with its last
coupling multiplied by mu: a polynomial whose degree is at most that of a block. If p has no zero on
the circle, it winds around zero as many times as there are roots inside (the argument principle).
Where an impact comes to rest the highest coefficient vanishes, and may only be known to be small:
a multiplier is infinite there, or as good as that, and counts as one outside.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

from flint import acb, acb_mat, acb_poly, arb

from .equations import Flight

ARCS = 16
DEEPEST = 12
"""Into how many arcs the circle is cut first, and how often each of these."""


def outside(flights: Sequence[Flight]) -> int | None:
    """Return how many multipliers lie outside; None if one may lie on the circle."""
    p = characteristic_polynomial(flights)
    slope = p.derivative()
    total, arcs = arb(0), list(itertools.pairwise(arb(2 * k) / ARCS for k in range(ARCS + 1)))
    cells = [(start, end, 0) for start, end in arcs]
    while cells:
        start, end, depth = cells.pop()
        arc, middle = _at(start.union(end)), _at((start + end) / 2)
        if (p(middle) + slope(arc) * (arc - middle)).contains(0):
            if depth == DEEPEST:
                return None
            half = (start + end) / 2
            cells += [(start, half, depth + 1), (half, end, depth + 1)]
            continue
        total += (p(_at(end)) / p(_at(start))).arg()
    inside = (total / (2 * arb.pi())).unique_fmpz()
    return None if inside is None else len(flights[0][0]) - int(inside)


def _at(half_turns: Any) -> Any:
    """A number of the circle, by its angle over pi."""
    angle = half_turns * arb.pi()
    return acb(angle.cos(), angle.sin())


def characteristic_polynomial(flights: Sequence[Flight]) -> Any:
    """Return p from its values at roots of unity."""
    count = len(flights[0][0]) + 1
    roots = [_at(arb(2 * k) / count) for k in range(count)]
    values = [acb_mat(_cyclic(flights, mu)).det() for mu in roots]
    return acb_poly(
        [
            sum((v * roots[-j * k % count] for k, v in enumerate(values)), acb(0)) / count
            for j in range(count)
        ]
    )


def _cyclic(flights: Sequence[Flight], mu: Any) -> list[list[Any]]:
    """C(mu)."""
    m = len(flights[0][0])
    n, rows = m * len(flights), []
    for k, (_, start, end, _) in enumerate(flights):
        factor = mu if k == len(flights) - 1 else acb(1)
        for r in range(m):
            row = [acb(0)] * n
            for c in range(m):
                row[m * k + c] += start[m * r + c]
                row[(m * k + m + c) % n] += factor * end[m * r + c]
            rows.append(row)
    return rows
