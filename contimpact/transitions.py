"""Where the observed attractor changes along a sweep, and what the change is called.

A change between two values of a sweep is bisected: each value is started from the attractor before
the change, as the sweep itself would. Names are those of Table 1 of the paper on
vibro-impact pairs: PD, G with one or more impacts added, PD_G from an orbit of period pT, TG from
complex motion, and FB. What tells them apart is the last attractor before the change: at a fold a
multiplier is near 1, at a period doubling near -1, at a grazing a flight comes near to a wall.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from .attractor import SETTLING, Attractor, Kind, Settling, settle
from .diagram import Diagram, Entry
from .sweep import Row, Simulators, Sweep

MOST = 6
"""Changes located at most between two neighbouring values of a sweep."""
EXPLAINED = 1e-5
"""An entry explains a transition if it is this near to it, in parts of the range swept."""
CLOSE = 0.1
"""A multiplier this near to 1 or -1, or a gap this small by the largest velocity, tells it."""


@dataclass(frozen=True)
class Side:
    """An attractor beside a transition: its value, and what it is."""

    value: float
    kind: str
    notation: str
    word: str | None
    period: int | None
    rate: float
    multiplier: float | None
    smallest_gap: float | None


@dataclass(frozen=True)
class Explanation:
    """An entry of the branches beside a transition.

    `role` is ``explains`` where it lies within the bracket, or as near to it as `EXPLAINED` says,
    and ``bounds`` where it is the nearest of its kind on the side to which the parameter moves, or
    before.
    """

    entry: str
    label: str
    value: float
    distance: float
    role: str


@dataclass(frozen=True)
class Transition:
    """A change of the observed attractor.

    Attributes
    ----------
    direction : str
        Of the sweep.
    kind : str or None
        PD, G, PD_G, TG, FB; None where none of these describes it.
    label : str
        As in Table 1, ``G[1:1->2:1]``, or the two notations.
    order : int or None
        Impacts per forcing period gained, where both sides are periodic and it is a whole number;
        above 1 the grazing is one of higher order.
    before, after : Side
        The attractors on both sides of the bracket, in the order of the sweep.
    width : float
        Of the bracket.
    explanations : sequence of Explanation
    """

    direction: str
    kind: str | None
    label: str
    order: int | None
    before: Side
    after: Side
    width: float
    explanations: Sequence[Explanation] = ()

    @property
    def value(self) -> float:
        """The middle of the bracket."""
        return 0.5 * (self.before.value + self.after.value)

    def as_record(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self) | {"value": self.value}

    @staticmethod
    def from_record(record: Mapping[str, Any]) -> Transition:
        """Return the transition a record was made of."""
        given = {key: value for key, value in record.items() if key != "value"}
        given["before"], given["after"] = Side(**record["before"]), Side(**record["after"])
        given["explanations"] = tuple(Explanation(**e) for e in record["explanations"])
        return Transition(**given)

    def __repr__(self) -> str:
        return f"<{self.label} between {self.before.value:.12g} and {self.after.value:.12g}>"


def changes(rows: Sequence[Row]) -> Iterator[tuple[Row, Row]]:
    """Yield the neighbouring rows of one sweep between which the attractor changes."""
    for before, after in itertools.pairwise(rows):
        if before.attractor.label != after.attractor.label:
            yield before, after


def find_transitions(
    sweep: Sweep, width: float, *, settling: Settling = SETTLING, diagram: Diagram | None = None,
    simulators: Simulators | None = None,
) -> list[Transition]:  # fmt: skip
    """Locate and name every change of attractor along the sweeps down and up.

    Parameters
    ----------
    sweep : Sweep
    width : float
        To which brackets are halved, in the parameter's unit.
    settling : Settling
    diagram : Diagram, optional
        Branches, for explanations.
    simulators : Simulators, optional

    Returns
    -------
    list of Transition
    """
    simulators = simulators or Simulators(sweep.model, sweep.parameter)
    found = [
        transition
        for before, after in all_changes(sweep)
        for transition in between(simulators, before, after, width, settling)
    ]
    return [explained(t, diagram, sweep) if diagram else t for t in found]


def all_changes(sweep: Sweep) -> list[tuple[Row, Row]]:
    """Return the neighbouring rows of all sweeps between which the attractor changes."""
    ways = [way for way in sweep.directions if way != "random"]
    return [pair for way in ways for pair in changes(sweep.of(way))]


def between(
    simulators: Simulators, before: Row, after: Row, width: float, settling: Settling = SETTLING
) -> Iterator[Transition]:
    """Yield the transitions between two rows of a sweep, one after another.

    At most `MOST` are located; what is left of the interval then is one transition without a name.
    """
    for _ in range(MOST):
        left, right = edge(simulators, before, after, width, settling)
        if right is None:
            return
        yield name(left, right)
        ahead = (after.value - right.value) * (after.value - before.value) > 0.0
        if right.attractor.label == after.attractor.label or not ahead:
            return
        before = right
    rest = name(before, after)
    yield replace(rest, kind=None, label=f"{before.attractor.notation}->{after.attractor.notation}")


def edge(
    simulators: Simulators, before: Row, after: Row, width: float, settling: Settling = SETTLING
) -> tuple[Row, Row | None]:
    """Follow an attractor by simulation to where it ends.

    The step is halved where the attractor is lost and kept where it is not, so that beside the end
    the start is always close to the attractor: a long step can kick the motion out of a small basin
    before its attractor ends.

    Returns
    -------
    left, right : Row
        The last value with the attractor before and the next one with another; `right` is None if
        it does not end within ten times the distance of the two rows.
    """
    left, step = before, after.value - before.value
    lost, furthest = after, before.value + 10.0 * step
    for _ in range(200):
        if abs(step) <= width or left.value + step == left.value:
            break
        step *= 0.5
        row = _row(simulators, left, left.value + step, settling)
        while row.attractor.label == left.attractor.label:
            left = row
            if (furthest - left.value) * step <= 0.0:
                return left, None
            row = _row(simulators, left, left.value + step, settling)
        lost = row
    return left, _settled(simulators, lost, furthest, settling)


def _settled(simulators: Simulators, row: Row, furthest: float, settling: Settling) -> Row:
    """The first row further on at which the motion settles; the row itself if there is none."""
    step, ahead = 1e-3 * (furthest - row.value), row
    while not ahead.attractor.settled and abs(furthest - ahead.value) > abs(step) > 0.0:
        ahead = _row(simulators, ahead, ahead.value + step, settling)
        step *= 2.0
    return ahead if ahead.attractor.settled else row


def _row(simulators: Simulators, before: Row, value: float, settling: Settling) -> Row:
    simulator, start = simulators.at(value), before.attractor.state
    if start is None:
        return Row(before.direction, value, before.attractor)
    return Row(before.direction, value, settle(simulator, start, settling))


# Names.


def name(before: Row, after: Row) -> Transition:
    """Name the change between two neighbouring values."""
    one, other = before.attractor, after.attractor
    gained = other.rate - one.rate
    both = one.period is not None and other.period is not None
    whole = both and math.isfinite(gained) and abs(gained - round(gained)) < 1e-9
    order = round(gained) if whole else None
    kind = _kind(one, other, gained)
    arrow = f"{one.notation}->{other.notation}"
    return Transition(
        before.direction, kind, f"{kind}[{arrow}]" if kind else arrow, order, _side(before),
        _side(after), abs(after.value - before.value),
    )  # fmt: skip


def _kind(one: Attractor, other: Attractor, gained: float) -> str | None:
    if one.kind is Kind.COMPLEX:
        return "TG" if other.period is not None and _low_impacts(one) else None
    if one.kind is not Kind.PERIODIC:
        return None
    if _doubled(one, other) or _doubled(other, one):
        return "PD"
    multiplier, gap = _multiplier(one), one.smallest_gap / _size(one)
    near_fold, near_doubling = abs(multiplier - 1.0), abs(multiplier + 1.0)
    if gap < CLOSE and gap < min(near_fold, near_doubling) ** 2:
        longer = (one.period or 1) > 1 and other.period == 1 and gained > 0.0
        return "PD_G" if longer else "G"
    if near_fold < CLOSE:
        return "PD_G" if (one.period or 1) > 1 and other.period == 1 and gained > 0 else "FB"
    if near_doubling < CLOSE:
        return "PD"
    slowest = min(abs(v) for v in one.velocities) / _size(one)
    return "G" if slowest < CLOSE and gained < 0.0 else None


def _doubled(one: Attractor, other: Attractor) -> bool:
    """Whether the second has the first's word twice, over twice the period."""
    if one.word is None or other.word is None or one.period is None:
        return False
    twice = one.word * 2
    return (
        other.period == 2 * one.period and len(other.word) == len(twice)
        and other.word in twice * 2
    )  # fmt: skip


def _multiplier(attractor: Attractor) -> float:
    """The larger multiplier where it is real, otherwise zero."""
    if attractor.multipliers is None or complex(attractor.multipliers[0]).imag:
        return 0.0
    return complex(attractor.multipliers[0]).real


def _size(attractor: Attractor) -> float:
    return float(max(abs(attractor.velocities), default=1.0))


def _low_impacts(attractor: Attractor) -> bool:
    """Whether complex motion has impacts of low velocity now and then."""
    return bool(min(abs(attractor.velocities)) < CLOSE * _size(attractor))


def _side(row: Row) -> Side:
    a = row.attractor
    gap = a.smallest_gap if math.isfinite(a.smallest_gap) else None
    multiplier = _multiplier(a) if a.multipliers is not None else None
    return Side(row.value, a.kind.value, a.notation, a.word, a.period, a.rate, multiplier, gap)


# What the branches say.

_KINDS = {"PD": ("PD",), "G": ("G",), "PD_G": ("G", "FB"), "TG": ("FB", "G"), "FB": ("FB",)}


def explained(transition: Transition, diagram: Diagram, sweep: Sweep) -> Transition:
    """Return the transition with the entries that explain or bound it.

    An entry explains it that lies in the bracket or next to it and belongs to the orbit before, or
    to the one after. Otherwise the nearest entries of the kinds that go with it, on branches of
    these orbits and of the orbit whose periods were doubled, bound it: for TG and PD_G those are
    the fold at which the orbit after is born, and the (ghost) grazing of the orbit before.
    """
    values = [row.value for row in sweep.rows]
    span = (max(values) - min(values)) or 1.0
    related = [e for e in diagram.entries if _related(e, transition)]
    low, high = sorted((transition.before.value, transition.after.value))
    near = []
    for entry in related:
        distance = max(low - entry.value, entry.value - high, 0.0)
        near.append((distance, entry))
    near.sort(key=lambda pair: pair[0])
    explains = [pair for pair in near if pair[0] <= EXPLAINED * span]
    chosen = explains[:2] or _bounds(near, transition)
    role = "explains" if explains else "bounds"
    records = [Explanation(e.id, e.label, e.value, d, role) for d, e in chosen]
    return replace(transition, explanations=tuple(records))


def _bounds(
    near: Sequence[tuple[float, Entry]], transition: Transition
) -> list[tuple[float, Entry]]:
    """The nearest entry of each kind that goes with a transition."""
    kinds = _KINDS.get(transition.kind or "", ("G", "FB", "PD"))
    firsts = ([pair for pair in near if pair[1].kind == kind][:1] for kind in kinds)
    return [pair for first in firsts for pair in first]


def _related(entry: Entry, transition: Transition) -> bool:
    """Whether an entry is of the orbits beside a transition, or of one they have multiplied."""
    kinds = _KINDS.get(transition.kind or "")
    if kinds is not None and entry.kind not in kinds:
        return False
    sides = (transition.before, transition.after)
    periodic = [s for s in sides if s.word is not None and s.period is not None]
    if not periodic:
        return False
    return any(_repeats(s.word or "", s.period or 1, entry) for s in periodic) or (
        entry.becomes is not None
        and any(_cyclic(s.word or "", entry.becomes.split("/")[0]) for s in periodic)
    )


def _repeats(word: str, period: int, entry: Entry) -> bool:
    """Whether an orbit is the entry's, or the entry's run several times."""
    times, rest = divmod(period, entry.period)
    return rest == 0 and _cyclic(word, entry.word * times)


def _cyclic(one: str, other: str) -> bool:
    return len(one) == len(other) and one in other * 2
