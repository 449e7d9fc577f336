"""What a diagram has cost: points, iterations, evaluations."""

from __future__ import annotations

import collections
from collections.abc import Iterable, Sequence

from ..continuation.branch import TestFunction
from ..orbit_continuation.orbit_branch import Run


def counts_of(runs: Sequence[Run], probes: int) -> dict[str, int]:
    """Return the counts of a diagram's branches; `probes` are the switches tried."""
    walks = [walk for run in runs for walk in run.walks]
    problems = {id(run.problem): run.problem for run in runs}
    return {
        "branches": len(runs),
        "points": sum(len(run.points) for run in runs),
        "corrector_iterations": sum(w.corrector_iterations for w in walks),
        "rejected_steps": sum(w.rejected_steps for w in walks),
        "switches_tried": probes,
        "kernel_evaluations": sum(p.kernel_evaluations for p in problems.values()),
    }


def evaluations_of(tests: Iterable[TestFunction]) -> dict[str, int]:
    """Return the evaluations of test functions, by kind."""
    counts = collections.Counter[str]()
    for test in tests:
        counts[test.kind] += test.evaluations
    return dict(counts)
