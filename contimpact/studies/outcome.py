"""What is kept of a scene: rows of the store's tables, as plain data."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from ..results.branch import Branch, Entry
from ..results.diagram import Diagram, Limit
from ..results.diagram_reading import Interval, Reading, read

if TYPE_CHECKING:
    from ..diagrams.scene_simulation import Simulation
    from ..systems.membrane import Membrane

Rows = dict[str, list[dict[str, Any]]]


@dataclass(frozen=True)
class Outcome:
    """What has become of a scene."""

    status: str
    """``done``, ``incomplete`` where a failure ended it early, or ``failed``."""
    seconds: float | None
    versions: str
    """Versions of the package and its libraries, as JSON."""
    rows: Mapping[str, Sequence[Mapping[str, Any]]] = field(default_factory=dict)
    """Rows, by table."""
    points: int | None = None
    evaluations: int | None = None


def failure(kind: str, reason: str) -> dict[str, Any]:
    """Return the row of a failure."""
    return {"kind": kind, "reason": reason}


def diagram_rows(diagram: Diagram, keep: Sequence[str], derived: str | None) -> Rows:
    """Return the rows of a diagram."""
    rows: Rows = {
        "branches": [_branch(branch, "tables" in keep) for branch in diagram.branches],
        "events": [_event(entry, derived) for entry in diagram.entries],
        "limits": [_limit(number, limit) for number, limit in enumerate(diagram.limits)],
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
    return {
        "branch": branch.id,
        "notation": branch.notation,
        "word": branch.word,
        "period": branch.period,
        "origin": branch.origin,
        "points": len(branch),
        "low": float(values.min()),
        "high": float(values.max()),
        "first_end": first,
        "last_end": last,
        "missed": len(branch.missed),
        "content": compress_text(branch_text(branch)) if whole else None,
    }


def _limit(number: int, limit: Limit) -> dict[str, Any]:
    left_out = sum(count for _, count in limit.left_out)
    about = {"key": limit.key, "value": limit.value, "what": limit.what}
    return {"number": number, **about, "left_out": left_out}


_OF_ENTRY = (
    "branch",
    "kind",
    "label",
    "ghost",
    "notation",
    "word",
    "period",
    "becomes",
    "wall",
    "value",
    "stable",
    "physical",
    "n_unstable",
    "criticality",
    "why",
    "arclength",
    "residual",
    "error",
)


def _event(entry: Entry, derived: str | None) -> dict[str, Any]:
    own = {name: getattr(entry, name) for name in _OF_ENTRY}
    return {"event": entry.id, **own, "derived": entry.parameters[derived] if derived else None}


def _readings(diagram: Diagram, reading: Reading, derived: str | None) -> Rows:
    branches = {branch.id: branch for branch in diagram.branches}
    intervals = [
        {"number": number, **_interval(interval, branches[interval.branch], derived)}
        for number, interval in enumerate(reading.stable)
    ]
    transitions = [
        {
            "number": number,
            "source": t.source,
            "target": t.target,
            "mechanism": t.mechanism,
            "grazing": t.entry,
            "doubling": t.doubling,
            "fold": t.fold,
        }
        for number, t in enumerate(reading.transitions)
    ]
    return {"intervals": intervals, "transitions": transitions}


def _interval(interval: Interval, branch: Branch, derived: str | None) -> dict[str, Any]:
    values = branch[branch.parameter]
    ends = interval.low, interval.high
    of_ends: list[float | None] = [None, None]
    if derived:
        of_ends = [float(branch[derived][abs(values - end).argmin()]) for end in ends]
    return {
        "branch": interval.branch,
        "notation": interval.notation,
        "low": interval.low,
        "high": interval.high,
        "low_end": interval.bounds[0],
        "high_end": interval.bounds[1],
        "low_derived": of_ends[0],
        "high_derived": of_ends[1],
    }


def _curves(diagram: Diagram) -> list[dict[str, Any]]:
    from ..results.catalogue import curve_text

    return [
        {
            "curve": curve.id,
            "kind": curve.kind,
            "label": curve.label,
            "notation": curve.notation,
            "first": curve.parameters[0],
            "second": curve.parameters[1],
            "points": len(curve),
            "content": compress_text(curve_text(curve)),
        }
        for curve in diagram.curves
    ]


def _codimension_two(diagram: Diagram, derived: str | None) -> list[dict[str, Any]]:
    pairs = [(curve, point) for curve in diagram.curves for point in curve.points]
    return [
        {
            "number": number,
            "curve": curve.id,
            "kind": point.kind,
            "notation": curve.notation,
            "first": curve.parameters[0],
            "second": curve.parameters[1],
            "first_value": point.parameters[curve.parameters[0]],
            "second_value": point.parameters[curve.parameters[1]],
            "derived": point.parameters[derived] if derived else None,
            "residual": point.residual,
            "error": point.error,
        }
        for number, (curve, point) in enumerate(pairs)
    ]


def simulation_rows(simulation: Simulation, keep: Sequence[str], membrane: Membrane | None) -> Rows:
    """Return the rows of a simulation."""
    found: Rows = {"attractors": [], "energies": []}
    for number, row in enumerate(simulation.sweep.rows):
        a = row.attractor
        found["attractors"].append(
            {
                "number": number,
                "direction": row.direction,
                "value": row.value,
                "kind": a.kind.value,
                "notation": a.notation,
                "word": a.word,
                "period": a.period,
                "exponent": a.exponents[0],
                "rate": a.rate,
                "gap": a.smallest_gap,
            }
        )
        if "energies" in keep and membrane is not None:
            from ..simulation.energy import attractor_voltages

            energy = attractor_voltages(membrane, a)
            means = {"per_impact": energy.per_impact, "per_time": energy.per_time}
            found["energies"].append({"number": number, **means})
    return found
