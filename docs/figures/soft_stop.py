"""Draw the soft stop's way to the rigid one, for its page of the documentation.

    python docs/figures/soft_stop.py

Prints what it draws on the right: for some decades of the stiffness and tolerances of the
corrector, what a point takes, plainly, and how far points are off orbits in thirty digits.
"""

import math
import os
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import contimpact as ci
from contimpact.accuracy.reference import Reference
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.soft_stop import SoftStop

OUTER = {"a": 1.0, "omega": 1.3, "c": 0.1, "k": 1.0}
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14)
REPEATED = 5


def physical(model, word, parameter):
    """The orbit that exists."""
    return next(o for o in ci.find_orbits(model, word, parameter=parameter) if o.physical)


def stretch(branch, low, tolerance):
    """Microseconds a point, and the largest error, from a stiffness to ten times as much."""
    start = branch.orbit(int(np.argmin(np.abs(np.log(branch["k_b"] / (3.0 * low))))))
    settings = ci.Settings(tolerance=tolerance, max_step=0.02, step=0.02, max_points=60)
    seconds = []
    for _ in range(REPEATED):
        began = time.process_time()
        part = ci.continue_orbit(start, range=(low, 10.0 * low), events=[], settings=settings)
        seconds.append((time.process_time() - began) / len(part))
    rows = range(0, len(part), max(1, len(part) // 8))
    columns = ("t1", "v1", "t2", "v2", "k_b")
    orbits = [np.array([part[name][row] for name in columns]) for row in rows]
    exact = Reference(start.problem)
    return 1e6 * min(seconds), max(exact.orbit(z).distance(z) for z in orbits)


def main():
    os.environ["CONTIMPACT_COMPILED"] = "never"
    soft = physical(SoftStop(**OUTER, e=0.5, k_b=20.0, c_b=0.0), "CR", "k_b")
    rigid = physical(Oscillator(**OUTER, sigma=0.5, r=1.0), "S", "a")
    branch = ci.continue_orbit(soft, "k_b", range=(1.0, 1e8), events=["FB", "PD", "G", "V"])
    stiffness, period = branch["k_b"], 2.0 * math.pi / OUTER["omega"]
    late = branch["t1"] - rigid.times[0]
    late = np.abs(late - period * np.round(late / period))
    faster = np.abs(branch["v1"] - rigid.velocities[0])
    figure = Figure(figsize=(10.0, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.loglog(stiffness, late, "o-", markersize=3, label="of the time of contact")
    left.loglog(stiffness, faster, "s-", markersize=3, label="of the velocity")
    left.loglog(stiffness, 4.0 * stiffness**-0.5, "k:", label="$k_b^{-1/2}$")
    left.set(xlabel="$k_b$", ylabel="difference from the rigid stop")
    left.legend(fontsize=8)
    for low, marker in ((1e1, "o"), (1e4, "s"), (1e7, "^")):
        found = [stretch(branch, low, tolerance) for tolerance in TOLERANCES]
        for tolerance, (took, error) in zip(TOLERANCES, found, strict=True):
            print(f"k_b from {low:.0e}, {tolerance:.0e}: {took:.0f} us a point, off {error:.1e}")
        label = f"$k_b = 10^{{{int(math.log10(low))}}}$ to $10^{{{int(math.log10(low)) + 1}}}$"
        right.semilogy(*zip(*found, strict=True), marker + "-", markersize=4, label=label)
    right.set(xlabel="microseconds a point", ylabel="largest error", xlim=(0.0, None))
    right.legend(fontsize=8)
    file = Path(__file__).parent / "soft-stop.png"
    figure.savefig(file, dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()
