"""Means of the outputs that a scene states, as columns of branches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import InputError
from ..models.model import Model
from ..models.outputs import Output
from ..orbits.outputs import means_of
from .branch import Branch, orbit_at
from .scene import OUTPUT_ERROR


def add_outputs(branch: Branch, outputs: Sequence[Output], model: Model) -> Branch:
    """Return a branch with a column for the mean of each output, and one for its error.

    Where an orbit cannot be computed again from its row they are not numbers, and a note says so.
    """
    rows, lost = np.full((len(branch), len(outputs), 2), np.nan), 0
    for row in range(len(branch)):
        try:
            orbit = orbit_at(branch, row, model)
        except InputError:
            lost += 1
            continue
        rows[row] = means_of(orbit.linearisation, outputs, orbit.model)
    columns: dict[str, Any] = dict(branch.columns)
    for k, output in enumerate(outputs):
        columns |= {output.name: rows[:, k, 0], output.name + OUTPUT_ERROR: rows[:, k, 1]}
    note = f"outputs are missing at {lost} rows, whose orbits do not solve their equations"
    return replace(branch, columns=columns, notes=[*branch.notes, *[note] * bool(lost)])
