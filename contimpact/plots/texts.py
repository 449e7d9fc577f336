"""How pictures write names and numbers: labels as in Table 1, parameters, values, headings."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from ..errors import printable, shorten
from ..results.branch import Branch, Entry
from ..results.quantities import GREEK, PI_BELOW, LabelParts, label_parts, parts_of

if TYPE_CHECKING:
    from ..models.model import Model

CAPITALS = "Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi Omega".split()
COMMANDS = {
    letter: rf"\{name}"
    for name, letter in reversed(GREEK.items())  # so that whole names come last
    if name.islower() or name in CAPITALS
} | {GREEK["phi"]: r"\varphi", GREEK["omicron"]: "o"}
"""Of Greek letters in mathematical text; without one the letter itself is set."""


def plain_text(text: str, longest: int = 40) -> str:
    """Return a text from elsewhere as it is drawn: short, in one line, none of it mathematics."""
    drawn = printable(shorten(text, longest)).replace("$", r"\$")
    return f"{drawn} " if drawn.endswith("\\") else drawn  # which would change what is put behind


def label_text(entry: Entry, orbit: bool = False) -> str:
    """Return an entry's label set as in Table 1: a tilde over ghosts, words raised and lowered.

    A grazing of orbits with the period 2T, 4T, ... is PD_G. With `orbit`, labels without words
    name the orbit.
    """
    parts = label_parts(entry.kind, entry.label, entry.ghost, entry.period)
    return _set(parts, entry.notation if orbit else "")


def set_label(kind: str, label: str, orbit: str = "") -> str:
    """Return a label as ``G[1:1->2:1]`` with its words raised and lowered; others name `orbit`."""
    return _set(label_parts(kind, label), orbit)


def _set(parts: LabelParts, orbit: str) -> str:
    if not parts.standard:
        name = plain_text(parts.symbol)
    else:
        name = rf"\mathrm{{{parts.symbol}}}"
        name = rf"\widetilde{{{name}}}" if parts.tilde else name
        if parts.above:
            return f"${name}_{{{parts.below}}}^{{\\,{parts.above}}}$"
        name += rf"_{{\mathrm{{{parts.below}}}}}" if parts.below else ""
        name = f"${name}$"
    return name + (f"({plain_text(orbit)})" if orbit else "")


def symbol(name: str) -> str:
    """Return a name as it is set in labels: letters, Greek ones too, as symbols, ``r_B`` with an
    index, ``gbar`` with a bar, words as they are."""
    found = parts_of(name)
    if found is None:
        return plain_text(name)
    letter, bar, index = found
    letter = COMMANDS.get(letter, letter)
    letter = rf"\bar{{{letter}}}" if bar else letter
    return f"${letter}_{{{index}}}$" if index else f"${letter}$"


def axis_label(name: str, unit: str = "") -> str:
    """Return the label of an axis: a parameter and its unit."""
    return symbol(name) + (f" ({unit})" if unit else "")


def value_text(value: float) -> str:
    """Return a number as it is set in headings, a multiple of pi as such."""
    for below in range(1, PI_BELOW + 1) if math.isfinite(value) else ():
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


def walls_of(system: str, names: Sequence[str]) -> list[str]:
    """Return names of walls in the order of their system, if it is known; other names as given."""
    found = _class(system)
    walls = [wall.name for wall in getattr(found, "WALLS", ())]  # classes of scenes have none
    return list(dict.fromkeys([*(walls if {*walls} & {*names} else ()), *names]))


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
    from ..results.branch import find_imported_system

    return find_imported_system(name) if name else None
