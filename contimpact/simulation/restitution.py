"""Restitution, as the motion after an impact has it.

The law itself is a system's `Formulas.reset`; the kernel of the motion after a wall applies it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

LOW = 1e-6
"""A velocity at which the coefficient of chatter is read off."""


def coefficient(motion: Callable[..., Any], wall: int) -> float:
    """Return the coefficient of restitution at low velocity."""
    return abs(float(motion((wall, 0.0, LOW), 0.0)[1])) / LOW
