"""Paths from which connections of unstable orbits are solved for, taken from simulated motion.

A path leaves an orbit, or follows one for some laps, may graze, and comes nearest to the stable
manifold of another orbit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import product
from typing import Any

import numpy as np

from ..arrays import Array
from ..bifurcations.crisis import Connected, Connection, Passage, solve, unstable_direction
from ..models.guards import Word, is_rotation
from ..orbits.orbit import Orbit
from ..orbits.search import solve_near
from ..segments.touches import interior_touches
from ..simulation.run import Run
from ..simulation.simulator import Simulator

DEPTH = 24
"""Impacts before the arrival at the orbit among which the one that grazes is looked for."""
PLACES = 4
"""Places on a path at which a grazing is tried: those where it is nearest to one."""
LAPS = 3
"""Laps of the first orbit that are taken from a simulated path, and of the last one at least."""
CLOSING, MOST = 1e-10, 12
"""What so many laps of the last orbit may leave of the unwanted direction, and how many are at most
taken: where fewer are, paths are not in the order in which their motions reach the orbit."""
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
RETURNS = 8
"""Paths taken from motions along an unstable manifold."""
SHORTEST, JOINED = 4, 0.25
"""Impacts at most of the orbits after which a path's last impacts are tried, and how near to the
path they are, in periods and in its largest velocity."""
SAME_FLIGHT = 1e-6
"""How well a simulated flight repeats one of a path, in periods; beside a grazing it does by the
square root of rounding."""


Guess = tuple[str, int | None, Array, Word]
"""The walls of a path, the impact that grazes or None, the impacts, and the orbit it leaves."""


def orbit_near(orbit: Orbit, value: float) -> Orbit | None:
    """Return the orbit next to one at a value of its parameter, if there is one."""
    here = solve_near(orbit.problem, np.append(orbit.unknowns[:-1], value))
    return None if here is None else Orbit(orbit.problem, here)


def connections_of(
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


def guesses_of(
    simulator: Simulator,
    leaves: Orbit,
    orbit: Orbit,
    run: Run,
    entries: dict[int, float],
    paths_of: Callable[[Simulator, Orbit, Orbit, str, Array], Iterator[Guess]],
) -> Iterator[Guess]:
    """Return paths near to arrivals of a run at an orbit.

    They leave the first orbit, or one that the motion has followed.
    """
    for entry in entries:
        yield from paths_of(simulator, leaves, orbit, *_arriving(orbit, run, entry))


def passage_of(orbit: Orbit, run: Run, entry: int) -> Connected | None:
    """Solve for the tangency of the manifold of motions that arrive at an orbit as a run does."""
    walls, rows = _arriving(orbit, run, entry)
    given = orbit.model, orbit.problem.kernels, walls, None, orbit.word, orbit.word
    problem = Passage(*given)
    problem.begun = float(rows[0, 0])
    return solve(problem, np.append(rows.ravel(), orbit.value))


def _arriving(orbit: Orbit, run: Run, entry: int) -> tuple[str, Array]:
    """The last impacts of a run before it arrives at an orbit, its lap beside that, in which it may
    graze, and laps of the orbit."""
    part = slice(entry - BEFORE, entry + len(orbit.word))
    rows = np.column_stack([run.times[part], run.velocities[part]])
    rows[:, 0] -= run.period * np.floor(rows[0, 0] / run.period)
    laps = last_laps(orbit)
    rows = np.vstack([rows, *_laps(orbit, 0, rows[BEFORE, 0], range(1, laps))])
    return run.word[part] + orbit.word.walls * (laps - 1), rows


def manifold_runs(
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


def returning_paths(
    leaves: Orbit, orbit: Orbit, runs: Iterable[tuple[Array, Run]]
) -> Iterator[Guess]:
    """Return paths along the unstable manifold of one orbit that come nearest to the stable one of
    another after as many impacts."""
    nearest = dict[int, tuple[float, Array, str]]()
    lap, last = len(orbit.word), last_laps(orbit)
    for first, run in runs:
        for row, far in entries_of(run, orbit, len(leaves.word)).items():
            if row not in nearest or abs(far) < nearest[row][0]:
                end = row + lap
                rows = np.column_stack([run.times[:end], run.velocities[:end]])
                laps = _laps(orbit, 0, run.times[row] + orbit.period, range(last))
                nearest[row] = abs(far), np.vstack([first, rows, *laps]), run.word[:end]
    for _, rows, text in sorted(nearest.values(), key=lambda near: near[0])[:RETURNS]:
        yield leaves.word.walls[0] + text + orbit.word.walls * last, None, rows, leaves.word


def last_laps(orbit: Orbit) -> int:
    """How many laps of an orbit a path ends with: after so many it may close in time alone."""
    first, second = np.abs(orbit.multipliers[:2])
    left = max(float(second / first), CLOSING)
    return min(max(math.ceil(math.log(CLOSING) / math.log(left)), LAPS), MOST)


def _laps(orbit: Orbit, first: int, time: float, numbers: Iterable[int]) -> list[Array]:
    """Return the impacts of laps of an orbit, each from one of its impacts on, which lap number 0
    makes at about a time."""
    forcing = orbit.problem.period(orbit.unknowns)
    lap = np.column_stack([orbit.times, orbit.velocities])
    lap[:first, 0] += orbit.period
    lap = np.roll(lap, -first, axis=0)
    lap[:, 0] += forcing * round((time - lap[0, 0]) / forcing)
    return [lap + np.array([number * orbit.period, 0.0]) for number in numbers]


def entries_of(run: Run, orbit: Orbit, first: int = BEFORE) -> dict[int, float]:
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


def side_left(path: Connected, orbit: Orbit) -> float | None:
    """The side of its stable manifold to which a path leaves an orbit, as a sign; None if it leaves
    another orbit."""
    before = path.problem.before.walls
    here = end_of(path, orbit, 0)
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


def sides_of(entries: dict[int, float]) -> set[float]:
    """The sides of a stable manifold on which the nearest arrivals are, as signs."""
    return set(np.sign(list(entries.values())[:ARRIVALS]).tolist())


def grazing_paths(
    simulator: Simulator, leaves: Orbit, orbit: Orbit, walls: str, rows: Array
) -> Iterator[Guess]:
    """Return paths near to an arrival at an orbit: those that leave the first one, and the one that
    leaves the orbit which the motion has followed before."""
    for place, time, wall in _nearly_grazing(simulator, orbit, walls, rows):
        path, impacts = walls, rows
        if time is not None:
            path = walls[:place] + wall + walls[place:]
            impacts = np.insert(rows, place, [time, 0.0], axis=0)
        yield from _leaving(leaves, path, place, impacts)
        if (tail := _tail(path[:place], impacts[:place, 0], simulator.period)) is not None:
            begin, before = tail
            yield path[begin:], place - begin, impacts[begin:], before


def touching_paths(
    simulator: Simulator, leaves: Orbit, orbit: Orbit, walls: str, rows: Array
) -> Iterator[Guess]:
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
    simulator: Simulator, orbit: Orbit, walls: str, rows: Array
) -> list[tuple[int, float | None, str]]:
    """Where a path is nearest to a grazing: an impact, or the place, time and wall of a touch."""
    fastest = float(np.max(np.abs(rows[:, 1])))
    width = max(simulator.positions) - min(simulator.positions)
    span = rows[-1, 0] - rows[0, 0] + simulator.period
    gaps = interior_touches(simulator.kernels, walls, simulator.values, rows, span)
    found: list[tuple[float, int, float | None, str]] = []
    for k in range(BEFORE - DEPTH, BEFORE + len(orbit.word)):
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


def followed_orbits(run: Run) -> list[tuple[Array, Word]]:
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


def paths_beginning_with(
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


def end_of(path: Connected, orbit: Orbit, place: int) -> Orbit | None:
    """An orbit at the parameter value of a path, if this begins (0) or ends (-1) with laps near to
    it."""
    lap = path.problem.after if place else path.problem.before
    if lap.period != orbit.word.period or not is_rotation(lap.walls, orbit.word.walls):
        return None
    there, wall = orbit_near(orbit, float(path.unknowns[-1])), path.problem.walls[place]
    if there is None:
        return None
    forcing = orbit.problem.period(orbit.unknowns)
    time, velocity = path.impacts[place]
    fastest = float(np.max(np.abs(there.velocities)))
    for k, letter in enumerate(there.word.walls):
        apart = (time - there.times[k]) / forcing, (velocity - there.velocities[k]) / fastest
        if letter == wall and max(abs(apart[0] - round(apart[0])), abs(apart[1])) < CLOSE:
            return there
    return None


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
        off = min(abs(dt - (later[0] - row[0])) for later in following)
        if not off < SAME_FLIGHT * simulator.period:
            return False
    return True
