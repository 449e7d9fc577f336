"""The documentation's tables of keys, from where the keys are declared: python tools/key_tables.py.

Pages have them below a comment ``<!-- keys of CLASS TABLE -->``; the table is left out where the
keys are in the class's own. Those of records are below ``<!-- record of CLASS -->``.
"""

from __future__ import annotations

import dataclasses
import re
import types
import typing
from collections.abc import Mapping, Sequence
from pathlib import Path

from contimpact.results.branch import Entry
from contimpact.results.options import (
    CertifyOptions,
    CurveOptions,
    DesignOptions,
    MarginOptions,
    PlotOptions,
    SimulateOptions,
)
from contimpact.results.scene import Scene
from contimpact.schema import REQUIRED, Key, keys_of
from contimpact.studies.study_file import StudyFile
from contimpact.systems.membrane import Membrane

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGES = ("catalogue", "scene", "curves", "simulate", "certificates", "studies", "design")
KINDS = {
    kind.__name__: kind
    for kind in (
        Scene,
        PlotOptions,
        CurveOptions,
        SimulateOptions,
        CertifyOptions,
        DesignOptions,
        MarginOptions,
        Membrane,
        StudyFile,
    )
}
RECORDS = {kind.__name__: kind for kind in (Entry,)}
MARK = re.compile(r"(<!-- (?:keys|record) of (\w+) ?(\w*) -->\n\n)(?:\|.*\n)*")
HEAD = "| key | type | default | meaning |\n|---|---|---|---|\n"
POWERS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


def table(kind: type, name: str) -> str:
    """Return the table of the keys that a class declares in a table."""
    rows = []
    for field, hint, rule in keys_of(kind):
        if rule.table != name:
            continue
        for inner, own_hint, own in keys_of(hint) if rule.inline else ():
            if inner.name in rule.inline:
                base = None if field.default is REQUIRED else field.default
                value = getattr(base, inner.name, inner.default)
                changed = dataclasses.replace(own, **rule.inline[inner.name])
                rows.append(row(own.name or inner.name, own_hint, changed, value))
        if rule.doc and not rule.inline:
            rows.append(row(rule.name or field.name, hint, rule, field.default))
    return HEAD + "".join(rows)


def row(name: str, hint: object, rule: Key, default: object) -> str:
    """Return a row of a table."""
    cells = (f"`{name}`", type_of(hint, rule), rule.shown or shown(default), rule.doc)
    return "".join(f"| {cell} ".replace("|  ", "| ") for cell in cells) + "|\n"


def record_table(kind: type) -> str:
    """Return the table of the keys of a class's records."""
    keys = ((rule.name or field.name, hint, rule) for field, hint, rule in keys_of(kind))
    rows = (f"| `{name}` | {record_type(hint, rule)} | {rule.doc} |\n" for name, hint, rule in keys)
    return "| key | type | meaning |\n|---|---|---|\n" + "".join(rows)


def record_type(hint: object, rule: Key) -> str:
    """Return the type of a record's key in words; what is silent is never null."""
    kind, inner = typing.get_origin(hint), typing.get_args(hint)
    if kind is types.UnionType:
        return record_type(inner[0], rule) + " or null" * (not rule.silent)
    plain_types = {str: "text", bool: "boolean", int: "whole", float: "number"}
    if kind is Sequence:
        return f"list of {plain_types[inner[0]]}s" if inner[0] in plain_types else "list"
    return plain_types.get(hint, "object")


class Named:
    """What was read before, in words: the keys' names."""

    def __getattr__(self, name: str) -> str:
        return f"`{name}`"


def type_of(hint: object, rule: Key) -> str:
    """Return a key's type and bounds in words."""
    kind, inner = typing.get_origin(hint), typing.get_args(hint)
    if kind is types.UnionType and types.NoneType in inner:
        return type_of(inner[0], rule)
    if kind is types.UnionType:
        return rule.accepted
    if hint is int:
        least = 1 if rule.least is None else rule.least
        least = least(Named()) if callable(least) else whole(least)
        return f"whole, {least} to {whole(rule.most)}"
    if hint is float:
        above = "" if rule.above is None else f" > {rule.above}"
        most = "" if rule.most is None else f", at most {plain(rule.most)}"
        return f"number{above}{most}"
    if kind is tuple and inner[1:] != (Ellipsis,):
        return "two numbers"
    if kind is tuple:
        return f"list of {'texts' if inner[0] is str else 'numbers'}"
    return {str: "text", bool: "true or false"}.get(hint, "table")


def whole(number: int) -> str:
    """Return a whole number as a reader sees it best."""
    power = len(str(number)) - 1
    if number == 10**power and power > 6:
        return f"10{str(power).translate(POWERS)}"
    if number == 2**63 - 1:
        return "2⁶³ - 1"
    return f"{number:,}".replace(",", " ") if number >= 10_000 else str(number)


def plain(number: float) -> str:
    """Return a number as a file has it."""
    if number >= 1e6:
        return whole(int(number))
    return re.sub("e-0", "e-", f"{number:.6g}")


def shown(default: object) -> str:
    """Return a default as a file has it."""
    if default is REQUIRED or default is None or isinstance(default, Mapping):
        return ""
    if isinstance(default, bool):
        return str(default).lower()
    if isinstance(default, str):
        return f'`"{default}"`'
    if isinstance(default, tuple):
        inside = ", ".join(f'"{item}"' for item in default)
        return f"`[{inside}]`"
    return plain(default)


def page(text: str) -> str:
    """Return a page with its tables as the keys are declared."""

    def made(mark: re.Match[str]) -> str:
        named, kind = mark[2], mark[3]
        return mark[1] + (
            record_table(RECORDS[named]) if named in RECORDS else table(KINDS[named], kind)
        )

    return MARK.sub(made, text)


if __name__ == "__main__":
    for name in PAGES:
        path = DOCS / f"{name}.md"
        path.write_text(page(path.read_text("utf-8")), "utf-8")
