"""The symbols of kernels that are no parameters of a model."""

from __future__ import annotations

import sympy


def own(name: str) -> sympy.Symbol:
    """Return a symbol of ours: the prime keeps it apart from any parameter of that name."""
    return sympy.Symbol(f"{name}'", real=True)


T0, T1, TURN, DT, PHASE = map(own, ("t0", "t1", "turn", "dt", "phase"))
"""phase = t0 - turn*T and dt = t1 - t0, with `turn` a whole number."""
