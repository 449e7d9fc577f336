"""The kinds of events by name, for whoever only has to read or to list them.

A kind is declared in the file of its own that defines it, which need not be imported for that.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, cast

from ..errors import InputError, short_repr
from ..models.model import Model
from ..syntax import parse_expression, sources_in


class KindDeclaration(NamedTuple):
    """What can be said of a kind before anything is computed."""

    name: str
    file: str
    """`name`, `file`: its name, which is that of its class, and the module that defines it."""
    place: int
    """Where it comes in lists of kinds."""
    usual: bool = True
    tori: bool = False
    """`usual`, `tori`: whether it is looked for unless a scene says otherwise, one that is about
    tori only where a model can have them."""
    born: bool = False
    continues: bool = False
    """`born`, `continues`: whether other branches are born there, or the motion itself goes to
    another word."""
    curves: bool = False
    """Whether it has curves in two parameters."""
    second: bool = False
    """Whether its equations need second derivatives."""


_DECLARED = re.compile(r"^@declared(\([^()]*\))\nclass (\w+)\(", re.MULTILINE)


def kinds_in(folders: Iterable[str]) -> tuple[KindDeclaration, ...]:
    """Return what the files in folders declare; they are read, and not imported."""
    found = []
    for file, text in sources_in(folders):
        for said, name in _DECLARED.findall(text):
            call = cast(ast.Call, parse_expression(f"declared{said}"))
            fields = {str(k.arg): ast.literal_eval(k.value) for k in call.keywords}
            found.append(KindDeclaration(name, file, **fields))
    return tuple(sorted(found, key=lambda kind: (kind.place, kind.name)))


DECLARED = kinds_in([str(Path(__file__).parent)])
"""The kinds of the package."""

FILES = {kind.name: kind.file for kind in DECLARED}
KINDS = tuple(FILES)
"""Every kind that is looked for along branches."""


# Kinds of a user's own are classes: there is none before the class they derive from is imported.


def own_kinds() -> tuple[str, ...]:
    """Return the names of a user's own kinds, as far as their classes are defined."""
    base = sys.modules.get(f"{__package__}.kind")
    return () if base is None else tuple(dict.fromkeys(base.names_of_own_kinds()))


def is_kind(defined: type) -> bool:
    """Whether a class is one of a kind."""
    base = sys.modules.get(f"{__package__}.kind")
    return base is not None and issubclass(defined, base.Kind)


SYNONYMS = {
    **dict.fromkeys(("LP", "LPC", "SN", "F", "CF"), "folds are FB here"),
    **dict.fromkeys(("TR", "HB", "H"), "tori are born at NS here"),
    **dict.fromkeys(("PF", "SB", "BPC"), "crossings of branches and pitchforks are BP here"),
    **dict.fromkeys(("GR", "GRAZE", "GZ"), "grazings are G here"),
    **dict.fromkeys(("FLIP", "P2"), "period doublings are PD here"),
    "CR": "crises are located by detect.crises of scenes, and by locate_crisis",
}
"""Names of kinds elsewhere, and what they are here."""


def unknown_kind(name: object, where: str, more: str = "") -> InputError:
    """Return the refusal of a name that no kind of event has, of the package or of one's own."""
    hint = f"; {SYNONYMS[name]}" if isinstance(name, str) and name in SYNONYMS else ""
    accepted = f"accepted are {', '.join(dict.fromkeys([*KINDS, *own_kinds()]))}{more}{hint}"
    return InputError(where, f"no event kind {short_repr(name)}", accepted)


EVENTS = tuple(kind.name for kind in DECLARED if kind.usual and not kind.tori)
"""Those looked for in any system where nothing else is said."""

USUAL = tuple(kind.name for kind in DECLARED if kind.usual)
"""Those, and the ones looked for where they can be."""

SWITCHES = tuple(kind.name for kind in DECLARED if kind.born)
"""Those at which other branches are born."""

CONTINUED = tuple(kind.name for kind in DECLARED if kind.continues)
"""Those of them beyond which the motion itself continues on another word."""

CURVES = tuple(kind.name for kind in DECLARED if kind.curves)
"""Those that have curves in two parameters."""

SECOND = tuple(kind.name for kind in DECLARED if kind.second)
"""Those whose equations need second derivatives."""

REQUESTED = "UZ"
"""The kind of the values to hit."""

CROSSINGS = ("PD-G", "G-PD")
"""Kind of the point at which curves of PD and of G cross, by the curve on which it is found."""


def usual_events(model: Model) -> tuple[str, ...]:
    """Return the kinds that are looked for in a model where nothing else is said."""
    return tuple(k.name for k in DECLARED if k.usual and (model.tori or not k.tori))


def wanted_kinds(
    kinds: Sequence[str], values: Mapping[str, Sequence[float]] | None, where: str, accepted: str
) -> list[str]:
    """Return the kinds to look for, each once: those named, and UZ where there are values to hit.

    UZ without values is an `InputError` at `where`.
    """
    asked = list(dict.fromkeys([*kinds, *([REQUESTED] if values else [])]))
    if REQUESTED in asked and not values:
        raise InputError(where, f"{REQUESTED} without values to hit", accepted)
    return asked
