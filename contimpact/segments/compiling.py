"""The library of compiled programs: loaded from the cache, or compiled where that pays.

llvmlite (the optional extra ``fast``) compiles a `machine_code.Program` once. The machine code is
kept in the cache; later processes load it without importing it.

``CONTIMPACT_COMPILED`` decides: ``auto`` (the default: compile where the work pays for it),
``always`` (compile at once; llvmlite must be installed) or ``never``. The time that plain Python
took is kept in the cache, too, so that what is run again and again is compiled.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import hashlib
import importlib.util
import math
import os
import platform
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..arrays import ENTRY, TABLE
from ..errors import InputError
from ..storage import (
    cache_folder,
    is_intact,
    load_file,
    logger,
    processor,
    put_with_digest,
    store_file,
    warn_uncached,
)

if TYPE_CHECKING:
    from .machine_code import Program

MODES = ("auto", "always", "never")
PAYS_AFTER = 0.5
"""Seconds of processor time that plain Python has taken for what a program does, in this process
and earlier ones, after which compiling it pays: what took so long once is often run again."""
PAYS_SOON = 0.1
"""The same where such a program has been compiled for another model, so that a model's own modules
are all that is made: that takes some tenths of a second, and later runs are spared them."""
WORTH_KEEPING = 0.02
"""Seconds of one process from which on they are kept for later ones."""


def mode() -> str:
    """Return the value of ``CONTIMPACT_COMPILED``.

    Raises InputError if it is not one of `MODES`.
    """
    found = os.environ.get("CONTIMPACT_COMPILED") or "auto"
    if found not in MODES:
        raise InputError("CONTIMPACT_COMPILED", f"found {found!r}", f"give {', '.join(MODES)}")
    return found


def available() -> bool:
    """Whether llvmlite is installed; it is not imported."""
    return importlib.util.find_spec("llvmlite") is not None


class CompiledProgram:
    """A compiled entry function, called through ctypes; `keep` must live as long as it does."""

    def __init__(self, function: Any, keep: Any) -> None:
        self.function, self.keep = function, keep

    def __call__(self, *arrays: Any, known: Sequence[int] = ()) -> int:
        """Run on arrays: int64 or float64, contiguous, one for each argument.

        `known` are the `addresses` of arguments before these, which took longer to look up than
        to be used.
        """
        return int(self.function(*known, *addresses(arrays)))


def addresses(arrays: Iterable[Any]) -> list[int]:
    """Return where arrays begin, and their sizes, as compiled code takes them."""
    numbers: list[int] = []
    for array in arrays:
        numbers += [array.__array_interface__["data"][0], *array.shape]
    return numbers


def load(
    identity: tuple[str, ...],
    arguments: str,
    build: Callable[[], Program],
    after: float | None = None,
) -> CompiledProgram | None:
    """Load a program from the cache, or compile it if that pays.

    Parameters
    ----------
    identity : tuple of str
        What the program's text depends on besides the package's own files.
    arguments : str
        Kinds of the entry's arguments.
    build : callable
        Returns the program, whose entry is the function ``entry``.
    after : float, optional
        Seconds after which it pays; `PAYS_AFTER` or `PAYS_SOON` unless given.

    Returns
    -------
    CompiledProgram or None
        None if it is not in the cache and compiling it does not (yet) pay.
    """
    key = (*identity, arguments)
    if key in _LOADED:
        return _LOADED[key]
    if after is None:
        known = _are_known(arguments, os.environ.get("CONTIMPACT_CACHE"))
        after = PAYS_SOON if known else PAYS_AFTER
    pays = compiling_pays(identity, after)
    if key in _MISSING and not pays:
        return None
    folder, name = cache_folder(), f"compiled-{_digest(*key, *_machine())}"
    found = None
    if folder is not None and key not in _MISSING:
        found = _load_cached(folder, name, arguments)
        if found is None and not pays and available():
            _recall_plain_time(identity, folder)
            pays = compiling_pays(identity, after)
    if found is None and pays:
        found = _compile_program(build, arguments, folder, name)
    if found is None:
        _MISSING.add(key)
    else:
        _LOADED[key] = found
    return found


def compiling_pays(identity: tuple[str, ...], after: float = PAYS_AFTER) -> bool:
    """Whether to compile a program that is not in the cache.

    Raises InputError if the mode is ``always`` and llvmlite is not installed.
    """
    if mode() == "always" and not available():
        found = "always, but llvmlite is not installed"
        accepted = "install contimpact[fast], or say auto or never"
        raise InputError("CONTIMPACT_COMPILED", found, accepted)
    return mode() == "always" or (_EXPECTED[0] + _SPENT[identity] >= after and available())


@functools.cache
def _are_known(arguments: str, cache: str | None) -> bool:
    """Whether a program with such arguments, and with it the modules that programs for other models
    share with it, is in the cache of this name."""
    folder = cache_folder()
    return folder is not None and _mark(folder, arguments).exists()


def _mark(folder: Path, arguments: str) -> Path:
    """The file that says that a program with such arguments is in a cache."""
    return folder / f"kind-{_digest(arguments, *_machine())}.txt"


def _digest(*texts: str) -> str:
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()[:24]


def cores() -> int:
    """Return the number of cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def count_loaded() -> int:
    """Return how many compiled programs this process has loaded."""
    return len(_LOADED)


def note_uncompiled(why: str) -> None:
    """Note what cannot be compiled, for the manifest and, once, the log."""
    if mode() != "never" and why not in _PLAINLY:
        _PLAINLY[why] = None
        logger(__name__).info("not compiled: %s", why)


def ran_plainly() -> list[str]:
    """Return what this process could not have compiled."""
    return list(_PLAINLY)


@contextlib.contextmanager
def timed_plainly(identity: tuple[str, ...]) -> Iterator[None]:
    """Count the processor time of what a compiled program would have done."""
    began = time.thread_time()
    try:
        yield
    finally:
        _SPENT[identity] += time.thread_time() - began


def expect_plain_time(seconds: float) -> None:
    """Count what plain Python would yet take, for every program."""
    _EXPECTED[0] += seconds


def _recall_plain_time(identity: tuple[str, ...], folder: Path) -> None:
    """Count what earlier processes have taken for what a program does."""
    if identity in _KEPT:
        return
    path, seconds = folder / f"plain-{_digest(*identity, *_machine())}.txt", 0.0
    with contextlib.suppress(OSError, ValueError):
        found = float(load_file(path))
        seconds = found if 0.0 < found < math.inf else 0.0
    _KEPT[identity] = path, seconds
    _SPENT[identity] += seconds


@atexit.register
def keep_plain_time() -> None:
    """Keep the time plain Python has taken for later processes, if the cache can be written.

    Of processes that end at once, the last one's is kept. Where compiling has failed none is, so
    that it is not tried in every process.
    """
    for identity, (path, seconds) in _KEPT.items():
        spent = _SPENT[identity] if _EXPECTED[0] >= 0.0 else 0.0
        if abs(spent - seconds) >= WORTH_KEEPING:
            with contextlib.suppress(OSError):
                store_file(path, f"{spent:.3f}\n".encode())


_SPENT: defaultdict[tuple[str, ...], float] = defaultdict(float)
_KEPT: dict[tuple[str, ...], tuple[Path, float]] = {}
"""Where the time spent for a program is kept, and how much was, of programs not in the cache."""
_EXPECTED = [0.0]
_PLAINLY: dict[str, None] = {}


def _compile_program(
    build: Callable[[], Program], arguments: str, folder: Path | None, name: str
) -> CompiledProgram | None:
    """Compile a program, and store its machine code in the cache if that can be written."""
    import tempfile

    began = time.perf_counter()
    logger(__name__).info("compiling %s", name)
    try:
        program = build()
        if folder is not None:
            try:
                _compile_parts(program, arguments, folder, name)
            except OSError as error:
                warn_uncached(folder, error)
                folder = None
        with contextlib.ExitStack() as stack:
            if folder is None:
                temporary = tempfile.TemporaryDirectory(
                    prefix="contimpact-", ignore_cleanup_errors=True
                )
                folder = Path(stack.enter_context(temporary))
                _compile_parts(program, arguments, folder, name)
            found = _load_cached(folder, name, arguments)
    except Exception as error:  # of whatever kind: what runs plainly must not end because of it
        if mode() == "always":
            raise
        why = "nothing is compiled in this process: %s: %s"
        logger(__name__).warning(why, type(error).__name__, error)
        _EXPECTED[0] = -math.inf
        return None
    logger(__name__).info("compiled %s in %.1f s", name, time.perf_counter() - began)
    return found


def _compile_parts(program: Program, arguments: str, folder: Path, name: str) -> None:
    """Store the machine code of a program's modules, and which they are; that of a module which
    another program has, too, is there already."""
    from .llvm_ir import Translation
    from .machine_code import object_code

    parts = []
    for module in Translation(program).modules(arguments):
        parts.append(f"part-{_digest(module, *_compiler())}.o")
        if not is_intact(folder / parts[-1]):
            put_with_digest(folder / parts[-1], object_code(module))
    put_with_digest(folder / f"{name}.parts", "\n".join(parts).encode())
    store_file(_mark(folder, arguments), b"")
    _are_known.cache_clear()


_LOADED: dict[tuple[str, ...], CompiledProgram] = {}
_MISSING: set[tuple[str, ...]] = set()


@functools.cache
def _machine() -> tuple[str, ...]:
    """What machine code depends on besides the program: package, system and processor."""
    return _own_files(), sys.platform, platform.machine(), processor()


@functools.cache
def _compiler() -> tuple[str, ...]:
    """What the machine code of a module depends on besides its text: how LLVM is called, and for
    which system and processor."""
    from importlib.metadata import version

    caller = (Path(__file__).parent / "machine_code.py").read_text()
    return caller, version("llvmlite"), *_machine()[1:]


def _own_files() -> str:
    """Digest of the package's source files, from which programs are made."""
    digest = hashlib.sha256()
    for file in sorted(Path(__file__).parent.parent.rglob("*.py")):
        with file.open("rb", buffering=0) as source:  # a third of the time of `read_bytes`
            digest.update(source.read())
    return digest.hexdigest()


def _load_cached(folder: Path, name: str, arguments: Sequence[str]) -> CompiledProgram | None:
    """Load machine code from the cache: a shared library, or object files through LLVM."""
    import ctypes

    kinds = [
        kind
        for argument in arguments
        for kind in (ctypes.c_void_p, *[ctypes.c_int64] * (2 if argument == TABLE else 1))
    ]
    library, parts = folder / f"{name}.so", list[Path]()
    if not is_intact(library):
        parts = _parts_of(folder, name)
        if not parts:
            return None
        _link(parts, library)
    if is_intact(library):
        try:
            loaded = ctypes.CDLL(str(library))
            function = getattr(loaded, ENTRY)
        except (OSError, AttributeError) as error:
            logger(__name__).warning("compiled code %s cannot be loaded: %s", library, error)
        else:
            function.argtypes, function.restype = kinds, ctypes.c_int64
            return CompiledProgram(function, loaded)
    if importlib.util.find_spec("llvmlite") is None:
        return None
    parts = parts or _parts_of(folder, name)
    return _load_by_llvm(parts, kinds) if parts else None


def _parts_of(folder: Path, name: str) -> list[Path]:
    """The object files of a program; none if one of them is not there as it was written."""
    listed = folder / f"{name}.parts"
    if not is_intact(listed):
        return []
    parts = [folder / part for part in load_file(listed).decode().split()]
    return parts if all(map(is_intact, parts)) else []


def _link(parts: Sequence[Path], library: Path) -> None:
    """Make a shared library if the machine has a linker."""
    from .machine_code import link

    try:
        content = link(parts)
        if content is not None:
            put_with_digest(library, content)
    except OSError as error:
        logger(__name__).info("%s is not made: %s", library, error)


def _load_by_llvm(parts: Sequence[Path], kinds: Sequence[Any]) -> CompiledProgram:
    """Load object files without a linker."""
    import ctypes

    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    for part in parts:
        engine.add_object_file(llvm.ObjectFileRef.from_path(str(part)))
    engine.finalize_object()
    address = engine.get_function_address(ENTRY)
    return CompiledProgram(ctypes.CFUNCTYPE(ctypes.c_int64, *kinds)(address), engine)
