r"""Where two branches cross, or pass each other without meeting.

A symmetry or a coincidence makes branches cross. Without it they come close and turn away, each
onto the other's way, as hyperbolas do. Both cases have a point where

.. math:: F + \nu\psi = 0, \quad J^{\mathsf T}\psi = 0, \quad \psi\cdot\psi = 1;

the branches cross if :math:`\nu` vanishes. Otherwise :math:`\nu` unfolds the crossing, and with
:math:`h` the eigenvalue of :math:`\psi\cdot F_{zz}` on the null space that has its sign, and
:math:`h'` the other one, the branches pass each other at a distance of
:math:`d = 2\sqrt{2\nu/h}`, in turns of radius :math:`|h/h'|\,d/2`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ..arrays import Array
from .branch import Point, Problem, Refusal, RefusalDetails
from .corrector import Arc, length
from .settings import Settings
from .step import EVENLY, Notice

NARROWING, GLANCES = 12, 2
"""How often a step is halved towards the place where its orientation flips, and where it does
not."""

SHARP, SHORT, ROUNDED = 0.1, 0.02, 4.0
"""Where another branch passes: the residual a point may have as a part of nu, and the shortest step
as a part of the turn's radius; where it crosses: the residual as a part of the error of nu."""

TURN = 0.25
"""A step along a turn beside a near miss is at most this part of the distance."""

HIDDEN = 0.25
"""How near to a crossing no point is taken, as part of the distance that the error of nu makes: a
bound, which is seldom reached."""

BESIDE, BLURRED = 4.0, 30.0
"""Where another branch passes: the distance below which steps are made one by one, in lengths of
the step that led there; and that below which they are made sharply, in distances, or in what a
point's residual makes of them."""


@dataclass(frozen=True, eq=False)
class Meeting:
    """Where two branches cross or come closest."""

    unknowns: Array
    """Shape (n + 1,)."""
    nu: float
    nu_error: float
    """`nu`, `nu_error`: what unfolds the crossing, and its estimated error."""
    sizes: tuple[float, float]
    """The eigenvalues' absolute values, in the metric."""
    unit: float
    """The nu whose residual has its natural size."""

    @property
    def distance(self) -> float:
        """Between the branches, in the metric."""
        return self.apart(self.nu)

    def apart(self, nu: float) -> float:
        """The distance that another nu would make."""
        return 2.0 * float(np.sqrt(2.0 * abs(nu) / self.sizes[0]))

    def blurred(self, settings: Settings) -> float:
        """How near to the meeting the residual of a point hides which branch it is on."""
        return self.apart(max(settings.tolerance * self.unit, abs(self.nu)))

    @property
    def hidden(self) -> float:
        """How near to a crossing rounding decides which branch a point is on, and steps from it
        lead anywhere; zero where branches do not cross."""
        return HIDDEN * self.apart(self.nu_error) if self.crosses else 0.0

    def hides(self, here: Point, scale: Array) -> bool:
        """Whether a point is as near as that."""
        return length(here.unknowns - self.unknowns, scale) < self.hidden

    @property
    def radius(self) -> float:
        """Of the branches' sharpest turns, in the metric."""
        return 0.5 * self.distance * self.sizes[0] / self.sizes[1]

    @property
    def crosses(self) -> bool:
        """Whether the branches cross, as far as can be told."""
        return abs(self.nu) <= self.nu_error

    @property
    def parameter(self) -> float:
        """Value of the free parameter."""
        return float(self.unknowns[-1])

    def __str__(self) -> str:
        return f"{self.distance:.2g} (nu = {self.nu:.2g} +- {self.nu_error:.1g})"


Find = Callable[[Problem, Point, Array], Meeting | None]
"""``find(problem, guess, scale)`` solves for the meeting of branches next to a point."""


def meeting_on(arc: Arc, find: Find, most: int = NARROWING) -> Meeting | None:
    """Return the meeting on an arc, or that hides its right end; None if none is found.

    From ever closer points, by bisection on the orientation, where it flips.
    """
    a, b = 0.0, 1.0
    for _ in range(most):
        middle = 0.5 * (a + b)
        guess = arc.at(middle)
        near = guess or arc.near(middle)
        found = find(arc.problem, near, arc.scale) if near else None
        if found is not None and reaches(arc, found):
            return found
        if guess is None:
            return None
        if (guess.orientation >= 0.0) == (arc.left.orientation >= 0.0):
            a = middle
        else:
            b = middle
    return None


def reaches(arc: Arc, meeting: Meeting) -> bool:
    """Whether a meeting is on an arc, or hides its right end."""
    return arc.holds(meeting.unknowns) or meeting.hides(arc.right, arc.scale)


def decays(arc: Arc) -> bool:
    """Whether the orientation changes by one factor all along an arc, as that of long words does,
    which is a product over all flights: then it was not about to vanish.

    Where branches cross, it falls towards the crossing in proportion to the distance, and no such
    fall on one side and rise on the other has these values at both places.
    """
    left, right = arc.left.orientation, arc.right.orientation
    for part in (0.25, 0.5):
        point, expected = arc.at(part), left * (right / left) ** part
        if point is None or not abs(point.orientation - expected) <= EVENLY * abs(expected):
            return False
    return True


@dataclass(eq=False)
class MeetingRecord:
    """The meetings of branches a walk has come to, and had to be careful at.

    Next to them it goes on step by step, to points as exact as rounding or nu asks for, and beside
    a near miss in steps as short as the turn needs.
    """

    find: Find | None = None
    known: list[tuple[Meeting, float]] = field(default_factory=list)

    def refuse(self, arc: Arc, notices: Notice) -> RefusalDetails | None:
        """Why a step is refused that may have led to another branch; None if it has not.

        The orientation flips where the step passes two branches that cross, and where it lands on
        another branch. From one branch to another that crosses it the step may lead without a
        flip; then the orientation was about to vanish, and has not.
        """
        if Notice.FLIPS in notices:
            return self.flipped(arc)
        return self.dipped(arc) if Notice.DIPS in notices else None

    def met(self, arc: Arc) -> Meeting | None:
        """The known meeting on an arc, or that hides its right end, if there is one."""
        return next((m for m, _ in self.known if reaches(arc, m)), None)

    def flipped(self, arc: Arc) -> RefusalDetails | None:
        """The same where the orientation flips; bisection decides where no meeting is found."""
        found = self.met(arc) or (meeting_on(arc, self.find) if self.find else None)
        if found is None:
            return None if arc.connected() else RefusalDetails(Refusal.JUMPS)
        if found.crosses and not found.hides(arc.right, arc.scale):
            return None
        self.keep(arc, found)
        return RefusalDetails(Refusal.JUMPS if found.crosses else Refusal.PASSES)

    def dipped(self, arc: Arc) -> RefusalDetails | None:
        """The same where it does not: the step is short, or no meeting lies on it."""
        found = self.met(arc)
        if found is None and self.find is not None and not decays(arc):
            found = meeting_on(arc, self.find, GLANCES)
        if found is None:
            return None
        if found.crosses:
            self.keep(arc, found)
            return RefusalDetails(Refusal.JUMPS)
        chord = arc.right.arclength - arc.left.arclength
        if chord <= TURN * found.distance:
            return None
        self.keep(arc, found)
        return RefusalDetails(Refusal.PASSES)

    def keep(self, arc: Arc, meeting: Meeting) -> None:
        """Keep a meeting in mind."""
        chord = arc.right.arclength - arc.left.arclength
        if all(known is not meeting for known, _ in self.known):
            self.known.append((meeting, BESIDE * max(chord, meeting.distance)))

    def look(self, problem: Problem, here: Point, scale: Array, settings: Settings) -> float:
        """Look for a meeting next to a point from which no step leads on.

        Returns a step to try, half as long as the way there; zero where there is no other meeting
        so near that it matters.
        """
        found = self.find(problem, here, scale) if self.find else None
        if found is None or self.near(here, scale) is not None:
            return 0.0
        away = length(here.unknowns - found.unknowns, scale)
        if away > BLURRED * found.blurred(settings):
            return 0.0
        self.known.append((found, BESIDE * max(away, found.distance)))
        return 0.5 * away

    def leap(self, arc: Arc) -> float:
        """How long a step is that passes the crossing which hides an arc's right end; zero where
        none does."""
        for meeting, _ in self.known:
            if meeting.hides(arc.right, arc.scale):
                away = length(arc.left.unknowns - meeting.unknowns, arc.scale)
                return away + 2.0 * meeting.hidden
        return 0.0

    def near(self, here: Point, scale: Array) -> Meeting | None:
        """The near miss next to a point, if there is one."""
        for meeting, reach in self.known:
            if length(here.unknowns - meeting.unknowns, scale) < reach:
                return meeting
        return None

    def numerics(self, here: Point, scale: Array, settings: Settings) -> Settings:
        """The settings at a point."""
        near = self.near(here, scale)
        if near is None:
            return settings
        if length(here.unknowns - near.unknowns, scale) > BLURRED * near.blurred(settings):
            return settings
        if near.crosses:
            sharp, shortest = ROUNDED * near.nu_error, settings.min_step
        else:
            sharp, shortest = SHARP * abs(near.nu), SHORT * min(near.radius, near.distance)
            shortest = min(shortest, settings.min_step)
        sharpest = min(settings.tolerance, sharp / near.unit)
        return replace(settings, tolerance=sharpest, min_step=shortest)

    def notes(self, parameter: str) -> list[str]:
        """What a user reads of them."""
        return [
            f"another branch passes at {parameter} = {meeting.parameter:.12g} at a distance of "
            f"{meeting}"
            for meeting, _ in self.known
            if not meeting.crosses
        ]
