"""The laws of the architecture, read from the source: who imports whom, and what is forbidden."""

from __future__ import annotations

import ast
import graphlib
import os
import re
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest
from zoo import ROOT, tool

import contimpact
from contimpact.bifurcations.declarations import CROSSINGS, KINDS
from contimpact.models.sources import GENERATOR

PACKAGE = Path(contimpact.__file__).parent
FILES = {
    ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__"): path
    for path in sorted(PACKAGE.rglob("*.py"))
}
"""Every module of the package, by its dotted name."""

PAGE = (ROOT / "docs" / "development" / "architecture.md").read_text(encoding="utf-8")
ROW = re.compile(r"^\| `(\w+)` \| (.*) \|$", re.MULTILINE)
PACKAGES = {
    name: set(re.findall(r"`(\w+)`", others))
    for name, others in ROW.findall(PAGE.split("<!-- table of imports -->")[1].split("\n\n", 2)[1])
}
"""The packages, and which others the modules of each may import, as the page says."""

FOR_ALL = {
    "contimpact",
    *(f"contimpact.{n}" for n in ("arrays", "display", "errors", "progress", "schema", "syntax")),
}
"""What any package may import as well."""

TRUSTED = {
    "contimpact.cli": {"exec"},
    "contimpact.segments.kernel": {"exec"},
    "contimpact.segments.kernels": {"exec"},
    "contimpact.segments.compiling": {"ctypes"},
    "contimpact.segments.bounded": {"exec"},
    "contimpact.segments.llvm_ir": {"exec"},
    "contimpact.segments.transients": {"exec"},
    "contimpact.segments.machine_code": {"subprocess"},
    "contimpact.storage": {"pickle"},
}
"""Modules that run what the package has written itself: kernels, compiled code, an empty text."""


class Import(NamedTuple):
    """One imported module: the line that imports it, and when that is executed."""

    module: str
    line: int
    when: str

    @property
    def at_import(self):
        return self.when == "import"


@cache
def measure():
    """The script that measures the package: it has every module's tree."""
    return tool("measure")


def tree(module):
    return measure().TREES[module]


@cache
def nodes(module):
    """Every node of a module, and when it is executed: on import, later, or for types alone."""
    found, waiting = [], [(tree(module), "import")]
    while waiting:
        node, when = waiting.pop()
        for child in ast.iter_child_nodes(node):
            now = when
            if isinstance(child, ast.If) and "TYPE_CHECKING" in getattr(child.test, "id", ""):
                now = "typing"
            elif isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
                now = "later" if when == "import" else when
            found.append((child, now))
            waiting.append((child, now))
    return found


@cache
def imports(module):
    """The modules a module imports; of ``from a import b``, a.b where that is a module."""
    package = module if FILES[module].name == "__init__.py" else module.rpartition(".")[0]
    found = []
    for node, when in nodes(module):
        if isinstance(node, ast.Import):
            found += [Import(alias.name, node.lineno, when) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) + 1 - node.level]
            base = ".".join([*(above if node.level else []), *filter(None, [node.module])])
            for alias in node.names:
                whole = f"{base}.{alias.name}"
                found.append(Import(whole if whole in FILES else base, node.lineno, when))
    return tuple(found)


def inside(module, package):
    return module == package or module.startswith(f"{package}.")


def modules_of(package):
    return [module for module in FILES if inside(module, package)]


def own(module):
    """The modules of the package that a module imports."""
    return {i.module for i in imports(module) if inside(i.module, "contimpact")}


def places(module, wanted):
    return [f"{FILES[module].name}:{i.line}: {i.module}" for i in imports(module) if wanted(i)]


def test_the_reader_of_imports():
    """The reader sees what is known to be imported."""
    assert {f"contimpact.{name}" for name in PACKAGES} < set(FILES)
    assert "contimpact.errors" in own("contimpact.models.model")
    assert "contimpact.models.model" in own("contimpact.systems.impact_pair")
    symbolic = [i for i in imports("contimpact.systems.impact_pair") if "symbolic" in i.module]
    assert symbolic
    assert not any(i.at_import for i in symbolic)
    assert any(i.module.startswith("matplotlib") for i in imports("contimpact.plots.diagram"))
    assert len(FILES) > 20


def law(modules):
    """Make one test of a check of one module: it fails with all modules that break the law."""

    def test_of(check):
        def test():
            broken = {}
            for module in modules:
                try:
                    check(module)
                except AssertionError as error:
                    broken[module] = str(error)
            assert broken == {}

        test.__name__, test.__doc__ = check.__name__, check.__doc__
        return test

    return test_of


def package_of(module):
    return module.split(".")[1] if module.count(".") else ""


@law([m for m in FILES if package_of(m) in PACKAGES])
def test_packages_import_what_they_may(module):
    package = package_of(module)
    allowed = {package, *PACKAGES[package]}
    assert {m for m in own(module) - FOR_ALL if package_of(m) not in allowed} == set()


def test_every_package_is_known():
    assert {package_of(m) for m in FILES} - {
        "",
        "__main__",
        "arrays",
        "cli",
        "display",
        "errors",
        "progress",
        "schema",
        "syntax",
    } == {*PACKAGES}


def test_packages_have_an_order():
    """Each imports those of its list alone, none of which imports it in turn."""
    order = list(graphlib.TopologicalSorter(PACKAGES).static_order())
    assert order.index("segments") < order.index("orbits") < order.index("diagrams")


def test_classes_that_the_page_names_are_there():
    named = set(re.findall(r"`([A-Z]\w*[a-z]\w*)[`(.]", PAGE))
    text = "".join(path.read_text(encoding="utf-8") for path in FILES.values())
    assert len(named) > 10
    assert named <= set(re.findall(r"^class (\w+)", text, re.MULTILINE))


@law(modules_of("contimpact.systems"))
def test_a_system_imports_models_and_what_it_extends(module):
    models = (
        "model",
        "symbolic",
        "linear",
        "nonlinear",
        "filippov",
        "switching",
        "machine",
        "stated_modes",
        "expressions",
        "symbols",
    )
    extended = {"soft_pair": {"systems.impact_pair", "systems.membrane"}}
    named = {f"models.{name}" for name in models} | extended.get(module.rpartition(".")[2], set())
    assert own(module) - FOR_ALL <= {f"contimpact.{name}" for name in named}


PICTURES = modules_of("contimpact.plots")
"""The modules that draw pictures."""


@law([m for m in FILES if m not in PICTURES])
def test_only_pictures_import_matplotlib(module):
    assert places(module, lambda i: inside(i.module, "matplotlib")) == []


@law([m for m in FILES if m not in PICTURES])
def test_pictures_are_imported_where_they_are_drawn(module):
    """A module that imports them when it is imported itself would load matplotlib."""
    assert places(module, lambda i: i.module in PICTURES and i.at_import) == []


@law(FILES)
def test_pyplot_is_imported_nowhere(module):
    assert places(module, lambda i: "pyplot" in i.module) == []
    assert "pyplot" not in FILES[module].read_text(encoding="utf-8")


@law(FILES)
def test_sympy_is_imported_where_it_is_used(module):
    found = places(module, lambda i: inside(i.module, "sympy") and i.at_import)
    of_models = ("equations", "filippov", "linear", "nonlinear", "symbolic", "symbols")
    names = (
        *(f"models.{name}" for name in of_models),
        *(f"segments.{name}" for name in ("codegen",)),
    )
    symbolic = {f"contimpact.{name}" for name in names}
    if module not in symbolic:
        assert found == []


@law(FILES)
def test_the_symbolic_modules_are_imported_where_they_are_used(module):
    """A module that imports them when it is imported itself would load SymPy."""
    symbolic = {
        f"contimpact.{name}"
        for name in (
            "segments.checking",
            "segments.codegen",
            "models.symbolic",
            "mechanics.symbolic",
        )
    }
    if module not in symbolic:
        assert places(module, lambda i: i.module in symbolic and i.at_import) == []


@law(FILES)
def test_pandas_is_optional(module):
    assert places(module, lambda i: inside(i.module, "pandas") and i.at_import) == []


@law(FILES)
def test_nothing_unsafe(module):
    unsafe = {"pickle", "marshal", "shelve", "dill", "joblib", "subprocess", "ctypes"}
    unsafe -= TRUSTED.get(module, set())
    assert places(module, lambda i: i.module.split(".")[0] in unsafe) == []
    called = [n.func for n, _ in nodes(module) if isinstance(n, ast.Call)]
    names = {f.id for f in called if isinstance(f, ast.Name)}
    attributes = {f.attr for f in called if isinstance(f, ast.Attribute)}
    assert not names & {"eval", "__import__", "input", "breakpoint"}
    assert not attributes & {"parse_expr", "system", "popen"}
    if "exec" not in TRUSTED.get(module, set()):
        assert "exec" not in names


@law(FILES)
def test_texts_are_parsed_in_one_thread_at_a_time(module):
    """``ast.parse`` in two threads at once can fail in CPython 3.11: `syntax` has a lock."""
    called = [n.func for n, _ in nodes(module) if isinstance(n, ast.Call)]
    attributes = [f for f in called if isinstance(f, ast.Attribute) and f.attr == "parse"]
    parsing = [f for f in attributes if ast.unparse(f) == "ast.parse"]
    assert len(parsing) == (2 if module == "contimpact.syntax" else 0)


@law(FILES)
def test_only_the_command_line_prints(module):
    """Progress prints, too, where a caller asks for it."""
    printing = [
        f"{FILES[module].name}:{node.lineno}"
        for node, _ in nodes(module)
        if (isinstance(node, ast.Name) and node.id == "print")
        or (isinstance(node, ast.Attribute) and node.attr in ("stdout", "stderr"))
    ]
    assert printing == [] or inside(module, "contimpact.cli") or module == "contimpact.progress"


@law(FILES)
def test_only_the_command_line_exits(module):
    exits = [
        node
        for node, _ in nodes(module)
        if isinstance(node, ast.Name) and node.id in ("SystemExit", "exit", "quit")
    ]
    assert exits == []
    if module != "contimpact.__main__" and not inside(module, "contimpact.cli"):
        assert not re.search(r"\bsys\.exit\b", FILES[module].read_text(encoding="utf-8"))


@law(FILES)
def test_no_warning_is_silenced_and_no_exception_swallowed(module):
    bare = [
        node.lineno
        for node, _ in nodes(module)
        if isinstance(node, ast.ExceptHandler)
        and (node.type is None or all(isinstance(n, ast.Pass) for n in node.body))
    ]
    assert bare == []
    assert places(module, lambda i: i.module == "warnings") == []


MACHINE = re.compile(
    r"""(?<![\w.:/])(/(home|root|Users|usr|opt|mnt|tmp|var|srv|data)/|[A-Za-z]:\\\\|~/)"""
)


@law(FILES)
def test_no_path_of_a_machine(module):
    lines = FILES[module].read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if MACHINE.search(line)] == []


def test_the_reader_of_paths():
    assert MACHINE.search('open("/home/me/file")')
    assert MACHINE.search("# see /opt/notes")
    assert not MACHINE.search("a ratio n/m, `examples/data/x`, https://host/home/x")


@law(FILES)
def test_imports_are_relative_within_the_package(module):
    """A copy under another name then works."""
    absolute = [
        node.lineno
        for node, _ in nodes(module)
        if (
            isinstance(node, ast.ImportFrom)
            and not node.level
            and node.module
            and inside(node.module, "contimpact")
        )
        or (isinstance(node, ast.Import) and any(inside(a.name, "contimpact") for a in node.names))
    ]
    assert absolute == []


def test_no_constant_is_bound_twice():
    """Functions above would silently take on the value that is meant for those below."""
    twice = []
    for module, file in FILES.items():
        body = ast.parse(file.read_text(encoding="utf-8")).body
        targets = [
            target for part in body if isinstance(part, ast.Assign) for target in part.targets
        ]
        names = [n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)]
        twice += [f"{module}: {name}" for name in set(names) if names.count(name) > 1]
    assert not twice


def test_imports_run_one_way():
    """No circle among modules; imports inside functions count, and those for types."""
    graph = {
        module: {i.module for i in imports(module)} & set(FILES) - {module, "contimpact"}
        for module in FILES
    }
    graphlib.TopologicalSorter(graph).prepare()


@law(FILES)
def test_no_kind_of_event_is_told_by_its_name(module):
    """What depends on a kind is defined with the kind; changes of attractors have names alone."""
    found = [
        f"{FILES[module].name}:{node.lineno}: {ast.unparse(node)}"
        for node, _ in nodes(module)
        if isinstance(node, ast.Compare)
        and "kind" in ast.unparse(node)
        and {n.value for n in ast.walk(node) if isinstance(n, ast.Constant)} & {*KINDS, *CROSSINGS}
    ]
    assert found == [] or module == "contimpact.simulation.transitions"


OPTIONAL = ("accuracy", "certificates", "page", "studies")
"""Packages that only some commands need."""


@pytest.mark.full
def test_the_core_runs_without_the_optional_packages(tmp_path):
    """Copied without them, it follows the orbits of Fig. 7 and draws the diagram."""
    left_out = shutil.ignore_patterns(*OPTIONAL)
    shutil.copytree(PACKAGE, tmp_path / "contimpact", ignore=left_out)
    scene = ROOT / "branches" / "fig7" / "scene.toml"
    order = [sys.executable, "-m", "contimpact", "run", scene, "-o", tmp_path / "out"]
    apart = os.environ | {"PYTHONPATH": str(tmp_path)}
    done = subprocess.run(order, cwd=tmp_path, env=apart, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "G[2:1->3:1] e5 to FB e4" in done.stdout
    assert (tmp_path / "out" / "diagram.png").stat().st_size > 0


def test_a_key_of_a_scene_is_spelled_in_one_module():
    places = measure().places_of_keys()
    assert {"depth", "max_branches", "survey", "bits", "formats", "basins"} <= set(places)
    assert {name: modules for name, modules in places.items() if len(modules) > 1} == {}


def test_errors_import_nothing():
    assert own("contimpact.errors") == set()


@law([m for m in FILES if not inside(m, "contimpact.cli")])
def test_nothing_imports_the_command_line(module):
    if module != "contimpact.__main__":
        assert not any(inside(m, "contimpact.cli") for m in own(module))


@law(FILES)
def test_every_module_has_a_docstring(module):
    text = ast.get_docstring(tree(module))
    assert text
    assert text.splitlines()[0].endswith((".", ":", "?"))


def test_kernels_are_known_by_all_files_that_write_them():
    """A change in a file that is not named would leave old kernels in the cache."""
    stating = "contimpact.models.nonlinear"  # a system of the package builds its flights by it
    writing, waiting = set(), {"contimpact.segments.codegen", stating}
    while waiting:
        writing |= waiting
        found = {i.module for module in waiting for i in imports(module) if i.when != "typing"}
        waiting = found & set(FILES) - writing
    named = {f"contimpact.{name.replace('/', '.')}" for name in GENERATOR}
    others = ("arrays", "errors", "models.sources", "storage", "syntax")
    assert writing - {f"contimpact.{name}" for name in others} == named
