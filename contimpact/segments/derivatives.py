"""Second and third derivatives of a segment along a direction, from the text of its kernel.

The kernel is evaluated once on series whose coefficients write down what is done with them; what
they have written is a kernel of floats. That takes milliseconds, and no formulas.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

from ..errors import InputError
from .arithmetic import FLOATS, FLOWS, Kernel, evaluate_in, kernel_of
from .layout import Blocks, flat, refilled
from .recording import RECORDED, Tape
from .series import Series, series

Derivatives: TypeAlias = Callable[..., Any]
"""Of a kernel, as a function of floats."""

SERIES = series(RECORDED)
SERIES_OF_FLOATS = series(FLOATS)


def second_derivatives(kernel: Kernel, ends: int, parameters: Sequence[str]) -> Derivatives:
    """Return ``second(t0, *y0, t1, *y1, *q, *p)``: how `Blocks` change along a direction q.

    Parameters
    ----------
    kernel : Kernel
        Of a flight.
    ends : int
        Unknowns at both ends of the flight.
    parameters : sequence of str
        Those that the direction has entries for, behind those of the ends.
    """
    if _loops(kernel):
        directly = _directly(kernel, ends, parameters, 1)

        def second(*given: float) -> Blocks:
            found = directly(*given)
            return refilled(found, [_coefficient(x, 1) for x in flat(found)])

        return second
    tape, arguments, blocks = _along(kernel, ends, parameters, 1)
    changes = tuple(tuple(_coefficient(number, 1) for number in block) for block in blocks)
    about = f"How {kernel.__name__} changes along a direction q."
    return kernel_of("second", tape.kernel("second", arguments, about, changes), "<second>")


def third_derivatives(kernel: Kernel, ends: int) -> Derivatives:
    """Return ``third(t0, *y0, t1, *y1, *q, *p)``: third derivatives of the residual along q.

    Parameters
    ----------
    kernel : Kernel
        Of a flight.
    ends : int
        Unknowns at both ends of the flight, the entries of the direction.
    """
    if _loops(kernel):
        directly = _directly(kernel, ends, (), 3)
        return lambda *given: tuple(6 * _coefficient(x, 3) for x in directly(*given)[0])
    tape, arguments, blocks = _along(kernel, ends, (), 3)
    found = tuple(6 * _coefficient(number, 3) for number in blocks[0])
    about = f"Third derivatives of the residual of {kernel.__name__} along a direction q."
    return kernel_of("third", tape.kernel("third", arguments, about, found), "<third>")


def _loops(kernel: Kernel) -> bool:
    """Whether a kernel calls what cannot be written down: its steps depend on its arguments."""
    return not FLOWS.isdisjoint(kernel.__code__.co_names)


def _directly(
    kernel: Kernel, ends: int, parameters: Sequence[str], degree: int
) -> Callable[..., Blocks]:
    """Return a kernel on series of floats, for the arguments of its derivatives."""
    names = kernel.__code__.co_varnames[: kernel.__code__.co_argcount]
    moving = [*names[:ends], *(f"p_{parameter}" for parameter in parameters)]
    function, rest = evaluate_in(kernel, SERIES_OF_FLOATS), [0] * (degree - 1)

    def evaluated(*given: float) -> Blocks:
        along = dict(zip(moving, given[ends:], strict=False))
        values = [*given[:ends], *given[ends + len(moving) :]]
        return function(
            *(
                Series([value, along[name], *rest]) if name in along else value
                for name, value in zip(names, values, strict=True)
            )
        )

    return evaluated


def _along(
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
    return tape, arguments, evaluate_in(kernel, SERIES)(*given)


def _coefficient(number: Any, order: int) -> Any:
    """A coefficient of a result, which does not move where it is no series."""
    if not isinstance(number, Series):
        return 0
    if order >= len(number.coefficients):
        found = f"one of its free motions has no derivatives of order {order}"
        raise InputError("flight", found, "write it with free motions of lower n and b")
    return number.coefficients[order]
