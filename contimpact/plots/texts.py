"""How pictures write names and numbers: labels as in Table 1, parameters, values, headings."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from ..bifurcations.registry import kind_of
from ..errors import printable, shortened
from ..records.branch import Branch
from ..records.entry import Entry

if TYPE_CHECKING:
    from ..models.model import Model

GREEK = "alpha beta gamma delta mu omega phi sigma tau theta zeta".split()
SYMBOLS = {name: rf"\{name}" for name in GREEK} | {"phi": r"\varphi"}
DENOMINATORS = (1, 2, 3, 4, 6, 9, 12, 18)
"""Of the multiples of pi that are written as such."""
ORBIT = r"(?:[^\W_]|[:/()])*"
"""How orbits are called in labels; nothing in it has a meaning in mathematical text."""


def plain(text: str, longest: int = 40) -> str:
    """Return a text from elsewhere as it is drawn: short, in one line, none of it mathematics."""
    drawn = printable(shortened(text, longest)).replace("$", r"\$")
    return f"{drawn} " if drawn.endswith("\\") else drawn  # which would change what is put behind


def label_text(entry: Entry, orbit: bool = False) -> str:
    """Return an entry's label set as in Table 1: a tilde over ghosts, words raised and lowered.

    A grazing of orbits with the period 2T, 4T, ... is PD_G. With `orbit`, labels without words
    name the orbit.
    """
    kind = kind_of(entry.kind)
    if not kind.tilde:
        return plain(entry.kind)
    upright, _, index = kind.symbol(entry.period).partition("_")
    name = rf"\mathrm{{{upright}}}"
    if entry.ghost:
        name = rf"\widetilde{{{name}}}"
    if index:
        name += rf"_{{\mathrm{{{index}}}}}"
    elif match := re.fullmatch(rf"~?\w+\[({ORBIT})->({ORBIT})\]", entry.label):
        return f"${name}_{{{match[1]}}}^{{\\,{match[2]}}}$"
    return f"${name}$" + (f"({plain(entry.notation)})" if orbit else "")


def set_label(kind: str, label: str, orbit: str = "") -> str:
    """Return a label as ``G[1:1->2:1]`` with its words raised and lowered; others name `orbit`."""
    if match := re.fullmatch(rf"~?\w+\[({ORBIT})->({ORBIT})\]", label):
        return rf"$\mathrm{{{kind}}}_{{{match[1]}}}^{{\,{match[2]}}}$"
    name = rf"$\mathrm{{{kind}}}$" if kind_of(kind).tilde else plain(kind)
    return name + (f"({plain(orbit)})" if orbit else "")


def symbol(name: str) -> str:
    """Return a name as it is set in labels: letters, Greek ones too, as symbols, ``r_B`` with an
    index, ``gbar`` with a bar, words as they are."""
    match = re.fullmatch(r"([A-Za-z]+?)(bar)?(?:_([A-Za-z0-9]+)|([0-9]+))?", name)
    if match is None or (len(match[1]) > 1 and match[1] not in SYMBOLS):
        return plain(name)
    letter, index = SYMBOLS.get(match[1], match[1]), match[3] or match[4]
    letter = rf"\bar{{{letter}}}" if match[2] else letter
    return f"${letter}_{{{index}}}$" if index else f"${letter}$"


def axis_label(name: str, unit: str = "") -> str:
    """Return the label of an axis: a parameter and its unit."""
    return symbol(name) + (f" ({unit})" if unit else "")


def value_text(value: float) -> str:
    """Return a number as it is set in headings, a simple multiple of pi as such."""
    for below in DENOMINATORS if math.isfinite(value) else ():
        above = value / math.pi * below
        if abs(above - round(above)) < 1e-12 * max(1.0, abs(above)) and round(above):
            top = {1: "", -1: "-"}.get(round(above), str(round(above)))
            return rf"${top}\pi/{below}$" if below > 1 else rf"${top}\pi$"
    return f"{value:.6g}"


def values_text(values: Mapping[str, float], units: Mapping[str, str]) -> str:
    """Return ``beta = pi/6, A = 5 N`` as it is set in headings."""
    parts = []
    for name, value in values.items():
        unit = units.get(name, "").replace("dimensionless", "").replace("^2", "\u00b2")
        parts.append(f"{symbol(name)} = {value_text(value)}" + (f" {unit}" if unit else ""))
    return ", ".join(parts)


def units_of(system: str) -> dict[str, str]:
    """Return the units of a system's parameters, derived ones included; none if it is unknown."""
    found = _class(system)
    if found is None:
        return {}
    units = dict(found.DERIVED_UNITS)
    for parameter in found.PARAMETERS:
        units |= dict.fromkeys((parameter.name, *parameter.split), parameter.unit)
    return units


def fixed_values(branches: Sequence[Branch]) -> dict[str, float]:
    """Return the parameters that no branch varies and all share, derived ones left out."""
    if not branches:
        return {}
    found = _class(branches[0].system)
    derived = found.DERIVED if found else ()
    return {
        name: float(branches[0][name][0])
        for name in branches[0].constant
        if name not in derived
        and all(name in b.constant and b[name][0] == branches[0][name][0] for b in branches)
    }


def _class(name: str) -> type[Model] | None:
    """The class of a system that is installed or imported."""
    from ..records.recovery import imported_system

    return imported_system(name) if name else None
