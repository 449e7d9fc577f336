"""Zeros of the acceleration in flight, between which the velocity is monotone.

They follow from its harmonics where it depends on time alone, and otherwise from a Chebyshev
interpolant resolved to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import TypeAlias

import numpy as np

from ..arrays import Array, Vector
from .arithmetic import Kernel

Rounding: TypeAlias = Callable[[float], float]
"""Returns a bound of a function's rounding error at a time."""

_DEGREES = (16, 32, 64)

CUTS, FASTEST = 12, 30
"""In halves, of a piece that is not resolved: at first, and where something in it oscillates."""

_NOISE = 1e-5
"""Last coefficients below this part of the largest that no longer fall are the rounding of the
function itself, which grows with the angles in it."""

_EVERY = 3
"""Cuts after which a piece that is not resolved is compared with the function's rounding."""

_SMALLEST = 2.0**-1000
"""Sums of smaller terms are rounded to a multiple of the least number there is."""

_LAYER = 1e-12
"""Part of the largest coefficient by which the interpolant may miss the function at an end. No node
lies in the boundary layer of a strongly damped flight, whose rest looks smooth."""

_MISSED = 1e-6
"""Part of it by which an interpolant that is smooth misses an end behind such a layer, which is too
thin for higher degrees as well."""

_ALONE = 1.01
"""A mean that is larger than all oscillation about it, by so much, leaves no room for a zero, nor
for the pair beside the real axis that a touch may have become by rounding."""


def time_zeros(harmonics: Sequence[float], period: float) -> list[float] | None:
    """Return where in [0, period) the acceleration changes sign, or None if it depends on more.

    Parameters
    ----------
    harmonics : sequence of float
        What the kernel ``harmonics`` returns: mean, then k, a_k, b_k for each harmonic.
    period : float
    """
    mean, terms = harmonics[0], harmonics[1:]
    if math.isnan(mean):
        return None
    series = [(int(terms[i]), terms[i + 1], terms[i + 2]) for i in range(0, len(terms), 3)]
    if not series:
        return []
    if len(series) == 1 and series[0][0] == 1:
        zeros = [0.0, 0.0]
        return zeros[: single_zeros(mean, *series[0][1:], period, zeros)]
    angles = _trigonometric_zeros(mean, series)
    return sorted((angle % (2.0 * math.pi)) * period / (2.0 * math.pi) for angle in angles)


def single_zeros(mean: float, a: float, b: float, period: float, zeros: Vector) -> int:
    """Fill in where in [0, period) mean + a cos + b sin vanishes, in order; returns how many."""
    size = math.sqrt(a * a + b * b)
    if not abs(mean) < size:
        return 0
    middle, half = math.atan2(b, a), math.acos(-mean / size)
    turn = 2.0 * math.pi
    one = ((middle - half) % turn) * period / turn
    other = ((middle + half) % turn) * period / turn
    zeros[0], zeros[1] = min(one, other), max(one, other)
    return 2


def _trigonometric_zeros(mean: float, series: Sequence[tuple[int, float, float]]) -> list[float]:
    """Angles of the roots near the unit circle of sum_k c_k z^k, polished by Newton.

    A multiple root scatters around its place, so roots well off the circle are kept: a place where
    the acceleration does not change sign is one break too many, and harmless.
    """
    highest = max(k for k, _, _ in series)
    coefficients = np.zeros(2 * highest + 1, dtype=complex)
    coefficients[highest] = mean
    for k, a, b in series:
        coefficients[highest + k] += 0.5 * (a - 1j * b)
        coefficients[highest - k] += 0.5 * (a + 1j * b)
    roots = np.roots(coefficients[::-1])
    return [_polished(angle, mean, series) for angle in _near_circle(roots)]


def _near_circle(roots: Array) -> list[float]:
    near = np.abs(np.log(np.abs(roots[roots != 0.0]))) < 0.3
    return np.angle(roots[roots != 0.0][near]).tolist()


def _polished(angle: float, mean: float, series: Sequence[tuple[int, float, float]]) -> float:
    """Newton's iteration for a root of the trigonometric sum, as long as its steps are small."""
    for _ in range(3):
        value, slope = mean, 0.0
        for k, a, b in series:
            cosine, sine = math.cos(k * angle), math.sin(k * angle)
            value += a * cosine + b * sine
            slope += k * (b * cosine - a * sine)
        step = value / slope if slope else math.inf
        if not abs(step) < 1e-3:
            break
        angle -= step
    return angle


def chebyshev_zeros(
    function: Callable[[Array], Array],
    length: float,
    cuts: int = CUTS,
    rounding: Rounding | None = None,
) -> list[float]:
    """Return the zeros in (0, length) of a smooth function, from its Chebyshev interpolant.

    The degree is doubled until the last coefficients are rounding, the function's own where that is
    larger; a function that is not resolved by the highest degree is cut in halves. A zero at a cut
    may be returned twice, but is not lost. A piece that is still not resolved after all cuts is
    rounding alone: its sign changes on a mesh are returned. Where `rounding` is given, a bound of
    the function's rounding error at a time, a piece with no larger values has no zeros.
    """
    pieces = zeros_in_turn(function, length, cuts=cuts, fastest=0, rounding=rounding)
    return [zero for piece in pieces for zero in piece]


def zeros_in_turn(
    function: Callable[[Array], Array],
    length: float,
    passed: Callable[[float, float], bool] = lambda begin, length: False,
    begin: float = 0.0,
    cuts: int = CUTS,
    fastest: int = FASTEST,
    rounding: Rounding | None = None,
) -> Iterator[list[float]]:
    """Yield the same piece by piece, in order, each found when it is asked for.

    Parameters
    ----------
    passed : callable ``passed(begin, length) -> bool``
        Whether zeros in a piece that would have to be cut do not matter; its ends are returned in
        their place.
    begin : float
        Where the function's zero lies for `passed`.
    cuts, fastest : int
        A piece that is not resolved after `cuts` is cut on as long as one of its halves is, or some
        part of it that takes `fastest` more, at most: in it something decays or oscillates fast.
    rounding : callable ``rounding(time) -> float``, optional
        Of the function, see `chebyshev_zeros`.
    """
    found = _interpolated_zeros(function, length)
    if found is None and passed(begin, length):
        found = [0.0, length]
    if found is None and rounding and cuts % _EVERY == 0 and _vanishes(function, length, rounding):
        found = []
    if found is None and cuts <= 0 and _is_rounding(function, length, cuts + fastest):
        found = _mesh_zeros(function, length)
    if found is not None:
        yield found
        return
    half = 0.5 * length
    limits = cuts - 1, fastest
    yield from zeros_in_turn(function, half, passed, begin, *limits, rounding)
    late = rounding and (lambda t: rounding(half + t))
    later = passed, begin + half, *limits, late
    for piece in zeros_in_turn(lambda t: function(half + t), half, *later):
        yield [half + zero for zero in piece]


def rounding_along(
    kernel: Kernel, head: Sequence[float], values: Sequence[float], begin: float = 0.0
) -> Rounding:
    """Return what bounds the rounding of an acceleration, a kernel's third result."""

    def rounding(dt: float) -> float:
        from .bounded import bounds_of_kernel

        return float(bounds_of_kernel(kernel, [*head, begin + dt, *values])[1][2])

    return rounding


def _vanishes(function: Callable[[Array], Array], length: float, rounding: Rounding) -> bool:
    """Whether no value is larger than its rounding; the largest one tells most often."""
    times = chebyshev_nodes(_DEGREES[0] + 1, length)
    sizes = np.abs(np.broadcast_to(function(times), times.shape))
    order = np.argsort(-sizes, kind="stable")
    bounds = map(rounding, times[order].tolist())
    pairs = zip(sizes[order].tolist(), bounds, strict=True)
    return all(size <= bound + _SMALLEST < math.inf for size, bound in pairs)


def _is_rounding(function: Callable[[Array], Array], length: float, cuts: int) -> bool:
    """Whether neither half is resolved, nor the short parts that so many cuts make.

    Of a boundary layer one half is.
    """
    half = 0.5 * length
    parts = (0.5**k for k in (1, *range(2, cuts, 3)))
    return _interpolated_zeros(lambda t: function(half + t), half) is None and all(
        _interpolated_zeros(function, part * length) is None for part in parts
    )


def _interpolated_zeros(function: Callable[[Array], Array], length: float) -> list[float] | None:
    """The zeros of the interpolant of the lowest degree that resolves the function, if one does."""
    from numpy.polynomial import chebyshev

    before = math.inf
    for degree in _DEGREES:
        nodes = chebyshev_nodes(degree + 1, length)
        nodes = np.append(nodes, (0.0, length))
        *values, first, last = np.broadcast_to(function(nodes), nodes.shape)
        coefficients = chebyshev_coefficients(np.array(values))
        size = float(np.max(np.abs(coefficients)))
        off = max(abs(_at_start(coefficients) - first), abs(np.sum(coefficients) - last))
        if size == off == 0.0:
            return []
        tail = float(np.max(np.abs(coefficients[-3:]))) / size if size else math.inf
        resolved = tail < 1e-14 or (tail < _NOISE and tail > 0.1 * before)
        if resolved and off <= max(_LAYER, len(values) * tail) * size:
            if abs(coefficients[0]) > _ALONE * np.sum(np.abs(coefficients[1:])):
                return []
            kept = np.nonzero(np.abs(coefficients) > 1e-15 * size)[0][-1] + 1
            roots = chebyshev.chebroots(coefficients[:kept]) if kept > 1 else np.array([])
            near = (np.abs(roots.imag) < 1e-6) & (np.abs(roots.real) <= 1.0 + 1e-9)
            return sorted((0.5 * length * (np.clip(roots.real[near], -1.0, 1.0) + 1.0)).tolist())
        if resolved and off > _MISSED * size:
            return None
        before = tail
    return None


def _at_start(coefficients: Array) -> float:
    """The interpolant where Chebyshev polynomials are 1 and -1 in turn."""
    return float(np.sum(coefficients[::2]) - np.sum(coefficients[1::2]))


def _mesh_zeros(function: Callable[[Array], Array], length: float) -> list[float]:
    times = np.linspace(0.0, length, 257)
    signs = np.broadcast_to(function(times), times.shape) >= 0.0
    changes = np.nonzero(signs[1:] != signs[:-1])[0]
    return (0.5 * (times[changes] + times[changes + 1])).tolist()


def chebyshev_nodes(count: int, length: float) -> Array:
    """Return the roots of a Chebyshev polynomial on (0, length), from the last to the first."""
    nodes = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    return 0.5 * length * (nodes + 1.0)


def chebyshev_coefficients(values: Array) -> Array:
    """Return the coefficients of the interpolant through values at `chebyshev_nodes`."""
    coefficients = _transform(len(values)) @ values
    coefficients[0] *= 0.5
    return coefficients


@cache
def _transform(n: int) -> Array:
    angles = np.pi * (np.arange(n) + 0.5) / n
    return np.asarray(2.0 / n * np.cos(np.outer(np.arange(n), angles)))
