"""How far complex motion is from the crisis that ends it, in tolerances of chosen parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..bifurcations.crisis import Connected, Connection
from ..errors import InputError, explain_arguments
from ..models.model import Model
from ..results.options import tolerance_sizes
from ..segments.kernels import Kernels
from .connection_paths import is_physical
from .crisis_location import Crisis
from .margins import nearest_point


@dataclass(frozen=True, eq=False)
class CrisisMargin:
    """The point of a crisis's surface in parameters that is nearest to a model's."""

    label: str
    distance: float
    """Its distance, in tolerances."""
    direction: Mapping[str, float]
    """From the model to it, in tolerances of each parameter, of length one."""
    parameters: Mapping[str, float]
    """Those that have tolerances, at the crisis."""
    physical: bool
    """Whether simulated flights repeat the connection there."""
    tolerances: Mapping[str, float]
    path: Connected = field(repr=False)

    def sensitivity(self, parameter: str) -> float:
        """Return the exact derivative of the distance by any parameter of the model.

        Raises
        ------
        InputError
            For a parameter the model does not have.
        """
        model, names = self.path.problem.model, tuple(self.tolerances)
        model.require(parameter, "parameter")
        if parameter in self.tolerances:
            return -self.direction[parameter] / self.tolerances[parameter]
        problem = _connection(self.path.problem, model, *names, parameter)
        here = problem.evaluate(np.append(self.path.unknowns, model.values[parameter]))
        psi = np.linalg.svd(here.jacobian[:, : problem.n])[0][:, -1]
        *slopes, by = (psi @ here.jacobian[:, problem.n :]).tolist()
        sizes = zip(slopes, self.tolerances.items(), strict=True)
        return -float(by / sum(slope * size * self.direction[n] for slope, (n, size) in sizes))

    def __repr__(self) -> str:
        place = ", ".join(f"{name} = {value:.9g}" for name, value in self.parameters.items())
        unphysical = "" if self.physical else ", not physical"
        return f"{self.label} at distance {self.distance:.6g}: {place}{unphysical}"


@explain_arguments
def find_crisis_margin(
    crisis: Crisis, model: Model, tolerances: Mapping[str, float | str]
) -> CrisisMargin:
    """Find how far parameters may change until complex motion ends in a crisis.

    Parameters
    ----------
    crisis : Crisis
        Of that motion, located anywhere; see `locate_crisis`.
    model : Model
        At whose parameters the motion is looked at.
    tolerances : mapping
        Of each parameter that may change, the change that is one unit of distance: a number, or a
        part of the value such as ``"5%"``.

    Returns
    -------
    CrisisMargin
        The nearest point of the surface on which the same connection grazes or touches, from exact
        derivatives, as `find_margins` does for events of orbits. Another connection may end the
        motion before: locate the crisis again there where that matters.

    Raises
    ------
    InputError
        For another system, a parameter it does not have, a tolerance that is not positive, or where
        the search does not settle.
    """
    if type(model) is not type(crisis.model) or model.options != crisis.model.options:
        raise InputError("model", model.SYSTEM, f"give the crisis's system, {crisis.model.SYSTEM}")
    units = tolerance_sizes(tolerances, model)
    center, values = np.array([model.values[name] for name in units]), np.array([*units.values()])
    near, begin = crisis.path, [crisis.model.values[name] for name in units]
    known = np.append(near.unknowns[: near.problem.n], begin)
    problem, start = _connection(near.problem, model, *units).longer(known, 1, 1)
    try:
        found = nearest_point(
            problem, lambda here, own: here, problem.evaluate(start), np.zeros(0), center, values
        )
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        found = None
    if found is None:
        accepted = "locate the crisis nearer to the model"
        raise InputError("crisis", "its nearest point is not found from there", accepted)
    path = found[0]
    place = path.unknowns[problem.n :]
    y = (place - center) / values
    distance = float(np.linalg.norm(y))
    direction = y / distance if distance > 0.0 else y
    return CrisisMargin(
        crisis.label,
        distance,
        dict(zip(units, direction.tolist(), strict=True)),
        dict(zip(units, place.tolist(), strict=True)),
        is_physical(path),
        units,
        path,
    )


def _connection(like: Connection, model: Model, *names: str) -> Connection:
    """The equations of a connection of the same walls, with other free parameters."""
    given = like.walls, like.grazing, like.before, like.after
    return Connection(model, Kernels(model, *names), *given)
