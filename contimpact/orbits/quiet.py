r"""Orbits without impacts, the forcing they answer, and orbits whose period is free.

The unknowns are the state on the section t = 0, z = (x_0, v_0, x_1, v_1, ..., lambda), in the first
mode of the system. One flight of p periods leads back to the section; its residual and its blocks
stand in the cyclic matrix as those of a word of one letter:

.. math:: R(x, v, x', v', \lambda) = 0, \qquad (x', v') = (x, v).

There is no impact, so there are no times, and the multipliers are those of the map over p periods.

Without forcing the section is where the first coordinate turns, v_0 = 0, and the period T stands
in the place of v_0 among the unknowns. The flight takes the time T; its blocks have the derivative
by T for the arrival, and nothing for the start.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Number
from ..errors import InputError
from ..models.guards import Row, Word, following_letters, state_before, state_size
from ..models.model import Model, Symmetry
from ..segments.flight import FlightGaps, Touch, touch_of
from ..segments.kernel import SECTION
from ..segments.kernels import Kernels
from ..segments.oscillation import Excursion, excursions
from ..segments.segment import Segment
from ..segments.touches import Seen, seen_by
from ..segments.track import IntegratedTrack, integrated_track, join_flights
from .problem import INSTANTS, VANISHING, Ends, Linearisation, OrbitProblem, motion_of

FAR_LESS = 2.0**-10
"""Part of the largest coordinate below which one is measured by its own size."""

BEYOND = 0.125
"""Part of a period for which an orbit without impacts is looked at beyond its end: no extremum is
at an end of both the orbit and what is looked at."""

AGAIN = 1e-6
"""Part of the orbit behind its end from which on an extremum is one that was seen at its beginning;
nearer, it may lie before the beginning next to it."""

# Whether motions depend on the time: where periods are free they must not.

PROBES = 3
"""States at which it is seen whether a motion depends on the time."""

DURATIONS = tuple(0.25**k for k in range(6))
"""Durations of the flights from them, as long as too few have a value."""

NO_TIME = 1e-12
"""Part of a flight's velocity by which it may change with the time, where it should not."""

ASIDE = 0.1
"""Amount by which a followed parameter is moved to see whether it brings a forcing."""


def require_no_forcing(model: Model, kernels: Kernels) -> None:
    """Raise `InputError` if motions depend on the time, or do so beside a followed parameter."""
    given = tuple(model.values.values())
    if model.timeless or given in kernels.unforced:
        return
    forced, unseen = _forced_flight(kernels, model.values)
    if forced:
        found = f"it is free, and the flight {forced} depends on the time"
        accepted = "take the forcing away, as by a = 0, or leave the period to the forcing"
        raise InputError("period", found, accepted)
    if unseen:
        found = f"it is free, and the flight {unseen} has no value at random states, by which it "
        found += "is seen whether it depends on the time"
        raise InputError("period", found, "give parameter values at which it has")
    for name in kernels.parameters:
        value = model.values[name]
        aside = ASIDE * (abs(value) or 1.0)
        forced, unseen = _forced_flight(kernels, {**model.values, name: value + aside})
        if unseen:
            forced, unseen = _forced_flight(kernels, {**model.values, name: value - aside})
        if forced:
            found = f"motions depend on the time where {name} is not {value!r}"
            accepted = "follow another one: without forcing alone the period is free"
            raise InputError("parameter", found, accepted)
        if unseen:
            found = f"beside {name} = {value!r} the flight {unseen} has no value at random "
            found += "states, by which it is seen whether it depends on the time"
            raise InputError("parameter", found, "follow another one, or from another value")
    kernels.unforced.add(given)


def _forced_flight(kernels: Kernels, values: Mapping[str, float]) -> tuple[str, str]:
    """A flight that changes where it is moved in time, or else one of which that cannot be seen."""
    guards, unseen = kernels.model.WALLS, ""
    for guard in guards:
        segment = kernels.segment(guard.name, following_letters(guards, guard.name)[0])
        changes = list(islice(_changes(segment, kernels.model, list(values.values())), PROBES))
        if any(change > NO_TIME for change in changes):
            return segment.name, ""
        if not changes:
            unseen = segment.name
    return "", unseen


def _changes(segment: Segment, model: Model, values: list[float]) -> Iterator[float]:
    """By which parts of their velocities flights from random states change if moved in time.

    The long ones first: where a law has a pole, or differences grow, only short ones may have a
    value.
    """
    m = model.unknowns_per_impact
    for duration in DURATIONS:
        for one, other in np.random.default_rng(0).normal(size=(PROBES, 2, m - 1)).tolist():
            try:
                _, leaving, arriving, _ = segment.whole([-duration, *one], [0.0, *other], values)
            except (ArithmeticError, ValueError):
                continue
            pairs = list(zip(leaving[::m], arriving[::m], strict=True))
            change = max(abs(by_start + by_end) for by_start, by_end in pairs)
            largest = max(abs(by_end) for _, by_end in pairs)
            if largest > 0.0 and math.isfinite(change / largest):
                yield change / largest


# Orbits of systems without forcing: their period T is an unknown.
#
# Neither has the clock of such an orbit a phase. It is set such that the orbit closes at t = 0: the
# first passage is at t_1 = -T, and no unknown is added. That passage is a Poincare section, so that
# no other condition fixes the phase. The last flight arrives at t = 0, whatever the unknowns are;
# its column of t_1 vanishes (N = 3)::
#
#     [ A1 B1      | L1 ]
#     [    A2 B2   | L2 ]      B3' is B3 without its first column
#     [ B3'   A3   | L3 ]
#
# The multipliers are those of the section's return map, m - 1 of them. In their pencil the first
# passage's time is held, and when the orbit returns is what follows: the first column is left out
# of A1, not of B3. The multiplier 1 of the flow's direction becomes a 0 in that place, and is left
# out.


class WithoutForcing(OrbitProblem):
    """Orbits of a system without forcing."""

    autonomous = True

    def _begin(self, model: Model, word: Word, kernels: Kernels) -> None:
        super()._begin(model, word, kernels)
        require_no_forcing(model, kernels)

    def period(self, unknowns: Array) -> float:
        """Return the orbit's period."""
        return self.span(unknowns)


class FreePeriodProblem(WithoutForcing):
    """The equations of a word in a system without forcing; see `OrbitProblem`."""

    def span(self, unknowns: Array) -> float:
        """Return the orbit's period."""
        return -float(unknowns[0])

    def closing(self, first: Number, period: Number) -> Number:
        """Return when an orbit closes: at t = 0."""
        return 0.0 * first

    def cyclic(self, start: Array, end: Array) -> Array:
        """Return the (n, n + free) cyclic matrix of flattened blocks."""
        end = end.copy()
        end[-self.m * self.m :: self.m] = 0.0
        return super().cyclic(start, end)

    def returned(self, moved: Sequence[float], mu: float) -> list[float]:
        """Return how the arrival at impact 1 moves: not in time."""
        return [0.0, *super().returned(moved[1:], mu)]

    def placed(self, rows: Array, span: float) -> Array:
        """Return an orbit's impacts in the clock in which it closes at t = 0."""
        rows = rows.copy()
        rows[:, 0] -= rows[0, 0] + span
        return rows

    def held(self, start: Array) -> Array:
        """Return the blocks A_k with the first passage's time held."""
        start = start.copy()
        start[0, :, 0] = 0.0
        return start

    def laps(self, first: Array, second: Array) -> Array:
        """Return the direction of the word run twice: one lap closes where the next starts."""
        first = first.copy()
        first[:: self.m] += second[0]
        return super().laps(first, second)


TURNING_SAMPLES = 1024
"""Instants at which it is seen when a coordinate turns."""

SIMILAR = 3.0
"""Factor of the least distance between two turns up to which others are the same orbit's: those
after more laps are about as small."""

STILL, SAME_LAP, MOST_LAPS = 1e-6, 1e-7, 8
"""The acceleration below which an orbit rests, as a part of the state; the relative residual of a
part of its period below which it repeats another; and the most laps that are looked for where the
period is free."""


def problem_of(model: Model, word: Word, kernels: Kernels) -> OrbitProblem:
    """Return the equations of a word, whatever it is; arguments as of `OrbitProblem`."""
    if word.walls:
        kind = OrbitProblem if word.period else FreePeriodProblem
    else:
        kind = QuietProblem if word.period else FreeQuietProblem
    return kind(model, word, kernels)


def problem_in(parameter: str, model: Model, here: Linearisation) -> tuple[OrbitProblem, Array]:
    """Return the equations of an orbit of a model with a parameter free, and the unknowns there."""
    problem = problem_of(model, here.problem.word, Kernels(model, parameter))
    free = [model.values[parameter]]
    return problem, np.concatenate([here.unknowns[: problem.n], free])


def _extrema(seen: Seen, length: float) -> Excursion:
    """The extrema of a gap coordinate in a period; one that has no maximum or no minimum is at rest
    in its place."""
    motion, breaks = seen
    place, _, _ = motion((), 0.0, ())
    ends = length, motion((), length, ())[1], 0.0, 0.0
    high, when_high, low, when_low, slowest = excursions(
        motion, (), (), ends, breaks, 0.0, math.inf
    )
    if math.isnan(high):
        high, when_high = place, 0.0
    if math.isnan(low):
        low, when_low = place, 0.0
    return high, when_high, low, when_low, slowest


class QuietProblem(OrbitProblem):
    """The equations of orbits without impacts; see `OrbitProblem`."""

    def __init__(self, model: Model, word: Word, kernels: Kernels) -> None:
        self._begin(model, word, kernels)
        self.n = self.m
        self.kinds, self.arrivals, self.excursions = (), (), ()
        own = state_size(model.MODES, model.first_mode, model.DEGREES_OF_FREEDOM)
        self.lost = self.m - own
        self.segments = [kernels.segment(SECTION, str(word.period))]
        self._place_blocks()

    def impacts(self, unknowns: Array) -> Array:
        """Return the impacts: none."""
        return np.zeros((0, self.m))

    def leaving(self, unknowns: Array, flight: int) -> tuple[str, list[float]]:
        """Return the section and the state there."""
        return SECTION, self.state(unknowns)

    def state(self, unknowns: Array) -> list[float]:
        """Return the state on the section."""
        return unknowns[: self.m].tolist()

    def natural_units(self, unknowns: Array) -> Array:
        """Return units in which differences of orbits are told: the largest of positions, and of
        velocities in waves of the forcing, that time, and for parameters their values."""
        rate = 2.0 * math.pi / self.period(unknowns)
        sizes = np.abs(self.state(unknowns))
        sizes[1::2] /= rate
        units = np.full(self.n, np.max(sizes) or 1.0)
        units[1::2] *= rate
        return np.append(units, self._units_of_parameters(unknowns))

    def size_of_gaps(self, here: Linearisation) -> float:
        """Return the natural size of gaps: that of positions along the orbit."""
        return float(here.sizes[1][0])

    def times_around(self, unknowns: Array, flight: int) -> tuple[float, float]:
        """Return the times between which touches are looked for."""
        return 0.0, self.span(unknowns) + BEYOND * self.period(unknowns)

    def ends(self, unknowns: Array, closing: Number | None = None) -> list[Ends]:
        """Return the state on the section, and the unknowns to which the flight leads."""
        return [(self.state(unknowns), unknowns[: self.m].tolist())]

    def ends_along(self, direction: Array, mu: float, drifts: Sequence[float] = ()) -> list[Ends]:
        """Return how these move along a direction."""
        q = direction[: self.m].tolist()
        return [(self.leaves(q).tolist(), [mu * c for c in q])]

    def drifts(self, unknowns: Array) -> list[float]:
        """Return none: the kernel of the flight has the forcing's period in it."""
        return []

    def gaps(self, unknowns: Array) -> list[FlightGaps]:
        """Return the nearest touch of each guard of the first mode, in one row."""
        mode = self.model.first_mode
        positions = self.setup(unknowns).walls
        length = self.times_around(unknowns, 0)[1]
        found = {row: _extrema(seen, length) for row, seen in self._seen(unknowns, length).items()}
        touches = tuple(
            self._first(touch_of(0, 0.0, guard, position, found[guard.row(self.m // 2)]), unknowns)
            if mode in guard.modes and not guard.past
            else None
            for guard, position in zip(self.model.WALLS, positions, strict=True)
        )
        turns = (each[4] for each in found.values() if not math.isnan(each[4]))
        slowest = min(turns, key=abs, default=math.nan)
        return [FlightGaps(length, touches, slowest)]

    def _first(self, touch: Touch | None, unknowns: Array) -> Touch | None:
        """The same touch within the first period: rounding decides which of both is the nearer."""
        span = self.span(unknowns)
        if touch is None or touch.time < (1.0 + AGAIN) * span:
            return touch
        return replace(touch, time=touch.time - span)

    def _seen(self, unknowns: Array, length: float) -> dict[Row, Seen]:
        """The gap coordinates of the guards of the first mode."""
        values, state, mode = self.values(unknowns), self.state(unknowns), self.model.first_mode
        rows = {g.row(self.m // 2): g.name for g in self.model.WALLS if mode in g.modes}
        if not self.kernels.integrated(SECTION):
            since = {row: self.kernels.since(name) for row, name in rows.items()}
            return {row: seen_by(since[row], state, length, values) for row in rows}
        track = self._track(unknowns, state, values, length)
        curves = {row: track.along(row) for row in rows}
        return {row: (curve, curve.breaks()) for row, curve in curves.items()}

    def _track(
        self, unknowns: Array, state: list[float], values: list[float], length: float
    ) -> IntegratedTrack:
        """The orbit and what comes after it, where its first states come again."""
        segment: Any = self.segments[0]
        whole = segment.long_track(state, unknowns[: self.m].tolist(), values)
        if whole is None:
            return integrated_track(self.kernels, SECTION, state, values, length)
        span, places = self.span(unknowns), np.array(state[::2])
        more = integrated_track(self.kernels, SECTION, state, values, length - span)
        return join_flights([whole, more], [0.0, span], np.array([places, places]))

    def first_lap(self, unknowns: Array) -> tuple[QuietProblem, Array]:
        """Return an orbit as one of its shortest period, itself if it repeats none."""
        shorter = (QuietProblem(self.model, w, self.kernels) for w in self.word.repeated())
        return next((one for one in shorter if one.solved_by(unknowns)), self), unknowns

    def later(self, unknowns: Array) -> list[Array]:
        """Return the same orbit as it begins one period of the forcing later, two periods, ..."""
        once, found = QuietProblem(self.model, Word("", 1), self.kernels), list[Array]()
        for _ in range(self.word.period - 1):
            unknowns = unknowns.copy()
            unknowns[: self.m] += once.evaluate(unknowns).residual
            found.append(unknowns)
        return found

    def mirrored(self, unknowns: Array, symmetry: Symmetry) -> Array:
        """Return the image of an orbit under the model's symmetry."""
        begins = np.array([0.0, self._image_begins(unknowns, symmetry), 1.0])
        motion, image = motion_of(Linearisation(self, unknowns), begins), unknowns.copy()
        image[: self.m] = symmetry.sign * np.array([motion.x[1], motion.v[1]]).T.ravel()
        return image

    def _image_begins(self, unknowns: Array, symmetry: Symmetry) -> float:
        """At which part of an orbit its image begins."""
        return symmetry.shift / self.word.period

    def solved_by(self, unknowns: Array) -> bool:
        """Whether unknowns are those of an orbit."""
        sizes = self.residual_sizes(self.scale(unknowns, 1.0))
        return bool(np.all(np.abs(self.evaluate(unknowns).residual) < SAME_LAP * sizes))

    def second_lap(self, unknowns: Array, moved: Array) -> tuple[Array, Array]:
        """Return an orbit run twice and its direction, from those of one lap and the next one's
        being opposite."""
        return unknowns, moved

    def from_touch(self, problem: OrbitProblem, unknowns: Array, impact: int) -> Array:
        """Return a guess of the unknowns where the only impact of a word vanishes, shape (m,).

        Of a flight that is integrated it is the state on the section, on the way to the touch.
        """
        flight = (impact - 1) % len(problem.word)
        wall, leave = problem.leaving(unknowns, flight)
        if not self.kernels.integrated(wall):
            return np.zeros(self.m)
        length = -leave[0] % self.period(unknowns)
        track = integrated_track(self.kernels, wall, leave, self.values(unknowns), length)
        size = self.m // 2
        ends = [track.along(row).at_end() for row in np.eye(size).tolist()]
        return np.array(ends).ravel()

    def _sizes(self, unknowns: Array) -> Array:
        """Natural sizes of the state.

        Velocities are measured by the largest along the orbit, or positions in waves of the
        forcing, and positions by the same in the wave's time; coordinates that are `FAR_LESS` than
        the largest by their own, unless these vanish beside it.
        """
        rate = 2.0 * math.pi / self.period(unknowns)
        positions, velocities = np.abs(self.state(unknowns)).reshape(-1, 2).T
        fastest, speeds = self._largest_speeds(unknowns)
        own = np.maximum(positions, np.maximum(velocities, speeds) / rate)
        largest = max(float(np.max(positions)), fastest / rate, float(np.max(velocities)) / rate)
        less = (own < FAR_LESS * largest) & (own > VANISHING * largest)
        size = np.where(less, own, largest) if largest > 0.0 else np.ones(len(own))
        return np.column_stack([size, size * rate]).ravel()

    def residual_sizes(self, scale: Array) -> Array:
        """Return natural sizes of the residuals: those of the state."""
        return scale[: self.n]

    def _largest_speeds(self, unknowns: Array) -> tuple[float, Array]:
        """The largest speed of a gap coordinate along the orbit, and that of each coordinate, which
        is known of integrated flights, and else of what the gap depends on."""
        values, state, length = self.values(unknowns), self.state(unknowns), self.span(unknowns)
        guard = self.model.WALLS[0]
        row = np.array(guard.row(self.m // 2), dtype=float)
        if not self.kernels.integrated(SECTION):
            since = self.kernels.since(guard.name)
            fastest = max(abs(since(*state, part * length, *values)[1]) for part in (0, *INSTANTS))
            return fastest, np.where(row == 0.0, 0.0, fastest)
        each = np.zeros(len(row))
        try:
            track = integrated_track(self.kernels, SECTION, state, values, length)
        except ArithmeticError:
            return 0.0, each
        _, speeds = track.at(length * np.array(INSTANTS))
        moving = speeds.shape[1]
        each[:moving] = np.max(np.abs(speeds), axis=0)
        return float(np.max(np.abs(speeds @ row[:moving]))), each

    def difference(self, one: Array, other: Array) -> Array:
        """Return one - other as orbits."""
        return np.asarray(one - other)


def largest_first(here: Linearisation) -> Array:
    """Return the state on an orbit where the first coordinate is largest, of `TURNING_SAMPLES` on
    each flight."""
    motion = motion_of(here, TURNING_SAMPLES)
    largest = np.argmax(motion.x[:, 0])
    return np.array([motion.x[largest], motion.v[largest]]).T.ravel()


class FreeQuietProblem(WithoutForcing, QuietProblem):
    """The equations of orbits without impacts in a system without forcing."""

    def span(self, unknowns: Array) -> float:
        """Return the orbit's period."""
        return float(unknowns[1])

    def state(self, unknowns: Array) -> list[float]:
        """Return the state on the section, where the first coordinate turns."""
        return self.leaves(unknowns[: self.m]).tolist()

    def natural_units(self, unknowns: Array) -> Array:
        """Return those of `scale`: where a guard at zero is touched, the state is zero."""
        return self.scale(unknowns, self._units_of_parameters(unknowns))

    def leaves(self, moved: ArrayLike) -> Array:
        """Return a direction of the unknowns, or rows of them in turn, without v_0."""
        moved = np.array(moved)
        moved[1 :: self.m] = 0.0
        return moved

    def first_lap(self, unknowns: Array) -> tuple[QuietProblem, Array]:
        """Return an orbit run once: it has at least a turn of the first coordinate in each lap."""
        span = self.span(unknowns)
        track = self._track(unknowns, self.state(unknowns), self.values(unknowns), span)
        speeds = track.at(np.linspace(0.0, span, TURNING_SAMPLES))[1][:, 0]
        turns = int(np.count_nonzero((speeds[:-1] > 0.0) & (speeds[1:] <= 0.0)))
        for laps in range(max(turns + 1, MOST_LAPS), 1, -1):
            once = unknowns.copy()
            once[1] /= laps
            if self.solved_by(once):
                return self, once
        return self, unknowns

    def later(self, unknowns: Array) -> list[Array]:
        """Return none: without a forcing no orbit is another one a period of it later."""
        return []

    def mirrored(self, unknowns: Array, symmetry: Symmetry) -> Array:
        """Return the image of an orbit under the model's symmetry."""
        image = super().mirrored(unknowns, symmetry)
        image[1] = unknowns[1]
        return image

    def _image_begins(self, unknowns: Array, symmetry: Symmetry) -> float:
        """At which part of an orbit its image begins: where the image's first coordinate is
        largest."""
        if symmetry.sign > 0.0:
            return 0.0
        span = self.span(unknowns)
        track = self._track(unknowns, self.state(unknowns), self.values(unknowns), span)
        first = track.along(np.eye(self.m // 2)[0].tolist())
        return _extrema((first, first.breaks()), span)[3] / span

    def second_lap(self, unknowns: Array, moved: Array) -> tuple[Array, Array]:
        """Return an orbit run twice and its direction: the period does not move."""
        unknowns, moved = unknowns.copy(), moved.copy()
        unknowns[1], moved[1] = 2.0 * unknowns[1], 0.0
        return unknowns, moved

    def from_touch(self, problem: OrbitProblem, unknowns: Array, impact: int) -> Array:
        """Return the state where the first coordinate is largest on the orbit, and the period.

        A touch of a guard above that coordinate is there itself, others are on the way.
        """
        letter, section = problem.word.walls[impact], problem.impacts(unknowns)[impact, 1:].tolist()
        guard, place = self.model.guard(letter), self.model.letters.index(letter)
        row = guard.row(self.m // 2)
        state = np.array(state_before(row, self.setup(unknowns).walls[place], section)).T.ravel()
        if any(row[1:]) or guard.side * row[0] < 0.0:
            state = largest_first(Linearisation(problem, unknowns))
        state[1] = problem.span(unknowns)
        return state

    def turning(self, unknowns: Array) -> float:
        """Return the first coordinate's acceleration on the section; zero at an equilibrium.

        It is that of a flight of no duration: the rows of a long one are those of its pieces.
        """
        state = self.state(unknowns)
        _, _, end, _ = self.segments[0].blocks(state, state, self.values(unknowns))
        return float(end[self.m + 1])

    def guess_after(self, unknowns: Array, length: float, settled: bool) -> Array | None:
        """Return a guess of the unknowns of a cycle on a flight that is integrated: from its start
        to where the first coordinate is largest, or from a later such place to the last, between
        which the state comes again."""
        values, state = self.values(unknowns), self.state(unknowns)
        track = integrated_track(self.kernels, SECTION, state, values, length)
        times = np.linspace(0.0, length, TURNING_SAMPLES)
        speeds = track.at(times)[1][:, 0]
        turns = np.nonzero((speeds[:-1] > 0.0) & (speeds[1:] <= 0.0))[0]
        if len(turns) < 1 + settled:
            return None
        part = speeds[turns] / (speeds[turns] - speeds[turns + 1])
        ends = times[turns] + part * times[1]
        guess = unknowns.copy()
        guess[1] = ends[0]
        if settled:
            positions, speeds = track.at(ends)
            apart = np.abs(positions[-2 : -2 - MOST_LAPS : -1] - positions[-1]).max(axis=1)
            first = -2 - int(np.argmax(apart <= SIMILAR * apart.min()))
            guess[: self.m] = np.array([positions[first], speeds[first]]).T.ravel()
            guess[1] = ends[-1] - ends[first]
        return guess

    def moves(self, unknowns: Array, units: Array) -> bool:
        """Whether an orbit is one from where the first coordinate is largest, run once, and no
        equilibrium; one at rest is told in `units` of the state."""
        moving = self.span(unknowns) > 0.0 and self.turning(unknowns) < 0.0
        moving = moving and not self.rests(unknowns, units)
        return moving and self.first_lap(unknowns)[1] is unknowns

    def rests(self, unknowns: Array, units: Array) -> bool:
        """Whether it is an equilibrium, which solves the equations with any period."""
        size = float(np.max(np.maximum(units, np.abs(self.state(unknowns))) / units)) * units[0]
        rate = units[1] / units[0]
        return abs(self.turning(unknowns)) <= STILL * size * rate**2

    def scale(self, unknowns: Array, span: ArrayLike) -> Array:
        """Return natural sizes of the unknowns, by which arclength is measured."""
        sizes = super().scale(unknowns, span)
        sizes[1] = self.span(unknowns)
        return sizes

    def residual_sizes(self, scale: Array) -> Array:
        """Return the same, with a velocity in the place of the period."""
        sizes = super().residual_sizes(scale).copy()
        sizes[1] = 2.0 * math.pi * sizes[0] / sizes[1]
        return sizes
