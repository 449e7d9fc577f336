"""Plain data and their texts: JSON and CSV, written, and read with their mistakes named.

Names and messages may come from files of others. They reach a reader as text: no control character
comes to a terminal, no cell is a formula in a spreadsheet, no HTML and no further row stands in a
table. What is read back is read back the same.
"""

from __future__ import annotations

import csv
import dataclasses
import enum
import io
import json
import math
import re
import sys
import types
import typing
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import cache
from typing import Any, TypeAlias, TypeVar

from ..errors import printable, short_repr

_INVISIBLE = re.compile(
    "[\x7f-\x9f\xad\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb\ud800-\udfff]"
)
"""Characters that change how a text is shown, and halves of characters."""
_NUMBERS = re.compile(r"(?<=\[)\n *-?\d[^][{}\"tfn]*(?=\])")
"""List of numbers alone that is printed over several lines."""
_FORMULA = tuple("=+-@\t\r'")
"""How cells begin that a spreadsheet takes for formulas; and ``'``, the mark that they are none."""


def terminal_text(text: str, encoding: str | None = None) -> str:
    """Return lines of text as a terminal of an encoding can show them, all else as escapes."""
    lines, code = "\n".join(map(printable, text.split("\n"))), encoding or "utf-8"
    return lines.encode(code, "backslashreplace").decode(code)


# JSON.

Json: TypeAlias = bool | int | float | str | Sequence["Json"] | Mapping[str, "Json"] | None
"""Plain data as JSON holds them."""


def json_text(content: Json) -> str:
    """Return readable JSON with no number that is not finite; lists of numbers are in one line."""
    text = json.dumps(_finite(content), indent=1, allow_nan=False, ensure_ascii=False)
    text = _NUMBERS.sub(lambda found: " ".join(found[0].split()), text)
    return f"{_visible(text)}\n"


def json_line(content: Json) -> str:
    """Return JSON in one line; numbers that are not finite are texts."""
    return _visible(json.dumps(_finite(content, repr), allow_nan=False, ensure_ascii=False))


def _visible(text: str) -> str:
    """JSON with the characters that are not seen as escapes, which read back to the same."""
    return _INVISIBLE.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def _finite(value: Any, instead: Callable[[float], Any] = lambda value: None) -> Any:
    """Plain data with every number that is not finite replaced."""
    if isinstance(value, float):
        return value if math.isfinite(value) else instead(value)
    if isinstance(value, Mapping):
        return {name: _finite(v, instead) for name, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v, instead) for v in value]
    return value


# CSV.


def csv_text(columns: Sequence[str], rows: Iterable[Iterable[Any]], *, exact: bool = False) -> str:
    """Return a table as CSV; numbers read back to the same bits, None is an empty cell.

    A text that would be a formula in a spreadsheet has ``'`` before it. Where it is `exact`,
    `unescape_text` gives texts back as they are; control characters are escapes otherwise.
    """
    shown = _escape_text if exact else printable
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(_cell(name, shown) for name in columns)
    writer.writerows([_cell(value, shown) for value in row] for row in rows)
    return buffer.getvalue()


def _cell(value: Any, shown: Callable[[str], str]) -> Any:
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, str) and value:
        text = shown(value)
        return f"'{text}" if text.startswith(_FORMULA) else text
    return value


def _escape_text(text: str) -> str:
    """A text as it is; halves of characters and \\r, which no table gives back, as escapes."""
    return text.encode(errors="backslashreplace").decode().replace("\r", "\\r")


def unescape_text(cell: str) -> str:
    """Return the text that an exact `csv_text` has written as a cell."""
    return cell.removeprefix("'")


# Markdown.

_MARKS = str.maketrans(
    {"\\": "\\\\", "|": r"\|", "~": r"\~", "`": r"\`", "<": "&lt;", "&": "&amp;"}
)
_LINK = re.compile(r"\](?=[(\[])")


def markdown_cell(value: Any) -> str:
    """Return a value as a cell of a Markdown table, numbers to 12 digits."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.12g}"
    return _LINK.sub(r"]\\", printable(str(value)).translate(_MARKS))


# Plain data, as JSON has it, made into dataclasses whose annotations it has to fit.

T = TypeVar("T")

NOT_FINITE = ("inf", "-inf", "nan")
LARGEST = 2**63 - 1
DAMAGE = (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError)
"""Exceptions that reading a damaged record may raise."""


def build_record(kind: type[T], record: Any, needed: Collection[str] | None = None) -> T:
    """Return a dataclass made of a record; keys that it does not have are passed over.

    Its annotations may be texts, numbers, booleans, enumerations (by name), sequences, tuples,
    mappings, other dataclasses, None besides any of these, and Any. Keys that are `needed` are
    required, by default all without a default value; others are None if they are missing.

    Raises ValueError if a key is missing or its value does not fit.
    """
    if not isinstance(record, Mapping):
        raise ValueError(f"found {short_repr(record)} in place of a record")
    values = {}
    hints = _fields(typing.cast(Any, kind))
    for field, hint in hints:
        value = record.get(field.name)
        if value is not None:
            values[field.name] = fit_value(value, hint, field.name)
        elif _needs_value(field, hint, field.name in record, needed):
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


def _needs_value(
    field: dataclasses.Field[Any], hint: Any, given: bool, needed: Collection[str] | None
) -> bool:
    """Whether None, or nothing, cannot stand for a field."""
    if needed is not None:
        return field.name in needed
    return not (_is_optional(hint) if given else _has_default(field))


def _is_optional(hint: Any) -> bool:
    return hint is Any or types.NoneType in typing.get_args(hint)


def fit_value(value: Any, hint: Any, name: str) -> Any:
    """Return a value as an annotation has it, or raise `ValueError` naming where it stands."""
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if hint is Any or _made_already(value):
        return value
    if origin in (types.UnionType, typing.Union):
        return _fit_union(value, inner, name)
    if hint in _PLAIN and (plain := _PLAIN[hint](value)) is not None:
        return plain
    if origin is tuple and isinstance(value, list | tuple) and inner[1:] == (Ellipsis,):
        return tuple(fit_value(v, inner[0], name) for v in value)
    if origin is tuple and isinstance(value, list | tuple) and len(value) == len(inner):
        return tuple(fit_value(v, h, name) for v, h in zip(value, inner, strict=True))
    if origin is Sequence and isinstance(value, list | tuple):
        return [fit_value(v, inner[0], name) for v in value]
    if origin is Mapping and isinstance(value, Mapping):
        return {str(key): fit_value(v, inner[1], f"{name}.{key}") for key, v in value.items()}
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return build_record(hint, value)
    if isinstance(hint, enum.EnumMeta) and value in hint.__members__:
        return hint[value]
    raise ValueError(f"{name} is {short_repr(value)}")


def _made_already(value: Any) -> bool:
    """Whether a value is no plain data: somebody else has made, and checked, it."""
    return dataclasses.is_dataclass(value) or hasattr(value, "dtype")


def _fit_union(value: Any, hints: Sequence[Any], name: str) -> Any:
    if value is None and types.NoneType in hints:
        return None
    for hint in hints:
        try:
            return fit_value(value, hint, name)
        except ValueError:
            continue
    raise ValueError(f"{name} is {short_repr(value)}")


def _number(value: Any) -> float | None:
    """A number; what is not finite may be written as a text."""
    if isinstance(value, str):
        return float(value) if value in NOT_FINITE else None
    whole = type(value) is int and abs(value) <= sys.float_info.max
    return float(value) if whole or isinstance(value, float) else None


def _whole_number(value: Any) -> int | None:
    plain = isinstance(value, int) and not isinstance(value, bool)
    return value if plain and abs(value) <= LARGEST else None


_PLAIN: dict[Any, Any] = {
    str: lambda value: value if isinstance(value, str) else None,
    bool: lambda value: value if isinstance(value, bool) else None,
    int: _whole_number,
    float: _number,
    complex: lambda value: value if isinstance(value, complex) else None,
}
