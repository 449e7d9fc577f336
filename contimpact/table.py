"""One table of a scene: keys handed out by type, every mistake named with the path of its key."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from .errors import InputError, shown
from .expressions import number


def _nearest(key: str, known: Sequence[str]) -> str | None:
    """The known key that is spelled most like another, if one is."""
    import difflib

    return next(iter(difflib.get_close_matches(key, known, 1)), None)


_REQUIRED: Any = object()


class Table:
    """One table of a scene: hands out its keys by type, and refuses those nobody asked for."""

    def __init__(self, data: Mapping[str, Any], path: str) -> None:
        self.data, self.path = data, path
        self.asked: list[str] = []

    def place(self, key: str) -> str:
        return f"{self.path}.{key}" if self.path else key

    def take(self, key: str, default: Any, wanted: str) -> Any:
        self.asked.append(key)
        if key in self.data:
            return self.data[key]
        if default is _REQUIRED:
            if near := _nearest(key, [k for k in self.data if k not in self.asked]):
                raise InputError(
                    self.place(near), f"unknown key (did you mean {key!r}?)",
                    f"{self.place(key)} is missing: give {wanted}",
                )  # fmt: skip
            raise InputError(self.place(key), "missing", f"give {wanted}")
        return default

    def refuse(self, key: str, found: Any, wanted: str) -> InputError:
        return InputError(self.place(key), f"found {shown(found)}", f"give {wanted}")

    def text(self, key: str, default: Any = _REQUIRED) -> str:
        value = self.take(key, default, "a text")
        if not isinstance(value, str):
            raise self.refuse(key, value, "a text in quotes")
        return value

    def texts(self, key: str, default: Any = _REQUIRED) -> list[str]:
        value = self.take(key, default, "a list of texts")
        if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
            raise self.refuse(key, value, "a list of texts in quotes")
        return list(value)

    def number(self, key: str, default: Any = _REQUIRED) -> float:
        value = self.take(key, default, "a number, or an expression in quotes")
        return self.as_number(value, key)

    def as_number(self, value: Any, key: str) -> float:
        if isinstance(value, str):
            return number(value, self.place(key))
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.refuse(key, value, "a number, or an expression in quotes")
        try:
            value = float(value)
        except OverflowError:
            value = math.inf
        if not math.isfinite(value):
            raise self.refuse(key, value, "a finite number")
        return value

    def numbers(self, key: str) -> list[float]:
        value = self.take(key, _REQUIRED, "a list of numbers")
        if not isinstance(value, list):
            raise self.refuse(key, value, "a list of numbers")
        return [self.as_number(v, f"{key}[{i}]") for i, v in enumerate(value)]

    def pair(self, key: str) -> tuple[float, float]:
        wanted = "two numbers, the lower one first"
        if key not in self.data:
            self.take(key, _REQUIRED, wanted)
        values = self.numbers(key)
        if len(values) != 2 or not values[0] < values[1]:
            raise self.refuse(key, self.data[key], wanted)
        return values[0], values[1]

    def truth(self, key: str, default: bool) -> bool:
        value = self.take(key, default, "true or false")
        if not isinstance(value, bool):
            raise self.refuse(key, value, "true or false")
        return value

    def whole(self, key: str, default: Any = _REQUIRED, least: int = 1) -> int:
        value = self.take(key, default, "a whole number")
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            raise self.refuse(key, value, f"a whole number >= {least}")
        return value

    def table(self, key: str, optional: bool = False) -> Table:
        value = self.take(key, {} if optional else _REQUIRED, f"a table [{self.place(key)}]")
        if not isinstance(value, dict):
            raise self.refuse(key, value, f"a table [{self.place(key)}]")
        return Table(value, self.place(key))

    def finish(self) -> None:
        for key in self.data:
            if key not in self.asked:
                near = _nearest(key, self.asked)
                hint = f" (did you mean {near!r}?)" if near else ""
                raise InputError(
                    self.place(key), f"unknown key{hint}", f"accepted are {', '.join(self.asked)}"
                )
