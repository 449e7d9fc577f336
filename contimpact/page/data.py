"""The data of the page: what it shows of a diagram and of its members."""

from __future__ import annotations

import base64
import dataclasses
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .. import __version__
from ..arrays import Array
from ..bifurcations.codimension_two import OTHER_NAMES
from ..bifurcations.kind import kind_of
from ..errors import printable
from ..models.guards import Guard, orders_of
from ..models.model import Model
from ..progress import Progress, ignore_progress, tell_each
from ..results.branch import Branch, Entry, constant_parameters, coordinates, shared_parameters
from ..results.catalogue import SWEEP, Motion, Share, shorten_names, sweep_cells
from ..results.curve import (
    Area,
    Coverage,
    Curve,
    Key,
    Region,
    colour_of,
    falling_column,
    key_of,
    keys_of,
    lanes,
    panel_areas,
    panels,
    regions,
)
from ..results.diagram import Diagram
from ..results.diagram_reading import Reading, read, sentence_of
from ..results.quantities import GREEK, PI_ABOVE, PI_BELOW, label_parts
from ..results.scene import OUTPUT_ERROR
from ..segments.kernels import Kernels
from ..segments.segment import ARRAYS, evaluate_in
from ..storage import check_reading

# Numbers and texts as a page embeds them: compact, exact, and nothing but data.

TYPES = {"f8": "<f8", "f4": "<f4", "u4": "<u4", "u1": "u1"}
"""Types of packed numbers, as the script knows them and as NumPy does."""


def pack_column(values: Array, kind: str = "f8") -> str | float:
    """Return a column as one number where it is constant and finite, else as base64.

    The text is the kind of `TYPES` and the bytes, as ``f8:AAAAAAAA8D8=``, all rows in order.
    """
    array = np.ascontiguousarray(values, dtype=TYPES[kind])
    flat = array.ravel()
    if len(flat) and np.all(flat == flat[0]) and math.isfinite(flat[0]):
        return float(flat[0])
    return f"{kind}:{base64.b64encode(array.tobytes()).decode()}"


def plain_data(value: Any) -> Any:
    """Return plain data whose texts are printable, with None for numbers that are not finite."""
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {printable(str(name)): plain_data(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain_data(part) for part in value]
    return value


def script_json(value: Any) -> str:
    """Return JSON that can stand in a script element: no character of it begins markup."""
    text = json.dumps(plain_data(value), allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


LAST = 40
"""Impacts shown of a motion that is not periodic."""


@dataclass(frozen=True, eq=False)
class SweepSeries:
    """Attractors of one kind that a sweep found in one direction."""

    direction: str
    kind: str
    notation: str
    word: str
    """Word of periodic motion without sojourns on a wall; else empty."""
    period: int | None
    parameters: Mapping[str, Array]
    """Shape (n,)."""
    starts: Array
    """Index at which the impacts of each begin among those of all, shape (n + 1,)."""
    times: Array
    velocities: Array
    walls: Array
    """`times`, `velocities`, `walls`: walls by their numbers."""
    sections: Array
    """Times and all section coordinates, shape (impacts, m)."""
    multipliers: Array
    """Real and imaginary parts of the two largest, not numbers where there are none, shape (n, 2,
    2)."""
    periods: Array | None = None
    """As of `Orbits`."""

    def __len__(self) -> int:
        return len(self.starts) - 1

    @property
    def periodic(self) -> bool:
        """Whether these are orbits of a word."""
        return bool(self.word)


@dataclass(frozen=True)
class _Row:
    """A line of the table."""

    cells: Mapping[str, str]
    impacts: Sequence[tuple[float, ...]]
    word: str

    def key(self) -> tuple[str, ...]:
        return (*(self.cells[name] for name in ("direction", "kind", "notation")), self.word)


def read_sweep(path: Path, model: Model) -> list[SweepSeries]:
    """Read the attractors of a simulation, those of one word and direction together.

    Raises InputError if the file is not of this schema, damaged, or of another system.
    """
    _, table = sweep_cells(path)
    with check_reading(path, SWEEP):
        groups: dict[tuple[str, ...], list[_Row]] = {}
        for cells in table:
            row = _row(cells, model)
            groups.setdefault(row.key(), []).append(row)
        return [_join_rows(rows, model) for rows in groups.values()]


def _row(cells: Mapping[str, str], model: Model) -> _Row:
    letters = model.letters
    names = coordinates(model.unknowns_per_impact)
    impacts: list[tuple[float, ...]] = []
    for k in range(1, len(cells)):
        wall = cells.get(f"wall{k}")
        if not wall:
            break
        if not wall.endswith("*"):
            section = (_number(cells[f"{name}{k}"]) for name in names)
            impacts.append((letters.index(wall), *section))
    word = "".join(letters[int(wall)] for wall, *_ in impacts)
    whole = cells["kind"] == "periodic" and len(impacts) == int(cells["impacts"])
    return _Row(cells, impacts if whole else impacts[-LAST:], word if whole else "")


def _join_rows(rows: Sequence[_Row], model: Model) -> SweepSeries:
    cells = rows[0].cells
    direction, kind, notation, word = rows[0].key()
    width = 1 + model.unknowns_per_impact
    table = np.array([impact for row in rows for impact in row.impacts]).reshape(-1, width)
    names = (*model.values, *model.DERIVED)
    free = np.array([float(row.cells["period"] or "nan") for row in rows])
    turns = 1 if model.autonomous else int(cells["period"]) if cells["period"] else None
    return SweepSeries(
        direction,
        kind,
        notation,
        word,
        turns,
        {name: np.array([_number(row.cells[name]) for row in rows]) for name in names},
        np.cumsum([0, *(len(row.impacts) for row in rows)]),
        table[:, 1],
        table[:, 2],
        table[:, 0],
        table[:, 1:],
        np.array([_multipliers(row.cells) for row in rows]),
        free if model.autonomous else None,
    )


def _multipliers(cells: Mapping[str, str]) -> list[list[float]]:
    parts = ("re", "im")
    return [[float(cells.get(f"multiplier{k}_{part}") or "nan") for part in parts] for k in (1, 2)]


def _number(cell: Any) -> float:
    """A finite number; raises `ValueError` for anything else."""
    value = float(cell)
    if not math.isfinite(value):
        raise ValueError(f"{cell!r} in a row")
    return value


# Orbits as a page draws them without Python: states along each flight, and cubics between them.
#
# Each flight has displacement and velocity of every coordinate at so many equal steps of its
# duration that the cubics which take both on are right to `FLAT` of what they span.

FLAT = 5e-4
"""Error of a drawn flight, by the size of the picture."""
FEWEST, MOST = 4, 512
"""Steps of a flight."""
BUDGET = 400_000
"""States that a page holds at most, about."""
ROWS = 128
"""Orbits whose states are computed together: matrices of many more leave the processor's cache."""
GUESS = 10
"""States of a flight, for that."""
SMALL, TINY = 1e-6, float(np.finfo(float).tiny)
"""Part of its distance from the origin below which a flight need not be resolved; never zero."""

Moved = Callable[[Array], tuple[Array, Array]]
"""Map from fractions of a flight to displacements and velocities, of orbits, coordinates,
fractions."""


@dataclass(frozen=True)
class Orbits:
    """Orbits of one word at different parameter values."""

    word: str
    """A wall for each impact."""
    period: int
    """Period in forcing periods."""
    parameters: Mapping[str, Array]
    """Parameters of the model, shape (n,)."""
    impacts: Array
    """Times and section coordinates before impact, shape (n, N, m)."""
    periods: Array | None = None
    """Periods of the orbits, where they are free, and shown as one forcing period, shape (n,)."""

    def at(self, rows: Array) -> Orbits:
        """Return some of the orbits."""
        chosen = {name: values[rows] for name, values in self.parameters.items()}
        return Orbits(self.word, self.period, chosen, self.impacts[rows])


def stride(impacts: Sequence[tuple[int, int]], coordinates: int = 1) -> int:
    """Return of how many orbits one is kept, given the numbers of orbits and of their impacts."""
    states = GUESS * coordinates * sum(orbits * each for orbits, each in impacts)
    return max(1, -(-states // BUDGET))


class Tracks:
    """Makes tracks of one model's orbits; only its formulas matter, not its values."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.kernels = Kernels(model, next(iter(model.values)))
        self.size = model.DEGREES_OF_FREEDOM
        rows = {wall.name: np.array(wall.row(self.size), dtype=float) for wall in model.WALLS}
        self.alone = all(row.tolist() == [1.0] for row in rows.values())
        """Whether the gap coordinate of every wall is the only coordinate there is."""
        self.hits = {name: np.nonzero(row)[0].tolist() for name, row in rows.items()}
        """The coordinates that a wall's gap coordinate is made of."""
        self.factors = {name: row[row != 0.0] for name, row in rows.items()}

    def clock_and_walls(self, orbits: Orbits) -> tuple[Array, dict[str, Array]]:
        """Return period and positions of the walls, a value for each orbit.

        Of a wall on a combination of coordinates it is the combination's.
        """
        setup = evaluate_in(self.kernels.setup, ARRAYS)(*self._values(orbits))
        each = np.zeros(len(orbits.impacts))
        walls = zip(self.model.WALLS, setup.walls, strict=True)
        period = setup.period if orbits.periods is None else orbits.periods
        places = {wall.name: each + place for wall, place in walls}
        for name, factors in self.factors.items():
            places[name] /= factors[0] if len(factors) == 1 else 1.0
        return each + period, places

    def record(self, orbits: Orbits, rows: Array) -> dict[str, Any]:
        """Return the tracks of some orbits, and the walls and forcing periods of all, packed."""
        periods, walls = self.clock_and_walls(orbits)
        shown, clock = orbits.at(rows), periods[rows]
        flights = [self._flight(shown, clock, walls, rows, k) for k in range(len(orbits.word))]
        states = (
            np.concatenate(flights, axis=1) if flights else np.zeros((len(rows), 0, 2 * self.size))
        )
        return {
            "period": pack_column(periods),
            "walls": {name: pack_column(places) for name, places in walls.items()},
            "hits": self.hits,
            "coordinates": list(self.model.coordinates),
            "rows": pack_column(rows, "u4") if len(rows) < len(orbits.impacts) else None,
            "nodes": [flight.shape[1] for flight in flights],
            "states": pack_column(states, "f4"),
        }

    def _values(self, orbits: Orbits) -> list[Array]:
        return [orbits.parameters[name] for name in self.model.values]

    def _flight(
        self, orbits: Orbits, clock: Array, walls: Mapping[str, Array], rows: Array, number: int
    ) -> Array:
        """Position and velocity of each coordinate in turn, along one flight of each orbit, shape
        (n, nodes, 2 * coordinates); not numbers where the flight's mode does not have it."""
        wall = orbits.word[number]
        leave, following = orbits.impacts[:, number], (number + 1) % len(orbits.word)
        arrive = orbits.impacts[:, following, 0]
        length = arrive - leave[:, 0] + (0.0 if following else orbits.period * clock)
        kernel = self.kernels.motion(wall) if self.alone else self.kernels.states(wall)
        motion = evaluate_in(kernel, ARRAYS)
        head, values = leave.T[..., None], [v[:, None] for v in self._values(orbits)]
        place = walls[wall][rows][:, None, None] if self.alone else 0.0

        def moved(fractions: Array) -> tuple[Array, Array]:
            states = np.empty((len(length), 2 * self.size, len(fractions)))
            for k in range(0, len(length), ROWS):
                some = slice(k, k + ROWS)
                given = length[some, None] * fractions, *(v[some] for v in values)
                for i, part in enumerate(motion(*head[:, some], *given)[: 2 * self.size]):
                    states[some, i] = part
            return place + states[:, ::2], states[:, 1::2]

        fastest = np.abs(orbits.impacts[:, :, 1]).max(axis=1) if self.alone else 0.0
        states = _fine_enough(moved, length, fastest)
        orders = orders_of(self.model.MODES, self.model.guard(wall).next_mode, self.size)
        for i, order in enumerate(orders):
            if not order:
                states[:, :, 2 * i : 2 * i + 2] = math.nan
        return states


def _fine_enough(moved: Moved, length: Array, fastest: Array | float) -> Array:
    """States at as many equal steps as their cubics need."""
    steps = FEWEST
    states = np.stack(moved(np.linspace(0.0, 1.0, 2 * steps + 1)), axis=2)
    while steps < MOST and _error(states, length / steps, fastest) > FLAT:
        steps *= 2
        finer = np.empty((*states.shape[:-1], 2 * steps + 1))
        finer[..., ::2] = states
        finer[..., 1::2] = np.stack(moved(np.arange(0.5, steps) / steps), axis=2)
        states = finer
    return states[..., ::2].reshape(len(states), -1, steps + 1).transpose(0, 2, 1)


def _error(states: Array, step: Array, fastest: Array | float) -> float:
    """How far cubics on every other state are from the others, by the size of a picture."""
    x, v = np.moveaxis(states, 2, 0)
    h = np.where(step == 0.0, 1.0, step)[:, None, None]
    a, middle, b = x[..., :-1:2], x[..., 1::2], x[..., 2::2]
    p, speed, q = v[..., :-1:2], v[..., 1::2], v[..., 2::2]
    off = np.abs(0.5 * (a + b) + h * (p - q) / 8.0 - middle)
    slip = np.abs(1.5 * (b - a) / h - 0.25 * (p + q) - speed)
    tall = np.ptp(x, axis=2) + SMALL * np.abs(x).max(axis=2)
    wide = np.maximum(np.reshape(fastest, (-1, 1)), np.abs(v).max(axis=2))
    parts = (off / (tall + TINY)[..., None], slip / (wide + TINY)[..., None])
    return max(float(np.max(part[step != 0.0], initial=0.0)) for part in parts)


# The branches of a diagram by the values of the parameters that no branch varies.


def members(branches: Sequence[Branch], derived: Sequence[str]) -> list[dict[str, Any]]:
    """Return the groups of branches that one diagram shows.

    Each has as ``fixed`` the values that set it apart, and as ``branches`` their places.
    """
    shared = shared_parameters(branches, derived)
    apart = [name for name in constant_parameters(branches, derived) if name not in shared]
    groups: dict[tuple[float, ...], list[int]] = {}
    for place, branch in enumerate(branches):
        groups.setdefault(tuple(float(branch[name][0]) for name in apart), []).append(place)
    return [
        {"fixed": dict(zip(apart, values, strict=True)), "branches": places}
        for values, places in sorted(groups.items())
    ]


SCHEMA = "contimpact.page/1"
UNSAID = tuple(
    "system options tangent multipliers_before multipliers_after crisis scenario".split()
)
"""Keys of entries that a page leaves out."""


@dataclasses.dataclass(frozen=True)
class PageView:
    """How a page begins: the axis, limits, and which unphysical orbits are drawn."""

    x: str
    xlim: tuple[float, float] | None = None
    ylim: tuple[float, float] | None = None
    unphysical: str = "period-1"
    """One of "period-1", "all", "none"."""
    source: str = ""
    """Source that the scene names."""
    remarks: Sequence[str] = ()
    """Remarks for the reader: that the run was ended early, what it could not find."""
    margin: float | None = None
    """Stretches of stable orbits with a smaller margin are shaded."""


def remarks_in(statistics: Mapping[str, Any], coverage: Sequence[Coverage] = ()) -> list[str]:
    """Return what the statistics of a run, or its manifest, and its coverage remark on it."""
    notes = statistics.get("notes")
    found = [statistics.get("failure"), *(notes if isinstance(notes, list) else [])]
    covered = [f"covered: {told.place}{told}" for told in coverage]
    return [*(text for text in found if text and isinstance(text, str)), *covered]


@np.errstate(all="ignore")  # numbers of damaged folders
def page_data(
    diagram: Diagram,
    model: Model | None,
    shown: PageView,
    swept: Sequence[SweepSeries] = (),
    progress: Progress = ignore_progress,
    fractions: tuple[str, Sequence[Share]] | None = None,
    motions: Sequence[Motion] = (),
) -> dict[str, Any]:
    """Return what a page shows.

    Without a model no orbits are drawn, and units are not known. `swept` has attractors of a
    simulation, `fractions` basin fractions along a parameter, `motions` the attractors along the
    parameter, those of no branch among them. Progress is called with a line of text for each
    branch.
    """
    derived = model.DERIVED if model else ()
    branches, keys = diagram.branches, keys_of(diagram.curves)
    lines = [
        *(
            (len(branch), len(branch.word))
            for branch in branches
            if _has_known_formulas(branch, model)
        ),
        *((len(found), len(found.word)) for found in swept if found.periodic),
    ]
    tracks = Tracks(model) if model and lines else None
    every = stride(lines, tracks.size if tracks else 1)
    found = read(diagram)
    varying = _varying_parameters(branches, shown.x) if branches else _swept_along(swept, derived)
    varying = varying or [shown.x]
    remarks = [*shown.remarks, *map(sentence_of, found.unknown)]
    return {
        "schema": SCHEMA,
        "version": __version__,
        "name": diagram.name,
        "shown": dataclasses.asdict(shown) | {"remarks": remarks},
        "parameter": varying[0],
        "varying": varying,
        "quantities": list(dict.fromkeys(name for b in branches for name in _quantities(b))),
        "fixed": shared_parameters(branches, derived) if branches else _constant(swept, derived),
        "units": _units(branches, model),
        "walls": _walls(branches, model),
        "machine": _machine(model),
        "greek": GREEK,
        "pi_below": PI_BELOW,
        "pi_above": PI_ABOVE,
        "every": every,
        "members": (groups := members(branches, derived)),
        "own": _scene_group(groups, model),
        "unknown": _undrawable_reason(branches, model),
        "branches": [
            _branch(branch, tracks if _has_known_formulas(branch, model) else None, every)
            for branch in tell_each(branches, "drawing the orbits of", progress)
        ],
        "entries": [_entry(entry, branch) for branch in branches for entry in branch.events],
        "looks": {e.kind: _look_record(e.kind) for e in diagram.entries}
        | {c.kind: _look_record(c.kind) for c in diagram.curves},
        "reading": _reading(diagram, found),
        "keys": [_key(key, keys) for key in keys],
        "curves": [_curve(curve) | {"key": keys.index(key_of(curve))} for curve in diagram.curves],
        "panels": _panels(diagram),
        "swept": [_swept(found, tracks, every) for found in swept],
        "fractions": _bands(*fractions, model) if fractions and model else None,
        "motions": [_motion(motion, varying[0], model) for motion in motions if model],
    }


def _has_known_formulas(branch: Branch, model: Model | None) -> bool:
    """Whether a branch is of the model's formulas."""
    return (
        model is not None
        and branch.system == model.SYSTEM
        and dict(model.options) == dict(branch.options)
        and set(model.values) <= set(branch.parameters)
        and set(branch.word) <= set(model.letters)
    )


def _scene_group(groups: Sequence[Mapping[str, Any]], model: Model | None) -> int:
    """The place of the group at the scene's own values; the first one if there is none."""
    values = model.values if model else {}
    wanted = (
        k for k, g in enumerate(groups) if all(values.get(n) == v for n, v in g["fixed"].items())
    )
    return next(wanted, 0)


def _undrawable_reason(branches: Sequence[Branch], model: Model | None) -> str | None:
    """Why the orbits of some branches cannot be drawn, if so."""
    lacking = [branch.id for branch in branches if not _has_known_formulas(branch, model)]
    if not lacking:
        return None
    system = next(branch.system for branch in branches if branch.id in lacking)
    return f"the formulas of the system {system} are not known here (branches {', '.join(lacking)})"


def _units(branches: Sequence[Branch], model: Model | None) -> dict[str, str]:
    unit: Callable[[str], str] = model.unit if model else lambda name: ""
    names = dict.fromkeys(name for branch in branches for name in branch.parameters)
    if model:
        names |= dict.fromkeys((*model.values, *model.DERIVED))
    return {name: unit(name).replace("dimensionless", "").replace("^2", "\u00b2") for name in names}


def _walls(branches: Sequence[Branch], model: Model | None) -> list[str]:
    if model:
        return model.letters
    return sorted({wall for branch in branches for wall in branch.word})


def _machine(model: Model | None) -> dict[str, Any] | None:
    """What the machine is drawn with, where its coordinates are displacements."""
    if model is None or model.GEOMETRY is None:
        return None
    guards = {
        guard.name: {
            "side": guard.side,
            "row": guard.row(model.DEGREES_OF_FREEDOM),
            "soft": _gives_way(guard, model),
            "rigid": guard.rigid,
        }
        for guard in model.WALLS
    }
    return dataclasses.asdict(model.GEOMETRY) | {"guards": guards}


def _gives_way(guard: Guard, model: Model) -> bool:
    """Whether a guard begins a contact, from the first mode, that another ends at its surface."""
    return model.first_mode in guard.modes and any(
        (other.coordinate, other.side) == (guard.coordinate, -guard.side)
        and guard.next_mode in other.modes
        and guard.next_mode != model.first_mode
        for other in model.WALLS
    )


def _constant(swept: Sequence[SweepSeries], derived: Sequence[str]) -> dict[str, float]:
    """The parameters that all attractors share, derived ones left out."""
    values = {n: v for n, v in _columns(swept).items() if n not in derived}
    return {n: float(v[0]) for n, v in values.items() if np.all(v == v[0])}


def _swept_along(swept: Sequence[SweepSeries], derived: Sequence[str]) -> list[str]:
    """The parameters that differ among attractors, derived ones last."""
    varied = [n for n, v in _columns(swept).items() if np.any(v != v[0])]
    return sorted(varied, key=lambda name: name in derived)


def _columns(swept: Sequence[SweepSeries]) -> dict[str, Array]:
    """The parameters of all attractors."""
    names = list(swept[0].parameters) if swept else []
    return {n: np.concatenate([found.parameters[n] for found in swept]) for n in names}


def _varying_parameters(branches: Sequence[Branch], x: str) -> list[str]:
    """The parameters that vary along a branch, the followed ones first."""
    followed = [branch.parameter for branch in branches]
    others = [
        name for b in branches for name in b.parameters if name not in b.constant or name == x
    ]
    return list(dict.fromkeys([*followed, *others, x]))


# Branches.


def _branch(branch: Branch, tracks: Tracks | None, every: int) -> dict[str, Any]:
    names = [*branch.parameters, "arclength", "smallest_gap", *_quantities(branch)]
    marked = np.nonzero(branch["event"] != "")[0]
    known, reasons = np.unique(branch["reason"].astype(str), return_inverse=True)
    ending = branch.columns.get("margin_event", np.zeros(len(branch), str)).astype(str)
    nearest, event = np.unique(ending, return_inverse=True)
    record = {name: getattr(branch, name) for name in ("id", "word", "notation")}
    record |= {"period": branch.period or 1}
    record |= {"parameter": branch.parameter, "from": branch.origin, "rows": len(branch)}
    record |= {
        "ends": [end.message for end in branch.ends],
        "missed": list(branch.missed),
        "notes": list(branch.notes),
        "columns": {name: pack_column(branch[name]) for name in names if name in branch.columns},
        "times": pack_column(branch.times),
        "velocities": pack_column(branch.velocities),
        "multipliers": pack_column(
            np.stack([branch.multipliers.real, branch.multipliers.imag], axis=-1)
        ),
        "unstable": pack_column(np.clip(branch["n_unstable"], 0, 255), "u1"),
        "physical": pack_column(branch.physical, "u1"),
        "status": pack_column(_pieces(branch), "u1"),
        "reasons": known.tolist(),
        "reason": pack_column(reasons.ravel(), "u4"),
        "nearest": nearest.tolist(),
        "margin_event": pack_column(event.ravel(), "u4"),
        "tracks": None,
    }
    if tracks is not None:
        record["tracks"] = tracks.record(_orbits(branch), _kept_rows(len(branch), every, marked))
    return record


def _quantities(branch: Branch) -> list[str]:
    """Columns that may be drawn: the margin, and outputs, which have estimates of their errors."""
    names = branch.columns
    return [n for n in names if n == "margin" or f"{n}{OUTPUT_ERROR}" in names]


def _pieces(branch: Branch) -> Array:
    """The status of the piece that begins at each row, at the last one of that before."""
    status = branch.status
    return np.append(status, status[-1:] if len(status) else [0])


def _orbits(branch: Branch) -> Orbits:
    """The orbits of all rows; section coordinates stand in the order of the unknowns."""
    extra = sum(f"{name}1" in branch.columns for name in coordinates(64)[2:])
    names = coordinates(2 + extra)
    impacts = [
        np.column_stack([branch[f"{name}{k + 1}"] for name in names])
        for k in range(len(branch.word))
    ]
    parameters = {name: branch[name] for name in branch.parameters}
    stacked = np.stack(impacts, axis=1) if impacts else np.zeros((len(branch), 0, len(names)))
    free = branch.columns.get("period")
    return Orbits(branch.word, branch.period or 1, parameters, stacked, free)


def _kept_rows(rows: int, every: int, marked: Array) -> Array:
    """The rows whose orbits are drawn: one of so many, the events and both ends."""
    return np.unique(np.concatenate([np.arange(0, rows, every), marked, [rows - 1]]))


# Entries.


def _entry(entry: Entry, branch: Branch) -> dict[str, Any]:
    record = dataclasses.asdict(entry) | {"branch": branch.id}
    along = "arclength" if entry.arclength is not None else branch.parameter
    place = entry.value if entry.arclength is None else entry.arclength
    row = int(np.argmin(np.abs(branch[along] - place)))
    parts = label_parts(entry.kind, entry.label, entry.ghost, entry.period)
    said = {name: value for name, value in record.items() if name not in UNSAID}
    return said | {"row": row, "parts": dataclasses.asdict(parts)}


def _look_record(kind: str) -> dict[str, Any]:
    look = kind_of(kind).look
    touching = "touch_time" in kind_of(kind).needed
    return {"marker": look.marker, "colour": look.colour, "touching": touching}


def _reading(diagram: Diagram, found: Reading) -> dict[str, Any]:
    """What was read, stable runs with their rows."""
    branches = {branch.id: branch for branch in diagram.branches}
    record = {"crises": []} | found.as_record() | {"incomplete": found.incomplete}
    record["scenarios"] = [
        {"entry": s.entry, "text": str(s).partition(": ")[2]} for s in found.scenarios
    ]
    for run in record["stable"]:
        branch = branches[run["branch"]]
        run["rows"] = [_row_at(branch, run["low"]), _row_at(branch, run["high"])]
    return record


def _row_at(branch: Branch, value: float) -> int:
    """The row with a value of the followed parameter."""
    return int(np.argmin(np.abs(branch[branch.parameter] - value)))


# Curves in two parameters.


def _key(key: Key, keys: Sequence[Key]) -> dict[str, Any]:
    """A bifurcation that curves are of, with the colour of pictures."""
    parts = dataclasses.asdict(label_parts(key.kind, key.label))
    return {**key._asdict(), "parts": parts, "colour": colour_of(key, keys)}


def _curve(curve: Curve) -> dict[str, Any]:
    names = [name for name in curve.parameter_columns if np.ptp(curve[name]) > 0.0]
    record = {name: getattr(curve, name) for name in ("id", "kind", "label", "word", "notation")}
    return record | {
        "parameters": list(curve.parameters),
        "fixed": dict(curve.fixed),
        "from": curve.origin,
        "rows": len(curve),
        "columns": {name: pack_column(curve[name]) for name in (*names, "arclength")},
        "ghost": pack_column(curve.ghost_pieces, "u1"),
        "ends": [end.message for end in curve.ends],
        "missed": list(curve.missed),
        "points": [
            {
                "kind": OTHER_NAMES.get(p.kind, p.kind),
                "changes": p.changes,
                "parameters": dict(p.parameters),
            }
            for p in curve.points
        ],
    }


def _panels(diagram: Diagram) -> list[dict[str, Any]]:
    """The curves by member of the family and pair of parameters, areas, and what comes first."""
    places = {curve.id: place for place, curve in enumerate(diagram.curves)}
    return [
        {
            "fixed": dict(group[0].fixed),
            "along": (along := falling_column(group)),
            "across": (across := group[0].parameters[1]),
            "curves": [places[curve.id] for curve in group],
            "areas": [
                _area_record(area)
                for area in panel_areas(diagram.areas, group[0].fixed, across, along)
            ],
            "regions": _regions(regions(group, along, diagram.checks)),
        }
        for group in panels(diagram.curves)
    ]


def _regions(found: Sequence[Region]) -> list[dict[str, Any]]:
    """Regions with what runs say of them, and the lanes in which they are drawn."""
    return [
        {**dataclasses.asdict(region), "said": region.said, "lane": lane}
        for region, lane in zip(found, lanes(found), strict=True)
    ]


def _area_record(area: Area) -> dict[str, Any]:
    doubts = [f"{d.across:.6g}, {d.along:.6g}: {d.says}" for d in area.doubtful]
    return {
        "id": area.id,
        "orbits": [{"notation": o.notation, "ends": o.ends} for o in area.orbits],
        "polygon": [[list(point) for point in ring] for ring in area.polygon],
        "part": area.part,
        "says": " and ".join(map(str, area.orbits)),
        "doubt": "; ".join(doubts),
    }


# Attractors.


def _swept(found: SweepSeries, tracks: Tracks | None, every: int) -> dict[str, Any]:
    """Attractors of one word found in one direction; or motions that have none."""
    record: dict[str, Any] = {
        name: getattr(found, name) for name in ("direction", "kind", "notation", "word", "period")
    }
    record |= {
        "rows": len(found),
        "columns": {name: pack_column(values) for name, values in found.parameters.items()},
        "starts": pack_column(found.starts, "u4"),
        "times": pack_column(found.times),
        "velocities": pack_column(found.velocities),
        "walls": pack_column(found.walls, "u1"),
        "multipliers": pack_column(found.multipliers),
        "tracks": None,
    }
    if tracks is not None and found.periodic:
        record["tracks"] = tracks.record(
            _cycles(found), _kept_rows(len(found), every, np.zeros(0, int))
        )
    return record


def _cycles(found: SweepSeries) -> Orbits:
    impacts = found.sections.reshape(len(found), len(found.word), -1)
    parameters: Mapping[str, Array] = found.parameters
    return Orbits(found.word, found.period or 1, parameters, impacts, found.periods)


def _motion(motion: Motion, parameter: str, model: Model) -> dict[str, Any]:
    """An attractor along the parameter, with its ends in words."""
    ends = motion.low, motion.high
    there = [model.replace(**{parameter: end.value}) for end in ends]
    speed = motion.speed(motion.low.value, motion.high.value)
    return {
        "notation": motion.notation,
        "branch": motion.branch,
        "columns": {name: [m[name] for m in there] for name in (parameter, *model.DERIVED)},
        "said": f"impacts at up to {speed:.4g}; ends: {ends[0]}; {ends[1]}",
    }


def _bands(parameter: str, shares: Sequence[Share], model: Model) -> dict[str, Any]:
    """Basin fractions by motion, at the values of the parameter and of what derives from it."""
    values = sorted({share.value for share in shares})
    there = [model.replace(**{parameter: value}) for value in values]
    motions: dict[int, dict[float, Share]] = {}
    for share in shares:
        motions.setdefault(share.motion, {})[share.value] = share
    return {
        "columns": {name: [m[name] for m in there] for name in (parameter, *model.DERIVED)},
        "motions": [
            {
                "name": shorten_names([own[v].notation for v in values if v in own]),
                "parts": [own[v].fraction if v in own else 0.0 for v in values],
                "low": [own[v].low if v in own else 0.0 for v in values],
                "high": [own[v].high if v in own else 0.0 for v in values],
            }
            for _, own in sorted(motions.items())
        ],
    }
