"""The documentation's tables of keys, from where the keys are declared: python tools/key_tables.py.

Pages have them below a comment ``<!-- keys of CLASS TABLE -->``; the table is left out where the
keys are in the class's own.
"""

from __future__ import annotations

import dataclasses
import re
import types
import typing
from collections.abc import Mapping
from pathlib import Path

from contimpact.results.design_table import DesignOptions, MarginOptions
from contimpact.results.options import CertifyOptions, CurveOptions, PlotOptions
from contimpact.results.scene import Scene
from contimpact.results.simulate_tables import SimulateOptions
from contimpact.schema import REQUIRED, Key, keys_of
from contimpact.studies.study_file import StudyFile
from contimpact.systems.membrane import Membrane

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGES = ("scene", "curves", "simulate", "certificates", "studies", "design")
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
MARK = re.compile(r"(<!-- keys of (\w+) ?(\w*) -->\n\n)(?:\|.*\n)*")
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
    return MARK.sub(lambda mark: mark[1] + table(KINDS[mark[2]], mark[3]), text)


if __name__ == "__main__":
    for name in PAGES:
        path = DOCS / f"{name}.md"
        path.write_text(page(path.read_text("utf-8")), "utf-8")
