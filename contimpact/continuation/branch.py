"""Branches and what stands on them. Data only."""

from __future__ import annotations

import enum
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from .problem import Array


@dataclass(frozen=True)
class Point:
    """A solution on a branch.

    Attributes
    ----------
    evaluation : Any
        The `Evaluation` that the problem made; what else it holds is the problem's affair.
    tangent : ndarray of shape (n + 1,)
        Unit tangent in the branch's metric, in the direction of the walk.
    orientation : float
        Scaled determinant of the Jacobian bordered by the tangent. It changes sign at a branch
        point, and where a step lands on another branch.
    arclength : float
        From the start of the walk.
    iterations : int
        Corrector iterations it took.
    """

    evaluation: Any
    tangent: Array
    orientation: float
    arclength: float
    iterations: int

    @property
    def unknowns(self) -> Array:
        """The solution, the free parameter last."""
        return self.evaluation.unknowns

    @property
    def parameter(self) -> float:
        """Value of the free parameter."""
        return float(self.evaluation.unknowns[-1])


class EndKind(enum.Enum):
    """Why a branch ends; the value is the sentence a user reads."""

    RANGE = "reached the end of the range at {parameter} = {value:.12g}"
    CLOSED = "closed on itself: the branch is a loop"
    STEP = (
        "the step fell below {floor:.3g} at {parameter} = {value:.12g}; a smaller min_step or "
        "another free parameter may carry on"
    )
    CORRECTOR = (
        "the corrector failed at {parameter} = {value:.12g} even with the smallest step ({why}); "
        "the formulas may have no value beyond"
    )
    START = "the first point was not reached at {parameter} = {value:.12g} ({why})"
    SINGULAR = (
        "the tangent is not defined at {parameter} = {value:.12g} ({why}); start from another point"
    )
    POINTS = (
        "the limit of {limit} points was reached at {parameter} = {value:.12g}; raise max_points "
        "to go on"
    )
    KNOWN = "met branch {known} at {parameter} = {value:.12g}"
    BORN = "born at {entry} of branch {parent} at {parameter} = {value:.12g}"
    UNFOLDED = (
        "the crossing of branches is unfolded at {parameter} = {value:.12g}: beyond, the branches "
        "pass each other"
    )
    TOUCH = "the touch reaches an impact of its own flight at {parameter} = {value:.12g}"
    STOPPED = "stopped at {parameter} = {value:.12g} on request"


@dataclass(frozen=True)
class End:
    """How a branch ends: the kind, the parameter value there, and a sentence."""

    kind: EndKind
    value: float
    message: str

    @classmethod
    def of(cls, kind: EndKind, parameter: str, value: float, **details: Any) -> End:
        """Make an end, filling in its sentence."""
        text = kind.value.format(parameter=parameter, value=value, **details)
        return cls(kind, value, text)


@dataclass(frozen=True)
class Event:
    """A located zero of a test function.

    Attributes
    ----------
    kind : str
        FB, BP, PD, NS, G, V, T, UZ or the name of a user's function.
    point : Point
        The solution there.
    residual : float
        Largest residual of the equations it was located with.
    error : float
        Estimated error of the parameter value.
    method : str
        ``"newton"`` on the extended system, or ``"bracket"``.
    details : mapping
        What the test function adds (which impact, which wall, a null vector).
    """

    kind: str
    point: Point
    residual: float
    error: float
    method: str
    details: Mapping[str, Any] = field(default_factory=dict)

    @property
    def parameter(self) -> float:
        """Value of the free parameter."""
        return self.point.parameter


@dataclass(frozen=True)
class Missed:
    """A sign change that could not be located, with the reason."""

    kind: str
    parameters: tuple[float, float]
    reason: str


@dataclass(frozen=True)
class Walk:
    """One walk along a branch: its points and events in order, and how it ended."""

    points: Sequence[Point]
    events: Sequence[Event]
    end: End
    missed: Sequence[Missed] = ()
    corrector_iterations: int = 0
    rejected_steps: int = 0
    seconds_in_events: float = 0.0


def joined(backward: Walk, forward: Walk) -> tuple[list[Point], list[Event]]:
    """Join two walks that left one point in opposite directions into one run along the branch.

    Arclength starts from zero where the backward walk ended; tangents all point forward.
    """
    length = backward.points[-1].arclength

    def turned(point: Point) -> Point:
        return replace(
            point, tangent=-point.tangent, orientation=-point.orientation,
            arclength=length - point.arclength,
        )  # fmt: skip

    def shifted(point: Point) -> Point:
        return replace(point, arclength=length + point.arclength)

    points = [turned(p) for p in reversed(backward.points)]
    points += [shifted(p) for p in forward.points[1:]]
    events = [replace(e, point=turned(e.point)) for e in reversed(backward.events)]
    events += [replace(e, point=shifted(e.point)) for e in forward.events]
    return points, events
