"""Symmetry: where a branch runs into its own image, and ends, for beyond all of it comes again.

The images of an orbit are its shifts by whole forcing periods and, where the model has one, its
mirror image. An orbit that is one of its own images is one of a shorter period, or a symmetric one.
A branch of other orbits meets it at a branch point and goes on along its own image.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..bifurcations.branch_point import BranchPoint
from ..continuation.branch import Event, Point, TestFunction
from ..continuation.ends import End, EndKind
from ..continuation.walk import Stop
from ..models.model import Symmetry
from ..orbits.problem import Array, OrbitProblem
from ..orbits.search import mirrored, repeats, rotated_to, shortest

Known = Callable[[OrbitProblem, Array], "str | None"]

AT_IMAGE, OFF_IMAGE = 1e-6, 1e-9
"""How near its image an orbit at a branch point is, and how far from it an ordinary one is."""


def symmetry_of(problem: OrbitProblem) -> Symmetry | None:
    """Return the symmetry the model has along a branch in the followed parameter."""
    model, kernels = problem.model, problem.kernels
    return model.symmetry(problem.parameter, kernels.harmonics(*model.values.values()))


def symmetric(
    problem: OrbitProblem, unknowns: Array, symmetry: Symmetry | None, tolerance: float
) -> bool:
    """Whether an orbit is its own mirror image."""
    if symmetry is None or not problem.word.walls:
        return False
    image = rotated_to(*mirrored(problem, unknowns, symmetry), problem.word)
    if image is None:
        return False
    return bool(np.max(np.abs(problem.difference(image, unknowns))) < tolerance)


def mirrors_back(
    problem: OrbitProblem, unknowns: Array, tangent: Array, symmetry: Symmetry | None
) -> bool:
    """Whether the mirror image of a branch leaves its start as the branch itself, backwards."""
    if symmetry is None or not problem.word.walls:
        return False
    along = 1e-4 * tangent / np.max(np.abs(tangent))
    image = rotated_to(*mirrored(problem, unknowns + along, symmetry), problem.word)
    if image is None:
        return False
    return bool(np.max(np.abs(problem.difference(image, unknowns - along))) < 1e-8)


def again(name: str, point: Point) -> End:
    """Return the end of a branch at a start beyond which its mirror image follows."""
    parameter = point.evaluation.problem.parameter
    known = f"{name} again, as its own mirror image"
    return End.of(EndKind.KNOWN, parameter, point.parameter, known=known)


def at_image(problem: OrbitProblem, known: Known | None = None) -> Stop | None:
    """Return what ends a walk at the branch point where its orbits become images of themselves.

    Parameters
    ----------
    problem : OrbitProblem
    known : callable ``known(problem, unknowns) -> str or None``, optional
        Returns the name of the branch an orbit of shorter period lies on.

    Returns
    -------
    callable or None
        As `stop` of a walk that looks for BP. None where no orbit of the problem can be an image
        of itself.
    """
    if len(problem.word.rotations()) == 1 and symmetry_of(problem) is None:
        return None
    return _AtImage(problem, known)


def watched(tests: Sequence[TestFunction], stop: Stop | None) -> list[TestFunction]:
    """Return the test functions of a walk: those asked for, and that of what `stop` goes by."""
    asked = stop is None or any(isinstance(test, BranchPoint) for test in tests)
    return [*tests, *([] if asked else [BranchPoint()])]


class _AtImage:
    """See `at_image`; nothing ends where orbits are their own images from the first point on."""

    def __init__(self, problem: OrbitProblem, known: Known | None) -> None:
        self.problem, self.known = problem, known
        self.symmetry = symmetry_of(problem)
        self.kinds: list[EndKind] | None = None

    def __call__(self, point: Point, events: Sequence[Event]) -> tuple[End, Point] | None:
        if self.kinds is None:
            own = self.images(point.unknowns, OFF_IMAGE)
            self.kinds = [k for k in (EndKind.SHORTER, EndKind.SYMMETRIC) if k not in own]
        for event in events:
            if event.kind == BranchPoint.kind:
                for kind in self.images(event.point.unknowns, AT_IMAGE):
                    if kind in self.kinds:
                        return self.end(kind, event.point), event.point
        return None

    def images(self, unknowns: Array, tolerance: float) -> list[EndKind]:
        """In which ways an orbit is an image of itself."""
        found = []
        if repeats(self.problem, unknowns, tolerance):
            found.append(EndKind.SHORTER)
        if symmetric(self.problem, unknowns, self.symmetry, tolerance):
            found.append(EndKind.SYMMETRIC)
        return found

    def end(self, kind: EndKind, point: Point) -> End:
        """The end at a branch point."""
        name, value = self.problem.parameter, point.parameter
        if kind is EndKind.SYMMETRIC:
            return End.of(kind, name, value)
        shorter, moved = shortest(self.problem, point.unknowns, AT_IMAGE)
        if self.known is not None and (branch := self.known(shorter, moved)):
            return End.of(EndKind.KNOWN, name, value, known=branch)
        letters = self.problem.model.letters
        times = self.problem.word.period // shorter.word.period
        return End.of(kind, name, value, word=shorter.word.notation(letters), times=times)
