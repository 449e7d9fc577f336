"""Continuation of periodic orbits in impacting systems, ghosts included.

The names below are loaded when they are first used; importing the package imports nothing else. A
function whose package is not installed says so when it is called.
"""

from __future__ import annotations

import importlib
import re
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .certificates.certify import certify as certify
    from .continuation.settings import Settings as Settings
    from .diagrams.crises import find_crises as find_crises
    from .diagrams.crises import find_crisis_margin as find_crisis_margin
    from .diagrams.crises import follow_crisis as follow_crisis
    from .diagrams.crisis_location import locate_crisis as locate_crisis
    from .diagrams.crisis_location import locate_tangencies as locate_tangencies
    from .diagrams.curves import follow_curve as follow_curve
    from .diagrams.curves import follow_isoline as follow_isoline
    from .diagrams.curves import sensitivity as sensitivity
    from .diagrams.design import design as design
    from .diagrams.explore import follow as follow
    from .diagrams.map_explorer import follow_codim2 as follow_codim2
    from .diagrams.margins import find_margins as find_margins
    from .diagrams.orbit_branch import continue_born as continue_born
    from .diagrams.orbit_branch import continue_orbit as continue_orbit
    from .diagrams.ranges import attractor_ranges as attractor_ranges
    from .diagrams.ranges import load_ranges as load_ranges
    from .diagrams.starting_orbits import find_orbits as find_orbits
    from .display import plot as plot
    from .errors import InputError as InputError
    from .models.model import Formulas as Formulas
    from .models.model import Geometry as Geometry
    from .models.model import Model as Model
    from .models.model import Parameter as Parameter
    from .models.model import Symmetry as Symmetry
    from .models.model import Wall as Wall
    from .orbits.fitting import fit as fit
    from .orbits.orbit import Orbit as Orbit
    from .page.document import view as view
    from .plots.attractors import plot_basins as plot_basins
    from .plots.attractors import plot_energy as plot_energy
    from .plots.attractors import plot_manifold as plot_manifold
    from .plots.attractors import plot_sweep as plot_sweep
    from .plots.curves import plot_codim2 as plot_codim2
    from .plots.curves import plot_curves as plot_curves
    from .plots.curves import plot_transitions as plot_transitions
    from .plots.diagram import plot_diagram as plot_diagram
    from .plots.orbit import plot_fit as plot_fit
    from .plots.orbit import plot_orbit as plot_orbit
    from .results.branch import Branch as Branch
    from .results.branch import Entry as Entry
    from .results.catalogue import load_diagram as load_diagram
    from .results.catalogue import load_entries as load_entries
    from .results.catalogue import write_diagram as write_diagram
    from .results.curve import Curve as Curve
    from .results.diagram import Diagram as Diagram
    from .results.diagram_reading import read as read
    from .results.diagram_reading import stable_intervals as stable_intervals
    from .results.formats import write_auto as write_auto
    from .results.formats import write_mat as write_mat
    from .results.scene import load_scene as load_scene
    from .results.scene import new_scene as new_scene
    from .results.scene import read_scene as read_scene
    from .segments.checking import check_model as check_model
    from .simulation.energy import energy as energy
    from .simulation.energy import losses as losses
    from .simulation.files import load as load
    from .simulation.files import save as save
    from .simulation.integrity import basin_fractions as basin_fractions
    from .simulation.integrity import escape_rate as escape_rate
    from .simulation.integrity import integrity as integrity
    from .simulation.manifolds import grow_manifold as grow_manifold
    from .simulation.settle import settle as settle
    from .simulation.simulator import Simulator as Simulator
    from .simulation.sweep import Basins as Basins
    from .simulation.sweep import basins as basins
    from .simulation.sweep import cover as cover
    from .simulation.sweep import find_attractors as find_attractors
    from .simulation.sweep import sweep as sweep
    from .simulation.transitions import find_transitions as find_transitions
    from .studies.run import run_study as run_study
    from .studies.store import Store as Store
    from .studies.study import Study as Study
    from .studies.study_file import load_study as load_study
    from .studies.study_file import read_study as read_study
    from .systems import list_systems as list_systems
    from .systems.belt import Belt as Belt
    from .systems.bouncing_ball import BouncingBall as BouncingBall
    from .systems.coupled_by_impact import CoupledByImpact as CoupledByImpact
    from .systems.duffing import Duffing as Duffing
    from .systems.impact_damper import ImpactDamper as ImpactDamper
    from .systems.impact_pair import ImpactPair as ImpactPair
    from .systems.membrane import Membrane as Membrane
    from .systems.oscillator import Oscillator as Oscillator
    from .systems.pendulum import Pendulum as Pendulum
    from .systems.soft_pair import SoftPair as SoftPair
    from .systems.soft_stop import SoftStop as SoftStop
    from .systems.stated import HybridSystem as HybridSystem
    from .systems.stated import LinearMachine as LinearMachine
    from .systems.two_masses import TwoMasses as TwoMasses
    from .systems.two_stops import TwoStops as TwoStops
    from .systems.van_der_pol import VanDerPol as VanDerPol

__version__ = "0.2.0"

_PLACES: dict[str, str] = {
    name: place
    for place, name in re.findall(
        r"^    from \.(\S+) import \w+ as (\w+)$",
        __spec__.loader.get_source(__name__),  # type: ignore[union-attr]
        re.MULTILINE,
    )
}
"""The module of each public name, read from the imports above, which type checkers follow."""

__all__ = ["__version__", *_PLACES]


if not TYPE_CHECKING:  # where types are read, a name that is not above is a mistake

    def __getattr__(name: str) -> Any:
        if name not in _PLACES:
            from .errors import did_you_mean, guessed_names

            other = next((one for one in guessed_names(name) if one in _PLACES), None)
            hint = f"; there is {other!r}" if other else did_you_mean(name, _PLACES)
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}{hint}")
        try:
            return getattr(importlib.import_module(f"{__name__}.{_PLACES[name]}"), name)
        except ModuleNotFoundError as error:
            return _lacking(name, error)


def load_painters() -> None:
    """Load the functions that draw results; they register themselves with `display`."""
    for name in ("attractors", "maps", "orbit"):  # which import the others
        importlib.import_module(f"{__name__}.plots.{name}")


def _lacking(name: str, error: ModuleNotFoundError) -> Any:
    """What stands for a function whose package is not installed: it says so when it is called."""

    def lacking(*given: Any, **named: Any) -> Any:
        raise error

    lacking.__name__ = lacking.__qualname__ = name
    lacking.__doc__ = f"Not available: {error}."
    return lacking


def __dir__() -> list[str]:
    return sorted(__all__)
