"""A branch: its problem, points, events in order, end, and the test functions along it."""

from __future__ import annotations

import bisect
import enum
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, Protocol, TypeAlias, TypeVar, overload

import numpy as np

from ..arrays import Array
from ..errors import count_text
from .settings import Settings

# What a problem must provide whose solutions form the branch.


class Evaluation(Protocol):
    """A problem evaluated at one point. A problem may keep more here for its test functions."""

    @property
    def unknowns(self) -> Array:
        """The point, shape (n + 1,); the free parameter is last."""

    @property
    def residual(self) -> Array:
        """F, shape (n,)."""

    @property
    def jacobian(self) -> Array:
        """dF/d(unknowns), shape (n, n + 1)."""


E = TypeVar("E", bound=Evaluation, covariant=True)
"""Evaluation that a problem makes at a point."""


class Problem(Protocol[E]):
    """n equations in n + 1 unknowns, the last of which is the free parameter."""

    def evaluate(self, unknowns: Array) -> E:
        """Evaluate at a point. `ArithmeticError` and `ValueError` say that F has no value there."""

    def scale(self, unknowns: Array, span: float) -> Array:
        """Return natural sizes of the unknowns, shape (n + 1,), given the parameter's."""

    def difference(self, one: Array, other: Array) -> Array:
        """Return one - other, zero where both stand for the same solution."""


# Why a branch ends.


class EndKind(enum.Enum):
    """Why a branch ends; the value is the sentence a user reads."""

    RANGE = "reached the end of the range at {parameter} = {value:.12g}"
    CLOSED = "closed on itself: the branch is a loop"
    STEP = (
        "the step fell below {floor:.3g} at {parameter} = {value:.12g} ({why}); "
        "{advice} may carry on"
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
    EDGE = (
        "left the range within a step of {floor:.3g} from {parameter} = {value:.12g} ({why}); "
        "another range or a smaller min_step ends on the limit itself"
    )
    NEAR_MISS = (
        "another branch passes this one at {parameter} = {place:.12g} at a distance of {near}, and "
        "no step follows this one beyond {parameter} = {value:.12g} ({why}); change a parameter to "
        "part them further"
    )
    SHORTER = (
        "became {word}, run {times} times, at {parameter} = {value:.12g}; beyond, the same orbits "
        "come again, whole periods later, or others that pass a guard"
    )
    SYMMETRIC = (
        "became its own mirror image at {parameter} = {value:.12g}; beyond, the mirror images of "
        "its orbits follow"
    )
    REST = (
        "shrank to an equilibrium near {parameter} = {value:.9g}, where the orbits are born: a "
        "Hopf bifurcation"
    )
    FOR_EVER = (
        "the period has grown to {period:.6g} at {parameter} = {value:.12g}, and {what}: the "
        "orbits come near to one that takes for ever, by an equilibrium (a homoclinic one){other}"
    )
    ROUNDING = (
        "rounding errors have grown to {error:.1g} at {parameter} = {value:.9g}: the flights "
        "amplify them so much that orbits beyond are not told apart"
    )
    UNBOUNDED = (
        "grew without bound as {parameter} approached {value:.9g}: the solution is {times:.1g} "
        "times as large as it was at the start, and {parameter} changes no more"
    )
    KNOWN = "met branch {known} at {parameter} = {value:.12g}"
    UNPHYSICAL = (
        "the orbits are unphysical at {parameter} = {value:.12g} ({why}), and with unphysical = "
        "false are followed no further"
    )
    BORN = "born at {entry} of branch {parent} at {parameter} = {value:.12g}"
    UNFOLDED = (
        "the crossing of branches is unfolded at {parameter} = {value:.12g}: beyond, the branches "
        "pass each other"
    )
    TOUCH = "the touch reaches an impact of its own flight at {parameter} = {value:.12g}"
    VANISHED = (
        "beyond {parameter} = {value:.12g} the equations are solved by orbits without the "
        "multiplier: an impact comes to rest, or a flight vanishes"
    )
    RESONANCE = "the pair of multipliers meets on the real axis at {parameter} = {value:.12g}"
    PERIOD = (
        "the forcing's period is {times} times that of the start at {parameter} = {value:.12g} and "
        "grows without bound beyond; to go on, start from there"
    )
    STOPPED = "stopped at {parameter} = {value:.12g} on request"
    INTERRUPTED = "interrupted at {parameter} = {value:.12g}: what lies beyond was not followed"


AT_BRANCH_POINTS = frozenset({EndKind.SHORTER, EndKind.SYMMETRIC, EndKind.KNOWN})
"""Ends on orbits that have the status of neither side."""


@dataclass(frozen=True)
class End:
    """How a branch ends: the kind, the parameter value there, and a sentence."""

    kind: EndKind
    value: float
    message: str

    @classmethod
    def of(cls, kind: EndKind, parameter: str, value: float, **details: object) -> End:
        """Make an end, filling in its sentence."""
        text = kind.value.format(parameter=parameter, value=value, **details)
        return cls(kind, value, text)


# Why a step is refused, and what kind of end it makes where no shorter step is left.


class Refusal(enum.Enum):
    """Reasons to refuse a step: the kind of end each leads to, and the words a user reads."""

    NO_VALUE = EndKind.CORRECTOR, "{}"
    NO_SOLUTION = EndKind.SINGULAR, "the bordered matrix is singular"
    DIVERGES = EndKind.STEP, "Newton's iteration diverges"
    SLOW = EndKind.STEP, "no convergence in {} iterations"
    NO_TANGENT = EndKind.SINGULAR, "the tangent is not defined"
    TURNS = EndKind.STEP, "the branch turns by {:.3g} rad"
    BENDS = EndKind.STEP, "the branch turns inside the step, by {:.3g} of its length"
    JUMPS = EndKind.STEP, "the branch turns away from the step"
    PASSES = EndKind.STEP, "the step leads to another branch that passes nearby"
    LEAVES = EndKind.EDGE, "the branch leaves the range and returns inside the step"
    NO_LIMIT = EndKind.EDGE, "no point was reached on the limit"


@dataclass(frozen=True)
class RefusalDetails:
    """A refusal with what it has to tell."""

    cause: Refusal
    detail: object = None

    @property
    def kind(self) -> EndKind:
        """The end of a branch on which every step was refused like this one."""
        return self.cause.value[0]

    def __str__(self) -> str:
        return self.cause.value[1].format(self.detail)


# The order of events along a branch, where rounding must not decide it.

TOGETHER = 1e-10
"""Events further apart along a branch are two places, whatever their errors."""


def order_events(events: Iterable[Event]) -> list[Event]:
    """Return events in order along a branch.

    Those that their errors do not tell apart, as both touches of a symmetric orbit, are at one
    place: they have one arclength, and stand there in the order of their kinds' names, and of the
    values of one test function, in both directions.
    """
    places: list[list[Event]] = []
    for event in sorted(events, key=lambda e: e.point.arclength):
        if places and _coincide(places[-1][-1], event):
            places[-1].append(event)
        else:
            places.append([event])
    return [e for place in places for e in (_rank_events(place) if len(place) > 1 else place)]


def same_place(apart: float, difference: float, error: float) -> bool:
    """Whether two points of a branch are one place.

    They differ by `apart` in arclength and by `difference` in their parameters, known to `error`.
    """
    return abs(apart) <= TOGETHER and abs(difference) <= error


def _coincide(a: Event, b: Event) -> bool:
    apart = a.point.arclength - b.point.arclength
    return same_place(apart, a.parameter - b.parameter, a.error + b.error)


def _rank_events(place: Sequence[Event]) -> list[Event]:
    """The events of one place in order, at the first one's arclength."""
    ranked = sorted(place, key=lambda e: (e.kind, int(e.details.get("index", 0))))
    return [event.moved_to(place[0].point.arclength) for event in ranked]


@dataclass(frozen=True, eq=False)
class Point(Generic[E]):
    """A solution on a branch."""

    evaluation: E
    """Evaluation made by the problem; only the problem knows what else it holds."""
    tangent: Array
    """Unit tangent in the branch's metric, in the direction of the walk, shape (n + 1,)."""
    orientation: float
    """Scaled determinant of the Jacobian bordered by the tangent. It changes sign at a branch
    point, and where a step lands on another branch."""
    arclength: float
    """Arclength from the start of the walk."""
    iterations: int
    """Corrector iterations it took."""

    @property
    def unknowns(self) -> Array:
        """The solution, the free parameter last."""
        return self.evaluation.unknowns

    @property
    def parameter(self) -> float:
        """Value of the free parameter."""
        return float(self.evaluation.unknowns[-1])


Details: TypeAlias = Mapping[str, Any]
"""Details of an event from the test function of its kind, by name."""


@dataclass(frozen=True, eq=False)
class Event(Generic[E]):
    """A located zero of a test function."""

    kind: str
    """FB, BP, PD, NS, G, V, T, UZ or the name of a user's function."""
    point: Point[E]
    """The solution there."""
    residual: float
    """Largest residual of the equations it was located with."""
    error: float
    """Estimated error of the parameter value."""
    method: str
    """``"newton"`` on the extended system, or ``"bracket"``."""
    details: Details = field(default_factory=dict)
    """Details that the test function adds (which impact, which wall, a null vector)."""

    @property
    def parameter(self) -> float:
        """Value of the free parameter."""
        return self.point.parameter

    def moved_to(self, arclength: float) -> Event[E]:
        """Return the event at another place along the branch."""
        return replace(self, point=replace(self.point, arclength=arclength))


@dataclass(frozen=True)
class MissedEvent:
    """A sign change that could not be located, with the reason; `arclength` is where on its walk,
    infinite where that is not told, and `place` where on the orbit, empty likewise. `index` is the
    value of the test function, if it is one that has changed."""

    kind: str
    parameters: tuple[float, float]
    reason: str
    arclength: float = np.inf
    place: str = ""
    index: int | None = None


NAMED = 6
"""Places on the orbit that are named where several events may be missing for one reason."""


def missed_texts(parameter: str, missed: Iterable[MissedEvent]) -> list[str]:
    """Return what is said of events that could not be located; what is the same at several places
    of the orbit is said once, with their number, and what is the same of several kinds."""
    places: dict[tuple[str, str, str], list[str]] = {}
    for one in missed:
        low, high = one.parameters
        head = f"between {parameter} = {low:.12g} and {high:.12g}"
        places.setdefault((one.kind, head, one.reason), []).append(one.place)
    kinds: dict[str, list[str]] = {}
    for (kind, head, reason), where in places.items():
        kinds.setdefault(f"{head}{_several(where)}: {reason}", []).append(kind)
    return [f"{', '.join(each)} {text}" for text, each in kinds.items()]


def _several(places: Sequence[str]) -> str:
    """How many places there are, and which, if it is not one."""
    if len(places) == 1:
        return ""
    named = list(dict.fromkeys(place for place in places if place))
    told = ", ".join(named[:NAMED]) + (", ..." if len(named) > NAMED else "")
    return f", at {len(places)} places" + (f" ({told})" if told else "")


@dataclass(frozen=True, eq=False)
class Walk(Generic[E]):
    """One walk along a branch: its points and events in order, and how it ended.

    `notes` say where another branch passes it closely.
    """

    points: Sequence[Point[E]]
    events: Sequence[Event[E]]
    end: End
    missed: Sequence[MissedEvent] = ()
    corrector_iterations: int = 0
    rejected_steps: int = 0
    seconds_in_events: float = 0.0
    notes: Sequence[str] = ()


@dataclass(frozen=True, eq=False)
class Block:
    """Points of a walk as arrays, a row each."""

    unknowns: Array
    tangents: Array
    """`unknowns`, `tangents`: shape (P, n + 1)."""
    orientations: Array
    arclengths: Array
    iterations: Array
    """`orientations`, `arclengths`, `iterations`: shape (P,)."""
    described: Array
    """Further numbers with which the problem describes each point, shape (P, D)."""
    make: Callable[[Array, Array], Evaluation]
    """``make(unknowns, described)``: the evaluation at a point."""
    sign: float = 1.0
    origin: float = 0.0
    """`sign`, `origin`: a point lies at arclength origin + sign s; its tangent and orientation are
    turned with it."""
    measured: object = None
    """Further numbers that the problem's test functions use; not kept in parts of a block."""

    def __len__(self) -> int:
        return len(self.iterations)

    def __getitem__(self, rows: slice) -> Block:
        own = "unknowns", "tangents", "orientations", "arclengths", "iterations", "described"
        return replace(self, measured=None, **{name: getattr(self, name)[rows] for name in own})

    def point(self, i: int) -> Point:
        """Return one of the points."""
        here = self.make(self.unknowns[i], self.described[i])
        tangent, orientation = self.sign * self.tangents[i], self.sign * float(self.orientations[i])
        place = self.origin + self.sign * float(self.arclengths[i])
        return Point(here, tangent, orientation, place, int(self.iterations[i]))

    @property
    def places(self) -> Array:
        """The points' arclengths along the branch."""
        return self.origin + self.sign * self.arclengths

    def moved(self, sign: float, origin: float) -> Block:
        """Return the points with arclength origin + sign s, their tangents turned accordingly."""
        return replace(self, sign=sign * self.sign, origin=origin + sign * self.origin)


class Points(Sequence[Point]):
    """The points of a branch in order, from single points and blocks.

    Points of a block are made when they are looked at, each time afresh.
    """

    def __init__(self, pieces: Iterable[Point | Block] = ()) -> None:
        self.pieces: list[Point | Block] = []
        self._ends: list[int] = []
        self._open: Block | None = None  # the block the last piece is from, if it may go on
        self._last: tuple[Block, Point] | None = None  # the last point, and the block it is from
        for piece in pieces.pieces if isinstance(pieces, Points) else pieces:
            self._put(piece)

    def _put(self, piece: Point | Block) -> None:
        end = len(self) + _count(piece)
        # no calls: an interruption, which Python raises at them, leaves both lists or neither
        self.pieces += [piece]
        self._ends += [end]
        self._open = None

    def __len__(self) -> int:
        return self._ends[-1] if self._ends else 0

    def _place(self, at: int) -> tuple[int, int]:
        """The piece a point is in, and its place there."""
        at = at + len(self) if at < 0 else at
        if not 0 <= at < len(self):
            raise IndexError("point index out of range")
        i = bisect.bisect_right(self._ends, at)
        return i, at - (self._ends[i - 1] if i else 0)

    @overload
    def __getitem__(self, at: int) -> Point: ...
    @overload
    def __getitem__(self, at: slice) -> Points: ...
    def __getitem__(self, at: int | slice) -> Point | Points:
        if isinstance(at, slice):
            return self._cut(*at.indices(len(self)))
        i, row = self._place(at)
        piece = self.pieces[i]
        if isinstance(piece, Point):
            return piece
        if at != -1:
            return piece.point(row)
        if self._last is None or self._last[0] is not piece:
            self._last = piece, piece.point(row)
        return self._last[1]

    def _cut(self, first: int, last: int, step: int) -> Points:
        if step not in (1, -1):
            return Points(self[i] for i in range(first, last, step))
        low, high = (first, last) if step == 1 else (last + 1, first + 1)
        found = Points()
        for piece, end in zip(self.pieces, self._ends, strict=True):
            begin = end - _count(piece)
            if isinstance(piece, Point) and low <= begin < high:
                found._put(piece)
            elif isinstance(piece, Block) and max(low, begin) < min(high, end):
                found._put(piece[max(low - begin, 0) : high - begin])
        return found if step == 1 else found._reversed()

    def _reversed(self) -> Points:
        return Points(p if isinstance(p, Point) else p[::-1] for p in reversed(self.pieces))

    def __iter__(self) -> Iterator[Point]:
        for piece in self.pieces:
            if isinstance(piece, Point):
                yield piece
            else:
                yield from (piece.point(i) for i in range(len(piece)))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and list(self) == list(other)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"<{count_text(len(self), 'point')}>"

    def with_more(self, points: Iterable[Point]) -> Points:
        """Return these points and some more, given in order of arclength, at their places."""
        found, done, lengths = Points(), 0, self.arclengths
        for point in points:
            place = int(np.searchsorted(lengths, point.arclength))
            for piece in self[done:place].pieces:
                found._put(piece)
            found._put(point)
            done = place
        for piece in self[done:].pieces if done else self.pieces:
            found._put(piece)
        return found

    def end_with(self, point: Point) -> None:
        """Put a point in the place of the last one."""
        shorter = self[:-1]
        self.pieces, self._ends = shorter.pieces, shorter._ends
        self.append(point)

    def append(self, point: Point) -> None:
        """Add a point."""
        self._put(point)

    def extend(self, piece: Point | Block, first: int, last: int) -> None:
        """Add a piece's points from `first` up to `last`; a block may be added part by part."""
        if first == last:
            return
        if isinstance(piece, Point):
            self._put(piece)
            return
        if self._open is piece:
            known = _count(self.pieces[-1])
            part, end = piece[first - known : last], len(self) + last - first
            self.pieces[-1], self._ends[-1] = part, end
            return
        self._put(piece[first:last])
        self._open = piece

    def moved(self, sign: float, origin: float) -> Points:
        """Return the points with arclength origin + sign s, their tangents turned accordingly."""
        return Points(
            _move_point(piece, sign, origin)
            if isinstance(piece, Point)
            else piece.moved(sign, origin)
            for piece in self.pieces
        )

    @property
    def unknowns(self) -> Array:
        """The unknowns of every point, a row each."""
        return self.stacked(lambda point: point.unknowns, lambda block: block.unknowns)

    @property
    def numbers(self) -> Array:
        """What the evaluations tell of every point in a row of numbers."""
        return self.stacked(lambda point: point.evaluation.numbers, lambda block: block.described)

    @property
    def iterations(self) -> Array:
        """Corrector iterations of every point."""
        found = self.stacked(lambda point: point.iterations, lambda block: block.iterations)
        return found.astype(np.int64)

    @property
    def arclengths(self) -> Array:
        """Arclength of every point."""
        return self.stacked(lambda point: point.arclength, lambda block: block.places)

    def stacked(self, one: Callable[[Point], object], many: Callable[[Block], Array]) -> Array:
        """Return what functions of points, and of blocks, say of every point, a row each."""
        found = [np.array([one(p)]) if isinstance(p, Point) else many(p) for p in self.pieces]
        return np.concatenate(found) if found else np.zeros(0)


def _count(piece: Point | Block) -> int:
    return 1 if isinstance(piece, Point) else len(piece)


def _move_point(point: Point, sign: float, origin: float) -> Point:
    tangent, orientation = sign * point.tangent, sign * point.orientation
    place = origin + sign * point.arclength
    return replace(point, tangent=tangent, orientation=orientation, arclength=place)


def join_walks(backward: Walk, forward: Walk) -> tuple[Points, list[Event]]:
    """Join two walks that left one point in opposite directions into one run along the branch.

    Arclength starts from zero where the backward walk ended; tangents all point forward. Where the
    branch turns on a limit of the range, both walks from there find the event there: it is kept
    once.
    """
    origin = backward.points[-1].arclength
    first = Points(backward.points).moved(-1.0, origin)[::-1]
    rest = Points(forward.points[1:]).moved(1.0, origin)
    points = Points([*first.pieces, *rest.pieces])
    events = [
        replace(e, point=_move_point(e.point, sign, origin))
        for sign, found in ((-1.0, backward.events[::-1]), (1.0, forward.events))
        for e in found
        if sign > 0.0 or not any(_is_same(e, other) for other in forward.events)
    ]
    return points, order_events(events)


def _is_same(event: Event, other: Event) -> bool:
    """Whether events of two walks from one point are one event, at that point."""
    at_start = event.point.arclength + other.point.arclength
    difference, error = event.parameter - other.parameter, event.error + other.error
    named = [(e.kind, e.details.get("index")) for e in (event, other)]
    return named[0] == named[1] and same_place(at_start, difference, error)


# Test functions: functions of the points of a branch whose zeros are events.

At = TypeVar("At", bound=Evaluation, contravariant=True)
"""Evaluations for which a test function is made."""


@dataclass(frozen=True, eq=False)
class Location:
    """A solution of a test function's equations: where, how well, and what was evaluated there."""

    unknowns: Array
    residual: float
    error: float
    details: Details = field(default_factory=dict)
    evaluation: Evaluation | None = None


class Between(Protocol):
    """Two neighbouring points of a walk; see `contimpact.continuation.corrector.Arc`."""

    @property
    def left(self) -> Point: ...
    @property
    def right(self) -> Point: ...
    @property
    def span(self) -> float: ...
    @property
    def scale(self) -> Array: ...
    @property
    def settings(self) -> Settings: ...


class TestFunction(ABC, Generic[At]):
    """A function of points whose zeros are events; generic in what the problem makes of a point.

    Implementers give `kind`, `values`, and, where they can, `locate`; `accept` may turn a located
    zero down, and `details` describe one found by bracketing.
    """

    __test__ = False  # not a test case
    kind: str
    noise = 0.0
    """Values below this on both sides of a sign change are rounding, not a crossing."""
    rounding = 0.0
    """Two zeros are not looked for among values below this."""

    vanishing = 0.0
    """Values below this do not exist where they cannot be told from zero."""

    evaluations = 0

    def place_on_orbit(self, index: int) -> str:
        """Return where on the orbit one of the values is, in words; empty if it is nowhere."""
        return ""

    guides = 0
    """How many of the values, the last ones, are no test functions themselves but tell where the
    others begin or end."""

    def guided(self, left: Array, right: Array) -> Array:
        """Return which guides are to be followed between two points, shape (guides,)."""
        return np.ones(self.guides, dtype=bool)

    def at(self, point: Point[At]) -> Array:
        """Return `values`, and count the evaluation."""
        self.evaluations += 1
        return self.values(point)

    def on(self, piece: Point[At] | Block) -> Array:
        """Return the values at every point of a piece, and count the evaluations, shape (P, q)."""
        if isinstance(piece, Point):
            return self.at(piece)[None]
        self.evaluations += len(piece)
        return self.batch(piece)

    def batch(self, block: Block) -> Array:
        """Return the values at every point of a block, shape (P, q)."""
        return np.array([self.values(block.point(i)) for i in range(len(block))])

    @abstractmethod
    def values(self, point: Point[At]) -> Array:
        """Return the function's values, shape (q,), the same q along a branch.

        Not-a-number says that a value does not exist here; it never takes part in a crossing.
        """

    def locate_on(self, arc: Between, fraction: float, index: int) -> Event[At] | None:
        """Locate a zero on an arc in one go, guessed at a fraction of it; None where that fails:
        it is then looked for step by step, from `locate` on."""
        return None

    def locate(self, problem: Problem[At], guess: Point[At], index: int) -> Location | None:
        """Solve the exact extended system from a nearby point; None if that fails."""
        return None

    def enters(self, point: Point[At], index: int) -> bool:
        """Whether a value begins at the point, where what it is of comes from elsewhere: that it
        jumps there is nothing that was missed."""
        return False

    def accept(self, event: Event[At]) -> bool:
        """Whether a located zero is an event of this kind."""
        return True

    def details(self, point: Point[At], index: int) -> Details:
        """Return what to record of a zero found by bracketing."""
        return {"index": index}


class UserFunction(TestFunction[At]):
    """A user's own function of the point, located by bracketing; `kind` names its events."""

    def __init__(self, kind: str, function: Callable[[Point[At]], float]) -> None:
        self.kind, self.function = kind, function

    def values(self, point: Point[At]) -> Array:
        try:
            return np.atleast_1d(np.asarray(self.function(point), dtype=float))
        except ArithmeticError:  # a pole met exactly
            return np.array([np.nan])
