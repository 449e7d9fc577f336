r"""On which side of a bifurcation its new branch lies.

A grazing is supercritical where the orbit with one impact more exists for parameter values at which
the old one is unphysical, and subcritical where both exist together; a fold then follows on the new
branch. The slope of the new impact's velocity decides, with that of the old orbit's gap:

.. math:: \frac{dv}{d\lambda} = \frac{\dot v}{\dot\lambda}\Big|_{new}, \qquad
          \dot g \propto -\sigma\,\partial R_x \cdot \dot z\,|_{old},

both exact, from the tangents: at a touch the gap does not depend on its time, and R_x is the
position residual of the flight to the touch.

A period doubling is supercritical where the doubled orbit exists for values at which the old one
has a multiplier beyond -1. With z = z_0 + a q + a^2 w + ... on one half of the doubled orbit and
z_0 - a q + a^2 w + ... on the other, lambda = lambda_0 + c a^2 solves the equations to third order:

.. math:: C(1) w_0 = -\tfrac12 B[q,q], \quad C(1) z_\lambda = -F_\lambda, \quad
          c = -\frac{\psi \cdot (B[q, w_0] + T[q,q,q]/6)}
                    {\psi \cdot (B[q, z_\lambda] + F_{z\lambda} q)},

with psi the left null vector of C(-1), B and T the second and third derivatives of F, the
directions q continued with the factor -1 over the period (Lyapunov and Schmidt; see Golubitsky and
Schaeffer 1985).
"""

from __future__ import annotations

import numpy as np

from ..continuation.branch import Event, Point
from ..orbits.linearisation import Linearisation
from .switching import Start

SUPER, SUB = "supercritical", "subcritical"


def velocity_slope(event: Event, start: Start) -> float | None:
    """Return dv/dlambda of the impact born at a grazing, v counted towards the wall."""
    speed = _new_speed(event, start)
    rate = float(start.tangent[-1])
    return speed / rate if rate != 0.0 else None


def of_grazing(event: Event, start: Start) -> str | None:
    """Return whether a grazing is super- or subcritical; None if it is degenerate."""
    here: Linearisation = event.point.evaluation
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


def of_doubling(event: Event, before: Point, after: Point) -> str | None:
    """Return whether a period doubling is super- or subcritical; None if it cannot be told.

    Parameters
    ----------
    event : Event
    before, after : Point
        The branch's points around the event, between which it does not fold.
    """
    value = event.parameter
    bend = doubling_bend(event.point.evaluation)
    if not bend or (before.parameter - value) * (after.parameter - value) >= 0.0:
        return None
    before_is_there = (before.parameter - value) * bend > 0.0
    there, other = (before, after) if before_is_there else (after, before)
    unstable = [p.evaluation.n_unstable for p in (there, other)]
    if unstable[0] == unstable[1]:
        return None
    return SUPER if unstable[0] > unstable[1] else SUB


def doubling_bend(here: Linearisation) -> float:
    """Return c of lambda = lambda_0 + c a^2 on the branch born at a period doubling.

    Parameters
    ----------
    here : Linearisation
        The orbit at its period doubling. Its first free parameter is lambda.
    """
    problem, n = here.problem, here.problem.n
    left, _, right = np.linalg.svd(here.cyclic(-1.0)[:, :n])
    psi, q = left[:, -1], right[-1]
    along = np.concatenate([q, np.zeros(problem.free)])
    mixed = problem.second_along(here.unknowns, along, -1.0)
    squared = problem.second_along(here.unknowns, along, -1.0, beside=-1.0)[:, :n] @ q
    cubed = problem.third_along(here.unknowns, q, -1.0)
    periodic = here.cyclic(1.0)[:, :n]
    bent, moved = np.linalg.solve(
        periodic, np.column_stack([-0.5 * squared, -here.by_parameter[:, 0]])
    ).T
    crossing = psi @ (mixed[:, :n] @ moved + mixed[:, n])
    return float(-psi @ (mixed[:, :n] @ bent + cubed / 6.0) / crossing)


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
