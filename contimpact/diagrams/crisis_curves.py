"""Curves of crises in two parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..arrays import Array
from ..bifurcations.crisis import Connected, Connection, error_of, solve
from ..continuation.ends import End
from ..continuation.settings import Settings
from ..continuation.walk import walk
from ..errors import explain_arguments
from ..results.options import CURVE_SETTINGS
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
