"""What README.md and docs/ show as printed or written by the program is what it prints and writes.

Words have to be the same; numbers agree to nine digits, or, where rounding errors are what is
told, to within a factor.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
import re

import pytest
from zoo import ROOT

from contimpact import load_diagram
from contimpact.cli import main
from contimpact.cli.run import say_branch

NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
ROUNDING = 1e-10
"""Numbers below are rounding errors, and may differ by a factor."""
FACTOR = 4.0


@pytest.fixture(scope="module")
def fig7(tmp_path_factory):
    """What the first run of the README prints, and the folder it writes."""
    folder = tmp_path_factory.mktemp("printed") / "fig7"
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        scene = ROOT / "branches/fig7/scene.toml"
        assert main(["run", str(scene), "-o", str(folder), "--no-plot"]) == 0
    return printed.getvalue().replace(str(folder), "out/fig7"), folder


def blocks(page, language):
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.S | re.M)


def same(shown, made):
    """Whether two lines have the same words, and numbers that agree."""
    if NUMBER.sub("#", shown) != NUMBER.sub("#", made):
        return False
    pairs = zip(NUMBER.findall(shown), NUMBER.findall(made), strict=True)
    return all(agree(float(a), float(b)) for a, b in pairs)


def agree(a, b):
    if abs(a) < ROUNDING and abs(b) < ROUNDING:
        return a == b or 0.0 in (a, b) or 1 / FACTOR < abs(a / b) < FACTOR
    return math.isclose(a, b, rel_tol=1e-9)


def not_printed(shown, made):
    """Lines that are shown and not among those made, in their order; dots stand for any lines."""
    made = iter(made)
    return [
        line for line in shown if line != "..." and not any(same(line, other) for other in made)
    ]


@pytest.mark.parametrize("page", ["README.md", "docs/index.md"])
def test_the_first_run_prints_what_is_shown(page, fig7):
    shown = next(block for block in blocks(page, "text") if "\nb1 " in block)
    *lines, last = shown.splitlines()
    assert not_printed(lines, fig7[0].splitlines()) == []
    assert re.fullmatch(r"written to out/fig7 in \d\.\d\d s", last)


def test_python_prints_what_is_shown():
    """The page's script up to what it prints of margins, and the message of a mistake."""
    script = blocks("docs/python.md", "python")
    last = next(k for k, block in enumerate(script) if "find_margins" in block)
    begun, mistake = script[: last + 1], script[-1]
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(compile("\n".join([*begun, mistake]), "docs/python.md", "exec"), {})
    shown = "".join(blocks("docs/python.md", "text")).splitlines()
    assert not_printed(shown, printed.getvalue().splitlines()) == []


def test_a_catalogue_is_written_as_it_is_shown(fig7):
    made = json.loads((fig7[1] / "catalogue.json").read_text(encoding="utf-8"))
    shown = json.loads(blocks("docs/figures/catalogue.md", "json")[0])
    firsts = {key: made[key][:1] for key in ("branches", "entries")}
    firsts["reading"] = {key: rows[:1] for key, rows in made["reading"].items()}
    lines = json.dumps({**made, **firsts}, indent=1).splitlines()
    assert not_printed(json.dumps(shown, indent=1).splitlines(), lines) == []
    assert len(lines) == len(json.dumps(shown, indent=1).splitlines())


def test_tables_are_written_as_they_are_shown(fig7):
    events, branch = blocks("docs/figures/catalogue.md", "text")
    made = (fig7[1] / "events.csv").read_text(encoding="utf-8").splitlines()
    assert not_printed(events.splitlines(), made[:3]) == []
    (table,) = (fig7[1] / "branches").glob("b1-*.csv")
    made = table.read_text(encoding="utf-8").splitlines()
    assert not_printed(branch.splitlines()[1:], made[1:3]) == []


def test_every_key_of_a_catalogue_and_a_manifest_is_told(fig7):
    told = (ROOT / "docs/catalogue.md").read_text(encoding="utf-8")
    catalogue = json.loads((fig7[1] / "catalogue.json").read_text(encoding="utf-8"))
    manifest = json.loads((fig7[1] / "manifest.json").read_text(encoding="utf-8"))
    records = [catalogue, manifest, catalogue["branches"][0], catalogue["entries"][0]]
    records += [row for rows in catalogue["reading"].values() for row in rows[:1]]
    records.append(catalogue["reading"])
    assert [key for record in records for key in record if f"`{key}`" not in told] == []


def test_what_is_observable_is_printed_first_and_ghosts_on_request(fig7):
    """In the order of the catalogue, and every event in one list or the other."""
    made = json.loads((fig7[1] / "catalogue.json").read_text(encoding="utf-8"))
    lines = fig7[0].splitlines()
    stable = [line for line in lines if line.startswith("stable ")]
    assert lines[: len(stable)] == stable
    assert [line.split()[1] for line in stable] == [
        row["branch"] for row in made["reading"]["stable"]
    ]
    listed = {line.split()[0] for line in lines if re.match(r"  e\d", line)}
    assert listed == {entry["id"] for entry in made["entries"] if not entry["ghost"]}
    counts = [line for line in lines if line.startswith("      ghosts: ")]
    assert sum(int(n) for line in counts for n in re.findall(r"(\d+) ", line)) == sum(
        entry["ghost"] for entry in made["entries"]
    )
    diagram, printed = load_diagram(fig7[1]), io.StringIO()
    with contextlib.redirect_stdout(printed):
        for branch in diagram.branches:
            say_branch(branch, [], ghosts=True)
    assert set(re.findall(r"^  (e\d+) ", printed.getvalue(), re.M)) == {
        entry["id"] for entry in made["entries"]
    }
