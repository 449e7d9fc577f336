"""Output voltage of the harvester as its capsule shortens, simulated and on branches (Fig. 11).

    python examples/energy_over_a_sweep.py [PICTURE]

Sweeps s downwards, each value starting from the motion at the one before, and prints the mean
voltages per impact and per unit of time. The picture shows them over the voltages of each impact on
the branches of 1:1 and 2:1 orbits.
"""

import math
import sys

import numpy as np

import contimpact as ci

membrane = ci.Membrane()  # of the paper; the ball is assumed to be of steel
pair = ci.ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.4)
found = ci.sweep(pair, "s", np.linspace(0.4, 0.24, 17), progress=True)

for row in found.rows:
    energy = ci.energy(row.attractor, membrane)
    print(
        f"s = {row.value:.3f}  {row.attractor.notation:8} "
        f"per impact {energy.per_impact:8.0f} V, per time {energy.per_time:8.0f} V"
    )

if len(sys.argv) > 1:
    branches = []
    for word in ("1:1", "2:1"):
        at = pair.replace(s=0.34)
        orbit = next(o for o in ci.find_orbits(at, word, parameter="s") if o.physical)
        name = f"b{len(branches) + 1}"
        events = ["FB", "PD", "G"]  # where lines change their style
        branches.append(ci.continue_orbit(orbit, "s", (0.2, 0.45), events=events, name=name))
    diagram = ci.Diagram("Fig. 11(a)", branches)
    ax = ci.plot_energy(membrane, found, x="d", diagram=diagram)
    ax.figure.savefig(sys.argv[1])
