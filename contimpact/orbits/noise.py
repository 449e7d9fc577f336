r"""Fluctuations of a stable orbit under small noise, to first order.

Parameters that fluctuate are drawn anew at each impact, for the restitution there and the flight
that follows. The equations of flight k, linear in what is small,

.. math:: A_k\,\delta z_k + B_k\,\delta z_{k+1} + L_k\,\xi_k = 0, \qquad
          E[\xi_k] = 0,\; E[\xi_k \xi_l^T] = \delta_{kl}\,C,

carry the covariance S_k of the impacts from one to the next. Over a period it repeats itself where
the orbit is stable: a discrete Lyapunov equation (see Gardiner, Handbook of Stochastic Methods,
section 4.4).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..segments.kernels import Kernels
from .problem import Linearisation, OrbitProblem
from .quiet import problem_of

FAR = 3.0
"""Standard deviations from a touch or a vanishing velocity beyond which first order is trusted."""

STEP = 1e-5
"""Part of natural sizes by which gaps are differenced."""


@dataclass(frozen=True)
class Margin:
    """How far an orbit is from a touch of a wall, or from an impact's vanishing, under noise."""

    what: str
    """The gap to a wall inside a flight, or the velocity of an impact."""
    distance: float
    """The gap, or the velocity's size."""
    deviation: float
    """Its standard deviation."""

    @property
    def sigmas(self) -> float:
        """The distance in standard deviations."""
        return self.distance / self.deviation if self.deviation else float("inf")

    def __str__(self) -> str:
        return f"the {self.what} is {self.sigmas:.3g} standard deviations from zero"


@dataclass(frozen=True, eq=False)
class Fluctuations:
    """What small noise makes of a stable orbit; see `Orbit.fluctuations`."""

    deviations: Mapping[str, float]
    """Standard deviations of the parameters."""
    covariances: Array
    """Of the unknowns at each impact (time, velocity before impact, and others), shape (N, m,
    m)."""
    margins: tuple[Margin, ...]
    """Of each gap and each velocity, the nearest in standard deviations first."""

    @property
    def times(self) -> Array:
        """Standard deviations of the impact times, shape (N,)."""
        return np.sqrt(self.covariances[:, 0, 0])

    @property
    def velocities(self) -> Array:
        """Standard deviations of the velocities before impact, shape (N,)."""
        return np.sqrt(self.covariances[:, 1, 1])

    @property
    def trusted(self) -> bool:
        """Whether first order is enough: beside a grazing the map has no derivative."""
        return all(margin.sigmas > FAR for margin in self.margins)

    def __repr__(self) -> str:
        noise = ", ".join(f"{name} {value:g}" for name, value in self.deviations.items())
        spread = f"times {_numbers(self.times)}; velocities {_numbers(self.velocities)}"
        lines = [f"Fluctuations for {noise}: {spread}", *(f"  {m}" for m in self.margins[:1])]
        if not self.trusted:
            lines.append(
                "  that is too near for first order: motions leave the orbit's word; simulate them"
            )
        return "\n".join(lines)


def fluctuations_of(here: Linearisation, noise: Mapping[str, float]) -> Fluctuations:
    """Return an orbit's fluctuations; see `Orbit.fluctuations`."""
    from scipy.linalg import block_diag, solve_discrete_lyapunov

    problem, unknowns = here.problem, here.unknowns
    model = problem.model_at(unknowns)
    if problem.autonomous or not problem.word.walls:
        what = "its period is free, and its phase drifts" if problem.autonomous else "no impacts"
        raise InputError("orbit", what, "give an orbit with impacts of a forced system")
    if not (here.verdict.physical and max(abs(here.multipliers), default=0.0) < 1.0):
        found = f"multipliers {here.multipliers}" if here.verdict.physical else "it is unphysical"
        raise InputError("orbit", found, "give a physical orbit with all multipliers below 1")
    if not noise or not all(0.0 <= deviation < np.inf for deviation in noise.values()):
        accepted = "give standard deviations of parameters, such as {'r': 0.01}"
        raise InputError("noise", repr(dict(noise)), accepted)
    for name in noise:
        model.require(name, "noise")
    count, m = len(problem.word), problem.m
    problems = {name: problem_of(model, problem.word, Kernels(model, name)) for name in noise}
    there = [
        own.evaluate(np.append(unknowns[: problem.n], model.values[name])).by_parameter
        for name, own in problems.items()
    ]
    deviations = np.array(list(noise.values()))
    kicks = np.concatenate(there, axis=1).reshape(count, m, -1) * deviations
    try:
        step = -np.linalg.solve(here.end, here.start)
        kick = -np.linalg.solve(here.end, kicks)
    except np.linalg.LinAlgError:
        found = "an impact of zero velocity"
        raise InputError("orbit", found, "take an orbit beside the event") from None
    whole, heard = np.eye(m), np.zeros((m, m))
    for k in range(count):
        whole = step[k] @ whole
        heard = step[k] @ heard @ step[k].T + kick[k] @ kick[k].T
    covariances = [solve_discrete_lyapunov(whole, heard)]
    for k in range(count - 1):
        covariances.append(step[k] @ covariances[k] @ step[k].T + kick[k] @ kick[k].T)
    margins = []
    for k, gaps in enumerate(here.gaps):
        joint = block_diag(covariances[k], np.diag(deviations**2))
        for place, (wall, touch) in enumerate(zip(model.letters, gaps.touches, strict=True)):
            if touch is not None:
                slope = _gap_slope(problems, here, k, place)
                spread = (
                    float(np.sqrt(slope @ joint @ slope)) if all(np.isfinite(slope)) else np.inf
                )
                margins.append(Margin(f"gap in flight {k + 1} to {wall}", touch.gap, spread))
    for k, (velocity, wall) in enumerate(
        zip(problem.impacts(unknowns)[:, 1].tolist(), problem.word.walls, strict=True)
    ):
        spread = float(np.sqrt(covariances[k][1, 1]))
        margins.append(Margin(f"velocity of impact {k + 1} on {wall}", abs(velocity), spread))
    margins.sort(key=lambda margin: margin.sigmas)
    return Fluctuations(dict(noise), np.array(covariances), tuple(margins))


def _gap_slope(
    problems: Mapping[str, OrbitProblem], here: Linearisation, flight: int, place: int
) -> Array:
    """Derivatives of a gap by the unknowns where its flight begins, then by parameters.

    By central differences, which give more digits than a margin needs; infinite where the flight
    stops turning towards the wall.
    """
    n, m, unknowns = here.problem.n, here.problem.m, here.unknowns
    values = here.problem.model_at(unknowns).values
    sizes = here.problem.scale(unknowns, 1.0)

    def slope(problem: OrbitProblem, at: Array, number: int) -> float:
        step = STEP * (sizes[number] if number < n else max(1.0, abs(at[n])))
        gaps = []
        for moved in (at[number] + step, at[number] - step):
            there = np.where(np.arange(n + 1) == number, moved, at)
            touch = problem.evaluate(there).gaps[flight].touches[place]
            gaps.append(touch.gap if touch else np.nan)
        difference = (gaps[0] - gaps[1]) / (2.0 * step)
        return difference if np.isfinite(difference) else np.inf

    by_state = [slope(here.problem, unknowns, m * flight + i) for i in range(m)]
    by_parameter = [
        slope(own, np.append(unknowns[:n], values[name]), n) for name, own in problems.items()
    ]
    return np.array([*by_state, *by_parameter])


def _numbers(values: Array) -> str:
    return ", ".join(f"{value:.3g}" for value in values)
