"""Integrity: how far a stable orbit's impacts may be moved before the motion leads elsewhere.

The distance from an orbit to the nearest boundary of its basin, a measure of how large a
disturbance it survives (Soliman and Thompson, 1989, who call it local integrity). It is measured
among the states before impacts: phase in periods, every other coordinate in the largest value that
the orbit has of it. Rings of starts around each impact are simulated, the smallest first; in the
first one from which motion leads elsewhere the boundary is found by bisection, and then the nearest
part of it by turning the direction.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..arrays import Array
from ..errors import InputError, explain_arguments
from ..orbits.orbit import Orbit
from ..progress import Asked, progress_lines
from ..results.options import SETTLING, Settling
from ..segments.kernels import Kernels
from .attractor import Attractor
from .basins import attractor_numbers
from .run import Outcome, State
from .settle import settle
from .simulator import Simulator

SMALLEST, RATIO = 1e-4, 1.12
"""Radius of the first ring, and of each ring in that of the one before."""
SECTIONS = 16
"""Parts into which a stretch with a boundary is divided at once."""
TURNS = 24
"""Rounds in which directions around the nearest are tried, each within 0.7 of the last angle."""
FINEST = 1e-9
"""Part of the distance to which it is bracketed."""


@dataclass(frozen=True, eq=False)
class Integrity:
    """Distance of a stable orbit from the nearest boundary of its basin; see `integrity`."""

    distance: float
    """In the units of `sizes`; `largest` if no start led elsewhere."""
    error: float
    """Width of the last bracket. A part of the basin of another motion that is thinner than the
    spacing of starts may be nearer."""
    bounded: bool
    """Whether a boundary was met."""
    impact: int
    """The impact, from 1 on, that is moved."""
    wall: str
    change: Array
    """What is added to its time, velocity and other coordinates at the boundary, shape (m,)."""
    leads_to: str
    """What is reached beyond the boundary."""
    sizes: Array
    """Units of the coordinates: the period, the orbit's largest velocity before impact, and the
    largest of each other coordinate, shape (m,)."""
    starts: int
    """Starts simulated."""
    orbit: Orbit = field(repr=False)

    def __repr__(self) -> str:
        name, starts = f"Integrity of {self.orbit.notation}", f"; {self.starts} starts"
        if not self.bounded:
            return f"{name}: {self.distance:.6g} or more{starts}"
        changes = ", ".join(f"{value:+.4g}" for value in self.change)
        moved = f"impact {self.impact} on {self.wall} moved by ({changes})"
        value = f"{self.distance:.9g} (+- {self.error:.1g})"
        return f"{name}: {value}; {moved} leads to {self.leads_to}{starts}"


@explain_arguments
def integrity(
    orbit: Orbit,
    *,
    directions: int = 64,
    largest: float = 0.5,
    settling: Settling = SETTLING,
    rng: int = 0,
) -> Integrity:
    """Return how far a stable orbit is from the nearest boundary of its basin.

    Parameters
    ----------
    orbit : Orbit
        Stable and physical, with impacts.
    directions : int
        Starts on a ring around each impact. With one coordinate they are at equal angles, else at
        random.
    largest : float
        Largest distance looked at, in periods and in the orbit's largest velocity.
    settling : Settling
    rng : int
        Seed.

    Returns
    -------
    Integrity

    Raises
    ------
    InputError
        If the orbit is not stable, not physical, without impacts, or so near a boundary that a
        simulation leaves it; if numbers cannot be.
    """
    if not (orbit.stable and orbit.physical and orbit.word):
        found = "no impacts" if not orbit.word else "an orbit that cannot be observed"
        raise InputError("orbit", found, "give a stable physical orbit with impacts")
    if directions < 3 or not 0.0 < largest <= 10.0:
        found = f"directions {directions}, largest {largest}"
        raise InputError("integrity", found, "give at least 3 directions, and 0 < largest <= 10")
    return _Search(orbit, settling).nearest(directions, largest, np.random.default_rng(rng))


class _Search:
    """Starts around an orbit, and where they lead."""

    def __init__(self, orbit: Orbit, settling: Settling) -> None:
        self.orbit, self.settling = orbit, settling
        self.simulator = Simulator(orbit.model)
        self.impacts = np.asarray(orbit.problem.impacts(orbit.unknowns), dtype=float)
        self.sizes = np.max(np.abs(self.impacts), axis=0)
        self.sizes[self.sizes == 0.0] = 1.0
        self.sizes[0] = self.simulator.period
        start = self.state(0, np.zeros(self.impacts.shape[1]))
        self.known: list[Attractor] = [settle(self.simulator, start, settling)]
        if (reached := self.known[0].notation) != orbit.notation:
            found = f"simulated from {orbit.notation}, motion comes to {reached}"
            raise InputError("orbit", found, "give an orbit whose basin a simulation can resolve")
        self.starts = 0

    def state(self, impact: int, change: Array) -> State | None:
        """The start with an impact moved; None where it would run away from the wall."""
        time, velocity, *others = (self.impacts[impact] + self.sizes * change).tolist()
        wall = self.orbit.word.walls[impact]
        if velocity * self.simulator.sides[self.simulator.letters.index(wall)] <= 0.0:
            return None
        return self.simulator.state(wall, time % self.simulator.period, velocity, others)

    def reached(self, impacts: Array, changes: Array) -> Array:
        """The number of the attractor that each start leads to; the orbit's is 0."""
        states = [self.state(int(k), change) for k, change in zip(impacts, changes, strict=True)]
        there = [k for k, state in enumerate(states) if state is not None]
        self.starts += len(there)
        numbers = np.zeros(len(states), dtype=int)
        kept = [state for state in states if state is not None]
        numbers[there] = attractor_numbers(self.simulator, kept, self.known, self.settling)
        return numbers

    def bracket(self, impact: int, ray: Array, high: float, width: float) -> tuple[float, float]:
        """A stretch of a ray of at most this part of its length, from whose far end motion leads
        elsewhere, as it does from `high`."""
        low = 0.0
        while high - low > width * high:
            radii = np.linspace(low, high, SECTIONS + 1)[1:-1]
            beyond = self.reached(np.full(len(radii), impact), np.outer(radii, ray))
            first = int(np.argmax(beyond > 0)) if beyond.any() else len(radii)
            low, high = np.array([low, *radii, high])[first : first + 2].tolist()
        return low, high

    def nearest(self, directions: int, largest: float, generator: np.random.Generator) -> Integrity:
        count, size = self.impacts.shape
        angles = 2.0 * np.pi * np.arange(directions) / directions
        rays = np.column_stack([np.cos(angles), np.sin(angles)])
        if size > 2:
            rays = generator.normal(size=(directions, size))
            rays /= np.linalg.norm(rays, axis=1)[:, None]
        moved = np.repeat(np.arange(count), directions)
        rays = np.tile(rays, (count, 1))
        radius = SMALLEST
        while True:
            beyond = np.flatnonzero(self.reached(moved, radius * rays))
            if beyond.size or radius >= largest:
                break
            radius = min(RATIO * radius, largest)
        if not beyond.size:
            return self.result(largest, 0.0, False, 0, np.zeros(size))
        spread = 2.0 * np.pi / directions
        width = min(0.1 * spread**2, 0.1)
        impact, ray, high = 0, rays[0], radius / (1.0 - width)
        tried, near = moved[beyond], rays[beyond]
        for _ in range(TURNS):
            inside = high * (1.0 - width)
            for j in np.flatnonzero(self.reached(tried, inside * near)).tolist():
                k, one = int(tried[j]), near[j]
                inside = high * (1.0 - width)
                if self.reached(np.array([k]), inside * one[None])[0]:
                    impact, ray = k, one
                    high = self.bracket(k, one, inside, width)[1]
            near = ray + spread * generator.uniform(-1.0, 1.0, size=(SECTIONS, size))
            near /= np.linalg.norm(near, axis=1)[:, None]
            tried, spread = np.full(SECTIONS, impact), 0.7 * spread
            width = max(0.1 * spread**2, FINEST)
        inner, high = self.bracket(impact, ray, high, FINEST)
        return self.result(high, high - inner, True, impact, high * ray)

    def result(
        self, distance: float, error: float, bounded: bool, impact: int, change: Array
    ) -> Integrity:
        reached = self.reached(np.array([impact]), change[None])[0]
        return Integrity(
            distance,
            error,
            bounded,
            impact + 1,
            self.orbit.word.walls[impact],
            change * self.sizes,
            self.known[reached].notation,
            self.sizes,
            self.starts,
            self.orbit,
        )


# How often noise takes a motion out of a stable orbit: escapes per period, by simulation.
#
# Beside a grazing the map has no derivative, and fluctuations to first order say nothing. Simulated
# motions begin on the orbit; parameters are drawn anew at each impact, for the restitution there
# and the flight that follows, as for `contimpact.orbits.orbit`. A motion escapes when it meets
# another wall than the orbit's word says. Escapes that are independent of each other are a Poisson
# process, whose rate has the interval of Garwood (1936).

TOLD = 100
"""Motions after which progress is reported."""


@dataclass(frozen=True)
class EscapeRate:
    """Escapes of simulated motions from an orbit."""

    escapes: int
    motions: int
    periods: float
    """Forcing periods simulated of all motions together."""
    interval: tuple[float, float]
    """Of the rate, 95 %."""

    @property
    def rate(self) -> float:
        """Escapes per forcing period."""
        return self.escapes / self.periods

    def __repr__(self) -> str:
        low, high = self.interval
        head = f"{self.escapes} of {self.motions} motions escape in {self.periods:.6g} periods"
        return f"{head}: {self.rate:.3g} per period ({low:.3g} to {high:.3g})"


@explain_arguments
def escape_rate(
    orbit: Orbit,
    noise: Mapping[str, float],
    *,
    motions: int = 200,
    periods: int = 100,
    rng: np.random.Generator | int = 0,
    progress: Asked = False,
) -> EscapeRate:
    """Simulate how often noise takes motions out of a stable orbit.

    Parameters
    ----------
    orbit : Orbit
        Stable and physical, with impacts, of a forced system.
    noise : mapping of str to float
        Standard deviations of parameters, each drawn anew at each impact.
    motions, periods : int
        Motions, and forcing periods after which each is given up.
    rng : Generator or int
    progress : bool or callable

    Returns
    -------
    EscapeRate

    Raises
    ------
    InputError
        For an orbit that is not physical and stable, noise in the forcing period, or noise that
        takes a parameter out of its range.
    """
    from scipy.stats import chi2

    orbit.fluctuations(noise)  # refuses what has no fluctuations
    for name, count in (("motions", motions), ("periods", periods)):
        if count < 1:
            raise InputError(name, f"found {count!r}", "give a whole number >= 1")
    generator, model = np.random.default_rng(rng), orbit.model
    kernels = Kernels(model, next(iter(model.values)))
    still, word = Simulator(model, kernels), orbit.word
    rows = orbit.problem.impacts(orbit.unknowns)
    begin = still.state(word.walls[0], rows[0, 0], rows[0, 1], rows[0, 2:].tolist())
    turns = word.period or 1
    escapes, lasted = 0, 0.0
    with progress_lines(progress, "escape_rate") as tell:
        for motion in range(motions):
            if motion % TOLD == 0:
                tell(f"motion {motion + 1} of {motions}")
            state, escaped = begin, False
            for impact in range(len(word) * -(-periods // turns)):
                moved = {
                    name: model[name] + deviation * generator.standard_normal()
                    for name, deviation in noise.items()
                }
                simulator = Simulator(model.replace(**moved), kernels)
                if simulator.period != still.period:
                    found = "it changes the forcing period"
                    raise InputError("noise", found, "leave that parameter out")
                run = simulator.run(state, impacts=1)
                expected = word.walls[(impact + 1) % len(word)]
                escaped = (
                    run.outcome is not Outcome.DONE
                    or run.end is None
                    or still.letters[run.end.wall] != expected
                )
                if escaped or run.end is None:
                    break
                state = run.end
            escapes += escaped
            lasted += (impact + 1) / len(word) * turns
    low = chi2.ppf(0.025, 2 * escapes) / 2.0 if escapes else 0.0
    high = chi2.ppf(0.975, 2 * escapes + 2) / 2.0
    return EscapeRate(escapes, motions, lasted, (low / lasted, high / lasted))
