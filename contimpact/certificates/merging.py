"""What is left of an orbit at an event where an impact comes to rest, or a flight takes no time.

Multipliers at such an event are those of the word without what vanishes, as
`contimpact.bifurcations.sliding` says. Which flights take no time is seen in doubles, and proven
here: by the equations of the event, or as follows. Let a flight begin on the surface that it
reaches. If it begins, or ends, at rest there, and the acceleration has one sign all along, it takes
no time. If the jump of an impact at rest leads onto that surface, it is the velocity that has to
have one sign. (Guards with `past` change a velocity of zero, too: nothing leaves them at rest.)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import arb, arb_series

from ..bifurcations.sliding import (
    CROSSING,
    SWITCHING,
    at_once,
    at_zero_velocity,
    respelled,
    shorter,
    vanished,
)
from ..models.word import Word
from ..orbits.problem import OrbitProblem
from ..segments.segment import ELSEWHERE
from .equations import BallProblem, Balls


@dataclass(frozen=True)
class Remains:
    """A word, possibly that without impacts, and what is not in it.

    Attributes
    ----------
    word : Word
    dropped : tuple of int
        Impacts of the longer word.
    brief : tuple of int
        Its flights that take no time.
    """

    word: Word
    dropped: tuple[int, ...]
    brief: tuple[int, ...]


def remains_of(problem: OrbitProblem, z: Balls, details: Mapping[str, Any]) -> Remains | None:
    """Return what is left at an event; None where nothing vanishes, as where a contact that lasts
    begins or ends at rest."""
    impact, flight = details.get("impact"), details.get("flight")
    if "touch_time" in details or (impact is None) == (flight is None):
        return None
    unknowns = np.array([float(x.mid()) for x in z])
    if impact is None:
        return _without_flight(problem, unknowns, details["flight"])
    if at_zero_velocity(problem, unknowns, impact) == SWITCHING:
        return _merged(problem, (impact - 1) % len(problem.word))
    return _without(problem, unknowns, impact)


def _without_flight(problem: OrbitProblem, unknowns: Any, flight: int) -> Remains | None:
    found = at_once(problem, flight)
    if found in (CROSSING, SWITCHING):
        return _merged(problem, flight)
    return None if found is None else _without(problem, unknowns, flight)


def _without(problem: OrbitProblem, unknowns: Any, impact: int) -> Remains:
    dropped = vanished(problem.evaluate(unknowns), impact)
    return Remains(problem.word.drop(*dropped), dropped, dropped[:-1])


def _merged(problem: OrbitProblem, flight: int) -> Remains | None:
    letter, other = shorter(problem, flight), (flight + 1) % len(problem.word)
    if letter is None:
        return None
    return Remains(respelled(problem.word, flight, letter, 2), (other,), (flight,))


def takes_no_time(space: BallProblem, z: Balls, flight: int) -> bool:
    """Return whether a flight with an impact at rest is proven to take no time."""
    problem = space.problem
    word, letters = problem.word.walls, [guard.name for guard in problem.model.WALLS]
    ends = word[flight], word[(flight + 1) % len(word)]
    left, reached = map(letters.index, ends)
    start, end = (space.impacts(z)[flight + i] for i in (0, 1))
    duration = end[0] - start[0]
    if not duration.contains(0):
        return False
    motion = space.motion(ends[0], None if left == reached else ends[1])
    _, speed, acceleration = motion(start, duration.union(arb(0)), space.values(z))
    passages = problem.kernels.passages
    leaves_at_rest = bool(start[1] == 0) and not problem.model.WALLS[left].past
    if passages.arrivals[left][reached] != ELSEWHERE:
        return (leaves_at_rest or bool(end[1] == 0)) and not acceleration.contains(0)
    return leaves_at_rest and passages.meets_at_rest(left, reached) and not speed.contains(0)


def stops(space: BallProblem, z: Balls, flight: int) -> bool:
    """Return whether a flight that takes no time is proven to begin with an impact at rest.

    The jump of an impact at rest leads onto the surface reached; that of no other velocity does if
    it moves the gap coordinate with the velocity.
    """
    problem = space.problem
    ends = [problem.word.walls[k % len(problem.word)] for k in (flight, flight + 1)]
    left, reached = ([g.name for g in problem.model.WALLS].index(end) for end in ends)
    passages, start = problem.kernels.passages, space.impacts(z)[flight]
    if not (passages.onto and passages.onto[left][reached]) or not start[1].contains(0):
        return False
    faster = [start[0], arb_series([start[1].union(arb(0)), 1], prec=2), *start[2:]]
    begin = space.motion(*ends)(faster, arb(0), space.values(z))[0]
    return isinstance(begin, arb_series) and not begin[1].contains(0)
