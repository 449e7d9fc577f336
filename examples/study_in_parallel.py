"""A study from Python: the stable 2:1 orbit over the angle of the capsule, on all processors.

    python examples/study_in_parallel.py

Models, orbits and branches can be pickled, so any pool of processes will do. For each angle the
range of s is printed in which the 2:1 orbit can be observed, and what bounds it.
"""

import math
from concurrent.futures import ProcessPoolExecutor

import contimpact as ci


def observed(degrees):
    """Return the branch of the stable 2:1 orbit nearest to s = 0.34, or None."""
    pair = ci.ImpactPair(beta=math.radians(degrees), r=0.3, A=5.0, s=0.34)
    orbits = ci.find_orbits(pair, "2:1", parameter="s", starts=64)
    orbit = next((o for o in orbits if o.stable and o.physical), None)
    if orbit is None:
        return None
    return ci.continue_orbit(orbit, "s", range=(0.1, 1.0), events=["FB", "PD", "G"])


if __name__ == "__main__":
    angles = [25, 30, 35, 40]
    with ProcessPoolExecutor() as pool:
        branches = list(pool.map(observed, angles))
    for degrees, branch in zip(angles, branches, strict=True):
        if branch is None:
            print(f"{degrees} degrees: no stable 2:1 orbit at s = 0.34")
            continue
        labels = {event.id: event.label for event in branch.events}
        for interval in ci.stable_intervals(branch):
            bounds = " to ".join(labels.get(b, "end") for b in interval.bounds)
            print(f"{degrees} degrees: s from {interval.low:.6f} to {interval.high:.6f} ({bounds})")
