"""Events of a scene against many digits: their true errors, and how honest the estimates are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

import mpmath
import numpy as np

from ..bifurcations.declarations import KINDS
from ..diagrams.explore import follow
from ..orbits.problem import Array
from ..results.branch import Entry, orbit_of
from ..results.diagram import Diagram
from ..results.entry_conversion import details_of
from ..results.scene import Scene
from ..segments.kernels import Kernels
from .reference import Exact, Reference
from .timing import within_budget

DIGITS = 30

SECONDS = 120.0
"""After which no further event is compared."""


def measured_events(
    scene: Scene, kernels: Kernels, diagram: Diagram | None = None
) -> list[dict[str, Any]]:
    """Return every event of the scene's diagram with its true error and its estimate.

    An event of a family's member is compared at that member's parameter values. Those that there
    is no time for are not ``compared``.
    """
    references: dict[Any, Reference] = {}
    entries = [e for e in (diagram or follow(scene)).entries if e.kind in KINDS]
    rows = []
    for entry in within_budget(entries, SECONDS):
        here = orbit_of(entry, scene.model, kernels)
        problem = here.problem
        fixed = [v for n, v in problem.model.values.items() if n != scene.parameter]
        key = (entry.word, entry.period, *fixed)
        exact = references.setdefault(key, Reference(problem, DIGITS))
        found = exact.event(entry.kind, here.unknowns, details_of(entry))
        rows.append(_event_row(entry, here.unknowns, found, True))
    return [*rows, *(_event_row(entry, None, None, False) for entry in entries[len(rows) :])]


def _event_row(
    entry: Entry, unknowns: Array | None, found: Exact | None, compared: bool
) -> dict[str, Any]:
    true = abs(found.parameter_error(entry.value)) if found else None
    return {
        **{name: getattr(entry, name) for name in ("id", "label", "branch", "value")},
        "compared": compared,
        "digits": mpmath.nstr(found.parameter, DIGITS) if found else None,
        "true_error": true,
        "estimated_error": entry.error,
        "ratio": None if true is None else _ratio(true, entry.error),
        "moved": found.distance(unknowns) if found and unknowns is not None else None,
        "condition": found.condition if found else None,
        "method": entry.method,
    }


def _ratio(true: float, estimated: float) -> float:
    """The true error over its estimate; an event that is exact, and says so, is within it."""
    if estimated == 0.0:
        return 0.0 if true == 0.0 else np.inf
    return true / estimated


def honesty(events: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return how true errors compare with their estimates."""
    ratios = [e["ratio"] for e in events if e["ratio"] is not None]
    return {
        "events": len(events),
        "compared": sum(e["compared"] for e in events),
        "confirmed": sum(e["true_error"] is not None for e in events),
        "within_estimate": sum(ratio <= 1.0 for ratio in ratios),
        "median_ratio": median(ratios) if ratios else None,
        "largest_ratio": max(ratios, default=None),
        "largest_true_error": max(
            (e["true_error"] for e in events if e["true_error"] is not None), default=None
        ),
    }
