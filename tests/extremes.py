"""Extreme cases, each with its measured outcome: what `test_extremes.py` checks and the docs show.

``python tests/extremes.py docs/figures/extremes.md`` computes the table of the documentation anew.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import mpmath
import numpy as np
from scipy.optimize import brentq
from zoo import unknowns_of

from contimpact import ImpactPair, InputError, Oscillator, Settings, find_orbits
from contimpact.accuracy.reference import (
    ExactFlights,
    Reference,
    flights_of,
    plain_voltage,
    voltages,
)
from contimpact.bifurcations.grazing import touches_at
from contimpact.bifurcations.kind import switch, test_functions
from contimpact.continuation.corrector import correct
from contimpact.diagrams.orbit_walks import walk_both_ways
from contimpact.models.guards import Word
from contimpact.orbits.problem import OrbitProblem
from contimpact.orbits.search import solve_near
from contimpact.segments.kernels import Kernels
from contimpact.simulation.energy import attractor_voltages
from contimpact.simulation.settle import settle
from contimpact.simulation.simulator import Simulator
from contimpact.systems.membrane import Membrane

EVENTS = ("FB", "PD", "G", "V", "T")
CASES: dict[str, Callable[[], Row]] = {}


@dataclass(frozen=True)
class Row:
    """What was measured of a case; errors are against thirty digits.

    `allowed` is the largest error that double precision excuses here.
    """

    outcome: str
    residual: float = math.nan
    error: float = math.nan
    condition: float = math.nan
    allowed: float = 1e-12
    note: str = ""


def case(name):
    """Put a function among the cases."""

    def keep(function):
        CASES[name] = function
        return function

    return keep


def pair(**changes):
    """The impact pair of Fig. 7, changed."""
    return ImpactPair(**{"beta": math.pi / 6, "r": 0.3, "A": 5.0, "s": 0.389} | changes)


def measured(model, word, parameter, limits, events=EVENTS, most=2, max_points=150, **extra):
    """Follow orbits of a word; the worst point and event against thirty digits."""
    kernels = Kernels(model, parameter)
    orbits = find_orbits(model, word, kernels=kernels, starts=64, rounds=4)
    if not orbits:
        return Row(f"no {word} orbit found, said so")
    residual, errors, conditions, count, points, missed = 0.0, [0.0], [0.0], 0, 0, 0
    for orbit in orbits[:most]:
        problem, exact = orbit.problem, Reference(orbit.problem)
        tests = test_functions(problem, events, {})
        run = walk_both_ways(
            problem, orbit.unknowns, limits, tests, Settings(max_points=max_points)
        )
        points += len(run.points)
        missed += sum(len(walk.missed) for walk in run.walks)
        for event in run.events:
            found = exact.event(event.kind, event.point.unknowns, event.details)
            errors.append(found.distance(event.point.unknowns) if found else math.inf)
            conditions.append(found.condition if found else math.inf)
            residual = max(residual, event.residual)
        count += len(run.events)
        here = solve_near(problem, orbit.unknowns)
        found = exact.orbit(here.unknowns)
        errors.append(found.distance(here.unknowns) if found else math.inf)
        conditions.append(found.condition if found else math.inf)
        residual = max(residual, float(np.max(np.abs(here.residual))))
    note = f"{len(orbits)} orbits, {points} points, {count} events" + (
        f", {missed} sign changes reported as not located" if missed else ""
    )
    return Row("solved", residual, max(errors), max(conditions), note=note, **extra)


def solved(problem, guess, exact=True, **extra):
    """An orbit at fixed parameter from a guess, against thirty digits."""
    here = solve_near(problem, guess)
    if here is None:
        return Row("Newton did not converge, said so")
    found = Reference(problem).orbit(here.unknowns) if exact else None
    error = found.distance(here.unknowns) if found else math.inf
    return Row(
        "solved",
        float(np.max(np.abs(here.residual))),
        error,
        float(np.linalg.cond(here.jacobian[:, :-1])),
        **extra,
    )


for value, text, known in (
    (0.0, "0", {"events": [kind for kind in EVENTS if kind != "G"]}),  # see test_status.py
    (1e-12, "1e-12", {"allowed": 1e-11}),  # a touch within 1e-6 of an impact
    (1 - 1e-12, "1 - 1e-12", {"allowed": 1e-8}),  # the fold of a pitchfork that is hardly unfolded
    (1.0, "1", {}),
):
    case(f"r = {text}")(
        lambda r=value, known=known: measured(pair(r=r, s=0.45), "1:1", "s", (0.3, 0.6), **known)
    )

for value, text in ((0.0, "0"), (1e-12, "1e-12"), (math.pi / 2, "pi/2")):
    case(f"beta = {text}")(lambda b=value: measured(pair(beta=b), "1:1", "s", (0.25, 0.5)))


@case("s, A and g over twelve decades at fixed d")
def scaling():
    """Everything dimensionless must agree to rounding."""
    seen = []
    for decade in range(-6, 7):
        k = 10.0**decade
        model = pair(s=0.34 * k, A=5.0 * k, g=9.8 * k)
        orbit = find_orbits(model, "1:1", parameter="s", starts=64, rounds=4)[0]
        tests = test_functions(orbit.problem, ("FB", "PD", "G"), {})
        run = walk_both_ways(orbit.problem, orbit.unknowns, (0.3 * k, 0.6 * k), tests, Settings())
        seen.append([event.parameter / k for event in run.events])
    spread = float(np.max(np.ptp(np.array(seen), axis=0) / np.mean(seen, axis=0)))
    return Row("solved", error=spread, note="13 decades; error is the relative spread of events")


@case("d -> 0: one orbit of 1:1 as s falls to 1e-9")
def small_gap():
    model = pair(s=0.389)
    orbit = find_orbits(model, "1:1", parameter="s", starts=64, rounds=4)[0]
    tests = test_functions(orbit.problem, ("FB", "PD", "T"), {})
    settings = Settings(max_points=300)
    run = walk_both_ways(orbit.problem, orbit.unknowns, (1e-9, 0.4), tests, settings)
    last = run.points[0].evaluation
    at = last.unknowns[-1]
    row = solved(orbit.problem, last.unknowns)
    return Row(
        "solved",
        row.residual,
        row.error,
        row.condition,
        1e-11,
        f"reached s = {at:.3g}; {run.walks[0].end.message}",
    )


def chattering(count):
    """A word with `count` impacts on one wall, grown by grazings is too slow: ask the search."""
    model = pair(s=0.05, r=0.6)
    return measured(model, f"{count}:1", "s", (0.03, 0.08), events=("FB", "PD"), most=1)


case("d -> 0: 6:1, chattering at the bottom")(lambda: chattering(6))


@case("d -> 0: 200 impacts per period (100:100), r = 1")
def many_impacts():
    """Bouncing between walls much faster than the forcing: an adiabatic invariant, hence nearly a
    line of orbits."""
    model = pair(s=0.02, r=1.0, beta=0.0)
    problem = OrbitProblem(model, Word("BT" * 100), Kernels(model, "s"))
    gap = problem.kernels.setup(*model.values.values()).derived[0]
    times = np.arange(200) / 100.0
    speeds = np.where(np.arange(200) % 2 == 0, 1.0, -1.0) * gap * 100.0
    return solved(problem, unknowns_of(problem, times, speeds), allowed=1e-9)


@case("word of 200 impacts, 1:1/100T")
def long_word():
    return repeated(pair(s=0.3515), 100)


@case("p = 64: 1:1/64T")
def long_period():
    return repeated(pair(s=0.37), 64)


def repeated(model, times):
    """The 1:1 orbit run many times: the multipliers are known powers."""
    kernels = Kernels(model, "s")
    orbit = find_orbits(model, "1:1", kernels=kernels, starts=64, rounds=4)[0]
    rows = orbit.problem.impacts(orbit.unknowns)
    later = [rows + np.array([2.0 * k, 0.0]) for k in range(times)]
    problem = OrbitProblem(model, Word("BT" * times, times), kernels)
    guess = unknowns_of(problem, np.vstack(later)[:, 0] + 1e-6, np.vstack(later)[:, 1])
    row = solved(problem, guess, allowed=1e-10)
    here = solve_near(problem, guess)
    found = Reference(problem).orbit(here.unknowns)
    large = Reference(problem).multipliers(found.unknowns)[0]
    off = abs(float(here.multipliers[0].real / float(large)) - 1.0)
    tests = test_functions(problem, ("FB",), {})
    value = float(here.unknowns[-1])
    run = walk_both_ways(problem, here.unknowns, (value - 1e-3, value + 1e-3), tests, Settings())
    ends = " and ".join(walk.end.kind.name for walk in run.walks)
    return Row(
        row.outcome,
        row.residual,
        row.error,
        row.condition,
        row.allowed,
        f"multiplier {float(large):.3g} off by {off:.1e} (relative); branch ends: {ends}",
    )


def grazing_event():
    """The ghost grazing of the 1:1 orbit of Fig. 7."""
    orbit = find_orbits(pair(s=0.34), "1:1", parameter="s", starts=64, rounds=4)[0]
    tests = test_functions(orbit.problem, ("G",), {})
    run = walk_both_ways(orbit.problem, orbit.unknowns, (0.3, 0.36), tests, Settings())
    return run.events[0]


def beside_grazing(speed):
    """The 2:1 orbit whose new impact has a given velocity, and its largest multiplier."""
    start = switch(grazing_event())
    problem = start.problem
    place = int(np.argmin(np.abs(problem.impacts(start.unknowns)[:, 1]))) * 2 + 1
    guess = start.unknowns + start.tangent * (speed / start.tangent[place])
    row = np.zeros(len(guess))
    row[place] = 1.0
    guess[place] = speed
    scale = np.ones(len(guess))
    here = correct(problem, guess, row, scale, Settings(tolerance=1e-15)).evaluation
    exact = Reference(problem)
    found = exact.orbit(here.unknowns, held=place)
    large = float(exact.multipliers(found.unknowns)[0])
    off = abs(here.multipliers[0].real / large - 1.0)
    return Row(
        "solved",
        float(np.max(np.abs(here.residual))),
        found.distance(here.unknowns),
        float(np.linalg.cond(here.jacobian)),
        note=f"multiplier {large:.3g}, off by {off:.1e} (relative)",
    )


for value in (1e-6, 1e-10, 1e-14):
    case(f"impact velocity {value:.0e} beside a grazing")(lambda v=value: beside_grazing(v))


@case("two grazings 1e-11 apart (beta = 1e-11)")
def close_events():
    return symmetric_grazings(1e-11)


@case("grazing on two flights at once (beta = 0)")
def double_grazing():
    return symmetric_grazings(0.0)


def symmetric_grazings(beta):
    """The grazings of the (nearly) symmetric 1:1 orbit, one on each flight."""
    kernels = Kernels(pair(beta=beta), "s")
    errors, apart, residual, orders = [], [], 0.0, []
    for orbit in find_orbits(pair(beta=beta, s=0.33), "1:1", kernels=kernels):
        tests = test_functions(orbit.problem, ("G",), {})
        run = walk_both_ways(orbit.problem, orbit.unknowns, (0.05, 0.6), tests, Settings())
        exact = Reference(orbit.problem)
        for event in run.events:
            found = exact.event("G", event.point.unknowns, event.details)
            errors.append(found.distance(event.point.unknowns))
            residual = max(residual, event.residual)
            orders.append(len(touches_at(event)))
        places = sorted(event.parameter for event in run.events)
        apart += np.diff(places).tolist()
    return Row(
        "solved",
        residual,
        max(errors, default=math.inf),
        note=f"{len(errors)} events, closest {min(apart, default=math.nan):.1e} apart, "
        f"touches at each {sorted(set(orders))}",
    )


@case("FB meets G (codimension two), 1:1/2T -> (3:2)/2T")
def fold_at_grazing():
    """Where the branch born at the grazing leaves it vertically; found in r."""

    def steepness(r):
        event = last_grazing(r)
        tangent = switch(event).tangent
        return float(tangent[-1] / np.linalg.norm(tangent))

    r = brentq(steepness, 0.3, 0.4, xtol=1e-15, rtol=1e-14)
    event = last_grazing(r)
    start = switch(event)
    tests = test_functions(start.problem, ("FB", "V"), {})
    run = walk_both_ways(start.problem, start.unknowns, (0.3, 0.4), tests, Settings())
    near = [e for e in run.events if abs(e.parameter - event.parameter) < 1e-6]
    errors = [math.inf]
    for e in near:
        found = Reference(start.problem).event(e.kind, e.point.unknowns, e.details)
        errors.append(found.distance(e.point.unknowns) if found else math.inf)
    kinds = "+".join(sorted(e.kind for e in near))
    apart = max(e.parameter for e in near) - min(e.parameter for e in near)
    return Row(
        "solved",
        max(e.residual for e in near),
        max(errors[1:]),
        allowed=1e-9,
        note=f"r = {r:.12g}, s = {event.parameter:.12g}: {kinds}, {apart:.0e} apart",
    )


def last_grazing(r):
    """The grazing at the bottom of the 1:1/2T orbits with the largest s."""
    orbits = find_orbits(pair(s=0.33, r=r), "1:1/2T", parameter="s", starts=64, rounds=4)
    events = []
    for orbit in orbits:
        tests = test_functions(orbit.problem, ("G",), {})
        run = walk_both_ways(orbit.problem, orbit.unknowns, (0.3, 0.4), tests, Settings())
        events += [e for e in run.events if e.details["wall"] == "B"]
    return max(events, key=lambda e: e.parameter)


for text in ("cos(pi*t) + 0.3*cos(25*pi*t)", "cos(pi*t) - 0.999999*cos(pi*t)"):
    case(f"forcing {text}")(
        lambda f=text: measured(
            pair(forcing=f, s=0.389 if "25" in f else 0.389e-6, g=9.8 if "25" in f else 9.8e-6),
            "1:1",
            "s",
            (0.3, 0.5) if "25" in f else (0.3e-6, 0.5e-6),
        )
    )


@case("flights of 16 periods (B/16T)")
def long_flights():
    return measured(pair(s=50.0, A=50.0), "B/16T", "s", (40.0, 60.0), allowed=1e-11)


@case("flights of 200 periods (oscillator, S/200T)")
def very_long_flights():
    model = Oscillator(a=1.0, omega=3.7, c=0.01, k=1.0, sigma=0.05, r=0.8)
    return measured(model, "S/200T", "sigma", (0.01, 0.07), allowed=1e-9)


@case("late times: the orbit of Fig. 7 after 1e6 periods")
def late():
    orbit = find_orbits(pair(), "1:1", parameter="s", starts=64, rounds=4)[0]
    problem = orbit.problem
    later = orbit.unknowns.copy()
    later[: -1 : problem.m] += 2e6
    row = np.zeros(len(later))
    row[-1] = 1.0
    scale = problem.scale(later, 1.0)
    result = correct(problem, later, row, scale, Settings())
    if result.evaluation is None:
        return Row(f"refused: {result.reason}")
    here = result.evaluation
    found = Reference(problem).orbit(here.unknowns)
    return Row(
        "solved",
        float(np.max(np.abs(here.residual))),
        found.distance(here.unknowns),
        float(np.linalg.cond(here.jacobian)),
        1e-9,
        note=f"a double near 2e6 is rounded by {np.spacing(2e6):.1e}; the search starts in [0, T)",
    )


def oscillator(**changes):
    """An oscillator whose forcing is as large as what resists it, so that it reaches its stop."""
    return Oscillator(
        **{"a": 1.0, "omega": 1.0, "c": 0.1, "k": 1.0, "sigma": 0.3, "r": 0.8} | changes
    )


for text, c, allowed in (("1e4", 1e4, 1e-12), ("1e8", 1e8, 1e-8)):  # the condition number is c/k
    case(f"oscillator, overdamped, c = {text}: orbits of S")(
        lambda c=c, e=allowed: measured(
            oscillator(c=c, a=c), "S", "a", (0.9 * c, 1.1 * c), allowed=e
        )
    )


for text, c, kinds, allowed in (  # PD stands beside V, 3e-9 of its value from it
    ("c = 1e4: four decades of a", 1e4, ("FB", "PD", "V"), 1e-8),
    ("c = 1e8: four decades of a", 1e8, ("PD", "V"), 1e-7),
    ("c = 1e8: the fold", 1e8, ("FB",), 1.0),  # of 3e7: its condition number is (c/k)^2
):
    case(f"oscillator, overdamped, {text}")(
        lambda c=c, kinds=kinds, e=allowed: measured(
            oscillator(c=c, a=c), "S", "a", (0.01 * c, 100 * c), kinds, 1, 1000, allowed=e
        )
    )


@case("oscillator, stiff, k = 1e8: an orbit of S")
def stiff():
    """Thousands of free oscillations in a flight; a walk would look for its touches among them."""
    orbit = find_orbits(oscillator(k=1e8, a=1e8, c=100.0), "S", parameter="a", starts=64)[0]
    return solved(orbit.problem, orbit.unknowns)


def flown(model, wall, time, velocity, impacts, allowed=1e-12):
    """A simulation, each flight against thirty digits, of the oscillator by its roots besides."""
    simulator = Simulator(model)
    run = simulator.run(simulator.state(wall, time, velocity), impacts=impacts)
    exact = ExactFlights(simulator)
    errors = exact.errors(run)
    flights = len(errors)
    if isinstance(model, Oscillator):
        errors += [off_by_roots(model, exact, run, k) for k in flights_of(run)]
    rests = int(np.sum(run.released))
    return Row(
        "solved",
        error=max(errors),
        allowed=allowed,
        note=f"{flights} flights, {rests} rests; {run.outcome.name}",
    )


INSIDE = [*np.geomspace(1e-7, 0.9, 60).tolist(), *(k / 60 for k in range(1, 60))]
"""Parts of a flight at which it must not have arrived yet, more of them next to its start."""


def off_by_roots(model, exact, run, k):
    """How far a flight's arrival is from that of the motion with the roots of s^2 + c s + k.

    In sixty digits, from the equation of motion alone.
    """
    ctx = mpmath.mp.clone()
    ctx.dps = 60
    _, start, guess = exact.about(run, k, [float(run.phases[k]), float(run.velocities[k])])
    a, w, c, stiffness, sigma, r = (ctx.mpf(x) for x in model.values.values())
    high = -c / 2 + ctx.sqrt(ctx.mpc(c**2 / 4 - stiffness))
    roots, response = (high, -c - high), a / ctx.mpc(stiffness - w**2, c * w)
    t0 = ctx.mpf(start[0])
    x, v = sigma - ctx.re(response * ctx.expj(w * t0)), -r * ctx.mpf(start[1])
    v -= ctx.re(1j * w * response * ctx.expj(w * t0))
    parts = [(v - other * x) / (one - other) for one, other in (roots, roots[::-1])]

    def state(t):
        """Position from the stop and velocity."""
        free = [p * ctx.exp(s * (t - t0)) for p, s in zip(parts, roots, strict=True)]
        steady = response * ctx.expj(w * t)
        speed = sum(s * f for s, f in zip(roots, free, strict=True)) + 1j * w * steady
        return ctx.re(sum(free) + steady) - sigma, ctx.re(speed)

    t = ctx.mpf(guess[0])
    for _ in range(8):
        position, speed = state(t)
        t -= position / speed
    position, speed = state(t)
    assert abs(position) < 1e-40
    assert all(state(t0 + part * (t - t0))[0] <= 0 for part in INSIDE), "an earlier arrival"
    return max(abs(float(t - guess[0])), abs(float(speed - guess[1])))


case("simulation of the pair, chattering to rest")(lambda: flown(CHATTERING, "B", 0.3, 0.5, 60))
case("simulation of the pair, r = 1")(lambda: flown(pair(r=1.0), "B", 0.3, 0.5, 60))
case("simulation of the pair, s = 1e-9")(lambda: flown(pair(s=1e-9), "B", 0.3, 0.5, 60))
case("simulation of the pair, forcing cos(pi*t) + 0.3*cos(25*pi*t)")(
    lambda: flown(pair(forcing="cos(pi*t) + 0.3*cos(25*pi*t)"), "B", 0.3, 0.5, 60)
)
case("simulation of the oscillator, overdamped, c = 1e4")(
    lambda: flown(oscillator(c=1e4, a=1e4), "S", 0.3, 0.5, 3)
)
case("simulation of the oscillator, overdamped, c = 1e8")(
    lambda: flown(oscillator(c=1e8, a=1e8), "S", 0.3, 0.5, 3)
)
for text, k, impacts, allowed in (  # its flight after rest has 1e4 oscillations, whence the error
    ("1e4", 1e4, 3, 1e-12),
    ("1e8", 1e8, 40, 1e-11),
):
    case(f"simulation of the oscillator, stiff, k = {text}")(
        lambda k=k, n=impacts, e=allowed: flown(oscillator(k=k, a=k), "S", 0.3, 0.5, n, e)
    )


@case("voltages of impacts from 1e-9 to 30 m/s")
def voltages_of_impacts():
    """Table A1 as printed loses all digits at low velocities, in doubles."""
    membrane, ctx = Membrane(), mpmath.mp.clone()
    ctx.dps = 60
    errors = []
    for velocity in np.geomspace(1e-9, 30.0, 60).tolist():
        exact = plain_voltage(membrane, ctx.mpf(velocity), ctx)
        errors.append(abs(float(float(membrane.voltage(velocity)) / exact - 1)))
    return Row("solved", error=max(errors), note="relative")


CHATTERING = pair(s=1.5, r=0.5, beta=1.2)


def voltages_along(model, impacts, allowed=1e-11):
    """The simulation's own error included."""
    simulator = Simulator(model)
    run = simulator.run(simulator.state("B", 0.3, 0.5), impacts=impacts)
    exact = ExactFlights(simulator)
    found = voltages(Membrane(), model.values, run, exact.along(run)[1], exact.exact.ctx)
    note = f"{found['impacts']} impacts, relative"
    return Row("solved", error=found["along"], allowed=allowed, note=note)


case("voltages along a simulation of Fig. 7")(lambda: voltages_along(pair(s=0.34), 30))
case("voltages along a simulation, s = 1e-9")(lambda: voltages_along(pair(s=1e-9, r=0.9), 30))
case("voltages along a chatter to rest")(lambda: voltages_along(CHATTERING, 60))


def energy_of(model, allowed=1e-12):
    """The mean energy in time of the motion that a simulation settles on, against all impacts of
    its cycle in many digits: one after the other since the first one or since a release."""
    simulator, membrane = Simulator(model), Membrane()
    attractor = settle(simulator, simulator.state("B", 0.3, 0.5))
    run = simulator.run(attractor.state, impacts=len(attractor.walls) + 1)
    exact, start, speeds = ExactFlights(simulator), None, []
    for k in range(len(run) - 1):
        if start is None or run.released[k]:
            start = [float(run.phases[k]), float(run.velocities[k])]
        if not run.released[k + 1]:
            found = exact.arrival(*exact.about(run, k, start))
            start = [found[0] - exact.turns(run, k) * exact.period, found[1]]
            speeds.append(found[1])
    ctx, values = exact.exact.ctx, model.values
    scale = ctx.mpf(values["A"]) * ctx.pi / (ctx.mpf(values["M"]) * ctx.mpf(values["omega"]))
    total = sum(plain_voltage(membrane, scale * abs(v), ctx) for v in speeds if v)
    mean = attractor_voltages(membrane, attractor).per_time
    off = abs(float(mean * exact.period * attractor.period / total - 1))
    note = f"{attractor.notation}, {len(speeds)} impacts in {attractor.period} periods, relative"
    return Row("solved", error=off, allowed=allowed, note=note)


for text, model in (
    ("Fig. 7", pair()),
    ("r = 0", pair(r=0.0, s=0.45)),
    ("s = 1e-9", pair(s=1e-9)),
    ("s = 50 m", pair(s=50.0, A=50.0)),
    ("a chatter to rest", CHATTERING),
):
    case(f"energy of the motion at {text}")(lambda model=model: energy_of(model))


def measure(name):
    """One row; refusals by `InputError` are outcomes."""
    try:
        return CASES[name]()
    except InputError as error:
        return Row(f"refused: {error}")


def table():
    """The table of the documentation."""
    lines = [
        "| case | outcome | residual | error | condition | remark |",
        "|---|---|---|---|---|---|",
    ]
    for name in CASES:
        row = measure(name)
        numbers = (row.residual, row.error, row.condition)
        shown = " | ".join("" if math.isnan(x) else f"{x:.0e}" for x in numbers)
        lines.append(f"| {name} | {row.outcome} | {shown} | {row.note} |")
    return "\n".join(lines)


MARK = "<!-- table: python tests/extremes.py docs/figures/extremes.md -->"

if __name__ == "__main__":
    page = Path(sys.argv[1])
    head, _, _ = page.read_text(encoding="utf-8").partition(MARK)
    page.write_text(f"{head}{MARK}\n\n{table()}\n", encoding="utf-8")
