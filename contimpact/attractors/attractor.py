"""Attractors as data: what a simulated motion settles on, as files and pictures show it."""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..models.model import Model
from ..orbits.orbit import Orbit
from ..results.tables import same_data
from ..simulation.run import State
from ..storage.texts import made


class Kind(enum.Enum):
    """What a motion is; the value is how files and pictures call it."""

    PERIODIC = "periodic"
    STICKING = "sticking"
    COMPLEX = "complex"
    NOT_SETTLED = "not settled"
    RESTING = "resting"
    NO_IMPACT = "no impact"


@dataclass(frozen=True, eq=False)
class Attractor:
    """What was found at one set of parameter values.

    Attributes
    ----------
    kind : Kind
    parameters : mapping of str to float
        All parameters and derived parameters.
    word : str or None
        Walls of one period, its first rotation in the order of the walls, as ``BBT``; a sojourn on
        a wall, with the accumulation of impacts that leads to it, is written ``B*``.
    period : int or None
        In forcing periods.
    forcing_period : float
        T, in the unit of `times`.
    notation : str
        ``2:1``, ``1:1/2T``, ``1:1/C`` for complex motion, or the kind.
    walls, times, velocities, released : ndarray of shape (N,)
        Impacts of one period from the word's first one on, whose time is in [0, T); for motions
        that are not periodic, of the last part of the run.
    others : ndarray of shape (N, n)
        The other section coordinates, position and velocity of each coordinate but the one that the
        wall gives; n is zero for one degree of freedom.
    held : ndarray of int, shape (N,)
        The walls against which the system rests before each impact, a bit for each; of several
        degrees of freedom only.
    multipliers : tuple of complex, or None
        The largest first.
    exponents : tuple of float
        Lyapunov exponents per impact, the largest first, and its standard error; of periodic
        motion NaN where rounding leaves nothing of the multiplier, which is then zero.
    error : float
    exponent_sum : float or None
        Of periodic motion the sum of all exponents, from determinants, also where they are not
        known one by one; None where it is that of `exponents`.
    restitution : float
        Mean of ln r^2 over the impacts.
    per_period : float
        The largest exponent per forcing period.
    rate : float
        Impacts per forcing period.
    smallest_gap : float
        Nearest to a wall that a flight comes without touching it; periodic motions only.
    closing : float
        By how much the period closes.
    distance : float
        Of the motion from the periodic orbit when it was told.
    periods : int
        Simulated until then.
    state : State or None
        From which a neighbour can start.
    mode : str
        Of a motion without impacts, the mode in which it goes on; empty in systems of one mode.
    motion : tuple of float or None
        Of such a motion, if it settles on one of the forcing's period, position and velocity of
        each coordinate at t = 0: the unknowns x0, v0, x1, v1, ... of an orbit of the word ``0``.
    """

    kind: Kind
    parameters: Mapping[str, float]
    notation: str
    forcing_period: float
    word: str | None = None
    period: int | None = None
    walls: Array = field(default_factory=lambda: np.zeros(0, dtype=np.int8))
    times: Array = field(default_factory=lambda: np.zeros(0))
    velocities: Array = field(default_factory=lambda: np.zeros(0))
    released: Array = field(default_factory=lambda: np.zeros(0, dtype=bool))
    others: Array = field(default_factory=lambda: np.zeros((0, 0)))
    held: Array = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    multipliers: tuple[complex, ...] | None = None
    exponents: tuple[float, ...] = (math.nan, math.nan)
    error: float = math.nan
    restitution: float = math.nan
    per_period: float = math.nan
    rate: float = math.nan
    smallest_gap: float = math.nan
    closing: float = math.nan
    distance: float = math.nan
    periods: int = 0
    state: State | None = None
    mode: str = ""
    motion: tuple[float, ...] | None = None
    exponent_sum: float | None = None

    @property
    def label(self) -> str:
        """What tells one kind of motion from another along a sweep."""
        if self.kind is Kind.NO_IMPACT:
            return self.notation
        return f"{self.word}/{self.period}T" if self.word else self.kind.value

    @property
    def settled(self) -> bool:
        """Whether it is known what the motion is."""
        return self.kind is not Kind.NOT_SETTLED

    def __eq__(self, other: object) -> bool:
        return same_data(self, other) if isinstance(other, Attractor) else NotImplemented

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        word = f" ({self.word})" if self.word else ""
        return f"<{self.notation}{word}, velocities {np.array2string(self.velocities[:8])}>"

    def orbit(self, model: Model, parameter: str | None = None) -> Orbit:
        """Return a periodic motion as an orbit, which can be followed.

        Parameters
        ----------
        model : Model
            Its system; parameter values are taken from the attractor.
        parameter : str, optional
            That may be followed; the model's first one by default.

        Raises
        ------
        InputError
            If the motion is no orbit of impacts, or the system another one.
        """
        from ..results.branch import orbit_with

        if self.kind is not Kind.PERIODIC or self.word is None or self.period is None:
            accepted = "give one that is periodic; plot_sweep and portraits show any motion"
            raise InputError("attractor", f"found {self.label}", accepted)
        if lacking := [name for name in model.values if name not in self.parameters]:
            found = f"an attractor without {', '.join(lacking)}"
            raise InputError("model", found, "give the model it was simulated with")
        at = model.replace(**{name: self.parameters[name] for name in model.values})
        followed = parameter or next(iter(model.values))
        columns = [self.times, self.velocities, *self.others.T]
        unknowns = [*np.stack(columns, axis=1).ravel(), at.values[followed]]
        return orbit_with(at, (self.word, self.period), followed, np.array(unknowns))

    def as_record(self) -> dict[str, Any]:
        """Return plain data from which `from_record` makes the same attractor."""
        record = asdict(self) | {"kind": self.kind.name}
        for name in ("walls", "times", "velocities", "released", "others", "held"):
            record[name] = getattr(self, name).tolist()
        if not self.held.size:
            del record["others"], record["held"]
        if self.multipliers is not None:
            record["multipliers"] = [[mu.real, mu.imag] for mu in map(complex, self.multipliers)]
        return record

    @staticmethod
    def from_record(record: Mapping[str, Any]) -> Attractor:
        """Return the attractor a record was made of."""
        given = dict(record)
        kinds: dict[str, Any] = {"walls": np.int8, "times": float, "velocities": float}
        kinds |= {"released": bool, "others": float, "held": np.int64}
        for name, kind in kinds.items():
            if name in given:
                given[name] = np.array(given[name], dtype=kind)
        if given["multipliers"] is not None:
            given["multipliers"] = tuple(complex(*mu) for mu in given["multipliers"])
        return made(Attractor, given)

    def require(self, model: Model) -> None:
        """Raise `ValueError` if this cannot be an attractor of a model."""
        impacts = (self.walls, self.times, self.velocities, self.released)
        if {column.shape for column in impacts} != {(len(self.walls),)}:
            raise ValueError("impacts that are no table")
        if lacking := [n for n in (*model.values, *model.DERIVED) if n not in self.parameters]:
            raise ValueError(f"an attractor without {', '.join(lacking)}")
        walls, state = self.walls.tolist(), self.state
        width = model.unknowns_per_impact - 2
        if len(self.exponents) not in (2, 2 + width):
            raise ValueError("another number of exponents")
        if width and (self.others.shape, self.held.shape) != ((len(walls), width), (len(walls),)):
            raise ValueError("impacts without all coordinates")
        if self.motion is not None and len(self.motion) != width + 2:
            raise ValueError("a motion without all coordinates")
        numbers = [*self.times, *self.velocities, *self.others.ravel(), self.forcing_period]
        numbers += self.motion or ()
        if state is not None:
            walls.append(state.wall)
            numbers += [state.phase, *state.section]
            if len(state.others) != width:
                raise ValueError("a state without all coordinates")
            if not 0.0 <= state.phase <= self.forcing_period:
                raise ValueError(f"a phase of {state.phase:.6g}")
        if not all(0 <= wall < len(model.WALLS) for wall in walls):
            raise ValueError("an impact on a wall that is not there")
        if not np.isfinite(numbers).all():
            raise ValueError("impacts that are not finite")
