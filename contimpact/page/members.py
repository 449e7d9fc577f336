"""The branches of a diagram by the values of the parameters that no branch varies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..results.branch import Branch


def constants(branches: Sequence[Branch], derived: Sequence[str]) -> list[str]:
    """Return the parameters that are constant along every branch, derived ones left out."""
    if not branches:
        return []
    return [
        name
        for name in branches[0].constant
        if name not in derived and all(name in branch.constant for branch in branches)
    ]


def fixed(branches: Sequence[Branch], derived: Sequence[str]) -> dict[str, float]:
    """Return the constant parameters that all branches share."""
    shared = {}
    for name in constants(branches, derived):
        values = {float(branch[name][0]) for branch in branches}
        if len(values) == 1:
            shared[name] = values.pop()
    return shared


def members(branches: Sequence[Branch], derived: Sequence[str]) -> list[dict[str, Any]]:
    """Return the groups of branches that one diagram shows.

    Each has as ``fixed`` the values that set it apart, and as ``branches`` their places.
    """
    shared = fixed(branches, derived)
    apart = [name for name in constants(branches, derived) if name not in shared]
    groups: dict[tuple[float, ...], list[int]] = {}
    for place, branch in enumerate(branches):
        groups.setdefault(tuple(float(branch[name][0]) for name in apart), []).append(place)
    return [
        {"fixed": dict(zip(apart, values, strict=True)), "branches": places}
        for values, places in sorted(groups.items())
    ]
