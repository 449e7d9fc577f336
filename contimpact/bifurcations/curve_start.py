"""Where a curve in two parameters begins, or passes, that is seen from a point of another curve."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from ..continuation.branch import Details
from ..models.word import Word
from ..orbits.problem import Array, Linearisation
from ..orbits.quiet import problem_of

if TYPE_CHECKING:
    from .extended_system import ExtendedSystem

    Leaves: TypeAlias = Callable[[ExtendedSystem, Array], tuple[Array, Array]]


@dataclass(frozen=True)
class CurveStart:
    """An orbit at a point of codimension two, as one of a curve that begins there or passes.

    Attributes
    ----------
    kind : str
        Of the curve.
    here : Linearisation
        The orbit, with two free parameters.
    details : mapping
        Where on the orbit it happens.
    leaves : callable ``leaves(system, own) -> (orbit, own)``, optional
        Where other solutions of the curve's equations cross it: the direction of the curve, in the
        orbit's unknowns and in those that the equations add, given the equations and the latter.
        Without it the solutions are one curve.
    """

    kind: str
    here: Linearisation
    details: Details = field(default_factory=dict)
    leaves: Leaves | None = None


def twice(here: Linearisation) -> Linearisation:
    """Return an orbit run twice, as one of the doubled word."""
    problem = here.problem
    rows, span = problem.impacts(here.unknowns), here.span
    later = rows.copy()
    later[:, 0] += span
    word = Word(problem.word.walls * 2, problem.word.period * 2)
    doubled = problem_of(problem.model, word, problem.kernels)
    both = np.vstack([rows, later])
    return doubled.evaluate(doubled.with_impacts(both, 2.0 * span, here.unknowns))
