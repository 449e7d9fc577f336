"""Numbers and texts as a page embeds them: compact, exact, and nothing but data."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import printable

TYPES = {"f8": "<f8", "f4": "<f4", "u4": "<u4", "u1": "u1"}
"""Types of packed numbers, as the script knows them and as NumPy does."""


def packed(values: Array, kind: str = "f8") -> str | float:
    """Return a column as one number where it is constant and finite, else as base64.

    The text is the kind of `TYPES` and the bytes, as ``f8:AAAAAAAA8D8=``, all rows in order.
    """
    array = np.ascontiguousarray(values, dtype=TYPES[kind])
    flat = array.ravel()
    if len(flat) and np.all(flat == flat[0]) and math.isfinite(flat[0]):
        return float(flat[0])
    return f"{kind}:{base64.b64encode(array.tobytes()).decode()}"


def plain(value: Any) -> Any:
    """Return plain data whose texts are printable, with None for numbers that are not finite."""
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {printable(str(name)): plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    return value


def script_json(value: Any) -> str:
    """Return JSON that can stand in a script element: no character of it begins markup."""
    text = json.dumps(plain(value), allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
