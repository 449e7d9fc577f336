"""Help, manual and completion are of the parser, with an example for every command."""

from __future__ import annotations

import importlib
import shlex
import shutil
import subprocess

import pytest
from zoo import ROOT, tool

from contimpact.cli import commands_of, main, parser
from contimpact.cli.completion import script

COMMANDS = list(commands_of(parser()))


def test_the_manual_is_that_of_the_parser():
    """Made again by ``python tools/manual.py > docs/cli.md``."""
    page = tool("manual").manual().rstrip("\n")
    assert (ROOT / "docs" / "cli.md").read_text(encoding="utf-8") == page + "\n"


@pytest.mark.parametrize("name", COMMANDS)
def test_help_ends_with_an_example_that_can_be_read(name, capsys):
    with pytest.raises(SystemExit) as end:
        main([name, "--help"])
    assert end.value.code == 0
    _, _, example = capsys.readouterr().out.rpartition("\nexample:\n  ")
    if name == "completion":
        assert example == 'eval "$(contimpact completion bash)"\n'
        return
    words = shlex.split(example)
    assert words[:2] == ["contimpact", name]
    module, _, function = parser().parse_args(words[1:]).function.partition(".")
    assert callable(getattr(importlib.import_module(f"contimpact.cli.{module}"), function))


@pytest.mark.parametrize("name", COMMANDS)
def test_every_argument_says_what_it_is(name):
    lacking = [a.dest for a in commands_of(parser())[name]._actions if not a.help]
    assert lacking == []


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (["contimpact", "r"], ["run", "report"]),
        (["contimpact", "plot", "--x"], ["--xlim"]),
        (["contimpact", "run", "--no"], ["--no-plot"]),
    ],
)
def test_bash_completes(line, expected, tmp_path):
    words = " ".join(map(shlex.quote, line))
    ask = f'COMP_WORDS=({words}); COMP_CWORD={len(line) - 1}; _contimpact; echo "${{COMPREPLY[@]}}"'
    code = script("bash") + ask
    done = subprocess.run(
        ["bash", "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert set(expected) <= set(done.stdout.split())


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_command_prints_the_script(shell, capsys):
    assert main(["completion", shell]) == 0
    text = capsys.readouterr().out
    assert text == script(shell)
    assert all(name in text for name in COMMANDS)
