"""The kinetic energy that impacts take, against the work of forces and damping around an orbit."""

from __future__ import annotations

import json
import math

import pytest
from mutations import written
from scipy.integrate import quad
from zoo import ProportionalMasses

from contimpact import InputError, losses
from contimpact.cli import main
from contimpact.diagrams.scene_simulation import simulate
from contimpact.orbits.search import find_orbits
from contimpact.results.result_folder import hold_folder, renew_folder
from contimpact.results.scene import read_scene
from contimpact.segments.kernels import Kernels
from contimpact.simulation.settle import settle
from contimpact.simulation.simulator import Simulator
from contimpact.systems.coupled_by_impact import CoupledByImpact
from contimpact.systems.impact_damper import ImpactDamper
from contimpact.systems.oscillator import Oscillator


def test_around_an_orbit_they_are_what_comes_in_less_what_damping_takes():
    """The damper: the force acts on the oscillator, whose velocity is no gap coordinate's."""
    model = ImpactDamper(Omega=1.0, d=20.0, r=0.8, mu=0.1, zeta=0.01)
    orbit = next(o for o in find_orbits(model, "RL", parameter="d", starts=24) if o.stable)
    rows = orbit.problem.impacts(orbit.unknowns)
    found = losses(orbit)
    # the oscillator between impacts: x'' + 2 zeta x' + x = cos t
    zeta, taken = 0.01, 0.0
    w = math.sqrt(1 - zeta**2)
    for k, (t0, dy, x0, v0) in enumerate(rows):
        end = rows[1][0] if k == 0 else rows[0][0] + 2 * math.pi
        v0 += 0.1 * 1.8 / 1.1 * dy
        # a particular solution at resonance: sin t/(2 zeta)
        q, u = x0 - math.sin(t0) / (2 * zeta), v0 - math.cos(t0) / (2 * zeta)

        def speed(t, t0=t0, q=q, u=u):
            s = t - t0
            c, b = q, (u + zeta * q) / w
            decay = math.exp(-zeta * s)
            free = decay * (
                (-zeta * c + w * b) * math.cos(w * s) + (-zeta * b - w * c) * math.sin(w * s)
            )
            return math.cos(t) / (2 * zeta) + free

        def power(t, speed=speed):
            return (math.cos(t) - 2 * zeta * speed(t)) * speed(t)

        taken += quad(power, t0, end, epsabs=1e-11, epsrel=1e-11)[0]
    assert found.impacts.sum() == pytest.approx(taken, abs=1e-8)
    carnot = 0.5 * (1 - 0.8**2) * rows[:, 1] ** 2 * 0.1 / 1.1
    assert found.impacts == pytest.approx(carnot, rel=1e-13)
    assert found.per_time == pytest.approx(carnot.sum() / (2 * math.pi), rel=1e-13)


def test_of_an_attractor_they_are_those_of_the_reduced_mass():
    given = {"m2": 2.0, "c1": 0.1, "c2": 0.0, "k1": 1.0, "k2": 2.0, "a1": 1.0, "omega": 1.3}
    model = CoupledByImpact(**given, gap=0.2, r=0.7)
    simulator = Simulator(model)
    found = settle(simulator, simulator.state("K", 0.15, 1.6, [-0.5, -0.3]))
    lost = losses(found, model)
    reduced = 1.0 * 2.0 / 3.0
    carnot = 0.5 * (1 - 0.7**2) * reduced * found.velocities**2
    assert lost.impacts == pytest.approx(carnot, rel=1e-13)
    assert lost.per_impact == pytest.approx(carnot.mean(), rel=1e-13)


def test_of_one_coordinate_they_are_those_of_a_unit_of_mass():
    model = Oscillator(a=1.0, omega=1.0, c=0.1, k=1.0, sigma=1.0, r=0.8)
    orbit = find_orbits(model, "1", parameter="a")[0]
    expected = 0.5 * (1 - 0.64) * orbit.velocities**2
    assert losses(orbit).impacts == pytest.approx(expected, rel=1e-13)


@pytest.mark.full
def test_masses_that_are_not_stated_are_asked_for():
    model = ProportionalMasses(k1=1.0, k2=0.6, omega=1.8, r=0.8, a=1.0, c=0.07, sigma=1.0)
    orbit = find_orbits(model, "A", parameter="r", starts=8)[0]
    with pytest.raises(InputError, match=r"Formulas\.mass"):
        losses(orbit)
    with pytest.raises(InputError, match="an attractor and its model"):
        losses(3.0)


BODIES = {
    "system": "hybrid",
    "period": "2*pi/w",
    "parameters": {"m": 0.5, "k": 1.3, "w": 1.7, "r": 0.7, "d": 0.4},
    "mass": {"x": 1, "y": "m"},
    "define": {"pull": "k*(x - y)", "both": "(1 + r)*(v + m*u)/(1 + m)"},
    "modes": {"f": {"x": "v", "y": "u", "v": "cos(w*t) - x - pull - v/5", "u": "(pull - u/5)/m"}},
    "guards": {"S": {"within": "y - x <= d", "set": {"v": "both - r*v", "u": "both - r*u"}}},
}
SIMULATE = {"range": [0.35, 0.45], "values": 2, "periods": 60, "losses": True}


def stated(word="S", **changes):
    table = {k: v for k, v in (BODIES | changes).items() if v is not None}
    follow = {"parameter": "d", "range": [0.1, 1.0], "orbits": [word]}
    return read_scene({"name": "n", "model": table, "follow": follow, "simulate": SIMULATE})


def test_masses_of_a_hybrid_system_are_stated_in_its_scene():
    """Carnot's theorem with the reduced mass; the impulse acts between the bodies."""
    orbit = find_orbits(stated().model, "S", parameter="d")[0]
    reduced = 0.5 / 1.5
    carnot = 0.5 * (1 - 0.7**2) * reduced * orbit.velocities**2
    assert losses(orbit).impacts == pytest.approx(carnot, rel=1e-12)


def test_a_body_that_comes_to_stick_loses_what_it_had_beside_the_next_modes_rate():
    modes = {"f": {"x": "v", "v": "cos(w*t) - x - v/5"}, "s": {"x": "0", "e": "1"}}
    guards = {
        "S": {"mode": "f", "within": "x <= d", "to": "s", "set": {"e": 0}},
        "R": {"mode": "s", "within": "e <= 1", "to": "f", "set": {"v": "-k*r/m"}},
    }
    changes = {"modes": modes, "guards": guards, "define": None, "mass": {"x": "m"}}
    model = stated("SR", **changes).model
    kernels, values = Kernels(model, "d"), model.values.values()
    (stopped,) = kernels.loss("S")(1.5, 0.0, 0.0, *values)
    (started,) = kernels.loss("R")(1.0, 0.4, 0.0, *values)
    assert stopped == pytest.approx(0.25 * 1.5**2, rel=1e-14)
    assert started == pytest.approx(-0.25 * (1.3 * 0.7 / 0.5) ** 2, rel=1e-14)


@pytest.mark.parametrize(
    ("mass", "message"),
    [
        ({"x": 1}, r"^model\.mass\.y: missing; give each coordinate its mass"),
        ({"x": 1, "y": 1, "z": 1}, r"^model\.mass\.z: 'z' is no coordinate; .* x, y$"),
        ({"x": 1, "v": 1, "y": 1}, r"^model\.mass\.v: 'v' is no coordinate"),
        ({"x": 1, "y": "-m"}, r"^model\.mass\.y: it is -0\.5; it must be 0 or more"),
        ({"x": 1, "y": "q"}, r"^model\.mass\.y: unknown name 'q'"),
        ({"x": 1, "y": "0/0"}, r"^model\.mass\.y"),
        ([1, 1], r"^model\.mass: found \[1, 1\]"),
    ],
)
def test_masses_are_those_of_coordinates(mass, message):
    with pytest.raises(InputError, match=message):
        stated(mass=mass)


def test_losses_of_unknown_masses_are_refused_before_anything_is_computed(tmp_path, capsys):
    scene = stated(mass=None)
    with pytest.raises(InputError, match=r"^simulate\.losses: .*state its masses, model\.mass$"):
        simulate(scene, tmp_path)
    assert list(tmp_path.iterdir()) == []
    path = written(scene.given, tmp_path / "scene.toml")
    assert main(["check", path]) == 2
    assert "simulate.losses: the kinetic energy of hybrid is not known" in capsys.readouterr().err


def test_losses_of_an_earlier_run_do_not_survive(tmp_path):
    scene = stated()
    with hold_folder(tmp_path) as folder:
        (folder / "losses.csv").write_text('# {"schema": "contimpact.losses/1"}\nfrom\n')
        (folder / "manifest.json").write_text(
            json.dumps({"schema": "contimpact.manifest/1", "scene": scene.resolved()})
        )
        with renew_folder(folder, ["simulate"], scene.resolved()):
            assert not (folder / "losses.csv").exists()
