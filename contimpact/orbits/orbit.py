"""A periodic orbit, as users see it, and its sensitivities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..arrays import Array
from ..display import NotebookResult, ParameterItems, Summary, frame, limit_lines
from ..models.model import Model
from ..models.outputs import Harvester, Output
from ..models.word import Word, name_orbit
from ..segments.kernels import Kernels
from .contacts import Contact, contacts_of
from .noise import Fluctuations, fluctuations_of
from .outputs import Mean, mean_output, rates_of
from .problem import Linearisation, OrbitProblem, Path, motion_of, path_of
from .quiet import problem_of

if TYPE_CHECKING:
    from pandas import DataFrame


# How an orbit moves with a parameter, to first order.


class Sensitivity(NamedTuple):
    """Derivatives of an orbit with respect to a parameter, all others held."""

    times: Array
    """Derivatives of the impact times, shape (N,)."""
    velocities: Array
    """Derivatives of the velocities before impact, shape (N,)."""


def sensitivity_of(orbit: Orbit, parameter: str) -> Sensitivity:
    """Solve J dz = -dF/dp for an orbit's derivative.

    Raises InputError for a parameter the model does not have, or an orbit at a fold or a branch
    point.
    """
    model = orbit.model
    model.require(parameter, "parameter")
    problem = problem_of(model, orbit.word, Kernels(model, parameter))
    unknowns = np.append(orbit.unknowns[: problem.n], model.values[parameter])
    rows = rates_of(problem.evaluate(unknowns)).reshape(-1, problem.m)
    return Sensitivity(rows[:, 0], rows[:, 1])


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
        output = Output("output", expression, at_impacts, contacts, per_time, harvester)
        return mean_output(self.linearisation, self.model, output)

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
        from .output_slopes import mean_slope

        at_impacts = at_impacts or per_time
        output = Output("output", expression, at_impacts, "", per_time, harvester)
        return mean_slope(self.linearisation, self.model, output, parameter)

    def sensitivity(self, parameter: str) -> Sensitivity:
        """Return the derivatives of impact times and velocities with respect to a parameter.

        Raises
        ------
        InputError
            For a parameter the model does not have, or an orbit at a fold or a branch point.
        """
        return sensitivity_of(self, parameter)

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
        factors = ", ".join(f"{_plain_number(mu):.6g}" for mu in self.multipliers)
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


def _plain_number(mu: complex) -> complex | float:
    return mu.real if mu.imag == 0.0 else mu
