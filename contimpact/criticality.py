r"""On which side of a bifurcation its new branch lies.

A grazing is supercritical where the orbit with one impact more exists for parameter values at which
the old one is unphysical, and subcritical where both exist together; a fold then follows on the new
branch. The slope of the new impact's velocity decides, with that of the old orbit's gap:

.. math:: \frac{dv}{d\lambda} = \frac{\dot v}{\dot\lambda}\Big|_{new}, \qquad
          \dot g \propto -\sigma\,\partial R_x \cdot \dot z\,|_{old},

both exact, from the tangents: at a touch the gap does not depend on its time, and R_x is the
position residual of the flight to the touch.

A period doubling is supercritical where the doubled orbit exists for values at which the old one
has a multiplier beyond -1. The doubled branch leaves as lambda = lambda_0 + c a^2; the sign of c is
that of its first points, at two amplitudes a.
"""

from __future__ import annotations

import numpy as np

from .continuation.arclength import Settings, correct, length
from .continuation.branch import Event, Point
from .mechanics.orbit import Linearisation
from .switching import Start

SUPER, SUB = "supercritical", "subcritical"
AMPLITUDES = (1e-2, 3e-3)


def velocity_slope(event: Event, start: Start) -> float | None:
    """Return dv/dlambda of the impact born at a grazing, v counted towards the wall."""
    speed = _new_speed(event, start)
    rate = float(start.tangent[-1])
    return speed / rate if rate != 0.0 else None


def of_grazing(event: Event, start: Start) -> str | None:
    """Return whether a grazing is super- or subcritical; None if it is degenerate."""
    here: Linearisation = event.point.evaluation  # type: ignore[assignment]
    problem, flight, wall = here.problem, event.details["flight"], event.details["wall"]
    m = problem.m
    own = slice(m * flight, m * flight + m)
    touch = _touch_row(start, event)
    kernel = problem.kernels.flight(problem.word.walls[flight], wall)
    left = problem.impacts(here.unknowns)[flight].tolist()
    out = np.array(kernel(*left, *touch.tolist(), *problem.values(here.unknowns)))
    along = event.point.tangent
    position_rate = float(out[m : 2 * m] @ along[own] + out[m + 2 * m * m] * along[-1])
    side = next(w.side for w in problem.model.WALLS if w.name == wall)
    old, new = -side * position_rate * along[-1], _new_speed(event, start) * start.tangent[-1]
    if old == 0.0 or new == 0.0:
        return None
    return SUB if (old > 0.0) == (new > 0.0) else SUPER


def of_doubling(event: Event, start: Start, before: Point, after: Point) -> str | None:
    """Return whether a period doubling is super- or subcritical; None if it cannot be told.

    Parameters
    ----------
    event : Event
    start : Start
        Of the doubled branch.
    before, after : Point
        The branch's points around the event, between which it does not fold.
    """
    value = event.parameter
    if (before.parameter - value) * (after.parameter - value) >= 0.0:
        return None
    sides = [_doubled_side(start, amplitude) for amplitude in AMPLITUDES]
    if sides[0] != sides[1] or sides[0] == 0:
        return None
    there, other = (
        (before, after) if (before.parameter - value) * sides[0] > 0.0 else (after, before)
    )
    unstable = [p.evaluation.n_unstable for p in (there, other)]  # type: ignore[attr-defined]
    if unstable[0] == unstable[1]:
        return None
    return SUPER if unstable[0] > unstable[1] else SUB


def _doubled_side(start: Start, amplitude: float) -> int:
    """The sign of lambda - lambda_0 on the doubled branch at an amplitude, 0 if not reached."""
    value = float(start.unknowns[-1])
    scale = start.problem.scale(start.unknowns, max(abs(value), 1.0))
    step = amplitude * start.tangent / length(start.tangent, scale)
    settings = Settings(tolerance=1e-13)
    result = correct(start.problem, start.unknowns + step, step / scale**2, scale, settings)
    if result.evaluation is None:
        return 0
    return int(np.sign(result.evaluation.unknowns[-1] - value))


def _touch_row(start: Start, event: Event) -> np.ndarray:
    rows = start.problem.impacts(start.unknowns)
    return np.asarray(rows[np.argmin(np.abs(rows[:, 0] - event.details["touch_time"]))])


def _new_speed(event: Event, start: Start) -> float:
    """The rate of the new impact's velocity towards its wall, along the new branch."""
    problem = start.problem
    rows = problem.impacts(start.unknowns)
    impact = int(np.argmin(np.abs(rows[:, 0] - event.details["touch_time"])))
    side = next(w.side for w in problem.model.WALLS if w.name == event.details["wall"])
    return side * float(start.tangent[problem.m * impact + 1])
