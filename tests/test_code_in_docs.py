"""Code in the documentation is that of the files it is taken from, and seen without Sphinx."""

from __future__ import annotations

import re
import textwrap

import pytest
from zoo import ROOT

PAGES = sorted((ROOT / "docs").glob("*.md"))
TAKEN = [
    (path.name, *found)
    for path in PAGES
    for found in re.findall(
        r"^<!-- from (\S+) -->\n```\w+\n(.*?)^```", path.read_text("utf-8"), re.M | re.S
    )
]


@pytest.mark.parametrize(("page", "file", "code"), TAKEN, ids=lambda value: value[:30])
def test_code_is_that_of_its_file(page, file, code):
    assert textwrap.dedent(code) in textwrap.dedent((ROOT / file).read_text("utf-8"))


def test_pages_hide_no_code():
    """Directives whose content stands in another file show nothing on a page of a repository."""
    assert len(TAKEN) >= 4
    hidden = r"^```\{(?:literalinclude|include|code-cell)\}|\{(?:eq|ref|doc)\}`"
    assert [p.name for p in PAGES if re.search(hidden, p.read_text("utf-8"), re.M)] == []


def test_the_readme_leads_to_every_page():
    readme = (ROOT / "README.md").read_text("utf-8")
    assert [p.name for p in PAGES if f"(docs/{p.name})" not in readme] == []
