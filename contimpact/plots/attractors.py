"""Pictures of simulated motion: attractors over branches, exponents, energy, portraits, basins.

In the manner of Figs. 5, 7, 8, 11 and 12 of the paper on vibro-impact pairs. Attractors are open
circles; where sweeps in both directions are drawn, those of the second one are crosses. Colours
and line styles are those of `contimpact.plots.diagram`, and the same in print without colours: what
differs in colour differs in marker, style or panel as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..attractors.attractor import Attractor, Kind
from ..attractors.basins import Basins
from ..attractors.energy import Membrane, along, of_attractor
from ..attractors.sweep import Row, Simulators, Sweep
from ..diagram import Branch, Diagram
from ..files import Content, write_all
from ..mechanics.search import Orbit
from ..mechanics.simulate import Simulator
from . import diagram as style
from .texts import axis_label, symbol

if TYPE_CHECKING:
    from ..attractors.simulation import Simulation
    from ..scene import PlotOptions

INK = "0.15"
MARKS: dict[str, dict[str, Any]] = {
    "first": {"marker": "o", "markerfacecolor": "none", "markersize": 3.2, "markeredgewidth": 0.7},
    "second": {"marker": "x", "markersize": 3.0, "markeredgewidth": 0.7},
    "random": {"marker": "D", "markerfacecolor": "none", "markersize": 3.4, "markeredgewidth": 0.7},
}
"""Of the sweep done first, the other one, and random starts."""
SHOWN = 40
"""Impacts drawn of a motion that is not periodic, in diagrams and time series."""
LOOPS = 160
"""Impacts drawn of such a motion in the phase plane."""
SPOTS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#F0E442", "0.45")


def plot_sweep(
    sweep: Sweep, ax: Any = None, *, x: str | None = None, diagram: Diagram | None = None,
    xlim: tuple[float, float] | None = None, ylim: tuple[float, float] | None = None,
    unit: str = "", **options: Any,
) -> Any:  # fmt: skip
    """Draw attractors as open circles, over branches if there are any.

    Parameters
    ----------
    sweep : Sweep
    ax : matplotlib.axes.Axes, optional
    x : str, optional
        Parameter on the x axis; the swept one by default.
    diagram : Diagram, optional
    xlim, ylim : (low, high), optional
        All that was swept by default.
    unit : str
        Of x.
    **options
        Of `contimpact.plots.diagram.plot_diagram`.

    Returns
    -------
    matplotlib.axes.Axes
    """
    ax = ax or style.new_figure().add_subplot()
    x = x or sweep.parameter
    xlim = xlim or _limits(sweep, x)
    if diagram is not None:
        style.plot_diagram(diagram, ax, x=x, xlim=xlim, ylim=ylim, unit=unit, **options)
    entries = list(getattr(ax.get_legend(), "legend_handles", []) or [])
    speeds = [0.0]
    for direction, mark in _marks(sweep).items():
        places, values = _points(sweep.of(direction), x)
        ax.plot(places, values, linestyle="none", color=INK, zorder=4, **mark)
        speeds += values
        entries.append(
            style.legend_mark(linestyle="none", color=INK, label=_told(direction), **mark)
        )
    ax.set_xlim(*xlim)
    if ylim is None and diagram is None:
        margin = 0.06 * (max(speeds) - min(speeds) or 1.0)
        ax.set_ylim(min(speeds) - margin, max(speeds) + margin)
    if diagram is None:
        ax.axhline(0.0, color="0.75", linewidth=0.6, zorder=0)
    _label(ax, x, unit, "velocity before impact")
    _legend(ax, entries)
    return ax


def _told(direction: str) -> str:
    return "random starts" if direction == "random" else f"simulated, {direction}"


def _marks(sweep: Sweep) -> dict[str, dict[str, Any]]:
    """A marker for each direction of a sweep."""
    ways = [way for way in sweep.directions if way != "random"]
    marks = {way: MARKS["first" if k == 0 else "second"] for k, way in enumerate(ways)}
    return marks | ({"random": MARKS["random"]} if "random" in sweep.directions else {})


def _limits(sweep: Sweep, x: str) -> tuple[float, float]:
    values = [row.attractor.parameters[x] for row in sweep.rows]
    margin = 0.015 * (max(values) - min(values) or 1.0)
    return min(values) - margin, max(values) + margin


def _points(rows: Sequence[Row], x: str) -> tuple[list[float], list[float]]:
    places: list[float] = []
    values: list[float] = []
    for row in rows:
        a = row.attractor
        speeds = a.velocities[~a.released]
        speeds = speeds if a.period is not None else speeds[-SHOWN:]
        places += [a.parameters[x]] * len(speeds)
        values += speeds.tolist()
    return places, values


def _label(ax: Any, x: str, unit: str, y: str) -> None:
    ax.set_xlabel(axis_label(x, unit))
    ax.set_ylabel(y)


def _legend(ax: Any, handles: Sequence[Any]) -> None:
    ax.legend(
        handles=list(handles), loc="upper left", bbox_to_anchor=(1.045, 1.0), fontsize=8,
        frameon=False, borderaxespad=0.0,
    )  # fmt: skip


# Exponents and energy.


def plot_exponents(sweep: Sweep, ax: Any = None, *, x: str | None = None, unit: str = "") -> Any:
    """Draw the largest Lyapunov exponent per forcing period.

    Periodic motion is drawn open, complex motion filled with bars of one standard error; motion
    that sticks has no finite exponent and is marked at the lower edge.
    """
    ax = ax or style.new_figure(7.2, 3.6).add_subplot()
    x = x or sweep.parameter
    finite = [r for r in sweep.rows if np.isfinite(r.attractor.per_period)]
    sticking = [r for r in sweep.rows if r.attractor.kind is Kind.STICKING]
    handles = []
    ax.axhline(0.0, color="0.6", linewidth=0.8, zorder=0)
    looks = {
        "periodic": ([r for r in finite if r.attractor.period is not None], "none", "0.15"),
        "complex": ([r for r in finite if r.attractor.kind is Kind.COMPLEX], "#D55E00", "#D55E00"),
        "not settled": (
            [r for r in finite if r.attractor.kind is Kind.NOT_SETTLED], "0.7", "0.4"
        ),
    }  # fmt: skip
    for name, (rows, face, edge) in looks.items():
        if not rows:
            continue
        places = [r.attractor.parameters[x] for r in rows]
        errors = [r.attractor.error * r.attractor.rate for r in rows]
        mark = {"marker": "o", "markersize": 3.2, "markerfacecolor": face, "color": edge}
        ax.errorbar(
            places, [r.attractor.per_period for r in rows], yerr=errors, linestyle="none",
            elinewidth=0.8, **mark,
        )  # fmt: skip
        handles.append(style.legend_mark(linestyle="none", label=name, **mark))
    if sticking:
        mark = {"marker": "v", "markersize": 4, "color": INK, "linestyle": "none"}
        places = [r.attractor.parameters[x] for r in sticking]
        ax.plot(places, [0.02] * len(places), transform=ax.get_xaxis_transform(), **mark)
        handles.append(style.legend_mark(label="sticking", **mark))
    ax.set_xlim(*_limits(sweep, x))
    _label(ax, x, unit, "largest exponent per period")
    _legend(ax, handles)
    return ax


def plot_energy(
    membrane: Membrane, sweep: Sweep, ax: Any = None, *, x: str | None = None,
    diagram: Diagram | None = None, xlim: tuple[float, float] | None = None, unit: str = "",
) -> Any:  # fmt: skip
    """Draw the output voltages of attractors, and of the branches of period T.

    Open circles are U_k of each impact, squares the mean per impact, triangles the mean per unit of
    dimensionless time; lines are U_k along the branches, by wall.
    """
    ax = ax or style.new_figure().add_subplot()
    x = x or sweep.parameter
    first = [r for r in sweep.rows if r.direction == sweep.directions[0]] if sweep.rows else []
    handles = []
    if diagram is not None:
        handles += _branch_voltages(ax, membrane, diagram, x)
    voltages, means, places = [], [], []
    for row in first:
        energy = of_attractor(membrane, row.attractor)
        place = row.attractor.parameters[x]
        shown = energy.impacts if row.attractor.period else energy.impacts[-SHOWN:]
        voltages += [(place, u) for u in shown.tolist()]
        means.append((energy.per_impact, energy.per_time))
        places.append(place)
    looks = [
        ("$U_k$", [p for p, _ in voltages], [u for _, u in voltages], MARKS["first"], INK),
        (r"$\bar{U}_I$, per impact", places, [m[0] for m in means],
         {"marker": "s", "markersize": 3.0}, "#D55E00"),
        (r"$\bar{U}_T$, per time", places, [m[1] for m in means],
         {"marker": "^", "markersize": 3.2}, "#CC79A7"),
    ]  # fmt: skip
    for label, at, values, mark, colour in looks:
        ax.plot(at, np.array(values) / 1e3, linestyle="none", color=colour, zorder=4, **mark)
        handles.append(style.legend_mark(linestyle="none", color=colour, label=label, **mark))
    low, high = xlim or _limits(sweep, x)
    tops = [u for p, u in voltages if low <= p <= high]
    tops += [max(pair) for p, pair in zip(places, means, strict=True) if low <= p <= high]
    ax.set_xlim(low, high)
    ax.set_ylim(0.0, 1.1e-3 * max(tops, default=1.0) or 1.0)
    _label(ax, x, unit, "output voltage (kV)")
    _legend(ax, handles)
    return ax


def _branch_voltages(ax: Any, membrane: Membrane, diagram: Diagram, x: str) -> list[Any]:
    walls = list(dict.fromkeys(wall for b in diagram.branches for wall in sorted(b.word)))
    colours = dict(zip(walls, style.COLOURS, strict=False))
    for branch in diagram.branches:
        if branch.period > 1:
            continue
        columns = along(membrane, branch)
        good = branch.stable & branch.physical
        for k, wall in enumerate(branch.word):
            for shown, line in ((good, "-"), (~good, (0, (1, 1.6)))):
                values = np.where(shown, columns[f"U{k + 1}"], np.nan) / 1e3
                ax.plot(
                    branch[x], values, color=colours[wall], linewidth=1.0, linestyle=line, zorder=2
                )
    handles = [style.legend_mark(color=colours[w], label=f"$U_k$, wall {w}") for w in walls]
    handles.append(style.legend_mark(color="0.3", label="stable"))
    handles.append(
        style.legend_mark(color="0.3", linestyle=(0, (1, 1.6)), label="unstable or\nunphysical")
    )
    return handles


# Portraits.


def motion(
    simulator: Simulator, attractor: Attractor, periods: int = 0, last: int = SHOWN
) -> tuple[Any, Any, Any, Any]:
    """Return times, positions, velocities of a motion, and the rows of its touches.

    A periodic motion is closed, and repeated if `periods` is more than its own; of another one the
    `last` impacts are taken.

    Returns
    -------
    t, z, v : ndarray
    touches : list of (time, wall, velocity)
    """
    if attractor.period is None:
        rows = slice(-last, None)
        walls, times = attractor.walls[rows], attractor.times[rows]
        speeds, released = attractor.velocities[rows], attractor.released[rows]
    else:
        times_round = max(1, -(-periods // attractor.period))
        span = attractor.period * attractor.forcing_period
        walls = np.tile(attractor.walls, times_round)
        released = np.tile(attractor.released, times_round)
        speeds = np.tile(attractor.velocities, times_round)
        times = np.concatenate([attractor.times + span * k for k in range(times_round)])
        walls, released = np.append(walls, walls[0]), np.append(released, released[0])
        speeds = np.append(speeds, speeds[0])
        times = np.append(times, attractor.times[0] + span * times_round)
    t, z, v = simulator.path(walls, times, speeds, released)
    hits = [row for row in zip(times, walls, speeds, released, strict=True) if not row[3]]
    return t, z, v, [(time, int(wall), speed) for time, wall, speed, _ in hits]


def plot_portrait(
    simulator: Simulator, attractor: Attractor, ax: Any = None, *,
    others: Mapping[str, Attractor] | None = None,
) -> Any:  # fmt: skip
    """Draw the phase plane: velocity against position, with the walls and the touches.

    Parameters
    ----------
    simulator : Simulator
    attractor : Attractor
    ax : matplotlib.axes.Axes, optional
    others : mapping of str to Attractor, optional
        Further orbits at the same parameter values, such as unstable or unphysical ones, by label;
        drawn dashed.
    """
    ax = ax or style.new_figure(4.4, 4.0).add_subplot()
    handles = []
    for number, (label, other) in enumerate((others or {}).items()):
        _, z, v, _ = motion(simulator, other)
        look: dict[str, Any] = {
            "color": ("#D55E00", "#CC79A7", "#E69F00")[number % 3], "linewidth": 1.1,
            "linestyle": ((0, (5, 2)), (0, (1, 1.6)))[number % 2],
        }  # fmt: skip
        ax.plot(z, v, zorder=3, **look)
        handles.append(style.legend_mark(label=label, **look))
    _, z, v, touches = motion(simulator, attractor, last=LOOPS)
    thin = 1.3 if attractor.period is not None else 0.3
    ax.plot(z, v, color="#0072B2", linewidth=thin)
    handles.append(style.legend_mark(color="#0072B2", label=attractor.notation))
    _walls(ax.axvline, simulator)
    for wall, position in enumerate(simulator.positions):
        ax.annotate(
            simulator.letters[wall], (position, 1.0), (0, 3), ha="center", fontsize=8,
            color=style.COLOURS[wall], xycoords=ax.get_xaxis_transform(),
            textcoords="offset points",
        )  # fmt: skip
    for _, wall, speed in touches:
        ax.plot(simulator.positions[wall], speed, color=INK, **MARKS["first"])
    ax.axhline(0.0, color="0.85", linewidth=0.6, zorder=0)
    ax.locator_params(axis="x", nbins=5)
    ax.set_xlabel("$Z$")
    ax.set_ylabel(r"$\dot{Z}$")
    ax.legend(handles=handles, fontsize=7, frameon=False, loc="best")
    return ax


def plot_series(simulator: Simulator, attractor: Attractor, ax: Any = None) -> Any:
    """Draw position against time in forcing periods, with the walls and the touches."""
    ax = ax or style.new_figure(5.2, 3.0).add_subplot()
    periods = 4 if attractor.period is not None else 0
    t, z, _, touches = motion(simulator, attractor, periods)
    begin = np.floor(t[0] / simulator.period)
    ax.plot(t / simulator.period - begin, z, color="#0072B2", linewidth=1.1)
    _walls(ax.axhline, simulator)
    for wall, position in enumerate(simulator.positions):
        ax.annotate(
            simulator.letters[wall], (1.0, position), (4, 0), va="center", fontsize=8,
            color=style.COLOURS[wall], xycoords=ax.get_yaxis_transform(),
            textcoords="offset points",
        )  # fmt: skip
    for time, wall, _ in touches:
        ax.plot(
            time / simulator.period - begin, simulator.positions[wall], color=INK, **MARKS["first"]
        )
    ax.margins(x=0.01)
    ax.set_xlabel("$t/T$")
    ax.set_ylabel("$Z$")
    return ax


def _walls(line: Any, simulator: Simulator) -> None:
    for k, position in enumerate(simulator.positions):
        line(position, color=style.COLOURS[k], linewidth=1.4, zorder=1)


# Basins.


def plot_basins(found: Basins, ax: Any = None) -> Any:
    """Draw which attractor each start leads to, and where the attractors hit the wall."""
    ax = ax or style.new_figure(6.4, 4.4).add_subplot()
    colours = np.array([_rgb(SPOTS[k % len(SPOTS)]) for k in range(len(found.attractors))])
    period = found.attractors[0].forcing_period
    edges_x = np.linspace(0.0, 1.0, len(found.phases) + 1)
    half = 0.5 * abs(found.velocities[1] - found.velocities[0]) if len(found.velocities) > 1 else 1
    low, high = min(found.velocities) - half, max(found.velocities) + half
    image = colours[found.labels]
    if found.velocities[0] > found.velocities[-1]:
        image = image[::-1]
    ax.imshow(
        0.35 + 0.65 * image, origin="lower", extent=(edges_x[0], edges_x[-1], low, high),
        aspect="auto", interpolation="nearest",
    )  # fmt: skip
    handles = []
    marks = ("o", "s", "^", "D", "v", "P", "X")
    for k, (a, share) in enumerate(zip(found.attractors, found.shares, strict=True)):
        look: dict[str, Any] = {
            "linestyle": "none", "marker": marks[k % len(marks)], "markersize": 5,
            "color": SPOTS[k % len(SPOTS)], "markeredgecolor": "k", "markeredgewidth": 0.6,
        }  # fmt: skip
        here = (a.walls == found.wall_number) & ~a.released
        here &= (a.velocities >= low) & (a.velocities <= high)
        size = 5 if a.period is not None else 2
        ax.plot((a.times[here] / period) % 1.0, a.velocities[here], **look | {"markersize": size})
        handles.append(style.legend_mark(label=f"{a.notation}, {share:.0%}", **look))
    ax.set_xlim(0.0, 1.0)
    ax.set_xlabel("time of the first impact, $t/T$")
    ax.set_ylabel(f"velocity before it, on wall {found.wall}")
    _legend(ax, handles)
    return ax


def _rgb(colour: str) -> tuple[float, float, float]:
    if not colour.startswith("#"):
        return (float(colour),) * 3
    red, green, blue = (int(colour[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return red, green, blue


# Files.


def save_simulation(result: Simulation, folder: Path, options: PlotOptions) -> list[str]:
    """Draw all pictures of a simulation to files; returns their names."""
    scene, sweep, name = result.scene, result.sweep, result.scene.name
    declared = scene.model.declared.get(options.x)
    unit = declared.unit if declared else ""
    figures: dict[str, Any] = {
        "attractors": plot_sweep(
            sweep, x=options.x, diagram=result.diagram, xlim=options.xlim or None,
            ylim=options.ylim, unit=unit,
            **({"unphysical": options.unphysical} if result.diagram else {}),
        ).figure,
        "exponents": plot_exponents(sweep, x=options.x, unit=unit).figure,
    }  # fmt: skip
    if scene.energy is not None:
        figures["energy"] = plot_energy(
            scene.energy, sweep, x=options.x, diagram=result.diagram, xlim=options.xlim, unit=unit
        ).figure
    simulators = Simulators(scene.model, scene.parameter)
    for number, row in enumerate(result.portraits, start=1):
        simulator = simulators.at(row.value)
        figures[f"portrait{number}"] = portrait_figure(
            simulator, row, _others(result, row, simulator), options.x
        )
    for number, found in enumerate(result.basins, start=1):
        figures[f"basins{number}"] = plot_basins(found).figure
    contents: dict[str, Content] = {}
    for stem, figure in figures.items():
        contents |= style.pictures(figure, stem, options.formats, name)
    return write_all(folder, contents)


def portrait_figure(simulator: Simulator, row: Row, others: Mapping[str, Attractor], x: str) -> Any:
    """Return a figure with the phase plane and the time series of an attractor."""
    figure = style.new_figure(9.0, 3.6)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.5))
    if row.attractor.kind in (Kind.RESTING, Kind.NO_IMPACT):
        left.set_title(row.attractor.notation)
        return figure
    plot_portrait(simulator, row.attractor, left, others=others)
    plot_series(simulator, row.attractor, right)
    value = row.attractor.parameters[x]
    figure.suptitle(f"{symbol(x)} = {value:.6g}: {row.attractor.notation}", fontsize=10)
    return figure


def _others(result: Simulation, row: Row, simulator: Simulator) -> dict[str, Attractor]:
    """Orbits of period T on the branches at a value that cannot be observed.

    Of each notation and state the one with the fastest impact.
    """
    if result.diagram is None:
        return {}
    from ..attractors.coverage import orbits_on

    found: dict[str, Attractor] = {}
    for branch in result.diagram.branches:
        if branch.period > 1:
            continue
        for orbit in orbits_on(branch, result.sweep, row.value, simulator.kernels):
            if not (orbit.stable and orbit.physical):
                state = "unstable" if orbit.physical else "unphysical"
                label = f"{branch.notation}, {state}"
                other = _as_attractor(branch, orbit, simulator)
                known = found.get(label)
                if known is None or _fastest(other) > _fastest(known):
                    found[label] = other
    return found


def _fastest(attractor: Attractor) -> float:
    return float(np.max(np.abs(attractor.velocities)))


def _as_attractor(branch: Branch, orbit: Orbit, simulator: Simulator) -> Attractor:
    walls = np.array([simulator.letters.index(letter) for letter in branch.word])
    return Attractor(
        Kind.PERIODIC, {}, branch.notation, simulator.period, branch.word, branch.period, walls,
        orbit.times, orbit.velocities, np.zeros(len(walls), dtype=bool),
    )  # fmt: skip
