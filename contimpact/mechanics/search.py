"""All orbits of a word at given parameter values, by vectorised Newton iteration from many starts.

A start is a set of impact times drawn at random; the section coordinates that fit them best follow
from least squares, since residuals are (close to) linear in them. Newton steps are shortened so
that impacts stay in order. Rounds of starts are repeated until several in a row find nothing new.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError
from .kernels import Kernels
from .model import Model
from .orbit import Array, Linearisation, OrbitProblem
from .recognition import repeats
from .word import Word, parse_word

ITERATIONS = 25
FEWEST_STARTS = 16
MOST_WORK = 40_000
"""Starts in a round, times the square of the word's length, beyond which fewer starts are made."""

SAME_ORBIT = 1e-7
SAME_SINGULAR_ORBIT = 1e-4


@dataclass(frozen=True)
class Orbit:
    """A periodic orbit, physical or not.

    Attributes
    ----------
    problem : OrbitProblem
    unknowns : ndarray of shape (n + 1,)
        Impact times, section coordinates and the free parameter.
    """

    problem: OrbitProblem
    linearisation: Linearisation

    @property
    def unknowns(self) -> Array:
        return self.linearisation.unknowns

    @property
    def word(self) -> Word:
        """The walls visited, and the period."""
        return self.problem.word

    @property
    def model(self) -> Model:
        """The model, at the orbit's parameter values."""
        return self.problem.model_at(self.unknowns)

    @property
    def times(self) -> Array:
        """Impact times, shape (N,), in the model's clock."""
        return self.problem.impacts(self.unknowns)[:, 0]

    @property
    def velocities(self) -> Array:
        """Velocities before impact, shape (N,)."""
        return self.problem.impacts(self.unknowns)[:, 1]

    @property
    def multipliers(self) -> Any:
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

    def __repr__(self) -> str:
        letters = [w.name for w in self.model.WALLS]
        state = ("stable" if self.stable else "unstable") + (
            "" if self.physical else ", unphysical"
        )
        rows = [
            f"  {wall}  t = {t:.12g}  v = {v:.12g}"
            for wall, t, v in zip(self.word.walls, self.times, self.velocities, strict=True)
        ]
        factors = ", ".join(f"{_plain(mu):.6g}" for mu in self.multipliers)
        head = (
            f"Orbit {self.word.notation(letters)} ({self.word}) at {self.problem.parameter} = "
            f"{self.unknowns[-1]:.12g}: {state}; multipliers {factors}"
        )
        why = [f"  {self.reason}"] if self.reason else []
        return "\n".join([head, *rows, *why])


def _plain(mu: complex) -> complex | float:
    return mu.real if mu.imag == 0.0 else mu


def find_orbits(
    model: Model, word: str | Word, *, parameter: str | None = None,
    kernels: Kernels | None = None, rng: Any = 0, starts: int = 256, rounds: int = 8,
) -> list[Orbit]:  # fmt: skip
    """Find the orbits of a word: stable, unstable and unphysical ones.

    Parameters
    ----------
    model : Model
        The system at the parameter values of interest.
    word : str or Word
        ``"2:1"``, ``"1:1/2T"``, ``"BTBT/2T"``, ...
    parameter : str, optional
        The parameter that will be followed; the first of the model by default.
    kernels : Kernels, optional
        Kernels to use, if some are at hand; they name the parameter.
    rng : None, int or numpy.random.Generator, default 0
        Where starts come from; see `numpy.random.default_rng`.
    starts : int
        Starts in one round; fewer for words of more than a dozen impacts.
    rounds : int
        Rounds at most; the search ends after two rounds in a row that find nothing new.

    Returns
    -------
    list of Orbit
        Sorted by the first impact's velocity, largest first; impacts in order of time, the first
        in [0, T). Repetitions of an orbit of shorter period are left out. The list can be
        incomplete: the search is a random one.

    Raises
    ------
    InputError
        If the word cannot be read or the parameter is unknown.
    """
    for name, count in (("starts", starts), ("rounds", rounds)):
        if count < 1:
            raise InputError(name, f"found {count!r}", "give a whole number >= 1")
    letters = [w.name for w in model.WALLS]
    word = word if isinstance(word, Word) else parse_word(word, letters)
    kernels = kernels or Kernels(model, parameter or next(iter(model.values)))
    problem = OrbitProblem(model, word, kernels)
    generator = np.random.default_rng(rng)
    starts = min(starts, max(FEWEST_STARTS, MOST_WORK // len(word) ** 2))
    found: list[Orbit] = []
    quiet = 0
    for _ in range(rounds):
        before = len(found)
        with np.errstate(all="ignore"):
            found_there = _newton(problem, _random_starts(problem, generator, starts))
        for unknowns in found_there:
            _keep(found, problem, unknowns)
        quiet = quiet + 1 if len(found) == before else 0
        if quiet == 2:
            break
    return sorted(found, key=lambda orbit: -float(orbit.velocities[0]))


def settle(problem: OrbitProblem, unknowns: Array, iterations: int = 12) -> Linearisation | None:
    """Solve for an orbit at fixed parameter, to rounding, from a good guess; None if it fails."""
    z = unknowns.copy()
    best: Linearisation | None = None
    try:
        for _ in range(iterations):
            here = problem.evaluate(z)
            size = np.max(np.abs(here.residual))
            if best is not None and not size < 0.5 * np.max(np.abs(best.residual)):
                break
            best = here
            z = z.copy()
            z[:-1] -= np.linalg.solve(here.jacobian[:, :-1], here.residual)
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        return None
    size = max(1.0, float(np.max(np.abs(problem.impacts(unknowns)[:, 1:]))))
    return best if best is not None and np.max(np.abs(best.residual)) < 1e-11 * size else None


def _keep(found: list[Orbit], problem: OrbitProblem, unknowns: Array) -> None:
    """Add an orbit to the list unless it is there, is out of order or repeats a shorter one."""
    here = settle(problem, _reduced(problem, unknowns))
    if here is None:
        return
    impacts = problem.impacts(here.unknowns)
    span = problem.word.period * problem.kernels.setup(*problem.values(here.unknowns))[0]
    durations = np.diff(np.append(impacts[:, 0], impacts[0, 0] + span))
    if np.min(durations) <= 1e-9 * span or repeats(problem, here.unknowns, SAME_ORBIT):
        return
    same = SAME_ORBIT if _regular(here) else SAME_SINGULAR_ORBIT
    for orbit in found:
        if np.max(np.abs(problem.difference(here.unknowns, orbit.unknowns))) < same:
            return
    found.append(Orbit(problem, here))


def _regular(here: Linearisation) -> bool:
    """Whether an orbit is known to rounding, and not only to its root as at a bifurcation."""
    sizes = np.linalg.svd(here.cyclic(1.0)[:, : here.problem.n], compute_uv=False)
    return bool(sizes[-1] > 1e-4 * sizes[0])


def _reduced(problem: OrbitProblem, unknowns: Array) -> Array:
    """The same orbit with its first impact in [0, T)."""
    period = problem.kernels.setup(*problem.values(unknowns))[0]
    shifted = unknowns.copy()
    shifted[: -1 : problem.m] -= np.floor(unknowns[0] / period) * period
    return shifted


# The vectorised iteration: arrays have one row per start.


def _random_starts(problem: OrbitProblem, generator: np.random.Generator, count: int) -> Array:
    """Random times in order; section coordinates by least squares."""
    n, m = len(problem.word), problem.m
    period = problem.kernels.setup(
        *problem.values(np.array([problem.model.values[problem.parameter]]))
    )[0]
    span = problem.word.period * period
    z = np.zeros((count, n, m))
    z[:, 0, 0] = generator.uniform(0.0, period, count)
    durations = generator.dirichlet(np.ones(n), count) * span
    z[:, 1:, 0] = z[:, :1, 0] + np.cumsum(durations, axis=1)[:, :-1]
    residual, jacobian = _evaluate_all(problem, z)
    sections = [i for i in range(n * m) if i % m]
    by_section = jacobian[:, :, sections]
    normal = by_section.transpose(0, 2, 1) @ by_section
    normal += 1e-12 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(len(sections))
    right = -(by_section.transpose(0, 2, 1) @ residual[:, :, None])
    z.reshape(count, -1)[:, sections] = np.linalg.solve(normal, right)[:, :, 0]
    return z


def _newton(problem: OrbitProblem, z: Array) -> list[Array]:
    """Newton's iteration from every start; returns the unknowns of those that converged."""
    _, n, m = z.shape
    value = problem.model.values[problem.parameter]
    period = problem.kernels.setup(*problem.values(np.array([value])))[0]
    span = problem.word.period * period
    converged: list[Array] = []
    with np.errstate(all="ignore"):
        for _ in range(ITERATIONS):
            residual, jacobian = _evaluate_all(problem, z)
            healthy = np.all(np.isfinite(jacobian), axis=(1, 2)) & np.all(
                np.isfinite(residual), axis=1
            )
            z, residual, jacobian = z[healthy], residual[healthy], jacobian[healthy]
            jacobian = jacobian + 1e-300 * np.eye(n * m)
            step = _solve_all(jacobian, -residual).reshape(-1, n, m)
            done = np.max(np.abs(step), axis=(1, 2)) < 1e-8
            converged += [np.append(row.ravel(), value) for row in (z + step)[done]]
            z, step = z[~done], step[~done]
            if not len(z):
                break
            z = z + step * _shortening(z, step, span, period)[:, None, None]
    return converged


def _solve_all(matrices: Array, right: Array) -> Array:
    try:
        return np.linalg.solve(matrices, right[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        return (np.linalg.pinv(matrices) @ right[:, :, None])[:, :, 0]


def _shortening(z: Array, step: Array, span: float, period: float) -> Array:
    """The part of each step that keeps impacts in order and moves no time by over T/4."""
    times, moves = z[:, :, 0], step[:, :, 0]
    durations = np.diff(np.concatenate([times, times[:, :1] + span], axis=1), axis=1)
    changes = np.diff(np.concatenate([moves, moves[:, :1]], axis=1), axis=1)
    shrinking = np.where(
        changes < 0.0, -0.9 * durations / np.where(changes < 0.0, changes, 1.0), 1.0
    )
    largest = 0.25 * period / np.maximum(np.max(np.abs(moves), axis=1), 1e-300)
    return np.minimum(1.0, np.minimum(np.min(shrinking, axis=1), largest))


def _evaluate_all(problem: OrbitProblem, z: Array) -> tuple[Array, Array]:
    """Residuals (S, n) and square Jacobians (S, n, n) of all starts at the model's parameters."""
    count, n, m = z.shape
    p: Sequence[float] = list(problem.model.values.values())
    span = problem.word.period * problem.kernels.setup(*p)[0]
    residual = np.zeros((count, n * m))
    jacobian = np.zeros((count, n * m, n * m))
    for k, (a, b) in enumerate(problem.kinds):
        start = [z[:, k, i] for i in range(m)]
        end = [z[:, (k + 1) % n, i] for i in range(m)]
        if k == n - 1:
            end[0] = end[0] + span
        kernel = problem.kernels.vectorised(problem.kernels.flight(a, b))
        out = [np.broadcast_to(value, (count,)) for value in kernel(*start, *end, *p)]
        rows = slice(k * m, k * m + m)
        residual[:, rows] = np.stack(out[:m], axis=1)
        blocks = np.stack(out[m : m + 2 * m * m], axis=1).reshape(count, 2, m, m)
        jacobian[:, rows, k * m : k * m + m] += blocks[:, 0]
        j = (k + 1) % n * m
        jacobian[:, rows, j : j + m] += blocks[:, 1]
    problem.kernel_evaluations += count * n
    return residual, jacobian


def orbit_at(problem: OrbitProblem, unknowns: Array) -> Orbit:
    """Solve for the orbit next to `unknowns` at their parameter value.

    Raises
    ------
    InputError
        If Newton's iteration does not converge from there.
    """
    here = settle(problem, np.asarray(unknowns, dtype=float))
    if here is None:
        raise InputError(
            "unknowns", f"no {problem.word} orbit was reached from them",
            "give a closer guess, or use find_orbits",
        )  # fmt: skip
    return Orbit(problem, here)
