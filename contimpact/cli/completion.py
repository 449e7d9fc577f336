"""What shells need to complete commands and options, made of the parser itself."""

from __future__ import annotations

import argparse

from . import commands_of, parser, say

BASH = """\
_contimpact() {{
    local current=${{COMP_WORDS[COMP_CWORD]}} words=""
    if [ "$COMP_CWORD" -eq 1 ]; then
        COMPREPLY=($(compgen -W "{commands}" -- "$current"))
        return
    fi
    case ${{COMP_WORDS[1]}} in
{cases}
    esac
    COMPREPLY=($(compgen -W "$words" -- "$current") $(compgen -f -- "$current"))
}}
complete -o filenames -F _contimpact contimpact
"""
ZSH = "autoload -U +X bashcompinit && bashcompinit\n"


def completion(options: argparse.Namespace) -> int:
    """Print the script of a shell; returns the exit status."""
    say(script(options.shell).rstrip("\n"))
    return 0


def script(shell: str) -> str:
    """Return the script of a shell: bash, zsh or fish."""
    found = {
        name: [text for action in one._actions for text in action.option_strings]
        for name, one in commands_of(parser()).items()
    }
    if shell == "fish":
        return "".join(_fish(name, words) for name, words in found.items())
    cases = "\n".join(f'        {name}) words="{" ".join(w)}" ;;' for name, w in found.items())
    text = BASH.format(commands=" ".join(found), cases=cases)
    return ZSH + text if shell == "zsh" else text


def _fish(name: str, words: list[str]) -> str:
    """The lines of one command."""
    lines = [f"complete -c contimpact -n __fish_use_subcommand -f -a {name}"]
    for word in words:
        kind, text = ("l", word[2:]) if word.startswith("--") else ("s", word[1:])
        lines.append(
            f"complete -c contimpact -n '__fish_seen_subcommand_from {name}' -{kind} {text}"
        )
    return "\n".join(lines) + "\n"
