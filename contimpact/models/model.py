"""What the author of a system writes: a class of its parameters, guards and formulas.

A system is a subclass of `Model` in a file of its own under `contimpact/systems`. Its numbers are
plain Python; its formulas are SymPy and are asked for only when a kernel has to be generated.
"""

from __future__ import annotations

import copy
import inspect
import math
import numbers
import re
import unicodedata
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar, Never, Self, TypeAlias

from ..errors import (
    InputError,
    count_text,
    did_you_mean,
    explain_arguments,
    missing,
    require_whole,
    short_repr,
)
from .expressions import CONSTANTS, FUNCTIONS, check_expression, names_in, number, values_of
from .guards import FEW, guard_of, orders_of, slides_at
from .guards import Guard as Guard
from .guards import Mode as Mode
from .guards import Wall as Wall
from .sources import identity

# Whether the modes and guards of a system's class fit together, checked when it is defined.


def check_modes(kind: Any, where: str) -> None:
    """Check `DEGREES_OF_FREEDOM`, `MODES` and `WALLS` of a system's class; InputError names the
    attribute."""
    size = kind.DEGREES_OF_FREEDOM
    require_whole(size, f"{where}.DEGREES_OF_FREEDOM")
    modes = _modes(kind.MODES, size, f"{where}.MODES")
    if not hasattr(kind, "WALLS"):
        return
    place = f"{where}.WALLS"
    require_all(kind.WALLS, ("name", "side", "modes", "coordinate"), place, "Wall or Guard")
    for guard in kind.WALLS:
        _check_letter(guard, place)
        _check_graph(guard, modes, place)
        _check_coordinate(guard, size, place)
        _check_sizes(guard, kind.MODES, size, place)
        _check_crossing(guard, kind.WALLS, place)
    names = [guard.name for guard in kind.WALLS]
    if not names or len(set(names)) < len(names):
        accepted = "give at least one wall, each name once"
        raise InputError(place, f"found {short_repr(names)}", accepted)
    for mode in modes:
        _check_passage(mode, mode == modes[0], kind.WALLS, place)


def _modes(modes: Any, size: int, where: str) -> list[str]:
    """The names of the modes; one without a name where none are declared."""
    require_all(modes, ("name", "degrees_of_freedom"), where, "Mode")
    names = [mode.name for mode in modes]
    if not all(isinstance(name, str) and name for name in names) or len({*names}) < len(names):
        raise InputError(where, f"found {short_repr(names)}", "give each mode a name of its own")
    for mode in modes:
        own = size if mode.degrees_of_freedom is None else mode.degrees_of_freedom
        if not isinstance(own, int) or isinstance(own, bool) or own < 1:
            raise InputError(
                where, f"mode {mode.name!r} has {short_repr(own)}", "give a whole number >= 1"
            )
        if own > size:
            found = f"mode {mode.name!r} has {own} degrees of freedom, the system {size}"
            raise InputError(where, found, "declare DEGREES_OF_FREEDOM those of the largest mode")
        first = getattr(mode, "first_order", ())
        if not isinstance(first, tuple) or not set(first) <= set(range(own)):
            found = f"mode {mode.name!r} has the coordinates of first order {short_repr(first)}"
            raise InputError(where, found, f"give a tuple of numbers from 0 to {own - 1}")
    return names or [""]


def _check_letter(guard: Guard, where: str) -> None:
    if not (isinstance(guard.name, str) and len(guard.name) == 1 and guard.name.isalpha()):
        accepted = "give a single letter: words are written in them"
        raise InputError(where, f"a wall is called {short_repr(guard.name)}", accepted)
    if guard.side not in (1, -1):
        accepted = "give +1 where the body stays below the wall, -1 where it stays above"
        raise InputError(where, f"wall {guard.name!r} has side {short_repr(guard.side)}", accepted)


def _check_graph(guard: Guard, modes: list[str], where: str) -> None:
    """The modes that a guard ends and the one it leads to."""
    known = "declare modes in MODES" if modes == [""] else f"the modes are {', '.join(modes)}"
    for name in (*guard.modes, guard.next_mode):
        if name not in modes:
            raise InputError(where, f"{guard.name!r} has the mode {short_repr(name)}", known)
    if isinstance(guard, Wall) and not guard.rigid:
        found = f"wall {guard.name!r} leads from {short_repr(guard.mode)} to {guard.next_mode!r}"
        accepted = "give a Guard, or a wall for each mode: a Wall leads back to the mode it ends"
        raise InputError(where, found, accepted)
    if guard.to is None and len(guard.modes) != 1:
        found = f"{guard.name!r} ends {count_text(len(guard.modes), 'mode')}"
        raise InputError(where, found, "say which mode it leads to")


def _check_coordinate(guard: Guard, size: int, where: str) -> None:
    given: Any = guard.coordinate
    found = f"{guard.name!r} has the coordinate {short_repr(given)}"
    if isinstance(given, int) and not isinstance(given, bool):
        if not 0 <= given < size:
            raise InputError(where, found, f"give a number from 0 to {size - 1}")
        return
    numeric = isinstance(given, tuple) and all(
        isinstance(c, numbers.Real) and math.isfinite(c) for c in given
    )
    if not numeric or len(given) != size or not any(given):
        accepted = f"give the number of a position, or {size} coefficients, not all zero"
        raise InputError(where, found, accepted)


def _check_sizes(guard: Guard, modes: Any, size: int, where: str) -> None:
    """The modes that a guard ends have the same state, and its gap coordinate in it."""
    ended = {orders_of(modes, name, size) for name in guard.modes}
    if len(ended) > 1:
        found = f"{guard.name!r} ends modes of different coordinates"
        raise InputError(where, found, "give a guard for each of them")
    (orders,) = ended
    row = guard.row(size)
    if any(factor and not order for factor, order in zip(row, orders, strict=True)):
        found = (
            f"{guard.name!r} lies on a coordinate that the mode {guard.modes[0]!r} does not have"
        )
        raise InputError(where, found, "give one of its own")


def _check_crossing(guard: Guard, guards: Iterable[Guard], where: str) -> None:
    """Where it leads through a surface, another guard leads to sliding."""
    past = getattr(guard, "past", "")
    if past and slides_at(tuple(guards), guard) is None:
        found = f"{guard.name!r} leads on past {short_repr(past)}"
        accepted = "give a guard on the same surface, and name one that ends the mode it leads to"
        raise InputError(where, found, accepted)


def _check_passage(mode: str, first: bool, guards: Iterable[Guard], where: str) -> None:
    """Every mode is reached and left; in the first one the system may begin."""
    if not any(mode in guard.modes for guard in guards):
        raise InputError(where, f"mode {mode!r} is ended by no guard", "give it a guard")
    if not first and not any(mode == guard.next_mode for guard in guards):
        raise InputError(where, f"mode {mode!r} is reached by no guard", "lead a guard to it")


def require_all(given: Any, attributes: Iterable[str], where: str, kind: str) -> None:
    try:
        fits = all(hasattr(item, name) for item in given for name in attributes)
    except TypeError:
        fits = False
    if not fits:
        raise InputError(where, f"found {short_repr(given)}", f"give a tuple of {kind}")


def require_forcing(model: Model, where: str, why: str, accepted: str) -> None:
    """Raise `InputError` for a system without forcing."""
    if model.autonomous:
        found = f"{why} the forcing's period, and the system has no forcing"
        raise InputError(where, found, accepted)


# The contract of a system's class, checked when the class is defined.

REQUIRED = ("SYSTEM", "PARAMETERS", "WALLS")

COLUMNS = frozenset(
    """arclength becomes branch closing criticality direction distance error event exponent1
    exponent2 exponent_error exponent_per_period exponent_sum flight from ghost id impact impacts
    iterations kind label mean_ln_r2 method n_unstable notation opens order parameter period
    periods physical rate reason requested residual slope smallest_gap stable touch_time wall why
    word""".split()
)
"""Columns that the package's tables have, whatever the system."""
NUMBERED = re.compile(
    r"(t|v|wall|time|velocity)[1-9]\d*|[xv]\d+_\d+|(position|velocity)\d+_\d+"
    r"|multiplier\d+_(re|im)|exponent[1-9]\d*"
)
"""Columns with the number of an impact, a motion, a multiplier or an exponent."""


def check_class(kind: Any) -> None:
    """Check the class attributes of a `Model`; those that are not there yet are left out.
    InputError names the attribute."""
    where = kind.__name__
    check_modes(kind, where)
    parameters = getattr(kind, "PARAMETERS", ())
    require_all(parameters, ("name", "split", "accepted"), f"{where}.PARAMETERS", "Parameter")
    names = [name for p in parameters for name in (p.name, *p.split)]
    check_names(names, f"{where}.PARAMETERS", taken=())
    check_names(kind.DERIVED, f"{where}.DERIVED", taken=names)
    check_names(kind.OPTIONS, f"{where}.OPTIONS", taken=("system", "parameters", *names))
    for attribute, known in (
        ("DERIVED_UNITS", kind.DERIVED),
        ("DERIVED_FROM", kind.DERIVED),
        ("EXPRESSIONS", kind.OPTIONS),
        ("PARAMETRIC", kind.EXPRESSIONS),
    ):
        _check_known(getattr(kind, attribute), known, f"{where}.{attribute}")
    for derived, depends in kind.DERIVED_FROM.items():
        _check_known(depends, names, f"{where}.DERIVED_FROM[{derived!r}]")


def check_complete(kind: Any) -> None:
    """Raise `InputError` if a class attribute that every system needs is missing."""
    for name in REQUIRED:
        if not hasattr(kind, name):
            raise InputError(f"{kind.__name__}.{name}", "missing", f"set {', '.join(REQUIRED)}")


def check_names(names: Any, where: str, taken: Iterable[str]) -> None:
    """Refuse names that are no identifiers, that are columns of tables, or that stand twice."""
    used = set(taken)
    for name in names:
        if not _is_name(name):
            accepted = "give a name of letters, digits and underscores that starts with a letter"
            raise InputError(where, f"the name {short_repr(name)}", accepted)
        if name in COLUMNS or NUMBERED.fullmatch(name):
            accepted = "give another name: tables have a column of that name"
            raise InputError(where, f"the name {name!r}", accepted)
        if name in used:
            raise InputError(where, f"the name {name!r} twice", "give each its own name")
        used.add(name)


def _is_name(name: Any) -> bool:
    """Whether Python reads a name as it stands; it equates some letters."""
    return (
        isinstance(name, str)
        and name.isidentifier()
        and unicodedata.normalize("NFKC", name) == name
    )


def _check_known(names: Any, known: Iterable[str], where: str) -> None:
    unknown = [name for name in names if name not in known]
    if unknown:
        accepted = f"give some of {', '.join(known) or 'none'}"
        raise InputError(where, f"unknown name {unknown[0]!r}", accepted)


# Parameters of one's own: names in an expression that are given values among the parameters.

SAMPLES = 256
"""Samples of a period: more than twice the harmonics that a forcing may have."""
AT_RANDOM = (0.37, -1.91, 0.083)
"""Values of a parameter at which means are compared."""


def own_names(
    texts: Sequence[str], known: Collection[str], taken: Collection[str], given: Collection[str]
) -> list[str]:
    """Return the names in expressions that are given values, in the order of their appearance.
    Those that are `known` mean something else: variables, and the parameters that a system
    declares. Names must not be among those `taken`."""
    known = {*known, *FUNCTIONS, *CONSTANTS}
    names = dict.fromkeys(name for text in texts for name in names_in(text))
    own = [name for name in names if name in given and name not in known]
    check_names(own, "parameters", taken)
    return own


def check_with_own(
    text: str, where: str, variables: Sequence[str], own: Sequence[str], declared: Collection[str]
) -> None:
    """Check an expression in which parameters of one's own may stand; see `check_expression`.

    The parameters that a system declares may not.
    """
    try:
        check_expression(text, where, (*variables, *own))
    except InputError as error:
        unknown = error.found.startswith("unknown name")
        if not unknown or any(repr(name) in error.found for name in declared):
            raise
        accepted = f"give it a value among the parameters; {error.accepted}"
        raise InputError(error.where, error.found, accepted) from None


def mean_depends(text: str, own: Mapping[str, float], parameter: str, period: float) -> bool:
    """Return whether the mean of a sum of harmonics in ``t`` depends on a parameter in it; `own`
    are the values of all of these."""
    import numpy as np

    t = period * np.arange(SAMPLES) / SAMPLES
    means = [
        np.mean(values_of(text, "expression", {"t": t, **own, parameter: value}))
        for value in AT_RANDOM
    ]
    return bool(np.ptp(means) > 1e-12)


FREE = "free"
"""The option `period` of a system that has no forcing at its values."""


@explain_arguments
@dataclass(frozen=True)
class Parameter:
    """A physical parameter: its default, unit and the values it may take.

    `default` is None where the user must give a value. `split` names finer parameters that may be
    given instead of this one (``r`` or ``r_B`` and ``r_T``).
    """

    name: str
    unit: str
    meaning: str
    default: float | None = None
    lower: float = -math.inf
    upper: float = math.inf
    above_lower: bool = False
    split: tuple[str, ...] = ()
    apart: str = ""
    """What else is accepted, as another model, in words."""

    @property
    def accepted(self) -> str:
        """The values it may take, in words."""
        return self._range + (f", or {self.apart}" if self.apart else "")

    @property
    def _range(self) -> str:
        if math.isinf(self.lower) and math.isinf(self.upper):
            return "a finite number"
        if math.isinf(self.upper):
            return f"a number {'>' if self.above_lower else '>='} {self.lower:.6g}"
        if self.above_lower:
            return f"a number above {self.lower:.6g}, at most {self.upper:.6g}"
        return f"a number from {self.lower:.6g} to {self.upper:.6g}"

    @property
    def doc(self) -> str:
        """Its entry in the docstring of a system that lists none itself."""
        usual = "" if self.default is None else f", default {self.default:g}"
        unit = f" ({self.unit})" if self.unit else ""
        finer = f"; or {' and '.join(f'`{name}`' for name in self.split)}" if self.split else ""
        meaning = f"{self.meaning[:1].upper()}{self.meaning[1:]}"
        return f"{self.name} : float{usual}\n    {meaning}{unit}: {self.accepted}{finer}."

    def check(self, value: Any, where: str) -> float:
        """Return the value, or that of an expression such as ``"pi/6"``, as a float.

        Raises
        ------
        InputError
            That names `where`, if it is not admitted.
        """
        if isinstance(value, str):
            value = number(value, where)
        if isinstance(value, bool) or not isinstance(value, numbers.Real):
            raise InputError(where, f"found {short_repr(value)}", f"give {self.accepted}")
        try:
            value = float(value)
        except OverflowError:
            value = math.copysign(math.inf, value)
        inside = self.lower <= value <= self.upper and not (
            self.above_lower and value == self.lower
        )
        if not (math.isfinite(value) and inside):
            unit = f" ({self.unit})" if self.unit else ""
            degrees = f"; {value:g} degrees are math.radians({value:g})" if unit == " (rad)" else ""
            accepted = f"it must be {self.accepted}{unit}{degrees}"
            raise InputError(where, f"{self.meaning} is {value!r}", accepted)
        return value


State: TypeAlias = Sequence[Any]
"""Positions or velocities, one for each degree of freedom."""

Reset: TypeAlias = Callable[[str, State, State], State]
Jump: TypeAlias = Callable[[str, State, State], tuple[State, State]]
Flight: TypeAlias = Callable[[Any, State, State, Any], tuple[State, State]]
Acceleration: TypeAlias = Callable[[Any, State, State], State]
Harmonics: TypeAlias = tuple[Any, Sequence[tuple[int, Any, Any]]]


@explain_arguments
@dataclass(frozen=True)
class Formulas:
    """A system's mathematics in SymPy.

    Positions and velocities are sequences with one entry per degree of freedom. In a system of
    several modes `flight` and `acceleration` are mappings from the modes' names to what is said
    here of one, and `harmonics` are left out. All functions are given the coordinates that the mode
    has, and state these; velocities after a jump, and those that flights start with, are of the
    coordinates of second order alone.

    Attributes
    ----------
    period : sympy.Expr
        Forcing period T, in the parameters.
    walls : mapping of str to sympy.Expr
        Position of each wall, or of the surface of each guard.
    derived : mapping of str to sympy.Expr
        Derived parameters, for reports.
    reset : callable ``(wall, x, v) -> v_plus``, optional
        Velocities after an impact at `wall`; positions do not change. Without it velocities do not
        change either.
    jump : callable ``(guard, x, v) -> (x_plus, v_plus)``, optional
        Instead of `reset`, where positions change too.
    mass : sequence of sequences of sympy.Expr, optional
        The symmetric matrix M of the kinetic energy v.Mv/2, of which impacts take a part, or one
        for each mode; for one degree of freedom 1 unless it is given: energies are then those of a
        unit of mass.
    flight : callable ``(t0, x0, v0, dt) -> (u, v1)``
        Free flight from the state (x0, v0) at time t0: mean velocities u = (x1 - x0)/dt and
        velocities v1 after the time dt, in forms that do not cancel as dt goes to zero.
    acceleration : callable ``(t, x, v) -> a``
        The equations of motion in free flight: of a coordinate of first order, its velocity.
    harmonics : tuple of (constant, [(k, a_k, b_k), ...]), optional
        Where the acceleration of coordinate 0 in flight depends on time alone:
        constant + sum of a_k cos(2 pi k t/T) + b_k sin(2 pi k t/T).
    """

    period: Any
    walls: Mapping[str, Any]
    reset: Reset | None = None
    flight: Flight | Mapping[str, Flight] | None = None
    acceleration: Acceleration | Mapping[str, Acceleration] | None = None
    derived: Mapping[str, Any] = field(default_factory=dict)
    harmonics: Harmonics | None = None
    jump: Jump | None = None
    mass: Sequence[Sequence[Any]] | Mapping[str, Sequence[Sequence[Any]]] | None = None


@explain_arguments
@dataclass(frozen=True)
class Geometry:
    """What pictures that move draw of a machine beside its coordinates and guards.

    Bodies stand in a row in the order of their coordinates, and move along it; where nothing is
    said, each along a line of its own.

    Attributes
    ----------
    direction : float or str
        Angle below the horizontal at which coordinates grow, rad, or the parameter that is it.
    springs : tuple of (int, int)
        Bodies that are joined, by their coordinates; -1 is the ground before the first body, the
        number of bodies that behind the last.
    contained : tuple of (int, int)
        Bodies in containers that their walls end, each with the body that is the container; -1
        where the container is what displacements are measured from.
    turning : bool
        Whether the coordinate is the angle of a pendulum, zero where it hangs.
    """

    direction: float | str = 0.0
    springs: tuple[tuple[int, int], ...] = ()
    contained: tuple[tuple[int, int], ...] = ()
    turning: bool = False


@explain_arguments
@dataclass(frozen=True)
class Symmetry:
    """A map of orbits to orbits: walls exchanged, time shifted, section coordinates multiplied.

    `shift` is in forcing periods, `sign` is +1 or -1.
    """

    walls: Mapping[str, str]
    shift: float
    sign: float


@dataclass(frozen=True)
class Example:
    """What a scene to start from asks of a system: see `contimpact.new_scene`."""

    values: Mapping[str, float | str]
    follow: tuple[str, float, float]
    orbits: Sequence[str]
    second: tuple[str, float, float]
    """`follow`, `second`: the parameter of branches, and another one for curves, with ranges."""
    model: str = ""
    """Further lines of [model]."""
    plot: tuple[str, str] = ('# y = "multipliers"', "velocities before impact otherwise")
    """A line of [plot], and what it means."""


class Model(ABC):
    """An impacting system at given parameter values.

    Subclasses set the class attributes, which are checked when the class is defined, and write
    `formulas`. A system is a small hybrid automaton: in each of its modes it moves by one law,
    until it comes to a guard, which leads to the next mode. Most have one mode and rigid walls
    alone, and say nothing of modes. Instances are not changed after construction; `replace` gives
    a neighbour. What `formulas` returns is looked at once for an instance and its neighbours.

    Parameters
    ----------
    *unnamed
        Refused: values are given by name.
    **given
        Values of `PARAMETERS` (floats) and of `OPTIONS` (text that shapes the formulas).

    Raises
    ------
    InputError
        For an unknown, missing, contradictory or inadmissible value.

    Notes
    -----
    Of the class attributes these may be left out: `MODES`, where there is one; `DERIVED_UNITS`,
    units of derived parameters for labels; `DERIVED_FROM`, the parameters each depends on (all, if
    nothing is said); `EXPRESSIONS`, the options that are expressions, with the names that may stand
    in them; `PARAMETRIC`, those of them in which any name may stand that is given a value, as a
    parameter of one's own, and is then in `own`; `MEMBRANES`, whether impacts hit membranes of an
    energy harvester; `STATED`, whether scenes state the system themselves, as its option `machine`;
    `AUTONOMOUS`, whether it has no forcing; `GEOMETRY`, how the machine is drawn, None where
    coordinates are no displacements; `EXAMPLE`, from which ``contimpact new`` makes a scene. Any
    other system may be given the option ``period="free"`` at values at which it has none.
    """

    SYSTEM: ClassVar[str]
    PARAMETERS: ClassVar[tuple[Parameter, ...]]
    WALLS: ClassVar[tuple[Guard, ...]]
    MODES: ClassVar[tuple[Mode, ...]] = ()
    DERIVED: ClassVar[tuple[str, ...]] = ()
    DERIVED_UNITS: ClassVar[Mapping[str, str]] = {}
    DERIVED_FROM: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    OPTIONS: ClassVar[Mapping[str, str]] = {}
    EXPRESSIONS: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    PARAMETRIC: ClassVar[tuple[str, ...]] = ()
    DEGREES_OF_FREEDOM: ClassVar[int] = 1
    MEMBRANES: ClassVar[bool] = False
    STATED: ClassVar[bool] = False
    AUTONOMOUS: ClassVar[bool] = False
    GEOMETRY: ClassVar[Geometry | None] = Geometry()
    EXAMPLE: ClassVar[Example | None] = None

    def __init_subclass__(cls, **given: Any) -> None:
        super().__init_subclass__(**given)
        check_class(cls)
        text = vars(cls).get("__doc__")
        if text and "Parameters\n" not in text and "PARAMETERS" in vars(cls):
            listed = "\n".join(parameter.doc for parameter in cls.PARAMETERS)
            cls.__doc__ = f"{inspect.cleandoc(text)}\n\nParameters\n----------\n{listed}\n"

    def __init__(self, /, *unnamed: Never, **given: Any) -> None:
        check_complete(type(self))
        if unnamed:
            accepted = f"give them by name: {', '.join(f'{p.name}=...' for p in self.PARAMETERS)}"
            raise InputError("parameters", f"{len(unnamed)} values without names", accepted)
        self.shared: dict[str, Any] = {}
        self.options = {name: str(given.pop(name, text)) for name, text in self.OPTIONS.items()}
        if "period" in given:
            self.options["period"] = self._period(given.pop("period"))
        self.own = self._own_parameters(given)
        added = tuple(Parameter(n, "", "a parameter of an expression") for n in self.own)
        self._declared = {p.name: p for p in _resolve_parameters((*self.PARAMETERS, *added), given)}
        self.values = {
            name: p.check(given.pop(name, p.default), name) for name, p in self._declared.items()
        }
        self.validate()

    def _period(self, text: Any) -> str:
        """What is said of the period: that it is free."""
        if text != FREE:
            accepted = f"give {FREE!r}, or leave it out: the formulas state the forcing's"
            raise InputError("period", f"found {short_repr(text)}", accepted)
        return FREE

    @property
    def autonomous(self) -> bool:
        """Whether there is no forcing, and the periods of orbits are unknowns."""
        return self.AUTONOMOUS or self.options.get("period") == FREE

    @property
    def timeless(self) -> bool:
        """Whether it is known without a look at motions that none depends on the time."""
        return False

    @property
    def tori(self) -> bool:
        """Whether two multipliers can leave the unit circle as a pair, so that a torus is born.

        With one coordinate and losses they cannot: their product is below one. Laws that a scene
        states may give more than they take.
        """
        return self.DEGREES_OF_FREEDOM > 1

    def _own_parameters(self, given: Mapping[str, Any]) -> tuple[str, ...]:
        """The parameters that expressions have besides those declared, once these are checked."""
        declared = [name for p in self.PARAMETERS for name in (p.name, *p.split)]
        known = (*declared, *(v for names in self.EXPRESSIONS.values() for v in names))
        texts = [self.options[name] for name in self.PARAMETRIC]
        own = own_names(texts, known, (*self.DERIVED, *self.OPTIONS), given)
        for name, variables in self.EXPRESSIONS.items():
            if name in self.PARAMETRIC:
                check_with_own(self.options[name], name, variables, own, declared)
            else:
                check_expression(self.options[name], name, variables)
        return tuple(own)

    @abstractmethod
    def formulas(self, symbols: Mapping[str, Any]) -> Formulas:
        """Return the system's mathematics in the given parameter symbols."""

    def symmetry(self, parameter: str, harmonics: Sequence[float]) -> Symmetry | None:
        """Return the symmetry the model has at every value of the followed parameter, if any.

        Parameters
        ----------
        parameter : str
            The followed parameter.
        harmonics : sequence of float
            What the kernel ``harmonics`` returns at the model's values.
        """
        return None

    def place(self, what: str, name: str = "") -> str:
        """Return where a formula is stated, for messages: ``reset at`` a guard, or ``period``."""
        return f"{type(self).__name__}.formulas: {what}" + (f" {name!r}" if name else "")

    def state_names(self, mode: str) -> list[tuple[str, str]]:
        """Return how positions and velocities in a mode are called, for messages."""
        return [(f"x[{i}]", f"v[{i}]") for i in range(self.DEGREES_OF_FREEDOM)]

    @property
    def unknowns_per_impact(self) -> int:
        """Unknowns of one impact: its time and its section coordinates before impact."""
        return 2 * self.DEGREES_OF_FREEDOM

    @property
    def letters(self) -> list[str]:
        """The letters of the guards, in which words are written."""
        return [guard.name for guard in self.WALLS]

    @property
    def few_guards(self) -> bool:
        """Whether it has at most two guards: words are counts, and unphysical orbits followed."""
        return len(self.WALLS) <= FEW

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The names of the coordinates: x, or x1, x2, ... where there are several."""
        size = self.DEGREES_OF_FREEDOM
        return ("x",) if size == 1 else tuple(f"x{i + 1}" for i in range(size))

    def guard(self, letter: str) -> Guard:
        """Return the guard of a letter."""
        return guard_of(self.WALLS, letter)

    @property
    def first_mode(self) -> str:
        """The mode in which motion begins; it has no name where there is one."""
        return self.MODES[0].name if self.MODES else ""

    @property
    def declared(self) -> Mapping[str, Parameter]:
        """The parameters this instance has, by name."""
        return self._declared

    def unit(self, name: str) -> str:
        """Return the unit of a parameter or derived parameter; empty where none is declared."""
        declared = self._declared.get(name)
        return declared.unit if declared else self.DERIVED_UNITS.get(name, "")

    def varying(self, parameter: str) -> tuple[str, ...]:
        """Return what varies along a branch in a parameter: itself and derived parameters."""
        return (
            parameter,
            *(n for n in self.DERIVED if parameter in self.DERIVED_FROM.get(n, (parameter,))),
        )

    def replace(self, /, **changes: float) -> Self:
        """Return the same system with some parameter values changed.

        Raises
        ------
        InputError
            For a name the system does not have or a value it does not admit.
        """
        for name in changes:
            self.require(name, name)
        neighbour = copy.copy(self)
        neighbour.shared = self.shared
        neighbour.values = self.values | {
            name: self._declared[name].check(value, name) for name, value in changes.items()
        }
        neighbour.validate()
        return neighbour

    def validate(self) -> None:  # noqa: B027  most systems have nothing to add
        """Raise `InputError` where values that are admissible one by one do not go together."""

    def validate_between(self, parameter: str, low: float, high: float, where: str) -> None:
        """Raise `InputError` where the model does not hold at the limits of a parameter's range."""
        for limit in (low, high):
            try:
                self.replace(**{parameter: limit})
            except InputError as error:
                raise error.within(where) from None

    def require(self, name: str, where: str) -> Parameter:
        """Return the declaration of a parameter, or raise `InputError`."""
        if name not in self._declared:
            hint = did_you_mean(name, self._declared)
            if name in self.DERIVED:
                hint = (
                    f": it is derived from {', '.join(self.DERIVED_FROM.get(name, self._declared))}"
                )
            found = f"{self.SYSTEM} has no parameter {name!r}{hint}"
            raise InputError(where, found, f"it has {', '.join(self._declared)}")
        return self._declared[name]

    @property
    def identity(self) -> str:
        """What the kernels depend on: formulas, names and options, not values.

        The formulas of a class outside the package are derived for it, once for a model and all
        that `replace` makes of it; of the package's own classes the files' texts are taken.
        """
        names = tuple(self.values), self.WALLS, self.DERIVED
        return repr((self.SYSTEM, *names, tuple(self.options.items()), identity(self)))

    def __getitem__(self, name: str) -> float:
        """Return the value of a parameter, or of a derived parameter."""
        if name not in self.values and name in self.DERIVED:
            from .equations import equations_of

            found = equations_of(self)
            return float(
                found.derived[name].subs({found.parameters[n]: v for n, v in self.values.items()})
            )
        self.require(name, name)
        return self.values[name]

    __iter__ = None
    """Its items are looked up by name; `parameters` is a dictionary of them."""

    def __contains__(self, name: object) -> bool:
        """Whether it has a parameter, or derived parameter, of a name."""
        return name in self.values or name in self.DERIVED

    @property
    def parameters(self) -> dict[str, float]:
        """Values of all parameters, derived ones included."""
        return {name: self[name] for name in (*self.values, *self.DERIVED)}

    if not TYPE_CHECKING:  # where types are read, an attribute that is not there is a mistake

        def __getattr__(self, name: str) -> Any:
            raise missing(self, name) if "values" in vars(self) else AttributeError(name)

    def _ipython_key_completions_(self) -> list[str]:
        return [*self.values, *self.DERIVED]

    def __eq__(self, other: object) -> bool:
        """Whether it is the same system with the same options and parameter values."""
        if type(self) is not type(other):
            return NotImplemented
        return self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> tuple[Any, ...]:
        return type(self), *sorted(self.options.items()), *sorted(self.values.items())

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"shared": {}}

    def statement(self) -> list[tuple[str, str]]:
        """Return what the system is and its parameter values, as headings with a text each."""
        guards = (
            guard.name if guard.rigid else f"{guard.name} ({', '.join(guard.modes)} to {guard.to})"
            for guard in self.WALLS
        )
        options = ((name, value) for name, value in self.options.items() if value)
        return [
            ("model", self.SYSTEM),
            *options,
            ("guards", ", ".join(guards)),
            ("values", self._listed()),
        ]

    def _listed(self) -> str:
        units = {name: f" {p.unit}" if p.unit else "" for name, p in self._declared.items()}
        return ", ".join(f"{n}={v:.12g}{units.get(n, '')}" for n, v in self.values.items())

    def __repr__(self) -> str:
        shown = self.options | {name: f"{value:.12g}" for name, value in self.values.items()}
        inside = ", ".join(
            f"{name}={value!r}" if name in self.options else f"{name}={value}"
            for name, value in shown.items()
        )
        return f"{type(self).__name__}({inside})"


def _resolve_parameters(
    parameters: Sequence[Parameter], given: Mapping[str, Any]
) -> list[Parameter]:
    """The parameters in force once the split ones are decided; refuses what does not fit."""
    known = {name for p in parameters for name in (p.name, *p.split)}
    for name in given:
        if name not in known:
            accepted = f"accepted are {', '.join(sorted(known))}"
            raise InputError(name, f"no such parameter{did_you_mean(name, known)}", accepted)
    resolved = []
    for p in parameters:
        finer = [name for name in p.split if name in given]
        if finer and p.name in given:
            accepted = f"give either {p.name} or {' and '.join(p.split)}"
            raise InputError(p.name, f"given together with {' and '.join(finer)}", accepted)
        in_force = [p]
        if finer:
            own = [(name, f"{p.meaning} ({name})") for name in p.split]
            in_force = [replace(p, name=n, meaning=text, split=(), apart="") for n, text in own]
        for q in in_force:
            if q.default is None and q.name not in given:
                instead = f" (or {' and '.join(p.split)})" if p.split and not finer else ""
                raise InputError(q.name, "missing", f"give {q.meaning}{instead}, {q.accepted}")
        resolved += in_force
    return resolved
