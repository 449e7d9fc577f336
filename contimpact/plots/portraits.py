"""Phase planes and time series of simulated motion, in the manner of Figs. 5, 7 and 8 of the paper.

The attractor is black and solid, with a circle at each impact. Orbits beside it have the line
styles of diagrams: unstable ones are dashed, unphysical ones dotted. They differ in colour and in
width, so that those that lie on one another can all be seen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..orbits.orbit import Orbit
from ..results.branch import Branch
from ..simulation.attractor import Attractor, Kind
from ..simulation.simulator import Simulator
from ..simulation.sweep import Row
from . import diagram as style
from .lines import STYLES
from .texts import plain

if TYPE_CHECKING:
    from ..diagrams.scene_simulation import Simulation

INK = "0.1"
TOUCH: dict[str, Any] = {"marker": "o", "markerfacecolor": "white", "color": INK, "zorder": 5}
TOUCH |= {"markersize": 3.4, "markeredgewidth": 0.7}
OTHERS = ("#D55E00", "#009E73", "#CC79A7", "#56B4E9")
"""Colours of orbits beside the attractor; none is a wall's."""
SHOWN = 40
"""Impacts drawn of a motion that is not periodic, in diagrams and time series."""
LOOPS = 160
"""Impacts drawn of such a motion in the phase plane."""


def motion(
    simulator: Simulator, attractor: Attractor, periods: int = 0, last: int = SHOWN
) -> tuple[Any, Any, Any, Any]:
    """Return times, positions, velocities of a motion, and the rows of its touches.

    A periodic motion is closed, and repeated if `periods` is more than its own; of another one the
    `last` impacts are taken.

    Returns
    -------
    t : ndarray of shape (n,)
    z, v : ndarray of shape (n, coordinates)
        Of the coordinates of `coordinates_of`.
    touches : list of (time, wall, velocity)
    """
    columns = [attractor.walls, attractor.velocities, attractor.released]
    columns += [attractor.others, attractor.held] if attractor.held.size else []
    if attractor.period is None:
        times = attractor.times[-last:]
        columns = [column[-last:] for column in columns]
    else:
        times_round = max(1, -(-periods // attractor.period))
        span = attractor.period * attractor.forcing_period
        rows = np.arange(len(attractor.walls) * times_round + 1)
        turns, places = np.divmod(rows, len(attractor.walls))
        times = attractor.times[places] + span * turns
        columns = [column[places] for column in columns]
    walls, speeds, released, *others = columns
    given: dict[str, Any] = dict(zip(("others", "held"), others, strict=False))
    t, z, v = simulator.path(walls, times, speeds, released, **given)
    if simulator.several:
        z, v = (part[:, coordinates_of(simulator)] for part in (z, v))
    else:
        z, v = z[:, None], v[:, None]
    hits = [row for row in zip(times, walls, speeds, released, strict=True) if not row[3]]
    return t, z, v, [(time, int(wall), speed) for time, wall, speed, _ in hits]


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

    Parameters
    ----------
    simulator : Simulator
    attractor : Attractor
    ax : matplotlib.axes.Axes, optional
    others : mapping of str to Attractor, optional
        Further orbits at the same parameter values, by label. One that ends in ``unstable`` or
        ``unphysical`` is drawn in the style of its state, others solid.
    """
    ax = ax or style.new_figure(4.4, 4.0).add_subplot()
    handles = []
    _, z, v, touches = motion(simulator, attractor, last=LOOPS)
    closed = attractor.period is not None
    for column, ink in _inks(simulator, INK if closed else "0.45"):
        ax.plot(z[:, column], v[:, column], color=ink, linewidth=1.5 if closed else 0.3)
    handles.append(style.legend_mark(color=INK, label=plain(attractor.notation)))
    for (label, other), look in zip(
        (others or {}).items(), _looks(list(others or {})), strict=True
    ):
        _, z, v, _ = motion(simulator, other)
        ax.plot(z, v, **look)
        handles.append(style.legend_mark(label=label, **look))
    _walls(ax.axvline, simulator)
    for name, place, colour in named_places(simulator.letters, simulator.positions):
        where: dict[str, Any] = {"ha": "center", "xycoords": ax.get_xaxis_transform()}
        where |= {"textcoords": "offset points", "color": colour, "fontsize": 8}
        ax.annotate(name, (place, 1.0), (0, 3), **where)
    for _, wall, speed in touches:
        ax.plot(simulator.positions[wall], speed, **TOUCH)
    ax.axhline(0.0, color="0.85", linewidth=0.6, zorder=0)
    ax.locator_params(axis="x", nbins=5)
    ax.set_xlabel(_name(simulator))
    ax.set_ylabel(_name(simulator, moving=True))
    below: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.16), "ncols": 2}
    ax.legend(handles=handles, fontsize=7, frameon=False, handlelength=3.2, **below)
    return ax


def _looks(labels: Sequence[str]) -> list[dict[str, Any]]:
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
    """Draw position against time in forcing periods, with the walls and the touches."""
    ax = ax or style.new_figure(5.2, 3.0).add_subplot()
    periods = 4 if attractor.period is not None else 0
    t, z, _, touches = motion(simulator, attractor, periods)
    begin = np.floor(t[0] / simulator.period)
    for column, ink in _inks(simulator, INK):
        ax.plot(t / simulator.period - begin, z[:, column], color=ink, linewidth=1.1)
    _walls(ax.axhline, simulator)
    for name, place, colour in named_places(simulator.letters, simulator.positions):
        where: dict[str, Any] = {"va": "center", "xycoords": ax.get_yaxis_transform()}
        where |= {"textcoords": "offset points", "color": colour, "fontsize": 8}
        ax.annotate(name, (1.0, place), (4, 0), **where)
    for time, wall, _ in touches:
        ax.plot(time / simulator.period - begin, simulator.positions[wall], **TOUCH)
    ax.margins(x=0.01)
    ax.set_xlabel("$t/T$")
    ax.set_ylabel(_name(simulator))
    return ax


def _name(simulator: Simulator, moving: bool = False) -> str:
    """What an axis of gap coordinates is called."""
    if simulator.several and len(coordinates_of(simulator)) > 1:
        return "their velocities" if moving else "gap coordinates"
    if simulator.several:
        return "its velocity" if moving else "gap coordinate"
    return r"$\dot{Z}$" if moving else "$Z$"


def named_places(letters: Sequence[str], places: Sequence[float]) -> list[tuple[str, float, str]]:
    """Return the names of walls, one text for those that share a place, with place and colour."""
    found: dict[float, list[int]] = {}
    for number, place in enumerate(places):
        found.setdefault(round(float(place), 9), []).append(number)
    return [
        (", ".join(letters[k] for k in walls), place, style.COLOURS[walls[0] % len(style.COLOURS)])
        for place, walls in found.items()
    ]


def _walls(line: Any, simulator: Simulator) -> None:
    for k, position in enumerate(simulator.positions):
        line(position, color=style.COLOURS[k % len(style.COLOURS)], linewidth=1.4, zorder=1)


def portrait_figure(
    simulator: Simulator, attractor: Attractor, others: Mapping[str, Attractor]
) -> Any:
    """Return a figure with the phase plane and the time series of an attractor."""
    figure = style.new_figure(9.0, 4.0)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.5))
    if attractor.kind in (Kind.RESTING, Kind.NO_IMPACT):
        left.set_title(plain(attractor.notation))
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
    from ..simulation.basins import orbits_on

    found: dict[str, Attractor] = {}
    for branch in result.diagram.branches:
        if branch.period > 1 or not branch.word:
            continue
        for orbit in orbits_on(branch, result.sweep, row.value, simulator.kernels):
            if not (orbit.stable and orbit.physical):
                state = "unstable" if orbit.physical else "unphysical"
                label = f"{plain(branch.notation)}, {state}"
                other = _as_attractor(branch, orbit, simulator)
                known = found.get(label)
                if known is None or _fastest(other) > _fastest(known):
                    found[label] = other
    return found


def _fastest(attractor: Attractor) -> float:
    return float(np.max(np.abs(attractor.velocities)))


def _as_attractor(branch: Branch, orbit: Orbit, simulator: Simulator) -> Attractor:
    walls = np.array([simulator.letters.index(letter) for letter in branch.word])
    table = (walls, orbit.times, orbit.velocities, np.zeros(len(walls), dtype=bool))
    if simulator.several:
        others = orbit.problem.impacts(orbit.unknowns)[:, 2:]
        table = (*table, others, np.zeros(len(walls), dtype=np.int64))  # type: ignore[assignment]
    T = simulator.period
    return Attractor(Kind.PERIODIC, {}, branch.notation, T, branch.word, branch.period, *table)
