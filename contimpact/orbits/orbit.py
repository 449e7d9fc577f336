"""A periodic orbit, as users see it, its sensitivities, and its fluctuations under small noise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..arrays import Array
from ..display import NotebookResult, ParameterItems, Summary, frame, limit_lines
from ..errors import InputError, short_repr
from ..models.guards import Word, name_orbit
from ..models.model import Model
from ..models.outputs import Harvester, Output, check_output
from .outputs import Contact, Mean, contacts_of, means_of, rates_of, slopes_of_means, values_at
from .problem import Linearisation, OrbitProblem, Path, motion_of, path_of
from .quiet import problem_in

if TYPE_CHECKING:
    from pandas import DataFrame

# How an orbit moves with a parameter, to first order.


class Sensitivity(NamedTuple):
    """Derivatives of an orbit with respect to a parameter, all others held."""

    times: Array
    """Derivatives of the impact times, shape (N,)."""
    velocities: Array
    """Derivatives of the velocities before impact, shape (N,)."""


@dataclass(frozen=True, eq=False)
class Orbit(ParameterItems, NotebookResult):
    """A periodic orbit, physical or not.

    Attributes
    ----------
    problem : OrbitProblem
    linearisation : Linearisation
    """

    problem: OrbitProblem
    linearisation: Linearisation

    @property
    def unknowns(self) -> Array:
        """Impact times, section coordinates and the free parameter, shape (n + 1,)."""
        return self.linearisation.unknowns

    @property
    def word(self) -> Word:
        """The walls visited, and the period."""
        return self.problem.word

    @property
    def notation(self) -> str:
        """The word, as a count of impacts, such as ``2:1`` or ``1:1/2T``."""
        return self.word.notation(self.problem.model.letters)

    @property
    def parameter(self) -> str:
        """The parameter followed."""
        return self.problem.parameter

    @property
    def value(self) -> float:
        """Value of this parameter."""
        return float(self.unknowns[-1])

    @property
    def model(self) -> Model:
        """The model, at the orbit's parameter values."""
        return self.problem.model_at(self.unknowns)

    @property
    def times(self) -> Array:
        """Impact times, shape (N,), in the model's clock; from 0 where the period is free."""
        times = self.problem.impacts(self.unknowns)[:, 0]
        return times - times[:1] if self.problem.autonomous else times

    @property
    def velocities(self) -> Array:
        """Velocities before impact, shape (N,)."""
        return self.problem.impacts(self.unknowns)[:, 1]

    @property
    def multipliers(self) -> Array:
        """Multipliers, largest first, complex."""
        return self.linearisation.multipliers

    @property
    def stable(self) -> bool:
        """Whether no multiplier lies outside the unit circle."""
        return self.linearisation.n_unstable == 0

    @property
    def physical(self) -> bool:
        """Whether the orbit stays within the walls with its impacts in order."""
        return self.linearisation.verdict.physical

    @property
    def parameters(self) -> Mapping[str, float]:
        """All parameters, derived ones included."""
        return {**self.model.values, **self.derived}

    @property
    def derived(self) -> Mapping[str, float]:
        """Derived parameters."""
        return self.linearisation.derived

    @property
    def smallest_gap(self) -> float:
        """Smallest gap inside a flight; not a number if no flight turns towards a wall."""
        return self.linearisation.verdict.smallest_gap

    @property
    def reason(self) -> str | None:
        """Why the orbit is unphysical, or None."""
        return self.linearisation.verdict.reason

    @property
    def residual(self) -> float:
        """Largest absolute residual."""
        return float(np.max(np.abs(self.linearisation.residual)))

    @property
    def period(self) -> float:
        """The orbit's period, in the model's clock."""
        return self.linearisation.span

    def path(self, points: int = 200) -> Path:
        """Return the motion along one period: times, gap coordinate and velocity.

        Parameters
        ----------
        points : int
            On each flight.
        """
        return path_of(self.linearisation, points)

    def motion(self, points: int = 200) -> Path:
        """Return the motion of all coordinates along one period: times, positions, velocities.

        Parameters
        ----------
        points : int
            On each flight.

        Returns
        -------
        Path
            `x` and `v` have a column for each degree of freedom, in the model's order. An orbit
            without impacts begins at t = 0.
        """
        return motion_of(self.linearisation, points)

    def evaluate(self, expression: str, points: int = 200) -> Array:
        """Return an expression at each time of `motion`, shape (times,).

        Parameters
        ----------
        expression : str
            In the names that ``[output]`` of a scene admits.
        points : int
            On each flight.

        Raises
        ------
        InputError
            For anything else in the expression.
        """
        outputs, model = self._outputs(expression)
        places = np.linspace(0.0, 1.0, points)
        return values_at(self.linearisation, outputs, model, places)[0].ravel()

    def _outputs(self, expression: str, *how: Any) -> tuple[list[Output], Model]:
        """An expression as the only one of some outputs, and the model in whose names it is."""
        model, output = self.model, Output("output", expression, *how)
        check_output(output, model, "expression")
        return [output], model

    def _in(self, parameter: str) -> Linearisation:
        """The orbit with another parameter free."""
        self.model.require(parameter, "parameter")
        problem, unknowns = problem_in(parameter, self.model, self.linearisation)
        return problem.evaluate(unknowns)

    @property
    def contacts(self) -> list[Contact]:
        """Contacts with what gives way, such as a soft stop: how long, how deep, how elastic."""
        return contacts_of(self.linearisation, self.model)

    def mean(
        self,
        expression: str,
        at_impacts: bool = False,
        contacts: str = "",
        *,
        per_time: bool = False,
        harvester: Harvester | None = None,
    ) -> Mean:
        """Return the mean of an expression over the period, and an estimate of its error.

        Parameters
        ----------
        expression : str
            In the names that ``[output]`` of a scene admits.
        at_impacts : bool
            Whether to take the mean of the values before impacts instead of that over time.
        contacts : str
            Letters at which contacts begin, to take the mean over these of an expression in their
            ``duration``, ``deflection``, ``speed`` and ``restitution`` and the parameters.
        per_time : bool
            Whether to take the sum of the values before impacts in a unit of time.
        harvester : Membrane, optional
            Gives the expression the name ``U``, the voltage of an impact at the velocity ``v``.

        Raises
        ------
        InputError
            For anything else in the expression.
        """
        at_impacts = at_impacts or per_time
        given = self._outputs(expression, at_impacts, contacts, per_time, harvester)
        return means_of(self.linearisation, *given)[0]

    def mean_sensitivity(
        self,
        expression: str,
        parameter: str,
        at_impacts: bool = False,
        *,
        per_time: bool = False,
        harvester: Harvester | None = None,
    ) -> float:
        """Return the exact derivative of a mean with respect to a parameter, all others held.

        Arguments as of `mean`.

        Raises
        ------
        InputError
            For anything else in the expression, a parameter the model does not have, or an orbit
            without impacts, at a fold or at a branch point.
        """
        at_impacts = at_impacts or per_time
        given = self._outputs(expression, at_impacts, "", per_time, harvester)
        return float(slopes_of_means(self._in(parameter), *given)[0, 0])

    def sensitivity(self, parameter: str) -> Sensitivity:
        """Return the derivatives of impact times and velocities with respect to a parameter.

        Raises
        ------
        InputError
            For a parameter the model does not have, or an orbit at a fold or a branch point.
        """
        here = self._in(parameter)
        rows = rates_of(here).reshape(-1, here.problem.m)
        return Sensitivity(rows[:, 0], rows[:, 1])

    def fluctuations(self, noise: Mapping[str, float]) -> Fluctuations:
        """Return what small noise makes of a stable orbit, to first order.

        Parameters
        ----------
        noise : mapping of str to float
            Standard deviations of parameters, each drawn anew at each impact, for the restitution
            there and the flight that follows.

        Returns
        -------
        Fluctuations
            Covariances of the impacts, and how many standard deviations the orbit is from a touch
            of a wall and from an impact's vanishing. Beside a grazing it says that first order is
            not enough.

        Raises
        ------
        InputError
            For an orbit that is not physical and stable, has no impacts, or a free period.
        """
        return fluctuations_of(self.linearisation, noise)

    def to_dataframe(self) -> DataFrame:
        """Return the impacts as a pandas DataFrame, a row for each; pandas must be installed."""
        walls, times, velocities = list(self.word.walls), self.times, self.velocities
        return frame({"wall": walls, "time": times, "velocity": velocities})

    def summary(self) -> Summary:
        """Return the orbit's impacts in short."""
        rows = zip(self.word.walls, self.times.tolist(), self.velocities.tolist(), strict=True)
        columns = ("wall", "time", "velocity before impact")
        return Summary(self._head(), columns, list(rows), [self.reason] if self.reason else [])

    def _head(self) -> str:
        state = f"{'' if self.stable else 'un'}stable{'' if self.physical else ', unphysical'}"
        factors = ", ".join(f"{mu if mu.imag else mu.real:.6g}" for mu in self.multipliers)
        place = (
            f"{name_orbit(self.notation, str(self.word))} at {self.parameter} = {self.value:.12g}"
        )
        return f"Orbit {place}: {state}; multipliers {factors}"

    def __repr__(self) -> str:
        rows = [
            f"  {wall}  t = {t:.12g}  v = {v:.12g}"
            for wall, t, v in zip(self.word.walls, self.times, self.velocities, strict=True)
        ]
        return limit_lines(self._head(), rows, [f"  {self.reason}"] if self.reason else [])


# Fluctuations of a stable orbit under small noise, to first order.
#
# Parameters that fluctuate are drawn anew at each impact, for the restitution there and the flight
# that follows. The equations of flight k, linear in what is small,
#
# .. math:: A_k\,\delta z_k + B_k\,\delta z_{k+1} + L_k\,\xi_k = 0, \qquad
#           E[\xi_k] = 0,\; E[\xi_k \xi_l^T] = \delta_{kl}\,C,
#
# carry the covariance S_k of the impacts from one to the next. Over a period it repeats itself
# where the orbit is stable: a discrete Lyapunov equation (see Gardiner, Handbook of Stochastic
# Methods, section 4.4).

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
    given = noise.values() if isinstance(noise, Mapping) else ()
    if not given or not all(isinstance(one, Real) and 0.0 <= one < np.inf for one in given):
        accepted = "give standard deviations of parameters, such as {'r': 0.01}"
        raise InputError("noise", short_repr(noise), accepted)
    for name in noise:
        model.require(name, "noise")
    count, m = len(problem.word), problem.m
    there = [problem_in(name, model, here) for name in noise]
    kicks = [own.evaluate(at).by_parameter for own, at in there]
    deviations = np.array(list(noise.values()))
    kicked = np.concatenate(kicks, axis=1).reshape(count, m, -1) * deviations
    try:
        step = -np.linalg.solve(here.end, here.start)
        kick = -np.linalg.solve(here.end, kicked)
    except np.linalg.LinAlgError:
        found = "an impact of zero velocity"
        raise InputError("orbit", found, "take an orbit beside the event") from None
    whole, heard = np.eye(m), np.zeros((m, m))
    for k in range(count):
        whole = step[k] @ whole
        heard = step[k] @ heard @ step[k].T + kick[k] @ kick[k].T
    units = problem.scale(unknowns, 1.0)[:m]
    area = np.outer(units, units)
    first = solve_discrete_lyapunov(whole * units / units[:, None], heard / area)
    covariances = [area * first]
    for k in range(count - 1):
        covariances.append(step[k] @ covariances[k] @ step[k].T + kick[k] @ kick[k].T)
    margins = []
    for k, gaps in enumerate(here.gaps):
        joint = block_diag(covariances[k], np.diag(deviations**2))
        for place, (wall, touch) in enumerate(zip(model.letters, gaps.touches, strict=True)):
            if touch is not None:
                slope = _gap_slope(there, deviations, here, k, place)
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
    moved: Sequence[tuple[OrbitProblem, Array]],
    deviations: Array,
    here: Linearisation,
    flight: int,
    place: int,
) -> Array:
    """Derivatives of a gap by the unknowns where its flight begins, then by parameters.

    By central differences, which give more digits than a margin needs; infinite where the flight
    stops turning towards the wall.
    """
    n, m, unknowns = here.problem.n, here.problem.m, here.unknowns
    sizes = here.problem.scale(unknowns, 1.0)

    def slope(problem: OrbitProblem, at: Array, number: int, size: float) -> float:
        step = STEP * size
        gaps = []
        for value in (at[number] + step, at[number] - step):
            there = np.where(np.arange(n + 1) == number, value, at)
            touch = problem.evaluate(there).gaps[flight].touches[place]
            gaps.append(touch.gap if touch else np.nan)
        difference = (gaps[0] - gaps[1]) / (2.0 * step)
        return difference if np.isfinite(difference) else np.inf

    by_state = [
        slope(here.problem, unknowns, i, sizes[i]) for i in range(m * flight, m * flight + m)
    ]
    by_parameter = [
        slope(own, at, n, max(abs(at[n]), deviation) or 1.0)
        for (own, at), deviation in zip(moved, deviations, strict=True)
    ]
    return np.array([*by_state, *by_parameter])


def _numbers(values: Array) -> str:
    return ", ".join(f"{value:.3g}" for value in values)
