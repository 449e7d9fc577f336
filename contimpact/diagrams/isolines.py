"""Isolines of quantities of orbits in two parameters, and sensitivities of events."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..arrays import Array
from ..bifurcations.codimension_two import GrazingCoincides, StopCoincides
from ..bifurcations.extended_system import EPSILON, ExtendedSystem, SystemEvaluation
from ..bifurcations.kind import Kind, Values
from ..continuation.branch import Point, TestFunction, UserFunction
from ..continuation.ends import End
from ..continuation.settings import Settings
from ..errors import InputError, explain_arguments, short_repr
from ..models.model import Model
from ..models.word import Word
from ..orbits.orbit import Orbit
from ..orbits.problem import Linearisation, OrbitProblem, rounding
from ..orbits.quiet import problem_of
from ..results.branch import Entry, model_of
from ..results.curve import Curve
from ..results.entry_conversion import to_orbit
from ..results.options import CURVE_SETTINGS
from ..segments.kernels import Kernels
from .curve_problem import (
    CurveProblem,
    curve_problem,
    difference_gradient,
    require_curve,
    sizes_of,
    slope_of,
)
from .curves import Range, check_range, curve_from_walks, walk_both_ways

Function = Callable[[Orbit], float]


@explain_arguments
def follow_isoline(
    orbit: Orbit | Entry,
    function: Function,
    model: Model | None = None,
    *,
    second: str,
    ranges: Sequence[Range],
    value: float | None = None,
    label: str = "isoline",
    name: str = "c1",
    values: Sequence[float] = (),
    settings: Settings = CURVE_SETTINGS,
    callback: Callable[[Point], bool | None] | None = None,
) -> Curve | End:
    """Follow the orbits on which a function keeps its value, in two parameters.

    Parameters
    ----------
    orbit : Orbit or Entry
        Where the curve starts, nearly if `value` is given.
    function : callable ``function(orbit) -> float``
        Smooth where the curve goes; its derivatives are differenced.
    model : Model, optional
        The system of an entry, where its name does not tell.
    second : str
        The second parameter; the first is the one with which the orbit was found.
    ranges : sequence of (low, high)
        Of both parameters; the curve ends where it leaves one.
    value : float, optional
        The value to keep; by default the one at the orbit.
    label : str
        What the curve is called, such as ``"20 V"``.
    name : str
    values : sequence of float
        Values of the second parameter to hit exactly.
    settings : Settings
    callback : callable, optional
        Called with every accepted point.

    Returns
    -------
    Curve or End
        Where its orbits also graze, or an impact of theirs loses its velocity, is in `points`. The
        end of a curve that has no point, where the value is not reached next to the orbit.

    Raises
    ------
    InputError
        For a parameter the model does not have, ranges that do not hold the orbit, or a function
        that does not return a number there.
    """
    given = to_orbit(orbit, model)
    at, first = given.model, given.problem.parameter
    if len(ranges) != 2:
        raise InputError("ranges", f"found {len(ranges)}", "give one for each of two parameters")
    names = (first, second)
    kernels = Kernels(at, *names)
    limits = [check_range(at, n, at.values[n], r) for n, r in zip(names, ranges, strict=True)]
    problem = problem_of(at, given.word, kernels)
    start = np.concatenate([given.unknowns[: problem.n], [at.values[n] for n in names]])
    kept = _number(function(given)) if value is None else float(value)
    system = Level(problem, function, kept)
    curve = CurveProblem(Isoline(system), system, {}, [limits[0][1] - limits[0][0]])
    special = curve.kind.codimension_two(given.word)
    found = walk_both_ways(curve, start, limits, special, values, settings, callback)
    if isinstance(found, End):
        return found
    notation = given.word.notation(at.letters)
    return curve_from_walks(name, curve, found, special, label, notation, "")


class Level(ExtendedSystem):
    """A function of the orbit has a value."""

    def __init__(self, problem: OrbitProblem, function: Function, value: float) -> None:
        super().__init__(problem)
        self.function, self.value = function, value

    def start(self, here: Linearisation) -> Array:
        return np.zeros(0)

    def assemble(self, here: Linearisation, own: Array) -> SystemEvaluation:
        x = here.unknowns
        row = difference_gradient(lambda z: self.away(self.problem.evaluate(z)), x, sizes_of(here))
        residual = np.append(here.residual, self.away(here))
        return SystemEvaluation(residual, np.vstack([here.jacobian, row]))

    def rounding(self, here: Linearisation, own: Array) -> Array:
        size = max(abs(self.value), abs(self._of(here)))
        return np.append(rounding(here).residual, EPSILON * (1.0 + len(here.unknowns) * size))

    def away(self, here: Linearisation) -> float:
        """Return how far the function is from its value on an orbit."""
        return self._of(here) - self.value

    def _of(self, here: Linearisation) -> float:
        return _number(self.function(Orbit(self.problem, here)))


class Isoline(Kind):
    """A value of a function; nothing changes there."""

    name = "isoline"

    def __init__(self, level: Level) -> None:
        self.level = level

    def test(self, problem: OrbitProblem, values: Values) -> TestFunction:
        return UserFunction(self.name, lambda point: self.level.away(point.evaluation))

    def codimension_two(self, word: Word) -> list[TestFunction]:
        return [GrazingCoincides(self.name), StopCoincides(self.name)]


def _number(found: object) -> float:
    try:
        value = np.asarray(found, dtype=float)
    except (TypeError, ValueError):
        value = np.array([np.nan])
    if value.size != 1 or not np.isfinite(value).all():
        raise InputError("function", f"it returned {short_repr(found)}", "return one finite number")
    return float(value.reshape(()))


# How the place of a bifurcation moves with a second parameter, to first order.


@explain_arguments
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
    try:
        return slope_of(problem, start)
    except np.linalg.LinAlgError:
        found = f"the curve of {entry.label} turns here"
        raise InputError("entry", found, "follow the curve with follow_curve") from None
