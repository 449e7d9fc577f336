"""Draw the figures of the paper that no scene draws, for the gallery of the documentation.

    python docs/figures/paper.py [NAME ...]

Names are fig5, fig6, fig9, fig10 and fig12; all of them if none is given. Fig. 6 takes two minutes,
Fig. 12 one, Fig. 10 a quarter of an hour; its sweeps are kept in fig10.sqlite, in the folder where
this is started.
"""

import lzma
import math
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import contimpact as ci
from contimpact.results.quantities import WALLS
from contimpact.studies.executors import processes

HERE = Path(__file__).parent
SCENES = HERE.parents[1] / "branches"
EVENTS = ["FB", "PD", "G", "V"]
FINE = ci.Settings(step=0.002, max_step=0.004)
"""Of branches near a grazing, where a multiplier goes to infinity within a short way."""
PUBLISHED = (
    (1 / 18, 0.394006503),
    (1 / 9, 0.295513665),
    (1 / 6, 0.185725166),
    (1 / 18, 0.429318118),
    (1 / 9, 0.372079625),
    (1 / 6, 0.304161346),
    (1 / 4, 0.151180589),
)
"""Angle in pi and r where the curves of panels 6(a) and 6(b) cross."""
STORE = Path("fig10.sqlite")
"""Where the sweeps of Fig. 10 are kept; what is there already is not simulated again."""
LIMITS = {"a": (0.08, 0.42), "b": (0.08, 0.42), "c": (0.08, 0.3)}
"""Of d in Fig. 10."""
TITLES = {
    "a": r"$\beta = \pi/3$, $A = 5$ N, $s$ swept",
    "b": r"$\beta = \pi/3$, $s = 0.5$ m, $A$ swept",
    "c": r"$\beta = \pi/6$, $s = 0.5$ m, $A$ swept",
}


def written(figure, name):
    """Write a figure as PNG, the same bytes every time."""
    figure.savefig(HERE / f"{name}.png", dpi=110, metadata={"Software": None})


def fig5():
    """The 1:1 orbit, stable, unstable, unphysical, and what attracts the motion there."""
    figure = Figure(figsize=(9.0, 9.0), layout="constrained")
    axes = figure.subplots(3, 2, width_ratios=(1.0, 1.5))
    cases = ((6.8, 0.4, []), (7.35, 0.4, ["1:1/2T"]), (7.8, 0.25, ["2:1"]))
    for (A, r, attracting), row in zip(cases, axes, strict=True):
        pair = ci.ImpactPair(beta=math.pi / 6, r=r, A=A, s=0.5)
        found = [ci.find_orbits(pair, word, parameter="A") for word in ["1:1", *attracting]]
        single = max(found[0], key=lambda o: o.velocities[0])
        stable = [o for orbits in found[1:] for o in orbits if o.stable and o.physical]
        state = "unstable" if single.physical and not single.stable else "stable"
        state = state if single.physical else "unphysical"
        labels = [f"{word}, stable" for word in attracting]
        labels.append(f"1:1, {state}, A = {A} N, r = {r}")
        ci.plot_orbit(*stable, single, axes=row, labels=labels)
    written(figure, "fig5")


def fig6():
    """Fig. 6 whole: where PD and grazing of 1:1 and of 2:1 exchange places, at all angles."""
    figure = Figure(figsize=(10.4, 4.8), layout="constrained")
    axes = figure.subplots(1, 2, sharex=True, sharey=True)
    for name, style, fixed in (("fig6_A", "-", "$A = 5$ N"), ("fig6_s", "--", "$s = 0.5$ m")):
        diagram = ci.follow(ci.load_scene(SCENES / name / "scene.toml"))
        for curve in (c for c in diagram.codim2_curves if c.kind == "PD-G"):
            ax = axes[("1:1", "2:1").index(curve.notation)]
            first = curve["r"][np.argmax(curve["beta"])] < 0.5 if ax is axes[0] else True
            colour = WALLS[0] if first else "0.45"
            ax.plot(curve["beta"] / np.pi, curve["r"], color=colour, linestyle=style)
            ends = curve["beta"][[0, -1]] / np.pi, curve["r"][[0, -1]]
            ax.plot(*ends, "o", color=colour, markersize=4, markerfacecolor="w", clip_on=False)
        for ax in axes:
            ax.plot([], [], color="k", linestyle=style, label=fixed)
    for ax, word in zip(axes, ("1:1", "2:1"), strict=True):
        ax.set_title(f"PD-G of {word}")
        ax.set_xlabel(r"$\beta$ ($\pi$ rad)")
    axes[0].plot(*zip(*PUBLISHED, strict=True), "kx", label="panels (a) and (b)")
    axes[0].text(0.04, 0.16, "grazing first", fontsize=9)
    axes[0].text(0.26, 0.4, "period doubling first", fontsize=9, color=WALLS[0])
    axes[0].text(0.25, 0.74, "a second 1:1 at smaller $d$", fontsize=9, color="0.45")
    axes[1].text(0.02, 0.69, "with grazing to 3:1", fontsize=9)
    axes[1].text(0.12, 0.1, "with grazing to 2:2", fontsize=9)
    axes[0].set_ylabel("$r$ (dimensionless)")
    axes[0].set_ylim(0.0, 0.8)
    axes[0].legend(fontsize=8, loc="lower right", bbox_to_anchor=(1.0, 0.1))
    written(figure, "fig6")


def fig9():
    """Eigenvalues along the 2:1 branches of Figs. 7 and 8, of the unstable orbits as well."""
    figure = Figure(figsize=(12.0, 5.2))
    axes = figure.subplots(1, 2)
    figure.subplots_adjust(left=0.06, right=0.97, top=0.85, bottom=0.24)
    for letter, name, ax in zip("ab", ("fig7", "fig8"), axes, strict=True):
        scene = ci.load_scene(SCENES / name / "scene.toml")
        pair, followed = scene.model, scene.parameter
        orbit = next(
            o for o in ci.find_orbits(pair, "2:1", parameter=followed) if o.stable and o.physical
        )
        branch = ci.continue_orbit(orbit, followed, scene.range, events=EVENTS, settings=FINE)
        fold = max(e.parameters["d"] for e in branch.events if e.kind == "FB")
        lowest = min(e.parameters["d"] for e in branch.events if e.kind in ("PD", "G"))
        limits = (lowest - 0.01, fold + 0.005)
        ax.set_yscale("symlog", linthresh=1.0, linscale=1.5)
        reach = {"xlim": limits, "ylim": (-1e3, 1e3), "unphysical": "all"}
        ci.plot_diagram(ci.Diagram(name, [branch]), ax, x="d", y="multipliers", **reach)
        ax.set_title(f"({letter}) {name.replace('fig', 'Fig. ')}", loc="left", pad=34, fontsize=10)
    written(figure, "fig9")


def fig10():
    """Transitions of simulated motion over the curves of Fig. 6: 10(a), (b) and (c)."""
    for panel, to in (("a", ["2:1", "3:1"]), ("b", ["2:1", "3:1"]), ("c", ["2:1", "3:1", "2:2"])):
        study = ci.load_study(SCENES / "fig10" / f"{panel}.toml")
        with ci.Store(STORE) as store:
            ci.run_study(study, store, processes())
        with ci.Study(STORE, study.name) as asked:
            sweeps = asked.sweeps()
        save_sweeps(sweeps, SCENES / "fig10" / f"{panel}.csv.xz")
        figure = Figure(figsize=(8.4, 5.8), layout="constrained")
        diagram = ci.follow(with_curves(study))
        ax = figure.add_subplot()
        units = {"d": "dimensionless", "r": "dimensionless"}
        # those of the paper; V are those of grazings
        shown = [c for c in diagram.curves if c.kind != "V" and c.notation in ("1:1", "2:1")]
        look = {"units": units, "xlim": (0.05, 0.9), "ylim": LIMITS[panel]}
        ci.plot_transitions(shown, sweeps, to=to, ax=ax, areas=diagram.areas, **look)
        ax.set_title(TITLES[panel], fontsize=10)
        written(figure, f"fig10{panel}")


def save_sweeps(sweeps, path):
    """Write what each sweep settles on, a row for each value and direction."""
    names = ("r", "A", "s", "d")
    rows = ["direction,r,A,s,d,kind,notation,period"]
    for sweep in sweeps:
        for row in sweep.rows:
            a = row.attractor
            values = (f"{a.parameters[name]:.10g}" for name in names)
            period = "" if a.period is None else str(a.period)
            rows.append(",".join([row.direction, *values, a.kind.value, a.notation, period]))
    packed(path, rows)


def packed(path, rows):
    """Write lines to a compressed file, the same bytes every time."""
    path.write_bytes(lzma.compress("\n".join([*rows, ""]).encode()))


def with_curves(study):
    """A study's scene with the curves of 1:1 and 2:1 over r, and with areas."""
    given = study.scene_at([0.5])
    del given["simulate"]
    kinds = ["FB", "PD", "G", "V"]
    return ci.read_scene(
        given
        | {
            "follow": {**given["follow"], "orbits": ["1:1", "2:1"]},
            "detect": {"events": kinds},
            "curves": {
                "parameter": "r",
                "range": [0.05, 0.9],
                "kinds": kinds,
                "cover": 3,
                "max_step": 0.02,
                "areas": True,
            },
        }
    )


def fig12():
    """Mean voltages over d for two coefficients of restitution: s decreasing, A increasing."""
    figure = Figure(figsize=(12.0, 4.4), layout="constrained")
    axes = figure.subplots(1, 2)
    lengths, forces = np.linspace(0.45, 0.16, 59), np.linspace(5.56, 15.56, 61)
    rows = draw_means(axes[0], ci.ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.45), "s", lengths)
    rows += draw_means(axes[1], ci.ImpactPair(beta=math.pi / 6, r=0.3, A=5.56, s=0.5), "A", forces)
    packed(HERE / "fig12.csv.xz", ["swept,r,d,notation,U_T (V),U_I (V)", *rows])
    axes[0].set_title("(a) $A$ = 5 N, $s$ decreasing", loc="left", fontsize=10)
    axes[1].set_title("(b) $s$ = 0.5 m, $A$ increasing", loc="left", fontsize=10)
    axes[0].legend(fontsize=8)
    written(figure, "fig12")


def draw_means(ax, pair, parameter, values):
    """Mean voltages of what a sweep settles on, for r = 0.3 and 0.6; returns them as rows."""
    rows = []
    for r, colour in zip((0.3, 0.6), WALLS, strict=False):
        found = ci.sweep(pair.replace(r=r), parameter, values)
        attractors = [row.attractor for row in found.rows]
        d = [a.parameters["d"] for a in attractors]
        means = [ci.energy(a) for a in attractors]
        per_time = [e.per_time / 1e3 for e in means]
        per_impact = [e.per_impact / 1e3 for e in means]
        ax.plot(d, per_time, "^", color=colour, markersize=4, label=rf"$\bar{{U}}_T$, r = {r}")
        hollow = {"markerfacecolor": "white", "color": colour, "markersize": 4}
        counted = [(x, u) for x, u in zip(d, per_impact, strict=True) if u]
        ax.plot(*zip(*counted, strict=True), "s", label=rf"$\bar{{U}}_I$, r = {r}", **hollow)
        rows += [
            f"{parameter},{r},{x:.10g},{a.notation},{e.per_time:.10g},{e.per_impact:.10g}"
            for x, a, e in zip(d, attractors, means, strict=True)
        ]
    ax.set_xlabel("$d$ (dimensionless)")
    ax.set_ylabel("mean output voltage (kV)")
    ax.set_ylim(bottom=0.0)
    return rows


if __name__ == "__main__":
    for chosen in sys.argv[1:] or ["fig5", "fig6", "fig9", "fig10", "fig12"]:
        {"fig5": fig5, "fig6": fig6, "fig9": fig9, "fig10": fig10, "fig12": fig12}[chosen]()
        print(chosen)
