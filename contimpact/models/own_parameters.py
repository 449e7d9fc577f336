"""Parameters of one's own: names in an expression that are given values among the parameters."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from ..errors import InputError
from .contract import check_names
from .expressions import CONSTANTS, FUNCTIONS, check_expression, names_in, values_of

SAMPLES = 256
"""Of a period: more than twice the harmonics that a forcing may have."""
AT_RANDOM = (0.37, -1.91, 0.083)
"""Values of a parameter at which means are compared."""


def own_names(
    texts: Sequence[str], known: Collection[str], taken: Collection[str], given: Collection[str]
) -> list[str]:
    """Return the names in expressions that are given values, in the order of their appearance.

    Parameters
    ----------
    texts : sequence of str
        The expressions.
    known : collection of str
        Names that stand for something else: variables, and the parameters that a system declares.
    taken : collection of str
        Names that they must not have.
    given : collection of str
        Names that are given values.
    """
    known = {*known, *FUNCTIONS, *CONSTANTS}
    names = dict.fromkeys(name for text in texts for name in names_in(text))
    own = [name for name in names if name in given and name not in known]
    check_names(own, "parameters", taken)
    return own


def check_with_own(
    text: str, where: str, variables: Sequence[str], own: Sequence[str], declared: Collection[str]
) -> None:
    """Check an expression in which parameters of one's own may stand; see `check_expression`.

    The parameters that a system declares may not.
    """
    try:
        check_expression(text, where, (*variables, *own))
    except InputError as error:
        unknown = error.found.startswith("unknown name")
        if not unknown or any(repr(name) in error.found for name in declared):
            raise
        accepted = f"give it a value among the parameters; {error.accepted}"
        raise InputError(error.where, error.found, accepted) from None


def mean_depends(text: str, own: Mapping[str, float], parameter: str, period: float) -> bool:
    """Return whether the mean of a sum of harmonics in ``t`` depends on a parameter in it.

    Parameters
    ----------
    text : str
    own : mapping of str to float
        Values of the parameters in it.
    parameter : str
        One of them.
    period : float
    """
    import numpy as np

    t = period * np.arange(SAMPLES) / SAMPLES
    means = [
        np.mean(values_of(text, "expression", {"t": t, **own, parameter: value}))
        for value in AT_RANDOM
    ]
    return bool(np.ptp(means) > 1e-12)
