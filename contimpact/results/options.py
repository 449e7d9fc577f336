"""A table of a scene as it is read, key by key, and what may be asked in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..continuation.settings import Settings
from ..errors import InputError, did_you_mean, each_once, short_repr
from ..models.expressions import number

# One table of a scene: keys are read by type, every mistake is named with the path of its key.
#
# Everything has a bound, so that no scene can ask for more than a machine has.

LARGEST_NUMBER = 1e100
LONGEST_TEXT = 10_000
LONGEST_LIST = 10_000

REQUIRED: Any = object()


class Table:
    """One table of a scene: reads keys by type, and refuses those that nothing has read.

    Parameters
    ----------
    data : mapping
        The table as it was read.
    path : str
        Its place in the scene, empty for the scene itself.

    Attributes
    ----------
    asked : list of str
        The keys read so far.

    Notes
    -----
    Methods that take a key raise `InputError` if it is missing and has no default, of another type,
    or out of bounds.
    """

    def __init__(self, data: Mapping[str, Any], path: str) -> None:
        self.data, self.path = data, path
        self.asked: list[str] = []

    def place(self, key: str) -> str:
        """Return the path of a key."""
        return f"{self.path}.{key}" if self.path else key

    def take(self, key: str, default: Any, wanted: str) -> Any:
        """Return what stands at a key, or the default."""
        self.asked.append(key)
        if key in self.data:
            return self.data[key]
        if default is REQUIRED:
            if near := _nearest_key(key, [k for k in self.data if k not in self.asked]):
                accepted = f"{self.place(key)} is missing: give {wanted}"
                raise InputError(self.place(near), f"unknown key (did you mean {key!r}?)", accepted)
            raise InputError(self.place(key), "missing", f"give {wanted}")
        return default

    def refuse(self, key: str, found: Any, wanted: str) -> InputError:
        """Return the error for a value that cannot be used."""
        return InputError(self.place(key), f"found {short_repr(found)}", f"give {wanted}")

    def text(self, key: str, default: Any = REQUIRED) -> str:
        """Return a text."""
        value = self.take(key, default, "a text")
        if not isinstance(value, str):
            raise self.refuse(key, value, "a text in quotes")
        if len(value) > LONGEST_TEXT:
            raise InputError(
                self.place(key), f"{len(value)} characters", f"at most {LONGEST_TEXT} are admitted"
            )
        return value

    def texts(self, key: str, default: Any = REQUIRED) -> list[str]:
        """Return a list of texts, each there once."""
        value = self.take(key, default, "a list of texts")
        if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
            raise self.refuse(key, value, "a list of texts in quotes")
        return self.distinct(key, list(self.bounded(key, value)))

    def number(self, key: str, default: Any = REQUIRED) -> float:
        """Return a number."""
        value = self.take(key, default, "a number, or an expression in quotes")
        return self.as_number(value, key)

    def as_number(self, value: Any, key: str) -> float:
        """Return a value as a number, of any size a scene may hold."""
        if isinstance(value, str):
            value = number(value, self.place(key))
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.refuse(key, value, "a number, or an expression in quotes")
        if not -LARGEST_NUMBER <= value <= LARGEST_NUMBER:
            raise self.refuse(key, value, f"a finite number, at most {LARGEST_NUMBER:g} in size")
        return float(value)

    def numbers(self, key: str) -> list[float]:
        """Return a list of numbers, each there once."""
        return self.distinct(key, self._numbers(key))

    def _numbers(self, key: str) -> list[float]:
        value = self.take(key, REQUIRED, "a list of numbers")
        if not isinstance(value, list):
            raise self.refuse(key, value, "a list of numbers")
        return [self.as_number(v, f"{key}[{i}]") for i, v in enumerate(self.bounded(key, value))]

    def distinct(self, key: str, values: list[Any]) -> list[Any]:
        """Return a list without the values that it repeats."""
        return each_once(values, self.place(key))

    def bounded(self, key: str, values: list[Any]) -> list[Any]:
        """Return a list if it is not too long."""
        if len(values) > LONGEST_LIST:
            raise InputError(
                self.place(key), f"a list of {len(values)}", f"at most {LONGEST_LIST} are admitted"
            )
        return values

    def pair(self, key: str) -> tuple[float, float]:
        """Return two numbers, the lower one first."""
        wanted = "two numbers, the lower one first"
        if key not in self.data:
            self.take(key, REQUIRED, wanted)
        values = self._numbers(key)
        if len(values) != 2 or not values[0] < values[1]:
            raise self.refuse(key, self.data[key], wanted)
        return values[0], values[1]

    def has(self, key: str) -> bool:
        """Whether a key is there; it counts as read."""
        self.asked.append(key)
        return key in self.data

    def optional_numbers(self, key: str) -> list[float]:
        """Return a list of numbers, empty if there is none."""
        return self.numbers(key) if self.has(key) else []

    def optional_pair(self, key: str) -> tuple[float, float] | None:
        """Return two numbers, the lower one first, if they are there."""
        return self.pair(key) if self.has(key) else None

    def truth(self, key: str, default: bool) -> bool:
        """Return true or false."""
        value = self.take(key, default, "true or false")
        if not isinstance(value, bool):
            raise self.refuse(key, value, "true or false")
        return value

    def whole(self, key: str, default: Any = REQUIRED, *, least: int = 1, most: int) -> int:
        """Return a whole number from `least` to `most`."""
        value = self.take(key, default, "a whole number")
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
            raise self.refuse(key, value, f"a whole number from {least} to {most}")
        return value

    def table(self, key: str, optional: bool = False) -> Table:
        """Return the table at a key."""
        value = self.take(key, {} if optional else REQUIRED, f"a table [{self.place(key)}]")
        if not isinstance(value, dict):
            raise self.refuse(key, value, f"a table [{self.place(key)}]")
        return Table(value, self.place(key))

    def finish(self) -> None:
        """Refuse the keys that nothing has read."""
        asked = list(dict.fromkeys(self.asked))
        for key in self.data:
            if key not in asked:
                accepted = f"accepted are {', '.join(asked)}"
                raise InputError(
                    self.place(key), f"unknown key{did_you_mean(key, asked)}", accepted
                )


def _nearest_key(key: str, known: Sequence[str]) -> str | None:
    """The known key that is spelled most like another, if one is."""
    import difflib

    return next(iter(difflib.get_close_matches(key[:100], known[:100], 1)), None)


CURVE_SETTINGS = Settings(tolerance=1e-13, max_step=0.05, max_points=1000)
"""Numerics of curves in two parameters."""
FORMATS = ("svg", "png", "pdf")
SHOWN = ("period-1", "all", "none")
LABELS = ("all", "period-1", "real", "none")
QUANTITIES = ("velocity", "multipliers", "moduli", "energy", "U_I", "U_T", "gap", "period")
VOLTAGES = ("energy", "U_I", "U_T")
SCENE_SETTINGS = Settings(max_step=0.03)
"""Numerics of a scene that says nothing else; steps short enough for a smooth picture."""

MOST_BITS = 4096
"""Largest precision of proofs."""
LARGEST_TOLERANCE = 1e-3
LARGEST_SEED = 2**63 - 1
MOST_POINTS = 10**9
MOST_STARTS = 100_000
MOST_TRIES = 1000
"""Largest number of corrector iterations, of rounds of the search, and of successive switches."""
MOST_LINES = 1000
MOST_BRANCHES = 100_000


@dataclass(frozen=True)
class PlotOptions:
    """How the diagram is drawn: the parameter on the x axis, limits, on which branches unphysical
    orbits are shown (``period-1``, ``all``, ``none``), formats to write, which events are labelled
    (``all``, ``period-1``, ``real``, ``none``), whether the page is written, and the quantity on
    the y axis."""

    x: str
    xlim: tuple[float, float] | None = None
    ylim: tuple[float, float] | None = None
    unphysical: str = "period-1"
    formats: tuple[str, ...] = ("svg", "png")
    labels: str = "all"
    html: bool = False
    y: str = "velocity"


@dataclass(frozen=True)
class CurveOptions:
    """Which curves to follow in a second parameter."""

    parameter: str
    range: tuple[float, float]
    kinds: tuple[str, ...]
    """Kinds of the entries at which curves start."""
    unphysical: tuple[str, ...] = ()
    """Kinds of which curves start also at entries of unphysical orbits."""
    values: tuple[float, ...] = ()
    """Values of the second parameter to hit exactly."""
    family: tuple[str, tuple[float, ...]] | None = None
    """A third parameter, and the values of it for which everything is repeated."""
    settings: Settings = CURVE_SETTINGS
    start: tuple[float, ...] = ()
    """Further values of the second parameter at which curves start and are checked."""
    third: tuple[str, tuple[float, float]] | None = None
    """A parameter in which points of codimension two are followed."""
    cover: int = 0
    """How many lines in each direction must meet nothing new before a map is taken as complete; 0
    asks for none."""
    areas: bool = False
    """Whether the rectangle is divided into areas by what ends the stable orbits."""
    reach: int = 1
    """How many words away from the scene's the orbits may be whose curves start at points of
    codimension two."""


@dataclass(frozen=True)
class CertifyOptions:
    """What ``contimpact certify`` proves."""

    bits: int = 128
    """Precision to begin with."""
    max_bits: int = 512
    """Precision up to which it is doubled where a proof fails."""
    branches: bool = True
    """Whether branches are proven complete, besides their entries."""
    events: tuple[str, ...] = ("FB", "PD", "G")
    """Kinds of events that are certified; by default those the scene looks for."""
    seconds: float = 600.0
    """Processor time that the proof of a branch may take; what is left then is unproven."""
