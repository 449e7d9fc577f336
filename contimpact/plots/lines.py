"""Lines of branches, the quantities on their axes, texts in pictures, and where labels stand."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.cbook import is_math_text
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.textpath import TextPath
from matplotlib.ticker import ScalarFormatter
from matplotlib.transforms import ScaledTranslation

from ..arrays import Array
from ..bifurcations.kind import kind_of
from ..errors import InputError, printable, shorten
from ..results.branch import STATUS, Branch, Entry, first_unknown, model_at, shared_parameters
from ..results.diagram import Diagram
from ..results.quantities import (
    GREEK,
    PI_ABOVE,
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

DOTS = 150
"""Per inch, in files."""
FORMULAS: Any = RendererAgg(1, 1, DOTS).mathtext_parser
"""Lays out formulas for all pictures, and keeps the layouts: each takes it some milliseconds."""

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


def label_axis(axis: Any, name: str, unit: str = "") -> None:
    """Label the axis of a parameter, whose values are written in full."""
    axis.set_label_text(axis_label(name, unit))
    formatter = axis.get_major_formatter()
    if isinstance(formatter, ScalarFormatter):
        formatter.set_useOffset(False)


def value_text(value: float) -> str:
    """Return a number as it is set in headings, a multiple of pi as such."""
    for below in range(1, PI_BELOW + 1) if math.isfinite(value) else ():
        above = value / math.pi * below
        near = abs(above - round(above)) < 1e-12 * max(1.0, abs(above))
        if near and 0 < abs(round(above)) <= PI_ABOVE:
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


def walls_of(branches: Sequence[Branch], names: Sequence[str]) -> list[str]:
    """Return names of walls in the order of their system, if it is known; other names as given."""
    walls: Sequence[str] = ()
    with contextlib.suppress(InputError, IndexError):
        walls = model_at(branches[0], 0).letters
    return list(dict.fromkeys([*(walls if {*walls} & {*names} else ()), *names]))


def fixed_values(branches: Sequence[Branch]) -> dict[str, float]:
    """Return the parameters that no branch varies and all share, derived ones left out."""
    found = _class(branches[0].system) if branches else None
    return shared_parameters(branches, found.DERIVED if found else ())


def _class(name: str) -> type[Model] | None:
    """The class of a system that is installed or imported."""
    from ..results.branch import find_imported_system

    return find_imported_system(name) if name else None


# Labels of events and names of orbits, placed where they cover nothing.
#
# A leader leans from its value on the frame to a *port* and rises from there to the label, which
# stands over the port. Ports are in the order of the values, so leaders do not cross. Where labels
# are too wide to stand side by side they form a stair, the leftmost one highest, so that no leader
# runs through a label. What would be too far from its value or from the frame is left out and
# counted: ghosts and long orbits before others.


CHOICES = ("all", "period-1", "real", "none")
"""Choices of the events that are labelled: all, those of period T, those that are no ghosts,
none."""

ROWS, ROW, SIZE, GAP = 4, 16.0, 8.0, 4.0
"""Rows of labels; their height, font and distance in points."""
FAN = 10.0
"""Height above the frame within which leaders lean to their ports, in points."""
CLEAR = 2.0
"""Distance of leaders from each other and from labels, in points."""
BEYOND = 20.0
"""How far labels may reach beyond the frame on either side, in points."""
FARTHEST = 60.0
"""How far a port may be from its value, in points."""


@dataclass(frozen=True)
class Label:
    """A text, the value it belongs to, and how much it tells: the smaller the more."""

    text: str
    value: float
    rank: tuple[Any, ...]


@dataclass(frozen=True)
class Spot:
    """Where a label stands, in points from the left end of the frame's upper edge."""

    place: float
    port: float
    left: float
    row: int
    width: float

    @property
    def right(self) -> float:
        """The label's right end."""
        return self.left + self.width

    @property
    def height(self) -> float:
        """Of the label's lower edge above the frame."""
        return FAN + ROW * self.row


def choose_events(entries: Iterable[Entry], which: str) -> list[Entry]:
    """Return the events to be labelled, by one of `CHOICES`; requested values have no label."""
    wanted = {
        "all": lambda e: True,
        "period-1": lambda e: e.period <= 1,
        "real": lambda e: not e.ghost,
        "none": lambda e: False,
    }[which]
    return [e for e in entries if e.requested is None and wanted(e)]


def draw_labels(ax: Any, entries: Sequence[Entry], x: str) -> int:
    """Label events inside the axes' limits above the frame, with a line down from each label;
    returns how many labels found no place."""
    low, high = ax.get_xlim()
    width = ax.get_window_extent().width / ax.figure.dpi * 72.0
    scale = width / (high - low)
    labels = _merge_labels(_labels(entries, x), 3 * GAP / scale)
    places = [(label.value - low) * scale for label in labels]
    limits = _limits(ax, width)
    spots = arrange_labels(places, [text_width(label.text) for label in labels], limits)
    for label, spot in zip(labels, spots, strict=True):
        if spot is not None:
            _draw(ax, label, spot)
    return sum(spot is None for spot in spots)


def _labels(entries: Sequence[Entry], x: str) -> list[Label]:
    """The labels of events, each text and value once, those that tell most first."""
    orbits: dict[str, set[str]] = {}
    for entry in entries:
        orbits.setdefault(entry.kind, set()).add(entry.notation)
    named = {kind for kind, names in orbits.items() if len(names) > 1}
    found: dict[tuple[str, float], Label] = {}
    for e in entries:
        text, value = label_text(e, e.kind in named), e.parameters[x]
        label = Label(text, value, (e.ghost, not e.physical, e.period, len(e.word), value))
        known = found.get((text, value))
        found[text, value] = min(known, label, key=lambda one: one.rank) if known else label
    return sorted(found.values(), key=lambda label: label.rank)


def _merge_labels(labels: Sequence[Label], near: float) -> list[Label]:
    """Labels, a text not repeated where it stands nearby already."""
    kept: list[Label] = []
    for label in labels:
        if not any(label.text == k.text and abs(label.value - k.value) < near for k in kept):
            kept.append(label)
    return kept


def _limits(ax: Any, width: float) -> tuple[float, float]:
    """How far labels may reach to the left and right: inside the figure, near the frame."""
    left = ax.get_window_extent().x0 / ax.figure.dpi * 72.0
    whole = ax.figure.get_figwidth() * 72.0
    return -min(BEYOND, left - 1.0), width + min(BEYOND, whole - left - width - 1.0)


def text_width(text: str) -> float:
    """Return the width of a label in points."""
    text = text.replace("\n", " ")
    if not text.strip():  # some versions of Matplotlib draw no path of nothing
        return 0.0
    if is_math_text(text):
        laid_out = FORMULAS.parse(text, DOTS, FontProperties(size=SIZE))
        return float(laid_out.width) * 72.0 / DOTS
    return float(TextPath((0, 0), text, size=SIZE).get_extents().width)


def _draw(ax: Any, label: Label, spot: Spot) -> None:
    transform = ax.get_xaxis_transform()
    line: dict[str, Any] = {"color": "0.8", "linewidth": 0.5}
    ax.plot([label.value] * 2, [0.0, 1.0], transform=transform, zorder=0, **line)
    moved = spot.port - spot.place
    inches = ax.figure.dpi_scale_trans + ScaledTranslation(label.value, 1.0, transform)
    path = np.array([(0.0, 0.0), (moved, FAN), (moved, spot.height)]) / 72.0
    ax.add_artist(Line2D(*path.T, transform=inches, clip_on=False, gid="leader", **line))
    offset = (spot.left - spot.place, spot.height)
    where: dict[str, Any] = {"xycoords": transform, "textcoords": "offset points"}
    look: dict[str, Any] = {"ha": "left", "va": "bottom", "fontsize": SIZE, "gid": "event"}
    ax.annotate(label.text, (label.value, 1.0), offset, **where, **look)


# Places.


def arrange_labels(
    places: Sequence[float], widths: Sequence[float], limits: tuple[float, float]
) -> list[Spot | None]:
    """Return the places of labels, None for those that no longer find a place between the limits.
    Places and widths are in points from the left end of the frame."""
    kept: list[int] = []
    spots: list[Spot] = []
    for number in range(len(places)):
        tried = sorted([*kept, number], key=places.__getitem__)
        found = _place_labels([places[k] for k in tried], [widths[k] for k in tried], limits)
        if all(_excess(spot, limits) <= 0.0 for spot in found):
            kept, spots = tried, found
    standing = dict(zip(kept, spots, strict=True))
    return [standing.get(k) for k in range(len(places))]


def _excess(spot: Spot, limits: tuple[float, float]) -> float:
    """By how much a label is too far away."""
    return max(
        limits[0] - spot.left, spot.right - limits[1], abs(spot.port - spot.place) - FARTHEST
    )


def _place_labels(
    places: Sequence[float], widths: Sequence[float], limits: tuple[float, float]
) -> list[Spot]:
    """Labels in order of their places, spread to both sides where they are crowded.

    Pushing them to the right from their places keeps all distances, pushing them to the left does;
    so does what lies between the two.
    """
    rows = _rows(places, widths)
    right = _push_labels(places, widths, rows)
    mirrored = ([-p for p in places[::-1]], widths[::-1], rows[::-1])
    pushed = zip(_push_labels(*mirrored), widths[::-1], strict=True)
    left = [(-port, -start - wide) for (port, start), wide in pushed][::-1]
    found: list[Spot] = []
    for part in (0.5, 0.25, 0.75, 0.0, 1.0):
        blend = (1.0 - part) * np.array(left) + part * np.array(right)
        found = [
            Spot(place, port, start, row, wide)
            for place, (port, start), row, wide in zip(
                places, blend.reshape(-1, 2).tolist(), rows, widths, strict=True
            )
        ]
        if all(_excess(spot, limits) <= 0.0 for spot in found):
            break
    return found


def _push_labels(
    places: Sequence[float], widths: Sequence[float], rows: Sequence[int]
) -> list[tuple[float, float]]:
    """Ports and left ends of labels, none to the left of its place.

    A label stays clear of the one before it in its row, and of the leaders before it that rise to
    higher rows; a leader stays clear of the labels before it in lower rows.
    """
    found: list[tuple[float, float]] = []
    ends = [-np.inf] * ROWS
    risen = [-np.inf] * ROWS
    before = -np.inf
    for k, (place, wide, row) in enumerate(zip(places, widths, rows, strict=True)):
        start = max(ends[row] + GAP, max(risen[row + 1 :], default=-np.inf) + CLEAR)
        apart = min(CLEAR, place - places[k - 1]) if k else 0.0
        port = max(place, before + apart, max(ends[:row], default=-np.inf) + CLEAR, start)
        start = max(start, port - 0.5 * wide)
        ends[row], risen[row], before = start + wide, port, port
        found.append((port, start))
    return found


def _rows(places: Sequence[float], widths: Sequence[float]) -> list[int]:
    """Rows of labels: zero where they fit side by side, stairs where they do not.

    The division into stairs costs least where ports are at their places; of those that can be so,
    low stairs cost least.
    """
    best: dict[int, tuple[float, list[int]]] = {0: (0.0, [])}
    for last in range(1, len(places) + 1):
        options = []
        for size in range(1, min(ROWS, last) + 1):
            cost, rows = best[last - size]
            tried = rows + list(range(size))[::-1]
            moved = _push_labels(places[:last], widths[:last], tried)[last - size :]
            far = sum(port - p for (port, _), p in zip(moved, places[last - size :], strict=False))
            options.append((cost + far + 3.0 * size * (size - 1), tried))
        best[last] = min(options, key=lambda option: option[0])
    return best[len(places)][1]


# Names in a diagram: of orbits on their stable stretches, of walls at the ends of their curves.
#
# A name stands beside its curve where it covers no line, no marker and no other name.

NAMES_SIZE, HEIGHT = 7.5, 9.0
"""Font and height of a name of an orbit, in points."""
SHORTEST = 3.0
"""Stable stretches that are shorter in a picture have no name, in points."""
APART = 2.5
"""At which distance a line is taken to be a row of points, in points."""
FRACTIONS = (0.5, 0.4, 0.6, 0.25, 0.75, 0.1, 0.9)
GAPS = (2.5, 6.0, 11.0, 17.0)
"""Where a name is tried: along a stretch, and how far from its curve, in points."""
TOO_MUCH = 4.0
"""What speaks against a place, at or above which a name is left out."""
LOWER = 0.3
"""What speaks against the next curve of a stretch."""
HALO = [withStroke(linewidth=1.6, foreground="white")]


def name_orbits(ax: Any, pieces: Sequence[Piece]) -> int:
    """Name the orbits on their stable stretches; returns how many found no place."""
    frame, dots = ax.get_window_extent(), ax.figure.dpi / 72.0
    size = frame.size / dots

    def in_points(x: Any, y: Any) -> Array:
        there = ax.transData.transform(np.column_stack([x, y]).astype(float))
        return np.asarray((there - frame.p0) / dots)

    lines = [(_dense(in_points(p.places, p.values)), p) for p in pieces]
    seen = [(p[np.all((p >= 0.0) & (p <= size), axis=1)], piece) for p, piece in lines]
    marks = [line for line in ax.lines if line.get_linestyle() == "None"]
    spots = [in_points(*m.get_data()) for m in marks]
    filled = np.vstack([np.zeros((0, 2)), *(points for points, _ in seen), *spots])
    walls = [t for t in ax.texts if t.get_gid() == "wall"]
    letters = [in_points(*np.reshape(t.xy, (2, 1)))[0] + t.xyann for t in walls]
    taken = [(x, y - HEIGHT / 2.0, x + HEIGHT, y + HEIGHT / 2.0) for x, y in letters]
    left_out = 0
    for name, curves in _stretches(seen):
        wide = text_width(name) * NAMES_SIZE / 8.0 + 2.0
        tried = [
            (_count_covered(box, filled, taken) + cost, box)
            for box, cost in _places(curves, wide)
            if box[0] > 0 and box[1] > 0 and box[2] < size[0] and box[3] < size[1]
        ]
        cost, box = min(tried, default=(np.inf, (0.0,) * 4))
        if cost >= TOO_MUCH:
            left_out += 1
            continue
        taken.append(box)
        at = ax.transData.inverted().transform((np.array(box[:2]) + 1.0) * dots + frame.p0)
        look: dict[str, Any] = {"fontsize": NAMES_SIZE, "gid": "orbit", "path_effects": HALO}
        ax.text(*at, name, ha="left", va="bottom", color="0.1", zorder=6, **look)
    return left_out


def _dense(corners: Array) -> Array:
    """A line as points close to one another."""
    corners = corners[np.all(np.isfinite(corners), axis=1)]
    if len(corners) < 2:
        return corners
    length = np.append(0.0, np.cumsum(np.hypot(*np.diff(corners, axis=0).T)))
    along = np.linspace(0.0, length[-1], int(min(length[-1] / APART, 4000)) + 2)
    return np.column_stack([np.interp(along, length, column) for column in corners.T])


def _stretches(seen: Sequence[tuple[Array, Piece]]) -> list[tuple[str, list[Array]]]:
    """The stable stretches in sight with their curves, an orbit and range once, long ones first."""
    found: dict[tuple[str, int, int], list[Array]] = {}
    for points, piece in seen:
        if piece.style == "stable" and piece.orbit and len(points):
            low, high = np.min(points[:, 0]), np.max(points[:, 0])
            if high - low >= SHORTEST:
                key = (plain_text(piece.orbit), round(low / 3.0), round(high / 3.0))
                found.setdefault(key, []).append(points)
    order = sorted(found.items(), key=lambda item: item[0][1] - item[0][2])
    return [(key[0], sorted(c, key=lambda p: -np.max(p[:, 1]))) for key, c in order]


def _places(
    curves: Sequence[Array], wide: float
) -> Iterator[tuple[tuple[float, float, float, float], float]]:
    """Boxes beside the curves of a stretch, and what speaks against each."""
    for number, curve in enumerate(curves[: round(TOO_MUCH / LOWER)]):
        for fraction in FRACTIONS:
            x, y = curve[round(fraction * (len(curve) - 1))]
            for gap in GAPS:
                for low in (y + gap, y - gap - HEIGHT):
                    box = (x - wide / 2, low, x + wide / 2, low + HEIGHT)
                    against = LOWER * number + 0.05 * gap + 0.5 * abs(fraction - 0.5)
                    yield box, against + (0.2 if low < y else 0.0)


def _count_covered(
    box: tuple[float, float, float, float],
    filled: Array,
    taken: Sequence[tuple[float, float, float, float]],
) -> float:
    """How many points of lines a box covers; very many if it covers another name."""
    x0, y0, x1, y1 = box
    if any(x0 < b[2] and b[0] < x1 and y0 < b[3] and b[1] < y1 for b in taken):
        return 1e6
    x, y = filled.T
    return float(np.count_nonzero((x0 < x) & (x < x1) & (y0 < y) & (y < y1)))


def name_walls(ax: Any, pieces: Sequence[Piece], colours: Mapping[str, str]) -> None:
    """Write each wall's name to the right of the curves that belong to it; longer names stand in
    the legend alone."""
    apart = 0.06 * float(np.ptp(ax.get_ylim()))
    right, wide = ax.get_xlim()[1], float(np.ptp(ax.get_xlim()))
    names = []
    for wall, colour in colours.items():
        own = [p for p in pieces if p.series == wall] if len(wall) == 1 else []
        physical = [p for p in own if p.style != "unphysical"]
        names += [(v, x, wall, colour) for x, v in _rightmost(ax, physical) or _rightmost(ax, own)]
    lowest = -np.inf
    for speed, place, wall, colour in sorted(names):
        lowest = max(speed, lowest + apart)
        look = {"fontsize": 9, "fontweight": "bold", "color": colour, "gid": "wall"}
        offset: dict[str, Any] = {"textcoords": "offset points", "annotation_clip": False}
        offset |= {"path_effects": HALO, "zorder": 6}
        beside = right - place < 0.03 * wide  # a letter would lie on the frame
        above = 7 if ax.get_ylim()[1] - lowest > apart else -7
        spot, shift = ((right, lowest), (5, 0)) if beside else ((place, lowest), (3, above))
        ax.annotate(wall, spot, shift, ha="left", va="center", **offset, **look)


def _rightmost(ax: Any, pieces: Sequence[Piece]) -> list[tuple[float, float]]:
    """The point in sight that is farthest to the right; of several, the one of largest speed."""
    (low, high), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    found: list[tuple[float, float]] = []
    for _, _, places, speeds, _ in pieces:
        edge = np.nonzero((places[:-1] - high) * (places[1:] - high) < 0.0)[0]
        part = (high - places[edge]) / (places[edge + 1] - places[edge])
        crossing = speeds[edge] + part * (speeds[edge + 1] - speeds[edge])
        found += zip(places.tolist(), speeds.tolist(), strict=True)
        found += ((high, v) for v in crossing.tolist())
    seen = [(x, v) for x, v in found if low <= x <= high and bottom <= v <= top]
    return sorted(seen, key=lambda spot: (spot[0], abs(spot[1])))[-1:]
