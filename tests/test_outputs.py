"""Means of outputs along orbits, and the balance of energies."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import contimpact as ci
from contimpact.errors import InputError
from contimpact.models.outputs import Output
from contimpact.orbits.outputs import quadrature, values_at
from contimpact.results.quantities import series_of
from contimpact.results.scene import read_model, read_scene


@pytest.fixture(scope="module")
def oscillator():
    """An orbit with one impact in a period, closed forms with damping."""
    model = ci.Oscillator(a=1.0, omega=2.6, c=0.1, k=1.0, sigma=0.0, r=0.8)
    return next(o for o in ci.find_orbits(model, "1") if o.physical)


def test_balance_oscillator(oscillator):
    forcing = oscillator.mean("a*cos(omega*t)*v")
    damping = oscillator.mean("c*v**2")
    lost = ci.losses(oscillator).per_time
    assert lost > 0.0
    assert forcing.value == pytest.approx(damping.value + lost, rel=1e-12)
    assert forcing.error < 1e-14


def test_linear_response():
    """Without impacts the mean of v^2 is half the squared amplitude of the velocity."""
    model = ci.Oscillator(a=1.0, omega=2.0, c=0.3, k=1.5, sigma=10.0, r=0.8)
    (orbit,) = ci.find_orbits(model, "0")
    amplitude = 2.0 / np.hypot(1.5 - 4.0, 0.6)
    assert orbit.mean("v**2").value == pytest.approx(amplitude**2 / 2, rel=1e-13)
    assert abs(orbit.mean("v").value) < 1e-14


def test_before_impacts(oscillator):
    found = oscillator.mean("v**2", at_impacts=True)
    assert found.value == pytest.approx(np.mean(oscillator.velocities**2), rel=1e-13)


@pytest.mark.parametrize("text", ["w**2", "v**", "open('x')", "1/0"])
def test_wrong_expression(oscillator, text):
    with pytest.raises(InputError, match="expression"):
        oscillator.mean(text)


def test_balance_two_masses():
    """A machine of two masses that a scene states, whose velocities are v1 and v2."""
    scene = {
        "system": "linear",
        "coordinates": ["x1", "x2"],
        "mass": [["1", "0"], ["0", "mu"]],
        "damping": [["c", "-c"], ["-c", "c"]],
        "stiffness": [["2", "-1"], ["-1", "1"]],
        "force": ["0", "F*cos(w*t)"],
        "period": "2*pi/w",
        "guards": {"S": {"within": "x2 <= d", "restitution": "e"}},
        "parameters": {"mu": 0.5, "c": 0.2, "F": 1.0, "w": 1.3, "d": 0.1, "e": 0.7},
    }
    model = read_model(scene)
    orbits = ci.find_orbits(model, "1")
    assert orbits
    for orbit in orbits:
        work = orbit.mean("F*cos(w*t)*v2").value
        damping = orbit.mean("c*(v2 - v1)**2").value
        assert work == pytest.approx(damping + ci.losses(orbit).per_time, rel=1e-12)


@pytest.mark.full
def test_balance_of_contacts():
    """What the shaking and the weight give is what the membranes' dampers take, the only loss."""
    given = {"r": 0.3, "A": 5.0, "s": 0.39, "k": 500.0, "m": 0.004, "M": 0.1245}
    pair = ci.SoftPair(beta=np.pi / 6, omega=5 * np.pi, **given)
    orbit = next(o for o in ci.find_orbits(pair, "BbTt", parameter="s") if o.physical)
    mass = given["m"] * given["M"] / (given["m"] + given["M"])
    zeta = -np.log(given["r"]) / np.hypot(np.pi, np.log(given["r"]))
    damper = 2.0 * zeta * np.sqrt(given["k"] * mass)
    rate = damper * np.pi / (mass * 5.0 * np.pi)
    places, weights = quadrature(1)
    speeds = values_at(orbit.linearisation, [Output("square", "v**2")], orbit.model, places)[0]
    ends = np.append(orbit.times, orbit.times[0] + orbit.period)
    in_contact = np.diff(ends)[[0, 2]] @ (speeds[[0, 2]] @ weights)
    work = orbit.mean("(cos(pi*t) + gbar)*v").value
    assert work == pytest.approx(rate * in_contact / orbit.period, rel=1e-12)


def scene(**outputs):
    """A short branch of the oscillator with outputs."""
    return {
        "name": "outputs",
        "model": {
            "system": "oscillator",
            "parameters": {"a": 1, "omega": 2.6, "c": 0.1, "k": 1, "sigma": 0, "r": 0.8},
        },
        "follow": {"parameter": "omega", "range": [2.5, 2.7], "orbits": ["1"]},
        "detect": {"events": []},
        "output": outputs,
        "plot": {"y": next(iter(outputs)), "formats": ["png"]},
    }


def test_voltages_of_outputs_are_not_left_out():
    """With membranes that are stated, and with those of the paper."""
    pair = {"system": "impact-pair", "parameters": {"s": 0.5, "A": 5, "beta": 0.5, "r": 0.3}}
    follow = {"parameter": "s", "range": [0.4, 0.6], "orbits": ["1:1"]}
    given = {"name": "voltages", "model": pair, "follow": follow, "plot": {"formats": []}}
    for energy in ({}, {"energy": {}}):
        for text, said in (("U**2", False), ("v**2", True)):
            asked = {**given, **energy, "output": {"P": {"before_impacts": text}}}
            left = read_scene(asked).left_out()
            assert any(line.startswith("energy") for line in left) is said


@pytest.mark.full
def test_columns_of_branches(tmp_path):
    given = scene(P="c*v**2", work="a*cos(omega*t)*v", hit={"before_impacts": "v**2"})
    diagram = ci.follow(given)
    branch = diagram.branches[0]
    row = len(branch) // 2
    orbit = branch.orbit(row)
    assert branch["P"][row] == orbit.mean("c*v**2").value
    assert branch["P_error"].max() < 1e-14
    arriving = 2 * abs(branch["v1"]) * branch["residual"] + 1e-15  # as far as rows solve
    assert (abs(branch["hit"] - branch["v1"] ** 2) <= arriving).all()
    assert read_scene(given).resolved()["output"] == given["output"]
    ci.write_diagram(diagram, tmp_path)
    again = ci.load_diagram(tmp_path).branches[0]
    np.testing.assert_array_equal(again["work"], branch["work"])
    assert again.parameters == branch.parameters
    (series,) = series_of(branch, "P")
    assert len(series.name) > 1, "a name of one letter is a wall's"
    np.testing.assert_array_equal(series.values, branch["P"])


@pytest.mark.full
def test_voltages_of_impacts():
    """Equations (9) of the paper, as outputs; the membranes are those of [energy]."""
    given = {
        "name": "pair",
        "model": {"system": "impact-pair", "parameters": {"beta": 0.5, "r": 0.3, "A": 5, "s": 0.4}},
        "follow": {"parameter": "s", "range": [0.39, 0.41], "orbits": ["1:1"]},
        "detect": {"events": []},
        "output": {"mean": {"before_impacts": "U"}, "rate": {"before_impacts": "U", "per": "time"}},
        "energy": {"U_in": 1000.0},
        "plot": {"formats": []},
    }
    assert read_scene(given).resolved()["output"] == given["output"]
    branch = ci.follow(given).branches[0]
    expected = ci.energy(branch, ci.Membrane(U_in=1000.0))
    np.testing.assert_allclose(branch["mean"], expected["U_I"], rtol=1e-10)  # as rows solve
    np.testing.assert_allclose(branch["rate"], expected["U_T"], rtol=1e-10)
    given["output"]["rate"]["per"] = "hour"
    with pytest.raises(InputError, match=r"output.rate.per: .*accepted are"):
        read_scene(given)
    given["output"] = {"rate": {"mean": "v**2"}}
    with pytest.raises(InputError, match=r"output.rate: found a table with mean; give an express"):
        read_scene(given)


@pytest.mark.parametrize(
    ("outputs", "where"),
    [
        ({"P": "c*w"}, r"output\.P"),
        ({"P": 3}, r"output\.P"),
        ({"P": {"impact": "v"}}, r"output\.P"),
        ({"v1": "v"}, r"output\.v1"),
        ({"omega": "v"}, r"output\.omega"),
        ({"a b": "v"}, r"output\.a b"),
    ],
)
def test_wrong_outputs(outputs, where):
    with pytest.raises(InputError, match=where):
        read_scene(scene(**outputs))


def hybrid(law):
    """An oscillator between two modes that a scene states, with its mass."""
    return {
        "system": "hybrid",
        "period": "2*pi/w",
        "mass": {"x": "m"},
        "modes": {"free": {"x": "v", "v": law}},
        "guards": {"S": {"within": "x <= d", "set": {"v": "-e*v"}}},
        "parameters": {"m": 2.0, "c": 0.2, "k": 3.0, "F": 1.5, "w": 2.3, "d": 0.05, "e": 0.7},
    }


@pytest.mark.parametrize("power", ["x", "x**3"])
def test_balance_hybrid(power):
    """Linear flights, and integrated ones, of a mass other than one."""
    if power != "x":
        pytest.importorskip("heyoka")
    model = read_model(hybrid(f"(F*cos(w*t) - c*v - k*{power})/m"))
    orbit = next(o for o in ci.find_orbits(model, "1") if o.physical)
    work, damping = orbit.mean("F*cos(w*t)*v"), orbit.mean("c*v**2")
    lost = ci.losses(orbit).per_time
    assert lost == pytest.approx(
        2.0 * (1 - 0.7**2) / 2 * orbit.velocities[0] ** 2 / orbit.period, rel=1e-12
    )
    assert work.value == pytest.approx(damping.value + lost, rel=1e-12)


def test_mean_of_simulated_motion(oscillator):
    """Motion that SciPy integrates from the orbit's impact, with v^2 beside it, has its mean."""

    def law(t, y):
        return [y[1], np.cos(2.6 * t) - 0.1 * y[1] - y[0], y[1] ** 2]

    begin, speed = oscillator.times[0], oscillator.velocities[0]
    span, start = (begin, begin + oscillator.period), [0.0, -0.8 * speed, 0.0]
    end = solve_ivp(law, span, start, method="DOP853", rtol=1e-12, atol=1e-14).y[:, -1]
    assert end[1] == pytest.approx(speed, rel=1e-9)
    assert oscillator.mean("v**2").value == pytest.approx(end[2] / oscillator.period, rel=1e-10)


@pytest.mark.full
def test_balance_free_period():
    """Without forcing, on integrated flights of a period that is found."""
    pytest.importorskip("heyoka")
    model = ci.VanDerPol(epsilon=1.0, r=0.8, sigma=1.0)
    orbit = next(o for o in ci.find_orbits(model, "1") if o.physical)
    gained = orbit.mean("epsilon*(1 - x**2)*v**2")
    assert gained.value == pytest.approx(ci.losses(orbit).per_time, rel=1e-12)
    assert abs(orbit.mean("v").value) < 1e-14


def test_a_variable_that_one_mode_lacks_is_named_with_the_mode():
    modes = {"free": {"x": "u", "u": "a - x"}, "contact": {"x": "u", "u": "-x - V", "V": "u - V"}}
    guards = {
        "C": {"mode": "free", "within": "x <= 1", "to": "contact", "set": {"V": 0}},
        "R": {"mode": "contact", "within": "x >= 1", "to": "free"},
    }
    model = {"system": "hybrid", "period": "1", "modes": modes, "guards": guards}
    given = {"name": "circuit", "model": model | {"parameters": {"a": 1.0}}}
    given |= {"follow": {"parameter": "a", "range": [0, 1], "orbits": ["CR"]}}
    with pytest.raises(InputError, match=r"output.P: 'V', which the mode free does not have"):
        read_scene(given | {"output": {"P": "V**2"}})
