r"""Matrices of truncated power series with derivatives, block by block, in ball arithmetic.

A `Blocks` is :math:`\sum_k A_{k,0} u^k + \sum_{k,i} A_{k,i} u^k \delta_i`, with
:math:`u^k = 0` from some order on and :math:`\delta_i\delta_j = 0`: the power series of a matrix in
u, and those of its derivatives by some parameters. As one large matrix it would be block
triangular, with every block in it many times (see `linear_flow.toeplitz`, `triangular`); a product
takes each block once.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

from flint import arb, arb_mat, ctx

from .ball_series import Number, around_zero

Matrix: TypeAlias = Any
"""An ``arb_mat``, or None for one that is zero."""

Blocks: TypeAlias = list[list[Matrix]]
"""``blocks[k][i]`` is A_{k,i}."""

SMALL = 6
"""The exponential's series is summed for a norm of 2 to minus this."""


def one(size: int, like: Blocks) -> Blocks:
    """Return the identity, with as many blocks."""
    found: Blocks = [[None for _ in row] for row in like]
    found[0][0] = arb_mat([[int(i == j) for j in range(size)] for i in range(size)])
    return found


def product(a: Blocks, b: Blocks) -> Blocks:
    """Return a product; the first one may have fewer rows than columns."""
    found: Blocks = [[None for _ in row] for row in b]
    for j, row in enumerate(a):
        for k, column in enumerate(b[: len(b) - j]):
            into = found[j + k]
            for i, right in enumerate(column):
                _add(into, i, row[0], right)
            for i, left in enumerate(row[1:], start=1):
                _add(into, i, left, column[0])
    return found


def _add(into: list[Matrix], i: int, left: Matrix, right: Matrix) -> None:
    if left is None or right is None:
        return
    more = left * right
    into[i] = more if into[i] is None else into[i] + more


def mapped(function: Callable[..., Matrix], *all_blocks: Blocks) -> Blocks:
    """Return what a function makes of each block; those that are zero everywhere stay so."""
    return [
        [
            None if all(block is None for block in blocks) else function(*blocks)
            for blocks in zip(*rows, strict=True)
        ]
        for rows in zip(*all_blocks, strict=True)
    ]


def scaled(a: Blocks, factor: Number) -> Blocks:
    """Return a multiple."""
    return mapped(lambda block: block * factor, a)


def added(a: Blocks, b: Blocks) -> Blocks:
    """Return a sum."""
    return mapped(lambda x, y: x if y is None else y if x is None else x + y, a, b)


def subtracted(a: Blocks, b: Blocks) -> Blocks:
    """Return a difference."""
    return mapped(lambda x, y: -y if x is None else x if y is None else x - y, a, b)


def norm(a: Blocks) -> Number:
    """Return the largest sum of absolute values of a row, of all blocks, rounded upwards."""
    tables = [block.tolist() for row in a for block in row if block is not None]
    sums = [
        sum((abs(x) for row in rows for x in row), arb(0)).upper()
        for rows in zip(*tables, strict=True)
    ]
    return max(sums)


def exponential(a: Blocks) -> Blocks:
    """Return exp(A), by its series for A/2^r, squared r times."""
    if len(a) == len(a[0]) == 1:
        return [[a[0][0].exp()]]
    size = norm(a)
    doublings = max(0, math.ceil(math.log2(max(float(size), 1e-300))) + SMALL)
    part, size = scaled(a, arb(2) ** -doublings), size / 2**doublings
    terms = _terms(float(size))
    found = _left_out_added(_series(part, terms), 2 * size**terms / math.factorial(terms))
    for _ in range(doublings):
        found = product(found, found)
    return found


def _terms(size: float) -> int:
    """How many make the rest small beside the precision."""
    terms = 2
    while terms * math.log2(max(size, 1e-300)) - math.lgamma(terms + 1) / math.log(2) > -ctx.prec:
        terms += 1
    return terms


def _series(a: Blocks, terms: int) -> Blocks:
    """The first terms of exp(A), by powers of a power of A (Paterson and Stockmeyer)."""
    step = math.isqrt(terms - 1) + 1
    powers = [one(a[0][0].nrows(), a), a]
    while len(powers) <= step:
        powers.append(product(powers[-1], a))
    total: Blocks | None = None
    for first in reversed(range(0, terms, step)):
        part = _combined(
            powers, [_inverse_factorial(j) for j in range(first, min(first + step, terms))]
        )
        total = part if total is None else added(part, product(total, powers[step]))
    assert total is not None
    return total


def _combined(powers: Sequence[Blocks], factors: Sequence[Number]) -> Blocks:
    total = scaled(powers[0], factors[0])
    for power, factor in zip(powers[1:], factors[1:], strict=False):
        total = added(total, scaled(power, factor))
    return total


def _inverse_factorial(j: int) -> Number:
    return 1 / arb(math.factorial(j))


def _left_out_added(a: Blocks, bound: Number) -> Blocks:
    """The sum with balls in every entry of every block."""
    rows, columns = a[0][0].nrows(), a[0][0].ncols()
    ball = around_zero(bound.upper())
    rest = arb_mat([[ball] * columns for _ in range(rows)])
    return [[rest if block is None else block + rest for block in row] for row in a]
