"""The contract of a system's class, checked when the class is defined."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable
from typing import Any

from ..errors import InputError, shown
from .automaton import check_modes, require_all

REQUIRED = ("SYSTEM", "PARAMETERS", "WALLS")

COLUMNS = frozenset(
    """arclength becomes branch closing criticality direction distance error event exponent1
    exponent2 exponent_error exponent_per_period exponent_sum flight from ghost id impact impacts
    iterations kind label mean_ln_r2 method n_unstable notation opens order parameter period
    periods physical rate reason requested residual slope smallest_gap stable touch_time wall why
    word""".split()
)
"""Columns that the package's tables have, whatever the system."""
NUMBERED = re.compile(
    r"(t|v|wall|time|velocity)[1-9]\d*|[xv]\d+_\d+|(position|velocity)\d+_\d+"
    r"|multiplier\d+_(re|im)|exponent[1-9]\d*"
)
"""Columns with the number of an impact, a motion, a multiplier or an exponent."""


def check_class(kind: Any) -> None:
    """Check the class attributes of a `Model`; those that are not there yet are left out.

    Raises
    ------
    InputError
        Naming the attribute.
    """
    where = kind.__name__
    check_modes(kind, where)
    parameters = getattr(kind, "PARAMETERS", ())
    require_all(parameters, ("name", "split", "accepted"), f"{where}.PARAMETERS", "Parameter")
    names = [name for p in parameters for name in (p.name, *p.split)]
    check_names(names, f"{where}.PARAMETERS", taken=())
    check_names(kind.DERIVED, f"{where}.DERIVED", taken=names)
    check_names(kind.OPTIONS, f"{where}.OPTIONS", taken=("system", "parameters", *names))
    for attribute, known in (
        ("DERIVED_UNITS", kind.DERIVED),
        ("DERIVED_FROM", kind.DERIVED),
        ("EXPRESSIONS", kind.OPTIONS),
        ("PARAMETRIC", kind.EXPRESSIONS),
    ):
        _check_known(getattr(kind, attribute), known, f"{where}.{attribute}")
    for derived, depends in kind.DERIVED_FROM.items():
        _check_known(depends, names, f"{where}.DERIVED_FROM[{derived!r}]")


def check_complete(kind: Any) -> None:
    """Raise `InputError` if a class attribute that every system needs is missing."""
    for name in REQUIRED:
        if not hasattr(kind, name):
            raise InputError(f"{kind.__name__}.{name}", "missing", f"set {', '.join(REQUIRED)}")


def check_names(names: Any, where: str, taken: Iterable[str]) -> None:
    """Refuse names that are no identifiers, that are columns of tables, or that stand twice."""
    used = set(taken)
    for name in names:
        if not _is_name(name):
            accepted = "give a name of letters, digits and underscores that starts with a letter"
            raise InputError(where, f"the name {shown(name)}", accepted)
        if name in COLUMNS or NUMBERED.fullmatch(name):
            accepted = "give another name: tables have a column of that name"
            raise InputError(where, f"the name {name!r}", accepted)
        if name in used:
            raise InputError(where, f"the name {name!r} twice", "give each its own name")
        used.add(name)


def _is_name(name: Any) -> bool:
    """Whether Python reads a name as it stands; it equates some letters."""
    return (
        isinstance(name, str)
        and name.isidentifier()
        and unicodedata.normalize("NFKC", name) == name
    )


def _check_known(names: Any, known: Iterable[str], where: str) -> None:
    unknown = [name for name in names if name not in known]
    if unknown:
        accepted = f"give some of {', '.join(known) or 'none'}"
        raise InputError(where, f"unknown name {unknown[0]!r}", accepted)
