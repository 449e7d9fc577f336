"""Branches in other programs' formats: AUTO's bifurcation file and MATLAB's."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np

from ..bifurcations.registry import kind_of
from ..storage.files import write, write_text
from .branch import Branch

END_POINT = 9


def write_auto(branch: Branch, path: str | Path) -> None:
    """Write a branch as an AUTO-07p bifurcation file (``b.NAME``).

    Columns are branch, point (negative where unstable), type, label, the parameter, the norm of
    the velocities before impact, and then the impact times and velocities.

    Parameters
    ----------
    branch : Branch
    path : str or Path
    """
    number = int("".join(c for c in branch.id if c.isdigit()) or 1)
    kinds = {entry.id: kind_of(entry.kind).auto for entry in branch.events}
    names = [f"{name}{k + 1}" for k in range(len(branch.word)) for name in ("t", "v")]
    titles = [branch.parameter, "L2-NORM", *names]
    lines = ["   0    PT  TY  LAB " + "".join(f"{title:^19}" for title in titles)]
    columns = [branch[branch.parameter], np.linalg.norm(branch.velocities, axis=1)]
    table = np.column_stack([*columns, *(branch[name] for name in names)])
    label, stable, events = 0, branch.stable.tolist(), branch["event"].tolist()
    form = "%19.10E" * table.shape[1]
    for row, values in enumerate(table.tolist()):
        at_end = row in (0, len(table) - 1)
        kind = kinds.get(events[row], END_POINT if at_end else 0)
        label += kind != 0
        point = (row + 1) * (1 if stable[row] else -1)
        lines.append(
            f"{number:4d}{point:6d}{kind:4d}{label if kind else 0:5d} " + form % (*values,)
        )
    write_text(Path(path), "\n".join(lines) + "\n")


def write_mat(branch: Branch, path: str | Path) -> None:
    """Write the columns of a branch, and what it is, as a MATLAB file.

    Parameters
    ----------
    branch : Branch
    path : str or Path
    """
    from scipy.io import savemat

    names = ("word", "period", "notation", "parameter")
    content: dict[str, Any] = {name: getattr(branch, name) for name in names}
    content |= {"ends": [end.message for end in branch.ends], **branch.columns}
    file = io.BytesIO()
    savemat(file, content, long_field_names=True, oned_as="column")
    write(Path(path), file.getvalue())
