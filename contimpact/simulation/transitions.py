"""Transitions between attractors along a sweep: their edges, and their names.

A change between two values of a sweep is bisected: each value is started from the attractor before
the change, as the sweep itself would. Its name follows from what is on both sides.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np

from ..errors import explain_arguments
from ..models.guards import Word, is_rotation
from ..orbits.quiet import problem_of
from ..orbits.search import solve_near
from ..results.branch import Entry
from ..results.diagram import Diagram
from ..results.options import SETTLING, Settling
from ..schema import build_record
from .attractor import Attractor, Cycle, Kind, repetitions_of, solve_cycle, stable_cycle_beside
from .settle import contraction_of, multipliers_alone, periodic
from .sweep import SAME, Row, Simulators, Sweep, same_attractor

# Where an attractor ends between two values of a sweep.
#
# Near a period doubling or a fold motions settle slowly; there they are given more periods before
# they count as not settled.

EVALUATIONS = 120
"""Values tried for one change at most."""
SMALLEST, STEPS = 1.0 / 64.0, 8
"""Part of the way, from one row to the next or of a width, in which an attractor is followed, if
need be, to another row of its word; steps for a motion without impacts."""
SLOW = 0.95
"""Motions settle slowly if a multiplier is larger than this."""
PATIENCE = 16
"""How many times more periods a slow motion is given."""
NEARBY = 16
"""Widths from the end within which it is given them."""
AHEAD, LAST = 0.9, 0.999
"""Part of the way to the predicted end that a step goes; part of a width that the last step is."""


class End(NamedTuple):
    """Where an attractor ends, by rows."""

    earlier: Row
    left: Row
    """`earlier`, `left`: two with the attractor, the second one the last."""
    lost: Row | None
    """The first beyond the end; None if a motion without impacts cannot be started again there."""
    right: Row | None
    """The first from there on at which the motion settles; None if the attractor does not end
    within ten times the distance of the two rows given."""


def locate(
    simulators: Simulators, before: Row, after: Row, width: float, settling: Settling = SETTLING
) -> End:
    """Locate the end of an attractor between two rows.

    A periodic attractor, or a motion without impacts, is followed, by Newton's iteration if that is
    direct and by simulation if not. The step is halved where it is lost and grows again where it is
    not, so that near the end the start is always close to the attractor: a long step can kick the
    motion out of a small basin before its attractor ends. Steps lead to where a quantity that is
    critical at the end would vanish. Other motions are not left in this way; for them the interval
    is bisected. Where a motion without impacts cannot be started again, what follows is the second
    row.
    """
    lost: Row | None = after
    gone: Cycle | None = None
    earlier, left, end = before, before, after.value
    step, won = 0.5 * (after.value - before.value), 0
    furthest, longest = before.value + 20.0 * step, abs(step)
    periodic_before = before.attractor.kind is Kind.PERIODIC
    follows = periodic_before or before.attractor.motion is not None
    for _ in range(EVALUATIONS):
        value = left.value + step
        patient = _waiting_time(left.attractor, abs(step), width, settling)
        cycle = _moved_cycle(simulators, left, value)
        row, on = None, False
        if cycle is not None:
            row = _periodic_row(simulators, left, value, cycle)
            on = row is not None
        elif not periodic_before or abs(step) <= width:
            row = _row(simulators, left, value, patient)
            if row is None:
                return End(earlier, left, None, after)
            on = goes_on(simulators, left, row, settling)
        if on and row:
            earlier, left, won = left, row, won + 1
            if (furthest - left.value) * step <= 0.0:
                return End(earlier, left, lost, None)
            if not follows:
                step *= 0.5
            elif ahead := _predicted_step(earlier, left, end, width):
                step = ahead
            elif won > 1 and abs(step) < longest:
                step, won = 2.0 * step, 0
        else:
            lost, gone, end, won = row, cycle, value, 0
            step *= 0.5
        if _is_ahead(end, left, step) and abs(end - left.value) <= width:
            if lost or gone:
                break
            step = end - left.value  # where nothing but Newton's iteration has failed
        if left.value + step == left.value:
            break
    if not _is_ahead(end, left, step):
        return End(earlier, left, lost, None)
    if periodic_before and (lost is None or not lost.attractor.settled):
        lost = _beside(simulators, left, gone, end, settling.longest) or lost
    lost = lost or _row(simulators, left, end, patient)
    if lost is None:
        return End(earlier, left, None, after)
    right = _settled_row(simulators, left, lost, furthest, width, settling)
    return End(earlier, left, lost, right)


def _moved_cycle(simulators: Simulators, before: Row, value: float) -> Cycle | None:
    """The cycle to which that of a periodic attractor has moved at another value, stable or not;
    None if Newton's iteration does not lead there directly."""
    one = before.attractor
    if one.kind is not Kind.PERIODIC or one.state is None or one.period is None:
        return None
    there = simulators.at(value)
    found = solve_cycle(there, one.state, len(one.walls), one.period, direct=True)
    return None if found is None or repetitions_of(found, there.period) > 1 else found


def _periodic_row(
    simulators: Simulators, before: Row, value: float, cycle: Cycle | None
) -> Row | None:
    """The row of a cycle at another value, if it is stable."""
    if cycle is None or abs(cycle.multipliers[0]) >= 1.0:
        return None
    found = periodic(simulators.at(value), cycle, contracts=multipliers_alone)
    return Row(before.direction, value, found)


def _with_known_multipliers(simulators: Simulators, row: Row) -> Row:
    """A row with zero for the multipliers of which rounding leaves nothing."""
    one = row.attractor
    if one.kind is not Kind.PERIODIC:
        return row
    cycle = Cycle(**{each.name: getattr(one, each.name) for each in fields(Cycle)})
    known = contraction_of(simulators.at(row.value), cycle).multipliers
    return replace(row, attractor=replace(one, multipliers=known))


def _beside(
    simulators: Simulators, left: Row, gone: Cycle | None, value: float, longest: int
) -> Row | None:
    """What follows a periodic attractor beyond its end if that is near: a stable cycle beside the
    one `gone`, which is unstable there, or the one of which the attractor was the doubled one."""
    there, one = simulators.at(value), left.attractor
    if gone is not None:
        found = stable_cycle_beside(there, gone)
        short = found is not None and len(found.walls) <= longest
        return _periodic_row(simulators, left, value, found) if short else None
    half, walls = len(one.walls) // 2, one.walls.tolist()
    if one.state is None or not one.period or one.period % 2 or walls[:half] != walls[half:]:
        return None
    found = solve_cycle(there, one.state, half, one.period // 2, direct=True)
    return _periodic_row(simulators, left, value, found)


def _predicted_step(earlier: Row, left: Row, end: float, width: float) -> float | None:
    """The step to nine tenths of the way to where a critical quantity would vanish, or once that is
    within half a width, a width; None if it would not before the end of the interval."""
    step = left.value - earlier.value
    unit = abs(earlier.attractor.smallest_gap) or 1.0
    then, now = (_quantities(row.attractor, unit) for row in (earlier, left))
    falling = [key for key in now if now[key] < then[key] < math.inf]
    ways = [now[key] * step / (then[key] - now[key]) for key in falling]
    way = min(ways, key=abs, default=math.inf)
    if not abs(way) < abs(end - left.value) or (end - left.value) * step <= 0.0:
        return None
    return AHEAD * way if abs(way) > 0.5 * width else math.copysign(LAST * width, step)


def goes_on(simulators: Simulators, before: Row, after: Row, settling: Settling) -> bool:
    """Whether an attractor is the one before it, at a neighbouring value, by what they are.

    Where a periodic one moves to is solved for; where that fails, or leads to an orbit of a shorter
    period as beside a doubling, a near one of its word is taken for it. Of others that may coexist
    with their like, the motion has to lead back. Complex motions are not told apart here.
    """
    one, other = before.attractor, after.attractor
    if one.label != other.label:
        return False
    if one.kind is Kind.PERIODIC and one.state and one.period is not None:
        there = simulators.at(after.value)
        solved = solve_cycle(there, one.state, len(one.walls), one.period)
        if solved is None or repetitions_of(solved, there.period) > 1:
            return same_attractor(one, other, BESIDE)
        moved = replace(other, **(vars(solved) | {"multipliers": other.multipliers}))
        return same_attractor(moved, other)
    if one.kind is Kind.NO_IMPACT:
        return _motion_goes_on(simulators, before, after)
    if one.kind is not Kind.STICKING:
        return True
    back = simulators.lead(other, before.value, settling)
    return back is None or same_attractor(back, one)


def _motion_goes_on(simulators: Simulators, before: Row, after: Row) -> bool:
    """Of motions without impacts; linear ones have none beside them, and of other modes than the
    first no orbit can be solved for."""
    one, other, modes = before.attractor, after.attractor, simulators.model.MODES
    there = simulators.at(after.value)
    if one.motion is None or other.motion is None:
        return True
    if one.mode not in ("", *(mode.name for mode in modes[:1])):
        return True
    if there.machine.law_in(one.mode) is not None or one.rests:
        return True
    at = np.append(one.unknowns, before.value)
    for value in np.linspace(before.value, after.value, STEPS + 1)[1:].tolist():
        model = simulators.model.replace(**{simulators.parameter: value})
        at[-1] = value
        word = Word("", int(not one.free))
        moved = solve_near(problem_of(model, word, simulators.kernels), at)
        if moved is None:
            return False
        at = moved.unknowns
    found = replace(other, motion=tuple(at[:-1].tolist()))
    return same_attractor(found, replace(other, motion=tuple(other.unknowns.tolist())))


def leads_to(
    simulators: Simulators,
    before: Row,
    after: Row,
    least: float,
    settling: Settling,
    tolerance: float = SAME,
) -> bool:
    """Whether an attractor, followed in steps that are halved down to the least one where it is
    lost and grow again, is that of the second row, or as near to it as a tolerance."""
    left, step = before, after.value - before.value
    if step == 0.0:
        return same_attractor(before.attractor, after.attractor, tolerance)
    periodic_before = before.attractor.kind is Kind.PERIODIC
    if not periodic_before and goes_on(simulators, before, after, settling):
        return True
    while before.attractor.label == after.attractor.label and abs(step) >= least:
        last = abs(after.value - left.value) <= abs(step) * (1.0 + 1e-9)
        value = after.value if last else left.value + step
        if periodic_before:
            row = _periodic_row(simulators, left, value, _moved_cycle(simulators, left, value))
        else:
            row = _row(simulators, left, value, settling)
            row = row if row and goes_on(simulators, left, row, settling) else None
        if row is None:
            step *= 0.5
        elif last:
            return same_attractor(row.attractor, after.attractor, tolerance)
        else:
            left, step = row, 2.0 * step
    return False


def _waiting_time(
    attractor: Attractor, distance: float, width: float, settling: Settling
) -> Settling:
    """How long to wait, at a distance from an attractor, for it or for what follows it."""
    slow = attractor.multipliers is not None and abs(attractor.multipliers[0]) > SLOW
    if slow and distance <= NEARBY * width:
        return replace(settling, periods=PATIENCE * settling.periods)
    return settling


def _is_ahead(value: float, left: Row, step: float) -> bool:
    """Whether a value lies in front of a row, and not just by rounding."""
    return (value - left.value) * math.copysign(1.0, step) > 0.25 * abs(step)


def _settled_row(
    simulators: Simulators, left: Row, lost: Row, furthest: float, width: float, settling: Settling
) -> Row:
    """The first row further on at which the motion settles; the lost one if there is none.

    Steps begin with the requested width, since what follows a doubling may soon end again.
    """
    step, ahead = math.copysign(width, furthest - lost.value), lost
    while not ahead.attractor.settled and abs(furthest - ahead.value) > abs(step) > 0.0:
        value = ahead.value + step
        patient = _waiting_time(left.attractor, abs(value - left.value), width, settling)
        found = _beside(simulators, left, None, value, settling.longest)
        found = found or _row(simulators, ahead, value, patient)
        if found is None:
            return lost
        ahead = found
        step *= 2.0
    return ahead if ahead.attractor.settled else lost


def _row(simulators: Simulators, before: Row, value: float, settling: Settling) -> Row | None:
    """What an attractor leads to at another value; None if that cannot be told."""
    found = simulators.lead(before.attractor, value, settling)
    return None if found is None else Row(before.direction, value, found)


# What a change of attractor is called: the names of Table 1 of the paper on vibro-impact pairs.
#
# PD, G with one or more impacts added, PD_G from an orbit of period pT, TG from complex motion, and
# FB. The last attractor before the change decides, since a multiplier is near 1 at a fold and a
# flight is near a wall at a grazing, together with what follows: a period doubling is one only if
# the doubled orbit follows. A multiplier of -1 without it, as at a subcritical doubling, has no
# name; the observation is recorded as evidence.

REACH = 3.0
"""Steps beyond the bracket within which the line of a quantity has to vanish to tell the kind."""
BESIDE = 0.1
"""An orbit of the same word this near goes on beside the one that ends."""
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
    """A change of the observed attractor."""

    direction: str
    """Direction of the sweep."""
    kind: str | None
    """PD, G, PD_G, TG, FB; None if none of these describes it."""
    label: str
    """Label as in Table 1, ``G[1:1->2:1]``, or the two notations."""
    order: int | None
    """Impacts per forcing period gained, where both sides are periodic and it is a whole number;
    above 1 the grazing is one of higher order."""
    before: Side
    after: Side
    """`before`, `after`: the attractors on both sides of the bracket, in the order of the sweep."""
    width: float
    """Width of the bracket."""
    explanations: Sequence[Explanation] = ()
    evidence: str = ""
    """What the attractors beside the change show."""
    wide: str | None = None
    """Why the bracket is wider than requested, and what may help; None if it is not."""

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
        found = build_record(Transition, record)
        return replace(found, explanations=tuple(found.explanations))

    def lines(self, parameter: str) -> list[str]:
        """Return what a summary says: the change, its evidence if it has no name, why its bracket
        is wide if it is, and the entries that explain it."""
        low, high = sorted((self.before.value, self.after.value))
        head = f"  {self.label:24} {self.direction:4} {parameter} from {low:.9g} to {high:.9g}"
        found = [head, *([f"      no name: {self.evidence}"] if self.kind is None else [])]
        found += [f"      wide: {self.wide}"] if self.wide else []
        return found + [
            f"      {e.role} {e.label} ({e.entry}) at {e.value:.12g}" for e in self.explanations
        ]

    def __repr__(self) -> str:
        return f"<{self.label} between {self.before.value:.12g} and {self.after.value:.12g}>"


def name(before: Row, after: Row, earlier: Row | None = None) -> Transition:
    """Name the change between two neighbouring values.

    `earlier` is the attractor before, further away from the change: it shows which quantity goes to
    its critical value there.
    """
    one, other = before.attractor, after.attractor
    gained = other.rate - one.rate
    both = one.period is not None and other.period is not None and not one.free
    whole = both and math.isfinite(gained) and abs(gained - round(gained)) < 1e-9
    order = round(gained) if whole else None
    kind, evidence = _kind(before, after, earlier)
    arrow = f"{one.notation}->{other.notation}"
    label = f"{kind}[{arrow}]" if kind else arrow
    sides, width = (_side(before), _side(after)), abs(after.value - before.value)
    return Transition(before.direction, kind, label, order, *sides, width, evidence=evidence)


def _kind(before: Row, after: Row, earlier: Row | None) -> tuple[str | None, str]:
    """The name of a change, if it has one, and the evidence for it."""
    one, other = before.attractor, after.attractor
    if one.kind is Kind.COMPLEX:
        slowest = min(abs(one.velocities))
        grazes = other.period is not None and slowest < CLOSE * one.fastest
        seen = f"complex motion with impacts as slow as {slowest:.2g}"
        return ("TG" if grazes else None), seen
    if one.kind is not Kind.PERIODIC and not math.isfinite(one.smallest_gap):
        return None, f"{one.kind.value}: it has neither multipliers nor a gap that could vanish"
    critical = _critical(before, after, earlier)
    seen = critical.told if critical else "no multiplier near 1 or -1, no flight near to a wall"
    if _is_doubled(one, other) or _is_doubled(other, one):
        return "PD", f"the word is run twice over twice the period; {seen}"
    if critical is None:
        return None, seen
    if critical.kind == "PD":
        return None, f"{seen}, but no doubled orbit follows"
    if same_attractor(one, other, BESIDE):
        return None, f"{seen}, but an orbit beside it follows, as where a symmetry breaks"
    longer = (one.period or 1) > 1 and other.period == 1 and other.rate > one.rate
    return ("PD_G" if longer else critical.kind), seen


@dataclass(frozen=True)
class Critical:
    """A quantity of an attractor that vanishes where it ends.

    `value` is the last one seen, `zero` the parameter value at which its line vanishes, None if
    only one attractor is known.
    """

    kind: str
    what: str
    value: float
    zero: float | None

    @property
    def told(self) -> str:
        """The quantity in words."""
        end = "" if self.zero is None else f", zero at {self.zero:.9g}"
        return f"{self.what} = {self.value:.2g}{end}"


def _critical(before: Row, after: Row, earlier: Row | None) -> Critical | None:
    """Which quantity of a periodic attractor, or of one without impacts, is critical at its end.

    Beside a doubling 1 + mu is linear in the parameter, beside a fold (1 - mu)^2, beside a grazing
    the gap, or the velocity of the impact that is lost. The quantity whose line vanishes nearest
    to the bracket tells the kind; without an earlier attractor, the smallest does.
    """
    unit = abs((earlier or before).attractor.smallest_gap) or 1.0
    now = _quantities(before.attractor, unit)
    if earlier is None or earlier.value == before.value:
        key = min(now, key=lambda key: now[key])
        return Critical(*key, now[key], None) if now[key] < CLOSE**2 else None
    step = before.value - earlier.value
    then = _quantities(earlier.attractor, unit)
    scores, zeros = {}, {}
    for key, value in now.items():
        if abs(value) < then[key]:
            zeros[key] = before.value + value * step / (then[key] - value)
            past = (zeros[key] - after.value) / step
            scores[key] = max(past, (before.value - zeros[key]) / step, 0.0) + value
    best = min(scores, key=lambda key: scores[key], default=None)
    if best is None or not scores[best] < REACH:
        return None
    return Critical(*best, now[best], zeros[best])


def _quantities(attractor: Attractor, unit: float) -> dict[tuple[str, str], float]:
    """Quantities that vanish where an attractor ends, by the kind and what they are; the gap of
    one without impacts in a unit."""
    multiplier = _multiplier(attractor)
    size = attractor.fastest if attractor.velocities.size else unit
    gap = attractor.smallest_gap / size
    return {
        ("PD", "1 + mu"): abs(1.0 + multiplier),
        ("FB", "(1 - mu)^2"): (1.0 - multiplier) ** 2,
        ("G", "smallest gap"): gap if math.isfinite(gap) else math.inf,
        ("G", "slowest impact"): float(min(abs(attractor.velocities), default=math.inf)) / size,
    }


def _is_doubled(one: Attractor, other: Attractor) -> bool:
    """Whether the second has the first's word twice, over twice the period."""
    if one.word is None or other.word is None or one.period is None:
        return False
    return other.period == 2 * one.period and is_rotation(other.word, one.word * 2)


def _multiplier(attractor: Attractor) -> float:
    """The larger multiplier where it is real, otherwise zero."""
    if attractor.multipliers is None or complex(attractor.multipliers[0]).imag:
        return 0.0
    return complex(attractor.multipliers[0]).real


def _side(row: Row) -> Side:
    a = row.attractor
    gap = a.smallest_gap if math.isfinite(a.smallest_gap) else None
    multiplier = _multiplier(a) if a.multipliers is not None else None
    return Side(row.value, a.kind.value, a.notation, a.word, a.period, a.rate, multiplier, gap)


MOST = 6
"""Changes located at most between two neighbouring values of a sweep."""
EXPLAINED = 1e-5
"""An entry explains a transition if it is this near to it, in parts of the range swept."""


@explain_arguments
def find_transitions(
    sweep: Sweep,
    width: float,
    *,
    settling: Settling = SETTLING,
    diagram: Diagram | None = None,
    simulators: Simulators | None = None,
) -> list[Transition]:
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
        for before, after in all_changes(sweep, simulators, settling)
        for transition in transitions_between(simulators, before, after, width, settling)
    ]
    return [explain_transition(t, diagram, sweep) if diagram else t for t in found]


def all_changes(
    sweep: Sweep, simulators: Simulators, settling: Settling = SETTLING
) -> list[tuple[Row, Row]]:
    """Return the neighbouring rows of all sweeps between which the attractor changes, also to
    another one of its word.

    What is before a row that has not settled is followed to the next one, or to the last row.
    """
    pairs = ((*pair, SMALLEST * abs(pair[1].value - pair[0].value)) for pair in neighbours(sweep))
    return [pair[:2] for pair in pairs if not leads_to(simulators, *pair, settling)]


def neighbours(sweep: Sweep) -> Iterator[tuple[Row, Row]]:
    """Yield the neighbouring rows of all sweeps.

    A row between that has not settled is no attractor, and passed over.
    """
    for rows in _sweeps(sweep):
        settled = [row for row in rows[:-1] if row.attractor.settled]
        yield from itertools.pairwise([*settled, *rows[-1:]])


def _sweeps(sweep: Sweep) -> list[list[Row]]:
    return [sweep.of(way) for way in sweep.directions if way != "random"]


def transitions_between(
    simulators: Simulators, before: Row, after: Row, width: float, settling: Settling = SETTLING
) -> Iterator[Transition]:
    """Yield the transitions between two rows of a sweep, one after another.

    What follows an attractor is followed in turn, beyond the second row if need be, until it is
    that row's, or beyond it where that has not settled. At most `MOST` are located; what is left of
    the interval then is one transition without a name, and so is a change of the sweep to another
    basin, where the attractor before goes on.
    """
    first, span, past, least = before, after.value - before.value, False, SMALLEST * width
    for _ in range(MOST):
        target = replace(after, value=before.value + span) if past else after
        earlier, left, lost, right = locate(simulators, before, target, width, settling)
        if not after.attractor.settled and (
            right is None or (after.value - left.value) * span <= 0
        ):
            return
        if right is None:
            yield _changed_basin(first, after, left)
            return
        if lost is None:
            yield _not_followed(left, after)
            return
        if not leads_to(simulators, left, right, least, settling):
            told = (_with_known_multipliers(simulators, row) for row in (left, right, earlier))
            yield replace(name(*told), wide=_width_reason(left, lost, right, width))
        if leads_to(simulators, right, after, least, settling):
            return
        splits = left.attractor.label == right.attractor.label
        if splits and leads_to(simulators, after, right, least, settling, BESIDE):
            return  # the other one of two that begin where a symmetry breaks
        before = right
        past = (after.value - before.value) * span <= 0.0
        if past and not after.attractor.settled:
            return
    if past:
        yield _changed_basin(first, after, before)
        return
    evidence = f"{MOST} changes were located before it; this is left"
    wide = "more changes than are located between two values; more simulate.values separate them"
    yield replace(_unnamed_transition(before, after), evidence=evidence, wide=wide)


A_STEP = "it is a step of the sweep"
"""Why a bracket is wide in which the attractor before was not followed to its end."""


def _changed_basin(first: Row, after: Row, last: Row) -> Transition:
    """A change that is no end of the attractor before: a step of the sweep has left its basin."""
    evidence = (
        f"a step of the sweep left the basin of {first.attractor.notation}; followed with "
        f"small steps, {last.attractor.notation} is met up to {last.value:.9g} at least"
    )
    wide = f"{A_STEP}; more simulate.values keep to the attractor"
    return replace(_unnamed_transition(first, after), evidence=evidence, wide=wide)


def _not_followed(left: Row, after: Row) -> Transition:
    """A change somewhere behind a motion without impacts that cannot be started anew."""
    evidence = (
        f"{left.attractor.notation} cannot be started anew beyond {left.value:.9g}: no motion "
        "that repeats itself, within the guards, is known of it; it is not followed to its end"
    )
    wide = f"{A_STEP}; more simulate.values narrow it"
    return replace(_unnamed_transition(left, after), evidence=evidence, wide=wide)


def _unnamed_transition(before: Row, after: Row) -> Transition:
    arrow = f"{before.attractor.notation}->{after.attractor.notation}"
    return replace(name(before, after), kind=None, label=arrow)


def _width_reason(left: Row, lost: Row, right: Row, width: float) -> str | None:
    """Why a bracket is wider than asked, and what may help."""
    if abs(right.value - left.value) <= width * (1.0 + 1e-9):
        return None
    found = f"{abs(right.value - left.value):.2g} instead of {width:.2g}: "
    if lost is right:
        return f"{found}{EVALUATIONS} values were tried; a wider simulate.width asks for less"
    far = f"from {lost.value:.9g} on the motion does not settle"
    return f"{found}{far} before {right.value:.9g}; more simulate.periods may resolve it"


# What the branches say.

_KINDS = {"PD": ("PD",), "G": ("G",), "PD_G": ("G", "FB"), "TG": ("FB", "G"), "FB": ("FB",)}


def explain_transition(transition: Transition, diagram: Diagram, sweep: Sweep) -> Transition:
    """Return the transition with the entries that explain or bound it.

    An entry explains it that lies in the bracket or next to it and belongs to the orbit before, or
    to the one after; it bounds it where the bracket is a step of the sweep, in which more may lie.
    Otherwise the nearest entries of the kinds that go with it, on branches of these orbits and of
    the orbit whose periods were doubled, bound it: for TG and PD_G those are the fold at which the
    orbit after is born, and the (ghost) grazing of the orbit before.

    A crisis of the motion before explains its end also from a step of the sweep away: beyond it
    transients are long.
    """
    values = [row.value for row in sweep.rows]
    span = (max(values) - min(values)) or 1.0
    related = [e for e in diagram.entries if _is_related(e, transition)]
    low, high = sorted((transition.before.value, transition.after.value))
    near = []
    for entry in related:
        distance = max(low - entry.value, entry.value - high, 0.0)
        near.append((distance, entry))
    near.sort(key=lambda pair: pair[0])
    explains = [pair for pair in near if pair[0] <= EXPLAINED * span]
    farthest = max((b - a for a, b in itertools.pairwise(sorted({*values}))), default=0.0)
    for entry in diagram.entries:
        distance = max(low - entry.value, entry.value - high, 0.0)
        ended = entry.crisis and entry.crisis.get("attractor") == transition.before.notation
        if ended and distance <= farthest:
            explains.insert(0, (distance, entry))
    chosen = explains[:2] or _bounds(near, transition)
    step = (transition.wide or "").startswith(A_STEP)
    located = explains and not (step and explains[0][1].crisis is None)
    role = "explains" if located else "bounds"
    records = [Explanation(e.id, e.label, e.value, d, role) for d, e in chosen]
    found = replace(transition, explanations=tuple(records))
    return _named_by(found, explains[0][1]) if located else found


_NAMED = {"G": "G", "V": "G", "FB": "FB"}
"""What changes from or to motion without impacts are called, by the entry that explains them."""


def _named_by(transition: Transition, entry: Entry) -> Transition:
    """A transition with the name of the entry that explains it, if it has none because motion
    without impacts does not show what vanishes, or an orbit shows it too near to its end."""
    kind, sides = _NAMED.get(entry.kind), (transition.before, transition.after)
    if transition.kind or not kind or not any(s.kind == Kind.NO_IMPACT.value for s in sides):
        return transition
    label, evidence = f"{kind}[{transition.label}]", f"{entry.label} ({entry.id}) lies there"
    return replace(transition, kind=kind, label=label, evidence=evidence)


def _bounds(
    near: Sequence[tuple[float, Entry]], transition: Transition
) -> list[tuple[float, Entry]]:
    """The nearest entry of each kind that goes with a transition."""
    kinds = _KINDS.get(transition.kind or "", ("G", "FB", "PD"))
    firsts = ([pair for pair in near if pair[1].kind == kind][:1] for kind in kinds)
    return [pair for first in firsts for pair in first]


def _is_related(entry: Entry, transition: Transition) -> bool:
    """Whether an entry is of the orbits beside a transition, or of one they have multiplied."""
    kinds = _KINDS.get(transition.kind or "")
    sides = (transition.before, transition.after)
    freed = any(side.kind == Kind.NO_IMPACT.value for side in sides)
    if entry.crisis is not None:
        return False
    if kinds is not None and entry.kind not in kinds and not (freed and entry.kind in _NAMED):
        return False
    periodic = [s for s in sides if s.word is not None and s.period is not None]
    if not periodic:
        return False
    if entry.kind == "G" and not entry.word and freed:
        return True
    if any(_repeats(s.word or "", s.period or 0, entry) for s in periodic):
        return True
    if entry.becomes is None:
        return False
    word, _, periods = entry.becomes.partition("/")
    period = int(periods.rstrip("T") or 1)
    return any((s.period or 1) == period and is_rotation(s.word or "", word) for s in periodic)


def _repeats(word: str, period: int, entry: Entry) -> bool:
    """Whether an orbit is the entry's, or the entry's run several times."""
    long, short = (period, entry.period) if entry.period else (len(word), len(entry.word) or 1)
    times, rest = divmod(long, short)
    return rest == 0 and is_rotation(word, entry.word * times)
