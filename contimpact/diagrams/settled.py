"""Orbits on which short simulations settle: what attracts is found, however small a search is.

A few motions from random states are simulated for some dozens of impacts. Where one comes back
near an earlier impact, Newton's iteration solves for the orbit of the impacts between, with the
equations of the search. It counts if it is stable and physical.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..models.model import Model
from ..models.word import Word
from ..orbits.orbit import Orbit
from ..orbits.quiet import problem_of
from ..orbits.search import SAME_ORBIT, reduce_period, rotate_to_word, solve_near
from ..segments.kernels import Kernels
from ..simulation.run import Outcome, Run, State
from ..simulation.simulator import Simulator

MOTIONS, QUIET = 8, 3
"""Motions that are simulated at most, and how many may settle on nothing new, one after the other,
before; those that fly on without impacts are not counted."""

DEAR_MOTIONS, DEAR_QUIET = 4, 2
"""The same of several coordinates or integrated flights, where an impact takes far longer."""

IMPACTS = (64, 96, 192)
"""Impacts that a motion has to settle in before each look at it; the last look is the first for
integrated flights, and the second for several coordinates."""

LONGEST = 32
"""Impacts of an orbit at most."""

LONGEST_FLIGHT = 20
"""Periods after which a motion is left that meets no wall."""

NEAR = 1e-2
"""A motion this close to an earlier impact may have closed; in periods and largest coordinates."""

REACHED = 0.1
"""How far from the simulated impacts the orbit may be, likewise."""


class Settled(NamedTuple):
    """What motions from random states settle on."""

    orbits: list[Orbit]
    """The stable orbits with impacts, each once."""
    motions: int
    """How many were simulated."""
    runaways: int
    """How many of them run away: `Outcome.RUNAWAY`."""


def settled_orbits(model: Model, kernels: Kernels, rng: np.random.Generator | int = 0) -> Settled:
    """Return the stable orbits with impacts on which motions from random states settle.

    Parameters
    ----------
    kernels : Kernels
        Of the model; they name the followed parameter.
    """
    simulator = Simulator(model, kernels, longest_flight=LONGEST_FLIGHT)
    generator = np.random.default_rng(rng)
    integrated = any(kernels.integrated(guard.name) for guard in model.WALLS)
    dear = simulator.several or integrated
    motions, patience = (DEAR_MOTIONS, DEAR_QUIET) if dear else (MOTIONS, QUIET)
    looks = IMPACTS[: 1 if integrated else 2 if simulator.several else 3]
    found: list[Orbit] = []
    quiet = made = runaways = 0
    while made < motions and quiet < patience:
        orbit, outcome = _settle_orbit(simulator, simulator.random_state(generator), looks)
        made, runaways = made + 1, runaways + (outcome is Outcome.RUNAWAY)
        new = orbit is not None and not any(_same_orbit(orbit, other) for other in found)
        quiet = 0 if new else quiet + (outcome is not Outcome.NO_IMPACT)
        if orbit is not None and new:
            found.append(orbit)
    return Settled(found, made, runaways)


def unknowns_of_word(orbits: Iterable[Orbit], word: Word) -> list[Array]:
    """Return the unknowns of those orbits that have a word, from its first letter on."""
    turned = (turn_to_word(orbit, word) for orbit in orbits)
    return [unknowns for unknowns in turned if unknowns is not None]


def word_of(orbit: Orbit) -> Word:
    """Return an orbit's word, from the letter on from which it comes first in the model's order."""
    word, order = orbit.word, orbit.problem.model.letters.index
    turns = (word.walls[k:] + word.walls[:k] for k in range(len(word)))
    return Word(min(turns, key=lambda walls: [order(wall) for wall in walls]), word.period)


def _settle_orbit(
    simulator: Simulator, state: State, looks: Sequence[int]
) -> tuple[Orbit | None, Outcome]:
    """The orbit on which one motion settles, and how its last run ended; no orbit if it does not in
    time, or rests, or flies on."""
    try:
        return _after(simulator, state, looks)
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        # a flight has no value somewhere, or takes too many steps
        return None, Outcome.DONE


def _after(
    simulator: Simulator, state: State, looks: Sequence[int]
) -> tuple[Orbit | None, Outcome]:
    """The same, where all flights stay finite."""
    for impacts in looks:
        run = simulator.run(state, impacts=impacts)
        if run.end is None or run.outcome is not Outcome.DONE:
            return None, run.outcome
        if run.released.any() or run.held.any():
            break
        for orbit in _orbits_near(simulator, run):
            if orbit.physical and np.max(np.abs(orbit.multipliers)) < 1.0:
                return orbit, run.outcome
        state = run.end
    return None, run.outcome


def _orbits_near(simulator: Simulator, run: Run) -> Iterator[Orbit]:
    """The orbits through the end of a run, of as few impacts as possible first."""
    model, period, last = simulator.model, simulator.period, len(run) - 1
    rows = np.column_stack([run.turns * period + run.phases, run.velocities, *run.others.T])
    sizes = np.append(period, np.max(np.abs(rows[:, 1:]), axis=0))
    sizes[sizes == 0.0] = 1.0
    for impacts in range(1, min(LONGEST, last) + 1):
        away = (rows[last] - rows[last - impacts]) / sizes
        turns = 0 if model.autonomous else round(float(away[0]))
        away[0] -= away[0] if model.autonomous else turns
        same = run.walls[last] == run.walls[last - impacts]
        if not same or np.max(np.abs(away)) > NEAR or not (turns or model.autonomous):
            continue
        lap = rows[last - impacts : last].copy()
        span = float(rows[last, 0] - lap[0, 0]) if model.autonomous else turns * period
        lap[:, 0] -= np.floor(lap[0, 0] / period) * period
        letters = "".join(simulator.letters[k] for k in run.walls[last - impacts : last])
        problem = problem_of(model, Word(letters, turns), simulator.kernels)
        free = [model.values[name] for name in simulator.kernels.parameters]
        guess = problem.with_impacts(lap, span, np.array(free))
        here = solve_near(problem, guess)
        if here is None:
            continue
        apart = problem.difference(here.unknowns, guess)[: problem.n].reshape(-1, problem.m)
        if np.max(np.abs(apart / sizes)) < REACHED:
            single, unknowns = reduce_period(problem, here.unknowns, SAME_ORBIT)
            yield Orbit(single, here if single is problem else single.evaluate(unknowns))


def _same_orbit(one: Orbit, other: Orbit) -> bool:
    """Whether two orbits are one, their words rotated perhaps."""
    turned = turn_to_word(one, other.word)
    if turned is None:
        return False
    return bool(np.max(np.abs(other.problem.difference(turned, other.unknowns))) < SAME_ORBIT)


def turn_to_word(orbit: Orbit, word: Word) -> Array | None:
    """Return an orbit's unknowns as an orbit of a word, its first impact in [0, T); None if it is
    none of it."""
    turned = rotate_to_word(orbit.problem, orbit.unknowns, word)
    if turned is None or orbit.problem.autonomous:
        return turned
    turned = turned.copy()
    period = orbit.problem.period(turned)
    turned[: -orbit.problem.free : orbit.problem.m] -= np.floor(turned[0] / period) * period
    return turned
