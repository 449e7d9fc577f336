"""Look for a better harvester than the one designed, at random points: each is one motion.

    python docs/figures/harvester_scan.py [COUNT [WORKERS]]

Points are uniform within the bounds of ``examples/harvester.toml``, 100,000 of them if nothing
else is said, which takes twenty minutes of computing; they do not depend on WORKERS. From a random
impact, the motion is simulated for 200 periods, and its output for 200 more. What gives more
than the best in ``examples/harvester.csv`` is settled, and events are searched for near its orbit.
Prints how many there are, and writes them to ``harvester_scan.csv`` beside this file.
"""

import csv
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from pathlib import Path

import numpy as np

import contimpact as ci
from contimpact.segments.kernels import Kernels
from contimpact.systems.membrane import velocity_scale

HERE = Path(__file__).parent
EXAMPLES = HERE.parents[1] / "examples"
SEED, CHUNK, PERIODS = 32, 500, 200
SLACK = 0.999
"""Part of the best above which a mean that has not quite settled is looked at."""


@cache
def asked():
    """The scene, its best output, and kernels for all points."""
    scene = ci.load_scene(EXAMPLES / "harvester.toml")
    with (EXAMPLES / "harvester.csv").open(encoding="utf-8", newline="") as file:
        best = next(float(row["P"]) for row in csv.DictReader(file) if row["is"] == "best")
    return scene, best, Kernels(scene.model, "s")


def power(model, velocities, span):
    """P of the impacts in a time."""
    voltages = ci.Membrane().voltage(velocity_scale(model.parameters) * velocities)
    return float(np.sum(voltages**2)) / span


def examine(model, simulator):
    """The orbit that a motion settles on: output, notation, distance to the nearest event, and
    that; None where it gives less than the best."""
    scene, best, _ = asked()
    motion = ci.settle(simulator)
    value = power(model, motion.velocities, simulator.period * (motion.period or np.inf))
    if motion.kind.value != "periodic" or not value > best:
        return None
    tolerances = {n: t.at(model[n]) for n, t in scene.design.tolerances.items()}
    for orbit in ci.find_orbits(model, motion.word, parameter="s"):
        speeds = np.sort(abs(orbit.velocities)), np.sort(abs(motion.velocities))
        if orbit.stable and orbit.physical and np.allclose(*speeds, rtol=1e-6):
            nearest = ci.find_margins(orbit, tolerances, within=1.0).nearest
            event = ("", "") if nearest is None else (nearest.distance, nearest.label)
            return value, motion.notation, *event
    return value, motion.notation, "no orbit found", ""


def look(chunk, count):
    """The better ones of some points, and how many motions were without impacts."""
    scene, best, kernels = asked()
    rng, found, lost = np.random.default_rng([SEED, chunk]), [], 0
    low, high = np.array(list(scene.design.bounds.values())).T
    for place in rng.uniform(low, high, size=(count, len(low))).tolist():
        model = scene.model.replace(**dict(zip(scene.design.bounds, place, strict=True)))
        simulator = ci.Simulator(model, kernels)
        begun = simulator.run(simulator.random_state(rng), periods=PERIODS, record=False)
        if begun.end is None:
            lost += 1
            continue
        run = simulator.run(begun.end, periods=PERIODS)
        if power(model, run.velocities, PERIODS * simulator.period) > SLACK * best:
            one = examine(model, simulator)
            found += [] if one is None else [(*place, *one)]
    return found, lost


def main():
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    workers = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    scene, best, _ = asked()
    with ProcessPoolExecutor(workers) as pool:
        chunks = range(-(-count // CHUNK))
        sizes = [min(CHUNK, count - CHUNK * chunk) for chunk in chunks]
        parts = list(pool.map(look, chunks, sizes))
    rows = sorted((row for found, _ in parts for row in found), key=lambda row: -row[3])
    with (HERE / "harvester_scan.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([*scene.design.bounds, "P", "orbit", "margin", "event"])
        writer.writerows(rows)
    kept = sum(not isinstance(row[5], float) for row in rows)
    print(f"{count} points, {sum(lost for _, lost in parts)} of them without impacts")
    print(f"{len(rows)} give more than {best:.6g}, {kept} of these at no event within 1")


if __name__ == "__main__":
    main()
