"""What is kept of a scene: rows of the store's tables, as plain data."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..results.branch import Branch, Entry
from ..results.diagram import Diagram
from ..results.diagram_reading import Interval, Reading, read
from .store import row_of

if TYPE_CHECKING:
    from ..diagrams.scene_simulation import Simulation
    from ..systems.membrane import Membrane

Rows = dict[str, list[dict[str, Any]]]


def diagram_rows(diagram: Diagram, keep: Sequence[str], derived: str | None) -> Rows:
    """Return the rows of a diagram."""
    rows: Rows = {
        "branches": [_branch(branch, "tables" in keep) for branch in diagram.branches],
        "events": [_event(entry, derived) for entry in diagram.entries],
        "limits": [
            row_of("limits", limit, number=number, left_out=sum(n for _, n in limit.left_out))
            for number, limit in enumerate(diagram.limits)
        ],
    }
    if "readings" in keep:
        rows |= _readings(diagram, read(diagram), derived)
    if "curves" in keep:
        rows["curves"] = _curves(diagram)
        rows["codimension_two"] = _codimension_two(diagram, derived)
    if "catalogue" in keep:
        from ..results.catalogue import catalogue_text

        rows["catalogues"] = [{"content": compress_text(catalogue_text(diagram))}]
    return rows


def compress_text(text: str) -> bytes:
    """Return a text compressed."""
    return zlib.compress(text.encode(), 9)


def decompress_text(content: bytes) -> str:
    """Return the text that `compress_text` has compressed."""
    return zlib.decompress(content).decode()


def _branch(branch: Branch, whole: bool) -> dict[str, Any]:
    from ..results.catalogue import branch_text

    values = branch[branch.parameter]
    first, last = (end.kind.name.lower() for end in branch.ends)
    return row_of(
        "branches",
        branch,
        branch=branch.id,
        points=len(branch),
        low=float(values.min()),
        high=float(values.max()),
        first_end=first,
        last_end=last,
        missed=len(branch.missed),
        content=compress_text(branch_text(branch)) if whole else None,
    )


def _event(entry: Entry, derived: str | None) -> dict[str, Any]:
    value = entry.parameters[derived] if derived else None
    return row_of("events", entry, event=entry.id, derived=value)


def _readings(diagram: Diagram, reading: Reading, derived: str | None) -> Rows:
    branches = {branch.id: branch for branch in diagram.branches}
    intervals = [
        _interval(number, interval, branches[interval.branch], derived)
        for number, interval in enumerate(reading.stable)
    ]
    transitions = [
        row_of("transitions", transition, number=number, grazing=transition.entry)
        for number, transition in enumerate(reading.transitions)
    ]
    return {"intervals": intervals, "transitions": transitions}


def _interval(
    number: int, interval: Interval, branch: Branch, derived: str | None
) -> dict[str, Any]:
    values = branch[branch.parameter]
    ends = interval.low, interval.high
    of_ends: list[float | None] = [None, None]
    if derived:
        of_ends = [float(branch[derived][abs(values - end).argmin()]) for end in ends]
    (low_end, high_end), (low_derived, high_derived) = interval.bounds, of_ends
    more = {"low_derived": low_derived, "high_derived": high_derived}
    return row_of("intervals", interval, number=number, low_end=low_end, high_end=high_end, **more)


def _curves(diagram: Diagram) -> list[dict[str, Any]]:
    from ..results.catalogue import curve_text

    return [
        row_of(
            "curves",
            curve,
            curve=curve.id,
            first=curve.parameters[0],
            second=curve.parameters[1],
            points=len(curve),
            content=compress_text(curve_text(curve)),
        )
        for curve in diagram.curves
    ]


def _codimension_two(diagram: Diagram, derived: str | None) -> list[dict[str, Any]]:
    pairs = [(curve, point) for curve in diagram.curves for point in curve.points]
    return [
        row_of(
            "codimension_two",
            point,
            number=number,
            notation=curve.notation,
            first=curve.parameters[0],
            second=curve.parameters[1],
            first_value=point.parameters[curve.parameters[0]],
            second_value=point.parameters[curve.parameters[1]],
            derived=point.parameters[derived] if derived else None,
        )
        for number, (curve, point) in enumerate(pairs)
    ]


def simulation_rows(simulation: Simulation, keep: Sequence[str], membrane: Membrane | None) -> Rows:
    """Return the rows of a simulation."""
    found: Rows = {"attractors": [], "energies": []}
    for number, row in enumerate(simulation.sweep.rows):
        a = row.attractor
        own = {"number": number, "direction": row.direction, "value": row.value}
        own |= {"kind": a.kind.value, "exponent": a.exponents[0], "gap": a.smallest_gap}
        found["attractors"].append(row_of("attractors", a, **own))
        if "energies" in keep and membrane is not None:
            from ..simulation.energy import attractor_voltages

            energy = attractor_voltages(membrane, a)
            found["energies"].append(row_of("energies", energy, number=number))
    return found
