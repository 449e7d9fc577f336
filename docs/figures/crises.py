"""Draw crises.png: the manifolds of the unstable 2:1 of Fig. 7, before and after the crisis."""

from pathlib import Path

from matplotlib.figure import Figure

import contimpact as ci

figure = Figure(figsize=(8.2, 3.6), layout="constrained")
for ax, s in zip(figure.subplots(1, 2, sharey=True), (0.3556, 0.354), strict=True):
    pair = ci.ImpactPair(beta="pi/6", r=0.3, A=5.0, s=s)
    found = ci.find_orbits(pair, "2:1", "s")
    saddle = next(o for o in found if o.physical and not o.stable)
    ci.grow_manifold(saddle, stable=True, length=3.0, spacing=0.005).plot(ax, wall="T")
    ci.grow_manifold(saddle, length=1.0).plot(ax, wall="T")
    ax.get_legend().remove()
    side = "before" if s > 0.35522 else "after"
    ax.set_title(f"{side} the crisis, $s$ = {s:.4f} m", fontsize="medium")
    ax.set_xlim(0.69, 0.73)
    ax.set_ylim(-0.56, -0.48)
    ax.label_outer()
figure.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
figure.savefig(Path(__file__).with_name("crises.png"), dpi=120)
