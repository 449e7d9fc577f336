"""Crises and tangencies located from simulated motion.

The equations are in `contimpact.bifurcations.crisis`. What they lack is a path to start from: a
stretch of simulated complex motion that nearly grazes, and then comes nearest to the stable
manifold of the unstable orbit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, product
from typing import Any

import numpy as np

from ..arrays import Array
from ..bifurcations.crisis import Connected, Connection, refined, solve, unstable_direction
from ..errors import InputError, explain_arguments
from ..models.model import Model
from ..models.word import Word, is_rotation
from ..orbits.orbit import Orbit
from ..orbits.search import solve_near
from ..results.branch import Entry
from ..results.options import SETTLING, Settling
from ..segments.kernels import Kernels
from ..segments.touches import interior_touches
from ..simulation.attractor import Attractor, Kind, distances_between
from ..simulation.run import Run, State
from ..simulation.settle import settle
from ..simulation.simulator import Simulator, has_several_coordinates
from ..simulation.sweep import same_attractor

CR = "CR"
"""Kind of their entries."""
BESIDE = 1e-6
"""How far beside an orbit the motion along its unstable manifold starts."""
PATIENT = replace(SETTLING, periods=8000)
"""How long motion beyond a crisis is given: transients are long there."""
NEARER = 0.01, 0.02, 0.05, 0.2, 0.5, 0.8, 0.95
"""Parts of the distance to a crisis at which the attractor is looked for again."""
NEAR = 0.05
"""The part of it within which it has to be seen, and the crisis found, once more."""
RETURNING = 40_000
"""Impacts beyond a crisis among which motion is looked for that passes the orbit and returns."""
WIDER, RARE = 5.0, 1e-3
"""An attractor has widened if more than this part of its impacts is further from all impacts before
than that many times what as large a part of these is from all of its own."""
RUNS = 10
"""As many times that, after which no attractor has changed; and as many times the impacts in which
motion leaves beyond a crisis, which the attractor has to last beside it."""
TRIALS = 8
"""How often a crisis is looked for again, nearer by."""
DEPTH = 24
"""Impacts before the arrival at the orbit among which the one that grazes is looked for."""
PLACES = 4
"""Places on a path at which a grazing is tried: those where it is nearest to one."""
LAPS = 3
"""Laps of the first orbit that are taken from a simulated path."""
LONGEST_TAIL = 8
"""Impacts of the first orbit at most."""
BEFORE = DEPTH + (LAPS + 1) * LONGEST_TAIL
"""Impacts of a simulated path before its arrival at the orbit."""
ENTRIES, PATHS = 50, 40
"""Arrivals looked at, and different paths solved for, at most."""
ARRIVALS = 20
"""Arrivals from which on those that follow the orbit twice are enough."""
CLOSE = 0.05
"""How near to an orbit a connection begins and ends, in periods and in its largest velocity."""
LEAVING, STARTS, RETURN, RETURNS = 1e-4, 64, 200, 8
"""How far beside an orbit motions start on a side of it, from all along its unstable manifold, how
many and for how many impacts, and paths taken from them."""
SHORTEST, JOINED, BEGUN = 4, 0.25, 2
"""Impacts at most of the orbits after which a path's last impacts are tried, how near to the path
they are, in periods and in its largest velocity, and simulated paths begun with."""
REFINED = 4
"""Orbits left, of each of which the nearest path is lengthened: how near it is is known then."""
SAME_FLIGHT = 1e-6
"""How well a simulated flight repeats one of a path; beside a grazing it does by the square root of
rounding."""


NEAREST_FOUND = "the nearest tangency found; a rarer one may end the motion before"


@dataclass(frozen=True, eq=False)
class Crisis:
    """A crisis: where a chaotic attractor touches the stable manifold of an unstable orbit."""

    parameter: str
    value: float
    error: float
    """Bound of the error of the tangency's value: rounding, and what longer paths change. Without a
    grazing, a rarer path may end the attractor before."""
    attractor: str
    """Notation of the motion that ends."""
    type: str | None
    """``boundary`` if the motion leaves the attractor beyond; ``interior`` if beyond it passes the
    orbit's stable manifold to both sides and stays complex, so that the attractor has widened;
    ``merging`` if another complex attractor has touched from the other side, as its mirror image;
    None if it has not settled: the transient is longer than was simulated."""
    after: str
    """What the motion settles on, as far beyond as the first orbit was before the crisis."""
    seen: float
    """The nearest value of the parameter at which simulation has shown the attractor."""
    orbit: Orbit
    """The unstable orbit, at the crisis."""
    path: Connected = field(repr=False)
    """The connection that grazes, or at which two connections meet."""
    model: Model = field(repr=False)
    """The model at the crisis."""
    branch: str | None = None
    """The branch on which the orbit lies, if it was found on one."""

    @property
    def label(self) -> str:
        """``CR[1:1/C|2:1]``: the attractor, and the orbit whose stable manifold it touches."""
        return f"{CR}[{self.attractor}|{self.orbit.notation}]"

    @property
    def walls(self) -> str:
        """The walls hit along the connection."""
        return self.path.problem.walls

    @property
    def grazing(self) -> int | None:
        """Number of the impact on the connection whose velocity vanishes; None where the attractor
        touches without a grazing, as in smooth maps."""
        return self.path.problem.grazing

    @property
    def times(self) -> Array:
        """Times of its impacts."""
        return self.path.impacts[:, 0]

    @property
    def velocities(self) -> Array:
        """Velocities before its impacts."""
        return self.path.impacts[:, 1]

    @property
    def homoclinic(self) -> bool:
        """Whether the connection leaves the orbit at which it ends."""
        problem = self.path.problem
        own, other = problem.before, problem.after
        return own.period == other.period and own.walls in other.walls * 2

    def as_record(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "kind": CR,
            "label": self.label,
            "parameter": self.parameter,
            "value": self.value,
            "error": self.error,
            "parameters": {**self.orbit.parameters},
            "orbit": str(self.orbit.word),
            "branch": self.branch,
            **self.connection(),
        }

    def connection(self) -> dict[str, Any]:
        """Return as plain data what a crisis has besides its orbit, as its entry keeps it."""
        return {
            "attractor": self.attractor,
            "type": self.type,
            "after": self.after,
            "seen": self.seen,
            "leaves": str(self.path.problem.before),
            "homoclinic": self.homoclinic,
            "walls": self.walls,
            "grazing": self.grazing,
            "times": self.times.tolist(),
            "velocities": self.velocities.tolist(),
        }

    def __str__(self) -> str:
        kind = f", {self.type}" if self.type else ""
        place = f"{self.parameter} = {self.value:.15g} (+- {self.error:.1g})"
        text = f"{self.label} at {place}{kind}; beyond: {self.after}"
        return text if self.grazing is not None else f"{text}; {NEAREST_FOUND}"


@dataclass(frozen=True)
class NoCrisis:
    """Why no crisis was located."""

    reason: str
    entry: Entry | None = None
    """The event from which on the periodic motion that takes over is stable, if there is one."""

    def __str__(self) -> str:
        return f"no crisis: {self.reason}"


@explain_arguments
def locate_crisis(
    orbit: Orbit, start: State | None = None, *, impacts: int = 40_000
) -> Crisis | NoCrisis:
    """Locate the crisis at which a chaotic attractor touches an orbit's stable manifold.

    Parameters
    ----------
    orbit : Orbit
        Unstable, at a value of its parameter at which the attractor still exists, best near to the
        crisis; see `find_orbits`. The closer, the more crises without a grazing are found.
    start : State, optional
        From which the motion settles on the attractor; by default it starts beside the orbit, along
        its unstable manifold.
    impacts : int
        Simulated on the attractor.

    Returns
    -------
    Crisis or NoCrisis
        The nearest one in the orbit's parameter. The attractor is known from simulation: that it is
        the nearest is as certain as that the run has visited all of it.

    Raises
    ------
    InputError
        For a system with several coordinates or without forcing, an orbit that is not unstable in
        one direction, with a positive multiplier, or not physical, or impacts that are no whole
        number > 0.
    """
    require_one_coordinate(orbit.model, orbit.problem.kernels, "orbit")
    if type(impacts) is not int or impacts < 1:
        raise InputError("impacts", f"found {impacts!r}", "give a whole number > 0")
    simulator = Simulator(orbit.model, orbit.problem.kernels)
    _require_saddle(orbit, "orbit")
    attractor = settle(simulator, start) if start else _beside(simulator, orbit)
    if attractor is None or attractor.kind is not Kind.COMPLEX or attractor.state is None:
        settled = attractor.notation if attractor else "periodic motion on both sides"
        return NoCrisis(f"the motion settles on {settled} at {orbit.parameter} = {orbit.value:.9g}")
    return locate_either(orbit, attractor, impacts)


def locate_either(orbit: Orbit, attractor: Attractor, impacts: int) -> Crisis | NoCrisis:
    """Locate the crisis of an attractor, with a grazing or else without one."""
    found = approach_crisis(orbit, attractor, impacts, smooth=False)
    if isinstance(found, Crisis):
        return found
    touching = approach_crisis(orbit, attractor, impacts, smooth=True)
    return (
        touching
        if isinstance(touching, Crisis)
        else NoCrisis(f"{found.reason}; without a grazing, {touching.reason}")
    )


def approach_crisis(
    orbit: Orbit, attractor: Attractor, impacts: int, smooth: bool
) -> Crisis | NoCrisis:
    """Locate a crisis again and again, nearer by, until nothing touches before it."""
    best: tuple[Connected, float] | None = None
    begun, first, outermost = orbit.value, (orbit, attractor), not smooth
    for _ in range(TRIALS):
        nearest = _nearest(orbit, attractor, impacts, smooth)
        if best is not None:
            path, error = best
            value = float(path.unknowns[-1])
            left = (value - orbit.value) * np.sign(value - begun)
            ahead = abs(float(nearest[0].unknowns[-1]) - orbit.value) if nearest else np.inf
            near = 0.0 < left <= ahead + 2.0 * error and left <= NEAR * abs(value - begun)
            if not outermost and (near or nearest is None):
                outermost = True
                before = _touching_before(best, *first, impacts)
                if before is not None:
                    best, orbit, attractor = before
                    nearest, near = best, False
                elif near and nearest is not None:
                    return _crisis(orbit, attractor, path, error, 2.0 * value - begun)
            elif near:
                return _crisis(orbit, attractor, path, error, 2.0 * value - begun)
            elif not 0.0 < left <= ahead:
                best = None
        if nearest is None:
            break
        best = best or nearest
        nearer = _nearer(orbit, attractor, float(best[0].unknowns[-1]))
        if nearer is None:
            break
        orbit, attractor = nearer
    place = f"{orbit.parameter} = {orbit.value:.9g}"
    if best is None:
        ends = "ends" if smooth else "grazes and ends"
        none = f"no simulated path leads to one that {ends} at {orbit.notation} at {place}"
        return NoCrisis(f"{none}, or the motion comes near to that orbit on both sides")
    reached = f"the nearest connection is at {best[0].unknowns[-1]:.9g}, and the attractor was seen"
    return NoCrisis(f"{reached} at {place}, but not both near to each other; simulate more impacts")


def require_one_coordinate(model: Model, kernels: Kernels, where: str) -> None:
    """Raise `InputError` for a system whose crises are not located."""
    if model.autonomous or has_several_coordinates(model, kernels):
        accepted = "crises are located of one forced coordinate between rigid walls"
        raise InputError(where, f"the system {model.SYSTEM}", accepted)


@dataclass(frozen=True, eq=False)
class Tangency:
    """Where an unstable manifold touches a stable one, with or without a corner that a grazing has
    cut."""

    parameter: str
    value: float
    error: float
    """Bound of the value's error: rounding, and what longer paths change."""
    leaves: Orbit
    """The orbit whose unstable manifold touches, at the tangency."""
    arrives: Orbit
    """The orbit whose stable manifold is touched, at the tangency."""
    path: Connected = field(repr=False)
    """The connection that grazes, or at which two connections meet."""

    @property
    def homoclinic(self) -> bool:
        """Whether both are the same orbit."""
        return are_same_orbit(self.leaves, self.arrives)

    def __str__(self) -> str:
        kind = "homoclinic" if self.homoclinic else "heteroclinic"
        ends = f"{self.leaves.notation} to {self.arrives.notation}"
        return f"{kind}, {ends}, at {self.parameter} = {self.value:.15g} (+- {self.error:.1g})"


@explain_arguments
def locate_tangencies(
    leaves: Orbit, arrives: Orbit | None = None, *, starts: int = 64, impacts: int = 200
) -> list[Tangency]:
    """Locate values at which an orbit's unstable manifold touches a stable one.

    With impacts an unstable manifold has corners, the images of its points that graze; it may also
    touch where it is round. Motions that leave the orbit, from all along its manifold, are
    simulated; those that come near to the other orbit are where connections are looked for.

    Parameters
    ----------
    leaves, arrives : Orbit
        Unstable, at the same value of the same parameter, best near to the tangency; the same orbit
        by default.
    starts : int
        Motions simulated on either side of the orbit.
    impacts : int
        Of each motion.

    Returns
    -------
    list of Tangency
        Those with a physical connection, the nearest in the parameter first. Others may exist.

    Raises
    ------
    InputError
        For a system with several coordinates or without forcing, orbits of different systems or
        values, or one that is not unstable in one direction, or not physical.
    """
    if type(starts) is not int or starts < 1:
        raise InputError("starts", f"found {starts!r}", "give a whole number > 0")
    arrives = arrives or leaves
    for name, orbit in (("leaves", leaves), ("arrives", arrives)):
        require_one_coordinate(orbit.model, orbit.problem.kernels, name)
        _require_saddle(orbit, name, -np.inf)
    if leaves.parameters != arrives.parameters or leaves.parameter != arrives.parameter:
        accepted = "give orbits at the same values, with the same parameter"
        raise InputError("arrives", f"{arrives.notation} at other values", accepted)
    simulator = Simulator(leaves.model, leaves.problem.kernels)
    found = list[Tangency]()
    runs = list(_manifold_runs(simulator, leaves, BESIDE, (1.0, -1.0), starts, impacts))
    given = simulator, leaves, arrives
    with_grazing = (_guesses(*given, run, _entries(run, arrives), _paths) for _, run in runs)
    for guesses in (chain(*with_grazing), _returning(leaves, arrives, runs)):
        for path in _solutions(arrives, guesses, set()):
            end = _end_of(path, arrives, -1)
            begin = _end_of(path, leaves, 0)
            if end is None or begin is None or not is_physical(path):
                continue
            longer = refined(path)
            if longer is not None and is_physical(longer[0]):
                value, error = float(longer[0].unknowns[-1]), longer[1]
                if not any(abs(t.value - value) <= t.error + error for t in found):
                    found.append(Tangency(leaves.parameter, value, error, begin, end, longer[0]))
    return sorted(found, key=lambda t: abs(t.value - leaves.value))


def _end_of(path: Connected, orbit: Orbit, place: int) -> Orbit | None:
    """An orbit at the parameter value of a path, if this begins (0) or ends (-1) with laps near to
    it."""
    lap = path.problem.after if place else path.problem.before
    if lap.period != orbit.word.period or not is_rotation(lap.walls, orbit.word.walls):
        return None
    here = solve_near(orbit.problem, np.append(orbit.unknowns[:-1], path.unknowns[-1]))
    if here is None:
        return None
    there, wall = Orbit(orbit.problem, here), path.problem.walls[place]
    forcing = orbit.problem.period(orbit.unknowns)
    time, velocity = path.impacts[place]
    fastest = float(np.max(np.abs(there.velocities)))
    for k, letter in enumerate(there.word.walls):
        apart = (time - there.times[k]) / forcing, (velocity - there.velocities[k]) / fastest
        if letter == wall and max(abs(apart[0] - round(apart[0])), abs(apart[1])) < CLOSE:
            return there
    return None


def are_same_orbit(one: Orbit, other: Orbit) -> bool:
    """Whether two orbits at the same values are one."""
    return one.word == other.word and bool(
        np.allclose(one.velocities, other.velocities, rtol=1e-9, atol=0.0)
    )


def _require_saddle(orbit: Orbit, where: str, least: float = 1.0) -> None:
    if not is_saddle(orbit, least):
        above = "above 1" if least > 0.0 else "outside the unit circle"
        accepted = f"give a physical orbit with one multiplier {above}, and the others within it"
        raise InputError(where, repr(orbit).partition("\n")[0], accepted)


def is_saddle(orbit: Orbit, least: float = 1.0) -> bool:
    """Whether an orbit is physical and unstable in one direction, with a positive multiplier unless
    less is admitted: with a negative one motion changes sides, so that no attractor ends on one of
    them."""
    first, second = orbit.multipliers[:2]
    unstable = first.imag == 0.0 and abs(first) > 1.0 and first.real > least
    return bool(orbit.physical and unstable and abs(second) < 1.0)


def _nearest(
    orbit: Orbit, attractor: Attractor, impacts: int, smooth: bool
) -> tuple[Connected, float] | None:
    """The physical connection that is nearest in the parameter to where an attractor was seen."""
    assert attractor.state is not None
    simulator = Simulator(orbit.model, orbit.problem.kernels)
    run = simulator.run(attractor.state, impacts=impacts)
    entries = _entries(run, orbit)
    if not entries or len(_sides_of(entries)) > 1:
        return None
    guesses = _guesses(simulator, orbit, orbit, run, entries, _touching if smooth else _paths)
    if smooth:
        sides = _sides_of(entries)
        leaving = _manifold_runs(simulator, orbit, LEAVING, sides, STARTS, RETURN)
        guesses = chain(_returning(orbit, orbit, leaving), guesses)
    paths = [path for path in _solutions(orbit, guesses, set()) if is_physical(path)]
    found = dict[Word, tuple[Connected, float]]()
    for path in sorted(paths, key=lambda p: abs(p.unknowns[-1] - orbit.value)):
        leaves = path.problem.before
        known = any(is_rotation(leaves.walls, word.walls) for word in found)
        if not known and (longer := refined(path)) is not None and is_physical(longer[0]):
            found[leaves] = longer
        if len(found) == REFINED:
            break
    return min(found.values(), key=lambda f: abs(f[0].unknowns[-1] - orbit.value), default=None)


def _touching_before(
    best: tuple[Connected, float], orbit: Orbit, attractor: Attractor, impacts: int
) -> tuple[tuple[Connected, float], Orbit, Attractor] | None:
    """A connection that is met before another one, and the orbit and the attractor where this has
    been seen to last; None if there is none.

    It has the last impacts of the other one, or of the nearest arrivals at the orbit among ten
    times as many impacts, after laps of orbits that the motion has followed.
    """
    value = float(best[0].unknowns[-1])
    lasting = _nearer(orbit, attractor, value, RUNS * RETURNING)
    orbit, attractor = lasting or (orbit, attractor)
    assert attractor.state is not None
    simulator = Simulator(orbit.model, orbit.problem.kernels)
    run = simulator.run(attractor.state, impacts=RUNS * impacts)
    entries = _entries(run, orbit)
    sides, followed = _sides_of(entries), _followed(run)

    def ahead(path: Connected) -> float:
        return (float(path.unknowns[-1]) - orbit.value) * float(np.sign(value - orbit.value))

    def before(paths: Iterable[Connected], most: float) -> list[Connected]:
        met = [path for path in paths if 0.0 < ahead(path) < most and is_physical(path)]
        met = [path for path in met if _side_left(path, orbit) in {None, *sides}]
        return sorted(met, key=ahead)

    arriving = _guesses(simulator, orbit, orbit, run, entries, _touching)
    tried = set[tuple[str, int | None]]()
    starts = [best[0], *before(_solutions(orbit, arriving, tried), np.inf)[:BEGUN]]
    found = best
    while starts:
        guesses = [g for s in starts for g in _beginning_otherwise(s, followed, run.period)]
        others = _solutions(orbit, guesses, tried, len(tried) + len(guesses))
        nearer = before([*starts, *others], ahead(found[0]))
        starts = []
        for path in nearer[:REFINED]:
            longer = refined(path)
            if longer is None or not is_physical(longer[0]):
                continue
            if ahead(longer[0]) < ahead(found[0]) - longer[1] - found[1]:
                found, starts = longer, [longer[0]]
                break
    return None if found is best else (found, orbit, attractor)


def _followed(run: Run) -> list[tuple[Array, Word]]:
    """A lap of each of the shortest orbits that a run has followed, and their words."""
    text, found = run.word, dict[str, tuple[Array, Word]]()
    rows = np.column_stack([run.times, run.velocities])
    fastest = float(np.max(np.abs(run.velocities)))
    for lap in range(1, SHORTEST + 1):
        turns = (run.times[lap:] - run.times[:-lap]) / run.period
        apart = np.abs(turns - np.round(turns))
        apart += np.abs(run.velocities[lap:] - run.velocities[:-lap]) / fastest
        for row in np.argsort(apart).tolist():
            if apart[row] > CLOSE:
                break
            word = text[row : row + lap]
            name = min(word[k:] + word[:k] for k in range(lap))
            repeated = any(word == word[:m] * (lap // m) for m in range(1, lap))
            if name not in found and not repeated and text[row + lap] == word[0]:
                found[name] = rows[row : row + lap], Word(word, max(round(float(turns[row])), 1))
    return list(found.values())


def _beginning_otherwise(
    path: Connected, followed: Sequence[tuple[Array, Word]], period: float
) -> Iterator[Guess]:
    """Return paths with as few as one of the last impacts of another one, after laps of orbits that
    are near to its impacts there."""
    walls, rows, after = path.problem.walls, path.impacts, path.problem.after.walls
    arrival = len(walls)
    while walls[:arrival].endswith(after):
        arrival -= len(after)
    fastest = float(np.max(np.abs(rows[:, 1])))
    for (lap, word), place in product(followed, range(max(arrival - DEPTH, 1), arrival)):
        turns = (rows[place, 0] - lap[:, 0]) / period
        apart = np.abs(turns - np.round(turns)) + np.abs(rows[place, 1] - lap[:, 1]) / fastest
        apart[[wall != walls[place] for wall in word.walls]] = np.inf
        first = int(np.argmin(apart))
        if apart[first] < JOINED:
            shift = np.array([word.period * period, 0.0])
            begun = np.vstack([lap[first:], lap[:first] + shift])
            begun[:, 0] += period * np.round(turns[first])
            laps = [begun - number * shift for number in range(LAPS, 0, -1)]
            own = Word(word.walls[first:] + word.walls[:first], word.period)
            if own.walls * LAPS + walls[place:] in after * len(walls):
                continue
            yield own.walls * LAPS + walls[place:], None, np.vstack([*laps, rows[place:]]), own


def _nearer(
    orbit: Orbit, attractor: Attractor, value: float, lasting: int = 0
) -> tuple[Orbit, Attractor] | None:
    """The orbit and the attractor nearer to a crisis; None if the attractor is not seen there, for
    as many impacts."""
    for part in NEARER:
        near = value + part * (orbit.value - value)
        here = solve_near(orbit.problem, np.append(orbit.unknowns[:-1], near))
        if here is None:
            continue
        there = Orbit(orbit.problem, here)
        simulator = Simulator(there.model, orbit.problem.kernels)
        found: Attractor | None = settle(simulator, attractor.state, PATIENT)
        if found is not None and found.kind is not Kind.COMPLEX:
            found = _beside(simulator, there, PATIENT)
        if found is not None and (not lasting or _lasts(there, found, lasting)):
            return there, found
    return None


def _beside(simulator: Simulator, orbit: Orbit, settling: Settling = SETTLING) -> Attractor | None:
    """The complex motion to which the unstable manifold of an orbit leads, if there is one."""
    sides = _sides(simulator, orbit, settling)
    return next((found for found in sides if found.kind is Kind.COMPLEX), None)


def _sides(simulator: Simulator, orbit: Orbit, settling: Settling) -> Iterator[Attractor]:
    """What the motions settle on that leave an orbit along its unstable manifold to both sides."""
    _, right, _ = unstable_direction(orbit.linearisation)
    wall = orbit.word.walls[0]
    for side in (BESIDE, -BESIDE):
        time, velocity = orbit.times[0] + side * right[0], orbit.velocities[0] + side * right[1]
        yield settle(simulator, simulator.state(wall, time, velocity), settling)


# From a run to paths that are nearly connections.


Guess = tuple[str, int | None, Array, Word]
"""The walls of a path, the impact that grazes or None, the impacts, and the orbit it leaves."""


def _solutions(
    orbit: Orbit, guesses: Iterable[Guess], tried: set[tuple[str, int | None]], most: int = PATHS
) -> Iterator[Connected]:
    """Solve for the connections to an orbit that guesses are close to, of each kind once."""
    for walls, grazing, impacts, before in guesses:
        if len(tried) >= most:
            break
        if (walls, grazing) in tried:
            continue
        tried.add((walls, grazing))
        given = orbit.model, orbit.problem.kernels, walls, grazing, before, orbit.word
        if (path := solve(Connection(*given), np.append(impacts.ravel(), orbit.value))) is not None:
            yield path


def _guesses(
    simulator: Simulator,
    leaves: Orbit,
    orbit: Orbit,
    run: Run,
    entries: dict[int, float],
    paths_of: Callable[[Simulator, Orbit, str, Array], Iterator[Guess]],
) -> Iterator[Guess]:
    """Return paths near to arrivals of a run at an orbit.

    They leave the first orbit, or one that the motion has followed.
    """
    text, times = run.word, run.times
    for entry in entries:
        part = slice(entry - BEFORE, entry)
        rows = np.column_stack([times[part], run.velocities[part]])
        rows[:, 0] -= run.period * np.floor(rows[0, 0] / run.period)
        arrival = rows[-1, 0] + times[entry] - times[entry - 1]
        rows = np.vstack([rows, *_laps(orbit, 0, arrival, range(LAPS))])
        made = text[part] + orbit.word.walls * LAPS
        yield from paths_of(simulator, leaves, made, rows)


def _manifold_runs(
    simulator: Simulator,
    orbit: Orbit,
    beside: float,
    sides: Iterable[float],
    starts: int,
    impacts: int,
) -> Iterator[tuple[Array, Run]]:
    """Return motions from all along the unstable manifold of an orbit, and their first impacts."""
    factor, right, _ = unstable_direction(orbit.linearisation)
    for number, side in product(range(starts), sides):
        away = side * beside * abs(factor) ** (number / starts)
        first = np.array([orbit.times[0], orbit.velocities[0]]) + away * right
        state = simulator.state(orbit.word.walls[0], *first.tolist())
        yield first, simulator.run(state, impacts=impacts)


def _returning(leaves: Orbit, orbit: Orbit, runs: Iterable[tuple[Array, Run]]) -> Iterator[Guess]:
    """Return paths along the unstable manifold of one orbit that come nearest to the stable one of
    another after as many impacts."""
    nearest = dict[int, tuple[float, Array, str]]()
    lap = len(orbit.word)
    for first, run in runs:
        for row, far in _entries(run, orbit, len(leaves.word)).items():
            if row not in nearest or abs(far) < nearest[row][0]:
                end = row + lap
                rows = np.column_stack([run.times[:end], run.velocities[:end]])
                laps = _laps(orbit, 0, run.times[row] + orbit.period, range(LAPS))
                nearest[row] = abs(far), np.vstack([first, rows, *laps]), run.word[:end]
    for _, rows, text in sorted(nearest.values(), key=lambda near: near[0])[:RETURNS]:
        yield leaves.word.walls[0] + text + orbit.word.walls * LAPS, None, rows, leaves.word


def _laps(orbit: Orbit, first: int, time: float, numbers: Iterable[int]) -> list[Array]:
    """Return the impacts of laps of an orbit, each from one of its impacts on, which lap number 0
    makes at about a time."""
    forcing = orbit.problem.period(orbit.unknowns)
    lap = np.column_stack([orbit.times, orbit.velocities])
    lap[:first, 0] += orbit.period
    lap = np.roll(lap, -first, axis=0)
    lap[:, 0] += forcing * round((time - lap[0, 0]) / forcing)
    return [lap + np.array([number * orbit.period, 0.0]) for number in numbers]


def _entries(run: Run, orbit: Orbit, first: int = BEFORE) -> dict[int, float]:
    """Rows of a run, from a first one on, from which it follows an orbit, and how far it is there
    from the stable manifold, those nearest to it first.

    The distance is that from the manifold's tangent, taken a lap later where the run follows the
    orbit for so long: there the motion is nearer to the orbit by its small multiplier.
    """
    word, lap, text = orbit.word.walls, len(orbit.word), run.word
    factor, _, left = unstable_direction(orbit.linearisation)
    for laps in (2, 1):
        rows = [i for i in range(len(text)) if text.startswith(word * laps, i)]
        if len(rows) < ARRIVALS and laps > 1:
            continue
        at = np.array(rows, dtype=int) + (laps - 1) * lap
        away = _away(orbit, left, run.phases[at], run.velocities[at])
        known = dict(zip(rows, (away / factor ** (laps - 1)).tolist(), strict=True))
        break
    entries = [
        row
        for row, far in known.items()
        if row >= first
        and abs(far) < abs(known.get(row - lap, np.inf))
        and abs(far) <= abs(known.get(row + lap, np.inf))
    ]
    nearest = sorted(entries, key=lambda row: abs(known[row]))[:ENTRIES]
    return {row: known[row] for row in nearest}


def _away(orbit: Orbit, left: Array, times: Any, velocities: Any) -> Any:
    """How far impacts are from the tangent of an orbit's stable manifold at its first impact."""
    period = orbit.problem.period(orbit.unknowns)
    apart = times - orbit.times[0]
    apart -= period * np.round(apart / period)
    return left[0] * apart + left[1] * (velocities - orbit.velocities[0])


def _side_left(path: Connected, orbit: Orbit) -> float | None:
    """The side of its stable manifold to which a path leaves an orbit, as a sign; None if it leaves
    another orbit."""
    before = path.problem.before.walls
    here = _end_of(path, orbit, 0)
    if here is None:
        return None
    laps = 0
    while path.problem.walls.startswith(before, (laps + 1) * len(before)):
        laps += 1
    _, _, left = unstable_direction(here.linearisation)
    rows = path.impacts[(laps - 1) * len(before) : laps * len(before)]
    forcing = orbit.problem.period(orbit.unknowns)
    turns = (rows[:, 0] - here.times[0]) / forcing
    apart = np.abs(turns - np.round(turns))
    apart[[wall != here.word.walls[0] for wall in before]] = np.inf
    time, velocity = rows[int(np.argmin(apart))]
    return float(np.sign(_away(here, left, time, velocity)))


def _sides_of(entries: dict[int, float]) -> set[float]:
    """The sides of a stable manifold on which the nearest arrivals are, as signs."""
    return set(np.sign(list(entries.values())[:ARRIVALS]).tolist())


def _paths(simulator: Simulator, orbit: Orbit, walls: str, rows: Array) -> Iterator[Guess]:
    """Return paths near to an arrival: those that leave the orbit itself, and the one that leaves
    the orbit which the motion has followed before."""
    for place, time, wall in _nearly_grazing(simulator, walls, rows):
        path, impacts = walls, rows
        if time is not None:
            path = walls[:place] + wall + walls[place:]
            impacts = np.insert(rows, place, [time, 0.0], axis=0)
        yield from _leaving(orbit, path, place, impacts)
        if (tail := _tail(path[:place], impacts[:place, 0], simulator.period)) is not None:
            begin, before = tail
            yield path[begin:], place - begin, impacts[begin:], before


def _touching(simulator: Simulator, orbit: Orbit, walls: str, rows: Array) -> Iterator[Guess]:
    """Return paths near to an arrival without a grazing, from the orbits that the motion has
    followed before."""
    followed = dict[str, tuple[float, int, Word]]()
    for place in range(BEFORE - DEPTH + 1, BEFORE + 1):
        tail = _tail(walls[:place], rows[:place, 0], simulator.period)
        if tail is not None:
            begin, before = tail
            lap = len(before)
            change = abs(rows[place - 1, 1] - rows[place - 1 - lap, 1])
            name = min(before.walls[k:] + before.walls[:k] for k in range(lap))
            nearest = followed.get(name, (np.inf, 0, before))
            followed[name] = min(nearest, (change, begin, before))
    for _, begin, before in followed.values():
        yield walls[begin:], None, rows[begin:], before


def _leaving(orbit: Orbit, walls: str, grazing: int, rows: Array) -> Iterator[Guess]:
    """Return paths that follow an orbit until a few impacts before they graze."""
    lap, own = len(orbit.word), orbit.word.walls
    for begin in range(grazing - lap, grazing):
        for first in range(lap):
            word = own[first:] + own[:first]
            if word[0] == walls[begin]:
                laps = _laps(orbit, first, rows[begin, 0], range(-LAPS, 0))
                path, place = word * LAPS + walls[begin:], LAPS * lap + grazing - begin
                yield path, place, np.vstack([*laps, rows[begin:]]), Word(word, orbit.word.period)


def _nearly_grazing(
    simulator: Simulator, walls: str, rows: Array
) -> list[tuple[int, float | None, str]]:
    """Where a path is nearest to a grazing: an impact, or the place, time and wall of a touch."""
    fastest = float(np.max(np.abs(rows[:, 1])))
    width = max(simulator.positions) - min(simulator.positions)
    span = rows[-1, 0] - rows[0, 0] + simulator.period
    gaps = interior_touches(simulator.kernels, walls, simulator.values, rows, span)
    found: list[tuple[float, int, float | None, str]] = []
    for k in range(BEFORE - DEPTH, BEFORE):
        found.append((abs(rows[k, 1]) / fastest, k, None, walls[k]))
        for touch in gaps[k].touches:
            if touch is not None:
                near = float(np.sqrt(max(touch.gap, 0.0) / width))
                found.append((near, k + 1, touch.time, touch.wall))
    return [(k, time, wall) for _, k, time, wall in sorted(found, key=lambda f: f[0])[:PLACES]]


def _tail(walls: str, times: Array, period: float) -> tuple[int, Word] | None:
    """Return where the laps begin that a path ends with, and the orbit of which they are laps.

    None if it ends with no word twice.
    """
    best: tuple[int, int] | None = None
    for lap in range(1, LONGEST_TAIL + 1):
        repeated = 0
        while repeated < len(walls) - lap and walls[-1 - repeated] == walls[-1 - repeated - lap]:
            repeated += 1
        turns = (times[-1] - times[-1 - lap]) / period
        closes = round(turns) >= 1 and abs(turns - round(turns)) < 0.25
        if closes and repeated > lap and (best is None or repeated + lap > sum(best) + 1):
            best = repeated, lap
    if best is None:
        return None
    repeated, lap = best
    begin = len(walls) - min(repeated + lap, LAPS * lap + 1)
    periods = round((times[-1] - times[-1 - lap]) / period)
    return begin, Word(walls[begin : begin + lap], periods)


# Whether a path is one of the motion, and what follows it.


def is_physical(path: Connected) -> bool:
    """Whether simulated flights repeat a path, its grazing passed by or touched."""
    problem, rows = path.problem, path.impacts.tolist()
    model = problem.model.replace(
        **dict(zip(problem.kernels.parameters, path.unknowns[problem.n :].tolist(), strict=True))
    )
    simulator = Simulator(model, problem.kernels)
    numbers = [simulator.letters.index(wall) for wall in problem.walls]
    for k, (wall, row) in enumerate(zip(numbers[:-1], rows[:-1], strict=True)):
        phase = row[0] % simulator.period
        if k == problem.grazing:
            if simulator.pressed(wall, phase)[0]:
                return False
            continue
        _, dt, _ = simulator.fly(wall, phase, row[1])
        following = rows[k + 1 : k + 3] if k + 1 == problem.grazing else rows[k + 1 : k + 2]
        if not min(abs(dt - (later[0] - row[0])) for later in following) < SAME_FLIGHT:
            return False
    return True


def _crisis(
    orbit: Orbit, attractor: Attractor, path: Connected, error: float, beyond: float
) -> Crisis | NoCrisis:
    """Describe a crisis: the orbit there, and what the motion settles on beyond."""
    value = float(path.unknowns[-1])
    here = solve_near(orbit.problem, np.append(orbit.unknowns[:-1], value))
    there = Orbit(orbit.problem, here) if here is not None else orbit
    model = orbit.model.replace(**{orbit.parameter: beyond})
    kernels = orbit.problem.kernels
    simulator = Simulator(model, kernels)
    after = settle(simulator, attractor.state, PATIENT)
    type_: str | None = None
    touches = f"where a manifold touches that of {orbit.notation}, at {value:.15g}"
    made = 0
    while made < RUNS * RETURNING:
        if after.kind is not Kind.COMPLEX or after.state is None:
            break
        if passes_and_returns(orbit, after, beyond):
            if not _has_widened(orbit, attractor, simulator, after):
                reached = f"motion beyond passes the orbit, at {beyond:.9g}, to where it was before"
                return NoCrisis(f"{touches}, no attractor changes: {reached}")
            type_ = "merging" if _parts_two(orbit) else "interior"
            break
        end = simulator.run(after.state, impacts=RETURNING, record=False).end
        made += RETURNING
        after = settle(simulator, end)
    else:
        seen = f"motion stays complex, and does not pass the orbit at {beyond:.9g}"
        return NoCrisis(f"{touches}, no attractor changes: {seen}, in {RUNS * RETURNING} impacts")
    lasting = RUNS * RETURNING
    if after.kind not in (Kind.COMPLEX, Kind.NOT_SETTLED):
        type_ = "boundary"
        lasting = min(lasting, RUNS * (made + math.ceil(after.periods * attractor.rate)))
    if not _lasts(orbit, attractor, lasting):
        beside = f"motion at {orbit.value:.9g} is a transient, too, over in {lasting} impacts"
        return NoCrisis(f"{touches}, no attractor ends: {beside}")
    names = attractor.notation, type_, after.notation
    return Crisis(orbit.parameter, value, error, *names, orbit.value, there, path, there.model)


def _has_widened(
    orbit: Orbit, attractor: Attractor, simulator: Simulator, after: Attractor
) -> bool:
    """Whether complex motion beyond a crisis reaches where the attractor was not before."""
    before = Simulator(orbit.model, orbit.problem.kernels)
    runs = [
        (one, at.run(one.state, impacts=RETURNING))
        for at, one in ((before, attractor), (simulator, after))
        if one.state is not None
    ]
    known, reached = (
        replace(one, walls=run.walls, times=run.times, velocities=run.velocities)
        for one, run in runs
    )
    furthest = partial(np.quantile, q=1.0 - RARE)
    beyond, within = distances_between(reached, known, RETURNING, furthest)
    return beyond > WIDER * within


def _lasts(orbit: Orbit, attractor: Attractor, impacts: int) -> bool:
    """Whether complex motion stays so for as many impacts: close to a crisis it may be a transient
    already."""
    assert attractor.state is not None
    simulator = Simulator(orbit.model, orbit.problem.kernels)
    end = simulator.run(attractor.state, impacts=impacts, record=False).end
    return end is not None and settle(simulator, end).kind is Kind.COMPLEX


def _parts_two(orbit: Orbit) -> bool:
    """Whether an orbit's unstable manifold leads to one complex attractor on one side, and to
    another one on the other."""
    simulator = Simulator(orbit.model, orbit.problem.kernels)
    one, other = _sides(simulator, orbit, PATIENT)
    both = one.kind is other.kind is Kind.COMPLEX
    return both and not same_attractor(one, other)


def passes_and_returns(orbit: Orbit, after: Attractor, value: float) -> bool:
    """Whether complex motion at a value comes near to an orbit on both sides of its stable
    manifold, and is complex still."""
    here = solve_near(orbit.problem, np.append(orbit.unknowns[:-1], value))
    if here is None or after.state is None:
        return False
    there = Orbit(orbit.problem, here)
    simulator = Simulator(there.model, orbit.problem.kernels)
    run = simulator.run(after.state, impacts=RETURNING)
    if run.end is None or len(_sides_of(_entries(run, there))) < 2:
        return False
    return settle(simulator, run.end).kind is Kind.COMPLEX
