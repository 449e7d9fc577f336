"""Tables in Markdown, and numbers in them."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from contestant import Sample


def grid(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table; all columns but the first are set flush right."""
    widths = [max(len(row[k]) for row in (header, *rows)) for k in range(len(header))]
    rule = ["-" * widths[0], *("-" * (w - 1) + ":" for w in widths[1:])]
    lines = [_line(header, widths), _line(rule, widths), *(_line(row, widths) for row in rows)]
    return "\n".join(lines)


def _line(cells: Sequence[str], widths: Sequence[int]) -> str:
    first = cells[0].ljust(widths[0])
    return "| " + " | ".join([first, *map(str.rjust, cells[1:], widths[1:])]) + " |"


def middle(values: Sequence[float]) -> str:
    """Return the median."""
    return number(statistics.median(values))


def spread(values: Sequence[float]) -> str:
    """Return the least and the largest value."""
    return f"{number(min(values))} to {number(max(values))}"


def both(values: Sequence[float]) -> str:
    """Return the median with the least and the largest value."""
    return f"{middle(values)} ({spread(values)})"


def number(value: float) -> str:
    """Return three significant digits, or all digits before the point."""
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"


def each(samples: Sequence[Sample]) -> list[float]:
    """Return the seconds per point, round by round."""
    return [sample.seconds / sample.count for sample in samples]


def whole(samples: Sequence[Sample]) -> list[float]:
    """Return the seconds, round by round."""
    return [sample.seconds for sample in samples]


def over(values: Sequence[float], others: Sequence[float]) -> list[float]:
    """Return the ratios of the rounds that both took part in."""
    return [value / other for value, other in zip(values, others, strict=False)]
