r"""What is seen beyond the grazing of a stable orbit, from Nordmark's normal form.

Let y be the smallest gap of a flight to the wall that it grazes, and t the time of it. An impact at
y < 0 leaves both as if the flight had come to its smallest gap earlier, by

.. math:: (1 + r)\, v / \alpha, \qquad v = \sqrt{-2 \alpha y},

alpha the acceleration away from the wall; changes of y itself are of higher order. The rest of the
cycle is smooth. With A its linearisation in (y, t), of the trace tau and the determinant delta,

.. math:: u \mapsto A u \;\; (y \ge 0), \qquad
          u \mapsto A \bigl(u - (0,\, (1 + r) \sqrt{-2 y / \alpha})\bigr) \;\; (y < 0)

beside the orbit, which is at y = -epsilon beyond its grazing. An impact at y < 0 changes the n-th
gap after it by

.. math:: \kappa\, U_n \sqrt{-y}, \qquad
          U_0 = 0, \quad U_1 = 1, \quad U_{n+1} = \tau U_n - \delta U_{n-1} .

All follows from tau, delta and the sign of kappa; its square is the unit of epsilon. Where an image
U_n is on the side of the wall, a gap of epsilon becomes one of its root: the motion *jumps* to
an attractor that does not shrink to the grazing orbit. Otherwise, with kappa > 0 and real
multipliers, the larger one lambda > 0, the motion stays near. Orbits with one impact in n
cycles have the depth w^2, epsilon = w^2 + kappa b_n w, and are stable in *windows* between a period
doubling and a grazing one cycle before the impact. For large n these are

.. math:: \tfrac34 < \epsilon / (\kappa U_n)^2 < (1 - \lambda) / \lambda^2,

so that they overlap for lambda < 1/4, leave chaos between for lambda < 2/3, and are empty above.
What is neglected moves their ends by parts of the order of U_n. A jump is finite, so that on its
end the terms neglected have as much influence.

References: A. B. Nordmark, Phys. Rev. E 55 (1997) 266; W. Chin, E. Ott, H. E. Nusse and
C. Grebogi, Phys. Rev. E 50 (1994) 4427; M. H. Fredriksson and A. B. Nordmark, Proc. R. Soc. Lond. A
453 (1997) 1261; di Bernardo, Budd, Champneys and Kowalczyk, Piecewise-smooth Dynamical Systems
(2008), chapters 4 and 6.
"""

from __future__ import annotations

import math

import numpy as np

from ..models.guards import Guard
from ..models.word import Word
from ..orbits.multipliers import count_unstable
from ..orbits.problem import Linearisation
from ..segments.segment import ELSEWHERE
from .extended_system import OrbitEvent
from .kind import Scenario, Start, Window
from .sliding import SlidingTouch

OVERLAP, CHAOS, IMMEDIATE, JUMP, UNDECIDED = (
    "overlapping period adding",
    "period adding with chaos between",
    "immediate chaos",
    "jump",
    "not decided",
)
"""Names of scenarios."""

OVERLAPPING, EMPTY = 1.0 / 4.0, 2.0 / 3.0
"""Multipliers below which windows overlap, and above which they are empty, for large n."""

FIRST_WINDOWS = 5
"""Windows given."""

LONGEST = 40
"""Most cycles per impact of the orbits tried."""

SUPERSTABLE = 1e-9
"""Multipliers below this tell no scenario: all images of an impact vanish together. Nor do those
as near to one."""


def scenario_of(event: OrbitEvent, start: Start | None, touches: int) -> Scenario:
    """Return what is seen beyond a grazing of so many touches at once; the start is that of the
    branch with the touch as an impact."""
    here: Linearisation = event.point.evaluation
    if start is None or (reason := _refusal(event, touches)):
        return Scenario(UNDECIDED, reason if start is not None else "no branch is born")
    multipliers = here.multipliers
    trace, determinant = float(np.sum(multipliers).real), float(np.prod(multipliers).real)
    longer = start.problem.evaluate(start.unknowns)
    if here.blocks.together or longer.blocks.together:
        return Scenario(UNDECIDED, "flights are computed in pieces", trace, determinant)
    try:
        coefficient, rate = square_root_coefficient(event, longer), gap_rate(event)
    except (ArithmeticError, np.linalg.LinAlgError):
        return Scenario(UNDECIDED, "the linearised flights are singular", trace, determinant)
    given = trace, determinant, coefficient, rate
    largest = float(np.max(np.abs(multipliers)))
    if largest < SUPERSTABLE or largest > 1.0 - SUPERSTABLE:
        what = "all multipliers vanish" if largest < 0.5 else "a multiplier is of size one"
        return Scenario(UNDECIDED, what, *given)
    if not (math.isfinite(coefficient) and coefficient and math.isfinite(rate) and rate):
        return Scenario(UNDECIDED, "the square root or the gap's rate vanishes", *given)
    name, found = predict(trace, determinant, coefficient > 0.0)
    scale, value = -(coefficient**2) / rate, float(here.unknowns[-1])
    short, long = here.problem.word, longer.problem.word
    seen = []
    for n, ends in found:
        low, high = sorted(value + scale * end for end in ends)
        word = Word(short.walls * (n - 1) + long.walls, n * short.period)
        notation = word.notation(here.problem.model.letters)
        seen.append(Window(n, notation, _finite(low), _finite(high)))
    return Scenario(name, None, *given, tuple(seen))


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _refusal(event: OrbitEvent, touches: int) -> str:
    """Why the normal form does not apply, or an empty text."""
    here: Linearisation = event.point.evaluation
    problem = here.problem
    guard = problem.model.guard(event.details["wall"])
    if problem.autonomous:
        return "without forcing, an impact leaves no square root"
    if problem.m != 2:
        return f"the return map has {problem.m} dimensions"
    if not guard.rigid:
        return "the wall gives way"
    if touches != 1 or "impact" in event.details:
        return f"{touches} touches at once" if touches != 1 else "the touch begins a flight"
    if problem.lost or count_unstable(here.multipliers):
        return "the orbit is not stable" if not problem.lost else "the orbit slides"
    return ""


# The normal form of an orbit.


def square_root_coefficient(event: OrbitEvent, longer: Linearisation) -> float:
    """Return kappa: a gap y < 0 at the touch becomes kappa sqrt(-y) a cycle later. The longer orbit
    has the touch as an impact."""
    problem = longer.problem
    count = len(problem.word)
    touch = (event.details["flight"] + 1) % count
    last = (touch - 1) % count
    side = float(problem.model.guard(event.details["wall"]).side)
    away = side * float(longer.end[last, 1, 0] / longer.end[last, 1, 1])  # alpha
    moved = np.array([-1.0 / away, side])  # time and velocity of an impact, over its speed
    for k in range(touch, touch + count - 1):
        moved = -np.linalg.solve(longer.end[k % count], longer.start[k % count] @ moved)
    gap = -side * float(longer.start[last, 0] @ moved)
    if problem.arrivals[last] != ELSEWHERE:  # its row is over the duration
        begin, end = problem.times_around(longer.unknowns, last)
        gap *= end - begin
    return gap * math.sqrt(2.0 * away) if away > 0.0 else math.nan


def gap_rate(event: OrbitEvent) -> float:
    """Return the derivative of the grazing flight's smallest gap by the parameter."""
    here: Linearisation = event.point.evaluation
    problem, details = here.problem, event.details
    guard: Guard = problem.model.guard(details["wall"])
    jacobian, n = here.jacobian, problem.n
    along = np.append(-np.linalg.solve(jacobian[:, :n], jacobian[:, n]), 1.0)
    system = SlidingTouch(problem, details["flight"], details["wall"], details["touch_time"])
    _, start, _, by_parameter = system.arrival(here, system.start(here))
    rate = float(start[0] @ along[system.left] + by_parameter[0, 0])
    if problem.word.walls:
        left = problem.word.walls[details["flight"]]
        if problem.kernels.arrival(left, details["wall"]) != ELSEWHERE:
            rate *= details["touch_time"] - problem.times_around(here.unknowns, system.flight)[0]
    return -guard.side * rate


# What the normal form does.


def predict(
    trace: float, determinant: float, away: bool
) -> tuple[str, list[tuple[int, tuple[float, float]]]]:
    """Return the scenario of a normal form with a stable orbit, and its windows: cycles per impact,
    and the range of epsilon over the square of kappa, as of `Scenario`. It is `away` where kappa >
    0: a cycle after the impact the gap is larger."""
    discriminant = trace * trace - 4.0 * determinant
    larger = 0.5 * (trace + math.sqrt(discriminant)) if discriminant >= 0.0 else math.nan
    found = windows(trace, determinant, away)
    if not (away and larger > 0.0 and trace > 0.0):
        return JUMP, [(n, ends) for n, ends in found if ends[0] < 0.0 < ends[1]]
    if larger >= EMPTY:
        return IMMEDIATE, found[:FIRST_WINDOWS]
    return (OVERLAP if larger < OVERLAPPING else CHAOS), found[:FIRST_WINDOWS]


def windows(trace: float, determinant: float, away: bool) -> list[tuple[int, tuple[float, float]]]:
    r"""Return where orbits with one impact in n cycles are stable in a normal form.

    Returns
    -------
    list of (int, (float, float))
        n, and the range of epsilon over the square of kappa.

    Notes
    -----
    With s the sign of kappa, w the root of the impact's depth over kappa, T_n the trace of A^n and
    D_n = 1 - T_n + delta^n, the orbit has

    .. math:: \epsilon = w^2 + s b_n w, \qquad b_n = U_n / D_n,

    the trace :math:`T_n - s U_n / (2 w)` and the determinant delta^n. Its gap after j < n cycles is
    :math:`s a_j w - \epsilon` with :math:`a_j = (U_j + \delta^j U_{n-j}) / D_n`.
    """
    sign = 1.0 if away else -1.0
    images, traces = images_of(trace, determinant, LONGEST)
    found = []
    for n in range(1, LONGEST + 1):
        power = determinant**n
        regular = 1.0 - traces[n] + power
        image = sign * images[n]
        bend = image / regular
        least = image / (1.0 + traces[n] + power) if image > 0.0 else -bend
        others = (
            sign * (images[j] + determinant**j * images[n - j]) / regular for j in range(1, n)
        )
        low, high = 0.5 * least, min(others, default=math.inf) - bend
        if 0.0 < low < high:
            found.append((n, (low * (low + bend), high * (high + bend))))
    return found


def images_of(trace: float, determinant: float, count: int) -> tuple[list[float], list[float]]:
    """Return U_n, and the traces of A^n, for n from 0 to a number."""
    images, traces = [0.0, 1.0], [2.0, trace]
    for _ in range(count - 1):
        images.append(trace * images[-1] - determinant * images[-2])
        traces.append(trace * traces[-1] - determinant * traces[-2])
    return images, traces
