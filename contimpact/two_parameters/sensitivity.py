"""How the place of a bifurcation moves with a second parameter, to first order."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..models.model import Model
from ..orbits.orbit import Orbit
from ..results.branch import Entry, model_of
from ..segments.kernels import Kernels
from .problem import curve_problem, require_curve


def sensitivity(entry: Entry, parameter: str, model: Model | None = None) -> float:
    """Return the derivative of an event's parameter value with respect to another parameter.

    It is the slope of the bifurcation's curve in the two parameters, see `follow_curve`, at the
    entry.

    Parameters
    ----------
    entry : Entry
        Of a kind that has curves, real or ghost.
    parameter : str
        Any other parameter of the model.
    model : Model, optional
        The system, where its name does not tell; parameter values are taken from the entry.

    Returns
    -------
    float
        In units of the entry's own parameter by those of the other one.

    Raises
    ------
    InputError
        For an entry without a curve, a parameter that the model does not have, or a curve that
        turns here.
    """
    if isinstance(entry, Orbit):
        raise InputError("entry", "found an orbit", "give an entry; an orbit has .sensitivity()")
    require_curve(entry)
    at = model_of(entry, model)
    at.require(parameter, "parameter")
    if parameter == entry.parameter:
        raise InputError("parameter", f"{parameter} is the entry's own", "give another one")
    problem, start = curve_problem(
        at, entry, parameter, Kernels(at, entry.parameter, parameter), 1.0
    )
    jacobian = problem.evaluate(start).jacobian
    try:
        moved = -np.linalg.solve(jacobian[:, :-1], jacobian[:, -1])
    except np.linalg.LinAlgError:
        found = f"the curve of {entry.label} turns here"
        raise InputError("entry", found, "follow the curve with follow_curve") from None
    return float(moved[problem.orbit.n])
