"""Contacts with what gives way: how long they last, how deep they go, what velocity they leave."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..arrays import Array, Vector
from ..models.model import Model
from .problem import Linearisation, motion_of

DEGREES = (16, 32, 64, 128)
"""Degrees of the polynomials by which a contact's motion is interpolated, one after the other."""


class Contact(NamedTuple):
    """One contact, from a guard to the one that ends it on the same surface."""

    wall: str
    """The letter at which it begins."""
    time: float
    duration: float
    deflection: float
    """The greatest distance beyond the surface."""
    speed: float
    """Before the contact."""
    restitution: float
    """The velocity of release by that of arrival, with the sign turned."""
    error: float
    """An estimate of the deflection's error."""


def contacts_of(here: Linearisation, model: Model) -> list[Contact]:
    """Return the contacts along an orbit at the model's parameter values."""
    problem, z = here.problem, here.unknowns
    word = problem.word.walls
    places = dict(zip(model.letters, problem.kernels.setup(*problem.values(z)).walls, strict=True))
    flights = [
        k
        for k, (one, other) in enumerate(pairwise(word + word[:1]))
        if _is_contact(model, one, other) and places[one] == places[other]
    ]
    if not flights:
        return []
    speeds = problem.impacts(z)[:, 1].tolist()
    depths = np.zeros(len(flights))
    for degree in DEGREES:
        before, depths = depths, _depths(here, model, flights, places, degree)
        if (abs(depths - before) <= 1e-14 * abs(depths)).all():
            break
    found = []
    for k, depth, error in zip(
        flights, depths.tolist(), abs(depths - before).tolist(), strict=True
    ):
        begin, end = problem.times_around(z, k)
        arriving, leaving = speeds[k], speeds[(k + 1) % len(word)]
        ratio = -leaving / arriving if arriving else np.nan
        found.append(Contact(word[k], begin, end - begin, depth, abs(arriving), ratio, error))
    return found


def _is_contact(model: Model, one: str, other: str) -> bool:
    """Whether a guard leads from the first mode into one that another ends on the way back."""
    begin, end = model.guard(one), model.guard(other)
    back = (end.coordinate, end.side) == (begin.coordinate, -begin.side)
    leads = begin.next_mode in end.modes and begin.next_mode != model.first_mode
    return back and leads and model.first_mode in begin.modes


def _depths(
    here: Linearisation, model: Model, flights: list[int], places: dict[str, float], degree: int
) -> Array:
    """The greatest distances beyond the surfaces, from polynomials of a degree."""
    word = here.problem.word.walls
    parts = (1.0 - np.cos(np.pi * np.arange(degree + 1) / degree)) / 2.0
    motion = np.reshape(motion_of(here, parts).x, (len(word), degree + 1, -1))
    found = []
    for k in flights:
        guard = model.guard(word[k])
        row = np.array(guard.row(model.DEGREES_OF_FREEDOM), dtype=float)
        found.append(_greatest(parts, guard.side * (motion[k] @ row - places[guard.name])))
    return np.array(found)


def _greatest(parts: Vector, values: Vector) -> float:
    """The greatest value of a polynomial that has some at Chebyshev's points on [0, 1]."""
    from numpy.polynomial import chebyshev

    factors = chebyshev.chebfit(2.0 * parts - 1.0, values, len(parts) - 1)
    turns = chebyshev.chebroots(chebyshev.chebder(factors))
    inside = turns[(abs(turns.imag) < 1e-8) & (abs(turns.real) <= 1.0)].real
    return float(np.max(chebyshev.chebval(np.r_[-1.0, inside, 1.0], factors)))
