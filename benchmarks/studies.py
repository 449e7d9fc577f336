"""What a study costs beside its scenes, and how much faster two processes are.

The same scenes of the ghost atlas are computed in this process, as ``contimpact run`` does before
it writes anything, then as a study on one process and on several. Kernels and compiled code are in
the cache before anything is timed. Where the machine is busy, wall clock says little; the CPU time
of all processes does.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from pathlib import Path

from contimpact import Store, follow, load_study, read_scene, read_study, run_study
from contimpact.studies.executors import processes

ATLAS = Path(__file__).parents[1] / "branches" / "atlas" / "A5.toml"


def timed(work):
    """Wall-clock and CPU seconds of this process and of those it has waited for."""
    before, began = os.times(), time.perf_counter()
    work()
    wall, after = time.perf_counter() - began, os.times()
    return wall, sum(after[:4]) - sum(before[:4])


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--scenes", type=int, default=60)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    given = dict(load_study(ATLAS).given)
    ranges = {"beta": [0.1, 1.5], "r": [0.05, 0.9]}
    sample = {"method": "sobol", "count": options.scenes, "range": ranges}
    given["study"] = {"keep": ["readings"], "sample": sample}
    study = read_study(given)
    scenes = [study.scene_at(values) for values in study.points[1]]
    folder = tempfile.TemporaryDirectory()

    def in_process():
        for scene in scenes:
            follow(read_scene(scene))

    def on(workers):
        def work():
            with Store(Path(folder.name) / f"{workers}-{time.monotonic_ns()}.sqlite") as store:
                run_study(study, store, processes(workers))

        return work

    start = {**given, "study": {**given["study"], "sample": {**sample, "count": 1}}}

    def started():
        with Store(Path(folder.name) / f"start-{time.monotonic_ns()}.sqlite") as store:
            run_study(read_study(start), store, processes(1))

    in_process()
    rows = {"in this process": timed(in_process), "one scene on one process": timed(started)}
    rows |= {"study on 1 process": timed(on(1))}
    rows |= {f"study on {options.workers} processes": timed(on(options.workers))}
    folder.cleanup()
    for name, (wall, cpu) in rows.items():
        print(f"{name:28} {wall:7.2f} s wall, {cpu:7.2f} s CPU")
    (alone, alone_cpu), (begun, begun_cpu), (one, one_cpu), (several, _) = rows.values()
    one_scene = alone_cpu / len(scenes)
    print(f"start of a process: {begun_cpu - one_scene:.2f} s CPU, once")
    whole = (one_cpu / alone_cpu - 1.0) * 100.0
    each = ((one_cpu - (begun_cpu - one_scene)) / alone_cpu - 1.0) * 100.0
    print(f"overhead per scene: {each:.1f} % of its CPU time; with the start {whole:.1f} %")
    busy = f"load {os.getloadavg()[0]:.1f}, start {begun:.2f} s"
    print(f"wall clock: a study on one process takes {one / alone:.2f} times as long ({busy})")
    print(f"speed-up on {options.workers} processes: {one / several:.2f}")


if __name__ == "__main__":
    main()
