"""Continuation of periodic orbits in impacting systems, ghosts included.

The names below are loaded when they are first used; importing the package imports nothing else.
"""

from __future__ import annotations

import importlib
from typing import Any

__version__ = "0.2.0"

_PLACES = {
    "InputError": "errors",
    "ImpactPair": "systems.impact_pair",
    "Oscillator": "systems.oscillator",
    "Model": "models.model",
    "Parameter": "models.model",
    "Wall": "models.model",
    "Formulas": "models.model",
    "Symmetry": "models.model",
    "check_model": "segments.checking",
    "Orbit": "orbits.search",
    "find_orbits": "orbits.search",
    "Settings": "continuation.settings",
    "continue_orbit": "orbit_continuation.orbit_branch",
    "continue_born": "orbit_continuation.born",
    "follow": "studies.explore",
    "follow_codim2": "two_parameters.codim2_curves",
    "follow_curve": "two_parameters.curves",
    "follow_isoline": "two_parameters.isolines",
    "Curve": "records.curve",
    "read": "records.diagram_reading",
    "stable_intervals": "records.diagram_reading",
    "load_entries": "records.catalogue",
    "plot_codim2": "plots.codim2",
    "plot_curves": "plots.curves",
    "save": "attractors.keeping",
    "load": "attractors.keeping",
    "sensitivity": "two_parameters.sensitivity",
    "write_auto": "records.formats",
    "write_mat": "records.formats",
    "load_scene": "scenes.scene",
    "read_scene": "scenes.scene",
    "Branch": "records.branch",
    "Diagram": "records.diagram",
    "Entry": "records.entry",
    "certify": "certificates.certify",
    "Simulator": "simulation.simulator",
    "Membrane": "systems.membrane",
    "energy": "attractors.energy",
    "losses": "attractors.losses",
    "settle": "attractors.verdict",
    "sweep": "attractors.sweep",
    "find_transitions": "attractors.transitions",
    "cover": "attractors.coverage",
    "load_study": "parameter_studies.study_file",
    "read_study": "parameter_studies.study_file",
    "run_study": "parameter_studies.run",
    "Store": "parameter_studies.store",
    "Study": "parameter_studies.study",
    "load_diagram": "records.catalogue",
    "write_diagram": "records.catalogue",
    "plot_diagram": "plots.diagram",
    "plot_orbit": "plots.orbit",
    "plot_sweep": "plots.attractors",
    "plot_transitions": "plots.transitions",
    "plot_energy": "plots.attractors",
}

__all__ = ["__version__", *_PLACES]


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_PLACES[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
