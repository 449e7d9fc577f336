"""Free motions of an oscillator at many times at once, by the formulas of `transients`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from . import transients
from .transients import APART, FEW, INVERSE_FACTORIAL, SERIES_BELOW, SLOW, TABLES, TERMS, Values


def _apart_each(order: int) -> Callable[..., Array]:
    """The functions where the roots are apart, element by element."""
    apart = getattr(transients, f"_apart{order}")

    def function(y: Array, kappa: Array, t: Array) -> Array:
        each = zip(y.tolist(), kappa.tolist(), t.tolist(), strict=True)
        return np.array([apart(*one) for one in each]).T

    return function


def _apart_together(y: Array, kappa: Array, t: Array) -> Array:
    """Those of `TABLES[1]`, which searches for zeros evaluate most, all at once."""
    x = np.sqrt(y * y - kappa)
    far = np.where(y > 0, -(x + y), x - y)
    near = kappa / far
    high, low = np.maximum(near, far), np.minimum(near, far)
    by = 1.0 / (high - low)
    eh, el = np.exp(high), np.exp(low)
    g0, g1 = by * (eh - el), by * (high * eh - low * el)
    fall = by * (_lags(high, eh) - _lags(low, el))
    fast = np.abs(near) >= SLOW
    fall[fast] = ((1.0 - g1 - 2.0 * y * g0)[fast]) / kappa[fast]
    return np.array([fall, g0, g1])


def _lags(root: Array, grown: Array) -> Array:
    """What `_lag` gives for j = 1, with the exponentials of the roots."""
    found, small = np.empty_like(root), np.abs(root) < 1.0
    total = np.zeros(np.count_nonzero(small))
    for i in range(FEW + 1, 0, -1):
        total = INVERSE_FACTORIAL[i] - root[small] * total
    found[small] = grown[small] * total
    found[~small] = (grown[~small] - 1.0) / root[~small]
    return found


def _array(order: int) -> Callable[..., Values]:
    """The same functions for arrays."""
    near, series, swing, timed = (
        getattr(transients, f"_{name}{order}") for name in ("near", "series", "swing", "timed")
    )
    apart = _apart_together if order == 1 else _apart_each(order)
    count = len(TABLES[order])

    def basis(y: Array, q: Array) -> Values:
        if q[0] < SERIES_BELOW:
            return series(y, q, TERMS)
        x = np.sqrt(q)
        return swing(q, np.sin(x) / x, np.cos(x))

    def function(c: ArrayLike, k: ArrayLike, t: ArrayLike) -> Values:
        given = np.broadcast_arrays(*(np.asarray(x, dtype=float) for x in (c, k, t)))
        c, k, t = (x.ravel() for x in given)
        found = np.empty((count, t.size))
        y, kappa = 0.5 * c * t, k * t * t
        q = kappa - y * y
        short, low, far = kappa < SERIES_BELOW, q < SERIES_BELOW, q <= -APART
        if np.any(far):
            found[:, far] = apart(y[far], kappa[far], t[far])
        for part in (low & short & ~far, low & ~short & ~far, ~low):
            if np.any(part):
                ch, kh, th, yh, qh = (x[part] for x in (c, k, t, y, q))
                brief = bool(short[part][0])
                found[:, part] = near(ch, kh, th, np.exp(-yh), brief, *basis(yh, qh))
        return timed(given[2], *found.reshape(count, *given[0].shape))

    return function


ARRAY = {f"transients{order}": _array(order) for order in TABLES}
