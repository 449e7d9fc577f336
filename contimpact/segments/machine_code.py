"""Programs of plain functions, and their machine code."""

from __future__ import annotations

import ast
import functools
import inspect
import math
import textwrap
import types
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..arrays import tail
from ..storage import temporary_beside
from ..syntax import parse
from .kernel import Family

PACKAGE = __name__.partition(".")[0]

# Programs: functions in the plain subset of Python with all they call.
#
# The subset: floats, whole numbers, tuples of them, vectors that are indexed, `math`, loops and
# branches; no lists made, nothing raised. It runs as it stands and under a compiler.


class Program:
    """An entry function and all it calls, as syntax trees; functions may be replaced by others."""

    def __init__(self, instead: Mapping[Callable[..., Any], Callable[..., Any]]) -> None:
        self.instead = instead
        self.names: dict[int, str] = {}
        self.trees: dict[str, ast.FunctionDef] = {}
        self.constants: dict[str, Any] = {"inf": math.inf, "nan": math.nan}
        """Numbers, tuples and classes of named tuples that the functions name."""
        self.origins: dict[str, str] = {}
        """The modules of the package that functions are from, and those of integrated flights;
        kernels and what is glued in are written for a model."""
        self.closed: set[str] = set()
        """Functions in closed form: long, and without loops. LLVM tries in vain, in time that grows
        with the square of their length, to compute their numbers side by side, unless told not to
        (by ``noimplicitfloat``)."""

    def add(self, function: Callable[..., Any], name: str | None = None) -> str:
        """Add a function with everything it calls; returns the name it has in the program."""
        function = self.instead.get(function, function)
        if id(function) in self.names:
            return self.names[id(function)]
        name = self._free_name(name or function.__name__)
        self.names[id(function)] = name
        if (function.__module__ or "").startswith(f"{PACKAGE}."):
            self.origins[name] = function.__module__
        if getattr(function, "family", None) is Family.CLOSED:
            self.closed.add(name)
        tree = _tree_of(function)
        tree.name = name
        known = _Names(self, _surroundings(function), {*function.__code__.co_varnames})
        self.trees[name] = known.visit(tree)
        return name

    def glue(self, text: str, **functions: Callable[..., Any]) -> None:
        """Add functions given as text; `functions` are those they call, by the name used there."""
        names = {name: self.add(function) for name, function in functions.items()}
        for tree in parse(textwrap.dedent(text)).body:
            assert isinstance(tree, ast.FunctionDef)
            assert tree.name not in self.trees, tree.name
            self.trees[tree.name] = _NameReplacer(names).visit(tree)

    def choose(
        self,
        name: str,
        arguments: str,
        chosen: str,
        functions: Mapping[str, Callable[..., Any]],
        given: str,
    ) -> None:
        """Add a function that calls one of several by number."""
        *first, last = functions
        lines = [f"def {name}({arguments}):"]
        for i, function in enumerate(first):
            lines += [f"    if {chosen} == {i}:", f"        return {function}({given})"]
        self.glue("\n".join([*lines, f"    return {last}({given})"]), **functions)

    def constant(self, name: str, value: Any) -> str:
        """Add a number, a tuple of numbers or a named tuple's class; returns its name."""
        if repr(self.constants.setdefault(name, value)) != repr(value):
            name = self._free_name(name)
            self.constants[name] = value
        return name

    @property
    def text(self) -> str:
        """The whole program as a module, to be read or run."""
        head = ["import collections", "import math", "from math import inf, nan"]
        constants = (f"{name} = {_constant_text(value)}" for name, value in self.constants.items())
        trees = (ast.unparse(ast.fix_missing_locations(tree)) for tree in self.trees.values())
        return "\n".join([*head, *constants, *trees]) + "\n"

    def _free_name(self, name: str) -> str:
        taken, number = {*self.trees, *self.constants, *self.names.values()}, 2
        free = name
        while free in taken:
            free, number = f"{name}_{number}", number + 1
        return free


def _constant_text(constant: Any) -> str:
    if isinstance(constant, type):
        return f"collections.namedtuple({constant.__name__!r}, {constant._fields!r})"  # type: ignore[attr-defined]
    return repr(constant)


def _tree_of(function: Callable[..., Any]) -> ast.FunctionDef:
    """The definition of a function, without what only people read."""
    text = getattr(function, "source", None) or _source_of(function)
    tree = next(
        node
        for node in ast.walk(parse(text))
        if isinstance(node, ast.FunctionDef)
        and (node.name == function.__code__.co_name or node.name == function.__name__)
    )
    tree.decorator_list, tree.returns = [], None
    for argument in tree.args.args:
        argument.annotation = None
    if ast.get_docstring(tree) is not None:
        tree.body = tree.body[1:]
    return tree


@functools.cache
def _source_of(function: Callable[..., Any]) -> str:
    """The text of a function of the package, which several programs may hold."""
    return textwrap.dedent(inspect.getsource(function))


def _surroundings(function: Any) -> dict[str, Any]:
    """Global names and closure variables of a function, by the name it uses."""
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    return function.__globals__ | dict(zip(function.__code__.co_freevars, cells, strict=True))


class _NameReplacer(ast.NodeTransformer):
    """Replaces names by others."""

    def __init__(self, names: Mapping[str, str]) -> None:
        self.names_for = names

    def visit_Name(self, node: ast.Name) -> ast.AST:
        return ast.Name(self.names_for.get(node.id, node.id), node.ctx)


class _Names(ast.NodeTransformer):
    """Adds what a function's names stand for to a program."""

    def __init__(self, program: Program, around: Mapping[str, Any], own: set[str]) -> None:
        self.program, self.around, self.own = program, around, own

    def visit_Name(self, node: ast.Name) -> ast.AST:
        if node.id in self.own or node.id not in self.around:
            return node
        value = self.around[node.id]
        if value is tail:
            return node
        if isinstance(value, types.FunctionType):
            return ast.Name(self.program.add(value), node.ctx)
        if isinstance(value, types.BuiltinFunctionType):  # of math
            return ast.Attribute(ast.Name("math", ast.Load()), value.__name__, ast.Load())
        if isinstance(value, int | float | tuple) or hasattr(value, "_fields"):
            return ast.Name(self.program.constant(node.id, value), node.ctx)
        return node


def object_code(module: str) -> bytes:
    """Return the machine code of LLVM's code."""
    import llvmlite.binding as llvm

    parsed = llvm.parse_assembly(module)
    parsed.verify()
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    cpu, features = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=cpu, features=features, opt=2, reloc="pic", codemodel="default"
    )
    options = llvm.create_pipeline_tuning_options(speed_level=1)
    options.slp_vectorization = True  # derivatives of a series side by side, to the same bits
    options.inlining_threshold = 0  # but for what is called once, and what `llvm_ir` marks
    options.loop_unrolling = options.loop_vectorization = False  # loops are short
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(parsed, builder)
    return bytes(machine.emit_object(parsed))


def link(paths: Sequence[Path]) -> bytes | None:
    """Return object files linked into a shared library; None if there is no linker.

    Raises OSError if the linker fails.
    """
    import shutil
    import subprocess

    linker = next((found for name in ("cc", "gcc", "clang") if (found := shutil.which(name))), None)
    if linker is None:
        return None
    folder = temporary_beside(paths[0])
    folder.mkdir(0o700)
    library = folder / "library.so"
    command = [linker, "-shared", "-o", str(library), *map(str, paths), "-lm"]
    try:
        subprocess.check_output(command, stderr=subprocess.STDOUT, timeout=PATIENCE)
        return library.read_bytes()
    except subprocess.CalledProcessError as error:
        raise OSError(error.output.decode(errors="replace").strip()) from None
    except subprocess.TimeoutExpired:
        raise OSError(f"{linker} took more than {PATIENCE} s") from None
    finally:
        shutil.rmtree(folder, ignore_errors=True)


PATIENCE = 60
"""Seconds that a linker may take."""
