"""Compiled code, taken from the cache or made where the work pays for it.

What is to run compiled is a `contimpact.compiling.program.Program`, which Numba (the optional
extra ``fast``) translates once, see `contimpact.compiling.machine_code`. The machine code is kept
in the cache, and later processes load it without importing Numba.

``CONTIMPACT_COMPILED`` decides: ``auto`` (the default: compile where the work pays for it),
``always`` (compile at once; Numba must be installed) or ``never``.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import math
import os
import platform
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..storage.cache import cache_folder, keep, kept, logger
from ..storage.files import reason
from .arguments import ENTRY, TABLE

if TYPE_CHECKING:
    from .program import Program

MODES = ("auto", "always", "never")
PAYS_AFTER = 1_000_000
"""Flights evaluated plainly in one process after which compiling is taken to pay: by then they
have taken about as long as compiling does."""


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


class Compiled:
    """A compiled entry function.

    Parameters
    ----------
    function
        As ctypes calls it.
    keep
        What must live as long as it.
    """

    def __init__(self, function: Any, keep: Any) -> None:
        self.function, self.keep = function, keep

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
    folder, name = cache_folder(), f"compiled-{key[:24]}"
    found = None
    if folder is not None and key not in _MISSING:
        found = _load(folder, name, arguments)
    if found is None and pays():
        found = _make(build, arguments, folder, name)
    if found is None:
        _MISSING.add(key)
    else:
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


def used() -> int:
    """Return how many compiled programs this process has loaded."""
    return len(_LOADED)


def spend(flights: int) -> None:
    """Note flights that were evaluated plainly."""
    _SPENT[0] += flights


_SPENT = [0.0]


def _make(
    build: Callable[[], Program], arguments: str, folder: Path | None, name: str
) -> Compiled | None:  # fmt: skip
    """Compile a program, and put its machine code into the cache if that can be written."""
    import tempfile
    import time

    from .machine_code import object_code

    began = time.perf_counter()
    logger(__name__).info("compiling %s", name)
    try:
        machine_code = object_code(build(), arguments)
    except Exception as error:  # of whatever kind: what runs plainly must not end because of it
        if mode() == "always":
            raise
        why = "nothing is compiled in this process: %s: %s"
        logger(__name__).warning(why, type(error).__name__, error)
        _SPENT[0] = -math.inf
        return None
    logger(__name__).info("compiled %s in %.1f s", name, time.perf_counter() - began)
    if folder is not None:
        try:
            put_whole(folder / f"{name}.o", machine_code)
        except OSError as error:
            logger(__name__).warning("compiled code is not cached: %s", error)
        else:
            return _load(folder, name, arguments)
    with tempfile.TemporaryDirectory(prefix="contimpact-", ignore_cleanup_errors=True) as place:
        put_whole(Path(place) / f"{name}.o", machine_code)
        return _load(Path(place), name, arguments)


_LOADED: dict[str, Compiled] = {}
_MISSING: set[str] = set()


@functools.cache
def _machine() -> tuple[str, ...]:
    """What machine code depends on besides the program: the package, machine and processor."""
    return _own_files(), sys.platform, platform.machine(), _processor()


def _own_files() -> str:
    """Digest of the package's own files, of which programs are made."""
    digest = hashlib.sha256()
    for file in sorted(Path(__file__).parent.parent.rglob("*.py")):
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


def _load(folder: Path, name: str, arguments: Sequence[str]) -> Compiled | None:
    """Load machine code from the cache: a shared library, or an object file through LLVM."""
    import ctypes

    kinds = [
        kind
        for argument in arguments
        for kind in (ctypes.c_void_p, *[ctypes.c_int64] * (2 if argument == TABLE else 1))
    ]
    library, machine_code = folder / f"{name}.so", folder / f"{name}.o"
    if _whole(machine_code) and not _whole(library):
        _link(machine_code, library)
    if _whole(library):
        try:
            loaded = ctypes.CDLL(str(library))
            function = getattr(loaded, ENTRY)
        except (OSError, AttributeError) as error:
            logger(__name__).warning("compiled code %s cannot be loaded: %s", library, error)
        else:
            function.argtypes, function.restype = kinds, ctypes.c_int64
            return Compiled(function, loaded)
    if importlib.util.find_spec("llvmlite") is None or not _whole(machine_code):
        return None
    return _by_llvm(machine_code, kinds)


def _link(machine_code: Path, library: Path) -> None:
    """Make a shared library, where the machine has a linker."""
    from .machine_code import linked

    try:
        content = linked(machine_code)
        if content is not None:
            put_whole(library, content)
    except OSError as error:
        logger(__name__).info("%s is not made: %s", library, error)


def put_whole(path: Path, content: bytes) -> None:
    """Put a file and its digest down."""
    keep(path, content)
    keep(_digest_beside(path), _digest(path, content))


def _digest_beside(path: Path) -> Path:
    """The file that holds the digest of a file of machine code."""
    return path.with_name(f"{path.name}.sha256")


def _digest(path: Path, content: bytes) -> bytes:
    """Digest of a file and its name: one that has got another's name does not fit."""
    return hashlib.sha256(path.name.encode() + b"\0" + content).hexdigest().encode()


def _whole(path: Path) -> bool:
    """Whether a file is there and is what this user wrote; loading a damaged one could crash."""
    try:
        expected, found = kept(_digest_beside(path)), _digest(path, kept(path))
    except FileNotFoundError:
        return False
    except OSError as error:
        logger(__name__).warning("compiled code %s is not used: %s", path, reason(error))
        return False
    if found != expected:
        logger(__name__).warning("compiled code %s is damaged and not used", path)
    return found == expected


def _by_llvm(path: Path, kinds: Sequence[Any]) -> Compiled:
    """Load an object file without a linker."""
    import ctypes

    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_path(str(path)))
    engine.finalize_object()
    address = engine.get_function_address(ENTRY)
    return Compiled(ctypes.CFUNCTYPE(ctypes.c_int64, *kinds)(address), engine)
