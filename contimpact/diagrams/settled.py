"""Orbits on which short simulations settle: what attracts is found, however small a search is.

A few motions from random states are simulated for some dozens of impacts. Where one comes back
near an earlier impact, Newton's iteration solves for the orbit of the impacts between, with the
equations of the search. It counts if it is stable and physical.
"""

from __future__ import annotations

import enum
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..models.model import Model
from ..models.word import Word
from ..orbits.orbit import Orbit
from ..orbits.quiet import problem_of
from ..orbits.search import SAME_ORBIT, reduce_period, rotate_to_word, solve_near
from ..segments.integration import limited_steps
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

DEAR_STEPS = 20_000
"""Steps of integration that all motions may take; one that takes more is the last, and is left."""

LONGEST = 32
"""Impacts of an orbit at most."""

LONGEST_FLIGHT = 20
"""Periods after which a motion is left that meets no wall."""

NEAR = 1e-2
"""A motion this close to an earlier impact may have closed; in periods and largest coordinates."""

REACHED = 0.1
"""How far from the simulated impacts the orbit may be, likewise."""


class _End(enum.Enum):
    """How a motion ends."""

    SETTLED = enum.auto()
    RUNAWAY = enum.auto()
    FLOWN = enum.auto()
    GONE = enum.auto()
    UNSETTLED = enum.auto()


class Settled(NamedTuple):
    """What motions from random states settle on."""

    orbits: list[Orbit]
    """The stable orbits with impacts, each once."""
    motions: int
    """How many were simulated."""
    runaways: int
    """How many of them run away: `Outcome.RUNAWAY`."""
    flown: int
    """How many fly on without impacts as orbits of the word `0` do."""
    gone: int
    """How many fly on without impacts in another mode than the first, or with a free period."""
    unsettled: int
    """How many settle on no orbit of at most `LONGEST` impacts within `IMPACTS`, or stick."""
    cut: bool
    """Whether they ended before what `MOTIONS` and `QUIET` say, by `DEAR_STEPS`."""

    def words(self) -> list[str]:
        """Return the words of the orbits, each once, and 0 if motions fly on without impacts."""
        words = dict.fromkeys(str(word_of(orbit)) for orbit in self.orbits)
        return [*words, *(["0"] if self.flown else [])]

    def remarks(self, place: str, quiet: bool) -> list[str]:
        """Return what else the motions do that were simulated at a place, in sentences.

        Those without impacts are left out if orbits without impacts are followed (`quiet`).
        """
        counts = (
            (self.runaways, "run away, a million times faster than their start and their forcing"),
            (not quiet and self.flown, "fly on without impacts: add 0 to follow.orbits"),
            (self.gone, "fly on without impacts, which no word describes"),
            (
                self.unsettled,
                f"had not settled on an orbit of at most {LONGEST} impacts: they stick, are "
                "complex or take longer; contimpact simulate shows it",
            ),
        )
        said = [
            f"{count} of {self.motions} motions simulated at {place} {what}"
            for count, what in counts
            if count
        ]
        if self.cut:
            said.append(
                f"the simulation at {place} ended after {DEAR_STEPS} steps of integration and "
                f"{self.motions} motions"
            )
        return said


def settled_orbits(model: Model, kernels: Kernels, rng: np.random.Generator | int = 0) -> Settled:
    """Return the stable orbits with impacts on which motions from random states settle.

    The kernels, of the model, name the followed parameter.
    """
    simulator = Simulator(model, kernels, longest_flight=LONGEST_FLIGHT)
    generator = np.random.default_rng(rng)
    integrated = any(kernels.integrated(guard.name) for guard in model.WALLS)
    effort = 2 if integrated else int(simulator.machine.costly)
    motions, patience = (DEAR_MOTIONS, DEAR_QUIET) if effort else (MOTIONS, QUIET)
    looks = IMPACTS[: len(IMPACTS) - effort]
    found: list[Orbit] = []
    ends: Counter[_End] = Counter()
    quiet = made = 0
    with limited_steps(DEAR_STEPS) as budget:
        while made < motions and quiet < patience and budget.left > 0:
            orbit, end = _settle_orbit(simulator, simulator.random_state(generator), looks)
            made, ends[end] = made + 1, ends[end] + 1
            new = orbit is not None and not any(_same_orbit(orbit, other) for other in found)
            quiet = 0 if new else quiet + (end not in (_End.FLOWN, _End.GONE))
            if orbit is not None and new:
                found.append(orbit)
    cut = budget.left <= 0
    unsettled = max(ends[_End.UNSETTLED] - cut, 0)  # the last one was left
    runaways, flown, gone = ends[_End.RUNAWAY], ends[_End.FLOWN], ends[_End.GONE]
    return Settled(found, made, runaways, flown, gone, unsettled, cut)


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
) -> tuple[Orbit | None, _End]:
    """The orbit on which one motion settles, and how it ends."""
    try:
        return _after(simulator, state, looks)
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        # a flight has no value somewhere, or takes too many steps
        return None, _End.UNSETTLED


def _after(simulator: Simulator, state: State, looks: Sequence[int]) -> tuple[Orbit | None, _End]:
    """The same, where all flights stay finite."""
    for impacts in looks:
        run = simulator.run(state, impacts=impacts)
        if run.outcome is Outcome.RUNAWAY:
            return None, _End.RUNAWAY
        if run.left is not None:
            model = simulator.model
            first = not model.MODES or model.WALLS[run.left.wall].next_mode == model.MODES[0].name
            return None, _End.FLOWN if first and not model.autonomous else _End.GONE
        if run.end is None or run.outcome is not Outcome.DONE:
            break
        state = run.end
        if run.released.any() or run.held.any():
            continue  # it sticks, at the beginning perhaps
        for orbit in _orbits_near(simulator, run):
            if orbit.physical and np.max(np.abs(orbit.multipliers)) < 1.0:
                return orbit, _End.SETTLED
    return None, _End.UNSETTLED


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
