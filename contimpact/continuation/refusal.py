"""Why a step is refused, and what kind of end it makes where no shorter step is left."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from .ends import EndKind


class Refusal(enum.Enum):
    """Reasons to refuse a step: the kind of end each leads to, and the words a user reads."""

    NO_VALUE = EndKind.CORRECTOR, "{}"
    NO_SOLUTION = EndKind.SINGULAR, "the bordered matrix is singular"
    DIVERGES = EndKind.STEP, "Newton's iteration diverges"
    SLOW = EndKind.STEP, "no convergence in {} iterations"
    NO_TANGENT = EndKind.SINGULAR, "the tangent is not defined"
    TURNS = EndKind.STEP, "the branch turns by {:.3g} rad"
    BENDS = EndKind.STEP, "the branch turns inside the step, by {:.3g} of its length"
    JUMPS = EndKind.STEP, "the branch turns away from the step"
    PASSES = EndKind.STEP, "the step leads to another branch that passes nearby"
    LEAVES = EndKind.EDGE, "the branch leaves the range and returns inside the step"
    NO_LIMIT = EndKind.EDGE, "no point was reached on the limit"


@dataclass(frozen=True)
class Refused:
    """A refusal with what it has to tell."""

    cause: Refusal
    detail: object = None

    @property
    def kind(self) -> EndKind:
        """The end of a branch on which every step was refused like this one."""
        return self.cause.value[0]

    def __str__(self) -> str:
        return self.cause.value[1].format(self.detail)
