"""Attractors drawn: sweeps, portraits, basins and energies.

In the manner of Figs. 7, 8, 11 and 12 of the paper on vibro-impact pairs. Attractors are open
circles beneath the branches, in the colours of the walls. Where sweeps in both directions are
drawn, circles are those of the one along which the drawn axis falls, and crosses show where the
other one met other attractors. Attractors are named at the lower edge. Colours and line styles are
those of `contimpact.plots.diagram`, and the same in print without colours: what differs in colour
differs in marker, style or panel as well.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.patches import Patch

from ..arrays import Array
from ..display import draw_result
from ..errors import InputError, explain_arguments
from ..models.model import Model
from ..orbits.orbit import Orbit
from ..results.branch import Branch
from ..results.catalogue import Share, shorten_names
from ..results.diagram import Diagram
from ..results.quantities import branch_voltages, direction_text
from ..simulation.attractor import Attractor, Kind
from ..simulation.energy import attractor_voltages
from ..simulation.integrity import BasinFractions
from ..simulation.manifolds import Manifold
from ..simulation.run import Run
from ..simulation.simulator import Simulator, state_after
from ..simulation.sweep import Basins, Row, Simulators, Sweep, same_attractor
from ..storage import Content, write_all
from ..systems.membrane import Membrane
from . import diagram as style
from .lines import (
    STYLES,
    VELOCITY,
    WIDTHS,
    label_axis,
    plain_text,
    runs,
    symbol,
    units_of,
    values_text,
    walls_of,
)

if TYPE_CHECKING:
    from ..diagrams.scene_simulation import Simulation
    from ..results.options import PlotOptions


# Phase planes and time series of simulated motion, in the manner of Figs. 5, 7 and 8 of the paper.
#
# The attractor is black and solid, with a circle at each impact. Orbits beside it have the line
# styles of diagrams: unstable ones are dashed, unphysical ones dotted. They differ in colour and in
# width, so that those that lie on one another can all be seen.

INK_OF_PORTRAITS = "0.1"
TOUCH: dict[str, Any] = {
    "marker": "o",
    "markerfacecolor": "white",
    "color": INK_OF_PORTRAITS,
    "zorder": 5,
}
TOUCH |= {"markersize": 3.4, "markeredgewidth": 0.7}
OTHERS = ("#D55E00", "#009E73", "#CC79A7", "#56B4E9")
"""Colours of orbits beside the attractor; none is a wall's."""
QUIET_POINTS = 200
"""Points drawn of a motion without impacts in a period."""
SHOWN = 40
"""Impacts drawn of a motion that is not periodic, in diagrams and time series."""
LOOPS = 160
"""Impacts drawn of such a motion in the phase plane."""


def motion(
    simulator: Simulator, attractor: Attractor, periods: int = 0, last: int = SHOWN
) -> tuple[Any, Any, Any, Any]:
    """Return times (n,), positions and velocities (n, coordinates; those of `coordinates_of`) of a
    motion, and its touches: (time, wall, velocity).

    A periodic motion is closed, and repeated if `periods` is more than its own; of another one the
    `last` impacts are taken.
    """
    if not attractor.times.size:
        return _quiet_motion(simulator, attractor, periods)
    columns = [attractor.walls, attractor.velocities, attractor.released]
    columns += [attractor.others, attractor.held] if attractor.held.size else []
    if attractor.period is None:
        times = attractor.times[-last:]
        columns = [column[-last:] for column in columns]
    else:
        span = attractor.duration
        times_round = max(1, math.ceil(periods * simulator.period / span))
        rows = np.arange(len(attractor.walls) * times_round + 1)
        turns, places = np.divmod(rows, len(attractor.walls))
        times = attractor.times[places] + span * turns
        columns = [column[places] for column in columns]
    walls, speeds, released, *others = columns
    given: dict[str, Any] = dict(zip(("others", "held"), others, strict=False))
    t, z, v = simulator.path(walls, times, speeds, released, **given)
    z, v = (
        part[:, coordinates_of(simulator)] if part.ndim == 2 else part[:, None] for part in (z, v)
    )
    hits = [row for row in zip(times, walls, speeds, released, strict=True) if not row[3]]
    return t, z, v, [(time, int(wall), speed) for time, wall, speed, _ in hits]


def _quiet_motion(
    simulator: Simulator, attractor: Attractor, periods: int
) -> tuple[Any, Any, Any, Any]:
    """Return the same of a motion without impacts that has the forcing's period."""
    assert attractor.motion is not None
    span = attractor.span if attractor.span > 0.0 else simulator.period
    t = np.linspace(0.0, span, QUIET_POINTS)
    states = (state_after(simulator, attractor.mode, attractor.motion, time) for time in t.tolist())
    x, v = np.array([*states]).transpose(1, 0, 2)
    guards = simulator.model.WALLS
    turns = max(1, math.ceil(periods * simulator.period / span))
    rows = np.array([guards[k].row(x.shape[1]) for k in coordinates_of(simulator)]).T
    times = np.concatenate([t + turn * span for turn in range(turns)])
    return times, np.tile(x @ rows, (turns, 1)), np.tile(v @ rows, (turns, 1)), []


def attractor_of_run(run: Run, model: Model | None = None) -> Attractor:
    """Return a run's impacts as a motion that is drawn as it is.

    Raises InputError if neither the run nor the call names the system, or there is no impact.
    """
    model = model or run.model
    if model is None:
        accepted = "give the model it was simulated with as model="
        raise InputError("model", "missing: a run in a file does not name its system", accepted)
    if not len(run):
        raise InputError("run", "it has no impacts", "give a longer one")
    table = {n: getattr(run, n) for n in ("walls", "times", "velocities", "released")}
    if run.held.size:
        table |= {"others": run.others, "held": run.held}
    known = model.parameters
    return Attractor(
        Kind.NOT_SETTLED, known, f"{len(run)} impacts", run.period, **table, model=model
    )


def coordinates_of(simulator: Simulator) -> list[int]:
    """Return a guard for each gap coordinate there is."""
    size = simulator.model.DEGREES_OF_FREEDOM
    rows = [guard.row(size) for guard in simulator.model.WALLS]
    return [rows.index(row) for row in dict.fromkeys(rows)]


def _inks(simulator: Simulator, ink: str) -> list[tuple[int, str]]:
    """Columns of gap coordinates and their colours: with several, that of the coordinate's wall."""
    found = coordinates_of(simulator)
    if len(found) == 1:
        return [(0, ink)]
    return [(i, style.COLOURS[k % len(style.COLOURS)]) for i, k in enumerate(found)]


def plot_portrait(
    simulator: Simulator,
    attractor: Attractor,
    ax: Any = None,
    *,
    others: Mapping[str, Attractor] | None = None,
) -> Any:
    """Draw the phase plane: velocity against position, with the walls and the touches.

    `others` are further orbits at the same parameter values, by label. One that ends in
    ``unstable`` or ``unphysical`` is drawn in the style of its state, others solid.
    """
    ax = ax or style.new_figure(4.4, 4.0).add_subplot()
    handles = []
    _, z, v, touches = motion(simulator, attractor, last=LOOPS)
    closed = attractor.period is not None or attractor.motion is not None
    for column, ink in _inks(simulator, INK_OF_PORTRAITS if closed else "0.45"):
        ax.plot(z[:, column], v[:, column], color=ink, linewidth=1.5 if closed else 0.3)
    handles.append(style.legend_mark(color=INK_OF_PORTRAITS, label=plain_text(attractor.notation)))
    for (label, other), look in zip(
        (others or {}).items(), _orbit_styles(list(others or {})), strict=True
    ):
        _, z, v, _ = motion(simulator, other)
        ax.plot(z, v, **look)
        handles.append(style.legend_mark(label=label, **look))
    draw_walls(ax, simulator.positions, across=False)
    name_walls(ax, simulator.letters, simulator.positions, across=False)
    for _, wall, speed in touches:
        ax.plot(simulator.positions[wall], speed, **TOUCH)
    ax.axhline(0.0, color="0.85", linewidth=0.6, zorder=0)
    ax.locator_params(axis="x", nbins=5)
    place, velocity = names_of_gaps(simulator.model)
    ax.set_xlabel(place)
    ax.set_ylabel(velocity)
    below: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.16), "ncols": 2}
    ax.legend(handles=handles, fontsize=7, frameon=False, handlelength=3.2, **below)
    return ax


def _orbit_styles(labels: Sequence[str]) -> list[dict[str, Any]]:
    """Colour, width and style of orbits beside an attractor: the style tells the state, each is
    narrower than those beneath it."""
    found = []
    for number, label in enumerate(labels):
        state = label.rpartition(" ")[2]
        colour, width = OTHERS[number % len(OTHERS)], max(1.0, 2.8 - 0.8 * number)
        look = {"color": colour, "linewidth": width, "linestyle": STYLES.get(state, "-")}
        found.append(look | {"zorder": 3 + 0.01 * number})
    return found


def plot_series(simulator: Simulator, attractor: Attractor, ax: Any = None) -> Any:
    """Draw position against time, in forcing periods if there are any, with the walls and the
    touches."""
    ax = ax or style.new_figure(5.2, 3.0).add_subplot()
    periods = 4 if attractor.period is not None or attractor.motion is not None else 0
    t, z, _, touches = motion(simulator, attractor, periods)
    unit, name = (1.0, "$t$") if attractor.free else (simulator.period, "$t/T$")
    begin = np.floor(t[0] / unit)
    for column, ink in _inks(simulator, INK_OF_PORTRAITS):
        ax.plot(t / unit - begin, z[:, column], color=ink, linewidth=1.1)
    draw_walls(ax, simulator.positions, across=True)
    name_walls(ax, simulator.letters, simulator.positions, across=True)
    for time, wall, _ in touches:
        ax.plot(time / unit - begin, simulator.positions[wall], **TOUCH)
    ax.margins(x=0.01)
    ax.set_xlabel(name)
    ax.set_ylabel(names_of_gaps(simulator.model)[0])
    return ax


def names_of_gaps(model: Model) -> tuple[str, str]:
    """Return what axes of gap coordinates and of their velocities are called: by the system's own
    names, Z where it has none."""
    size, found = model.DEGREES_OF_FREEDOM, dict[tuple[float, ...], tuple[str, str]]()
    for guard in model.WALLS:
        pairs, row = model.state_names(guard.modes[0] if guard.modes else ""), guard.row(size)
        parts = [(c, *pair) for c, pair in zip(row, pairs, strict=False) if c]
        if not all(name.isidentifier() for _, name, _ in parts):
            several = len({other.row(size) for other in model.WALLS}) > 1
            return ("gap coordinates", "their velocities") if several else ("$Z$", r"$\dot{Z}$")
        place = _sum_of([(c, name) for c, name, _ in parts])
        rates = [(c, rate) for c, _, rate in parts if rate.isidentifier()]
        found[row] = place, _sum_of(rates) if len(rates) == len(parts) else f"rate of {place}"
    places, velocities = zip(*found.values(), strict=True)
    return ", ".join(places), ", ".join(velocities)


def _sum_of(parts: Sequence[tuple[float, str]]) -> str:
    """A sum of names with factors, as it is set."""
    text = ""
    for c, name in sorted(parts, key=lambda part: part[0] < 0.0):
        sign = "$-$ " if c < 0.0 else "+ " if text else ""
        factor = "" if abs(c) == 1.0 else f"{abs(c):g} "
        text += f"{' ' * bool(text)}{sign}{factor}{symbol(name)}"
    return text


def draw_walls(ax: Any, places: Sequence[float], across: bool) -> None:
    """Draw walls as lines, across the axes or upright."""
    for k, place in enumerate(places):
        line = ax.axhline if across else ax.axvline
        line(place, color=style.COLOURS[k % len(style.COLOURS)], linewidth=1.4, zorder=1)


def name_walls(ax: Any, letters: Sequence[str], places: Sequence[float], across: bool) -> None:
    """Name walls beside the axes or above them, in one text those that share a place."""
    found: dict[float, list[int]] = {}
    for number, place in enumerate(places):
        found.setdefault(round(float(place), 9), []).append(number)
    for place, walls in found.items():
        at, offset = ((1.0, place), (4, 0)) if across else ((place, 1.0), (0, 3))
        frame = ax.get_yaxis_transform() if across else ax.get_xaxis_transform()
        look: dict[str, Any] = {"va": "center"} if across else {"ha": "center"}
        look |= {"xycoords": frame, "textcoords": "offset points", "fontsize": 8}
        colour = style.COLOURS[walls[0] % len(style.COLOURS)]
        ax.annotate(", ".join(letters[k] for k in walls), at, offset, color=colour, **look)


def portrait_figure(
    simulator: Simulator, attractor: Attractor, others: Mapping[str, Attractor]
) -> Any:
    """Return a figure with the phase plane and the time series of an attractor."""
    figure = style.new_figure(9.0, 4.0)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.5))
    mode, quiet = attractor.mode, attractor.motion
    drawn = quiet is not None and state_after(simulator, mode, quiet, simulator.period)
    if not (attractor.times.size or drawn):
        left.set_title(f"{plain_text(attractor.notation)}: its motion is not known", loc="left")
        for ax in (left, right):
            ax.set_axis_off()
        return figure
    plot_portrait(simulator, attractor, left, others=others)
    plot_series(simulator, attractor, right)
    return figure


def others_at(result: Simulation, row: Row, simulator: Simulator) -> dict[str, Attractor]:
    """Return the orbits of period T on the branches at a value that cannot be observed.

    Of each notation and state the one with the fastest impact.
    """
    if result.diagram is None:
        return {}
    from ..simulation.sweep import orbits_on

    found: dict[str, Attractor] = {}
    for branch in result.diagram.branches:
        if branch.period > 1 or not branch.word:
            continue
        for orbit in orbits_on(branch, result.sweep, row.value, simulator.kernels):
            if not (orbit.stable and orbit.physical):
                state = "unstable" if orbit.physical else "unphysical"
                label = f"{plain_text(branch.notation)}, {state}"
                other = _attractor_of(branch, orbit, simulator)
                known = found.get(label)
                if known is None or other.fastest > known.fastest:
                    found[label] = other
    return found


def _attractor_of(branch: Branch, orbit: Orbit, simulator: Simulator) -> Attractor:
    walls = np.array([simulator.letters.index(letter) for letter in branch.word])
    others, none = orbit.problem.impacts(orbit.unknowns)[:, 2:], np.zeros(len(walls), np.int64)
    table = (walls, orbit.times, orbit.velocities, none > 0, others, none)
    what = branch.notation, simulator.period, branch.word, branch.period
    return Attractor(Kind.PERIODIC, {}, *what, *table, span=orbit.period)


MARKS: dict[str, dict[str, Any]] = {
    "first": {"marker": "o", "markersize": 3.2, "markeredgewidth": 0.6, "zorder": 1.5},
    "second": {"marker": "x", "markersize": 3.8, "markeredgewidth": 0.9, "zorder": 4},
    "random": {"marker": "D", "markersize": 3.4, "markeredgewidth": 0.7, "zorder": 4},
}
"""Markers of the sweep done first, beneath the branches; of the other one; of random starts."""
HOLLOW: dict[str, Any] = {"markerfacecolor": "none", "linestyle": "none"}
INK = "0.25"
ROOM = 0.09
"""Part of a picture at its lower edge in which attractors are named."""
SPOTS = (*style.COLOURS, "#56B4E9", "#D0B000", "0.45")


@explain_arguments
def plot_sweep(
    sweep: Sweep,
    ax: Any = None,
    *,
    x: str | None = None,
    diagram: Diagram | None = None,
    xlim: tuple[float, float] | None = None,
    ylim: tuple[float, float] | None = None,
    unit: str = "",
    fractions: Sequence[Share] = (),
    **options: Any,
) -> Any:
    """Draw attractors as open circles, with branches over them if there are any.

    Circles are the sweep along which the drawn axis falls; of the other one what the first met at
    the same value is left out.

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
    fractions : sequence of Share
        Basin fractions, drawn as stacked bands below; not in axes that are given.
    **options
        Of `contimpact.plots.diagram.plot_diagram`.

    Returns
    -------
    matplotlib.axes.Axes
    """
    own = ax is None
    ax = ax or style.fixed_axes()
    x = x or sweep.parameter
    xlim = xlim or _limits(sweep, x)
    if diagram is not None:
        style.plot_diagram(diagram, ax, x=x, xlim=xlim, ylim=ylim, unit=unit, **options)
    entries = list(getattr(ax.get_legend(), "legend_handles", []) or [])
    walls = sweep.model.letters
    colours = style.colours_of(walls)
    if diagram is None:
        entries = [style.legend_mark(color=c, label=f"wall {w}") for w, c in colours.items()]
    else:  # walls that only simulated motion meets
        known = {handle.get_label() for handle in entries}
        met = {int(wall) for row in sweep.rows for wall in row.attractor.walls}
        more = [w for k, w in enumerate(walls) if k in met and f"wall {w}" not in known]
        entries[:0] = [style.legend_mark(color=colours[w], label=f"wall {w}") for w in more]
    speeds, (low, high) = [0.0], sorted(xlim)
    ways = _directions(sweep, x)
    for number, (direction, mark) in enumerate(_marks(ways).items()):
        rows = sweep.of(direction) if number == 0 else _new_rows(sweep, direction, ways[0])
        for wall, colour in enumerate(colours.values()):
            places, values = _points(rows, x, wall)
            ax.plot(places, values, color=colour, **mark, **HOLLOW)
            speeds += [v for at, v in zip(places, values, strict=True) if low <= at <= high]
        places = [r[x] for r in rows if r.attractor.kind is Kind.NO_IMPACT]
        ax.plot(places, [0.0] * len(places), color=style.NO_WALL, **mark, **HOLLOW)
        if number and not rows:
            continue
        text = f"simulated, {_direction_text(sweep, direction, x)}" + (": others" if number else "")
        entries.append(style.legend_mark(label=text, color=INK, **mark, **HOLLOW))
    if sweep.interrupted:
        text = "interrupted: values or directions are missing"
        entries.append(style.legend_mark(label=text, linestyle="none"))
    ax.set_xlim(*xlim)
    bottom, top = (0.0, 0.0) if diagram is None else ax.get_ylim()
    margin = 0.06 * (max(speeds) - min(speeds) or 1.0)
    bottom = bottom if bottom < min(speeds) else min(speeds) - margin
    top = top if top > max(speeds) else max(speeds) + margin
    ax.set_ylim(*(ylim or (bottom, top)))
    if diagram is None:
        ax.axhline(0.0, color="0.75", linewidth=0.6, zorder=0)
        label_axis(ax.xaxis, x, unit)
        ax.set_ylabel("impact velocity (before impact)")
    if ways:
        _name_attractors(ax, sweep, ways[0], x, widen=ylim is None)
    below = None
    if own and fractions:
        below = style.axes_below(ax)
        values = sorted({share.value for share in fractions})
        drawn = {v: sweep.model.replace(**{sweep.parameter: v})[x] for v in values}
        entries += _draw_bands(below, fractions, drawn)
        below.set_xlim(*ax.get_xlim())
        _label(below, x, unit, "basin\nfraction")
    style.draw_legend(below or ax, entries)
    if own:
        style.fit(ax, below)
    return ax


def _directions(sweep: Sweep, x: str) -> list[str]:
    """The directions of a sweep: that first along which the drawn axis falls, as in the paper."""
    return sorted(sweep.directions, key=lambda way: (way == "random", _axis_rises(sweep, way, x)))


def _axis_rises(sweep: Sweep, direction: str, x: str) -> bool:
    """Whether the drawn axis rises along a sweep."""
    rows = sweep.of(direction)
    return rows[-1][x] > rows[0][x]


def _direction_text(sweep: Sweep, direction: str, x: str) -> str:
    """What a sweep changes, with an arrow along the drawn axis."""
    if direction == "random":
        return "random starts"
    arrow = r"\rightarrow" if _axis_rises(sweep, direction, x) else r"\leftarrow"
    return f"{direction_text(symbol(sweep.parameter), direction == 'up')} (${arrow}$)"


def _name_attractors(ax: Any, sweep: Sweep, direction: str, x: str, widen: bool) -> None:
    """Name the attractors of one direction at the lower edge, each over the values at which it is
    met, as far as there is room; an arrow beside the axis shows the direction."""
    (low, high), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    if widen:
        ax.set_ylim(bottom - ROOM * (top - bottom), top)
    transform = ax.get_xaxis_transform()
    scale = ax.get_window_extent().width / ax.figure.dpi * 72.0 / (high - low)
    rows = [r for r in sweep.of(direction) if low <= r[x] <= high]
    edges = [k for k in range(1, len(rows)) if _name(rows[k]) != _name(rows[k - 1])]
    for first, beyond in itertools.pairwise([0, *edges, len(rows)]):
        if first == beyond:
            continue
        here = [row[x] for row in rows[max(first - 1, 0) : beyond + 1]]
        ends = [0.5 * sum(here[:2]) if first else here[0], here[-1]]
        ends[1] = 0.5 * sum(here[-2:]) if beyond < len(rows) else here[-1]
        text = plain_text(_name(rows[first]))
        if abs(ends[1] - ends[0]) * scale < 0.9 * style.text_width(text) + 3.0:
            continue
        ax.plot(
            ends,
            [0.012] * 2,
            transform=transform,
            color=INK,
            linewidth=0.8,
            marker="|",
            markersize=4,
        )
        where: dict[str, Any] = {"ha": "center", "va": "bottom", "fontsize": 7, "gid": "attractor"}
        ax.text(0.5 * sum(ends), 0.022, text, transform=transform, color=INK, **where)
    if direction != "random":
        look: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points"}
        text = _direction_text(sweep, direction, x)
        where = {"ha": "right", "va": "top", "fontsize": 8, "color": INK}
        ax.annotate(text, (1.0, 0.0), (0, -21), **look, **where)


def _name(row: Row) -> str:
    """What an attractor is called beside the axis: motions that stick alike."""
    return "sticking" if row.attractor.kind is Kind.STICKING else row.attractor.notation


def _new_rows(sweep: Sweep, direction: str, first: str) -> list[Row]:
    """The rows of a direction, without what the first one met at the same values."""
    met = {row.value: row.attractor for row in sweep.of(first)}
    rows = sweep.of(direction)
    return [r for r in rows if r.value not in met or not same_attractor(met[r.value], r.attractor)]


def _marks(ways: Sequence[str]) -> dict[str, dict[str, Any]]:
    """A marker for each direction of a sweep."""
    names = ("first", "second")
    return {w: MARKS["random" if w == "random" else names[k > 0]] for k, w in enumerate(ways)}


def _limits(sweep: Sweep, x: str) -> tuple[float, float]:
    values = [row[x] for row in sweep.rows]
    if not values:
        raise InputError("sweep", "no attractors", "sweep at least one value")
    margin = 0.015 * (max(values) - min(values) or 1.0)
    return min(values) - margin, max(values) + margin


def _points(rows: Sequence[Row], x: str, wall: int) -> tuple[list[float], list[float]]:
    """Impacts on a wall; of motions that are not periodic the last ones."""
    places: list[float] = []
    values: list[float] = []
    for row in rows:
        a = row.attractor
        hit = np.nonzero(~a.released)[0]
        hit = hit if a.period is not None else hit[-SHOWN:]
        speeds = a.velocities[hit[a.walls[hit] == wall]]
        places += [row[x]] * len(speeds)
        values += speeds.tolist()
    return places, values


def _label(ax: Any, x: str, unit: str, y: str) -> None:
    label_axis(ax.xaxis, x, unit)
    ax.set_ylabel(y)


def _legend(ax: Any, handles: Sequence[Any]) -> None:
    beside: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (1.045, 1.0)}
    ax.legend(handles=list(handles), fontsize=8, frameon=False, borderaxespad=0.0, **beside)


# Exponents and energy.


def plot_exponents(sweep: Sweep, ax: Any = None, *, x: str | None = None, unit: str = "") -> Any:
    """Draw the largest Lyapunov exponent per forcing period, without forcing per unit of time.

    Periodic motion is drawn open, complex motion filled with bars of one standard error; motion
    that sticks has no finite exponent and is marked at the lower edge, as is periodic motion whose
    exponents rounding takes.
    """
    ax = ax or style.new_figure(7.2, 3.6).add_subplot()
    x = x or sweep.parameter
    finite = [r for r in sweep.rows if np.isfinite(r.attractor.per_period)]
    sticking = [
        r
        for r in sweep.rows
        if r.attractor.kind is Kind.STICKING
        or (r.attractor.kind is Kind.COMPLEX and r.attractor.per_period == -math.inf)
    ]
    of_one = [r for r in sweep.rows if r.attractor.kind is Kind.PERIODIC]
    lost = [r for r in of_one if math.isnan(r.attractor.per_period)]
    handles = []
    ax.axhline(0.0, color="0.6", linewidth=0.8, zorder=0)
    of_kind = {kind: [r for r in finite if r.attractor.kind is kind] for kind in Kind}
    looks = {
        "periodic": ([r for r in finite if r.attractor.period is not None], "none", "0.15"),
        "complex": (of_kind[Kind.COMPLEX], "#D55E00", "#D55E00"),
        "not settled": (of_kind[Kind.NOT_SETTLED], "0.7", "0.4"),
    }
    for name, (rows, face, edge) in looks.items():
        if not rows:
            continue
        places = [r[x] for r in rows]
        errors = [r.attractor.error * r.attractor.rate for r in rows]
        mark = {"marker": "o", "markersize": 3.2, "markerfacecolor": face, "color": edge}
        values = [r.attractor.per_period for r in rows]
        ax.errorbar(places, values, yerr=errors, linestyle="none", elinewidth=0.8, **mark)
        handles.append(style.legend_mark(linestyle="none", label=name, **mark))
    for name, rows, shape in (("sticking", sticking, "v"), ("below rounding", lost, "x")):
        if rows:
            mark = {"marker": shape, "markersize": 4, "color": "0.15", "linestyle": "none"}
            places = [r[x] for r in rows]
            ax.plot(places, [0.02] * len(places), transform=ax.get_xaxis_transform(), **mark)
            handles.append(style.legend_mark(label=name, **mark))
    ax.set_xlim(*_limits(sweep, x))
    per = "unit of time" if sweep.model.autonomous else "period"
    _label(ax, x, unit, f"largest exponent per {per}")
    _legend(ax, handles)
    return ax


@explain_arguments
def plot_energy(
    sweep: Any,
    membrane: Any = None,
    ax: Any = None,
    *,
    x: str | None = None,
    diagram: Diagram | None = None,
    xlim: tuple[float, float] | None = None,
    unit: str = "",
) -> Any:
    """Draw the output voltages of attractors, and of the branches of period T.

    Open circles are U_k of each impact, squares the mean per impact, triangles the mean per unit of
    dimensionless time; lines are U_k along the branches, by wall, of physical orbits. Only the
    direction of a sweep along which the drawn axis falls is shown.

    Parameters
    ----------
    sweep : Sweep
    membrane : Membrane, optional
        With the paper's values by default; may also be given before the sweep.
    ax : matplotlib.axes.Axes, optional
    x : str, optional
        Parameter on the x axis; the swept one by default.
    diagram : Diagram, optional
        Whose branches of period T are drawn.
    xlim : (low, high), optional
    unit : str
        Of x.

    Returns
    -------
    matplotlib.axes.Axes
    """
    if isinstance(sweep, Membrane):
        sweep, membrane = membrane, sweep
    membrane = membrane or Membrane()
    ax = ax or style.new_figure().add_subplot()
    x = x or sweep.parameter
    first = sweep.of(_directions(sweep, x)[0]) if sweep.rows else []
    handles = []
    if diagram is not None:
        handles += _branch_voltages(ax, membrane, diagram, x)
    voltages, means, places = [], [], []
    for row in first:
        energy = attractor_voltages(membrane, row.attractor)
        place = row[x]
        shown = energy.impacts if row.attractor.period else energy.impacts[-SHOWN:]
        voltages += [(place, u) for u in shown.tolist()]
        means.append((energy.per_impact, energy.per_time))
        places.append(place)
    sticks = any(row.attractor.kind is Kind.STICKING for row in first)
    accumulates = "\n(0 where impacts accumulate)" if sticks else ""
    square = {"marker": "s", "markersize": 3.0, "color": "#D55E00", "zorder": 4}
    triangle = {"marker": "^", "markersize": 3.2, "color": "#CC79A7", "zorder": 4}
    per_impact = r"$\bar{U}_I$, per impact" + accumulates
    looks: list[tuple[str, list[float], list[float], dict[str, Any]]] = [
        (
            "$U_k$",
            [p for p, _ in voltages],
            [u for _, u in voltages],
            {"color": "0.4", "markerfacecolor": "none"} | MARKS["first"],
        ),
        (per_impact, places, [m[0] for m in means], square),
        (r"$\bar{U}_T$, per time", places, [m[1] for m in means], triangle),
    ]
    for label, at, values, mark in looks:
        ax.plot(at, np.array(values) / 1e3, linestyle="none", **mark)
        handles.append(style.legend_mark(linestyle="none", label=label, **mark))
    low, high = xlim or _limits(sweep, x)
    tops = [u for p, u in voltages if low <= p <= high]
    tops += [max(pair) for p, pair in zip(places, means, strict=True) if low <= p <= high]
    ax.set_xlim(low, high)
    ax.set_ylim(0.0, 1.1e-3 * max(tops, default=1.0) or 1.0)
    _label(ax, x, unit, "output voltage (kV)")
    if first:
        corner: dict[str, Any] = {
            "transform": ax.transAxes,
            "ha": "right",
            "va": "top",
            "fontsize": 8,
        }
        ax.text(0.985, 0.975, _direction_text(sweep, first[0].direction, x), **corner)
    _legend(ax, handles)
    return ax


def _branch_voltages(ax: Any, membrane: Membrane, diagram: Diagram, x: str) -> list[Any]:
    walls = list(dict.fromkeys(wall for b in diagram.branches for wall in sorted(b.word)))
    colours = style.colours_of(walls_of(diagram.branches, walls))
    used: set[str] = set()
    for branch in diagram.branches:
        if branch.period > 1:
            continue
        columns = branch_voltages(membrane, branch)
        for first, last, state in runs(branch):
            if state == "unphysical":
                continue
            rows = slice(first, last + 1)
            used.add(state)
            for k, wall in enumerate(branch.word):
                line = {"linewidth": WIDTHS[state], "linestyle": STYLES[state]}
                volts = columns[f"U{k + 1}"][rows]
                ax.plot(branch[x][rows], volts / 1e3, color=colours[wall], zorder=2, **line)
    handles = [style.legend_mark(color=colours[w], label=f"$U_k$, wall {w}") for w in walls]
    return handles + style.style_marks([state for state in STYLES if state in used])


# Basins.


@draw_result.register(Basins)
@explain_arguments
def plot_basins(found: Basins, ax: Any = None) -> Any:
    """Draw which attractor each start leads to, and where the attractors hit the wall.

    Parameters
    ----------
    found : Basins
    ax : matplotlib.axes.Axes, optional
        A new figure otherwise.

    Returns
    -------
    matplotlib.axes.Axes
    """
    ax = ax or style.new_figure(6.4, 4.4).add_subplot()
    colours = np.array([to_rgb(SPOTS[k % len(SPOTS)]) for k in range(len(found.attractors))])
    if not found.attractors:
        raise InputError("basins", "no start was made", "let it run for longer")
    period = found.attractors[0].forcing_period
    half = 0.5 * abs(found.velocities[1] - found.velocities[0]) if len(found.velocities) > 1 else 1
    low, high = min(found.velocities) - half, max(found.velocities) + half
    image = np.where(found.labels[..., None] < 0, 1.0, colours[found.labels])
    if found.velocities[0] > found.velocities[-1]:
        image = image[::-1]
    extent, pixels = (0.0, 1.0, low, high), {"origin": "lower", "interpolation": "nearest"}
    ax.imshow(0.35 + 0.65 * image, extent=extent, aspect="auto", **pixels)
    handles = []
    marks = ("o", "s", "^", "D", "v", "P", "X")
    for k, (a, share) in enumerate(zip(found.attractors, found.shares, strict=True)):
        look: dict[str, Any] = {"linestyle": "none", "markersize": 5, "markeredgecolor": "k"}
        look |= {"marker": marks[k % len(marks)], "color": SPOTS[k % len(SPOTS)]}
        look |= {"markeredgewidth": 0.6}
        here = (a.walls == found.wall_number) & ~a.released
        here &= (a.velocities >= low) & (a.velocities <= high)
        size = 5 if a.period is not None else 2
        drawn = look | {"markersize": size, "clip_on": False}
        ax.plot((a.times[here] / period) % 1.0, a.velocities[here], **drawn)
        handles.append(style.legend_mark(label=f"{plain_text(a.notation)}, {share:.0%}", **look))
    ax.set_xlim(0.0, 1.0)
    ax.set_title(f"{len(found.phases)} by {len(found.velocities)} starts", fontsize=8, loc="right")
    ax.set_xlabel("time of the first impact, $t/T$")
    ax.set_ylabel(f"velocity before it, on wall {found.wall}")
    _legend(ax, handles)
    return ax


HATCHES = ("", "///", "...", "xxx", "\\\\\\", "ooo")


@draw_result.register(BasinFractions)
@explain_arguments
def plot_fractions(
    found: BasinFractions, ax: Any = None, *, x: str | None = None, unit: str = ""
) -> Any:
    """Draw basin fractions as stacked bands, with the interval of each at its upper edge.

    Returns the axes, such as those below a diagram; new ones by default. On their x axis is the
    parameter, or the derived parameter x, in this unit.
    """
    ax = ax or style.new_figure(7.2, 3.6).add_subplot()
    name = x or found.parameter
    places = [next(iter(there.values())).parameters[name] for there in found.attractors]
    handles = _draw_bands(ax, found.shares, dict(zip(found.values, places, strict=True)))
    ax.margins(x=0.02 if len(places) > 1 else 0.0)  # the intervals at both ends are seen
    if len(places) == 1:
        ax.set_xticks(places)
    counted = f"{found.starts} starts, {100 * found.confidence:g} % intervals"
    ax.set_title(counted, fontsize=8, loc="right")
    _label(ax, name, unit, "basin fraction")
    _legend(ax, handles)
    return ax


def _across(x: Array) -> Array:
    """Return the places between which bands are drawn: about a single one, a hundredth of it."""
    return x if len(x) > 1 else x + 0.005 * (abs(x[0]) or 1.0) * np.array([-1.0, 1.0])


def _draw_bands(ax: Any, shares: Sequence[Share], places: Mapping[float, float]) -> list[Any]:
    """Draw stacked bands at the places of the values; returns what a legend has of them."""
    handles, x = [], np.array(list(places.values()))
    under, across = np.zeros(len(x)), _across(x)
    for number in sorted({share.motion for share in shares}):
        own = {share.value: share for share in shares if share.motion == number}
        k = number - 1
        look: dict[str, Any] = {"facecolor": (*to_rgb(SPOTS[k % len(SPOTS)]), 0.45)}
        look |= {"edgecolor": "0.35", "linewidth": 0.4, "hatch": HATCHES[k % len(HATCHES)]}
        none = Share(math.nan, "", 0.0, low=0.0, high=0.0)
        part, low, high = np.array(
            [(s.fraction, s.low, s.high) for s in (own.get(value, none) for value in places)]
        ).T
        top = under + part
        ax.fill_between(
            across, np.resize(under, across.shape), np.resize(top, across.shape), **look
        )
        inside = (part > 0.0) & (top < 1.0 - 1e-9)
        bars = {"fmt": "none", "ecolor": "k", "elinewidth": 0.8, "capsize": 2.0}
        errors = np.array([part - low, high - part])[:, inside]
        ax.errorbar(x[inside], top[inside], errors, **bars)
        names = shorten_names([own[value].notation for value in places if value in own])
        handles.append(Patch(**look, label=plain_text(names, 30)))
        under = top
    ax.set_ylim(0.0, 1.0)
    return handles


@draw_result.register(Manifold)
@explain_arguments
def plot_manifold(found: Manifold, ax: Any = None, *, wall: str | None = None) -> Any:
    """Draw a manifold, and its orbit, among the impacts on a wall.

    An unstable manifold is solid, a stable one dashed.

    Parameters
    ----------
    found : Manifold
        As `grow_manifold` returns it.
    ax : matplotlib.axes.Axes, optional
        Where to draw, such as over basins or the other manifold; a new figure otherwise.
    wall : str, optional
        By default that of the orbit's first impact.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        For a wall that the system does not have.
    """
    ax = ax or style.new_figure(6.4, 4.4).add_subplot()
    orbit, period = found.orbit, found.grower.period
    wall = orbit.word.walls[0] if wall is None else wall
    found.require_wall(wall)
    name = "stable" if found.stable else "unstable"
    look: dict[str, Any] = {"color": SPOTS[int(found.stable)], "linewidth": 0.9, "zorder": 4}
    look["linestyle"] = "--" if found.stable else "-"
    label = plain_text(f"{name} manifold of {orbit.notation}")
    for piece in (p for p in found.pieces if p.wall == wall):
        turns = np.floor(piece.times / period)
        breaks = np.nonzero(np.diff(turns))[0] + 1
        phases = np.insert(piece.times / period - turns, breaks, np.nan)
        ax.plot(phases, np.insert(piece.velocities, breaks, np.nan), label=label, **look)
        label = "_"
    here = [letter == wall for letter in orbit.word.walls]
    mark = {"linestyle": "none", "marker": "X", "color": "k", "markersize": 5, "zorder": 5}
    ax.plot(orbit.times[here] / period % 1.0, orbit.velocities[here], **mark)
    ax.set_xlim(0.0, 1.0)
    ax.set_xlabel("time of the impact, $t/T$")
    ax.set_ylabel(f"velocity before it, on wall {wall}")
    handles, _ = ax.get_legend_handles_labels()
    _legend(ax, handles)
    return ax


@draw_result.register
def _(result: Sweep, *x: str, **options: Any) -> Any:
    return plot_sweep(result, **{**({"x": x[0]} if x else {}), **options})


@draw_result.register
def _(result: Attractor, model: Model | None = None) -> Any:
    simulator = Simulator(result.require_model(model))
    return tuple(portrait_figure(simulator, result, {}).axes)


@draw_result.register
def _(result: Run, model: Model | None = None) -> Any:
    return draw_result(attractor_of_run(result, model))


# Files.


def save_simulation(result: Simulation, folder: Path, options: PlotOptions) -> list[str]:
    """Draw all pictures of a simulation to files; returns their names."""
    scene, sweep = result.scene, result.sweep
    unit = scene.model.unit(options.x)
    ylim = options.ylim if options.y == VELOCITY else None  # it is of the other quantity
    choices: dict[str, Any] = {"xlim": options.xlim or None, "ylim": ylim}
    if result.diagram:
        choices |= {"unphysical": options.unphysical, "labels": options.labels}
    if result.fractions is not None:
        choices["fractions"] = result.fractions.shares
    swept = plot_sweep(sweep, x=options.x, diagram=result.diagram, unit=unit, **choices)
    exponents = plot_exponents(sweep, x=options.x, unit=unit)
    figures: dict[str, Any] = {"attractors": swept.figure, "exponents": exponents.figure}
    if scene.energy is not None:
        figures["energy"] = plot_energy(
            scene.energy, sweep, x=options.x, diagram=result.diagram, xlim=options.xlim, unit=unit
        ).figure
    for figure in figures.values():
        _head(figure, result)
    simulators = Simulators(scene.model, scene.parameter)
    for number, row in enumerate(result.portraits, start=1):
        simulator = simulators.at(row.value)
        others = others_at(result, row, simulator)
        figure = figures[f"portrait{number}"] = portrait_figure(simulator, row.attractor, others)
        _head(figure, result, row.attractor.parameters)
    for number, found in enumerate(result.basins, start=1):
        figure = figures[f"basins{number}"] = plot_basins(found).figure
        _head(figure, result, found.parameters)
    if result.fractions is not None:
        figures["fractions"] = plot_fractions(result.fractions, x=options.x, unit=unit).figure
        _head(figures["fractions"], result)
    contents: dict[str, Content] = {}
    for stem, figure in figures.items():
        contents |= style.pictures(figure, stem, options.formats, scene.name)
    return write_all(folder, contents)


def _head(figure: Any, result: Simulation, values: Mapping[str, float] | None = None) -> None:
    """Write scene and parameters at the upper edge, by default those that are fixed."""
    model, parameter = result.scene.model, result.scene.parameter
    fixed = {name: value for name, value in model.values.items() if name != parameter}
    text = values_text(values or fixed, units_of(model.SYSTEM))
    style.write_heading(figure, f"{plain_text(result.scene.name, 60)}: {text}")
