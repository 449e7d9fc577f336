"""Proofs of other systems than the impact pair: linear flights of one and of two degrees of
freedom, free fall on a table, an oscillator that comes to rest at its stop."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
import subprocess
import sys

import numpy as np
import pytest
from zoo import ROOT

import contimpact
from contimpact import certify, continue_orbit, find_orbits, load_entries, load_scene
from contimpact.diagrams.explore import follow
from contimpact.models.guards import Word
from contimpact.results.branch import orbit_of
from contimpact.results.catalogue import open_results, write_diagram
from contimpact.results.options import CertifyOptions
from contimpact.results.scene import read_scene
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.two_stops import TwoStops

flint = pytest.importorskip("flint", reason="needs contimpact[certify]")

from contimpact.certificates import zeros  # noqa: E402
from contimpact.certificates import zeros as touches  # noqa: E402
from contimpact.certificates.branch import problem_of, verify_branch  # noqa: E402
from contimpact.certificates.certify import FILE, CertificateLog, verify_results  # noqa: E402
from contimpact.certificates.event import EventCertificate, certify_entry, verify_entry  # noqa: E402
from contimpact.certificates.tube import points_of, scale_of  # noqa: E402

ENTRIES_ALONE = CertifyOptions(branches=False)

KINDS = {
    "bouncing_ball": {"FB", "PD", "G", "V"},
    "stop": {"FB", "PD", "V"},
    "two_stops": {"BP", "PD", "G"},
    "impact_damper": {"BP", "NS"},
}
"""Of the entries that come with the package, by the folder of their scene."""

SMALLER = {
    "bouncing_ball": {"range": (0.008, 0.015), "orbits": (Word("P", 2),), "switch": ()},
    "two_stops": {"range": (0.48, 0.5), "switch": ()},
    "impact_damper": {"range": (19.95, 20.1), "switch": ()},
}
"""A part of each scene."""


@functools.cache
def entries_of(name):
    return load_entries(ROOT / "branches" / name)


@functools.cache
def diagram_of(name):
    whole = load_scene(ROOT / "branches" / name / "scene.toml")
    return follow(dataclasses.replace(whole, **SMALLER[name]))


@functools.cache
def proven(name):
    return contimpact.certify(diagram_of(name))


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.quick(1)
def test_every_entry_is_certified(name):
    few = entries_of(name)[:2] if name == "impact_damper" else entries_of(name)
    found = contimpact.certify(few, options=ENTRIES_ALONE)
    assert found.certified, found
    assert {c.kind for c in found.entries} == KINDS[name]
    assert all(c.certified_radius < 1e-30 for c in found.entries)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["two_masses", "coupled_by_impact", "impact_damper", "soft_stop"])
def test_every_entry_of_more_systems_is_certified(name):
    found = contimpact.certify(entries_of(name), options=ENTRIES_ALONE)
    assert found.certified, found


@pytest.mark.slow
def test_an_impact_at_rest_is_that_of_the_orbit_without_impacts():
    """A grazing of the word 0, seen from a word of one impact; a multiplier is infinite there. The
    orbit itself is physical, and none of its branch is."""
    (entry,) = (e for e in entries_of("two_masses") if e.id == "e22")
    found = certify_entry(entry)
    assert found.certified, found
    assert verify_entry(entry, found).certified
    assert certify_entry(dataclasses.replace(entry, n_unstable=0)).clause == "stability"
    assert not entry.physical
    assert certify_entry(dataclasses.replace(entry, physical=True)).clause == "physicality"


@pytest.mark.full
def test_a_velocity_that_vanishes_leaves_no_impact():
    """Of several coordinates: the multipliers are those of the orbit without impacts."""
    model = load_scene(ROOT / "branches" / "two_masses" / "scene.toml").model
    orbit = find_orbits(model, "A", parameter="omega")[0]
    (entry,) = continue_orbit(orbit, range=(1.6, 1.9), events=["V"]).events
    found = certify_entry(entry)
    assert found.certified, found
    assert certify_entry(dataclasses.replace(entry, n_unstable=1)).clause == "stability"


def test_a_grazing_of_the_orbit_without_impacts_is_certified():
    """It records no impacts: its state is found by a search, and proven."""
    (entry,) = (e for e in entries_of("soft_stop") if not e.word)
    found = certify_entry(entry)
    assert found.certified, found


def test_a_velocity_that_is_zero_outright_is_proven_again():
    """Its ball shrank to 1e-53, which only the inverse matrix of the first proof allowed."""
    pair = ImpactPair(beta="pi/4", r_B=0.45, r_T=0.35, M=0.05, omega=62.8, A=4.0, s=0.03)
    orbits = find_orbits(pair, "1:1", parameter="s")
    branches = [continue_orbit(o, range=(0.02, 0.12), events=("V",)) for o in orbits]
    entries = [entry for branch in branches for entry in branch.events]
    assert len(entries) >= 2
    for entry in entries:
        assert verify_entry(entry, certify_entry(entry)).certified


@pytest.mark.slow
def test_wrong_statements_of_the_orbit_without_impacts_are_rejected():
    (entry,) = (e for e in entries_of("soft_stop") if not e.word)
    assert verify_entry(entry, certify_entry(entry)).certified
    wrong = {
        "value": {"parameters": {**entry.parameters, "omega": entry.value + 1e-9}},
        "ghost": {"ghost": True},
        "stability": {"n_unstable": 1},
        "physicality": {"physical": False},
        "existence": {"touch_time": entry.touch_time + 1e-3},
    }
    for clause, values in wrong.items():
        assert certify_entry(dataclasses.replace(entry, **values)).clause == clause


@pytest.mark.slow
def test_a_contact_that_comes_to_rest_is_no_missing_event():
    """The multipliers' polynomial is zero there for all multipliers."""
    scene = load_scene(ROOT / "branches" / "soft_stop" / "scene.toml")
    diagram = follow(dataclasses.replace(scene, range=(0.7, 2.0)))
    branch = next(branch for branch in diagram.branches if branch.word == "CRCR")
    (found,) = contimpact.certify(branch).branches
    assert not found.refuted
    assert {piece.what for piece in found.unproven} == {
        "flights vanish there, and their multipliers with them"
    }


@pytest.mark.parametrize("name", ["bouncing_ball", "two_stops"])
@pytest.mark.full
def test_branches_are_complete(name):
    found = proven(name)
    assert found.branches
    assert all(branch.complete for branch in found.branches), found


@pytest.mark.slow
def test_branches_of_linear_flights_are_complete_but_where_they_cross():
    scene = load_scene(ROOT / "branches" / "two_stops" / "scene.toml")
    found = contimpact.certify(follow(dataclasses.replace(scene, range=(0.4, 0.5))))
    assert len(found.branches) == 3
    (crossing,) = (c for c in found.entries if c.kind == "BP")
    for branch in found.branches:
        assert not branch.refuted
        assert branch.share > 0.9998
        for piece in branch.unproven:
            assert piece.what == f"branches cross there, at {crossing.id}"
            assert abs(piece.end - piece.start) < 2e-5


@pytest.mark.full
def test_branches_of_two_degrees_of_freedom_are_proven():
    branch = proven("impact_damper").branches[0]
    assert not branch.refuted
    assert branch.complete, branch.lines()


@pytest.mark.full
def test_branches_followed_in_the_frequency_are_complete():
    """The matrices of their flights depend on it; one touch is counted once, whatever cells the
    tube is cut into."""
    scene = load_scene(ROOT / "branches" / "coupled_by_impact" / "scene.toml")
    orbits = find_orbits(scene.model.replace(omega=0.9), "K", parameter="omega")
    orbit = min(orbits, key=lambda one: abs(one.velocities[0] - 2.05))
    branch = continue_orbit(orbit, range=(0.899, 0.904), events=["FB", "PD", "G"])
    (found,) = certify(branch).branches
    assert found.complete, found.lines()
    assert list(found.events) == [event.id for event in branch.events]
    assert [event.kind for event in branch.events] == ["G"]


@pytest.mark.slow
def test_tubes_meet_beside_a_crossing():
    """Their bounds at the nodes are far wider there than the distance of an orbit from the node."""
    scene = load_scene(ROOT / "branches" / "impact_damper" / "scene.toml")
    short = dataclasses.replace(
        scene, model=scene.model.replace(d=16.5), range=(16.0, 17.0), switch=()
    )
    found = contimpact.certify(follow(short))
    (crossing,) = (c for c in found.entries if c.kind == "BP")
    for piece in (piece for branch in found.branches for piece in branch.unproven):
        assert piece.what == f"branches cross there, at {crossing.id}"
        assert abs(piece.end - piece.start) < 1e-4


def test_sizes_of_unknowns_are_those_of_the_whole_branch():
    """In the middle of the table one passes through zero, and has no size there."""
    model = load_scene(ROOT / "branches" / "two_masses" / "scene.toml").model
    orbit = find_orbits(model, "A", parameter="omega")[0]
    branch = continue_orbit(orbit, range=(1.7, 1.9), events=())
    problem = problem_of(branch, None, None)
    points = points_of(branch, problem)
    found, span = scale_of(problem, points), np.ptp(points[:, -1])
    assert all((found >= problem.scale(z, span)).all() for z in points)
    assert np.min(np.abs(points[:, 2])) < 0.25 * found[2]


@pytest.mark.full
def test_long_flights_take_few_cells(monkeypatch):
    """A ball that flies over two periods: rates enclosed on a whole flight are far too large."""
    diagram, calls = diagram_of("bouncing_ball"), []
    real = touches.FlightCoordinate.local

    def counted(self, s, *more, **how):
        calls.append(s)
        return real(self, s, *more, **how)

    monkeypatch.setattr(touches.FlightCoordinate, "local", counted)
    (branch,) = contimpact.certify(diagram).branches
    assert len(calls) < 150 * branch.tubes  # 4700 of them when tubes were cut first


# It can fail.


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.quick(2)
def test_wrong_statements_are_rejected_where_they_are(name):
    entries = entries_of(name)[: 3 if name == "bouncing_ball" else 1]
    assert entries
    for entry in entries:
        shifted = {**entry.parameters, entry.parameter: entry.value + 1e-9}
        wrong = dataclasses.replace(entry, parameters=shifted)
        assert certify_entry(wrong).clause in ("value", "existence")
        assert certify_entry(dataclasses.replace(entry, ghost=not entry.ghost)).clause == "ghost"
        more = dataclasses.replace(entry, n_unstable=entry.n_unstable + 1)
        assert certify_entry(more).clause == "stability"


@pytest.mark.full
def test_deleted_and_invented_events_are_found():
    diagram, found = diagram_of("bouncing_ball"), proven("bouncing_ball")
    certificates = {c.id: c for c in found.entries}
    deleted = 0
    for branch, record in zip(diagram.branches, found.branches, strict=True):
        for gone in [e for e in branch.events if e.kind in record.kinds]:
            deleted += 1
            others = [e for e in branch.events if e.id != gone.id]
            (piece,) = verify_branch(branch, record, others, certificates).missing
            low, high = sorted((piece.start, piece.end))
            assert low - 1e-3 <= gone.value <= high + 1e-3
            away = {**gone.parameters, gone.parameter: 0.999 * gone.value}
            invented = dataclasses.replace(gone, id="e99", parameters=away)
            assert not certify_entry(invented).certified
    assert deleted == 2


def test_a_determinant_is_the_same_by_pivots_and_by_minors():
    rng = np.random.default_rng(1)
    numbers = rng.normal(size=(6, 6, 3))
    rows = [[flint.arb_series(c.tolist(), prec=3) for c in row] for row in numbers]
    one = zeros._determinant_by_pivots([list(row) for row in rows])
    other = zeros._determinant_by_minors(rows)
    assert all(one[j].overlaps(other[j]) for j in range(3))
    assert float(other[0].mid()) == pytest.approx(np.linalg.det(numbers[:, :, 0]))
    rows[0][0] = rows[0][0] - rows[0][0][0]
    assert zeros._determinant_by_pivots([list(row) for row in rows]) is None
    numbers[0, 0, 0] = 0.0
    exact = np.linalg.det(numbers[:, :, 0])
    assert float(zeros._determinant_by_minors(rows)[0].mid()) == pytest.approx(exact)


# Kinds.


def swinging(omega):
    """Orbits of an oscillator with negative damping, whose multipliers' product passes one."""
    model = Oscillator(a=1.0, omega=omega, c=-0.05, k=1.0, sigma=0.0, r=0.8)
    return find_orbits(model, "S", parameter="r")[0]


def test_a_neimark_sacker_bifurcation_is_certified():
    """For one degree of freedom the product is r^2 exp(-cT) wherever the orbit is."""
    (entry,) = continue_orbit(swinging(2.2), range=(0.7, 1.0), events=["NS"]).events
    found = certify_entry(entry)
    assert found.certified, found
    period = 2 * flint.arb.pi() / flint.arb(2.2)
    exact = (flint.arb(-0.05) * period / 2).exp()
    assert flint.arb(found.parameter).overlaps(exact)


@pytest.mark.full
def test_a_neutral_saddle_is_no_neimark_sacker_bifurcation():
    near = math.exp(-0.05 * math.pi / 3.1)
    branch = continue_orbit(swinging(3.1), range=(0.7, 1.0), events=["UZ"], values={"r": [near]})
    (entry,) = branch.events
    assert abs(complex(*entry.multipliers[0]).imag) == 0.0
    found = certify_entry(dataclasses.replace(entry, kind="NS", requested=None, error=1e-12))
    assert (found.clause, "no complex pair" in str(found.found)) == ("existence", True)


def test_branches_that_pass_each_other_are_no_branch_point():
    """The equations of a branch point have a solution there, too, in which something unfolds it."""
    (entry,) = (e for e in entries_of("two_stops") if e.kind == "BP")
    assert certify_entry(entry).certified
    apart = {**entry.parameters, "b": 1e-13}
    found = certify_entry(dataclasses.replace(entry, parameters=apart))
    assert found.clause == "crossing"
    assert "e-1" in str(found.found)


def test_a_branch_point_of_the_impact_pair_is_certified():
    """Its period is a number, and no expression."""
    (orbit, *_) = find_orbits(ImpactPair(beta=0.0, r=0.5, A=5.0, s=0.42), "1:1", parameter="s")
    (entry,) = continue_orbit(orbit, range=(0.4, 0.45), events=["BP"]).events
    assert certify_entry(entry).certified


@functools.cache
def grazing_on_both_sides():
    """A branch of symmetric orbits that touch both stops at once."""
    model = TwoStops(a=1.0, omega=1.0, c=0.1, k=0.0, sigma=0.22, r=0.7)
    orbits = find_orbits(model, "1:1", parameter="sigma")
    branches = (continue_orbit(o, range=(0.2, 0.25), events=["G"]) for o in orbits)
    return next(found for found in branches if found.events)


def test_touches_that_come_at_once_by_a_symmetry_are_certified():
    one, other = grazing_on_both_sides().events
    assert one.value == pytest.approx(other.value, abs=1e-14)
    assert {one.wall, other.wall} == {"R", "L"}
    assert certify_entry(one).certified


@pytest.mark.full
def test_only_a_symmetry_tells_that_touches_come_at_once(monkeypatch):
    branch = grazing_on_both_sides()
    found = certify(branch)
    assert found.certified
    assert found.branches[0].complete
    monkeypatch.setattr(TwoStops, "symmetry", lambda *_: None)
    assert certify_entry(branch.events[0]).clause == "physicality"


@pytest.mark.slow
def test_a_flight_without_duration_is_certified():
    """Both masses hit their stops at once."""
    model = load_scene(ROOT / "branches" / "two_masses" / "scene.toml").model
    orbits = find_orbits(model.replace(omega=1.5), "AB/2T", parameter="sigma_2")
    events = [
        entry
        for orbit in orbits
        for entry in continue_orbit(orbit, range=(0.05, 3.0), events=["T", "NS"]).events
    ]
    assert {entry.kind for entry in events} == {"T", "NS"}
    for entry in events:
        assert certify_entry(entry).certified, entry


# Damage.


@pytest.mark.parametrize(
    ("values", "clause"),
    [
        ({"error": float("nan")}, "value"),
        ({"error": None}, "entry"),
        ({"flight": 7}, "entry"),
        ({"wall": "Q"}, "existence"),
        ({"impacts": []}, "entry"),
    ],
)
def test_a_damaged_entry_is_rejected(values, clause):
    (entry,) = (e for e in entries_of("bouncing_ball") if e.id == "e1")
    assert certify_entry(dataclasses.replace(entry, **values)).clause == clause


@pytest.mark.parametrize("bits", [-5, 0, 2, 10**9])
def test_a_certificate_of_no_precision_is_rejected(bits):
    (entry,) = (e for e in entries_of("bouncing_ball") if e.id == "e1")
    record = certify_entry(entry)
    assert verify_entry(entry, record).certified
    assert verify_entry(entry, dataclasses.replace(record, bits=bits)).clause == "bits"


@pytest.mark.parametrize(
    ("key", "value"), [("nodes", []), ("boxes", []), ("nodes", [[1.0]]), ("kinds", [])]
)
def test_a_damaged_certificate_of_a_branch_proves_nothing(key, value, tmp_path):
    diagram, found = diagram_of("bouncing_ball"), proven("bouncing_ball")
    write_diagram(diagram, tmp_path)
    record = {**found.branches[0].record(), key: value}
    content = {**found.record(), "branches": [record, *(b.record() for b in found.branches[1:])]}
    (tmp_path / FILE).write_text(json.dumps(content))
    told = verify_results(open_results(tmp_path)).branches[0]
    assert not told.complete
    assert told.kinds == ()
    damaged = ["certificate is damaged" in piece.what for piece in told.unproven]
    assert damaged == [True] * (key != "kinds")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["fig7", "fig8"])
def test_figures_are_proven(name):
    """Every branch, those of six and eight impacts among them."""
    found = contimpact.certify(follow(load_scene(ROOT / "branches" / name / "scene.toml")))
    assert found.certified, found
    assert all(branch.complete for branch in found.branches), found
    assert all(c.certified_radius < 1e-30 for c in found.entries)


def test_a_damaged_row_of_an_interrupted_proof_is_proven_again(tmp_path):
    path = tmp_path / "certificates.jsonl"
    CertificateLog(path, "key").add(certify_entry(entries_of("bouncing_ball")[1]))
    row = {"of": "EventCertificate", "certificate": {"id": "e9"}}
    with path.open("a") as file:
        file.write(json.dumps(row) + '\n{"of": "Event')
    kept = CertificateLog(path, "key")
    assert kept.get(EventCertificate, "e2").certified
    assert kept.get(EventCertificate, "e9") is None


def test_without_the_extra_python_says_what_to_install():
    code = "import sys; sys.modules['flint'] = None; import contimpact; contimpact.certify('out')"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert "pip install contimpact[certify]" in told.stderr


@pytest.mark.full
def test_a_number_beside_another_is_another_system():
    """What a law, a set, a guard or a matrix says is proven to the last digit that stands there."""
    given = {
        "system": "hybrid",
        "period": "2*pi/w",
        "parameters": {"w": 2.33, "d": 0.05, "r": 0.8},
        "modes": {"f": {"x": "v", "v": "cos(w*t) - 0.1*v - 0.66666667*x"}},
        "guards": {"S": {"within": "0.7*x <= d", "set": {"v": "-r*v"}}},
    }
    asked = {"parameter": "d", "range": [-0.3, 0.4], "orbits": ["S"]}
    scene = read_scene(
        {"name": "n", "model": given, "follow": asked, "detect": {"events": ["PD", "V"]}}
    )
    pd, v = (next(e for e in follow(scene).events if e.kind == kind) for kind in ("PD", "V"))
    assert certify_entry(pd).certified
    assert certify_entry(v).certified
    for entry, old, new in [
        (pd, '"-r*v"', '"-r*v*1.00000000001"'),
        (pd, "0.66666667*x", "2*x/3"),
        (v, "0.66666667*x", "0.66666667001*x"),
        (v, "0.1*v", "0.10000000001*v"),
        (v, "(d)/(0.7)", "(d)/(0.70000000001)"),
    ]:
        machine = entry.options["machine"]
        assert old in machine
        other = dataclasses.replace(entry, options={"machine": machine.replace(old, new)})
        assert certify_entry(other).clause in ("value", "existence"), (old, new)


@pytest.mark.parametrize("unit", [1e9, 1e-6])
def test_events_are_certified_in_any_unit_of_the_parameter(unit):
    """Boxes were as wide as 1e-12 at least, whatever the unit, and a flight whose frequency counts
    millions was said to turn by millions of radians."""
    model = {"system": "linear", "coordinates": ["x"], "mass": [1], "damping": [0.1]}
    model |= {"stiffness": [1], "force": ["cos(u*q*t)"], "period": "2*pi/(u*q)"}
    model |= {"guards": {"R": {"within": "x <= 0.4", "restitution": 0.7}}}
    model |= {"parameters": {"u": unit, "q": 1.7 / unit}}
    limits = 1.7 / unit, 1.95 / unit
    follow = {"parameter": "q", "range": list(limits), "orbits": ["R"]}
    scene = read_scene({"name": "in other units", "model": model, "follow": follow})
    orbits = find_orbits(scene.model, "R", parameter="q", starts=16)
    events = continue_orbit(orbits[0], range=limits, events=["PD", "FB"]).events
    assert {event.kind for event in events} == {"PD", "FB"}
    for event in events:
        here = orbit_of(event, scene.model).linearisation
        found = certify_entry(event, lambda here=here: here)
        assert found.certified, found
        assert verify_entry(event, found, lambda here=here: here).certified
