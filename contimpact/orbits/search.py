"""The search for orbits of a word: rounds of starts, and which orbits are known already.

Rounds of starts (`contimpact.orbits.starts`) are repeated until several in a row find nothing new.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError, count_text, random_generator, require_whole
from ..models.guards import Word, graph, parse_word
from ..models.model import Model, Symmetry
from ..progress import Asked, Progress, ignore_progress, progress_lines
from ..segments.integration import limited_steps
from ..segments.kernel import SECTION
from ..segments.kernels import Kernels
from ..segments.segment import STATES, VALUES
from .orbit import Orbit
from .problem import Linearisation, OrbitProblem
from .quiet import FreeQuietProblem, QuietProblem, largest_first, problem_of
from .starts import (
    ITERATIONS,
    SETTLED,
    SIZES,
    SPANS,
    solve_all,
    solve_rounds,
    units_at_rest,
    units_of_states,
)

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
) -> tuple[OrbitProblem, Array] | None:
    """Return the image of an orbit under the model's symmetry, and its problem; None if it is an
    orbit without impacts in another mode."""
    if isinstance(problem, QuietProblem):
        return (
            (problem, problem.mirrored(unknowns, symmetry)) if _stays(problem, symmetry) else None
        )
    walls = "".join(symmetry.walls[wall] for wall in problem.word.walls)
    image = problem_of(problem.model, Word(walls, problem.word.period), problem.kernels)
    rows = problem.impacts(unknowns).copy()
    rows[:, 0] += symmetry.shift * problem.period(unknowns)
    rows[:, 1:] *= symmetry.sign
    return image, image.with_impacts(rows, problem.span(unknowns), unknowns)


def _stays(problem: OrbitProblem, symmetry: Symmetry) -> bool:
    """Whether the first mode is its own image, by the guards that end it."""
    model = problem.model
    own = {guard.name for guard in model.WALLS if model.first_mode in guard.modes}
    return {symmetry.walls[name] for name in own} == own


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
    require_whole(starts, "starts")
    require_whole(rounds, "rounds")
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
    rest = np.append(np.zeros(problem.m), free)
    units, integrated = units_at_rest(problem, rest), problem.kernels.integrated(SECTION)
    if units is None or integrated:
        drawn = units_of_states(problem, rest)
        units = drawn[-1] if units is None or len(drawn) > 1 else units
    found: list[Orbit] = []
    known = [here] if (here := solve_near(problem, rest)) else []
    if known:
        _add_quiet(found, known[0], units)
    if not integrated:
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


def fills_a_family(problem: OrbitProblem) -> bool:
    """Whether motions without impacts, in closed form, all come back, but none is isolated, as
    where nothing holds a coordinate."""
    if problem.autonomous or problem.kernels.integrated(SECTION):
        return False
    free = [problem.model.values[name] for name in problem.kernels.parameters]
    here = problem.evaluate(np.append(np.zeros(problem.m), free))
    if _is_regular(here):
        return False
    table = np.column_stack([here.cyclic(1.0)[:, : problem.n], here.residual])
    for axis in (1, 0):
        largest = np.max(np.abs(table), axis=axis, keepdims=True)
        table = table / np.where(largest > 0.0, largest, 1.0)
    matrix, goal = table[:, :-1], table[:, -1]
    left = goal - matrix @ np.linalg.lstsq(matrix, goal, rcond=SAME_ORBIT)[0]
    return bool(np.max(np.abs(left)) <= SAME_ORBIT * np.max(np.abs(goal)))


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
            step = solve_all(table[..., healthy], -residual[:, healthy])
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
    except (ArithmeticError, ValueError):
        return False
    return bool(np.max(np.abs(there - here) / units) < math.sqrt(same))


def _search_turning(problem: FreeQuietProblem, generator: np.random.Generator) -> list[Orbit]:
    """The orbits without impacts in a system without forcing, from where the first coordinate is
    largest; those are left out on which nothing moves. Linear flights have none that is isolated.
    """
    if not problem.kernels.integrated(SECTION):
        return []
    free = [problem.model.values[name] for name in problem.kernels.parameters]
    rest = np.append(np.zeros(problem.m), free)
    rest[1] = problem.kernels.setup(*problem.model.values.values()).period
    with limited_steps(TURNING_STEPS):
        drawn = units_of_states(problem, rest)
    found: list[Orbit] = []
    for trial in range(TURNING_STARTS):
        units = drawn[trial // len(SIZES) % len(drawn)]
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
    except (ArithmeticError, ValueError):
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
