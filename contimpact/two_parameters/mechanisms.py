"""How a stable orbit gives way to one with one impact more: the mechanism of the transition.

What is born at the end of the orbit, and at its grazing, is followed, and read as a diagram is.
"""

from __future__ import annotations

import dataclasses

from ..bifurcations.doubling import PD
from ..bifurcations.grazing import G
from ..models.model import Model
from ..orbit_continuation.born import continue_born
from ..results.branch import Branch, Entry
from ..results.diagram import Diagram
from ..results.diagram_reading import read
from ..results.scene import Scene

DEPTH = 2
"""How many period doublings one after another are followed."""


def mechanisms(branch: Branch, end: Entry, scene: Scene, model: Model) -> list[int]:
    """Return the mechanisms by which the orbit of a branch gives way at the end of its stability.

    Parameters
    ----------
    branch : Branch
    end : Entry
        On it, where the orbit loses its stability or grazes.
    scene : Scene
        Gives range, events and settings.
    model : Model
        The branch's system.

    Returns
    -------
    list of int
        Of 1 to 4, as in `results.diagram_reading`; empty where nothing is decided.
    """
    grazings = _grazings(branch, end)
    if not grazings:
        return []
    family = _Family(scene, model)
    own = family.named(branch, "b")
    born = [family.born(entry, f"g{k}") for k, entry in enumerate(grazings)]
    opened = {e.id: new.id for e, new in zip(grazings, born, strict=True) if new is not None}
    doubled = family.doubled(end, "d", DEPTH) if end.kind == PD.name else []
    opened |= {end.id: doubled[0].id} if doubled else {}
    events = [dataclasses.replace(e, opens=_opens(opened, e.id)) for e in branch.events]
    own = family.named(dataclasses.replace(branch, events=events), "b")
    found = read(Diagram("", [own, *(new for new in born if new is not None), *doubled]))
    ends = f"b-{end.id}"
    shown = {t.mechanism for t in found.transitions if ends in (t.entry, t.doubling)}
    return sorted(m for m in shown if m is not None)


def _opens(opened: dict[str, str], name: str) -> tuple[str, ...]:
    return (opened[name],) if name in opened else ()


def _grazings(branch: Branch, end: Entry) -> list[Entry]:
    """The end if it is a grazing; of a doubling the next grazing of the orbit that has doubled."""
    if end.kind == G.name:
        return [end]
    if end.kind != PD.name:
        return []
    found = [e for e in branch.events if e.kind == G.name and e.physical and e.order == 1]
    return sorted(found, key=lambda e: abs(e.arclength - end.arclength))[:1]


@dataclasses.dataclass(frozen=True)
class _Family:
    """The branches born on one, their entries called so that no two have one name."""

    scene: Scene
    model: Model

    def born(self, entry: Entry, name: str) -> Branch | None:
        """The branch born at an entry."""
        scene = self.scene
        new = continue_born(
            entry, self.model, scene.range, events=scene.events, settings=scene.settings, name=name
        )
        return None if new is None else self.named(new, name)

    def doubled(self, entry: Entry, name: str, depth: int) -> list[Branch]:
        """The branch born at a period doubling, and those born on it in turn."""
        new = self.born(entry, name)
        if new is None:
            return []
        further = [e for e in new.events if e.kind == PD.name and not e.ghost] if depth > 1 else []
        later = [self.doubled(e, f"{name}{k}", depth - 1) for k, e in enumerate(further)]
        return [new, *(branch for some in later for branch in some)]

    @staticmethod
    def named(branch: Branch, name: str) -> Branch:
        """A branch and its entries under a name of their own."""
        events = [dataclasses.replace(e, id=f"{name}-{e.id}", branch=name) for e in branch.events]
        column = branch["event"].copy()
        column[column != ""] = [f"{name}-{event}" for event in column[column != ""]]
        columns = {**branch.columns, "event": column}
        return dataclasses.replace(branch, id=name, events=events, columns=columns)
