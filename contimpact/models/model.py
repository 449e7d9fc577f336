"""The definition of an impacting system: parameters, walls, reset and a closed-form flight.

A system is a subclass of `Model` in a file of its own under `contimpact/systems`. Its numbers are
plain Python; its formulas are SymPy and are asked for only when a kernel has to be generated.
"""

from __future__ import annotations

import copy
import math
import numbers
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Self, TypeAlias

from ..errors import InputError, did_you_mean, shown
from .contract import check_class, check_complete
from .expressions import check_expression, number
from .guards import Guard as Guard
from .guards import Mode as Mode
from .guards import Wall as Wall
from .guards import guard_of
from .own_parameters import check_with_own, own_names

FREE = "free"
"""The option `period` of a system that has no forcing at its values."""


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

    @property
    def accepted(self) -> str:
        """The values it may take, in words."""
        if math.isinf(self.lower) and math.isinf(self.upper):
            return "a finite number"
        if math.isinf(self.upper):
            return f"a number {'>' if self.above_lower else '>='} {self.lower:.6g}"
        return f"a number from {self.lower:.6g} to {self.upper:.6g}"

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
            raise InputError(where, f"found {shown(value)}", f"give {self.accepted}")
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


@dataclass(frozen=True)
class Symmetry:
    """A map of orbits to orbits: walls exchanged, time shifted, section coordinates multiplied.

    `shift` is in forcing periods, `sign` is +1 or -1.
    """

    walls: Mapping[str, str]
    shift: float
    sign: float


class Model(ABC):
    """An impacting system at given parameter values.

    Subclasses set the class attributes, which are checked when the class is defined, and write
    `formulas`. A system is a small hybrid automaton: in each of its modes it moves by one law,
    until it comes to a guard, which leads to the next mode. Most have one mode and rigid walls
    alone, and say nothing of modes. Instances are not changed after construction; `replace` gives
    a neighbour. What `formulas` returns is looked at once for an instance and its neighbours.

    Parameters
    ----------
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
    `AUTONOMOUS`, whether it has no forcing. Any other system may be given the option
    ``period="free"`` at values at which it has none.
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

    def __init_subclass__(cls, **given: Any) -> None:
        super().__init_subclass__(**given)
        check_class(cls)

    def __init__(self, /, **given: Any) -> None:
        check_complete(type(self))
        self.shared: dict[str, Any] = {}
        self.options = {name: str(given.pop(name, text)) for name, text in self.OPTIONS.items()}
        if "period" in given:
            self.options["period"] = self._period(given.pop("period"))
        self.own = self._own_parameters(given)
        added = tuple(Parameter(n, "", "a parameter of an expression") for n in self.own)
        self._declared = {p.name: p for p in _resolved((*self.PARAMETERS, *added), given)}
        self.values = {
            name: p.check(given.pop(name, p.default), name) for name, p in self._declared.items()
        }
        self.validate()

    def _period(self, text: Any) -> str:
        """What is said of the period: that it is free."""
        if text != FREE:
            accepted = f"give {FREE!r}, or leave it out: the formulas state the forcing's"
            raise InputError("period", f"found {shown(text)}", accepted)
        return FREE

    @property
    def autonomous(self) -> bool:
        """Whether there is no forcing, and the periods of orbits are unknowns."""
        return self.AUTONOMOUS or self.options.get("period") == FREE

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
            found = f"{self.SYSTEM} has no parameter {name!r}{did_you_mean(name, self._declared)}"
            raise InputError(where, found, f"it has {', '.join(self._declared)}")
        return self._declared[name]

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

    @property
    def parameters(self) -> dict[str, float]:
        """Values of all parameters, derived ones included."""
        return {name: self[name] for name in (*self.values, *self.DERIVED)}

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

    def __repr__(self) -> str:
        shown = self.options | {name: f"{value:.12g}" for name, value in self.values.items()}
        inside = ", ".join(
            f"{name}={value!r}" if name in self.options else f"{name}={value}"
            for name, value in shown.items()
        )
        return f"{type(self).__name__}({inside})"


def _resolved(parameters: Sequence[Parameter], given: Mapping[str, Any]) -> list[Parameter]:
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
            in_force = [
                Parameter(
                    n, p.unit, f"{p.meaning} ({n})", p.default, p.lower, p.upper, p.above_lower
                )
                for n in p.split
            ]
        for q in in_force:
            if q.default is None and q.name not in given:
                instead = f" (or {' and '.join(p.split)})" if p.split and not finer else ""
                raise InputError(q.name, "missing", f"give {q.meaning}{instead}, {q.accepted}")
        resolved += in_force
    return resolved
