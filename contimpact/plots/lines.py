"""Lines of branches, the quantities on their axes, and texts in pictures."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..arrays import Array
from ..bifurcations.kind import kind_of
from ..errors import printable, shorten
from ..results.branch import STATUS, Branch, Entry, first_unknown
from ..results.diagram import Diagram
from ..results.quantities import (
    GREEK,
    PI_BELOW,
    LabelParts,
    Quantity,
    Series,
    label_parts,
    parts_of,
    series_of,
)
from ..systems.membrane import Membrane

if TYPE_CHECKING:
    from ..models.model import Model

STYLES: dict[str, Any] = {
    "stable": "-",
    "unstable": (0, (5, 2)),
    "unphysical": (0, (1, 1.6)),
    "unknown": (0, (8, 2, 1, 2)),
}
WIDTHS = {"stable": 1.6, "unstable": 1.1, "unphysical": 0.9, "unknown": 0.7}
"""Widths of lines, by the status of their orbits."""

UNPHYSICAL = ("all", "period-1", "none")
"""On which branches unphysical orbits are drawn: all; those of period T, without branches of which
no orbit is physical while others have some; none."""

FLAT = 3e-4
"""How far a drawn chord may be from a smooth curve, by the size of the picture."""

FAR = 3.0
"""Multipliers of opposite signs that are larger have infinity between them, not zero."""


class Piece(NamedTuple):
    """A run of equal status of one series: its name, style, values on the x axis, values on the y
    axis, and the orbit's notation; of velocities a series is an impact, and its name a wall's."""

    series: str
    style: str
    places: Array
    values: Array
    orbit: str = ""


def series_by_branch(
    diagram: Diagram, y: Quantity, membrane: Membrane | None = None
) -> list[list[Series]]:
    """Return the series of a quantity along each branch."""
    return [series_of(branch, y, membrane) for branch in diagram.branches]


def pieces_of(
    diagram: Diagram,
    series: Sequence[Sequence[Series]],
    x: str,
    xlim: tuple[float, float] | None,
    whole: Collection[str],
) -> list[Piece]:
    """Return all that is drawn of branches; unphysical orbits of those alone that are `whole`."""
    pieces: list[Piece] = []
    for branch, own in zip(diagram.branches, series, strict=True):
        low, high = xlim or (np.nanmin(branch[x]), np.nanmax(branch[x]))
        span = float(high - low) or 1.0
        parts = [r for r in runs(branch) if r[2] != "unphysical" or branch.id in whole]
        for one in own:
            places, values, rows = _smooth_points(branch, x, one, span)
            for first, last, style in parts:
                piece = slice(rows[first], rows[last] + 1)
                drawn = places[piece], values[piece]
                drawn = _break_line(*drawn) if one.poles else drawn
                pieces.append(Piece(one.name, style, *drawn, branch.notation))
    return pieces


def branches_drawn_whole(diagram: Diagram, unphysical: str) -> set[str]:
    """Return the branches whose unphysical orbits are drawn, by one of `UNPHYSICAL`."""
    physical = {b.id for b in diagram.branches if b.physical.any()}
    known = {b.id for b in diagram.branches}
    short = {b.id for b in diagram.branches if b.period <= 1}
    return {"all": known, "period-1": short & (physical or known), "none": set()}[unphysical]


def runs(branch: Branch) -> list[tuple[int, int, str]]:
    """Return runs of equal status, each joined to the next at their common row.

    Of each the first row, the last one, and which of `STYLES` it has.
    """
    status = branch.status
    edges = (np.nonzero(np.diff(status))[0] + 1).tolist()
    ends = zip([0, *edges], [*edges, len(status)], strict=True)
    return [(first, last, STATUS[status[first]]) for first, last in ends if first < last]


def _break_line(places: Array, values: Array) -> tuple[Array, Array]:
    """A line, broken where it passes infinity from one sign to the other."""
    far = np.minimum(abs(values[:-1]), abs(values[1:])) > FAR
    poles = np.nonzero(far & (np.sign(values[:-1]) != np.sign(values[1:])))[0] + 1
    return np.insert(places, poles, np.nan), np.insert(values, poles, np.nan)


def _smooth_points(
    branch: Branch, x: str, series: Series, span: float
) -> tuple[Array, Array, Array]:
    """A branch's points, and points of a cubic in arclength where chords would be seen.

    Returns values on the x axis, those on the y axis, and where the branch's own rows stand among
    them.
    """
    values = series.values
    own = np.column_stack([branch[x], values])
    length = branch["arclength"]
    names = list(branch.columns)
    if len(own) < 3 or names.index(x) > first_unknown(names) or not series.smooth:
        return own[:, 0], own[:, 1], np.arange(len(own))
    steps, slopes = np.diff(length), _slopes(length, own)
    size = np.array([span, float(np.ptp(values)) or 1.0])
    bend = np.max(steps[:, None] * np.abs(np.diff(slopes, axis=0)) / (8.0 * size), axis=1)
    parts = np.clip(np.ceil(np.sqrt(np.nan_to_num(bend) / FLAT)), 1, 24).astype(int)
    rows = np.concatenate([[0], np.cumsum(parts)])
    i = np.repeat(np.arange(len(parts)), parts)
    u = ((np.arange(rows[-1]) - rows[i]) / parts[i])[:, None]
    dense = np.empty((rows[-1] + 1, 2))
    dense[:-1] = _cubic(u, steps[i, None], own[i], own[i + 1], slopes[i], slopes[i + 1])
    dense[rows] = own
    return dense[:, 0], dense[:, 1], rows


def _slopes(length: Array, values: Array) -> Array:
    """Derivatives with respect to arclength; coincident rows (events on points) share one."""
    apart = np.append(True, np.diff(length) > 1e-9 * (length[-1] - length[0]))
    if np.count_nonzero(apart) < 3:
        return np.zeros_like(values)
    there = np.gradient(values[apart], length[apart], axis=0, edge_order=2)
    return np.asarray(there[np.cumsum(apart) - 1])


def _cubic(u: Array, step: Array, a: Array, b: Array, da: Array, db: Array) -> Array:
    """Cubics from a to b with derivatives da and db, at fractions u of their steps."""
    bump = u * (1.0 - u)
    lean = (1.0 - u) * (step * da - (b - a)) - u * (step * db - (b - a))
    return a + u * (b - a) + bump * lean


# The y axis of a diagram: limits, label, guides, and where events stand, by the quantity drawn.

VELOCITY = "velocity"
LABELS = {
    "multipliers": "multipliers (real parts)",
    "moduli": "moduli of the multipliers",
    "energy": "output voltage $U_k$ (V)",
    "U_I": r"mean voltage per impact $\bar{U}_I$ (V)",
    "U_T": r"mean voltage per time $\bar{U}_T$ (V)",
    "gap": "smallest gap",
    "period": "period of the orbit",
    "margin": "margin (tolerances)",
}
BAND: dict[str, Any] = {
    "color": "#D55E00",
    "linewidth": 8.0,
    "alpha": 0.3,
    "solid_capstyle": "butt",
    "zorder": 0.5,
}
"""How stretches of a small margin are shaded."""
GUIDES = {
    "velocity": (0.0,),
    "multipliers": (-1.0, 0.0, 1.0),
    "moduli": (1.0,),
    "gap": (0.0,),
    "margin": (0.0,),
}
"""Values at which a line is drawn: those an event is told by."""
SEEN = {"multipliers": (-3.0, 3.0), "moduli": (0.0, 3.0)}
"""Multipliers grow without bound next to a grazing; limits hold no more of them than this."""


def draw_guides(ax: Any, y: Quantity) -> None:
    """Draw thin lines where the quantity tells of an event."""
    for value in GUIDES.get(y, ()) if isinstance(y, str) else ():
        ax.axhline(value, color="0.75", linewidth=0.6, zorder=0)


def shade_margins(
    ax: Any, diagram: Diagram, series: Sequence[Sequence[Series]], x: str, margin: float
) -> bool:
    """Draw a band along stretches of branches with a smaller margin; return if there are any."""
    drawn = False
    for branch, own in zip(diagram.branches, series, strict=True):
        known = branch.columns.get("margin", np.full(len(branch), np.nan))
        for one in own:
            rows = np.column_stack([branch[x], one.values, known])
            with np.errstate(invalid="ignore"):
                parts = (margin - known[:-1]) / np.diff(known)  # where it is reached between rows
            ends = np.flatnonzero((parts > 0.0) & (parts < 1.0))
            at = rows[ends] + parts[ends, None] * (rows[ends + 1] - rows[ends])
            at[:, 2] = margin
            rows = np.insert(rows, ends + 1, at, axis=0)
            rows[~(rows[:, 2] <= margin)] = np.nan
            drawn |= bool(np.isfinite(rows).any())
            ax.plot(*rows.T[:2], **BAND)
    return drawn


IN_A_LINE = 4
"""Walls in a line of the label; more do not fit beside the axis."""


def limits_of(
    pieces: Sequence[Piece], seen: tuple[float, float], y: Quantity
) -> tuple[float, float]:
    """Return limits that hold the guides and every value drawn in the x range, with a margin."""
    low, high = seen
    inside = [
        v[(low <= places) & (places <= high) & np.isfinite(v)] for _, _, places, v, _ in pieces
    ]
    guides = GUIDES.get(y, ()) if isinstance(y, str) else ()
    values = np.concatenate([guides, *inside])
    if isinstance(y, str) and y in SEEN:
        values = np.clip(values, *SEEN[y])
    if not len(values):
        return 0.0, 1.0
    margin = 0.06 * (values.max() - values.min() or abs(values[0]) or 1.0)
    return float(values.min() - margin), float(values.max() + margin)


def ordinate_label(diagram: Diagram, y: Quantity, names: Sequence[str]) -> str:
    """Return the label of the y axis; of velocities, which sign they have at which wall."""
    if y == VELOCITY:
        signs = _signs(diagram, names)
        lines = [", ".join(signs[i : i + IN_A_LINE]) for i in range(0, len(signs), IN_A_LINE)]
        return "\n".join(["impact velocity (before impact)", *lines])
    if isinstance(y, str):
        return LABELS.get(y) or axis_label(y)
    return plain_text(names[0]) if len(names) == 1 else ""


def _signs(diagram: Diagram, walls: Sequence[str]) -> list[str]:
    signs = []
    for wall in walls:
        speeds = [np.zeros(0)]
        speeds += [
            b[f"v{k + 1}"][b.physical]
            for b in diagram.branches
            for k, name in enumerate(b.word)
            if name == wall
        ]
        total = float(np.sum(np.concatenate(speeds)))
        if total:
            signs.append(f"{'positive' if total > 0 else 'negative'} at {wall}")
    return signs


def marks_of(
    diagram: Diagram, series: Sequence[Sequence[Series]], entry: Entry, y: Quantity
) -> list[tuple[str | None, Any]]:
    """Return where an event is marked: the name of a series and a value of the quantity.

    A touch is marked at the velocity zero of its wall.
    """
    if y == VELOCITY:
        marks = [(impact["wall"], impact["velocity"]) for impact in entry.impacts]
        touches = "touch_time" in kind_of(entry.kind).needed
        return [*marks, (entry.wall, 0.0)] if touches else marks
    for branch, own in zip(diagram.branches, series, strict=True):
        if branch.id == entry.branch:
            rows: Array = np.nonzero(branch["event"] == entry.id)[0]
            return [(one.name, one.values[row]) for row in rows[:1] for one in own]
    return []


# How pictures write names and numbers: labels as in Table 1, parameters, values, headings.

CAPITALS = "Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi Omega".split()
COMMANDS = {
    letter: rf"\{name}"
    for name, letter in reversed(GREEK.items())  # so that whole names come last
    if name.islower() or name in CAPITALS
} | {GREEK["phi"]: r"\varphi", GREEK["omicron"]: "o"}
"""Of Greek letters in mathematical text; without one the letter itself is set."""


def plain_text(text: str, longest: int = 40) -> str:
    """Return a text from elsewhere as it is drawn: short, in one line, none of it mathematics."""
    drawn = printable(shorten(text, longest)).replace("$", r"\$")
    return f"{drawn} " if drawn.endswith("\\") else drawn  # which would change what is put behind


def label_text(entry: Entry, orbit: bool = False) -> str:
    """Return an entry's label set as in Table 1: a tilde over ghosts, words raised and lowered.

    A grazing of orbits with the period 2T, 4T, ... is PD_G. With `orbit`, labels without words
    name the orbit.
    """
    parts = label_parts(entry.kind, entry.label, entry.ghost, entry.period)
    return _set(parts, entry.notation if orbit else "")


def set_label(kind: str, label: str, orbit: str = "") -> str:
    """Return a label as ``G[1:1->2:1]`` with its words raised and lowered; others name `orbit`."""
    return _set(label_parts(kind, label), orbit)


def _set(parts: LabelParts, orbit: str) -> str:
    if not parts.standard:
        name = plain_text(parts.symbol)
    else:
        name = rf"\mathrm{{{parts.symbol}}}"
        name = rf"\widetilde{{{name}}}" if parts.tilde else name
        if parts.above:
            return f"${name}_{{{parts.below}}}^{{\\,{parts.above}}}$"
        name += rf"_{{\mathrm{{{parts.below}}}}}" if parts.below else ""
        name = f"${name}$"
    return name + (f"({plain_text(orbit)})" if orbit else "")


def symbol(name: str) -> str:
    """Return a name as it is set in labels: letters, Greek ones too, as symbols, ``r_B`` with an
    index, ``gbar`` with a bar, words as they are."""
    found = parts_of(name)
    if found is None:
        return plain_text(name)
    letter, bar, index = found
    letter = COMMANDS.get(letter, letter)
    letter = rf"\bar{{{letter}}}" if bar else letter
    return f"${letter}_{{{index}}}$" if index else f"${letter}$"


def axis_label(name: str, unit: str = "") -> str:
    """Return the label of an axis: a parameter and its unit."""
    return symbol(name) + (f" ({unit})" if unit else "")


def value_text(value: float) -> str:
    """Return a number as it is set in headings, a multiple of pi as such."""
    for below in range(1, PI_BELOW + 1) if math.isfinite(value) else ():
        above = value / math.pi * below
        if abs(above - round(above)) < 1e-12 * max(1.0, abs(above)) and round(above):
            top = {1: "", -1: "-"}.get(round(above), str(round(above)))
            return rf"${top}\pi/{below}$" if below > 1 else rf"${top}\pi$"
    return f"{value:.6g}"


def values_text(values: Mapping[str, float], units: Mapping[str, str]) -> str:
    """Return ``beta = pi/6, A = 5 N`` as it is set in headings."""
    parts = []
    for name, value in values.items():
        unit = units.get(name, "").replace("dimensionless", "").replace("^2", "\u00b2")
        parts.append(f"{symbol(name)} = {value_text(value)}" + (f" {unit}" if unit else ""))
    return ", ".join(parts)


def units_of(system: str) -> dict[str, str]:
    """Return the units of a system's parameters, derived ones included; none if it is unknown."""
    found = _class(system)
    if found is None:
        return {}
    units = dict(found.DERIVED_UNITS)
    for parameter in found.PARAMETERS:
        units |= dict.fromkeys((parameter.name, *parameter.split), parameter.unit)
    return units


def walls_of(system: str, names: Sequence[str]) -> list[str]:
    """Return names of walls in the order of their system, if it is known; other names as given."""
    found = _class(system)
    walls = [wall.name for wall in getattr(found, "WALLS", ())]  # classes of scenes have none
    return list(dict.fromkeys([*(walls if {*walls} & {*names} else ()), *names]))


def fixed_values(branches: Sequence[Branch]) -> dict[str, float]:
    """Return the parameters that no branch varies and all share, derived ones left out."""
    if not branches:
        return {}
    found = _class(branches[0].system)
    derived = found.DERIVED if found else ()
    return {
        name: float(branches[0][name][0])
        for name in branches[0].constant
        if name not in derived
        and all(name in b.constant and b[name][0] == branches[0][name][0] for b in branches)
    }


def _class(name: str) -> type[Model] | None:
    """The class of a system that is installed or imported."""
    from ..results.branch import find_imported_system

    return find_imported_system(name) if name else None
