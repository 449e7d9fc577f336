"""Programs of plain functions as one text, and their machine code."""

from __future__ import annotations

import ast
import contextlib
import inspect
import re
import textwrap
import types
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ..arrays import ENTRY, INTEGERS, TABLE, VECTOR
from ..storage.files import temporary_beside

# Programs: functions in the plain subset of Python with all they call, as one text.
#
# The subset: floats, whole numbers, tuples of them, vectors that are indexed, `math`, loops and
# branches; no lists made, nothing raised. It runs as it stands and under a compiler.


class Program:
    """The text of an entry function and of all it calls.

    Parameters
    ----------
    instead : mapping of function to function
        Functions that others stand for.
    """

    def __init__(self, instead: Mapping[Callable[..., Any], Callable[..., Any]]) -> None:
        self.instead = instead
        self.names: dict[int, str] = {}
        self.parts: dict[str, str] = {}

    def add(self, function: Callable[..., Any], name: str | None = None) -> str:
        """Add a function with everything it calls; returns the name it has in the text."""
        function = self.instead.get(function, function)
        if id(function) in self.names:
            return self.names[id(function)]
        name = self._free_name(name or function.__name__)
        self.names[id(function)] = name
        tree = _tree_of(function)
        tree.name = name
        known = _Names(self, _surroundings(function), _locals_of(tree))
        self._put(name, known.visit(tree))
        return name

    def glue(self, text: str, **functions: Callable[..., Any]) -> None:
        """Add functions given as text; `functions` are those they call, by the name used there."""
        names = {name: self.add(function) for name, function in functions.items()}
        for tree in ast.parse(textwrap.dedent(text)).body:
            assert isinstance(tree, ast.FunctionDef)
            assert tree.name not in self.parts, tree.name
            self._put(tree.name, _NameReplacer(names).visit(tree))

    def constant(self, name: str, value: Any) -> str:
        """Add a number, a tuple of numbers or a named tuple's class; returns its name."""
        if isinstance(value, type):
            text = f"{name} = collections.namedtuple({name!r}, {value._fields!r})"  # type: ignore[attr-defined]
        else:
            text = f"{name} = {value!r}"
        if self.parts.get(name, text) != text:
            name = self._free_name(name)
            text = f"{name} ={text.partition('=')[2]}"
        self.parts[name] = text
        return name

    @property
    def text(self) -> str:
        """The whole module."""
        head = "import collections\nimport math\nfrom math import inf, nan\n\n"
        return head + "\n\n".join(self.parts.values()) + "\n"

    def _put(self, name: str, tree: ast.AST) -> None:
        self.parts[name] = f"@compile\n{ast.unparse(ast.fix_missing_locations(tree))}"

    def _free_name(self, name: str) -> str:
        taken, number = {*self.parts, *self.names.values()}, 2
        free = name
        while free in taken:
            free, number = f"{name}_{number}", number + 1
        return free


def _tree_of(function: Callable[..., Any]) -> ast.FunctionDef:
    """The definition of a function, without what only people read."""
    text = getattr(function, "source", None) or textwrap.dedent(inspect.getsource(function))
    tree = next(
        node
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.FunctionDef)
        and (node.name == function.__code__.co_name or node.name == function.__name__)
    )
    tree.decorator_list, tree.returns = [], None
    for argument in tree.args.args:
        argument.annotation = None
    if ast.get_docstring(tree) is not None:
        tree.body = tree.body[1:]
    return tree


def _surroundings(function: Any) -> dict[str, Any]:
    """Global names and closure variables of a function, by the name it uses."""
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    return function.__globals__ | dict(zip(function.__code__.co_freevars, cells, strict=True))


def _locals_of(tree: ast.FunctionDef) -> set[str]:
    names = (node for node in ast.walk(tree) if isinstance(node, ast.Name))
    stored = {name.id for name in names if isinstance(name.ctx, ast.Store)}
    return stored | {argument.arg for argument in tree.args.args}


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
        if isinstance(value, types.FunctionType):
            return ast.Name(self.program.add(value), node.ctx)
        if isinstance(value, types.BuiltinFunctionType):  # of math
            return ast.Attribute(ast.Name("math", ast.Load()), value.__name__, ast.Load())
        if isinstance(value, int | float | tuple) or hasattr(value, "_fields"):
            return ast.Name(self.program.constant(node.id, value), node.ctx)
        return node


def object_code(program: Program, arguments: str) -> bytes:
    """Return the machine code of a program whose entry is the function ``entry``.

    Parameters
    ----------
    arguments : str
        Kinds of the entry's arguments.
    """
    import llvmlite.binding as llvm
    from numba import carray, cfunc, njit
    from numba import types as nb

    plain = njit(error_model="numpy", fastmath=False)
    namespace: dict[str, Any] = {"compile": plain, "carray": carray}
    pointers = {INTEGERS: (nb.int64, 1), VECTOR: (nb.float64, 1), TABLE: (nb.float64, 2)}
    signature, names, views = [], [], []
    for i, kind in enumerate(arguments):
        number, dimensions = pointers[kind]
        sizes = [f"n{i}_{d}" for d in range(dimensions)]
        signature += [nb.CPointer(number), *[nb.int64] * dimensions]
        names += [f"p{i}", *sizes]
        views.append(f"carray(p{i}, ({', '.join(sizes)},))")
    head, body = f"def _c_entry({', '.join(names)}):", f"return entry({', '.join(views)})"
    text = f"{program.text}\n\n{head}\n    {body}\n"
    exec(compile(text, "<contimpact program>", "exec"), namespace)
    with _defer_optimisation():
        entry = cfunc(nb.int64(*signature), error_model="numpy")(namespace["_c_entry"])
    text = _self_contained(entry.inspect_llvm(), entry.native_name)
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    cpu, features = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=cpu, features=features, opt=3, reloc="pic", codemodel="default"
    )
    module = llvm.parse_assembly(text)
    module.verify()
    _optimise(module, machine)
    return bytes(machine.emit_object(module))


@contextlib.contextmanager
def _defer_optimisation() -> Iterator[None]:
    """Let Numba leave functions as they are, one by one: the whole is optimised at the end.

    That takes a third off the time of compiling. Numba's own compilers, which other functions of
    the process have, are made before.
    """
    import llvmlite.binding as llvm
    from numba.core import config as stated
    from numba.core.registry import cpu_target

    config: Any = stated
    given = config.OPT
    if not hasattr(llvm, "create_pass_builder") or not hasattr(cpu_target, "target_context"):
        yield
        return
    config.OPT = type(given)(0)
    try:
        yield
    finally:
        config.OPT = given


OF_THE_C_LIBRARY = frozenset(
    """acos asin atan atan2 ceil copysign cos cosh exp fabs floor fmod log memcpy memset pow sin
    sinh sqrt tan tanh""".split()
)
REPORTING = frozenset(
    """NRT_Free NRT_MemInfo_call_dtor PyBytes_FromStringAndSize PyErr_Clear PyErr_SetNone
    PyErr_SetString PyErr_WriteUnraisable PyUnicode_FromString Py_DecRef numba_do_raise
    numba_gil_ensure numba_gil_release numba_runtime_build_excinfo_struct numba_unpickle""".split()
)
"""Functions that Numba calls only to report an exception and to clean up after it."""


def _optimise(module: Any, machine: Any) -> None:
    """Once more, without what Numba puts between the functions; older LLVMs do without."""
    import llvmlite.binding as llvm

    if not hasattr(llvm, "create_pass_builder"):
        return
    for function in module.functions:
        if not function.is_declaration and function.name != ENTRY:
            function.linkage = "internal"
    builder = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=3))
    builder.getModulePassManager().run(module, builder)


COUNTING = re.compile(r"\s*(tail )?call void @NRT_(inc|dec)ref\(")
"""Counts references to arrays, which are the caller's: there is nothing to count."""


def _self_contained(text: str, entry: str) -> str:
    """Make Numba's intermediate code independent of Numba's own library and of Python's.

    What is called there only reports exceptions, which compiled programs do not raise: their
    functions are written so that a failure is a value. Those calls are made to do nothing.

    Raises NotImplementedError if anything else is called: a call that did nothing could be one that
    computes.
    """
    text = re.sub(rf'@"?{re.escape(entry)}"?', f"@{ENTRY}", text)
    lines = []
    for line in text.splitlines():
        if COUNTING.match(line):
            continue
        declared = re.match(r'declare (.*?)@"?([\w.$]+)"?\((.*?)\)', line)
        known = declared and (declared[2].startswith("llvm.") or declared[2] in OF_THE_C_LIBRARY)
        if declared and not known:
            _require(declared[2] in REPORTING, declared[2])
            line = _stub(declared[1], declared[2], declared[3])
        outside = re.match(r'@"?([\w.$]+)"? = external (?:local_unnamed_addr )?global (\S+)', line)
        if outside:
            _require(outside[1].startswith("PyExc_"), outside[1])
            line = f"@{outside[1]} = internal global {outside[2]} zeroinitializer"
        lines.append(line)
    return "\n".join(lines)


def _require(known: bool, name: str) -> None:
    if not known:
        raise NotImplementedError(
            f"Numba needs {name!r}, which contimpact does not know; another version of Numba may "
            "not, and CONTIMPACT_COMPILED=never runs plainly"
        )


def _stub(kind: str, name: str, arguments: str) -> str:
    """A function that does nothing."""
    returned = kind.split()[-1]
    kinds = [re.sub(r"( \w+(\(.*?\))?)+$", "", a.strip()) for a in arguments.split(",")]
    result = {"void": "void", "ptr": "ptr null"}.get(returned, f"{returned} 0")
    return f"define internal {returned} @{name}({', '.join(kinds)}) {{ ret {result} }}"


def link(path: Path) -> bytes | None:
    """Return an object file linked into a shared library; None if there is no linker.

    Raises OSError if the linker fails.
    """
    import shutil
    import subprocess

    linker = next((found for name in ("cc", "gcc", "clang") if (found := shutil.which(name))), None)
    if linker is None:
        return None
    folder = temporary_beside(path)
    folder.mkdir(0o700)
    library = folder / "library.so"
    command = [linker, "-shared", "-o", str(library), str(path), "-lm"]
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
