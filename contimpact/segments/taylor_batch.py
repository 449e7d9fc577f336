"""Many flights integrated side by side, as searches ask for them; see `taylor`."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from ..arrays import Array
from .taylor import MOST_STEPS, SCALE, Integrator


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

    def _compiled(self, system: list[Any]) -> Any:
        self.lanes = self.hy.recommended_simd_size()
        blank = np.zeros((len(system), self.lanes))
        return self.hy.taylor_adaptive_batch(system, blank, opt_level=1)

    def of_rows(self, rows: Array) -> Array:
        """Return mean and end velocities and their derivatives for each row of numbers.

        Parameters
        ----------
        rows : ndarray of shape (flights, names)
            A number for each of `Statement.names`.

        Returns
        -------
        ndarray of shape (flights, values)
            As a call of an `Integrator` gives them; NaN where it raises an error.
        """
        found = np.full((len(rows), len(self._rows)), np.nan)
        usable = np.flatnonzero(np.all(np.isfinite(rows), axis=1))
        alike = usable[np.argsort(np.abs(rows[usable, 0]))]  # in the number of their steps
        for first in range(0, len(alike), self.lanes):
            lanes = alike[first : first + self.lanes]
            found[lanes] = self._side_by_side(rows[lanes])
        return found

    def _side_by_side(self, rows: Array) -> Array:
        """The same of as many flights as there are lanes, or fewer.

        One that ceases to be finite stops all; they begin again with nothing in its place.
        """
        count = len(rows)
        given = rows[np.arange(self.lanes) % count]
        given[count:, 0] = 0.0
        finite = np.ones(self.lanes, dtype=bool)
        while np.any(finite):
            lost = self._propagated(given)
            if not np.any(lost):
                break
            finite &= ~lost
            given[lost] = given[np.argmax(finite)]
            given[lost, 0] = 0.0
        arrived = [said[0] in self._arrived for said in self._adaptive.propagate_res]
        found = np.where(finite & arrived, self._state[self._rows[:, 0]] / SCALE, np.nan)
        return np.asarray(found.T[:count])

    def _propagated(self, given: Array) -> Array:
        """Integrate all lanes; which of them cease to be finite."""
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
        lost = self.hy.taylor_outcome.err_nf_state
        return np.array([said[0] == lost for said in self._adaptive.propagate_res])


@functools.cache
def batch_integrator(field: str, directions: tuple[str, ...] = ()) -> BatchIntegrator:
    """Return the integrator of many flights; it is compiled when it is first asked for."""
    return BatchIntegrator(field, directions)
