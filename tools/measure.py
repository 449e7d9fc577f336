"""How large the package is, and how its modules hang together: python tools/measure.py [--items].

Prints lines, statements (docstrings not counted), modules, packages, functions, import edges and
circles of imports (imports inside functions and for types counted, those of the package itself left
out: it finds its names when they are first used), the places that ask whether a system has one
coordinate or several, the places that look for names in the code of kernels, the most modules in
which a key of a scene is spelled, and the functions that test; with ``--items`` also the items that
pytest collects.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "contimpact"
FREEDOM = re.compile(r"\bDEGREES_OF_FREEDOM\b|(^|\W)m$|\bunknowns_per_impact\b")
"""What a comparison with 1 or 2 asks for the number of coordinates by."""

FILES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for path in sorted(PACKAGE.rglob("*.py"))
}
TREES = {module: ast.parse(path.read_text("utf-8")) for module, path in FILES.items()}


def imported(module: str) -> set[str]:
    """Return the modules of the package that a module imports, anywhere in it."""
    found = set()
    here = module.split(".")
    package = here if FILES[module].name == "__init__.py" else here[:-1]
    for node in ast.walk(TREES[module]):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = ".".join(
                [*package[: len(package) + 1 - node.level], *filter(None, [node.module])]
            )
            wholes = (f"{base}.{alias.name}" for alias in node.names)
            found |= {whole if whole in FILES else base for whole in wholes}
    return found - {module}


def circles(graph: dict[str, set[str]]) -> list[list[str]]:
    """Return the groups of modules that import each other, by Tarjan's algorithm."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in sorted(graph[node]):
            if other not in index:
                visit(other)
            if other in stack:
                low[node] = min(low[node], low[other])
        if low[node] == index[node]:
            place = stack.index(node)
            found.append(sorted(stack[place:]))
            del stack[place:]

    for node in graph:
        if node not in index:
            visit(node)
    return [group for group in found if len(group) > 1]


def nodes() -> Iterator[ast.AST]:
    """All nodes of all modules."""
    for tree in TREES.values():
        yield from ast.walk(tree)


def asks_for_coordinates(node: ast.AST) -> bool:
    """Whether a node asks if a system has one coordinate or several."""
    if isinstance(node, ast.Compare):
        sides = [node.left, *node.comparators]
        numbers = {side.value for side in sides if isinstance(side, ast.Constant)}
        return bool(numbers & {1, 2}) and any(FREEDOM.search(ast.unparse(side)) for side in sides)
    return isinstance(node, ast.Attribute) and node.attr == "several"


def is_text(node: ast.AST) -> bool:
    """Whether a statement is a docstring."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


def handles_tables(tree: ast.AST) -> bool:
    """Whether a module declares or reads tables of keys; records of results are no such tables."""
    named = (node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom))
    names = {a.name for node in named if node.module == "schema" for a in node.names}
    return bool(names & {"Table", "key", "read", "written"})


def places_of_keys() -> dict[str, set[str]]:
    """Return in which modules each key is spelled, of those that read or write tables of keys.

    A key is what a class declares by ``key`` with its meaning; names of several tables are left
    out.
    """
    readers = {m: tree for m, tree in TREES.items() if handles_tables(tree)}
    declared: dict[str, list[str]] = {}
    spelled: dict[str, set[str]] = {}
    for module, tree in readers.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.AnnAssign) and isinstance(node.value, ast.Call):
                if ast.unparse(node.value.func) == "key":
                    rules = {rule.arg: rule.value for rule in node.value.keywords}
                    name = ast.literal_eval(rules["name"]) if "name" in rules else None
                    inline = rules.get("inline")
                    names = inline.keys if isinstance(inline, ast.Dict) else []
                    if "doc" in rules or len(node.value.args) > 1:
                        name = name or ast.unparse(node.target)
                    for each in (*[name] * bool(name), *map(ast.literal_eval, names)):
                        declared.setdefault(each, []).append(module)
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                spelled.setdefault(node.value, set()).add(module)
    return {
        name: {*modules, *spelled.get(name, ())}
        for name, modules in declared.items()
        if len(modules) == 1
    }


def main() -> None:
    """Print the figures."""
    graph = {module: imported(module) & set(FILES) for module in FILES}
    found = circles(
        {m: others - {PACKAGE.name} for m, others in graph.items() if m != PACKAGE.name}
    )
    every = list(nodes())
    tests = [ast.parse(path.read_text("utf-8")) for path in sorted(ROOT.glob("tests/**/*.py"))]
    functions = [node for tree in tests for node in ast.walk(tree) if is_test(node)]
    figures = {
        "lines": sum(len(path.read_text("utf-8").splitlines()) for path in FILES.values()),
        "statements": sum(isinstance(node, ast.stmt) and not is_text(node) for node in every),
        "functions": sum(isinstance(node, ast.FunctionDef) for node in every),
        "modules": len(FILES),
        "packages": sum(path.is_dir() and path.name != "__pycache__" for path in PACKAGE.iterdir()),
        "import edges": sum(map(len, graph.values())),
        "modules in circles of imports": sum(map(len, found)),
        "places that ask for one coordinate or several": sum(map(asks_for_coordinates, every)),
        "places that look for names in kernels": sum(
            isinstance(node, ast.Attribute) and ast.unparse(node).endswith("__code__.co_names")
            for node in every
        ),
        "places per scene key": max(map(len, places_of_keys().values())),
        "functions that test": len(functions),
    }
    if "--items" in sys.argv:
        command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-m", "", "tests"]
        done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
        figures["items of tests"] = sum("::" in line for line in done.stdout.splitlines())
    for name, figure in figures.items():
        print(f"{figure:7}  {name}")
    for group in found:
        print("a circle:", *group)


def is_test(node: ast.AST) -> bool:
    """Whether a node is a function that pytest collects."""
    return isinstance(node, ast.FunctionDef) and node.name.startswith("test_")


if __name__ == "__main__":
    main()
