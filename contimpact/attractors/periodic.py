"""Attractors made of cycles: the word from its first rotation on, its notation, its gaps."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from ..arrays import Array
from ..models.word import Word
from ..segments.flight import flight_gaps
from ..segments.touches import interior_touches
from ..simulation.simulator import Simulator
from .attractor import Attractor, Kind
from .cycle import Cycle
from .periodic_exponents import contracting


def parameters(simulator: Simulator) -> dict[str, float]:
    """Return every parameter and derived parameter of a simulated model."""
    return {**simulator.model.values, **simulator.derived}


def periodic(
    simulator: Simulator, cycle: Cycle, distance: float = 0.0, periods: int = 0
) -> Attractor:
    """Return the attractor of a stable cycle."""
    cycle = _rotated(cycle, simulator.period)
    sticks = bool(cycle.released.any() or cycle.held.any())
    word = _sticking_word(simulator, cycle) if sticks else _letters(simulator, cycle.walls)
    count, smallest = len(cycle.walls), math.nan
    found = contracting(simulator, cycle)
    logs = [2.0 * math.log(e) if e else -math.inf for e in simulator.restitution]
    if sticks:
        notation = _sticking_notation(simulator, cycle)
    else:
        notation = Word(word, cycle.period).notation(simulator.letters)
        smallest = _smallest_gap(simulator, word, cycle)
    return Attractor(
        Kind.STICKING if sticks else Kind.PERIODIC,
        parameters(simulator),
        notation,
        simulator.period,
        word,
        **(vars(cycle) | {"multipliers": found.multipliers}),
        exponents=found.exponents,
        error=found.error,
        exponent_sum=found.total,
        restitution=math.nan if sticks else float(np.mean([logs[wall] for wall in cycle.walls])),
        per_period=found.exponents[0] * count / cycle.period,
        rate=math.inf if sticks else count / cycle.period,
        smallest_gap=smallest,
        distance=distance,
        periods=periods,
        state=cycle.state(simulator.period),
    )


def _letters(simulator: Simulator, walls: Array) -> str:
    return "".join(simulator.letters[k] for k in walls.tolist())


def _rotated(cycle: Cycle, period: float) -> Cycle:
    """The cycle in its first rotation: walls in order, the faster impact first."""
    n = len(cycle.walls)
    span = cycle.period * period
    walls, fast = cycle.walls.tolist(), np.abs(cycle.velocities).tolist()

    def key(shift: int) -> tuple[list[int], bool, float]:
        # a rotation begins with an impact, not in the middle of chatter
        order = [(i + shift) % n for i in range(n)]
        return [walls[i] for i in order], bool(cycle.released[order[0]]), -fast[order[0]]

    shift = min(range(n), key=key)
    times = np.roll(cycle.times, -shift).copy()
    times[n - shift :] += span
    times -= math.floor(times[0] / period) * period
    roll = [np.roll(a, -shift) for a in (cycle.walls, cycle.velocities, cycle.released)]
    others = np.roll(cycle.others, -shift, axis=0), np.roll(cycle.held, -shift)
    told = cycle.period, cycle.multipliers, cycle.closing
    return Cycle(roll[0], times, roll[1], roll[2], *told, *others)


def _sticking_word(simulator: Simulator, cycle: Cycle) -> str:
    """The word, chatter that ends in a sojourn written as its wall and ``*``."""
    n = len(cycle.walls)
    dropped: set[int] = set()
    parts: list[list[str]] = []
    for wall, released in zip(cycle.walls, cycle.released, strict=True):
        parts.append([simulator.letters[wall] + ("*" if released else "")])
    for wall, first, last in _sojourns(cycle):
        i = (first - 1) % n
        while i != last and cycle.walls[i] == wall and not cycle.released[i]:
            dropped.add(i)
            i = (i - 1) % n
        if not (cycle.released[last] and cycle.walls[last] == wall):
            parts[last].insert(0, simulator.letters[wall] + "*")
    kept = ["".join(part) for i, part in enumerate(parts) if i not in dropped]
    rotations = [kept[i:] + kept[:i] for i in range(len(kept))]
    return "".join(min(rotations))


def _sojourns(cycle: Cycle) -> Iterator[tuple[int, int, int]]:
    """The wall of each sojourn, and the rows before which it begins and with which it ends."""
    n = len(cycle.walls)
    if not cycle.held.size:
        for k in np.nonzero(cycle.released)[0].tolist():
            yield int(cycle.walls[k]), k, k
        return
    held = cycle.held.tolist()
    for wall in range(max(held).bit_length()):
        for k in range(n):
            if held[k] >> wall & 1 and not held[k - 1] >> wall & 1:
                last = k
                while held[(last + 1) % n] >> wall & 1 and (last + 1) % n != k:
                    last = (last + 1) % n
                yield wall, k, last


def _sticking_notation(simulator: Simulator, cycle: Cycle) -> str:
    """Impacts per wall, infinite on walls where they accumulate."""
    stuck = {wall for wall, _, _ in _sojourns(cycle)}
    totals = [int(np.count_nonzero(cycle.walls == k)) for k in range(len(simulator.letters))]
    p = cycle.period
    finite = [total for k, total in enumerate(totals) if k not in stuck]
    whole = all(total % p == 0 for total in finite)
    each = [total // p if whole else total for total in totals]
    counts = ":".join("inf" if k in stuck else str(n) for k, n in enumerate(each))
    if p == 1:
        return counts
    return f"{counts}/{p}T" if whole else f"({counts})/{p}T"


def _smallest_gap(simulator: Simulator, word: str, cycle: Cycle) -> float:
    impacts = np.column_stack([cycle.times, cycle.velocities])
    touches = flight_gaps
    if simulator.several:
        impacts, touches = np.column_stack([impacts, cycle.others]), interior_touches
    span = cycle.period * simulator.period
    flights = touches(simulator.kernels, word, simulator.values, impacts, span)
    gaps = [t.gap for flight in flights for t in flight.touches if t is not None]
    return min(gaps, default=math.nan)
