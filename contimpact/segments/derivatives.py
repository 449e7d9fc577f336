"""Derivatives of kernels of any order, by truncated Taylor series and recorded programs.

The kernel is evaluated once on series whose coefficients write down what is done with them; what
they have written is a kernel of floats. That takes milliseconds, and no formulas.
"""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NoReturn, TypeAlias

from ..arrays import Number, Vector
from ..errors import InputError
from .integrated_flight import flown_of_series, in_parts
from .integration import statement
from .kernel import Blocks, flat, refill, result_text
from .linear_flow import Shape
from .segment import FLOATS, PLAIN, Arithmetic, Kernel, evaluate_in, kernel_of
from .transients import HIGHEST, MOTIONS, TABLES, TOGETHER

# Kernels on truncated Taylor series: derivatives along a direction, of any order.
#
# A kernel evaluated at x + q e, with e a small quantity whose powers beyond the n-th are dropped,
# returns the derivatives of its results along q,
#
# .. math:: f(x + q e) = \sum_{k \le n} \frac{e^k}{k!} \, \partial_q^k f(x) + O(e^{n+1}),
#
# exactly but for rounding (Griewank and Walther, Evaluating Derivatives, 2008, ch. 13). The
# coefficients are numbers of another arithmetic: floats, many digits, or numbers that write down
# what is done with them (recorded programs). The whole number 0 stands for a coefficient that
# vanishes whatever the arguments, and costs nothing.
#
# Of some functions fewer derivatives are known. Their series are shorter, and so are those of what
# is made from them.


class Series:
    """A polynomial in e, by its coefficients from that of e^0 on, as far as they are known."""

    __slots__ = ("coefficients",)

    def __init__(self, coefficients: Iterable[Number]) -> None:
        self.coefficients = list(coefficients)

    def _of(self, other: Number) -> Series:
        if isinstance(other, Series):
            return other
        return Series([other, *[0] * (len(self.coefficients) - 1)])

    def __add__(self, other: Number) -> Series:
        return Series(map(_sum, self.coefficients, self._of(other).coefficients))

    __radd__ = __add__

    def __neg__(self) -> Series:
        return Series([0 if _vanishes(a) else -a for a in self.coefficients])

    def __sub__(self, other: Number) -> Series:
        return Series(map(_difference, self.coefficients, self._of(other).coefficients))

    def __rsub__(self, other: Number) -> Series:
        return self._of(other) - self

    def __mul__(self, other: Number) -> Series:
        a, b = self.coefficients, self._of(other).coefficients
        return Series([_product(a[: n + 1], b[n::-1]) for n in range(min(len(a), len(b)))])

    __rmul__ = __mul__

    def __truediv__(self, other: Number) -> Series:
        a, b = self.coefficients, self._of(other).coefficients
        found: list[Number] = []
        for n in range(min(len(a), len(b))):
            left = _difference(a[n], _product(b[1 : n + 1], found[::-1]))
            found.append(0 if _vanishes(left) else left / b[0])
        return Series(found)

    def __rtruediv__(self, other: Number) -> Series:
        return self._of(other) / self

    def __pow__(self, exponent: Number) -> Series:
        return compose_series(
            lambda x: x**exponent, [lambda x: exponent * x ** (exponent - 1)], self
        )

    def __mod__(self, other: Number) -> Series:
        (a, *rest), (b, *by) = self.coefficients, self._of(other).coefficients
        turns = (a - a % b) / b
        return Series([a % b, *map(_difference, rest, (_product([turns], [c]) for c in by))])


def _vanishes(coefficient: Number) -> bool:
    return type(coefficient) is int and coefficient == 0


def _sum(a: Number, b: Number) -> Number:
    return b if _vanishes(a) else a if _vanishes(b) else a + b


def _difference(a: Number, b: Number) -> Number:
    return a if _vanishes(b) else -b if _vanishes(a) else a - b


def _product(a: Sequence[Number], b: Sequence[Number]) -> Number:
    """The sum of the products of coefficients."""
    total: Number = 0
    for x, y in zip(a, b, strict=True):
        if not (_vanishes(x) or _vanishes(y)):
            total = _sum(total, x * y)
    return total


def compose_series(
    function: Callable[..., Any], slopes: Sequence[Callable[..., Any]], *arguments: Number
) -> Series:
    """Return a function of series, from its values and its derivatives as functions of series.

    From f' = sum of df/dx_i x_i', coefficient by coefficient: n f_n = sum of k x_k (df/dx)_{n-k}.
    """
    size, given = _to_one_length(arguments)
    found = [function(*(x.coefficients[0] for x in given))] + [0] * (size - 1)
    if size == 1:
        return Series(found)
    shorter = [Series(x.coefficients[:-1]) for x in given]
    for x, slope in zip(given, slopes, strict=True):
        rates = [k * c if k > 1 else c for k, c in enumerate(x.coefficients)][1:]
        if all(map(_vanishes, rates)):
            continue
        by = shorter[0]._of(slope(*shorter)).coefficients
        for n in range(1, size):
            found[n] = _sum(found[n], _product(rates[:n], by[n - 1 :: -1]))
    return Series([c / n if n > 1 and not _vanishes(c) else c for n, c in enumerate(found)])


def _to_one_length(arguments: Sequence[Number]) -> tuple[int, list[Series]]:
    """Arguments as series of one length, and that length."""
    size = min(len(x.coefficients) for x in arguments if isinstance(x, Series))
    given = (x.coefficients if isinstance(x, Series) else [x, *[0] * size] for x in arguments)
    return size, [Series(x[:size]) for x in given]


def series(inner: Arithmetic) -> Arithmetic:
    """Return the arithmetic of series whose coefficients are numbers of another one."""
    names: dict[str, Any] = {}
    for name, slopes in _slopes(names).items():
        names[name] = _series_function(inner.names[name], slopes)
    for highest in TOGETHER:
        names[f"stumpffs{highest}"] = _together(inner, names, highest)
    for order in TABLES:
        names[f"transients{order}"] = _transients(inner, order)
    for name in ("flow", "flown"):
        if f"{name}_of_series" in inner.names:
            names[name] = _flights(inner, name)
    constants = {name: inner.names[name] for name in ("nan", "pi", "ratio") if name in inner.names}
    return Arithmetic(names | constants | PLAIN, inner.exact)


def _series_function(
    function: Callable[..., Any], slopes: Sequence[Callable[..., Any]]
) -> Callable[..., Any]:
    def on_series(*arguments: Number) -> Number:
        if any(isinstance(x, Series) for x in arguments):
            return compose_series(function, slopes, *arguments)
        return function(*arguments)

    return on_series


def _slopes(names: dict[str, Any]) -> dict[str, list[Callable[..., Any]]]:
    """The derivatives of every function with respect to each of its arguments."""
    f = names
    found: dict[str, list[Callable[..., Any]]] = {
        "sin": [lambda x: f["cos"](x)],
        "cos": [lambda x: -f["sin"](x)],
        "tan": [lambda x: 1 + f["tan"](x) ** 2],
        "asin": [lambda x: 1 / f["sqrt"](1 - x * x)],
        "acos": [lambda x: -1 / f["sqrt"](1 - x * x)],
        "atan": [lambda x: 1 / (1 + x * x)],
        "sinh": [lambda x: f["cosh"](x)],
        "cosh": [lambda x: f["sinh"](x)],
        "tanh": [lambda x: 1 - f["tanh"](x) ** 2],
        "exp": [lambda x: f["exp"](x)],
        "log": [lambda x: 1 / x],
        "sqrt": [lambda x: 1 / (2 * f["sqrt"](x))],
        "floor": [lambda x: 0],
    }
    for k in range(HIGHEST - 1):
        found[f"stumpff{k}"] = [lambda q, k=k: _stumpff_slope(f, k, q)]
    for k in (HIGHEST - 1, HIGHEST):  # their derivatives are further than there are functions
        found[f"stumpff{k}"] = [_refuse_order]
    return found


def _stumpff_slope(f: dict[str, Any], k: int, q: Number) -> Number:
    """c_k' = (k c_{k+2} - c_{k+1})/2."""
    above = f[f"stumpff{k + 1}"](q)
    if k == 0:
        return above / -2
    further = f[f"stumpff{k + 2}"](q)
    return ((further if k == 1 else k * further) - above) / 2


def _refuse_order(*arguments: Number) -> NoReturn:
    found = f"derivatives of Stumpff functions beyond c_{HIGHEST} are asked for"
    raise InputError("flight", found, "write it with Stumpff functions of lower order")


def _together(inner: Arithmetic, names: dict[str, Any], highest: int) -> Callable[[Number], Vector]:
    """All c_k from the first on, by the function of the coefficients' arithmetic for all."""
    slopes = _slopes(names)

    def on_series(q: Number) -> Vector:
        if not isinstance(q, Series):
            return inner.names[f"stumpffs{highest}"](q)
        values = inner.names[f"stumpffs{highest}"](q.coefficients[0])
        return tuple(
            compose_series(lambda _, c=c: c, slopes[f"stumpff{k}"], q)
            for k, c in enumerate(values, start=1)
        )

    return on_series


def _transients(inner: Arithmetic, order: int) -> Callable[..., Any]:
    """Free motions of an oscillator, from those with all their derivatives."""
    highest = max(TABLES)

    def on_series(*arguments: Number) -> Vector:
        if not any(isinstance(x, Series) for x in arguments):
            return inner.names[f"transients{order}"](*arguments)
        size, given = _to_one_length(arguments)
        values = inner.names[f"transients{highest}"](*(x.coefficients[0] for x in given))
        found = dict(zip(_forms(highest), (Series([v]) for v in values), strict=True))
        for n in range(2, size + 1):
            found = _longer_transients(found, [Series(x.coefficients[:n]) for x in given])
        return tuple(found[form] for form in _forms(order))

    return on_series


def _flights(inner: Arithmetic, name: str) -> Callable[..., Any]:
    """Flights that are linear, or integrated: a function of what they are of, and of numbers."""
    flights, of_series = inner.names[name], inner.names[f"{name}_of_series"]
    about = {"flow": 3, "flown": 2}[name]

    def on_series(*given: Any) -> Vector:
        of, arguments = given[:about], given[about:]
        if not any(isinstance(x, Series) for x in arguments):
            return flights(*given)
        rows = [x.coefficients for x in _to_one_length(arguments)[1]]
        return [Series(row) for row in of_series(*of, rows)]

    return on_series


Form: TypeAlias = tuple[bool, int, int]
"""A free motion (n, b), and whether it is divided by its power of the time."""


def _forms(order: int) -> list[Form]:
    """What `transients` of that order returns."""
    means = [(n < 2 * b - 1, n, b) for n, b in TABLES[order]]
    return [*means, *((False, n, b) for n, b in MOTIONS[order])]


def _longer_transients(
    known: dict[Form, Series], arguments: Sequence[Series]
) -> dict[Form, Series]:
    """Free motions with one coefficient more, as far as their derivatives are known."""
    moving = [not all(map(_vanishes, x.coefficients[1:])) for x in arguments]
    shorter = len(arguments[0].coefficients) - 1
    full = {form: x for form, x in known.items() if len(x.coefficients) == shorter}
    found = dict(known)
    for form, x in full.items():
        slopes = _slopes_of_motion(form, full)
        if all(slope for slope, moves in zip(slopes, moving, strict=True) if moves):
            found[form] = compose_series(lambda *_, x=x: x.coefficients[0], slopes, *arguments)
    return found


def _slopes_of_motion(form: Form, known: dict[Form, Series]) -> list[Any]:
    """Derivatives with respect to c, k and t; None for one that is not known."""
    mean, n, b = form
    both, lower = known.get((mean, n + 1, b + 1)), known.get((mean, n, b + 1))
    if mean:
        return [
            both and (lambda c, k, t: -b * (t * both)),
            lower and (lambda c, k, t: -b * (t * t * lower)),
            both and lower and (lambda c, k, t: -b * (c * both + 2 * (k * t) * lower)),
        ]
    rate = known.get((mean, n + 1, b))
    return [
        both and (lambda c, k, t: -b * both),
        lower and (lambda c, k, t: -b * lower),
        rate and (lambda c, k, t: rate),
    ]


# Numbers that write down what is done with them, as straight-line code.
#
# A kernel evaluated on them leaves a tape of its steps; equal steps stand there once. From the tape
# comes the text of a new kernel with those steps alone that its results need.

DEEPEST = 30
"""Operations inside each other that are written as one expression."""


class Tape:
    """Steps of a computation, in order: each an operation and what it is done with."""

    def __init__(self) -> None:
        self.steps: list[tuple[Any, ...]] = []
        self._places: dict[tuple[Any, ...], int] = {}

    def step(self, operation: str, *operands: Number) -> TapeNumber:
        """Return the result of an operation on recorded numbers and floats."""
        key = (operation, *(x.place if isinstance(x, TapeNumber) else repr(x) for x in operands))
        if key not in self._places:
            self._places[key] = len(self.steps)
            self.steps.append(key)
        return TapeNumber(self, self._places[key])

    def note(self, operation: str, operand: Number, result: TapeNumber) -> None:
        """Remember the result of an operation that need not be made."""
        self._places.setdefault((operation, operand.place), result.place)

    def kernel(self, name: str, arguments: Sequence[str], about: str, result: Any) -> str:
        """Return the text of the kernel that makes the steps a result needs."""
        values = flat(result)
        uses = self._uses([x.place for x in values if isinstance(x, TapeNumber)])
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
        found = [texts[x.place] if isinstance(x, TapeNumber) else repr(float(x)) for x in values]
        head = f'def {name}({", ".join(arguments)}):\n    """{about}"""\n'
        return f"{head}{''.join(lines)}    return {result_text(refill(result, found))}\n"

    def _uses(self, wanted: list[int]) -> Counter[int]:
        """How often each step is used, those alone that are needed."""
        uses = Counter(wanted)
        for place in range(len(self.steps) - 1, -1, -1):
            if uses[place]:
                uses.update(x for x in self.steps[place][1:] if isinstance(x, int))
        return +uses


def _operators(operation: str) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """An operation of a recorded number and another number, and of the other one and it."""

    def operator(one: TapeNumber, other: Number) -> Any:
        known = isinstance(other, TapeNumber | int | float)
        return one.tape.step(operation, one, other) if known else NotImplemented

    def turned(one: TapeNumber, other: Number) -> Any:
        known = isinstance(other, TapeNumber | int | float)
        return one.tape.step(operation, other, one) if known else NotImplemented

    return operator, turned


class TapeNumber:
    """A number on a tape, by its place there."""

    __slots__ = ("place", "tape")

    def __init__(self, tape: Tape, place: int) -> None:
        self.tape, self.place = tape, place

    __add__, __radd__ = _operators("({} + {})")
    __sub__, __rsub__ = _operators("({} - {})")
    __mul__, __rmul__ = _operators("({}*{})")
    __truediv__, __rtruediv__ = _operators("({}/{})")
    __mod__, _ = _operators("({} % {})")
    __pow__, _ = _operators("({}**{})")

    def __neg__(self) -> TapeNumber:
        return self.tape.step("(-{})", self)


def _record_function(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
    """A function that writes itself down where one of its arguments is on a tape."""

    def on_recorded(*arguments: Number) -> Number | Vector:
        tapes = [x.tape for x in arguments if isinstance(x, TapeNumber)]
        if not tapes:
            return function(*arguments)
        return tapes[0].step(f"{name}({', '.join(['{}'] * len(arguments))})", *arguments)

    return on_recorded


def _record_stumpff(highest: int) -> Callable[[Number], Vector]:
    """Stumpff functions of one argument; what asks for one of them later finds it there."""

    def on_recorded(q: Number) -> Vector:
        if not isinstance(q, TapeNumber):
            return FLOATS.names[f"stumpffs{highest}"](q)
        found = q.tape.step(f"stumpffs{highest}({{}})", q)
        parts = tuple(q.tape.step(f"{{}}[{k}]", found) for k in range(highest))
        for k, part in enumerate(parts, start=1):
            q.tape.note(f"stumpff{k}({{}})", q, part)
        return parts

    return on_recorded


def _record_transients(order: int) -> Callable[..., Any]:
    """Free motions, computed together."""
    name, count = f"transients{order}", len(TABLES[order]) + len(MOTIONS[order])
    together = _record_function(name, FLOATS.names[name])

    def on_recorded(*arguments: Number) -> Vector:
        found = together(*arguments)
        if not isinstance(found, TapeNumber):
            return found
        return tuple(found.tape.step(f"{{}}[{i}]", found) for i in range(count))

    return on_recorded


def _record_flights(
    field: str, directions: str, rows: Sequence[Sequence[Number]]
) -> list[list[TapeNumber]]:
    """Flights that are integrated, from series; see `integrated_flight.in_parts`."""
    count = 2 * statement(field).freedom * (1 + len(directions.split()))
    return _record_series(f"flown_of_series({field!r}, {directions!r}, {{}})", rows, count)


def _record_linear(
    d: int, h: int, directions: int, rows: Sequence[Sequence[Number]]
) -> list[list[TapeNumber]]:
    """Linear flights, from series."""
    count = (4 + 2 * directions) * d * Shape(d, h, directions).size
    return _record_series(f"flow_of_series({d}, {h}, {directions}, {{}})", rows, count)


def _record_series(
    call: str, rows: Sequence[Sequence[Number]], count: int
) -> list[list[TapeNumber]]:
    """What a function of series returns: so many series of the length of its own."""
    numbers, orders = [c for row in rows for c in row], len(rows[0])
    tape = next(x.tape for x in numbers if isinstance(x, TapeNumber))
    row = f"({'{}, ' * orders}), "
    found = tape.step(call.format(f"({row * len(rows)})"), *numbers)
    return [[tape.step(f"{{}}[{i}][{k}]", found) for k in range(orders)] for i in range(count)]


RECORDED = Arithmetic(
    {name: _record_function(name, f) for name, f in FLOATS.names.items() if name not in PLAIN}
    | {f"stumpffs{n}": _record_stumpff(n) for n in TOGETHER}
    | {f"transients{order}": _record_transients(order) for order in TABLES}
    | {"flown_of_series": functools.partial(in_parts, _record_flights)}
    | {"nan": math.nan, "flow_of_series": _record_linear}
    | PLAIN
)


Derivatives: TypeAlias = Callable[..., Any]
"""Derivatives of a kernel, as a function of floats."""

FLOAT_SERIES, RECORDED_SERIES = series(FLOATS), series(RECORDED)


@functools.lru_cache(maxsize=256)
def second_derivatives(kernel: Kernel, ends: int, parameters: tuple[str, ...]) -> Derivatives:
    """Return ``second(t0, *y0, t1, *y1, *q, *p)``: how the `Blocks` of a flight change along a
    direction q. It has entries for the unknowns at both ends of the flight, and behind them for
    these parameters."""
    tape, arguments, blocks = _evaluate_along(kernel, ends, parameters, 1)
    changes = tuple(tuple(_coefficient(number, 1) for number in block) for block in blocks)
    about = f"How {kernel.__name__} changes along a direction q."
    text = tape.kernel("second", arguments, about, changes)
    return kernel_of("second", text, "<second>", {"flown_of_series": flown_of_series})


@functools.lru_cache(maxsize=256)
def third_derivatives(kernel: Kernel, ends: int) -> Derivatives:
    """Return ``third(t0, *y0, t1, *y1, *q, *p)``: third derivatives of a flight's residual along q,
    which has an entry for each unknown at both ends of the flight."""
    tape, arguments, blocks = _evaluate_along(kernel, ends, (), 3)
    found = tuple(6 * _coefficient(number, 3) for number in blocks[0])
    about = f"Third derivatives of the residual of {kernel.__name__} along a direction q."
    text = tape.kernel("third", arguments, about, found)
    return kernel_of("third", text, "<third>", {"flown_of_series": flown_of_series})


def _evaluate_along(
    kernel: Kernel, ends: int, parameters: Sequence[str], degree: int
) -> tuple[Tape, list[str], Blocks]:
    """Evaluate a flight where its ends and some parameters move along a direction."""
    tape = Tape()
    names = kernel.__code__.co_varnames[: kernel.__code__.co_argcount]
    moving = [*names[:ends], *(f"p_{parameter}" for parameter in parameters)]
    along = {name: f"q{i}" for i, name in enumerate(moving)}
    rest = [0] * (degree - 1)
    given = [
        Series([tape.step(name), tape.step(along[name]), *rest])
        if name in along
        else tape.step(name)
        for name in names
    ]
    arguments = [*names[:ends], *along.values(), *names[ends:]]
    return tape, arguments, evaluate_in(kernel, RECORDED_SERIES)(*given)


def _coefficient(number: Any, order: int) -> Any:
    """A coefficient of a result, which does not move where it is no series."""
    if not isinstance(number, Series):
        return 0
    if order >= len(number.coefficients):
        found = f"one of its free motions has no derivatives of order {order}"
        raise InputError("flight", found, "write it with free motions of lower n and b")
    return number.coefficients[order]
