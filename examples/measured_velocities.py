"""Measured impact velocities laid over a diagram.

    python examples/measured_velocities.py [PICTURE]

`measured_velocities.csv` has a row for each impact: the length of the capsule in m, the wall, and
the speed before impact in m/s. It stands for an experiment; it was made by simulation, with noise
of two per cent. Speeds become dimensionless velocities by the scale A pi/(M omega), and are
compared with the observable orbits of the diagram.
"""

import csv
import math
import sys
from pathlib import Path

import numpy as np

import contimpact as ci

pair = ci.ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
scale = pair.values["A"] * math.pi / (pair.values["M"] * pair.values["omega"])
with open(Path(__file__).with_name("measured_velocities.csv"), newline="") as file:
    rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
lengths = np.array([float(row["s"]) for row in rows])
signs = np.array([1.0 if row["wall"] == "B" else -1.0 for row in rows])
measured = signs * np.array([float(row["speed"]) for row in rows]) / scale

branches = []
for word in ("1:1", "2:1"):
    orbit = next(o for o in ci.find_orbits(pair, word, parameter="s") if o.physical)
    values = {"s": sorted(set(lengths))}  # rows of the branch at exactly these lengths
    branches.append(
        ci.continue_orbit(
            orbit,
            "s",
            range=(0.2, 0.45),
            events=["FB", "PD", "G"],
            values=values,
            name=f"b{len(branches) + 1}",
        )
    )

for length in sorted(set(lengths)):
    at = lengths == length
    for branch in branches:
        here = (branch["s"] == length) & branch.stable & branch.physical
        for row in np.flatnonzero(here):
            computed = branch.velocities[row]
            off = [np.min(np.abs(computed - v)) for v in measured[at]]
            print(f"s = {length}: {branch.notation}, measured within {max(off):.3f}")

if len(sys.argv) > 1:
    ax = ci.plot_diagram(ci.Diagram("measured", branches), x="s", xlim=(0.28, 0.42), unit="m")
    ax.plot(lengths, measured, "k+", markersize=5, zorder=6)
    ax.figure.savefig(sys.argv[1])
