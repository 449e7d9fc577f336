"""What a change of attractor is called: the names of Table 1 of the paper on vibro-impact pairs.

PD, G with one or more impacts added, PD_G from an orbit of period pT, TG from complex motion, and
FB. The last attractor before the change decides, since a multiplier is near 1 at a fold and a
flight is near a wall at a grazing, together with what follows: a period doubling is one only if the
doubled orbit follows. A multiplier of -1 without it, as at a subcritical doubling, has no name; the
observation is recorded as evidence.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from ..models.word import is_rotation
from ..storage.texts import made
from .attractor import Attractor, Kind
from .sweep import Row

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
        PD, G, PD_G, TG, FB; None if none of these describes it.
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
    evidence : str
        What the attractors beside the change show.
    wide : str or None
        Why the bracket is wider than requested, and what may help; None if it is not.
    """

    direction: str
    kind: str | None
    label: str
    order: int | None
    before: Side
    after: Side
    width: float
    explanations: Sequence[Explanation] = ()
    evidence: str = ""
    wide: str | None = None

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
    kind, evidence = _kind(before, after, earlier)
    arrow = f"{one.notation}->{other.notation}"
    label = f"{kind}[{arrow}]" if kind else arrow
    sides, width = (_side(before), _side(after)), abs(after.value - before.value)
    return Transition(before.direction, kind, label, order, *sides, width, evidence=evidence)


def _kind(before: Row, after: Row, earlier: Row | None) -> tuple[str | None, str]:
    """The name of a change, if it has one, and the evidence for it."""
    one, other = before.attractor, after.attractor
    if one.kind is Kind.COMPLEX:
        slow = f"complex motion with impacts as slow as {min(abs(one.velocities)):.2g}"
        return ("TG" if other.period is not None and _low_impacts(one) else None), slow
    if one.kind is not Kind.PERIODIC:
        return None, f"{one.kind.value}: it has neither multipliers nor a gap that could vanish"
    critical = _critical(before, after, earlier)
    seen = critical.told if critical else "no multiplier near 1 or -1, no flight near to a wall"
    if _doubled(one, other) or _doubled(other, one):
        return "PD", f"the word is run twice over twice the period; {seen}"
    if critical is None:
        return None, seen
    if critical.kind == "PD":
        return None, f"{seen}, but no doubled orbit follows"
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
    """Which quantity of a periodic attractor is critical where it ends.

    Beside a doubling 1 + mu is linear in the parameter, beside a fold (1 - mu)^2, beside a grazing
    the gap, or the velocity of the impact that is lost. The quantity whose line vanishes nearest
    to the bracket tells the kind; without an earlier attractor, the smallest does.
    """
    now = _quantities(before.attractor)
    if earlier is None or earlier.value == before.value:
        key = min(now, key=lambda key: now[key])
        return Critical(*key, now[key], None) if now[key] < CLOSE**2 else None
    step = before.value - earlier.value
    then = _quantities(earlier.attractor)
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


def _quantities(attractor: Attractor) -> dict[tuple[str, str], float]:
    """Quantities that vanish where an attractor ends, by the kind and what they are."""
    multiplier, size = _multiplier(attractor), _size(attractor)
    gap = attractor.smallest_gap / size
    return {
        ("PD", "1 + mu"): abs(1.0 + multiplier),
        ("FB", "(1 - mu)^2"): (1.0 - multiplier) ** 2,
        ("G", "smallest gap"): gap if math.isfinite(gap) else math.inf,
        ("G", "slowest impact"): float(min(abs(attractor.velocities), default=math.inf)) / size,
    }


def _doubled(one: Attractor, other: Attractor) -> bool:
    """Whether the second has the first's word twice, over twice the period."""
    if one.word is None or other.word is None or one.period is None:
        return False
    return other.period == 2 * one.period and is_rotation(other.word, one.word * 2)


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
