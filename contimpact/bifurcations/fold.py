"""FB: the parameter turns back along the branch, and a multiplier passes 1."""

from __future__ import annotations

from typing import cast

import numpy as np

from ..continuation.branch import Event, Location, Point, Problem, TestFunction
from ..models.guards import Word
from ..orbits.problem import Array, Linearisation, OrbitProblem
from .at_rest import Curve, points_at_rest
from .codimension_two import (
    CurveTest,
    MultiplierCoincides,
    PairCoincides,
    Resonance,
    SecondEigenvector,
    leaving_tests,
)
from .extended_system import (
    ExtendedSystem,
    OrbitEvent,
    Orbits,
    SingularCycle,
    SingularTest,
    null_vectors,
    stands_upright,
    vanishes,
)
from .kind import Change, CurvePoint, Details, Equations, Kind, Look, System, Values, declared


class Fold(SingularTest):
    """The parameter's component of the tangent."""

    kind = "FB"
    mu = 1.0

    def of(self, orbits: Orbits) -> Array:
        return orbits.tangents[:, -1:]

    def accept(self, event: OrbitEvent) -> bool:
        """A branch that passes a branch point sideways turns there too, but is not folded, nor is
        one of orbits that all belong to one value."""
        if not super().accept(event) or stands_upright(event):
            return False
        here = event.point.evaluation
        psi, q = null_vectors(here, 1.0)
        terms = _terms(here, psi, np.concatenate([q, np.zeros(here.problem.free)]))
        return abs(float(np.sum(terms))) > FLAT * float(np.sum(np.abs(terms)))


FLAT = 1e-10
"""A part of its terms below which the form of a fold is rounding: of 60 folds it is a 25th at
least, along branches without one 5e-13 at most."""


def _terms(here: Linearisation, psi: Array, along: Array) -> Array:
    """The terms of psi . F_zz[q, q], one for each entry of F_zz[q]."""
    second = here.problem.second_along(here.unknowns, along)
    return np.asarray(psi[:, None] * second * along)


class Cusp(CurveTest):
    """CP: psi . F_zz[q, q]; psi is oriented with q, which the curve carries along."""

    kind = "CP"
    changes = "a cusp: two folds meet and end"

    def of(self, here: CurvePoint) -> float:
        return float(np.sum(self.terms(here)))

    def terms(self, here: CurvePoint) -> Array:
        """Return the terms of the form, one for each entry of F_zz[q]."""
        orbit = here.orbit
        psi, q = null_vectors(orbit, 1.0)
        psi = psi * np.sign(q @ here.own)
        return _terms(orbit, psi, np.concatenate([here.own, np.zeros(orbit.problem.free)]))

    def locate(
        self, problem: Problem[CurvePoint], guess: Point[CurvePoint], index: int
    ) -> Location | None:
        """Where an impact leaves no trace, the sign is that of its velocity."""
        return next(points_at_rest(cast(Curve, problem), guess.evaluation), None)

    def accept(self, event: Event[CurvePoint]) -> bool:
        """At an FB-V at which an impact leaves no trace, q moves nothing but that impact."""
        terms = self.terms(event.point.evaluation)
        sizes = float(np.sum(np.abs(terms)))
        return vanishes(event.point.evaluation.orbit, float(np.sum(terms)), sizes)


@declared(place=1, curves=True, second=True)
class FB(Kind):
    """Fold bifurcation."""

    name = Fold.kind
    changes = Change.STABILITY
    multiplier = 1.0
    shorter_at = ("GPD", "PD-V")
    auto = 5
    look = Look("^", "#D55E00", 0.8, "..")

    def test(self, problem: OrbitProblem, values: Values) -> TestFunction[Linearisation]:
        return Fold()

    def equations(self, problem: OrbitProblem, details: Details) -> ExtendedSystem:
        return SingularCycle(problem, 1.0)

    def in_many_digits(self, orbit: Equations, unknowns: Array, details: Details) -> System:
        return orbit.singular(unknowns, 1.0)

    def codimension_two(self, word: Word) -> list[TestFunction[CurvePoint]]:
        double = Resonance("R1", 1.0), SecondEigenvector("FB-BP", 1.0)
        also = MultiplierCoincides(self, "PD"), PairCoincides(self)
        return [*leaving_tests(self.name), Cusp(), *double, *also]
