"""Whether what a model declares agrees with its formulas, at random states.

What a class declares is checked when it is defined (`contimpact.models.model`), names and
symbols when its formulas are looked at (`contimpact.models.equations`). Here formulas are evaluated
at random states and compared. Importing this module imports SymPy.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from random import Random
from typing import Any, TypeAlias

from ..errors import InputError, explain_arguments
from ..models.equations import equations_of
from ..models.guards import Guard, orders_of
from ..models.model import Model, Symmetry
from ..storage import logger
from .codegen import KernelWriter
from .segment import kernel_of

# Whether a model's flight, acceleration and harmonics state one motion, at random states.

TOLERANCE = 1e-6
"""Tolerance as a part of the largest velocity or acceleration: far above rounding, far below a
wrong term."""
STEP = 1e-6
"""Step of differences as a part of a flight's duration; their rounding is 1e-10, and as much is
left out of flights of a few periods of the forcing's highest harmonic."""

DURATIONS = tuple(0.25**k for k in range(6))
"""Parts of a period that flights take, the next where none has a value: behind a pole of a law they
have none."""


def check_motion(model: Model, wall: str, agreement: Callable[..., Sequence[float]]) -> None:
    """Compare the formulas of a model for the flight after a wall, by the kernel ``agreement`` of
    one coordinate; see `contimpact.segments.codegen`.

    Raises InputError naming the wall and the formulas that contradict each other.
    """
    random = Random(0)
    mode = next((guard.next_mode for guard in model.WALLS if guard.name == wall), "")
    where = model.place("flight from", wall) + (f" in the mode {mode!r}" if model.MODES else "")
    for part in DURATIONS:
        compared = [_trial(model, agreement, random, where, part) for _ in range(TRIALS)]
        if any(compared):
            return
    logger(__name__).warning(
        "%s: no flight from there at random states has a value, since the law has none, or no "
        "series on the guard, as d**1.5 at d = 0, or is too fast: it is not checked",
        where,
    )


def _trial(
    model: Model, agreement: Callable[..., Any], random: Random, where: str, part: float
) -> bool:
    """One comparison, for about this part of a period; False where the formulas have no value, or
    change too fast."""
    values = _values_near(model, random)
    start = [random.uniform(-1, 1) for _ in range(model.unknowns_per_impact - 1)]
    try:
        period = agreement(0.0, *start, 0.0, *values)[0]
        phase, dt = period * random.random(), part * period * random.uniform(0.2, 1.2)
        step = STEP * dt
        if not step > 0.0:
            return False
        begun, flown, *beside = (
            agreement(phase, *start, after, *values)
            for after in (0.0, dt, dt - step, dt + step, dt - 0.5 * step, dt + 0.5 * step)
        )
        later = agreement(phase + period, *start, dt, *values)
    except (ArithmeticError, ValueError):
        return False
    if not all(math.isfinite(n) for row in (begun, flown, *beside, later) for n in row[:-1]):
        return False
    slopes = [
        (((dt + h) * ahead[2] - (dt - h) * behind[2]) / (2.0 * h), (ahead[3] - behind[3]) / (2 * h))
        for h, behind, ahead in ((step, *beside[:2]), (0.5 * step, *beside[2:]))
    ]
    (coarse, pushed), (rate, push) = slopes
    speed = max(map(abs, (*begun[1:4], *flown[1:4], rate, dt * push, dt * flown[4])))
    if max(abs(rate - coarse), dt * abs(push - pushed)) > TOLERANCE * speed:
        return False  # the motion is too fast for differences
    largest = max(speed / dt, abs(begun[4]))  # of a long flight that decays, at its start
    for one, other, unit, found in (
        (begun[2], begun[1], speed, "its mean velocity does not begin as the velocity that reset"),
        (begun[3], begun[1], speed, "its end velocity does not begin as the velocity that reset"),
        (rate, flown[3], speed, "its mean velocity contradicts its end velocity"),
        (push, flown[4], largest, "its velocity contradicts the acceleration"),
        (flown[4], later[4], largest, "the acceleration does not have the forcing's period"),
        (flown[3], later[3], speed, "its end velocity does not have the forcing's period"),
        (flown[4], flown[5], largest, "the harmonics contradict the acceleration"),
    ):
        if abs(one - other) > TOLERANCE * unit:
            accepted = f"check them by hand; here {_numbers(model, phase, dt, start, values)}"
            raise InputError(where, f"{found}: {one:.6g} against {other:.6g}", accepted)
    return True


def _numbers(
    model: Model, phase: float, dt: float, start: Sequence[float], values: Sequence[float]
) -> str:
    """The random numbers of a comparison, by name."""
    coordinates = ", ".join(f"{number:.6g}" for number in start)
    parameters = (f"{n} = {value:.6g}" for n, value in zip(model.values, values, strict=True))
    return (
        f"dt = {dt:.6g}, phase = {phase:.6g}, the section coordinates before the impact are "
        f"({coordinates}), {', '.join(parameters)}"
    )


def _values_near(model: Model, random: Random) -> list[float]:
    """Parameter values about the model's own, none of them a special one."""
    moved = {
        name: value * random.uniform(0.9, 1.1) if value else random.uniform(0.01, 0.1)
        for name, value in model.values.items()
    }
    try:
        return list(model.replace(**moved).values.values())
    except InputError:
        return list(model.values.values())


Agreements: TypeAlias = dict[tuple[str, int], Callable[..., Sequence[float]]]
"""The kernels ``agreement``, by wall and coordinate."""

TRIALS = 3


@explain_arguments
def check_model(model: Model) -> list[str]:
    """Check that what a system states fits together.

    Derived parameters have to depend on what `DERIVED_FROM` says; flights, resets, accelerations,
    harmonics and period have to state one motion; a reset has to send the body away from its wall,
    a guard into its next mode; a symmetry has to be one. It is called by ``contimpact check`` and
    before the first kernel of a system's formulas is written.

    Parameters
    ----------
    model : Model
        Compared at random parameter values near its own, its symmetries at its own.

    Returns
    -------
    list of str
        What was compared, in words.

    Raises
    ------
    InputError
        Naming the formulas that contradict each other, and where.
    """
    writer = KernelWriter(model, (next(iter(model.values)),))
    places = [(wall, i) for wall in model.letters for i in range(model.DEGREES_OF_FREEDOM)]
    names = {(wall, i): f"agreement_{wall}_{i}" for wall, i in places}
    kernels: Agreements = {
        place: kernel_of(name, writer.write(name), f"<{name}>") for place, name in names.items()
    }
    done = [*_check_derived(model), *_period(model, kernels)]
    for (wall, _), kernel in kernels.items():
        check_motion(model, wall, kernel)
    _check_laws(model, writer, kernels)
    done += [f"flight from {wall.name}" for wall in model.WALLS]
    done += [*_resets(model, kernels), *_passages(model, kernels)]
    return [*done, *_symmetries(model, writer, kernels)]


def _check_derived(model: Model) -> list[str]:
    """Derived parameters depend on no more than the class says."""
    for name, e in equations_of(model).derived.items():
        declared = model.DERIVED_FROM.get(name, tuple(model.values))
        more = sorted(str(symbol) for symbol in e.free_symbols if str(symbol) not in declared)
        if more:
            where = f"{type(model).__name__}.DERIVED_FROM[{name!r}]"
            found = f"{name} depends on {', '.join(more)}, too"
            raise InputError(where, found, "name all parameters that it depends on")
    return ["derived parameters"] if model.DERIVED else []


def _period(model: Model, kernels: Agreements) -> list[str]:
    """The period is positive."""
    kernel = next(iter(kernels.values()))
    start = [0.0] * (model.unknowns_per_impact - 1)
    try:
        period = kernel(0.0, *start, 0.0, *model.values.values())[0]
    except (ArithmeticError, ValueError):
        return []  # of which `check_motion` says that it is not checked
    if not period > 0.0:
        raise InputError(model.place("period"), f"it is {period:.6g}", "give a positive one")
    return ["period"]


def _check_laws(model: Model, writer: KernelWriter, kernels: Agreements) -> None:
    """The law that a linear flight is computed from is of the positions themselves: simulations and
    compiled code take it from there, whatever the flight was given."""
    size, values = model.DEGREES_OF_FREEDOM, list(model.values.values())
    for guard in model.WALLS:
        if not all(orders_of(model.MODES, guard.next_mode, size)):
            continue
        name, random = f"law_{guard.name}", Random(7)
        law = kernel_of(name, writer.write(name), f"<{name}>")
        start = [random.uniform(-1, 1) for _ in range(model.unknowns_per_impact - 1)]
        try:
            _, *flown = law(0.0, *start, *values)
            stated = [kernels[guard.name, i](0.0, *start, 0.0, *values)[4] for i in range(size)]
        except (ArithmeticError, ValueError):
            continue
        if not flown:  # the flight is no linear one
            continue
        _, numbers, state = flown
        for i, there in enumerate(stated):
            terms = [a * x for a, x in zip(numbers[i * len(state) :], state, strict=False)]
            if abs(sum(terms) - there) > TOLERANCE * max(map(abs, terms)):
                found = f"its linear law gives the acceleration {sum(terms):.6g}, not {there:.6g}"
                accepted = "give Linear the positions themselves, and its force what shifts them"
                raise InputError(model.place("flight from", guard.name), found, accepted)


def _resets(model: Model, kernels: Agreements) -> list[str]:
    """What hits a rigid wall leaves it, or stays at it.

    Of several degrees of freedom an impact may depend on what does not hit, and is refused only if
    it goes on into the wall whatever that is.
    """
    size = model.DEGREES_OF_FREEDOM
    rigid = [guard for guard in model.WALLS if guard.rigid and _hits(model, guard)]
    for wall in rigid:
        random, seen = Random(1), list[tuple[float, float]]()
        for _ in range(TRIALS):
            before = wall.side * random.uniform(0.1, 1.0)
            start = [before, *(random.uniform(-1.0, 1.0) for _ in range(2 * size - 2))]
            try:
                left = [
                    kernels[wall.name, i](0.0, *start, 0.0, *model.values.values())[1]
                    for i in range(size)
                ]
            except (ArithmeticError, ValueError):
                continue
            seen.append((before, sum(c * v for c, v in zip(wall.row(size), left, strict=True))))
        onwards = [(b, after) for b, after in seen if after * wall.side > TOLERANCE * abs(b)]
        if onwards and (size == 1 or len(onwards) == len(seen)):
            before, after = onwards[0]
            found = f"it sends the body on into the wall: {before:.6g} becomes {after:.6g}"
            accepted = f"turn its velocity back, as -r*v does, or mend the side, {wall.side:+d}"
            raise InputError(model.place("reset at", wall.name), found, accepted)
    return [f"reset at {wall.name}" for wall in rigid]


def _hits(model: Model, wall: Guard) -> bool:
    """Whether velocities alone change at a wall, those of its gap coordinate among them."""
    orders = orders_of(model.MODES, wall.next_mode, model.DEGREES_OF_FREEDOM)
    row = wall.row(model.DEGREES_OF_FREEDOM)
    second = all(order == 2 for c, order in zip(row, orders, strict=True) if c)
    return second and equations_of(model).returns(wall.name, wall.name)


def _passages(model: Model, kernels: Agreements) -> list[str]:
    """What passes a guard is within the guards of its next mode; of one degree of freedom."""
    if model.DEGREES_OF_FREEDOM > 1:
        return []
    equations = equations_of(model)
    given = {equations.parameters[name]: value for name, value in model.values.items()}
    passed = [guard for guard in model.WALLS if not guard.rigid and not guard.past]
    for guard in passed:
        place = equations.departures[guard.name].position[0].subs(given)
        if place.free_symbols:
            continue
        for other in (g for g in model.WALLS if guard.next_mode in g.modes):
            within = other.side * (equations.walls[other.name].subs(given) - place)
            _check_passage(model, guard, other, float(within), kernels[guard.name, 0])
    return [f"passage at {guard.name}" for guard in passed]


def _check_passage(
    model: Model, guard: Guard, other: Guard, within: float, kernel: Callable[..., Sequence[float]]
) -> None:
    """`within` is how far inside a guard of the next mode the body is where that begins."""
    mode = guard.next_mode
    if within < -TOLERANCE:
        found = f"{guard.name!r} leads into the mode {mode!r} {-within:.6g} beyond {other.name!r}"
        accepted = (
            f"mend their positions, the jump at {guard.name!r}, or the side of {other.name!r}, "
            f"which is {other.side:+d}"
        )
        raise InputError(model.place("walls"), found, accepted)
    if within > TOLERANCE:
        return
    random, onwards = Random(3), []
    for _ in range(TRIALS):
        before = guard.side * random.uniform(0.1, 1.0)
        try:
            speed = other.side * kernel(0.0, before, 0.0, *model.values.values())[1]
        except (ArithmeticError, ValueError):
            continue
        onwards.append(speed > TOLERANCE * abs(before))
    if onwards and all(onwards):
        found = f"the body leaves the mode {mode!r} at once by {other.name!r}, where it begins"
        accepted = f"mend reset or jump at {guard.name!r}, or a side"
        raise InputError(model.place("jump at", guard.name), found, accepted)


def _symmetries(model: Model, writer: KernelWriter, kernels: Agreements) -> list[str]:
    """Every symmetry that the model has at its values maps flights to flights."""
    values = list(model.values.values())
    harmonics = kernel_of("harmonics", writer.write("harmonics"), "<harmonics>")(*values)
    found = []
    for name in model.values:
        symmetry = model.symmetry(name, harmonics)
        if symmetry is not None:
            _check_symmetry(model, name, symmetry, kernels)
            found.append(name)
    return [f"symmetry at all {', '.join(found)}"] if found else []


def _check_symmetry(model: Model, name: str, symmetry: Symmetry, kernels: Agreements) -> None:
    """Flights from a wall against those from its image, at other values of a parameter."""
    random, where = Random(2), f"{type(model).__name__}.symmetry in {name}"
    for _ in range(TRIALS):
        values = _change_value(model, name, random)
        start = [random.uniform(-1, 1) for _ in range(model.unknowns_per_impact - 1)]
        image = [symmetry.sign * x for x in start]
        for (wall, i), kernel in kernels.items():
            if symmetry.walls.get(wall) not in model.letters:
                accepted = f"give each of {', '.join(model.letters)} its image"
                raise InputError(where, f"the wall {wall!r} has none", accepted)
            other = kernels[symmetry.walls[wall], i]
            try:
                period = kernel(0.0, *start, 0.0, *values)[0]
                phase, dt = period * random.random(), period * random.uniform(0.2, 1.2)
                one = kernel(phase, *start, dt, *values)[1:5]
                two = other(phase + symmetry.shift * period, *image, dt, *values)[1:5]
            except (ArithmeticError, ValueError):
                continue
            size = max(map(abs, (*one, *two)))
            for what, a, b in zip(COMPARED, one, two, strict=True):
                if abs(symmetry.sign * a - b) > TOLERANCE * size:
                    found = (
                        f"the {what} after {wall!r} is {a:.6g}, and after {symmetry.walls[wall]!r} "
                        f"{b:.6g} in place of {symmetry.sign * a:.6g}"
                    )
                    raise InputError(where, found, "return None where there is no symmetry")


COMPARED = ("velocity", "mean velocity", "end velocity", "acceleration")
"""Results of the kernels ``agreement`` from the second place on."""


def _change_value(model: Model, name: str, random: Random) -> list[float]:
    """The model's values, with another one of a parameter."""
    value = model.values[name]
    moved = value * random.uniform(0.8, 1.2) if value else random.uniform(0.05, 0.2)
    try:
        return list(model.replace(**{name: moved}).values.values())
    except InputError:
        return list(model.values.values())
