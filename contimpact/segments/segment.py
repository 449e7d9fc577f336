"""What an answerer of segments must provide.

A segment is one smooth piece of an orbit, from the impact it leaves to the one it reaches. An orbit
problem closes segments into an orbit and asks them for everything; it knows nothing of how they are
computed. `closed_form.ClosedForm` answers with generated kernels.

The unknowns of an impact are its time and its section coordinates before impact: m of them where
the segment starts, m where it ends, and m equations. Parameter values are all of the model's, in
its order; derivatives are taken with respect to the `Source.parameters` among them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeAlias

from ..arrays import Array, Number
from ..models.model import Model
from .arithmetic import Arithmetic, Kernel
from .layout import Blocks, Row, Setup
from .passages import Passages

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


class Segment(Protocol):
    """One smooth piece of an orbit between two guards.

    Attributes
    ----------
    name : str
        The letters of the guards it leaves and reaches.
    """

    name: str

    def blocks(self, start: Numbers, end: Numbers, values: Numbers) -> Blocks:
        """Return residual and first derivatives.

        Parameters
        ----------
        start, end : sequence of shape (m,)
            Unknowns of the impacts left and reached.
        values : sequence
            Parameter values.

        Returns
        -------
        residual : tuple of shape (m,)
            What arrives, less what `end` says.
        start, end, by_parameter : tuple of shape (m * m,), (m * m,), (m * free,)
            Its derivatives, row by row.
        """
        ...

    def over(self, arithmetic: Arithmetic) -> Callable[[Numbers, Numbers, Numbers], Blocks]:
        """Return `blocks` for the numbers of another arithmetic."""
        ...

    def second(self, start: Numbers, end: Numbers, along: Numbers, values: Numbers) -> Blocks:
        """Return the derivatives of `blocks` along a direction.

        Parameters
        ----------
        along : sequence of shape (2 * m + free,)
            Rates of the unknowns at the start, at the end, and of the free parameters.
        """
        ...

    def third(self, start: Numbers, end: Numbers, along: Numbers, values: Numbers) -> Row:
        """Return the third derivatives of the residual along a direction, shape (m,).

        Parameters
        ----------
        along : sequence of shape (2 * m,)
            Rates of the unknowns at the start and at the end; parameters are held.
        """
        ...

    def track(self, start: Numbers, dt: Number, values: Numbers) -> tuple[Number, Number, Number]:
        """Return how the gap coordinate moves: displacement from the guard left, velocity and
        acceleration at the time dt after leaving.

        Its extrema, and where it first arrives at a wall, are found by `flight.excursions` and
        `flight.first_arrival`.
        """
        ...

    def speeds(self, start: Numbers, step: float, count: int, values: Numbers) -> Array:
        """Return the velocity of the gap coordinate at so many equal steps after leaving."""
        ...


class Source(Protocol):
    """Where an orbit problem has its segments from.

    Attributes
    ----------
    parameters : tuple of str
        The free parameters: one, or two on curves.
    """

    parameters: tuple[str, ...]

    def segment(self, start: str, end: str) -> Segment:
        """Return the segment from one guard to another, by their letters."""
        ...

    def setup(self, *values: Number) -> Setup:
        """Return what depends on the parameters alone."""
        ...
