"""Where an attractor ends between two values of a sweep.

Near a period doubling or a fold motions settle slowly; there they are given more periods before
they count as not settled.
"""

from __future__ import annotations

import math
from dataclasses import replace

from ..results.simulate_tables import SETTLING, Settling
from .attractor import Attractor, Kind
from .sweep import Row, Simulators
from .verdict import settle_again

EVALUATIONS = 120
"""Values tried for one change at most."""
SLOW = 0.95
"""Motions settle slowly if a multiplier is larger than this."""
PATIENCE = 16
"""How many times more periods a slow motion is given."""
NEARBY = 16
"""Widths from the end within which it is given them."""


def locate(
    simulators: Simulators, before: Row, after: Row, width: float, settling: Settling = SETTLING
) -> tuple[Row, Row, Row | None, Row | None]:
    """Locate the end of an attractor between two rows.

    A periodic attractor, or a motion without impacts, is followed by simulation. The step is halved
    where it is lost and grows again where it is not, so that near the end the start is always close
    to the attractor: a long step can kick the motion out of a small basin before its attractor
    ends. Other motions are not left in this way; for them the interval is bisected.

    Returns
    -------
    earlier, left, lost, right : Row
        Two values with the attractor before, the second one the last; the first beyond the end; and
        the first from there on at which the motion settles. `right` is None if a periodic attractor
        does not end within ten times the distance of the two rows. `lost` is None, and `right` the
        second row, where a motion without impacts cannot be started anew.
    """
    earlier, left, lost = before, before, after
    step, won = 0.5 * (after.value - before.value), 0
    furthest, longest = before.value + 20.0 * step, abs(step)
    follows = before.attractor.kind is Kind.PERIODIC or before.attractor.motion is not None
    for _ in range(EVALUATIONS):
        patient = _patient(left.attractor, abs(step), width, settling)
        row = _row(simulators, left, left.value + step, patient)
        if row is None:
            return earlier, left, None, after
        if row.attractor.label == left.attractor.label:
            earlier, left, won = left, row, won + 1
            if (furthest - left.value) * step <= 0.0:
                return earlier, left, lost, None
            if not follows:
                step *= 0.5
            elif won > 1 and abs(step) < longest:
                step, won = 2.0 * step, 0
        else:
            lost, won = row, 0
            step *= 0.5
        if _ahead(lost, left, step) and abs(lost.value - left.value) <= width:
            break
        if left.value + step == left.value:
            break
    if not _ahead(lost, left, step):
        return earlier, left, lost, None
    return earlier, left, lost, _settled(simulators, left, lost, furthest, width, settling)


def _patient(attractor: Attractor, distance: float, width: float, settling: Settling) -> Settling:
    """How long to wait, at a distance from an attractor, for it or for what follows it."""
    slow = attractor.multipliers is not None and abs(attractor.multipliers[0]) > SLOW
    if slow and distance <= NEARBY * width:
        return replace(settling, periods=PATIENCE * settling.periods)
    return settling


def _ahead(row: Row, left: Row, step: float) -> bool:
    """Whether a row lies in front of another, and not just by rounding."""
    return (row.value - left.value) * math.copysign(1.0, step) > 0.25 * abs(step)


def _settled(
    simulators: Simulators, left: Row, lost: Row, furthest: float, width: float, settling: Settling
) -> Row:
    """The first row further on at which the motion settles; the lost one if there is none.

    Steps begin with the requested width, since what follows a doubling may soon end again.
    """
    step, ahead = math.copysign(width, furthest - lost.value), lost
    while not ahead.attractor.settled and abs(furthest - ahead.value) > abs(step) > 0.0:
        value = ahead.value + step
        patient = _patient(left.attractor, abs(value - left.value), width, settling)
        found = _row(simulators, ahead, value, patient)
        if found is None:
            return lost
        ahead = found
        step *= 2.0
    return ahead if ahead.attractor.settled else lost


def _row(simulators: Simulators, before: Row, value: float, settling: Settling) -> Row | None:
    """What an attractor leads to at another value; None if that cannot be told."""
    found = settle_again(simulators.at(value), before.attractor, settling)
    return None if found is None else Row(before.direction, value, found)
