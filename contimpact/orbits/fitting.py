r"""Orbits fitted to measured impacts: parameters, their covariance, and which word is nearest.

A row of the data has the wall, the time and the velocity before impact, or some of them. It belongs
to the impact k of the orbit on that wall that is nearest in deviations, n periods later:

.. math:: \tau_i = t_k(p) + n_i P(p) + c + \epsilon_i, \qquad w_i = v_k(p) + \eta_i,

with the clock c, an offset of the data's time. The sum of squares is made least along the orbits of
the word by the method of Levenberg and Marquardt. Derivatives of the orbit are exact: those of the
orbit problem, as in `Orbit.sensitivity`. The covariance is that of linear least squares at the
minimum (see Seber and Wild, Nonlinear Regression, 1989, section 2.1).
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array
from ..display import NotebookResult, Summary
from ..errors import (
    InputError,
    count_text,
    did_you_mean,
    explain_arguments,
    random_generator,
    short_repr,
)
from ..models.guards import Wall, Word
from ..models.model import Model
from ..schema import LARGEST_NUMBER
from ..segments.kernels import Kernels
from .orbit import Orbit
from .quiet import problem_of
from .search import find_orbits, solve_near

CLOCK = "clock"
"""Name of the offset between the data's time and the model's."""
MEASURED = ("time", "velocity")
ITERATIONS, MOST_DAMPED = 100, 1e12
"""Steps at most, and the damping, in parts of the scaled normal matrix, at which there is none."""
SINGULAR = 1e-9
"""Ratio of singular values of the scaled Jacobian below which a combination is undetermined."""
CLOCKS, KEPT = 64, 3
"""Offsets tried per forcing period, and those from which a fit begins."""
ELSEWHERE, AROUND = 8, 0.3
"""How often other starting values are drawn where there is no orbit, and how far, as a part."""
REWEIGHTED = 20
"""Fits at most with the deviations that the residuals of the last one have, where none are given;
the last one changes them by less than 1e-6."""
ROUNDED = 1e-12
"""Least deviation of exact data, in parts of period and largest velocity."""
LIKELY = 9.2
"""By how much larger the misfit of a fit is at most that is not refuted: e^4.6 is a hundred."""
SELDOM = 1e-3
"""Part of fits in which chance may name a number that is not wrong."""
AMBIGUOUS = 3.0
"""Deviations by which an impact has to be nearer to a row than the next one."""


# The data.


@dataclass(frozen=True, eq=False)
class Impacts:
    """Measured impacts, a row for each; what is missing is NaN, or an empty wall."""

    walls: tuple[str, ...]
    times: Array
    velocities: Array
    places: tuple[str, ...] = field(repr=False)
    """What messages call each row."""

    def column(self, name: str) -> Array:
        """Return the times or the velocities."""
        return self.times if name == "time" else self.velocities


def read_impacts(data: str | Path | Mapping[str, Sequence[Any]]) -> Impacts:
    """Read measured impacts: a CSV file, or columns `time`, `velocity` (before impact) and `wall`,
    in the units of the model. A file names them in its first line; a cell may be empty, lines that
    begin with # are left out.

    Raises InputError naming the line, for what is no number, a row without time and velocity, or
    another column.
    """
    if isinstance(data, Mapping):
        columns = {str(name): list(cells) for name, cells in data.items()}
        if len({len(cells) for cells in columns.values()}) > 1:
            found = ", ".join(f"{name} {len(cells)}" for name, cells in columns.items())
            raise InputError("data", f"columns of unlike lengths: {found}", "give equal lengths")
        rows = list(zip(*columns.values(), strict=True))
        return _impacts(list(columns), rows, [f"data, row {i}" for i in range(1, len(rows) + 1)])
    try:
        lines = Path(data).read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or error
        raise InputError(str(data), f"it cannot be read ({why})", "give a CSV file") from None
    kept = [
        (i, line) for i, line in enumerate(lines, 1) if line.strip() and line.lstrip()[0] != "#"
    ]
    cells = [[cell.strip() for cell in row] for row in csv.reader(line for _, line in kept)]
    if not cells:
        raise InputError(str(data), "no rows", "give a line of names and a row for each impact")
    for (i, _), row in zip(kept, cells, strict=True):
        if len(row) != len(cells[0]):
            found = f"{len(row)} cells under {len(cells[0])} names"
            raise InputError(f"{data}, line {i}", found, "leave a comma where a cell is empty")
    return _impacts(cells[0], cells[1:], [f"{data}, line {i}" for i, _ in kept[1:]])


def _impacts(names: list[str], rows: Sequence[Sequence[Any]], places: list[str]) -> Impacts:
    known = (*MEASURED, "wall")
    for name in names:
        if name not in known or names.count(name) > 1:
            found = f"column {short_repr(name)}{did_you_mean(name, known)}"
            found += ", twice" if names.count(name) > 1 else ""
            raise InputError("data", found, "give the columns time, velocity, wall, or some")
    if not rows or not set(names) & set(MEASURED):
        raise InputError("data", "no times and no velocities", "give rows with one of them")
    numbers = np.full((len(rows), 2), math.nan)
    walls = []
    for i, row in enumerate(rows):
        cells = dict(zip(names, row, strict=True))
        for j, name in enumerate(MEASURED):
            numbers[i, j] = _number(cells.get(name), f"{places[i]}, {name}")
        if np.all(np.isnan(numbers[i])):
            raise InputError(places[i], "neither time nor velocity", "leave the row out")
        wall = cells.get("wall")
        walls.append("" if wall is None or wall != wall else str(wall))  # NaN in tables
    return Impacts(tuple(walls), numbers[:, 0], numbers[:, 1], tuple(places))


def _number(cell: Any, where: str) -> float:
    """The number in a cell; NaN where it is empty."""
    try:
        value = math.nan if cell is None or cell == "" else float(cell)
    except (TypeError, ValueError):
        raise InputError(where, short_repr(cell), "give a number, or nothing") from None
    if abs(value) > LARGEST_NUMBER:
        accepted = f"give a finite number, at most {LARGEST_NUMBER:g} in size, or nothing"
        raise InputError(where, short_repr(cell), accepted)
    return value


# A fit.


@dataclass(frozen=True, eq=False)
class Fit(NotebookResult):
    """An orbit fitted to measured impacts; see `fit`."""

    orbit: Orbit
    """The orbit at the estimates."""
    values: Mapping[str, float]
    """Estimates, with that of the `clock` if it was fitted."""
    covariance: Array
    """Of the estimates, in their order; NaN where there is a `reason`."""
    chi2: float
    """Sum of squares of the residuals, in deviations."""
    freedom: int
    """Numbers measured less the estimates."""
    deviations: Mapping[str, float]
    """Standard deviations of a time and of a velocity, given or estimated from the residuals."""
    given: bool
    """Whether these were given: the covariance is then absolute."""
    residuals: Array
    """Measured less fitted times and velocities, a row for each of the data; NaN where missing."""
    impacts: Array
    """The impact of the orbit, from 0 on, that each row belongs to."""
    data: Impacts = field(repr=False)
    misfit: float
    """Twice the negative logarithm of the likelihood, but for a constant: it compares fits. Where
    deviations are not given, it is that of the deviations at which the likelihood is largest."""
    reason: str | None = None
    """Why it is no minimum, or not the only one; None otherwise."""
    notes: tuple[str, ...] = ()
    others: tuple[Fit, ...] = field(default=(), repr=False)
    """Fits of the other orbits, the nearest first."""

    @property
    def errors(self) -> dict[str, float]:
        """Standard deviations of the estimates."""
        return dict(zip(self.values, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def p_value(self) -> float | None:
        """Probability of residuals as large if the word and all other parameters are right.

        By chi2 where deviations were given. Otherwise by the test for lack of fit: means of the
        residuals of repeated impacts are compared with their scatter, which does not see that a
        word lacks impacts; `notes` do. None where neither can be said, as of exact data, or where
        there is a `reason`.
        """
        from scipy.stats import chi2, f

        if self.reason is not None or not self.freedom:
            return None
        if self.given:
            return float(chi2.sf(self.chi2, self.freedom))
        lack = scatter = 0.0
        count = groups = 0
        period = self.orbit.period / self.orbit.word.period
        scales = period, float(np.max(np.abs(self.orbit.velocities)))
        for i, kind in enumerate(MEASURED):
            if self.deviations.get(kind, 0.0) <= ROUNDED * scales[i]:
                continue  # exact data: what is left is rounding
            for k in sorted(set(self.impacts.tolist())):
                off = self.residuals[self.impacts == k, i]
                off = off[~np.isnan(off)] / self.deviations[kind]
                if len(off):
                    count, groups = count + len(off), groups + 1
                    lack += len(off) * float(np.mean(off)) ** 2
                    scatter += float(np.sum((off - np.mean(off)) ** 2))
        over, within = groups - len(self.values), count - groups
        if over < 1 or within < 1 or not scatter > 0.0:
            return None
        return float(f.sf(lack / over / (scatter / within), over, within))

    @property
    def state(self) -> str:
        """Whether the orbit is stable, unstable or unphysical."""
        if not self.orbit.physical:
            return "unphysical"
        return "stable" if self.orbit.stable else "unstable"

    def covers(self, truth: Mapping[str, float], level: float = 0.95) -> bool:
        """Return whether the confidence ellipsoid of some parameters holds their values."""
        from scipy.stats import chi2, f

        names = list(self.values)
        for name in truth:
            if name not in names:
                raise InputError("truth", repr(name), f"give some of {', '.join(names)}")
        at = [names.index(name) for name in truth]
        off = np.array([truth[name] - self.values[name] for name in truth])
        if CLOCK in truth:
            i, span = list(truth).index(CLOCK), self.orbit.period
            off[i] -= span * round(off[i] / span)
        distance = off @ np.linalg.solve(self.covariance[np.ix_(at, at)], off)
        most = len(at) * f.ppf(level, len(at), self.freedom) if not self.given else 0.0
        return bool(distance <= (chi2.ppf(level, len(at)) if self.given else most))

    def summary(self) -> Summary:
        """Return the estimates in short."""
        p = self.p_value
        title = f"Fit of {self.orbit.notation} ({self.orbit.word}), {self.state}: "
        title += f"chi2 = {self.chi2:.4g} of {self.freedom}"
        title += f", p = {p:.2g}" if p is not None else ""
        errors = self.errors
        rows = [(name, value, errors[name]) for name, value in self.values.items()]
        notes = ([self.reason] if self.reason else []) + [*self.notes]
        return Summary(title, ("parameter", "estimate", "standard deviation"), rows, notes)

    def __repr__(self) -> str:
        told = self.summary()
        lines = [told.title]
        for name, value, error in told.rows:
            lines.append(f"  {name} = {value:.9g}" + (f" +- {error:.2g}" if error >= 0.0 else ""))
        lines += [f"  {text}" for text in told.notes]
        for other in self.others[:3]:
            values = (
                f"{name} = {value:.4g}" for name, value in other.values.items() if name != CLOCK
            )
            which = ", ".join((other.orbit.notation, other.state, *values))
            lines.append(f"  further: {which}: {_beside(other, self)}")
        return "\n".join(lines)


@explain_arguments
def fit(
    model: Model,
    words: str | Word | Orbit | Iterable[str | Word | Orbit],
    data: str | Path | Mapping[str, Sequence[Any]] | Impacts,
    parameters: Sequence[str],
    *,
    deviations: Mapping[str, float] | None = None,
    clock: bool = True,
    rng: np.random.Generator | int = 0,
) -> Fit:
    """Fit parameters of a model to measured impacts of a periodic orbit.

    Parameters
    ----------
    model : Model
        Its values are those the fit starts from, and those of all other parameters.
    words : str, Word or Orbit, or several
        Orbits by name, each of which is searched for at the starting values, or, where there is
        none, at others drawn around them; or an orbit, which starts from its own values. The
        nearest is returned, with the `others`.
    data : path, mapping or Impacts
        See `contimpact.orbits.fitting.read_impacts`. Rows may be of many periods, in any order.
    parameters : sequence of str
        Those to estimate.
    deviations : mapping of str to float, optional
        Standard deviations of a `time` and of a `velocity`, as independent errors have. Otherwise
        they are estimated from the residuals: each kind's where there are more than two numbers for
        each estimate, and one in parts of period and largest velocity where there are fewer.
    clock : bool
        Whether the data's time has an unknown offset, which is then estimated too, modulo the
        orbit's period.
    rng : numpy.random.Generator or int
        For the search of orbits.

    Returns
    -------
    Fit
        Orbits of which each impact has data come before others, then physical ones before
        unphysical ones; then the least `misfit` decides.

    Raises
    ------
    InputError
        For data that cannot be read, an unknown parameter, or where no orbit is found to start
        from.
    """
    data = data if isinstance(data, Impacts) else read_impacts(data)
    if model.autonomous:
        found = "its period is free, and a time has no phase"
        raise InputError("model", found, "give a forced system")
    names = [parameters] if isinstance(parameters, str) else list(parameters)
    for name in names:
        model.require(name, "parameters")
    if not names or len(set(names)) < len(names):
        raise InputError("parameters", short_repr(names), "name at least one, each once")
    measured = [name for name in MEASURED if not np.all(np.isnan(data.column(name)))]
    if deviations is not None:
        for name in measured:
            if not 0.0 < deviations.get(name, 0.0) < math.inf:
                found = f"{short_repr(dict(deviations))}, with a {name} in the data"
                raise InputError("deviations", found, f"give {name} a number > 0")
    for wall, place in zip(data.walls, data.places, strict=True):
        if wall and wall not in model.letters:
            raise InputError(f"{place}, wall", repr(wall), f"give {', '.join(model.letters)}")
    _require_signs(model, data)
    starts, notes = _starts(model, words, names, rng)
    fits = []
    for orbit in starts:
        lacking = {w for w in data.walls if w} - set(orbit.word.walls)
        if lacking:
            notes.append(f"{orbit.notation} has no impact on {', '.join(sorted(lacking))}")
            continue
        kernels = {name: Kernels(orbit.model, name) for name in names}
        task = _Task(orbit.model, orbit.word, data, kernels, clock and "time" in measured)
        fits.append(_best(task, orbit, deviations))
    if not fits:
        found = "; ".join(dict.fromkeys(notes)) or "none"
        raise InputError("words", found, "give other words, starting values, or an orbit")
    kept: list[Fit] = []
    for one in sorted(fits, key=_rank):
        if not any(_same(one, other) for other in kept):
            kept.append(one)
    best = kept[0]
    return replace(best, others=tuple(kept[1:]), notes=(*best.notes, *dict.fromkeys(notes)))


def _require_signs(model: Model, data: Impacts) -> None:
    """Raise InputError where all velocities on a rigid wall point away from it, as of speeds."""
    for guard in model.WALLS:
        on = [i for i, wall in enumerate(data.walls) if wall == guard.name]
        on = [i for i in on if not math.isnan(data.velocities[i])]
        if isinstance(guard, Wall) and on and np.all(guard.side * data.velocities[on] < 0.0):
            sign = "positive" if guard.side > 0 else "negative"
            found = f"{data.velocities[on[0]]:.6g} on {guard.name}, like all others there"
            accepted = f"give velocities before impact, which are {sign} on {guard.name}"
            raise InputError(f"{data.places[on[0]]}, velocity", found, accepted)


def _starts(
    model: Model, words: Any, names: Sequence[str], rng: Any
) -> tuple[list[Orbit], list[str]]:
    """The orbits to start from, and which words have none at the starting values."""
    orbits: list[Orbit] = []
    notes: list[str] = []
    for word in [words] if isinstance(words, str | Word | Orbit) else list(words):
        if isinstance(word, Orbit):
            if list(word.model.values) != list(model.values) or word.model.letters != model.letters:
                accepted = f"give one of {model.SYSTEM}, with the same parameters"
                raise InputError("words", f"an orbit of {word.model.SYSTEM}", accepted)
            found = [word]
        elif not (found := find_orbits(model, word, rng=rng)):
            found, text = _elsewhere(model, word, names, rng)
            notes.append(f"no {word} orbit was found at the starting values{text}")
        orbits += [one for one in found if len(one.word)]
        if any(not len(one.word) for one in found):
            notes.append("an orbit without impacts has nothing to compare")
    return orbits, notes


def _elsewhere(
    model: Model, word: str | Word, names: Sequence[str], rng: Any
) -> tuple[list[Orbit], str]:
    """The orbits of a word at other values of the parameters to fit, drawn around the model's."""
    generator = random_generator(rng)
    for _ in range(ELSEWHERE):
        values = {name: model.values[name] for name in names}
        for name, part in zip(names, AROUND * generator.standard_normal(len(names)), strict=True):
            values[name] += part * (abs(values[name]) or 1.0)
        try:
            found = find_orbits(model.replace(**values), word, rng=rng)
        except InputError:  # beyond what a parameter admits
            continue
        if found:
            at = ", ".join(f"{name} = {value:.4g}" for name, value in values.items())
            return found, f"; begun at {at}"
    return [], f" and {ELSEWHERE} others around them"


def _rank(one: Fit) -> tuple[bool, bool, float, bool]:
    """What was measured is physical; of orbits that fit equally well, to rounding, that comes first
    which can be observed."""
    lacking = len(set(one.impacts.tolist())) < len(one.orbit.word)
    return lacking, not one.orbit.physical, round(one.misfit, 6), one.state != "stable"


def _same(one: Fit, other: Fit) -> bool:
    """Whether two fits have ended at the same orbit."""
    if one.orbit.word != other.orbit.word:
        return False
    fastest = float(np.max(np.abs(one.orbit.velocities)))
    late = np.abs(one.orbit.times - other.orbit.times) < 1e-6 * one.orbit.period
    faster = np.abs(one.orbit.velocities - other.orbit.velocities) < 1e-6 * fastest
    return bool(np.all(late & faster))


def _beside(one: Fit, best: Fit) -> str:
    """By how much a fit is worse than the one that comes first, or better and yet not first."""
    further = round(one.misfit - best.misfit, 6)
    return f"misfit {'smaller' if further < 0.0 else 'larger'} by {abs(further):.3g}"


# The least squares.


class _Point(NamedTuple):
    """An orbit at some estimates, and what the data say of it."""

    values: Array
    orbit: Orbit
    impacts: Array
    laps: Array
    residuals: Array
    cost: float


class _Task:
    """One word, the data and the parameters to fit."""

    def __init__(
        self, model: Model, word: Word, data: Impacts, kernels: dict[str, Kernels], clock: bool
    ) -> None:
        self.model, self.word, self.data, self.kernels = model, word, data, kernels
        self.names = [*kernels, *([CLOCK] if clock else [])]
        letters = np.array(list(word.walls))
        walls = np.array(data.walls)[:, None]
        self.barred = (walls != "") & (walls != letters)
        self.measured = np.column_stack([data.times, data.velocities])
        self.present = ~np.isnan(self.measured)
        self.sigmas = np.ones(2)
        self.refused = ""

    def solve(self, values: Array, guess: Array) -> Orbit | None:
        """The orbit at the parameters, from a guess of its impacts; None says why in `refused`."""
        given = dict(zip(self.kernels, values.tolist(), strict=False))
        try:
            model = self.model.replace(**given)
        except InputError as error:
            self.refused = str(error)
            return None
        name = next(iter(self.kernels))
        problem = problem_of(model, self.word, self.kernels[name])
        here = solve_near(problem, np.append(guess, given[name]))
        if here is None:
            at = ", ".join(f"{key} = {value:.6g}" for key, value in given.items())
            self.refused = f"the orbit cannot be followed to {at}; it may end in a fold before"
            return None
        return Orbit(problem, here)

    def compare(self, values: Array, orbit: Orbit) -> _Point:
        """Which impact each row belongs to, and by how much it is off."""
        offset = values[-1] if self.names[-1] == CLOCK else 0.0
        off = self.measured[:, None, :] - np.column_stack([orbit.times + offset, orbit.velocities])
        laps = np.round(off[..., 0] / orbit.period)
        off[..., 0] -= orbit.period * laps
        far = np.nansum((off / self.sigmas) ** 2, axis=2) + np.where(self.barred, math.inf, 0.0)
        impacts, rows = np.argmin(far, axis=1), np.arange(len(off))
        self.far = far
        return _Point(
            values, orbit, impacts, laps[rows, impacts], off[rows, impacts],
            float(np.sum(far[rows, impacts])),
        )  # fmt: skip

    def slopes(self, point: _Point) -> tuple[Array, Array]:
        """Derivatives of the orbit's impacts, and of what was measured, by the estimates."""
        problem, z = point.orbit.problem, point.orbit.unknowns
        columns, drifts = [], []
        for name, kernels in self.kernels.items():
            own = problem_of(point.orbit.model, self.word, kernels)
            unknowns = np.append(z[:-1], point.orbit.model.values[name])
            columns.append(own.evaluate(unknowns).by_parameter[:, 0])
            setup = kernels.setup(*own.values(unknowns))
            drifts.append(self.word.period * float(setup.slopes[0]))
        matrix = point.orbit.linearisation.jacobian[:, : problem.n]
        moved = -np.linalg.solve(matrix, np.column_stack(columns))
        rows = moved.reshape(-1, problem.m, len(columns))[point.impacts, :2]
        rows[:, 0] += np.nan_to_num(point.laps)[:, None] * np.array(drifts)
        if self.names[-1] == CLOCK:
            rows = np.concatenate([rows, np.zeros((len(rows), 2, 1))], axis=2)
            rows[:, 0, -1] = 1.0
        return moved, (rows / self.sigmas[:, None])[self.present]

    def leverages(self, point: _Point) -> Array:
        """The part of each number that the estimates follow, by which its residual is smaller than
        its error; their sum over times, or velocities, is how many estimates these determine."""
        matrix = self.slopes(point)[1] * self.sizes(point)
        u, s, _ = np.linalg.svd(matrix, full_matrices=False)
        shares = np.zeros(self.present.shape)
        shares[self.present] = np.sum(u[:, s > SINGULAR * s[0]] ** 2, axis=1)
        return shares

    def sizes(self, point: _Point) -> Array:
        """Natural sizes of the estimates, those they start from if these are larger."""
        begin = self.model.values
        known = zip(self.kernels, point.values, strict=False)
        sizes = np.array([max(abs(v), abs(begin[name])) or 1.0 for name, v in known])
        if self.names[-1] == CLOCK:
            sizes = np.append(sizes, point.orbit.period)
        return sizes


def _best(task: _Task, orbit: Orbit, deviations: Mapping[str, float] | None) -> Fit:
    """The nearest fit that starts from an orbit, over offsets of the clock and its laps."""
    period = orbit.period / task.word.period
    scales = np.array([period, max(float(np.max(np.abs(orbit.velocities))), 1e-300)])
    if deviations is not None:
        scales = np.array([deviations.get(name, 1.0) for name in MEASURED])
    task.sigmas = scales
    start = np.array([orbit.model.values[name] for name in task.kernels])
    if task.names[-1] == CLOCK:
        tried = np.arange(CLOCKS * task.word.period) * (period / CLOCKS)
        points = [task.compare(np.append(start, c), orbit) for c in tried]
        costs = np.array([point.cost for point in points])
        least = np.flatnonzero((costs <= np.roll(costs, 1)) & (costs <= np.roll(costs, -1)))
        begin = [points[i] for i in least[np.argsort(costs[least], kind="stable")][:KEPT]]
    else:
        laps = range(task.word.period if task.present[:, 0].any() else 1)
        begin = [task.compare(start, _later(orbit, lap * period)) for lap in laps]
    found, counts = [], np.sum(task.present, axis=0)
    enough = bool(np.all((counts == 0) | (counts > 2 * len(task.names))))
    for point in begin:
        task.sigmas = scales
        reached, reason = _descend(task, task.compare(point.values, point.orbit))
        if deviations is None and enough:
            for _ in range(REWEIGHTED):
                squares = np.nansum(reached.residuals**2, axis=0)
                squares /= np.maximum(counts - task.leverages(reached).sum(axis=0), 1)
                before, task.sigmas = task.sigmas, np.maximum(np.sqrt(squares), ROUNDED * scales)
                reached, reason = _descend(task, task.compare(reached.values, reached.orbit))
                if np.max(np.abs(task.sigmas / before - 1.0)) < 1e-6:
                    break
        found.append(_fit(task, reached, reason, deviations is not None))
    return _with_other_clocks(sorted(found, key=_rank))


def _with_other_clocks(found: Sequence[Fit]) -> Fit:
    """The first of an orbit's fits; a note names clocks at which others are about as likely."""
    best = found[0]
    if CLOCK not in best.values or best.reason is not None:
        return best
    texts = [
        f"{one.values[CLOCK]:.9g} ({_beside(one, best)})"
        for one in found[1:]
        if one.misfit - best.misfit < LIKELY and not _coincide(one, best)
    ]
    if not texts:
        return best
    note = f"the clock may also be {', '.join(dict.fromkeys(texts))}"
    return replace(best, notes=(*best.notes, note))


def _coincide(one: Fit, other: Fit) -> bool:
    """Whether two fits say the same of the data: each impact at the same time and velocity."""
    span = other.orbit.period
    shifts = one.values[CLOCK] - other.values[CLOCK]
    late = one.orbit.times[:, None] - other.orbit.times + shifts
    late -= span * np.round(late / span)
    faster = one.orbit.velocities[:, None] - other.orbit.velocities
    walls = [np.array(list(each.orbit.word.walls)) for each in (one, other)]
    fastest = float(np.max(np.abs(other.orbit.velocities)))
    near = (
        (np.abs(late) < 1e-6 * span)
        & (np.abs(faster) < 1e-6 * fastest)
        & (walls[0][:, None] == walls[1])
    )
    return bool(near.any(axis=1).all())


def _later(orbit: Orbit, shift: float) -> Orbit:
    """The same orbit some periods of the forcing later."""
    if not shift:
        return orbit
    unknowns = orbit.unknowns.copy()
    unknowns[: -1 : orbit.problem.m] += shift
    return Orbit(orbit.problem, orbit.problem.evaluate(unknowns))


def _descend(task: _Task, point: _Point) -> tuple[_Point, str | None]:
    """Levenberg's and Marquardt's method along the orbits; a text if there is no minimum."""
    damping = 0.0
    for _ in range(ITERATIONS):
        try:
            moved, matrix = task.slopes(point)
        except np.linalg.LinAlgError:
            return point, "the orbit turns at the estimates: its derivatives are infinite"
        sizes = task.sizes(point)
        matrix = matrix * sizes
        right = (point.residuals / task.sigmas)[task.present]
        u, s, vt = np.linalg.svd(matrix, full_matrices=False)
        kept = s > SINGULAR * s[0]
        along = (u.T @ right)[kept]
        scale = float(s[0]) ** 2
        while True:
            part = along * s[kept] / (s[kept] ** 2 + damping * scale)
            step = vt[kept].T @ part
            gain = float(np.sum(along**2 - (along - s[kept] * part) ** 2))
            if damping == 0.0 and (
                gain <= 1e-18 * point.cost or np.max(np.abs(step), initial=0.0) < 1e-14
            ):
                return point, None
            new = _step(task, point, moved, step * sizes)
            if new is not None and new.cost < point.cost:
                point, damping = new, 0.0 if damping < 1e-9 else 0.1 * damping
                break
            if new is not None and gain <= 1e-9 * point.cost + 1e-24:
                return point, None  # the rest is rounding
            damping = max(10.0 * damping, 1e-8)
            if damping > MOST_DAMPED:
                return point, f"no minimum was reached: {task.refused or 'no step leads down'}"
    return point, f"no minimum was reached in {ITERATIONS} steps"


def _step(task: _Task, point: _Point, moved: Array, step: Array) -> _Point | None:
    count = len(task.kernels)
    guess = point.orbit.unknowns[:-1] + moved @ step[:count]
    if not np.all(np.isfinite(guess)):
        return None
    orbit = task.solve(point.values + step, guess)
    return None if orbit is None else task.compare(point.values + step, orbit)


def _fit(task: _Task, point: _Point, reason: str | None, given: bool) -> Fit:
    """The result at what was reached."""
    point = task.compare(point.values, point.orbit)
    count, notes, sizes = int(np.sum(task.present)), list[str](), task.sizes(point)
    freedom = max(count - len(task.names), 0)
    covariance = np.full((len(sizes), len(sizes)), math.nan)
    try:
        matrix = task.slopes(point)[1] * sizes
    except np.linalg.LinAlgError:
        matrix = np.zeros((count, len(sizes)))
    padded = np.pad(matrix, ((0, max(len(sizes) - count, 0)), (0, 0)))
    s, vt = np.linalg.svd(padded, full_matrices=False)[1:]
    free = vt[s <= SINGULAR * max(float(s[0]), 1e-300)]
    if len(free):
        texts = [
            _combination(task.names, row * sizes / row[np.argmax(np.abs(row))]) for row in free
        ]
        told = f"the data do not determine {', nor '.join(texts)}: fix one of them"
        reason = f"{reason}; {told}" if reason else told
    elif reason is None:
        covariance = (vt.T / s**2) @ vt * np.outer(sizes, sizes)
        if not given:
            covariance *= point.cost / freedom if freedom else math.nan
        if reason is None:
            notes += _curvature(task, point, vt.T / s * sizes[:, None], given, freedom)
            notes += _outliers(task, point, given)
    if not given and not freedom:
        notes.append("as many estimates as data: no deviations")
    named = list(task.word.walls)
    unseen = [f"{k + 1} on {named[k]}" for k in range(len(named)) if k not in point.impacts]
    if unseen:
        notes.append(f"no row belongs to impact {', '.join(unseen)}")
    laps = point.laps[task.present[:, 0]]
    timed = list(zip(point.impacts[task.present[:, 0]].tolist(), laps.tolist(), strict=True))
    if again := len(timed) - len(set(timed)):
        notes.append(
            f"{count_text(again, 'row has', 'rows have')} the impact and the period of another row"
        )
    spread = math.sqrt(point.cost / freedom) if freedom and not given else 1.0
    if task.far.shape[1] > 1:
        near = np.sort(np.sqrt(task.far), axis=1) / max(spread, ROUNDED)
        if close := int(np.sum(near[:, 1] - near[:, 0] < AMBIGUOUS)):
            notes.append(f"{close} of {count_text(len(near), 'row')} may belong to another impact")
    values = dict(zip(task.names, point.values.tolist(), strict=True))
    if CLOCK in values:
        values[CLOCK] %= point.orbit.period
    known = [i for i in range(2) if task.present[:, i].any()]
    deviations = {MEASURED[i]: float(task.sigmas[i] * spread) for i in known}
    each = np.sum(task.present, axis=0)
    misfit = 2.0 * float(each[known] @ np.log(task.sigmas[known]))
    misfit += point.cost if given else count * math.log(max(point.cost / count, ROUNDED**2))
    return Fit(
        point.orbit, values, covariance, point.cost, freedom, deviations, given, point.residuals,
        point.impacts, task.data, misfit, reason, tuple(notes),
    )  # fmt: skip


def _curvature(task: _Task, point: _Point, axes: Array, given: bool, freedom: int) -> list[str]:
    """A note where the errors of first order are not those at one deviation along each axis."""
    unit = 1.0 if given else point.cost / max(freedom, 1)
    moved = task.slopes(point)[0]
    for axis in axes.T * math.sqrt(unit):
        if np.max(np.abs(axis) / task.sizes(point)) < SINGULAR:
            continue  # its chi2 is rounding
        for step in (axis, -axis):
            new = _step(task, point, moved, step)
            if new is None:
                return [f"within the errors the orbit ends, so they are rough: {task.refused}"]
            if not 0.5 < (new.cost - point.cost) / unit < 2.0:
                return ["within the errors the orbit bends, or rows change impacts: they are rough"]
    return []


def _outliers(task: _Task, point: _Point, given: bool) -> list[str]:
    """Notes that name the time and the velocity farthest off, where chance seldom puts one so far.

    A studentised residual, in deviations that all others of its kind have, follows Student's
    distribution (Cook and Weisberg, Residuals and Influence in Regression, 1982, section 2.2.2),
    and the normal one where deviations are given.
    """
    from scipy.stats import norm, t

    shares, notes, count = task.leverages(point), list[str](), int(np.sum(task.present))
    scales = point.orbit.period, float(np.max(np.abs(point.orbit.velocities)))
    for i, kind in enumerate(MEASURED):
        rows = np.flatnonzero(task.present[:, i])
        room = 1.0 - shares[rows, i]
        others, total = float(np.sum(room)) - 1.0, float(np.sum(point.residuals[rows, i] ** 2))
        few = len(rows) <= (0 if given else 2 * len(task.names))
        if few or total <= (ROUNDED * scales[i]) ** 2:
            continue
        squares = point.residuals[rows, i] ** 2 / np.maximum(room, SINGULAR)
        far = int(np.argmax(squares))
        if given:
            chance = 2.0 * norm.sf(math.sqrt(squares[far]) / task.sigmas[i])
        else:
            rest = max(total - float(squares[far]), (ROUNDED * scales[i]) ** 2)
            chance = 2.0 * t.sf(math.sqrt(squares[far] * others / rest), others)
        if chance * count < SELDOM:
            off = point.residuals[rows[far], i]
            found = f"{task.data.places[rows[far]]}: its {kind} is off by {off:.3g}, more than"
            notes.append(f"{found} the errors of all others explain; check it, or leave it out")
    return notes


def _combination(names: Sequence[str], row: Array) -> str:
    """A direction of the estimates that changes no measured number, in words."""
    least = 1e-6 * min(1.0, float(np.max(np.abs(row))))
    large = [(n, v) for n, v in zip(names, row.tolist(), strict=True) if abs(v) > least]
    if len(large) == 1:
        return large[0][0]
    return f"{' and '.join(n for n, _ in large)} apart (they move together as " + (
        ", ".join(f"{v:+.4g} in {n}" for n, v in large) + ")"
    )
