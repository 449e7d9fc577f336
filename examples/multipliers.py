"""Multipliers along the 2:1 branches of Fig. 7, as Fig. 9(a) of the paper shows them.

    python examples/multipliers.py [PICTURE]

Prints the moduli of both multipliers along the branch, and the range of s in which an orbit of it
can be observed: stable and physical.
"""

import math
import sys

import contimpact as ci

pair = ci.ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
orbit = next(o for o in ci.find_orbits(pair, "2:1", parameter="s") if o.stable and o.physical)
branch = ci.continue_orbit(orbit, "s", range=(0.2, 0.36), events=["FB", "PD", "G"])

for row in range(0, len(branch), 6):
    state = "stable" if branch.stable[row] else "unstable"
    state += "" if branch.physical[row] else ", unphysical"
    first, second = abs(branch.multipliers[row])
    print(f"d = {branch['d'][row]:.6f}: {first:.6f}, {second:.6f}  {state}")

for interval in ci.stable_intervals(branch):
    print(f"observed from s = {interval.low:.6f} to {interval.high:.6f}")

if len(sys.argv) > 1:
    diagram = ci.Diagram("Fig. 9(a)", [branch])
    ax = ci.plot_diagram(diagram, x="d", y="multipliers", xlim=(0.13, 0.225), unphysical="all")
    ax.figure.savefig(sys.argv[1])
