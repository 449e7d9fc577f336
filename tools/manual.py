"""The manual of the commands, made of their parser: python tools/manual.py > docs/cli.md."""

from __future__ import annotations

import argparse
from collections import Counter

from contimpact.cli import commands_of, parser

HEAD = """\
# Commands

<!-- made by python tools/manual.py; a test compares -->

`contimpact COMMAND ...` and `python -m contimpact COMMAND ...` are the same. `contimpact --help`
lists the commands, `contimpact COMMAND --help` the options of one, and `contimpact --version`
prints the version.

The exit status is 0 on success; 2 where the input cannot be used, with one message on standard
error; 1 where a computation was interrupted or failed, or a file could not be written. What was
computed until then is written. Of several scenes, the highest status counts.

Several commands have these options:

"""

SHARED_BY = 3
"""Commands from which on an option is described once for all."""


def manual() -> str:
    """Return the page."""
    whole = parser()
    (action,) = (a for a in whole._actions if isinstance(a, argparse._SubParsersAction))
    helps = {choice.dest: choice.help for choice in action._choices_actions}
    commands = commands_of(whole)
    rows = {
        name: [_row(a) for a in one._actions if a.dest != "help"] for name, one in commands.items()
    }
    count = Counter(row for described in rows.values() for row in described)
    shared = [row for row, times in count.items() if times >= SHARED_BY]
    pages = [HEAD + "\n".join(shared) + "\n"]
    for name, one in commands.items():
        own = [row for row in rows[name] if row not in shared]
        pages.append(_page(name, helps[name] or "", one, own))
    return "\n".join(pages)


def _page(name: str, help: str, command: argparse.ArgumentParser, rows: list[str]) -> str:
    usage = " ".join(["contimpact", name, *map(_usage, command._actions)])
    lines = [f"## {name}", "", f"{help[:1].upper()}{help[1:]}.", "", f"```text\n{usage}\n```", ""]
    example = (command.epilog or "").removeprefix("example:\n  ")
    lines += [*rows, "", f"```sh\n{example}\n```", ""]
    return "\n".join(lines)


def _usage(action: argparse.Action) -> str:
    if action.dest == "help":
        return "[-h]"
    text = " ".join([*action.option_strings[:1], *_values(action)])
    if action.option_strings:
        return text if action.required else f"[{text}]"
    return f"{text}..." if action.nargs == "+" else text


def _values(action: argparse.Action) -> list[str]:
    """The names of an argument's values."""
    if action.nargs == 0:
        return []
    if isinstance(action.metavar, tuple):
        return list(action.metavar)
    if action.choices is not None and action.metavar is None:
        return ["{" + ",".join(map(str, action.choices)) + "}"]
    return [action.metavar or action.dest.upper()]


def _row(action: argparse.Action) -> str:
    names = [f"`{name}`" for name in action.option_strings] or [f"`{_values(action)[0]}`"]
    values = " ".join(_values(action)) if action.option_strings else ""
    return f"- {', '.join(names)} {values}".rstrip() + f": {action.help or ''}"


if __name__ == "__main__":
    print(manual().rstrip("\n"))
