"""Starts anywhere within the guards of a mode; what lies elsewhere is refused."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError

if TYPE_CHECKING:
    from .automaton import Automaton


def check_start(automaton: Automaton, position: Sequence[float], mode: str) -> int:
    """Return a guard that leads into the mode of a start.

    Raises
    ------
    InputError
        If there is no such mode, if its flights are not known from anywhere, or if the start lies
        beyond one of its guards.
    """
    modes = [guard.next_mode for guard in automaton.guards]
    if mode not in modes:
        raise InputError("mode", f"no mode {mode!r}", f"the modes are {', '.join(modes)}")
    wall = modes.index(mode)
    if not automaton.linear[wall]:
        found = f"the flights of {automaton.kernels.model.SYSTEM} are known from guards on"
        raise InputError("position", found, "start at a guard")
    for k, row in enumerate(automaton.rows):
        guard = automaton.guards[k]
        if automaton.passages.watched[wall][k]:
            gap = guard.side * (automaton.positions[k] - float(row @ np.array(position)))
            if not gap >= 0.0:
                raise _outside(automaton, list(position), guard.name, mode)
    return wall


def _outside(automaton: Automaton, position: list[float], guard: str, mode: str) -> InputError:
    """A start beyond a guard of its mode."""
    if not mode:
        return InputError("position", f"{position} is beyond {guard}", "start within the guards")
    found = f"{position} is beyond {guard}, at which the mode {mode!r} ends"
    others = dict.fromkeys(g.next_mode for g in automaton.guards if g.next_mode != mode)
    named = " or ".join(f"mode={other!r}" for other in others)
    return InputError("position", found, f"start within the guards, or give {named}")
