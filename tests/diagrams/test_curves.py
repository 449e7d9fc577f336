"""Curves in two parameters against closed forms and one-parameter runs."""

from __future__ import annotations

import dataclasses
import math
import tomllib
from types import SimpleNamespace

import numpy as np
import pytest
from zoo import ROCKING_BLOCK, ROOT, between_soft_stops

from contimpact.bifurcations.codimension_two import TouchSingular
from contimpact.continuation.branch import EndKind
from contimpact.diagrams import curves
from contimpact.diagrams.curve_problem import _event_place
from contimpact.diagrams.curves import LeavingEnd, follow_curve
from contimpact.diagrams.explore import follow
from contimpact.diagrams.map_lines import same_curve
from contimpact.diagrams.orbit_branch import continue_born, continue_orbit
from contimpact.diagrams.shorter_orbits import RepetitionTest
from contimpact.errors import InputError
from contimpact.models.guards import Word
from contimpact.orbits.quiet import problem_of
from contimpact.orbits.search import find_orbits, orbit_at
from contimpact.results.branch import details_of
from contimpact.results.catalogue import load_diagram, load_entries, write_diagram
from contimpact.results.curve import CheckedOrbit, real_heights, regions
from contimpact.results.scene import read_scene
from contimpact.segments.kernels import Kernels
from contimpact.systems.belt import Belt
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

EDGES = (0.05, 0.95)


def entry_of(model, word, parameter, limits, kind, events=("FB", "BP", "PD", "G"), which=0):
    orbits = [o for o in find_orbits(model, word, parameter=parameter) if o.physical]
    branch = continue_orbit(orbits[0], range=limits, events=events)
    return [e for e in branch.events if e.kind == kind][which]


def rows_at(curve, values):
    second = curve.parameters[1]
    rows = [int(np.argmin(np.abs(curve[second] - value))) for value in values]
    np.testing.assert_allclose(curve[second][rows], values, rtol=0, atol=1e-12)
    return rows


def fold_of_symmetric_pair(r):
    return np.sqrt(((1 + r) / ((1 - r) * np.pi)) ** 2 + 4 / np.pi**4)


def breaking_of_symmetric_pair(r):
    root = np.sqrt(4 * (1 + r) ** 2 + np.pi**2 * (1 - r) ** 2)
    return 2 * (1 + r) / root * (0.5 - 2 / np.pi**2)


@dataclasses.dataclass
class Place:
    """A point of a curve at a value of the parameter, as an evaluation of itself."""

    arclength: float
    left: float = 0.0
    multipliers: tuple = ()
    resting: tuple = ()

    def __post_init__(self):
        kernels = SimpleNamespace(parameter="s")
        self.evaluation = SimpleNamespace(
            problem=SimpleNamespace(orbit=SimpleNamespace(kernels=kernels)),
            parameter=lambda name: self.arclength,
            own=(),
            orbit=SimpleNamespace(
                multipliers=np.array(self.multipliers),
                resting=self.resting,
                unknowns=(),
                problem=SimpleNamespace(
                    impacts=lambda unknowns: np.array([[0.0, 1.0], [1.0, 0.0]])
                ),
            ),
        )


def test_a_walk_ends_before_a_limit_that_is_passed_and_not_located():
    """As where the touch of a grazing reaches an impact at rest: the equations are singular."""
    test = SimpleNamespace(kind="touch", values=lambda point: np.array([1.0, point.left]))
    limits = {EndKind.TOUCH: test}
    kind = SimpleNamespace(
        curve_limits=lambda: limits, curve_end=lambda own: None, is_on_circle=lambda here: True
    )
    policy = LeavingEnd(kind, [])
    within, beyond = Place(0.1, 0.2), Place(0.2, -0.1)
    assert policy.accepted(within, []) is None
    end, last = policy.accepted(beyond, [])
    assert (end.kind, end.value, last) == (EndKind.TOUCH, 0.1, within)
    assert "0.1, or up to a step beyond: that place is not located" in end.message
    assert LeavingEnd(kind, []).accepted(beyond, []) is None  # where it begins on the limit


@pytest.mark.parametrize("last", [{"multipliers": (-1.2, 0.5)}, {"resting": (1,)}])
def test_a_curve_ends_where_its_orbits_lose_the_multiplier(last, monkeypatch):
    """A curve of PD of a soft stop continued along that of the V at which the contact vanishes."""
    kind = SimpleNamespace(
        curve_limits=dict,
        curve_end=lambda own: None,
        is_on_circle=lambda here: -1.0 in here.multipliers and not here.resting,
    )
    monkeypatch.setattr(curves, "leaves_no_trace", lambda here: False)
    policy = LeavingEnd(kind, [])
    at_rest, within = Place(0.0, resting=(1,), multipliers=(-1.0,)), Place(0.1, multipliers=(-1.0,))
    assert policy.accepted(at_rest, []) is None  # where it begins at a V
    assert policy.accepted(within, []) is None
    end, place = policy.accepted(Place(0.2, **{"multipliers": (-1.0,)} | last), [])
    assert (end.kind, end.value, place) == (EndKind.VANISHED, 0.1, within)
    monkeypatch.setattr(curves, "leaves_no_trace", lambda here: True)
    end, place = LeavingEnd(kind, []).accepted(at_rest, [])  # as of a contact
    assert (end.kind, end.value, place) == (EndKind.VANISHED, 0.0, at_rest)


@pytest.mark.full
def test_symmetric_fold_curve():
    """d_FB(r) reaches 12.4 at r = 0.95: errors relative to it are 1e-15 or so."""
    wanted = np.linspace(*EDGES, 19)
    model = ImpactPair(beta=0.0, r=0.3, A=5.0, s=0.6)
    entry = entry_of(model, "1:1", "s", (0.1, 25.0), "FB")
    curve = follow_curve(model, entry, "r", (0.05, 25.0), EDGES, values=wanted)
    rows = rows_at(curve, wanted)
    np.testing.assert_allclose(curve["d"][rows], fold_of_symmetric_pair(wanted), rtol=0, atol=1e-11)


@pytest.mark.full
def test_symmetric_branch_point_curve():
    wanted = np.linspace(*EDGES, 19)
    model = ImpactPair(beta=0.0, r=0.3, A=5.0, s=0.6)
    entry = entry_of(model, "1:1", "s", (0.1, 2.0), "BP")
    curve = follow_curve(model, entry, "r", (0.05, 2.0), EDGES, values=wanted)
    rows = rows_at(curve, wanted)
    exact = breaking_of_symmetric_pair(wanted)
    np.testing.assert_allclose(curve["d"][rows], exact, rtol=0, atol=1e-11)


@pytest.mark.full
def test_a_branch_point_unfolds_with_the_angle():
    """Along beta the crossing of branches does not persist: the curve ends and says so."""
    model = ImpactPair(beta=0.0, r=0.3, A=5.0, s=0.6)
    entry = entry_of(model, "1:1", "s", (0.1, 2.0), "BP")
    curve = follow_curve(model, entry, "beta", (0.05, 2.0), (-0.5, 0.5))
    assert {end.kind.name for end in curve.ends} == {"UNFOLDED"}


@pytest.mark.parametrize("kind", ["FB", "PD"])
def test_bouncing_ball(kind):
    """The 1:0 word with the top far away: Gamma = 1/gbar against its closed forms."""
    wanted = np.linspace(0.1, 0.9, 9)
    model = ImpactPair(beta=math.pi / 2, r=0.5, A=1.6, s=40.0)
    entry = entry_of(model, "1:0", "A", (0.1, 8.0), kind, events=("FB", "PD"))
    curve = follow_curve(model, entry, "r", (0.1, 8.0), (0.1, 0.9), values=wanted)
    rows = rows_at(curve, wanted)
    fold = np.pi * (1 - wanted) / (1 + wanted)
    exact = fold
    if kind == "PD":
        exact = np.sqrt(fold**2 + (2 * (1 + wanted**2) / (1 + wanted) ** 2) ** 2)
    np.testing.assert_allclose(1 / curve["gbar"][rows], exact, rtol=0, atol=1e-10)


@pytest.mark.full
def test_grazing_curve_of_the_oscillator():
    """The steady response touches the stop at sigma = a/sqrt((k - w^2)^2 + (c w)^2)."""
    wanted = [0.7, 0.9, 1.1, 1.4]
    model = Oscillator(a=0.3, omega=1.0, c=0.3, k=1.0, sigma=0.8, r=0.8)
    orbit = next(o for o in find_orbits(model, "1", parameter="sigma") if o.physical)
    branch = continue_orbit(orbit, range=(0.1, 2.0), events=("V",))
    entry = branch.events[0]
    curve = follow_curve(model, entry, "omega", (0.05, 2.0), (0.6, 1.5), values=wanted)
    rows = rows_at(curve, wanted)
    w = np.array(wanted)
    exact = 0.3 / np.sqrt((1 - w**2) ** 2 + (0.3 * w) ** 2)
    np.testing.assert_allclose(curve["sigma"][rows], exact, rtol=0, atol=1e-12)


ANGLES = {name: n * math.pi / 18 for name, n in (("pi/18", 1), ("pi/6", 3), ("pi/2", 9))}


def agreement(beta, count, seed):
    """Largest difference in d between curves and one-parameter runs at random r."""
    base = {"beta": beta, "A": 5.0, "s": 0.4}
    wanted = np.sort(np.random.default_rng(seed).uniform(0.1, 0.9, count))
    worst = 0.0
    model = ImpactPair(r=0.5, **base)
    orbit = next(o for o in find_orbits(model, "1:1", parameter="s") if o.physical)
    entries = continue_orbit(orbit, range=(0.03, 1.2), events=("PD", "G")).events
    for entry in (e for e in entries if e.physical):
        curve = follow_curve(
            model, entry, "r", (0.03, 1.2), (0.05, 0.95), values=wanted, detect=False
        )
        for r, row in zip(wanted, rows_at(curve, wanted), strict=True):
            there = ImpactPair(r=float(r), **base)
            found = find_orbits(there, "1:1", parameter="s", starts=64)
            events = [
                e
                for o in found
                for e in continue_orbit(o, range=(0.03, 1.2), events=(entry.kind,)).events
            ]
            worst = max(worst, min(abs(e.parameters["d"] - curve["d"][row]) for e in events))
    return worst


@pytest.mark.parametrize("name", ANGLES)
@pytest.mark.full
def test_curves_agree_with_one_parameter_runs(name):
    assert agreement(ANGLES[name], 4, seed=1) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("n", [1, 2, 3, 4, 6, 7, 9])
def test_curves_agree_with_one_parameter_runs_at_fifty_values(n):
    assert agreement(n * math.pi / 18, 50, seed=n) < 1e-9


@pytest.mark.parametrize(
    ("beta", "d", "r"),
    [(math.pi / 9, 0.205889307, 0.295513665), (math.pi / 6, 0.229925231, 0.185725166)],
)
@pytest.mark.full
def test_doubling_meets_grazing(beta, d, r):
    """Located on both curves, and confirmed by one-parameter runs on either side."""
    model = ImpactPair(beta=beta, r=0.5, A=5.0, s=0.4)
    orbit = next(o for o in find_orbits(model, "1:1", parameter="s") if o.physical)
    entries = continue_orbit(orbit, range=(0.1, 1.2), events=("PD", "G")).events
    points = {}
    for entry in (e for e in entries if e.physical):
        curve = follow_curve(model, entry, "r", (0.05, 1.2), (0.05, 0.9))
        points |= {p.kind: p.parameters for p in curve.points if p.kind in ("PD-G", "G-PD")}
    assert set(points) == {"PD-G", "G-PD"}
    for name in ("d", "r"):
        assert abs(points["PD-G"][name] - points["G-PD"][name]) < 1e-11
    assert points["PD-G"]["d"] == pytest.approx(d, abs=1e-8)
    assert points["PD-G"]["r"] == pytest.approx(r, abs=1e-8)
    # d_PD - d_G from two runs vanishes, by linear interpolation, where the curves cross
    step, at = 1e-5, points["PD-G"]
    gaps = [difference(beta, at["r"] + sign * step) for sign in (-1, 1)]
    assert gaps[0] < 0.0 < gaps[1]
    crossing = at["r"] - step + 2 * step * gaps[0] / (gaps[0] - gaps[1])
    assert crossing == pytest.approx(at["r"], abs=1e-8)


def difference(beta, r):
    model = ImpactPair(beta=beta, r=r, A=5.0, s=0.4)
    orbit = next(o for o in find_orbits(model, "1:1", parameter="s") if o.physical)
    events = continue_orbit(orbit, range=(0.1, 1.2), events=("PD", "G")).events
    values = {kind: [e.parameters["d"] for e in events if e.kind == kind] for kind in ("PD", "G")}
    return min((p - g for p in values["PD"] for g in values["G"]), key=abs)


def fig6(**curves):
    return read_scene(
        {
            "name": "f",
            "model": {
                "system": "impact-pair",
                "parameters": {"beta": "pi/6", "r": 0.5, "A": 5.0, "s": 0.4},
            },
            "follow": {"parameter": "s", "range": [0.03, 1.2], "orbits": ["1:1"]},
            "detect": {"events": ["FB", "PD", "G"]},
            "numerics": {"starts": 32},
            "curves": {"parameter": "r", "range": [0.05, 0.9], "kinds": ["PD", "G"], **curves},
        }
    )


@pytest.fixture(scope="module")
def panel():
    return follow(fig6(family={"beta": ["pi/18", "pi/9", "pi/6", "pi/3"]}))


@pytest.mark.full
def test_competition_map(panel):
    found = {}
    for region in regions(panel.curves, "d"):
        found.setdefault(round(region.fixed["beta"] * 18 / math.pi), []).append(region)
    assert [r.first for r in found[1]] == ["G[1:1->2:1]", "PD"]
    assert [r.first for r in found[3]] == ["G[1:1->2:1]", "PD"]
    assert found[3][0].high == pytest.approx(0.185725166, abs=1e-8)
    assert [r.first for r in found[6]] == ["PD"]


@pytest.mark.full
def test_no_region_is_a_crossing_found_on_both_curves(panel):
    assert all(region.high - region.low > 1e-6 for region in regions(panel.curves, "d"))


def test_ghosts_change_where_the_curves_cross(panel):
    """PD is a ghost below the crossing, the grazing above it."""
    crossed = []
    for curve in panel.curves:
        crossing = [p.parameters["r"] for p in curve.points if p.kind in ("PD-G", "G-PD")]
        if not crossing:
            continue
        away = np.abs(curve["r"] - crossing[0]) > 1e-6
        below = curve["r"] < crossing[0]
        expected = below if curve.kind == "PD" else ~below
        assert np.array_equal(curve.ghost[away], expected[away])
        crossed.append(curve.kind)
    assert crossed == ["G", "PD"] * 3


def test_curves_solve_their_equations(panel):
    for curve in panel.curves:
        assert np.max(curve["residual"]) < 1e-12
        assert np.all(np.diff(curve["arclength"]) >= 0.0)
        assert not curve.missed
        product = curve["multiplier1_re"] * curve["multiplier2_re"]
        product -= curve["multiplier1_im"] * curve["multiplier2_im"]
        np.testing.assert_allclose(product, curve["r"] ** 4, rtol=1e-6)
        if curve.kind == "PD":
            nearest = np.minimum(
                np.abs(curve["multiplier1_re"] + 1), np.abs(curve["multiplier2_re"] + 1)
            )
            assert np.max(nearest) < 1e-9


def test_effort_against_a_scan(panel):
    """Curves cost less than a tenth of fifty one-parameter runs for each angle.

    Flights evaluated; the search for the first orbits is left out on both sides, once here and
    fifty times there.
    """
    counts = panel.statistics["counts"]
    scene = fig6()
    found = find_orbits(scene.model, "1:1", parameter="s", starts=32)
    one_run = 0
    for orbit in found:
        before = orbit.problem.kernel_evaluations
        continue_orbit(orbit, range=scene.range, events=scene.events, settings=scene.settings)
        one_run = max(one_run, orbit.problem.kernel_evaluations - before)
    spent = counts["curve_kernel_evaluations"] + counts["family_kernel_evaluations"]
    spent += len(found) * one_run
    assert len({tuple(c.fixed.items()) for c in panel.curves}) == 4
    assert 4 * 50 * one_run > 10 * spent


def test_a_curve_starts_from_a_saved_catalogue(tmp_path, panel):
    write_diagram(panel, tmp_path)
    entry = next(e for e in load_entries(tmp_path) if e.kind == "PD")
    model = ImpactPair(beta=0.0, r=0.5, A=5.0, s=0.4)  # values come from the entry
    curve = follow_curve(model, entry, "r", (0.03, 1.2), (0.05, 0.9), values=[0.5])
    known = next(c for c in panel.curves if c.origin == entry.id)
    np.testing.assert_allclose(curve["s"][[0, -1]], known["s"][[0, -1]], rtol=0, atol=1e-11)


@pytest.mark.parametrize(("parameter", "limits"), [("r", (0.0, 1.0)), ("beta", (0.0, math.pi / 2))])
@pytest.mark.full
def test_curves_end_with_a_reason_at_the_edges(parameter, limits):
    model = ImpactPair(beta=math.pi / 6, r=0.5, A=5.0, s=0.4)
    orbit = next(o for o in find_orbits(model, "1:1", parameter="s") if o.physical)
    events = continue_orbit(orbit, range=(0.03, 1.2), events=("FB", "PD", "G", "V")).events
    kinds = set()
    for entry in events:
        curve = follow_curve(model, entry, parameter, (0.03, 1.2), limits)
        kinds |= {end.kind.name for end in curve.ends}
        assert all(end.message for end in curve.ends)
    assert "RANGE" in kinds
    assert kinds <= {"RANGE", "TOUCH", "CLOSED"}


def test_a_curve_of_orbits_run_twice_does_not_end_by_rounding():
    """BP of the doubled orbit is PD of the orbit, all along: the halves differ by rounding."""
    ends = []
    for word, kind in (("3:1", "PD"), ("3:1/2T", "BP")):
        model = ImpactPair(beta=0.94022267, r=0.6570138, A=11.448766, s=0.4359)
        orbit = next(o for o in find_orbits(model, word, parameter="s") if o.physical)
        branch = continue_orbit(orbit, range=(0.05, 1.2), events=(kind,))
        (event,) = (e for e in branch.events if e.kind == kind and abs(e.value - 0.4459) < 1e-3)
        curve = follow_curve(event, model, "r", (0.05, 1.2), (0.05, 0.9))
        ends.append([curve["s"].min(), curve["s"].max(), curve["r"].min(), curve["r"].max()])
    assert ends[0] == pytest.approx(ends[1], abs=1e-10)


@pytest.mark.full
def test_a_curve_ends_on_its_limits():
    """The steady response of amplitude 1/sqrt((1 - w^2)^2 + c^2 w^2) reaches sigma = 1 at
    w^2 = 2 - c^2. The row of a value asked for at the end comes after the one of the point."""
    model = Oscillator(a=1.0, omega=2.3, c=0.1, k=1.0, sigma=0.3, r=0.8)
    stops = [
        entry
        for orbit in find_orbits(model, "S", parameter="sigma")
        for entry in continue_orbit(orbit, range=(0.01, 1.0), events=["V"]).events
    ]
    curve = follow_curve(stops[0], model, "omega", (0.01, 1.0), (0.5, 3.0), values=[2.0, 3.0])
    low = int(np.argmin(curve["omega"]))
    assert low in (0, len(curve) - 1)
    assert curve["sigma"][low] == 1.0
    assert curve["omega"][low] == pytest.approx(math.sqrt(1.99), rel=1e-14)
    rows = np.nonzero(curve["omega"] == 3.0)[0]
    assert curve["event"][rows].tolist() == ["", "UZ"]
    assert len(set(curve["arclength"][rows])) == 1


@pytest.mark.full
def test_zero_velocities_of_a_doubled_orbit_end_at_the_pd_v():
    """Each from its own side at the point that the PD has on the orbit itself, and at no other."""
    pair = ImpactPair(beta=0.35, r_B=0.34, r_T=0.2266, A=8.127, s=0.4723, M=0.1468, omega=14.03)
    first, second = (0.25, 0.55), (0.18, 0.65)
    doubling = next(
        entry
        for orbit in find_orbits(pair, "BBT", parameter="r_B")
        for entry in continue_orbit(orbit, range=first, events=["PD"]).events
        if entry.ghost
    )
    (point,) = follow_curve(doubling, pair, "beta", first, second).points
    assert point.kind == "PD-V"
    stops = continue_born(doubling, pair, range=first, events=["V"]).events
    assert len(stops) == 2
    for stop in stops:
        curve = follow_curve(stop, pair, "beta", first, second)
        (row,) = (
            k for k, end in zip((0, -1), curve.ends, strict=True) if end.kind.name == "SHORTER"
        )
        for name in ("r_B", "beta"):
            assert curve[name][row] == pytest.approx(point.parameters[name], rel=0, abs=2e-12)
        assert all(found.error < 1e-10 for found in curve.points)


@pytest.mark.full
def test_cusp_and_degenerate_touch_are_zeros_of_what_they_say():
    """Fig. 6(d), 2:1: curves on which folds are born at grazings."""
    model = ImpactPair(beta=math.pi / 4, r=0.5, A=11.0, s=0.5)
    orbit = next(o for o in find_orbits(model, "2:1", parameter="A") if o.physical)
    events = continue_orbit(orbit, range=(5.0, 40.0), events=("FB", "PD", "G")).events
    grazing = next(e for e in events if e.label.startswith("G[2:1->3:1]"))
    curve = follow_curve(model, grazing, "r", (1.0, 60.0), (0.05, 0.9))
    born = [p for p in curve.points if "fold of the new branch" in p.changes]
    assert len(born) == 2
    for point in born:  # on either side of it the grazing is super- or subcritical
        kinds = set()
        for r in (point.parameters["r"] - 1e-3, point.parameters["r"] + 1e-3):
            there = ImpactPair(beta=math.pi / 4, r=r, A=point.parameters["A"] * 0.97, s=0.5)
            orbits = [o for o in find_orbits(there, "2:1", parameter="A") if o.physical]
            near = [
                e
                for o in orbits
                for e in continue_orbit(o, range=(5.0, 40.0), events=("G",)).events
                if e.label.endswith("G[2:1->3:1]") and abs(e.value - point.parameters["A"]) < 0.1
            ]
            kinds.add(near[0].criticality)
        assert kinds == {"supercritical", "subcritical"}


@pytest.mark.parametrize(
    ("curves", "where"),
    [
        ({"parameter": "s"}, "curves.parameter"),
        ({"parameter": "q"}, "curves.parameter"),
        ({"range": [0.6, 0.9]}, "curves.range"),
        ({"range": [0.1, 1.2]}, "curves.range"),
        ({"kinds": ["BP"]}, "curves.kinds[0]"),
        ({"kinds": ["T"]}, "curves.kinds[0]"),
        ({"start": [0.1, 0.95]}, "curves.start[1]"),
        ({"start": 3}, "curves.start"),
        ({"unphysical": ["PD", "FB"]}, "curves.unphysical[1]"),
        ({"unphysical": 1}, "curves.unphysical"),
        ({"reach": -1}, "curves.reach"),
        ({"family": {"r": [0.1]}}, "curves.family.r"),
        ({"family": {"beta": []}}, "curves.family.beta"),
        ({"family": {"beta": [3.0]}}, "curves.family.beta"),
        ({"famly": {}}, "curves.famly"),
    ],
)
def test_bad_scenes_are_refused(curves, where):
    with pytest.raises(InputError) as refused:
        fig6(**curves)
    assert refused.value.where == where


@pytest.mark.parametrize(
    ("unphysical", "kinds"), [(False, []), (True, ["PD", "G"]), (["G"], ["G"]), ([], [])]
)
def test_kinds_whose_ghosts_on_unphysical_orbits_are_followed(unphysical, kinds):
    """All, none, or those named; as the manifest has it, it is read back."""
    given = fig6(unphysical=unphysical)
    assert given.resolved()["curves"]["unphysical"] == kinds
    assert read_scene(given.resolved()).curves == given.curves


def test_how_far_a_map_reaches():
    """As many words away as it switches deep, or one; a scene may say otherwise."""
    table = {**fig6().resolved(), "follow": {**fig6().resolved()["follow"], "switch": ["PD"]}}
    table["follow"]["depth"] = 3
    del table["curves"]["reach"]
    assert read_scene(table).curves.reach == 3
    assert fig6().curves.reach == 1
    assert fig6(reach=0).curves.reach == 0


@pytest.mark.parametrize(
    ("limits", "values"), [((-1.0, 2.0), ()), ((0.9, 0.1), ()), ((0.1, 0.9), (5.0,))]
)
def test_ranges_and_values_that_do_not_fit_are_refused(limits, values):
    model = ImpactPair(beta=math.pi / 6, r=0.5, A=5.0, s=0.4)
    entry = entry_of(model, "1:1", "s", (0.1, 1.2), "PD")
    with pytest.raises(InputError):
        follow_curve(model, entry, "r", (0.1, 1.2), limits, values=values)


# Curves started at several values, and checked by one-parameter runs.


def test_a_member_that_a_fold_keeps_from_the_family_is_named_with_the_fold():
    """2:1 of Fig. 7 folds at s = 0.356895277: it has no member at 0.37."""
    parameters = {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.34}
    given = {
        "name": "folded",
        "model": {"system": "impact-pair", "parameters": parameters},
        "follow": {"parameter": "A", "range": [4.9, 5.1], "orbits": ["2:1"]},
        "detect": {"events": ["PD"]},
        "curves": {
            "parameter": "r",
            "range": [0.29, 0.31],
            "kinds": ["PD"],
            "family": {"s": [0.34, 0.37]},
        },
    }
    notes = follow(read_scene(given)).statistics["notes"]
    (note,) = {note for note in notes if "was not reached" in note}
    text, _, turn = note.rpartition(" = ")
    assert text == "s = 0.37 was not reached from 0.34: the branch turns back at s"
    assert float(turn) == pytest.approx(0.356895277, abs=1e-5)


@pytest.fixture(scope="module")
def fig6d():
    """Fig. 6(d) at pi/6, where curves through r = 0.5 alone name G[2:1->2:2] first for small r."""
    text = (ROOT / "branches" / "fig6d" / "scene.toml").read_text("utf-8")
    data = tomllib.loads(text)
    data["curves"]["family"] = {"beta": ["pi/6"]}
    data["curves"] |= {"start": [0.12, 0.2], "cover": 0, "areas": False, "kinds": ["PD", "G"]}
    return follow(read_scene(data))


@pytest.mark.full
def test_curves_that_do_not_pass_the_scenes_own_value_are_found(fig6d):
    """G[2:1->3:1] at small r ends where it folds; each curve is there once."""
    heights = [
        y
        for curve in fig6d.curves
        if curve.label == "G[2:1->3:1]"
        for y in real_heights(curve, "r", "d", 0.12)
    ]
    assert max(heights) == pytest.approx(0.2243, abs=2e-4)
    for curve in fig6d.curves:
        model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.5)
        problem = problem_of(model, Word(curve.word, curve.period), Kernels(model, "A", "r"))
        others = (other for other in fig6d.curves if other is not curve)
        assert not any(same_curve(curve, other, problem) for other in others)


@pytest.mark.full
def test_curves_that_share_their_ends_alone_are_two():
    """One curve from two places is one, in either direction; with other orbits between, two."""
    ends, curves = (0.1, 0.9), []
    for r in (0.3, 0.7):
        model = ImpactPair(beta=math.pi / 6, r=r, A=5.0, s=0.4)
        entry = entry_of(model, "1:1", "s", (0.03, 1.2), "PD")
        curves.append(follow_curve(entry, model, "r", (0.03, 1.2), ends))
    one, other = curves
    problem = problem_of(model, Word(one.word, one.period), Kernels(model, *one.parameters))
    turned = {name: column[::-1] for name, column in other.columns.items()}
    assert same_curve(one, other, problem)
    assert same_curve(one, dataclasses.replace(other, columns=turned), problem)
    bump = np.sin(np.pi * np.linspace(0.0, 1.0, len(other)))
    for name in ("t2", "v1", "s"):
        moved = {**other.columns, name: other[name] * (1.0 + 0.1 * bump)}
        assert not same_curve(one, dataclasses.replace(other, columns=moved), problem)
    nearly = {**other.columns, "v1": other["v1"] * (1.0 + 8e-6)}  # ends as near as 1e-5 of them
    assert not same_curve(one, dataclasses.replace(other, columns=nearly), problem)


@pytest.mark.full
def test_heights_between_points():
    """Cubics through four points are a hundred times as near as lines where a curve bends."""
    model = ImpactPair(beta=math.pi / 6, r=0.5, A=5.0, s=0.4)
    entry = entry_of(model, "1:1", "s", (0.1, 1.2), "PD")
    hit = np.linspace(0.2, 0.8, 25)
    curve = follow_curve(entry, model, "r", (0.1, 1.2), (0.1, 0.9), values=hit.tolist())
    exact = np.min(np.abs(curve["r"][:, None] - hit), axis=1) < 1e-12
    assert np.sum(exact) >= len(hit)
    left = {name: column[~exact] for name, column in curve.columns.items()}
    thinned = dataclasses.replace(curve, columns=left)
    order, d = np.argsort(left["r"]), curve["d"][exact]
    heights = [real_heights(thinned, "r", "d", value) for value in curve["r"][exact]]
    lines = np.interp(curve["r"][exact], left["r"][order], left["d"][order])
    assert np.shape(heights) == (len(d), 1)
    off = np.max(np.abs(np.ravel(heights) - d)), np.max(np.abs(lines - d))
    assert off[0] < 2.5e-7 < 2e-5 < off[1]


@pytest.mark.full
def test_what_comes_first_is_what_runs_say(fig6d):
    found = regions(fig6d.curves, "d", fig6d.checks)
    assert found
    assert all(region.checked and not region.doubtful for region in found)
    low = next(region for region in found if region.low <= 0.12 <= region.high)
    assert low.first == "G[2:1->3:1]"
    assert {check.value for check in fig6d.checks} >= {0.12, 0.2, 0.5}
    assert not [note for note in fig6d.statistics["notes"] if "no curve" in note]


@pytest.mark.full
def test_a_region_ends_where_the_curve_becomes_a_ghost(fig6d):
    """At r = 0.24956 a fold is born at the grazing, which the curve passes unstable: a run at
    r = 0.25 finds no real grazing. The point's own status is a matter of rounding."""
    found = regions(fig6d.curves, "d", fig6d.checks)
    first = next(region for region in found if region.first == "G[2:1->3:1]")
    assert first.high == pytest.approx(0.24956012, abs=1e-8)
    flipped = []
    for curve in fig6d.curves:
        marked = np.array([event not in ("", "UZ") for event in curve["event"]])
        other = np.where(marked, 1 - curve["physical"], curve["physical"])
        flipped.append(dataclasses.replace(curve, columns={**curve.columns, "physical": other}))
    assert regions(flipped, "d", fig6d.checks) == found


def test_a_region_ends_where_its_curve_turns():
    """It ended at the nearest point that had been computed. Of forced motion that just reaches the
    stop, a = hypot(1 - omega^2, c omega) is least at omega^2 = 1 - c^2/2."""
    model = Oscillator(a=1.0, omega=0.9, c=0.1, k=1.0, sigma=1.0, r=0.8)
    (orbit,) = find_orbits(model, "0", parameter="omega")
    (grazing,) = continue_orbit(orbit, range=(0.9, 1.6), events=["G"]).events
    curve = follow_curve(grazing, model, "a", (0.8, 1.6), (0.02, 1.5))
    (region,) = regions([curve], "omega")
    assert region.low == pytest.approx(0.1 * math.sqrt(1.0 - 0.1**2 / 4.0), abs=1e-8)


@pytest.mark.full
def test_regions_without_a_run_say_so(fig6d):
    found = regions(fig6d.curves, "d")
    assert {region.said for region in found} == {"not checked by a run"}
    for changed in ({"orbits": ()}, {"orbits": [CheckedOrbit("FB", "", {"c0": [0.1]})]}):
        wrong = [dataclasses.replace(check, first="FB", **changed) for check in fig6d.checks]
        assert all("otherwise" in region.said for region in regions(fig6d.curves, "d", wrong))


@pytest.mark.full
def test_orbits_of_one_word_are_told_apart(fig6d):
    """At r = 0.5 a second 2:1 orbit grazes at d = 0.1327, above the doubling of the main one at
    0.1290, which a simulation meets; files without what runs say of orbits have one row."""
    found = regions(fig6d.curves, "d", fig6d.checks)
    here = {r.first: r for r in found if r.low < 0.5 < r.high}
    assert here.keys() == {"PD", "G[2:1->3:1]"}
    assert here["PD"].branch == "b1" != here["G[2:1->3:1]"].branch
    for label, d in (("PD", 0.1290), ("G[2:1->3:1]", 0.1327)):
        (curve,) = (c for c in fig6d.curves if c.id in here[label].curves)
        heights = real_heights(curve, "r", "d", 0.5)
        assert min(abs(height - d) for height in heights) < 5e-5
        assert 0.5 in here[label].checked
    earlier = [dataclasses.replace(check, orbits=()) for check in fig6d.checks]
    assert [r.first for r in regions(fig6d.curves, "d", earlier) if r.low < 0.5 < r.high] == [
        "G[2:1->3:1]"
    ]


@pytest.mark.full
def test_checks_are_saved_and_read_back(fig6d, tmp_path):
    write_diagram(fig6d, tmp_path)
    assert load_diagram(tmp_path).checks == fig6d.checks


@pytest.mark.full
def test_branches_at_other_values_of_the_second_parameter_are_kept_and_belong_to_curves(fig6d):
    known = {entry.id for entry in fig6d.entries}
    assert all(curve.origin in known for curve in fig6d.curves)
    assert len({branch["r"][0] for branch in fig6d.branches}) > 1


@pytest.mark.quick(1)
@pytest.mark.parametrize("r", [0.33, 0.19, 0.2, 0.23])
def test_no_point_is_found_by_rounding_beside_an_end_at_a_shorter_orbit(r):
    """There an orbit that grazes has the multiplier 1, too: a G-FB was found at r = 0.185727."""
    model = ImpactPair(beta=math.pi / 6, r=r, A=5.0, s=0.36)
    orbits = find_orbits(model, "1:1/2T", parameter="s", starts=64)
    events = [e for o in orbits for e in continue_orbit(o, range=(0.2, 0.42), events=["G"]).events]
    curves = [follow_curve(e, model, "r", (0.2, 0.42), (0.15, 0.6)) for e in events]
    (curve,) = (c for c in curves if "SHORTER" in {end.kind.name for end in c.ends})
    points = {point.kind: point.parameters["r"] for point in curve.points}
    expected = {"G-FB": 0.336352666157718, "G-PD": 0.392475271817893}
    assert len(curve.points) == 2
    assert points == pytest.approx(expected, abs=1e-12)


def shipped(scene, label, notation=None):
    """An entry of a shipped catalogue, and its model."""
    entries = load_entries(ROOT / "branches" / scene)
    labelled = (e for e in entries if e.label.lstrip("~") == label)
    entry = next(e for e in labelled if notation in (None, e.notation))
    return entry, entry.orbit().problem.model


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("scene", "label", "second"),
    [
        ("soft_stop", "G[0->1:1]", "a"),
        ("soft_stop", "V[2:2->1:1]", "a"),
        ("belt", "V[SP->0]", "mu_0"),
        ("stiff", "G[1->2]", "c"),
        ("soft_pair_friction", "G[BdbTut->BdbSPTut]", "A"),
    ],
)
def test_a_contact_that_begins_at_rest_has_no_points_made_by_rounding(scene, label, second):
    """The parameter goes with the square of the new impact's velocity all along the curve, as with
    soft stops, or the impact is forgotten before the next: determinants are rounding, in which up
    to 18 G-FB were seen. Friction is touched at no velocity, where the position has no acceleration
    either: ten DG."""
    entry, model = shipped(scene, label)
    value = model.values[second]
    curve = follow_curve(
        entry, model, second, (0.95 * entry.value, 1.05 * entry.value), (0.9 * value, 1.1 * value)
    )
    assert len(curve) > 5
    assert (curve.points, curve.missed) == ([], [])


def test_a_free_cycle_that_touches_a_guard_at_zero_is_read_and_followed():
    """There its state on the section is zero, which was taken for its size."""
    pytest.importorskip("heyoka")
    curves = []
    for label in ("G[0->SP]", "V[SP->0]"):
        entry, model = shipped("belt_free", label)
        curves.append(
            follow_curve(entry, model, "delta", (1.5, 1.7), (2.9, 3.1), values=[2.95, 3.05])
        )
    for curve in curves:
        assert (curve.points, curve.missed) == ([], [])
    grazing, stopping = (curve["V"][rows_at(curve, [2.95, 3.05])] for curve in curves)
    np.testing.assert_allclose(grazing, stopping, rtol=1e-12)


@pytest.mark.quick(1)
def test_a_velocity_that_is_forgotten_at_one_stiffness_makes_a_point():
    """A kick changes an oscillator's position after a period by sin(w T)/w, w^2 = k - c^2/4: not
    where w is the forcing's frequency. The row of C(1) vanishes there, and so scaled, its
    determinant jumped."""
    entry, model = shipped("stop", "V[1->0]")
    curve = follow_curve(entry, model, "k", (0.05, 0.2), (0.9, 1.1))
    assert curve.missed == []
    ((kind, k),) = ((p.kind, p.parameters["k"]) for p in curve.points)
    expected = model.values["omega"] ** 2 + model.values["c"] ** 2 / 4
    assert kind == "G-FB"
    assert k == pytest.approx(expected, abs=1e-12)


SHORTER_ENDS = {
    "fig3d": ("FB", "1:1/2T", "r", (2.5, 3.94), (0.9, 1.1)),
    "fig8": ("G[1:1/4T->(5:4)/4T]", "1:1/4T", "s", (7.5, 11.3), (0.7, 1.3)),
    "coco_bang_bang": ("FB", "2:2", "A", (0.95, 0.995), (0.9, 1.005)),
}


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", SHORTER_ENDS)
def test_nothing_is_missed_at_an_end_in_a_shorter_orbit(name):
    """The cusp's test function vanishes at the end by symmetry, to the third order, and that of
    G-FB, whose multiplier is the square of -1, to the second. Orbits of free period end so, too."""
    label, notation, second, first, parts = SHORTER_ENDS[name]
    entry, model = shipped(name, label, notation)
    low, high = (part * model.values[second] for part in parts)
    curve = follow_curve(entry, model, second, first, (low, high))
    assert [end.kind.name for end in curve.ends].count("SHORTER") == 1
    assert curve.missed == []


@pytest.mark.full
def test_a_doubling_whose_contact_ends_at_rest_is_no_turning_point_but_a_pd_v():
    """C(1) is singular there, as C(-1) is, without a multiplier: a GPD was located, at which the
    coefficient is 0.0132, and the PD-V was not, since no point is reached close to it."""
    model = between_soft_stops(a=0.671121, w=0.8892004309986946)
    problem = problem_of(model, Word("ABLR", 1), Kernels(model, "w"))
    rows = [6.88839, 1.00617], [7.33494, -0.9846], [10.003, -0.01199], [9.64812, 0.00317]
    orbit = orbit_at(problem, np.append(rows, model.values["w"]))
    (entry,) = continue_orbit(orbit, range=(0.8882, 0.8902), events=["PD"]).events
    curve = follow_curve(entry, model, "a", (0.88, 0.895), (0.671, 0.6745))
    assert curve.missed == []
    places = {point.kind: point.parameters["a"] for point in curve.points}
    assert places.keys() == {"PD-V", "GPD"}
    assert len(curve.points) == 2
    assert places["GPD"] == pytest.approx(0.6730900788846, abs=1e-11)
    stops = next(point for point in curve.points if point.kind == "PD-V")
    assert stops.error < 1e-6
    # where the velocity vanishes by the line through points at 2.7e-8 and -2.3e-7
    assert places["PD-V"] == pytest.approx(0.67243575, abs=stops.error + 1e-8)


@pytest.mark.full
def test_a_contact_over_the_end_of_the_period_vanishes_where_the_other_does():
    """A block rests upright and touches the other corner, x = 1 - cos(w t), where b = 1 + w**2. Of
    the twins one contact is the flight that ends in the next period, which w changes."""
    model = read_scene(ROCKING_BLOCK).model.replace(b=9.0, w=3.0)
    orbits = [o for o in find_orbits(model, "NP", parameter="b") if min(o.velocities) > -0.5]
    assert len(orbits) == 2
    for orbit in orbits:
        branch = continue_orbit(orbit, "b", (8.5, 10.5), events=["V"])
        (event,) = branch.events
        assert event.value == pytest.approx(10.0, rel=1e-13)
        curve = follow_curve(event, model, "w", (1.0, 12.0), (2.0, 5.0))
        assert [end.kind for end in curve.ends] == [EndKind.RANGE] * 2
        assert curve["b"] == pytest.approx(1.0 + curve["w"] ** 2, rel=1e-12)


@pytest.mark.full
def test_no_fold_is_born_where_a_touch_that_reverses_friction_has_no_acceleration():
    """The determinant has no factor that vanishes there, and its sign made a G-FB that jumped. The
    velocity that touches has no rate, and none of that rate before friction reverses."""
    force = "a*cos(w*t) - x - 0.062*v"
    model = read_scene(
        {
            "name": "friction",
            "model": {
                "system": "hybrid",
                "period": "2*pi/w",
                "parameters": {"a": 0.97, "w": 0.553},
                "modes": {
                    "up": {"x": "v", "v": f"{force} - 0.213"},
                    "down": {"x": "v", "v": f"{force} + 0.323"},
                },
                "guards": {
                    "A": {"mode": "up", "within": "v >= 0.045", "to": "down"},
                    "B": {"mode": "down", "within": "v <= 0.045", "to": "up"},
                },
            },
            "follow": {"parameter": "w", "range": [0.54, 0.57], "orbits": ["AB"]},
        }
    ).model
    events = [
        event
        for orbit in find_orbits(model, "AB", parameter="w", starts=64)
        for event in continue_orbit(orbit, range=(0.54, 0.57), events=["V"]).events
    ]
    curves = [follow_curve(event, model, "a", (0.54, 0.57), (0.86, 1.02)) for event in events]
    (curve,) = (curve for curve in curves if curve.points)
    (point,) = curve.points
    assert (point.kind, curve.missed) == ("DG", [])
    a, w = point.parameters["a"], point.parameters["w"]
    assert a * w * np.sin(w * point.impacts[0]["time"]) == pytest.approx(-0.045, abs=1e-12)


def test_slip_that_begins_on_its_limit_with_zero_rate_is_a_point():
    """Beyond it the flight passes the belt's velocity at once: it was not located, and of the same
    curve a grazing was said to come first. The place is that of closed forms solved with 30
    digits."""
    kernels = Kernels(model := Belt(a=0.533, omega=0.7, c=0.08, V=0.325, mu_0=0.5), "a")
    near = [1.537, 0.654, 6.193, 1.0, 8.59, -0.113, 0.533]
    orbit = orbit_at(problem_of(model, Word("PCB"), kernels), near)
    events = continue_orbit(orbit, range=(0.532, 0.534), events=["G"]).events
    (entry,) = (event for event in events if event.physical)
    told = details_of(entry)
    assert _event_place(entry.orbit(model).linearisation, told) == pytest.approx(told)
    curve = follow_curve(entry, model, "V", (0.516, 0.534), (0.324, 0.342))
    (point,), place = curve.points, curve.points[0].parameters
    assert (point.kind, curve.missed) == ("DG", [])
    assert place["a"] == pytest.approx(0.524175161704762, abs=1e-12)
    assert place["V"] == pytest.approx(0.339923713267635, abs=1e-12)
    assert np.max(curve["V"][curve["physical"] == 1]) == place["V"]


@pytest.mark.parametrize(("multiplier", "there"), [(-1.0 + 1e-9, True), (-0.048, False)])
def test_an_orbit_that_doubles_at_its_grazing_has_the_multiplier(multiplier, there):
    """Where an impact comes to rest and leaves no trace, C(mu) is singular for every mu: a G-FB and
    a G-PD were seen at one place."""
    event = SimpleNamespace(point=Place(0.0, multipliers=(multiplier, 0.0)))
    assert TouchSingular("G-PD", "", -1.0, lambda here: here.orbit).accept(event) is there


def test_touches_of_an_orbit_are_the_same_within_rounding():
    """A curve of orbits that touch twice, with velocities of rounding, had dozens of zeros
    that were not located."""
    model = Oscillator(a=1.0, omega=3.3164175064886990, c=0.05, k=1.0, sigma=0.1, r=0.8)
    problem = problem_of(model, Word("SS", 2), Kernels(model, "omega", "sigma"))
    touches = [0.9422847997671447, 2.1e-16, 0.9422847997671450, -1.2e-16]
    here = problem.evaluate(np.array([*touches, model.values["omega"], model.values["sigma"]]))
    test = RepetitionTest(problem)
    values = test.values(SimpleNamespace(evaluation=SimpleNamespace(orbit=here)))
    assert np.max(np.abs(values)) < test.noise
