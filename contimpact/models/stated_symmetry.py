"""The symmetry of a hybrid system that a scene states: all coordinates change their signs.

Each guard has another one for its image, and each mode the one that this ends. Forced motion is
shifted by half a period, or by none where the forcing is a factor.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import lru_cache
from random import Random

from ..errors import InputError
from .expressions import number
from .machine import ROUNDING, TIME
from .stated_modes import StatedMode, StatedModes, usable_definitions

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
