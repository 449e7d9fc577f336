"""The package's names as a user meets them: in help, type checkers and editors, without extras."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import contimpact

WITHOUT_EXTRAS = """
import inspect, pydoc, sys
sys.modules.update(dict.fromkeys(("flint", "heyoka", "llvmlite", "pandas", "pyarrow", "mpi4py")))
import contimpact
from contimpact import *
found = dict(inspect.getmembers(contimpact))
assert all(name in found and hasattr(contimpact, name) for name in contimpact.__all__)
assert "certify" in pydoc.render_doc("contimpact")
assert "pip install contimpact[certify]" in pydoc.render_doc(certify)
try:
    certify("a folder")
except ModuleNotFoundError as error:
    print(error.name, error)
"""

SCRIPT = """
import contimpact as ci

pair = ci.ImpactPair(beta=0.5, r=0.3, A=5.0, s=0.34)
orbits = ci.find_orbits(pair, "1:1")
branch = ci.continue_orbit(orbits[0], "s", range=(0.2, 0.4))
diagram = ci.follow(ci.load_scene("scene.toml"))
reveal_type(orbits)
reveal_type(branch)
reveal_type(branch.events[0].value)
reveal_type(diagram.reading.stable)
reveal_type(ci.certify(branch))
ci.find_orbits(pair, 3)
ci.find_orbit(pair, "1:1")
"""
SAID = [
    'note: Revealed type is "list[contimpact.orbits.orbit.Orbit]"',
    'note: Revealed type is "contimpact.results.branch.Branch"',
    'note: Revealed type is "float"',
    'Sequence[contimpact.results.diagram_reading.Interval]"',
    'note: Revealed type is "contimpact.certificates.certify.Certificates"',
    'error: Argument 2 to "find_orbits" has incompatible type "int"; expected "str | Word"',
    'error: Module has no attribute "find_orbit"',
]


def python(*given: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, *given], capture_output=True, text=True, timeout=300)


@pytest.mark.full
def test_without_extras_names_are_there_and_say_what_they_lack_when_called():
    done = python("-c", WITHOUT_EXTRAS)
    assert done.stderr == ""
    assert done.stdout.startswith(
        "flint python-flint, which proofs are made with, is not installed"
    )


def test_types_are_read_from_where_names_are_loaded_from():
    module = ast.parse(Path(contimpact.__file__).read_text(encoding="utf-8"))
    (checked,) = (
        node
        for node in module.body
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
    )
    places = {
        name.asname: line.module
        for line in checked.body
        if isinstance(line, ast.ImportFrom)
        for name in line.names
        if name.name == name.asname
    }
    assert places == contimpact._PLACES


@pytest.mark.full
def test_mypy_knows_the_types_of_a_users_script(tmp_path, request):
    pytest.importorskip("mypy")
    (tmp_path / "script.py").write_text(SCRIPT, encoding="utf-8")
    kept = str(request.config.cache.mkdir("mypy"))
    flags = ["--strict", "--no-error-summary", "--config-file=", f"--cache-dir={kept}"]
    said = python("-m", "mypy", *flags, str(tmp_path / "script.py")).stdout.splitlines()
    assert len(said) == len(SAID), said
    assert all(part in line for part, line in zip(SAID, said, strict=True)), said


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("ci.fi", "find_orbits"),
        ("branch = ci.continue_orbit(orbit, 's', range=(0, 1))\nbranch.ev", "events"),
        ("ci.follow(scene).read", "reading"),
    ],
)
def test_editors_complete_names_and_what_results_have(text, wanted):
    jedi = pytest.importorskip("jedi")
    script = f"import contimpact as ci\n{text}"
    assert wanted in {found.name for found in jedi.Script(script).complete()}
