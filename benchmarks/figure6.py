"""Fig. 6 of the paper, whole: the seconds its four scenes take from Python."""

from __future__ import annotations

from contestant import HERE, MODES, Contestant, Sample, Workspace, seconds_of

from contimpact import follow, load_scene

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
    took, diagram = seconds_of(lambda: follow(load_scene(path)))
    if diagram.statistics["failure"] or not diagram.curves:
        raise RuntimeError(f"{name} failed: {diagram.statistics['failure']}")
    return took
