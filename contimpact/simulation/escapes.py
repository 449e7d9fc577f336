"""How often noise takes a motion out of a stable orbit: escapes per period, by simulation.

Beside a grazing the map has no derivative, and fluctuations to first order say nothing. Simulated
motions begin on the orbit; parameters are drawn anew at each impact, for the restitution there and
the flight that follows, as for `contimpact.orbits.orbit`. A motion escapes when it meets another
wall than the orbit's word says. Escapes that are independent of each other are a Poisson process,
whose rate has the interval of Garwood (1936).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..errors import InputError, explain_arguments
from ..orbits.orbit import Orbit
from ..progress import Asked, progress_lines
from ..segments.kernels import Kernels
from .run import Outcome
from .simulator import Simulator

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
