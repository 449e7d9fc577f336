"""What is observed at each value of the parameter: attractors of branches and of a simulation.

The parameter's range is cut where an attractor begins or ends. Periodic attractors are the stable
physical orbits of the branches, whose ends are events; other motion is that of simulated attractors
that lie on no branch, whose ends are known as exactly as the sweep has located them, or are the
crisis or the event that lies there.
"""

from __future__ import annotations

import itertools
import json
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..display import NotebookResult, Summary, frame
from ..errors import InputError, count_text, explain_arguments
from ..models.guards import Word, is_rotation
from ..models.model import Model
from ..orbits.quiet import problem_in, problem_of
from ..results.branch import Branch, Entry, model_at
from ..results.catalogue import (
    Bound,
    Motion,
    Share,
    load_diagram,
    read_fractions,
    shorten_names,
    simulation_remarks,
)
from ..results.diagram import Diagram
from ..results.diagram_reading import Interval, places_of
from ..schema import build_record, fit_value
from ..segments.kernels import Kernels
from ..simulation.attractor import Kind
from ..simulation.files import COVERAGE, TRANSITIONS, sweep_of
from ..simulation.sweep import Coverage, Row, Sweep, begins_with, cover, orbits_on
from ..storage import check_reading, csv_text, is_there, read_json
from .crisis_location import CR
from .orbit_walks import AT_IMAGE, symmetric, symmetry_of

RANGES = "contimpact.ranges/1"
"""Schema of the table of ranges."""
FOLDER = "a folder of contimpact run or simulate"
Bracket = tuple[float, float, str]


@dataclass(frozen=True)
class Observed:
    """An attractor within a range."""

    motion: Motion
    speed: float
    """Largest speed before an impact."""
    fractions: tuple[float, float] | None
    """Smallest and largest basin fraction counted in the range; None where none was."""


@dataclass(frozen=True)
class Range:
    """Values of the parameter between which the same attractors are there."""

    low: float
    high: float
    observed: Sequence[Observed]

    def __repr__(self) -> str:
        here = "; ".join(_cells(one)[0] for one in self.observed) or "no attractor is known"
        return f"{self.low:.9g} to {self.high:.9g}: {here}"


@dataclass(frozen=True, eq=False)
class Ranges(NotebookResult):
    """Which attractors are there over the whole range of a parameter."""

    name: str
    parameter: str
    ranges: Sequence[Range]
    motions: Sequence[Motion]
    notes: Sequence[str] = ()
    """What may be missing, and what would show it."""

    def at(self, value: float) -> Range:
        """Return the range in which a value lies; where two ranges meet, that with more attractors.

        Raises InputError if it lies in none.
        """
        if found := [r for r in self.ranges if r.low <= value <= r.high]:
            return max(found, key=lambda r: len(r.observed))
        accepted = f"give one from {self.ranges[0].low:.9g} to {self.ranges[-1].high:.9g}"
        raise InputError(self.parameter, f"found {value}", accepted)

    def describe(self, value: float) -> str:
        """Return in words what is observed at a value, and how far each attractor's end is; what
        may be missing is in `notes`."""
        here = self.at(value)
        count = len(here.observed)
        told = {0: "no attractor is known", 1: "one attractor"}.get(count, f"{count} attractors")
        lines = [f"{self.parameter} = {value:.9g}: {told}"]
        for one in here.observed:
            distance, end = one.motion.nearest(value)
            way = "below" if end.value < value else "above"
            share = f"; {_percent(one.fractions)} of starts" if one.fractions else ""
            speed = one.motion.speed(value, value)
            fastest = f"; impacts at up to {speed:.4g}" if math.isfinite(speed) else ""
            lines += [
                f"  {one.motion.notation}{_on(one.motion)}{fastest}{share}",
                f"    nearest end {distance:.4g} {way}, at {end.value:.9g}: {end.text}",
            ]
        return "\n".join(lines)

    def rows(self) -> list[tuple[Any, ...]]:
        """Return a row for each attractor in each range, in the order of `COLUMNS`."""
        return [
            (r.low, r.high, m.notation, m.branch, m.simulated, one.speed)
            + (one.fractions or (None, None))
            + tuple(x for end in (m.low, m.high) for x in (end.value, end.error, end.text))
            for r in self.ranges
            for one in r.observed
            for m in (one.motion,)
        ]

    def to_dataframe(self) -> Any:
        """Return the rows as a pandas DataFrame; pandas must be installed."""
        return frame([dict(zip(COLUMNS, row, strict=True)) for row in self.rows()])

    def summary(self) -> Summary:
        """Return the ranges in short."""
        rows = [
            (f"{r.low:.9g} to {r.high:.9g}", *cells)
            for r in self.ranges
            for cells in (list(map(_cells, r.observed)) or [("none is known", "", "", "")])
        ]
        columns = (self.parameter, "attractor", "fastest impact", "from", "to")
        return Summary(f"{self.name}: attractors along {self.parameter}", columns, rows, self.notes)

    def __repr__(self) -> str:
        lines = [f"{self.name}: attractors along {self.parameter}"]
        lines += [f"  {r!r}" for r in self.ranges]
        for m in self.motions:
            speed = max(m.speeds, default=math.nan)
            fastest = f", with impacts at up to {speed:.4g}" if math.isfinite(speed) else ""
            lines.append(f"{m.notation}{_on(m)}{fastest}")
            lines.append(f"  from {m.low}")
            lines.append(f"  to   {m.high}")
        return "\n".join([*lines, *self.notes])


COLUMNS = (
    *("low", "high", "notation", "branch", "simulated", "speed", "fraction_low", "fraction_high"),
    *("from", "from_error", "from_what", "to", "to_error", "to_what"),
)


def _cells(one: Observed) -> tuple[str, str, str, str]:
    motion = one.motion
    speed = f"{one.speed:.4g}" if math.isfinite(one.speed) else ""
    share = f" ({_percent(one.fractions)} of starts)" if one.fractions else ""
    return f"{motion.notation}{_on(motion)}{share}", speed, str(motion.low), str(motion.high)


def _on(motion: Motion) -> str:
    return f" on {motion.branch}" if motion.branch else ", simulated"


def _percent(parts: tuple[float, float]) -> str:
    low, high = (f"{100.0 * part:.3g}" for part in parts)
    return f"{low} %" if low == high else f"{low} to {high} %"


def ranges_text(found: Ranges) -> str:
    """Return the ranges as a table with a comment line."""
    head = {"schema": RANGES, "name": found.name, "parameter": found.parameter}
    return f"# {json.dumps({**head, 'notes': list(found.notes)})}\n" + csv_text(
        COLUMNS, found.rows()
    )


@explain_arguments
def attractor_ranges(
    diagram: Diagram,
    sweep: Sweep | None = None,
    *,
    coverage: Coverage | None = None,
    brackets: Sequence[Bracket] = (),
    fractions: Iterable[Share] = (),
) -> Ranges:
    """Return which attractors are there over the range of the followed parameter.

    Parameters
    ----------
    diagram : Diagram
        Its stable physical orbits are attractors; its crises end complex motion.
    sweep : Sweep, optional
        Its attractors that lie on no branch are added, neighbours of each other as one motion.
    coverage : Coverage, optional
        Which attractors of the sweep lie on branches; found by `cover` otherwise.
    brackets : sequence of (float, float, str)
        Values before and after each transition of the sweep, where these are located more closely
        than by its values, and the notation of the motion before.
    fractions : iterable of Share
        Basin fractions, as `BasinFractions.shares` gives them.

    Returns
    -------
    Ranges

    Raises
    ------
    InputError
        If there is neither a branch nor a simulated attractor, or their parameters differ.
    """
    parameters = {branch.parameter for branch in diagram.branches}
    parameters |= {sweep.parameter} if sweep is not None and sweep.rows else set()
    if len(parameters) != 1:
        found = f"the parameters {', '.join(sorted(parameters))}" if parameters else "no attractor"
        raise InputError("diagram", found, "give branches and a sweep along one parameter")
    parameter = parameters.pop()
    diagram, others = _at_one_place(diagram, sweep)
    reading = diagram.reading
    motions = [_of_branch(diagram, interval) for interval in reading.stable]
    notes = [reading.incomplete] if diagram.branches else []
    notes += others
    if mirrored := [i for i in reading.stable if _has_mirror_image(diagram, i, sweep)]:
        names = ", ".join(dict.fromkeys(f"{i.notation} on {i.branch}" for i in mirrored))
        notes.append(f"the mirror images of {names} are attractors, too, and not listed")
    if stopped := diagram.statistics.get("stopped"):
        notes.append(
            f"the run ended early ({stopped}): attractors may be missing; contimpact run finds them"
        )
    notes += [
        f"not known whether {i.notation} on {i.branch} is stable from {i.low:.9g} to {i.high:.9g}"
        for i in reading.unknown
    ]
    values = [v for b in diagram.branches for v in (b[parameter].min(), b[parameter].max())]
    shares = _on_branches(fractions, diagram, sweep)
    if sweep is None or not sweep.rows:
        notes.append("complex motion is not known: nothing was simulated (contimpact simulate)")
    else:
        if coverage is None:
            coverage = cover(sweep, diagram)
            notes += _unmatched(sweep, diagram)
        rest, counts = _split(sweep, coverage, motions)
        motions = [replace(m, simulated=counts[k]) for k, m in enumerate(motions)]
        simulated, more = _simulated(rest, sweep, diagram, brackets, motions, shares)
        motions += simulated
        notes += more
        swept = [row.value for row in sweep.rows]
        if values and (min(swept) > min(values) or max(swept) < max(values)):
            notes.append(f"simulated from {min(swept):.9g} to {max(swept):.9g} only")
        values += swept
    low, high = float(min(values)), float(max(values))
    ranges = _cut(motions, low, high, shares)
    notes += _unlisted(ranges, parameter, shares)
    return Ranges(diagram.name, parameter, ranges, motions, notes)


@explain_arguments
def load_ranges(folder: str | Path, model: Model | None = None) -> Ranges:
    """Return the ranges of a folder of results: its branches, and what was simulated if it was.

    Parameters
    ----------
    folder : str or Path
        Of ``contimpact run``, with what was simulated in it or in its folder ``simulation``, or of
        ``contimpact simulate``.
    model : Model, optional
        The system, where the branches do not name it.

    Returns
    -------
    Ranges

    Raises
    ------
    InputError
        If the folder holds neither branches nor attractors, or a file in it is damaged.
    """
    folder = Path(folder)
    branches = is_there(folder / "catalogue.json") or _place_of_sweep(folder) is None
    diagram = load_diagram(folder) if branches else Diagram(folder.name, [])
    return ranges_in(folder, diagram, model)


def _place_of_sweep(folder: Path) -> Path | None:
    places = [folder, folder / "simulation"]
    return next((place for place in places if is_there(place / "sweep.csv")), None)


def ranges_in(folder: Path, diagram: Diagram, model: Model | None = None) -> Ranges:
    """Return the ranges of a diagram and of what was simulated in a folder, which may still be
    written to; see `load_ranges`."""
    place = _place_of_sweep(folder)
    if place is None:
        return attractor_ranges(diagram)
    if model is None:
        if not diagram.branches:
            raise InputError(str(folder), "no branch names the system", "give `model`")
        model = model_at(diagram.branches[0], 0)
    coverage, brackets, shares = None, list[Bracket](), list[Share]()
    if is_there(path := place / "coverage.json"):
        with check_reading(path, COVERAGE):
            coverage = build_record(Coverage, read_json(path, COVERAGE, FOLDER))
    if is_there(path := place / "transitions.json"):
        with check_reading(path, TRANSITIONS):
            brackets = [
                fit_value(
                    [before["value"], t["after"]["value"], before["notation"]], Bracket, "value"
                )
                for t in read_json(path, TRANSITIONS, FOLDER)["transitions"]
                for before in (t["before"],)
            ]
    if is_there(path := place / "fractions.csv"):
        _, shares = read_fractions(path)
    found = sweep_of(place / "sweep.csv", model)
    about: Any = {"coverage": coverage, "brackets": brackets, "fractions": shares}
    ranges = attractor_ranges(diagram, found, **about)
    return replace(ranges, notes=[*simulation_remarks(place), *ranges.notes])


def _at_one_place(diagram: Diagram, sweep: Sweep | None) -> tuple[Diagram, list[str]]:
    """The diagram at the values of the sweep, or else of its first branch, and what is left out."""
    if sweep is not None and sweep.rows:
        found = sweep.rows[0].attractor
        own = diagram.at({name: found[name] for name in sweep.model.values})
    elif diagram.branches:
        first = diagram.branches[0]
        own = diagram.at({name: first[name][0] for name in first.constant})
    else:
        return diagram, []
    if not (left := len(diagram.branches) - len(own.branches)):
        return own, []
    place = places_of(diagram.branches).get(own.branches[0].id) if own.branches else ""
    here = place or " at the values of the sweep"
    return own, [f"branches{here} alone; {count_text(left, 'other')} left out"]


# Stable orbits of branches.


def _of_branch(diagram: Diagram, interval: Interval) -> Motion:
    branch = diagram[interval.branch]
    assert isinstance(branch, Branch)
    events = {entry.id: entry for entry in diagram.entries}
    low, high = (
        _bound(branch, events, value, name)
        for value, name in zip((interval.low, interval.high), interval.bounds, strict=True)
    )
    values, speeds = _speeds(branch, interval)
    return Motion(interval.notation, interval.branch, low, high, 0, values, speeds)


def _has_mirror_image(diagram: Diagram, interval: Interval, sweep: Sweep | None) -> bool:
    """Whether the mirror images of a branch's orbits are other orbits; False if its system is not
    known."""
    branch = diagram[interval.branch]
    assert isinstance(branch, Branch)
    word, parameter = Word(branch.word, branch.period), branch.parameter
    try:
        model = model_at(branch, 0, sweep.model if sweep else None)
        if type(model).symmetry is Model.symmetry:  # no formulas are derived to learn of none
            return False
        symmetry = symmetry_of(problem_of(model, word, Kernels(model, parameter)))
        orbits = [branch.orbit(row, model) for row in interval.rows[0]] if symmetry else []
    except InputError:
        return False
    ends = (problem_in(parameter, orbit.model, orbit.linearisation) for orbit in orbits)
    return not all(symmetric(*end, symmetry, AT_IMAGE) for end in ends)


def _bound(branch: Branch, events: dict[str, Entry], value: float, name: str | None) -> Bound:
    """The end of stable orbits: an event, that of the parent for a branch that is born there, be it
    as one that goes on as its own mirror image."""
    entry, origin = events.get(name or ""), events.get(branch.origin or "")
    if origin is not None and (name == "born" or math.isclose(value, origin.value, rel_tol=1e-9)):
        entry = entry or origin
    if entry is not None:
        return Bound(value, entry.error, entry.id, f"{entry.label} {entry.id}")
    words = {None: "the status changes between two points", "range": "the range ends"}
    return Bound(value, 0.0, None, words.get(name, f"the branch ends ({name})"))


def _speeds(branch: Branch, interval: Interval) -> tuple[list[float], list[float]]:
    """Largest impact speeds of the orbits of an interval, at rising values of the parameter."""
    values = branch[branch.parameter]
    good = branch.stable & branch.physical
    ends = np.isin(branch["event"], [bound for bound in interval.bounds if bound])
    inside = np.zeros(len(values), dtype=bool)
    for first, last in interval.rows:
        inside[first : last + 1] = True
    inside &= good | ends
    if not branch.velocities.size:
        return [], []
    order = np.argsort(values[inside], kind="stable")
    speeds = np.abs(branch.velocities[inside]).max(axis=1)
    return values[inside][order].tolist(), speeds[order].tolist()


# Simulated attractors that lie on no branch.


def _unmatched(sweep: Sweep, diagram: Diagram) -> list[str]:
    """A remark on motion without impacts whose rows do not say where it is, as those of a table."""
    branches = [branch.id for branch in diagram.branches if not branch.word]
    still = (row.attractor for row in sweep.rows if not row.attractor.walls.size)
    if not branches or all(one.motion is not None for one in still):
        return []
    return [
        f"simulated motion without impacts may be that of {' or '.join(branches)}, and is then "
        "listed twice: simulate with branches = true"
    ]


def _split(
    sweep: Sweep, coverage: Coverage, motions: Sequence[Motion]
) -> tuple[list[Row], Counter[int]]:
    """The attractors that lie on no branch, and how many lie on the orbits of each motion."""
    matched = {(m.direction, m.value, m.notation): m.branch for m in coverage.matches}
    counts = Counter[int]()
    rest = []
    for row in sweep.rows:
        branch = matched.get((row.direction, row.value, row.attractor.notation))
        if branch is None:
            rest.append(row)
            continue
        speed, at = row.attractor.fastest, row.value
        near = [
            (max(m.low.value - at, at - m.high.value, 0.0), abs(m.speed(at, at) - speed), k)
            for k, m in enumerate(motions)
            if m.branch == branch
        ]
        if near:  # of stretches of a branch at the same values, that with its speed
            counts[min(near)[2]] += 1
    return rest, counts


def _simulated(
    rest: Sequence[Row],
    sweep: Sweep,
    diagram: Diagram,
    brackets: Sequence[Bracket],
    motions: Sequence[Motion],
    shares: Sequence[Share],
) -> tuple[list[Motion], list[str]]:
    """Motions of attractors at neighbouring values that lie on no branch, and remarks."""
    grid = sorted({row.value for row in sweep.rows})
    place = {value: k for k, value in enumerate(grid)}
    there: dict[int, list[Row]] = {}
    for row in rest:
        there.setdefault(place[row.value], []).append(row)
    runs: list[list[int]] = []
    for k in sorted(there):
        if runs and runs[-1][-1] == k - 1:
            runs[-1].append(k)
        else:
            runs.append([k])
    found, lost = list[Motion](), 0
    ends, late = _ends(diagram, motions), partial(_left_early, grid, sweep, brackets)
    for run in runs:
        rows = [row for k in run for row in there[k]]  # at rising values
        settled = [row for row in rows if row.attractor.kind is not Kind.NOT_SETTLED]
        if not settled:
            lost += len(rows)
            continue
        names = [row.attractor.notation for row in settled]
        free = all(
            row.attractor.motion is not None or not row.attractor.walls.size for row in settled
        )
        met = [s.value for s in shares if s.branch is None and s.notation in names]
        low, high = (
            _edge(grid, k, way, brackets, [] if free else ends[way], met, late(names, k, way))
            for k, way in ((run[0], -1), (run[-1], +1))
        )
        hitting = [row for row in settled if row.attractor.velocities.size]
        values = [row.value for row in hitting]
        largest = [row.attractor.fastest for row in hitting]
        said = shorten_names(names), None, low, high, len(rows), values, largest
        found.append(Motion(*said, met=sorted({*names})))
    motions_lost = count_text(lost, "simulated motion")
    note = f"{motions_lost} on no branch had not settled; give [simulate] more periods"
    return found, [note] * (lost > 0)


def _ends(diagram: Diagram, motions: Sequence[Motion]) -> dict[int, list[Bound]]:
    """What may be the lower (-1) and the upper (1) end of motion that lies on no branch.

    It is a crisis, or where a stable orbit ends below it and begins above it.
    """
    crises = [
        Bound(e.value, e.error, e.id, f"{e.label} {e.id}")
        for e in diagram.entries
        if e.crisis is not None
    ]
    neighbours = {-1: [m.high for m in motions], +1: [m.low for m in motions]}
    return {
        way: crises + [end for end in found if end.entry is not None]
        for way, found in neighbours.items()
    }


def _left_early(
    grid: Sequence[float],
    sweep: Sweep,
    brackets: Sequence[Bracket],
    names: Sequence[str],
    place: int,
    way: int,
) -> tuple[float, float] | None:
    """The bracket of the end of motion of these names where a step of the sweep has left its basin
    before, so that this end lies beyond the step."""
    if not 0 <= place + way < len(grid):
        return None
    beyond = way * grid[place + way]
    again = (way * row.value for row in sweep.rows if row.attractor.notation in names)
    first = min((value for value in again if value >= beyond), default=math.inf)
    late = [
        (before, after)
        for before, after, name in brackets
        if name in names and way * grid[place] <= way * before < min(first, way * after)
    ]
    found = min(late, key=lambda bracket: way * bracket[0], default=None)
    return found if found and way * found[1] > beyond else None


def _edge(
    grid: Sequence[float],
    place: int,
    way: int,
    brackets: Sequence[Bracket],
    ends: Sequence[Bound],
    met: Sequence[float],
    late: tuple[float, float] | None,
) -> Bound:
    """Where a run of simulated values ends on one side: an event in the bracket, or its middle.

    The motion is still there at the values at which random starts have met it. A crisis may lie a
    step away, since transients outlast the attractor. Where several events lie in a step of the
    sweep, it is too coarse to tell which one it is.
    """
    inner, outer = grid[place], grid[place + way] if 0 <= place + way < len(grid) else math.nan
    if math.isnan(outer):
        return Bound(inner, 0.0, None, "the sweep ends")
    inner = way * max(way * v for v in (inner, *met) if way * v < way * outer)
    step = abs(outer - grid[place])
    low, high = sorted(late or (inner, outer))
    crises = [e for e in ends if e.text.startswith(CR) and low - step <= e.value <= high + step]
    closer = [(min(b), max(b)) for *b, _ in brackets if low <= min(b) < max(b) <= high]
    if closer:
        low, high = max(closer) if way > 0 else min(closer)
    slack = high - low if closer else 0.0
    near = crises or [end for end in ends if low - slack <= end.value <= high + slack]
    if len(near) == 1 or (near and closer):
        end = min(near, key=lambda end: abs(end.value - 0.5 * (low + high)))
        error = end.error if crises else max(abs(end.value - low), abs(end.value - high))
        return replace(end, error=error, text=f"{end.text}, where simulation has it")
    text = f"simulated between {low:.9g} and {high:.9g}"
    return Bound(0.5 * (low + high), 0.5 * (high - low), None, text)


# Ranges.


def _cut(
    motions: Sequence[Motion], low: float, high: float, shares: Sequence[Share]
) -> list[Range]:
    """Cut the range where an attractor begins or ends."""
    edges = [low]
    tolerance = 1e-12 * max(abs(low), abs(high))
    for value in sorted({end.value for m in motions for end in (m.low, m.high)}):
        if edges[-1] + tolerance < value < high - tolerance:
            edges.append(value)
    edges.append(high)
    found: list[Range] = []
    for left, right in itertools.pairwise(edges):
        middle = 0.5 * (left + right)
        here = [m for m in motions if m.low.value < middle < m.high.value]
        if found and [one.motion for one in found[-1].observed] == here:
            left = found.pop().low
        found.append(Range(left, right, [_observed(m, here, left, right, shares) for m in here]))
    return found


def _on_branches(fractions: Iterable[Share], diagram: Diagram, sweep: Sweep | None) -> list[Share]:
    """The shares, with the branches on which their orbits lie; by notation where no system is
    known."""
    shares = list(fractions)
    if not any(share.word for share in shares) or not diagram.branches:
        return shares
    try:
        model = sweep.model if sweep else model_at(diagram.branches[0], 0)
    except InputError:
        return [share._replace(word="") for share in shares]
    parameter = diagram.branches[0].parameter
    about, kernels = Sweep(model, parameter, []), Kernels(model, parameter)
    found = []
    for share in shares:
        word = Word(share.word, share.period)
        branches = (
            branch.id
            for branch in diagram.branches
            if share.word and branch.period == word.period and is_rotation(branch.word, word.walls)
            for orbit in orbits_on(branch, about, share.value, kernels)
            if begins_with(orbit, word, (share.time, share.velocity))
        )
        found.append(share._replace(branch=next(branches, None)))
    return found


def _owners(share: Share, here: Sequence[Motion]) -> list[Motion]:
    """The motions in a range that a share may be of: those of its branch, or of its notation if its
    orbit is not known, or else those that simulation alone shows, of periodic ones if it has met
    the notation."""
    mine = [
        m
        for m in here
        if m.branch and (m.branch == share.branch if share.word else m.notation == share.notation)
    ]
    alone = [m for m in here if m.branch is None]
    return mine or [m for m in alone if not share.word or share.notation in m.met]


def _unlisted(ranges: Sequence[Range], parameter: str, shares: Sequence[Share]) -> list[str]:
    """Remarks on motion that random starts lead to and neither a branch nor the sweep has."""
    found = []
    for share in shares:
        here = next((r for r in ranges if r.low <= share.value <= r.high), None)
        if not (here and _owners(share, [one.motion for one in here.observed])):
            part = (
                f"{_percent((share.fraction, share.fraction))} of starts lead to {share.notation}"
            )
            found.append(f"{parameter} = {share.value:.9g}: {part}, on no branch and in no sweep")
    return found


def _observed(
    motion: Motion, here: Sequence[Motion], low: float, high: float, shares: Sequence[Share]
) -> Observed:
    """An attractor in a range, with its basin fractions where these are told apart."""
    parts = dict.fromkeys((share.value for share in shares if low <= share.value <= high), 0.0)
    apart = True
    for share in (share for share in shares if share.value in parts):
        owners = _owners(share, here)
        if any(owner is motion for owner in owners):
            apart = apart and len(owners) == 1
            parts[share.value] += share.fraction
    given = (min(parts.values()), max(parts.values())) if parts and apart else None
    return Observed(motion, motion.speed(low, high), given)
