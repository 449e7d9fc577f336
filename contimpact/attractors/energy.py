"""The output voltage of the energy harvester: of orbits, along branches, and on attractors."""

from __future__ import annotations

import numpy as np

from ..arrays import Array
from ..errors import InputError, shown
from ..orbits.orbit import Orbit
from ..results.branch import Branch, Entry
from ..results.quantities import Energy, along, of_impacts
from ..systems.membrane import Membrane
from .attractor import Attractor, Kind

__all__ = ["Energy", "Membrane", "along", "energy", "of_attractor", "of_impacts"]


def energy(
    of: Orbit | Entry | Attractor | Branch, membrane: Membrane | None = None
) -> Energy | dict[str, Array]:
    """Return the output voltages of an orbit, of an attractor, or along a branch.

    Parameters
    ----------
    of : Orbit, Entry, Attractor or Branch
        Of the impact pair.
    membrane : Membrane, optional
        Membranes and ball; those of the paper by default.

    Returns
    -------
    Energy or dict of str to ndarray
        Of a branch the columns ``U1``, ``U2``, ... of each impact, ``U_I`` per impact and ``U_T``
        per time, in V, with a value for each point.

    Raises
    ------
    InputError
        For anything else, or a system without membranes.
    """
    membrane = membrane or Membrane()
    if isinstance(of, Branch):
        return along(membrane, of)
    if isinstance(of, Attractor):
        return of_attractor(membrane, of)
    orbit = of.orbit() if isinstance(of, Entry) else of
    if not isinstance(orbit, Orbit):
        accepted = "give an orbit, an entry, an attractor or a branch"
        raise InputError("of", f"found {shown(of)}", accepted)
    return of_impacts(membrane, orbit.parameters, orbit.velocities, orbit.linearisation.span)


def of_attractor(membrane: Membrane, attractor: Attractor) -> Energy:
    """Return the voltages of an attractor, over its period or over the end of its run."""
    if attractor.kind in (Kind.RESTING, Kind.NO_IMPACT):
        return Energy(np.zeros(0), 0.0, 0.0)
    hits = ~attractor.released
    if attractor.period is not None:
        span = attractor.period * attractor.forcing_period
    else:  # from the first impact to the last, without the first
        span = float(attractor.times[-1] - attractor.times[0])
        hits = hits & (np.arange(len(hits)) > 0)
    found = of_impacts(membrane, attractor.parameters, attractor.velocities[hits], span)
    if attractor.kind is Kind.STICKING:
        return Energy(found.impacts, 0.0, found.per_time)
    return found
