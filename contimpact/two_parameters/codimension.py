r"""Points of codimension two on curves of bifurcations, as test functions along a curve.

====== ============ ======================================================================
kind   on           test function
====== ============ ======================================================================
FB-G.. FB, BP, PD   smallest interior gap of each flight and wall: the orbit also grazes
..-V   FB, BP, PD   velocity of each impact
G-PD   G, V         determinant of C(-1) of the orbit that grazes
G-FB   G, V         determinant of C(1) of the orbit that grazes (the old branch folds), and
                    parameter rate of the branch with one impact more (its fold is born)
DG     G, V         acceleration at the touch
CP     FB           psi . F_zz[q, q], oriented by psi . F_lambda > 0: a cusp
GPD    PD           lambda - lambda_0 over the squared amplitude of the doubled orbit, in the limit
R1, R2 FB, PD       product of two multipliers minus one: a second one at 1, or at -1
====== ============ ======================================================================

They are located by bracketing along the curve, whose points solve its equations to rounding.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..bifurcations.criticality import doubling_bend
from ..continuation.arclength import scaled_determinant
from ..continuation.branch import Point
from ..continuation.events import TestFunction
from ..orbits import multipliers as stability
from ..orbits.linearisation import Linearisation
from ..orbits.problem import Array, OrbitProblem
from .problem import CurvePoint, CurveProblem


class OnCurve(TestFunction):
    """A test function of the points of a curve, with a sentence on what changes at its zeros."""

    changes: str = ""

    def values(self, point: Point) -> Array:
        try:
            here: Any = point.evaluation
            return np.atleast_1d(np.array(self.of(here), dtype=float))
        except (ArithmeticError, np.linalg.LinAlgError):
            return np.array([np.nan])

    @abstractmethod
    def of(self, here: CurvePoint) -> Any:
        """Return the values, as a number or a sequence."""

    def details(self, point: Point, index: int) -> Mapping[str, Any]:
        return {"index": index, "changes": self.changes}


class AlsoGrazes(OnCurve):
    """The bifurcating orbit touches a wall."""

    def __init__(self, kind: str) -> None:
        self.kind = f"{kind}-G"
        self.changes = (
            f"the {kind} and a grazing happen on the same orbit: beyond, the orbit is unphysical "
            f"at the {kind}, which becomes a ghost"
        )

    def of(self, here: CurvePoint) -> Any:
        touches = [t for flight in here.orbit.gaps for t in flight.touches]
        return [np.nan if t is None else t.gap for t in touches]


class AlsoStops(OnCurve):
    """An impact of the bifurcating orbit loses its velocity."""

    def __init__(self, kind: str) -> None:
        self.kind = f"{kind}-V"
        self.changes = (
            f"an impact loses its velocity on the orbit of the {kind}: beyond, it runs the wrong "
            "way"
        )

    def of(self, here: CurvePoint) -> Any:
        return here.orbit.problem.impacts(here.orbit.unknowns)[:, 1]


class GrazingDoubles(OnCurve):
    """A multiplier of the grazing orbit is -1."""

    kind = "G-PD"
    changes = "the grazing orbit doubles its period here: the grazing is real on one side only"

    def of(self, here: CurvePoint) -> Any:
        old = without_touch(here)
        return scaled_determinant(old.cyclic(-1.0)[:, : old.problem.n])


class GrazingFolds(OnCurve):
    """A multiplier of the grazing orbit is 1."""

    kind = "G-FB"
    changes = "the branch that grazes folds at its grazing"

    def of(self, here: CurvePoint) -> Any:
        old = without_touch(here)
        return scaled_determinant(old.cyclic(1.0)[:, : old.problem.n])


class NewBranchFolds(OnCurve):
    """The branch with one impact more leaves its grazing with the parameter at rest."""

    kind = "G-FB"
    changes = (
        "the fold of the new branch is born at the grazing: the grazing changes between "
        "supercritical and subcritical"
    )

    def of(self, here: CurvePoint) -> Any:
        new = with_touch(here)
        return scaled_determinant(new.cyclic(1.0)[:, : new.problem.n])


class DegenerateTouch(OnCurve):
    """The touch has no acceleration."""

    kind = "DG"
    changes = "the touch has zero acceleration: two touches of the flight are born or meet"

    def of(self, here: CurvePoint) -> Any:
        orbit, problem = here.orbit, here.orbit.problem
        if here.problem.kind == "V":
            left, since = here.details["impact"], 0.0
        else:
            left = here.details["flight"]
            since = here.details["touch_time"] - problem.impacts(orbit.unknowns)[left, 0]
        row = problem.impacts(orbit.unknowns)[left].tolist()
        kernel = problem.kernels.motion(problem.word.walls[left])
        return kernel(*row, since, *problem.values(orbit.unknowns))[2]


class Cusp(OnCurve):
    """Two folds meet."""

    kind = "CP"
    changes = "a cusp: two folds meet and end"

    def of(self, here: CurvePoint) -> Any:
        orbit, n = here.orbit, here.orbit.problem.n
        psi = np.linalg.svd(orbit.cyclic(1.0)[:, :n])[0][:, -1]
        psi = psi * np.sign(psi @ orbit.by_parameter[:, 0])
        along = np.concatenate([here.own, np.zeros(2)])
        return psi @ orbit.problem.second_along(orbit.unknowns, along) @ along


class DoublingTurns(OnCurve):
    """The doubled branch leaves to the other side."""

    kind = "GPD"
    changes = "the period doubling changes between supercritical and subcritical"

    def of(self, here: CurvePoint) -> Any:
        return doubling_bend(here.orbit)


class Resonance(OnCurve):
    """A second multiplier joins the critical one."""

    def __init__(self, kind: str) -> None:
        self.kind = {"FB": "R1", "PD": "R2"}[kind]
        at = {"FB": "1", "PD": "-1"}[kind]
        self.changes = f"two multipliers are {at}: a curve of NS begins"

    def of(self, here: CurvePoint) -> Any:
        value = stability.neimark_sacker(here.orbit.start, here.orbit.end)
        return value if abs(value) > 1e-9 else np.nan


def codimension_two(problem: CurveProblem) -> list[TestFunction]:
    """Return the test functions of a curve."""
    kind = problem.kind
    if kind in ("G", "V"):
        long_enough = kind == "G" or len(problem.orbit.word) > 1
        pairs: list[TestFunction] = [DegenerateTouch(), NewBranchFolds()]
        return pairs + ([GrazingDoubles(), GrazingFolds()] if long_enough else [])
    tests: list[TestFunction] = [AlsoGrazes(kind), AlsoStops(kind)]
    if kind == "FB":
        tests += [Cusp(), Resonance(kind)]
    if kind == "PD":
        tests += [DoublingTurns(), Resonance(kind)]
    return tests


def without_touch(here: CurvePoint) -> Linearisation:
    """The grazing orbit as one of the shorter word."""
    orbit, problem = here.orbit, here.orbit.problem
    if here.problem.kind == "G":
        return orbit
    impact = here.details["impact"]
    rows = np.delete(problem.impacts(orbit.unknowns), impact, axis=0)
    shorter = OrbitProblem(problem.model, problem.word.drop(impact), problem.kernels)
    problem.kernel_evaluations += len(shorter.word)
    return shorter.evaluate(np.append(rows.ravel(), orbit.unknowns[-2:]))


def with_touch(here: CurvePoint) -> Linearisation:
    """The grazing orbit as one of the longer word."""
    orbit, problem = here.orbit, here.orbit.problem
    if here.problem.kind == "V":
        return orbit
    flight, wall = here.details["flight"], here.details["wall"]
    touch = np.insert(here.own, 1, 0.0)
    rows = np.insert(problem.impacts(orbit.unknowns), flight + 1, touch, axis=0)
    longer = OrbitProblem(problem.model, problem.word.insert(flight, wall), problem.kernels)
    problem.kernel_evaluations += len(longer.word)
    return longer.evaluate(np.append(rows.ravel(), orbit.unknowns[-2:]))
