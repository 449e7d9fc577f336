"""Which attractors there are along a parameter: from branches, from simulation, and from both."""

from __future__ import annotations

import csv
import importlib.util
import json
import math
import shutil
from dataclasses import replace

import numpy as np
import pytest
from zoo import ROOT

import contimpact as ci
from contimpact.cli import main
from contimpact.diagrams.crises import add_crises
from contimpact.diagrams.crisis_location import Crisis, locate_crisis
from contimpact.diagrams.ranges import attractor_ranges, load_ranges
from contimpact.errors import InputError
from contimpact.plots.maps import plot_ranges
from contimpact.results.branch import model_at
from contimpact.results.catalogue import Share, write_diagram
from contimpact.results.diagram import Diagram
from contimpact.simulation.settle import settle
from contimpact.simulation.simulator import Simulator
from contimpact.simulation.sweep import Row, Sweep, sweep
from contimpact.systems.impact_pair import ImpactPair

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

STILL = ("0", "no impact")
PAIR = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.4)


@pytest.fixture(scope="module")
def fig7():
    return load_ranges(ROOT / "branches/fig7")


@pytest.fixture(scope="module")
def diagram():
    return ci.load_diagram(ROOT / "branches/fig7")


def names(found):
    return [[one.motion.notation for one in r.observed] for r in found.ranges]


def test_branches_and_simulation_are_one_answer(fig7):
    assert names(fig7) == [
        [],
        ["inf:1, 6:1, 5:1, 4:1"],
        ["3:1"],
        ["2:1", "3:1"],
        ["2:1"],
        ["2:1", "1:1/C"],
        ["1:1/C"],
        ["1:1/2T"],
        ["1:1"],
    ]
    chaos = fig7.at(0.36).observed[0].motion
    assert (chaos.branch, chaos.high.entry) == (None, "e7")
    assert chaos.low.value == pytest.approx(0.355203, abs=1e-6)
    assert chaos.low.error < 1e-6
    fold = fig7.at(0.33).observed[0].motion.high
    assert (fold.entry, fold.text) == ("e4", "FB e4")
    assert fold.value == pytest.approx(0.35689527700013085, abs=1e-12)
    assert any("from 0.2217 to 0.4016 only" in note for note in fig7.notes)
    assert any("not surveyed" in note for note in fig7.notes)


@pytest.mark.slow
def test_what_simulation_from_random_starts_meets_is_listed(fig7):
    """At values apart from those of the sweep, and from starts of its own."""
    rng = np.random.default_rng(5)
    for value in (0.2792, 0.3, 0.3561, 0.362, 0.375, 0.39):
        simulator = Simulator(PAIR.replace(s=value))
        listed = {one.motion.notation for one in fig7.at(value).observed}
        met = set()
        for _ in range(25):
            time, speed = rng.uniform(0.0, 2.0), rng.uniform(0.1, 1.0)
            met.add(settle(simulator, simulator.state("B", time, speed)).notation)
        assert met <= listed, value


def test_without_simulation_complex_motion_is_not_known(diagram):
    found = attractor_ranges(diagram)
    assert found.at(0.36).observed == []
    assert "nothing was simulated" in found.notes[-1]
    assert "0.356895277 to 0.365318559: no attractor is known" in repr(found)
    assert repr(found.at(0.36)) == "0.356895277 to 0.365318559: no attractor is known"


def test_what_an_interruption_left_out_is_not_passed_over(tmp_path, diagram, capsys):
    until = "following b3, 2:1: 7 points"
    write_diagram(replace(diagram, statistics={"stopped": until}), tmp_path)
    for options in ([], ["--at", "0.3"]):
        assert main(["range", str(tmp_path), *options]) == 0
        assert f"ended early ({until})" in capsys.readouterr().out
    assert not any("ended early" in note for note in attractor_ranges(diagram).notes)
    first = replace(diagram.branches[0], events=diagram.branches[0].events[:1])
    write_diagram(replace(diagram, branches=[first], statistics={"stopped": until}), tmp_path)
    commands = [["plot", "-o", str(tmp_path / "all.svg")]]
    if importlib.util.find_spec("flint"):
        commands += [["certify"], ["certify", "--verify"]]
    for command in commands:
        main([command[0], str(tmp_path), *command[1:]])
        assert f"ended early ({until}): branches and events may" in capsys.readouterr().err


@pytest.mark.full
def test_the_crisis_is_the_end_of_the_complex_motion(diagram):
    rows = sweep(PAIR, "s", np.arange(0.3562, 0.3546, -0.0002).tolist())
    unstable = next(
        o for o in ci.find_orbits(PAIR.replace(s=0.3554), "2:1", "s") if o.physical and not o.stable
    )
    crisis = locate_crisis(unstable)
    assert isinstance(crisis, Crisis)
    with_crisis = add_crises(diagram, [replace(crisis, branch="b2")])
    chaos = attractor_ranges(with_crisis, rows).at(0.356).observed[-1].motion
    assert chaos.low.value == pytest.approx(0.355220528250598985, abs=1e-12)
    assert chaos.low.text.startswith("CR[1:1/C|2:1] e")
    assert chaos.low.error < 1e-9


def test_speeds_are_those_of_the_orbits(fig7):
    """Interpolated between points, against the orbit solved at the value."""
    motion = fig7.at(0.5).observed[0].motion
    orbit = next(o for o in ci.find_orbits(PAIR.replace(s=0.5), "1:1", "s") if o.stable)
    assert motion.speed(0.5, 0.5) == pytest.approx(np.max(np.abs(orbit.velocities)), rel=1e-3)
    assert motion.speed(0.5, 0.6) > motion.speed(0.5, 0.5)


def test_speeds_of_two_stable_stretches_of_one_branch_are_told_apart():
    """Two orbits 2:2 of the soft stop are stable there, the second slower by a quarter."""
    found = load_ranges(ROOT / "branches/soft_stop")
    value, branch = 0.70286, ci.load_diagram(ROOT / "branches/soft_stop")["b3"]
    mine = [one.motion for one in found.at(value).observed if one.motion.branch == "b3"]
    known = []
    for rows in (slice(21, 24), slice(37, 64)):
        values, speeds = branch[branch.parameter][rows], np.abs(branch.velocities[rows]).max(axis=1)
        order = np.argsort(values)
        known.append(float(np.interp(value, values[order], speeds[order])))
    assert [motion.speed(value, value) for motion in mine] == pytest.approx(known, rel=1e-12)
    assert known[1] < 0.8 * known[0]


def test_a_simulated_attractor_counts_for_the_stretch_it_lies_on():
    """Of the two orbits 2:2 of the soft stop, motions come to the slower one."""
    diagram = ci.load_diagram(ROOT / "branches/soft_stop")
    model = model_at(diagram["b3"], 22).replace(omega=0.70286)
    (attractor,) = ci.find_attractors(model, 1)
    sweep = Sweep(model, "omega", [Row("random", 0.70286, attractor)])
    found = ci.attractor_ranges(diagram, sweep)
    counts = {m.speed(0.70286, 0.70286): m.simulated for m in found.motions if m.branch == "b3"}
    assert [counts[speed] for speed in sorted(counts)] == [1, 0]
    assert np.abs(attractor.velocities).max() == pytest.approx(min(counts), rel=1e-3)


def test_how_far_the_ends_are(fig7):
    distance, end = fig7.at(0.356).observed[0].motion.nearest(0.356)
    assert distance == pytest.approx(0.35689527700013085 - 0.356, abs=1e-12)
    assert end.text == "FB e4"
    assert "nearest end 0.0008953 above, at 0.356895277: FB e4" in fig7.describe(0.356)
    with pytest.raises(InputError, match=r"give one from 0\.08 to"):
        fig7.at(2.0)


@pytest.mark.full
def test_an_attractor_is_there_at_its_ends(fig7):
    """At s = 0.2217 the sweep ends, and no branch is stable below it."""
    for motion in fig7.motions:
        for end in (motion.low, motion.high):
            assert fig7.at(end.value).observed
    assert fig7.describe(0.2217).startswith("s = 0.2217: one attractor\n  inf:1, 6:1, 5:1, 4:1,")


def test_fractions_belong_to_motions(diagram):
    shares = [Share(0.356, "2:1", 0.37), Share(0.356, "1:1/C", 0.63), Share(0.5, "1:1", 1.0)]
    rows = sweep(PAIR, "s", [0.36, 0.358, 0.3565, 0.356, 0.3555])
    found = attractor_ranges(diagram, rows, fractions=shares)
    parts = {one.motion.notation: one.fractions for one in found.at(0.356).observed}
    assert parts == {"2:1": (0.37, 0.37), "1:1/C": (0.63, 0.63)}
    assert found.at(0.5).observed[0].fractions == (1.0, 1.0)
    assert found.at(0.3).observed[0].fractions is None
    shares[1:2] = [Share(0.356, "1:1/C", 0.6), Share(0.356, "(8:6)/6T", 0.03, word="B" * 14)]
    found = attractor_ranges(diagram, rows, fractions=shares)
    assert found.at(0.356).observed[1].fractions == (0.6, 0.6)
    assert any("3 % of starts lead to (8:6)/6T, on no branch" in note for note in found.notes)
    shares[1:3] = [Share(0.356, "1:1/C", 0.63)]
    missed = attractor_ranges(diagram, fractions=[*shares, Share(0.5, "3:3", 0.02)]).notes
    assert "s = 0.5: 2 % of starts lead to 3:3, on no branch and in no sweep" in missed
    assert "s = 0.356: 63 % of starts lead to 1:1/C, on no branch and in no sweep" in missed
    assert "2:1 on b2 (37 % of starts)" in repr(found)


@pytest.mark.full
def test_motion_lasts_as_far_as_random_starts_have_met_it(diagram):
    """The sweep steps over the fold of 2:1 at 0.356895 and the crisis at 0.355220."""
    rows = sweep(PAIR, "s", [0.36, 0.3575, 0.355])
    low = attractor_ranges(diagram, rows).at(0.3575).observed[-1].motion.low
    assert low.text == "FB e4, where simulation has it"
    met = [Share(0.3565, "1:1/C", 0.6), Share(0.3565, "2:1", 0.4)]
    low = attractor_ranges(diagram, rows, fractions=met).at(0.3575).observed[-1].motion.low
    assert low.text == "simulated between 0.355 and 0.3565"


def test_motion_that_a_step_of_the_sweep_leaves_lasts_until_its_end(diagram):
    """Its end, located with smaller steps, lies beyond the value at which the sweep has 2:1."""
    rows = sweep(PAIR, "s", [0.362, 0.36, 0.35, 0.34, 0.33])
    brackets = [(0.345, 0.3449, "1:1/C"), (0.335, 0.334, "2:1"), (0.37, 0.371, "1:1/C")]
    found = attractor_ranges(diagram, rows, brackets=brackets)
    motion = found.at(0.361).observed[-1].motion
    assert motion.notation == "1:1/C"
    assert motion.low.text == "simulated between 0.3449 and 0.345"
    assert [one.motion.notation for one in found.at(0.347).observed] == ["2:1", "1:1/C"]


def test_fractions_belong_to_the_branches_of_their_orbits(diagram):
    orbits = ci.find_orbits(PAIR.replace(s=0.33), "2:1", "s")
    orbit = next(o for o in orbits if o.stable and o.physical)
    share = Share(0.33, "2:1", 1.0, word="BBT", period=1, time=orbit.times[0] + 2.0)
    own, other = (share._replace(velocity=orbit.velocities[0] + off) for off in (0.0, 1e-3))
    assert attractor_ranges(diagram, fractions=[own]).at(0.33).observed[0].fractions == (1.0, 1.0)
    found = attractor_ranges(diagram, fractions=[other])
    assert found.at(0.33).observed[0].fractions == (0.0, 0.0)
    assert "s = 0.33: 100 % of starts lead to 2:1, on no branch and in no sweep" in found.notes


def test_a_closed_branch_has_no_end_where_it_was_begun():
    """1:0 of two masses is a loop, followed from omega = 1.8."""
    found = load_ranges(ROOT / "branches/two_masses")
    texts = [end.text for m in found.motions for end in (m.low, m.high)]
    assert not any("closed" in text for text in texts)
    (loop,) = (m for m in found.motions if m.notation == "1:0")
    assert loop.low.value < 1.8 < loop.high.value


def test_orbits_born_at_a_pitchfork_end_there():
    """Beyond it, the branch goes on as its own mirror image."""
    found = load_ranges(ROOT / "branches/two_stops")
    assert "the mirror images of 1:1 on b3 are attractors, too, and not listed" in found.notes
    (born,) = (motion for motion in found.motions if motion.branch == "b3")
    assert (born.high.entry, born.high.text) == ("e1", "BP e1")
    assert born.high.error > 0.0


def test_branches_at_other_values_of_a_second_parameter_are_no_attractors_here():
    diagram = ci.load_diagram(ROOT / "branches/fig6_s")
    first = diagram.branches[0]
    own = {b.id for b in diagram.branches if b["r"][0] == first["r"][0]}
    assert len(own) < len(diagram.branches)
    found = attractor_ranges(diagram)
    assert {motion.branch for motion in found.motions} <= own
    left = len(diagram.branches) - len(own)
    assert f"branches at r = 0.5 alone; {left} others left out" in found.notes
    still = ci.ImpactPair(beta=0.3, r=0.5, A=5.0, s=0.5)
    (note,) = (n for n in attractor_ranges(diagram, sweep(still, "A", [5.0])).notes if "left" in n)
    assert (
        note
        == f"branches at the values of the sweep alone; {len(diagram.branches)} others left out"
    )
    told = str(diagram.reading)
    assert " at r = 0.5\n" in told


def test_refusals():
    with pytest.raises(InputError, match="no attractor"):
        attractor_ranges(Diagram("empty", []))
    diagram = ci.load_diagram(ROOT / "branches/fig7")
    others = sweep(PAIR, "r", [0.3, 0.31])
    with pytest.raises(InputError, match="parameters r, s"):
        attractor_ranges(diagram, others)
    assert attractor_ranges(diagram, Sweep(PAIR, "s", [])).motions


@pytest.mark.full
def test_the_command(capsys, tmp_path):
    assert main(["range", str(ROOT / "branches/fig7"), "--at", "0.356"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("s = 0.356: 2 attractors\n  2:1 on b2; impacts at up to 0.6378\n")
    assert printed.endswith("simulated from 0.2217 to 0.4016 only\n")
    table = tmp_path / "ranges.csv"
    assert main(["range", str(ROOT / "branches/fig7"), "-o", str(table)]) == 0
    head, *lines = table.read_text(encoding="utf-8").splitlines()
    assert json.loads(head[2:])["schema"] == "contimpact.ranges/1"
    rows = list(csv.DictReader(lines))
    assert [row["branch"] for row in rows if float(row["low"]) < 0.356 < float(row["high"])] == [
        "b2",
        "",
    ]
    assert main(["range", str(tmp_path / "none")]) == 2
    assert "give a folder made by contimpact run" in capsys.readouterr().err


def test_bars(fig7):
    ax = plot_ranges(fig7)
    assert [label.get_text() for label in ax.get_yticklabels()][:3] == [
        "inf:1, 6:1, 5:1, 4:1",
        "3:1",
        "2:1",
    ]
    assert len(ax.patches) == len(fig7.motions)


def test_bars_of_one_notation_that_overlap_are_in_rows_of_their_own():
    orbits = ci.find_orbits(PAIR.replace(s=0.5), "1:1", parameter="s")
    orbit = next(o for o in orbits if o.stable and o.physical)
    ranges = ((0.4, 0.8), (0.45, 0.9))
    branches = [
        ci.continue_orbit(orbit, range=limits, events=(), name=f"b{k}")
        for k, limits in enumerate(ranges, 1)
    ]
    ax = plot_ranges(attractor_ranges(Diagram("two", branches)))
    assert [label.get_text() for label in ax.get_yticklabels()] == ["1:1", "1:1"]
    assert sorted(bar.get_y() + bar.get_height() / 2 for bar in ax.patches) == [0.0, 1.0]


@pytest.mark.parametrize("name", ["fig7", "two_masses", "stiff"])
def test_attractors_in_a_file_are_matched_with_branches(tmp_path, name):
    """Without coverage.json, as after an interruption, what lies on branches is not listed twice.

    Motions without impacts are the exception: their rows do not say where they are, and a note
    does.
    """
    shipped = ROOT / "branches" / name
    folder = shutil.copytree(shipped, tmp_path / name)
    expected = load_ranges(folder)
    next((folder / "simulation").glob("coverage.json*")).unlink()

    def listed(found):
        return [
            (m.notation, m.branch, m.simulated) for m in found.motions if m.notation not in STILL
        ]

    found = load_ranges(folder)
    assert listed(found) == listed(expected)
    still = any(not branch.word for branch in ci.load_diagram(folder).branches)
    assert any("listed twice: simulate" in note for note in found.notes) is still
    assert not any("listed twice: simulate" in note for note in expected.notes)
