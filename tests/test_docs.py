r"""The documentation as text: no control characters, formulas that LaTeX can read.

A formula that goes through a program's string constant loses its backslashes: ``\begin`` becomes a
backspace and ``egin``, ``\\`` a single ``\``, ``\frac`` a form feed and ``rac``.
"""

from __future__ import annotations

import re
import unicodedata

import pytest
from matplotlib._mathtext_data import tex2uni
from zoo import ROOT

from contimpact.bifurcations.declarations import KINDS
from contimpact.systems import SYSTEMS

PAGES = [
    *sorted(ROOT.glob("docs/*.md")),
    *sorted(ROOT.glob("docs/development/*.md")),
    *sorted(ROOT.glob("docs/figures/*.md")),
    *sorted(ROOT.glob("branches/*.md")),
    *sorted(ROOT.glob("paper/*.md")),
    *sorted(ROOT.glob("*.md")),
]


def texts_below(folder):
    """The pages, tables and modules of a folder, without what was built or installed there."""
    for path in sorted(folder.iterdir()):
        if path.is_dir() and not path.name.startswith((".", "_", "node_modules")):
            yield from texts_below(path)
        elif path.suffix in (".md", ".toml", ".py"):
            yield path


STRUCTURE = """
begin end left right bigl bigr Bigl Bigr frac tfrac dfrac sqrt text operatorname mathrm mathbb
lvert rvert lVert rVert big Big mathbf mathcal mathsf mathit underbrace overline dots cos sin tan
exp ln log max min det bmod le ge ne to quad qquad
"""
COMMANDS = frozenset(tex2uni) | frozenset(STRUCTURE.split())
"""What structures formulas, and symbols by their LaTeX names."""

MATRICES = ("pmatrix", "bmatrix", "array")


def formulas(text):
    """The formulas of a page, displayed or in a line, without what is code."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.S | re.M)
    text = re.sub(r"`[^`\n]*`", "", text)
    displayed = re.findall(r"\$\$(.*?)\$\$", text, flags=re.S)
    rest = re.sub(r"\$\$.*?\$\$", "", text, flags=re.S)
    return displayed + re.findall(r"\$([^$\n]+(?:\n[^$\n]+)?)\$", rest)


def faults(formula):
    """What LaTeX could not read in a formula, or would set as something else."""
    found = [f"\\{c}: unknown" for c in re.findall(r"\\([A-Za-z]+)", formula) if c not in COMMANDS]
    plain = re.sub(r"\\(?:operatorname|text|mathrm|begin|end)\{[^}]*\}(?:\{[^}]*\})?", " ", formula)
    bare = re.findall(r"[A-Za-z]{3,}", re.sub(r"\\[A-Za-z]+", " ", plain))
    found += [f"{word}: a command without its backslash" for word in bare]
    for one, other in ((r"\{", r"\}"), (r"\\left\b", r"\\right\b"), (r"\\bigl\b", r"\\bigr\b")):
        if len(re.findall(one, formula)) != len(re.findall(other, formula)):
            found.append(f"{one} and {other} do not pair")
    return found + _environments(formula)


def _environments(formula):
    """Environments that do not close, and matrices whose rows differ in length."""
    begun = re.findall(r"\\begin\{(\w+)\}", formula)
    ended = re.findall(r"\\end\{(\w+)\}", formula)
    if sorted(begun) != sorted(ended):
        return [f"begins {begun}, ends {ended}"]
    found = []
    for name, inside in re.findall(r"\\begin\{(\w+)\}(.*?)\\end\{\1\}", formula, flags=re.S):
        rows = [row.count("&") for row in inside.split("\\\\")]
        if name in MATRICES and (len(rows) < 2 or len(set(rows)) != 1):
            found.append(f"{name}: rows of {[n + 1 for n in rows]} cells")
    outside = re.sub(r"\\begin\{(\w+)\}.*?\\end\{\1\}", "", formula, flags=re.S)
    if "&" in outside:
        found.append("& outside of an environment")
    return found


def test_the_texts_are_there():
    assert {"mathematics.md", "curves.md", "results.md"} <= {path.name for path in PAGES}


def test_no_control_characters():
    """Neither the invisible ones nor those of a private use; lines end in a line feed."""
    found = {}
    texts = [*texts_below(ROOT)]
    assert len(texts) > 500
    for path in texts:
        signs = {*path.read_bytes().decode("utf-8")} - {"\n"}
        odd = {c for c in signs if unicodedata.category(c) in ("Cc", "Cf", "Co")}
        if odd:
            found[str(path.relative_to(ROOT))] = sorted(map(ascii, odd))
    assert found == {}


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_formulas_can_be_read(path):
    found = formulas(path.read_text(encoding="utf-8"))
    assert [(f, faults(f)) for f in found if faults(f)] == []


def test_pages_have_formulas():
    """The patterns see them; measured: 185 in the page on mathematics."""
    assert len(formulas((ROOT / "docs/mathematics.md").read_text(encoding="utf-8"))) > 120


@pytest.mark.parametrize(
    "broken",
    [
        "O \x08egin{bmatrix} P & Q \\ & A \\end{bmatrix}",
        r"\begin{bmatrix} P & Q \ & A \end{bmatrix}",
        r"\begin{bmatrix} P & Q \\ A \end{bmatrix}",
        r"\frac{1}{2",
        "rac12 x",
        r"\lamda",
        r"a &= b",
        r"\left( x",
        r"\bigl( x",
    ],
)
def test_broken_formulas_are_found(broken):
    assert faults(broken)


def test_the_newest_changes_begin_with_a_summary():
    """Of at most 25 lines; what changed in detail is under headings."""
    newest = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").split("\n## ")[1]
    summary, *headings = newest.split("\n### ")
    assert len(summary.strip().splitlines()) <= 25
    assert headings


def test_pages_name_every_kind_and_every_system():
    """Where users look for them: the table of events, the short list, the key `system`."""
    mathematics, quick, scene = (
        (ROOT / "docs" / f"{page}.md").read_text(encoding="utf-8")
        for page in ("mathematics", "quick", "scene")
    )
    (listed,) = (line for line in quick.splitlines() if line.startswith("The kinds of events are"))
    (systems,) = (line for line in scene.splitlines() if line.startswith("| `system` |"))
    assert [kind for kind in KINDS if f"\n| {kind} | " not in mathematics] == []
    assert [kind for kind in KINDS if not re.search(rf"\b{kind} ", listed)] == []
    assert [name for name in SYSTEMS if f'`"{name}"`' not in systems] == []
