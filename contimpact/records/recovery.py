"""From recorded numbers back to orbits: rows of tables, entries of catalogues, their files.

A record holds the system's name, its options and all parameters, the word and its impacts. With the
system's formulas that is an orbit again; that it solves them is checked.
"""

from __future__ import annotations

import operator
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..bifurcations.requested import PERIOD
from ..errors import InputError, shown
from ..models.model import Model
from ..models.word import Word
from ..orbits.orbit import Orbit
from ..orbits.problem import Array, OrbitProblem
from ..orbits.quiet import problem_of
from ..orbits.search import find_orbits
from ..segments.kernels import Kernels
from ..systems import installed
from .tables import columns_of, coordinates, kinds_of, named_by_id, named_by_kind

if TYPE_CHECKING:
    from .branch import Branch
    from .entry import Entry

SOLVED = 1e-6
"""A larger residual belongs to another model."""


def orbit_of(entry: Entry, model: Model | None = None, kernels: Kernels | None = None) -> Orbit:
    """Return the orbit a catalogue entry records.

    Parameters
    ----------
    entry : Entry
    model : Model, optional
        The system; parameter values are taken from the entry. By default the one it names.
    kernels : Kernels, optional
        Of the model, with the entry's parameter free, and perhaps a second one.

    Raises
    ------
    InputError
        If the entry is damaged, or of another model.
    """
    at = model_of(entry, model)
    kernels = kernels or Kernels(at, entry.parameter)
    if not entry.word:
        return _without_impacts(entry, at, kernels)
    problem = problem_of(at, Word(entry.word, entry.period), kernels)
    names = ["time", "velocity", *coordinates(problem.m)[2:]]
    whole = [impact for impact in entry.impacts if set(names) <= set(impact)]
    if len(whole) != len(entry.word):
        found = f"{len(whole)} impacts of the word {entry.word!r}"
        raise InputError("entry", found, "give an entry as a catalogue records it")
    rows = np.array([[impact[name] for name in names] for impact in whole])
    return _solved(problem, _closing(problem, rows, entry.orbit_period, "entry"), "entry")


def orbit_at(branch: Branch, place: int | str, model: Model | None = None) -> Orbit:
    """Return the orbit of a row of a branch; see `Branch.orbit`."""
    where = f"branch {branch.id}"
    if isinstance(place, str):
        return orbit_of(event_of_branch(branch, place), model)
    row = _row(branch, place, where)
    at = model_at(branch, row, model)
    problem = problem_of(at, Word(branch.word, branch.period), Kernels(at, branch.parameter))
    unknowns = [branch[name][row] for name in columns_of(branch.word, problem.m)]
    rows = np.reshape(unknowns, (-1, problem.m))
    period = branch[PERIOD][row] if PERIOD in branch.columns else None
    return _solved(problem, _closing(problem, rows, period, where), where)


def _closing(problem: OrbitProblem, rows: Array, period: float | None, where: str) -> Array:
    """The impacts of a record in the clock of the unknowns."""
    if not problem.autonomous:
        return rows
    if period is None:
        raise InputError(where, "it has no period", "give what a catalogue records")
    if not problem.word.walls:  # it stands in the place of a velocity that is zero
        rows[0, 1] = period
        return rows
    return problem.placed(rows, period)


def _without_impacts(entry: Entry, at: Model, kernels: Kernels) -> Orbit:
    """The orbit of the word `0` that has an entry's multipliers: there are no impacts to go by."""
    found = find_orbits(at, Word("", entry.period), kernels=kernels)
    if not found:
        accepted = "give the model it was computed with"
        raise InputError("entry", "no orbit without impacts was found", accepted)
    told = np.array([np.inf if pair is None else complex(*pair) for pair in entry.multipliers])
    return min(found, key=lambda orbit: float(np.max(np.abs(orbit.multipliers - told))))


def event_of_branch(branch: Branch, name: str) -> Entry:
    """The event of a name on a branch."""
    found = named_by_id(branch.events, name) or named_by_kind(branch.events, name)
    if found is None:
        known = ", ".join(entry.id for entry in branch.events) or "none"
        known += kinds_of(branch.events, name)
        raise InputError(f"branch {branch.id}", f"no event {name!r}", f"its events are {known}")
    return found


def _row(branch: Branch, place: int, where: str) -> int:
    """The number of a row, counted from the end if it is negative."""
    accepted = f"give a row from 0 to {len(branch) - 1}, or the name of an event"
    try:
        row = operator.index(place)
    except TypeError:
        raise InputError(where, f"found {shown(place)}", accepted) from None
    if not -len(branch) <= row < len(branch):
        raise InputError(where, f"no row {row}", accepted)
    return row


def _solved(problem: OrbitProblem, rows: Array, where: str) -> Orbit:
    """The orbit of these impacts at the model's parameters, if it solves the equations."""
    free = [problem.model.values[name] for name in problem.kernels.parameters]
    here = problem.evaluate(np.append(rows.ravel(), free))
    if not here.largest_residual < SOLVED:
        found = f"it is no orbit of this model (residual {here.largest_residual:.2g})"
        raise InputError(where, found, "give the model it was computed with")
    return Orbit(problem, here)


def orbit_with(model: Model, word: tuple[str, int], parameter: str, unknowns: Array) -> Orbit:
    """Return the orbit of a word, its walls and its period, that has these unknowns."""
    problem = problem_of(model, Word(*word), Kernels(model, parameter))
    if len(unknowns) != problem.n + 1:
        found = f"{len(unknowns)} unknowns of the word {problem.word}"
        raise InputError("orbit", found, f"give {problem.n + 1}")
    return _solved(problem, unknowns[:-1].reshape(-1, problem.m), "orbit")


# The system of a record.


def named_model(record: Mapping[str, Any], given: Model | None = None) -> Model:
    """Return the given model, or the one a record names, at the record's parameter values."""
    options, parameters = dict(record["options"]), dict(record["parameters"])
    return _model(str(record["system"]), options, parameters, given, "the file")


def model_of(entry: Entry, given: Model | None = None) -> Model:
    """Return the given model, or the one an entry names, at the entry's parameter values.

    Raises
    ------
    InputError
        If its system is not known, or another one than the given.
    """
    return _model(entry.system, entry.options, entry.parameters, given, "entry")


def model_at(branch: Branch, row: int, given: Model | None = None) -> Model:
    """Return the given model, or the one a branch names, at a row's parameter values.

    Raises
    ------
    InputError
        If its system is not known, or another one than the given.
    """
    parameters = {name: float(branch[name][row]) for name in branch.parameters}
    return _model(branch.system, branch.options, parameters, given, f"branch {branch.id}")


def _model(
    name: str | None,
    options: Mapping[str, str],
    parameters: Mapping[str, float],
    given: Model | None,
    where: str,
) -> Model:
    """The given model, or the one of a system by name, at recorded parameter values."""
    if given is None:
        kind = _system(name, where)
        return kind(**options, **{k: v for k, v in parameters.items() if k not in kind.DERIVED})
    if not isinstance(given, Model):
        raise InputError("model", f"found {shown(given)}", "give a model, such as ImpactPair(...)")
    if missing := [own for own in given.values if own not in parameters]:
        accepted = f"give a model with {', '.join(parameters)}"
        raise InputError(where, f"it has no parameter {missing[0]!r}", accepted)
    return given.replace(**{own: parameters[own] for own in given.values})


def _system(name: str | None, where: str) -> type[Model]:
    """The class of a system: one of the package's, or one of the user's that is imported."""
    accepted = "give the model it was computed with, as model="
    if name is None:
        raise InputError(where, "it does not say of what system it is", accepted)
    known = _classes(name)
    if len(known) != 1:
        found = f"{len(known)} imported classes are the system {name!r}"
        raise InputError(where, found, accepted)
    return known[0]


def imported_system(name: str) -> type[Model] | None:
    """Return the class of a system by its name; None if it is not imported, or ambiguous."""
    known = _classes(name)
    return known[0] if len(known) == 1 else None


def _classes(name: str) -> list[type[Model]]:
    if (kind := installed(name)) is not None:
        return [kind]
    # a class that is defined again, as in a notebook, replaces the earlier one
    own = {
        (k.__module__, k.__qualname__): k
        for k in _below(Model)
        if getattr(k, "SYSTEM", None) == name
    }
    return list(own.values())


def _below(kind: Any) -> Iterator[type[Model]]:
    """All subclasses, in the order of their definition."""
    for one in kind.__subclasses__():
        yield one
        yield from _below(one)
