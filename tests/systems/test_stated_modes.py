"""Hybrid systems stated in scenes: COCO's and PWSDDE-cont's demonstrations, and what is refused.

References are closed forms and SciPy's DOP853; nothing here comes from the package but what is
compared.
"""

import copy
import math
import pickle
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve, root

import contimpact as ci
from contimpact.diagrams.scene_simulation import _notes_on_unsettled
from contimpact.errors import InputError
from contimpact.models.stated_modes import StatedMode
from contimpact.results.scene import read_scene
from contimpact.segments.checking import check_model
from contimpact.segments.kernels import Kernels
from contimpact.simulation.run import Outcome
from contimpact.simulation.sweep import Row, Sweep

BRANCHES = Path(__file__).parents[2] / "branches"
EXACT = {"rtol": 1e-13, "atol": 1e-13, "method": "DOP853"}

OSCILLATOR = {
    "system": "hybrid",
    "period": "2*pi/omega",
    "parameters": {"a": 0.4, "omega": 1.3, "c": 0.1, "sigma": 0.5, "r": 0.8},
    "define": {"drive": "a*cos(omega*t)"},
    "modes": {"free": {"x": "v", "v": "drive - c*v - x"}},
    "guards": {"S": {"within": "x <= sigma", "set": {"v": "-r*v"}}},
}


def guard(**changes):
    return {"guards": {"S": {"within": "x <= sigma"} | changes}}


def laws(**given):
    return {"modes": {"free": given}}


def model_of(table):
    scene = {"name": "n", "model": copy.deepcopy(table)}
    scene["follow"] = {
        "parameter": next(iter(table["parameters"])),
        "range": [-9, 9],
        "orbits": ["0"],
    }
    return read_scene(scene).model


def shipped(name, **values):
    given = tomllib.loads((BRANCHES / name / "scene.toml").read_text(encoding="utf-8"))
    return model_of(given["model"]).replace(**values)


def test_a_system_tells_what_its_scene_states():
    """In lines, as `contimpact check` prints them, and in a repr without its text."""
    model = shipped("coco_stick_slip")
    assert model.statement() == [
        ("model", "hybrid"),
        ("define", "F = V**2*sin(w*t)**2/(1 - x)**2 - c*v - x"),
        ("mode", "stick: x' = v, v' = F"),
        ("mode", "slip: x' = v, v' = n + 6*F/5, u' = -n - F/5"),
        ("guard", "I: stick, x <= d, to slip; v = -e*v, u = (1 + e)*v/6"),
        ("guard", "R: slip, u >= 0, to stick"),
        ("period", "pi/w"),
        ("values", "V=0.6, c=0.04, n=3.17, w=0.92, e=0.8, d=0.5"),
    ]
    assert repr(model).startswith("<hybrid system of x, u with guards I, R: V=0.6,")
    damped = shipped("dry_friction").statement()
    assert ("guard", "C: forward, v >= 0, to backward, past A; a = a + 2") in damped


def test_the_oscillator_stated_is_the_one_that_comes_with_the_package():
    stated = model_of(OSCILLATOR)
    own = ci.Oscillator(k=1, **OSCILLATOR["parameters"])
    found, expected = (ci.find_orbits(m, "S", parameter="omega") for m in (stated, own))
    assert len(found) == len(expected) > 0
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one.times, other.times, rtol=0, atol=1e-12)
        np.testing.assert_allclose(one.velocities, other.velocities, rtol=1e-12)
        np.testing.assert_allclose(one.multipliers, other.multipliers, rtol=1e-10)


def test_a_variable_whose_rate_is_another_one_is_of_second_order_unless_a_guard_lies_on_that():
    mode = StatedMode("m", (("x", "v"), ("v", "-x"), ("u", "v")))
    assert mode.velocities(()) == {"x": "v"}
    assert mode.coordinates(()) == ("x", "u")
    assert mode.velocities(("v",)) == {}


def test_models_are_copied_and_pickled_and_stand_in_entries():
    model = model_of(OSCILLATOR)
    assert pickle.loads(pickle.dumps(model)) == model == copy.copy(model)
    assert type(model)(machine=model.options["machine"], **model.values) == model


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (guard(to="gone"), r"model\.guards\.S\.to: found 'gone'"),
        (guard(within="v*x <= sigma"), r"model\.guards\.S\.within"),
        (guard(set={"w": "1"}), r"model\.guards\.S\.set\.w: no variable"),
        (guard(set={"v": "-drive"}), r"S\.set\.v: 'drive' in '-drive' depends on the time"),
        (guard(set={"v": "-v*t"}), r"S\.set\.v: 't' in '-v\*t' depends on the time; let the phase"),
        (guard(within="x <= sigma*cos(t)"), r"S\.within: 't' in .* depends on the time"),
        (laws(x="v", v="-x + q"), r"model\.modes\.free\.v: unknown name 'q'"),
        (laws(a="v", v="-x"), r"modes\.free\.a: the name 'a', which is a parameter or a"),
        (laws(t="v", v="-t"), r"modes\.free\.t: the name 't', which is the time; give a name"),
        (laws(sin="v", v="-sin"), r"the name 'sin', which is a function; give"),
        (laws(x="v", v="drive - c*v - x/(sigma - 0.5)"), r"free\.v: at c = 0\.1, sigma = 0\.5, "),
        (
            laws(x="v", v="drive - v - x*log(c - 1)"),
            r"free\.v: at c = 0\.1, .* no finite real value",
        ),
        ({"period": "-1"}, r"model\.period: it is -1"),
    ],
)
def test_mistakes_are_refused_with_their_place(change, message):
    with pytest.raises(InputError, match=message):
        model_of(OSCILLATOR | change)


TWO_BODIES = OSCILLATOR | {
    "define": {"push": "a*cos(omega*t) - c*(v1 - v2) - x1"},
    "modes": {"free": {"x1": "v1", "v1": "push", "x2": "v2", "v2": "x1 - x2"}},
    "guards": {"S": {"within": "x2 <= sigma", "set": {"v2": "-r*v2"}}},
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (guard(to=["free"]), r"^model\.guards\.S\.to: found \['free'\]; the modes are free$"),
        (guard(to={"free": 1}), r"^model\.guards\.S\.to: found {'free': 1}"),
        (guard(mode=[["free"]]), r"^model\.guards\.S\.mode: found \['free'\]"),
        (guard(mode={"a": 1}), r"^model\.guards\.S\.mode: found {'a': 1}"),
        (guard(mode=[]), r"^model\.guards\.S\.mode: empty"),
        (guard(past=["S"]), r"^model\.guards\.S\.past: found \['S'\]"),
        (guard(past="Q"), r"^model\.guards\.S\.past: found 'Q'; the guards are S"),
        (laws(x="v"), r"^model\.modes\.free: no law for 'v', which the law of 'x' has"),
        (laws(x="v", v="-x + cos(omgea*t)"), r"modes\.free\.v: unknown name 'omgea' in .*'omega'"),
        ({"define": {"drive": "a*cos(omega*t) + u"}}, r"^model\.define\.drive: unknown name 'u'"),
    ],
)
def test_mistakes_are_refused_by_their_cause(change, message):
    with pytest.raises(InputError, match=message):
        model_of(OSCILLATOR | change)


@pytest.mark.parametrize(
    "within", ["x <= sigma", "sigma >= x", "2*x <= 2*sigma", "-3*x >= -3*sigma"]
)
def test_two_guards_on_one_surface_are_refused(within):
    """Which of them was met rounding decided, and otherwise in compiled code."""
    first = OSCILLATOR["guards"]["S"]
    table = OSCILLATOR | {"guards": {"S": first, "B": {"within": within, "set": {"v": "-v/2"}}}}
    message = r"^model\.guards\.B\.within: it is the surface of 'S', met in the same mode and dir"
    with pytest.raises(InputError, match=message):
        model_of(table)


@pytest.mark.parametrize("within", ["x >= -sigma", "2*x <= 3*sigma", "x <= sigma + a - 0.4"])
def test_guards_that_are_met_apart_are_admitted(within):
    """The last ones lie together at these values of the parameters alone."""
    first = OSCILLATOR["guards"]["S"]
    model_of(OSCILLATOR | {"guards": {"S": first, "B": {"within": within, "set": {"v": "-v/2"}}}})


def test_a_mode_without_a_law_is_named_with_what_needs_it():
    modes = TWO_BODIES["modes"] | {"held": {"x1": "v1", "v1": "push"}}
    with pytest.raises(
        InputError, match=r"modes\.held: no law for 'v2', which 'push' in the law of"
    ):
        model_of(TWO_BODIES | {"modes": modes} | guard(mode="free", within="x2 <= sigma"))


@pytest.mark.parametrize(
    ("period", "laws_", "message"),
    [
        ("pi/omega", {}, r"^model\.period: it is 2\.41\d+ \(pi/omega\), after which "
         r"modes\.free\.v does not repeat; they repeat after 4\.83\d+, 2 times as long$"),
        ("pi/omega", {"v": "drive - x**3"}, "they repeat after 4.83"),
        ("4*pi/(3*omega)", {}, "they repeat after 4.83.*, 3/2 times as long$"),
        ("2*pi", {}, r"they repeat after 4\.83\d+$"),
        ("1e-14", {}, "after which modes.free.v does not repeat; they repeat after 4.83"),
        ("5e-324", {}, "after which modes.free.v does not repeat; they repeat after 4.83"),
        ("2*pi/1.3", {}, "repeats at these values of the parameters alone"),
        ("2*pi/omega", {"v": "drive - x + t"}, "give one after which all laws repeat$"),
        ("2*pi/omega", {"v": "exp(t) - x*a*c"}, "give one after which all laws repeat$"),
    ],
)  # fmt: skip
def test_a_period_that_is_none_is_refused_with_one_that_is(period, laws_, message):
    modes = {"free": OSCILLATOR["modes"]["free"] | laws_}
    define = {"drive": "a*cos(omega*t) - c*v"}
    with pytest.raises(InputError, match=message):
        model_of(OSCILLATOR | {"period": period, "modes": modes, "define": define})


@pytest.mark.parametrize("period", ["2*pi/omega", "4*pi/omega", "-(-2)*pi/omega"])
def test_periods_and_their_multiples_are_admitted(period):
    model_of(OSCILLATOR | {"period": period})


@pytest.mark.parametrize("power", [1, 3])
def test_squares_of_waves_have_half_the_period(power):
    model_of(
        OSCILLATOR | {"period": "pi/omega", "define": {"drive": f"a*cos(omega*t)**{2 * power}"}}
    )


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (
            OSCILLATOR | guard(set={"v": "r*v"}),
            r"^model\.guards\.S\.set: it sends the body on into",
        ),
        (
            TWO_BODIES | {"guards": {"S": {"within": "x2 <= sigma", "set": {"v2": "r*v2"}}}},
            r"^model\.guards\.S\.set: it sends the body on into the wall: 0\.\d+ becomes 0\.\d+",
        ),
    ],
)
def test_a_reset_that_does_not_turn_the_body_back_is_refused(table, message):
    with pytest.raises(InputError, match=message):
        check_model(model_of(table))


def test_what_is_not_smooth_at_a_guard_is_named_as_the_scene_names_it():
    given = tomllib.loads((BRANCHES / "coco_piecewise" / "scene.toml").read_text(encoding="utf-8"))
    for letter, side in (("L", ">="), ("R", "<=")):
        given["model"]["guards"][letter]["within"] = f"x {side} 0"
    del given["model"]["parameters"]["border"]
    with pytest.raises(InputError, match=r"^model\.guards\.L: 'Abs\(y\)' arises"):
        check_model(model_of(given["model"]))


NONLINEAR = OSCILLATOR | {"guards": guard(within="x <= sigma", set={"v": "-r*v"})["guards"]}


@pytest.mark.full
def test_functions_of_numbers_are_numbers_in_laws_that_are_integrated():
    pytest.importorskip("heyoka")
    given = "sqrt(2) + cos(pi/7) + sin(1) - exp(1)/2 + atan(3) + cosh(1) + log(2) + tanh(1)"
    number = (
        math.sqrt(2) + math.cos(math.pi / 7) + math.sin(1) - math.e / 2 + math.atan(3)
        + math.cosh(1) + math.log(2) + math.tanh(1)
    )  # fmt: skip
    one, other = (
        ci.find_orbits(model_of(NONLINEAR | laws(x="v", v=law)), "S", parameter="omega", starts=8)
        for law in (f"drive - c*v - x - ({given})*x**3", f"drive - c*v - x - {number!r}*x**3")
    )
    assert len(one) == len(other) > 0
    for a, b in zip(one, other, strict=True):
        np.testing.assert_allclose(a.times, b.times, rtol=0, atol=1e-12)
        np.testing.assert_allclose(a.multipliers, b.multipliers, rtol=1e-9)


def test_friction_that_falls_with_the_velocity_is_integrated():
    """An orbit under Stribeck's law, against DOP853."""
    pytest.importorskip("heyoka")
    law = "drive - c*tanh(v/r)*(1 + exp(-v**2)) - x"
    model = model_of(NONLINEAR | laws(x="v", v=law))
    orbit = ci.find_orbits(model, "S", parameter="omega", starts=8)[0]
    a, w, c, sigma, r = (model.values[n] for n in ("a", "omega", "c", "sigma", "r"))

    def rates(t, z):
        friction = c * math.tanh(z[1] / r) * (1 + math.exp(-(z[1] ** 2)))
        return [z[1], a * math.cos(w * t) - friction - z[0]]

    start, speed = orbit.times[0], orbit.velocities[0]
    flown = solve_ivp(rates, (start, start + 2 * math.pi / w), [sigma, -r * speed], **EXACT)
    np.testing.assert_allclose(flown.y[:, -1], [sigma, speed], rtol=0, atol=1e-10)


def test_what_a_variable_is_in_the_next_mode_has_to_be_said():
    modes = OSCILLATOR["modes"] | {"held": {"f": "1"}}
    guards = {
        "S": {"mode": "free", "within": "x <= sigma", "to": "held"},
        "R": {"mode": "held", "within": "f <= 1", "to": "free", "set": {"x": "sigma", "v": 0}},
    }
    with pytest.raises(InputError, match=r"guards\.S\.set\.f: nothing says what 'f' is"):
        model_of(OSCILLATOR | {"modes": modes, "guards": guards})


# COCO's piecewise: in polar coordinates both fields have closed forms.


def _round(start, al, be, ga):
    """The radius after one turn from (0, start), how long it took, and the slope of the map."""
    grown = math.exp(math.pi)
    low = start * grown / (1 + start * (grown - 1))

    def after(time):
        grown = math.exp(al * be * time)
        return be * low * grown / (be + low * (grown - 1))

    def turned(time):
        return ga * time + math.log(after(time) / low) / al - math.pi

    time = brentq(turned, 0.1, 9.0, xtol=1e-15)
    return after(time), math.pi + time


@pytest.mark.slow
@pytest.mark.parametrize("be", [0.7, 2.0, 4.5])
def test_piecewise_has_the_orbit_of_its_closed_form(be):
    pytest.importorskip("heyoka")
    model = shipped("coco_piecewise", be=be)
    radius = brentq(lambda r: _round(r, 1.0, be, 1.5)[0] - r, 0.05, 8.0, xtol=1e-15)
    period = _round(radius, 1.0, be, 1.5)[1]
    slope = (_round(radius + 1e-5, 1.0, be, 1.5)[0] - _round(radius - 1e-5, 1.0, be, 1.5)[0]) / 2e-5
    (orbit,) = (o for o in ci.find_orbits(model, "LR", parameter="be", starts=64) if o.physical)
    assert orbit.period == pytest.approx(period, abs=1e-11)
    assert abs(orbit.multipliers[0]) == pytest.approx(slope, abs=1e-7)
    assert list(orbit.multipliers[1:]) == [0.0, 0.0]


@pytest.mark.full
def test_piecewise_has_its_orbits_in_other_units():
    """A border at zero says nothing of their size, which laws do: states as large as numbers are
    drawn led to none where lengths are 1e3 and times 1e-4."""
    pytest.importorskip("heyoka")
    given = tomllib.loads((BRANCHES / "coco_piecewise" / "scene.toml").read_text(encoding="utf-8"))
    model = given["model"]
    model["period"] = 1e-4
    model["define"]["r"] = "sqrt(x**2 + y**2)/1000"
    for laws in model["modes"].values():
        laws.update({name: f"10000*({law})" for name, law in laws.items()})
    radius = brentq(lambda r: _round(r, 1.0, 2.0, 1.5)[0] - r, 0.05, 8.0, xtol=1e-15)
    found = ci.find_orbits(ci.read_scene(given).model, "LR", parameter="be", starts=64)
    (orbit,) = (one for one in found if one.physical)
    assert orbit.period == pytest.approx(1e-4 * _round(radius, 1.0, 2.0, 1.5)[1], rel=1e-11)


# COCO's bangbang.


@pytest.mark.slow
def test_bang_bang_has_the_orbit_of_dop853():
    pytest.importorskip("heyoka")
    model = shipped("coco_bang_bang", om=1.1)
    (orbit,) = ci.find_orbits(model, "NP", parameter="om", starts=48)
    half = math.pi / 1.1

    def flown(state, force):
        def field(t, y):
            return [y[1], force - 0.2 * y[1] - y[0] - y[0] ** 3]

        return solve_ivp(field, (0.0, half), state, **EXACT).y[:, -1]

    at_n = orbit.problem.impacts(orbit.unknowns)[0, 2:]
    np.testing.assert_allclose(flown(flown(at_n, -26.0), 26.0), at_n, rtol=0, atol=1e-10)
    assert orbit.period == pytest.approx(2 * half, abs=1e-12)


# COCO's stickslip.


def _stick(V, w=0.92, c=0.04):
    def field(t, y):
        return [y[1], (V * math.sin(w * t) / (1 - y[0])) ** 2 - c * y[1] - y[0]]

    return field


def _touch(level=0.5):
    """V, time and velocity at t = 0 of the orbit without impact that touches the level."""

    def apart(z):
        V, t, slow = z
        run = solve_ivp(_stick(V), (t, t + math.pi / 0.92), [level, slow], **EXACT)
        return [*(run.y[:, -1] - [level, slow]), slow]

    found = root(apart, [0.5875, -0.01, 0.0], tol=1e-14)
    assert np.max(np.abs(found.fun)) < 1e-12
    return found.x


@pytest.fixture(scope="module")
def impacting():
    pytest.importorskip("heyoka")
    model = shipped("coco_stick_slip")
    (orbit,) = (
        o for o in ci.find_orbits(model, "IR", parameter="V", starts=128, rounds=3) if o.physical
    )
    return orbit


@pytest.mark.slow
def test_stick_slip_begins_where_the_orbit_that_sticks_touches(impacting):
    branch = ci.continue_orbit(impacting, "V", (0.58, 0.605), events=["V"])
    (event,) = branch.events
    assert event.value == pytest.approx(_touch()[0], abs=1e-10)
    quiet = ci.continue_born(event, range=(0.5, 0.7), events=["FB"])
    assert quiet.word == ""
    (fold,) = quiet.events
    assert event.value < fold.value < 0.58754


@pytest.mark.full
def test_the_slope_of_a_touch_before_an_excursion_is_that_of_the_branch_born_there(impacting):
    """The impact's velocity beside the V at which it is zero, by central differences."""
    branch = ci.continue_orbit(
        impacting, "V", (0.58, 0.605), events=["V"], settings={"max_step": 0.02}
    )
    (event,) = branch.events
    quiet = ci.continue_born(event, range=(0.5, 0.7), events=["G"])
    (touch,) = [e for e in quiet.events if abs(e.value - event.value) < 1e-9]
    assert touch.becomes == "IR"
    values, speeds = branch["V"] - event.value, branch["v1"]
    near = np.argsort(np.abs(values))[1:5]
    slope, _ = np.polyfit(values[near], speeds[near] / values[near], 1)[::-1]
    assert touch.slope == pytest.approx(slope, rel=1e-5)


@pytest.mark.slow
def test_stick_slip_has_the_orbit_of_dop853(impacting):
    V = impacting.value
    begun, ended = impacting.times
    speed = impacting.velocities[0]

    def slip(t, y):
        force = _stick(V)(t, y)[1]
        return [y[1], 3.17 + 6 * force / 5, -3.17 - force / 5]

    def rest(t, y):
        return y[2]

    def hits(t, y):
        return y[0] - 0.5

    rest.terminal = hits.terminal = True
    rest.direction, hits.direction = -1, 1
    first = [0.5, -0.8 * speed, 1.8 * speed / 6]
    slipped = solve_ivp(slip, (begun, begun + 1), first, events=rest, **EXACT)
    assert slipped.t[-1] == pytest.approx(ended, abs=1e-10)
    stuck = solve_ivp(_stick(V), (ended, ended + 9), slipped.y[:2, -1], events=hits, **EXACT)
    assert stuck.t[-1] == pytest.approx(begun + math.pi / 0.92, abs=1e-10)
    assert stuck.y[1, -1] == pytest.approx(speed, abs=1e-10)


def test_the_grazing_orbit_noted_in_coco_is_there():
    """V = 0.58762, w = 0.9189: x = 0.25073 and v = 0.0043073 at the phase pi/2, from -0.0095526."""
    start, w = -0.0095526 / 0.9189, 0.9189
    run = solve_ivp(_stick(0.58762, w), (start, math.pi / 2 / w), [0.5, 0.0], **EXACT)
    np.testing.assert_allclose(run.y[:, -1], [0.25073, 0.0043073], rtol=0, atol=6e-6)


# PWSDDE-cont's dry friction: symmetric motion that never sticks, from half a period of it.


def _reversal(eta, near):
    """The frequency, time and velocity's rate where friction at a reversal is at a limit."""

    def apart(z):
        omega, t, x = z

        def field(s, y):
            return [y[1], 1.5 * math.cos(omega * (s - 1.0)) - 0.1 * y[1] - y[0] + 1.0]

        run = solve_ivp(field, (t, t + math.pi / omega), [x, 0.0], **EXACT)
        return [*(run.y[:, -1] + [x, 0.0]), 1.5 * math.cos(omega * (t - 1.0)) - x + eta]

    return fsolve(apart, near, xtol=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize(("eta", "near"), [(1.1, [0.7487, 2.18, 3.0]), (1.0, [0.7226, 2.15, 3.0])])
def test_reversals_without_sticking_end_where_friction_can_hold_the_body(eta, near):
    model = shipped("dry_friction", eta=eta, omega=0.9)
    (orbit,) = (o for o in ci.find_orbits(model, "CD", parameter="omega", starts=32) if o.physical)
    branch = ci.continue_orbit(orbit, "omega", (0.7, 0.95), events=["G"])
    first = min(branch.events, key=lambda event: abs(event.value - near[0]))
    assert first.value == pytest.approx(_reversal(eta, near)[0], abs=1e-10)
    assert first.sliding == "crossing-sliding"


def test_an_orbit_with_a_flight_that_has_just_vanished_is_followed_from_there():
    """The derivative of the arrival by its time is a velocity over a duration, and both are zero
    within rounding."""
    diagram = ci.load(BRANCHES / "dry_friction")
    event = next(e for e in diagram.entries if e.kind == "T" and e.branch == "b2")
    orbit = event.orbit()
    assert orbit.multipliers == pytest.approx([complex(*m) for m in event.multipliers], rel=1e-9)
    branch = ci.continue_orbit(event, range=(0.7, 1.25), events=["G", "T"])
    assert {end.value for end in branch.ends} == {0.7}
    assert [e.value for e in branch.events if e.kind == "T"] == pytest.approx([event.value])


def test_an_orbit_that_sticks_twice_is_that_of_dop853():
    model = shipped("dry_friction", omega=0.72)
    orbit = next(
        o for o in ci.find_orbits(model, "SABP", parameter="omega", starts=64) if o.physical
    )
    stop, leaves, _, _ = orbit.times
    x = 1.5 * math.cos(0.72 * (leaves - 1.0)) + 1.1  # at rest, the friction is -1.1 as it leaves

    def field(t, y):
        return [y[1], 1.5 * math.cos(0.72 * (t - 1.0)) - 0.1 * y[1] - y[0] + 1.0]

    def rest(t, y):
        return y[1]

    rest.terminal, rest.direction = True, 1
    run = solve_ivp(field, (leaves, leaves + 9.0), [x, -1e-300], events=rest, **EXACT)
    assert run.t[-1] == pytest.approx(stop + math.pi / 0.72, abs=1e-10)
    assert run.y[0, -1] == pytest.approx(-x, abs=1e-10)
    assert orbit.multipliers[1] == 0.0


# PWSDDE-cont's two-degree-of-freedom impact Duffing oscillator.


@pytest.mark.parametrize("ends", ["UD", "DU"])
@pytest.mark.quick(1)
def test_a_flight_is_integrated_once_however_its_start_is_written(ends):
    """The reset's linear combinations can be factored in several ways."""
    kernels = Kernels(shipped("impact_duffing"), "omega")
    assert kernels.flight(*ends).text.count("flown(") == 1


@pytest.mark.slow
def test_two_bodies_that_hit_each_other_have_the_orbit_of_dop853():
    pytest.importorskip("heyoka")
    model = shipped("impact_duffing")
    orbits = ci.find_orbits(model, "UD", parameter="omega", starts=24, rounds=3)
    orbit = next(o for o in orbits if o.physical and o.stable)
    (begun, gap_speed, *rest), (ended, *_) = orbit.problem.impacts(orbit.unknowns)
    x, v = _bodies(rest, gap_speed)
    both = 1.9 * (v[0] + 0.05 * v[1]) / 1.05

    def field(t, y):
        d, w = y[0] - y[1], y[2] - y[3]
        pull = 0.952**2 * d + 0.254 * w + 0.1 * d**3
        return [
            y[2],
            y[3],
            math.cos(1.5 * t) - y[0] - 0.04 * y[2] - 0.1 * y[0] ** 3 - 0.05 * pull,
            pull,
        ]

    def below(t, y):
        return y[1] - y[0] + 1.0

    below.terminal, below.direction = True, -1
    first = [*x, *(both - 0.9 * s for s in v)]
    run = solve_ivp(field, (begun, begun + 9.0), first, events=below, **EXACT)
    assert run.t[-1] == pytest.approx(ended, abs=1e-10)
    np.testing.assert_allclose(run.y[:2, -1], -np.array(x), rtol=0, atol=1e-10)


def _bodies(rest, gap_speed):
    """Positions and velocities at U, where x2 - x1 = 1, from those of the second body."""
    x2, v2 = rest
    return [x2 - 1.0, x2], [v2 - gap_speed, v2]


@pytest.mark.parametrize("impacts", [4, 400])
def test_a_mode_that_begins_behind_a_guard_ends_the_run(impacts):
    """In slip nothing stops x, which is at 0.588 when the body sticks again, behind 0.3: it was set
    back there, and impacts of a 4:4 motion followed that no orbit has."""
    rate = "cos(w*t) - 0.3*v - x/4"
    table = {
        "name": "passed",
        "model": {
            "system": "hybrid",
            "period": "2*pi/w",
            "parameters": {"w": 1.0, "d": 0.3},
            "modes": {"stick": {"x": "v", "v": rate}, "slip": {"x": "v", "v": rate, "u": "-2"}},
            "guards": {
                "I": {"mode": "stick", "within": "x <= d", "to": "slip", "set": {"u": "1"}},
                "R": {"mode": "slip", "within": "u >= 0", "to": "stick"},
            },
        },
        "follow": {"parameter": "d", "range": [-1.0, 1.0], "orbits": ["IR"]},
    }
    simulator = ci.Simulator(read_scene(table).model)
    run = simulator.run(simulator.state("I", 0.1, 0.4, (0.0, 0.0)), impacts=impacts)
    assert (run.word, run.outcome) == ("R", Outcome.BEYOND)
    found = ci.settle(simulator, simulator.state("I", 0.1, 0.4, (0.0, 0.0)))
    assert found.notation == "not settled (BEYOND at R)"
    (note,) = _notes_on_unsettled(Sweep(simulator.model, "d", [Row("down", 0.3, found)]))
    assert note.endswith(f"no attractor is known there: at R {Outcome.BEYOND.value}")
    assert run.others[0, 0] == pytest.approx(0.588229554, abs=1e-9)
    starts = [simulator.random_state(seed) for seed in range(20)]
    assert all(start.wall == 0 or start.others[0] <= 0.3 for start in starts)


@pytest.mark.full
def test_a_guard_on_a_velocity():
    """SymPy says of a sum and of its negative that a sign can be extracted."""
    table = {
        "name": "governor",
        "model": {
            "system": "hybrid",
            "period": "2*pi/w",
            "parameters": {"w": 1.2, "c": 0.1, "k": 1.0, "r": 0.8, "s": 0.5},
            "modes": {"free": {"x": "v", "v": "cos(w*t)-c*v-k*x"}},
            "guards": {"S": {"within": "v <= s", "set": {"v": "-r*v"}}},
        },
        "follow": {"parameter": "w", "range": [0.9, 1.6], "orbits": ["S"]},
    }
    model = read_scene(table).model
    orbits = ci.find_orbits(model, "S", parameter="w", starts=64)
    assert orbits
    for orbit in orbits:
        ((time, force, x, *_),) = orbit.problem.impacts(orbit.unknowns)
        assert force == pytest.approx(math.cos(1.2 * time) - 0.1 * 0.5 - x, abs=1e-12)


def counter():
    """y falls, and rises where a clock's tick finds it below the level."""
    tick = {"mode": ["down", "up"], "within": "c <= 1", "set": {"c": 0}}
    table = {
        "name": "counter",
        "model": {
            "system": "hybrid",
            "period": 1,
            "parameters": {"level": 1.0, "top": 9.0},
            "modes": {"down": {"y": "-1", "c": "1"}, "up": {"y": "1", "c": "1"}},
            "guards": {
                "P": {"mode": "down", "within": "y + 2*c >= level", "to": "up"},
                "D": {"mode": "up", "within": "y <= top", "to": "down"},
                "K": tick | {"to": "down"},
                "L": tick | {"to": "up", "past": "P"},
            },
        },
        "follow": {"parameter": "level", "range": [0.5, 2.0], "orbits": ["KL"]},
    }
    return ci.Simulator(read_scene(table).model)


def test_where_two_resets_part_the_gap_that_they_move_tells():
    """From y = 2.5: 1.5 and 0.5 at the next ticks, then 1.5 and 0.5 in turn; P is not met between.
    L was never taken, since the resets change the rate of P's gap coordinate, too."""
    simulator = counter()
    run = simulator.run(simulator.start(0.0, [2.5, 0.0], [0.0, 0.0], "down"), impacts=6)
    assert (run.word, run.outcome) == ("LKLKLK", Outcome.DONE)
    assert run.turns + run.phases == pytest.approx([2.0, 3.0, 4.0, 5.0, 6.0, 7.0], abs=1e-12)
    assert run.others[:, 0] == pytest.approx([0.5, 1.5] * 3, abs=1e-12)


def test_a_guard_of_several_modes_is_within_the_guards_of_one_of_them():
    """A tick that begins up may be above the level, and one that begins down above the top."""
    simulator = counter()
    starts = [simulator.random_state(seed) for seed in range(40)]
    assert all(np.max(np.abs(start.others[::2])) < 100.0 for start in starts)
    assert {simulator.run(start, impacts=50).outcome for start in starts} == {Outcome.DONE}


@pytest.mark.parametrize("swapped", [False, True])
def test_columns_do_not_depend_on_the_order_in_which_a_mode_lists_its_laws(swapped):
    """A column of the motion was p in one mode and q in the other."""
    free = {"x": "v", "v": "cos(w*t) - 0.2*v - x", "p": "x - p", "q": "1 - q"}
    pressed = free | {"v": "cos(w*t) - 0.2*v - x - 9*(x - d)", "q": "3 - q"}
    if swapped:
        pressed = {name: pressed[name] for name in ("q", "p", "x", "v")}
    table = {
        "name": "columns",
        "model": {
            "system": "hybrid",
            "period": "2*pi/w",
            "parameters": {"w": 1.0, "d": 0.5},
            "modes": {"free": free, "pressed": pressed},
            "guards": {
                "C": {"mode": "free", "within": "x <= d", "to": "pressed"},
                "R": {"mode": "pressed", "within": "x >= d", "to": "free"},
            },
        },
        "follow": {"parameter": "d", "range": [0.1, 1.0], "orbits": ["CR"]},
    }
    model = read_scene(table).model
    motion = next(o for o in ci.find_orbits(model, "CR", parameter="d") if o.physical).motion(50)
    _, p, q = motion.x.T
    assert motion.v[:, 1] == pytest.approx(motion.x[:, 0] - p, abs=1e-12)
    assert 1.0 < q.min() < q.max() < 3.0
    assert np.abs(np.diff(q)).max() < 0.2
