r"""Crises: a chaotic attractor touches the stable manifold of an unstable orbit.

An attractor with impacts has corners where it is cut by a grazing: the images of the points of an
unstable manifold that graze. At a crisis the outermost of them lies on the stable manifold of an
unstable orbit X. The orbit through it is a *grazing connection*: it leaves a periodic orbit (X
itself, or one within the attractor), grazes once, and ends at X.

Neither manifold has to be computed. The path is written as impacts, with laps of the first orbit at
its beginning and laps of X at its end; its flights, the impact velocity that vanishes, and

.. math:: t_{n_0} - t_0 = p_0 T, \qquad t_{N} - t_{N - n_1} = p_1 T

are as many equations as unknowns, the parameter among them. The last two let the first and the last
lap close in time alone. With the multipliers :math:`|\mu_s| < 1 < |\mu_u|` of an orbit, what they
leave of the unwanted direction after k laps is :math:`(\mu_s/\mu_u)^k` times as large: laps are
added until they change nothing that double precision could tell.

Where impacts contract less, the attractor is round at its end, as in smooth maps, and touches
without a grazing. Then the path's own equations :math:`F` are singular in its impacts: two
connections, which exist beyond the crisis, meet. In place of the velocity that vanishes there is
the number :math:`g` of

.. math::
   \begin{pmatrix} F_z & b \\ c^\top & 0 \end{pmatrix}
   \begin{pmatrix} \phi \\ g \end{pmatrix} = \begin{pmatrix} 0 \\ 1 \end{pmatrix}

(Govaerts, Numerical Methods for Bifurcations of Dynamical Equilibria, 2000, ch. 3); its derivatives
have differences of :math:`F_z` along :math:`\phi`, which affect the speed of Newton's method alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.linalg import lu_factor, lu_solve

from ..arrays import Array
from ..models.guards import Word
from ..models.model import Model
from ..orbits.problem import Linearisation
from ..segments.bounded import bounds_of
from ..segments.kernels import Kernels
from .extended_system import EPSILON, FIRST_ORDER, moves

NEWTON_ITERATIONS = 20
CONVERGED = 1e-11
"""Largest residual of a solution, in natural sizes."""
DIFFERENCE = 1e-6
"""Largest step of the differences along the kernel, in natural sizes."""
FAR = 0.5
"""Longest Newton step near a solution, in the natural sizes of the impacts."""
INVERSE_ITERATIONS = 3
"""Inverse iterations for vectors that border a matrix; they need not be exact."""
MOST_LAPS = 12
"""Laps added at an end at most."""


@dataclass(frozen=True, eq=False)
class Connected:
    """A grazing connection's equations at one point."""

    problem: Connection
    unknowns: Array
    residual: Array
    jacobian: Array

    @property
    def impacts(self) -> Array:
        """Times and velocities of the path's impacts, shape (N, 2)."""
        return self.problem.impacts(self.unknowns)


class Connection:
    """The equations of a grazing connection, of systems with one degree of freedom.

    The path hits `walls`; it begins with a lap of the orbit `before` and ends with a lap of
    `after`. `grazing` is the number of the impact whose velocity vanishes, None where the manifolds
    touch without one. The kernels name the free parameters: one for a crisis, two for a curve of
    them.
    """

    def __init__(
        self,
        model: Model,
        kernels: Kernels,
        walls: str,
        grazing: int | None,
        before: Word,
        after: Word,
    ) -> None:
        self.model, self.kernels, self.walls, self.grazing = model, kernels, walls, grazing
        self.before, self.after = before, after
        self.segments = [kernels.segment(a, b) for a, b in pairwise(walls)]
        names, self._values = list(model.values), list(model.values.values())
        self._free = [names.index(name) for name in kernels.parameters]
        self.free = len(self._free)
        self.n = 2 * len(walls)
        self._borders: tuple[Array, Array] | None = None

    def values(self, unknowns: Array) -> list[float]:
        """Return all parameter values at a point, in the model's order."""
        values = self._values.copy()
        for place, value in zip(self._free, unknowns[self.n :].tolist(), strict=True):
            values[place] = value
        return values

    def impacts(self, unknowns: Array) -> Array:
        """Return times and velocities of the path's impacts, shape (N, 2)."""
        return unknowns[: self.n].reshape(-1, 2)

    def evaluate(self, unknowns: Array) -> Connected:
        """Evaluate the equations and their derivatives at a point."""
        residual, jacobian = self._path(unknowns)
        if self.grazing is not None:
            residual[self.n] = self.impacts(unknowns)[self.grazing, 1]
            jacobian[self.n, 2 * self.grazing + 1] = 1.0
        else:
            residual[self.n], jacobian[self.n] = self._tangent(unknowns, jacobian[: self.n])
        return Connected(self, unknowns, residual, jacobian)

    def _tangent(self, unknowns: Array, jacobian: Array) -> tuple[float, Array]:
        """Evaluate the number that vanishes where two connections meet, and its derivatives."""
        n = self.n
        if self._borders is None:
            self._borders = _singular_vectors(jacobian[:, :n])
        b, c = self._borders
        matrix = np.block([[jacobian[:, :n], b[:, None]], [c[None, :], np.zeros((1, 1))]])
        unit, factors = np.append(np.zeros(n), 1.0), lu_factor(matrix)
        kernel, kernel_of_rows = lu_solve(factors, unit), lu_solve(factors, unit, trans=1)[:n]
        step = np.append(kernel[:n], np.zeros(self.free))
        size = DIFFERENCE / float(np.max(np.abs(step / self.scale(unknowns, np.inf))))
        step *= size
        change = self._path(unknowns + step)[1][:n] - self._path(unknowns - step)[1][:n]
        change /= 2.0 * size
        return float(kernel[n]), -kernel_of_rows @ change

    def _path(self, unknowns: Array) -> tuple[Array, Array]:
        """Evaluate the flights and both laps; the last row is left out."""
        p, rows = self.values(unknowns), self.impacts(unknowns).tolist()
        setup = self.kernels.setup(*p)
        residual = np.zeros(self.n + 1)
        jacobian = np.zeros((self.n + 1, self.n + self.free))
        for k, segment in enumerate(self.segments):
            i = slice(2 * k, 2 * k + 2)
            found, leaving, arriving, by = segment.blocks(rows[k], rows[k + 1], p)
            residual[i] = found
            jacobian[i, i] = np.reshape(leaving, (2, 2))
            jacobian[i, 2 * k + 2 : 2 * k + 4] = np.reshape(arriving, (2, 2))
            jacobian[i, self.n :] = np.reshape(by, (2, -1))
        last = len(rows) - 1
        laps = (0, len(self.before), self.before), (last - len(self.after), last, self.after)
        for row, (first, second, word) in enumerate(laps, self.n - 2):
            residual[row] = rows[second][0] - rows[first][0] - word.period * setup.period
            jacobian[row, 2 * first], jacobian[row, 2 * second] = -1.0, 1.0
            jacobian[row, self.n :] = [-word.period * slope for slope in setup.slopes]
        return residual, jacobian

    def rounding(self, here: Connected) -> Array:
        """Return bounds of the rounding errors of the residuals at a point."""
        p, rows = self.values(here.unknowns), here.impacts.tolist()
        found = [
            bounds_of(segment, leave, arrive, p)[1][0]
            for segment, (leave, arrive) in zip(self.segments, pairwise(rows), strict=True)
        ]
        closing = 4.0 * EPSILON * float(np.max(np.abs(here.impacts[:, 0])))
        return np.array([*np.ravel(found), closing, closing, 0.0])

    def scale(self, unknowns: Array, span: float) -> Array:
        """Return natural sizes of the unknowns, given the last parameter's."""
        period = self.kernels.setup(*self.values(unknowns)).period
        fastest = float(np.max(np.abs(self.impacts(unknowns)[:, 1])))
        sizes = np.maximum(np.abs(unknowns[self.n :]), EPSILON)
        sizes[-1] = span if np.isfinite(span) else sizes[-1]
        return np.concatenate([np.tile([period, fastest], len(self.walls)), sizes])

    def residual_sizes_at(self, here: Connected, scale: Array) -> Array:
        """Return natural sizes of the residuals at a point, given those of the unknowns."""
        return moves(here.jacobian, scale)

    def difference(self, one: Array, other: Array) -> Array:
        """Return one - other."""
        return one - other

    def longer(self, unknowns: Array, first: int, last: int) -> tuple[Connection, Array]:
        """Return the problem of a path with more laps at both ends, and a guess of it."""
        rows = self.impacts(unknowns)
        period = self.kernels.setup(*self.values(unknowns)).period
        begin, end = rows[: len(self.before)], rows[len(rows) - len(self.after) :]
        shift = np.array([period, 0.0])
        parts = [begin - k * self.before.period * shift for k in range(first, 0, -1)]
        parts += [rows, *(end + k * self.after.period * shift for k in range(1, last + 1))]
        ending = self.walls[len(rows) - len(self.after) :]
        walls = self.walls[: len(begin)] * first + self.walls + ending * last
        grazing = None if self.grazing is None else self.grazing + first * len(begin)
        given = self.model, self.kernels, walls, grazing, self.before, self.after
        return Connection(*given), np.concatenate([np.vstack(parts).ravel(), unknowns[self.n :]])


class Passage(Connection):
    """The equations of a path that begins at a time anywhere, in place of laps of an orbit.

    What precedes it hardly matters after some impacts: it is where a manifold touches that holds
    motion with this past.
    """

    begun: float

    def _path(self, unknowns: Array) -> tuple[Array, Array]:
        residual, jacobian = super()._path(unknowns)
        row = self.n - 2
        residual[row], jacobian[row] = unknowns[0] - self.begun, 0.0
        jacobian[row, 0] = 1.0
        return residual, jacobian


def _singular_vectors(matrix: Array) -> tuple[Array, Array]:
    """Return about the left and the right vector of the smallest singular value."""
    factors, right = lu_factor(matrix), np.ones(len(matrix))
    for _ in range(INVERSE_ITERATIONS):
        left = lu_solve(factors, right / np.linalg.norm(right), trans=1)
        right = lu_solve(factors, left / np.linalg.norm(left))
    return left / np.linalg.norm(left), right / np.linalg.norm(right)


def solve(problem: Connection, guess: Array) -> Connected | None:
    """Solve the equations of a problem with one free parameter; None if Newton's method fails."""
    z, best = guess, None
    scale, rows = problem.scale(guess, np.inf), None
    try:
        for _ in range(NEWTON_ITERATIONS):
            here = problem.evaluate(z)
            rows = problem.residual_sizes_at(here, scale) if rows is None else rows
            size = float(np.max(np.abs(here.residual) / rows))
            if not np.isfinite(size):
                return None
            if best is not None and size >= 0.5 * best[0] and best[0] < CONVERGED:
                break
            best = size, here
            step = np.linalg.solve(here.jacobian, -here.residual)
            if not float(np.max(np.abs(step / scale)[: problem.n])) < FAR:
                return None
            z = z + step
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        return None
    return best[1] if best is not None and best[0] < CONVERGED else None


def error_of(here: Connected) -> float:
    """Bound the error of the parameter that rounding leaves of a solution."""
    unit = np.zeros(len(here.unknowns))
    unit[-1] = 1.0
    row = np.linalg.solve(here.jacobian.T, unit)
    off = FIRST_ORDER * np.abs(here.residual) + here.problem.rounding(here)
    return float(np.abs(row) @ off)


def refined(here: Connected) -> tuple[Connected, float] | None:
    """Add laps at both ends until they change the parameter by rounding only.

    Returns the path and a bound of the parameter's error (rounding, and what the last laps
    changed); None if a longer path is not found.
    """
    error = error_of(here)
    for ends in ((1, 0), (0, 1)):
        for _ in range(MOST_LAPS):
            found = solve(*here.problem.longer(here.unknowns, *ends))
            if found is None:
                return None
            moved = abs(float(found.unknowns[-1] - here.unknowns[-1]))
            here, error = found, error_of(found)
            if moved <= error:
                break
        else:
            error += moved
    return here, error


def unstable_direction(here: Linearisation) -> tuple[float, Array, Array]:
    """Return an orbit's unstable multiplier, and its right and left vectors at the first impact.

    The orbit is one of a system of one degree of freedom.
    """
    carried: Any = np.eye(2)
    for start, end in zip(here.start, here.end, strict=True):
        carried = -np.linalg.solve(end, start) @ carried
    factors, vectors = np.linalg.eig(carried)
    k = int(np.argmax(np.abs(factors)))
    right = np.real(vectors[:, k])
    left = np.real(np.linalg.inv(vectors)[k])
    return float(np.real(factors[k])), right, left
