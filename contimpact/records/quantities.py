"""Quantities of orbits along a branch, by name: what may stand on the y axis of a diagram.

A quantity is one series for each impact, each multiplier or each orbit. Series of one name belong
together: those of impacts are called as their walls.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from ..arrays import Array
from ..errors import InputError, shown
from ..segments.kernels import Kernels
from ..systems.membrane import Membrane
from .branch import Branch
from .energies import along
from .recovery import model_at
from .vocabulary import NO_IMPACT

QUANTITIES = ("velocity", "multipliers", "moduli", "energy", "U_I", "U_T", "gap", "period")
"""Names of quantities beside those of columns."""

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

    Parameters
    ----------
    branch : Branch
    quantity : str or callable
        One of `QUANTITIES`: ``velocity`` before each impact, zero on branches without any; real
        parts of the ``multipliers`` or their ``moduli``; ``energy`` for the output voltage of each
        impact, ``U_I`` and ``U_T`` for its means per impact and per time; the smallest ``gap``; the
        ``period``; a numeric column; or a function of the branch that returns an array with a row
        for each point, or several of them by name.
    membrane : Membrane, optional
        Of the voltages.

    Raises
    ------
    InputError
        For a name that is none of these, or values that do not fit the branch.
    """
    if callable(quantity):
        return list(_of_function(branch, quantity))
    if quantity == "velocity":
        speeds = [Series(w, branch[f"v{k}"], True) for k, w in enumerate(branch.word, start=1)]
        return speeds or [Series(NO_IMPACT, np.zeros(len(branch)))]
    if quantity in ("multipliers", "moduli"):
        rows = branch.multipliers.real if quantity == "multipliers" else abs(branch.multipliers)
        return [Series(f"multiplier {k}", m, poles=True) for k, m in enumerate(rows.T, start=1)]
    if quantity in ("energy", "U_I", "U_T"):
        return _voltages(branch, quantity, membrane or Membrane())
    if quantity == "period":
        return [Series("period", _periods(branch))]
    name = {"gap": "smallest_gap"}.get(quantity, quantity)
    if name not in numbers_of(branch):
        accepted = f"accepted are {', '.join([*QUANTITIES, *numbers_of(branch)])}"
        raise InputError("y", f"branch {branch.id} has no {shown(quantity)}", accepted)
    return [Series(quantity, branch[name], smooth=name[:1] in "tv" and name[1:].isdigit())]


def numbers_of(branch: Branch) -> list[str]:
    """Return the names of a branch's numeric columns."""
    return [name for name, values in branch.columns.items() if values.dtype.kind in "fi"]


def _voltages(branch: Branch, quantity: str, membrane: Membrane) -> list[Series]:
    columns = along(membrane, branch)
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


def _of_function(branch: Branch, function: Callable[[Branch], Any]) -> Iterator[Series]:
    found = function(branch)
    if isinstance(found, Mapping):
        for name, values in found.items():
            yield Series(str(name), _checked(branch, values)[:, 0])
        return
    name = getattr(function, "__name__", "y")
    for column in _checked(branch, found).T:
        yield Series("y" if name == "<lambda>" else name, column)


def _checked(branch: Branch, values: Any) -> Array:
    """Values as columns with a row for each point of the branch."""
    try:
        rows = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        rows = np.zeros(0)
    if rows.ndim not in (1, 2) or len(rows) != len(branch):
        found = f"its function returned {shown(values)} on branch {branch.id}"
        raise InputError("y", found, f"return {len(branch)} numbers, one for each point")
    return rows.reshape(len(branch), -1)
