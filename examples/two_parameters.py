"""Which comes first as the capsule shortens, a period doubling or a grazing? It depends on r.

    python examples/two_parameters.py [PICTURE]

Follows both bifurcations of the 1:1 orbit in s and r, and prints where their curves cross and what
comes first on either side, with the slopes ds/dr at the start.
"""

import math
import sys

import contimpact as ci

pair = ci.ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.38)
orbit = next(o for o in ci.find_orbits(pair, "1:1", parameter="s") if o.physical)
branch = ci.continue_orbit(orbit, "s", range=(0.2, 0.5), events=["PD", "G"])

curves = []
for number, event in enumerate(branch.events, start=1):
    print(f"{event.label}: s = {event.value:.9f}, ds/dr = {ci.sensitivity(event, 'r'):.6f}")
    curve = ci.follow_curve(
        event, second="r", first_range=(0.05, 1.0), second_range=(0.1, 0.6), name=f"c{number}"
    )
    curves.append(curve)
    for point in curve.points:
        values = f"s = {point.parameters['s']:.9f}, r = {point.parameters['r']:.9f}"
        print(f"  {point.kind} at {values} (error {point.error:.0e}): {point.changes}")

if len(sys.argv) > 1:
    axes = ci.plot_curves(curves, along="s")
    axes[0].figure.savefig(sys.argv[1])
