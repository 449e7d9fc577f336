"""An event on a branch, as the catalogue records it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array
from ..display import Shown, Summary, frame
from ..errors import printable

if TYPE_CHECKING:
    from ..models.model import Model
    from ..orbits.orbit import Orbit


FLAT = tuple(
    """id kind ghost label why branch word period notation becomes order criticality slope wall
    flight impact touch_time requested parameter n_unstable stable physical reason residual error
    method arclength opens""".split()
)
"""What stands in an entry's row as it is."""


STATES = {"positions": "position", "velocities": "velocity"}
"""Of an impact's record: what a column of one coordinate is called."""


@dataclass(frozen=True)
class Entry(Shown):
    """An event on a branch, as the catalogue records it; the attributes are its keys.

    Attributes
    ----------
    id, branch : str
        Its own name and its branch's.
    kind : str
        FB, BP, PD, NS, G, V, T, UZ, or a user's name.
    label : str
        As in Table 1 of the paper: ``PD``, ``~PD``, ``G[1:1->2:1]``.
    ghost : bool
        Whether the orbit that carries it is unstable or unphysical for another reason than the
        event; `n_unstable`, `stable`, `physical` and `reason` likewise leave the event out.
    word, period, notation
        The orbit.
    why : str or None
        Why it is a ghost.
    becomes : str or None
        The word beyond a grazing or a zero velocity, with its period.
    order : int or None
        For G, how many impacts are added.
    criticality : str or None
        ``supercritical`` or ``subcritical``, for G and PD, where it can be told.
    slope : float or None
        For G, the derivative of the new impact's velocity towards its wall with respect to the
        parameter.
    flight, impact, wall, touch_time
        Where it happens, as far as that applies.
    requested : mapping or None
        For UZ, the requested name and value.
    parameters : mapping of str to float
        All parameters and derived parameters.
    impacts : sequence of mappings
        Wall, time, velocity of each impact (with several degrees of freedom also the other section
        coordinates, and all positions and velocities before it); the first time is in [0, T).
    multipliers : sequence of (real, imaginary)
        None stands for an infinite multiplier.
    multipliers_before, multipliers_after
        The same at the neighbouring points of the branch.
    residual, error : float
        Of the equations it was located with; a bound of the error of the followed parameter.
    method : str
        ``newton`` on the extended system, or ``bracket``.
    arclength : float
        Where it lies on its branch.
    tangent : sequence of float or None
        For BP, the branch's direction: by the time and section coordinates of each impact in turn,
        and by the parameter.
    opens : sequence of str
        Branches that start here.
    system, options
        The model, and the texts that shape its formulas; None and empty where a catalogue of an
        earlier version does not say.
    sliding : str or None
        Which sliding bifurcation it is: ``grazing-sliding``, ``adding-sliding``,
        ``switching-sliding`` or ``crossing-sliding``.
    certified_radius : float or None
        Radius of the proven enclosure of the followed parameter, where the entry is certified.
    nu, nu_error : float or None
        For BP, what would unfold the crossing of branches, zero within its estimated error.
    orbit_period : float or None
        The orbit's period, where it is free; the first impact is then at t = 0.
    """

    id: str
    kind: str
    ghost: bool
    label: str
    why: str | None
    branch: str
    word: str
    period: int
    notation: str
    becomes: str | None
    order: int | None
    criticality: str | None
    slope: float | None
    wall: str | None
    flight: int | None
    impact: int | None
    touch_time: float | None
    requested: Mapping[str, float] | None
    parameter: str
    parameters: Mapping[str, float]
    impacts: Sequence[Mapping[str, Any]]
    multipliers: Sequence[tuple[float, float] | None]
    multipliers_before: Sequence[tuple[float, float] | None]
    multipliers_after: Sequence[tuple[float, float] | None]
    n_unstable: int
    stable: bool
    physical: bool
    reason: str | None
    residual: float
    error: float
    method: str
    arclength: float
    tangent: Sequence[float] | None = None
    opens: Sequence[str] = ()
    system: str | None = None
    options: Mapping[str, str] = field(default_factory=dict)
    nu: float | None = None
    nu_error: float | None = None
    certified_radius: float | None = None
    orbit_period: float | None = None
    sliding: str | None = None

    @property
    def times(self) -> Array:
        """Impact times, shape (N,)."""
        return np.array([impact["time"] for impact in self.impacts], dtype=float)

    @property
    def velocities(self) -> Array:
        """Velocities before impact, shape (N,)."""
        return np.array([impact["velocity"] for impact in self.impacts], dtype=float)

    @property
    def value(self) -> float:
        """Value of the followed parameter."""
        return self.parameters[self.parameter]

    def orbit(self, model: Model | None = None) -> Orbit:
        """Return the orbit at the event, to continue it or to look at it.

        Parameters
        ----------
        model : Model, optional
            The system, where its name does not tell: an own one that is not imported. Parameter
            values are taken from the entry.

        Raises
        ------
        InputError
            If the system is not known, or the entry is none of it.
        """
        from .recovery import orbit_of

        return orbit_of(self, model)

    def as_row(self) -> dict[str, Any]:
        """Return the entry as a row of a table; impacts and multipliers are spread over columns."""
        row: dict[str, Any] = {name: getattr(self, name) for name in FLAT}
        row["opens"] = " ".join(self.opens)
        if self.requested is not None:
            row["requested"] = " ".join(f"{n}={v!r}" for n, v in self.requested.items())
        row |= self.parameters
        if self.orbit_period is not None:
            row["orbit_period"] = self.orbit_period
        for k, impact in enumerate(self.impacts, start=1):
            for name, value in impact.items():
                if isinstance(value, list):  # of every coordinate
                    row |= {f"{STATES[name]}{i}_{k}": x for i, x in enumerate(value, start=1)}
                else:
                    row[f"{name}{k}"] = value
        for k, mu in enumerate(self.multipliers, start=1):
            real, imaginary = mu or (None, None)
            row |= {f"multiplier{k}_re": real, f"multiplier{k}_im": imaginary}
        return row

    def to_dataframe(self) -> Any:
        """Return the entry as a pandas DataFrame of one row; pandas must be installed."""
        return frame([self.as_row()])

    def summary(self) -> Summary:
        """Return the entry's orbit in short."""
        columns = ("wall", "time", "velocity before impact")
        rows = [(impact["wall"], impact["time"], impact["velocity"]) for impact in self.impacts]
        error = f"error {self.error:.1g}, {self.method}"
        notes = [
            error,
            *([self.sliding] if self.sliding else []),
            *([f"a ghost: {self.why}"] if self.why else []),
        ]
        return Summary(repr(self)[1:-1], columns, rows, notes)

    def __repr__(self) -> str:
        return printable(f"<{self.label} on {self.branch} at {self.parameter} = {self.value:.12g}>")
