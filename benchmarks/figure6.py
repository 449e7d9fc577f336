"""Fig. 6 of the paper, whole: the seconds the curves of its four scenes take from Python.

They are those of PD and G from the scenes' own value of r, without the lines that cover the map
and without areas.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

from contestant import HERE, MODES, Contestant, Sample, Workspace, seconds_of

from contimpact import follow, load_scene
from contimpact.results.scene import Scene

SCENES = ("fig6a", "fig6b", "fig6c", "fig6d")
ROUNDS = 3


def contestants(workspace: Workspace) -> list[Contestant]:
    """Return those of this subject, which take part in a few rounds only."""
    return [
        Contestant(f"Fig. 6, {mode}", lambda m=mode: _measure(workspace, m), ROUNDS)
        for mode in MODES
    ]


def _measure(workspace: Workspace, mode: str) -> list[Sample]:
    times = {name: workspace.call("figure6.seconds", name, mode=mode) for name in SCENES}
    times["all four"] = sum(times.values())
    return [Sample("figure6", row(mode, name), took, 1) for name, took in times.items()]


def row(mode: str, scene: str) -> str:
    """Return the name of a row."""
    return f"contimpact {mode}, {scene}"


# In the child.


def seconds(name: str) -> float:
    """Time a scene, from its file to its diagram and curves."""
    path = HERE.parent / "branches" / name / "scene.toml"
    took, diagram = seconds_of(lambda: follow(_curves_alone(path)))
    if diagram.statistics["failure"] or not diagram.curves:
        raise RuntimeError(f"{name} failed: {diagram.statistics['failure']}")
    return took


def _curves_alone(path: Path) -> Scene:
    scene = load_scene(path)
    assert scene.curves is not None
    least = {"kinds": ("PD", "G"), "start": (), "cover": 0, "areas": False}
    return dataclasses.replace(scene, curves=dataclasses.replace(scene.curves, **least))
