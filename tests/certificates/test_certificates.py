"""What a catalogue records is proven, and what is wrong in it is rejected, exactly there."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
from zoo import ROOT, harmonic_pair, scene

import contimpact
from contimpact import InputError, certify, continue_orbit, find_orbits, load_scene
from contimpact.cli import main
from contimpact.diagrams.explore import follow
from contimpact.results.catalogue import open_results, write_diagram
from contimpact.results.options import CertifyOptions

flint = pytest.importorskip("flint", reason="needs contimpact[certify]")

from contimpact.certificates import tube  # noqa: E402
from contimpact.certificates.branch import problem_of, verify_branch  # noqa: E402
from contimpact.certificates.certify import (  # noqa: E402
    FILE,
    CertificateLog,
    certify_results,
    verify_results,
    write_certificates,
)
from contimpact.certificates.equations import BallProblem  # noqa: E402
from contimpact.certificates.event import certify_entry  # noqa: E402
from contimpact.certificates.tube import nodes_of, points_of, scale_of  # noqa: E402

ENTRIES_ALONE = CertifyOptions(branches=False)


@pytest.fixture(scope="module")
def diagram():
    """1:1 of Fig. 7 from the range's end through its fold and back: a grazing, a doubling, FB."""
    return follow(scene(follow={"switch": []}))


@pytest.fixture(scope="module")
def proven(diagram):
    return contimpact.certify(diagram)


def changed(diagram, place, **values):
    """The diagram with an entry of its first branch changed."""
    branch = diagram.branches[0]
    events = list(branch.events)
    parameters = {**events[place].parameters, **values.pop("parameters", {})}
    events[place] = dataclasses.replace(events[place], parameters=parameters, **values)
    return dataclasses.replace(diagram, branches=[dataclasses.replace(branch, events=events)])


def with_events(diagram, events):
    branch = dataclasses.replace(diagram.branches[0], events=events)
    return dataclasses.replace(diagram, branches=[branch])


def test_every_entry_is_certified_to_rounding_of_its_precision(diagram, proven):
    assert proven.certified
    assert [c.kind for c in proven.entries] == ["G", "PD", "FB"]
    for entry, c in zip(diagram.entries, proven.entries, strict=True):
        assert c.bits == 128
        assert c.certified_radius < 1e-30
        value = flint.arb(c.parameter)
        assert abs(value - entry.value) < entry.error


@pytest.mark.parametrize("bits", [512, 1024])
def test_an_entry_is_certified_with_many_bits(diagram, bits):
    for entry in diagram.entries:
        record = certify_entry(entry, bits=bits, most=bits)
        assert record.certified
        assert record.certified_radius < 2.0 ** (60 - bits)


def test_the_branch_is_complete(proven):
    (branch,) = proven.branches
    assert branch.complete
    assert branch.kinds == ("FB", "PD", "G")
    assert sorted(branch.events) == ["e1", "e2", "e3"]
    assert branch.share == 1.0
    assert branch.tubes < 60


def test_certified_values_are_those_of_thirty_digits(diagram, proven):
    """Another arithmetic, and another method."""
    from contimpact.accuracy.reference import Reference
    from contimpact.results.branch import details_of, orbit_of

    for entry, c in zip(diagram.entries, proven.entries, strict=True):
        orbit = orbit_of(entry)
        reference = Reference(orbit.problem, 40)
        unknowns = orbit.linearisation.unknowns
        exact = reference.event(entry.kind, unknowns, details_of(entry))
        with flint.ctx.workprec(200):
            digits = flint.arb(str(exact.parameter))
            assert abs(flint.arb(c.parameter) - digits) < 1e-35


def test_a_branch_whose_time_is_over_says_what_is_left(diagram, proven):
    found = contimpact.certify(diagram, options=CertifyOptions(seconds=1e-9))
    assert found.certified
    (branch,) = found.branches
    (piece,) = branch.unproven
    assert piece.what == "not proven within 1e-09 s; more are given by seconds in [certify]"
    values = diagram.branches[0]["s"]
    assert (piece.start, piece.end) == (values[0], values[-1])
    assert (branch.complete, branch.share, branch.strange) == (False, 0.0, ())
    assert {c.id: c.verdict for c in found.entries} == {c.id: c.verdict for c in proven.entries}


# It can fail.


def rejections(diagram, options=ENTRIES_ALONE):
    found = contimpact.certify(diagram, options=options)
    return {c.id: c.clause for c in found.rejected}


@pytest.mark.parametrize("place", range(3))
def test_a_shifted_value_is_rejected_there(diagram, place):
    entry = diagram.entries[place]
    shifted = changed(diagram, place, parameters={"s": entry.value + 1e-9})
    assert rejections(shifted) == {entry.id: "value"}


def test_a_shifted_velocity_is_rejected_there(diagram):
    entry = diagram.entries[1]
    impacts = [dict(impact) for impact in entry.impacts]
    impacts[1]["velocity"] += 3e-9
    assert rejections(changed(diagram, 1, impacts=impacts)) == {"e2": "impacts"}


@pytest.mark.parametrize(
    ("values", "clause"),
    [
        ({"ghost": False}, "ghost"),
        ({"stable": True}, "stable"),
        ({"n_unstable": 0}, "stability"),
        ({"physical": False}, "physicality"),
        ({"label": "G[1:1->2:1]"}, "label"),
        ({"touch_time": 0.9}, "existence"),
    ],
)
def test_a_wrong_statement_is_rejected_there(diagram, values, clause):
    assert rejections(changed(diagram, 0, **values)) == {"e1": clause}


@pytest.mark.full
def test_a_flipped_flag_is_no_gap_of_the_branch(diagram, proven):
    """The event is there, and its entry says where: only what it says of its orbit is rejected."""
    flipped = changed(diagram, 0, ghost=False)
    (branch,) = flipped.branches
    certificates = {e.id: certify_entry(e) for e in flipped.entries}
    assert certificates["e1"].clause == "ghost"
    found = verify_branch(branch, proven.branches[0], branch.events, certificates)
    assert found.complete


@pytest.mark.full
def test_an_entry_of_other_parameters_does_not_count(diagram, proven):
    other = changed(diagram, 1, parameters={"g": 9.8 * (1.0 + 2.0**-52)})
    (branch,) = other.branches
    certificates = {c.id: c for c in proven.entries}
    found = verify_branch(branch, proven.branches[0], branch.events, certificates)
    assert [piece.what.split(" near")[0] for piece in found.missing] == [
        "a zero of the test function of PD"
    ]


@pytest.mark.full
def test_a_deleted_event_is_missing_there(diagram, proven):
    for gone in diagram.entries:
        events = [entry for entry in diagram.entries if entry.id != gone.id]
        certificates = {c.id: c for c in proven.entries if c.id != gone.id}
        branch = diagram.branches[0]
        found = verify_branch(branch, proven.branches[0], events, certificates)
        assert found.refuted
        (piece,) = found.missing
        low, high = sorted((piece.start, piece.end))
        assert low - 1e-3 <= gone.value <= high + 1e-3
        assert sorted(found.events) == sorted(certificates)


def test_an_event_whose_entry_is_not_certified_is_not_missing(diagram, proven):
    """Its zero may be the entry's: what is said to be missing is in no entry."""
    (branch,) = diagram.branches
    certificates = {c.id: c for c in proven.entries}
    for entry in diagram.entries:
        rejected = dataclasses.replace(
            certificates[entry.id], verdict="rejected", clause="existence"
        )
        known = {**certificates, entry.id: rejected}
        found = verify_branch(branch, proven.branches[0], branch.events, known)
        assert not found.refuted
        assert not found.complete
        (piece,) = found.unproven
        assert piece.what.endswith(f"not told from {entry.id}, not certified")


def test_an_invented_event_is_rejected_there(diagram):
    for place, away in ((0, 0.01), (1, 0.02), (2, -0.05)):
        entry = diagram.entries[place]
        parameters = {**entry.parameters, "s": entry.value + away}
        invented = dataclasses.replace(entry, id="e9", parameters=parameters)
        assert set(rejections(with_events(diagram, [*diagram.entries, invented]))) == {"e9"}


def test_an_event_recorded_twice_is_rejected_once(diagram):
    twin = dataclasses.replace(diagram.entries[1], id="e9")
    assert rejections(with_events(diagram, [*diagram.entries, twin])) == {"e9": "twice"}


def test_an_event_of_another_branch_is_not_on_this_one(diagram):
    """An orbit on the branch, but at no event of its kind: the doubling's, called a fold."""
    called = dataclasses.replace(diagram.entries[1], kind="FB", id="e9")
    assert set(rejections(with_events(diagram, [*diagram.entries, called]))) == {"e9"}


def test_no_tube_leads_from_one_branch_to_another(diagram):
    """From one side of the fold to the other: both ends are orbits of the word."""
    branch = diagram.branches[0]
    with flint.ctx.workprec(80):
        problem = problem_of(branch, None, None)
        points = points_of(branch, problem)
        scale = scale_of(problem, points)
        nodes = nodes_of(problem, points, scale)
        values = points[:, -1]
        turn = int(np.argmax(values))
        first = turn // 2
        other = turn + int(np.argmin(np.abs(values[turn:] - values[first])))
        space = BallProblem(problem, 80)
        near = tube.Segment(space, nodes[first], nodes[first + 1], scale)
        across = tube.Segment(space, nodes[first], nodes[other], scale)
        assert tube.prove_tube(near) is not None
        assert tube.prove_tube(across) is None


# Files and doors.


@pytest.fixture
def folder(diagram, tmp_path):
    write_diagram(diagram, tmp_path)
    return tmp_path


@pytest.mark.full
def test_the_folder_is_certified_and_verified(folder, capsys):
    assert main(["certify", str(folder), "-q"]) == 0
    catalogue = json.loads((folder / "catalogue.json").read_text())
    assert all(0.0 < e["certified_radius"] < 1e-30 for e in catalogue["entries"])
    assert all(e.certified_radius < 1e-30 for e in contimpact.load_entries(folder))
    record = json.loads((folder / FILE).read_text())
    assert record["schema"] == "contimpact.certificates/1"
    assert [b["complete"] for b in record["branches"]] == [True]
    assert main(["certify", "--verify", str(folder)]) == 0
    assert "3 of 3 entries certified" in capsys.readouterr().out
    assert sorted(p.name for p in folder.glob("certificates*")) == [FILE]


@pytest.mark.parametrize("key", ["box", "inner"])
def test_a_forged_box_is_found(folder, key):
    options = CertifyOptions(branches=False)
    results = open_results(folder)
    write_certificates(results, certify_results(results, options))
    record = json.loads((folder / FILE).read_text())
    record["entries"][1][key][0] = "[0.25 +/- 1e-9]"
    (folder / FILE).write_text(json.dumps(record))
    found = verify_results(open_results(folder))
    assert {c.id: c.clause for c in found.rejected} == {"e2": "existence"}


@pytest.mark.parametrize(
    ("name", "key", "claim"),
    [(FILE, "certified_radius", 0.0), (FILE, "kind", "FB"), ("catalogue.json", None, 1e-60)],
)
def test_a_certificate_that_claims_more_than_it_proves_is_found(folder, name, key, claim):
    """A radius, or a kind, that a proof does not give was confirmed."""
    results = open_results(folder)
    write_certificates(results, certify_results(results, CertifyOptions(branches=False)))
    record = json.loads((folder / name).read_text())
    record["entries"][1][key or "certified_radius"] = claim
    (folder / name).write_text(json.dumps(record))
    found = verify_results(open_results(folder))
    assert (found.rejected, found.unconfirmed, found.certified) == ([], ["e2"], False)
    assert "e2: its stored certificate says more than that" in found.lines()


def test_a_table_of_events_changed_afterwards_is_found(folder):
    results = open_results(folder)
    write_certificates(results, certify_results(results, CertifyOptions(branches=False)))
    verified = verify_results(open_results(folder))
    assert (verified.table, verified.certified) == ("", True)
    text, table = (folder / "events.csv").read_text(), folder / "events.csv"
    table.write_text(text.replace("e2,PD,0", "e2,PD,1"))
    found = verify_results(open_results(folder))
    assert (found.rejected, found.certified) == ([], False)
    assert found.lines()[-1] == "e2: ghost is '1' in events.csv, '0' in the catalogue"
    table.write_text("\n".join(text.splitlines()[:-1]))
    found = verify_results(open_results(folder))
    assert found.table == "events.csv has 2 rows, the catalogue 3 entries"
    table.unlink()
    assert verify_results(open_results(folder)).certified


@pytest.mark.parametrize("factor", [100.0, 1e-8])
@pytest.mark.full
def test_a_forged_tube_is_found(folder, proven, factor, capsys):
    """Its piece is unproven, and that its certificate says otherwise is a failure."""
    record = json.loads(json.dumps(proven.record()))
    record["branches"][0]["boxes"][3] = [factor * x for x in record["branches"][0]["boxes"][3]]
    (folder / FILE).write_text(json.dumps(record))
    found = verify_results(open_results(folder))
    assert (found.rejected, found.refuted, found.unconfirmed) == ([], [], ["b1"])
    (piece,) = found.branches[0].unproven
    assert piece.what == "no tube is proven"
    assert main(["certify", "--verify", str(folder)]) == 1
    assert "b1: its stored certificate says more than that" in capsys.readouterr().out


def test_a_certificate_of_a_branch_that_is_not_there_is_found(folder, proven):
    (folder / FILE).write_text(json.dumps(proven.record()))
    catalogue = json.loads((folder / "catalogue.json").read_text())
    (folder / "catalogue.json").write_text(json.dumps({**catalogue, "branches": []}))
    found = verify_results(open_results(folder))
    assert (found.rejected, found.unconfirmed, found.certified) == ([], ["b1"], False)


def test_a_catalogue_changed_afterwards_is_found(folder):
    results = open_results(folder)
    write_certificates(results, certify_results(results, CertifyOptions(branches=False)))
    catalogue = json.loads((folder / "catalogue.json").read_text())
    catalogue["entries"][2]["parameters"]["s"] += 1e-9
    catalogue["entries"][0]["ghost"] = False
    (folder / "catalogue.json").write_text(json.dumps(catalogue))
    found = verify_results(open_results(folder))
    assert {c.id: c.clause for c in found.rejected} == {"e1": "ghost", "e3": "value"}


def test_an_interrupted_proof_goes_on(folder, monkeypatch):
    """What is kept is not proven again; rows of another catalogue are not used."""
    from contimpact.certificates import certify as doors

    whole = certify_results(open_results(folder), ENTRIES_ALONE)
    path, calls = folder / "certificates.jsonl", []
    real = certify_entry

    def counted(entry, *given):
        calls.append(entry.id)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return real(entry, *given)

    monkeypatch.setattr(doors, "certify_entry", counted)
    with pytest.raises(KeyboardInterrupt):
        certify_results(open_results(folder), ENTRIES_ALONE, keep=True)
    assert path.exists()
    found = certify_results(open_results(folder), ENTRIES_ALONE, keep=True)
    assert calls == ["e1", "e2", "e3", "e3"]
    assert [tuple(c.inner) for c in found.entries] == [tuple(c.inner) for c in whole.entries]
    assert not path.exists()
    assert CertificateLog(path, "of another").rows == {}


def test_an_interruption_says_where_what_was_proven_is(folder, monkeypatch, capsys):
    from contimpact.certificates import certify as doors

    def interrupted(entry, *given):
        if entry.id == "e2":
            raise KeyboardInterrupt
        return certify_entry(entry, *given)

    monkeypatch.setattr(doors, "certify_entry", interrupted)
    assert main(["certify", str(folder), "-q"]) == 1
    said = (
        f"what was proven is in {folder / 'certificates.jsonl'}; the same command goes on from it"
    )
    assert said in capsys.readouterr().err


def test_without_the_extra_the_command_says_what_to_install(folder, monkeypatch, capsys):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert main(["certify", str(folder)]) == 2
    assert "pip install contimpact[certify]" in capsys.readouterr().err


# Other parameters, other kinds, another system.


@pytest.mark.full
def test_a_doubling_and_a_grazing_that_nearly_coincide_are_told_apart():
    """beta = pi/9, r = 0.2955: their values differ by less than 1e-4."""
    parameters = {"beta": "pi/9", "r": 0.2955, "A": 5.0, "s": 0.34}
    model = {"system": "impact-pair", "parameters": parameters}
    near = follow(scene(model=model, follow={"switch": []}))
    found = contimpact.certify(near)
    assert found.certified
    assert [branch.complete for branch in found.branches] == [True]
    values = {c.kind: flint.arb(c.parameter) for c in found.entries}
    recorded = {e.kind: e.value for e in near.entries}
    assert abs(recorded["PD"] - recorded["G"]) < 1e-3
    assert (values["PD"] > values["G"]) == (recorded["PD"] > recorded["G"])


@pytest.mark.full
def test_other_kinds_are_certified():
    """V, T and UZ, on 2:1."""
    events = ["FB", "PD", "G", "V", "T", "UZ"]
    values = {"d": [0.15], "s": [0.3]}
    asked = scene(
        model={"parameters": {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.34}},
        follow={"orbits": ["2:1"], "switch": []},
        detect={"events": events, "values": values},
    )
    found = contimpact.certify(follow(asked), options=ENTRIES_ALONE)
    assert {c.id: (c.clause, c.found) for c in found.rejected} == {}
    assert {"V", "UZ", "G", "FB", "PD"} <= {c.kind for c in found.entries}


@pytest.mark.full
def test_the_oscillator_is_certified():
    oscillator = {
        "name": "stop",
        "model": {
            "system": "oscillator",
            "parameters": {"a": 1.0, "omega": 2.6, "c": 0.1, "k": 1.0, "sigma": 0.0, "r": 0.8},
        },
        "follow": {"parameter": "omega", "range": [2.5, 2.9], "orbits": ["S"], "switch": []},
        "detect": {"events": ["FB", "PD", "G"]},
    }
    diagram = follow(contimpact.read_scene(oscillator))
    found = contimpact.certify(diagram)
    assert found.entries
    assert found.certified, found
    assert [b.complete for b in found.branches] == [True] * len(found.branches)


@pytest.mark.full
def test_a_branch_born_at_a_doubling_is_complete_from_there_on():
    """1:1/2T of Fig. 7, whose equations are singular where it begins."""
    born = follow(scene(follow={"switch": ["PD"], "depth": 1}))
    doubled = next(branch for branch in born.branches if branch.notation == "1:1/2T")
    (certificate,) = contimpact.certify(doubled).branches
    assert certificate.complete, certificate.lines()
    assert certificate.start == pytest.approx(0.3831434883431645, abs=1e-12)
    gone = [entry for entry in doubled.events if entry.kind != "PD"]
    certificates = {entry.id: certify_entry(entry) for entry in doubled.events}
    found = verify_branch(doubled, certificate, gone, certificates)
    assert len(found.missing) == 1
    assert "PD" in found.missing[0].what


# Scenes and reports.


def test_a_scene_says_what_is_proven():
    asked = scene(certify={"bits": 200, "branches": False}).certify
    assert asked == CertifyOptions(200, 512, False, ("FB", "PD", "G"))
    assert scene().certify is None
    left = " ".join(scene(certify={}).left_out())
    assert "[certify] is for contimpact certify alone" in left
    assert scene(certify={"seconds": 5}).certify.seconds == 5.0
    wrong = ({"bits": 10}, {"bits": 256, "max_bits": 128}, {"digits": 30}, {"seconds": 0})
    for table in wrong:
        with pytest.raises(contimpact.InputError, match="certify"):
            scene(certify=table)


@pytest.mark.full
def test_the_report_says_what_proofs_cost(diagram):
    from contimpact.accuracy.report import _proof_table
    from contimpact.accuracy.report import measure_certificates as measured

    assert measured(scene(), diagram, lambda text: None) is None
    asked = scene(certify={}, follow={"switch": [], "range": [0.3, 0.5]})
    found = measured(asked, follow(asked), lambda text: None)
    assert found["certified"] == found["entries"] == 2
    assert found["per_entry"]["low"] > 0.0
    assert all(b["complete"] and b["per_tube"] > 0.0 for b in found["branches"])
    assert "seconds per tube" in "\n".join(_proof_table(found))


# Many parameter sets.


def random_scene(seed):
    """1:1 and 2:1 of an impact pair with random parameters."""
    rng = np.random.default_rng(seed)
    parameters = {
        "beta": float(rng.uniform(0.05, 1.2)),
        "r": float(rng.uniform(0.1, 0.9)),
        "A": float(rng.uniform(3.0, 12.0)),
        "s": float(rng.uniform(0.2, 0.6)),
    }
    follows = {"range": [0.1, 1.0], "orbits": ["1:1", "2:1"], "switch": []}
    return scene(model={"parameters": parameters}, follow=follows)


@pytest.mark.slow
def test_random_parameter_sets_are_proven():
    sets = entries = branches = 0
    for seed in range(100):
        try:
            diagram = follow(random_scene(seed))
        except contimpact.InputError:  # neither orbit at the start
            continue
        found = contimpact.certify(diagram)
        assert found.certified, (seed, found)
        assert all(branch.complete for branch in found.branches), (seed, found)
        sets, entries = sets + 1, entries + len(found.entries)
        branches += len(found.branches)
    assert sets > 80
    assert entries > 500
    assert branches > 300


@pytest.mark.full
def test_what_has_no_enclosures_is_refused_at_once():
    waves = [(k, 1.0 / k, 0.0) for k in range(1, 20)]
    model = harmonic_pair(waves, beta=0.2, r=0.6, A=4.0, s=0.4)
    orbit = find_orbits(model, "BT", parameter="A")[0]
    branch = continue_orbit(orbit, range=(3.9, 4.1), events=())
    with pytest.raises(InputError, match="sums over more than eight harmonics"):
        certify(branch)


def test_a_scene_is_run_and_certified(tmp_path, capsys):
    """As contimpact run would print it, and then its proofs."""
    text = (ROOT / "branches" / "fig7" / "scene.toml").read_text("utf-8")
    parameters = text[text.index("[model]") : text.index("[follow]")].replace("0.34", "0.39")
    follow = 'parameter = "s"\nrange = [0.38, 0.4]\norbits = ["1:1"]\n'
    (tmp_path / "pd.toml").write_text(f'name = "pd"\n{parameters}[follow]\n{follow}')
    given = ["certify", str(tmp_path / "pd.toml"), "-o", str(tmp_path / "out"), "--no-plot"]
    assert main(given) == 0
    said = capsys.readouterr().out
    assert "0.383143488 to 0.4 " in said
    assert "1 of 1 entry certified" in said
    assert "b1 BT/1T: complete" in said
    assert not (tmp_path / "out" / "diagram.png").exists()
    assert main([*given, "-q"]) == 0
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("name", ["pendulum", "duffing"])
def test_integrated_flights_are_refused_before_anything_is_run(name, tmp_path, capsys):
    """With the package that integrates, and without."""
    folder = ROOT / "branches" / name
    refusal = "its flights are integrated; proofs are for linear flights and closed forms"
    assert main(["certify", str(folder / "scene.toml"), "-o", str(tmp_path / "out")]) == 2
    assert f"system {name}: {refusal}" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    with pytest.raises(InputError, match=refusal):
        certify(contimpact.load_entries(folder))


def test_orbits_without_impacts_are_left_out_with_a_reason():
    model = load_scene(ROOT / "branches" / "soft_stop" / "scene.toml").model
    orbit = find_orbits(model, "0", parameter="omega")[0]
    branch = continue_orbit(orbit, range=(1.98, 2.02), events=())
    (found,) = certify(branch).branches
    assert [piece.what for piece in found.unproven] == [
        "proofs along branches are for orbits with impacts"
    ]
