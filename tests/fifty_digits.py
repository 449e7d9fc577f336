"""Kernels evaluated in fifty digits by other ways than the enclosures of `balls`.

A kernel's text is the same, and is what is enclosed. What it calls is computed otherwise, and
without Arb:

- linear flights by their power series in whole numbers, with a fixed point 384 bits long, without
  exponentials of matrices, balancing or doubling;
- free motions by partial fractions over both roots, where balls sum power series in the time;
- Stumpff functions by closed forms below 1/2 and by series up to 30, where balls do the reverse;
- elementary functions by mpmath.

Shared with the package, so that only other tests can see a mistake in one of these: the matrices of
a linear flight (`generators`), which free motions there are and in which order (`TABLES`,
`MOTIONS`), their partial fractions (`_partial_fractions`, `_roots`), and what `many_digits` takes
from mpmath, which gives Stumpff functions of small arguments, too.
"""

from __future__ import annotations

import mpmath
from flint import arb, ctx
from mpmath.libmp import from_man_exp, to_fixed

from contimpact.segments.arithmetic import Arithmetic
from contimpact.segments.exact_transients import _partial_fractions, _roots
from contimpact.segments.linear_flow import Shape, generators
from contimpact.segments.many_digits import many_digits
from contimpact.segments.stumpff import HIGHEST, TOGETHER
from contimpact.segments.transients import MOTIONS, TABLES

MP = mpmath.mp.clone()
MP.dps = 50

BITS = 384
"""Behind the point of whole numbers."""
SPARE = 160
"""Digits of sums that cancel."""


def flow(d, h, directions, dt, *numbers):
    """What `linear_flow.flow` returns."""
    shape, t = Shape(d, h, directions), _fixed(dt)
    given = [MP.mpf(x) for x in numbers]
    matrices = [_entries(matrix) for matrix in generators(shape, given, object)]
    n = shape.size
    whole = [(i + n * k, j + n * k, g) for k in range(directions + 1) for i, j, g in matrices[0]]
    whole += [(i, j + n * k, g) for k, m in enumerate(matrices[1:], 1) for i, j, g in m]
    rows = [_of_position(i, n * (directions + 1), whole, t) for i in range(d)]
    tables = []
    for first in range(0, n * (directions + 1), n):
        part, count = slice(first, first + n), 4 if first == 0 else 2
        tables += [[row[kind][part] for row in rows] for kind in range(count)]
    return [MP.make_mpf(from_man_exp(x, -BITS)) for table in tables for row in table for x in row]


def _fixed(x):
    return to_fixed(MP.mpf(x)._mpf_, BITS)


def _entries(matrix):
    """Those that are not zero, each with its place."""
    places = ((i, j, x) for i, row in enumerate(matrix) for j, x in enumerate(row))
    return [(i, j, _fixed(x)) for i, j, x in places if x]


def _of_position(place, size, matrix, t):
    """Of a row e of the identity, that of a position: e Q, e G exp(Gt), and their rates.

    Q is the sum of G^(k+1) t^k/(k+1)!, exp(Gt) is 1 + tQ, and commutes with G; e G is the row of
    the velocity. Only the rate of Q is divided by t, of whose digits there are many.
    """
    row = [int(i == place) << BITS for i in range(size)]
    term, mean, k = _times(row, matrix), [0] * size, 1
    while any(term):
        mean = [a + b for a, b in zip(mean, term, strict=True)]
        k += 1
        by = k << BITS
        term = [_quotient(x * t, by) for x in _times(term, matrix)]
    arrived = [a + (t * b >> BITS) for a, b in zip(row, mean, strict=True)]
    end = _times(arrived, matrix)
    rate = [((a - b) << BITS) // t for a, b in zip(end, mean, strict=True)]
    return mean, end, rate, _times(end, matrix)


def _times(row, matrix):
    found = [0] * len(row)
    for i, j, g in matrix:
        if row[i]:
            found[j] += row[i] * g
    return [x >> BITS for x in found]


def _quotient(x, by):
    """Rounded towards zero, so that series end."""
    return x // by if x >= 0 else -(-x // by)


def transients(order):
    """What `transients` of that order returns."""

    def function(c, k, t):
        with MP.workdps(SPARE):
            means = [_free_motion(n, b, c, k, t) for n, b in TABLES[order]]
            of = dict(zip(TABLES[order], means, strict=True))
            timed = [of[n, b] * MP.mpf(t) ** (2 * b - 1 - n) for n, b in MOTIONS[order]]
        return tuple(+x for x in (*means, *timed))

    return function


def _free_motion(n, b, c, k, t):
    c, k, t = map(MP.mpf, (c, k, t))
    return _partial_fractions(MP, n, b, _roots(MP, c, k, t), t) * t ** -max(2 * b - 1 - n, 0)


def stumpff(k):
    """c_k."""

    def function(q):
        q = MP.mpf(q)
        if k < 2 or q == 0 or abs(q) >= 0.5:
            return PLAIN.names[f"stumpff{k}"](q)
        with MP.workdps(SPARE):
            x = MP.sqrt(abs(q))
            found = [MP.cos(x), MP.sin(x) / x] if q > 0 else [MP.cosh(x), MP.sinh(x) / x]
            for j in range(k - 1):
                found.append((1 / MP.factorial(j) - found[j]) / q)
        return +found[k]

    return function


def _together(highest):
    functions = [stumpff(k) for k in range(1, highest + 1)]
    return lambda q: tuple(function(q) for function in functions)


PLAIN = many_digits(MP)

REFERENCE = Arithmetic(
    PLAIN.names
    | {"flow": flow}
    | {f"transients{order}": transients(order) for order in TABLES}
    | {f"stumpff{k}": stumpff(k) for k in range(HIGHEST + 1)}
    | {f"stumpffs{n}": _together(n) for n in TOGETHER},
    exact=True,
)


def exactly(number):
    """A number as the ball of no radius that it is."""
    sign, mantissa, exponent, _ = MP.mpf(number)._mpf_
    return arb(((-1) ** sign * int(mantissa), exponent))


def holds(ball, number):
    """Whether a ball holds a number of fifty digits, these rounded."""
    with ctx.workprec(400):
        digits = exactly(number)
        slack = abs(digits) * arb(10) ** -47 + arb(10) ** -60
        return bool(ball.overlaps(digits + arb(0, 1) * slack))
