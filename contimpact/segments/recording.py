"""Numbers that write down what is done with them, as straight-line code.

A kernel evaluated on them leaves a tape of its steps; equal steps stand there once. From the tape
comes the text of a new kernel with those steps alone that its results need.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

from ..arrays import Number, Vector
from .arithmetic import FLOATS, PLAIN, Arithmetic
from .layout import flat, refilled, result_text
from .stumpff import TOGETHER
from .transients import MOTIONS, TABLES

DEEPEST = 30
"""Operations inside each other that are written as one expression."""


class Tape:
    """Steps of a computation, in order: each an operation and what it is done with."""

    def __init__(self) -> None:
        self.steps: list[tuple[Any, ...]] = []
        self._places: dict[tuple[Any, ...], int] = {}

    def step(self, operation: str, *operands: Number) -> Recorded:
        """Return the result of an operation on recorded numbers and floats."""
        key = (operation, *(x.place if isinstance(x, Recorded) else repr(x) for x in operands))
        if key not in self._places:
            self._places[key] = len(self.steps)
            self.steps.append(key)
        return Recorded(self, self._places[key])

    def note(self, operation: str, operand: Number, result: Recorded) -> None:
        """Remember the result of an operation that need not be made."""
        self._places.setdefault((operation, operand.place), result.place)

    def kernel(self, name: str, arguments: Sequence[str], about: str, result: Any) -> str:
        """Return the text of the kernel that makes the steps a result needs."""
        values = flat(result)
        uses = self._uses([x.place for x in values if isinstance(x, Recorded)])
        texts: dict[int, str] = {}
        depths: dict[int, int] = {}
        lines: list[str] = []
        for place in sorted(uses):
            operation, *operands = self.steps[place]
            inner = [texts[x] if isinstance(x, int) else x for x in operands]
            text = operation.format(*inner)
            depth = 1 + max((depths[x] for x in operands if isinstance(x, int)), default=0)
            if operands and (uses[place] > 1 or depth > DEEPEST):
                lines.append(f"    w{len(lines)} = {text}\n")
                text, depth = f"w{len(lines) - 1}", 0
            texts[place], depths[place] = text, depth
        found = [texts[x.place] if isinstance(x, Recorded) else repr(float(x)) for x in values]
        head = f'def {name}({", ".join(arguments)}):\n    """{about}"""\n'
        return f"{head}{''.join(lines)}    return {result_text(refilled(result, found))}\n"

    def _uses(self, wanted: list[int]) -> Counter[int]:
        """How often each step is used, those alone that are needed."""
        uses = Counter(wanted)
        for place in range(len(self.steps) - 1, -1, -1):
            if uses[place]:
                uses.update(x for x in self.steps[place][1:] if isinstance(x, int))
        return +uses


class Recorded:
    """A number on a tape, by its place there."""

    __slots__ = ("place", "tape")

    def __init__(self, tape: Tape, place: int) -> None:
        self.tape, self.place = tape, place

    def _with(self, operation: str, *operands: Number) -> Number:
        if all(isinstance(x, Recorded | int | float) for x in operands):
            return self.tape.step(operation, *operands)
        return NotImplemented

    def __add__(self, other: Number) -> Number:
        return self._with("({} + {})", self, other)

    def __radd__(self, other: Number) -> Number:
        return self._with("({} + {})", other, self)

    def __sub__(self, other: Number) -> Number:
        return self._with("({} - {})", self, other)

    def __rsub__(self, other: Number) -> Number:
        return self._with("({} - {})", other, self)

    def __mul__(self, other: Number) -> Number:
        return self._with("({}*{})", self, other)

    def __rmul__(self, other: Number) -> Number:
        return self._with("({}*{})", other, self)

    def __truediv__(self, other: Number) -> Number:
        return self._with("({}/{})", self, other)

    def __rtruediv__(self, other: Number) -> Number:
        return self._with("({}/{})", other, self)

    def __mod__(self, other: Number) -> Number:
        return self._with("({} % {})", self, other)

    def __pow__(self, other: Number) -> Number:
        return self._with("({}**{})", self, other)

    def __neg__(self) -> Number:
        return self._with("(-{})", self)


def _recorded(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
    """A function that writes itself down where one of its arguments is on a tape."""

    def on_recorded(*arguments: Number) -> Number | Vector:
        tapes = [x.tape for x in arguments if isinstance(x, Recorded)]
        if not tapes:
            return function(*arguments)
        return tapes[0].step(f"{name}({', '.join(['{}'] * len(arguments))})", *arguments)

    return on_recorded


def _together(highest: int) -> Callable[[Number], Vector]:
    """Stumpff functions of one argument; what asks for one of them later finds it there."""

    def on_recorded(q: Number) -> Vector:
        if not isinstance(q, Recorded):
            return FLOATS.names[f"stumpffs{highest}"](q)
        found = q.tape.step(f"stumpffs{highest}({{}})", q)
        parts = tuple(q.tape.step(f"{{}}[{k}]", found) for k in range(highest))
        for k, part in enumerate(parts, start=1):
            q.tape.note(f"stumpff{k}({{}})", q, part)
        return parts

    return on_recorded


def _transients(order: int) -> Callable[..., Any]:
    """Free motions, computed together."""
    name, count = f"transients{order}", len(TABLES[order]) + len(MOTIONS[order])
    together = _recorded(name, FLOATS.names[name])

    def on_recorded(*arguments: Number) -> Vector:
        found = together(*arguments)
        if not isinstance(found, Recorded):
            return found
        return tuple(found.tape.step(f"{{}}[{i}]", found) for i in range(count))

    return on_recorded


RECORDED = Arithmetic(
    {name: _recorded(name, f) for name, f in FLOATS.names.items() if name not in PLAIN}
    | {f"stumpffs{n}": _together(n) for n in TOGETHER}
    | {f"transients{order}": _transients(order) for order in TABLES}
    | {"nan": math.nan, **PLAIN}
)
