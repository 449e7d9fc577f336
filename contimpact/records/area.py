"""Areas of two parameters in which the same stable orbits end in the same way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

Ring = Sequence[tuple[float, float]]


@dataclass(frozen=True)
class StableOrbit:
    """A stable physical orbit of an area, and what ends it.

    Attributes
    ----------
    word, period, notation
        The orbit.
    ends : str or None
        Label of the bifurcation that it meets first as the parameter along the y axis falls; why
        its branch ends if it meets none; None where it goes on to the end of the range.
    kind : str or None
        Of the bifurcation.
    criticality : str or None
    mechanisms : sequence of int
        How it gives way to an orbit with one impact more, 1 to 4 as in `GrazingTransition`:
        all that runs inside the area show, none if they do not decide.
    """

    word: str
    period: int
    notation: str
    ends: str | None
    kind: str | None = None
    criticality: str | None = None
    mechanisms: Sequence[int] = ()

    def __str__(self) -> str:
        told = f"{self.notation} until {self.ends}" if self.ends else f"{self.notation} throughout"
        told += f" ({self.criticality})" if self.criticality else ""
        many = " or ".join(map(str, self.mechanisms))
        return told + (f", mechanism {many}" if many else "")


@dataclass(frozen=True)
class Doubt:
    """A place in an area where a run sees something else: what is stable there and how it ends, or
    that it ends on no curve, in words."""

    across: float
    along: float
    says: str


@dataclass(frozen=True)
class Area:
    """A part of a rectangle of two parameters, its borders those of curves.

    Attributes
    ----------
    id : str
    fixed : mapping of str to float
        The family's parameter.
    across, along : str
        The parameters: the second one, and the one that falls.
    orbits : sequence of StableOrbit
        That are stable in it: several where there is bistability, none where no orbit of the
        scene's words is stable.
    polygon : sequence of rings
        As coordinates of a GeoJSON polygon: points (across, along), the outer ring first,
        counter-clockwise, then holes; the last point of a ring is its first.
    borders : sequence of sequence of (int, str)
        For each ring the number of a point and what the border is from there on: a curve's name
        (or several, of curves that lie one on another), ``side`` of the rectangle, or ``line``,
        a vertical line below which the order of the curves changes.
    part : float
        Of the rectangle.
    places : sequence of (float, float)
        Points (across, along) in it, one for each of its cells, at which runs have looked.
    checked : int
        Cells in it of which all runs say the same, two at least.
    doubtful : sequence of Doubt
        Where another run says something else.
    departure : float
        The largest distance, in the parameter that falls, between an end of a stable orbit in a
        run and the curve.
    """

    id: str
    fixed: Mapping[str, float]
    across: str
    along: str
    orbits: Sequence[StableOrbit]
    polygon: Sequence[Ring]
    borders: Sequence[Sequence[tuple[int, str]]]
    part: float
    places: Sequence[tuple[float, float]]
    checked: int
    doubtful: Sequence[Doubt] = ()
    departure: float = 0.0

    @property
    def bistable(self) -> bool:
        """Whether several orbits are stable."""
        return len(self.orbits) > 1

    def holds(self, across: float, along: float) -> bool:
        """Return whether a point lies in its polygon."""
        crossed = sum(_crossed(np.asarray(ring), across, along) for ring in self.polygon)
        return crossed % 2 == 1

    def __str__(self) -> str:
        held = " and ".join(map(str, self.orbits)) or "nothing stable"
        fixed = "".join(f"{name} = {value:.6g}  " for name, value in self.fixed.items())
        told = f"{self.id}  {fixed}{held}: {100.0 * self.part:.3g} % of the rectangle"
        if self.doubtful:
            places = [f"{d.across:.6g}, {d.along:.6g}: {d.says}" for d in self.doubtful]
            told += f"; a run says otherwise at ({self.across}, {self.along}) = {places[0]}"
            told += f" and {len(places) - 1} more" if len(places) > 1 else ""
        return told


def _crossed(ring: np.ndarray, x: float, y: float) -> int:
    """How often a ring crosses the line upwards from a point."""
    (a, b), (c, d) = ring[:-1].T, ring[1:].T
    passes = (a <= x) != (c <= x)
    with np.errstate(all="ignore"):
        heights = b + (d - b) * (x - a) / (c - a)
    return int(np.sum(passes & (heights > y)))
