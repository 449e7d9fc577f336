"""Parameters of one's own in the forcing: `cos(pi*t) + h*cos(3*pi*t)`."""

from __future__ import annotations

import math

import numpy as np
import pytest
from zoo import scene as fig7_scene

from contimpact import (
    ImpactPair,
    InputError,
    continue_orbit,
    find_orbits,
    follow,
    load_entries,
    write_diagram,
)
from contimpact.segments.kernel import flat
from contimpact.segments.kernels import Kernels
from contimpact.simulation.simulator import Simulator

FORCING = "cos(pi*t) + h*cos(3*pi*t)"


def pair(forcing=FORCING, **values):
    return ImpactPair(
        **{"beta": math.pi / 6, "r": 0.3, "A": 5.0, "s": 0.36} | values, forcing=forcing
    )


@pytest.mark.parametrize(
    ("forcing", "values", "numbers"),
    [
        (FORCING, {"h": 0.1}, "cos(pi*t) + 0.1*cos(3*pi*t)"),
        ("cos(pi*t + phi)", {"phi": 0.2}, "cos(pi*t + 0.2)"),
        (
            "sin(u)*cos(pi*t) + w**2/(1+w**2)*sin(2*pi*t)",
            {"u": 0.7, "w": 0.4},
            "sin(0.7)*cos(pi*t) + 0.16/1.16*sin(2*pi*t)",
        ),
        ("cos(pi*t) + phase*cos(2*pi*t)", {"phase": 0.3}, "cos(pi*t) + 0.3*cos(2*pi*t)"),
    ],
)
@pytest.mark.quick(1)
def test_a_parameter_is_its_number(forcing, values, numbers):
    """Harmonics, flights with their derivatives, motions: as with the number in its place."""
    one, other = pair(forcing, **values), pair(numbers)
    p, q = ([*m.values.values()] for m in (one, other))
    kernels = [Kernels(m, "s") for m in (one, other)]
    ends = (0.3, 0.7, 1.9, -0.4)
    for name, given in (("harmonics", ()), ("flight_B_T", ends), ("motion_B", ends[:3])):
        found, expected = (
            flat(k.kernel(name)(*given, *v)) for k, v in zip(kernels, (p, q), strict=True)
        )
        assert found == pytest.approx(expected, rel=1e-14, abs=1e-15)
    assert one.own == tuple(values)
    assert one.unit(next(iter(values))) == ""


@pytest.mark.full
def test_it_is_followed():
    """Each orbit of the branch is one of the forcing with the number that it has there."""
    forcing = "sin(h+1)*cos(pi*t + h)"
    orbit = find_orbits(pair(forcing, h=0.1), "1:1", parameter="h")[0]
    branch = continue_orbit(orbit, "h", (0.05, 0.3), events=["FB", "PD", "G"])
    for row in (0, -1):
        at = float(branch["h"][row])
        alone = find_orbits(pair(forcing.replace("h", f"({at!r})")), "1:1", parameter="s")
        nearest = min(alone, key=lambda o: abs(o.velocities[0] - branch["v1"][row]))
        np.testing.assert_allclose(nearest.velocities, branch.velocities[row], atol=1e-11)
        assert branch.orbit(row).model.values["h"] == at


@pytest.mark.full
def test_a_scene_with_one(tmp_path):
    """Followed, written, read back and simulated."""
    scene = fig7_scene(
        model={
            "forcing": FORCING,
            "parameters": {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.4, "h": "1/10"},
        },
        follow={"parameter": "h", "range": [-0.2, 0.4], "orbits": ["1:1"], "switch": []},
    )
    diagram = follow(scene)
    assert diagram.entries
    write_diagram(diagram, tmp_path / "out")
    (entry, *_) = load_entries(tmp_path / "out")
    assert entry.orbit().model.own == ("h",)
    assert abs(entry.parameters["h"] - diagram.entries[0].parameters["h"]) < 1e-15
    model = scene.model
    run = Simulator(model).run(Simulator(model).state("B", 0.3, 0.5), impacts=50)
    plain = Simulator(pair("cos(pi*t) + 0.1*cos(3*pi*t)", s=0.4))
    np.testing.assert_allclose(
        run.velocities, plain.run(plain.state("B", 0.3, 0.5), impacts=50).velocities, atol=1e-9
    )


@pytest.mark.parametrize(
    ("forcing", "values", "says"),
    [
        (FORCING, {}, r"^forcing: unknown name 'h'.*; give it a value among the parameters;"),
        ("cos(pi*t) + beta", {}, r"^forcing: unknown name 'beta'.*such as sin\(\)$"),
        ("cos(pi*t)", {"h": 1.0}, "^h: no such parameter"),
        ("cos(pi*t) + t1", {"t1": 1.0}, "'t1'; give another name: tables have a column"),
        ("cos(pi*t) + d", {"d": 1.0}, "the name 'd' twice"),
        ("cos(pi*t) + forcing", {}, "^forcing: unknown name 'forcing'"),
        (FORCING, {"h": math.inf}, "^h: a parameter of an expression is inf"),
    ],
)
def test_names_that_are_refused(forcing, values, says):
    with pytest.raises(InputError, match=says):
        pair(forcing, **values)


@pytest.mark.parametrize(
    ("forcing", "says"),
    [
        ("exp(cos(pi*t))*h", "no sum of harmonics for all values of h"),
        ("cos(h*pi*t)", "does not have the period 2"),
        ("h*cos(pi*t)/(h - h)", "is not finite"),
    ],
)
def test_forcings_that_are_refused(forcing, says):
    with pytest.raises(InputError, match=says):
        Kernels(pair(forcing, h=1.0), "s").setup  # noqa: B018


@pytest.mark.parametrize(
    ("forcing", "parameter", "symmetric"),
    [
        (FORCING, "h", True),
        (FORCING, "s", True),
        ("cos(pi*t) + h", "s", True),
        ("cos(pi*t) + h", "h", False),  # at h = 0 the capsule is level by chance
        ("cos(pi*t) + h*sin(pi*t)**2", "s", False),
        ("cos(pi*t) + h*cos(2*pi*t)", "h", False),
    ],
)
def test_the_symmetry_that_a_parameter_leaves(forcing, parameter, symmetric):
    model = pair(forcing, beta=0.0, h=0.0)
    found = Kernels(model, parameter).harmonics(*model.values.values())
    assert (model.symmetry(parameter, found) is not None) == symmetric
