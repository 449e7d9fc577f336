"""Error against run time: the report of a small scene, its files and its picture."""

from __future__ import annotations

import json
import math
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from zoo import ROOT, SMALL, scene_table

from contimpact.accuracy import reference as contestant
from contimpact.accuracy import report
from contimpact.accuracy import report as long_words
from contimpact.accuracy import report as module
from contimpact.accuracy.reference import (
    EXPLICIT,
    IMPLICIT,
    MOST_EVALUATIONS,
    Reference,
    Shooting,
    measure_simulation,
)
from contimpact.accuracy.report import (
    _budget_note,
    _event_table,
    _fewer_places,
    _simulation_table,
    compare_estimates,
    measure_events,
)
from contimpact.cli import main
from contimpact.continuation.branch import EndKind
from contimpact.continuation.settings import Settings
from contimpact.diagrams.explore import follow
from contimpact.diagrams.orbit_walks import walk_orbits
from contimpact.errors import InputError
from contimpact.orbits.search import find_orbits
from contimpact.plots.report import plot_report
from contimpact.results.scene import load_scene, read_scene
from contimpact.segments.kernels import Kernels
from contimpact.systems.oscillator import Oscillator


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The command itself, with fewer settings than it takes otherwise."""
    place = tmp_path_factory.mktemp("report")
    (place / "scene.toml").write_text(SMALL, encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "TOLERANCES", (1e-4, 1e-8, 1e-14))
        patch.setattr(module, "STEPS", (0.1, 0.01))
        patch.setattr(long_words, "WORD_LENGTHS", (10, 20, 40, 60))
        patch.setattr(contestant, "SHOT", 2)
        command = ["report", str(place / "scene.toml"), "-o", str(place / "out"), "-n", "2"]
        assert main(command) == 0
    return place / "out"


@pytest.fixture(scope="module")
def data(folder):
    return json.loads((folder / "report.json").read_text(encoding="utf-8"))


@pytest.mark.full
def test_files(folder):
    names = {path.name for path in folder.iterdir()}
    assert names == {"report.json", "report.md", "work-precision.svg", "work-precision.png"}


@pytest.mark.full
def test_schema_and_machine(data):
    assert data["schema"] == "contimpact.report/1"
    assert data["digits"] >= 30
    assert data["machine"]["processors"] >= 1
    assert {"python", "numpy", "scipy", "mpmath", "contimpact"} <= set(data["machine"])


@pytest.mark.full
def test_every_method_is_there_and_its_error_falls(data):
    names = [method["name"] for method in data["methods"]]
    assert names == [
        "tolerance, tangent predictor",
        "step, tangent predictor",
        "tolerance, secant predictor",
        "step, secant predictor",
        "shooting, solve_ivp",
    ]
    for method in data["methods"]:
        rows = method["rows"]
        errors = [row["error"] for row in rows]
        costs = [row["evaluations"] for row in rows]
        assert errors == sorted(errors, reverse=True)
        assert costs == sorted(costs)
        for row in rows:
            assert row["seconds"]["low"] <= row["seconds"]["median"] <= row["seconds"]["high"]
        if method["varied"] == "tolerance":
            assert errors[-1] < 1e-13


@pytest.mark.full
def test_events_are_confirmed_and_honest(data):
    fair = data["honesty"]
    assert fair["events"] == fair["confirmed"] == fair["within_estimate"] == 2
    assert all(event["true_error"] < 1e-14 for event in data["events"])
    for event in data["events"]:
        assert float(event["digits"]) == pytest.approx(event["value"], abs=1e-15)
        assert len(event["digits"]) >= 30


@pytest.mark.full
def test_events_of_a_family_are_compared_at_their_own_values():
    text = SMALL.replace('"small"', '"family"').replace(
        "range = [0.30, 0.40]", "range = [0.1, 1.0]"
    )
    text += '[curves]\nparameter = "r"\nrange = [0.29, 0.31]\n[curves.family]\nbeta = [0.4, "pi/6"]'
    scene = read_scene(tomllib.loads(text))
    events = measure_events(scene, Kernels(scene.model, "s"))
    fair = compare_estimates(events)
    assert fair["events"] == fair["confirmed"] == fair["within_estimate"] >= 4
    assert fair["largest_true_error"] < 1e-13


@pytest.mark.parametrize("name", ["stop", pytest.param("fig6a", marks=pytest.mark.slow)])
def test_reported_errors_of_shipped_scenes_are_bounds(name):
    scene = load_scene(ROOT / "branches" / name / "scene.toml")
    fair = compare_estimates(measure_events(scene, Kernels(scene.model, scene.parameter)))
    assert fair["events"] == fair["confirmed"] == fair["within_estimate"]
    assert fair["largest_ratio"] < 0.5


@pytest.mark.full
def test_a_simulation_and_its_voltages_are_measured():
    """Each flight to rounding; the integrator's error falls with its tolerance."""
    scene = load_scene(ROOT / "branches" / "fig7" / "scene.toml")
    found = measure_simulation(scene, (1e-4, 1e-8, 1e-12), 2, 30)
    assert found["flights"] == 40
    assert found["simulator"]["error"] < 1e-14
    assert found["along"][0] <= found["simulator"]["error"]
    assert found["energy"]["formula"] < 1e-14
    errors = [row["error"] for row in found["solve_ivp"]]
    assert errors == sorted(errors, reverse=True)
    assert found["simulator"]["error"] < errors[-1] < 1e-10
    text = "\n".join(_simulation_table(found))
    assert "Voltages" in text
    assert "nan" not in text


@pytest.mark.full
def test_a_scene_without_a_simulation_has_none_in_its_report(data):
    assert data["simulation"] is None


@pytest.mark.full
def test_cost_of_long_words(data):
    words = data["long_words"]
    assert [row["impacts"] for row in words["rows"]] == [10, 20, 40, 60]
    assert set(words["exponents"]) >= {"bordered solve", "multipliers"}
    assert all(math.isfinite(value) for value in words["exponents"].values())


@pytest.mark.full
def test_the_text_has_every_table(folder, data):
    text = (folder / "report.md").read_text(encoding="utf-8")
    for heading in [m["name"] for m in data["methods"]] + ["Events", "Long words"]:
        assert f"## {heading}\n" in text
    assert "nan" not in text
    assert "inf " not in text


@pytest.mark.parametrize("against", ["seconds", "evaluations"])
@pytest.mark.full
def test_plot_on_given_axes(data, against):
    from matplotlib.figure import Figure

    ax = Figure().add_subplot()
    assert plot_report(data, ax, against=against) is ax
    assert ax.get_xscale() == ax.get_yscale() == "log"
    assert len(ax.get_legend_handles_labels()[1]) == len(data["methods"])


def test_repetitions_are_checked():
    scene = read_scene(scene_table({"beta": 0.5}, name="x", follow={"range": [0.3, 0.4]}))
    with pytest.raises(InputError, match="repetitions"):
        module.report(scene, 0)


@pytest.mark.parametrize("word", ["1:1", "2:1"])
def test_shooting_finds_the_same_orbit(pair, word):
    """An independent way to the orbit: the equations of motion, integrated."""
    orbit = find_orbits(pair(s=0.34), word, parameter="s", starts=64, rounds=4)[0]
    guess = orbit.unknowns.copy()
    guess[:-1] += 1e-4
    found = Shooting(orbit.problem, 1e-11).orbit(guess)
    assert found is not None
    assert Reference(orbit.problem).orbit(orbit.unknowns).distance(found) < 1e-8


def test_shooting_that_misses_its_wall_is_none(pair):
    orbit = find_orbits(pair(s=0.34), "1:1", parameter="s", starts=64, rounds=4)[0]
    guess = orbit.unknowns.copy()
    guess[1], guess[-1] = 1e-9, 50.0
    assert Shooting(orbit.problem, 1e-6).orbit(guess) is None


@pytest.mark.full
def test_shooting_reads_many_harmonics(pair):
    """Whose sum is one term."""
    many = "+".join(f"cos({k}*pi*t)*{0.5**k}" for k in range(1, 12))
    orbit = find_orbits(pair(s=0.36, forcing=many), "1:1", parameter="s", starts=64, rounds=4)[0]
    guess = orbit.unknowns.copy()
    guess[:-1] += 1e-6
    found = Shooting(orbit.problem, 1e-11).orbit(guess)
    assert Reference(orbit.problem).orbit(orbit.unknowns).distance(found) < 1e-8


@pytest.mark.full
def test_shooting_gives_up_a_stiff_flight(oscillator):
    """Thousands of oscillations took an explicit integrator minutes at every tolerance."""
    model = oscillator(k=1e8, a=1e8, c=100.0, omega=1.0, sigma=0.3)
    problem = find_orbits(model, "S", parameter="a", starts=64)[0].problem
    shooting = Shooting(problem, 1e-6)
    release = [np.arccos(0.3), 0.0]
    assert shooting.flight("S", "S", release, 2 * np.pi, list(model.values.values())) is None
    assert shooting.evaluations <= MOST_EVALUATIONS + 1


def test_predictors_are_named():
    assert Settings().predictor == "tangent"
    with pytest.raises(InputError, match="secant"):
        Settings(predictor="cubic")


def test_the_secant_predictor_reaches_the_same_branch(pair):
    from contimpact.diagrams.orbit_branch import continue_orbit

    orbit = find_orbits(pair(s=0.34), "2:1", parameter="s", starts=64, rounds=4)[0]
    values = []
    for predictor in ("tangent", "secant"):
        settings = Settings(predictor=predictor)
        branch = continue_orbit(
            orbit, range=(0.08, 1.05), events=["FB", "PD", "G"], settings=settings
        )
        values.append([(e.label, e.value) for e in branch.events])
    assert [label for label, _ in values[0]] == [label for label, _ in values[1]]
    assert np.allclose([v for _, v in values[0]], [v for _, v in values[1]], atol=1e-13, rtol=0)


STIFF = {"a": 3000.0, "omega": 1.0, "c": 100.0, "k": 1e4, "sigma": 0.3, "r": 0.8}


@pytest.mark.full
def test_shooting_of_stiff_motion_ends_within_its_budget_and_says_what_it_reached(monkeypatch):
    """One for stiff motion is tried besides; what costs more than nothing ended at is not."""
    monkeypatch.setattr(contestant, "EVALUATIONS", 30_000)
    monkeypatch.setattr(contestant, "SHOT", 1)
    model = Oscillator(**STIFF)
    (orbit, *_) = find_orbits(model, "1", parameter="a")
    walk = walk_orbits(
        orbit.problem,
        orbit.unknowns,
        +1,
        gaps=False,
        limits=(2999.9, 3000.1),
        settings=Settings(max_points=3),
    )
    told = []
    found = contestant.measure_shooting(
        orbit.problem, [walk], (1e-4, 1e-8, 1e-11, 1e-12), 1, told.append
    )
    assert list(found) == [EXPLICIT, IMPLICIT]
    last = found[EXPLICIT][-1]
    assert last["unfinished"] == 1
    assert last["evaluations"] <= 30_001 * len(walk.points)
    assert len(found[EXPLICIT]) < 4
    assert all(r["evaluations"] <= 30_001 * len(walk.points) for r in found[IMPLICIT])
    text = "\n".join(_budget_note([last]))
    assert "Not ended within 200000 evaluations a row and 50000 a flight: 1 at" in text
    assert "smaller tolerances are not tried" in text


@pytest.mark.full
def test_the_first_orbit_with_impacts_is_compared_where_a_scene_names_none():
    scene = load_scene(ROOT / "branches" / "soft_stop" / "scene.toml")
    given = {**scene.given, "follow": {**scene.given["follow"], "range": [1.6, 2.0]}}
    scene = read_scene(given)
    kernels = Kernels(scene.model, scene.parameter)
    orbit = module._orbit(scene, kernels, follow(scene))
    assert str(orbit.word) == "CR"
    assert 1.6 < orbit.unknowns[-1] < 1.73


def test_places_between_points_are_fewer_than_orbits_without_a_note():
    row = {"places": 22, "places_asked": 22, "orbits": 24}
    assert _fewer_places({"rows": [row]}) == []
    assert "errors are those at 21 at least" in _fewer_places({"rows": [{**row, "places": 21}]})[1]


SWITCH = """
name = "a switch of MEMS in SI units, whose first orbit found is unphysical"
[model]
system = "soft-stop"
[model.parameters]
a = 50.0
omega = 1e5
c = 2e3
k = 1e10
e = 5e-9
k_b = 1e12
c_b = 2e4
[follow]
parameter = "omega"
range = [5e4, 2.5e5]
orbits = ["CR"]
"""


def test_physical_orbits_are_compared_and_shot_at_in_any_unit(monkeypatch):
    scene = read_scene(tomllib.loads(SWITCH))
    orbit = module._orbit(scene, Kernels(scene.model, scene.parameter), None)
    assert orbit.physical
    assert max(orbit.velocities) < 1e-3
    task = module._Task(scene, orbit, 1, lambda text: None)
    monkeypatch.setattr(module, "TOLERANCES", ())
    assert [method["name"] for method in task.shooting()] == ["shooting, solve_ivp"]


@pytest.mark.full
def test_events_that_there_is_no_time_for_are_counted(monkeypatch):
    monkeypatch.setattr(report, "SECONDS_OF_EVENTS", 0.0)
    scene = read_scene(tomllib.loads(SMALL))
    rows = measure_events(scene, Kernels(scene.model, scene.parameter))
    fair = compare_estimates(rows)
    assert (fair["events"], fair["compared"], fair["confirmed"]) == (2, 1, 1)
    assert "1 were not compared" in "\n".join(_event_table(rows, fair))


@pytest.mark.full
@pytest.mark.parametrize("known", [True, False])
def test_events_that_are_not_confirmed_say_why(monkeypatch, known):
    monkeypatch.setattr(report.Reference, "event", lambda *given: None)
    monkeypatch.setattr(report.Reference, "has_event", lambda *given: known)
    scene = read_scene(tomllib.loads(SMALL))
    rows = measure_events(scene, Kernels(scene.model, scene.parameter))
    why = "does not converge to 30 digits" if known else "has no equations for what defines it"
    said = "\n".join(_event_table(rows, compare_estimates(rows)))
    assert "0 of 2 events confirmed" in said
    assert f"{why}: {', '.join(row['id'] for row in rows)}." in said


@pytest.mark.parametrize("during", ["diagram", "walk"])
def test_an_interruption_ends_a_report(monkeypatch, during):
    """A report of what was followed until then looked like that of the whole scene."""
    scene = read_scene(tomllib.loads(SMALL))
    diagram, walks = follow(scene), module.walk_orbits
    if during == "diagram":
        diagram.statistics["failure"] = "interrupted"
    monkeypatch.setattr(module, "follow", lambda scene: diagram)

    def interrupted(*given, **options):
        walk = walks(*given, **options)
        return replace(walk, end=replace(walk.end, kind=EndKind.INTERRUPTED))

    monkeypatch.setattr(module, "walk_orbits", interrupted)
    with pytest.raises(KeyboardInterrupt):
        module.report(scene, 1)


def test_what_takes_long_is_not_repeated(monkeypatch):
    monkeypatch.setattr(contestant, "SECONDS", 0.0)
    calls = []
    _, seconds = contestant.time_task(lambda: calls.append(sum(range(10**5))), 5)
    assert len(calls) == 1
    assert seconds["low"] == seconds["median"] == seconds["high"] > 0.0
