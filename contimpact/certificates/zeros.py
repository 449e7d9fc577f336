"""Zeros of a test function along a tube: excluded, or isolated, one in each of some cells.

The function is a polynomial in u with enclosed coefficients. A cell of u is free of zeros if the
enclosure on it is; it holds exactly one if the function is strictly monotone on it and has
different signs at its ends. Other cells are cut.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from flint import arb, arb_series

from .test_functions import Test
from .tube import Model, Tube, coefficient, shifted

DEEPEST = 10
"""How often a tube is cut."""
NARROW = 1e-6
"""Width of the part of a tube in which a zero is looked at."""
CUT = 0.4921875
"""Where a cell is cut: not where an event is likely to lie."""


@dataclass(frozen=True)
class Cell:
    """A part of a tube; `what` is ``zero`` with exactly one, or ``open`` if that is not known."""

    left: float
    right: float
    what: str


def zeros(tube: Tube, name: str, function: Test) -> list[Cell]:
    """Return the cells of a tube that hold a zero of a function of the flights, or may."""
    model = tube.model(name, function)
    rates = [j * c for j, c in enumerate(model)][1:]
    sideways = None
    found: list[Cell] = []
    cells = [(-1.0, 1.0, 0)]
    while cells:
        left, right, depth = cells.pop()
        if not over(model, left, right).contains(0):
            continue
        if sideways is None:
            sideways = across(tube, function)
        slope = over(rates, left, right) + sideways
        ends = [over(model, u, u) for u in (left, right)]
        if not slope.contains(0) and not any(end.contains(0) for end in ends):
            if (ends[0] > 0) != (ends[1] > 0):
                found.append(Cell(left, right, "zero"))
            continue
        if depth == DEEPEST:
            found.append(Cell(left, right, "open"))
            continue
        middle = left + CUT * (right - left)
        cells += [(middle, right, depth + 1), (left, middle, depth + 1)]
    return _merged(found)


def narrowed(tube: Tube, name: str, function: Test, cell: Cell) -> tuple[float, float]:
    """Return a part of a cell that holds its only zero, as small as enclosures tell."""
    model, left, right = tube.model(name, function), cell.left, cell.right
    rising = bool(over(model, right, right) > 0)
    while right - left > NARROW:
        middle = left + CUT * (right - left)
        value = over(model, middle, middle)
        if value.contains(0):
            return left, right
        if (value > 0) == rising:
            right = middle
        else:
            left = middle
    return left, right


def over(model: Model, left: float, right: float) -> Any:
    """Return the range of a polynomial on a cell, an outer enclosure."""
    half = (arb(right) - arb(left)) / 2
    first, *others = shifted(model, arb(left) + half)
    spread, power = arb(0), arb(1)
    for c in others:
        power *= half
        spread += abs(c) * power
    return first + arb(0, 1) * spread


def across(tube: Tube, function: Test) -> Any:
    """Return the function's derivative along w'(u), anywhere in the tube."""
    pairs = zip(tube.state(arb(0, 1)), tube.rates, strict=True)
    moving = [arb_series([x, r], prec=2) for x, r in pairs]
    return coefficient(function(tube.segment.space.flights(moving)), 1)


def _merged(cells: list[Cell]) -> list[Cell]:
    """Open cells that touch each other as one."""
    found: list[Cell] = []
    for cell in sorted(cells, key=lambda c: c.left):
        if found and found[-1].what == cell.what == "open" and found[-1].right == cell.left:
            cell = Cell(found.pop().left, cell.right, "open")
        found.append(cell)
    return found
