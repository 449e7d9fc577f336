"""Many flights integrated side by side, as searches ask for them; see `taylor`."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from ..arrays import Array
from .taylor import MOST_STEPS, SCALE, Integrator, integrator


class BatchIntegrator(Integrator):
    """The flow of a field, compiled for as many flights as the processor computes at once.

    Parameters
    ----------
    field : str
    directions : tuple of str
        As of `Integrator`.
    """

    def __init__(self, field: str, directions: tuple[str, ...]) -> None:
        super().__init__(field, directions, 0, 0)
        self.field = field

    def _compiled(self, system: list[Any]) -> Any:
        self.lanes = self.hy.recommended_simd_size()
        blank = np.zeros((len(system), self.lanes))
        return self.hy.taylor_adaptive_batch(system, blank, opt_level=1)

    def each(self, rows: Array) -> Array:
        """Return what an `Integrator` does for each row of numbers.

        Flights of like duration are integrated together. One that ceases to be finite stops those
        beside it; then they are integrated one by one.

        Parameters
        ----------
        rows : ndarray of shape (flights, names)
            A number for each of `Statement.names`.

        Returns
        -------
        ndarray of shape (flights, values)
        """
        found = np.full((len(rows), len(self._rows)), np.nan)
        usable = np.flatnonzero(np.all(np.isfinite(rows), axis=1))
        alike = usable[np.argsort(np.abs(rows[usable, 0]), kind="stable")]
        for first in range(0, len(alike), self.lanes):
            lanes = alike[first : first + self.lanes]
            together = self._side_by_side(rows[lanes])
            if together is None:
                together = integrator(self.field, self.directions).each(rows[lanes])
            found[lanes] = together
        return found

    def _side_by_side(self, rows: Array) -> Array | None:
        """The same of as many flights as there are lanes, or fewer; None where one does not end."""
        given = rows[np.arange(self.lanes) % len(rows)]
        given[len(rows) :, 0] = 0.0
        d = self.stated.freedom
        self._given[:] = given[:, : self._used].T
        self._adaptive.set_time(0.0)
        self._state[:] = 0.0
        for i, speeds in enumerate(given[:, 2 + d : 2 + 2 * d].T):
            self._state[self._places[f"w{i}", "", 0]] = speeds * SCALE
            place = self._places.get((f"w{i}", f"v{i}", 0))
            if place is not None:
                self._state[place] = SCALE
        self._adaptive.propagate_until(1.0, max_steps=MOST_STEPS)
        if not all(said[0] in self._arrived for said in self._adaptive.propagate_res):
            return None
        return np.asarray(self._state[self._rows[:, 0]].T[: len(rows)] / SCALE)


@functools.cache
def batch_integrator(field: str, directions: tuple[str, ...] = ()) -> BatchIntegrator:
    """Return the integrator of many flights; it is compiled when it is first asked for."""
    return BatchIntegrator(field, directions)
