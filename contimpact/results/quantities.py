"""Quantities along branches, energies of impacts among them.

A quantity is one series for each impact, each multiplier or each orbit. Series of one name belong
together: those of impacts are called as their walls.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from ..arrays import Array
from ..bifurcations.kind import kind_of
from ..errors import InputError, count_text, short_repr
from ..models.model import Model
from ..models.outputs import Output, require_membranes
from ..orbits.outputs import means_of
from ..segments.kernels import Kernels
from ..systems.membrane import Membrane, velocity_scale
from .branch import Branch, find_imported_system, model_at, orbit_at
from .options import QUANTITIES, VOLTAGES
from .scene import OUTPUT_ERROR

# The vocabulary that pictures and the page share: how names are written, which colour a wall has.
#
# Colours are dark enough for print on white; the first two differ in lightness.

WALLS = ("#00558B", "#B87400", "#00795A", "#A8527F", "#5E4FA2", "#8B3A1E")
"""Of walls, in their order; what is more begins again."""
WALLS_ON_DARK = ("#56B4E9", "#F0B340", "#35C596", "#E39FC8", "#B3A6F0", "#E8987A")
NO_WALL = "#555555"
NO_IMPACT = "no impact"
"""What the series of a motion without impacts is called."""
PI_BELOW = 36
"""Largest denominator of the multiples of pi that are written as such."""
PI_ABOVE = 1_000_000
"""Largest numerator: among larger ones a multiple is next to any number."""

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


ORBIT = r"(?:[^\W_]|[:/()])*"
"""How orbits are called in labels; nothing in it has a meaning in mathematical text."""


@dataclass(frozen=True)
class LabelParts:
    """An event's label as pictures set it."""

    symbol: str
    tilde: bool = False
    """Whether a tilde stands over it: it is a ghost's."""
    below: str = ""
    above: str = ""
    """`below`, `above`: what is lowered and raised, orbits as a rule."""
    standard: bool = True
    """Whether the symbol is set as mathematics."""


def label_parts(kind: str, label: str, ghost: bool = False, period: int = 1) -> LabelParts:
    """Return the parts of a label such as ``~G[1:1->2:1]``, as in Table 1 of the paper.

    A grazing of orbits with the period 2T, 4T, ... is PD_G, and has no words.
    """
    known = kind_of(kind)
    if not known.tilde:
        return LabelParts(kind, standard=False)
    symbol, _, index = known.symbol(period).partition("_")
    words = re.fullmatch(rf"~?\w+\[({ORBIT})->({ORBIT})\]", label)
    if index or not words:
        return LabelParts(symbol, ghost, index)
    return LabelParts(symbol, ghost, words[1], words[2])


def direction_text(parameter: str, rising: bool) -> str:
    """Return how the direction of a sweep is called: by what changes."""
    return f"{parameter} {'rising' if rising else 'falling'}"


# Output voltages of the energy harvester on orbits: of each impact, and their means.
#
# The voltage of one impact is `contimpact.systems.membrane`'s affair. Means are equations (9) of
# the paper on vibro-impact pairs.


@dataclass(frozen=True, eq=False)
class Energy:
    """What the impacts of a motion deliver, or take: output voltages, or energies lost."""

    impacts: Array
    """Of each impact, such as U_k in V; an energy lost is zero for a release, shape (N,)."""
    per_impact: float
    per_time: float
    """`per_impact`, `per_time`: the means of equations (9), the second per unit of dimensionless
    time. Where impacts accumulate there are infinitely many of them, and the mean per impact is
    zero."""

    @classmethod
    def of(cls, impacts: Array, span: float) -> Energy:
        """Return what impacts made in a time add up to."""
        total = float(np.sum(impacts))
        return cls(impacts, total / len(impacts) if len(impacts) else 0.0, total / span)


def impact_voltages(
    membrane: Membrane, parameters: Mapping[str, float], velocities: Any, span: float
) -> Energy:
    """Return the voltages of impacts, by their dimensionless velocities before impact, of shape
    (N,), made in a dimensionless time `span`; parameters are those of a system with membranes."""
    voltages = membrane.voltage(velocity_scale(parameters) * np.asarray(velocities))
    return Energy.of(voltages, span)


def branch_voltages(membrane: Membrane, branch: Branch) -> dict[str, Array]:
    """Return the voltages along a branch, unphysical orbits included, with a value for each point:
    ``U1``, ``U2``, ... of each impact, ``U_I`` per impact, ``U_T`` per time."""
    require_membranes(find_imported_system(branch.system))
    scale = np.asarray(velocity_scale(branch.columns))
    voltages = membrane.voltage(scale[:, None] * branch.velocities)
    columns = {f"U{k + 1}": voltages[:, k] for k in range(voltages.shape[1])}
    total = voltages.sum(axis=1)
    columns["U_I"] = total / voltages.shape[1]
    columns["U_T"] = total / _periods(branch)
    return columns


Quantity: TypeAlias = str | Callable[[Branch], Any]
"""A name, or a function of a branch that returns values with a row for each point."""


@dataclass(frozen=True)
class Series:
    """Values along a branch, and what they are of: a wall, a multiplier, an orbit.

    Between points the values are a smooth function of arclength if `smooth` says so; with `poles`
    they may pass through infinity.
    """

    name: str
    values: Array
    smooth: bool = False
    poles: bool = False


def series_of(
    branch: Branch, quantity: Quantity = "velocity", membrane: Membrane | None = None
) -> list[Series]:
    """Return the series of a quantity along a branch.

    One of `QUANTITIES`: ``velocity`` before each impact, zero on branches without any; real parts
    of the ``multipliers`` or their ``moduli``; with membranes ``energy`` for the output voltage of
    each impact, ``U_I`` and ``U_T`` for its means per impact and per time; the smallest ``gap``;
    the ``period``; a numeric column; or a function of the branch that returns an array with a row
    for each point, or several of them by name.

    Raises InputError for a name that is none of these, or values that do not fit the branch.
    """
    if callable(quantity):
        return list(_function_series(branch, quantity))
    if quantity == "velocity":
        speeds = [Series(w, branch[f"v{k}"], True) for k, w in enumerate(branch.word, start=1)]
        return speeds or [Series(NO_IMPACT, np.zeros(len(branch)))]
    if quantity in ("multipliers", "moduli"):
        rows = branch.multipliers.real if quantity == "multipliers" else abs(branch.multipliers)
        return [Series(f"multiplier {k}", m, poles=True) for k, m in enumerate(rows.T, start=1)]
    if quantity in VOLTAGES:
        return _voltages(branch, quantity, membrane or Membrane())
    if quantity == "period":
        return [Series("period", _periods(branch))]
    name = {"gap": "smallest_gap"}.get(quantity, quantity)
    if name not in numbers_of(branch):
        accepted = f"accepted are {', '.join([*QUANTITIES, *numbers_of(branch)])}"
        raise InputError("y", f"branch {branch.id} has no {short_repr(quantity)}", accepted)
    shown = quantity if len(quantity) > 1 else f"value of {quantity}"  # one letter is a wall's name
    return [Series(shown, branch[name], smooth=name[:1] in "tv" and name[1:].isdigit())]


def numbers_of(branch: Branch) -> list[str]:
    """Return the names of a branch's numeric columns."""
    return [name for name, values in branch.columns.items() if values.dtype.kind in "fi"]


def _voltages(branch: Branch, quantity: str, membrane: Membrane) -> list[Series]:
    columns = branch_voltages(membrane, branch)
    if quantity != "energy":
        return [Series(quantity, columns[quantity], True)]
    return [Series(w, columns[f"U{k}"], True) for k, w in enumerate(branch.word, start=1)]


def _periods(branch: Branch) -> Array:
    """The orbits' periods, in the model's clock."""
    if "period" in branch.columns:
        return branch["period"]
    kernels = Kernels(model_at(branch, 0), branch.parameter)
    names = list(kernels.model.values)
    rows = np.column_stack([branch[name] for name in names]).tolist()
    return branch.period * np.array([kernels.setup(*row).period for row in rows])


def _function_series(branch: Branch, function: Callable[[Branch], Any]) -> Iterator[Series]:
    found = function(branch)
    if isinstance(found, Mapping):
        for name, values in found.items():
            yield Series(str(name), _check_columns(branch, values)[:, 0])
        return
    name = getattr(function, "__name__", "y")
    for column in _check_columns(branch, found).T:
        yield Series("y" if name == "<lambda>" else name, column)


def _check_columns(branch: Branch, values: Any) -> Array:
    """Values as columns with a row for each point of the branch."""
    try:
        rows = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        rows = np.zeros(0)
    if rows.ndim not in (1, 2) or len(rows) != len(branch):
        found = f"its function returned {short_repr(values)} on branch {branch.id}"
        raise InputError("y", found, f"return {len(branch)} numbers, one for each point")
    return rows.reshape(len(branch), -1)


# Means of the outputs that a scene states, as columns of branches.


def output_columns(outputs: Sequence[Output]) -> list[str]:
    """Return the names of the columns for outputs: the mean of each, and its error."""
    return [name for output in outputs for name in (output.name, output.name + OUTPUT_ERROR)]


def fill_outputs(branch: Branch, outputs: Sequence[Output], model: Model) -> list[str]:
    """Fill the `output_columns` of a branch, row by row, and return notes.

    Where an orbit cannot be computed again from its row they stay as they are, and a note says so.
    """
    lost, columns = 0, [branch[name] for name in output_columns(outputs)]
    kernels = Kernels(model, branch.parameter)
    for row in range(len(branch)):
        try:
            orbit = orbit_at(branch, row, model, kernels)
        except InputError:
            lost += 1
            continue
        means = means_of(orbit.linearisation, outputs, orbit.model)
        for column, value in zip(columns, (v for mean in means for v in mean), strict=True):
            column[row] = value
    rows = count_text(lost, "row")
    note = f"outputs are missing at {rows}, whose orbits do not solve their equations"
    return [note] * bool(lost)
