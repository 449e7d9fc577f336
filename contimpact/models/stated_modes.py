"""A hybrid system in texts: laws of motion for each mode, and guards that lead from one to another.

What a scene states is checked here without SymPy, and kept as one text, by which the system is
known in records.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from random import Random
from typing import Any, TypeAlias

from ..errors import InputError, count_text, did_you_mean, require_known, short_repr
from .expressions import CONSTANTS, FUNCTIONS, check_at_values, check_expression, names_in, number
from .machine import (
    MOST_COORDINATES,
    ROUNDING,
    TIME,
    Timed,
    angles_of,
    meaning_of,
    stay_text,
    surface_of,
    text_of,
)

Texts: TypeAlias = tuple[tuple[str, str], ...]
"""Names, and an expression for each."""
GUARD_KEYS = ("mode", "within", "to", "set", "past")


@dataclass(frozen=True)
class StatedMode:
    """A mode by the laws of its state."""

    name: str
    laws: Texts
    """The rate of change of each state variable, in that order."""

    @property
    def variables(self) -> tuple[str, ...]:
        """The names of its state."""
        return tuple(name for name, _ in self.laws)

    def velocities(self, sections: Sequence[str]) -> dict[str, str]:
        """Return the coordinates of second order, each with its velocity.

        A variable whose rate is another one has that for its velocity, unless a guard lies on it.
        """
        found: dict[str, str] = {}
        for name, law in self.laws:
            rate = law.strip()
            free = rate in self.variables and rate not in (name, *sections, *found.values())
            if free and name not in found.values() and rate not in found:
                found[name] = rate
        return found

    def coordinates(self, sections: Sequence[str]) -> tuple[str, ...]:
        """Return the names of its coordinates, in their order."""
        speeds = self.velocities(sections).values()
        return tuple(name for name in self.variables if name not in speeds)


@dataclass(frozen=True)
class StatedGuard:
    """A surface at which some modes end."""

    name: str
    """Its letter."""
    modes: tuple[str, ...]
    to: str
    """The mode it leads to."""
    row: tuple[float, ...]
    """The gap coordinate: a factor for each coordinate of the mode."""
    side: int
    """+1 where the gap coordinate stays below the position, -1 where it stays above."""
    position: str
    after: Texts
    """State variables that change there, in the state before and the parameters."""
    past: str
    """See `contimpact.models.guards.Guard.past`."""


@dataclass(frozen=True)
class StatedModes:
    """Everything a hybrid system is made of."""

    parameters: tuple[str, ...]
    definitions: Texts
    """Names for expressions that stand in laws and guards."""
    sections: tuple[str, ...]
    """State variables that guards lie on."""
    modes: tuple[StatedMode, ...]
    guards: tuple[StatedGuard, ...]
    period: str
    mass: Texts = ()
    """Masses of the coordinates; empty where nothing is said of the kinetic energy."""
    symmetry: Texts = ()
    """Guards with their images where all variables change their signs; empty without a symmetry."""

    @property
    def text(self) -> str:
        """The system as a text, from which `statement_of` makes it again."""
        given = asdict(self)
        for key in ("mass", "symmetry"):
            if not given[key]:
                del given[key]
        return json.dumps(given, separators=(",", ":"))

    @property
    def lines(self) -> list[tuple[str, str]]:
        """The system for readers: headings with a text each."""
        lines = [("define", f"{name} = {text}") for name, text in self.definitions]
        for mode in self.modes:
            laws = ", ".join(f"{name}' = {law}" for name, law in mode.laws)
            lines.append(("mode", f"{mode.name}: {laws}"))
        for guard in self.guards:
            coordinates = self.mode(guard.modes[0]).coordinates(self.sections)
            there = stay_text(coordinates, guard.row, guard.side, guard.position)
            text = f"{guard.name}: {', '.join(guard.modes)}, {there}"
            text += f", to {guard.to}" if (guard.to,) != guard.modes else ""
            text += f", past {guard.past}" if guard.past else ""
            changes = ", ".join(f"{name} = {change}" for name, change in guard.after)
            lines.append(("guard", text + (f"; {changes}" if changes else "")))
        masses = ", ".join(f"{name}: {text}" for name, text in self.mass)
        images = ", ".join(f"{name}: {image}" for name, image in self.symmetry)
        more = [(key, text) for key, text in (("mass", masses), ("symmetry", images)) if text]
        return [*lines, *more, ("period", self.period)]

    @property
    def laws(self) -> list[str]:
        """The expressions of all laws, and those that may stand in them."""
        laws = [law for mode in self.modes for _, law in mode.laws]
        return [*(text for _, text in self.definitions), *laws]

    @property
    def expressions(self) -> list[str]:
        """All that parameters may stand in."""
        changes = [text for guard in self.guards for _, text in guard.after]
        masses = (text for _, text in self.mass)
        return [*self.laws, *(g.position for g in self.guards), *changes, *masses, self.period]

    @property
    def autonomous(self) -> bool:
        """Whether the time stands nowhere in it."""
        return not any(TIME in names_in(text) for text in self.laws)

    def in_time(self, values: Mapping[str, float]) -> dict[str, Timed]:
        """Return the laws in which the time stands, by their keys, at a random state."""
        random = Random(4)
        found = {}
        timed = [
            name for name, _ in self.definitions if _depends_on_time(dict(self.definitions), name)
        ]
        for mode in self.modes:
            state = {name: random.uniform(0.1, 0.9) for name in mode.variables}
            usable = usable_definitions(self, mode)
            defined = tuple(pair for pair in self.definitions if pair[0] in usable)
            for name, law in mode.laws:
                if {TIME, *timed}.intersection(names_in(law)):
                    at = {**values, **state}
                    found[f"modes.{mode.name}.{name}"] = _add_definitions(law, defined, at)
        return found

    def angles(self, values: Mapping[str, float]) -> list[Timed]:
        """Return what the sines and cosines of the time are of."""
        return angles_of(self.laws, values)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The coordinates of the mode that has most."""
        return max((mode.coordinates(self.sections) for mode in self.modes), key=len)

    @property
    def degrees_of_freedom(self) -> int:
        """How many these are."""
        return len(self.coordinates)

    def mode(self, name: str) -> StatedMode:
        """Return a mode by its name."""
        return next(mode for mode in self.modes if mode.name == name)

    def check(self) -> None:
        """Refuse expressions of anything but what has a value where they stand."""
        known = self.parameters
        for name, text in self.definitions:
            variables = [v for mode in self.modes for v in mode.variables]
            before = [n for n, _ in self.definitions[: [*dict(self.definitions)].index(name)]]
            usable = (TIME, *known, *before, *variables)
            _check_known(text, f"define.{name}", usable)
            check_expression(text, f"define.{name}", usable, growing=True)
        check_expression(self.period, "period", known, growing=True)
        if not self.guards:
            raise InputError("guards", "none", "give at least one")
        for mode in self.modes:
            usable = (TIME, *known, *mode.variables, *usable_definitions(self, mode))
            for name, text in mode.laws:
                _check_laws_are_there(self, mode, name, usable)
                check_expression(text, f"modes.{mode.name}.{name}", usable, growing=True)
        for guard in self.guards:
            _check_guard(guard, self)
        if self.mass:
            _check_mass(self)


def _add_definitions(
    law: str, defined: Sequence[tuple[str, str]], at: Mapping[str, float]
) -> Timed:
    def value(t: float) -> float:
        known = {**at, TIME: t}
        for name, text in defined:
            known[name] = number(text, "define", known)
        return number(law, "modes", known)

    return value


def modes_of_table(given: Mapping[str, Any], parameters: Sequence[str]) -> StatedModes:
    """Return the system of a scene's table, in the parameters that have a value.

    Raises InputError with the place in the table.
    """
    definitions = _texts(given["define"], "define")
    _check_names([*parameters], "parameters", (*FUNCTIONS, *CONSTANTS, TIME))
    taken = (*parameters, *FUNCTIONS, *CONSTANTS, TIME)
    _check_names([name for name, _ in definitions], "define", taken)
    modes = tuple(
        _mode(name, laws, (*taken, *dict(definitions))) for name, laws in given["modes"].items()
    )
    if not modes:
        raise InputError("modes", "none", "give at least one")
    modes = tuple(_in_one_order(modes))
    tables = {name: _guard_table(name, g, modes) for name, g in given["guards"].items()}
    sections = dict.fromkeys(
        name
        for _, mode, table in tables.values()
        for name in names_in(str(table["within"]).replace("<=", "-").replace(">=", "-"))
        if name in mode.variables
    )
    guards = tuple(
        _guard(name, names, mode, table, tuple(sections), parameters)
        for name, (names, mode, table) in tables.items()
    )
    period = text_of(given["period"], "period")
    found = StatedModes(
        tuple(parameters),
        definitions,
        tuple(sections),
        modes,
        guards,
        period,
        _texts(given["mass"], "mass"),
        _texts(given["symmetry"], "symmetry"),
    )
    found.check()
    return found


def _texts(given: Any, where: str) -> Texts:
    """Names and expressions of a table."""
    if not isinstance(given, Mapping):
        raise InputError(where, f"found {short_repr(given)}", 'give a table such as { x = "v" }')
    return tuple((name, text_of(e, f"{where}.{name}")) for name, e in given.items())


def _check_names(names: Sequence[str], where: str, taken: Sequence[str]) -> None:
    for name in names:
        if not name.isidentifier() or name in taken:
            what = meaning_of(name) or ("a parameter or a definition" if name in taken else "")
            found = f"the name {short_repr(name)}" + (what and f", which is {what}")
            accepted = "give a name of its own, of letters, digits and underscores"
            raise InputError(f"{where}.{name}", found, accepted)


def _mode(name: str, laws: Any, taken: Sequence[str]) -> StatedMode:
    where = f"modes.{name}"
    mode = StatedMode(name, _texts(laws, where))
    if not 1 <= len(mode.laws) <= 2 * MOST_COORDINATES:
        accepted = f"give the rates of 1 to {2 * MOST_COORDINATES} variables"
        raise InputError(where, f"found {count_text(len(mode.laws), 'law')}", accepted)
    _check_names(mode.variables, where, taken)
    return mode


def _in_one_order(modes: Sequence[StatedMode]) -> Iterator[StatedMode]:
    """Modes whose laws of variables that earlier modes have are in the order that these have."""
    order: dict[str, int] = {}
    for mode in modes:
        known = iter(
            sorted((law for law in mode.laws if law[0] in order), key=lambda e: order[e[0]])
        )
        yield replace(mode, laws=tuple(next(known) if e[0] in order else e for e in mode.laws))
        for variable in mode.variables:
            order.setdefault(variable, len(order))


def _guard_table(
    name: str, given: Any, modes: Sequence[StatedMode]
) -> tuple[tuple[str, ...], StatedMode, Mapping[str, Any]]:
    """The modes that a guard ends, the first of them, and its table."""
    where = f"guards.{name}"
    if not isinstance(given, Mapping):
        raise InputError(where, f"found {short_repr(given)}", 'give { within = "x <= sigma" }')
    for key in given:
        require_known(key, GUARD_KEYS, f"{where}.{key}", "unknown key")
    if "within" not in given:
        raise InputError(f"{where}.within", "missing", 'give it, such as "x <= sigma"')
    known = {mode.name: mode for mode in modes}
    first = modes[0].name if len(modes) == 1 else None
    ended = given.get("mode", first)
    names = tuple(ended) if isinstance(ended, list) else (ended,)
    accepted = f"the modes are {', '.join(known)}"
    if not names:
        raise InputError(f"{where}.mode", "empty", accepted)
    for key, mode in (*(("mode", name) for name in names), ("to", given.get("to", names[0]))):
        if not isinstance(mode, str) or mode not in known:
            found = "missing" if mode is None else f"found {short_repr(mode)}"
            raise InputError(f"{where}.{key}", found, accepted)
    if not isinstance(given.get("past", ""), str):
        raise InputError(
            f"{where}.past", f"found {short_repr(given['past'])}", "give a guard's letter"
        )
    return names, known[names[0]], given


def _guard(
    name: str,
    names: tuple[str, ...],
    mode: StatedMode,
    given: Mapping[str, Any],
    sections: Sequence[str],
    parameters: Sequence[str],
) -> StatedGuard:
    where = f"guards.{name}"
    coordinates = mode.coordinates(sections)
    row, side, position = surface_of(given["within"], f"{where}.within", coordinates, parameters)
    after, past = _texts(given.get("set", {}), f"{where}.set"), given.get("past", "")
    return StatedGuard(name, names, given.get("to", names[0]), row, side, position, after, past)


def _check_mass(given: StatedModes) -> None:
    """Refuse masses of what is no coordinate, and a coordinate with a velocity but without one."""
    known = list(dict.fromkeys(n for m in given.modes for n in m.coordinates(given.sections)))
    moving = {n for m in given.modes for n, law in m.laws if law.strip() in m.variables}
    for name, text in given.mass:
        if name not in known:
            found = f"{name!r} is no coordinate"
            raise InputError(f"mass.{name}", found, f"the coordinates are {', '.join(known)}")
        check_expression(text, f"mass.{name}", given.parameters, growing=True)
    for name in known:
        if name in moving and name not in dict(given.mass):
            raise InputError(f"mass.{name}", "missing", "give each coordinate its mass, or 0")


def check_values(given: StatedModes, values: Mapping[str, float]) -> None:
    """Refuse parameter values at which a law has none, and negative masses."""
    texts = {f"define.{name}": text for name, text in given.definitions}
    for mode in given.modes:
        texts |= {f"modes.{mode.name}.{name}": law for name, law in mode.laws}
    check_at_values(texts, values)
    for name, text in given.mass:
        mass = number(text, f"mass.{name}", values)
        if mass < 0.0:
            raise InputError(f"mass.{name}", f"it is {mass:.6g}", "it must be 0 or more")


def _check_known(text: str, where: str, usable: Sequence[str]) -> None:
    """Refuse a name in a definition that is none of a mode's variables, nor anything else."""
    for name in names_in(text):
        if name not in (*usable, *FUNCTIONS, *CONSTANTS):
            found = f"unknown name {short_repr(name)}{did_you_mean(name, usable)}"
            accepted = "give it a law in a mode, or a value among the parameters"
            raise InputError(where, found, accepted)


def _check_laws_are_there(
    given: StatedModes, mode: StatedMode, variable: str, usable: Sequence[str]
) -> None:
    """Refuse a law that needs a variable of which its mode has none."""
    law = dict(mode.laws)[variable]
    known, definitions = {*usable, *FUNCTIONS, *CONSTANTS}, dict(given.definitions)
    for name in (n for n in names_in(law) if n not in known):
        lacking, needs = name, f"the law of {variable!r}"
        while lacking in definitions:
            needs = f"{lacking!r} in {needs}"
            lacking = next(n for n in names_in(definitions[lacking]) if n not in known)
        elsewhere = any(lacking in other.variables for other in given.modes)
        if elsewhere or name in definitions or law.strip() == name:
            found = f"no law for {lacking!r}, which {needs} has"
            raise InputError(f"modes.{mode.name}", found, f"give the rate of change of {lacking}")


def _check_guard(guard: StatedGuard, given: StatedModes) -> None:
    where = f"guards.{guard.name}"
    _check_without_time(guard.position, f"{where}.within", given)
    check_expression(guard.position, f"{where}.within", given.parameters, growing=True)
    if guard.past and guard.past not in (other.name for other in given.guards):
        accepted = f"the guards are {', '.join(other.name for other in given.guards)}"
        raise InputError(f"{where}.past", f"found {short_repr(guard.past)}", accepted)
    before, after = given.mode(guard.modes[0]), given.mode(guard.to)
    for name in guard.modes[1:]:
        if given.mode(name).variables != before.variables:
            found = f"it ends modes of different variables: {', '.join(guard.modes)}"
            raise InputError(f"{where}.mode", found, "give a guard for each of them")
    for name, text in guard.after:
        if name not in after.variables:
            accepted = f"the mode {after.name!r} has {', '.join(after.variables)}"
            raise InputError(f"{where}.set.{name}", f"no variable {name!r}", accepted)
        _check_without_time(text, f"{where}.set.{name}", given)
        usable = usable_definitions(given, before)
        check_expression(
            text,
            f"{where}.set.{name}",
            (*given.parameters, *before.variables, *usable),
            growing=True,
        )
    for name in after.variables:
        if name not in (*before.variables, *dict(guard.after)):
            found = f"nothing says what {name!r} is in the mode {after.name!r}"
            raise InputError(f"{where}.set.{name}", found, "give it, in the state before")


def _check_without_time(text: str, where: str, given: StatedModes) -> None:
    """Refuse the time at a guard, in an expression or in a definition that stands there."""
    definitions = dict(given.definitions)
    for name in names_in(text):
        if name == TIME or (name in definitions and _depends_on_time(definitions, name)):
            found = f"{name!r} in {short_repr(text)} depends on the time"
            accepted = "let the phase be a variable of the rate 1/T, which a guard sets to 0 at 1"
            raise InputError(where, found, accepted)


def usable_definitions(given: StatedModes, mode: StatedMode) -> list[str]:
    """Return the definitions whose variables a mode has."""
    found: list[str] = []
    for name, text in given.definitions:
        if set(names_in(text)) <= {
            *found, TIME, *given.parameters, *mode.variables, *FUNCTIONS, *CONSTANTS,
        }:  # fmt: skip
            found.append(name)
    return found


def _depends_on_time(definitions: Mapping[str, str], name: str) -> bool:
    """Whether the time stands in a definition."""
    names = names_in(definitions[name])
    return TIME in names or any(_depends_on_time(definitions, n) for n in names if n in definitions)


# The symmetry that a scene states: all coordinates change their signs. Each guard has another one
# for its image; forced motion is shifted by half a period, or by none if the forcing is a factor.

SHIFTS, TRIALS = (0.5, 0.0), 4
Same = tuple[str, str, StatedMode, str, StatedMode]
"""What is compared: its name in messages, a text and its mode, the image's text and its mode."""


def guard_images(given: StatedModes) -> dict[str, str]:
    """Return the image of each guard."""
    return {image: name for name, image in given.symmetry} | dict(given.symmetry)


def symmetric_shift(
    given: StatedModes, values: Mapping[str, float], parameter: str | None = None
) -> float | None:
    """Return by which part of the period images are shifted, whatever value a parameter has; None
    where there is no symmetry."""
    return _shift(given, tuple(values.items()), parameter) if given.symmetry else None


@lru_cache(64)
def _shift(
    given: StatedModes, values: tuple[tuple[str, float], ...], parameter: str | None
) -> float | None:
    found = (s for s in SHIFTS if _difference(given, dict(values), parameter, s) is None)
    return next(found, None)


def check_symmetry(given: StatedModes, values: Mapping[str, float]) -> None:
    """Refuse a stated symmetry that the system does not have at these values."""
    if given.symmetry and symmetric_shift(given, values) is None:
        found = f"{_difference(given, values, None, SHIFTS[0])} does not change its sign with all"
        found += " variables, half a period later or at once"
        raise InputError("symmetry", found, "mend it, or take model.symmetry away")


def check_guard_images(given: StatedModes) -> None:
    """Refuse guards without an image on the other side."""
    if not given.symmetry:
        return
    guards = {guard.name: guard for guard in given.guards}
    for name in (name for pair in given.symmetry for name in pair):
        if name not in guards:
            found = f"found {name!r}"
            raise InputError("symmetry", found, f"the guards are {', '.join(guards)}")
    images = guard_images(given)
    for name, guard in guards.items():
        other = guards.get(images.get(name, ""))
        if other is None or images[other.name] != name:
            found = f"{name!r} has no image" if other is None else f"{name!r} has several images"
            raise InputError("symmetry", found, 'give pairs such as { R = "L" }, each guard once')
        same = len(other.modes) == len(guard.modes)
        if not same or (other.row, other.side) != (guard.row, -guard.side):
            found = f"{name!r} and {other.name!r} are not on two sides of the same coordinates"
            raise InputError("symmetry", found, 'pair guards such as "x <= s" and "x >= -s"')
    images_of = _mode_images(given)
    for mode in given.modes:
        other_mode = images_of.get(mode.name)
        if other_mode is None or set(other_mode.variables) != set(mode.variables):
            found = f"the mode {mode.name!r} has no image with its variables"
            raise InputError("symmetry", found, "pair guards that end modes of the same variables")


def _mode_images(given: StatedModes) -> dict[str, StatedMode]:
    """The image of each mode: what its guards' images end, or lead to."""
    guards, found = {guard.name: guard for guard in given.guards}, dict[str, StatedMode]()
    for name, image in guard_images(given).items():
        one, other = guards[name], guards[image]
        for a, b in zip((*one.modes, one.to), (*other.modes, other.to), strict=True):
            if found.setdefault(a, given.mode(b)).name != b:
                raise InputError("symmetry", f"the mode {a!r} has several images", "give it one")
    return found


def _compared(given: StatedModes) -> Iterator[Same]:
    """All laws, positions and changes, each with its image."""
    modes, guards = _mode_images(given), {guard.name: guard for guard in given.guards}
    for mode in given.modes:
        image = modes[mode.name]
        for name, law in mode.laws:
            yield f"the law of {name!r} in {mode.name!r}", law, mode, dict(image.laws)[name], image
    images = guard_images(given)
    for name, one in guards.items():
        other = guards[images[name]]
        before, image = given.mode(one.modes[0]), given.mode(other.modes[0])
        yield f"the position of {name!r}", one.position, before, other.position, image
        changed, changed_there = dict(one.after), dict(other.after)
        for variable in given.mode(one.to).variables:
            there = changed_there.get(variable, variable)
            told = f"{variable!r} after {name!r}"
            yield told, changed.get(variable, variable), before, there, image


def _difference(
    given: StatedModes, values: Mapping[str, float], parameter: str | None, shift: float
) -> str | None:
    """What does not change its sign at random states whose signs change; None if all does."""
    random = Random(7)
    for _ in range(TRIALS):
        at = dict(values)
        if parameter is not None:
            at[parameter] += (abs(at[parameter]) or 1.0) * random.uniform(-0.1, 0.1)
        state = {name: random.uniform(-1.0, 1.0) for m in given.modes for name in m.variables}
        mirrored = {name: -value for name, value in state.items()}
        time = random.uniform(0.0, 1.0)
        for told, text, mode, text_there, image in _compared(given):
            try:
                period = number(given.period, "period", at)
                one = _value(given, text, mode, {**at, **state, TIME: time * period})
                when = {TIME: (time + shift) * period}
                other = _value(given, text_there, image, {**at, **mirrored, **when})
            except InputError:  # without a value there
                continue
            if abs(one + other) > ROUNDING * max(abs(one), abs(other)):
                return told
    return None


def _value(given: StatedModes, text: str, mode: StatedMode, at: Mapping[str, float]) -> float:
    known, texts = dict(at), dict(given.definitions)
    for name in usable_definitions(given, mode):
        known[name] = number(texts[name], f"define.{name}", known)
    return number(text, "symmetry", known)
