"""The vocabulary that pictures and the page share: how names are written, which colour a wall has.

Colours are dark enough for print on white; the first two differ in lightness.
"""

from __future__ import annotations

import re

WALLS = ("#00558B", "#B87400", "#00795A", "#A8527F", "#5E4FA2", "#8B3A1E")
"""Of walls, in their order; what is more begins again."""
WALLS_ON_DARK = ("#56B4E9", "#F0B340", "#35C596", "#E39FC8", "#B3A6F0", "#E8987A")
NO_WALL = "#555555"
NO_IMPACT = "no impact"
"""What the series of a motion without impacts is called."""
PI_BELOW = 36
"""Largest denominator of the multiples of pi that are written as such."""

_SMALL = (
    "alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi omicron pi rho "
    "sigma tau upsilon phi chi psi omega"
).split()
_SHORT = {"al": "alpha", "be": "beta", "ga": "gamma", "eps": "epsilon", "la": "lambda"}
_SHORT |= {"om": "omega"}
GREEK = dict(zip(_SMALL, (chr(c) for c in range(0x3B1, 0x3CA) if c != 0x3C2), strict=True))
"""Letters by their names and the usual abbreviations of these, capitals among them."""
GREEK |= {short: GREEK[name] for short, name in _SHORT.items()}
GREEK |= {name.capitalize(): letter.upper() for name, letter in GREEK.items()}


def parts_of(name: str) -> tuple[str, bool, str] | None:
    """Return the letter of a name as ``beta``, ``gbar`` or ``r_B``, whether it has a bar, and its
    index; None for a word."""
    match = re.fullmatch(r"([A-Za-z]+?)(bar)?(?:_([A-Za-z0-9]+)|([0-9]+))?", name)
    if match is None or (len(match[1]) > 1 and match[1] not in GREEK):
        return None
    return GREEK.get(match[1], match[1]), bool(match[2]), match[3] or match[4] or ""


def way(parameter: str, rising: bool) -> str:
    """Return how the direction of a sweep is called: by what changes."""
    return f"{parameter} {'rising' if rising else 'falling'}"
