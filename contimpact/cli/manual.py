"""The manual of the commands, made of the parser itself.

python -m contimpact.cli.manual > docs/cli.md
"""

from __future__ import annotations

import argparse

from . import parser
from .examples import EXAMPLES, commands_of

HEAD = """\
# Commands

<!-- made by python -m contimpact.cli.manual; a test compares -->

`contimpact COMMAND ...`, or `python -m contimpact COMMAND ...`, which is the same. `contimpact
--help` lists the commands, `contimpact COMMAND --help` the options of one, `contimpact --version`
says which version this is.

Exit status: 0 on success; 2 where the input cannot be used, with one message on standard error; 1
where a computation was interrupted or failed, or a file could not be written. What was computed
until then is written.
"""


def manual() -> str:
    """Return the page."""
    whole = parser()
    (action,) = (a for a in whole._actions if isinstance(a, argparse._SubParsersAction))
    helps = {choice.dest: choice.help for choice in action._choices_actions}
    pages = [_page(name, helps[name] or "", one) for name, one in commands_of(whole).items()]
    return "\n".join([HEAD, *pages])


def _page(name: str, help: str, command: argparse.ArgumentParser) -> str:
    rows = [_row(action) for action in command._actions if action.dest != "help"]
    usage = " ".join(["contimpact", name, *map(_usage, command._actions)])
    lines = [f"## {name}", "", f"{help[:1].upper()}{help[1:]}.", "", f"```text\n{usage}\n```", ""]
    lines += ["| | |", "|---|---|", *rows, "", f"```sh\n{EXAMPLES.get(name, '')}\n```", ""]
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
    return f"| {', '.join(names)} {values}".rstrip() + f" | {action.help or ''} |"


if __name__ == "__main__":
    from .terminal import say

    say(manual().rstrip("\n"))
