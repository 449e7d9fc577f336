"""The orbits that a diagram starts from, found by search and by simulation.

The search is a random one: a word is never said to have no orbit, only that none was found, where,
and with how many starts. So that what attracts is found, however small a search is, a few motions
from random states are simulated for some dozens of impacts. Where one comes back near an earlier
impact, Newton's iteration solves for the orbit of the impacts between, with the equations of the
search. It counts if it is stable and physical.
"""

from __future__ import annotations

import contextlib
import enum
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..arrays import Array
from ..errors import InputError, count_text, explain_arguments, random_generator, short_repr
from ..models.guards import Word, graph, parse_word, repetitions
from ..models.model import Model
from ..orbits import search as orbits_search
from ..orbits.orbit import Orbit
from ..orbits.quiet import problem_of
from ..orbits.search import (
    SAME_ORBIT,
    Search,
    add_orbits,
    fills_a_family,
    reduce_period,
    rotate_to_word,
    search,
    solve_near,
)
from ..progress import Asked, Progress, ignore_progress, progress_lines
from ..results.scene import Scene
from ..segments.integration import StepLimitError, limited_steps
from ..segments.kernels import Kernels

if TYPE_CHECKING:
    from ..simulation.run import Run, State
    from ..simulation.simulator import Simulator
    from ..storage import Json


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


class MotionEnd(enum.Enum):
    """How a motion ends; the value is what is said of it, if anything."""

    SETTLED = ""
    RUNAWAY = "run away, a million times faster than their start and their forcing"
    FLOWN = "fly on without impacts: add 0 to follow.orbits"
    """As orbits of the word `0` do."""
    GONE = "fly on without impacts, which no word describes"
    """In another mode than the first, or with a free period."""
    BEYOND = (
        "ended: a jump led behind a guard of the next mode, where the system does not say how to "
        "go on; contimpact simulate names the guard"
    )
    UNSETTLED = (
        f"had not settled on an orbit of at most {LONGEST} impacts: they stick, are complex or "
        "take longer; contimpact simulate shows it"
    )


class Settled(NamedTuple):
    """What motions from random states settle on."""

    orbits: list[Orbit]
    """The stable orbits with impacts, each once."""
    motions: int
    """How many were simulated."""
    ends: Mapping[MotionEnd, int]
    """How many of them end in each way."""
    cut: bool
    """Whether they ended before what `MOTIONS` and `QUIET` say, by `DEAR_STEPS`."""

    def words(self) -> list[str]:
        """Return the words of the orbits, each once, and 0 if motions fly on without impacts."""
        words = dict.fromkeys(str(word_of(orbit)) for orbit in self.orbits)
        return [*words, *(["0"] if self.ends.get(MotionEnd.FLOWN) else [])]

    def remarks(self, place: str, quiet: bool) -> list[str]:
        """Return what else the motions do that were simulated at a place, in sentences.

        Those without impacts are left out if orbits without impacts are followed (`quiet`).
        """
        told = [end for end in MotionEnd if end.value and not (quiet and end is MotionEnd.FLOWN)]
        motions = count_text(self.motions, "motion")
        said = [
            f"{self.ends[end]} of {motions} simulated at {place} {end.value}"
            for end in told
            if self.ends.get(end)
        ]
        if self.cut:
            said.append(
                f"the simulation at {place} ended after {DEAR_STEPS} steps of integration and "
                f"{motions}"
            )
        return said


def settled_orbits(model: Model, kernels: Kernels, rng: np.random.Generator | int = 0) -> Settled:
    """Return the stable orbits with impacts on which motions from random states settle.

    The kernels, of the model, name the followed parameter.
    """
    from ..simulation.simulator import Simulator

    simulator = Simulator(model, kernels, longest_flight=LONGEST_FLIGHT)
    generator = random_generator(rng)
    integrated = any(kernels.integrated(guard.name) for guard in model.WALLS)
    effort = 2 if integrated else int(simulator.machine.costly)
    motions, patience = (DEAR_MOTIONS, DEAR_QUIET) if effort else (MOTIONS, QUIET)
    looks = IMPACTS[: len(IMPACTS) - effort]
    found: list[Orbit] = []
    ends: Counter[MotionEnd] = Counter()
    quiet = made = 0
    with limited_steps(DEAR_STEPS) as budget:
        while made < motions and quiet < patience and budget.left > 0:
            orbit, end = _settle_orbit(simulator, simulator.random_state(generator), looks)
            made, ends[end] = made + 1, ends[end] + 1
            new = orbit is not None and not any(_same_orbit(orbit, other) for other in found)
            quiet = 0 if new else quiet + (end not in (MotionEnd.FLOWN, MotionEnd.GONE))
            if orbit is not None and new:
                found.append(orbit)
    cut = budget.left <= 0
    ends[MotionEnd.UNSETTLED] = max(ends[MotionEnd.UNSETTLED] - cut, 0)  # the last one was left
    return Settled(found, made, ends, cut)


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
) -> tuple[Orbit | None, MotionEnd]:
    """The orbit on which one motion settles, and how it ends."""
    try:
        return _after(simulator, state, looks)
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        # a flight has no value somewhere, or takes too many steps
        return None, MotionEnd.UNSETTLED


def _after(
    simulator: Simulator, state: State, looks: Sequence[int]
) -> tuple[Orbit | None, MotionEnd]:
    """The same, where all flights stay finite."""
    from ..simulation.run import Outcome

    for impacts in looks:
        run = simulator.run(state, impacts=impacts)
        if run.outcome is Outcome.RUNAWAY:
            return None, MotionEnd.RUNAWAY
        if run.outcome is Outcome.BEYOND:
            return None, MotionEnd.BEYOND
        if run.left is not None:
            model = simulator.model
            first = not model.MODES or model.WALLS[run.left.wall].next_mode == model.MODES[0].name
            return None, MotionEnd.FLOWN if first and not model.autonomous else MotionEnd.GONE
        if run.end is None or run.outcome is not Outcome.DONE:
            break
        state = run.end
        if run.released.any() or run.held.any():
            continue  # it sticks, at the beginning perhaps
        for orbit in _orbits_near(simulator, run):
            if orbit.physical and np.max(np.abs(orbit.multipliers)) < 1.0:
                return orbit, MotionEnd.SETTLED
    return None, MotionEnd.UNSETTLED


def _orbits_near(simulator: Simulator, run: Run) -> Iterator[Orbit]:
    """The orbits through the end of a run, of as few impacts as possible first."""
    from ..simulation.attractor import own_sizes

    model, period, last = simulator.model, simulator.period, len(run) - 1
    rows = np.column_stack([run.turns * period + run.phases, run.velocities, *run.others.T])
    sizes = own_sizes(rows[:, 1:], period)
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
    return other.problem.apart(turned, other.unknowns) < SAME_ORBIT


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


SURVEYED = 9
"""Values of the followed parameter at which words are looked for besides the start."""

GLANCE = 64
"""Random starts at such a value, unless a survey was asked for; where they find an orbit, it is
searched as the start is."""


STEPS_ELSEWHERE = 1_000_000
"""Steps of integration that the search for a word there may take, if only to say where it is."""


@dataclass(frozen=True)
class NotFound:
    """A word of which no orbit was found at a scene's start."""

    word: Word
    notation: str
    parameter: str
    value: float
    """Value of the followed parameter at the start."""
    starts: int
    """Random starts in each round of the search."""
    rounds: int
    """Rounds that were made."""
    repeated: tuple[str, ...] = ()
    """Orbits at the start that read as the word if they are run several times, by their
    notation."""
    tried: int = 0
    """Other values at which orbits were looked for."""
    elsewhere: tuple[tuple[float, int], ...] = ()
    """Those at which some were found, and how many."""
    starts_elsewhere: int = GLANCE
    """Random starts at each of them in the first round."""
    unphysical: int = 0
    """Unphysical orbits at the start, where such orbits are not followed; physical ones that were
    found elsewhere are followed then."""
    family: bool = False
    """Whether the orbits at the start are not isolated."""

    @classmethod
    def of(cls, scene: Scene, kernels: Kernels, word: Word) -> NotFound:
        """Tell what a search in vain at a scene's start has tried: it ends after two rounds."""
        letters = scene.model.letters
        here = partial(search_at, scene, kernels, value=scene.start)
        shorter = [w for w in word.repeated() if here(w).orbits]
        tried = scene.parameter, scene.start, scene.starts, min(scene.rounds, 2)
        notations, glance = tuple(w.notation(letters) for w in shorter), _quick_search(scene).starts
        family = not word.walls and fills_a_family(problem_of(scene.model, word, kernels))
        found = cls(word, word.notation(letters), *tried, notations, starts_elsewhere=glance)
        return replace(found, family=family)

    def also_at(self, value: float, count: int) -> NotFound:
        """Return the same after a search at another value, and how many orbits it found."""
        found = ((value, count),) if count else ()
        return replace(self, tried=self.tried + 1, elsewhere=self.elsewhere + found)

    @property
    def but(self) -> str:
        """What was found instead, in words; empty if nothing was."""
        if self.family:
            return " but a family that cannot be followed (as where nothing holds a coordinate)"
        return f" but {repetitions(self.repeated)}" if self.repeated else ""

    @property
    def nearby(self) -> str:
        """How many orbits there are elsewhere, in words."""
        return ", ".join(f"{n} at {self.parameter} = {value:.6g}" for value, n in self.elsewhere)

    def told(self, surveyed: bool) -> str:
        """Return what a diagram's note says; a survey has followed what was found elsewhere."""
        if self.elsewhere:
            followed = surveyed or self.unphysical
            done = "followed from there" if followed else "follow.survey = true follows them"
            return f"{self}; {self.nearby} ({done})"
        return f"{self}" + (f", {self.nowhere}" if self.tried and not self.family else "")

    @property
    def nowhere(self) -> str:
        """Where else nothing was found, in words."""
        if not self.tried:
            return "other values were left out, as flights take too many steps of integration"
        values = count_text(self.tried, "other value")
        return f"nor at {values} within the range ({self.starts_elsewhere} random starts at each)"

    def as_record(self) -> dict[str, Json]:
        """Return plain data, as the manifest has it."""
        found = asdict(self)
        found |= {"word": self.word.walls, "repeated": list(self.repeated)}
        found["elsewhere"] = list(map(list, self.elsewhere))
        return {"word": found.pop("word"), "period": self.word.period, **found}

    def __str__(self) -> str:
        rounds = count_text(self.rounds, "round")
        what = f"physical {self.word}" if self.unphysical else str(self.word)
        return (
            f"no {what} orbit{self.but} was found at {self.parameter} = {self.value:.9g} "
            f"({rounds} of {self.starts} random starts)"
        )


def error_at_key(error: InputError, scene: Scene) -> InputError:
    """Return an error of a scene's kernels at a key of the scene."""
    if error.where == "parameter":
        return error.within("follow")
    of_model = error.where == "period" or error.where in scene.model.options
    return error.within("model") if of_model else error


def search_at(scene: Scene, kernels: Kernels, word: Word, value: float) -> Search:
    """Search for a word at a value of a scene's parameter, with the scene's options."""
    model = scene.model.replace(**{scene.parameter: value})
    tried = scene.seed, scene.starts, scene.rounds
    return search(model, word, scene.parameter, kernels, *tried)


def add_settled(
    scene: Scene,
    kernels: Kernels,
    found: Mapping[Word, Sequence[Orbit]],
    progress: Progress = ignore_progress,
) -> tuple[dict[Word, list[Orbit]], Settled | None]:
    """Return the orbits of each word at a scene's start, and on what simulations settle there.

    Nothing is simulated where the search has found an orbit of each word that attracts. Otherwise
    what is simulated on orbits of these words is added to those that were found.
    """
    if all(attracts(orbits) for word, orbits in found.items() if word.walls):
        return {word: list(orbits) for word, orbits in found.items()}, None

    progress(f"simulating at {scene.parameter} = {scene.start:.9g}")
    settled = settled_orbits(scene.model, kernels, scene.seed)
    problems = {word: problem_of(scene.model, word, kernels) for word in found}
    return {
        word: add_orbits(orbits, problems[word], unknowns_of_word(settled.orbits, word))
        if word.walls
        else [*orbits]
        for word, orbits in found.items()
    }, settled


def attracts(orbits: Iterable[Orbit]) -> bool:
    """Whether one of the orbits is stable and physical."""
    return any(orbit.stable and orbit.physical for orbit in orbits)


def search_elsewhere(scene: Scene, kernels: Kernels, word: Word, value: float) -> Search:
    """Search at a value besides the start: with few starts, if only to say where orbits are."""
    if not scene.survey:
        glance = search_at(_quick_search(scene), kernels, word, value)
        if not glance.orbits:
            return glance
    return search_at(scene, kernels, word, value)


def _quick_search(scene: Scene) -> Scene:
    """The scene with the search by which other values are looked at first."""
    return scene if scene.survey else replace(scene, starts=min(GLANCE, scene.starts), rounds=1)


def survey_values(scene: Scene) -> list[float]:
    """Return the values across a scene's range at which words are looked for."""
    values: list[float] = np.linspace(*scene.range, SURVEYED + 2)[1:-1].tolist()
    return values


def not_found(
    scene: Scene, kernels: Kernels, word: Word, progress: Progress = ignore_progress
) -> NotFound:
    """Return what is known of a word without an orbit at the start, looked for elsewhere.

    Without a survey fewer values are looked at where `STEPS_ELSEWHERE` are used up.
    """

    found = NotFound.of(scene, kernels, word)
    with limited_steps(STEPS_ELSEWHERE) if not scene.survey else contextlib.nullcontext() as budget:
        for value in survey_values(scene):
            progress(f"looking for {word} at {scene.parameter} = {value:.6g}")
            try:
                count = len(search_elsewhere(scene, kernels, word, value).orbits)
            except StepLimitError:  # not looked at whole
                continue
            if budget is not None and budget.left <= 0 and not count:
                break
            found = found.also_at(value, count)
    return found


def refusal(missing: Sequence[NotFound], settled: Settled | None = None) -> InputError:
    """Return the error of a scene of whose words none has an orbit at its start, where simulations
    have settled on others."""
    first = next((each for each in missing if each.elsewhere), missing[0])
    others = [str(each.word) for each in missing if each is not first]
    found = str(first) + (f", nor of {', '.join(others)}" if others else "")
    words = settled.words() if settled else []
    others = [word for word in words if word not in [str(each.word) for each in missing]]
    remedy = _remedy(first, others)
    if settled and not others:
        place = f"{first.parameter} = {first.value:.9g}"
        remedy = "; ".join([remedy, *settled.remarks(place, quiet=True)])
    return InputError("follow.orbits", found, remedy)


def _remedy(lacking: NotFound, others: Sequence[str]) -> str:
    """What to do about a word without an orbit at the start, where simulation settles on others."""
    if others:
        words = " or ".join(others)
        return f"ask for {words}, on which simulation settles there; {_remedy(lacking, ())}"
    shorter = f"ask for {' or '.join(lacking.repeated)}, or " if lacking.repeated else ""
    if lacking.unphysical:
        shorter += f"follow unphysical ones ({lacking.unphysical}) by follow.unphysical = true, or "
    if lacking.elsewhere:
        start = f"start where one exists, by model.parameters.{lacking.parameter}"
        return f"{shorter}{start}: {lacking.nearby}"
    return f"{lacking.nowhere}; {shorter}try another word or parameters"


def orbits_at_start(scene: Scene, kernels: Kernels, word: Word) -> list[Orbit]:
    """Find the orbits of a word at a scene's start.

    Raises InputError if there is none; it says what was tried and what exists nearby.
    """
    found = search_at(scene, kernels, word, scene.start).orbits
    if not found:
        raise refusal([not_found(scene, kernels, word)])
    return found


# The public search for orbits of a word: from random starts, and by simulation.


@explain_arguments
def find_orbits(
    model: Model,
    word: str | Word,
    parameter: str | None = None,
    *,
    kernels: Kernels | None = None,
    rng: np.random.Generator | int = 0,
    starts: int = 256,
    rounds: int = 8,
    progress: Asked = False,
) -> list[Orbit]:
    """Find the orbits of a word: stable, unstable and unphysical ones.

    Parameters
    ----------
    model : Model
        The system at the parameter values of interest.
    word : str or Word
        ``"2:1"``, ``"1:1/2T"``, ``"BTBT/2T"``, ...
    parameter : str, optional
        The parameter that will be followed; the first of the model by default, or the last where
        the period is free: the first ones may bring a forcing.
    kernels : Kernels, optional
        Kernels to use, if some are at hand; they name the parameter.
    rng : None, int or numpy.random.Generator, default 0
        Where starts come from; see `numpy.random.default_rng`.
    starts : int
        Starts in one round; fewer for words of more than a dozen impacts.
    rounds : int
        Rounds at most; the search ends after two rounds in a row that find nothing new.
    progress : bool or callable
        Whether to tell on standard error how far the search is, or a function to call with lines
        of text.

    Returns
    -------
    list of Orbit
        Sorted by the first impact's velocity, largest first; impacts in order of time, the first
        in [0, T). Where several rotations of the word read the same, the first impact is the
        fastest of those it can be. Repetitions of an orbit of shorter period are left out. The list
        can be incomplete: the search is a random one.

    Raises
    ------
    InputError
        If the word cannot be read or the parameter is unknown.

    Notes
    -----
    Where random starts lead to no orbit that is stable and physical, a few short simulations from
    random states are made as well: an attractor on which one of them settles is found.
    """
    if not isinstance(model, Model):
        raise InputError(
            "model", f"found {short_repr(model)}", "give a model, such as ImpactPair(...)"
        )
    first = list(model.values)[-1 if model.autonomous else 0]
    kernels = kernels or Kernels(model, parameter or first)
    kernels.require_room(model)
    found = orbits_search.find_orbits(
        model, word, kernels=kernels, rng=rng, starts=starts, rounds=rounds, progress=progress
    )
    if not isinstance(word, Word):
        word = parse_word(word, model.letters, graph=graph(model.WALLS), free=model.autonomous)
    if not word.walls or attracts(found):
        return found

    with progress_lines(progress, f"find_orbits {word}") as tell:
        tell("simulating from random states")
        settled = unknowns_of_word(settled_orbits(model, kernels, rng).orbits, word)
    return orbits_search.add_orbits(found, problem_of(model, word, kernels), settled)
