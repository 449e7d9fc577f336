"""Crises and tangencies located from simulated motion.

The equations are in `contimpact.bifurcations.crisis`. What they lack is a path to start from: a
stretch of simulated complex motion, taken in `connection_paths`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from typing import Any

import numpy as np

from ..arrays import Array
from ..bifurcations.crisis import Connected, refined, unstable_direction
from ..errors import InputError, explain_arguments, require_whole
from ..models.guards import Word, is_rotation
from ..models.model import Model
from ..orbits.orbit import Orbit
from ..results.branch import Entry
from ..results.options import SETTLING, Settling
from ..segments.kernels import Kernels
from ..simulation.attractor import Attractor, Kind, distances_between
from ..simulation.run import Run, State
from ..simulation.settle import settle
from ..simulation.simulator import Simulator, has_several_coordinates
from ..simulation.sweep import same_attractor
from .connection_paths import (
    CLOSE,
    connections_of,
    end_of,
    entries_of,
    followed_orbits,
    grazing_paths,
    guesses_of,
    is_physical,
    manifold_runs,
    orbit_near,
    passage_of,
    paths_beginning_with,
    returning_paths,
    side_left,
    sides_of,
    touching_paths,
)

CR = "CR"
"""Kind of their entries."""
CONNECTION = (
    *("attractor", "type", "after", "seen", "lasted", "leaves", "homoclinic", "walls", "grazing"),
    *("times", "velocities"),
)
"""What a crisis has besides its orbit, as its entry keeps it."""
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
LONGER = 0.25, 64
"""At this part of a distance beyond a crisis motion lasts so many times as long at most: transients
become longer by the distance's third power, or less."""
RUNS = 10
"""As many times that, after which no attractor has changed; and as many times the impacts in which
motion leaves beyond a crisis, which the attractor has to last beside it."""
TRIALS = 8
"""How often a crisis is looked for again, nearer by."""
LEAVING, STARTS, RETURN = 1e-4, 64, 200
"""How far beside an orbit motions start on a side of it, from all along its unstable manifold, how
many and for how many impacts."""
LASTING, STRETCH = 10_000_000, 500_000
"""Impacts which the attractor has to last just before a crisis without a grazing, and after as many
of which it is looked whether it has ended: all where simulation is not compiled."""
ESCAPES, WAYS, LEFT = 8, 3, 2000
"""How often motion that leaves before is looked at, how many of its arrivals at the orbit, and how
many of its last impacts."""
REFINED = 4
"""Orbits left, of each of which the nearest path is lengthened: how near it is is known then."""


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
    lasted: int
    """Impacts for which it lasted there, or kept to one side of the orbit if it merges or widens,
    in one simulation."""
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
        names = ("label", "parameter", "value", "error")
        own = {name: getattr(self, name) for name in names}
        at = {"parameters": {**self.orbit.parameters}, "orbit": str(self.orbit.word)}
        return {"kind": CR, **own, **at, "branch": self.branch, **self.connection()}

    def connection(self) -> dict[str, Any]:
        """Return as plain data what a crisis has besides its orbit, as its entry keeps it."""
        found = {name: getattr(self, name) for name in CONNECTION}
        return found | {name: found[name].tolist() for name in ("times", "velocities")}

    @property
    def leaves(self) -> str:
        """The orbit that the connection leaves."""
        return str(self.path.problem.before)

    def __str__(self) -> str:
        kind = f", {self.type}" if self.type else ""
        place = f"{self.parameter} = {self.value:.15g} (+- {self.error:.1g})"
        text = f"{self.label} at {place}{kind}; beyond: {self.after}"
        if self.grazing is not None:
            return text
        lasted = f"motion lasted {self.lasted:.2g} impacts at {self.seen:.9g}"
        return f"{text}; {lasted}: a rarer tangency may end it before"


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
    require_whole(impacts, "impacts")
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
    begun, first = orbit.value, (orbit, attractor)
    for _ in range(TRIALS):
        nearest = _nearest(orbit, attractor, impacts, smooth)
        if best is not None:
            path, error = best
            value = float(path.unknowns[-1])
            left = (value - orbit.value) * np.sign(value - begun)
            ahead = abs(float(nearest[0].unknowns[-1]) - orbit.value) if nearest else np.inf
            near = 0.0 < left <= ahead + 2.0 * error and left <= NEAR * abs(value - begun)
            if near and smooth:
                return _approach_outermost(*first, best, impacts)
            if near and nearest is not None:
                return _crisis(orbit, attractor, path, error, 2.0 * value - begun)
            if not 0.0 < left <= ahead:
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
        return NoCrisis(f"{none}, or the motion sticks or comes near to that orbit on both sides")
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
    require_whole(starts, "starts")
    arrives = arrives or leaves
    for name, orbit in (("leaves", leaves), ("arrives", arrives)):
        require_one_coordinate(orbit.model, orbit.problem.kernels, name)
        _require_saddle(orbit, name, -np.inf)
    if leaves.parameters != arrives.parameters or leaves.parameter != arrives.parameter:
        accepted = "give orbits at the same values, with the same parameter"
        raise InputError("arrives", f"{arrives.notation} at other values", accepted)
    simulator = Simulator(leaves.model, leaves.problem.kernels)
    found = list[Tangency]()
    runs = list(manifold_runs(simulator, leaves, BESIDE, (1.0, -1.0), starts, impacts))
    given = simulator, leaves, arrives
    with_grazing = (
        guesses_of(*given, run, entries_of(run, arrives), grazing_paths) for _, run in runs
    )
    for guesses in (chain(*with_grazing), returning_paths(leaves, arrives, runs)):
        for path in connections_of(arrives, guesses, set()):
            end = end_of(path, arrives, -1)
            begin = end_of(path, leaves, 0)
            if end is None or begin is None or not is_physical(path):
                continue
            if any(_grazes(orbit) for orbit in (begin, end)):
                continue  # a motion along the orbit, which itself grazes there
            longer = refined(path)
            if longer is not None and is_physical(longer[0]):
                value, error = float(longer[0].unknowns[-1]), longer[1]
                if not any(abs(t.value - value) <= t.error + error for t in found):
                    found.append(Tangency(leaves.parameter, value, error, begin, end, longer[0]))
    return sorted(found, key=lambda t: abs(t.value - leaves.value))


def _grazes(orbit: Orbit) -> bool:
    """Whether an orbit touches a wall, to rounding, or passes it."""
    least = 1e-9 * orbit.period * float(np.max(np.abs(orbit.velocities)))
    return not orbit.physical or orbit.smallest_gap < least


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
    entries = {} if run.released.any() else entries_of(run, orbit)
    if not entries or len(sides_of(entries)) > 1:
        return None
    guesses = guesses_of(
        simulator, orbit, orbit, run, entries, touching_paths if smooth else grazing_paths
    )
    if smooth:
        sides = sides_of(entries)
        leaving = manifold_runs(simulator, orbit, LEAVING, sides, STARTS, RETURN)
        guesses = chain(returning_paths(orbit, orbit, leaving), guesses)
    paths = [path for path in connections_of(orbit, guesses, set()) if is_physical(path)]
    found = dict[Word, tuple[Connected, float]]()
    for path in sorted(paths, key=lambda p: abs(p.unknowns[-1] - orbit.value)):
        leaves = path.problem.before
        known = any(is_rotation(leaves.walls, word.walls) for word in found)
        if not known and (longer := refined(path)) is not None and is_physical(longer[0]):
            found[leaves] = longer
        if len(found) == REFINED:
            break
    return min(found.values(), key=lambda f: abs(f[0].unknowns[-1] - orbit.value), default=None)


def _approach_outermost(
    orbit: Orbit, attractor: Attractor, best: tuple[Connected, float], impacts: int
) -> Crisis | NoCrisis:
    """Locate a crisis without a grazing from a tangency on: until the attractor lasts just before.

    Where it does not, the motion that leaves has the path of a tangency that was met before.
    """
    assert attractor.state is not None
    simulator = Simulator(orbit.model, orbit.problem.kernels)
    run = simulator.run(attractor.state, impacts=impacts)
    sides, followed = sides_of(entries_of(run, orbit)), followed_orbits(run)
    best, number, reason = _before(orbit, best, [best[0]], sides, followed), 0, ""
    for _ in range(ESCAPES):
        path, error = best
        value = float(path.unknowns[-1])
        near = _nearer(orbit, attractor, value)
        near = near and _nearer(*near, value)
        reason = f"the attractor was not seen near to a tangency at {value:.9g}"
        if near is None or abs(value - near[0].value) > NEAR * abs(value - orbit.value):
            break
        lasted, escape = escape_from(*near, number)
        if escape is None:
            return _crisis(*near, path, error, 2.0 * value - orbit.value, lasted)
        ways = [
            way
            for entry, far in entries_of(escape, near[0]).items()
            if np.sign(far) not in sides and (way := passage_of(near[0], escape, entry))
        ]
        found = _before(orbit, best, ways[:WAYS], sides, followed)
        number = number + 1 if found is best else 0
        best = found
        reason = f"motion at {near[0].value:.9g} is a transient, over in {lasted} impacts"
    return NoCrisis(f"{reason}; no tangency was found before which it lasts")


def _before(
    orbit: Orbit,
    best: tuple[Connected, float],
    starts: Sequence[Connected],
    sides: set[float],
    followed: Sequence[tuple[Array, Word]],
) -> tuple[Connected, float]:
    """The first connection that has the last impacts of one of some paths, after laps of orbits
    that the motion has followed; the one known if none is met before it."""
    sign = float(np.sign(best[0].unknowns[-1] - orbit.value))
    period = Simulator(orbit.model, orbit.problem.kernels).period

    def ahead(path: Connected) -> float:
        return (float(path.unknowns[-1]) - orbit.value) * sign

    tried = set[tuple[str, int | None]]()
    while starts := [path for path in starts if ahead(path) > 0.0]:
        guesses = [guess for s in starts for guess in paths_beginning_with(s, followed, period)]
        others = connections_of(orbit, guesses, tried, len(tried) + len(guesses))
        met = [path for path in others if ahead(path) > 0.0 and is_physical(path)]
        met = [path for path in met if side_left(path, orbit) in {None, *sides}]
        starts = []
        for path in sorted(met, key=ahead)[:REFINED]:
            longer = refined(path)
            if longer is None or not is_physical(longer[0]):
                continue
            if 0.0 < ahead(longer[0]) < ahead(best[0]) - longer[1] - best[1]:
                best, starts = longer, [longer[0]]
    return best


def escape_from(orbit: Orbit, attractor: Attractor, number: int) -> tuple[int, Run | None]:
    """How many impacts motion on an attractor lasts, from one of its impacts on, and its last ones
    if it ends."""
    simulator = Simulator(orbit.model, orbit.problem.kernels)
    wall, made = simulator.letters[attractor.walls[number]], 0
    state = simulator.state(wall, attractor.times[number], attractor.velocities[number])
    most = LASTING if simulator.machine.batch(LASTING) else STRETCH
    while made < most:
        end = simulator.run(state, impacts=STRETCH, record=False).end
        after = settle(simulator, end) if end else None
        if end is None or after is None or after.kind not in (Kind.COMPLEX, Kind.NOT_SETTLED):
            run = simulator.run(state, impacts=STRETCH)
            lap = len(after.walls) if after and after.kind is Kind.PERIODIC else 1
            apart = np.abs(run.velocities[lap:] - run.velocities[:-lap])
            moving = np.flatnonzero(apart > CLOSE * np.max(np.abs(run.velocities)))
            last = int(np.max(moving, initial=0))
            part = slice(max(last - LEFT, 0), last + RETURN)
            names = "walls", "turns", "phases", "velocities", "released"
            return made + last, replace(run, **{n: getattr(run, n)[part] for n in names})
        state, made = end, made + STRETCH
    return made, None


def _nearer(orbit: Orbit, attractor: Attractor, value: float) -> tuple[Orbit, Attractor] | None:
    """The orbit and the attractor nearer to a crisis; None if the attractor is not seen there."""
    for part in NEARER:
        there = orbit_near(orbit, value + part * (orbit.value - value))
        if there is None:
            continue
        simulator = Simulator(there.model, orbit.problem.kernels)
        found: Attractor | None = settle(simulator, attractor.state, PATIENT)
        if found is not None and found.kind is not Kind.COMPLEX:
            found = _beside(simulator, there, PATIENT)
        if found is not None:
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


# What follows a path.


def _crisis(
    orbit: Orbit,
    attractor: Attractor,
    path: Connected,
    error: float,
    beyond: float,
    lasted: int = 0,
) -> Crisis | NoCrisis:
    """Describe a crisis: the orbit there, and what the motion settles on beyond."""
    value = float(path.unknowns[-1])
    there = orbit_near(orbit, value) or orbit
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
            one, other = _sides(Simulator(orbit.model, kernels), orbit, PATIENT)
            two = one.kind is other.kind is Kind.COMPLEX and not same_attractor(one, other)
            type_ = "merging" if two else "interior"  # an attractor on either side, or one
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
        near = orbit_near(orbit, value + LONGER[0] * (beyond - value))
        most = LASTING if simulator.machine.batch(LASTING) else STRETCH
        most = min(most, LONGER[1] * lasting)
        if near is not None and _lasts(near, attractor, most, keeping=False):
            lives = f"motion beyond, at {near.value:.9g}, stays complex for {most} impacts"
            return NoCrisis(f"{touches}, no attractor ends: {lives}")
    keeping = type_ in ("interior", "merging")
    if keeping or lasted < lasting:
        if not keeping and simulator.machine.batch(LASTING):
            lasting = max(lasting, STRETCH)
        lasted = lasting if _lasts(orbit, attractor, lasting, keeping) else 0
    if not lasted:
        beside = f"motion at {orbit.value:.9g} is a transient, too, over in {lasting} impacts"
        return NoCrisis(f"{touches}, no attractor ends: {beside}")
    names = attractor.notation, type_, after.notation
    given = orbit.parameter, value, error, *names, orbit.value, lasted
    return Crisis(*given, there, path, there.model)


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


def _lasts(orbit: Orbit, attractor: Attractor, impacts: int, keeping: bool) -> bool:
    """Whether complex motion stays so for as many impacts, and keeps to one side of an orbit's
    stable manifold if asked: close to a crisis it may be a transient already."""
    simulator, end = Simulator(orbit.model, orbit.problem.kernels), attractor.state
    for _ in range(math.ceil(impacts / RETURNING) if keeping else 1):
        made = RETURNING if keeping else impacts
        run = simulator.run(end, impacts=made, record=keeping)
        end = run.end
        if end is None or (keeping and len(sides_of(entries_of(run, orbit))) > 1):
            return False
    return settle(simulator, end).kind is Kind.COMPLEX


def passes_and_returns(orbit: Orbit, after: Attractor, value: float) -> bool:
    """Whether complex motion at a value comes near to an orbit on both sides of its stable
    manifold, and is complex still."""
    there = orbit_near(orbit, value)
    if there is None or after.state is None:
        return False
    simulator = Simulator(there.model, orbit.problem.kernels)
    run = simulator.run(after.state, impacts=RETURNING)
    if run.end is None or len(sides_of(entries_of(run, there))) < 2:
        return False
    return settle(simulator, run.end).kind is Kind.COMPLEX
