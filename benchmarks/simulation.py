"""Impacts per second of the simulation, on three kinds of motion of the impact pair.

    python benchmarks/simulation.py [IMPACTS]

Prints medians of seven runs with the least and the most. Seconds depend on the machine; compare
figures of one run only.
"""

from __future__ import annotations

import math
import statistics
import sys
import time

from contimpact import ImpactPair
from contimpact.mechanics.simulate import Simulator, State

MOTIONS = {
    "1:1, periodic": {"A": 5.0, "s": 0.389},
    "2:1, periodic": {"A": 5.0, "s": 0.3},
    "1:1/C, complex": {"A": 5.0, "s": 0.3631},
}
RUNS = 7


def main() -> None:
    impacts = int(sys.argv[1]) if len(sys.argv) > 1 else 20000
    for name, values in MOTIONS.items():
        simulator = Simulator(ImpactPair(beta=math.pi / 6, r=0.3, **values))
        start = State(wall=0, phase=0.14, velocity=0.686)
        rates = []
        for _ in range(RUNS):
            began = time.perf_counter()
            run = simulator.run(start, impacts=impacts)
            rates.append(len(run.walls) / (time.perf_counter() - began))
        middle = statistics.median(rates)
        print(f"{name:16} {middle:9.0f} impacts/s ({min(rates):.0f} to {max(rates):.0f})")


if __name__ == "__main__":
    main()
