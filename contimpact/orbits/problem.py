r"""The orbit problem of one word: its equations, their linearisation, and the motion.

Unknowns z = (t_1, y_1, ..., t_N, y_N, lambda): each impact's time and section coordinates before
impact, and the free parameter last (two of them on curves). Flight k leaves impact k and arrives at
impact k + 1; the last one arrives at impact 1, pT later. Its residual and derivatives come from the
segment between its two walls:

.. math:: R_k(t_k, y_k, t_{k+1}, y_{k+1}, \lambda) = 0, \qquad
          A_k = \partial R_k / \partial(t_k, y_k), \quad
          B_k = \partial R_k / \partial(t_{k+1}, y_{k+1}), \quad
          L_k = \partial R_k / \partial\lambda .

The Jacobian is cyclic (N = 3)::

    [ A1 B1    | L1 ]
    [    A2 B2 | L2 ]
    [ B3    A3 | L3 ]

Because the times of impacts are unknowns, nothing is divided by an impact velocity and the problem
is regular where one vanishes.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Number
from ..errors import InputError
from ..models.guards import Guard, Word, pivot, state_before, state_size
from ..models.model import Model
from ..segments.bounded import UNIT, BoundedNumber, bounds_of, bounds_of_kernel
from ..segments.flight import FlightGaps, flight_gaps
from ..segments.integration import KEPT
from ..segments.kernel import SECTION, CombinedBlocks, Setup
from ..segments.kernels import Kernels
from ..segments.segment import ARRAYS, ELSEWHERE, MEETING, STATES, evaluate_in
from ..segments.touches import flights_are_apart, interior_touches
from ..segments.track import integrated_track, track_of
from .status import (
    AT_REST,
    Stability,
    Verdict,
    count_unstable,
    determinant,
    findings,
    stability_of,
    verdict_of,
    with_arrival_rates,
)

# The motion along an orbit, for pictures and time series.


class Path(NamedTuple):
    """The motion along an orbit's period: times, gap coordinate and its velocity, flight by
    flight.

    Velocities jump at impacts.
    """

    t: Array
    x: Array
    v: Array


def path_of(here: Linearisation, points: int = 200) -> Path:
    """Return the motion from an orbit's first impact until that impact returns."""
    problem = here.problem
    values = problem.values(here.unknowns)
    rows = problem.impacts(here.unknowns).tolist()
    ends = [row[0] for row in rows[1:]] + [rows[0][0] + here.span]
    walls, begin = positions(here), rows[0][0] if rows and problem.autonomous else 0.0
    parts: list[tuple[Any, ...]] = []
    for wall, row, end in zip(problem.word.walls, rows, ends, strict=True):
        dt = np.linspace(0.0, end - row[0], points)
        if (states := _integrated(here, len(parts), dt)) is not None:
            guard = next(g for g in problem.model.WALLS if g.name == wall)
            factors = np.array(guard.row(problem.model.DEGREES_OF_FREEDOM), dtype=float)
            x, v = (part @ factors for part in states)
        else:
            motion = evaluate_in(problem.kernels.motion(wall), ARRAYS)
            x, v = motion(*(value + 0.0 * dt for value in row), dt, *values)[:2]
            x = walls[wall] + x
        parts.append((row[0] - begin + dt, x, v))
    return Path(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def positions(here: Linearisation) -> dict[str, float]:
    """Return the positions of the walls at an orbit's parameter values, by name."""
    problem = here.problem
    setup = problem.setup(here.unknowns)
    places = zip(problem.model.letters, setup.walls, strict=True)
    return {name: float(x) for name, x in places}


def motion_of(here: Linearisation, points: int | Array = 200) -> Path:
    """Return the motion of all coordinates along an orbit's period; `x` and `v` have a column for
    each. Without impacts it begins at t = 0. Points are a number of them on each flight, or where
    on it they are, from 0 to 1."""
    problem = here.problem
    rows = problem.impacts(here.unknowns).tolist()
    if not rows:
        dt = _places(here.span, points)
        state, wall = here.unknowns[: problem.m].tolist(), problem.model.WALLS[0].name
        if (states := _integrated(here, 0, dt)) is not None:
            return Path(dt, *states)
        return Path(dt, *_motion_by_segment(here, SECTION, wall, state, 0.0, dt))
    walls = problem.word.walls
    parts = []
    for k, (wall, row) in enumerate(zip(walls, rows, strict=True)):
        dt = _places(np.subtract(*problem.times_around(here.unknowns, k)[::-1]), points)
        if (states := _integrated(here, k, dt)) is not None:
            x, v = states
        elif problem.kernels.linear(wall):
            x, v = _motion_on_track(here, wall, row, dt)
        else:
            x, v = _motion_by_segment(here, wall, walls[(k + 1) % len(walls)], row, row[0], dt)
        parts.append((row[0] + dt, x, v))
    return Path(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _places(duration: float, points: int | Array) -> Array:
    """Times on a flight, at equal distances or at given parts of it."""
    return (
        duration * points if isinstance(points, np.ndarray) else np.linspace(0.0, duration, points)
    )


def _integrated(here: Linearisation, flight: int, dt: Array) -> tuple[Array, Array] | None:
    """Positions and velocities of all coordinates along a flight that is integrated, if its mode
    has them all."""
    problem, z = here.problem, here.unknowns
    left, leave = problem.leaving(z, flight)
    if not problem.kernels.integrated(left) or not dt[-1] > 0.0:
        return None
    rows = [*problem.impacts(z).tolist(), z[: problem.m].tolist()]
    arrive = rows[flight + 1] if len(rows) > 1 else rows[0]
    if flight + 2 == len(rows):
        arrive[0] += here.span
    values, segment = problem.values(z), cast(Any, problem.segments[flight])
    track = segment.long_track(leave, arrive, values)
    if track is None:
        track = integrated_track(problem.kernels, left, leave, values, float(dt[-1]))
    states = track.at(dt)
    return states if states[0].shape[1] == problem.model.DEGREES_OF_FREEDOM else None


def _motion_on_track(
    here: Linearisation, wall: str, row: list[float], dt: Array
) -> tuple[Array, Array]:
    """Positions and velocities of all coordinates along a linear flight."""
    problem, size = here.problem, here.problem.model.DEGREES_OF_FREEDOM
    law = problem.kernels.law(wall)(*row, *problem.values(here.unknowns))
    if not dt[-1] > 0.0:
        states = np.tile(np.array(law[3], dtype=float), (len(dt), 1))
    else:
        track = track_of(law, float(dt[-1]))
        states = np.array([track.at(t) for t in dt.tolist()])
    return states[:, :size], states[:, size : 2 * size]


def _motion_by_segment(
    here: Linearisation, left: str, wall: str, row: list[float], begin: float, dt: Array
) -> tuple[Array, Array]:
    """The same by the kernels of a flight to a wall: its gap coordinate, and what arrives there."""
    problem = here.problem
    values, kernels = problem.values(here.unknowns), problem.kernels
    guard = problem.model.guard(wall)
    gap, segment = kernels.gap_after(left, wall), kernels.segment(left, wall)
    none = [0.0] * (problem.m - 1)
    if kernels.integrated(left):  # in pieces, where a flight is long
        found = [
            (*gap(*row, t, *values)[:2], *segment.blocks(row, [begin + t, *none], values)[0][2:])
            for t in dt.tolist()
        ]
        columns: list[Any] = list(np.array(found, dtype=float).T)
    else:
        ends = segment.over(STATES)(row, [begin + dt, *none], values)[0][2:]
        columns = [*evaluate_in(gap, STATES)(*row, dt, *values)[:2], *ends]
    factors = guard.row(problem.model.DEGREES_OF_FREEDOM)
    states = state_before(factors, columns[0], columns[1:])
    x, v = (np.column_stack([part + 0.0 * dt for part in state]) for state in states)
    return x, v


# An orbit problem at one point: residual, blocks, and what follows from them.


class CyclicBlocks(NamedTuple):
    """Residual (n,) and blocks of all segments of an orbit: A_k and B_k, shape (N, m, m), and (n,
    free).

    They are `together` where rows of a flight from an impact are combinations of its equations; see
    `kernel.CombinedBlocks`.
    """

    residual: Array
    start: Array
    end: Array
    by_parameter: Array
    together: bool = False


class Summary(NamedTuple):
    """What a branch keeps of a point, as a row of 2 m + 7 numbers; or of many, as rows.

    The m multipliers are complex, the largest first; the 6 findings are what `physicality.verdict`
    returns, the first NaN where that was not asked for.
    """

    largest_residual: Number
    multipliers: Array
    findings: Array

    @classmethod
    def of(cls, rows: Array) -> Summary:
        """Return the summary in a row, or those in rows."""
        multipliers = np.ascontiguousarray(rows[..., 1:-6]).view(complex)
        return cls(rows[..., 0], multipliers, rows[..., -6:])

    @property
    def row(self) -> Array:
        """The summary of one point as a row."""
        parts = self.multipliers.astype(complex).view(float)
        return np.concatenate([[self.largest_residual], parts, self.findings])


class Linearisation:
    """An orbit problem at one point; what follows from it is computed when asked for.

    The blocks are evaluated then, if they are not given; a summary is what is known already.
    """

    def __init__(
        self,
        problem: OrbitProblem,
        unknowns: Array,
        blocks: CyclicBlocks | None = None,
        summary: Summary | None = None,
    ) -> None:
        self.problem, self.unknowns, self._known = problem, unknowns, summary
        if blocks is not None:
            self.blocks = blocks

    @functools.cached_property
    def blocks(self) -> CyclicBlocks:
        """Residual and blocks."""
        return self.problem.evaluate(self.unknowns).blocks

    @property
    def residual(self) -> Array:
        """The residual, shape (n,)."""
        return self.blocks.residual

    @property
    def start(self) -> Array:
        """The blocks A_k, shape (N, m, m)."""
        return self.blocks.start

    @property
    def end(self) -> Array:
        """The blocks B_k, shape (N, m, m)."""
        return self.blocks.end

    @property
    def by_parameter(self) -> Array:
        """Derivatives of the residual with respect to the free parameters, shape (n, free)."""
        return self.blocks.by_parameter

    @functools.cached_property
    def jacobian(self) -> Array:
        """The (n, n + free) Jacobian."""
        matrix = self.cyclic(1.0)
        matrix[:, self.problem.n :] = self.by_parameter
        return matrix

    def cyclic(self, mu: float) -> Array:
        """The (n, n + free) cyclic matrix, its last coupling multiplied by mu; the columns of the
        parameters are zero."""
        end = self.end.ravel()
        if mu != 1.0:
            end = end.copy()
            end[-(self.problem.m**2) :] *= mu
        return self.problem.cyclic(self.start.ravel(), end)

    @functools.cached_property
    def sizes(self) -> tuple[Array, Array]:
        """Natural sizes of residuals and unknowns; those of parameters move residuals by theirs."""
        problem = self.problem
        unknowns = problem.scale(self.unknowns, np.ones(problem.free))
        residuals = problem.residual_sizes(unknowns)
        moved = np.max(np.abs(self.by_parameter) / residuals[:, None], axis=0)
        unknowns[problem.n :] = 1.0 / np.where(moved > 0.0, moved, 1.0)
        return residuals, unknowns

    def singular_vectors(self, matrix: Array) -> tuple[Array, Array]:
        """Return the left and the right singular vectors, in rows, of the Jacobian or a cyclic
        matrix in natural units; those of the smallest singular value are last."""
        rows, columns = self.sizes
        columns = columns[: matrix.shape[1]]
        left, _, right = np.linalg.svd(matrix * columns / rows[:, None])
        return left.T / rows, right * columns

    @functools.cached_property
    def stability(self) -> Stability:
        """Multipliers, their products, and the determinant of a period doubling.

        The derivative of an arrival by its time is the arrival's velocity (over the duration,
        back on the surface left). The orbit's own is put in its place: the multipliers next to
        a grazing go with its inverse, and the kernel's carries the rounding of larger terms.
        """
        problem, start = self.problem, self.held
        if self.blocks.together:
            return self.told(self._in_pieces(start))
        if not problem.arrivals:  # without impacts
            return self.told(stability_of(start, self.end))
        given = problem.arrivals, self.unknowns.tolist(), self.span
        return self.told(stability_of(start, with_arrival_rates(self.end, *given)))

    def _in_pieces(self, start: Array) -> Stability:
        """The same where flights are computed in pieces.

        Without forcing, the derivatives by both times are opposite: those of the end where the row
        is smaller are the exact ones. Of one degree of freedom the other multiplier of all
        directions is then 1, so that their product is the one asked for, whatever its size.
        """
        found = stability_of(start, self.end)
        if not (self.problem.autonomous and self.problem.kernels.planar):
            return found
        start, end = self.start.copy(), self.end.copy()
        by_start = np.abs(start[:, :, 1]) < np.abs(end[:, :, 1])
        later = np.where(by_start, -start[:, :, 0], end[:, :, 0])
        start[:, :, 0], end[:, :, 0] = -later, later
        values = np.array([determinant(start, end), 0.0], dtype=complex)
        return replace(found, multipliers=values)

    @property
    def held(self) -> Array:
        """The blocks A_k of the multipliers; see `OrbitProblem.held`."""
        return self.problem.held(self.start)

    @property
    def by_blocks(self) -> Stability:
        """Stability by the blocks as they are, where an impact is at rest or a flight vanishes."""
        return self.told(stability_of(self.held, self.end))

    def told(self, found: Stability) -> Stability:
        """Return what blocks tell of stability, less what is known without them."""
        return found.without(self.problem.lost, int(self.problem.autonomous))

    @property
    def multipliers(self) -> Array:
        """Multipliers, largest first; infinite where an impact velocity vanishes."""
        return self._known.multipliers if self._known else self.stability.multipliers

    @property
    def span(self) -> float:
        """The orbit's period."""
        return self.problem.span(self.unknowns)

    @property
    def largest_residual(self) -> float:
        """The largest absolute residual."""
        known = self._known
        return float(known.largest_residual if known else np.max(np.abs(self.residual)))

    @functools.cached_property
    def n_unstable(self) -> int:
        """Number of multipliers outside the unit circle."""
        return int(count_unstable(self.multipliers))

    @functools.cached_property
    def gaps(self) -> list[FlightGaps]:
        """The interior touches of every flight.

        Where an impact is at rest, its acceleration tells on which side of its guard the flight
        begins; the sign of a velocity that is rounding does not.
        """
        return self.problem.gaps(self._resting_unknowns())

    def gaps_of(self, flight: int) -> FlightGaps:
        """Return the interior touches of one flight; the others are not looked for."""
        if "gaps" in self.__dict__:
            return self.gaps[flight]
        return self.problem.gaps_of(self._resting_unknowns(), flight)

    def _resting_unknowns(self) -> Array:
        """The unknowns, where the velocities of impacts at rest are zero."""
        unknowns = self.unknowns.copy()
        velocities = unknowns[1 : self.problem.n : self.problem.m]
        velocities[np.abs(velocities) < AT_REST * np.max(np.abs(velocities))] = 0.0
        return unknowns

    @functools.cached_property
    def verdict(self) -> Verdict:
        """Whether the orbit is physical, and if not why and where."""
        return self._verdict_of(self.findings)

    def judge(
        self,
        forgive_touches: Collection[tuple[int, str]] = (),
        forgive_impacts: Collection[int] = (),
    ) -> Verdict:
        """As `verdict`, with touches or impacts forgiven; see `physicality.findings`."""
        return self._verdict_of(findings(*self._flights(), forgive_touches, forgive_impacts))

    def _verdict_of(self, found: Sequence[float]) -> Verdict:
        """What was found, as an object; free periods begin with the first passage."""
        problem = self.problem
        word = problem.word.walls
        first = float(self.unknowns[0]) if problem.autonomous and word else 0.0
        return verdict_of(found, word, problem.model.WALLS, first)

    @property
    def resting(self) -> list[int]:
        """The impacts whose velocity is rounding beside the speeds along the flights."""
        problem = self.problem
        speeds = problem.scale(self.unknowns, 1.0)[1 : problem.n : problem.m]
        velocities = problem.impacts(self.unknowns)[: len(problem.word), 1]
        return np.nonzero(np.abs(velocities) < AT_REST * speeds)[0].tolist()

    @property
    def unbounded(self) -> bool:
        """Whether a multiplier is infinite, or a quotient of rounding: an impact is at rest."""
        return bool(self.resting) or not bool(np.isfinite(self.multipliers).all())

    @functools.cached_property
    def findings(self) -> Sequence[float]:
        """What `physicality.verdict` says of the orbit."""
        if self._known and not np.isnan(self._known.findings[0]):
            return self._known.findings.tolist()
        return findings(*self._flights())

    def _flights(self) -> tuple[str, Sequence[Guard], Array, Sequence[FlightGaps]]:
        problem = self.problem
        impacts = problem.impacts(self.unknowns)
        return problem.word.walls, problem.model.WALLS, impacts, self.gaps

    @functools.cached_property
    def numbers(self) -> Array:
        """The row of the point's `Summary`."""
        return Summary(self.largest_residual, self.multipliers, np.array(self.findings)).row

    @functools.cached_property
    def derived(self) -> Mapping[str, float]:
        """Derived parameters at this point."""
        problem = self.problem
        found = problem.derived_at(problem.values(self.unknowns))
        return dict(zip(problem.model.DERIVED, found, strict=True))


# Bounds of the rounding errors of an orbit problem's residual and blocks.


def rounding(here: Linearisation) -> Linearisation:
    """Return bounds of the rounding errors of residual and blocks, in their places."""
    problem = here.problem
    m, n = problem.m, problem.n
    first, p = BoundedNumber(float(here.unknowns[0])), problem.values(here.unknowns)
    setup, off = bounds_of_kernel(problem.kernels.setup, p)
    closing = problem.closing(first, BoundedNumber(setup.period, off.period))
    parts: list[list[float]] = [[], [], [], []]
    for segment, ends in zip(problem.segments, problem.ends(here.unknowns, closing), strict=True):
        _, errors = bounds_of(segment, *ends, p)
        for part, block in zip(parts, errors, strict=True):
            part += block
    residual, start, end, by_parameter = map(np.array, parts)
    start = problem.leaves(start)
    blocks = start.reshape(-1, m, m), end.reshape(-1, m, m), by_parameter.reshape(n, -1)
    bounds = Linearisation(problem, here.unknowns, CyclicBlocks(residual, *blocks))
    if problem.word.walls:
        _add_drift(bounds, here, np.array(setup.slopes), np.array(off.slopes))
    return bounds


def _add_drift(bounds: Linearisation, here: Linearisation, slopes: Array, off: Array) -> None:
    """The last arrival moves with the forcing period, and so with the parameters."""
    problem = here.problem
    last = slice(problem.n - problem.m, problem.n)
    moved = np.outer(bounds.end[-1, :, 0], np.abs(slopes)) + np.outer(
        np.abs(here.end[-1, :, 0]), off + 2.0 * UNIT * np.abs(slopes)
    )
    bounds.by_parameter[last] += problem.word.period * moved


def rounding_of_setup(problem: OrbitProblem, unknowns: Array) -> Setup:
    """Return bounds of the rounding errors of what the kernel ``setup`` says at a point."""
    return bounds_of_kernel(problem.kernels.setup, problem.values(unknowns))[1]


Ends: TypeAlias = tuple[list[Any], list[Any]]
"""The unknowns of the impacts that a flight leaves and reaches, or how these move."""

INSTANTS = sorted(k * (math.sqrt(5.0) - 1.0) / 2.0 % 1.0 for k in range(1, 8))
"""Parts of a flight at whose ends the largest speed on it is sought: of a motion with a period of
its own, which the flight lasts several times, they are different phases."""

VANISHING = 1e-9
"""A section coordinate that is below this part of its largest along the flights at all impacts
vanishes there: it is rounding."""

RESTING = 1e-12
"""A velocity that is below this part of its position in a wave of the forcing is rounding."""


class OrbitProblem:
    """The equations of one word in one free parameter, or two.

    See `quiet` for those of `0` and for those of a system without forcing.

    Parameters
    ----------
    model : Model
        Gives the values of all parameters but the free one.
    word : Word
    kernels : Kernels
        Kernels of that model; they name the free parameters.

    Attributes
    ----------
    m, n : int
        Unknowns per impact and of all impacts.
    free : int
        Number of free parameters.
    arrivals : tuple of int
        Where each flight ends; see `contimpact.segments.segment`.
    lost : int
        Multipliers that vanish: directions of the state that some mode on the way does not have.
    excursions : tuple of int
        Flights through another mode and back, which can vanish with the velocities at their ends.
    kernel_evaluations : int
        Flights evaluated so far.
    solvers : dict
        What solves systems of events on its orbits, by their equations.
    autonomous : bool
        Whether the period is an unknown.
    paired : bool
        Whether a time and a velocity for each impact are all that is unknown, and the position is
        the gap coordinate of all guards: `block_cyclic` solves such equations, and `cyclic_chain`
        any.
    """

    autonomous = False

    def __init__(self, model: Model, word: Word, kernels: Kernels) -> None:
        self._begin(model, word, kernels)
        self.n = self.m * len(word)
        following = word.walls[1:] + word.walls[0]
        self.kinds = tuple(zip(word.walls, following, strict=True))
        self.segments = [kernels.segment(a, b) for a, b in self.kinds]
        self.arrivals = tuple(kernels.arrival(a, b) for a, b in self.kinds)
        self._elsewhere = np.array([arrival == ELSEWHERE for arrival in self.arrivals])
        self.excursions = self._excursions()
        size, modes = model.DEGREES_OF_FREEDOM, model.MODES
        met = {guard.next_mode for guard in model.WALLS if guard.name in word.walls}
        # by how much the smallest state on the way is smaller than that of the system
        self.lost = max(2 * size - state_size(modes, mode, size) for mode in met)
        self._place_blocks()

    @functools.cached_property
    def surfaces(self) -> dict[tuple[float, ...], list[int]]:
        """The impacts on surfaces of each gap coordinate, by its row, whose largest is one."""
        found: dict[tuple[float, ...], list[int]] = {}
        for k, row in enumerate(self.rows):
            found.setdefault(tuple((row / row[pivot(row)]).tolist()), []).append(k)
        return found

    @functools.cached_property
    def rows(self) -> Array:
        """The coefficients of each impact's gap coordinate, of all positions."""
        size = self.model.DEGREES_OF_FREEDOM
        return np.array([self.model.guard(letter).row(size) for letter in self.word.walls], float)

    @functools.cached_property
    def looks_along(self) -> bool:
        """Whether sizes are looked for along the flights in all coordinates."""
        return not self.kernels.planar or all(map(self.kernels.integrated, self.word.walls))

    def _begin(self, model: Model, word: Word, kernels: Kernels) -> None:
        """What orbits of all words have."""
        self.model, self.word, self.kernels = model, word, kernels
        self.parameter = kernels.parameter
        self.m = model.unknowns_per_impact
        positions = kernels.planar and all(guard.row(1) == (1,) for guard in model.WALLS)
        self.paired = positions and not self.autonomous
        names = list(model.values)
        self._values = list(model.values.values())
        self.free = len(kernels.parameters)
        self._free = [names.index(name) for name in kernels.parameters]
        self.kernel_evaluations = 0
        self._last_setup: tuple[tuple[float, ...] | None, Any] = None, None
        self.solvers: dict[str, Any] = {}
        self._kept_sizes = functools.lru_cache(KEPT)(lambda z: self._sizes(np.frombuffer(z)))
        if self.autonomous != model.autonomous:
            found = f"{word!r}, of a model {'without' if model.autonomous else 'with'} forcing"
            accepted = f"give the period {0 if model.autonomous else 1}, or the word as a text"
            raise InputError("word", found, accepted)

    def _place_blocks(self) -> None:
        """Positions of the blocks A and B in the flattened n x (n + free) Jacobian."""
        rows = np.arange(self.n).reshape(-1, self.m, 1) * (self.n + self.free)
        columns = np.arange(self.n).reshape(-1, 1, self.m)
        self._at_start = (rows + columns).ravel()
        self._at_end = (rows + np.roll(columns, -1, axis=0)).ravel()

    def __reduce__(self) -> tuple[object, ...]:
        """Made anew from what it was made of; kernels are loaded when they are asked for."""
        return type(self), (self.model, self.word, self.kernels)

    def _excursions(self) -> tuple[int, ...]:
        """The flights that end on the surface they leave, and lead back to the mode before it."""
        after = {guard.name: guard.next_mode for guard in self.model.WALLS}
        modes = [after[letter] for letter in self.word.walls]
        count = len(modes)
        return tuple(
            k
            for k, arrival in enumerate(self.arrivals)
            if arrival == MEETING
            and count > 1
            and modes[(k + 1) % count] == modes[k - 1] != modes[k]
        )

    def values(self, unknowns: Array) -> list[float]:
        """Return all parameter values at a point, in the model's order."""
        values = self._values.copy()
        for place, value in zip(self._free, unknowns[-self.free :].tolist(), strict=True):
            values[place] = value
        return values

    def period(self, unknowns: Array) -> float:
        """Return the forcing period at a point."""
        return self.setup(unknowns).period

    def setup(self, unknowns: Array) -> Setup:
        """Return what depends on the parameters alone; much is asked at the same ones in a row."""
        free = tuple(unknowns[-self.free :].tolist())
        known, found = self._last_setup
        if known != free:
            found = self.kernels.setup(*self.values(unknowns))
            self._last_setup = free, found
        return found

    def span(self, unknowns: Array) -> float:
        """Return the orbit's period at a point, a multiple of the forcing's."""
        return self.word.period * self.period(unknowns)

    def derived_at(self, values: Sequence[float]) -> tuple[float, ...]:
        """Return the derived parameters at parameter values."""
        return tuple(self.kernels.setup(*values).derived)

    def model_at(self, unknowns: Array) -> Model:
        """Return the model at a point's parameter values."""
        free = unknowns[-self.free :].tolist()
        return self.model.replace(**dict(zip(self.kernels.parameters, free, strict=True)))

    def impacts(self, unknowns: Array) -> Array:
        """Return the (N, m) times and section coordinates of a point."""
        return unknowns[: -self.free].reshape(-1, self.m)

    def leaving(self, unknowns: Array, flight: int) -> tuple[str, list[float]]:
        """Return the letter of the guard a flight leaves, and the unknowns there."""
        return self.word.walls[flight], self.impacts(unknowns)[flight].tolist()

    def leaves(self, moved: ArrayLike) -> Array:
        """Return a direction of an impact's unknowns, or rows of them in turn, as one of where a
        flight leaves."""
        return np.asarray(moved)

    def times_around(self, unknowns: Array, flight: int) -> tuple[float, float]:
        """Return the times at which a flight starts and ends."""
        times = self.impacts(unknowns)[:, 0]
        if flight + 1 < len(times):
            return times[flight], times[flight + 1]
        return times[flight], times[0] + self.span(unknowns)

    def gaps(self, unknowns: Array) -> list[FlightGaps]:
        """Return the interior touches of every flight."""
        values, impacts = self.values(unknowns), self.impacts(unknowns)
        return interior_touches(self.kernels, self.word.walls, values, impacts, self.span(unknowns))

    def gaps_of(self, unknowns: Array, flight: int) -> FlightGaps:
        """Return the interior touches of one flight."""
        walls = self.word.walls
        if not walls or not flights_are_apart(self.kernels, walls):
            return self.gaps(unknowns)[flight]
        values, impacts = self.values(unknowns), self.impacts(unknowns)
        return flight_gaps(self.kernels, walls, values, impacts, self.span(unknowns), flight)[0]

    def evaluate(self, unknowns: Array) -> Linearisation:
        """Evaluate residual and blocks at a point.

        Raises ArithmeticError or ValueError where a formula has no value (a parameter outside its
        domain, an overflow).
        """
        m, n = self.m, self.n
        p = self.values(unknowns)
        residual, start, end, by_parameter = (list[float]() for _ in range(4))
        together = False
        for segment, ends in zip(self.segments, self.ends(unknowns), strict=True):
            rows, leaving, arriving, free = found = segment.blocks(*ends, p)
            together = together or isinstance(found, CombinedBlocks)
            residual += rows
            start += leaving
            end += arriving
            by_parameter += free
        self.kernel_evaluations += len(self.segments)
        for i, drift in enumerate(self.drifts(unknowns)):
            for row in range(n - m, n):  # the arrival at t_1 + pT moves with T(lambda)
                by_parameter[self.free * row + i] += drift * end[m * row]
        blocks = CyclicBlocks(
            np.array(residual),
            self.leaves(start).reshape(-1, m, m),
            np.array(end).reshape(-1, m, m),
            np.array(by_parameter).reshape(n, -1),
            together and bool(self.arrivals),
        )
        return Linearisation(self, unknowns, blocks)

    def rounding(self, here: Linearisation) -> Array:
        """Return bounds of the rounding errors of the residuals at a point, shape (n,)."""

        return rounding(here).residual

    def described(self, unknowns: Array, row: Array) -> Linearisation:
        """Return a point of which the `Summary` in a row is known; the rest follows when asked
        for."""
        return Linearisation(self, unknowns, summary=Summary.of(row))

    def second_along(
        self, unknowns: Array, direction: Array, mu: float = 1.0, beside: float = 1.0
    ) -> Array:
        """Return the gradient by z of the cyclic matrix times a direction, an (n, n + free)
        matrix.

        The direction is q = (q_1, ..., q_N, q_lambda). In the last flight the arrival moves by mu
        q_1; with mu = 1 the result is the derivative of the Jacobian along q. `beside` is the same
        factor for the direction the result is multiplied with.
        """
        m, n = self.m, self.n
        p, drifts, ends = self.values(unknowns), self.drifts(unknowns), self.ends(unknowns)
        start: list[float] = []
        end: list[float] = []
        by_parameter: list[float] = []
        moves = self.ends_along(direction, mu, drifts)
        for segment, one, moved in zip(self.segments, ends, moves, strict=True):
            along = [*moved[0], *moved[1], *direction[n:].tolist()]
            blocks: Sequence[Sequence[float]] = [
                [0.0] * size for size in (m**2, m**2, m * self.free)
            ]
            if any(along):
                blocks = segment.second(*one, along, p)[1:]
                self.kernel_evaluations += 1
            start += blocks[0]
            end += blocks[1]
            by_parameter += blocks[2]
        last = np.array(end[-m * m :: m])  # the arrival moves with T(lambda), its rate with T'
        end[-m * m :] = [beside * rate for rate in end[-m * m :]]
        gradient = self.cyclic(self.leaves(start), np.array(end))
        gradient[:, n:] = np.reshape(by_parameter, (n, -1))
        if not drifts:
            return gradient
        gradient[n - m :, n:] += np.outer(last, drifts)
        curvatures = np.reshape(self.setup(unknowns).curvatures, (self.free, self.free))
        if curvatures.any():
            arriving = self.segments[-1].blocks(*ends[-1], p)[2]
            bend = self.word.period * curvatures @ direction[n:]
            gradient[n - m :, n:] += np.outer(arriving[::m], bend)
        return gradient

    def ends(self, unknowns: Array, closing: Number | None = None) -> list[Ends]:
        """Return the unknowns at both ends of each flight; `closing` is when the orbit closes, of
        another arithmetic."""
        z = unknowns.tolist()
        if closing is None:
            closing = self.closing(z[0], self.setup(unknowns).period)
        return self._around(z, [closing, *z[1 : self.m]])

    def ends_along(self, direction: Array, mu: float, drifts: Sequence[float] = ()) -> list[Ends]:
        """Return how these move along a direction; in the last flight the arrival does by mu q_1,
        and with the forcing's period."""
        q = direction.tolist()
        back = self.returned(q[: self.m], mu)
        if drifts:
            back[0] += float(np.array(drifts) @ direction[self.n :])
        return self._around(q, back)

    def drifts(self, unknowns: Array) -> list[float]:
        """Return how fast the orbit's period grows with each free parameter, as the forcing's."""
        return [self.word.period * slope for slope in self.setup(unknowns).slopes]

    def _around(self, given: list[float], last: list[Number]) -> list[Ends]:
        """What is given of impacts, at both ends of each flight; `last` where the orbit closes."""
        rows = [given[i : i + self.m] for i in range(0, self.n, self.m)]
        return list(zip(rows, [*rows[1:], last], strict=True))

    def cyclic(self, start: Array, end: Array) -> Array:
        """Return the (n, n + free) cyclic matrix of flattened blocks, zero in the columns of the
        parameters."""
        matrix = np.zeros(self.n * (self.n + self.free))
        matrix[self._at_start] = start
        matrix[self._at_end] += end
        return matrix.reshape(self.n, -1)

    def closing(self, first: Number, period: Number) -> Number:
        """Return when an orbit closes, of the first impact's time and the forcing period."""
        return first + period * self.word.period

    def returned(self, moved: Sequence[float], mu: float) -> list[float]:
        """Return how the arrival at impact 1 moves that moves so before, multiplied by mu."""
        return [mu * c for c in moved]

    def placed(self, rows: Array, span: float) -> Array:
        """Return an orbit's impacts in the clock of the unknowns, given its period."""
        return rows

    def with_impacts(self, rows: Array, span: float, beside: Array) -> Array:
        """Return the unknowns of an orbit, given its impacts and its period; the free parameters
        are those at the end of other unknowns."""
        return np.append(self.placed(rows, span).ravel(), beside[-self.free :])

    def later(self, unknowns: Array) -> list[Array]:
        """Return the same orbit as it begins one period of the forcing later, two periods, ..., if
        its unknowns, other than times, are others then."""
        return []

    def held(self, start: Array) -> Array:
        """Return the blocks A_k on the section whose map the multipliers are of."""
        return start

    def laps(self, first: Array, second: Array) -> Array:
        """Return the direction of the word run twice, of those of its laps, shape (2 n,)."""
        return np.concatenate([first, second])

    def third_along(self, unknowns: Array, direction: Array, mu: float = 1.0) -> Array:
        """Return the third derivative of the residual along a direction (q_1, ..., q_N), shape
        (n,).

        Parameters are held; in the last flight the arrival moves by mu q_1.
        """
        p, result = self.values(unknowns), list[float]()
        ends, moves = self.ends(unknowns), self.ends_along(direction, mu)
        for segment, one, moved in zip(self.segments, ends, moves, strict=True):
            result += segment.third(*one, [*moved[0], *moved[1]], p)
        self.kernel_evaluations += len(self.segments)
        return np.array(result)

    def scale(self, unknowns: Array, span: ArrayLike) -> Array:
        """Return natural sizes of the unknowns, by which arclength is measured.

        Times are measured in waves of the forcing, velocities in the largest along the flights,
        other section coordinates in the largest at the impacts, or, where they vanish at all of
        them, in the largest along the flights, and the velocity of what rests by its position in a
        wave; all averaged over the impacts on surfaces of one gap coordinate, since others have
        their own units. The free parameters are measured in `span`.
        """
        sizes = self._kept_sizes(np.asarray(unknowns, dtype=float).tobytes())
        return np.append(sizes, np.full(self.free, span))

    def _sizes(self, unknowns: Array) -> Array:
        """Those of the unknowns of impacts."""
        impacts, one = np.abs(self.impacts(unknowns)), np.ones((len(self.word), self.m))
        one[:, 0] = self.period(unknowns) / self.mean_order(self.values(unknowns))
        along = self._largest_along(unknowns) if self.looks_along else None
        for row, place in self.surfaces.items():
            sizes = np.max(impacts[place, 1:], axis=0)
            if along is None:
                sizes[0] = max(sizes[0], self._largest_speed(unknowns))
            else:
                speed, others = along[row]
                sizes[0] = max(sizes[0], speed)
                sizes[1:] = np.where(sizes[1:] > VANISHING * others, sizes[1:], others)
                resting = sizes[1::2] / one[0, 0]
                moves = sizes[2::2] > RESTING * resting
                sizes[2::2] = np.where(moves, sizes[2::2], resting)
            one[place, 1:] = np.where(sizes > 0, sizes, 1.0)
        return np.asarray(one * math.sqrt(len(self.word)))

    def residual_sizes(self, scale: Array) -> Array:
        """Return natural sizes of the residuals, given those of the unknowns, shape (n,).

        They are states at the ends of flights: the gap coordinate's is measured by the largest
        velocity in a wave of the forcing, or by that velocity, where it is over the duration.
        """
        sizes = scale[: self.n].reshape(-1, self.m) / math.sqrt(len(self.word))
        sizes = np.concatenate([sizes[1:], sizes[:1]])
        sizes[:, 0] = np.where(self._elsewhere, sizes[:, 0], 1.0) * sizes[:, 1]
        return sizes.ravel()

    def natural_units(self, unknowns: Array) -> Array:
        """Return units in which differences of orbits are told, whatever the units of the model:
        the forcing's period, the largest velocity at an impact, or to a wall in a period, for
        positions their product, and for parameters their values. Surfaces of several gap
        coordinates have the units of `scale`."""
        if len(self.surfaces) > 1:
            units = self.scale(unknowns, self._units_of_parameters(unknowns))
            units[: self.n] /= math.sqrt(len(self.word))
            return units
        setup, rates = self.setup(unknowns), np.abs(self.impacts(unknowns)[:, 1::2])
        fastest = max(float(np.max(rates)), max(map(abs, setup.walls)) / abs(setup.period))
        units = np.full(self.n + self.free, fastest or 1.0)
        impacts = units[: self.n].reshape(-1, self.m)
        impacts[:, 0] = 1.0
        impacts[:, ::2] *= self.period(unknowns)
        units[self.n :] = self._units_of_parameters(unknowns)
        return units

    def size_of_gaps(self, here: Linearisation) -> float:
        """Return the natural size of gaps: the way at the largest velocity in a period."""
        sizes = here.sizes[1][1 : self.n : self.m] / math.sqrt(len(self.word))
        return float(np.max(sizes)) * self.period(here.unknowns)

    def _units_of_parameters(self, unknowns: Array) -> Array:
        sizes = np.abs(unknowns[self.n :])
        return np.where(sizes > 0.0, sizes, 1.0)

    def least_scale(self, unknowns: Array) -> Array:
        """Return sizes of the impacts' unknowns that are at most those of `scale`, for one degree
        of freedom; they take no look along the flights."""
        sizes = np.empty(self.n)
        sizes[::2] = self.period(unknowns) / self.mean_order(self.values(unknowns))
        sizes[1::2] = np.max(np.abs(unknowns[1 : self.n : 2]))
        return sizes * math.sqrt(len(self.word))

    def mean_order(self, values: Sequence[float]) -> float:
        """Return the root of the mean square of the harmonics' orders; 1 where they are not
        known."""
        waves = self.kernels.harmonics(*values)[1:]
        if len(waves) == 3:  # as the sums over one
            weight = waves[1] * waves[1] + waves[2] * waves[2]
            return math.sqrt(waves[0] * waves[0] * weight / weight) if weight > 0.0 else 1.0
        orders, cosines, sines = np.reshape(waves, (-1, 3)).T
        weights = cosines**2 + sines**2
        total = float(np.sum(weights))
        return float(np.sqrt(orders**2 @ weights / total)) if total > 0.0 else 1.0

    def _largest_speed(self, unknowns: Array) -> float:
        """The largest speed at instants of each flight."""
        p = self.values(unknowns)
        rows = self.impacts(unknowns).tolist()
        rows.append([rows[0][0] + self.span(unknowns), *rows[0][1:]])
        fastest = 0.0
        for segment, (row, later) in zip(self.segments, pairwise(rows), strict=True):
            track, length = segment.track, later[0] - row[0]
            for part in INSTANTS:
                fastest = max(fastest, abs(track(row, part * length, p)[1]))
        return fastest

    def _largest_along(self, unknowns: Array) -> dict[tuple[float, ...], tuple[float, Array]]:
        """Of surfaces of one gap coordinate, its largest speed at instants of all flights, and the
        largest along them of each section coordinate but the first; where rounding alone moves a
        coordinate, of all of them."""
        places = np.array([0.0, *INSTANTS, 1.0])
        motion = motion_of(Linearisation(self, unknowns), places)
        inside = np.tile((places > 0.0) & (places < 1.0), len(self.word))
        speeds = np.max(np.abs(motion.v[inside] @ self.rows.T), axis=0)
        largest = np.max(np.abs([motion.x, motion.v]), axis=1).T
        waves = largest * (1.0, self.period(unknowns) / self.mean_order(self.values(unknowns)))
        resting = np.max(waves, axis=1) < UNIT * np.max(waves)
        largest[resting] = np.max(largest, axis=0)
        return {
            row: (float(np.max(speeds[place])), np.delete(largest, pivot(row), axis=0).ravel())
            for row, place in self.surfaces.items()
        }

    def apart(self, one: Array, other: Array) -> float:
        """Return the largest difference of two orbits in natural units; parameters do not count."""
        difference = self.difference(one, other) / self.natural_units(other)
        return float(np.max(np.abs(difference[: self.n])))

    def difference(self, one: Array, other: Array) -> Array:
        """Return one - other as orbits: zero up to whole periods and rotations of the word."""
        period, span, shifts = self.period(one), self.span(other), self.word.rotations()
        impacts = self.impacts(other)
        units = self.natural_units(other) if len(shifts) > 1 else 1.0
        best, least = None, math.inf
        for shift in shifts:
            moved = np.concatenate([impacts[shift:], impacts[:shift]])
            moved[len(moved) - shift :, 0] += span
            gap = self.impacts(one) - self.placed(moved, span)
            if not self.autonomous:
                gap[:, 0] -= period * np.round(np.mean(gap[:, 0]) / period)
            candidate = np.append(gap.ravel(), one[-self.free :] - other[-self.free :])
            away = float(np.linalg.norm(candidate / units))
            if best is None or away < least:
                best, least = candidate, away
        assert best is not None
        return best
