"""An extended system with further free parameters, as a problem the continuer follows."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..bifurcations.declarations import CURVES
from ..bifurcations.extended_system import ExtendedSystem
from ..bifurcations.kind import Kind
from ..bifurcations.registry import kind_of
from ..continuation.branch import Details
from ..errors import InputError, shown
from ..models.model import Model
from ..orbits.problem import Array, Linearisation, OrbitProblem
from ..results.branch import Entry, orbit_of
from ..results.entry_conversion import details_of
from ..segments.kernels import Kernels


class CurveProblem:
    """An extended system with one free parameter more than it has equations for, to be continued.

    Parameters
    ----------
    kind : Kind
        Named in `CURVES`, or several at once.
    system : ExtendedSystem
        On an `OrbitProblem` with two free parameters, or as many as make its solutions a curve.
    details : mapping
        Where on the orbit it happens (flight, wall, impact).
    spans : sequence of float
        Natural sizes of the free parameters but the last, along which the walk is limited.
    """

    def __init__(
        self,
        kind: Kind,
        system: ExtendedSystem,
        details: Details,
        spans: Sequence[float],
    ) -> None:
        self.kind, self.system, self.details = kind, system, dict(details)
        self.orbit = system.problem
        self.spans = list(spans)

    def packed(self, orbit: Array, own: Array) -> Array:
        """Return the curve's unknowns: the last parameter goes last."""
        return np.concatenate([orbit[:-1], own, orbit[-1:]])

    def unpacked(self, unknowns: Array) -> tuple[Array, Array]:
        """Return the orbit's unknowns with all free parameters, and the system's own."""
        inner = self.orbit.n + self.orbit.free - 1
        return np.append(unknowns[:inner], unknowns[-1]), unknowns[inner:-1]

    def evaluate(self, unknowns: Array) -> CurvePoint:
        """Evaluate the system."""
        orbit, own = self.unpacked(unknowns)
        here = self.orbit.evaluate(orbit)
        at = self.system.assemble(here, own)
        found = CurvePoint(self, unknowns, at.residual, here, own)
        found.jacobian = self.in_order(at.jacobian)
        return found

    def in_order(self, jacobian: Array) -> Array:
        """Return the system's Jacobian with the last parameter's column last."""
        last = self.orbit.n + self.orbit.free - 1
        return jacobian[:, [*range(last), *range(last + 1, jacobian.shape[1]), last]]

    def rounding(self, here: CurvePoint) -> Array:
        """Return bounds of the rounding errors of the residuals at a point."""
        return self.system.rounding(here.orbit, here.own)

    def scale(self, unknowns: Array, span: float) -> Array:
        """Return natural sizes: those of the orbit, one for unit vectors, times for touches."""
        orbit, own = self.unpacked(unknowns)
        sizes = self.orbit.scale(orbit, [*self.spans, span])
        return self.packed(sizes, self.system.scale(own, sizes))

    def difference(self, one: Array, other: Array) -> Array:
        """Return one - other, orbits compared as orbits."""
        orbit, own = self.unpacked(one)
        orbit_other, own_other = self.unpacked(other)
        return self.packed(self.orbit.difference(orbit, orbit_other), own - own_other)


@dataclass(eq=False)
class CurvePoint:
    """A curve's system at one point, with the orbit's linearisation."""

    problem: CurveProblem
    unknowns: Array
    residual: Array
    orbit: Linearisation
    own: Array

    @functools.cached_property
    def jacobian(self) -> Array:
        """The system's Jacobian, made when asked for if it is not there."""
        return self.problem.in_order(self.problem.system.assemble(self.orbit, self.own).jacobian)

    def parameter(self, name: str) -> float:
        """Return the value of a free parameter."""
        names = self.problem.orbit.kernels.parameters
        return float(self.orbit.unknowns[self.problem.orbit.n + names.index(name)])

    @property
    def details(self) -> Details:
        """Where on the orbit it happens, the time of a touch included."""
        return {**self.problem.details, **self.problem.system.details(self.own)}


def require_curve(entry: Entry) -> None:
    """Raise `InputError` if this is no entry, or events of its kind have no curves."""
    if getattr(entry, "kind", None) not in CURVES:
        found = f"{shown(entry)} has no curve"
        raise InputError("entry", found, f"accepted are entries of {', '.join(CURVES)}")


def curve_problem(
    model: Model, entry: Entry, second: str, kernels: Kernels, first_span: float
) -> tuple[CurveProblem, Array]:
    """Return the problem of the curve through a catalogue entry, and where it starts."""
    at = orbit_of(entry, model, kernels)
    problem, orbit = at.problem, at.unknowns
    system = system_of(problem, entry)
    curve = CurveProblem(kind_of(entry.kind), system, details_of(entry), [first_span])
    return curve, curve.packed(orbit, system.start(problem.evaluate(orbit)))


def system_of(problem: OrbitProblem, entry: Entry) -> ExtendedSystem:
    """Return the exact equations of an entry's event."""
    system = kind_of(entry.kind).equations(problem, details_of(entry))
    assert system is not None, "every kind that has curves has equations"
    return system
