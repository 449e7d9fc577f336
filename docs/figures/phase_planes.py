"""Draw the phase planes and time series of the paper's Figs. 2(b), 5(a), 7 and 8, for the gallery.

    python docs/figures/phase_planes.py [fig2] [fig5a] [fig7] [fig8]

Each panel has the d of its caption, except those of real grazings, which are drawn at the grazing
itself. Line styles of orbits are those of diagrams; simulated motion is grey. Motion that starts on
an unstable orbit leaves it as rounding errors grow.
"""

import math
import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import contimpact as ci
from contimpact.results.quantities import WALLS

HERE = Path(__file__).parent
MOTION = {"color": "0.45", "zorder": 0}
IMPACT = {"linestyle": "none", "marker": "o", "markerfacecolor": "white", "color": "0.1"}
IMPACT |= {"markersize": 3.0, "markeredgewidth": 0.7, "zorder": 5}
FIG3A = {"beta": math.pi / 9, "r": 0.3, "A": 5.0, "s": 0.4}
FIG7 = {"beta": math.pi / 6, "r": 0.3, "A": 5.0, "s": 0.34}
FIG8 = {"beta": math.pi / 6, "r": 0.25, "A": 7.2, "s": 0.5}


def at(parameter, d, given):
    """The impact pair with this d, reached by s or by A."""
    pair = ci.ImpactPair(**given)
    known = ci.find_orbits(pair, "1:1", parameter=parameter)[0].parameters["d"]
    factor = d / known if parameter == "s" else known / d
    return pair.replace(**{parameter: given[parameter] * factor})


def orbits_of(pair, word, parameter):
    """Its orbits, stable ones first."""
    found = ci.find_orbits(pair, word, parameter=parameter)
    return sorted(found, key=lambda orbit: not (orbit.stable and orbit.physical))


def simulated(row, orbit, *, from_near=0.0, skipped=0, periods=12):
    """Draw motion from an orbit's first impact, or from near it, into both axes of a row."""
    plane, series = row
    simulator = ci.Simulator(orbit.model)
    velocity = orbit.velocities[0] * (1.0 + from_near)
    state = simulator.state(orbit.word.walls[0], orbit.times[0], velocity)
    state = simulator.run(state, periods=skipped).end
    run = simulator.run(state, periods=periods)
    t, z, v = simulator.path(run.walls, run.times, run.velocities, run.released)
    plane.plot(z, v, **MOTION, linewidth=0.4)
    series.plot(t / run.period, z, **MOTION, linewidth=0.9)
    hits = [simulator.positions[wall] for wall in run.walls]
    series.plot(run.times / run.period, hits, **IMPACT)
    for position, colour in zip(simulator.positions, WALLS, strict=False):
        series.axhline(position, color=colour, linewidth=1.4, zorder=1)
    series.set(xlim=(t[0] / run.period, t[-1] / run.period), xlabel="$t/T$", ylabel="$Z$")


def grazing(entries, label):
    """The event of this label, as an orbit with its touch."""
    return next(entry for entry in entries if entry.label == label)


def panels(title, rows):
    """A row of two axes for each panel of the paper, named as there."""
    figure = Figure(figsize=(10.0, 3.3 * len(rows)), layout="constrained")
    figure.suptitle(title, fontsize=10)
    axes = figure.subplots(len(rows), 2, width_ratios=(1.0, 1.6))
    for pair, name in zip(axes, rows, strict=True):
        pair[0].set_title(name, fontsize=10)
    return figure, axes


def zoomed(plane, entry):
    """An inset where an orbit touches a wall."""
    _, z, v = entry.orbit().path(2000)
    wall = np.max(z)
    inset = plane.inset_axes((0.3, 0.36, 0.42, 0.36))
    inset.plot(z, v, color="0.1", linewidth=1.0)
    inset.axvline(wall, color=WALLS[0])
    inset.plot(wall, 0.0, marker="o", color="#D55E00")
    inset.set(xlim=(wall - 0.004, wall + 0.0005), ylim=(-0.06, 0.06), xticks=[], yticks=[0.0])
    inset.tick_params(labelsize=7)
    plane.indicate_inset_zoom(inset)


def fig2():
    """The ball inside the moving capsule, in absolute coordinates: 1:1 and 2:1."""
    figure = Figure(figsize=(10.0, 5.0), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    for ax, word, beta, s in zip(axes, ("1:1", "2:1"), ("π/9", "4π/9"), (0.5, 0.35), strict=True):
        angle = math.pi / 9 * (4 if beta == "4π/9" else 1)
        pair = ci.ImpactPair(beta=angle, r=0.3, A=5.0, s=s)
        orbit = orbits_of(pair, word, "s")[0]
        t, z, _ = orbit.path()
        t = np.concatenate([t + turn * orbit.period for turn in range(-1, 4)])
        capsule = -np.cos(np.pi * t) / np.pi**2
        half = 0.5 * orbit.parameters["d"]
        ends = (("bottom B", -half, WALLS[0]), ("top T", half, WALLS[1]))
        for name, side, colour in ends:
            ax.plot(t / orbit.period, capsule + side, "-.", color=colour, label=name)
        ax.plot(t / orbit.period, capsule - np.tile(z, 5), color="0.1", label="ball")
        values = f"$\\beta$ = {beta}, $r$ = 0.3, $A$ = 5 N, $s$ = {s} m"
        ax.set_title(f"{word}, stable: {values}", fontsize=10)
        ax.set_ylabel("height (dimensionless)")
    axes[1].set(xlim=(0.0, 4.0), xlabel="$t/T$")
    handles = axes[0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=3, fontsize=9, frameon=False)
    return figure


def fig5a():
    """The flights of 1:1, from D on the bottom to A on the top and back: at the grazing, which P2
    reaches at G, and before it."""
    before = orbits_of(at("s", 0.24, FIG3A), "1:1", "s")[0]
    branch = ci.continue_orbit(before, "s", range=(0.3, 0.5), events=["G"])
    event = grazing(branch.events, "~G[1:1->2:1]")
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    plane, series = figure.subplots(1, 2, width_ratios=(1.0, 1.3))
    flights = {"P_2": "0.1", "P_3": WALLS[1]}
    for orbit, line in ((before, "--"), (event.orbit(), "-")):
        half = 0.5 * orbit.parameters["d"]
        told = f"$d$ = {2 * half:.4f}" + (" = $d_G$" if line == "-" else "")
        t, z, v = (part.reshape(2, -1) for part in orbit.path())
        for k, (name, colour) in enumerate(flights.items()):
            plane.plot(z[k], v[k], line, color=colour, label=f"${name}$, {told}")
            series.plot((t[k] - t[0, 0]) / orbit.period, z[k], line, color=colour)
        for side in (-half, half):
            plane.axvline(side, color="0.6", linestyle=line, linewidth=0.8, zorder=0)
            series.axhline(side, color="0.6", linestyle=line, linewidth=0.8, zorder=0)
    places = {"D": (t[0, 0], z[0, 0], v[0, 0]), "A": (t[0, -1], z[0, -1], v[0, -1])}
    places["G"] = (event.touch_time, half, 0.0)
    for name, (time, at_z, at_v) in places.items():
        look = {"xytext": (6, 6), "textcoords": "offset points", "fontsize": 11}
        late = (time - t[0, 0]) / orbit.period
        for ax, place in ((plane, (at_z, at_v)), (series, (late, at_z))):
            ax.plot(*place, **IMPACT)
            ax.annotate(name, place, **look)
    plane.set(xlabel="$Z$", ylabel=r"$\dot Z$")
    series.set(xlabel="$t/T$ since D", ylabel="$Z$", xlim=(0.0, 1.0))
    figure.legend(*plane.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    figure.suptitle(
        "Fig. 5(a): 1:1 as $P_2$ and $P_3$; $\\beta$ = π/9, $r$ = 0.3, $A$ = 5 N", fontsize=10
    )
    return figure


def fig7():
    """Phase planes and time series of Fig. 7, from (b) to (l)."""
    diagram = ci.follow(ci.load_scene(HERE.parents[1] / "branches/fig7/scene.toml"))
    rows = ["(b), (c)", "(d), (e)", "(f) to (h)", "(i), (j)", "(k), (l)"]
    figure, axes = panels("Fig. 7: $\\beta$ = π/6, $r$ = 0.3, $A$ = 5 N", rows)
    single = orbits_of(at("s", 0.242, FIG7), "1:1", "s")[0]
    doubled = orbits_of(at("s", 0.233, FIG7), "1:1/2T", "s")[0]
    ci.plot_orbit(single, axes=axes[0], labels=["1:1, stable, d = 0.242"])
    ci.plot_orbit(doubled, axes=axes[1], labels=["1:1/2T, stable, d = 0.233"])
    stable, ghost = orbits_of(at("s", 0.205, FIG7), "2:1", "s")[:2]
    labels = ["2:1, stable, d = 0.205", "2:1, unstable: motion (grey) starts on it"]
    ci.plot_orbit(stable, ghost, axes=(axes[2, 0], None), labels=labels)
    simulated(axes[2], ghost, periods=10)
    single = orbits_of(at("s", 0.226, FIG7), "1:1", "s")[0]
    ci.plot_orbit(single, axes=(axes[3, 0], None), labels=["1:1, unstable, d = 0.226"])
    simulated(axes[3], single, from_near=0.01, skipped=500, periods=20)
    event = grazing(diagram.entries, "G[2:1->3:1]")
    ci.plot_orbit(event, axes=axes[4], labels=["2:1 at its grazing, d = 0.1737"])
    zoomed(axes[4, 0], event)
    return figure


def fig8():
    """Phase planes and time series of Fig. 8, from (b) to (j)."""
    diagram = ci.follow(ci.load_scene(HERE.parents[1] / "branches/fig8/scene.toml"))
    figure, axes = panels(
        "Fig. 8: $\\beta$ = π/6, $r$ = 0.25, $s$ = 0.5 m",
        ["(b), (c)", "(d), (e)", "(f), (g)", "(h) to (j)"],
    )
    event = grazing(diagram.entries, "G[1:1->2:1]")
    ci.plot_orbit(event, axes=axes[0], labels=["1:1 at its grazing, d = 0.2138"])
    pair = at("A", 0.194872, FIG8)
    stable = orbits_of(pair, "2:1", "A")[0]
    beyond = next(o for o in orbits_of(pair, "1:1", "A") if not o.physical)
    labels = ["2:1, stable, d = 0.1949", "1:1, unphysical"]
    ci.plot_orbit(stable, beyond, axes=axes[1], labels=labels)
    doubled = orbits_of(at("A", 0.12484, FIG8), "2:1/2T", "A")[0]
    ci.plot_orbit(doubled, axes=axes[2], labels=["2:1/2T, stable, d = 0.1248"])
    pair = at("A", 0.1132, FIG8)
    stable = orbits_of(pair, "BBTBBTT/2T", "A")[0]
    ghost = next(o for o in orbits_of(pair, "2:2", "A") if o.physical)
    labels = ["(4:3)/2T, stable, d = 0.1132", "2:2, unstable: motion (grey) 37 periods from it"]
    ci.plot_orbit(stable, ghost, axes=(axes[3, 0], None), labels=labels)
    simulated(axes[3], ghost, skipped=37, periods=14)
    return figure


if __name__ == "__main__":
    figures = {"fig2": fig2, "fig5a": fig5a, "fig7": fig7, "fig8": fig8}
    for chosen in sys.argv[1:] or figures:
        figure = figures[chosen]()
        name = f"{chosen}_phase_planes" if chosen in ("fig7", "fig8") else chosen
        target = HERE / f"{name}.png"
        figure.savefig(target, dpi=90, metadata={"Software": None})
        print(target.name)
