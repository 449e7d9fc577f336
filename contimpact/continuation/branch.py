"""Branches and what stands on them. Data only."""

from __future__ import annotations

import enum
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, overload

import numpy as np

from .problem import Array


@dataclass(frozen=True, eq=False)
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


@dataclass(frozen=True, eq=False)
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


@dataclass(frozen=True, eq=False)
class Walk:
    """One walk along a branch: its points and events in order, and how it ended."""

    points: Sequence[Point]
    events: Sequence[Event]
    end: End
    missed: Sequence[Missed] = ()
    corrector_iterations: int = 0
    rejected_steps: int = 0
    seconds_in_events: float = 0.0


@dataclass(frozen=True, eq=False)
class Block:
    """Points of a walk as arrays, a row each.

    Attributes
    ----------
    unknowns, tangents : ndarray of shape (P, n + 1)
    orientations, arclengths, iterations : ndarray of shape (P,)
    described : ndarray of shape (P, D)
        What else the problem says of each point.
    make : callable ``make(unknowns, described)``
        The evaluation at a point.
    """

    unknowns: Array
    tangents: Array
    orientations: Array
    arclengths: Array
    iterations: Array
    described: Array
    make: Callable[[Array, Array], Any]

    def evaluation(self, i: int) -> Any:
        """Return the evaluation at one of the points."""
        return self.make(self.unknowns[i], self.described[i])

    def point(self, i: int) -> Point:
        """Return one of the points."""
        return Point(
            self.evaluation(i), self.tangents[i],
            float(self.orientations[i]), float(self.arclengths[i]), int(self.iterations[i]),
        )  # fmt: skip

    def moved(self, sign: float, origin: float) -> Block:
        """Return the points with arclength origin + sign s, their tangents turned accordingly."""
        return replace(
            self, tangents=sign * self.tangents, orientations=sign * self.orientations,
            arclengths=origin + sign * self.arclengths,
        )  # fmt: skip


class Points(Sequence[Point]):
    """The points of a branch in order; those computed in blocks are made when they are looked at.

    `items` holds each point, or the block it is in and its row.
    """

    def __init__(self, items: Iterable[Point | tuple[Block, int]] = ()) -> None:
        given = items.items if isinstance(items, Points) else items
        self.items: list[Point | tuple[Block, int]] = list(given)

    def __len__(self) -> int:
        return len(self.items)

    @overload
    def __getitem__(self, at: int) -> Point: ...
    @overload
    def __getitem__(self, at: slice) -> Points: ...
    def __getitem__(self, at: int | slice) -> Point | Points:
        if isinstance(at, slice):
            return Points(self.items[at])
        item = self.items[at]
        if isinstance(item, tuple):
            item = self.items[at] = item[0].point(item[1])
        return item

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and list(self) == list(other)

    def __repr__(self) -> str:
        return f"<{len(self)} points>"

    def __setitem__(self, at: int, point: Point) -> None:
        self.items[at] = point

    def append(self, point: Point) -> None:
        """Put a point down."""
        self.items.append(point)

    def extend(self, block: Block, first: int, last: int) -> None:
        """Put the points of a block from `first` up to `last` down."""
        self.items.extend([(block, i) for i in range(first, last)])

    def moved(self, sign: float, origin: float) -> list[Point | tuple[Block, int]]:
        """Return the items with arclength origin + sign s, their tangents turned accordingly."""
        blocks: dict[int, Block] = {}
        moved: list[Point | tuple[Block, int]] = []
        for item in self.items:
            if isinstance(item, Point):
                moved.append(_moved(item, sign, origin))
                continue
            block = blocks.get(id(item[0]))
            if block is None:
                block = blocks[id(item[0])] = item[0].moved(sign, origin)
            moved.append((block, item[1]))
        return moved

    @property
    def unknowns(self) -> Array:
        """The unknowns of every point, a row each."""
        return np.array([
            item.unknowns if isinstance(item, Point) else item[0].unknowns[item[1]]
            for item in self.items
        ])  # fmt: skip

    @property
    def numbers(self) -> Array:
        """What the evaluations tell of every point in a row of numbers."""
        return np.array([
            item.evaluation.numbers if isinstance(item, Point) else item[0].described[item[1]]
            for item in self.items
        ])  # fmt: skip

    @property
    def iterations(self) -> Array:
        """Corrector iterations of every point."""
        return np.array(
            [
                item.iterations if isinstance(item, Point) else item[0].iterations[item[1]]
                for item in self.items
            ],
            dtype=np.int64,
        )

    @property
    def arclengths(self) -> list[float]:
        """Arclength of every point."""
        return [
            item.arclength if isinstance(item, Point) else float(item[0].arclengths[item[1]])
            for item in self.items
        ]


def _moved(point: Point, sign: float, origin: float) -> Point:
    return replace(
        point, tangent=sign * point.tangent, orientation=sign * point.orientation,
        arclength=origin + sign * point.arclength,
    )  # fmt: skip


def joined(backward: Walk, forward: Walk) -> tuple[Points, list[Event]]:
    """Join two walks that left one point in opposite directions into one run along the branch.

    Arclength starts from zero where the backward walk ended; tangents all point forward.
    """
    origin = backward.points[-1].arclength
    first = Points(backward.points).moved(-1.0, origin)[::-1]
    points = Points(first + Points(forward.points[1:]).moved(1.0, origin))
    events = [
        replace(e, point=_moved(e.point, sign, origin))
        for sign, found in ((-1.0, backward.events[::-1]), (1.0, forward.events))
        for e in found
    ]
    return points, events
