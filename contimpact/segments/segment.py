"""What a segment must provide, in which arithmetics, what meets it, and closed forms.

A segment is one smooth piece of an orbit, from the impact it leaves to the one it reaches. An orbit
problem closes segments into an orbit and asks them for everything; it knows nothing of how they are
computed.

The unknowns of an impact are its time and its section coordinates before impact: m of them where
the segment starts, m where it ends, and m equations. Parameter values are all of the model's, in
its order; derivatives are taken with respect to the free ones among them.
"""

from __future__ import annotations

import builtins
import dis
import functools
import math
import types
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np

from ..arrays import Array, Number
from ..errors import InputError
from ..models.expressions import NUMPY_SPELLING
from ..models.guards import Guard
from ..models.model import Model
from . import integrated_flight, kernel, linear_flow, transients
from .kernel import ELEMENTARY, SECTION, Blocks, Row, cube, function_of, power, square
from .kernel import FUNCTIONS as FUNCTIONS
from .kernel import Kernel as Kernel

# The arithmetics in which a kernel can be evaluated.
#
# A kernel is one straight-line text: sums, products, quotients, powers and functions, all by name;
# where a forcing has many harmonics it holds a loop over these. What the names stand for makes the
# arithmetic: floats, arrays, numbers with bounds of their rounding errors (`bounded`), many digits
# (`bounded`), truncated Taylor series (`derivatives`). Two constants are not whole numbers: ``pi``,
# and ``ratio(p, q)`` for the quotient of two of these. Floats and arrays see them as numbers; an
# exact arithmetic makes them itself.


def _same(number: Number) -> Number:
    return number


@dataclass(frozen=True)
class Arithmetic:
    """What the names in a kernel stand for."""

    names: dict[str, Any]
    """Those of `FUNCTIONS`, ``nan``, and `PLAIN`; as far as kernels call them, ``stumpff0`` to
    ``stumpff11``, ``stumpffs3`` and ``stumpffs5`` for undamped motion, ``transients1``, ``2`` and
    ``4`` for damped one, ``flow`` for linear flights and ``flown`` for integrated ones, as `FLOATS`
    has them. An exact arithmetic has ``pi`` and ``ratio`` besides."""
    exact: bool = False
    """Whether constants are looked up among the names, rather than taken as floats."""
    number: Callable[[Number], Number] = _same
    """Makes a number of it of a double, or of a number that it is already."""
    time: Callable[[Number], Number] = _same
    """Makes what a kernel may reduce to the forcing's period of the time of an impact."""


def evaluate_in(kernel: Kernel, arithmetic: Arithmetic) -> Callable[..., Any]:
    """Return a kernel as a function of the numbers of an arithmetic.

    Raises InputError if the kernel calls what the arithmetic does not have.
    """
    code = _exact_code(kernel.text) if arithmetic.exact else kernel.__code__
    names = arithmetic.names | kernel.functions if kernel.functions else arithmetic.names
    if missing := [name for name in code.co_names if name not in names]:
        _require_names(kernel, code, missing)
    return types.FunctionType(code, names, kernel.__name__)


def _require_names(kernel: Kernel, code: types.CodeType, missing: Sequence[str]) -> None:
    """Refuse a kernel that calls one of these; they may be attributes, or Python's own."""
    called = {i.argval for i in dis.get_instructions(code) if i.opname == "LOAD_GLOBAL"}
    if lacking := [name for name in missing if name in called and not hasattr(builtins, name)]:
        found = f"it has no {', '.join(lacking)}, which the kernel {kernel.__name__} uses"
        raise InputError("arithmetic", found, "add what FLOATS has by that name, for its numbers")


def kernel_of(
    name: str, text: str, file: str, functions: dict[str, Callable[..., Any]] | None = None
) -> Kernel:
    """Return a kernel, as a function of floats, from its text.

    `functions` are those that it calls and arithmetics do not have, in plain sums and products.
    """
    return function_of(name, text, file, FLOATS.names, functions)


@functools.cache
def _exact_code(text: str) -> types.CodeType:
    module = compile(text, "<kernel>", "exec")
    return next(c for c in module.co_consts if isinstance(c, types.CodeType))


def waves(rows: Any, phase: Any, dt: Any) -> Any:
    """Return the rows (k, a_k, b_k) of a sum over harmonics, in each of which stands its term."""
    return rows


def total(x: Any) -> Any:
    """Return the sum of the terms of a row of `waves`."""
    return x


PLAIN: dict[str, Any] = {
    "square": square,
    "cube": cube,
    "power": power,
    "waves": waves,
    "total": total,
    **kernel.NAMES,
}
"""Names that stand for the same in every arithmetic."""

FLOATS = Arithmetic(
    {**PLAIN, **ELEMENTARY, **linear_flow.SCALAR, **integrated_flight.SCALAR}
    | transients.STUMPFF_SCALAR
    | transients.SCALAR
)

AT_ONCE = 8192
"""Numbers in the arrays that a sum over harmonics makes: as many as a processor holds nearby."""


def _array_waves(rows: Any, phase: Any, dt: Any) -> Iterator[Any]:
    """Several rows at once, along a first axis of their own."""
    shape = np.broadcast_shapes(np.shape(phase), np.shape(dt))
    count = max(1, AT_ONCE // max(1, math.prod(shape)))
    columns = np.array(rows, dtype=float).T
    for first in range(0, len(rows), count):
        part = columns[:, first : first + count]
        yield part.reshape(*part.shape, *(1 for _ in shape))


ARRAYS = Arithmetic(
    {name: getattr(np, NUMPY_SPELLING.get(name, name)) for name in FUNCTIONS}
    | {"nan": math.nan, **linear_flow.ARRAY, **integrated_flight.ARRAY, **PLAIN}
    | {"waves": _array_waves, "total": lambda x: np.sum(x, axis=0)}
    | transients.STUMPFF_ARRAY
    | transients.ARRAY
)

STATES = Arithmetic({**ARRAYS.names, **linear_flow.STATES, **integrated_flight.STATES})
"""Arrays, where derivatives of linear and of integrated flights by parameters are not asked for."""
VALUES = Arithmetic({**STATES.names, **integrated_flight.VALUES})
"""Arrays, where no derivatives of integrated flights are asked for."""


# What meets a flight: the guards that can end it, and how it leaves and reaches their surfaces.

ELSEWHERE, BACK, MEETING, AT_SECTION = range(4)
"""End of a flight: on another surface than it left; on the same; on the same, where both guards let
the motion pass, so that the flight can vanish with the velocities at its ends; at the section."""


class Passages(NamedTuple):
    """What meets the flights of a system, by the numbers of its guards."""

    watched: tuple[tuple[bool, ...], ...]
    """Of each guard that is left: whether the flight can meet each guard."""
    leaving: tuple[float, ...]
    """The side, on the flight, of the surface that it leaves: its guard's after a rigid wall, that
    of the guard that the new mode has there after another, or zero if it has none."""
    arrivals: tuple[tuple[int, ...], ...]
    """Of each guard that is left: where a flight to each guard ends."""
    onto: tuple[tuple[bool, ...], ...] = ()
    """Of each guard that is left: whether the jump after a touch leads onto the surface of each
    guard, so that the flight there vanishes with the velocity of the touch. Empty for none."""
    begins: tuple[tuple[bool, ...], ...] = ()
    at_rest: tuple[tuple[bool, ...], ...] = ()
    """`begins`, `at_rest`: of each guard that is left: whether the flight begins on the surface of
    each guard of its mode with a rate of either sign, so that it may leave the mode at once; or
    always without any. Empty for none."""
    bends: tuple[tuple[bool, ...], ...] = ()
    """Of each guard that is left: whether the rate of each guard's gap coordinate is another one
    after it than before, in modes that both have that guard. Empty for none."""

    def meets_at_rest(self, left: int, reached: int) -> bool:
        """Whether a flight that a touch starts can vanish."""
        return self.arrivals[left][reached] != ELSEWHERE or (
            bool(self.onto) and self.onto[left][reached]
        )

    @property
    def anchored(self) -> bool:
        """Whether flights start on the surfaces of the guards that they leave: no jump moves the
        gap coordinate."""
        return all(row[a] != ELSEWHERE for a, row in enumerate(self.arrivals))

    def beginning(self, left: int) -> list[int]:
        """Return the guards on whose surface the flight begins with a rate of either sign."""
        return [k for k, begins in enumerate(self.begins[left]) if begins] if self.begins else []

    def resting(self, left: int) -> list[int]:
        """Return the guards on whose surface the flight begins without any."""
        return [k for k, rests in enumerate(self.at_rest[left]) if rests] if self.at_rest else []

    def bending(self, left: int) -> list[int]:
        """Return the guards whose gap coordinates have another rate after a guard than before."""
        return [k for k, bends in enumerate(self.bends[left]) if bends] if self.bends else []

    def vanishes(self, left: int, reached: int) -> bool:
        """Whether a flight can vanish together with the velocities at its ends."""
        return self.arrivals[left][reached] == MEETING


def neighbouring_guards(guards: Sequence[Guard], passages: Passages, wall: int) -> tuple[int, int]:
    """Return the guards below and above that a flight from a guard can meet; -1 for none.

    Raises InputError if the side of its surface on which the flight leaves is not known, or there
    are two guards on one side.
    """
    if passages.leaving[wall] == 0.0:
        found = f"behind {guards[wall].name} its next mode has no guard on the same surface"
        raise InputError("model", found, "give the mode one there to simulate it")
    met = {-1: -1, 1: -1}
    for k, guard in enumerate(guards):
        if passages.watched[wall][k] and met[guard.side] >= 0:
            raise InputError("model", "two walls on one side", "give at most one on each side")
        if passages.watched[wall][k]:
            met[guard.side] = k
    return met[-1], met[1]


def passages_of(guards: Sequence[Guard], back: Callable[[int, int], bool]) -> Passages:
    """Return what meets flights.

    ``back(left, reached)`` says whether a flight between two guards ends on the surface it leaves.
    """
    places = range(len(guards))
    watched = tuple(tuple(a.next_mode in b.modes for b in guards) for a in guards)

    def arrival(a: int, b: int) -> int:
        if not back(a, b):
            return ELSEWHERE
        through = guards[a].side != guards[b].side and not guards[a].past
        return MEETING if through else BACK

    def leaving(a: int) -> float:
        met = (guards[b].side for b in places if watched[a][b] and back(a, b))
        return float(next(met, 0))

    arrivals = tuple(tuple(arrival(a, b) for b in places) for a in places)
    return Passages(watched, tuple(leaving(a) for a in places), arrivals)


Numbers: TypeAlias = Sequence[Number] | Array
"""Numbers of one arithmetic."""


class KernelSource(Protocol):
    """What segments ask of the kernels of a model; see `kernels.Kernels`."""

    model: Model
    parameters: tuple[str, ...]

    @property
    def passages(self) -> Passages:
        """What meets the flights, by the numbers of the guards."""

    def flight(self, a: str, b: str) -> Kernel:
        """Return the kernel of a flight from wall a to wall b."""
        ...

    def second(self, a: str, b: str) -> Callable[..., Any]:
        """Return how the blocks of a flight change along a direction."""
        ...

    def third(self, a: str, b: str) -> Callable[..., Any]:
        """Return the third derivatives of the residual of a flight along a direction."""
        ...

    def motion(self, a: str) -> Kernel:
        """Return the motion of the gap coordinate of wall a after an impact there."""
        ...

    def since(self, a: str) -> Kernel:
        """Return the motion of the gap coordinate of wall a since a section."""
        ...

    def law(self, a: str) -> Kernel:
        """Return the law of the linear flights that leave wall a."""
        ...

    def linear(self, a: str) -> bool:
        """Return whether the flights that leave wall a are linear."""
        ...


# Segments, answered by generated kernels.


class Segment:
    """One smooth piece of an orbit between two guards, by default in closed form; its `name` is the
    letters of the guards it leaves and reaches."""

    def __init__(self, kernels: KernelSource, start: str, end: str) -> None:
        self.name = start + end
        self._kernels, self._walls = kernels, (start, end)
        self._flight = kernels.flight(start, end)

    def blocks(self, start: Numbers, end: Numbers, values: Numbers) -> Blocks:
        """Return residual and first derivatives.

        `start` and `end` are the m unknowns of the impacts left and reached. The residual (m,) is
        what arrives, less what `end` says; its derivatives by both and by the free parameters, of
        shape (m * m,), (m * m,) and (m * free,), are row by row.
        """
        return self._flight(*start, *end, *values)

    def whole(self, start: Numbers, end: Numbers, values: Numbers) -> Blocks:
        """Return `blocks` of a flight that is not computed in pieces.

        Raises ArithmeticError where it would have to be.
        """
        return self.blocks(start, end, values)

    def over(self, arithmetic: Arithmetic) -> Callable[[Numbers, Numbers, Numbers], Blocks]:
        """Return `blocks` for the numbers of another arithmetic."""
        flight = evaluate_in(self._flight, arithmetic)
        return lambda start, end, values: flight(*start, *end, *values)

    @property
    def kernel(self) -> Kernel:
        """The kernel of the flight."""
        return self._flight

    def second(self, start: Numbers, end: Numbers, along: Numbers, values: Numbers) -> Blocks:
        """Return the derivatives of `blocks` along a direction: rates of the unknowns at the start,
        at the end, and of the free parameters, shape (2 * m + free,)."""
        return self._kernels.second(*self._walls)(*start, *end, *along, *values)

    def third(self, start: Numbers, end: Numbers, along: Numbers, values: Numbers) -> Row:
        """Return the third derivatives of the residual along a direction of the unknowns at both
        ends, shape (m,); parameters are held."""
        return self._kernels.third(*self._walls)(*start, *end, *along, *values)

    def track(self, start: Numbers, dt: Number, values: Numbers) -> tuple[Number, Number, Number]:
        """Return how the gap coordinate moves: displacement from the guard left, velocity and
        acceleration at the time dt after leaving.

        Its extrema, and where it first arrives at a wall, are found by `flight.excursions` and
        `flight.first_arrival`.
        """
        return self._motion(*start, dt, *values)

    @functools.cached_property
    def _motion(self) -> Kernel:
        """The motion of the gap coordinate of the guard left, or of the first guard."""
        if self._walls[0] == SECTION:
            return self._kernels.since(self._kernels.model.WALLS[0].name)
        return self._kernels.motion(self._walls[0])
