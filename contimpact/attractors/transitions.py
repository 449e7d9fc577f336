"""Where the observed attractor changes along a sweep, and what the branches say of it.

A change between two values of a sweep is bisected: each value is started from the attractor before
the change, as the sweep itself would. What it is called stands in `naming`.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

from ..models.word import is_rotation
from ..results.branch import Entry
from ..results.diagram import Diagram
from ..results.simulate_tables import SETTLING, Settling
from .edges import EVALUATIONS, locate
from .naming import Explanation, Transition, name
from .sweep import Row, Simulators, Sweep

MOST = 6
"""Changes located at most between two neighbouring values of a sweep."""
EXPLAINED = 1e-5
"""An entry explains a transition if it is this near to it, in parts of the range swept."""


def changes(rows: Sequence[Row]) -> Iterator[tuple[Row, Row]]:
    """Yield the neighbouring rows of one sweep between which the attractor changes."""
    for before, after in itertools.pairwise(rows):
        if before.attractor.label != after.attractor.label:
            yield before, after


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

    What follows an attractor is followed in turn, beyond the second row if need be, until it is
    that row's. At most `MOST` are located; what is left of the interval then is one transition
    without a name, and so is a change of the sweep to another basin, where the attractor before
    goes on.
    """
    first, span = before, after.value - before.value
    for _ in range(MOST):
        past = (after.value - before.value) * span <= 0.0
        target = replace(after, value=before.value + span) if past else after
        earlier, left, lost, right = locate(simulators, before, target, width, settling)
        if right is None:
            yield _changed_basin(first, after, left)
            return
        if lost is None:
            yield _not_followed(left, after)
            return
        if right.attractor.label != left.attractor.label:
            yield replace(name(left, right, earlier), wide=_wide(left, lost, right, width))
        if right.attractor.label == after.attractor.label:
            return
        before = right
    if (after.value - before.value) * span <= 0.0:
        yield _changed_basin(first, after, before)
        return
    evidence = f"{MOST} changes were located before it; this is left"
    wide = "more changes than are located between two values; more simulate.values separate them"
    yield replace(_unnamed(before, after), evidence=evidence, wide=wide)


def _changed_basin(first: Row, after: Row, last: Row) -> Transition:
    """A change that is no end of the attractor before: a step of the sweep has left its basin."""
    evidence = (
        f"a step of the sweep left the basin of {first.attractor.notation}; followed with "
        f"small steps, {last.attractor.notation} is met up to {last.value:.9g} at least"
    )
    wide = "it is a step of the sweep; more simulate.values keep to the attractor"
    return replace(_unnamed(first, after), evidence=evidence, wide=wide)


def _not_followed(left: Row, after: Row) -> Transition:
    """A change somewhere behind a motion without impacts that cannot be started anew."""
    evidence = (
        f"{left.attractor.notation} cannot be started anew beyond {left.value:.9g}: no motion of "
        "the forcing's period, within the guards, is known of it; it is not followed to its end"
    )
    wide = "it is a step of the sweep; more simulate.values narrow it"
    return replace(_unnamed(left, after), evidence=evidence, wide=wide)


def _unnamed(before: Row, after: Row) -> Transition:
    arrow = f"{before.attractor.notation}->{after.attractor.notation}"
    return replace(name(before, after), kind=None, label=arrow)


def _wide(left: Row, lost: Row, right: Row, width: float) -> str | None:
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
        and any(is_rotation(s.word or "", entry.becomes.split("/")[0]) for s in periodic)
    )


def _repeats(word: str, period: int, entry: Entry) -> bool:
    """Whether an orbit is the entry's, or the entry's run several times."""
    times, rest = divmod(period, entry.period)
    return rest == 0 and is_rotation(word, entry.word * times)
