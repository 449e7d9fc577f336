"""Continuation of periodic orbits in impacting systems, ghosts included.

The names below are loaded when they are first used; importing the package imports nothing else.
"""

from __future__ import annotations

import importlib
from typing import Any

__version__ = "0.1.0"

_PLACES = {
    "InputError": "errors",
    "ImpactPair": "systems.impact_pair",
    "Oscillator": "systems.oscillator",
    "Model": "mechanics.model",
    "Parameter": "mechanics.model",
    "Wall": "mechanics.model",
    "Formulas": "mechanics.model",
    "Symmetry": "mechanics.model",
    "Orbit": "mechanics.search",
    "find_orbits": "mechanics.search",
    "Settings": "continuation.arclength",
    "continue_orbit": "orbit_branch",
    "continue_born": "orbit_branch",
    "follow": "explore",
    "follow_curve": "two_parameters.curves",
    "Curve": "two_parameters.curves",
    "read": "reading",
    "stable_intervals": "reading",
    "load_entries": "catalogue",
    "plot_curves": "plots.curves",
    "write_auto": "formats",
    "write_mat": "formats",
    "load_scene": "scene",
    "read_scene": "scene",
    "Branch": "diagram",
    "Diagram": "diagram",
    "Entry": "diagram",
    "Simulator": "mechanics.simulate",
    "settle": "attractors.attractor",
    "sweep": "attractors.sweep",
    "find_transitions": "attractors.transitions",
    "cover": "attractors.coverage",
    "load_diagram": "catalogue",
    "write_diagram": "catalogue",
    "plot_diagram": "plots.diagram",
}

__all__ = ["__version__", *_PLACES]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_PLACES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
