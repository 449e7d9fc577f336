"""Compiled code: functions in the plain subset of Python, translated by Numba, cached on disk.

A `Program` is the text of an entry function and of everything it calls, gathered into one module:
the package's own functions as they stand, kernels, and the glue between them. Numba (the optional
extra ``fast``) compiles it once. The machine code is kept beside the kernels, under a hash of the
text, and later processes load it without importing Numba.

``CONTIMPACT_COMPILED`` decides: ``auto`` (the default: compile where the work pays for it),
``always`` (compile at once; Numba must be installed) or ``never``.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import importlib.util
import inspect
import logging
import math
import os
import platform
import re
import sys
import tempfile
import textwrap
import types
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .errors import InputError
from .mechanics.kernels import cache_folder

log = logging.getLogger(__name__)

MODES = ("auto", "always", "never")
PAYS_AFTER = 300_000
"""Flights evaluated plainly in one process after which compiling is taken to pay (seconds)."""

INTEGERS, VECTOR, TABLE = "i", "f", "F"
"""Kinds of arguments of an entry function: integers, floats, and a table of floats."""


def mode() -> str:
    """Return what ``CONTIMPACT_COMPILED`` says.

    Raises
    ------
    InputError
        If it says anything unknown.
    """
    said = os.environ.get("CONTIMPACT_COMPILED") or "auto"
    if said not in MODES:
        raise InputError("CONTIMPACT_COMPILED", f"found {said!r}", f"give {', '.join(MODES)}")
    return said


def available() -> bool:
    """Whether Numba is installed; it is not imported."""
    return importlib.util.find_spec("numba") is not None


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
            self._put(tree.name, _Renamed(names).visit(tree))

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
    stored = {n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)}
    return stored | {argument.arg for argument in tree.args.args}


class _Renamed(ast.NodeTransformer):
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


class Compiled:
    """A compiled entry function.

    Parameters
    ----------
    function
        What ctypes or LLVM loaded.
    arguments : sequence of str
        Kinds of its arguments.
    """

    def __init__(self, function: Any, arguments: Sequence[str], keep: Any = None) -> None:
        self.function, self.arguments, self.keep = function, arguments, keep

    def __call__(self, *arrays: Any) -> int:
        """Run on arrays: int64 or float64, contiguous, one for each argument."""
        numbers: list[int] = []
        for array in arrays:
            numbers += [array.ctypes.data, *array.shape]
        return int(self.function(*numbers))


def compiled(
    identity: Sequence[str], arguments: str, build: Callable[[], Program]
) -> Compiled | None:
    """Return an entry function compiled, from the cache if it is there.

    Parameters
    ----------
    identity : sequence of str
        What the program's text depends on besides the package's own files.
    arguments : str
        Kinds of the entry's arguments.
    build : callable
        Makes the program, whose entry is the function ``entry``.

    Returns
    -------
    Compiled or None
        None where it is not in the cache and compiling it does not (yet) pay.
    """
    key = hashlib.sha256("\0".join((*identity, arguments, *_machine())).encode()).hexdigest()
    if key in _LOADED:
        return _LOADED[key]
    folder = cache_folder()
    name = f"compiled-{key[:24]}"
    found = _load(folder, name, arguments) if folder else None
    if found is None and pays():
        found = _compile(build(), arguments, folder or Path(tempfile.mkdtemp()), name)
    if found is not None:
        _LOADED[key] = found
    return found


def pays() -> bool:
    """Whether to compile what is not in the cache.

    Raises
    ------
    InputError
        If it is to be compiled always, but Numba is not installed.
    """
    if mode() == "always" and not available():
        raise InputError(
            "CONTIMPACT_COMPILED", "always, but Numba is not installed",
            "install contimpact[fast], or say auto or never",
        )  # fmt: skip
    return mode() == "always" or (_SPENT[0] >= PAYS_AFTER and available())


def spend(flights: int) -> None:
    """Note flights that were evaluated plainly."""
    _SPENT[0] += flights


_SPENT = [0]
_LOADED: dict[str, Compiled] = {}


@functools.cache
def _machine() -> tuple[str, ...]:
    """What machine code depends on besides the program: the package, machine and processor."""
    return _own_files(), sys.platform, platform.machine(), _processor()


def _own_files() -> str:
    """Digest of the package's own files, of which programs are made."""
    here = Path(__file__).parent
    files = [f for part in (".", "continuation", "mechanics") for f in (here / part).glob("*.py")]
    digest = hashlib.sha256()
    for file in sorted(files):
        digest.update(file.read_bytes())
    return digest.hexdigest()


def _processor() -> str:
    """The processor's model and features as the system tells them."""
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return platform.processor()
    lines = [line for line in text.splitlines() if line.startswith(("model name", "flags"))]
    return "\n".join(lines[:2])


def _compile(program: Program, arguments: str, folder: Path, name: str) -> Compiled | None:
    """Compile a program and put its machine code into the cache."""
    import time

    began = time.perf_counter()
    log.info("compiling %s", name)
    machine_code = _object_code(program, arguments)
    path = folder / f"{name}.o"
    _put(path, machine_code)
    _link(path)
    log.info("compiled %s in %.1f s", name, time.perf_counter() - began)
    return _load(folder, name, arguments)


def _put(path: Path, content: bytes) -> None:
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=path.stem, suffix=".tmp")
    with os.fdopen(handle, "wb") as file:
        file.write(content)
    os.replace(temporary, path)


def _object_code(program: Program, arguments: str) -> bytes:
    """Numba's machine code of a program, independent of Numba and of Python."""
    import llvmlite.binding as llvm
    from numba import carray, cfunc, njit, types as nb

    namespace: dict[str, Any] = {
        "compile": njit(error_model="numpy", fastmath=False), "carray": carray
    }  # fmt: skip
    pointers = {INTEGERS: (nb.int64, 1), VECTOR: (nb.float64, 1), TABLE: (nb.float64, 2)}
    signature, names, views = [], [], []
    for i, kind in enumerate(arguments):
        number, dimensions = pointers[kind]
        sizes = [f"n{i}_{d}" for d in range(dimensions)]
        signature += [nb.CPointer(number), *[nb.int64] * dimensions]
        names += [f"p{i}", *sizes]
        views.append(f"carray(p{i}, ({', '.join(sizes)},))")
    text = f"{program.text}\n\ndef _c_entry({', '.join(names)}):\n    return entry({', '.join(views)})\n"
    exec(compile(text, "<contimpact program>", "exec"), namespace)
    entry = cfunc(nb.int64(*signature), error_model="numpy")(namespace["_c_entry"])
    text = _self_contained(entry.inspect_llvm(), entry.native_name)
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=llvm.get_host_cpu_name(), features=llvm.get_host_cpu_features().flatten(), opt=3,
        reloc="pic", codemodel="default",
    )  # fmt: skip
    module = llvm.parse_assembly(text)
    module.verify()
    return bytes(machine.emit_object(module))


_ENTRY = "contimpact_entry"
_OF_THE_C_LIBRARY = frozenset(
    "acos asin atan atan2 ceil copysign cos cosh exp expm1 fabs floor fmod hypot ldexp log log1p "
    "memcpy memset pow sin sinh sqrt tan tanh".split()
)  # fmt: skip


def _self_contained(text: str, entry: str) -> str:
    """Make Numba's intermediate code independent of Numba's own library and of Python's.

    What is called there only reports exceptions, which compiled programs do not raise: their
    functions are written so that a failure is a value.
    """
    text = re.sub(rf'@"?{re.escape(entry)}"?', f"@{_ENTRY}", text)
    lines = []
    for line in text.splitlines():
        declared = re.match(r'declare (.*?)@"?([\w.$]+)"?\((.*?)\)', line)
        if declared and not declared[2].startswith("llvm.") and declared[2] not in _OF_THE_C_LIBRARY:
            line = _stub(declared[1], declared[2], declared[3])
        line = re.sub(r"^(@\S+ = )external( local_unnamed_addr)? global (\S+).*",
                      r"\1internal global \3 zeroinitializer", line)  # fmt: skip
        lines.append(line)
    return "\n".join(lines)


def _stub(kind: str, name: str, arguments: str) -> str:
    """A function that does nothing."""
    returned = kind.split()[-1]
    types_only = ", ".join(re.sub(r"( \w+(\(.*?\))?)+$", "", a.strip()) for a in arguments.split(","))
    result = {"void": "void", "ptr": "ptr null"}.get(returned, f"{returned} 0")
    return f"define internal {returned} @{name}({types_only}) {{ ret {result} }}"


def _link(path: Path) -> None:
    """Make a shared library of machine code, where the machine has a linker."""
    import shutil
    import subprocess

    linker = next((found for name in ("cc", "gcc", "clang") if (found := shutil.which(name))), None)
    if linker is None:
        return
    library = path.with_suffix(".so")
    temporary = library.with_suffix(f".{os.getpid()}.tmp")
    done = subprocess.run(
        [linker, "-shared", "-o", temporary, path, "-lm"], capture_output=True, check=False
    )
    if done.returncode == 0:
        os.replace(temporary, library)
    else:
        temporary.unlink(missing_ok=True)
        log.info("not linked: %s", done.stderr.decode(errors="replace").strip())


def _load(folder: Path, name: str, arguments: Sequence[str]) -> Compiled | None:
    """Load machine code from the cache: a shared library, or an object file through LLVM."""
    import ctypes

    kinds = [
        kind
        for argument in arguments
        for kind in (ctypes.c_void_p, *[ctypes.c_int64] * (2 if argument == TABLE else 1))
    ]
    library, machine_code = folder / f"{name}.so", folder / f"{name}.o"
    if library.exists():
        try:
            loaded = ctypes.CDLL(str(library))
            function = getattr(loaded, _ENTRY)
        except (OSError, AttributeError) as error:
            log.warning("compiled code %s cannot be loaded: %s", library, error)
        else:
            function.argtypes, function.restype = kinds, ctypes.c_int64
            return Compiled(function, arguments, loaded)
    if not machine_code.exists() or importlib.util.find_spec("llvmlite") is None:
        return None
    return _by_llvm(machine_code, kinds, arguments)


def _by_llvm(path: Path, kinds: Sequence[Any], arguments: Sequence[str]) -> Compiled:
    import ctypes

    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_path(str(path)))
    engine.finalize_object()
    address = engine.get_function_address(_ENTRY)
    return Compiled(ctypes.CFUNCTYPE(ctypes.c_int64, *kinds)(address), arguments, engine)
