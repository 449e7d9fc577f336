"""The search for orbits of a word: starts, Newton's method, and which orbits are known already.

Rounds of starts (`contimpact.orbits.search`) are repeated until several in a row find nothing new.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array, Table, Vector
from ..segments.compiling import CompiledProgram, load, mode
from ..segments.flight import variant_of
from ..segments.kernel import Blocks, Setup
from .block_cyclic import BLOCK, KEPT, POSITIONS, assemble, eliminate, solve, store, store_compiled

if TYPE_CHECKING:
    from ..segments.kernels import Kernels
    from ..segments.machine_code import Program
    from .problem import OrbitProblem
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..errors import InputError, count_text, random_generator
from ..models.guards import Word, graph, orders_of, parse_word, pivot
from ..models.model import Model, Symmetry
from ..progress import Asked, Progress, ignore_progress, progress_lines
from ..segments.compiling import timed_plainly
from ..segments.integration import limited_steps
from ..segments.kernel import SECTION
from ..segments.kernels import Kernels
from ..segments.segment import ELSEWHERE, STATES, VALUES
from .orbit import Orbit
from .problem import Linearisation, OrbitProblem
from .quiet import FreeQuietProblem, QuietProblem, largest_first, problem_of

# When two sets of impacts are the same orbit: rotations of the word, and the model's symmetry.


def rotate_to_word(problem: OrbitProblem, unknowns: Array, word: Word) -> Array | None:
    """Return an orbit's unknowns with its first impact chosen so that it reads as `word`.

    None if the orbit's word is no rotation of it.
    """
    own = problem.word
    if own.period != word.period or len(own) != len(word):
        return None
    if not own.walls:
        return unknowns
    shift = (own.walls * 2).find(word.walls)
    if shift < 0:
        return None
    rows = problem.impacts(unknowns).copy()
    span = problem.span(unknowns)
    rows[:shift, 0] += span
    return problem.with_impacts(_roll_rows(rows, shift), span, unknowns)


def mirror_orbit(
    problem: OrbitProblem, unknowns: Array, symmetry: Symmetry
) -> tuple[OrbitProblem, Array]:
    """Return the image of an orbit under the model's symmetry, and its problem."""
    walls = "".join(symmetry.walls[wall] for wall in problem.word.walls)
    image = problem_of(problem.model, Word(walls, problem.word.period), problem.kernels)
    rows = problem.impacts(unknowns).copy()
    rows[:, 0] += symmetry.shift * problem.period(unknowns)
    rows[:, 1:] *= symmetry.sign
    return image, image.with_impacts(rows, problem.span(unknowns), unknowns)


def repeats(problem: OrbitProblem, unknowns: Array, tolerance: float) -> bool:
    """Whether an orbit is one of fewer periods, run several times."""
    return _shortest_shift(problem, unknowns, tolerance) is not None


def reduce_period(
    problem: OrbitProblem, unknowns: Array, tolerance: float
) -> tuple[OrbitProblem, Array]:
    """Return an orbit as one of its shortest period, itself if it repeats none."""
    shift = _shortest_shift(problem, unknowns, tolerance)
    if shift is None:
        return problem, unknowns
    word = Word(problem.word.walls[:shift], problem.word.period * shift // len(problem.word))
    first = problem_of(problem.model, word, problem.kernels)
    return first, first_lap(problem, unknowns, shift)


def first_lap(problem: OrbitProblem, unknowns: Array, impacts: int) -> Array:
    """Return the first of several laps of so many impacts, as an orbit of its own, or that part of
    a direction."""
    rows = problem.impacts(unknowns)
    lap = rows[:impacts].copy()
    if problem.autonomous:  # it closes at t = 0
        lap[:, 0] -= rows[impacts, 0]
    return np.append(lap.ravel(), unknowns[problem.n :])


def _shortest_shift(problem: OrbitProblem, unknowns: Array, tolerance: float) -> int | None:
    """How many impacts the orbit repeats after, None if only after all."""
    word = problem.word
    span = problem.span(unknowns)
    rows = problem.impacts(unknowns)
    n = len(word)
    waves = math.sqrt(n) * problem.period(unknowns)  # at least the scale of times
    for shift in word.rotations()[1:]:
        if word.period * shift % n:
            continue
        later = rows.copy()
        later[:shift, 0] += span
        later = _roll_rows(later, shift)
        later[:, 0] -= span * shift / n
        apart = abs(later - rows)
        if apart[:, 0].max() >= tolerance * waves:
            continue
        units = problem.scale(unknowns, 1.0)[: problem.n]  # all impacts may be touches
        if (apart / units.reshape(apart.shape)).max() < tolerance:
            return shift
    return None


def _roll_rows(rows: Array, shift: int) -> Array:
    return np.roll(rows, -shift, axis=0)


# Newton's iteration from many random starts at once: arrays have one start along their last axis,
# so that each number of all starts is in one place.
#
# Impact times are drawn at random; the section coordinates that fit them best follow from least
# squares, since residuals are (close to) linear in them. Steps are shortened so that impacts stay
# in order.

SPANS = 0.2, 5.0
"""Free periods that starts are given, as parts of the system's natural time."""

LONGEST = 2.0 * SPANS[1]
"""Free period from which on a start is given up, likewise."""

FAR = 30.0
"""Times as large as those of most starts: section coordinates at which one is given up, where
flights are integrated, which takes the longer the faster they oscillate."""

AT_REST = 1e-15
"""Times as large as those of most starts: section coordinates with which a machine without forcing
rests, whatever the time."""

NEARLY = 1e-6
"""Times as large as those of most starts: section coordinates that have vanished with a contact,
after all iterations but for what steps leave that halve them."""

SIZES = 0.1, 1.0, 10.0
"""Sizes of section coordinates that are drawn at random."""


def solve_rounds(
    problem: OrbitProblem,
    generator: np.random.Generator,
    starts: int,
    rounds: int,
    fitted: bool = True,
) -> list[Array]:
    """The solutions that the starts of each round lead to, in the order of their iterations.

    Section coordinates are drawn at random, too, unless they are fitted to the times.
    """
    times = [_random_times(problem, generator, starts) for _ in range(rounds)]
    with np.errstate(all="ignore"):
        at = np.concatenate(times).T
        begun = _fit_sections(problem, at) if fitted else _draw_sections(problem, at, generator)
        if fast := compiled_starts(problem):
            solutions, origin = solve_compiled(fast, problem, begun)
        else:
            with timed_plainly(identity_of(problem.kernels)):
                solutions, origin = solve_on_arrays(problem, begun)
    return [solutions[origin // starts == k] for k in range(rounds)]


def _random_times(problem: OrbitProblem, generator: np.random.Generator, count: int) -> Array:
    """Impact times in order, one row per start."""
    period = problem.kernels.setup(*problem.model.values.values()).period
    if problem.autonomous:
        low, high = np.log(SPANS).tolist()
        spans = period * np.exp(generator.uniform(low, high, (count, 1)))
        first = -spans
    else:
        spans = problem.word.period * period
        first = generator.uniform(0.0, period, count)[:, None]
    durations = generator.dirichlet(np.ones(len(problem.word)), count)
    durations *= spans
    return np.hstack([first, first + np.cumsum(durations, axis=1)[:, :-1]])


def _fit_sections(problem: OrbitProblem, times: Array) -> Array:
    """The starts with these impact times: section coordinates by least squares."""
    n, count = times.shape
    m = problem.m
    z = np.zeros((n, m, count))
    z[:, 0] = times
    residual, jacobian = _evaluate_all(problem, z)
    waves = 2.0 * math.pi / problem.kernels.setup(*problem.model.values.values()).period
    elsewhere = [arrival == ELSEWHERE for arrival in problem.arrivals]
    for found in (residual, jacobian):  # positions in the unit of velocities
        rows = found.reshape(n, m, -1)
        rows[:, 2::2] *= waves
        rows[elsewhere, 0] *= waves
    sections = [i for i in range(n * m) if i % m]
    by_section = np.moveaxis(jacobian[:, sections], -1, 0)
    normal = by_section.transpose(0, 2, 1) @ by_section
    normal += 1e-12 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(len(sections))
    right = -(by_section.transpose(0, 2, 1) @ residual.T[:, :, None])
    z.reshape(-1, count)[sections] = np.linalg.solve(normal, right)[:, :, 0].T
    return z


def _draw_sections(problem: OrbitProblem, times: Array, generator: np.random.Generator) -> Array:
    """The starts with these impact times: section coordinates at random."""
    z = generator.normal(size=(*times.T.shape, problem.m))
    z *= generator.choice(SIZES, (times.shape[1], 1, 1))
    z[:, :, 0] = times.T
    return np.ascontiguousarray(np.moveaxis(z, 0, -1))


def solve_on_arrays(problem: OrbitProblem, z: Array) -> tuple[Array, Array]:
    """Newton's iteration from every start: the unknowns of those that converged, of shape (K, n +
    1), the soonest first, and the numbers of their starts."""
    n, m, count = z.shape
    value = problem.model.values[problem.parameter]
    period = problem.kernels.setup(*problem.model.values.values()).period
    origin = np.arange(count)
    reached: list[Array] = []
    origins: list[Array] = []
    integrated = any(problem.kernels.flown(*kind) for kind in problem.kinds)
    flown, typical = _flown_from(problem), _typical_size(z)
    far = FAR * typical if integrated else math.inf
    near = AT_REST * typical if problem.autonomous and typical < math.inf else 0.0
    astray, shrunk, last = np.zeros(count, dtype=int), np.zeros(count, dtype=int), np.ones(count)
    for _ in range(ITERATIONS):
        left = np.abs(z[flown]).max(axis=0, initial=0.0) < far
        if problem.autonomous:
            left &= -z[0, 0] < LONGEST * period
        z, origin = z[..., left], origin[left]
        if not len(origin):
            break
        residual, jacobian = _evaluate_all(problem, z)
        healthy = np.isfinite(residual.sum(axis=0) + jacobian.sum(axis=(0, 1)))
        if not healthy.all():
            z, origin, residual = z[..., healthy], origin[healthy], residual[:, healthy]
            jacobian = jacobian[..., healthy]
        step = _solve_all(jacobian, -residual).reshape(n, m, -1)
        done = _sizes(step) < SETTLED * _sizes(z)
        done &= np.abs(step[:, 0]).max(axis=0) < SETTLED * period
        if done.any():
            ended = (z + step)[..., done]
            moving = _sizes(ended) >= near
            reached.append(ended[..., moving])
            origins.append(origin[done][moving])
            z, step, origin = z[..., ~done], step[..., ~done], origin[~done]
        part = shortening(problem, z, step, period)
        z = z + step * part
        off = part < ASTRAY
        astray[origin] += off
        shrunk[origin] = np.where(off & (part < SHRINKING * last[origin]), shrunk[origin] + 1, 0)
        last[origin] = part
        kept = (astray[origin] < LOST) & (shrunk[origin] < VANISHING)
        if not kept.all():
            z, origin = z[..., kept], origin[kept]
    if not problem.autonomous:  # where contacts vanish steps are halved, with all coordinates
        resting = _sizes(z) < NEARLY * typical
        reached.append(z[..., resting])
        origins.append(origin[resting])
    if not reached:
        return np.empty((0, n * m + 1)), np.empty(0, dtype=int)
    solutions = np.concatenate(reached, axis=-1).reshape(n * m, -1).T
    return np.insert(solutions, n * m, value, axis=1), np.concatenate(origins)


def _flown_from(problem: OrbitProblem) -> Array:
    """Which numbers of z are of a state: not times, nor velocities that a mode has none of."""
    size, found = problem.model.DEGREES_OF_FREEDOM, []
    for letter in problem.word.walls:
        guard = problem.model.guard(letter)
        own, place = orders_of(problem.model.MODES, guard.modes[0], size), pivot(guard.row(size))
        others = [order > k for order in (*own[:place], *own[place + 1 :]) for k in range(2)]
        found.append([False, own[place] > 1, *others])
    return np.array(found)


def _typical_size(z: Array) -> float:
    """The median size of section coordinates other than zero; infinite if there are none."""
    sizes = _sizes(z)
    known = np.sort(sizes[np.isfinite(sizes) & (sizes > 0.0)])
    middle = known[(len(known) - 1) // 2 : len(known) // 2 + 1]  # np.median imports numpy.ma
    return float(np.mean(middle)) if len(known) else math.inf


def _sizes(z: Array) -> Array:
    sizes: Array = np.abs(z[:, 1:]).max(axis=(0, 1))
    return sizes


def _solve_all(matrices: Array, right: Array) -> Array:
    """Solutions of all systems, which are changed a little, so that zeros are divided by."""
    n = len(right)
    matrices[range(n), range(n)] += 1e-300
    systems, sides = np.moveaxis(matrices, -1, 0), right.T[:, :, None]
    try:
        return np.linalg.solve(systems, sides)[:, :, 0].T
    except np.linalg.LinAlgError:
        return (np.linalg.pinv(systems) @ sides)[:, :, 0].T


def shortening(problem: OrbitProblem, z: Array, step: Array, period: float) -> Array:
    """The part of each step that keeps impacts in order and moves no time by over T/4."""
    times, moves = z[:, 0], step[:, 0]
    durations, changes = np.empty_like(times), np.empty_like(times)
    for given, found, span in ((times, durations, period), (moves, changes, 0.0)):
        np.subtract(given[1:], given[:-1], out=found[:-1])
        np.subtract(problem.closing(given[0], span), given[-1], out=found[-1])
    less = changes < 0.0
    shrinking = np.where(less, -0.9 * durations / np.where(less, changes, 1.0), 1.0)
    if problem.autonomous:
        period = durations.sum(axis=0)
    largest = 0.25 * period / np.maximum(np.abs(moves).max(axis=0), 1e-300)
    return np.minimum(1.0, np.minimum(shrinking.min(axis=0), largest))


def _evaluate_all(problem: OrbitProblem, z: Array) -> tuple[Array, Array]:
    """Residuals (n, S) and square Jacobians (n, n, S) of all starts at the model's parameters.

    All flights between the same walls are evaluated together.
    """
    n, m, count = z.shape
    p = list(problem.model.values.values())
    period = problem.kernels.setup(*p).period
    arrivals = np.concatenate([z[1:], z[:1]])
    arrivals[-1, 0] = problem.closing(z[0, 0], period)
    closing = problem.closing(1.0, 0.0)
    residual = np.zeros((n, m, count))
    jacobian = np.zeros((n, m, n, m, count))
    for a, b in dict.fromkeys(problem.kinds):
        leaving = [k for k, kind in enumerate(problem.kinds) if kind == (a, b)]
        arriving = [(k + 1) % n for k in leaving]
        start, end = (np.ascontiguousarray(e[leaving].transpose(1, 0, 2)) for e in (z, arrivals))
        blocks = problem.kernels.segment(a, b).over(STATES)
        rows, by_start, by_end, _ = blocks(start, end, p)
        for i in range(m):
            for flight, (k, to) in enumerate(zip(leaving, arriving, strict=True)):
                residual[k, i] = _of_flight(rows[i], flight)
                for j in range(m):
                    jacobian[k, i, k, j] = _of_flight(by_start[m * i + j], flight)
                    moved = _of_flight(by_end[m * i + j], flight)
                    if j == 0 and k + 1 == n:
                        moved = moved * closing
                    jacobian[k, i, to, j] += moved
    problem.kernel_evaluations += count * n
    return residual.reshape(-1, count), jacobian.reshape(n * m, n * m, count)


def _of_flight(values: Any, flight: int) -> Any:
    """One flight's part of what is of all of them, or the same for all."""
    return values[flight] if np.ndim(values) else values


FEWEST_STARTS, MOST_WORK = 16, 40_000
"""Starts in a round, times the square of the word's length, beyond which fewer starts are made."""

ROUNDS_IN_VAIN = 2
"""Rounds in a row that find nothing new, after which a search ends."""

QUIET_STARTS, QUIET_PERIODS = 64, 12
"""Starts in a round for orbits without impacts, and the times of the word's period that motions fly
on before."""

QUIET_LOST, QUIET_SETTLED = 1e4, 0.1
"""The size of motions that run away, and the part of a state by which one that settles changes in a
period."""

QUIET_STEP, QUIET_FAR = 0.7, 10.0
"""Longest Newton step for them, as a part of the state or of its unit, and the size of a state
that is left."""

AT_FIRST, QUIET_SIZES = (0.01, 0.1, 1.0), (0.3, 1.0, 3.0, 10.0)
"""Sizes of states from which these motions begin, by the positions of walls, and of others by what
becomes of them."""

COARSE = 16.0
"""Units in which starts without a forcing are drawn are powers of this: they have three sizes."""

TURNING_STARTS, TURNING_EVALUATIONS, TURNING_STEPS = 256, 60, 2048
"""Starts for orbits without impacts whose period is free, and of each the evaluations and the steps
of integration: motions that run away take very many."""

SETTLING, SETTLED_SPAN, SETTLED_STEPS = 8, 20.0, 4096
"""One of so many of these starts is where a motion comes in so many natural periods, and in so many
steps at most."""

SAME_ORBIT = 1e-7
SAME_SINGULAR_ORBIT = 1e-4
SAME_SOLUTION = 1e-9
"""Solutions this near to a regular one are that one: Newton's next steps are below rounding."""


def find_orbits(
    model: Model,
    word: str | Word,
    *,
    parameter: str | None = None,
    kernels: Kernels | None = None,
    rng: np.random.Generator | int = 0,
    starts: int = 256,
    rounds: int = 8,
    progress: Asked = False,
) -> list[Orbit]:
    """Find the orbits of a word from random starts; `diagrams.starting_orbits` documents it."""
    with progress_lines(progress, f"find_orbits {word}") as tell:
        return search(model, word, parameter, kernels, rng, starts, rounds, tell).orbits


@dataclass(frozen=True)
class Search:
    """What a search for orbits has found, and how far it went."""

    orbits: list[Orbit]
    starts: int
    """Random starts in each round."""
    settled: bool = True
    """Whether it ended because rounds found nothing new, not because there were no more."""


def search(
    model: Model,
    word: str | Word,
    parameter: str | None = None,
    kernels: Kernels | None = None,
    rng: np.random.Generator | int = 0,
    starts: int = 256,
    rounds: int = 8,
    tell: Progress = ignore_progress,
) -> Search:
    """Search for the orbits of a word, as `find_orbits` does."""
    for name, count in (("starts", starts), ("rounds", rounds)):
        if count < 1:
            raise InputError(name, f"found {count!r}", "give a whole number >= 1")
    letters = model.letters
    if not isinstance(word, Word):
        word = parse_word(word, letters, graph=graph(model.WALLS), free=model.autonomous)
    first = list(model.values)[-1 if model.autonomous else 0]
    kernels = kernels or Kernels(model, parameter or first)
    return search_for(problem_of(model, word, kernels), rng, starts, rounds, tell)


def search_for(
    problem: OrbitProblem,
    rng: np.random.Generator | int = 0,
    starts: int = 256,
    rounds: int = 8,
    tell: Progress = ignore_progress,
) -> Search:
    """Search for the orbits of a problem at its model's parameters; see `find_orbits`."""
    generator = random_generator(rng)
    if not problem.word.walls:
        if isinstance(problem, FreeQuietProblem):
            return Search(_search_turning(problem, generator), TURNING_STARTS)
        return _without_impacts(problem, generator, rounds, tell)
    starts = min(starts, max(FEWEST_STARTS, MOST_WORK // len(problem.word) ** 2))
    found = _search_rounds(problem, generator, starts, rounds, tell)
    if not found.orbits and any(problem.kernels.flown(*kind) for kind in problem.kinds):
        tell("states at random, too")
        found = _search_rounds(problem, generator, starts, rounds, tell, fitted=False)
    return replace(found, orbits=_sort_orbits(found.orbits))


def add_orbits(
    found: Sequence[Orbit], problem: OrbitProblem, guesses: Sequence[Array]
) -> list[Orbit]:
    """Return the orbits found, and those near guesses of the unknowns, each once, in order."""
    orbits = list(found)
    if len(guesses):
        _add_new(orbits, [], problem, np.array(guesses))
    return _sort_orbits(orbits)


def _sort_orbits(orbits: Sequence[Orbit]) -> list[Orbit]:
    """The first impact's velocity decides, the largest first."""
    return sorted(orbits, key=lambda orbit: -float(orbit.velocities[0]))


def _progress(found: Sequence[Any], made: int) -> str:
    return f"{count_text(len(found), 'orbit')} after {count_text(made, 'round')}"


def _search_rounds(
    problem: OrbitProblem,
    generator: np.random.Generator,
    starts: int,
    rounds: int,
    tell: Progress,
    fitted: bool = True,
) -> Search:
    """The orbits of a word with letters, from starts that fit their times or any states."""
    found: list[Orbit] = []
    known: list[Array] = []
    quiet = made = 0
    tell(f"{count_text(starts, 'start')} in a round")
    while quiet < ROUNDS_IN_VAIN and made < rounds:
        count = min(ROUNDS_IN_VAIN - quiet, rounds - made)  # so many are made in any case
        for solutions in solve_rounds(problem, generator, starts, count, fitted):
            before, made = len(found), made + 1
            _add_new(found, known, problem, solutions)
            tell(f"{_progress(found, made)} of {count_text(starts, 'start')}")
            quiet = quiet + 1 if len(found) == before else 0
    return Search(found, starts, quiet == ROUNDS_IN_VAIN)


def _without_impacts(
    problem: OrbitProblem, generator: np.random.Generator, rounds: int, tell: Progress
) -> Search:
    """The orbits of the word `0`, the smallest first; of flights in closed form, which are linear,
    there is one, to which the first start leads."""
    free = [problem.model.values[name] for name in problem.kernels.parameters]
    units = _units_at_rest(problem, free)
    found: list[Orbit] = []
    known = [here] if (here := solve_near(problem, np.append(0.0 * units, free))) else []
    if known:
        _add_quiet(found, known[0], units)
    if not problem.kernels.integrated(SECTION):
        return Search(found, 1)
    quiet = made = 0
    while quiet < ROUNDS_IN_VAIN and made < rounds:
        before, made = len(found), made + 1
        for z in _solve_quietly(problem, generator, units, known).T:
            here = solve_near(problem, _round_unknowns(problem, np.append(z, free)))
            if here is not None and not any(_is_near(here, one, units) for one in known):
                known.append(here)
                _add_quiet(found, here, units)
        tell(f"{_progress(found, made)} of {QUIET_STARTS} starts")
        quiet = quiet + 1 if len(found) == before else 0
    found.sort(key=lambda orbit: float(np.max(np.abs(orbit.unknowns[: problem.m] / units))))
    return Search(found, QUIET_STARTS, quiet == ROUNDS_IN_VAIN)


def _solve_quietly(
    problem: OrbitProblem,
    generator: np.random.Generator,
    units: Array,
    known: Sequence[Linearisation],
) -> Array:
    """New solutions for orbits without impacts, one in a column: from states in which motions from
    random ones are after some periods, near what attracts, and from random ones of such sizes. The
    first are as large as positions of walls, the next as what becomes of these.

    Newton's iteration is deflated: what is solved is the residual over the distances from the known
    solutions, none of which is reached again.
    """
    blocks, motions = (problem.segments[0].over(numbers) for numbers in (STATES, VALUES))
    values, m = list(problem.model.values.values()), problem.m

    def move(z: Array) -> Array:
        """Where all starts are after the word's period."""
        problem.kernel_evaluations += z.shape[1]
        moved: Array = z + np.array([*motions(z, z, values)[0]])
        return moved

    def arrive(z: Array) -> tuple[Array, Array]:
        """The residuals of all starts, and their derivatives, of shape (m, m, S)."""
        rows, start, end, _ = blocks(z, z, values)
        table = [np.broadcast_to(a + b, z.shape[1:]) for a, b in zip(start, end, strict=True)]
        problem.kernel_evaluations += z.shape[1]
        return np.array([*rows]), np.array(table).reshape(m, m, z.shape[1])

    def draw(sizes: tuple[float, ...]) -> Array:
        return generator.normal(size=(m, QUIET_STARTS)) * np.resize(sizes, QUIET_STARTS)

    def measure(z: Array) -> Array:
        sizes: Array = np.max(np.abs(z) / units[:, None], axis=0)
        return sizes

    def settle(z: Array) -> Array:
        """What becomes of motions after some periods, without those that run away."""
        for _ in range(QUIET_PERIODS):
            if z.shape[1]:
                z = move(z)
                z = z[:, measure(z) < QUIET_LOST]
        return z

    with np.errstate(all="ignore"):
        flown = settle(units[:, None] * draw(AT_FIRST))
        units = units * (float(np.median(measure(flown))) if flown.shape[1] else 1.0)
        flown = np.hstack([flown, settle(units[:, None] * draw(QUIET_SIZES))])
        if flown.shape[1]:
            sizes, rest = measure(flown), measure(move(flown) - flown)
            units = units * float(np.max(sizes[rest < QUIET_SETTLED * sizes], initial=1.0))
        z, reached = np.hstack([flown, units[:, None] * draw(QUIET_SIZES)]), [flown[:, :0]]
        for _ in range(ITERATIONS):
            if not z.shape[1]:
                break
            residual, table = arrive(z)
            healthy = np.isfinite(residual.sum(axis=0) + table.sum(axis=(0, 1)))
            z = z[:, healthy]
            step = _solve_all(table[..., healthy], -residual[:, healthy])
            size, grown = np.maximum(1.0, measure(z)), np.zeros(z.shape[1])
            done = measure(step) < SETTLED * size
            reached.append((z + step)[:, done])
            for other in known:
                apart = (z - other.unknowns[:m, None]) / units[:, None]
                square = np.sum(apart**2, axis=0)
                grown -= (
                    2.0 * np.sum(apart * step / units[:, None], axis=0) / square / (1.0 + square)
                )
            step = step / (1.0 - grown)
            z = z + step * np.minimum(1.0, QUIET_STEP * size / measure(step))
            z = z[:, ~done & (measure(z) < QUIET_FAR)]
    return np.hstack(reached)


def _is_near(here: Linearisation, other: Linearisation, units: Array) -> bool:
    """Whether two solutions without impacts are the same."""
    m = len(units)
    size = max(1.0, float(np.max(np.abs(here.unknowns[:m] / units))))
    apart = np.max(np.abs(here.unknowns[:m] - other.unknowns[:m]) / units)
    return bool(apart < SAME_ORBIT * size)


def _units_at_rest(problem: OrbitProblem, free: Sequence[float]) -> Array:
    """Units in which motion without impacts is of ordinary size: powers of two, for positions near
    where walls are, or to where the forcing leads from rest within a period."""
    setup = problem.kernels.setup(*problem.model.values.values())
    rate = 2.0 * math.pi / setup.period
    try:
        moved = np.abs(problem.evaluate(np.append(np.zeros(problem.m), free)).residual)
    except ArithmeticError:
        moved = np.zeros(problem.m)
    moved[1::2] /= rate
    length = max([*map(abs, setup.walls), *moved.tolist()])
    units = np.full(problem.m, _power_of_two(length) if 0.0 < length < math.inf else 1.0)
    units[1::2] *= _power_of_two(rate)
    return units


def _power_of_two(x: float) -> float:
    return 2.0 ** round(math.log2(x))


def _add_quiet(found: list[Orbit], here: Linearisation | None, units: Array) -> None:
    """Add an orbit without impacts to the list unless it is there, perhaps from a later period of
    the forcing on, or one of a shorter period. Of those that are one orbit moved, as by whole
    turns, the nearest is listed, and the nearest physical one."""
    if here is None or not _is_regular(here) or _repeats_quietly(here):
        return
    assert isinstance(here.problem, QuietProblem)
    size = float(np.max(np.abs(here.unknowns[: len(units)] / units)))
    same = SAME_ORBIT * max(1.0, size)
    places = [here.unknowns, *here.problem.later(here.unknowns)]
    if not all(_is_new(found, place, same, units) for place in places):
        return
    orbit = Orbit(here.problem, here)
    for number, other in enumerate(found):
        alike = other.physical == orbit.physical
        if alike and any(_is_shifted(other, place, units, same) for place in places):
            if size < float(np.max(np.abs(other.unknowns[: len(units)] / units))):
                found[number] = orbit
            return
    found.append(orbit)


def _is_shifted(orbit: Orbit, unknowns: Array, units: Array, same: float) -> bool:
    """Whether unknowns are those of an orbit without impacts moved by some positions, as by whole
    turns, and any motion may be moved by as much."""
    m, problem = len(units), orbit.problem
    shift = unknowns[:m] - orbit.unknowns[:m]
    if np.max(np.abs(shift[1::2]) / units[1::2]) >= same:
        return False
    shift[1::2] = 0.0
    begun, moved = orbit.unknowns.copy(), unknowns.copy()
    begun[:m] += units
    moved[:m] = begun[:m] + shift
    try:
        there, here = (problem.evaluate(state).residual for state in (moved, begun))
    except ArithmeticError:
        return False
    return bool(np.max(np.abs(there - here) / units) < math.sqrt(same))


def _search_turning(problem: FreeQuietProblem, generator: np.random.Generator) -> list[Orbit]:
    """The orbits without impacts in a system without forcing, from where the first coordinate is
    largest; those are left out on which nothing moves. Linear flights have none that is isolated.
    """
    if not problem.kernels.integrated(SECTION):
        return []
    free = [problem.model.values[name] for name in problem.kernels.parameters]
    units = COARSE ** np.round(np.log2(_units_at_rest(problem, free)) / math.log2(COARSE))
    found: list[Orbit] = []
    for trial in range(TURNING_STARTS):
        state = units * generator.normal(scale=10.0 ** (trial % 3 - 1), size=problem.m)
        here = _solve_after(problem, np.append(state, free), units, trial % SETTLING == 0)
        if here is not None and problem.moves(here.unknowns, units) and _is_regular(here):
            here = _from_largest(here, SAME_ORBIT * units[0])
            own = here.unknowns[: problem.m] / units
            known = (o.unknowns[: problem.m] / units for o in found)
            if not any(
                np.allclose(own, other, rtol=SAME_ORBIT, atol=SAME_ORBIT) for other in known
            ):
                found.append(Orbit(problem, here))
    return found


def _solve_after(
    problem: FreeQuietProblem, unknowns: Array, units: Array, settled: bool
) -> Linearisation | None:
    """A cycle near what a motion does next, or near what becomes of it."""
    natural = problem.kernels.setup(*problem.model.values.values()).period
    length, steps = (SETTLED_SPAN, SETTLED_STEPS) if settled else (SPANS[1], TURNING_STEPS)
    try:
        with limited_steps(steps), np.errstate(all="ignore"):
            guess = problem.guess_after(unknowns, length * natural, settled)
        if guess is None:
            return None
        with limited_steps(TURNING_STEPS), np.errstate(all="ignore"):
            here = _solve_from_afar(problem, guess, units)
            once = None if here is None else problem.first_lap(here.unknowns)[1]
            return here if once is None else solve_near(problem, once)
    except ArithmeticError:
        return None


def _solve_from_afar(problem: FreeQuietProblem, guess: Array, units: Array) -> Linearisation | None:
    """A cycle by Powell's hybrid method (MINPACK), which leads to one from six times as many starts
    as Newton's iteration."""
    from scipy.optimize import root

    def at(z: Array) -> Linearisation:
        return problem.evaluate(np.append(z, guess[problem.n :]))

    found = root(
        lambda z: at(z).residual / units,
        guess[: problem.n],
        jac=lambda z: at(z).jacobian[:, : problem.n] / units[:, None],
        options={"maxfev": TURNING_EVALUATIONS},
    )
    if not found.success:
        return None
    return solve_near(problem, _round_unknowns(problem, np.append(found.x, guess[problem.n :])))


def _from_largest(here: Linearisation, same: float) -> Linearisation:
    """The same orbit from where the first coordinate is largest, if that turns more than once."""
    largest = largest_first(here)
    if not largest[0] > here.unknowns[0] + same:
        return here
    largest[1] = here.span
    found = solve_near(here.problem, np.append(largest, here.unknowns[here.problem.m :]))
    return here if found is None else found


def _repeats_quietly(here: Linearisation) -> bool:
    """Whether an orbit without impacts is one of a shorter period."""
    assert isinstance(here.problem, QuietProblem)
    return here.problem.first_lap(here.unknowns)[0] is not here.problem


def solve_near(
    problem: OrbitProblem, unknowns: Array, iterations: int = 12
) -> Linearisation | None:
    """Solve for an orbit at fixed parameter, to rounding, from a good guess; None if it fails."""
    z, n, least = unknowns.copy(), problem.n, math.inf
    best: Linearisation | None = None
    try:
        if not z[:n].any():  # a state of no size: that of the orbit is seen after a step
            here = problem.evaluate(z)
            z[:n] = -np.linalg.solve(here.jacobian[:, :n], here.residual)
        units = problem.residual_sizes(problem.natural_units(z))
        for _ in range(iterations):
            here = problem.evaluate(z)
            size = float(np.max(np.abs(here.residual) / units))
            if best is not None and not size < 0.5 * least:
                break
            best, least = here, size
            z = z.copy()
            z[:n] -= np.linalg.solve(here.jacobian[:, :n], here.residual)
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        return None
    if best is not None and not least < SOLVED:  # impacts that are slow beside the motion
        least = float(np.max(np.abs(best.residual) / best.sizes[0]))
        return best if least < ROUNDED else None
    return best


SOLVED, ROUNDED = 1e-11, 1e-14
"""Residuals of an orbit, beside the velocities of its impacts, or beside the largest along its
flights, of which they are the rounding."""


def _add_new(
    found: list[Orbit], known: list[Array], problem: OrbitProblem, solutions: Array
) -> None:
    """Add the orbits among solutions to those found, each once; a start often leads to a known one.

    `known` are the regular solutions met so far, repetitions of shorter orbits among them.
    """
    left = _reduce_times(problem, solutions)
    for other in known:
        left = left[~_same_solution(problem, left, other)]
    while len(left):
        here = solve_near(problem, _round_unknowns(problem, left[0]))
        left = left[1:]
        if here is None or not _impacts_follow(here):
            continue
        regular = _is_regular(here)
        if regular:
            known.append(here.unknowns)
            left = left[~_same_solution(problem, left, here.unknowns)]
        if not repeats(problem, here.unknowns, SAME_ORBIT):
            _add(found, here, SAME_ORBIT if regular else SAME_SINGULAR_ORBIT)


def _round_unknowns(problem: OrbitProblem, unknowns: Array) -> Array:
    """Unknowns to nine digits of the largest: from there Newton's iteration leads to the same bits
    whichever start has led to them, and whichever arithmetic."""
    rounded, n = unknowns.copy(), problem.n
    digit = 2.0 ** (np.frexp(problem.natural_units(unknowns)[:n])[1] - 30)
    rounded[:n] = digit * np.round(unknowns[:n] / digit)
    return rounded


def _add(found: list[Orbit], here: Linearisation, same: float) -> None:
    """Add an orbit to the list unless it is there."""
    problem = here.problem
    units = problem.natural_units(here.unknowns)[: problem.n]
    if _is_new(found, here.unknowns, same, units):
        found.append(Orbit(problem, _rotate_to_fastest(here)))


def _is_new(found: list[Orbit], unknowns: Array, same: float, units: Array) -> bool:
    """Whether unknowns are those of no orbit in the list."""
    n = len(units)
    apart = (orbit.problem.difference(unknowns, orbit.unknowns)[:n] / units for orbit in found)
    return all(np.max(np.abs(difference)) >= same for difference in apart)


def _rotate_to_fastest(here: Linearisation) -> Linearisation:
    """The orbit from the rotation of its word on that begins with the fastest impact.

    Of equally fast ones that with the earlier phase, then by the next impact in turn. Without this
    rounding would decide which of the equal letters of a word comes first.
    """
    problem, shifts = here.problem, here.problem.word.rotations()
    if len(shifts) == 1:
        return here
    period, span = problem.period(here.unknowns), here.span
    rows = problem.impacts(here.unknowns).copy()
    speeds = np.abs(rows[:, 1])
    keys = np.column_stack([speeds / (np.max(speeds) or 1.0), -(rows[:, 0] / period % 1.0)])
    keys = np.round(keys, 9)
    first = max(shifts, key=lambda shift: np.roll(keys, -shift, axis=0).ravel().tolist())
    if first == 0:
        return here
    rows[:first, 0] += span
    rows = np.roll(rows, -first, axis=0)
    rows[:, 0] -= np.floor(rows[0, 0] / period) * period
    return problem.evaluate(problem.with_impacts(rows, span, here.unknowns))


BRIEF, BESIDE = 1e-9, 1e-4
"""Part of an orbit's period below which a flight has no duration, and how far on either side, in
natural units of its unknowns, it has one."""


def _impacts_follow(here: Linearisation) -> bool:
    """Whether the impacts follow each other, none at the time of the next, or only here: where two
    exchange their order, and where a contact vanishes. A flight that slides for no time solves its
    equations at any value of the parameter."""
    problem = here.problem
    parts = _durations(problem, here.unknowns)
    if np.min(parts) > BRIEF:
        return True
    if np.min(parts) < -BRIEF:
        return False
    _, directions = here.singular_vectors(here.jacobian)
    changes = np.zeros(len(parts))
    for step in BESIDE * directions[problem.n :]:
        sides = (_durations(problem, here.unknowns + sign * step) for sign in (1.0, -1.0))
        changes = np.maximum(changes, np.abs(np.subtract(*sides)))
    return bool(np.all(changes[parts < BRIEF] > BRIEF))


def _durations(problem: OrbitProblem, unknowns: Array) -> Array:
    """The durations of all flights as parts of the orbit's period."""
    times, span = problem.impacts(unknowns)[:, 0], problem.span(unknowns)
    return np.diff(np.append(times, times[0] + span)) / span


def _same_solution(problem: OrbitProblem, solutions: Array, other: Array) -> Array:
    """Which rows are another solution, up to whole periods and rotations of the word."""
    period, span = problem.period(other), problem.span(other)
    units = problem.natural_units(other)[: problem.n].reshape(-1, problem.m)
    rows = solutions[:, :-1].reshape(-1, len(problem.word), problem.m)
    same = np.zeros(len(solutions), dtype=bool)
    for shift in problem.word.rotations():
        moved = np.roll(problem.impacts(other), -shift, axis=0)
        moved[len(moved) - shift :, 0] += span
        gaps = rows - problem.placed(moved, span)
        if not problem.autonomous:
            gaps[:, :, 0] -= period * np.round(np.mean(gaps[:, :, :1], axis=1) / period)
        same |= np.max(np.abs(gaps / units), axis=(1, 2)) < SAME_SOLUTION
    return same


def _is_regular(here: Linearisation) -> bool:
    """Whether an orbit is known to rounding, and not only to its root as at a bifurcation."""
    matrix = here.cyclic(1.0)[:, : here.problem.n]
    for axis in (0, 1):  # in units that lie far apart, its entries do
        largest = np.max(np.abs(matrix), axis=axis, keepdims=True)
        matrix = matrix / np.where(largest > 0.0, largest, 1.0)
    sizes = np.linalg.svd(matrix, compute_uv=False)
    return bool(sizes[-1] > 1e-4 * sizes[0])


def _reduce_times(problem: OrbitProblem, solutions: Array) -> Array:
    """The same solutions with their first impacts in [0, T), where there is a forcing."""
    if problem.autonomous:
        return solutions
    period = problem.kernels.setup(*problem.model.values.values()).period
    shifted = solutions.copy()
    shifted[:, : -1 : problem.m] -= np.floor(solutions[:, :1] / period) * period
    return shifted


def orbit_at(problem: OrbitProblem, unknowns: Array) -> Orbit:
    """Solve for the orbit next to `unknowns` at their parameter value.

    Raises InputError if Newton's iteration does not converge from there.
    """
    here = solve_near(problem, np.asarray(unknowns, dtype=float))
    if here is None:
        found = f"no {problem.word} orbit was reached from them"
        raise InputError("unknowns", found, "give a closer guess, or use find_orbits")
    return Orbit(problem, here)


# Newton's iteration from many starts, compiled, as `solve_on_arrays` does it.
#
# It is for one degree of freedom and flights in closed form. Functions are in the plain subset of
# Python that `contimpact.segments.compiling` compiles.


ITERATIONS, SETTLED = 25, 1e-8
"""Most iterations, and the length of the Newton step after which a start has led to an orbit:
above one, of the period or of the largest velocity that part."""

ASTRAY, LOST = 1e-2, 10
"""Part of its Newton step that a start takes where it is astray, and how often it may be so: of
19,000 starts that led to orbits two were so seven times, none more often."""

SHRINKING, VANISHING = 0.2, 4
"""Part of the last part at which the part shrinks with a flight, and how often it may do so in a
row: steps towards a flight of no duration are shortened tenfold each time. Of 50,000 starts that
led to orbits 15 shrank so twice, none more often."""

PERIODS, PLACE = range(2)
"""Places in `counts`: forcing periods of the orbit, and the free parameter's among the values."""


def solve_from_starts(
    flight: Callable[..., Blocks],
    setup: Callable[[Vector], Setup],
    kinds: Vector,
    arrivals: Vector,
    counts: Vector,
    values: Vector,
    clock: Vector,
    border: Vector,
    step: Vector,
    made: Vector,
    blocks: Table,
    kept: Table,
    fixed: Table,
    starts: Table,
) -> int:
    """Iterate from every row of `starts`, which becomes the solution; fills `made` with the
    iterations it took, -1 where there is none. Returns how many points were evaluated.

    Steps leave the parameter, last in a row, as it is; they are shortened as in
    `search.shortening`.
    """
    count, evaluated = len(kinds), 0
    n = 2 * count
    for number in range(len(made)):
        z = starts[number]
        made[number] = -1.0
        astray, shrunk, last = 0, 0, 1.0
        for iteration in range(ITERATIONS):
            evaluated += 1
            total = assemble(
                flight,
                setup,
                kinds,
                counts[PERIODS],
                counts[PLACE],
                values,
                blocks,
                clock,
                fixed,
                z,
            )
            if total - total != 0.0:  # infinite or NaN
                break
            reduced = eliminate(blocks, arrivals, kept, 1.0, False, z, 0.0)
            if not abs(solve(reduced, kept, count, border, 0.0, step)) > 0.0:
                break
            farthest, period = 0.0, clock[0] / counts[PERIODS]
            largest, total, part, size = 0.0, 0.0, 1.0, 0.0
            for k in range(count):
                i = 2 * k
                farthest, size = max(farthest, abs(step[i])), max(size, abs(z[i + 1]))
                largest = max(largest, abs(step[i + 1]))
                total += abs(step[i]) + abs(step[i + 1])
            if total - total != 0.0:
                break
            if largest < SETTLED * size and farthest < SETTLED * period:
                for i in range(n):
                    z[i] += step[i]
                made[number] = float(iteration)
                break
            for k in range(count):
                i = 2 * k
                if k + 1 < count:
                    duration, change = z[i + 2] - z[i], step[i + 2] - step[i]
                else:
                    duration, change = z[0] + clock[0] - z[i], step[0] - step[i]
                if change < 0.0:
                    part = min(part, -0.9 * duration / change)
            part = min(part, 0.25 * period / max(farthest, 1e-300))
            for i in range(n):
                z[i] += part * step[i]
            if part < ASTRAY:
                astray += 1
                shrunk = shrunk + 1 if part < SHRINKING * last else 0
            else:
                shrunk = 0
            last = part
            if astray >= LOST or shrunk >= VANISHING:
                break
    return evaluated


ARGUMENTS = "iii" + "fffff" + "FFFF"
VECTORS = "kinds, arrivals, counts, values, clock, border, step, made, blocks, kept, fixed, starts"


def compiled_starts(problem: OrbitProblem) -> CompiledProgram | None:
    """Return compiled code for a problem, if there can be some and it is in the cache or pays."""
    kernels, walls = problem.kernels, problem.model.WALLS
    if mode() == "never" or not problem.paired:
        return None
    if any(kernels.linear(wall.name) or kernels.integrated(wall.name) for wall in walls):
        return None
    if variant_of(kernels, list(problem.model.values.values())) is None:
        return None
    return load(identity_of(kernels), ARGUMENTS, lambda: starts_program(kernels))


def identity_of(kernels: Kernels) -> tuple[str, ...]:
    """Return what tells the program from others."""
    return kernels.identity, "starts"


def starts_program(kernels: Kernels) -> Program:
    """Return `solve_from_starts` as a program, for words of a model."""
    from ..segments.machine_code import Program, choice

    program = Program({store: store_compiled})
    walls = kernels.model.letters
    p = ", ".join(f"p[{i}]" for i in range(len(kernels.model.values)))
    flights = {f"flight_{a}_{b}": kernels.flight(a, b) for a in walls for b in walls}
    given = f"t0, v0, t1, v1, {p}"
    chosen = choice("any_flight", "kind, t0, v0, t1, v1, p", "kind", list(flights), given)
    program.glue(chosen, **flights)
    text = f"""
def any_setup(p):
    return kernel_setup({p})

def entry({VECTORS}):
    return solve_from_starts(any_flight, any_setup, {VECTORS})
"""
    program.glue(text, kernel_setup=kernels.setup, solve_from_starts=solve_from_starts)
    return program


def solve_compiled(fast: CompiledProgram, problem: OrbitProblem, z: Array) -> tuple[Array, Array]:
    """As `search.solve_on_arrays`."""
    n, m, starts = z.shape
    model, setup = problem.model, problem.kernels.setup(*problem.model.values.values())
    letters, names = model.letters, list(model.values)
    word = [letters.index(letter) for letter in problem.word.walls]
    kinds = [a * len(letters) + b for a, b in zip(word, word[1:] + word[:1], strict=True)]
    place = names.index(problem.parameter)
    values, border = np.array(list(model.values.values())), np.zeros(n * m + 1)
    border[-1] = 1.0
    rows = np.empty((starts, n * m + 1))
    rows[:, :-1], rows[:, -1] = z.reshape(n * m, starts).T, values[place]
    made = np.empty(starts)
    evaluated = fast(
        np.array(kinds),
        np.array(problem.arrivals),
        np.array([problem.word.period, place]),
        values,
        np.zeros(3),
        border,
        np.empty(n * m + 1),
        made,
        np.empty((n, BLOCK)),
        np.empty((n, KEPT)),
        np.empty((1, POSITIONS + len(setup.walls) + len(setup.derived))),
        rows,
    )
    problem.kernel_evaluations += evaluated * n
    order = np.argsort(made, kind="stable")
    order = order[made[order] >= 0.0]
    return rows[order], order
