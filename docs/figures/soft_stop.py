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
from contimpact.plots.diagram import COLOURS
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.soft_stop import SoftStop

OUTER = {"a": 1.0, "omega": 1.3, "c": 0.1, "k": 1.0}
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14)
REPEATED = 15


def physical(model, word, parameter):
    """The orbit that exists."""
    return next(o for o in ci.find_orbits(model, word, parameter=parameter) if o.physical)


def stretch(branch, low, tolerance):
    """Microseconds a point, and the largest error, from a stiffness to ten times as much."""
    start = branch.orbit(int(np.argmin(np.abs(np.log(branch["k_b"] / (3.0 * low))))))
    settings = ci.Settings(tolerance=tolerance, max_step=0.02, step=0.02, max_points=60)
    seconds = []
    for _ in range(REPEATED):
        began = time.thread_time()
        part = ci.continue_orbit(start, range=(low, 10.0 * low), events=[], settings=settings)
        seconds.append((time.thread_time() - began) / len(part))
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
    blue, ochre = COLOURS[:2]
    left.loglog(stiffness, late, "o-", color=blue, markersize=3, label="of the time of contact")
    left.loglog(stiffness, faster, "s-", color=ochre, markersize=3, label="of the velocity")
    left.loglog(stiffness, 4.0 * stiffness**-0.5, "k:", label="$k_b^{-1/2}$")
    left.set(xlabel="stiffness of the stop, $k_b$", ylabel="difference from the rigid stop")
    left.legend(fontsize=8)
    for low, marker, colour in ((1e1, "o", blue), (1e4, "s", ochre), (1e7, "^", "0.4")):
        found = [stretch(branch, low, tolerance) for tolerance in TOLERANCES]
        for tolerance, (took, error) in zip(TOLERANCES, found, strict=True):
            print(f"k_b from {low:.0e}, {tolerance:.0e}: {took:.0f} us a point, off {error:.1e}")
        took, errors = zip(*found, strict=True)
        label = f"$k_b = 10^{{{int(math.log10(low))}}}$ to $10^{{{int(math.log10(low)) + 1}}}$: "
        label += f"{1e-3 * min(took):.2f} to {1e-3 * max(took):.2f} ms a point"
        right.loglog(TOLERANCES, errors, marker + "-", markersize=4, color=colour, label=label)
    right.loglog(TOLERANCES, TOLERANCES, "k:", label="the tolerance")
    right.set(xlabel="tolerance of the corrector", ylabel="largest error")
    right.legend(fontsize=8)
    file = Path(__file__).parent / "soft-stop.png"
    figure.savefig(file, dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()
