"""Why branches end, and why steps are refused."""

from __future__ import annotations

import enum
from dataclasses import dataclass


class EndKind(enum.Enum):
    """Why a branch ends; the value is the sentence a user reads."""

    RANGE = "reached the end of the range at {parameter} = {value:.12g}"
    CLOSED = "closed on itself: the branch is a loop"
    STEP = (
        "the step fell below {floor:.3g} at {parameter} = {value:.12g} ({why}); a smaller min_step "
        "or another free parameter may carry on"
    )
    CORRECTOR = (
        "the corrector failed at {parameter} = {value:.12g} even with the smallest step ({why}); "
        "the formulas may have no value beyond"
    )
    START = "the first point was not reached at {parameter} = {value:.12g} ({why})"
    SINGULAR = (
        "the tangent is not defined at {parameter} = {value:.12g} ({why}); start from another point"
    )
    POINTS = (
        "the limit of {limit} points was reached at {parameter} = {value:.12g}; raise max_points "
        "to go on"
    )
    EDGE = (
        "left the range within a step of {floor:.3g} from {parameter} = {value:.12g} ({why}); "
        "another range or a smaller min_step ends on the limit itself"
    )
    NEAR_MISS = (
        "another branch passes this one at {parameter} = {place:.12g} at a distance of {near}, and "
        "no step follows this one beyond {parameter} = {value:.12g} ({why}); change a parameter to "
        "part them further"
    )
    SHORTER = (
        "became {word}, run {times} times, at {parameter} = {value:.12g}; beyond, the same orbits "
        "come again, whole periods later, or others that pass a guard"
    )
    SYMMETRIC = (
        "became its own mirror image at {parameter} = {value:.12g}; beyond, the mirror images of "
        "its orbits follow"
    )
    REST = (
        "shrank to an equilibrium near {parameter} = {value:.9g}, where the orbits are born: a "
        "Hopf bifurcation"
    )
    FOR_EVER = (
        "the period has grown to {period:.6g} at {parameter} = {value:.12g}, and {what}: the "
        "orbits come near to one that takes for ever, by an equilibrium (a homoclinic one)"
    )
    ROUNDING = (
        "rounding errors have grown to {error:.1g} at {parameter} = {value:.9g}: the flights "
        "amplify them so much that orbits beyond are not told apart"
    )
    KNOWN = "met branch {known} at {parameter} = {value:.12g}"
    UNPHYSICAL = (
        "the orbits are unphysical at {parameter} = {value:.12g} ({why}), and with unphysical = "
        "false are followed no further"
    )
    BORN = "born at {entry} of branch {parent} at {parameter} = {value:.12g}"
    UNFOLDED = (
        "the crossing of branches is unfolded at {parameter} = {value:.12g}: beyond, the branches "
        "pass each other"
    )
    TOUCH = "the touch reaches an impact of its own flight at {parameter} = {value:.12g}"
    RESONANCE = "the pair of multipliers meets on the real axis at {parameter} = {value:.12g}"
    PERIOD = (
        "the forcing's period is {times} times that of the start at {parameter} = {value:.12g} and "
        "grows without bound beyond; to go on, start from there"
    )
    STOPPED = "stopped at {parameter} = {value:.12g} on request"
    INTERRUPTED = "interrupted at {parameter} = {value:.12g}: what lies beyond was not followed"


AT_BRANCH_POINTS = frozenset({EndKind.SHORTER, EndKind.SYMMETRIC, EndKind.KNOWN})
"""Ends on orbits that have the status of neither side."""


@dataclass(frozen=True)
class End:
    """How a branch ends: the kind, the parameter value there, and a sentence."""

    kind: EndKind
    value: float
    message: str

    @classmethod
    def of(cls, kind: EndKind, parameter: str, value: float, **details: object) -> End:
        """Make an end, filling in its sentence."""
        text = kind.value.format(parameter=parameter, value=value, **details)
        return cls(kind, value, text)


# Why a step is refused, and what kind of end it makes where no shorter step is left.


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
class RefusalDetails:
    """A refusal with what it has to tell."""

    cause: Refusal
    detail: object = None

    @property
    def kind(self) -> EndKind:
        """The end of a branch on which every step was refused like this one."""
        return self.cause.value[0]

    def __str__(self) -> str:
        return self.cause.value[1].format(self.detail)
