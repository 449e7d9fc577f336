"""Contacts with what gives way: how long they last, how deep they go, what velocity they leave."""

from __future__ import annotations

from functools import partial
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


def contacts_of(here: Linearisation, model: Model, deep: bool = True) -> list[Contact]:
    """Return the contacts along an orbit at the model's parameter values; unless `deep`, their
    deflections, which take the motion between impacts, are not numbers."""
    problem, z = here.problem, here.unknowns
    word = problem.word.walls
    places = dict(zip(model.letters, problem.kernels.setup(*problem.values(z)).walls, strict=True))
    contacts = _contacts(model, word, places)
    if not contacts:
        return []
    speeds = problem.impacts(z)[:, 1].tolist()
    depths = before = np.full(len(contacts), np.nan)
    for degree in DEGREES if deep else ():
        before, depths = depths, _depths(here, model, contacts, places, degree)
        if (abs(depths - before) <= 1e-14 * abs(depths)).all():
            break
    found = []
    for flights, depth, error in zip(
        contacts, depths.tolist(), abs(depths - before).tolist(), strict=True
    ):
        first, last = flights[0], flights[-1]
        duration = sum(end - begin for begin, end in map(partial(problem.times_around, z), flights))
        begin, _ = problem.times_around(z, first)
        arriving, leaving = speeds[first], speeds[(last + 1) % len(word)]
        ratio = -leaving / arriving if arriving else np.nan
        found.append(Contact(word[first], begin, duration, depth, abs(arriving), ratio, error))
    return found


def _contacts(model: Model, word: str, places: dict[str, float]) -> list[list[int]]:
    """The flights of each contact.

    It begins at a guard that leads away from the first mode, or from those that guards on other
    coordinates lead to from there, and ends at the next guard on its coordinate, if that is the
    same surface on the way back. What can slide on its surface is in no contact there.
    """
    found, switching = [], {guard.coordinate for guard in model.WALLS if guard.past}
    for k, letter in enumerate(word):
        begin = model.guard(letter)
        if begin.coordinate in switching:
            continue
        outside = _modes_around(model, begin.coordinate)
        if begin.next_mode in outside or outside.isdisjoint(begin.modes):
            continue
        for n in range(1, len(word) + 1):
            end = model.guard(word[(k + n) % len(word)])
            if end.coordinate == begin.coordinate:
                if end.side == -begin.side and places[end.name] == places[letter]:
                    found.append([(k + i) % len(word) for i in range(n)])
                break
    return found


def _modes_around(model: Model, coordinate: int | tuple[float, ...]) -> set[str]:
    """The first mode, and those reached from it by guards on other coordinates."""
    found, more = set[str](), {model.first_mode}
    while more:
        found |= more
        others = (g for g in model.WALLS if g.coordinate != coordinate)
        more = {g.next_mode for g in others if found & {*g.modes}} - found
    return found


def _depths(
    here: Linearisation,
    model: Model,
    contacts: list[list[int]],
    places: dict[str, float],
    degree: int,
) -> Array:
    """The greatest distances beyond the surfaces, from polynomials of a degree."""
    word = here.problem.word.walls
    parts = (1.0 - np.cos(np.pi * np.arange(degree + 1) / degree)) / 2.0
    motion = np.reshape(motion_of(here, parts).x, (len(word), degree + 1, -1))
    found = []
    for flights in contacts:
        guard = model.guard(word[flights[0]])
        row = np.array(guard.row(model.DEGREES_OF_FREEDOM), dtype=float)
        beyond = (guard.side * (motion[k] @ row - places[guard.name]) for k in flights)
        found.append(max(_greatest(parts, values) for values in beyond))
    return np.array(found)


def _greatest(parts: Vector, values: Vector) -> float:
    """The greatest value of a polynomial that has some at Chebyshev's points on [0, 1]."""
    from numpy.polynomial import chebyshev

    factors = chebyshev.chebfit(2.0 * parts - 1.0, values, len(parts) - 1)
    turns = chebyshev.chebroots(chebyshev.chebder(factors))
    inside = turns[(abs(turns.imag) < 1e-8) & (abs(turns.real) <= 1.0)].real
    return float(np.max(chebyshev.chebval(np.r_[-1.0, inside, 1.0], factors)))
