"""Test functions of orbits: written once, for a single orbit and for all those of a batch."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Protocol, TypeAlias

import numpy as np

from ..continuation.branch import Block, Event, Point, TestFunction
from ..orbits.problem import Array, Linearisation

OrbitPoint: TypeAlias = Point[Linearisation]
OrbitEvent: TypeAlias = Event[Linearisation]
"""On branches of periodic orbits."""


class Orbits(Protocol):
    """P orbits on a branch, a row each; what is costly is computed when it is asked for.

    Attributes
    ----------
    unknowns, tangents : ndarray of shape (P, n + 1)
    orientations : ndarray of shape (P,)
    spans : ndarray of shape (P,)
        The orbits' periods.
    doubling : ndarray of shape (P,)
    products : ndarray of shape (P, pairs)
        See `contimpact.orbits.multipliers.Stability`.
    gaps : ndarray of shape (P, N, W)
        The smallest interior gap of each flight to each wall, NaN if there is none.
    slowest : ndarray of shape (P, N)
        See `contimpact.segments.flight.excursions`.
    derived : ndarray of shape (P, D)
        Derived parameters.
    """

    @property
    def unknowns(self) -> Array: ...
    @property
    def tangents(self) -> Array: ...
    @property
    def orientations(self) -> Array: ...
    @property
    def spans(self) -> Array: ...
    @property
    def doubling(self) -> Array: ...
    @property
    def products(self) -> Array: ...
    @property
    def gaps(self) -> Array: ...
    @property
    def slowest(self) -> Array: ...
    @property
    def derived(self) -> Array: ...


@dataclass(frozen=True, eq=False)
class ManyOrbits:
    """The orbits of a batch; see `Orbits`."""

    unknowns: Array
    tangents: Array
    orientations: Array
    spans: Array
    doubling: Array
    products: Array
    gaps: Array
    slowest: Array
    derived: Array


class OneOrbit:
    """A single orbit; see `Orbits`. Without a point it has no tangent."""

    def __init__(self, here: Linearisation, point: OrbitPoint | None = None) -> None:
        self.here, self.unknowns = here, here.unknowns[None]
        none = np.full(len(here.unknowns), np.nan)
        self.tangents = (none if point is None else point.tangent)[None]
        self.orientations = np.array([np.nan if point is None else point.orientation])

    @property
    def spans(self) -> Array:
        return np.array([self.here.span])

    @property
    def doubling(self) -> Array:
        return np.array([self.here.stability.doubling])

    @property
    def products(self) -> Array:
        return self.here.stability.products[None]

    @property
    def gaps(self) -> Array:
        gaps = [[np.nan if t is None else t.gap for t in f.touches] for f in self.here.gaps]
        return np.array([gaps])

    @property
    def slowest(self) -> Array:
        return np.array([[flight.slowest for flight in self.here.gaps]])

    @property
    def derived(self) -> Array:
        return np.array([list(self.here.derived.values())])


class OrbitTest(TestFunction[Linearisation]):
    """A test function of orbits.

    Implementers give `kind`, `of`, and, where they can, `locate`. `needs` names what of `Orbits`
    a batch has only where it is asked for: ``"doubling"`` and ``"gaps"``, with ``"slowest"``.
    """

    needs: tuple[str, ...] = ()

    @abstractmethod
    def of(self, orbits: Orbits) -> Array:
        """Return the values, shape (P, q)."""

    def values(self, point: OrbitPoint) -> Array:
        return self._existing(self.of(OneOrbit(point.evaluation, point)))[0]

    def batch(self, block: Block) -> Array:
        assert isinstance(block.measured, ManyOrbits)
        return self._existing(self.of(block.measured))

    def _existing(self, values: Array) -> Array:
        if not self.vanishing:
            return values
        return np.where(np.abs(values) < self.vanishing, np.nan, values)
