"""What a corrector iteration and the multipliers cost against the number of impacts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from ..continuation import problem as linear
from ..continuation.corrector import bordered
from ..models.word import Word
from ..orbits.multipliers import multipliers
from ..orbits.orbit import Orbit
from ..orbits.problem import Array, OrbitProblem
from .timing import timed

WORD_LENGTHS = (10, 20, 50, 100, 150, 200)


def long_words(orbit: Orbit, repetitions: int) -> dict[str, Any]:
    """Return what a corrector iteration and the multipliers cost against the number of impacts.

    The words are the scene's own, run several times.
    """
    rows = []
    own = len(orbit.word)
    for length in WORD_LENGTHS:
        times = max(1, round(length / own))
        problem, unknowns = _repeated(orbit, times)
        here = problem.evaluate(unknowns)
        matrix = bordered(here.jacobian, np.ones(problem.n + 1))
        right = np.ones(problem.n + 1)
        loops = max(1, 200 // (own * times))
        parts: dict[str, Callable[[], Any]] = {
            "residual and blocks": partial(problem.evaluate, unknowns),
            "Jacobian": partial(_jacobian, problem, unknowns),
            "bordered solve": partial(linear.solve, matrix, right),
            "multipliers": partial(multipliers, here.start, here.end),
        }
        row: dict[str, Any] = {"impacts": own * times}
        for name, part in parts.items():
            _, row[name] = timed(partial(_often, part, loops), repetitions, loops)
        rows.append(row)
    exponents = {name: _exponent(rows, name) for name in parts}
    return {"rows": rows, "exponents": exponents, "dense_up_to": linear.DENSE_UP_TO}


def _jacobian(problem: OrbitProblem, unknowns: Array) -> Array:
    return problem.evaluate(unknowns).jacobian


def _often(part: Callable[[], Any], times: int) -> None:
    for _ in range(times):
        part()


def _repeated(orbit: Orbit, times: int) -> tuple[OrbitProblem, Array]:
    problem, word = orbit.problem, orbit.word
    span = problem.span(orbit.unknowns)
    rows = np.vstack([problem.impacts(orbit.unknowns)] * times)
    rows[:, 0] += span * np.repeat(np.arange(times), len(word))
    longer = Word(word.walls * times, word.period * times)
    return OrbitProblem(problem.model, longer, problem.kernels), np.append(
        rows.ravel(), orbit.unknowns[-1]
    )


def _exponent(rows: Sequence[Mapping[str, Any]], name: str) -> float:
    """The slope of log seconds over log impacts, over the longer half of the words."""
    longer = rows[len(rows) // 2 - 1 :]
    logs = np.log([[row["impacts"], row[name]["median"]] for row in longer])
    return float(np.polyfit(logs[:, 0], logs[:, 1], 1)[0])
