"""Systems, scenes and closed forms that several tests use."""

from __future__ import annotations

from pathlib import Path

from contimpact.scenes.scene import read_scene
from contimpact.systems.impact_pair import ImpactPair

ROOT = Path(__file__).parent.parent
"""The checkout."""


def harmonic_pair(waves, **given):
    """The impact pair under a_i cos(k_i pi t) + b_i sin(k_i pi t), given as a list of (k, a, b)."""
    terms = [
        f"({float(factor)!r})*{wave}({k}*pi*t)"
        for k, a, b in waves
        for wave, factor in (("cos", a), ("sin", b))
        if factor
    ]
    return ImpactPair(forcing=" + ".join(terms), **given)


def scene(**changes):
    """The scene of 1:1 at Fig. 7's parameters, with other values in its tables."""
    given = {
        "name": "t",
        "model": {
            "system": "impact-pair",
            "parameters": {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.34},
        },
        "follow": {
            "parameter": "s", "range": [0.08, 1.05], "orbits": ["1:1"],
            "switch": ["G", "PD"], "depth": 2,
        },
        "detect": {"events": ["FB", "PD", "G"]},
    }  # fmt: skip
    for table, values in changes.items():
        given[table] = {**given.get(table, {}), **values}
    return read_scene(given)
