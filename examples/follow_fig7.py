"""Follow the 1:1 and 2:1 orbits of the impact pair at the parameters of Fig. 7.

    python examples/follow_fig7.py [PICTURE]

Prints the events with their errors and the ranges of the capsule length on which an orbit can be
seen: where it is stable and physical. With a file name (png, svg or pdf), draws the diagram there.
"""

import math
import sys

import numpy as np
from matplotlib.figure import Figure

import contimpact as ci


def seen(branch):
    """Return the stretches (first, last) of a branch on which it is both stable and physical."""
    good = branch.stable & branch.physical
    for row in np.nonzero(branch["event"] != "")[0]:  # an event belongs to both of its sides
        good[row] = good[max(row - 1, 0)] or good[min(row + 1, len(good) - 1)]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
    return [(branch["d"][a], branch["d"][b - 1]) for a, b in edges.reshape(-1, 2)]


pair = ci.ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)

branches = []
for word in ("1:1", "2:1"):
    physical = [o for o in ci.find_orbits(pair, word, parameter="s") if o.physical]
    # Here both physical 2:1 orbits lie on one branch, so the first of them is enough.
    branches.append(
        ci.continue_orbit(
            physical[0], "s", (0.08, 1.05), events=["FB", "PD", "G"], name=f"b{len(branches) + 1}"
        )
    )

for branch in branches:
    print(f"{branch.notation}: {len(branch)} points")
    for event in branch.events:
        print(
            f"  {event.label:14} s = {event.value:.15f} m, error {event.error:.0e},  "
            f"d = {event.parameters['d']:.12f}"
        )
    for ends in seen(branch):
        print(f"  stable and physical for {min(ends):.6f} <= d <= {max(ends):.6f}")

if len(sys.argv) > 1:
    figure = Figure(figsize=(8, 5), layout="constrained")
    ax = figure.add_subplot()
    ci.plot_diagram(ci.Diagram("Fig. 7", branches), ax=ax, x="d", xlim=(0.13, 0.25))
    figure.savefig(sys.argv[1])
    print(f"drawn to {sys.argv[1]}")
