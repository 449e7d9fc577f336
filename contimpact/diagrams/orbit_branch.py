"""Branches of periodic orbits, continued from an orbit or from the event at which they are born."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ..bifurcations.declarations import KINDS, SWITCHES, usual_events, wanted_kinds
from ..bifurcations.kind import primitive_start, switch, test_functions
from ..continuation.branch import End, EndKind, Event, Point, TestFunction, UserFunction
from ..continuation.settings import Settings
from ..continuation.walk import retry_interrupted
from ..errors import InputError, each_once, explain_arguments, short_repr
from ..models.model import Model
from ..orbits.orbit import Orbit
from ..orbits.problem import OrbitProblem
from ..orbits.quiet import problem_in
from ..progress import Asked, progress_callback
from ..results.branch import Branch, Entry
from ..results.diagram import Diagram, entry_by_name, entry_first, event_of, to_orbit
from ..results.options import check_range, within
from .orbit_walks import Callback, orbit_beside, run_born, symmetric_end, walk_both_ways

UserEvent = tuple[str, Callable[[Orbit], float]]


@explain_arguments
def continue_orbit(
    orbit: Orbit | Entry | Event | Point | tuple[Branch | Diagram, int | str],
    parameter: str | None = None,
    range: tuple[float, float] | None = None,
    *,
    events: Sequence[str | UserEvent] | None = None,
    values: Mapping[str, Sequence[float]] | None = None,
    settings: Settings | Mapping[str, Any] | None = None,
    callback: Callback | None = None,
    name: str = "b1",
    model: Model | None = None,
    unphysical: bool | None = None,
    progress: Asked = False,
) -> Branch:
    """Follow a periodic orbit in one parameter, in both directions.

    Parameters
    ----------
    orbit : Orbit, Entry or (Branch, row)
        From `find_orbits`; an event of a branch or a catalogue; a branch and the number of a row
        or the name of an event on it; a diagram and the name of an event.
    parameter : str, optional
        The parameter to follow; by default the one the orbit was found with.
    range : (low, high)
        Its range, which holds the orbit's value.
    events : sequence, optional
        Kinds of events (FB, BP, PD, NS, G, V, T, UZ, or one's own), and pairs of a name and a
        function of the `Orbit` whose zeros are to be located; by default FB, BP, PD, G, V and T,
        and NS where tori can be born.
    values : mapping of str to sequence of float, optional
        Values of the parameter in its range, or of a derived one, to hit exactly (as UZ).
    settings : Settings or mapping, optional
    callback : callable, optional
        Called with every accepted point; a true value stops the walk in that direction.
    name : str
        The branch's name.
    model : Model, optional
        The system of an entry or a branch, where its name does not tell; see `Entry.orbit`.
    unphysical : bool, optional
        Whether to go on where the orbits turn unphysical, or to end a step behind. By default it
        is so in systems of at most two guards, and from an orbit that is unphysical itself.
    progress : bool or callable
        Whether to tell on standard error how far the walk is, or a function to call with lines of
        text.

    Returns
    -------
    Branch
        After an interruption from the keyboard, what was followed until then; its ends say so.

    Raises
    ------
    InputError
        For what is no orbit, a parameter the model does not have, a range it does not admit, or
        values outside it.
    """
    given = entry_by_name(orbit)
    orbit = to_orbit(given, model)
    problem = orbit.problem
    parameter = parameter or problem.parameter
    unknowns = orbit.unknowns
    if parameter != problem.parameter:
        problem, unknowns = problem_in(parameter, orbit.model, orbit.linearisation)
    limits = _limits(problem, float(unknowns[-1]), range)
    stop, tests = symmetric_end(problem), tests_of_events(problem, events, values, limits)
    settings = _numerics(settings)
    if isinstance(given, Entry) and given.tangent is not None and problem is orbit.problem:
        unknowns = orbit_beside(problem, unknowns, np.array(given.tangent), limits, settings)
    if unphysical is None:
        unphysical = problem.model.few_guards or not orbit.physical
    what = f"following {name}, {problem.word}"
    with progress_callback(progress, what, problem.parameter, callback) as told:
        run = walk_both_ways(problem, unknowns, limits, tests, settings, told, stop, unphysical)
    return retry_interrupted(lambda: run.branch(name, kinds=[test.kind for test in tests]))


def _limits(problem: OrbitProblem, start: float, limits: object) -> tuple[float, float]:
    """The range to follow an orbit in, at whose ends the model holds."""
    low, high = check_range(problem.model, problem.parameter, start, limits, "range")
    problem.model.validate_between(problem.parameter, low, high, "range")
    return low, high


def _numerics(given: Settings | Mapping[str, Any] | None) -> Settings:
    return given if isinstance(given, Settings) else Settings(**(given or {}))


def tests_of_events(
    problem: OrbitProblem,
    events: Sequence[str | UserEvent] | None,
    values: Mapping[str, Sequence[float]] | None,
    limits: tuple[float, float],
) -> list[TestFunction]:
    events = usual_events(problem.model) if events is None else events
    if isinstance(events, str) or not isinstance(events, Sequence):
        raise InputError("events", f"found {events!r}", "give a list, such as ['PD', 'G']")
    wanted = {}
    for name, asked in (values or {}).items():
        if np.ndim(asked) != 1:
            raise InputError(
                f"values.{name}", f"found {short_repr(asked)}", "give a list of numbers"
            )
        wanted[name] = each_once(asked, f"values.{name}")
    texts = each_once((kind for kind in events if isinstance(kind, str)), "events")
    kinds = wanted_kinds(texts, wanted, "events", "give values={name: [...]}")
    tests = test_functions(problem, kinds, wanted)
    asked = [float(value) for value in wanted.get(problem.parameter, ())]
    within(asked, f"values.{problem.parameter}", limits, "the range")
    own = [_user_test(kind) for kind in events if not isinstance(kind, str)]
    names = [test.kind for test in own]
    if again := [name for name in names if names.count(name) > 1]:
        found = f"found two functions by the name {short_repr(again[0])}"
        raise InputError("events", found, "give each a name of its own")
    return tests + own


def _user_test(given: UserEvent) -> TestFunction:
    named = isinstance(given, tuple) and len(given) == 2 and isinstance(given[0], str)
    if not named or not callable(given[1]) or given[0] in KINDS:
        accepted = f"give a pair of a name (none of {', '.join(KINDS)}) and a function"
        raise InputError("events", f"found {given!r}", accepted)
    kind, function = given

    def value(point: Point) -> float:
        found = np.asarray(function(Orbit(point.evaluation.problem, point.evaluation)))
        if found.size != 1 or found.dtype.kind in "cSU":
            raise InputError(
                f"event {kind}", f"its function returned {found!r}", "return one real number"
            )
        return float(found.reshape(()))

    return UserFunction(kind, value)


# From an event to the branch that is born there.


@explain_arguments
def continue_born(
    entry: Entry,
    model: Model | None = None,
    range: tuple[float, float] | None = None,
    *,
    events: Sequence[str | UserEvent] | None = None,
    values: Mapping[str, Sequence[float]] | None = None,
    settings: Settings | Mapping[str, Any] | None = None,
    callback: Callback | None = None,
    name: str = "b1",
    unphysical: bool | None = None,
    progress: Asked = False,
) -> Branch | None:
    """Follow the branch born at an event of another one, from a catalogue just made or loaded.

    Parameters
    ----------
    entry : Entry
        A G, V, PD or BP, or a T at which sliding vanishes or impacts exchange their order.
    model : Model, optional
        The system, where its name does not tell; parameter values are taken from the entry. It may
        also stand before the entry.
    range : (low, high)
        Of the entry's parameter.
    events, values, settings, callback, name, unphysical, progress
        As of `continue_orbit`.

    Returns
    -------
    Branch or None
        None where nothing starts: the only impact was dropped, or the event is degenerate. After
        an interruption from the keyboard, what was followed until then; its ends say so.

    Raises
    ------
    InputError
        For an event of another kind, or a range that does not fit.
    """
    if isinstance(model, str) and model == getattr(entry, "parameter", None):
        model = None  # where `continue_orbit` has the parameter, which here is the entry's
    entry, model = entry_first(entry, model)
    if getattr(entry, "kind", None) not in SWITCHES:
        accepted = f"accepted are entries of {', '.join(SWITCHES)}"
        raise InputError("entry", f"nothing is born at {short_repr(entry)}", accepted)
    start = switch(event_of(entry, model))
    if start is None:
        return None
    start = primitive_start(start)
    problem = start.problem
    limits = _limits(problem, entry.value, range)
    tests = tests_of_events(problem, events, values, limits)
    place = {"entry": entry.id, "parent": entry.branch}
    born = End.of(EndKind.BORN, entry.parameter, entry.value, **place)
    what = f"following {name}, {problem.word}"
    with progress_callback(progress, what, problem.parameter, callback) as told:
        stop, settings = symmetric_end(problem), _numerics(settings)
        if unphysical is None:
            unphysical = problem.model.few_guards or not entry.physical
        run = run_born(start, born, limits, tests, settings, stop, told, unphysical)
    if isinstance(run, End):
        return None
    asked = [test.kind for test in tests]
    branch = retry_interrupted(lambda: run.branch(name, entry.id, kinds=asked))
    return dataclasses.replace(branch, notes=[start.note, *branch.notes]) if start.note else branch
