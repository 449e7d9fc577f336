"""Curves of crises in two parameters, and how far parameters are from a crisis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..arrays import Array
from ..bifurcations.crisis import Connected, Connection, error_of, solve
from ..continuation.branch import End
from ..continuation.settings import Settings
from ..continuation.walk import walk
from ..errors import InputError, explain_arguments
from ..models.model import Model
from ..results.options import CURVE_SETTINGS, tolerance_sizes
from ..segments.kernels import Kernels
from .connection_paths import is_physical
from .crisis_location import Crisis


@dataclass(frozen=True, eq=False)
class CrisisCurve:
    """A curve of crises in two parameters."""

    names: tuple[str, str]
    """The crisis's own parameter, and the second one."""
    values: Array
    """Both at each point, in the order of the curve, shape (N, 2)."""
    errors: Array
    """Bounds of the errors of the first at the second, shape (N,)."""
    physical: Array
    """Whether simulated flights repeat the connection at each point, shape (N,)."""
    ends: tuple[End, End]
    """Why the curve ends."""
    label: str
    paths: Sequence[Connected] = field(repr=False)
    """The connections, with both parameters as unknowns."""

    def at(self, second: float) -> list[float]:
        """Return the values of the first parameter where the second has a value, solved for."""
        found = []
        offset = self.values[:, 1] - second
        found += self.values[offset == 0.0, 0].tolist()
        for k in np.nonzero(offset[:-1] * offset[1:] < 0.0)[0].tolist():
            part = offset[k] / (offset[k] - offset[k + 1])
            one, other = self.paths[k].unknowns, self.paths[k + 1].unknowns
            guess = (one + part * (other - one))[:-1]
            path = solve(_with_one_parameter(self.paths[k].problem, second), guess)
            if path is not None:
                found.append(float(path.unknowns[-1]))
        return found

    def __len__(self) -> int:
        return len(self.values)

    def __repr__(self) -> str:
        first, second = self.names
        values = self.values[:, 1]
        head = (
            f"Curve of {self.label} in ({first}, {second}), {len(self)} points, "
            f"{second} from {values.min():.9g} to {values.max():.9g}"
        )
        ends = [f"  end: {end.message}" for end in self.ends]
        left = int(np.sum(~self.physical))
        known = "  whether an attractor reaches it is known where it was located alone"
        unphysical = [f"  not physical: {left} points"] if left else []
        return "\n".join([head, *ends, *unphysical, known])


@explain_arguments
def follow_crisis(
    crisis: Crisis, second: str, limits: tuple[float, float], settings: Settings = CURVE_SETTINGS
) -> CrisisCurve:
    """Follow a crisis in two parameters.

    Parameters
    ----------
    crisis : Crisis
    second : str
        The second parameter; the first is the crisis's own.
    limits : (low, high)
        Range of the second parameter; it holds the crisis.
    settings : Settings
        Numerics of the walk.

    Returns
    -------
    CrisisCurve
        Whether the attractor that touches is still there is not looked at along the curve; locate
        the crisis again where that matters.

    Raises
    ------
    InputError
        For a parameter the model does not have, or limits that do not hold the crisis.
    """
    model = crisis.model
    model.require(second, "second")
    kernels = Kernels(model, crisis.parameter, second)
    path = crisis.path.problem
    given = path.walls, path.grazing, path.before, path.after
    begin = np.append(crisis.path.unknowns, model.values[second])
    problem, start = Connection(model, kernels, *given).longer(begin, 1, 1)
    ways = [
        walk(problem, start, way, parameter=second, limits=limits, settings=settings)
        for way in (-1, 1)
    ]
    paths: list[Connected] = [
        point.evaluation for point in [*reversed(ways[0].points), *ways[1].points[1:]]
    ]
    values = np.array([p.unknowns[-2:] for p in paths])
    left = max(_left_by_laps(p) for p in (paths[0], paths[-1]))
    errors = [error_of(_alone(p)) + left for p in paths]
    physical = np.array([is_physical(p) for p in paths])
    ends = ways[0].end, ways[1].end
    names = crisis.parameter, second
    return CrisisCurve(names, values, np.array(errors), physical, ends, crisis.label, paths)


def _with_one_parameter(problem: Connection, second: float) -> Connection:
    """The equations at a value of the second parameter."""
    first, other = problem.kernels.parameters
    model = problem.model.replace(**{other: second})
    given = problem.walls, problem.grazing, problem.before, problem.after
    return Connection(model, Kernels(model, first), *given)


def _alone(path: Connected) -> Connected:
    """A point of a curve as a crisis at its second parameter."""
    problem = _with_one_parameter(path.problem, float(path.unknowns[-1]))
    return problem.evaluate(path.unknowns[:-1])


def _left_by_laps(path: Connected) -> float:
    """How much one more lap at both ends changes a crisis; infinite if that is not known."""
    here = _alone(path)
    found = solve(*here.problem.longer(here.unknowns, 1, 1))
    return np.inf if found is None else abs(float(found.unknowns[-1] - here.unknowns[-1]))


# How far complex motion is from the crisis that ends it, in tolerances of chosen parameters.


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
    from .margins import nearest_point

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
