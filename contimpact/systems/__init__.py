"""The systems that come with the package, one file each."""

from __future__ import annotations

import importlib

from ..errors import InputError
from ..models.model import Model

SYSTEMS = {
    "impact-pair": "impact_pair:ImpactPair",
    "oscillator": "oscillator:Oscillator",
    "bouncing-ball": "bouncing_ball:BouncingBall",
    "soft-stop": "soft_stop:SoftStop",
    "two-stops": "two_stops:TwoStops",
    "two-masses": "two_masses:TwoMasses",
    "coupled-by-impact": "coupled_by_impact:CoupledByImpact",
    "impact-damper": "impact_damper:ImpactDamper",
    "linear": "linear:LinearMachine",
}


def system(name: str, where: str = "system") -> type[Model]:
    """Return the class of a system by the name scenes use.

    Raises
    ------
    InputError
        If there is no such system.
    """
    if name not in SYSTEMS:
        raise InputError(where, f"no system {name!r}", f"accepted are {', '.join(SYSTEMS)}")
    module, attribute = SYSTEMS[name].split(":")
    return getattr(importlib.import_module(f"{__name__}.{module}"), attribute)
