"""The documentation as a site: notebooks as they are kept, the gallery, the checker of links."""

from __future__ import annotations

import importlib.util
import json
import re

import pytest
from zoo import ROOT

DOCS = ROOT / "docs"
PAPER = ROOT / "paper"
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))


def code_of(path):
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]


def test_all_notebooks_are_in_the_contents():
    index = (DOCS / "index.md").read_text(encoding="utf-8")
    assert len(NOTEBOOKS) == 5
    assert all(f"notebooks/{path.stem}" in index for path in NOTEBOOKS)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_are_kept_without_outputs_and_places(path):
    text = path.read_text(encoding="utf-8")
    assert len(text) < 20_000
    assert not re.search(r"/(home|root|tmp|Users|work)/", text)
    for cell in json.loads(text)["cells"]:
        assert cell.get("outputs", []) == []
        assert cell.get("execution_count") is None


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebooks_run_from_top_to_bottom(path, tmp_path):
    """In a kernel of their own, as the documentation's build does with all of them."""
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    book = nbformat.read(path, 4)
    place = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(book, timeout=120, kernel_name="python3", resources=place).execute()
    shown = [o for cell in book.cells for o in cell.get("outputs", []) if "data" in o]
    assert any("image/png" in o["data"] or "<img" in o["data"].get("text/html", "") for o in shown)


def test_the_gallery_has_every_figure_and_its_pictures():
    text = (DOCS / "gallery.md").read_text(encoding="utf-8")
    heads = " ".join(re.findall(r"^## (.*)$", text, re.M))
    assert {int(n) for n in re.findall(r"\d+", heads.replace("1:1", ""))} == {*range(1, 13)}
    for target in re.findall(r"!\[[^\]]+\]\(([^)]+)\)", text):
        assert (DOCS / target).is_file(), target


def module_of(name):
    """A script of the documentation as a module."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def checker():
    return module_of("check_site")


@pytest.mark.full
def test_the_start_page_holds_a_live_page_of_fig7(checker, tmp_path):
    """In one file that loads nothing, below two megabytes beside the library it is drawn with."""
    start = (DOCS / "index.md").read_text(encoding="utf-8")
    (place,) = re.findall(r'<iframe src="([^"]+)"', start)
    module_of("conf").write_live_page(tmp_path)
    page = tmp_path / place
    library = (ROOT / "contimpact/page/vendor/d3.min.js").stat().st_size
    assert 100_000 < page.stat().st_size - library < 2_000_000
    assert checker.faults(tmp_path) == []
    assert '"swept":[{' in page.read_text(encoding="utf-8")  # the attractors that are kept


def test_broken_links_are_found(checker, tmp_path):
    (tmp_path / "b.html").write_text('<p id="here">', encoding="utf-8")
    (tmp_path / "a.html").write_text(
        '<a href="b.html#here"></a><a href="b.html#there"></a><a href="c.html"></a>'
        '<a href="https://example.org"></a><script src="https://example.org/x.js"></script>'
        '<img src="d.png">',
        encoding="utf-8",
    )
    assert checker.faults(tmp_path) == [
        "a.html: loads https://example.org/x.js",
        "a.html: b.html#there: no such place",
        "a.html: c.html: no such file",
        "a.html: d.png: no such file",
    ]


def test_the_paper_has_its_parts_figures_and_references():
    """In the form of the Journal of Open Source Software."""
    text = (PAPER / "paper.md").read_text(encoding="utf-8")
    heads = re.findall(r"^# (.*)$", text, re.M)
    wanted = ["Summary", "Statement of need", "State of the field"]
    wanted += ["Acknowledgements", "References"]
    assert [head for head in heads if head in wanted] == wanted
    assert 250 < len(text.split()) < 1000
    keys = set(re.findall(r"@(\w+)", text.split("---", 2)[2]))
    known = (PAPER / "paper.bib").read_text(encoding="utf-8")
    assert keys == set(re.findall(r"^@\w+\{(\w+),", known, re.M))
    for target in re.findall(r"\]\(([^)]+\.png)\)", text):
        assert (PAPER / target).is_file(), target
