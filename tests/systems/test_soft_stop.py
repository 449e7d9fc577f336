"""The oscillator with a soft stop: a system of two modes."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from contimpact.accuracy.reference import Reference
from contimpact.bifurcations.fold import Fold
from contimpact.diagrams.orbit_branch import continue_born, continue_orbit
from contimpact.errors import InputError
from contimpact.models.guards import Word
from contimpact.models.model import Parameter
from contimpact.orbits.problem import OrbitProblem
from contimpact.orbits.search import find_orbits
from contimpact.segments.kernels import Kernels
from contimpact.simulation.settle import exponents_of, settle
from contimpact.simulation.simulator import Simulator
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.soft_stop import SoftStop

VALUES = {"a": 1.0, "omega": 1.3, "c": 0.1, "k": 1.0, "e": 0.5, "k_b": 20.0, "c_b": 0.3}


def soft_stop(**changes):
    return SoftStop(**(VALUES | changes))


def physical(model, word, parameter="a"):
    return [o for o in find_orbits(model, word, parameter=parameter) if o.physical]


@pytest.fixture(scope="module")
def orbit():
    (found,) = physical(soft_stop(), "CR")
    return found


@pytest.fixture(scope="module")
def branch(orbit):
    return continue_orbit(orbit, "a", (0.01, 3.0), events=["FB", "PD", "G", "V", "T"])


def forces(t, y, p, contact):
    x, v = y
    beyond = p["k_b"] * (x - p["e"]) + p["c_b"] * v if contact else 0.0
    return [v, p["a"] * math.cos(p["omega"] * t) - p["c"] * v - p["k"] * x - beyond]


def flown(model, mode, start, until):
    """The state at a time, by SciPy."""
    options = {"rtol": 1e-12, "atol": 1e-13, "method": "DOP853"}
    contact = mode == "contact"
    found = solve_ivp(
        lambda t, y: forces(t, y, model.values, contact), (start[0], until), start[1:], **options
    )
    return found.y[:, -1]


@pytest.mark.parametrize("parameters", [{}, {"c_b": 30.0}, {"k_b": 1e4, "c": 0.0, "c_b": 0.0}])
def test_each_flight_runs_in_the_mode_its_guard_leads_to(parameters):
    """Against the equations of motion."""
    model = soft_stop(**parameters)
    kernels = Kernels(model, "a")
    values = list(model.values.values())
    for a, b, mode, v0 in (("C", "R", "contact", 1.2), ("R", "C", "free", -0.7)):
        t0, t1 = 0.4, 1.1
        rows = kernels.segment(a, b).blocks([t0, v0], [t1, 0.0], values)[0]
        x, v = flown(model, mode, (t0, model.values["e"], v0), t1)
        assert rows[0] * (t1 - t0) == pytest.approx(x - model.values["e"], abs=1e-9)
        assert rows[1] == pytest.approx(v, abs=1e-9)


@pytest.mark.parametrize("parameter", ["omega", "e", "k_b"])
@pytest.mark.full
def test_derivatives_against_differences_in_many_digits(orbit, parameter):
    problem = OrbitProblem(orbit.model, Word("CR"), Kernels(orbit.model, parameter))
    value = orbit.model.values[parameter]
    z = np.append(orbit.unknowns[:-1], value)
    exact = Reference(problem)
    differences = exact._differences(
        exact.residual, [exact.ctx.mpf(u) for u in z], exact.residual([exact.ctx.mpf(u) for u in z])
    )
    assert problem.evaluate(z).jacobian == pytest.approx(differences, rel=1e-13, abs=1e-13)


def test_the_product_of_the_multipliers_has_a_closed_form(branch):
    """Flights dissipate by their damping; where contacts vanish nothing is lost."""
    columns = branch.columns
    contact = columns["t2"] - columns["t1"]
    period = 2 * math.pi / columns["omega"]
    want = np.exp(-columns["c"] * period - columns["c_b"] * contact)
    one, other = (columns[f"multiplier{k}_re"] + 1j * columns[f"multiplier{k}_im"] for k in (1, 2))
    assert np.min(np.abs(contact)) == 0.0  # in the row of the V
    assert (one * other).real == pytest.approx(want, rel=1e-11)


def test_a_vanishing_contact_is_one_event_at_its_closed_form(branch):
    """There the motion without contact just reaches the stop."""
    p = branch.events[0].parameters
    amplitude = p["e"] * math.hypot(p["k"] - p["omega"] ** 2, p["c"] * p["omega"])
    (event,) = [e for e in branch.events if e.kind in ("V", "T")]
    assert (event.kind, event.label, event.becomes) == ("V", "V[1:1->0]", "0")
    assert not event.ghost
    assert event.value == pytest.approx(amplitude, rel=1e-14)
    assert event.error < 1e-13
    assert event.physical
    assert event.method == "newton"


def test_the_branch_turns_unphysical_where_the_contact_vanishes(branch):
    columns = branch.columns
    contact = columns["t2"] - columns["t1"]
    assert not np.any(columns["physical"][contact < 0.0])
    assert np.all(columns["physical"][contact > 0.0])
    assert branch.missed == []


@pytest.mark.full
def test_a_touch_is_the_contact_that_vanishes_on_the_longer_word(orbit):
    """G[1:1->2:2] and V[2:2->1:1]: one event, with one orbit's multipliers."""
    limits = (0.6, 1.3)
    before = continue_orbit(orbit, "omega", limits, events=["G"])
    (touch,) = [e for e in before.events if not e.ghost]
    assert (touch.becomes, touch.order, touch.criticality, touch.slope) == (
        "CRCR",
        2,
        "supercritical",
        None,
    )
    born = continue_born(touch, range=limits, events=["V", "T"])
    (vanishing,) = [e for e in born.events if abs(e.value - touch.value) < 1e-9]
    assert (vanishing.kind, vanishing.becomes, vanishing.ghost) == ("V", "CR", False)
    assert vanishing.value == pytest.approx(touch.value, rel=1e-14)
    assert np.ravel(vanishing.multipliers) == pytest.approx(np.ravel(touch.multipliers), rel=1e-12)
    row = list(born.columns["event"]).index(vanishing.id)
    beside = [row - 1, row + 1]
    assert sorted(born.columns["physical"][beside]) == [0, 1]
    assert np.all(born.columns["omega"][beside] < touch.value)  # where the old orbit passes


@pytest.mark.full
def test_a_simulation_settles_on_the_stable_orbit(orbit):
    simulator = Simulator(orbit.model)
    run = simulator.run(simulator.state("C", 0.3, 1.0), impacts=150)
    last = slice(-2, None) if run.word.endswith("CR") else slice(-3, -1)
    assert run.phases[last] == pytest.approx(orbit.times % run.period, abs=1e-11)
    assert run.velocities[last] == pytest.approx(orbit.velocities, abs=1e-11)


@pytest.mark.full
def test_exponents_of_a_simulation_are_those_of_the_multipliers(orbit):
    simulator = Simulator(orbit.model)
    state = simulator.run(simulator.state("C", 0.3, 1.0), impacts=150).end
    found = exponents_of(simulator, state, simulator.run(state, impacts=400))
    contact = orbit.times[1] - orbit.times[0]
    p = orbit.model.values
    want = -p["c"] * 2 * math.pi / p["omega"] - p["c_b"] * contact
    assert 2 * sum(found.per_impact) == pytest.approx(want, rel=1e-9)
    assert found.per_impact[0] == pytest.approx(math.log(abs(orbit.multipliers[0])) / 2, rel=0.04)


@pytest.mark.full
def test_what_a_motion_settles_on_is_the_orbit(orbit):
    simulator = Simulator(orbit.model)
    found = settle(simulator, simulator.state("C", 0.3, 1.0))
    assert (found.word, found.period, found.notation) == ("CR", 1, "1:1")
    assert found.times == pytest.approx(orbit.times, abs=1e-12)
    assert np.array(found.multipliers) == pytest.approx(orbit.multipliers, rel=1e-10)


def test_words_off_the_graph_are_refused():
    with pytest.raises(InputError, match="CC has C after C; after C can come R"):
        find_orbits(soft_stop(), "CC", parameter="a")
    with pytest.raises(InputError, match="it has R after R; after R can come C"):
        OrbitProblem(soft_stop(), Word("R"), Kernels(soft_stop(), "a"))


# Ever stiffer


@pytest.mark.parametrize("stiffness", [1e4, 1e6])
@pytest.mark.parametrize("low", [0.6, 1.7])
@pytest.mark.full
def test_a_fold_next_to_a_birth_is_found_whatever_the_first_step(stiffness, low):
    """Next to its birth the branch has the stable multipliers of the motion without contact, and
    is unstable at its first point; the stretch between shrinks like 1/k_b^2, as at k_b = 1000."""

    def born(k_b, low):
        model = soft_stop(omega=1.9, c=0.1, k_b=k_b)
        (quiet,) = find_orbits(model, "0", parameter="omega")
        (touch,) = continue_orbit(quiet, "omega", (1.6, 2.0), events=["G"]).events
        assert touch.stable
        limits = (low, 2.0 if low < 1.0 else 1.8)
        return touch, continue_born(touch, model, limits, events=["FB", "PD", "V"])

    touch, usual = born(1e3, 1.7)
    (known,) = [touch.value - e.value for e in usual.events if e.kind == "FB"]
    touch, branch = born(stiffness, low)
    apart = next(touch.value - e.value for e in branch.events if e.kind == "FB")
    assert apart == pytest.approx(known * (1e3 / stiffness) ** 2, rel=0.03)
    (birth,) = [i for i, e in enumerate(branch.events) if e.kind == "V"]
    fold = branch.events[birth + 1]
    assert fold.kind == "FB"
    inside = (branch["arclength"] > branch.events[birth].arclength) & (
        branch["arclength"] < fold.arclength
    )
    assert inside.any()
    assert not branch["n_unstable"][inside].any()
    assert branch.missed == []


@pytest.mark.full
def test_the_place_of_a_fold_that_is_lost_next_to_a_birth_is_closed_in(monkeypatch):
    """As the number of unstable multipliers changes there, it can be bisected."""
    model = soft_stop(omega=1.9, c=0.1, k_b=1e4)
    (quiet,) = find_orbits(model, "0", parameter="omega")
    (touch,) = continue_orbit(quiet, "omega", (1.6, 2.0), events=["G"]).events
    given = touch, model, (1.7, 1.8)
    (fold,) = [e for e in continue_born(*given, events=["FB", "V"]).events if e.kind == "FB"]
    monkeypatch.setattr(Fold, "accept", lambda test, event: False)
    branch = continue_born(*given, events=["FB", "PD", "V"])
    (missed,) = [missed for missed in branch.missed if missed.startswith("FB between")]
    ends = map(float, re.findall(r"1\.7[0-9]+", missed)[:2])
    assert max(abs(end - fold.value) for end in ends) < 2e-7  # the first step leads 2.3e-6 away


class StopOfRatio(SoftStop):
    """The soft stop by the damping ratio zeta of contact: c_b = 2 zeta sqrt(k_b)."""

    SYSTEM = "stop-of-ratio"
    PARAMETERS = (*SoftStop.PARAMETERS[:-1], Parameter("zeta", "", "the damping ratio", lower=0))

    def validate(self):
        """Nothing is at resonance here."""

    def formulas(self, symbols):
        import sympy

        given = dict(symbols)
        damping = 2 * given.pop("zeta") * sympy.sqrt(given["k_b"])
        return super().formulas(given | {"c_b": damping})


@pytest.mark.parametrize(("make", "zeta"), [(SoftStop, 0.0), (StopOfRatio, 0.1)])
@pytest.mark.quick(1)
def test_a_stiff_stop_is_a_rigid_one(make, zeta):
    """Contact lasts pi/sqrt(k_b (1 - zeta^2)), by which the orbit differs; half a swing of it keeps
    exp(-pi zeta/sqrt(1 - zeta^2)) of the velocity."""
    values = {n: v for n, v in VALUES.items() if n != "c_b"}
    damped = {"c_b": 0.0} if make is SoftStop else {"zeta": zeta}
    (orbit,) = physical(make(**values, **damped), "CR", parameter="k_b")
    branch = continue_orbit(orbit, "k_b", (20.0, 1e8), events=["FB", "PD", "G", "V", "T"])
    assert (branch.events, branch.missed) == ([], [])
    assert branch["k_b"][-1] == 1e8
    r = math.exp(-math.pi * zeta / math.sqrt(1 - zeta**2))
    rigid = Oscillator(a=1.0, omega=1.3, c=0.1, k=1.0, sigma=0.5, r=r)
    (limit,) = physical(rigid, "S")
    period = 2 * math.pi / 1.3
    late = branch["t1"] - limit.times[0]
    off = np.abs([late - period * np.round(late / period), branch["v1"] - limit.velocities[0]])
    stiff = branch["k_b"] > 1e6
    roots = np.sqrt(branch["k_b"][stiff])
    contact = (branch["t2"] - branch["t1"])[stiff]
    assert contact * roots == pytest.approx(math.pi / math.sqrt(1 - zeta**2), rel=2e-3)
    for error in off[:, stiff]:
        assert error * roots == pytest.approx(error[-1] * roots[-1], rel=5e-3)
        assert 0.0 < error[-1] < 1e-3
    assert np.max(branch["residual"]) < 1e-11
    last = branch.orbit(-1)
    exact = Reference(last.problem).orbit(last.unknowns)
    assert exact.distance(last.unknowns) < 1e-12 * np.max(np.abs(last.velocities))


@pytest.mark.parametrize(
    "changes", [{"c": 0.0, "omega": 1.0}, {"c": 0.0, "c_b": 0.0, "k": 0.69, "k_b": 1.0}]
)
def test_undamped_resonance_is_refused_in_each_mode(changes):
    with pytest.raises(InputError, match="at resonance"):
        soft_stop(**changes)
