"""Natural continuation: the same equations, solved anew at each s from the solution before.

It needs no derivative by s and no arclength, and it cannot pass a fold; this branch has none.
"""

from __future__ import annotations

import math
import statistics

import numpy as np
from case import D_PER_S, RANGE, START
from contestant import Contestant, Sample, Workspace, seconds_of
from scipy.optimize import root

from contimpact.orbits.problem import Array

POINTS = 1188
WALKS = 3
R = 0.3
G = 0.1245 * 9.8 * math.sin(math.pi / 6) / 5.0
ROW = "scipy.optimize.root, natural"


def contestants(workspace: Workspace) -> list[Contestant]:
    """Return the one of this subject."""

    def measure() -> list[Sample]:
        return [Sample("fixed", ROW, workspace.call("natural.walks"), POINTS)]

    return [Contestant("natural continuation", measure)]


# In the child.


def walks() -> float:
    """Time walks along the branch; the first one is left out."""
    follow()
    return statistics.median(seconds_of(follow)[0] for _ in range(WALKS))


def follow() -> list[list[float]]:
    """Return the points from d = 0.45 to 0.05: the unknowns and s."""
    z, points = np.array(START), []
    for s in np.linspace(RANGE[1], RANGE[0], POINTS).tolist():
        found = root(residual, z, (s,), method="hybr", jac=jacobian, tol=1e-12)
        z = found.x
        points.append([*z.tolist(), s])
    return points


def residual(z: Array, s: float) -> Array:
    """Return the residuals of both flights; `auto/impact_pair.f90` says the formulas."""
    t0, v0, t1, v1 = z.tolist()
    d = D_PER_S * s
    return np.array([*flight(t0, v0, t1, v1, -d), *flight(t1, v1, t0 + 2.0, v0, d)])


def jacobian(z: Array, s: float) -> Array:
    """Return their derivatives by the unknowns."""
    t0, v0, t1, v1 = z.tolist()
    up, down = slopes(t0, v0, t1), slopes(t1, v1, t0 + 2.0)
    return np.array(
        [[*up[0], *up[2]], [*up[1], *up[3]], [*down[2], *down[0]], [*down[3], *down[1]]]
    )


def flight(t0: float, v0: float, t1: float, v1: float, x: float) -> tuple[float, float]:
    """Return the residual of the flight over the displacement x."""
    pi, h = math.pi, t1 - t0
    waves = (math.cos(pi * t1) - math.cos(pi * t0)) / pi**2 + h * math.sin(pi * t0) / pi
    arrival = (math.sin(pi * t1) - math.sin(pi * t0)) / pi
    return -R * v0 * h + 0.5 * G * h * h - waves - x, -R * v0 + G * h + arrival - v1


def slopes(t0: float, v0: float, t1: float) -> tuple[tuple[float, float], ...]:
    """Return its derivatives: two rows by the impact left, two by the one reached."""
    pi, h = math.pi, t1 - t0
    leaving, reaching = math.cos(pi * t0), math.cos(pi * t1)
    speed = -R * v0 + G * h + (math.sin(pi * t1) - math.sin(pi * t0)) / pi
    start = (R * v0 - G * h - h * leaving, -R * h), (-G - leaving, -R)
    return (*start, (speed, 0.0), (G + reaching, -1.0))
