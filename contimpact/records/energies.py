"""Output voltages of the energy harvester on orbits: of each impact, and their means.

The voltage of one impact is `contimpact.systems.membrane`'s affair. Means are equations (9) of the
paper on vibro-impact pairs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..systems.membrane import Membrane, velocity_scale
from .branch import Branch


@dataclass(frozen=True, eq=False)
class Energy:
    """Output voltages of a motion.

    Attributes
    ----------
    impacts : ndarray of shape (N,)
        U_k, V.
    per_impact, per_time : float
        The means of equations (9), V, the second per unit of dimensionless time. Where impacts
        accumulate there are infinitely many of them, and the mean per impact is zero.
    """

    impacts: Array
    per_impact: float
    per_time: float


def of_impacts(
    membrane: Membrane, parameters: Mapping[str, float], velocities: Any, span: float
) -> Energy:
    """Return the voltages of the impacts made in a time `span`.

    Parameters
    ----------
    membrane : Membrane
    parameters : mapping of str to float
        Of a system with membranes.
    velocities : array_like of shape (N,)
        Dimensionless, before impact.
    span : float
        Dimensionless time in which they happen.
    """
    voltages = membrane.voltage(velocity_scale(parameters) * np.asarray(velocities))
    total = float(np.sum(voltages))
    mean = total / len(voltages) if len(voltages) else 0.0
    return Energy(voltages, mean, total / span)


def along(membrane: Membrane, branch: Branch, forcing_period: float = 2.0) -> dict[str, Array]:
    """Return the voltages along a branch, unphysical orbits included.

    Returns
    -------
    dict of str to ndarray
        ``U1``, ``U2``, ... of each impact, ``U_I`` per impact, ``U_T`` per time; one value for
        each point.
    """
    scale = np.asarray(velocity_scale(branch.columns))
    voltages = membrane.voltage(scale[:, None] * branch.velocities)
    columns = {f"U{k + 1}": voltages[:, k] for k in range(voltages.shape[1])}
    total = voltages.sum(axis=1)
    columns["U_I"] = total / voltages.shape[1]
    columns["U_T"] = total / branch.columns.get("period", branch.period * forcing_period)
    return columns
