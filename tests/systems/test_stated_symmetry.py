"""The symmetry that a hybrid scene states: all variables change their signs."""

from copy import deepcopy

import pytest

import contimpact as ci
from contimpact.diagrams.orbit_walks import symmetric
from contimpact.models.model import Symmetry
from contimpact.orbits.search import mirror_orbit
from contimpact.simulation.sweep import Row, Sweep, cover

RATTLE = {
    "system": "hybrid",
    "period": "2*pi/w",
    "symmetry": {"R": "L"},
    "parameters": {"w": 1.7, "s": 0.5, "r": 0.7, "b": 0.0},
    "modes": {"free": {"x": "v", "v": "cos(w*t) + b - 0.1*v"}},
    "guards": {
        "R": {"within": "x <= s", "set": {"v": "-r*v"}},
        "L": {"within": "x >= -s", "set": {"v": "-r*v"}},
    },
}
"""A mass that rattles between two stops, as `two-stops` without a spring."""


def stated(given, *keys, **changes):
    """The scene's table with other values at a path."""
    found = deepcopy(given)
    table = found
    for key in keys:
        table = table[key]
    table.update(changes)
    return found


def plain(given):
    """The same without the symmetry."""
    return {key: table for key, table in given.items() if key != "symmetry"}


def scene(model, low=0.1, high=0.6, parameter="s", orbits=("RL",), **follow):
    given = {"parameter": parameter, "range": [low, high], "orbits": list(orbits), **follow}
    return ci.read_scene({"name": "symmetric", "model": model, "follow": given})


def test_images_are_half_a_period_later():
    model = scene(RATTLE).model
    assert model.symmetry("s", (0.0,)) == Symmetry({"R": "L", "L": "R"}, shift=0.5, sign=-1.0)
    assert model.symmetry("b", (0.0,)) is None, "b tells left from right"
    assert model.replace(b=0.1).symmetry("s", (0.0,)) is None


def test_images_of_a_swing_are_at_once():
    law = {"x": "v", "v": "-0.1*v - (1 + cos(w*t))*sin(x)"}
    model = stated(stated(RATTLE, "modes", free=law), parameters={"w": 1.7, "s": 0.5, "r": 0.7})
    assert scene(model).model.symmetry("w", (0.0,)).shift == 0.0


def test_modes_have_images():
    def beyond(side):
        return {"x": "v", "v": f"cos(w*t) - v - x - 10*(x {side} s)"}

    model = {
        "system": "hybrid",
        "period": "2*pi/w",
        "symmetry": {"A": "C", "D": "B"},
        "parameters": {"w": 1.2, "s": 0.5},
        "modes": {
            "free": {"x": "v", "v": "cos(w*t) - v - x"},
            "right": beyond("-"),
            "left": beyond("+"),
        },
        "guards": {
            "A": {"mode": "free", "within": "x <= s", "to": "right"},
            "B": {"mode": "right", "within": "x >= s", "to": "free"},
            "C": {"mode": "free", "within": "x >= -s", "to": "left"},
            "D": {"mode": "left", "within": "x <= -s", "to": "free"},
        },
    }
    walls = scene(model, orbits=["ABCD"]).model.symmetry("w", (0.0,)).walls
    assert walls == {"A": "C", "C": "A", "B": "D", "D": "B"}
    crossed = stated(model, symmetry={"A": "B", "C": "D"})
    with pytest.raises(ci.InputError, match=r"model\.symmetry: the mode 'free' has several images"):
        scene(crossed, orbits=["ABCD"])


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (stated(RATTLE, symmetry={"R": "K"}), "found 'K'; the guards are R, L"),
        (stated(RATTLE, symmetry={"R": "R"}), "'R' and 'R' are not on two sides"),
        (stated(RATTLE, "parameters", b=0.1), "the law of 'v' in 'free' does not change its sign"),
        (stated(RATTLE, "guards", "L", within="x >= -1.1*s"), "the position of 'R' does not"),
        (stated(RATTLE, "guards", "L", set={"v": "-v"}), "'v' after 'R' does not"),
    ],
    ids=["unknown", "itself", "law", "position", "set"],
)
def test_what_is_no_symmetry_is_refused(model, message):
    with pytest.raises(ci.InputError, match=rf"^model\.symmetry: .*{message}"):
        scene(model)


def test_branches_that_are_images_are_followed_once():
    """They are those of `two-stops`, in which the symmetry is declared."""
    parameters = {"a": 1, "omega": 1.7, "c": 0.1, "k": 0, "sigma": 0.5, "r": 0.7}
    own = {"system": "two-stops", "parameters": parameters}
    options = {"switch": ["BP"], "unphysical": False}
    found = ci.follow(scene(RATTLE, **options))
    known = ci.follow(scene(own, parameter="sigma", **options))
    assert [e.kind for e in found.entries] == [e.kind for e in known.entries]
    values = [e.value for e in known.entries]
    assert [e.value for e in found.entries] == pytest.approx(values, abs=1e-11)
    assert [len(b.events) for b in found.branches] == [len(b.events) for b in known.branches]
    twice = ci.follow(scene(plain(RATTLE), **options))
    assert len(twice.entries) > len(found.entries)


def test_records_of_systems_without_one_are_the_same():
    assert "symmetry" not in scene(plain(RATTLE)).model.options["machine"]
    text = scene(RATTLE).model.options["machine"]
    assert type(scene(RATTLE).model)(machine=text, **RATTLE["parameters"]).symmetry("s", (0.0,))


def well(force, period="2*pi/w", **parameters):
    """A mass in a field of its own between stops that it does not reach."""
    given = stated(RATTLE, "modes", free={"x": "v", "v": force})
    return given | {"period": period, "parameters": {"s": 9.0, "r": 0.7, **parameters}}


TWO_WELLS = well("x - x**3 - 0.2*v + a*cos(w*t)", w=1.2, a=0.1)


def test_an_orbit_without_impacts_has_an_image_in_the_other_well():
    about = scene(TWO_WELLS, 0.06, 0.1, "a", ["0"])
    symmetry = about.model.symmetry("a", (0.0,))
    orbits = ci.find_orbits(about.model, "0", parameter="a")
    places = sorted(orbit.unknowns[0] for orbit in orbits)
    assert len(places) == 3
    for orbit in orbits:
        image, unknowns = mirror_orbit(orbit.problem, orbit.unknowns, symmetry)
        assert image is orbit.problem
        apart = [image.apart(unknowns, other.unknowns) for other in orbits]
        assert min(apart) < 1e-12
        assert symmetric(image, orbit.unknowns, symmetry, 1e-9) == (apart[orbits.index(orbit)] < 1)
    once, twice = ci.follow(about), ci.follow(scene(plain(TWO_WELLS), 0.06, 0.1, "a", ["0"]))
    assert (len(once.branches), len(twice.branches)) == (2, 3)
    rows = [Row("random", 0.1, found) for found in ci.find_attractors(about.model, 8)]
    assert [row.attractor.notation for row in rows] == ["no impact"] * 2
    assert len(cover(Sweep(about.model, "a", rows), once).matches) == 2


@pytest.mark.full
def test_where_orbits_without_impacts_lose_their_symmetry_one_way_is_followed():
    """With stiffness that hardens they do at a BP, which stays."""
    law = well("-x - x**3 - 0.2*v + a*cos(w*t)", w=1.2, a=4.0)
    options = {"switch": ["BP"]}
    once, twice = (
        ci.follow(scene(given, 4.0, 4.6, "a", ["0"], **options)) for given in (law, plain(law))
    )
    assert [e.kind for e in once.entries] == [e.kind for e in twice.entries] == ["BP"]
    assert "the mirror images of its orbits follow" in once.branches[1].ends[0].message
    assert len(once.branches) == len(twice.branches) == 2
    assert len(once.branches[1]) < len(twice.branches[1])


@pytest.mark.full
def test_a_cycle_without_impacts_has_an_image_in_the_other_well():
    """Hopf: at a = 1 cycles of the period pi sqrt(2) are born on both equilibria, -1 and 1."""
    law = well("x - x**3 + (a - x**2)*v", 4.4, a=0.98)
    once, twice = (ci.follow(scene(given, 0.975, 0.985, "a", ["0"])) for given in (law, plain(law)))
    assert (len(once.branches), len(twice.branches)) == (2, 3)


def test_a_mode_whose_image_is_another_has_no_orbits_that_are_images():
    sides = ("right", "+"), ("left", "-")
    modes = {side: {"x": "v", "v": f"{sign}1 - x - 0.1*v + a*cos(w*t)"} for side, sign in sides}
    guards = {
        "R": {"mode": "right", "within": "x >= -b", "to": "left"},
        "L": {"mode": "left", "within": "x <= b", "to": "right"},
    }
    parameters = {"w": 1.7, "a": 0.1, "b": 0.0}
    given = RATTLE | {"modes": modes, "guards": guards, "parameters": parameters}
    about = scene(given, 0.1, 0.2, "a", ["0"])
    (orbit,) = ci.find_orbits(about.model, "0", parameter="a")
    assert mirror_orbit(orbit.problem, orbit.unknowns, about.model.symmetry("a", (0.0,))) is None
    assert len(ci.follow(about).branches) == 1
