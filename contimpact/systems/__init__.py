"""The systems that come with the package, one file each, and those that plugins offer."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterable, Mapping
from typing import Any

from ..errors import InputError, did_you_mean, explain_arguments, short_repr
from ..models.model import Model
from ..syntax import sources_in

_SYSTEM = re.compile(r'^class (\w+)\((?:.|\n(?!class ))*?\n    SYSTEM = "(.+)"', re.MULTILINE)


def systems_in(folders: Iterable[str]) -> dict[str, str]:
    """Return module and class of each system in the files of folders, by name; they are read, and
    not imported."""
    found = {}
    for module, text in sources_in(folders):
        for kind, name in _SYSTEM.findall(text):
            found[name] = f"{module}:{kind}"
    return dict(sorted(found.items()))


SYSTEMS = systems_in(__path__)
"""Those of the package."""

PLUGINS = "contimpact.systems"
"""The group of entry points by which other distributions offer systems: ``name = module:Class``."""


def system(
    name: str, where: str = "system", own: Mapping[str, type[Model]] | None = None
) -> type[Model]:
    """Return the class of a system by the name scenes use, also of the user's `own`; errors name
    the place `where`.

    Raises InputError if there is no such system, or the plugin that offers it cannot be loaded.
    """
    kind = (own or {}).get(name) or find_system(name)
    if kind is None:
        names = list(dict.fromkeys((*SYSTEMS, *_plugins(), *(own or {}))))
        accepted = f"accepted are {', '.join(names)}, and a system of your own by --system FILE.py"
        raise InputError(
            where, f"no system {short_repr(name)}{did_you_mean(name, names)}", accepted
        )
    return kind


@explain_arguments
def list_systems() -> dict[str, type[Model]]:
    """Return the systems that scenes can name, with their classes.

    Returns
    -------
    dict of str to type
        Those of the package, and those that installed plugins offer.
    """
    return {name: system(name) for name in dict.fromkeys((*SYSTEMS, *_plugins()))}


def summary(kind: type[Model]) -> str:
    """Return in a line what a system is."""
    return (kind.__doc__ or "").strip().partition("\n")[0].partition(";")[0].rstrip(".")


def find_system(name: str) -> type[Model] | None:
    """Return the class of a system of the package or of a plugin; None if there is none."""
    if name in SYSTEMS:
        module, attribute = SYSTEMS[name].split(":")
        return getattr(importlib.import_module(f"{__name__}.{module}"), attribute)
    entry = _plugins().get(name)
    return None if entry is None else _load_entry_point(name, entry)


def _plugins() -> dict[str, Any]:
    """Entry points by name; of several with one name the first."""
    from importlib.metadata import entry_points

    return {entry.name: entry for entry in reversed(list(entry_points(group=PLUGINS)))}


def _load_entry_point(name: str, entry: Any) -> type[Model]:
    """The class that an entry point stands for."""
    where = f"plugin {entry.value}"
    try:
        kind = entry.load()
    except InputError as error:
        raise error.within(where) from None
    except Exception as error:
        found = f"it cannot be loaded ({type(error).__name__}: {error})"
        raise InputError(where, found, "mend or remove the package that offers it") from error
    if not (isinstance(kind, type) and issubclass(kind, Model)):
        raise InputError(where, f"found {kind!r}", "it has to be a subclass of Model")
    if getattr(kind, "SYSTEM", None) != name:
        found = f"its SYSTEM is {getattr(kind, 'SYSTEM', None)!r}"
        raise InputError(where, found, f"it has to be called {name!r}, as its entry point")
    return kind
