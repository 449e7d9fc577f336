r"""The cyclic linear systems of an orbit with one degree of freedom, in time linear in its length.

An impact has two unknowns (its time and its velocity), a flight two equations. With the blocks
A_k, B_k and the columns L_k of the free parameter, Newton's method and the tangent need::

    [ A1 B1    | L1 ] [ z1 ]   [ f1 ]
    [    A2 B2 | L2 ] [ z2 ] = [ f2 ]
    [ B3    A3 | L3 ] [ z3 ]   [ f3 ]
    [ c1 c2 c3 | c  ] [ l  ]   [ g  ]

Impacts 2 to N are eliminated one after the other: an orthogonal transformation of the four rows
that hold z_k gives two rows R_k z_k + W_k z_1 + V_k z_{k+1} + l_k lambda = f_k, from which z_k
follows, and two rows without it (Wright, SIAM J. Sci. Stat. Comput. 13, 1992: stable where flights
expand, as elimination without pivoting is not). What is left, P z_1 + mu Q z_1, has all that is
asked of the cycle: with mu = 1 the solution, with mu = -1 the period doublings, and as a pencil in
mu the multipliers.

The functions are scalar code in the plain subset of Python that `contimpact.compiling` compiles.
Where they run plainly, vectors are lists and `blocks` and `kept` are lists of tuples.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

from ..arrays import Table, Vector
from ..segments.kernel import Blocks, Setup, differences_grow
from ..segments.segment import AT_SECTION, ELSEWHERE, MEETING

BLOCK = 12
"""Numbers of a flight: 2 residuals, the blocks A and B row by row, 2 derivatives by lambda."""

POSITIONS = 1
"""Place of the walls' positions in the row `fixed`: the forcing period stands before them, the
derived parameters behind."""

UNRESOLVED, GROWN = 2, 3
"""Places in `clock` of a cycle: how many flights compiled code has not followed, and along how many
differences have grown too much; see `notice_growth`."""

KEPT = 15
"""Numbers of an eliminated impact: R (3), W (4), V (4), l (2), f (2)."""

BRIEF = 0.01
"""Part of an orbit's period below which a flight that can vanish is a brief one."""

VANISHED = 1e-6
"""Part of an orbit's period below which rounding decides on a duration, and on what is divided by
it."""

Reduced: TypeAlias = tuple[float, ...]
"""Result of `eliminate`."""


def store(table: Table, row: int, numbers: tuple[float, ...]) -> None:
    """Put a tuple of numbers into a row of a table."""
    table[row] = numbers


def store_compiled(table: Table, row: int, numbers: tuple[float, ...]) -> None:
    """As `store`, for tables that are arrays."""
    for i in range(len(numbers)):
        table[row, i] = numbers[i]


def assemble(
    flight: Callable[..., Blocks],
    setup: Callable[[Vector], Setup],
    kinds: Vector,
    periods: int,
    place: int,
    values: Vector,
    blocks: Table,
    clock: Vector,
    fixed: Table,
    z: Vector,
) -> float:
    """Evaluate every flight of a cycle at the unknowns z = (t_1, v_1, ..., t_N, v_N, lambda).

    ``flight(kind, t0, v0, t1, v1, values)`` gives the `segments.kernel.Blocks` of one flight,
    ``setup(values)`` the `segments.kernel.Setup`; the free parameter has a `place` among the values
    and is set from z. Filled in are `blocks`, a row per flight; `clock`, the orbit's period and its
    derivative by the free parameter; and in `fixed` the forcing period, positions of the walls and
    derived parameters. Returns the sum of all residuals' sizes.
    """
    last = len(kinds) - 1
    values[place] = z[2 * last + 2]
    period, slopes, _, positions, derived, _ = setup(values)
    store(fixed, 0, (period,) + positions + derived)  # noqa: RUF005
    span, drift = periods * period, periods * slopes[0]
    clock[0], clock[1] = span, drift
    total = 0.0
    for k in range(last):
        i = 2 * k
        rows, start, end, free = flight(kinds[k], z[i], z[i + 1], z[i + 2], z[i + 3], values)
        store(blocks, k, rows + start + end + free)
        total += abs(rows[0]) + abs(rows[1])
    i = 2 * last
    rows, start, end, free = flight(kinds[last], z[i], z[i + 1], z[0] + span, z[1], values)
    # the arrival at t_1 + pT moves with T(lambda)
    free = (free[0] + drift * end[0], free[1] + drift * end[2])
    store(blocks, last, rows + start + end + free)
    return total + abs(rows[0]) + abs(rows[1])


def largest_residual(blocks: Table, units: Vector) -> float:
    """Return the largest residual of all flights, given the natural sizes of all.

    NaN where a residual is not a number, which a maximum may lose and a sum does not.
    """
    size, total, count = 0.0, 0.0, len(blocks)
    m = len(units) // count
    for k in range(count):
        row = blocks[k]
        for i in range(m):
            part = abs(row[i]) / units[m * k + i]
            size = max(size, part)
            total += part
    return size if total - total == 0.0 else math.nan


def notice_growth(blocks: Table, count: int, m: int, timed: bool, clock: Vector) -> None:
    """Count the flights that would be computed in pieces; see `segments.integrated_form`."""
    for k in range(count):
        row = blocks[k]
        if differences_grow(row[m : m + m * m], row[m + m * m :], m, timed):
            clock[GROWN] += 1.0


def eliminate(
    blocks: Table, arrivals: Vector, kept: Table, right: float, exact: bool, z: Vector, span: float
) -> Reduced:
    """Eliminate impacts 2 to N; `kept` is filled with a row for each, from row 1.

    `right` is 1 to carry the right side f_k = -residual along, 0 for zeros. Where z solves the
    equations `exact`ly, the derivative of an arrival by its time is the arriving velocity z holds
    (over the duration, back on the surface left), which has not the rounding of larger terms:
    multipliers next to a grazing go with its inverse. `span` is the orbit's period.

    Returns the two rows left, P z_1 + Q z_{N+1} + l lambda = f, as p00, p01, p10, p11, q00, q01,
    q10, q11, l0, l1, f0, f1; sign and logarithm of the product of all det R_k, the sign 0 where one
    vanishes; and det Q as the product of all det B_k over det R_k, which does not cancel.
    """
    count = len(arrivals)
    b = blocks[0]
    p00, p01, p10, p11 = b[2], b[3], b[4], b[5]
    q00, q01, q10, q11 = b[6], b[7], b[8], b[9]
    if exact:
        q00 = arrival_rate(z, 0, 2, arrivals, span, q00)
    l0, l1 = b[10], b[11]
    f0, f1 = -right * b[0], -right * b[1]
    sign, logarithm = 1.0, 0.0
    ratio = q00 * q11 - q01 * q10
    for k in range(1, count):
        g0, g1, u2, x21, u3, x31, b00, b01, b10, b11, m0, m1 = blocks[k]
        x01, x11 = q01, q11
        if exact:
            b00 = arrival_rate(z, k, 2, arrivals, span, b00)
        g0, g1 = -right * g0, -right * g1
        u0, u1 = q00, q10
        norm = math.sqrt(u0 * u0 + u1 * u1 + u2 * u2 + u3 * u3)
        if not norm > 0.0:
            return (0.0,) * 15
        # first reflection: the first column becomes (r00, 0, 0, 0)
        r00 = -norm if u0 >= 0.0 else norm
        u0 -= r00
        c = -1.0 / (r00 * u0)
        s = c * (u0 * x01 + u1 * x11 + u2 * x21 + u3 * x31)
        r01, x11, x21, x31 = x01 - s * u0, x11 - s * u1, x21 - s * u2, x31 - s * u3
        s = c * (u0 * p00 + u1 * p10)
        w00, y10, y20, y30 = p00 - s * u0, p10 - s * u1, -s * u2, -s * u3
        s = c * (u0 * p01 + u1 * p11)
        w01, y11, y21, y31 = p01 - s * u0, p11 - s * u1, -s * u2, -s * u3
        s = c * (u2 * b00 + u3 * b10)
        v00, t10, t20, t30 = -s * u0, -s * u1, b00 - s * u2, b10 - s * u3
        s = c * (u2 * b01 + u3 * b11)
        v01, t11, t21, t31 = -s * u0, -s * u1, b01 - s * u2, b11 - s * u3
        s = c * (u0 * l0 + u1 * l1 + u2 * m0 + u3 * m1)
        h0, h1, m0, m1 = l0 - s * u0, l1 - s * u1, m0 - s * u2, m1 - s * u3
        e0, e1 = f0, f1
        if right != 0.0:
            s = c * (u0 * f0 + u1 * f1 + u2 * g0 + u3 * g1)
            e0, e1, g0, g1 = f0 - s * u0, f1 - s * u1, g0 - s * u2, g1 - s * u3
        # second reflection, of the last three rows: the second column becomes (r01, r11, 0, 0)
        norm = math.sqrt(x11 * x11 + x21 * x21 + x31 * x31)
        if not norm > 0.0:
            return (0.0,) * 15
        r11 = -norm if x11 >= 0.0 else norm
        u1, u2, u3 = x11 - r11, x21, x31
        c = -1.0 / (r11 * u1)
        s = c * (u1 * y10 + u2 * y20 + u3 * y30)
        w10, p00, p10 = y10 - s * u1, y20 - s * u2, y30 - s * u3
        s = c * (u1 * y11 + u2 * y21 + u3 * y31)
        w11, p01, p11 = y11 - s * u1, y21 - s * u2, y31 - s * u3
        s = c * (u1 * t10 + u2 * t20 + u3 * t30)
        v10, q00, q10 = t10 - s * u1, t20 - s * u2, t30 - s * u3
        s = c * (u1 * t11 + u2 * t21 + u3 * t31)
        v11, q01, q11 = t11 - s * u1, t21 - s * u2, t31 - s * u3
        s = c * (u1 * h1 + u2 * m0 + u3 * m1)
        h1, l0, l1 = h1 - s * u1, m0 - s * u2, m1 - s * u3
        f0, f1 = g0, g1
        if right != 0.0:
            s = c * (u1 * e1 + u2 * g0 + u3 * g1)
            e1, f0, f1 = e1 - s * u1, g0 - s * u2, g1 - s * u3
        row = (r00, r01, r11, w00, w01, w10, w11, v00, v01, v10, v11, h0, h1, e0, e1)
        store(kept, k, row)
        det = r00 * r11
        if det < 0.0:
            sign = -sign
        logarithm += math.log(abs(det))
        ratio *= (b00 * b11 - b01 * b10) / det
    return (p00, p01, p10, p11, q00, q01, q10, q11, l0, l1, f0, f1, sign, logarithm, ratio)


def arrival_rate(z: Vector, k: int, m: int, arrivals: Vector, span: float, slope: float) -> float:
    """Return the derivative of the arrival of flight k by its time, from m unknowns per impact.

    It is the velocity, and on flights back to the surface left the velocity over the duration.
    `slope`, what the kernel says, stands where that is zero within rounding, or about to vanish
    with the velocity, and for flights to the section, whose ends have no time.
    """
    if arrivals[k] == AT_SECTION:
        return slope
    last = k + 1 == len(arrivals)
    velocity = z[1] if last else z[m * (k + 1) + 1]
    if arrivals[k] == ELSEWHERE:
        return velocity
    duration = (z[0] + span if last else z[m * (k + 1)]) - z[m * k]
    if arrivals[k] == MEETING and abs(duration) < BRIEF * span:
        return slope
    return velocity / duration if abs(duration) > VANISHED * span else slope


def border(kept: Table, count: int, row: Vector, g: float) -> tuple[float, float, float, float]:
    """Eliminate impacts 2 to N from the row c of the border and its right side g.

    Returns c0, c1, c_lambda and g of the border in z_1 and lambda alone; NaN where an impact cannot
    be eliminated.
    """
    c0, c1, c, from0, from1 = row[0], row[1], row[2 * count], 0.0, 0.0
    for k in range(1, count):
        r00, r01, r11, w00, w01, w10, w11, v00, v01, v10, v11, l0, l1, e0, e1 = kept[k]
        if r00 == 0.0 or r11 == 0.0:
            return math.nan, math.nan, math.nan, math.nan
        a0 = (row[2 * k] + from0) / r00
        a1 = (row[2 * k + 1] + from1 - a0 * r01) / r11
        c0 -= a0 * w00 + a1 * w10
        c1 -= a0 * w01 + a1 * w11
        from0 = -(a0 * v00 + a1 * v10)
        from1 = -(a0 * v01 + a1 * v11)
        c -= a0 * l0 + a1 * l1
        g -= a0 * e0 + a1 * e1
    return c0 + from0, c1 + from1, c, g


def solve_three(
    a0: float,
    a1: float,
    a2: float,
    f: float,
    b0: float,
    b1: float,
    b2: float,
    g: float,
    c0: float,
    c1: float,
    c2: float,
    h: float,
) -> tuple[float, float, float, float]:
    """Solve three equations with partial pivoting; returns x, y, z and the determinant."""
    det = 1.0
    if abs(b0) > abs(a0):
        a0, a1, a2, f, b0, b1, b2, g, det = b0, b1, b2, g, a0, a1, a2, f, -det
    if abs(c0) > abs(a0):
        a0, a1, a2, f, c0, c1, c2, h, det = c0, c1, c2, h, a0, a1, a2, f, -det
    if not abs(a0) > 0.0:
        return math.nan, math.nan, math.nan, 0.0
    s, t = b0 / a0, c0 / a0
    b1, b2, g = b1 - s * a1, b2 - s * a2, g - s * f
    c1, c2, h = c1 - t * a1, c2 - t * a2, h - t * f
    if abs(c1) > abs(b1):
        b1, b2, g, c1, c2, h, det = c1, c2, h, b1, b2, g, -det
    if not abs(b1) > 0.0:
        return math.nan, math.nan, math.nan, 0.0
    s = c1 / b1
    c2, h = c2 - s * b2, h - s * g
    if not abs(c2) > 0.0:
        return math.nan, math.nan, math.nan, 0.0
    z = h / c2
    y = (g - b2 * z) / b1
    return (f - a1 * y - a2 * z) / a0, y, z, det * a0 * b1 * c2


def solve(reduced: Reduced, kept: Table, count: int, row: Vector, g: float, out: Vector) -> float:
    """Solve the bordered system from what `eliminate` returned and kept.

    The row has the border's coefficients, that of lambda last, and g is its right side. Returns the
    determinant of the two rows left and the border; zero (or NaN) where there is no solution.
    """
    p00, p01, p10, p11, q00, q01, q10, q11, l0, l1, f0, f1, sign, _, _ = reduced
    c0, c1, c, g = border(kept, count, row, g)
    t, v, free, det = solve_three(
        p00 + q00, p01 + q01, l0, f0, p10 + q10, p11 + q11, l1, f1, c0, c1, c, g
    )
    if sign == 0.0 or not abs(det) > 0.0:
        return 0.0
    out[0], out[1], out[2 * count] = t, v, free
    next0, next1 = t, v
    for k in range(count - 1, 0, -1):
        r00, r01, r11, w00, w01, w10, w11, v00, v01, v10, v11, l0, l1, e0, e1 = kept[k]
        y0 = e0 - w00 * t - w01 * v - v00 * next0 - v01 * next1 - l0 * free
        y1 = e1 - w10 * t - w11 * v - v10 * next0 - v11 * next1 - l1 * free
        next1 = y1 / r11
        next0 = (y0 - r01 * next1) / r00
        out[2 * k], out[2 * k + 1] = next0, next1
    return det
