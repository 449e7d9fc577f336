"""From an event to the branch that is born there."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

from ..bifurcations.declarations import SWITCHES
from ..bifurcations.kind import Start, once
from ..bifurcations.registry import switch
from ..continuation.branch import Point, TestFunction, Walk
from ..continuation.ends import End, EndKind
from ..continuation.settings import Settings
from ..continuation.walk import Stop, kept, other_way, undisturbed
from ..errors import InputError, shown
from ..models.model import Model
from ..progress import Asked
from ..results.branch import Branch, Entry
from ..results.entry_conversion import entry_first, event_of
from .orbit_branch import Callback, Run, UserEvent, checked_range, tests_of_events, told_of
from .orbit_walks import walk_orbits
from .symmetry import again, at_image, mirrors_back, symmetry_of, watched


def continue_born(
    entry: Entry,
    model: Model | None = None,
    range: tuple[float, float] | None = None,
    *,
    events: Sequence[str | UserEvent] | None = None,
    values: Mapping[str, Sequence[float]] | None = None,
    settings: Settings | None = None,
    callback: Callback | None = None,
    name: str = "b1",
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
    events, values, settings, callback, name, progress
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
    entry, model = entry_first(entry, model)
    if getattr(entry, "kind", None) not in SWITCHES:
        accepted = f"accepted are entries of {', '.join(SWITCHES)}"
        raise InputError("entry", f"nothing is born at {shown(entry)}", accepted)
    start = switch(event_of(entry, model))
    if start is None:
        return None
    start = once(start)
    problem = start.problem
    limits = checked_range(problem, range, entry.value)
    tests = tests_of_events(problem, events, values)
    place = {"entry": entry.id, "parent": entry.branch}
    born = End.of(EndKind.BORN, entry.parameter, entry.value, **place)
    with told_of(progress, f"following {name}, {problem.word}", problem, callback) as told:
        run = run_born(
            start, born, limits, tests, settings or Settings(), name, at_image(problem), told
        )
    if isinstance(run, End):
        return None
    asked = [test.kind for test in tests]
    branch = undisturbed(lambda: run.branch(name, entry.id, kinds=asked))
    return dataclasses.replace(branch, notes=[start.note, *branch.notes]) if start.note else branch


def run_born(
    start: Start,
    born: End,
    limits: tuple[float, float],
    tests: Sequence[TestFunction],
    settings: Settings,
    name: str = "b1",
    stop: Stop | None = None,
    callback: Callable[[Point], bool | None] | None = None,
) -> Run | End:
    """Walk along a branch from its start, one way or both as `Start` says.

    Parameters
    ----------
    start : Start
    born : End
        That of the way that is not gone.
    limits : (low, high)
    tests : sequence of TestFunction
    settings : Settings
    name : str
        The branch's, for the end of one that mirrors itself.
    stop, callback : callable, optional
        As of `contimpact.continuation.walk.walk`.

    Returns
    -------
    Run or End
        Where there is no first point, the end that says why.
    """
    problem = start.problem

    def go(direction: int) -> Walk:
        return walk_orbits(
            problem,
            start.unknowns,
            direction,
            limits=limits,
            tests=watched(tests, stop),
            settings=settings,
            tangent=start.tangent,
            branching=start.branching,
            callback=callback,
            stop=stop,
        )

    forward = kept(lambda: go(+1))
    if not forward.points:
        return forward.end
    first, closed = forward.points[:1], forward.end.kind is EndKind.CLOSED
    if not closed and mirrors_back(problem, start.unknowns, start.tangent, symmetry_of(problem)):
        backward = Walk(first, (), again(name, first[0]))
    elif start.both_ways or closed:
        backward = other_way(forward, problem.parameter, lambda: go(-1))
        if not backward.points:
            backward = Walk(first, (), backward.end)
    else:
        backward = Walk(first, (), born)
    return Run.of(problem, backward, forward, born=True)


def first_step(start: Start, limits: tuple[float, float], settings: Settings) -> Walk:
    """Return the walk's first step, to see where it leads."""
    return walk_orbits(
        start.problem,
        start.unknowns,
        +1,
        limits=limits,
        tangent=start.tangent,
        branching=start.branching,
        settings=dataclasses.replace(settings, max_points=2),
    )
