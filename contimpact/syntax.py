"""Python text as a syntax tree.

CPython 3.11 counts how deep a tree is in one place for all threads of an interpreter. Where two
threads parse at once, ``ast.parse`` may raise ``SystemError: AST constructor recursion depth
mismatch`` (its issue 106905). All the package's parsing takes one lock therefore.
"""

from __future__ import annotations

import ast
import pkgutil
import threading
from collections.abc import Iterable, Iterator
from typing import Any

_LOCK = threading.RLock()


def parse(text: str | bytes) -> ast.Module:
    """Return the tree of a module's text."""
    with _LOCK:
        return ast.parse(text)


def parse_expression(text: str) -> ast.expr:
    """Return the tree of an expression."""
    with _LOCK:
        return ast.parse(text, mode="eval").body


def sources_in(folders: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield name and text of each module in folders, none of which is imported."""
    for module in pkgutil.iter_modules(folders):
        loader: Any = module.module_finder.find_spec(module.name, None).loader  # type: ignore[union-attr]
        yield module.name, loader.get_source(module.name)
