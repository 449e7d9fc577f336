"""What a person tries who has read the documentation once: names, orders and kinds of arguments."""

from __future__ import annotations

import pickle
import types

import numpy as np
import pytest

import contimpact as ci

KEPT = {"s": 0.34, "A": 5.0, "beta": np.pi / 6, "r": 0.3}


@pytest.fixture(scope="module")
def tried(kernel_cache):
    """A diagram of one branch, with what stands on it and what is simulated beside it."""
    pair = ci.ImpactPair(**KEPT)
    orbit = ci.find_orbits(pair, "1:1", parameter="s")[0]
    branch = ci.continue_orbit(orbit, "s", range=(0.32, 0.4), events=["PD", "G"])
    simulator = ci.Simulator(pair)
    attractor = ci.settle(simulator, simulator.state("B", 0.1, 0.6))
    swept = ci.sweep(pair, "s", [0.34, 0.338])
    diagram = ci.Diagram("tried", [branch])
    found = {"pair": pair, "orbit": orbit, "branch": branch, "diagram": diagram}
    found |= {"simulator": simulator, "attractor": attractor, "swept": swept}
    return types.SimpleNamespace(**found)


def test_a_diagram_holds_what_it_is_asked_for(tried):
    diagram, entry = tried.diagram, tried.branch.events[0]
    assert "b1" in diagram
    assert entry.id in diagram
    assert entry in diagram
    assert "e99" not in diagram
    assert len(diagram) == 1
    assert ci.Diagram("empty", [])  # a diagram is one also without branches
    assert diagram.events == diagram.entries
    assert np.array_equal(diagram.orbit(entry).unknowns, diagram.orbit(entry.id).unknowns)


def test_orbits_entries_and_branches_share_names(tried):
    entry = tried.branch.events[0]
    orbit = entry.orbit()
    assert orbit.notation == entry.notation == tried.branch.notation == "1:1"
    assert orbit.parameter == entry.parameter == tried.branch.parameter == "s"
    assert orbit.value == entry.value
    assert orbit.times == pytest.approx(entry.times, abs=1e-12)
    assert orbit.velocities == pytest.approx(entry.velocities, abs=1e-12)


def test_a_number_of_a_branch_says_how_to_come_to_its_orbit(tried):
    with pytest.raises(KeyError, match=r"branch\.orbit\(3\)"):
        tried.branch[3]


@pytest.mark.parametrize("given", ["diagram", "branch", "branches"])
@pytest.mark.full
def test_branches_are_drawn_as_diagrams_are(tried, given):
    what = [tried.branch] if given == "branches" else getattr(tried, given)
    ax = ci.plot_diagram(what, x="d")
    wanted = ci.plot_diagram(tried.diagram, x="d")
    assert [line.get_xydata().tolist() for line in ax.lines] == [
        line.get_xydata().tolist() for line in wanted.lines
    ]
    with pytest.raises(ci.InputError, match="give a diagram, a branch, or a list of branches"):
        ci.plot_diagram(tried.orbit)


def test_one_curve_is_drawn_as_several_are(tried):
    doubling = next(e for e in tried.branch.events if e.kind == "PD")
    curve = ci.follow_curve(doubling, second="r", first_range=(0.2, 0.6), second_range=(0.28, 0.32))
    assert len(ci.plot_curves(curve)) == len(ci.plot_curves([curve])) == 1


def test_voltages_are_drawn_with_the_membrane_first_last_or_none(tried):
    drawn = [
        ci.plot_energy(tried.swept),
        ci.plot_energy(tried.swept, ci.Membrane()),
        ci.plot_energy(ci.Membrane(), tried.swept),
    ]
    data = [[line.get_xydata().tolist() for line in ax.lines] for ax in drawn]
    assert data[0] == data[1] == data[2]


@pytest.mark.parametrize("name", ["pair", "branch", "diagram", "attractor", "swept"])
def test_what_is_pickled_comes_back_equal(tried, name):
    one = getattr(tried, name)
    assert pickle.loads(pickle.dumps(one)) == one


def test_a_simulator_is_pickled_with_its_settings(tried):
    one = ci.Simulator(tried.pair, longest_flight=7)
    again = pickle.loads(pickle.dumps(one))
    assert again.model == one.model
    assert again.longest_flight == 7
    state = one.state("B", 0.1, 0.6)
    assert np.array_equal(
        again.run(state, impacts=9).velocities, one.run(state, impacts=9).velocities
    )
    assert repr(one) == f"Simulator({tried.pair!r})"


def test_models_are_equal_by_system_options_and_values(tried):
    assert tried.pair == ci.ImpactPair(**KEPT)
    assert hash(tried.pair) == hash(ci.ImpactPair(**KEPT))
    assert tried.pair != tried.pair.replace(s=0.35)
    assert tried.pair != ci.ImpactPair(**KEPT, forcing="sin(pi*t)")


@pytest.mark.parametrize("what", ["one", "several"])
def test_attractors_and_sweeps_are_kept(tried, tmp_path, what):
    attractors = [row.attractor for row in tried.swept.rows]
    given = tried.attractor if what == "one" else attractors
    ci.save(given, tmp_path / "attractors.json")
    assert ci.load(tmp_path / "attractors.json") == given
    ci.save(tried.swept, tmp_path / "sweep.json")
    assert ci.load(tmp_path / "sweep.json") == tried.swept


def test_mistakes_say_what_would_do(tried, tmp_path):
    with pytest.raises(ci.InputError, match=r"ci\.Diagram\(name, branches\)"):
        ci.save([tried.branch], tmp_path / "branches")
    with pytest.raises(ci.InputError, match=r"an orbit has \.sensitivity\(\)"):
        ci.sensitivity(tried.orbit, "r")
    with pytest.raises(ci.InputError, match="tells no order of its impacts; give the word"):
        ci.find_orbits(tried.pair, "(4:3)/2T")
