"""The proof of an event: that it exists where its entry says, at rest or not."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from flint import arb, ctx

from ..bifurcations.kind import Change, kind_of, orbits_beside
from ..bifurcations.zero_velocity import impacts_at_rest as stopped_at
from ..errors import InputError
from ..models.guards import Word
from ..orbits.problem import Linearisation
from ..orbits.quiet import problem_of
from ..orbits.search import solve_near
from ..results.branch import Entry, details_of, orbit_of
from .equations import BallProblem, Balls, crosses, krawczyk, prove_zero
from .orbit import Orbit, stops_at_once

# Impacts at rest that are no event of their own: proven by the symmetry that makes them rest.
#
# Where an orbit that is run twice grazes, it is at once an orbit of a longer word, in which one of
# its touches counts as an impact of zero velocity, and the event of that word in which the other
# one grazes. The orbit run once may be one without impacts. A ball never proves a velocity to be
# zero. But the grazing of the orbit run once can be proven; made into an orbit of the longer word
# it solves the equations of the event, and if it lies in the box in which these have one solution,
# it is that solution: the velocity is zero.


def resting_impacts(space: BallProblem, box: Balls, inner: Balls) -> list[int]:
    """Return the impacts of a grazing orbit that are proven to be at rest, from the box where the
    grazing is the only one, and the inner one where it lies."""
    m, count = space.problem.m, len(space.problem.word)
    if not count or len(inner) == space.problem.n + 1:
        return []
    slow = [k for k in range(count) if inner[m * k + 1].contains(0)]
    return [k for k in slow if _is_repeated_grazing(space, box, inner, k)]


def _is_repeated_grazing(space: BallProblem, box: Balls, inner: Balls, impact: int) -> bool:
    """Whether the orbit without an impact is another one run several times, which grazes there; or
    the orbit without impacts where it is the only one."""
    problem, m = space.problem, space.problem.m
    wall, alone = problem.word.walls[impact], len(problem.word) == 1
    once, times = Word("", 1), problem.word.period
    if not alone:
        longer = problem.word.drop(impact)
        once = next(iter(longer.repeated()), longer)
        times = len(longer) // len(once)
    if times == 1 or not (problem.model.guard(wall).rigid if alone else problem.paired):
        return False
    base = BallProblem(problem_of(problem.model, once, problem.kernels), space.bits)
    middles = [float(x.mid()) for x in inner]
    time, _, *others = middles[m * impact : m * impact + m]
    if alone:
        start = solve_near(base.problem, np.append(np.zeros(m), middles[m]))
        if start is None:
            return False
        z, starts = start.unknowns, np.zeros(1)
    else:
        kept = [*middles[: m * impact], *middles[m * impact + m :]]
        z = np.array([*kept[: base.problem.n], middles[problem.n]])
        starts = z[: base.problem.n : m]
    span = base.problem.span(z)
    time -= np.floor((time - starts[0]) / span) * span
    flight = int(np.searchsorted(starts, time)) - 1
    system, own = base.grazing(z, {"flight": flight, "wall": wall, "touch_time": time})
    found = prove_zero(base, system, [*z.tolist(), own[0], *others])
    return found is not None and _same_at_rest(base, found[1], times, box, impact)


def _same_at_rest(base: BallProblem, z: Balls, times: int, box: Balls, impact: int) -> bool:
    """Whether a grazing orbit, run several times with one touch as an impact and another one as
    the event, lies in a box."""
    m, n = base.problem.m, base.problem.n
    orbit, value, touch, others = z[: n + 1], z[n], z[n + 1], z[n + 2 :]
    span = arb(base.span(orbit))
    rows = [
        [row[0] + copy * span, *row[1:]]
        for copy in range(times)
        for row in base.impacts(orbit)[:-1]
    ]
    late = round(float((box[m * impact] - touch).mid()) / float(span.mid()))
    rows.insert(impact, [touch + late * span, arb(0), *others])
    whole = [x for row in rows for x in row]
    given = (
        [*whole, value, touch + other * span, *others]
        for other in range(late - times, late + times + 1)
        if other != late
    )
    return any(all(b.contains(x) for b, x in zip(box, one, strict=True)) for one in given)


AGREEMENT = 1e-9
"""Largest relative distance of recorded times, velocities and other parameters from proven ones.

The followed parameter has to be nearer: within its recorded error."""
DIGITS = 50

LEAST_BITS, MOST_BITS = 53, 8192
"""Least and largest precision of certificates that are verified."""

SAID = ("touch", "stability", "physicality", "stable", "ghost", "notation", "label")
"""Clauses about the orbit of an event that is proven to be there."""

FAILURES = (ArithmeticError, ValueError)
"""Exceptions of ball arithmetic where an enclosure holds a pole or does not decide."""

Recorded = Callable[[], Linearisation]
"""Makes the orbit of an entry as it is recorded."""


@dataclass(frozen=True)
class EventCertificate:
    """What is proven of an entry."""

    id: str
    kind: str
    branch: str
    """`id`, `kind`, `branch`: the entry's."""
    verdict: str = "rejected"
    """``certified`` or ``rejected``."""
    clause: str | None = None
    found: str | None = None
    """`clause`, `found`: of a rejected entry: which clause fails, and what was found."""
    bits: int = 0
    """Precision of the proof."""
    certified_radius: float | None = None
    """Radius of the enclosure of the followed parameter, rounded up."""
    parameter: str | None = None
    """The enclosure."""
    box: Sequence[str] = ()
    """Box in which the event is the only one: the orbit's unknowns, then those that the kind's
    equations add. Every ball is rounded outwards."""
    inner: Sequence[str] = ()
    """The part of the box in which it lies."""
    seconds: float = 0.0

    @property
    def certified(self) -> bool:
        """Whether every clause is proven."""
        return self.verdict == "certified"

    @property
    def located(self) -> bool:
        """Whether the event is proven to be where it is recorded, whatever is said of its orbit."""
        return self.certified or self.clause in SAID


class NoEnclosuresError(InputError):
    """A system of whose flights no enclosures are known: nothing is said of its entries."""


class RejectedError(Exception):
    """A clause that fails, and what was found."""

    def __init__(self, clause: str, found: str) -> None:
        super().__init__(f"{clause}: {found}")
        self.clause, self.found = clause, found


def certify_entry(
    entry: Entry, recorded: Recorded | None = None, bits: int = 128, most: int = 512
) -> EventCertificate:
    """Prove an entry of a catalogue, of the orbit `recorded`, by default that of the system it
    names. The precision begins with `bits` and is doubled where a proof fails, to `most`."""
    return _attempt(entry, recorded, bits, most, _isolate_zero)


def verify_entry(
    entry: Entry, record: EventCertificate, recorded: Recorded | None = None
) -> EventCertificate:
    """Prove an entry anew from the boxes of its certificate; nothing is searched for."""

    def stored(space: BallProblem, system: Any, guess: Sequence[float]) -> tuple[Balls, Balls]:
        box, inner = ([arb(text) for text in part] for part in (record.box, record.inner))
        if len(box) != len(guess) or len(inner) != len(guess):
            raise RejectedError("box", f"{len(box)} and {len(inner)} of {len(guess)} unknowns")
        if krawczyk(space, system, box) is None:
            raise RejectedError("existence", "Krawczyk's test fails on the recorded box")
        image = krawczyk(space, system, inner)
        if image is None or not all(b.contains(i) for b, i in zip(box, inner, strict=True)):
            raise RejectedError("existence", "Krawczyk's test fails on the recorded inner box")
        return box, inner

    if not LEAST_BITS <= record.bits <= MOST_BITS:
        found = f"{record.bits} bits, of {LEAST_BITS} to {MOST_BITS}"
        return EventCertificate(entry.id, entry.kind, entry.branch, clause="bits", found=found)
    return _attempt(entry, recorded, record.bits, record.bits, stored)


Boxes = Callable[[BallProblem, Any, Sequence[float]], tuple[Balls, Balls]]


def _isolate_zero(space: BallProblem, system: Any, guess: Sequence[float]) -> tuple[Balls, Balls]:
    found = prove_zero(space, system, guess)
    if found is None:
        raise RejectedError("existence", "Krawczyk's test fails: no zero is isolated there")
    return found


def _attempt(
    entry: Entry, recorded: Recorded | None, bits: int, most: int, boxes: Boxes
) -> EventCertificate:
    began = time.perf_counter()
    found = EventCertificate(entry.id, entry.kind, entry.branch)
    try:
        here = recorded() if recorded is not None else orbit_of(entry).linearisation
        while True:
            found = _certify_at_precision(entry, here, bits, boxes)
            undecided = str(found.found).startswith(UNDECIDED)  # and more digits may decide it
            if found.certified or not (undecided or found.clause == "existence") or 2 * bits > most:
                break
            bits *= 2
    except NoEnclosuresError:
        raise
    except InputError as error:
        found = replace(found, clause="entry", found=str(error))
    except (LookupError, TypeError, AttributeError) as error:
        found = replace(found, clause="entry", found=f"damaged ({type(error).__name__}: {error})")
    return replace(found, seconds=time.perf_counter() - began)


UNDECIDED = "not decided"


def _certify_at_precision(
    entry: Entry, here: Linearisation, bits: int, boxes: Boxes
) -> EventCertificate:
    """The certificate in a precision."""
    found = EventCertificate(entry.id, entry.kind, entry.branch, bits=bits)
    with ctx.workprec(bits):
        try:
            orbit, box, inner = _prove_existence(entry, here, bits, boxes)
            value = inner[here.problem.n]
            found = replace(
                found,
                certified_radius=float(value.rad().upper()) * (1.0 + 2.0**-50),
                parameter=decimal(value),
                box=tuple(map(decimal, box)),
                inner=tuple(map(decimal, inner)),
            )
            _agrees(entry, here, orbit, inner)
            _check_statements(entry, orbit, here)
        except RejectedError as error:
            return replace(found, clause=error.clause, found=error.found)
        except FAILURES as error:
            return replace(found, clause="existence", found=f"{type(error).__name__}: {error}")
    return replace(found, verdict="certified")


def decimal(ball: Any) -> str:
    """Return a ball in decimals, rounded outwards; `arb` reads it back."""
    text: str = ball.str(max(DIGITS, ctx.dps + 8), more=True)
    return text if "+/-" in text else f"[{text} +/- 0]"


def _prove_existence(
    entry: Entry, here: Linearisation, bits: int, boxes: Boxes
) -> tuple[Orbit, Balls, Balls]:
    """Existence and uniqueness in a box that holds what is recorded."""
    problem, recorded = here.problem, here.unknowns
    space, details, kind = BallProblem(problem, bits), details_of(entry), kind_of(entry.kind)
    equations = kind.in_many_digits(space, recorded, details)
    if equations is None:
        raise RejectedError("kind", f"there are no equations of {entry.kind} to be certified")
    system, own = equations
    box, inner = boxes(space, system, [*recorded.tolist(), *own])
    if outside := [i for i, g in enumerate(recorded) if not box[i].contains(arb(g))]:
        raise RejectedError("value", f"unknown {outside[0]} lies outside the box of the event")
    if kind.crossing and not crosses(space, box, inner):
        nu = inner[problem.n + 1].str(6)
        raise RejectedError("crossing", f"no symmetry says that branches meet; nu is {nu}")
    z = inner[: problem.n + 1]
    exact = dict(details)
    if "touch_time" in details:  # where the flight begins, or inside
        begun = "impact" in details
        exact["touch_time"] = inner[problem.m * details["impact"] if begun else problem.n + 1]
    stopped: tuple[int, ...] = ()
    if "touch_time" in details:
        stopped = tuple(resting_impacts(space, box, inner))
    elif "impact" in details:
        stopped = stopped_at(problem, details)
    elif "flight" in details and stops_at_once(space, z, details["flight"]):
        stopped = (details["flight"],)
    for impact in stopped:
        z[problem.m * impact + 1] = arb(0)
    return Orbit(space, z, kind, exact, stopped), box, inner


def _agrees(entry: Entry, here: Linearisation, orbit: Orbit, inner: Balls) -> None:
    """The recorded numbers are those of the event."""
    problem, space = here.problem, orbit.space
    value = inner[problem.n]
    if abs(value - entry.value) > entry.error or not entry.error >= 0.0:
        off = (value - entry.value).str(5)
        raise RejectedError(
            "value", f"{entry.parameter} is off by {off}, the recorded error is {entry.error:.3g}"
        )
    given = here.unknowns.tolist() if entry.word else []
    _require_near("impacts", zip(map(str, range(problem.n)), given, inner, strict=False))
    if entry.touch_time is not None:
        touch = orbit.details["touch_time"]
        _require_near("touch_time", [("touch_time", entry.touch_time, touch)])
    named = dict(zip(problem.model.values, space.values(orbit.z), strict=True))
    derived = space.setup(space.values(orbit.z)).derived
    named |= dict(zip(problem.model.DERIVED, map(arb, derived), strict=True))
    others = ((n, entry.parameters[n], b) for n, b in named.items() if n != entry.parameter)
    _require_near("parameters", others)
    walls = "".join(impact["wall"] for impact in entry.impacts)
    if walls != entry.word:
        raise RejectedError("impacts", f"on the walls {walls}, the word is {entry.word}")


def _require_near(clause: str, numbers: Any) -> None:
    for name, recorded, proven_ in numbers:
        if not abs(proven_ - recorded) <= AGREEMENT * max(1.0, abs(recorded)):
            raise RejectedError(clause, f"{name}: recorded {recorded!r}, proven {proven_.str(18)}")


def _check_statements(entry: Entry, orbit: Orbit, here: Linearisation) -> None:
    """What the entry says of its orbit."""
    said = {"touch": True, "stability": entry.n_unstable, "physicality": entry.physical}
    for clause, (found, why) in orbit.claims():
        if found is None:
            raise RejectedError(clause, f"{UNDECIDED}: {why}")
        beside = orbit.kind.changes is Change.PHYSICALITY and (orbit.at_rest or not entry.physical)
        if clause == "physicality" and found and beside:
            found = not _is_unphysical_beside(orbit, here)
        if found != said[clause]:
            text = f"recorded {said[clause]}, proven {found}{why and ': ' + why}"
            raise RejectedError(clause, text)
    ghost = entry.n_unstable > 0 or not entry.physical
    _require_recorded("stable", entry.stable, entry.n_unstable == 0)
    _require_recorded("ghost", entry.ghost, ghost)
    letters, word = orbit.space.problem.model.letters, orbit.space.problem.word
    notation = word.notation(letters)
    if entry.notation != word.counts(letters):  # as older catalogues have it, whatever the letters
        _require_recorded("notation", entry.notation, notation)
    tilde = ghost and orbit.kind.tilde
    _require_recorded("label", entry.label.startswith("~"), tilde)


def _is_unphysical_beside(orbit: Orbit, here: Linearisation) -> bool:
    """Whether orbits of the branch on both sides of an event are proven to be unphysical.

    At the event itself all that they violate may vanish, as where an orbit of several laps touches
    in each of them.
    """
    space, sides = orbit.space, 0
    for there in orbits_beside(here):
        guess = there.unknowns.tolist()
        system, _ = space.vanishing(_distance_from(guess[-1]))
        found = prove_zero(space, system, guess)
        sides += bool(found and Orbit(space, found[1], orbit.kind, {}).why_unphysical())
    return sides == 2


def _distance_from(value: float) -> Callable[[list[Any]], Any]:
    return lambda z: z[-1] - value


def _require_recorded(clause: str, recorded: Any, proven_: Any) -> None:
    if recorded != proven_:
        raise RejectedError(clause, f"recorded {recorded}, proven {proven_}")
