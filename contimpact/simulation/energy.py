"""Energy that attractors deliver to a membrane, and that impacts lose."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..arrays import Array
from ..errors import InputError, explain_arguments, short_repr
from ..models.model import Model
from ..models.outputs import require_membranes
from ..orbits.orbit import Orbit
from ..results.branch import Branch, Entry
from ..results.quantities import Energy, branch_voltages, impact_voltages
from ..segments.kernel import Family
from ..segments.kernels import Kernels
from ..systems.membrane import Membrane
from .attractor import Attractor

__all__ = [
    "Energy",
    "Membrane",
    "attractor_voltages",
    "branch_voltages",
    "energy",
    "impact_voltages",
]


@explain_arguments
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
        return branch_voltages(membrane, of)
    if isinstance(of, Attractor):
        return attractor_voltages(membrane, of)
    orbit = of.orbit() if isinstance(of, Entry) else of
    if not isinstance(orbit, Orbit):
        accepted = "give an orbit, an entry, an attractor or a branch"
        raise InputError("of", f"found {short_repr(of)}", accepted)
    require_membranes(orbit.model)
    return impact_voltages(membrane, orbit.parameters, orbit.velocities, orbit.linearisation.span)


def attractor_voltages(membrane: Membrane, attractor: Attractor) -> Energy:
    """Return the voltages of an attractor, over its period or over the end of its run."""
    require_membranes(attractor.model)
    if not attractor.times.size:
        return Energy(np.zeros(0), 0.0, 0.0)
    hits, span = _counted(attractor)
    found = impact_voltages(membrane, attractor.parameters, attractor.velocities[hits], span)
    return replace(found, per_impact=0.0) if attractor.accumulates else found


def _counted(attractor: Attractor) -> tuple[Array, float]:
    """Which rows of an attractor are counted, and the time that they take: all impacts of its
    period, or else those after the first one, until the last."""
    hits = ~attractor.released
    if attractor.period is not None:
        return hits, attractor.duration
    hits[0] = False
    return hits, float(attractor.times[-1] - attractor.times[0]) or math.nan


# The energy that impacts take: the loss of kinetic energy at each jump.
#
# With the velocities v before an impact and v+ after it, and the mass matrix M,
#
# .. math:: E = \tfrac12\left(v \cdot Mv - v^+ \cdot Mv^+\right),
#
# which for an impulse along n, without friction, is Carnot's theorem
#
# .. math:: E = \frac{1 - r^2}{2}\,\frac{(n \cdot v)^2}{n \cdot M^{-1}n}
#
# (B. Brogliato, Nonsmooth Mechanics, 2016, sec. 4.3). For one degree of freedom it is that of a
# unit of mass, unless the system says what moves.


@explain_arguments
def losses(of: Orbit | Entry | Attractor, model: Model | None = None) -> Energy:
    """Return the kinetic energy that impacts take.

    Parameters
    ----------
    of : Orbit, Entry or Attractor
    model : Model, optional
        Of an attractor, at any parameter values.

    Returns
    -------
    Energy

    Raises
    ------
    InputError
        For anything else, or a system that does not state its masses.
    """
    orbit = of.orbit() if isinstance(of, Entry) else of
    if isinstance(orbit, Orbit):
        problem = orbit.problem
        rows = problem.impacts(orbit.unknowns)
        walls = orbit.model.letters
        numbers = np.array([walls.index(w) for w in problem.word.walls], dtype=int)
        found = _lost_energies(problem.kernels, orbit.model, numbers, rows[:, 1:])
        return Energy.of(found, problem.span(orbit.unknowns))
    if not isinstance(of, Attractor) or model is None:
        accepted = "give an orbit, an entry, or an attractor and its model"
        raise InputError("of", f"found {short_repr(of)}", accepted)
    return losses_of_attractor(of, model, Kernels(model, next(iter(model.values))))


def losses_of_attractor(attractor: Attractor, model: Model, kernels: Kernels) -> Energy:
    """Return the losses of an attractor, over its period or over the end of its run."""
    if not len(attractor.walls):
        return Energy(np.zeros(0), 0.0, 0.0)
    here = model.replace(**{name: attractor.parameters[name] for name in model.values})
    section = attractor.velocities[:, None]
    if attractor.others.size:
        section = np.column_stack([section, attractor.others])
    found = _lost_energies(kernels, here, attractor.walls, section)
    found[attractor.released] = 0.0
    hits, span = _counted(attractor)
    means = Energy.of(found[hits], span)
    per_impact = 0.0 if attractor.accumulates else means.per_impact
    return replace(means, impacts=found, per_impact=per_impact)


def _lost_energies(kernels: Kernels, model: Model, walls: Array, section: Array) -> Array:
    names, values = model.letters, tuple(model.values.values())
    rows = zip(walls.tolist(), section.tolist(), strict=True)
    found = [float(kernels.loss(names[wall])(*row, *values)[0]) for wall, row in rows]
    if any(math.isnan(lost) for lost in found):
        raise _unknown_energy_error("losses", model)
    return np.array(found)


def require_masses(model: Model, kernels: Kernels, where: str) -> None:
    """Refuse, at the place `where`, a system of whose impacts the losses are not known."""
    if any(kernels.loss(letter).family is Family.UNKNOWN for letter in model.letters):
        raise _unknown_energy_error(where, model)


def _unknown_energy_error(where: str, model: Model) -> InputError:
    found = f"the kinetic energy of {model.SYSTEM} is not known"
    stated = model.place("mass") if model.STATED else "Formulas.mass"
    return InputError(where, found, f"state its masses, {stated}")
