"""Plain data, as JSON has it, made into dataclasses whose annotations it has to fit."""

from __future__ import annotations

import dataclasses
import enum
import types
import typing
from collections.abc import Collection, Mapping, Sequence
from functools import cache
from typing import Any, TypeVar

from ..errors import shown

T = TypeVar("T")

NOT_FINITE = ("inf", "-inf", "nan")
LARGEST = 2**63 - 1
DAMAGE = (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError)
"""What reading a damaged record may raise."""


def made(kind: type[T], record: Any, needed: Collection[str] | None = None) -> T:
    """Return a dataclass made of a record.

    Keys that it does not have are passed over.

    Parameters
    ----------
    kind : type
        Its annotations may be texts, numbers, booleans, enumerations (by name), sequences, tuples,
        mappings, other dataclasses, None besides any of these, and Any.
    record : mapping
    needed : collection of str, optional
        The required keys; others are None if they are missing. By default all keys without a
        default value are required.

    Raises
    ------
    ValueError
        If a key is missing or its value does not fit.
    """
    if not isinstance(record, Mapping):
        raise ValueError(f"found {shown(record)} in place of a record")
    values = {}
    hints = _fields(typing.cast(Any, kind))
    for field, hint in hints:
        value = record.get(field.name)
        if value is not None:
            values[field.name] = fitted(value, hint, field.name)
        elif _lacking(field, hint, field.name in record, needed):
            raise ValueError(f"a record without {field.name}")
        elif field.name in record or not _has_default(field):
            values[field.name] = None
    return kind(**values)


@cache
def _fields(kind: type[Any]) -> list[tuple[dataclasses.Field[Any], Any]]:
    hints = typing.get_type_hints(kind)
    return [(field, hints[field.name]) for field in dataclasses.fields(kind)]


def _has_default(field: dataclasses.Field[Any]) -> bool:
    missing = dataclasses.MISSING
    return field.default is not missing or field.default_factory is not missing


def _lacking(
    field: dataclasses.Field[Any], hint: Any, given: bool, needed: Collection[str] | None
) -> bool:
    """Whether None, or nothing, cannot stand for a field."""
    if needed is not None:
        return field.name in needed
    return not (_optional(hint) if given else _has_default(field))


def _optional(hint: Any) -> bool:
    return hint is Any or types.NoneType in typing.get_args(hint)


def fitted(value: Any, hint: Any, name: str) -> Any:
    """Return a value as an annotation has it, or raise `ValueError` naming where it stands."""
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if hint is Any or _made_already(value):
        return value
    if origin in (types.UnionType, typing.Union):
        return _one_of(value, inner, name)
    if hint in _PLAIN and (plain := _PLAIN[hint](value)) is not None:
        return plain
    if origin is tuple and isinstance(value, list | tuple) and inner[1:] == (Ellipsis,):
        return tuple(fitted(v, inner[0], name) for v in value)
    if origin is tuple and isinstance(value, list | tuple) and len(value) == len(inner):
        return tuple(fitted(v, h, name) for v, h in zip(value, inner, strict=True))
    if origin is Sequence and isinstance(value, list | tuple):
        return [fitted(v, inner[0], name) for v in value]
    if origin is Mapping and isinstance(value, Mapping):
        return {str(key): fitted(v, inner[1], f"{name}.{key}") for key, v in value.items()}
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return made(hint, value)
    if isinstance(hint, enum.EnumMeta) and value in hint.__members__:
        return hint[value]
    raise ValueError(f"{name} is {shown(value)}")


def _made_already(value: Any) -> bool:
    """Whether a value is no plain data: somebody else has made, and checked, it."""
    return dataclasses.is_dataclass(value) or hasattr(value, "dtype")


def _one_of(value: Any, hints: Sequence[Any], name: str) -> Any:
    if value is None and types.NoneType in hints:
        return None
    for hint in hints:
        try:
            return fitted(value, hint, name)
        except ValueError:
            continue
    raise ValueError(f"{name} is {shown(value)}")


def _number(value: Any) -> float | None:
    """A number; what is not finite may be written as a text."""
    if isinstance(value, str):
        return float(value) if value in NOT_FINITE else None
    plain = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if plain else None


def _whole(value: Any) -> int | None:
    plain = isinstance(value, int) and not isinstance(value, bool)
    return value if plain and abs(value) <= LARGEST else None


_PLAIN: dict[Any, Any] = {
    str: lambda value: value if isinstance(value, str) else None,
    bool: lambda value: value if isinstance(value, bool) else None,
    int: _whole,
    float: _number,
    complex: lambda value: value if isinstance(value, complex) else None,
}
