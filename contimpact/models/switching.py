"""The modes and guards of a system with a switching surface: two sides, and sliding between."""

from __future__ import annotations

from .guards import Guard, Mode

BELOW, SLIDING, ABOVE = "below", "sliding", "above"


def switching_modes(size: int) -> tuple[Mode, ...]:
    """Return the modes of a system of so many coordinates, all of first order."""
    first = tuple(range(size))
    names = (BELOW, 0), (SLIDING, 1), (ABOVE, 0)
    return tuple(Mode(name, first_order=first, dependent=less) for name, less in names)


def switching_guards(coordinate: int) -> tuple[Guard, ...]:
    """Return the guards: S and B lead to sliding, from below and above, P and A back to these, C
    and D through the surface. The coordinate is the one with the largest factor in the surface."""

    def guard(name: str, side: int, mode: str, to: str, past: str = "") -> Guard:
        return Guard(name, side=side, mode=mode, to=to, coordinate=coordinate, past=past)

    return (
        guard("S", +1, BELOW, SLIDING),
        guard("P", -1, SLIDING, BELOW),
        guard("A", +1, SLIDING, ABOVE),
        guard("B", -1, ABOVE, SLIDING),
        guard("C", +1, BELOW, ABOVE, "A"),
        guard("D", -1, ABOVE, BELOW, "P"),
    )
