"""Draw Fig. 7 with soft membranes, from the exported scenes, for the page on the soft pair.

python docs/figures/soft_pair.py
"""

import tomllib
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import contimpact as ci
from contimpact.plots.report import COLOURS

BRANCHES = Path(__file__).parents[2] / "branches"
FINE = ci.Settings(step=1e-4, max_step=2e-3)
PERIOD_ONE = {"BT": 1, "BBT": 2, "BBBT": 3}


def word(branch):
    """The impacts alone: contacts without their releases."""
    return branch.word.replace("b", "").replace("t", "")


def lines(ax, x, y, branch, **how):
    """Stable points solid, unstable ones dashed, unphysical ones left out."""
    physical, stable = branch["physical"] == 1, branch["n_unstable"] == 0
    for style, mask in (("-", physical & stable), ("--", physical & ~stable)):
        ax.plot(*(np.where(mask, values, np.nan) for values in (x, y)), style, **how)


def slowest(branch):
    """The slowest impact at the bottom."""
    columns = [branch[f"v{k}"] for k, letter in enumerate(branch.word, 1) if letter == "B"]
    return np.min(columns, axis=0)


def diagrams():
    """The limit of stiff membranes, with the ball's weight in gravity, and three soft pairs."""
    heavier = 9.8 * (1.0 + ci.Membrane().m / 0.1245)
    scene = tomllib.loads((BRANCHES / "fig7" / "scene.toml").read_text(encoding="utf-8"))
    scene["model"]["parameters"] |= {"s": 0.45, "g": heavier}
    scene["follow"]["switch"] = ["G"]
    for table in ("simulate", "energy"):
        del scene[table]
    yield "rigid", "0.0", ci.follow(scene)
    stiffer = tomllib.loads((BRANCHES / "soft_pair_500" / "scene.toml").read_text("utf-8"))
    del stiffer["output"]
    stiffer["follow"]["range"] = [0.2, 0.42]
    for label, colour, k in (("50 000 N/m", COLOURS[0], 50000), ("5 000 N/m", COLOURS[2], 5000)):
        stiffer["model"]["parameters"] |= {"s": 0.41, "k": k}
        yield label, colour, ci.follow(stiffer)
    yield "500 N/m", COLOURS[4], ci.load_diagram(BRANCHES / "soft_pair_500")


def main():
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for number, (label, colour, diagram) in enumerate(diagrams()):
        how = {"color": colour, "lw": 0.8 + 0.6 * number}  # the width tells them apart in grey
        left.plot([], [], **how, label=label)
        chosen = {word(b): b for b in diagram.branches if b.period == 1 and word(b) in PERIOD_ONE}
        for branch in chosen.values():
            lines(left, branch["s"], slowest(branch), branch, **how)
        born = chosen["BBBT"]
        (grazing,) = [e for e in chosen["BBT"].events if e.kind == "G" and not e.ghost]
        near = grazing.value - 0.0025, grazing.value + 0.001
        seen = born["physical"] & (born["n_unstable"] == 0) & (born["s"] > near[0])
        start = born.orbit(int(np.flatnonzero(seen)[0]))
        fine = ci.continue_orbit(start, "s", range=near, events=["FB", "V"], settings=FINE)
        lines(right, 1e3 * (fine["s"] - grazing.value), slowest(fine), fine, **how)
    left.set(xlim=(0.22, 0.37), ylim=(0.0, 0.15), xlabel="s (m)")
    left.set(ylabel="velocity of the slowest impact at the bottom")
    left.text(0.29, 0.135, "2:1")
    left.text(0.245, 0.03, "3:1")
    left.plot([], [], "--", color="0.4", lw=1.4, label="unstable")
    right.legend(*left.get_legend_handles_labels(), fontsize=8, loc="lower left")
    right.set(xlim=(-1.5, 0.7), ylim=(0.0, 0.018), xlabel="s beyond the grazing of 2:1 (mm)")
    right.set(ylabel="velocity of the slowest impact of 3:1")
    figure.savefig(Path(__file__).with_name("soft-pair.png"), dpi=110, metadata={"Software": None})


if __name__ == "__main__":
    main()
