"""Results in the formats of other programs, and catalogues of several folders as one."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..bifurcations.kind import kind_of
from ..errors import InputError, explain_arguments, printable
from ..schema import fit_value
from ..storage import Content, csv_text, json_text, sha256, write, write_all, write_text
from .branch import Branch
from .catalogue import entry_of
from .result_folder import WANTED, reading_catalogue

END_POINT = 9


@explain_arguments
def write_auto(branch: Branch, path: str | Path) -> None:
    """Write a branch as an AUTO-07p bifurcation file (``b.NAME``).

    Columns are branch, point (negative where unstable), type, label, the parameter, the norm of
    the velocities before impact, and then the impact times and velocities; of the word ``0``, the
    norm of the state at t = 0, and then the state.

    Parameters
    ----------
    branch : Branch
    path : str or Path
    """
    number = int("".join(c for c in branch.id if c.isdigit()) or 1)
    kinds = {entry.id: kind_of(entry.kind).auto for entry in branch.events}
    names = [f"{name}{k + 1}" for k in range(len(branch.word)) for name in ("t", "v")]
    if not branch.word:
        names = [name for name in branch.columns if re.fullmatch(r"[xv]\d+_0", name)]
    titles = [branch.parameter, "L2-NORM", *names]
    lines = ["   0    PT  TY  LAB " + "".join(f"{title:^19}" for title in titles)]
    numbers = np.column_stack([branch[name] for name in names])
    columns = [branch[branch.parameter]]
    columns.append(np.linalg.norm(branch.velocities if branch.word else numbers, axis=1))
    table = np.column_stack([*columns, numbers])
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


@explain_arguments
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


# Catalogues of several scenes in one table, with where each entry comes from.

CATALOGUES = "contimpact.catalogues/1"
FILES = ("catalogues.json", "catalogues.csv", "catalogues.md")
TABLE = ("scene", "id", "label", "ghost", "why", "criticality", "branch", "word", "period")


def merge(folders: Sequence[str | Path]) -> dict[str, Any]:
    """Merge the catalogues of several folders of ``contimpact run``: ``sources`` (scene, where its
    numbers are from, versions, digest of the catalogue, what was interrupted) and ``entries``,
    each with its scene.

    Raises InputError if a folder has no catalogue, its schema is not this version's, its run was
    ended while it wrote the folder, or two different catalogues go by the same scene name.
    """
    sources: list[dict[str, Any]] = []
    entries: list[dict[str, Any]] = []
    for folder in map(Path, folders):
        with reading_catalogue(folder) as (manifest, content):
            digest = sha256(folder / "catalogue.json")
            origin = _manifest_summary(folder, manifest)
            scene = fit_value(content["scene"], str, "scene")
            for record in content["entries"]:
                entry_of(record)
        same = next((s for s in sources if s["scene"] == scene), None)
        if same is not None:
            if same["sha256"] != digest:
                found = f"a second, different catalogue of the scene {scene!r}"
                raise InputError(str(folder), found, "give each scene a name of its own")
            continue
        cut = {"interrupted": content["interrupted"]} if content.get("interrupted") else {}
        sources.append({"scene": scene, "folder": folder.name, "sha256": digest, **origin, **cut})
        entries += [{"scene": scene, **entry} for entry in content["entries"]]
    return {"schema": CATALOGUES, "sources": sources, "entries": entries}


def _manifest_summary(folder: Path, manifest: Mapping[str, Any] | None) -> dict[str, Any]:
    """What the manifest says of a catalogue; nothing if the folder has none."""
    if manifest is None:
        return {"source": None, "versions": None}
    try:
        return {"source": manifest["scene"]["resolved"]["source"], "versions": manifest["versions"]}
    except (KeyError, TypeError):
        where = str(folder / "manifest.json")
        raise InputError(where, "damaged", f"give {WANTED}") from None


def write_merged(merged: dict[str, Any], folder: Path) -> list[str]:
    """Write `FILES` of merged catalogues; returns their names."""
    for name in FILES:  # so that what is there is of one run
        (folder / name).unlink(missing_ok=True)
    makers: tuple[Content, ...] = (
        lambda: json_text(merged),
        lambda: csv_text(*_table(merged)),
        lambda: _markdown(*_table(merged)),
    )
    return write_all(folder, dict(zip(FILES, makers, strict=True)))


def _table(merged: dict[str, Any]) -> tuple[list[str], list[list[Any]]]:
    entries = merged["entries"]
    parameters = list(dict.fromkeys(name for e in entries for name in e["parameters"]))
    columns = [*TABLE, "parameter", "value", "error", *parameters]
    rows = []
    for e in entries:
        values, parameter = e["parameters"], e["parameter"]
        row = [*map(e.get, TABLE), parameter, values[parameter], e.get("error")]
        rows.append([*row, *map(values.get, parameters)])
    return columns, rows


def _markdown(columns: list[str], rows: list[list[Any]]) -> str:
    shown = [i for i, name in enumerate(columns) if name not in ("why", "word", "period")]
    lines = [" | ".join(markdown_cell(row[i]) for i in shown) for row in (columns, *rows)]
    lines = [f"| {line} |" for line in lines]
    lines.insert(1, "|" + "---|" * len(shown))
    return "\n".join(lines) + "\n"


_MARKS = str.maketrans(
    {"\\": "\\\\", "|": r"\|", "~": r"\~", "`": r"\`", "<": "&lt;", "&": "&amp;"}
)
_LINK = re.compile(r"\](?=[(\[])")


def markdown_cell(value: Any) -> str:
    """Return a value as a cell of a Markdown table, numbers to 12 digits."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.12g}"
    return _LINK.sub(r"]\\", printable(str(value)).translate(_MARKS))
