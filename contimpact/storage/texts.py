"""Plain data and their texts: JSON and CSV, written, and read with their mistakes named.

Names and messages may come from files of others. They reach a reader as text: no control character
comes to a terminal, no cell is a formula in a spreadsheet, no HTML and no further row stands in a
table. What is read back is read back the same.
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeAlias

from ..errors import printable

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
    text = json.dumps(finite(content), indent=1, allow_nan=False, ensure_ascii=False)
    text = _NUMBERS.sub(lambda found: " ".join(found[0].split()), text)
    return f"{_visible(text)}\n"


def json_line(content: Json) -> str:
    """Return JSON in one line; numbers that are not finite are texts."""
    return _visible(json.dumps(finite(content, repr), allow_nan=False, ensure_ascii=False))


def _visible(text: str) -> str:
    """JSON with the characters that are not seen as escapes, which read back to the same."""
    return _INVISIBLE.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def finite(value: Any, instead: Callable[[float], Any] = lambda value: None) -> Any:
    """Plain data with every number that is not finite replaced."""
    if isinstance(value, float):
        return value if math.isfinite(value) else instead(value)
    if isinstance(value, Mapping):
        return {name: finite(v, instead) for name, v in value.items()}
    if isinstance(value, list | tuple):
        return [finite(v, instead) for v in value]
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
