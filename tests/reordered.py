"""What may differ between two folders of results where only arithmetic was reordered.

- An event's value of the followed parameter is right to its stated error, against its value in 30
  digits where the recording has a report, else against the recorded value and both stated errors.
- Other numbers agree to `TOLERANCE`, relative to themselves or to 1, whichever is larger; so do the
  numbers within texts, to the digits they are written with. Multipliers agree so, or their
  reciprocals do: where an impact velocity vanishes they are infinite.
- Residuals, error estimates and such are rounding themselves: they may not grow tenfold, unless
  they stay below `NEGLIGIBLE`. Counts of iterations and evaluations are not compared, nor how near
  a motion had come to the orbit it was taken for.
- At a branch point two tangents solve the same equations; which one is the branch's is told from
  the points beside it, to `SETTLED`.
- Compiled flights are not counted in the budget of steps of a search by simulation: it may get
  further there, and says so.
- Motion that is not periodic forgets how it was rounded: of such attractors the kind is compared,
  of transitions from and to them the name. Other transitions agree to `SETTLED`.

Everything else has to be the same: texts, order and number of events, points and files.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction

from differences import Difference, Table, is_number

TOLERANCE = 1e-10
WRITTEN = 1e-5
"""Of numbers within texts, relative: some are written to six digits."""

NEGLIGIBLE = 1e-12
SETTLED = 1e-8
"""Motions settle on their orbits to 1e-9."""

NOISE = {"residual", "error", "nu_error", "closing", "true_error", "estimated_error"}
NOISE |= {"ratio", "median_ratio", "largest_ratio", "largest_true_error", "moved"}
UNCOMPARED = {"iterations", "evaluations", "distance"}
BUDGET = "steps of integration"
COUNTS = ("counts/", "test_functions/")
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

    def refused(
        self, file: str, found: Sequence[Difference], old: Table, new: Table
    ) -> list[Difference]:
        """Return the differences between two tables that are not accepted, and wrong events."""
        left = [one for one in found if not self.accepts(one, old, new)]
        return [*left, *(self.wrong(file, new) if file == "catalogue.json" else ())]

    def accepts(self, one: Difference, old: Table, new: Table) -> bool:
        """Whether a difference between two tables is one of rounding."""
        if one.name in UNCOMPARED or one.place.startswith(COUNTS) or irregular(one, old, new):
            return True
        if one.place.startswith("notes/") and BUDGET in str(one.old):
            return True
        if one.stated is not None:
            return self.right(one, old)
        if one.name == "residual" and scatters(one, old):
            return True
        if is_number(one.old) and is_number(one.new):
            entry, tangent, _ = one.place.rpartition("/tangent/")
            crossing = tangent and old.get(f"{entry}/kind") == "BP"
            settled = crossing or one.file == "transitions.json"
            tolerance = SETTLED if settled else TOLERANCE
            return close(one.place, one.old, one.new, tolerance)
        texts = isinstance(one.old, str) and isinstance(one.new, str)
        return texts and same_text(one.old, one.new)

    def right(self, one: Difference, old: Table) -> bool:
        """Whether an event's value is right to its stated error."""
        owner = one.place.rpartition("/")[0].removesuffix("/parameters")
        exact = self.digits.get(owner.rpartition("/")[2])
        if exact is not None:
            return off(one.new, exact) <= one.stated
        return abs(one.new - one.old) <= one.stated + old[f"{owner}/error"]

    def wrong(self, file: str, cells: Table) -> Iterator[Difference]:
        """Events of a catalogue that are farther from their exact value than they state."""
        for event, exact in self.digits.items():
            owner = f"entries/{event}"
            if f"{owner}/error" in cells:
                place = f"{owner}/parameters/{cells[f'{owner}/parameter']}"
                stated = cells[f"{owner}/error"]
                if off(cells[place], exact) > stated:
                    yield Difference(file, place, float(exact), cells[place], stated)


def scatters(one: Difference, old: Table) -> bool:
    """Whether a point's residual is no larger than that of some other point of its branch or curve:
    where orbits are sensitive, residuals are rounding, and differ tenfold from point to point."""
    column = [x for place, x in old.items() if place.endswith("/residual") and is_number(x)]
    return (
        one.file.startswith(("branches/", "curves/"))
        and is_number(one.new)
        and one.new <= max(column)
    )


def irregular(one: Difference, old: Table, new: Table) -> bool:
    """Whether a cell tells of motion that is not periodic, or of a transition from or to it."""
    owner = one.place.rpartition("/")[0]
    if one.file == "transitions.json" and one.name not in {"kind", "label", "direction"}:
        transition = "/".join(one.place.split("/")[:2])
        sides = (f"{transition}/before/kind", f"{transition}/after/kind")
        return any(cells.get(side) in IRREGULAR for side in sides for cells in (old, new))
    kinds = {old.get(f"{owner}/kind"), new.get(f"{owner}/kind")}
    return one.name != "kind" and kinds <= IRREGULAR


def close(place: str, old: float, new: float, tolerance: float = TOLERANCE) -> bool:
    """Whether two numbers are the same but for rounding."""
    if place.rpartition("/")[2] in NOISE:
        return abs(new) <= max(10.0 * abs(old), NEGLIGIBLE)
    if "multiplier" in place and min(abs(old), abs(new)) > 1.0:
        return abs(1.0 / new - 1.0 / old) <= tolerance
    return abs(new - old) <= tolerance * max(1.0, abs(old))


def off(value: float, exact: str) -> Fraction:
    """The distance of a number from one of many digits."""
    return abs(Fraction(value) - Fraction(exact))


def same_text(old: str, new: str) -> bool:
    """Whether two texts differ in the last digits of their numbers alone."""
    if _NUMERAL.sub("#", old) != _NUMERAL.sub("#", new):
        return False
    pairs = zip(_NUMERAL.findall(old), _NUMERAL.findall(new), strict=True)
    return all(abs(float(a) - float(b)) <= WRITTEN * abs(float(a)) + TOLERANCE for a, b in pairs)
