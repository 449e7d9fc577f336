"""Branches with what leads away from them: branches born at their events, and others they meet."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..continuation.branch import Event
from ..results.branch import Branch, Entry


@dataclass(frozen=True)
class Birth:
    """A branch waiting to be followed: where it starts, and the entry it is born at."""

    event: Event
    entry: Entry
    depth: int


def with_openings(
    branches: Sequence[Branch],
    opens: Mapping[str, Sequence[str]],
    meetings: Mapping[str, Sequence[str]],
) -> list[Branch]:
    """Return branches that know what opens at their entries and what they meet.

    Parameters
    ----------
    branches : sequence of Branch
    opens : mapping of str to sequence of str
        The branches born at an entry, by its name.
    meetings : mapping of str to sequence of str
        The branches that a branch meets, by its name.
    """
    finished = []
    for branch in branches:
        events = [dataclasses.replace(e, opens=tuple(opens.get(e.id, ()))) for e in branch.events]
        met = list(meetings.get(branch.id, []))
        finished.append(dataclasses.replace(branch, events=events, meetings=met))
    return finished
