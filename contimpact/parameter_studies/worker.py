"""What a worker does: one scene, from its description to the rows that are kept of it.

Nothing here knows the store or the executor; a `Task` goes to a worker, an `Outcome` comes back,
both of them plain data.
"""

from __future__ import annotations

import contextlib
import functools
import json
import platform
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .. import __version__
from ..diagrams.explore import follow
from ..errors import InputError
from ..results.scene import Scene, read_scene
from ..segments.compiling import spend
from .budget import BudgetError, limited
from .outcome import Outcome, Rows, diagram_rows, failure, simulation_rows


@dataclass(frozen=True)
class Task:
    """A scene to compute.

    Attributes
    ----------
    scene : mapping
        As a scene file has it.
    keep : sequence of str
    derived : str or None
        The derived parameter whose values are kept.
    budget : float or None
        Seconds.
    fatal : bool
        Whether the process may be ended if the scene hangs outside Python.
    expected : int
        Flights that the study will evaluate, by which it is decided whether compiling pays.
    """

    scene: Mapping[str, Any]
    keep: tuple[str, ...]
    derived: str | None
    budget: float | None = None
    fatal: bool = False
    expected: int = 0


def compute(task: Task) -> Outcome:
    """Compute a scene; whatever fails is part of the outcome."""
    began = time.perf_counter()
    spend(task.expected)

    def ended(status: str, rows: Rows, **counts: int) -> Outcome:
        return Outcome(status, time.perf_counter() - began, versions(), rows, **counts)

    def failed(kind: str, reason: str) -> Outcome:
        return ended("failed", {"failures": [failure(kind, reason)]})

    try:
        with limited(task.budget, task.fatal) as tell:
            return _computed(task, tell, ended)
    except BudgetError:
        return failed("budget", f"not finished within its {task.budget:g} s")
    except InputError as error:
        return failed("refused", str(error))
    except Exception as error:
        return failed("error", f"{type(error).__name__}: {error}")


def _computed(task: Task, tell: Any, ended: Any) -> Outcome:
    scene = read_scene(task.scene)
    diagram = follow(scene, tell)
    rows = diagram_rows(diagram, task.keep, task.derived)
    if {"attractors", "energies"} & {*task.keep}:
        rows |= _simulated(scene, task, tell)
    if reason := diagram.statistics["failure"]:
        rows["failures"] = [failure("numerical", reason)]
    counts = diagram.statistics["counts"]
    return ended(
        "incomplete" if reason else "done",
        rows,
        points=counts["points"],
        evaluations=counts["kernel_evaluations"],
    )


def _simulated(scene: Scene, task: Task, tell: Any) -> Rows:
    from ..diagrams.scene_simulation import simulate

    with tempfile.TemporaryDirectory() as folder:
        simulation = simulate(scene, Path(folder), progress=tell)
    return simulation_rows(simulation, task.keep, scene.energy)


@functools.cache
def versions() -> str:
    """Return the versions of what computes, as JSON."""
    from importlib import metadata

    known = {"contimpact": __version__, "python": platform.python_version()}
    for name in ("numpy", "scipy", "sympy", "numba"):
        with contextlib.suppress(metadata.PackageNotFoundError):
            known[name] = metadata.version(name)
    return json.dumps(known | {"machine": platform.machine()}, sort_keys=True)
