"""The branch that every contestant follows: the 1:1 orbit of the inclined impact pair.

beta = pi/6, r = 0.3, A = 5 N; the capsule's length s falls so that d goes from 0.45 to 0.05. The
start, the stable orbit at d = 0.45, is given to all of them; `auto/impact_pair.f90` repeats it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from contimpact import ImpactPair, Settings
from contimpact.bifurcations.kind import test_functions
from contimpact.continuation.branch import Walk
from contimpact.diagrams.orbit_walks import walk_orbits
from contimpact.models.guards import Word
from contimpact.orbits.problem import Array, OrbitProblem
from contimpact.segments.kernels import Kernels

D_PER_S = 0.6225
RANGE = (0.05 / D_PER_S, 0.45 / D_PER_S)
START = (0.3289672464099905, 0.9099069905380301, 1.4248536390000661, -0.7221992982303381)
"""Time of the impact at the bottom and velocity before it, the same at the top."""

ALL = ("FB", "BP", "PD", "G", "V", "T")
EXPECTED = {"PD": 0.238506821494, "G": 0.204454926485}
"""Where d stands at the events of the branch."""

STEPS = {
    "fixed": Settings(step=0.001024, max_step=0.001024, max_points=5000),
    "adaptive": Settings(),
}
"""The fixed step gives as many points as AUTO's of 0.001 in its own metric."""


def problem(periods: int = 1) -> OrbitProblem:
    """Return the equations of the orbit, run several times to make a longer word."""
    pair = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=RANGE[1])
    return OrbitProblem(pair, Word("BT" * periods, periods), Kernels(pair, "s"))


def start(periods: int = 1) -> Array:
    """Return the unknowns at d = 0.45; every run of the orbit is a period of 2 later."""
    impacts = [(t + 2.0 * k, v) for k in range(periods) for t, v in (START[:2], START[2:])]
    return np.append(np.ravel(impacts), RANGE[1])


def follow(
    equations: OrbitProblem, unknowns: Array, settings: Settings, kinds: Sequence[str] = ALL
) -> Walk:
    """Walk down the range, with the events of some kinds located on the way."""
    tests = test_functions(equations, kinds, {})
    return walk_orbits(equations, unknowns, -1, limits=RANGE, tests=tests, settings=settings)
