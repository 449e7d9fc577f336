"""What the continuer asks of a problem; it knows nothing else about it."""

from __future__ import annotations

from typing import Protocol, TypeVar

from ..arrays import Array


class Evaluation(Protocol):
    """A problem evaluated at one point. A problem may keep more here for its test functions."""

    @property
    def unknowns(self) -> Array:
        """The point, shape (n + 1,); the free parameter is last."""

    @property
    def residual(self) -> Array:
        """F, shape (n,)."""

    @property
    def jacobian(self) -> Array:
        """dF/d(unknowns), shape (n, n + 1)."""


E = TypeVar("E", bound=Evaluation, covariant=True)
"""What a problem makes of a point."""


class Problem(Protocol[E]):
    """n equations in n + 1 unknowns, the last of which is the free parameter."""

    def evaluate(self, unknowns: Array) -> E:
        """Evaluate at a point. `ArithmeticError` and `ValueError` say that F has no value there."""

    def scale(self, unknowns: Array, span: float) -> Array:
        """Return natural sizes of the unknowns, shape (n + 1,), given the parameter's."""

    def difference(self, one: Array, other: Array) -> Array:
        """Return one - other, zero where both stand for the same solution."""
