"""Impacts per second of systems of several coordinates, and of many starts on two cores.

    python benchmarks/several.py

Seconds are those of the processor; the ratio of threads is by the clock, of runs that take turns.
"""

from __future__ import annotations

import os
import statistics
import time

import numpy as np

from contimpact import ImpactDamper, Simulator, TwoMasses

PAIR = {"m1": 1.0, "m2": 1.0, "c1": 0.1, "c2": 0.1, "k1": 1.0, "k2": 1.0, "a1": 1.0}
MODELS = {
    "two masses, 1:0": TwoMasses(**PAIR, omega=1.8, sigma_1=0.1, sigma_2=0.2, r=0.8),
    "free ball, 1:1": ImpactDamper(Omega=1.0, d=20.0, r=0.8, mu=0.1, zeta=0.01),
}
IMPACTS = {"automaton": 500, "never": 5_000, "always": 500_000}
STARTS, PERIODS, ROUNDS = 1000, 200, 5


def rate(simulator: Simulator, start: object, impacts: int) -> float:
    """Return the impacts per second of a run, which is begun once before."""
    simulator.run(start, impacts=100)
    began = time.process_time()
    made = len(simulator.run(start, impacts=impacts))
    return made / (time.process_time() - began)


def main() -> None:
    """Print the figures."""
    for name, model in MODELS.items():
        simulator, alone = Simulator(model), Simulator(model)
        alone.machine.__dict__["_runs"] = None  # as if no flight were linear
        start = simulator.random_state(np.random.default_rng(0))
        for mode, impacts in IMPACTS.items():
            os.environ["CONTIMPACT_COMPILED"] = "never" if mode == "automaton" else mode
            found = rate(alone if mode == "automaton" else simulator, start, impacts)
            print(f"{name}, {mode}: {found:.3g} impacts/s")
        generator, ratios = np.random.default_rng(1), []
        starts = [simulator.random_state(generator) for _ in range(STARTS)]
        for _ in range(ROUNDS):
            took = []
            for threads in (1, 2):
                began = time.perf_counter()
                simulator.run_all(starts, periods=PERIODS, threads=threads)
                took.append(time.perf_counter() - began)
            ratios.append(took[0] / took[1])
        print(f"{name}, {STARTS} starts, two threads: {statistics.median(ratios):.3g} x")


if __name__ == "__main__":
    main()
