r"""From an event to the start of the branch that is born there.

==== ==================================================== =========================================
G    the touches become impacts of zero velocity          null vector of the longer word's Jacobian
V    the impact is dropped                                null vector of the shorter word's Jacobian
PD   the word is run twice                                (q, -q), q the eigenvector of -1
BP   the same word                                        second root of the bifurcation equation
==== ==================================================== =========================================

At a G or a V the new problem is regular and the branch goes both ways: to orbits that are physical
and to orbits that are not. At a PD both ways lead to the same orbits, half a period apart. At a BP
with null vectors phi_1 (the branch's tangent) and phi_2 and left null vector psi, the directions
a phi_1 + b phi_2 solve

.. math:: \alpha_{11} a^2 + 2 \alpha_{12} a b + \alpha_{22} b^2 = 0, \qquad
          \alpha_{ij} = \psi \cdot F_{zz}[\phi_i, \phi_j],

(Keller 1977), of which the branch itself is the root b = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..continuation.arclength import first_tangent
from ..continuation.branch import Event
from ..models.word import Word
from ..orbits.linearisation import Linearisation
from ..orbits.problem import Array, OrbitProblem
from ..orbits.recognition import shortest

TOUCHING = 1e-9
"""A gap below this at a grazing is a second touch at the same parameter value."""

ALONG, REPEATS = 1e-3, 1e-7
"""How far along a branch it is seen whether its orbits repeat shorter ones, and how nearly."""


@dataclass(frozen=True)
class Start:
    """Where a branch begins, and which way it leaves.

    Attributes
    ----------
    problem : OrbitProblem
        Of the new word.
    unknowns, tangent : ndarray of shape (n + 1,)
        The tangent is not normalised. At a G it points to where the touch is a physical impact.
    branching : bool
        Whether the start is a branch point of the new problem.
    both_ways : bool
        Whether both directions lead to different orbits.
    """

    problem: OrbitProblem
    unknowns: Array
    tangent: Array
    branching: bool
    both_ways: bool


def switch(event: Event) -> Start | None:
    """Return the start of the branch born at an event.

    Parameters
    ----------
    event : Event
        Of a kind in `SWITCHES`, on a branch of periodic orbits.

    Returns
    -------
    Start or None
        None where nothing can start: a dropped impact was the only one, or the tangent is not
        defined (a degenerate event).
    """
    makers = {"G": _at_grazing, "V": _at_zero_velocity, "PD": _at_doubling, "BP": _at_branch_point}
    return makers[event.kind](event)


def once(start: Start) -> Start:
    """Return a start whose branch is one of shorter orbits run several times as one of these.

    So it is where an orbit of several periods touches in each of them, and where one becomes an
    orbit of a shorter period.
    """
    problem, unknowns, tangent = start.problem, start.unknowns, start.tangent
    ahead = unknowns + ALONG * tangent / np.max(np.abs(tangent))
    shorter, _ = shortest(problem, ahead, REPEATS)
    if shorter is problem:
        return start
    first = np.r_[: shorter.n, problem.n : len(unknowns)]
    return Start(shorter, unknowns[first], tangent[first], False, True)


def touches_at(event: Event) -> list[tuple[int, str, float]]:
    """Return (flight, wall, time) of every touch at a grazing, the event's own first."""
    here: Linearisation = event.point.evaluation
    own = (event.details["flight"], event.details["wall"], event.details["touch_time"])
    others = [
        (t.flight, t.wall, t.time)
        for flight in here.gaps
        for t in flight.touches
        if t is not None and abs(t.gap) < TOUCHING and (t.flight, t.wall) != own[:2]
    ]
    return [own, *others]


def grown_word(event: Event) -> Word:
    """Return the word of a grazing orbit with its touches counted as impacts."""
    word: Word = event.point.evaluation.problem.word
    for flight, wall, _ in _last_first(touches_at(event)):
        word = word.insert(flight, wall)
    return word


def _last_first(touches: list[tuple[int, str, float]]) -> list[tuple[int, str, float]]:
    """In this order, inserting one does not move the places of the others."""
    return sorted(touches, key=lambda touch: (touch[0], touch[2]), reverse=True)


def _at_grazing(event: Event) -> Start | None:
    here: Linearisation = event.point.evaluation
    problem = here.problem
    rows = problem.impacts(here.unknowns)
    own = (event.details["flight"], event.details["touch_time"])
    position = own[0] + 1
    for flight, wall, time in _last_first(touches_at(event)):
        touch = _touch_coordinates(problem, here, flight, wall, time)
        rows = np.insert(rows, flight + 1, touch, axis=0)
        position += (flight, time) < own
    longer = OrbitProblem(problem.model, grown_word(event), problem.kernels)
    start = _regular(longer, rows, here.unknowns[-1])
    if start is None:
        return None
    side = next(w.side for w in problem.model.WALLS if w.name == event.details["wall"])
    inward = start.tangent[longer.m * position + 1] * side
    return start if inward >= 0.0 else _reversed(start)


def _touch_coordinates(
    problem: OrbitProblem, here: Linearisation, flight: int, wall: str, time: float
) -> Array:
    """Time and section coordinates of a touch: zero velocity, the rest where the flight arrives."""
    m = problem.m
    touch = np.zeros(m)
    touch[0] = time
    if m > 2:
        kernel = problem.kernels.flight(problem.word.walls[flight], wall)
        left = problem.impacts(here.unknowns)[flight].tolist()
        out = np.array(kernel(*left, *touch.tolist(), *problem.values(here.unknowns)))
        by_end = out[m + m * m : m + 2 * m * m].reshape(m, m)
        touch[2:] -= np.linalg.lstsq(by_end[:, 2:], out[:m], rcond=None)[0]
    return touch


def _at_zero_velocity(event: Event) -> Start | None:
    here: Linearisation = event.point.evaluation
    problem = here.problem
    if len(problem.word) == 1:
        return None
    impact = event.details["impact"]
    rows = np.delete(problem.impacts(here.unknowns), impact, axis=0)
    shorter = OrbitProblem(problem.model, problem.word.drop(impact), problem.kernels)
    return _regular(shorter, rows, here.unknowns[-1])


def _regular(problem: OrbitProblem, rows: Array, value: float) -> Start | None:
    unknowns = np.append(rows.ravel(), value)
    jacobian = problem.evaluate(unknowns).jacobian
    tangent = first_tangent(jacobian, np.ones(len(unknowns)))
    return None if tangent is None else Start(problem, unknowns, tangent, False, True)


def _reversed(start: Start) -> Start:
    return Start(start.problem, start.unknowns, -start.tangent, start.branching, start.both_ways)


def _at_doubling(event: Event) -> Start:
    here: Linearisation = event.point.evaluation
    problem, word = here.problem, here.problem.word
    null = np.linalg.svd(here.cyclic(-1.0)[:, :-1])[2][-1]
    null *= np.sign(null[np.argmax(np.abs(null))])  # of two equal branches, always the same
    rows = problem.impacts(here.unknowns)
    later = rows.copy()
    later[:, 0] += word.period * problem.kernels.setup(*problem.values(here.unknowns))[0]
    doubled = OrbitProblem(problem.model, Word(word.walls * 2, word.period * 2), problem.kernels)
    unknowns = np.append(np.vstack([rows, later]).ravel(), here.unknowns[-1])
    return Start(doubled, unknowns, np.concatenate([null, -null, [0.0]]), True, False)


def _at_branch_point(event: Event) -> Start | None:
    here: Linearisation = event.point.evaluation
    problem = here.problem
    left, _, right = np.linalg.svd(here.jacobian)
    psi, null = left[:, -1], right[-2:]
    along = [problem.second_along(here.unknowns, vector) for vector in null]
    form = np.array([[float(psi @ row @ vector) for vector in null] for row in along])
    directions = _isotropic(form)
    if directions is None:
        return None
    own = null @ event.point.tangent
    own /= np.linalg.norm(own)
    other = min(directions, key=lambda pair: abs(pair @ own))
    return Start(problem, here.unknowns, other @ null, True, True)


def _isotropic(form: Array) -> list[Array] | None:
    """The two unit vectors on which an indefinite quadratic form in the plane vanishes."""
    sizes, axes = np.linalg.eigh(0.5 * (form + form.T))
    if not sizes[0] < 0.0 < sizes[1] or min(abs(sizes)) < 1e-10 * max(abs(sizes)):
        return None
    angle = np.arctan(np.sqrt(-sizes[0] / sizes[1]))
    return [np.cos(angle) * axes[:, 0] + sign * np.sin(angle) * axes[:, 1] for sign in (1.0, -1.0)]
