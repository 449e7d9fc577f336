"""Crises against many digits, simulation and themselves.

The constants were computed with mpmath in 45 digits from equations (4)-(6) of the paper, written
out apart from the package, with three laps more at both ends.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest
from exact_flights import pair_flight
from zoo import TWO_MASSES, scene

from contimpact.bifurcations.crisis import error_of, solve
from contimpact.diagrams import crises
from contimpact.diagrams.connection_paths import entries_of, last_laps, passage_of, sides_of
from contimpact.diagrams.crises import (
    add_crises,
    crises_text,
    find_crises,
    find_crisis_margin,
    follow_crisis,
)
from contimpact.diagrams.crisis_location import (
    PATIENT,
    Crisis,
    NoCrisis,
    approach_crisis,
    escape_from,
    locate_crisis,
    locate_tangencies,
    passes_and_returns,
)
from contimpact.diagrams.explore import follow
from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.errors import InputError
from contimpact.orbits.orbit import Orbit
from contimpact.orbits.search import find_orbits, solve_near
from contimpact.page.data import PageView, page_data
from contimpact.results.catalogue import load_diagram, write_diagram
from contimpact.results.diagram import Diagram
from contimpact.results.options import Settling
from contimpact.simulation.attractor import Kind
from contimpact.simulation.settle import settle
from contimpact.simulation.simulator import Simulator
from contimpact.simulation.sweep import Simulators, Sweep, attractor_numbers, same_attractor, sweep
from contimpact.simulation.transitions import explain_transition, transitions_between
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.soft_stop import SoftStop

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

FIG7 = 0.355220528250598985031742370212
"""s of the crisis of Fig. 7."""
STOP = {"a": 1.0, "omega": 1.3, "c": 0.1, "k": 1.0, "e": 0.5, "k_b": 20.0, "c_b": 0.3}
AT_R = {0.25: 0.361532047552305157160506350248, 0.35: 0.349262216481894132923365508288}


def at(orbit, value):
    """An orbit at another value of its parameter."""
    unknowns = np.append(orbit.unknowns[:-1], value)
    return Orbit(orbit.problem, solve_near(orbit.problem, unknowns))


def unstable(s, r=0.3):
    """The unstable 2:1 that is born at the ghost grazing."""
    model = ImpactPair(beta=math.pi / 6, r=r, A=5.0, s=s)
    found = find_orbits(model, "2:1", parameter="s")
    return next(o for o in found if o.physical and not o.stable)


@pytest.fixture(scope="module")
def swept():
    """Complex motion, which starts beside the unstable 1:1, and what follows it."""
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.3558)
    orbit = next(o for o in find_orbits(model, "1:1", parameter="s") if o.physical)
    start = Simulator(model).state("B", orbit.times[0] + 1e-3, orbit.velocities[0])
    found = sweep(model, "s", [0.3558, 0.3548], start=start)
    assert [row.attractor.notation for row in found.rows] == ["1:1/C", "2:1"]
    return found


@pytest.fixture(scope="module")
def crisis(swept):
    """The crisis between both values, of the orbits on one branch."""
    branch = continue_orbit(unstable(0.3556), range=(0.355, 0.3565), events=())
    (found,) = find_crises(swept, Diagram("fig7", [branch]), impacts=20_000)
    assert isinstance(found, Crisis)
    return found


def test_the_crisis_of_fig_7(crisis):
    assert abs(crisis.value - FIG7) <= crisis.error < 1e-12
    assert crisis.label == "CR[1:1/C|2:1]"
    assert (crisis.type, crisis.after, crisis.homoclinic) == ("boundary", "2:1", True)
    assert crisis.value < crisis.seen < crisis.value + 3e-5
    assert crisis.as_record()["lasted"] == crisis.lasted > 1000
    assert crisis.orbit.value == crisis.value
    record = crisis.as_record()
    assert record["parameters"]["d"] == pytest.approx(0.22112, abs=5e-6)  # as simulated before


def test_the_connection_grazes_and_ends_at_the_orbit(crisis):
    assert crisis.velocities[crisis.grazing] == pytest.approx(0.0, abs=1e-15)
    end = sorted(crisis.velocities[-3:])
    assert end == pytest.approx(sorted(crisis.orbit.velocities), abs=1e-10)
    start = sorted(crisis.velocities[:3])
    assert start == pytest.approx(sorted(crisis.orbit.velocities), abs=1e-2)


def test_simulation_leaves_the_attractor_just_beyond(crisis):
    """From the point of the path behind the grazing, 1e-5 below; above, `seen` is simulated."""
    simulator = Simulator(crisis.model.replace(s=crisis.value - 1e-5))
    k = crisis.grazing + 1
    state = simulator.state(crisis.walls[k], crisis.times[k], crisis.velocities[k])
    found = settle(simulator, state, Settling(periods=20_000))
    assert (found.kind, found.notation) == (Kind.PERIODIC, "2:1")


def test_paths_end_with_laps_until_what_they_leave_is_small():
    """Of 2:2 of Fig. 10(c) at r = .75 three left 8e-5 in A, beside 2:1 of Fig. 7 nothing."""
    model = ImpactPair(beta=math.pi / 6, r=0.75, A=18.697, s=0.5)
    orbits = find_orbits(model, "2:2", parameter="A")
    saddle = next(o for o in orbits if o.physical and o.multipliers[0].real > 1.0)
    for orbit, laps in ((unstable(0.3556), 3), (saddle, 6)):
        first, second = np.abs(orbit.multipliers)
        assert last_laps(orbit) == laps
        assert (second / first) ** laps < 1e-10


@pytest.mark.parametrize("laps", [(1, 0), (0, 1), (2, 2)])
def test_more_laps_change_nothing(crisis, laps):
    found = solve(*crisis.path.problem.longer(crisis.path.unknowns, *laps))
    assert abs(found.unknowns[-1] - FIG7) <= error_of(found) < 1e-12


def test_the_equations_derivatives(crisis):
    problem, z = crisis.path.problem, crisis.path.unknowns
    jacobian = problem.evaluate(z).jacobian
    for k in (0, 1, 2 * crisis.grazing, len(z) - 2, len(z) - 1):
        step = np.zeros(len(z))
        step[k] = 1e-6
        difference = problem.evaluate(z + step).residual - problem.evaluate(z - step).residual
        assert difference / 2e-6 == pytest.approx(jacobian[:, k], abs=1e-8)


@pytest.mark.full
def test_a_curve_in_two_parameters(crisis):
    curve = follow_crisis(crisis, "r", (0.25, 0.35))
    assert (curve.values[0, 1], curve.values[-1, 1]) == (0.25, 0.35)
    assert curve.physical.all()
    assert curve.errors.max() < 1e-12
    for row, r in ((0, 0.25), (-1, 0.35)):
        assert abs(curve.values[row, 0] - AT_R[r]) <= curve.errors[row]
    assert curve.at(0.3) == pytest.approx([FIG7], abs=1e-13)
    for r in (0.25, 0.35):  # its ends belong to it
        assert curve.at(r) == pytest.approx([AT_R[r]], abs=1e-12)
    assert curve.at(0.36) == []
    assert "27 points, r from 0.25 to 0.35" in repr(curve)
    assert repr(curve).endswith("known where it was located alone")


@pytest.mark.full
def test_margin_of_a_crisis(crisis):
    """In one parameter it is a difference; in two nothing on the curve is nearer, and its first
    differences are its slopes."""
    near = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.3556)
    alone = find_crisis_margin(crisis, near, {"s": 0.001})
    assert alone.distance == pytest.approx((0.3556 - FIG7) / 0.001, rel=1e-12)
    assert alone.direction == {"s": -1.0}
    model, units = near.replace(s=0.36, r=0.29), {"s": 0.0036, "r": 0.0029}
    found = find_crisis_margin(crisis, model, {"s": "1%", "r": "1%"})
    assert found.tolerances == pytest.approx(units)
    assert found.physical
    curve = follow_crisis(crisis, "r", (0.28, 0.31))

    def distance(r):
        return math.hypot((curve.at(r)[0] - 0.36) / 0.0036, (r - 0.29) / 0.0029)

    there = found.parameters["r"]
    assert distance(there) == pytest.approx(found.distance, rel=1e-11)
    for r in (there - 1e-4, there + 1e-4, 0.2801, 0.285, 0.295, 0.305):
        assert distance(r) > found.distance * (1.0 + 1e-5)
    for name, step in (("A", 1e-4), ("s", 1e-6), ("beta", 1e-5)):
        low, high = (
            find_crisis_margin(
                crisis, model.replace(**{name: model.values[name] + sign * step}), units
            ).distance
            for sign in (-1.0, 1.0)
        )
        assert found.sensitivity(name) == pytest.approx((high - low) / (2 * step), rel=1e-6)


def test_wrong_margins_of_a_crisis(crisis):
    with pytest.raises(InputError, match="crisis's system, impact-pair"):
        find_crisis_margin(crisis, SoftStop(**STOP), {"s": 0.1})
    with pytest.raises(InputError, match="no parameter 'q'"):
        find_crisis_margin(crisis, crisis.model, {"q": 0.1})


@pytest.fixture(scope="module")
def diagram():
    """A run of a scene that asks for crises: the branch of 2:1, and a sweep down."""
    return follow(
        scene(
            model={
                "system": "impact-pair",
                "parameters": {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.3556},
            },
            follow={"parameter": "s", "range": [0.34, 0.3566], "orbits": ["2:1"], "switch": []},
            detect={"events": ["FB"], "crises": True},
            simulate={"range": [0.3546, 0.3574], "values": 4},
        )
    )


def in_thirty_digits(kept, parameters, before, after):
    """The value of a connection from its impacts alone, by equations (4)-(6) of the paper.

    `before` and `after` are impacts and forcing periods of its first and last laps.
    """
    values = {n: mp.mpf(x) for n, x in parameters.items()}
    walls, last = kept["walls"], len(kept["walls"]) - 1

    def residual(*z):
        at = {**values, "s": z[-1]}
        rows = list(zip(z[:-1:2], z[1:-1:2], strict=True))
        found = [
            x
            for k in range(last)
            for x in pair_flight(
                at, "cos(pi*t)", walls[k : k + 1], walls[k + 1], *rows[k], *rows[k + 1]
            )[0]
        ]
        ends = (
            rows[before[0]][0] - rows[0][0] - 2 * before[1],
            rows[last][0] - rows[last - after[0]][0] - 2 * after[1],
        )
        return [*found, *ends, rows[kept["grazing"]][1]]

    z = [x for row in zip(kept["times"], kept["velocities"], strict=True) for x in row]
    return mp.findroot(residual, [*map(mp.mpf, z), values["s"]], tol=1e-28)[len(z)]


@pytest.mark.full
def test_a_run_has_the_crisis_of_its_scene(diagram, tmp_path):
    """In the catalogue it is solved for again, in 30 digits and from its record alone."""
    write_diagram(diagram, tmp_path)
    loaded = load_diagram(tmp_path)
    assert loaded.branches == diagram.branches
    (entry,) = [e for e in loaded.entries if e.kind == "CR"]
    assert (entry.label, entry.notation, entry.ghost) == ("CR[1:1/C|2:1]", "2:1", False)
    with mp.workdps(30):
        again = in_thirty_digits(entry.crisis, entry.parameters, (3, 1), (3, 1))
        assert abs(again - mp.mpf(entry.value)) <= entry.error < 1e-12
    assert abs(entry.value - FIG7) <= entry.error
    flat = (tmp_path / "events.csv").read_text()
    assert f"{entry.id},CR,0,CR[1:1/C|2:1],," in flat
    branch = loaded[entry.branch]
    row = branch["event"].tolist().index(entry.id)
    assert entry.orbit().value == branch["s"][row] == entry.value
    assert np.all(np.diff(branch["arclength"]) > 0.0)
    assert branch.status[row - 1] == branch.status[row] == 1
    sentence = (
        "the chaos 1:1/C ends at s = 0.355220528 in a boundary crisis on the unstable 2:1 "
        f"({entry.id}); beyond: 2:1"
    )
    assert sentence in str(loaded.reading).splitlines()
    page = page_data(loaded, None, PageView("s"))
    assert [crisis["entry"] for crisis in page["reading"]["crises"]] == [entry.id]
    assert next(e for e in page["entries"] if e["id"] == entry.id)["parts"]["symbol"] == "CR"


@pytest.mark.full
def test_a_crisis_explains_the_end_of_the_motion(crisis, swept):
    """Simulation puts it below, since transients are long there."""
    branch = continue_orbit(unstable(0.3556), range=(0.355, 0.3565), events=())
    diagram = add_crises(Diagram("fig7", [branch]), [crisis])
    simulators = Simulators(swept.model, "s")
    (found,) = transitions_between(simulators, *swept.rows, 1e-6, Settling(periods=4000))
    (explanation,) = explain_transition(found, diagram, swept).explanations
    assert (explanation.label, explanation.role) == ("CR[1:1/C|2:1]", "explains")
    assert explanation.distance < 3e-5


def test_a_crisis_met_twice_is_one_entry(crisis):
    branch = continue_orbit(unstable(0.3556), range=(0.355, 0.3565), events=())
    missed = NoCrisis("for a reason")
    found = add_crises(Diagram("fig7", [branch]), [crisis, missed, crisis])
    assert [entry.label for entry in found.entries] == ["CR[1:1/C|2:1]"]
    assert found.statistics["notes"] == ["no crisis: for a reason"]


@pytest.mark.slow
def test_a_crisis_of_an_orbit_on_no_branch_is_in_the_notes(swept):
    (found,) = find_crises(swept, Diagram("none", []))
    assert isinstance(found, Crisis)
    assert abs(found.value - FIG7) <= found.error
    (note,) = add_crises(Diagram("none", []), [found]).statistics["notes"]
    assert note.endswith("of an orbit on no branch")


@pytest.mark.parametrize("error", [KeyboardInterrupt(), np.linalg.LinAlgError("Singular matrix")])
def test_crises_found_before_the_search_ends_are_kept(monkeypatch, error):
    """Of three ends the search for the second is interrupted, or fails."""
    model = ImpactPair(beta=math.pi / 3, r=0.3, A=5.0, s=0.42)
    rows = sweep(model, "s", [0.42, 0.415]).rows
    again = [[replace(row, direction=way) for row in rows] for way in ("up", "down", "random")]
    searched = []

    def search(*given):
        searched.append(given)
        if len(searched) == 2:
            raise error
        return NoCrisis(f"end {len(searched)}")

    monkeypatch.setattr(crises.CrisisSearch, "end_between", search)
    monkeypatch.setattr(crises, "neighbours", lambda sweep: again)
    reasons = [one.reason for one in find_crises(Sweep(model, "s", rows), Diagram("none", []))]
    assert reasons[0] == "end 1"
    if isinstance(error, KeyboardInterrupt):
        assert reasons[1:] == ["the search was interrupted; changes of motion looked at: 1"]
    else:
        assert reasons[1].endswith("(down); the search failed (LinAlgError: Singular matrix)")
        assert reasons[2] == "end 3"


def test_complex_motion_does_not_end_where_motion_has_not_settled():
    """Such a row is no attractor: the motion is the same on both sides, and an end behind it is one
    between the rows that have settled."""
    model = ImpactPair(beta=math.pi / 3, r=0.3, A=5.0, s=0.42)
    rows = sweep(model, "s", [0.42, 0.415]).rows
    kinds = [Kind.COMPLEX, Kind.NOT_SETTLED, Kind.COMPLEX, Kind.NOT_SETTLED, Kind.PERIODIC]
    made = [
        replace(rows[0], value=0.42 - 0.001 * k, attractor=replace(rows[0].attractor, kind=kind))
        for k, kind in enumerate(kinds)
    ]
    search = crises.CrisisSearch(Sweep(model, "s", made), Diagram("none", []), None)
    assert [find.args[:2] for _, find in search.ends()] == [(made[2], made[4])]


def test_an_end_without_a_crisis_is_reported():
    assert json.loads(crises_text([NoCrisis("why")], "s"))["unexplained"] == ["why"]


@pytest.mark.parametrize(
    ("values", "word", "label"),
    [
        ((14.2575, 14.29), "3:2", "FB"),
        ((12.66, 12.56), "2:1", "PD"),
        ((14.2575, 14.16), "(7:5)", "G"),
    ],
)
@pytest.mark.full
def test_an_end_without_a_crisis_has_the_event_of_the_motion_that_takes_over(values, word, label):
    """In Fig. 8: a fold, the last doubling of a cascade, a grazing of an orbit of a long period."""
    model = ImpactPair(beta=math.pi / 6, r=0.25, A=values[0], s=0.5)
    found = sweep(model, "A", values)
    (end,) = find_crises(found, Diagram("none", []))
    assert isinstance(end, NoCrisis)
    assert end.entry is not None
    assert end.entry.kind == label
    assert min(values) < end.entry.value < max(values)
    orbit = found.rows[1].attractor.orbit(model, "A")
    assert orbit.notation.startswith(word)
    branch = continue_orbit(orbit, range=(5.0, 20.0), events=[label], settings={"max_step": 0.02})
    assert min(abs(e.value - end.entry.value) for e in branch.events) < 1e-10
    (record,) = json.loads(crises_text([end], "A"))["takeovers"]
    assert (record["value"], record["text"]) == (end.entry.value, end.reason)
    assert not add_crises(Diagram("none", []), [end]).statistics["notes"]


@pytest.mark.full
def test_an_end_in_a_cascade_has_the_event_of_the_orbit_that_was_doubled():
    model = ImpactPair(beta=math.pi / 3, r=0.3, A=5.0, s=0.42)
    found = sweep(model, "s", [0.42, 0.415])
    assert [row.attractor.notation for row in found.rows] == ["1:1/C", "(6:4)/4T"]
    (end,) = find_crises(found, Diagram("none", []))
    assert "(6:4)/4T takes over, doubled from (3:2)/2T, stable from FB" in str(end)
    orbits = find_orbits(model.replace(s=0.4155), "BTBBT/2T", parameter="s")
    stable = next(o for o in orbits if o.stable)
    branch = continue_orbit(stable, range=(0.41, 0.42), events=["FB"])
    assert min(abs(e.value - end.entry.value) for e in branch.events) < 1e-12


def test_a_scene_needs_branches():
    with pytest.raises(InputError, match=r"simulate\.branches = true"):
        scene(simulate={"range": [0.35, 0.36], "crises": True})


@pytest.mark.slow
def test_a_tangency_without_a_grazing_is_the_crisis(interior):
    """From the orbit's manifold alone, without an attractor."""
    assert "motion lasted 4e+05 impacts at 0.34973551" in str(interior)
    diagram = Diagram(
        "one", [continue_orbit(interior.orbit, range=(0.349, 0.35), events=(), name="b1")]
    )
    text = str(add_crises(diagram, [replace(interior, branch="b1")]).reading)
    assert "widens at s = 0.3497355 at the latest in an interior crisis" in text
    near = locate_tangencies(at(interior.orbit, interior.value + 1e-5), starts=32)
    assert min(abs(t.value - interior.value) for t in near) <= 1e-12


@pytest.mark.full
def test_a_homoclinic_tangency_is_the_crisis():
    first = locate_tangencies(unstable(0.3556), starts=6)[0]
    assert abs(first.value - FIG7) <= first.error < 1e-12
    assert first.homoclinic
    assert str(first).startswith("homoclinic, 2:1 to 2:1, at s = 0.3552205282")


@pytest.mark.full
def test_where_an_orbit_itself_grazes_its_manifolds_do_not_touch():
    pair = ImpactPair(beta="pi/4", r_B=0.45, r_T=0.35, M=0.05, omega=62.8, A=4.0, s=0.0425)
    found = find_orbits(pair, "1:1", parameter="s")
    orbit = next(o for o in found if o.physical and not o.stable)
    branch = continue_orbit(orbit, range=(0.02, 0.043), events=("G",))
    assert any(abs(entry.value - 0.0206465803) < 1e-9 for entry in branch.events)
    assert locate_tangencies(orbit) == []


@pytest.mark.full
def test_motion_passes_an_orbit_within_its_attractor_and_returns():
    """1:1 is within complex motion at high restitution; of Fig. 7, 2:1 is beside it."""
    model = ImpactPair(beta=0.25, r=0.62, A=5.0, s=0.145)
    within = next(o for o in find_orbits(model, "1:1", parameter="s") if o.multipliers[0].real > 1)
    beside = unstable(0.3556)
    start = Simulator(beside.model).state("B", beside.times[0] + 1e-3, beside.velocities[0])
    for orbit, state in ((within, "random"), (beside, start)):
        motion = settle(orbit.model, state)
        assert motion.kind is Kind.COMPLEX
        assert passes_and_returns(orbit, motion, orbit.value) is (orbit is within)


@pytest.mark.parametrize("kind", ["boundary", "interior", "merging", None])
def test_the_type_of_a_crisis_in_words(crisis, kind):
    typed = replace(crisis, type=kind, branch="b1")
    branch = continue_orbit(unstable(0.3556), range=(0.355, 0.3565), events=(), name="b1")
    text = str(add_crises(Diagram("typed", [branch]), [typed]).reading)
    said = {
        "boundary": "ends at s = 0.355220528 in a boundary crisis on the unstable 2:1",
        "interior": "widens at s = 0.355220528 in an interior crisis on the unstable 2:1",
        "merging": "merges with another one at s = 0.355220528 in a merging crisis on the unst",
        None: "in a crisis (e1), of a type that simulation does not show",
    }
    assert said[kind] in text
    assert "at the latest" not in text


@pytest.mark.slow
def test_heteroclinic_tangencies_in_thirty_digits():
    """From the orbit that is born where 1:1/2T grazes: the corner is another one, side by side."""
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.3556)
    born = next(o for o in find_orbits(model, "BBTBT/2T", parameter="s") if o.physical)
    found = locate_tangencies(born, unstable(0.3556))
    assert found
    for one in found:
        assert not one.homoclinic
        problem, impacts = one.path.problem, one.path.impacts.T.tolist()
        kept = dict(zip(("times", "velocities"), impacts, strict=True))
        kept |= {"walls": problem.walls, "grazing": problem.grazing}
        with mp.workdps(30):
            again = in_thirty_digits(kept, one.leaves.parameters, (5, 2), (3, 1))
            assert abs(again - mp.mpf(one.value)) <= one.error < 1e-12


@pytest.fixture(scope="module")
def symmetric():
    """1:1 of a level capsule, unstable: its own mirror image, between two complex attractors."""
    model = ImpactPair(beta=0.0, r=0.5, A=5.0, s=0.2003)
    return next(o for o in find_orbits(model, "1:1", parameter="s") if o.physical)


def mirror_images(simulator, orbit):
    """What motions settle on that leave the orbit to both sides; each is the other's mirror."""
    wall, time, velocity = orbit.word.walls[0], orbit.times[0], orbit.velocities[0]
    return [settle(simulator, simulator.state(wall, time + d, velocity)) for d in (1e-4, -1e-4)]


@pytest.mark.full
def test_two_complex_attractors_of_one_notation_are_two(symmetric):
    """As many as there are notations where the mirror images have two; else by their impacts."""
    simulator = Simulator(symmetric.model)
    one, other = mirror_images(simulator, symmetric)
    assert [one.kind, other.kind] == [Kind.COMPLEX] * 2
    again = settle(simulator, one.state, Settling(impacts=5000))
    assert same_attractor(one, again)
    assert not same_attractor(one, other)
    states = [a.state for a in (one, other, one, other)]
    assert attractor_numbers(simulator, states, [], Settling()) == [0, 1, 0, 1]


@pytest.fixture(scope="module")
def merging(symmetric):
    """The crisis at which both merge."""
    found = locate_crisis(symmetric)
    assert isinstance(found, Crisis)
    return found


@pytest.mark.slow
def test_mirror_images_merge_without_a_grazing(merging):
    """Simulated on both sides: before, motion keeps to one side of the symmetric orbit; beyond, as
    many impacts are on either wall."""
    crisis = merging
    assert (crisis.type, crisis.grazing, crisis.after) == ("merging", None, "1:1/C")
    assert crisis.error < 1e-12
    for side in (1e-5, -1e-3):
        simulator = Simulator(crisis.model.replace(s=crisis.value + side))
        for motion in mirror_images(simulator, crisis.orbit):
            run = simulator.run(motion.state, impacts=200_000)
            share = float(np.mean(run.walls == 0))
            assert abs(share - 0.5) > 0.1 if side > 0.0 else abs(share - 0.5) < 0.03
    longer = crisis.path.problem.longer(crisis.path.unknowns, 1, 1)
    again = solve(*longer)
    assert abs(again.unknowns[-1] - crisis.value) <= crisis.error + error_of(again)
    with mp.workdps(30):
        assert_two_connections_meet(crisis)


@pytest.mark.slow
def test_a_curve_of_crises_without_a_grazing(merging):
    """Crises located apart from it lie on it."""
    curve = follow_crisis(merging, "r", (0.49, 0.51))
    assert curve.physical.all()
    assert curve.errors.max() < 1e-12
    model = ImpactPair(beta=0.0, r=0.49, A=5.0, s=0.201)
    orbit = next(o for o in find_orbits(model, "1:1", parameter="s") if o.physical)
    other = locate_crisis(orbit)
    assert isinstance(other, Crisis)
    assert curve.values[0, 1] == 0.49
    assert abs(curve.values[0, 0] - other.value) <= curve.errors[0] + other.error


@pytest.fixture(scope="module")
def interior():
    """Where a window with six bands ends, on the orbit born unstable at the fold it begins with."""
    model = ImpactPair(beta=math.pi / 6, r=0.5, A=5.0, s=0.3502)
    motion = settle(model, Simulator(model).state("B", 0.3, 1.0))
    assert motion.notation == "1:1/6T"
    branch = continue_orbit(motion.orbit(model, "s"), range=(0.34985, 0.3504), events=["FB"])
    ends = [branch.orbit(row) for row in (0, len(branch) - 1)]
    found = locate_crisis(next(o for o in ends if o.multipliers[0].real > 1.0))
    assert isinstance(found, Crisis)
    return found


@pytest.mark.full
def test_an_attractor_widens_in_an_interior_crisis(interior):
    """Simulated on both sides: of twelve impacts each keeps to its band before, and to a sixth of
    the bands beyond."""
    assert (interior.label, interior.type) == ("CR[1:1/C|1:1/6T]", "interior")
    assert (interior.grazing, interior.homoclinic) == (None, True)
    assert interior.error < 1e-12
    assert interior.value < interior.seen < interior.value + 2e-6
    state = None
    for side, least, most in ((1e-6, 0.01, 0.015), (-1e-6, 0.08, 0.1)):
        simulator = Simulator(interior.model.replace(s=interior.value + side))
        motion = settle(simulator, state or simulator.state("B", 0.3, 1.0), Settling(periods=8000))
        run, state = simulator.run(motion.state, impacts=36_000), motion.state
        phases = (run.phases / simulator.period).reshape(-1, 12)
        widths = np.ptp((phases - phases[0] + 0.5) % 1.0, axis=0)
        assert least < widths.max() < most
    longer = interior.path.problem.longer(interior.path.unknowns, 1, 1)
    again = solve(*longer)
    assert abs(again.unknowns[-1] - interior.value) <= interior.error + error_of(again)
    with mp.workdps(30):
        assert_two_connections_meet(interior)


@pytest.fixture(scope="module")
def window():
    """A sweep from a window with six bands out of it, where the orbit beside them is on no branch.

    Its notation is 1:1/C on both sides.
    """
    model = ImpactPair(beta=math.pi / 6, r=0.5, A=5.0, s=0.3502)
    found = sweep(model, "s", [0.3502, 0.34975, 0.3497], start=Simulator(model).state("B", 0.3, 1))
    assert [row.attractor.notation for row in found.rows] == ["1:1/6T", "1:1/C", "1:1/C"]
    return found


@pytest.mark.full
def test_bands_that_become_fewer_show_an_interior_crisis(window, monkeypatch):
    """The orbit asked for is the unstable one born at the window's fold, s = .350359."""
    asked = []
    monkeypatch.setattr(
        "contimpact.diagrams.crises.locate_either",
        lambda orbit, motion, impacts: asked.append(orbit) or NoCrisis("for a reason"),
    )
    (end,) = find_crises(window, Diagram("none", []))
    assert "widens between s = 0.34975 and 0.3497, from bands met after 12 impacts to" in str(end)
    assert "met after 4; no crisis was found of the unstable orbits there: 1:1/6T" in str(end)
    (orbit,) = asked
    assert orbit.multipliers[0].real > 1.0
    branch = continue_orbit(orbit, range=(0.349, 0.351), events=["FB"])
    assert [round(e.value, 6) for e in branch.events] == [0.350359]


@pytest.mark.slow
def test_a_sweep_shows_an_interior_crisis(window):
    """That of `interior`, which is checked by flights in 30 digits."""
    (found,) = find_crises(window, Diagram("none", []))
    assert isinstance(found, Crisis)
    assert (found.label, found.type) == ("CR[1:1/C|1:1/6T]", "interior")
    assert abs(found.value - 0.349735500464764) <= found.error + 4e-13
    assert found.branch is None


@pytest.mark.slow
def test_a_tangency_at_which_no_attractor_changes_is_refused():
    """Counted by a program of its own, 24% of the impacts of 3:1/C are on T on both sides of it."""
    model = ImpactPair(beta=math.pi / 3, r=0.8, A=5.0, s=0.1452)
    orbits = find_orbits(model, "3:1", parameter="s")
    orbit = next(o for o in orbits if o.physical and o.multipliers[0].real > 40.0)
    found = locate_crisis(orbit, Simulator(model).state("B", 0.3, 1.0))
    assert isinstance(found, NoCrisis)
    assert "at 0.145283921176635, no attractor changes: motion beyond passes" in found.reason


MANY = [
    (math.pi / 6, 0.55, "2:1", 7.8314695712292 - 1e-3, 7.83146956969, 7.83146957894),
    (math.pi / 3, 0.6, "2:1", 7.487487501952 - 1e-3, 7.48748749, 7.4874875),
    (math.pi / 6, 0.75, "2:2", 18.69645, 18.69739, 18.697402),
]
"""Before many tangencies: beta, r, the orbit, A; and values of A at which, simulated by a C program
of its own, complex motion lasted 1.2e7, 4.8e7 and 4e7 impacts, and at which it left after 5e6, 8e6
and 3e6."""


def before_many(beta, r, word, start):
    """An orbit and complex motion that ends where it touches the orbit's stable manifold."""
    model = ImpactPair(beta=beta, r=r, A=start, s=0.5)
    orbits = find_orbits(model, word, parameter="A")
    orbit = next(o for o in orbits if o.physical and o.multipliers[0].real > 1.0)
    simulator = Simulator(model)
    starts = [simulator.state("B", 0.3, 0.5), simulator.state("T", 0.2, -0.3)]
    motions = [settle(simulator, state, PATIENT) for state in starts]
    return orbit, next(m for m in motions if m.kind is Kind.COMPLEX)


@pytest.mark.parametrize(
    ("s", "reason", "value", "complex"),
    [
        (0.3945, "motion beyond, at 0.3936", 0.3936, True),
        (0.3934923, "is a transient, too, over in 500000 impacts", 0.39347091, False),
    ],
)
def test_an_attractor_does_not_end_where_it_goes_on_or_has_ended(s, reason, value, complex):
    """At 0.3937902 it was said to end, from motion that had left at 0.39308; and at 0.3934709,
    before which motion leaves in some ten thousand impacts. By bisection with a million impacts at
    each value it ends between 0.3934822 and 0.3934823; it ends before, in transients longer than
    that, where it touches the stable manifold of (4:3)/3T (see the next test)."""
    pair = ImpactPair(beta=0.54, r_B=0.31, r_T=0.28, A=6.0, s=s)
    orbits = find_orbits(pair, "2:1", parameter="s")
    (orbit,) = (o for o in orbits if o.physical and not o.stable)
    found = locate_crisis(orbit)
    assert isinstance(found, NoCrisis)
    assert reason in found.reason
    state = settle(Simulator(pair), Simulator(pair).random_state(11)).state
    there = Simulator(pair.replace(s=value))
    end = there.run(state, impacts=1_000_000).end
    assert (settle(there, end).kind is Kind.COMPLEX) == complex


@pytest.mark.full
@pytest.mark.parametrize(
    ("beta", "r_b", "r_t", "amplitude", "s", "left", "lasts"),
    [
        (0.54, 0.31, 0.28, 6.0, 0.3936, 0.393479, 0.3934835),
        (0.477, 0.295, 0.297, 5.941, 0.4062, 0.405818, 0.4058205),
    ],
)
def test_a_path_may_graze_in_its_lap_beside_the_orbit(beta, r_b, r_t, amplitude, s, left, lasts):
    """Where the stable manifold of 2:1 is crossed before, and no branch has the orbit. Simulated by
    a C program of its own, motion leaves within half a million impacts at the first value, and
    lasts two million at the other one."""
    pair = ImpactPair(beta=beta, r_B=r_b, r_T=r_t, A=amplitude, s=s)
    starts = map(Simulator(pair).random_state, range(20))
    start = next(at for at in starts if settle(pair, at, PATIENT).kind is Kind.COMPLEX)
    (crisis,) = find_crises(sweep(pair, "s", [s, s - 6e-4], start=start), Diagram("none", []))
    assert isinstance(crisis, Crisis)
    assert (crisis.label, crisis.type) == ("CR[1:1/C|(4:3)/3T]", "boundary")
    assert crisis.homoclinic
    assert left < crisis.value < lasts
    with mp.workdps(30):
        again = in_thirty_digits(crisis.connection(), crisis.orbit.parameters, (7, 3), (7, 3))
        assert abs(again - mp.mpf(crisis.value)) <= crisis.error < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize(("beta", "r", "word", "start", "lasts", "left"), MANY)
def test_the_nearest_of_many_tangencies_is_the_crisis(beta, r, word, start, lasts, left):
    orbit, motion = before_many(beta, r, word, start)
    found = approach_crisis(orbit, motion, 40_000, smooth=True)
    assert isinstance(found, Crisis)
    assert (found.type, found.grazing) == ("boundary", None)
    assert lasts < found.value < left
    assert found.value - 2e-7 < found.seen < found.value
    assert found.lasted == 10_000_000


@pytest.mark.slow
def test_motion_that_leaves_before_a_tangency_shows_the_nearer_one():
    """Beyond the crisis and before the tangency: the motion that leaves has its path."""
    beta, r, word, start, lasts, _ = MANY[-1]
    orbit, motion = before_many(beta, r, word, start)
    there = at(orbit, 18.6974789)
    made, run = escape_from(there, settle(there.model, motion.state, PATIENT), 0)
    assert run is not None
    assert 1000 < made < 10_000_000
    entries = entries_of(run, there)
    (side,) = sides_of(entries_of(Simulator(orbit.model).run(motion.state, impacts=40_000), orbit))
    ways = [passage_of(there, run, entry) for entry, far in entries.items() if far * side < 0.0]
    values = [way.unknowns[-1] for way in ways if way is not None]
    assert any(lasts < value < there.value - 1e-6 for value in values)


def assert_two_connections_meet(crisis):
    """By the flights written out: the path's equations have a kernel, so that to second order two
    solutions leave the crisis to one side of s alone."""
    kept, problem = crisis.connection(), crisis.path.problem
    walls, n, last = kept["walls"], 2 * len(kept["walls"]), len(kept["walls"]) - 1
    values = {name: mp.mpf(x) for name, x in crisis.orbit.parameters.items()}
    values["s"] = mp.mpf(crisis.value)
    laps = (
        (0, len(problem.before), problem.before),
        (last - len(problem.after), last, problem.after),
    )

    def flight(z, k):
        ends = (walls[k : k + 1], walls[k + 1], *z[2 * k : 2 * k + 4])
        return np.array(pair_flight(values, "cos(pi*t)", *ends)[0])

    def closing(z):
        return np.array([z[2 * j] - z[2 * i] - 2 * word.period for i, j, word in laps])

    rows = zip(kept["times"], kept["velocities"], strict=True)
    z, step = [mp.mpf(x) for row in rows for x in row], mp.mpf("1e-14")
    flights = [flight(z, k) for k in range(last)]
    assert np.max(np.abs([*np.ravel(flights), *closing(z)])) < 1e-11
    jacobian = np.zeros((n, n))
    for k in range(n):
        moved = [x + step if j == k else x for j, x in enumerate(z)]
        for j in range(max(k // 2 - 1, 0), min(k // 2 + 1, last)):
            change = (flight(moved, j) - flights[j]) / step
            jacobian[2 * j : 2 * j + 2, k] = change.astype(float)
        jacobian[-2:, k] = ((closing(moved) - closing(z)) / step).astype(float)
    singular = np.linalg.svd(jacobian, compute_uv=False)
    assert singular[-1] < 1e-9 * singular[-2]


@pytest.mark.full
def test_refusals():
    for count in (0, 2.5):
        with pytest.raises(InputError, match=rf"impacts: found {count}; give a whole number >= 1"):
            locate_crisis(unstable(0.3556), impacts=count)
    masses = {"system": "two-masses", "parameters": {**TWO_MASSES}}
    given = scene(
        model=masses,
        follow={"parameter": "omega", "range": [1.2, 1.4], "orbits": ["A"], "switch": []},
        detect={"crises": True},
    )
    with pytest.raises(InputError, match=r"detect\.crises.*two-masses"):
        follow(given)
    with pytest.raises(InputError, match=r"located by detect\.crises"):
        scene(detect={"events": ["CR"]})
    assert isinstance(locate_crisis(unstable(0.35)), NoCrisis)  # below the crisis
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.35)
    stable = next(o for o in find_orbits(model, "2:1", parameter="s") if o.stable)
    flipping = find_orbits(model, "1:1", parameter="s")
    orbits = [stable, next(o for o in flipping if o.multipliers[0].real < -1.0)]
    for orbit in orbits:
        with pytest.raises(InputError, match="one multiplier above 1"):
            locate_crisis(orbit)
    with pytest.raises(InputError, match=r"arrives: .*one multiplier outside the unit circle"):
        locate_tangencies(unstable(0.35), stable)
    with pytest.raises(InputError, match="starts: found 0"):
        locate_tangencies(unstable(0.35), starts=0)
    with pytest.raises(InputError, match="arrives: 2:1 at other values"):
        locate_tangencies(unstable(0.35), unstable(0.351))
