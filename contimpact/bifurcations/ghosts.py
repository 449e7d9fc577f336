"""What an event is called and whether it is a ghost, as in Table 1 of the paper.

An event is a ghost when the orbit that carries it is unstable, or unphysical, for a reason other
than the event itself: of its multipliers the critical one is left out, of its gaps the touch.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..continuation.branch import Event, Point
from ..errors import InputError
from ..models.model import Model
from ..models.word import Word
from ..orbits import multipliers as stability
from ..orbits.linearisation import Linearisation
from ..orbits.physicality import Verdict
from ..orbits.problem import Array, OrbitProblem
from ..records.entry import Entry
from ..records.recovery import orbit_of
from ..records.tables import all_parameters, coordinates
from ..segments.kernels import Kernels
from . import criticality
from .names import LABELLED
from .switching import TOUCHING, grown_word, switch
from .test_functions import critical


def entry_of(event: Event, identity: str, branch: str, before: Point, after: Point) -> Entry:
    """Return the catalogue entry of an event, given the branch's points around it."""
    here: Linearisation = event.point.evaluation
    problem = here.problem
    word, details = problem.word, event.details
    letters = [w.name for w in problem.model.WALLS]
    becomes = next_word(event)
    multipliers, n_unstable = apart_from_event(event.kind, here, details)
    verdict = forgiven(event.kind, here, details)
    ghost = n_unstable > 0 or not verdict.physical
    side, slope = _criticality(event, before, after)
    return Entry(
        id=identity,
        kind=event.kind,
        ghost=ghost,
        label=label(event.kind, ghost, word, becomes, letters),
        why=_why(n_unstable, verdict),
        branch=branch,
        word=word.walls,
        period=word.period,
        notation=word.notation(letters),
        becomes=str(becomes) if becomes else None,
        order=len(becomes) - len(word) if becomes and event.kind == "G" else None,
        criticality=side,
        slope=slope,
        wall=details.get("wall"),
        flight=details.get("flight"),
        impact=details.get("impact"),
        touch_time=_shifted(problem, here.unknowns, details.get("touch_time")),
        requested=details.get("requested"),
        parameter=problem.parameter,
        parameters=all_parameters(here),
        impacts=impacts_of(problem, here.unknowns),
        multipliers=_pairs(multipliers),
        multipliers_before=_pairs(before.evaluation.multipliers),
        multipliers_after=_pairs(after.evaluation.multipliers),
        n_unstable=n_unstable,
        stable=n_unstable == 0,
        physical=verdict.physical,
        reason=verdict.reason,
        residual=event.residual,
        error=event.error,
        method=event.method,
        arclength=event.point.arclength,
        tangent=event.point.tangent.tolist() if event.kind == "BP" else None,
        system=problem.model.SYSTEM,
        options=problem.model.options,
        nu=details.get("nu"),
        nu_error=details.get("nu_error"),
    )


def event_of(entry: Entry, model: Model | None = None, kernels: Kernels | None = None) -> Event:
    """Return the event a catalogue entry records, to switch at it; see `recovery.orbit_of`.

    Raises
    ------
    InputError
        If the entry is damaged, or of another model.
    """
    orbit = orbit_of(entry, model, kernels)
    problem = orbit.problem
    kept = {"flight": entry.flight, "wall": entry.wall, "impact": entry.impact}
    details: dict[str, Any] = {name: value for name, value in kept.items() if value is not None}
    if entry.touch_time is not None:
        details["touch_time"] = entry.touch_time
    needed = {"G": ("flight", "wall", "touch_time"), "V": ("impact",)}.get(entry.kind, ())
    if lacking := [name for name in needed if name not in details]:
        found = f"it has no {lacking[0]}"
        raise InputError("entry", found, "give an entry as a catalogue records it")
    tangent = np.array(entry.tangent) if entry.tangent is not None else np.zeros(problem.n + 1)
    point = Point(orbit.linearisation, tangent, 0.0, entry.arclength, 0)
    return Event(entry.kind, point, entry.residual, entry.error, entry.method, details)


def _pairs(multipliers: Array) -> list[tuple[float, float] | None]:
    return [(m.real, m.imag) if np.isfinite(m) else None for m in multipliers.tolist()]


def _why(n_unstable: int, verdict: Verdict) -> str | None:
    """Why an event is a ghost, or None."""
    reasons = []
    if n_unstable:
        reasons.append(f"unstable: {n_unstable} multiplier{'s' * (n_unstable > 1)} outside")
    if verdict.reason:
        reasons.append(f"unphysical: {verdict.reason}")
    return "; ".join(reasons) or None


def _criticality(event: Event, before: Point, after: Point) -> tuple[str | None, float | None]:
    if event.kind == "PD":
        return criticality.of_doubling(event, before, after), None
    start = switch(event) if event.kind == "G" else None
    if start is None:
        return None, None
    return criticality.of_grazing(event, start), criticality.velocity_slope(event, start)


def next_word(event: Event) -> Word | None:
    """Return the word beyond a grazing or a zero velocity, None for other kinds."""
    word: Word = event.point.evaluation.problem.word
    if event.kind == "G":
        return grown_word(event)
    if event.kind == "V" and len(word) > 1:
        return word.drop(event.details["impact"])
    return None


def label(kind: str, ghost: bool, word: Word, becomes: Word | None, letters: Sequence[str]) -> str:
    """Return the label of an event: ``~G[2:1->2:2]``."""
    mark = "~" if ghost and kind in LABELLED else ""
    if becomes is None:
        return mark + kind
    return f"{mark}{kind}[{word.notation(letters)}->{becomes.notation(letters)}]"


def apart_from_event(
    kind: str, here: Linearisation, details: Mapping[str, Any]
) -> tuple[Array, int]:
    """Return the orbit's multipliers, and how many outside the unit circle are not the event's.

    At a zero velocity the multipliers are those of the orbit without that impact: the same orbit,
    whose own have no pole.
    """
    if kind == "V" and len(here.problem.word) > 1:
        start, end = _without_impact(here, details["impact"])
        multipliers = stability.multipliers(start, end)
        return multipliers, int(stability.count_unstable(multipliers))
    others = np.delete(here.multipliers, critical(kind, here.multipliers))
    return here.multipliers, int(stability.count_unstable(others))


def forgiven(kind: str, here: Linearisation, details: Mapping[str, Any]) -> Verdict:
    """Return the verdict on the orbit, the event itself not held against it."""
    if kind == "G":
        touching = {
            (t.flight, t.wall)
            for flight in here.gaps
            for t in flight.touches
            if t is not None and abs(t.gap) < TOUCHING
        }
        return here.judge(forgive_touches={(details["flight"], details["wall"]), *touching})
    if kind == "V":
        return here.judge(forgive_impact=details["impact"])
    return here.verdict


def _without_impact(here: Linearisation, impact: int) -> tuple[Array, Array]:
    """The blocks of the same orbit with one impact of zero velocity left out."""
    problem = here.problem
    shorter = OrbitProblem(problem.model, problem.word.drop(impact), problem.kernels)
    kept = np.delete(problem.impacts(here.unknowns), impact, axis=0)
    there = shorter.evaluate(np.append(kept.ravel(), here.unknowns[-problem.free :]))
    return there.start, there.end


def impacts_of(problem: OrbitProblem, unknowns: Array) -> list[dict[str, Any]]:
    """Return the impacts as records, the first one's time in [0, T)."""
    names = ["time", "velocity", *coordinates(problem.m)[2:]]
    rows = problem.impacts(unknowns).tolist()
    for row in rows:
        row[0] = _shifted(problem, unknowns, row[0])
    return [
        {"wall": wall} | dict(zip(names, row, strict=True))
        for wall, row in zip(problem.word.walls, rows, strict=True)
    ]


def _shifted(problem: OrbitProblem, unknowns: Array, time: Any) -> Any:
    """A time in the clock in which the first impact comes in [0, T)."""
    if time is None:
        return None
    period = problem.kernels.setup(*problem.values(unknowns))[0]
    return time - float(np.floor(unknowns[0] / period)) * period
