"""Machines and systems that a scene states: read, repeated, and made into a model.

What a scene states is checked here without SymPy, and kept as one text, by which the machine is
known in records.
"""

from __future__ import annotations

import json
import math
from abc import abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from fractions import Fraction
from functools import cache
from random import Random
from typing import Any, ClassVar, Protocol, Self, TypeAlias, TypeVar

from ..errors import DAMAGE, InputError, short_repr, shorten
from ..schema import build_record
from .expressions import (
    CONSTANTS,
    FUNCTIONS,
    Combination,
    arguments_in,
    check_at_values,
    check_expression,
    combination_of,
    names_in,
    number,
)
from .guards import AMBIGUOUS, rival_guards
from .model import Model

T = TypeVar("T", bound="MachineTable")

# Whether stated laws repeat after the period that is stated, and after which they would.
#
# Laws are evaluated at random times, states and parameter values, without SymPy.

Timed: TypeAlias = Callable[[float], float]
"""A law as a function of the time alone."""
TIMES, FAR = 7, 1e3
MOST = 12
"""How many times a period, or what part of it, is tried in its place."""
TOLERANCE = 1e-6
"""Tolerance as a part of the law's variation in time."""
ROUNDING = 1e-12
"""Rounding as a part of a law's size."""


class MachineTable(Protocol):
    """What a scene states."""

    @property
    def period(self) -> str:
        """An expression of the parameters."""

    def check(self) -> None:
        """Refuse expressions of anything but what has a value where they are."""

    def in_time(self, values: Mapping[str, float]) -> dict[str, Timed]:
        """Return the laws in which the time stands, by their keys, at a state and the values."""

    def angles(self, values: Mapping[str, float]) -> Sequence[Timed]:
        """Return what the sines and cosines of the time are of."""


def check_period(stated: MachineTable, values: Mapping[str, float]) -> None:
    """Refuse a period of the forcing that is none, where a system is stated: InputError has the
    place in the scene's table. Branches may lead to where there is none, and end on the way."""
    period = number(stated.period, "period", values)
    if not period > 0.0:
        raise InputError("period", f"it is {period:.6g}", "give the period of the forcing, above 0")
    said = f"it is {period:.6g} ({shorten(stated.period)}), after which"
    laws = stated.in_time(values)
    if wrong := _not_repeating(laws, period):
        accepted = "give one after which all laws repeat"
        for factor, other in _candidate_periods(period, stated.angles(values)):
            if not _not_repeating(laws, other):
                accepted = f"they repeat after {other:.6g}"
                accepted += f", {factor} times as long" if factor else ""
                break
        raise InputError("period", f"{said} {wrong} does not repeat", accepted)
    near = values_near(values, 6)
    try:
        period = number(stated.period, "period", near)
    except InputError:
        return
    if period > 0.0 and (wrong := _not_repeating(stated.in_time(near), period)):
        found = f"{said} {wrong} repeats at these values of the parameters alone"
        raise InputError("period", found, "give the period as an expression of the parameters")


def values_near(values: Mapping[str, float], seed: int) -> dict[str, float]:
    """Return random values of the parameters near these."""
    random = Random(seed)
    return {n: v * random.uniform(0.9, 1.1) if v else 0.1 for n, v in values.items()}


def _candidate_periods(period: float, angles: Sequence[Timed]) -> list[tuple[str, float]]:
    """Periods that are tried in the place of one, from the shortest on: small multiples of it, and
    of those of sines and cosines."""
    numbers = range(1, MOST + 1)
    factors = sorted({Fraction(m, n) for m in numbers for n in numbers})
    found = [(str(factor), float(factor) * period) for factor in factors]
    rates = [abs(angle(1.0) - angle(0.0)) for angle in angles]
    found += [("", k * 2 * math.pi / rate) for rate in rates if rate > 0.0 for k in numbers]
    return sorted(found, key=lambda pair: pair[1])


def _not_repeating(laws: Mapping[str, Timed], period: float) -> str | None:
    """The key of a law that takes other values one period later."""
    return next((name for name, law in laws.items() if not _repeats(law, period)), None)


def _repeats(law: Timed, period: float) -> bool:
    random = Random(5)
    parts = [random.uniform(-1.0, 1.0) for _ in range(TIMES)]
    times = [period * part for part in parts]
    try:
        now, later = [law(t) for t in times], [law(t + period) for t in times]
        varied, size = max(now) - min(now), max(map(abs, (*now, *later)))
        apart = max(abs(a - b) for a, b in zip(now, later, strict=True))
        if apart > TOLERANCE * varied + ROUNDING * size:
            return False
        if varied > ROUNDING * size:
            return True
        elsewhere = [law(FAR * part) for part in parts]  # nothing happens in so short a time
    except InputError:  # without a value there
        return True
    return max(elsewhere) - min(elsewhere) <= ROUNDING * size


def time_function(text: str, values: Mapping[str, float], time: str) -> Timed:
    """Return an expression as a function of the time."""
    return lambda t: number(text, "period", {**values, time: t})


MOST_COORDINATES = 20
MATRICES = ("mass", "damping", "stiffness")
LARGEST = 1e100
"""Largest of the numbers in matrices and forces."""
TIME = "t"


@dataclass(frozen=True)
class StatedGuard:
    """A rigid stop, or an impact between bodies."""

    name: str
    """Its letter."""
    row: tuple[float, ...]
    """The gap coordinate: a factor for each coordinate."""
    side: int
    """+1 where the gap coordinate stays below the position, -1 where it stays above."""
    position: str
    restitution: str
    """`position`, `restitution`: expressions of the parameters."""


@dataclass(frozen=True)
class Machine:
    """Everything a linear machine is made of, in the order of its coordinates."""

    parameters: tuple[str, ...]
    coordinates: tuple[str, ...]
    mass: tuple[tuple[str, ...], ...]
    damping: tuple[tuple[str, ...], ...]
    stiffness: tuple[tuple[str, ...], ...]
    force: tuple[str, ...]
    """Expressions of `TIME` and the parameters."""
    period: str
    guards: tuple[StatedGuard, ...]

    @property
    def text(self) -> str:
        """The machine as a text, from which `statement_of` makes it again."""
        return json.dumps(asdict(self), separators=(",", ":"))

    @property
    def lines(self) -> list[tuple[str, str]]:
        """The machine for readers: headings with a text each."""
        matrices = ((name, _matrix_entry(getattr(self, name))) for name in MATRICES)
        stays = [stay_text(self.coordinates, g.row, g.side, g.position) for g in self.guards]
        guards = (
            f"{guard.name}: {there}, restitution {guard.restitution}"
            for guard, there in zip(self.guards, stays, strict=True)
        )
        return [
            ("position", ", ".join(self.coordinates)),
            *matrices,
            ("force", ", ".join(self.force)),
            ("period", self.period),
            *(("guard", text) for text in guards),
        ]

    @property
    def expressions(self) -> list[str]:
        """All that parameters may stand in."""
        rows = (*self.mass, *self.damping, *self.stiffness, self.force, (self.period,))
        at_guards = (text for guard in self.guards for text in (guard.position, guard.restitution))
        return [*(text for row in rows for text in row), *at_guards]

    def in_time(self, values: Mapping[str, float]) -> dict[str, Timed]:
        """Return the forces in which the time stands, by their keys."""
        forces = ((f"force[{i}]", text) for i, text in enumerate(self.force))
        return {
            key: time_function(text, values, TIME) for key, text in forces if TIME in names_in(text)
        }

    def angles(self, values: Mapping[str, float]) -> list[Timed]:
        """Return what the sines and cosines of the time are of."""
        return angles_of(self.force, values)

    def check(self) -> None:
        """Refuse expressions of anything but the parameters, and of the time in forces."""
        for name in self.parameters:
            if what := meaning_of(name):
                found = f"the name {name!r}, which is {what}"
                raise InputError(f"parameters.{name}", found, "give another name")
        for name in MATRICES:
            for i, row in enumerate(getattr(self, name)):
                for j, text in enumerate(row):
                    check_expression(text, f"{name}[{i}][{j}]", self.parameters, growing=True)
        for i, text in enumerate(self.force):
            check_expression(text, f"force[{i}]", (TIME, *self.parameters), growing=True)
        check_expression(self.period, "period", self.parameters, growing=True)
        if not self.guards:
            raise InputError("guards", "none", "give at least one")
        for guard in self.guards:
            where = f"guards.{guard.name}"
            check_expression(guard.position, f"{where}.within", self.parameters, growing=True)
            check_expression(
                guard.restitution, f"{where}.restitution", self.parameters, growing=True
            )


def _matrix_entry(matrix: Sequence[Sequence[str]]) -> str:
    """A matrix as a scene has it: its rows, or the entries of its diagonal."""
    size = range(len(matrix))
    if all(matrix[i][j] == "0" for i in size for j in size if i != j):
        return f"diagonal {', '.join(matrix[i][i] for i in size)}"
    return "; ".join(", ".join(row) for row in matrix)


def meaning_of(name: str, parameters: Collection[str] = ()) -> str:
    """Return what a name means in expressions; nothing if it is free."""
    if name == TIME:
        return "the time"
    if name in FUNCTIONS:
        return "a function"
    if name in CONSTANTS:
        return "a constant"
    return "a parameter" if name in parameters else ""


def stay_text(coordinates: Sequence[str], row: Sequence[float], side: int, position: str) -> str:
    """Return where a system stays before a guard, as scenes have it."""
    gap = ""
    for factor, name in zip(row, coordinates, strict=False):
        if factor:
            size = "" if abs(factor) == 1 else f"{abs(factor):.12g}*"
            sign = "-" if factor < 0 else "+"
            gap += f" {sign} {size}{name}" if gap else f"{sign.strip('+')}{size}{name}"
    return f"{gap} {'<=' if side > 0 else '>='} {position}"


def angles_of(texts: Sequence[str], values: Mapping[str, float]) -> list[Timed]:
    """Return what sines and cosines are of in some expressions, where that is the time alone."""
    known = {TIME, *values, *CONSTANTS}
    angles = (angle for text in texts for angle in arguments_in(text, ("sin", "cos")))
    named = ((angle, set(names_in(angle))) for angle in angles)
    return [time_function(angle, values, TIME) for angle, names in named if TIME in names <= known]


def statement_of(kind: type[T], text: str) -> T:
    """Return the machine, or the modes, that a text holds.

    Raises InputError if it is no such text.
    """
    try:
        found = build_record(kind, json.loads(text))
    except DAMAGE as error:
        accepted = "state the system in a scene, with its laws or matrices and guards"
        raise InputError("machine", f"found {short_repr(text)}", accepted) from error
    found.check()
    return found


def machine_of_table(given: Mapping[str, Any], parameters: Sequence[str]) -> Machine:
    """Return the machine of a scene's table, in the parameters that have a value.

    Raises InputError with the place in the table.
    """
    names = _coordinates(given["coordinates"], parameters)
    matrices = {name: _matrix(given[name], len(names), name) for name in MATRICES}
    force = _expressions(given["force"], len(names), "force")
    guards = tuple(_guard(name, g, names, parameters) for name, g in given["guards"].items())
    period = text_of(given["period"], "period")
    machine = Machine(
        tuple(parameters), names, **matrices, force=force, period=period, guards=guards
    )
    machine.check()
    return machine


def check_use(parameters: Sequence[str], expressions: Sequence[str]) -> None:
    """Refuse a parameter in none of the expressions: it may be one with its name misspelt.
    InputError has the place in the scene's table."""
    used = {name for text in expressions for name in names_in(text)}
    for name in parameters:
        if name not in used:
            accepted = f"use {name} in the machine, or take its value away"
            raise InputError(f"parameters.{name}", "no expression has it", accepted)


def _coordinates(names: Any, parameters: Sequence[str]) -> tuple[str, ...]:
    accepted = f"give a list of 1 to {MOST_COORDINATES} names, each once"
    if not isinstance(names, list) or not 1 <= len(names) <= MOST_COORDINATES:
        raise InputError("coordinates", f"found {short_repr(names)}", accepted)
    for i, name in enumerate(names):
        if not isinstance(name, str) or not name.isidentifier() or name in names[:i]:
            raise InputError(f"coordinates[{i}]", f"found {short_repr(name)}", accepted)
        if what := meaning_of(name, parameters):
            found = f"the name {name!r}, which is {what}"
            raise InputError(f"coordinates[{i}]", found, "give a name of its own")
    return tuple(names)


def _matrix(given: Any, size: int, where: str) -> tuple[tuple[str, ...], ...]:
    """A square matrix: a list of rows, or of the entries of its diagonal."""
    if not isinstance(given, list) or len(given) != size:
        accepted = f"give {size} rows of {size} entries, or the {size} entries of the diagonal"
        raise InputError(where, f"found {short_repr(given)}", accepted)
    if not any(isinstance(row, list) for row in given):
        diagonal = _expressions(given, size, where)
        places = range(size)
        return tuple(tuple(diagonal[i] if i == j else "0" for j in places) for i in places)
    return tuple(_expressions(row, size, f"{where}[{i}]") for i, row in enumerate(given))


def _expressions(given: Any, size: int, where: str) -> tuple[str, ...]:
    if not isinstance(given, list) or len(given) != size:
        raise InputError(where, f"found {short_repr(given)}", f"give a list of {size} entries")
    return tuple(text_of(e, f"{where}[{i}]") for i, e in enumerate(given))


def text_of(given: Any, where: str) -> str:
    """A number or a text as a text."""
    if isinstance(given, str):
        return given
    if isinstance(given, bool) or not isinstance(given, int | float):
        accepted = "give a number, or an expression in quotes"
        raise InputError(where, f"found {short_repr(given)}", accepted)
    if not abs(given) <= LARGEST:
        accepted = f"give a number of at most {LARGEST:g}"
        raise InputError(where, f"found {short_repr(given)}", accepted)
    return repr(given)


def _guard(
    name: str, given: Any, coordinates: Sequence[str], parameters: Sequence[str]
) -> StatedGuard:
    where = f"guards.{name}"
    if not isinstance(given, Mapping):
        accepted = 'give { within = "...", restitution = "..." }'
        raise InputError(where, f"found {short_repr(given)}", accepted)
    for key in given:
        if key not in ("within", "restitution"):
            raise InputError(f"{where}.{key}", "unknown key", "accepted are within, restitution")
    for key in ("within", "restitution"):
        if key not in given:
            raise InputError(f"{where}.{key}", "missing", f"give {key}, an expression in quotes")
    row, side, position = surface_of(given["within"], f"{where}.within", coordinates, parameters)
    restitution = text_of(given["restitution"], f"{where}.restitution")
    return StatedGuard(name, row, side, position, restitution)


def surface_of(
    text: Any, where: str, coordinates: Sequence[str], parameters: Sequence[str]
) -> tuple[tuple[float, ...], int, str]:
    """Return row, side and position of a stated guard; where it is on one coordinate, this is the
    gap coordinate, whatever factor it has.

    Raises InputError with the text as it was stated.
    """
    gap, side, position = _sides(text, where, coordinates)
    row = row_of(gap, where, coordinates)
    factors = [factor for factor in row if factor]
    if len(factors) > 1 or factors == [1.0]:
        return row, side, position
    check_expression(position, where, parameters, growing=True)
    (factor,) = factors
    divisor = int(factor) if factor.is_integer() else factor
    position = f"-({position})" if factor == -1.0 else f"({position})/({divisor!r})"
    return tuple(float(c != 0.0) for c in row), side if factor > 0.0 else -side, position


def _sides(text: Any, where: str, coordinates: Sequence[str]) -> tuple[str, int, str]:
    """The gap coordinate, +1 where it stays below its position, and the position."""
    accepted = f'give where the machine stays, such as "{coordinates[0]} <= sigma"'
    found = f"found {short_repr(text)}"
    signs = [s for s in ("<=", ">=") if isinstance(text, str) and s in text]
    if len(signs) != 1 or text.count(signs[0]) != 1:
        raise InputError(where, found, f"{accepted}: one <= or >=, for each side a guard")
    sides = [part.strip() for part in text.split(signs[0])]
    moving = [any(name in coordinates for name in names_in(part)) for part in sides]
    if moving == [True, True] or any(
        moves and set(names_in(part)) - {*coordinates, *CONSTANTS}
        for moves, part in zip(moving, sides, strict=True)
    ):
        accepted += (
            ": coordinates alone on one side, with numbers for factors, parameters on the other "
            '(write "k*x <= 1" as "x <= 1/k"; for "x1 - k*x2 <= 1" make k*x2 a coordinate)'
        )
        raise InputError(where, found, accepted)
    below = (signs[0] == "<=") is not (moving == [False, True])
    gap, position = reversed(sides) if moving == [False, True] else sides
    return gap, +1 if below else -1, position


def row_of(text: str, where: str, coordinates: Sequence[str]) -> tuple[float, ...]:
    """The factors of a linear combination of coordinates."""
    check_expression(text, where, coordinates)
    size = len(coordinates)
    units = (Combination(tuple(float(i == j) for j in range(size))) for i in range(size))
    found = combination_of(text, where, dict(zip(coordinates, units, strict=True)))
    if found is None or not any(found.factors) or not all(map(math.isfinite, found.factors)):
        accepted = (
            f"give a linear combination of {', '.join(coordinates)}, such as {coordinates[0]}"
        )
        raise InputError(where, f"found {short_repr(text.strip())}", accepted)
    return tuple(c + 0.0 for c in found.factors)


def check_values(machine: Machine, values: Mapping[str, float]) -> None:
    """Refuse parameter values for which a machine has no motion, or an impact none: InputError has
    the place in the scene's table.

    Impacts push along the guards through the mass matrix, which is that of the kinetic energy:
    symmetric and positive definite.
    """
    mass = [
        [number(e, f"mass[{i}][{j}]", values) for j, e in enumerate(row)]
        for i, row in enumerate(machine.mass)
    ]
    _check_mass(mass)
    texts = {f"force[{i}]": text for i, text in enumerate(machine.force)}
    for name, matrix in (("damping", machine.damping), ("stiffness", machine.stiffness)):
        rows = enumerate(matrix)
        texts |= {f"{name}[{i}][{j}]": e for i, row in rows for j, e in enumerate(row)}
    check_at_values(texts, values)
    for guard in machine.guards:
        where = f"guards.{guard.name}.restitution"
        restitution = number(guard.restitution, where, values)
        if not 0.0 <= restitution <= 1.0:
            raise InputError(where, f"it is {restitution:.6g}", "it must be from 0 to 1")


def _check_mass(mass: list[list[float]]) -> None:
    """Refuse a matrix that is not symmetric or not positive definite."""
    size = len(mass)
    for i in range(size):
        for j in range(i):
            if abs(mass[i][j] - mass[j][i]) > 1e-12 * max(abs(mass[i][j]), abs(mass[j][i])):
                found = f"it is {mass[i][j]:.6g}, and mass[{j}][{i}] is {mass[j][i]:.6g}"
                raise InputError(f"mass[{i}][{j}]", found, "give a symmetric matrix")
    rest = [row[:] for row in mass]
    for k in range(size):
        if not rest[k][k] > 1e-14 * mass[k][k]:
            found = f"the matrix {short_repr(mass)} is not positive definite (row {k})"
            raise InputError("mass", found, "give masses above 0")
        for i in range(k + 1, size):
            factor = rest[i][k] / rest[k][k]
            rest[i] = [a - factor * b for a, b in zip(rest[i], rest[k], strict=True)]


# Systems that scenes state themselves: each by one text, of which its class is made.


class StatedSystem(Model):
    """A system by the text of its statement, `machine`, which the class of an instance has read,
    and a value for each parameter of it."""

    PARAMETERS = ()
    STATED = True
    OPTIONS: ClassVar[Mapping[str, str]] = {"machine": ""}
    machine: ClassVar[Any]

    def __new__(cls, /, **given: Any) -> Self:
        kind: Any = (
            cls if hasattr(cls, "machine") else _class_of(cls, str(given.get("machine", "")))
        )
        return object.__new__(kind)

    def __init__(self, /, **given: Any) -> None:
        super().__init__(**given)
        check_period(type(self).machine, self.values)
        self._check_surfaces()

    def _check_surfaces(self) -> None:
        """Refuse two guards that are met at once whatever the parameters are: InputError has the
        place in the scene's table."""
        positions = {guard.name: guard.position for guard in type(self).machine.guards}
        near = [values_near(self.values, seed) for seed in range(3)]
        for one, other, factor in rival_guards(self.WALLS, self.DEGREES_OF_FREEDOM):
            where = f"guards.{other.name}.within"
            try:
                places = [
                    (
                        factor * number(positions[one.name], where, values),
                        number(positions[other.name], where, values),
                    )
                    for values in (self.values, *near)
                ]
            except InputError:  # without a value there
                continue
            if all(abs(a - b) <= ROUNDING * max(abs(a), abs(b)) for a, b in places):
                found = f"it is the surface of {one.name!r}, met in the same mode and direction"
                raise InputError(where, found, AMBIGUOUS)

    def statement(self) -> list[tuple[str, str]]:
        """Return what a scene states, for readers, as headings with a text each."""
        lines = type(self).machine.lines
        return [("model", self.SYSTEM), *lines, ("values", self._listed())]

    def __repr__(self) -> str:
        coordinates, guards = ", ".join(self.coordinates), ", ".join(self.letters)
        return f"<{self.SYSTEM} system of {coordinates} with guards {guards}: {self._listed()}>"

    def __copy__(self) -> Self:
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        return other

    def __reduce__(self) -> tuple[Any, ...]:
        return _make_system, (type(self).__base__, self.options["machine"], dict(self.values))

    def place(self, what: str, name: str = "") -> str:
        """Return the key of a scene."""
        if not name:
            return f"model.{what}" if what in ("period", "mass") else "model"
        guard = next(g for g in type(self).machine.guards if g.name == name)
        set_there = ".set" if getattr(guard, "after", ()) else ""
        key = {"walls": ".within", "reset": set_there, "jump": set_there}.get(what.split()[0], "")
        return f"model.guards.{name}{key}"

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The names of the coordinates, of the mode that has most."""
        return type(self).machine.coordinates

    @classmethod
    @abstractmethod
    def attributes_of(cls, text: str) -> dict[str, Any]:
        """Return the attributes of the class of a statement, which is among them as `machine`."""


@cache
def _class_of(kind: type[StatedSystem], text: str) -> type[StatedSystem]:
    """Return the class of a statement."""
    named = {"__doc__": kind.__doc__, "__module__": kind.__module__, "OPTIONS": {"machine": text}}
    attributes = kind.attributes_of(text)
    try:
        return type(kind.__name__, (kind,), named | attributes)
    except InputError as error:
        inside = next((i for i in ("guards", "modes") if i.upper() in error.where), "parameters")
        inside = "guards" if error.where.endswith("WALLS") else inside
        raise InputError(inside, error.found, error.accepted) from None


def _make_system(kind: type[StatedSystem], text: str, values: Mapping[str, float]) -> StatedSystem:
    return kind(machine=text, **values)
