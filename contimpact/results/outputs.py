"""Outputs that a scene states, and their means as columns of branches."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import InputError, short_repr
from ..models.model import Model
from ..orbits.outputs import Output, check_output, means_of
from .branch import Branch, orbit_at
from .options import QUANTITIES, REQUIRED, Table

ERROR = "_error"
"""Ends the name of the column with the error estimates of a mean."""
_COLUMNS = re.compile(
    rf"arclength|residual|iterations|reason|event|physical|n_unstable|smallest_gap|"
    rf"[a-z]+\d+|\w*(_re|_im|{ERROR})|{'|'.join(QUANTITIES)}"
)
"""Names that columns of branches and quantities have."""


def read_outputs(table: Table, model: Model) -> tuple[Output, ...]:
    """Return the outputs of [output]."""
    found = []
    for name in table.data:
        value = table.take(name, REQUIRED, "an expression")
        if at_impacts := isinstance(value, dict):
            own = table.table(name)
            value = own.text("before_impacts")
            own.finish()
        if not isinstance(value, str):
            accepted = "an expression in quotes, or { before_impacts = an expression }"
            raise table.refuse(name, value, accepted)
        if _COLUMNS.fullmatch(name):
            found_name = f"{short_repr(name)} is or may be a column of tables"
            raise InputError(table.place(name), found_name, "give another name, such as P")
        found.append(Output(name, value, at_impacts))
        check_output(found[-1], model, table.place(name))
    return tuple(found)


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
        columns |= {output.name: rows[:, k, 0], output.name + ERROR: rows[:, k, 1]}
    note = f"outputs are missing at {lost} rows, whose orbits do not solve their equations"
    return replace(branch, columns=columns, notes=[*branch.notes, *[note] * bool(lost)])
