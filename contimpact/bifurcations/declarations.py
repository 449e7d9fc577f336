"""The kinds of events by name, for whoever only has to read or to list them.

A kind is declared here, for scenes, and defined in the file of its own that the declaration names.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ..errors import InputError, short_repr
from ..models.model import Model


class KindDeclaration(NamedTuple):
    """What can be said of a kind before anything is computed.

    `file` is the module that defines it, in a class of its name. It is looked for unless a scene
    says otherwise if it is `usual`, one that is about `tori` only where a model can have them.
    Other branches are `born` there, or the motion itself `continues` on another word; it has
    `curves` in two parameters; its equations need `second` derivatives.
    """

    name: str
    file: str
    usual: bool = True
    born: bool = False
    curves: bool = False
    second: bool = False
    tori: bool = False
    continues: bool = False


DECLARED = (
    KindDeclaration("FB", "fold", curves=True, second=True),
    KindDeclaration("BP", "branch_point", born=True, curves=True, second=True),
    KindDeclaration("PD", "doubling", born=True, curves=True, second=True),
    KindDeclaration("NS", "torus", curves=True, second=True, tori=True),
    KindDeclaration("G", "grazing", born=True, curves=True),
    KindDeclaration("V", "zero_velocity", born=True, curves=True),
    KindDeclaration("T", "zero_duration", born=True, continues=True),
    KindDeclaration("UZ", "requested", usual=False, curves=True),
)

FILES = {kind.name: kind.file for kind in DECLARED}
KINDS = tuple(FILES)
"""Every kind that is looked for along branches."""

SYNONYMS = {
    **dict.fromkeys(("LP", "LPC", "SN", "F", "CF"), "folds are FB here"),
    **dict.fromkeys(("TR", "HB", "H"), "tori are born at NS here"),
    **dict.fromkeys(("PF", "SB", "BPC"), "crossings of branches and pitchforks are BP here"),
    **dict.fromkeys(("GR", "GRAZE", "GZ"), "grazings are G here"),
    **dict.fromkeys(("FLIP", "P2"), "period doublings are PD here"),
    "CR": "crises are located by detect.crises of scenes, and by locate_crisis",
}
"""Names of kinds elsewhere, and what they are here."""


def unknown_kind(name: object, where: str) -> InputError:
    """Return the refusal of a name that no kind of event has."""
    hint = f"; {SYNONYMS[name]}" if isinstance(name, str) and name in SYNONYMS else ""
    return InputError(
        where, f"no event kind {short_repr(name)}", f"accepted are {', '.join(KINDS)}{hint}"
    )


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
