"""Near misses: where on a line what vanishes at an event comes nearest to zero, and turns back.

A closed curve that no line crosses is seen from the lines beside it: the determinant of the event,
or its gap, has an extremum there. From the extremum the orbit is followed across the line, and
along again where it comes nearest to zero on the way, until an event is met or nothing is nearer:
a descent to the extremum in both parameters, one coordinate at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..continuation.branch import Points
from ..models.word import Word
from ..orbit_continuation.orbit_branch import Run
from ..orbits.problem import Summary

MOST_STEPS = 8
"""How often a descent turns at most."""

NEARER = 0.999
"""A step that brings less than this is the last."""

TURNS = 1e-6
"""An extremum by less than this part of its size is rounding."""

SAME_PLACE = 0.02
"""Descents that come as near to each other, as parts of both ranges, go on as one,"""
SAME_ORBIT = 0.1
"""if their orbits' velocities differ by less than this part of the largest."""


@dataclass(frozen=True)
class NearMiss:
    """An extremum on a line.

    Attributes
    ----------
    word : Word
    kind : str
        Of the event that is missed.
    index : int
        Which of several values that vanish at events of this kind.
    size : float
        How far from zero it is.
    unknowns : ndarray
        The orbit, the line's free parameter last.
    velocities : ndarray
        Of its impacts.
    """

    word: Word
    kind: str
    index: int
    size: float
    unknowns: Array
    velocities: Array

    def like(self, other: NearMiss) -> bool:
        """Whether the same is missed on orbits that are not far from each other."""
        same = (self.word, self.kind, self.index) == (other.word, other.kind, other.index)
        if not same:
            return False
        apart = np.max(np.abs(self.velocities - other.velocities), initial=0.0)
        return bool(apart <= SAME_ORBIT * np.max(np.abs(self.velocities), initial=0.0))


def near_misses(run: Run, kinds: Sequence[str]) -> list[NearMiss]:
    """Return the near misses on a run, of the kinds for which one is told."""
    points, problem = run.points, run.problem
    rows = points.unknowns
    return [
        NearMiss(
            problem.word,
            kind,
            index,
            float(abs(values[row])),
            rows[row],
            problem.impacts(rows[row])[:, 1],
        )
        for kind in kinds
        if kind in VANISHING
        for index, values in enumerate(VANISHING[kind](points).T)
        for row in _turning(values)
    ]


def _turning(values: Array) -> list[int]:
    """Where a value is nearest to zero between two others of its sign."""
    left, middle, right = values[:-2], values[1:-1], values[2:]
    one_sign = (np.sign(left) == np.sign(middle)) & (np.sign(middle) == np.sign(right))
    nearest = np.abs(middle) * (1.0 + TURNS) < np.minimum(np.abs(left), np.abs(right))
    return (1 + np.nonzero(one_sign & nearest)[0]).tolist()


def _multipliers(points: Points) -> Array:
    values = Summary.of(points.numbers).multipliers
    return np.where(np.isfinite(values), values, np.nan)


def _fold(points: Points) -> Array:
    values = _multipliers(points)
    return np.prod((1.0 - values) / (1.0 + np.abs(values)), axis=1).real[:, None]


def _doubling(points: Points) -> Array:
    values = _multipliers(points)
    return np.prod((1.0 + values) / (1.0 + np.abs(values)), axis=1).real[:, None]


def _torus(points: Points) -> Array:
    """How far complex pairs are from the unit circle; others tell nothing."""
    values = _multipliers(points)
    pairs = np.where(values.imag > 0.0, np.abs(values) - 1.0, np.nan)
    order = np.argsort(np.abs(pairs), axis=1, kind="stable")[:, :1]  # not-a-number goes last
    return np.take_along_axis(pairs, order, axis=1)


def _gaps(points: Points) -> Array:
    return np.array(
        [
            [np.nan if t is None else t.gap for flight in p.evaluation.gaps for t in flight.touches]
            for p in points
        ]
    )


def _velocities(points: Points) -> Array:
    problem = points[0].evaluation.problem
    return np.array([problem.impacts(unknowns)[:, 1] for unknowns in points.unknowns])


VANISHING: dict[str, Callable[[Points], Array]] = {
    "FB": _fold,
    "PD": _doubling,
    "NS": _torus,
    "G": _gaps,
    "V": _velocities,
}
"""What vanishes at events of a kind, along the points of a run: shape (P, values)."""


Place = Mapping[str, float]
"""Values of both parameters."""

Cross = Callable[[NearMiss, str, Place], "Run | None"]
"""Follow the orbit of a near miss while a parameter is held at its value at a place."""


class Descents:
    """Descents from near misses to events, or to where nothing is nearer.

    Parameters
    ----------
    ranges : mapping of str to (low, high)
        Of both parameters.
    cross : callable
        See `Cross`.
    """

    def __init__(self, ranges: Mapping[str, tuple[float, float]], cross: Cross) -> None:
        self.ranges, self.cross = ranges, cross
        self.seen: list[tuple[Array, NearMiss]] = []

    def runs(self, miss: NearMiss, held: str, value: float) -> Iterator[Run]:
        """Follow from a near miss on a line that holds a parameter at a value."""
        for _ in range(MOST_STEPS):
            free = next(name for name in self.ranges if name != held)
            place = {held: value, free: float(miss.unknowns[-1])}
            run = None if self.known(miss, place) else self.cross(miss, free, place)
            if run is None:
                return
            yield run
            further = [one for one in near_misses(run, [miss.kind]) if one.index == miss.index]
            held, value = free, place[free]
            nearest = min(further, key=lambda one: one.size, default=miss)
            if nearest.size > NEARER * miss.size or any(e.kind == miss.kind for e in run.events):
                return
            miss = nearest

    def known(self, miss: NearMiss, place: Place) -> bool:
        """Whether a descent has been next to a near miss; from now on one has."""
        limits = self.ranges.items()
        parts = np.array([(place[name] - low) / (high - low) for name, (low, high) in limits])
        if any(np.max(np.abs(parts - p)) < SAME_PLACE and miss.like(m) for p, m in self.seen):
            return True
        self.seen.append((parts, miss))
        return False
