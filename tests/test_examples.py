"""The examples: each listed, each with the line that runs it; what runs them all is the site."""

from __future__ import annotations

import ast
import importlib.util
import re

import pytest
from zoo import ROOT

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


def test_the_list_is_complete():
    listed = re.findall(r"^\| \[([\w.]+)\]", (ROOT / "examples/README.md").read_text("utf-8"), re.M)
    assert sorted(listed) == [path.name for path in EXAMPLES]


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_says_how_it_is_run(path):
    text = ast.get_docstring(ast.parse(path.read_text("utf-8")))
    assert text.splitlines()[0].endswith((".", "?"))
    assert f"python examples/{path.name}" in text


def test_the_site_shows_and_runs_them_all():
    """The page links each example, and the site puts its code and a cell that runs it below."""
    spec = importlib.util.spec_from_file_location("conf", ROOT / "docs" / "conf.py")
    conf = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(conf)
    text = conf.run_examples((ROOT / "docs/examples.md").read_text("utf-8"))
    names = sorted(path.stem for path in EXAMPLES)
    assert sorted(re.findall(r"^\[(\w+)\.py\]", text, re.M)) == names
    assert (
        sorted(re.findall(r"^```\{literalinclude\} \.\./examples/(\w+)\.py", text, re.M)) == names
    )
    assert sorted(re.findall(r'^run\("(\w+)"', text, re.M)) == names
