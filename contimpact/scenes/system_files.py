"""Systems of the user's own, from Python files that are named on the command line.

A scene is data and never names code: which file is run is the explicit choice of the one who gives
the command.
"""

from __future__ import annotations

import hashlib
import importlib.util
import sys
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType

from ..errors import InputError
from ..models.model import Model
from ..systems import SYSTEMS

DEFINE = "define a subclass of Model in it, with SYSTEM, PARAMETERS, WALLS and formulas"


def systems_of(files: Iterable[str]) -> dict[str, type[Model]]:
    """Run Python files, and return the systems that they define, by name.

    Each file's folder is searched for modules that it imports, after all other places.

    Raises
    ------
    InputError
        Naming the file, if it cannot be read or run, defines no system, or one of a name that is
        taken.
    """
    found: dict[str, type[Model]] = {}
    for file in dict.fromkeys(files):
        for kind in _defined(_run(Path(file)), file):
            name = kind.SYSTEM
            if name in SYSTEMS or name in found:
                of = "the package" if name in SYSTEMS else "another file or class"
                accepted = "give it another name, in the scene too"
                raise InputError(file, f"{kind.__name__}.SYSTEM is {name!r} as in {of}", accepted)
            found[name] = kind
    return found


def _run(path: Path) -> ModuleType:
    """The module that a file makes."""
    file = str(path)
    if path.suffix != ".py":
        raise InputError(file, "no Python file", "give a file that ends in .py")
    place = path.resolve()
    digest = hashlib.sha256(str(place).encode()).hexdigest()[:8]
    spec = importlib.util.spec_from_file_location(f"{path.stem}_{digest}", place)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    if str(place.parent) not in sys.path:
        sys.path.append(str(place.parent))
    try:
        spec.loader.exec_module(module)
    except InputError as error:
        raise InputError(file, f"{error.where}: {error.found}", error.accepted) from None
    except FileNotFoundError as error:
        if error.filename != str(place):
            raise InputError(file, f"it cannot be run ({error})", "mend it") from error
        raise InputError(file, "no such file", "give the file that defines the system") from None
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a file may end the program, too
        found = f"it cannot be run ({type(error).__name__}: {error}{_line(error, str(place))})"
        raise InputError(file, found, "mend it; only what it defines is needed") from error
    return module


def _line(error: BaseException, file: str) -> str:
    """The last line of a file that an error has passed, in words."""
    lines, trace = [], error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == file:
            lines.append(trace.tb_lineno)
        trace = trace.tb_next
    return f", line {lines[-1]}" if lines else ""


def _defined(module: ModuleType, file: str) -> list[type[Model]]:
    """The systems that a module defines itself."""
    found = [
        value
        for value in vars(module).values()
        if isinstance(value, type)
        and issubclass(value, Model)
        and value.__module__ == module.__name__
        and "SYSTEM" in vars(value)
    ]
    if not found:
        raise InputError(file, "it defines no system", DEFINE)
    return list(dict.fromkeys(found))
