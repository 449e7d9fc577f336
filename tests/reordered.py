"""What may differ between two folders of results where only arithmetic was reordered.

- An event's value of the followed parameter is right to its stated error, against its value in 30
  digits where a report has it, else against the other value within both stated errors.
- Other numbers agree to `TOLERANCE`, relative to themselves or to 1, whichever is larger; and so do
  the numbers within texts, to the digits they are written with.
- Residuals, error estimates and such are rounding themselves: they must not grow tenfold, or stay
  below `NEGLIGIBLE`. Corrector iterations are not compared.
- Motion that is not periodic forgets how it was rounded: of such attractors the kind is compared.

Everything else, texts, order and number of events, points and files, has to be the same.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from fractions import Fraction

from differences import Difference, Table, is_number

TOLERANCE = 1e-10
WRITTEN = 1e-5
"""Relative, of numbers within texts: some are written to six digits."""

NEGLIGIBLE = 1e-12
ROUNDING = {"residual", "error", "nu_error", "closing", "distance", "true_error", "estimated_error"}
ROUNDING |= {"ratio", "median_ratio", "largest_ratio", "largest_true_error", "moved"}
UNCOMPARED = {"iterations", "corrector_iterations", "kernel_evaluations", "evaluations"}
IRREGULAR = {"complex", "not settled"}

_NUMERAL = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


class Judge:
    """Says which differences reordered arithmetic explains.

    Parameters
    ----------
    digits : mapping
        Exact values of a scene's events, by their ids.
    """

    def __init__(self, digits: Mapping[str, str]) -> None:
        self.digits = digits

    def accepts(self, found: Difference, old: Table, new: Table) -> bool:
        """Whether a difference between two tables is one of rounding."""
        owner, _, name = found.place.rpartition("/")
        if name in UNCOMPARED or (
            owner and new.get(f"{owner}/kind") in IRREGULAR and name != "kind"
        ):
            return True
        if found.stated is not None:
            return self.right(found, old, new)
        if is_number(found.old) and is_number(found.new):
            if name in ROUNDING:
                return abs(found.new) <= max(10.0 * abs(found.old), NEGLIGIBLE)
            return abs(found.new - found.old) <= TOLERANCE * max(1.0, abs(found.old))
        if isinstance(found.old, str) and isinstance(found.new, str):
            return same_text(found.old, found.new)
        return False

    def right(self, found: Difference, old: Table, new: Table) -> bool:
        """Whether an event's value is right to its stated error."""
        owner = found.place.rpartition("/")[0].removesuffix("/parameters")
        exact = self.digits.get(owner.rpartition("/")[2])
        if exact is not None:
            return off(found.new, exact) <= found.stated
        return abs(found.new - found.old) <= found.stated + old[f"{owner}/error"]

    def wrong(self, file: str, cells: Table) -> Iterator[Difference]:
        """Events of a catalogue whose error is larger than they state."""
        for event, exact in self.digits.items():
            owner = f"entries/{event}"
            if f"{owner}/error" in cells:
                place = f"{owner}/parameters/{cells[f'{owner}/parameter']}"
                stated, value = cells[f"{owner}/error"], cells[place]
                if off(value, exact) > stated:
                    yield Difference(file, place, float(exact), value, stated)


def off(value: float, exact: str) -> Fraction:
    """The distance of a number from one of many digits."""
    return abs(Fraction(value) - Fraction(exact))


def same_text(old: str, new: str) -> bool:
    """Whether two texts differ in the last digits of their numbers alone."""
    if _NUMERAL.sub("#", old) != _NUMERAL.sub("#", new):
        return False
    pairs = zip(_NUMERAL.findall(old), _NUMERAL.findall(new), strict=True)
    return all(abs(float(a) - float(b)) <= WRITTEN * abs(float(a)) + TOLERANCE for a, b in pairs)
