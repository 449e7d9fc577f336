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

from ..diagram import Diagram, Entry
from ..shapes import made
from .attractor import SETTLING, Attractor, Kind, Settling, settle
from .sweep import Row, Simulators, Sweep

MOST = 6
"""Changes located at most between two neighbouring values of a sweep."""
EVALUATIONS = 120
"""Values tried for one change at most."""
EXPLAINED = 1e-5
"""An entry explains a transition if it is this near to it, in parts of the range swept."""
REACH = 3.0
"""Steps beyond the bracket within which the line of a quantity has to vanish to tell the kind."""
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
        found = made(Transition, record)
        return replace(found, explanations=tuple(found.explanations))

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
        earlier, left, right = edge(simulators, before, after, width, settling)
        if right is None:
            return
        if right.attractor.label != left.attractor.label:
            yield name(left, right, earlier)
        ahead = (after.value - right.value) * (after.value - before.value) > 0.0
        if right.attractor.label == after.attractor.label or not ahead:
            return
        before = right
    rest = name(before, after)
    yield replace(rest, kind=None, label=f"{before.attractor.notation}->{after.attractor.notation}")


def edge(
    simulators: Simulators, before: Row, after: Row, width: float, settling: Settling = SETTLING
) -> tuple[Row, Row, Row | None]:
    """Locate the end of an attractor between two rows.

    A periodic attractor is followed by simulation, with a step that is halved where it is lost and
    grows again where it is not, so that beside the end the start is always close to the attractor:
    a long step can kick the motion out of a small basin before its attractor ends. For other
    motions, which a step does not leave so, the interval is bisected.

    Returns
    -------
    earlier, left, right : Row
        Two values with the attractor before, the second one the last, and the next one with
        another; `right` is None if a periodic attractor does not end within ten times the distance
        of the two rows.
    """
    earlier, left, lost = before, before, after
    step, won = 0.5 * (after.value - before.value), 0
    furthest, longest = before.value + 20.0 * step, abs(step)
    follows = before.attractor.kind is Kind.PERIODIC
    for _ in range(EVALUATIONS):
        row = _row(simulators, left, left.value + step, settling)
        if row.attractor.label == left.attractor.label:
            earlier, left, won = left, row, won + 1
            if (furthest - left.value) * step <= 0.0:
                return earlier, left, None
            if not follows:
                step *= 0.5
            elif won > 1 and abs(step) < longest:
                step, won = 2.0 * step, 0
        else:
            lost, won = row, 0
            step *= 0.5
        if _ahead(lost, left, step) and abs(lost.value - left.value) <= width:
            break
        if left.value + step == left.value:
            break
    if not _ahead(lost, left, step):
        return earlier, left, None
    return earlier, left, _settled(simulators, lost, furthest, settling)


def _ahead(row: Row, left: Row, step: float) -> bool:
    """Whether a row lies in front of another, and not just by rounding."""
    return (row.value - left.value) * math.copysign(1.0, step) > 0.25 * abs(step)


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


def name(before: Row, after: Row, earlier: Row | None = None) -> Transition:
    """Name the change between two neighbouring values.

    Parameters
    ----------
    before, after : Row
    earlier : Row, optional
        The attractor before, further away from the change: shows which quantity goes to its
        critical value there.
    """
    one, other = before.attractor, after.attractor
    gained = other.rate - one.rate
    both = one.period is not None and other.period is not None
    whole = both and math.isfinite(gained) and abs(gained - round(gained)) < 1e-9
    order = round(gained) if whole else None
    kind = _kind(before, after, earlier)
    arrow = f"{one.notation}->{other.notation}"
    return Transition(
        before.direction, kind, f"{kind}[{arrow}]" if kind else arrow, order, _side(before),
        _side(after), abs(after.value - before.value),
    )  # fmt: skip


def _kind(before: Row, after: Row, earlier: Row | None) -> str | None:
    one, other = before.attractor, after.attractor
    if one.kind is Kind.COMPLEX:
        return "TG" if other.period is not None and _low_impacts(one) else None
    if one.kind is not Kind.PERIODIC:
        return None
    if _doubled(one, other) or _doubled(other, one):
        return "PD"
    kind = _critical(before, after, earlier)
    longer = (one.period or 1) > 1 and other.period == 1 and other.rate > one.rate
    return "PD_G" if longer and kind in ("G", "FB") else kind


def _critical(before: Row, after: Row, earlier: Row | None) -> str | None:
    """Which quantity of a periodic attractor is critical where it ends.

    Beside a doubling 1 + mu is linear in the parameter, beside a fold (1 - mu)^2, beside a grazing
    the gap, or the velocity of the impact that is lost. The quantity whose line vanishes nearest
    to the bracket tells the kind; without an earlier attractor, the smallest does.
    """
    now = _quantities(before.attractor)
    if earlier is None or earlier.value == before.value:
        kind = min(now, key=lambda key: now[key])
        return kind[0] if now[kind] < CLOSE**2 else None
    step = before.value - earlier.value
    then = _quantities(earlier.attractor)
    scores = {}
    for key, value in now.items():
        if abs(value) < then[key]:
            zero = before.value + value * step / (then[key] - value)
            beyond = max((zero - after.value) / step, (before.value - zero) / step, 0.0)
            scores[key] = beyond + value
    best = min(scores, key=lambda key: scores[key], default=None)
    return best[0] if best is not None and scores[best] < REACH else None


def _quantities(attractor: Attractor) -> dict[tuple[str, str], float]:
    """Quantities that vanish where an attractor ends, by the kind and what they are."""
    multiplier, size = _multiplier(attractor), _size(attractor)
    gap = attractor.smallest_gap / size
    return {
        ("PD", "1 + mu"): abs(1.0 + multiplier),
        ("FB", "(1 - mu)^2"): (1.0 - multiplier) ** 2,
        ("G", "gap"): gap if math.isfinite(gap) else math.inf,
        ("G", "velocity"): float(min(abs(attractor.velocities), default=math.inf)) / size,
    }


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
