"""What the library raises: input that cannot be used, and files that could not be written."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from numbers import Integral
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    import numpy as np

Call = TypeVar("Call", bound=Callable[..., Any])

LONGEST_MESSAGE = 560


DAMAGE = (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError)
"""Exceptions that reading a damaged record may raise."""


class InputError(ValueError):
    """Something the caller gave cannot be used.

    The message is one line of bounded length, whatever was given.

    Parameters
    ----------
    where : str
        What was given: a key's path in a scene, an argument, a file.
    found : str
        What was found there.
    accepted : str
        What would be accepted instead.
    """

    def __init__(self, where: str, found: str, accepted: str) -> None:
        self.where, self.found, self.accepted = map(printable, (where, found, accepted))
        super().__init__(_message(self.where, self.found, self.accepted))

    def within(self, prefix: str) -> InputError:
        """Return the same error, its place seen from one level further out."""
        return InputError(f"{prefix}.{self.where}", self.found, self.accepted)


class NotInstalledError(InputError):
    """What was given needs a package that is not installed."""


class NotWrittenError(InputError):
    """Some files of a folder could not be written; the others were.

    `failed` says why, by name.
    """

    def __init__(self, folder: str, written: Sequence[str], failed: Mapping[str, str]) -> None:
        self.written, self.failed = list(written), dict(failed)
        reasons = ", ".join(dict.fromkeys(self.failed.values()))
        found = f"not written ({reasons}): {_name_list(list(self.failed))}"
        found += f"; written: {_name_list(self.written)}"
        super().__init__(folder, found, "free disk space or remove the cause, and run it again")


def _name_list(names: Sequence[str], most: int = 6) -> str:
    """Names in a row, the later ones counted."""
    text = ", ".join(names[:most]) or "nothing"
    return text + (f" and {len(names) - most} more" if len(names) > most else "")


def short_repr(value: Any, longest: int = 60) -> str:
    """Return a value as Python writes it, shortened, whatever it is."""
    try:
        return shorten(repr(value), longest)
    except (ValueError, RecursionError):  # whole numbers of thousands of digits, deep nesting
        return f"a {type(value).__name__} too long to show"


def count_text(count: int, thing: str, things: str = "") -> str:
    """Return a number of things in words: ``1 motion``, ``2 motions``."""
    return f"{count} {thing if count == 1 else things or f'{thing}s'}"


def shorten(text: str, longest: int = 60) -> str:
    """Return a text with its middle left out where it is too long."""
    if len(text) <= longest:
        return text
    ahead = (longest - 3) * 2 // 3
    return f"{text[:ahead]}...{text[len(text) - (longest - 3 - ahead) :]}"


def each_once(values: Iterable[Any], where: str) -> list[Any]:
    """Return a list without the values that it repeats, which a logged warning names."""
    given = list(values)
    kept = list(dict.fromkeys(given))
    if len(kept) < len(given):
        import logging

        again = ", ".join(short_repr(str(v)) for v in kept if given.count(v) > 1)
        text = f"{where}: {shorten(again)} more than once; each value is used once"
        logging.getLogger(__package__).warning(text)
    return kept


def require_known(
    value: Any, known: Iterable[Any], where: str, found: str | None = None, more: str = ""
) -> None:
    """Raise `InputError` for what is none of some names; what was found may be said otherwise, and
    more of what would do."""
    names = list(known)
    if value not in names:
        accepted = f"accepted are {', '.join(names)}{more}"
        raise InputError(where, found or f"found {short_repr(value)}", accepted)


def require_whole(value: Any, where: str, least: int = 1, most: int | None = None) -> None:
    """Raise `InputError` for what is no whole number, or too small or too large a one."""
    whole = isinstance(value, Integral) and not isinstance(value, bool)
    if not whole or value < least or (most is not None and value > most):
        limits = f">= {least}" if most is None else f"from {least} to {most}"
        raise InputError(where, f"found {short_repr(value)}", f"give a whole number {limits}")


def random_generator(rng: Any, where: str = "rng") -> np.random.Generator:
    """Return NumPy's generator with a seed, or the one given; raise `InputError` for neither."""
    import numpy as np

    try:
        return np.random.default_rng(rng)
    except (TypeError, ValueError):
        accepted = "give a seed, which is a whole number >= 0, or a numpy.random.Generator"
        raise InputError(where, f"found {short_repr(rng)}", accepted) from None


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return a hint at the known name that is spelled most like another; empty if there is none."""
    import difflib

    names = {k[:100].lower(): k for k in reversed([*known])}
    near = difflib.get_close_matches(name[:100].lower(), names, 1)
    return f" (did you mean {names[near[0]]!r}?)" if near else ""


def explain_arguments(function: Call) -> Call:
    """Return a function, or a class, that answers arguments it does not take with those it does,
    and what cannot be used instead of an argument with what it takes there."""
    if isinstance(function, type):
        for name, member in list(vars(function).items()):
            if callable(member) and (name == "__init__" or name[0].islower()):
                setattr(function, name, explain_arguments(member))
        return function

    @functools.wraps(function)
    def explained(*given: Any, **named: Any) -> Any:
        try:
            return function(*given, **named)
        except TypeError as error:
            if error.__traceback__ is None or error.__traceback__.tb_next is not None:
                raise  # from within
            raise TypeError(_arguments_text(function, named, error)) from None
        except AttributeError as error:
            owner = getattr(error, "owner", error.obj)
            raise _unusable_argument(function, given, named, owner) or error from None

    return explained  # type: ignore[return-value]


def _arguments_text(function: Callable[..., Any], named: Iterable[str], error: TypeError) -> str:
    """What is wrong with a call, and what would do."""
    import inspect

    known = [name for name in inspect.signature(function).parameters if name != "self"]
    shown = function.__qualname__.removesuffix(".__init__")
    unknown = next((name for name in named if name not in known), None)
    found = str(error).replace(".__init__()", "()")
    if unknown is not None:
        other = next((name for name in guessed_names(unknown) if name in known), None)
        hint = f" (did you mean {other!r}?)" if other else did_you_mean(unknown, known)
        found = f"{shown}() has no argument {unknown!r}{hint}"
    return f"{found}; it takes {', '.join(known) or 'none'}"


def _unusable_argument(
    function: Callable[..., Any], given: Sequence[Any], named: Mapping[str, Any], owner: Any
) -> InputError | None:
    """The error for an argument of another type than declared, if it is what lacks something."""
    import inspect
    import re

    signature = inspect.signature(function)
    for name, value in signature.bind(*given, **named).arguments.items():
        declared = str(signature.parameters[name].annotation)
        types = {kind.__name__ for kind in type(value).__mro__[:-1]} | {"Any"}
        types |= {"None"} if value is None else set()
        if value is owner and not types & {*re.findall(r"\w+", declared)}:
            return InputError(name, f"found {short_repr(value)}", f"give {declared}")
    return None


GUESSED = {
    "seed": "rng",
    "limits": "range",
    "ds": "step settings",
    "dsmin": "min_step settings",
    "dsmax": "max_step settings",
    "max_step": "settings",
    "max_steps": "max_points settings",
    "tol": "tolerance settings",
    "detect": "events",
    "n": "starts",
    "p_min": "range",
    "p_max": "range",
    "run": "follow",
    "follow": "continue_orbit",
    "continue_": "continue_orbit",
    "continue_branch": "continue_orbit",
    "with_": "replace",
    "walls": "letters",
    "df": "to_dataframe",
    "start": "ends",
    "end": "ends",
    "stable": "reading",
    "simulate": "sweep",
    "switch": "continue_born",
    "find": "find_orbits",
    "to_csv": "save",
    "set": "replace",
    "copy": "replace",
    "System": "Model",
    "Event": "Entry",
    "check": "check_model",
    "bifurcation_diagram": "follow",
    "continuation": "continue_orbit",
    "lyapunov": "exponents settle",
    "with_parameters": "replace",
    "update": "replace",
    "keys": "parameters",
    "units": "unit",
    "describe": "statement",
    "orbits": "orbit find_orbits",
    "param": "parameter",
    "at": "orbit",
    "bifurcations": "events",
    "special_points": "events",
    "specialpoint": "events",
    "points": "columns",
    "point": "orbit",
    "floquet": "multipliers",
    "eigenvalues": "multipliers",
    "impacts": "velocities",
    "transitions": "reading",
    "to_dict": "as_row as_record",
    "info": "summary",
    "fly": "run",
}
"""What is called otherwise here: names by what is guessed, the likeliest first."""


def guessed_names(name: str) -> list[str]:
    """Return what may be meant by a name: its other names here, or the name itself."""
    return GUESSED.get(name, name).split()


def missing(one: Any, name: str) -> AttributeError:
    """Return the error for an attribute that something does not have, with what gives it instead:
    an item, a function of the package, or what is spelled alike."""
    public = sys.modules[__package__].__all__
    kind, others = type(one).__name__, guessed_names(name)
    own = getattr(type(one), "__dataclass_fields__", {})
    if name.startswith("_") or name in own:  # as while it is unpickled
        return AttributeError(f"{kind!r} object has no attribute {name!r}")
    here = next((other for other in others if hasattr(type(one), other) or other in own), None)
    other = next((other for other in others if other in public), None)
    if here:
        hint = f"; there is {here!r}"
    elif _has(one, name):
        hint = f"; it is the item [{name!r}]"
    elif other:
        hint = f"; call contimpact.{other}({kind.lower()}, ...)"
    else:
        hint = did_you_mean(name, (known for known in dir(type(one)) if known[0].islower()))
    error = AttributeError(f"{kind!r} object has no attribute {name!r}{hint}", name=name, obj=None)
    error.owner = one  # type: ignore[attr-defined]
    return error


def _has(one: Any, name: str) -> bool:
    """Whether something has an item of a name."""
    try:
        one[name]
    except (LookupError, TypeError, ValueError):
        return False
    return True


def printable(text: str) -> str:
    """Return a text with line breaks and control characters written as escapes."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def _message(*parts: str) -> str:
    where, found, accepted = parts
    if sum(map(len, parts)) > LONGEST_MESSAGE:
        where, found, accepted = (shorten(part, LONGEST_MESSAGE // 3) for part in parts)
    return f"{where}: {found}; {accepted}"
