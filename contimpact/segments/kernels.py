"""The kernels of a model: loaded from the cache or generated, and known by their sources.

Every kernel is one function in one readable file. The file's first line carries the key it was
generated for and a digest of the rest; a file that does not fit (truncated, edited, of another
version) is generated anew. Loading a cached kernel does not import SymPy.
"""

from __future__ import annotations

import functools
import hashlib
import itertools
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

from ..errors import InputError
from ..models.guards import are_parallel, following_letters, orders_of, pivot, rival_factor
from ..models.model import Model
from ..models.sources import digests
from ..storage import cache_folder, load_file, logger, reason, store_file, warn_uncached
from .bounded import bounded_kernel
from .kernel import SECTION, Family, Setup, differences_grow
from .segment import ELSEWHERE, Kernel, Passages, Segment, kernel_of, passages_of

# What of a system was compared: kept in the cache, so that a warm check does without SymPy.


def check_once(model: Model) -> list[str]:
    """Return what `check_model` has compared, once for a model's formulas, values and version.

    An `InputError` names what contradicts itself.
    """
    folder, key = cache_folder(), _key(model)
    system = re.sub(r"\W", "_", model.SYSTEM)
    path = folder / f"{system}-checked-{key[:16]}.json" if folder else None
    try:
        record = json.loads(load_file(path)) if path else None
    except (OSError, ValueError):
        record = None
    if isinstance(record, dict) and record.get("key") == key:
        return list(record["compared"])
    from .checking import check_model

    compared = check_model(model)
    if path:
        _write(path, json.dumps({"key": key, "compared": compared}))
    return compared


def _key(model: Model) -> str:
    """What was compared, and by what files."""
    files = (Path(__file__).with_name("checking.py"),)
    comparing = (hashlib.sha256(file.read_bytes()).hexdigest() for file in files)
    parts = (model.identity, repr(model.values), *comparing, *digests())
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


F = TypeVar("F")
Method = TypeVar("Method", bound=Callable[..., Any])


def _caller(
    arguments: str, number: str, given: str, model: Model, loaded: _LazyKernels[Any]
) -> Callable[..., Any]:
    """Return a function that calls a kernel by number, its parameters written out.

    A call with starred arguments takes twice as long.
    """
    names = ", ".join(f"p_{name}" for name in model.values)
    text = f"def call({arguments}):\n {names}, = p\n return loaded[{number}]({given}, {names})"
    namespace: dict[str, Any] = {"loaded": loaded}
    exec(text, namespace)
    return namespace["call"]


class _LazyKernels(dict[int, F]):
    """Kernels by number, loaded when they are first asked for."""

    def __init__(self, load: Callable[[int], F]) -> None:
        self.load = load

    def __missing__(self, number: int) -> F:
        self[number] = self.load(number)
        return self[number]


def _known(method: Method) -> Method:
    """A method that is asked once for each of its arguments, as long as its object lives."""
    place = f"_{method.__name__}_known"

    @functools.wraps(method)
    def known(self: Kernels, *given: str) -> Any:
        found = self.__dict__.setdefault(place, {})
        if given not in found:
            found[given] = method(self, *given)
        return found[given]

    return cast(Method, known)


class Kernels:
    """The kernels of one model with some free parameters, loaded as they are asked for.

    Parameters
    ----------
    model : Model
        Only its formulas matter, not its values.
    parameter, *others : str
        The free parameters, in which flights are differentiated; others are for curves.

    Attributes
    ----------
    loaded, generated : list of str
        Names of the kernels read from the cache and of those that had to be generated.
    planar : bool
        Whether motion has one coordinate.
    long : bool
        Whether one of the `flights` has grown too much to be computed as a whole.
    whole : bool
        Whether those of the orbits under way are known not to.
    """

    long = False
    whole = False

    def __init__(self, model: Model, parameter: str, *others: str) -> None:
        self.model, self.parameter = model, parameter
        self.planar = model.DEGREES_OF_FREEDOM == 1
        self.parameters = (parameter, *others)
        for name in self.parameters:
            model.require(name, "parameter")
            if self.parameters.count(name) > 1:
                raise InputError("parameter", f"{name} twice", "give different parameters")
        self.loaded: list[str] = []
        self.generated: list[str] = []
        self._functions: dict[str, Kernel] = {}
        self.unforced: set[tuple[float, ...]] = set()
        """Parameter values about which motions were seen not to depend on the time."""
        self._writer: Any = None

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy, or what was pickled, loads its kernels anew: they are functions of no module."""
        return type(self), (self.model, *self.parameters)

    @functools.cached_property
    def setup(self) -> Kernel:
        """``setup(*p)``: the `Setup`, what depends on the parameters alone."""
        return self.kernel("setup")

    def require_room(self, model: Model) -> None:
        """Raise `InputError` where no motion fits between two rigid walls of a mode."""
        places = self.setup(*model.values.values()).walls
        bounds = []
        for guard, place in zip(model.WALLS, places, strict=True):
            row = guard.row(model.DEGREES_OF_FREEDOM)
            factor = row[pivot(row)]
            bounds += [(guard, row, factor * guard.side, place / factor)] if guard.rigid else []
        for (one, row, side, low), (other, against, beyond, high) in itertools.permutations(
            bounds, 2
        ):
            facing = side < 0 < beyond and one.modes == other.modes and are_parallel(row, against)
            if facing and low > high:
                found = f"the wall {one.name} is at {low:.6g}, beyond {other.name} at {high:.6g}: "
                found += "there is no place between them"
                raise InputError("model", found, "exchange or move them, by their parameters")

    @functools.cached_property
    def harmonics(self) -> Kernel:
        """``harmonics(*p)``: the acceleration where it depends on time alone."""
        return self.kernel("harmonics")

    @functools.cached_property
    def passages(self) -> Passages:
        """What meets the flights, by the numbers of the guards."""
        guards, modes = self.model.WALLS, self.model.MODES
        alone = passages_of(guards, lambda a, b: a == b)
        if not modes and len({guard.coordinate for guard in guards}) == 1:
            return alone
        size = range(len(guards))
        numbers = [int(number) for number in self.kernel("surfaces")(*self.model.values.values())]
        table = [numbers[len(guards) * a : len(guards) * (a + 1)] for a in size]
        found = passages_of(guards, lambda a, b: table[a][b] % 4 == 1)
        onto, begins, at_rest, bends = (
            tuple(tuple(bool(number & bit) for number in row) for row in table)
            for bit in (2, 4, 8, 16)
        )
        if not modes:
            return alone._replace(bends=bends)
        return found._replace(onto=onto, begins=begins, at_rest=at_rest, bends=bends)

    @_known
    def may_leave_at_once(self, walls: str) -> bool:
        """Whether a flight of a word may begin or end beyond a guard of its mode, or begin on its
        surface so that the impact's velocity does not tell on which side."""
        passages, places = self.passages, map(self.model.letters.index, dict.fromkeys(walls))
        return any(
            passages.beginning(k)
            or passages.resting(k)
            or self.guards_ahead(k)
            or self.guards_behind(k)
            for k in places
        )

    def guards_ahead(self, left: int) -> list[int]:
        """Return the guards of the mode after one beyond which a flight may begin, of several
        coordinates: not on their surface, and the mode before does not have them, or the rate of
        their gap coordinates jumps there."""
        guards, passages = self.model.WALLS, self.passages
        if self.planar:
            return []
        beside = {*passages.beginning(left), *passages.resting(left)}
        bending = passages.bending(left)
        return [
            k
            for k, guard in enumerate(guards)
            if passages.watched[left][k]
            and (k in bending or not {*guard.modes} & {*guards[left].modes})
            and passages.arrivals[left][k] == ELSEWHERE
            and k not in beside
        ]

    def guards_behind(self, reached: int) -> list[int]:
        """Return the guards of the modes that one ends beyond which a flight may end: of other gap
        coordinates, where the mode after it does not have them; and its rivals, on surfaces that
        the flight may have met before."""
        guards, size = self.model.WALLS, self.model.DEGREES_OF_FREEDOM
        own, found = guards[reached], []
        for k, guard in enumerate(guards):
            left_behind = {*guard.modes} & {*own.modes} and own.next_mode not in guard.modes
            aside = left_behind and not are_parallel(guard.row(size), own.row(size))
            rival = k != reached and rival_factor(own, guard, size) is not None
            if (aside or rival) and not guard.past:
                found.append(k)
        return found

    @_known
    def segment(self, start: str, end: str) -> Segment:
        """The segment from one wall to another, by their letters.

        Raises InputError if the second cannot follow the first.
        """
        if start != SECTION:
            after = following_letters(self.model.WALLS, start)
            if end not in after:
                accepted = f"after {start} can come {' or '.join(after)}"
                raise InputError("word", f"it has {end} after {start}", accepted)
        if self.flown(start, end):
            from .integrated_form import IntegratedForm

            return IntegratedForm(self, start, end)
        return Segment(self, start, end)

    def flown(self, a: str, b: str) -> bool:
        """Whether the flight from wall a to wall b is integrated."""
        return self.flight(a, b).family is Family.INTEGRATED

    def flight(self, a: str, b: str) -> Kernel:
        """``flight(t0, *y0, t1, *y1, *p)``: the `Blocks` of a flight from wall a to wall b."""
        return self.kernel(f"flight_{a}_{b}")

    @_known
    def second(self, a: str, b: str) -> Callable[..., Any]:
        """``second(t0, *y0, t1, *y1, *q, *p)``: how the `Blocks` of a flight change along q."""
        from .derivatives import second_derivatives

        return second_derivatives(self.flight(a, b), self._ends, self.parameters)

    @_known
    def third(self, a: str, b: str) -> Callable[..., Any]:
        """``third(t0, *y0, t1, *y1, *q, *p)``: third derivatives of the residual along q."""
        from .derivatives import third_derivatives

        return third_derivatives(self.flight(a, b), self._ends)

    def bounded(self, a: str, b: str) -> Callable[..., Any]:
        """``bounded(t0, *y0, t1, *y1, *p)``: `flight` of pairs (value, bound of its error)."""
        return bounded_kernel(self.flight(a, b))

    @functools.cached_property
    def bounded_period(self) -> Callable[..., Any]:
        """``bounded_period(*p)``: the forcing period of pairs."""
        return bounded_kernel(self.setup, Setup._fields.index("period"))

    @property
    def _ends(self) -> int:
        """Unknowns at both ends of a flight."""
        return 2 * self.model.unknowns_per_impact

    def motion(self, a: str) -> Kernel:
        """``motion(t0, *y0, dt, *p)``: displacement, velocity, acceleration after wall a."""
        return self.kernel(f"motion_{a}")

    def states(self, a: str) -> Kernel:
        """``states(t0, *y0, dt, *p)``: position and velocity of each coordinate after wall a."""
        return self.kernel(f"states_{a}")

    def since(self, a: str) -> Kernel:
        """``since(*state, dt, *p)``: position, velocity and acceleration of the gap coordinate of
        wall a, from the state on the section t = 0."""
        return self.kernel(f"since_{a}")

    def passing(self, a: str) -> Kernel:
        """``passing(t0, *state, dt, *p)``: the same from any state in the first mode."""
        return self.kernel(f"passing_{a}")

    def gap(self, a: str, b: str) -> Kernel:
        """``gap(t0, *y0, dt, *p)``: the gap coordinate of wall b after wall a."""
        return self.kernel(f"gap_{a}_{b}")

    def gap_after(self, left: str, wall: str) -> Kernel:
        """Return the gap coordinate of a wall after another one, or after the section."""
        return self.since(wall) if left == SECTION else self.gap(left, wall)

    def law(self, a: str) -> Kernel:
        """``law(t0, *y0, *p)``: what a linear flight after a wall is computed from."""
        return self.kernel(f"law_{a}")

    def rates(self, a: str) -> Kernel:
        """``rates(t, *x, *v, *p)``: the velocities of coordinates of first order after a wall, and
        how they change with positions and velocities, a row for each coordinate."""
        return self.kernel(f"rates_{a}")

    def loss(self, a: str) -> Kernel:
        """``loss(*y0, *p)``: the kinetic energy that an impact takes, alone in a tuple."""
        return self.kernel(f"loss_{a}")

    def field(self, a: str) -> Kernel:
        """``field(t0, *y0, *p)``: what a flight after a wall is integrated from; from the section
        ``field(*state, *p)``."""
        return self.kernel(f"field_{a}")

    @_known
    def field_text(self, a: str) -> str:
        """The text of that field; see `integration.text_of`."""
        from .taylor import field_of

        return field_of(self.field(a))

    @_known
    def linear(self, a: str) -> bool:
        """Whether the flight after a wall is a linear one, which `law` describes."""
        model, size = self.model, self.model.DEGREES_OF_FREEDOM
        orders = orders_of(model.MODES, model.guard(a).next_mode, size)
        return all(orders) and self.motion(a).family is Family.LINEAR

    @_known
    def has_law(self, a: str) -> bool:
        """Whether it is one of the coordinates that its mode has, which may be fewer."""
        return self._moving(a).family is Family.LINEAR

    def mechanical(self, a: str) -> bool:
        """Whether it is linear, and all coordinates have inertia."""
        model, size = self.model, self.model.DEGREES_OF_FREEDOM
        orders = orders_of(model.MODES, model.guard(a).next_mode, size)
        return self.linear(a) and orders == (2,) * size

    @_known
    def integrated(self, a: str) -> bool:
        """Whether the flight after a wall, or from the section, is integrated, from its `field`."""
        return self._moving(a).family is Family.INTEGRATED

    def _moving(self, a: str) -> Kernel:
        """A kernel of how a gap coordinate moves in the mode after a wall, or in the first one."""
        model, size = self.model, self.model.DEGREES_OF_FREEDOM
        first = model.MODES[0].name if model.MODES else ""
        guard = next((g for g in model.WALLS if g.name == a), None)
        mode = first if guard is None else guard.next_mode
        orders = orders_of(model.MODES, mode, size)
        met = next(g for g in model.WALLS if mode in g.modes)
        if guard is None:
            return self.since(model.WALLS[0].name if all(orders) else met.name)
        has = any(c and order for c, order in zip(guard.row(size), orders, strict=True))
        return self.motion(a) if has else self.gap(a, met.name)

    def arrival(self, a: str, b: str) -> int:
        """Where the flight between two walls ends; see `contimpact.segments.segment`."""
        return self.passages.arrivals[self.model.letters.index(a)][self.model.letters.index(b)]

    @functools.cached_property
    def oscillates(self) -> bool:
        """Whether the flights of one coordinate follow laws alike, for `segments.oscillation`."""
        guards = self.model.WALLS
        if any(guard.row(self.model.DEGREES_OF_FREEDOM) != (1,) for guard in guards):
            return False
        if not self.passages.anchored or any(self.integrated(guard.name) for guard in guards):
            return False
        given = 0.0, 1.0, *self.model.values.values()
        laws = [self.law(guard.name)(*given) for guard in guards]
        return len(laws[0]) > 1 and len({law[1:2] for law in laws}) == 1

    @functools.cached_property
    def has_paths(self) -> bool:
        """Whether the flights after all walls are integrated, by what compiled code can do."""
        return all(self.has_path(guard.name) for guard in self.model.WALLS)

    def has_path(self, a: str) -> bool:
        """Whether the flight after a wall, or from the section, is one of those."""
        if not self.integrated(a):
            return False
        from .taylor import has_series

        return has_series(self.field_text(a))

    @functools.cached_property
    def identity(self) -> str:
        """What the kernels' formulas depend on, as a hash."""
        return self._key("")

    def depends(self, name: str) -> bool:
        """Whether what a kernel returns depends on the free parameter."""
        return self.parameter in self.kernel(name).parameters

    @functools.cached_property
    def flights(self) -> Callable[..., Any]:
        """``flights(kind, t0, v0, t1, v1, p)``: the flight between two walls by their numbers,
        kind = start * walls + end; for one degree of freedom."""
        loaded = self._between(self.noticed)
        return _caller("kind, t0, v0, t1, v1, p", "kind", "t0, v0, t1, v1", self.model, loaded)

    def _between(
        self, of_walls: Callable[[str, str], Callable[..., Any]]
    ) -> _LazyKernels[Callable[..., Any]]:
        """Kernels of two walls by the kind of a flight."""
        named = self.model.letters
        return _LazyKernels(lambda kind: of_walls(*(named[i] for i in divmod(kind, len(named)))))

    def noticed(self, a: str, b: str) -> Callable[..., Any]:
        """Return `flight`; of one that is integrated it is noticed if it is `long`."""
        flight = self.flight(a, b)
        if flight.family is not Family.INTEGRATED:
            return flight

        def noticed(*given: float) -> Any:
            blocks = flight(*given)
            m = self.model.unknowns_per_impact
            self.long = self.long or differences_grow(blocks[1], blocks[2], m, a != SECTION)
            return blocks

        return noticed

    @functools.cached_property
    def seconds(self) -> Callable[..., Any]:
        """``seconds(kind, t0, v0, t1, v1, q0, q1, q2, q3, p)``: how the `Blocks` of the flight
        between two walls by their numbers change along q, parameters held; for one degree of
        freedom."""
        ends = "t0, v0, t1, v1, q0, q1, q2, q3"
        held = ", 0.0" * len(self.parameters)
        loaded = self._between(self.second)
        return _caller(f"kind, {ends}, p", "kind", ends + held, self.model, loaded)

    @functools.cached_property
    def motions(self) -> Callable[..., Any]:
        """``motions((wall, t0, *y0), dt, p)``: the motion after a wall by its number."""
        loaded = _LazyKernels[Kernel](lambda wall: self.motion(self.model.WALLS[wall].name))
        head = "".join(f"head[{i + 1}], " for i in range(self.model.unknowns_per_impact))
        return _caller("head, dt, p", "head[0]", f"{head}dt", self.model, loaded)

    def kernel(self, name: str) -> Kernel:
        """Return a kernel as a function of floats."""
        if name not in self._functions:
            self._functions[name] = self._load(name)
        return self._functions[name]

    def _load(self, name: str) -> Kernel:
        key = self._key(name)
        folder = cache_folder()
        system = re.sub(r"\W", "_", self.model.SYSTEM)
        path = (
            folder / f"{system}-{'_'.join(self.parameters)}-{name}-{key[:16]}.py"
            if folder
            else None
        )
        source = (_read(path, key) if path else None) or _unwritten.get(key)
        if source is None:
            source = self._generate(name, key)
            self.generated.append(name)
            if not (path and _write(path, source)):
                _unwritten[key] = source
        else:
            self.loaded.append(name)
        return _function_of(name, source, str(path or f"<kernel {name}>"))

    def _key(self, name: str) -> str:
        parts = (name, *self.parameters, self.model.identity, *digests())
        return hashlib.sha256("\0".join(parts).encode()).hexdigest()

    def _generate(self, name: str, key: str) -> str:
        from .checking import check_model
        from .codegen import KernelWriter

        logger(__name__).info("generating kernel %s of %s", name, self.model.SYSTEM)
        if self._writer is None:
            self._writer = KernelWriter(self.model, self.parameters)
            if "checked" not in self.model.shared:
                self.model.shared["checked"] = check_model(self.model)
        free = ", ".join(self.parameters)
        body = (
            f"# A kernel of contimpact: {self.model.SYSTEM}, {name}; free: {free}.\n"
            "# Generated by SymPy from the model's formulas; delete freely, it will be generated "
            f"again.\n# {self.model.options}\n\n" + self._writer.write(name)
        )
        return f"# {key} {_digest(body)}\n{body}"


_function_of = functools.lru_cache(maxsize=1024)(kernel_of)
"""Kernels are the same functions for all who load the same text."""

_unwritten: dict[str, str] = {}
"""Sources by their keys that the cache could not keep: this process generates them once."""


def _digest(body: str) -> str:
    return hashlib.sha256(body.encode()).hexdigest()


def _read(path: Path, key: str) -> str | None:
    """The source in the file if it is whole and the one asked for, else None."""
    try:
        source = load_file(path).decode()
    except FileNotFoundError:
        return None
    except (OSError, UnicodeDecodeError) as error:
        logger(__name__).warning(
            "cached kernel %s cannot be read (%s): generating it anew", path, reason(error)
        )
        return None
    head, _, body = source.partition("\n")
    if head != f"# {key} {_digest(body)}":
        logger(__name__).warning("cached kernel %s is damaged or foreign: generating it anew", path)
        return None
    return source


def _write(path: Path, source: str) -> bool:
    """Put a source into the cache; False where that fails."""
    try:
        store_file(path, source.encode())
    except OSError as error:
        warn_uncached(path.parent, error)
        return False
    return True
