"""Quantities of a study's scenes that maps show: a number or a name for each scene.

Most are read from the *main* stable orbit of a notation: of all branches with stable orbits that on
which they reach the largest value of the derived parameter (of the followed one where there is
none). It ends where the last of its intervals of stability does as that value falls; "as the
parameter falls" is said of that value, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from ..bifurcations.declarations import SWITCHES
from ..errors import InputError, shown

if TYPE_CHECKING:
    from .study import Study

Values = dict[int, Any]
PAIR = ("PD", "G")
"""Kinds whose distance is measured."""
assert {*PAIR} <= {*SWITCHES}


class Quantity(NamedTuple):
    """A quantity: how it is computed, what is said of it, and whether it is a name."""

    values: Callable[[Study, str], Values]
    text: str
    named: bool = False


class Main(NamedTuple):
    """The main stable orbit of a scene: its branch, its range, what ends it as the parameter
    falls."""

    branch: str
    low: float
    high: float
    end: str | None


def along(study: Study) -> str:
    """Return the parameter that falls: the derived one, if there is one."""
    return study.derived or study.parameter


def main_orbits(study: Study, orbit: str) -> dict[int, Main]:
    """Return the main stable orbit of a notation in each scene that has one."""
    intervals: dict[tuple[int, str], list[Main]] = {}
    columns = ("low_derived", "high_derived") if study.derived else ("low", "high")
    for row in study.rows(
        f"SELECT scene, branch, {', '.join(columns)}, low_end, high_end FROM intervals"
        " WHERE study = ? AND notation = ?",
        [study.number, orbit],
    ):
        scene, branch, low, high, low_end, high_end = row
        if low > high:  # the derived parameter falls as the followed one rises
            low, high, low_end = high, low, high_end
        intervals.setdefault((scene, branch), []).append(Main(branch, low, high, low_end))
    found: dict[int, Main] = {}
    for (scene, _), own in intervals.items():
        main = min(own, key=lambda one: one.low)._replace(high=max(one.high for one in own))
        if scene not in found or main.high > found[scene].high:
            found[scene] = main
    return found


def ends(study: Study, orbit: str) -> Values:
    """Which bifurcation ends the main stable orbit as the parameter falls."""
    labels = _labels(study, orbit)
    return {
        scene: labels.get((scene, main.end), main.end or "status changes")
        for scene, main in main_orbits(study, orbit).items()
    }


def mechanism(study: Study, orbit: str) -> Values:
    """By which mechanism the main stable orbit gives way to one with one impact more.

    Of several transitions that whose grazing is nearest to the end of stability.
    """
    mains, best = main_orbits(study, orbit), dict[int, tuple[float, Any]]()
    for scene, branch, number, value in study.rows(
        f"SELECT t.scene, e.branch, t.mechanism, {_value(study)} FROM transitions t"
        " JOIN events e ON e.study = t.study AND e.scene = t.scene AND e.event = t.grazing"
        " WHERE t.study = ? AND t.source = ?",
        [study.number, orbit],
    ):
        main = mains.get(scene)
        if main is not None and main.branch == branch:
            near = abs(value - main.low), number
            best[scene] = min(best.get(scene, near), near, key=lambda pair: pair[0])
    return {scene: str(number or "not decided") for scene, (_, number) in best.items()}


def distance(study: Study, orbit: str) -> Values:
    """The distance from the grazing to the period doubling of the main stable orbit.

    One of them ends its stability, the other, a ghost, is the nearest along the branch; positive
    where the doubling comes first as the parameter falls.
    """
    mains, found = main_orbits(study, orbit), {}
    for scene, events in _events(study, orbit):
        main = mains.get(scene)
        own = [e for e in events if main is not None and e[0] == main.branch]
        ending = next((e for e in own if main and e[1] == main.end and e[2] in PAIR), None)
        others = [e for e in own if ending and e[2] in PAIR and e[2] != ending[2]]
        if ending is None or not others:
            continue
        other = min(others, key=lambda e: abs(e[4] - ending[4]))
        value = {ending[2]: ending[3], other[2]: other[3]}
        found[scene] = value[PAIR[0]] - value[PAIR[1]]
    return found


def bistability(study: Study, orbit: str) -> Values:
    """The widest range of the parameter in which two orbits are stable."""
    columns = ("low_derived", "high_derived") if study.derived else ("low", "high")
    low, high = (
        f"min({{0}}.{columns[0]}, {{0}}.{columns[1]})",
        f"max({{0}}.{columns[0]}, {{0}}.{columns[1]})",
    )
    query = (
        f"SELECT a.scene, max(min({high.format('a')}, {high.format('b')})"
        f" - max({low.format('a')}, {low.format('b')})) FROM intervals a"
        " JOIN intervals b ON a.study = b.study AND a.scene = b.scene AND a.number < b.number"
        " WHERE a.study = ? GROUP BY a.scene"
    )
    found = {scene: 0.0 for (scene,) in _done(study)}
    return found | {s: max(wide, 0.0) for s, wide in study.rows(query, [study.number])}


def energy(study: Study, orbit: str) -> Values:
    """The largest mean voltage per unit of time of a scene's attractors."""
    query = "SELECT scene, max(per_time) FROM energies WHERE study = ? GROUP BY scene"
    return dict(study.rows(query, [study.number]))


def margin(study: Study, orbit: str) -> Values:
    """The distance in the followed parameter from the scene's start to the nearest real event."""
    given = study.given["model"].get("parameters", {})
    query = (
        "SELECT e.scene, min(abs(e.value - coalesce(x.value, ?))) FROM events e"
        " LEFT JOIN coordinates x ON x.study = e.study AND x.scene = e.scene AND x.name = ?"
        " WHERE e.study = ? AND NOT e.ghost AND e.notation = ? GROUP BY e.scene"
    )
    start = _number(given.get(study.parameter))
    return dict(study.rows(query, [start, study.parameter, study.number, orbit]))


def counted(study: Study, label: str) -> Values:
    """How many events with a label there are."""
    query = "SELECT scene, count(*) FROM events WHERE study = ? AND label = ? GROUP BY scene"
    found = {scene: 0 for (scene,) in _done(study)}
    return found | dict(study.rows(query, [study.number, label]))


QUANTITIES: Mapping[str, Quantity] = {
    "ends": Quantity(ends, "what ends stable {orbit} as {along} falls", True),
    "mechanism": Quantity(mechanism, "mechanism of the transition from {orbit}", True),
    "distance": Quantity(distance, "{along} of PD less {along} of grazing, {orbit}"),
    "bistability": Quantity(bistability, "width in {along} of bistability"),
    "energy": Quantity(energy, "largest mean voltage per time (V)"),
    "margin": Quantity(margin, "distance in {parameter} to the nearest event of {orbit}"),
}
COUNT = "count:"


def quantity(name: str) -> Quantity:
    """Return a quantity by its name; ``count:LABEL`` counts events.

    Raises
    ------
    InputError
        If there is none of this name.
    """
    if name.startswith(COUNT):
        label = name.removeprefix(COUNT)
        return Quantity(lambda study, orbit: counted(study, label), f"number of {label}")
    if name not in QUANTITIES:
        accepted = f"accepted are {', '.join(QUANTITIES)} and {COUNT}LABEL"
        raise InputError("quantity", f"found {shown(name)}", accepted)
    return QUANTITIES[name]


def _value(study: Study) -> str:
    return "e.derived" if study.derived else "e.value"


def _labels(study: Study, orbit: str) -> dict[tuple[int, Any], str]:
    query = "SELECT scene, event, label FROM events WHERE study = ? AND notation = ?"
    return {(scene, e): label for scene, e, label in study.rows(query, [study.number, orbit])}


def _events(study: Study, orbit: str) -> Iterator[tuple[int, list[Any]]]:
    """The events of an orbit, scene by scene: branch, name, kind, value, arclength."""
    import itertools

    rows = study.rows(
        f"SELECT scene, branch, event, kind, {_value(study)}, arclength FROM events e"
        " WHERE study = ? AND notation = ? ORDER BY scene",
        [study.number, orbit],
    )
    for scene, own in itertools.groupby(rows, key=lambda row: row[0]):
        yield int(scene), [row[1:] for row in own]


def _done(study: Study) -> Iterator[Any]:
    return study.rows(
        "SELECT scene FROM scenes WHERE study = ? AND status = 'done'", [study.number]
    )


def _number(value: Any) -> float | None:
    from ..models.expressions import number

    return number(value, "model.parameters") if isinstance(value, str) else value
