"""What is wrong with a text that is not TOML, by its keys."""

from __future__ import annotations

import re

from ..errors import shown

TWICE = re.compile(r"Cannot (overwrite|declare|mutate)|Duplicate")
LINE = re.compile(r"\(at line (\d+)")
HEADER = re.compile(r"\s*\[+([^\[\]]*)\]+\s*(#.*)?$")
STATEMENT = re.compile(r"\s*([\w.\"'-]+)\s*=\s*(.*)$")
COMMA = re.compile(r"[-+]?\d+,\d+\s*(#.*)?$")
WITHOUT_QUOTES = re.compile(r"[-+(]*\d*[.)*/]*[A-Za-z_][^\"'\[{]*$")
LONGEST = 300
"""Of what is looked at in a line."""


def explained(text: str, error: str) -> tuple[str, str]:
    """Return what was found in a text that is not TOML, and what would be accepted.

    Parameters
    ----------
    text : str
    error : str
        What the reader of TOML says.
    """
    lines = [line[:LONGEST] for line in text.split("\n")]
    at = LINE.search(error)
    last = max((i for i, line in enumerate(lines) if line.strip()), default=0)
    number = min(int(at[1]) - 1, last) if at else last
    line = lines[number]
    key, value = _key(lines, number), ""
    if statement := STATEMENT.match(line):
        value = statement[2].strip()
    said = f"line {number + 1}: {shown(line.strip())}"
    if TWICE.search(error) and key:
        return f"not TOML: {shown(key)} is there twice; {said}", "give each key and table once"
    if COMMA.match(value):
        return f"not TOML: {said}", "write decimals with a point, lists in [ ]"
    if WITHOUT_QUOTES.match(value):
        return f"not TOML: {said}", f'put expressions and texts in quotes: {key} = "..."'
    inside = f" at {key}" if key else ""
    accepted = "give lines such as range = [0.1, 1.0] in tables such as [follow]"
    return f"not TOML{inside}: {error}", accepted


def _key(lines: list[str], number: int) -> str:
    """The path of the key in a line, or of the table that it begins."""
    table = ""
    for line in lines[: number + 1]:
        if header := HEADER.match(line):
            table = header[1].strip()
    statement = STATEMENT.match(lines[number])
    if HEADER.match(lines[number]) or statement is None:
        return table
    return f"{table}.{statement[1]}" if table else statement[1]
