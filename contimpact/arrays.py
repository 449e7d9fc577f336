"""The types of arrays, what functions that run plainly and compiled work on, and LAPACK."""

from __future__ import annotations

import contextlib
import functools
import importlib.machinery
import importlib.util
import math
import sys
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, TypeAlias

import numpy as np

Array: TypeAlias = np.ndarray[Any, Any]
"""NumPy's arrays, of any shape and kind of number."""

Number: TypeAlias = Any
"""A number of some arithmetic: a float, an array of them, one with bounds, one of many digits."""

Vector: TypeAlias = Any
"""A list, tuple or array of numbers, for functions that run plainly and compiled."""

Table: TypeAlias = Any
"""A list of rows, or an array of two dimensions, for the same."""


class Containers(NamedTuple):
    """Makes what such functions work on: `LISTS` where they run plainly, `ARRAYS` compiled."""

    vector: Callable[[Iterable[float]], Vector]
    """``vector(numbers)``: of whole numbers if all are."""
    table: Callable[[int, int], Table]
    """``table(rows, columns)``: of zeros."""


def _list(numbers: Iterable[float]) -> Vector:
    return numbers.tolist() if isinstance(numbers, np.ndarray) else list(numbers)


def _list_table(rows: int, columns: int) -> Table:
    return [[0.0] * columns for _ in range(rows)]


def _array(numbers: Iterable[float]) -> Vector:
    found = np.array(numbers)
    whole = len(found) and found.dtype.kind in "iu"
    return found.astype(np.int64 if whole else float, copy=False)


def _array_table(rows: int, columns: int) -> Table:
    return np.zeros((rows, columns))


def tail(vector: Vector, place: int) -> Vector:
    """Return what a vector has from a place on; compiled code takes it that it has that place."""
    return vector[place:]


def norm(vector: Vector, scale: Vector) -> float:
    """Return the length of a vector, by natural sizes of its numbers."""
    size = 0.0
    for i in range(len(vector)):
        part = vector[i] / scale[i]
        size += part * part
    return math.sqrt(size)


LISTS = Containers(_list, _list_table)
ARRAYS = Containers(_array, _array_table)


# What a compiled program is called by: its entry, and the kinds of its arguments.

INTEGERS, VECTOR, TABLE = "i", "f", "F"
"""Kinds of arguments of an entry function: integers, floats, and a table of floats."""

ENTRY = "contimpact_entry"
"""The entry's name in machine code."""


@functools.cache
def lapack() -> Any:
    """Return SciPy's routines of LAPACK, without the rest of scipy.linalg if that can be left out.

    It imports much that nobody asks for here, which takes longer than many a branch.
    """
    name = "scipy.linalg._flapack"
    if "scipy.linalg" not in sys.modules:
        folders = [f"{folder}/linalg" for folder in importlib.import_module("scipy").__path__]
        found = importlib.machinery.PathFinder.find_spec(name, folders)
        if found is not None and found.loader is not None:
            with contextlib.suppress(ImportError):
                module = importlib.util.module_from_spec(found)
                found.loader.exec_module(module)
                sys.modules[name] = module
                return module
    return importlib.import_module("scipy.linalg.lapack")
