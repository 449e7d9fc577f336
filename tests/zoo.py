"""Systems of the tests' own."""

from __future__ import annotations

from contimpact.systems.impact_pair import ImpactPair


def harmonic_pair(waves, **given):
    """The impact pair under a_i cos(k_i pi t) + b_i sin(k_i pi t), given as a list of (k, a, b)."""
    terms = [
        f"({float(factor)!r})*{wave}({k}*pi*t)"
        for k, a, b in waves
        for wave, factor in (("cos", a), ("sin", b))
        if factor
    ]
    return ImpactPair(forcing=" + ".join(terms), **given)
