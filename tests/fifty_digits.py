"""Kernels evaluated in fifty digits by other ways than the enclosures of `balls`.

A kernel's text is the same, and is what is enclosed. What it calls is computed otherwise, and
without Arb:

- linear flights by their power series in whole numbers, with a fixed point 384 bits long, without
  exponentials of matrices, balancing or doubling;
- free motions by partial fractions over both roots, where balls sum power series in the time;
- Stumpff functions by closed forms below 1/2 and by series up to 30, where balls do the reverse;
- elementary functions by MPFR if gmpy2 is there, which is ten times as fast, or by mpmath.

Shared with the package, so that only other tests can see a mistake in one of these: the matrices of
a linear flight (`generators`), which free motions there are and in which order (`TABLES`,
`MOTIONS`), and the series of `bounded`, which gives Stumpff functions of small arguments.
"""

from __future__ import annotations

import math

import mpmath
from flint import arb
from mpmath.libmp import MPZ

from contimpact.segments.bounded import many_digits
from contimpact.segments.linear_flow import Shape, generators
from contimpact.segments.segment import Arithmetic
from contimpact.segments.transients import HIGHEST, MOTIONS, TABLES, TOGETHER

try:
    import mpfr
except ModuleNotFoundError:
    mpfr = None

MP = mpmath.mp.clone()
MP.dps = 50

DIGITS = mpfr.Context(50) if mpfr else MP
"""The quicker one of both kinds of numbers."""

BITS = 384
"""Behind the point of whole numbers."""
SPARE = 160
"""Digits of sums that cancel."""


def flow(ctx):
    """`linear_flow.flow`."""

    def function(d, h, directions, dt, *numbers):
        shape, t = Shape(d, h, directions), _fixed(ctx, dt)
        given = [ctx.mpf(x) for x in numbers]
        matrices = [_entries(ctx, matrix) for matrix in generators(shape, given, object)]
        n = shape.size
        whole = [
            (i + n * k, j + n * k, g) for k in range(directions + 1) for i, j, g in matrices[0]
        ]
        whole += [(i, j + n * k, g) for k, m in enumerate(matrices[1:], 1) for i, j, g in m]
        rows = [_of_position(i, n * (directions + 1), whole, t) for i in range(d)]
        tables = []
        for first in range(0, n * (directions + 1), n):
            part, count = slice(first, first + n), 4 if first == 0 else 2
            tables += [row[kind][part] for kind in range(count) for row in rows]
        return [ctx.ldexp(ctx.mpf(x), -BITS) for row in tables for x in row]

    return function


def _fixed(ctx, x):
    return MPZ(int(ctx.ldexp(ctx.mpf(x), BITS)))


def _entries(ctx, matrix):
    """Those that are not zero, each with its place."""
    places = ((i, j, x) for i, row in enumerate(matrix) for j, x in enumerate(row))
    return [(i, j, _fixed(ctx, x)) for i, j, x in places if x]


def _of_position(place, size, matrix, t):
    """Of a row e of the identity, that of a position: e Q, e G exp(Gt), and their rates.

    Q is the sum of G^(k+1) t^k/(k+1)!, exp(Gt) is 1 + tQ, and commutes with G; e G is the row of
    the velocity. Only the rate of Q is divided by t, of whose digits there are many.
    """
    row = [MPZ(i == place) << BITS for i in range(size)]
    timed = [(i, j, g * t >> BITS) for i, j, g in matrix]
    term, mean, k = _times(row, matrix), [MPZ(0)] * size, 1
    while any(term):
        mean = [a + b for a, b in zip(mean, term, strict=True)]
        k += 1
        term = [_quotient(x, k) for x in _times(term, timed)]
    arrived = [a + (t * b >> BITS) for a, b in zip(row, mean, strict=True)]
    end = _times(arrived, matrix)
    rate = [((a - b) << BITS) // t for a, b in zip(end, mean, strict=True)]
    return mean, end, rate, _times(end, matrix)


def _times(row, matrix):
    found = [MPZ(0)] * len(row)
    for i, j, g in matrix:
        if row[i]:
            found[j] += row[i] * g
    return [x >> BITS for x in found]


def _quotient(x, by):
    """Rounded towards zero, so that series end."""
    return x // by if x >= 0 else -(-x // by)


def transients(ctx, order):
    """`transients` of that order."""

    def function(c, k, t):
        with ctx.workdps(SPARE):
            c, k, t = map(ctx.mpf, (c, k, t))
            roots = _roots(ctx, c, k, t)
            motions = {(n, b): _free_motion(n, b, roots, t) for n, b in TABLES[order]}
            means = {(n, b): x / _power(t, max(2 * b - 1 - n, 0)) for (n, b), x in motions.items()}
        found = [*means.values(), *(motions[of] for of in MOTIONS[order])]
        return tuple(+x for x in found)

    return function


def _roots(ctx, c, k, t):
    """Those of s^2 + cs + k, two: the distance to the other one, the root, its exponential."""
    apart = ctx.sqrt(ctx.mpc(c * c - 4 * k))
    roots = [(distance, (distance - c) / 2) for distance in (apart, -apart)]
    return [(distance, root, ctx.exp(root * t)) for distance, root in roots]


def _free_motion(n, b, roots, t):
    """The inverse Laplace transform of s^n/(s^2 + cs + k)^b, by partial fractions."""
    parts = [
        (-1) ** (b - j)
        * math.comb(2 * b - j - 1, b - j)
        * _of_root(n, j, root, grown, t)
        / _power(distance, 2 * b - j)
        for distance, root, grown in roots
        for j in range(1, b + 1)
    ]
    return sum(parts).real


def _of_root(n, j, root, grown, t):
    """That of s^n/(s - root)^j; `grown` is exp(root t)."""
    if n >= 0:
        return grown * sum(
            math.comb(n, i) * _power(root, n - i) * _power(t, j - 1 - i) / math.factorial(j - 1 - i)
            for i in range(min(n, j - 1) + 1)
        )
    found = (grown - 1) / root
    for i in range(1, j):
        found = (grown * _power(t, i) / math.factorial(i) - found) / root
    return found


def _power(x, n):
    """By products, which for complex numbers of MPC is quickest."""
    return math.prod([x] * n)


def stumpff(ctx, k, plain):
    """c_k; `plain` is that of `bounded`."""

    def function(q):
        q = ctx.mpf(q)
        if k < 2 or q == 0 or abs(q) >= 0.5:
            return plain(q)
        with ctx.workdps(SPARE):
            x = ctx.sqrt(abs(q))
            found = [ctx.cos(x), ctx.sin(x) / x] if q > 0 else [ctx.cosh(x), ctx.sinh(x) / x]
            for j in range(k - 1):
                found.append((1 / ctx.factorial(j) - found[j]) / q)
        return +found[k]

    return function


def _together(functions):
    return lambda q: tuple(function(q) for function in functions)


PLAIN = many_digits(MP)


def reference(ctx):
    """Kernels in the numbers of a context."""
    names = many_digits(ctx).names
    each = [stumpff(ctx, k, names[f"stumpff{k}"]) for k in range(HIGHEST + 1)]
    return Arithmetic(
        names
        | {"flow": flow(ctx)}
        | {f"transients{order}": transients(ctx, order) for order in TABLES}
        | {f"stumpff{k}": function for k, function in enumerate(each)}
        | {f"stumpffs{n}": _together(each[1 : n + 1]) for n in TOGETHER},
        exact=True,
    )


REFERENCE = reference(DIGITS)


def holds(ball, number):
    """Whether a ball holds a number of fifty digits, these rounded."""
    exact = number if hasattr(number, "_mpf_") else MP.mpf(number)
    sign, mantissa, exponent, _ = exact._mpf_
    slack = abs(float(number)) * 1e-47 + 1e-60
    digits = arb(((-1) ** sign * int(mantissa), exponent), slack)
    return math.isfinite(slack) and bool(ball.overlaps(digits))
