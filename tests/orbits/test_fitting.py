"""Fits to measured impacts: synthetic data with known parameters, and data that cannot be used."""

from __future__ import annotations

import math

import numpy as np
import pytest

import contimpact as ci
from contimpact.orbits.fitting import read_impacts
from contimpact.orbits.search import find_orbits

PI = math.pi
PAIR = ci.ImpactPair(beta=PI / 6, r=0.3, A=5.0, s=0.34)
OFF = PAIR.replace(beta=0.5, r=0.33)
OSCILLATOR = ci.Oscillator(a=1.0, c=0.1, k=1.0, omega=2.8, sigma=0.0, r=0.8)
NOISE = {"time": 0.002, "velocity": 0.005}
TRUTH = {"r": 0.3, "beta": PI / 6}


def orbit_of(word, stable=True, model=PAIR):
    return next(o for o in find_orbits(model, word, parameter="s") if o.stable == stable)


@pytest.fixture(scope="module")
def two_one():
    return orbit_of("2:1")


@pytest.fixture(scope="module")
def beside():
    return orbit_of("2:1", model=OFF)


def measured(orbit, laps=20, clock=0.7, noise=None, rng=0):
    """Impacts of so many periods in an order of their own, as columns."""
    rng = np.random.default_rng(rng)
    noise = noise or {"time": 0.0, "velocity": 0.0}
    count = len(orbit.word)
    rows = rng.permutation(laps * count)
    n, k = np.divmod(rows, count)
    return {
        "time": orbit.times[k]
        + orbit.period * n
        + clock
        + noise["time"] * rng.standard_normal(len(k)),
        "velocity": orbit.velocities[k] + noise["velocity"] * rng.standard_normal(len(k)),
        "wall": [orbit.word.walls[i] for i in k],
    }


def without(data, *names):
    return {name: column for name, column in data.items() if name not in names}


@pytest.mark.parametrize("left_out", [("time",), ()])
def test_few_exact_rows_are_of_the_orbit_they_come_from(left_out):
    """Of two 1:1 orbits, that with smaller velocities was returned, at r = 2e-10."""
    model = ci.ImpactPair(beta=0.8, r=0.3, A=5.0, s=0.5)
    data = without(measured(orbit_of("1:1", model=model), laps=1), *left_out)
    found = ci.fit(model.replace(r=0.32), "1:1", data, ["r"])
    assert found.values["r"] == pytest.approx(0.3, abs=1e-10)
    assert all(one.misfit > found.misfit + 30.0 for one in found.others)
    assert not any("may belong" in note for note in found.notes)


def test_a_clock_that_times_do_not_determine_is_said():
    """Without walls, an orbit and its mirror image half a period later have the same times."""
    model = ci.ImpactPair(beta=0.0, r=0.5, A=5.0, s=0.4)
    orbit = orbit_of("1:1", model=model)
    data = measured(orbit, laps=4, clock=0.3, noise=NOISE)
    off = model.replace(r=0.52)
    found = ci.fit(off, orbit, without(data, "wall", "velocity"), ["r"])
    clocks = {round(found.values["clock"], 1)}
    (note,) = (note for note in found.notes if "clock" in note)
    clocks.add(round(float(note.split("also be ")[1].split()[0]), 1))
    assert clocks == {0.3, 1.3}
    assert not any("clock" in note for note in ci.fit(off, orbit, data, ["r"]).notes)


def test_exact_data_have_no_p_value(two_one):
    """Their scatter is rounding: p was 6e-192."""
    data = {"time": np.tile(two_one.times, 3), "velocity": np.tile(two_one.velocities, 3)}
    found = ci.fit(PAIR, two_one, data, ["r"], clock=False)
    assert found.values["r"] == pytest.approx(0.3, abs=1e-12)
    assert found.p_value is None


def test_an_estimate_of_nearly_zero_is_determined():
    """Velocities after impact, as if before it, lead to r = 0: it was called undetermined."""
    orbit = orbit_of("2:1")
    times = np.concatenate([orbit.times + 2.0 * lap for lap in range(6)])
    data = {"time": times, "velocity": np.tile(-0.3 * orbit.velocities, 6)}
    found = ci.fit(PAIR, "2:1", data, ["r"])
    assert abs(found.values["r"]) < 1e-6
    assert "do not determine" not in (found.reason or "")


def test_a_wall_missing_from_a_table_is_nan(two_one):
    data = measured(two_one, laps=1)
    data["wall"][1] = math.nan
    assert read_impacts(data).walls[1] == ""


@pytest.mark.parametrize("left_out", [("wall",), ("velocity",), (), ("velocity", "wall")])
@pytest.mark.quick(2)
def test_exact_data_give_the_parameters(two_one, left_out):
    """To 1e-10, from other starting values, whatever column is missing."""
    found = ci.fit(OFF, "2:1", without(measured(two_one), *left_out), ["r", "beta"])
    assert found.reason is None
    assert found.values == pytest.approx({**TRUTH, "clock": 0.7}, abs=1e-10)
    assert found.state == "stable"
    assert found.orbit.velocities == pytest.approx(two_one.velocities, abs=1e-10)


def test_velocities_alone_and_single_cells(two_one):
    """Without times there is no clock; of a row, either number may be missing."""
    found = ci.fit(OFF, "2:1", without(measured(two_one), "time"), ["r", "beta"])
    assert found.values == pytest.approx(TRUTH, abs=1e-10)
    data = measured(two_one)
    data["time"][::2] = math.nan
    data["velocity"][1::2] = math.nan
    found = ci.fit(OFF, "2:1", data, ["r", "beta"])
    assert found.values == pytest.approx({**TRUTH, "clock": 0.7}, abs=1e-10)
    assert found.freedom == 60 - 3


@pytest.mark.full
@pytest.mark.parametrize("given", [True, False])
def test_the_ellipse_of_95_percent_covers_the_truth(beside, two_one, given):
    """In 100 trials with noise; 89 to 99 is what a binomial count of 0.95 stays within in 99 %."""
    fits = [
        ci.fit(
            OFF,
            beside,
            measured(two_one, noise=NOISE, rng=trial),
            ["r", "beta"],
            deviations=NOISE if given else None,
        )
        for trial in range(100)
    ]
    assert all(one.reason is None for one in fits)
    covered = sum(one.covers(TRUTH) for one in fits)
    assert 89 <= covered <= 99
    assert sum(one.p_value < 0.05 for one in fits) <= 11
    if not given:
        mean = {name: np.mean([one.deviations[name] for one in fits]) for name in NOISE}
        assert mean == pytest.approx(NOISE, rel=0.03)
    pulls = np.array(
        [[(one.values[n] - v) / one.errors[n] for n, v in TRUTH.items()] for one in fits]
    )
    assert np.std(pulls, axis=0) == pytest.approx(1.0, abs=0.2)


@pytest.mark.full
def test_two_restitutions_and_a_fixed_clock():
    model = ci.ImpactPair(beta=PI / 6, r_B=0.3, r_T=0.35, A=5.0, s=0.34)
    orbit = orbit_of("2:1", model=model)
    off = model.replace(r_B=0.32, r_T=0.32)
    found = ci.fit(off, "2:1", measured(orbit, clock=0.0), ["r_B", "r_T", "beta"], clock=False)
    assert found.values == pytest.approx({"r_B": 0.3, "r_T": 0.35, "beta": PI / 6}, abs=1e-10)


@pytest.mark.full
def test_a_period_that_is_fitted():
    """Times of many laps move with the period, and with it the forcing's frequency."""
    orbit = find_orbits(OSCILLATOR, "1", parameter="omega")[0]
    found = ci.fit(OSCILLATOR.replace(omega=2.801), "1", measured(orbit), ["omega", "r"])
    assert found.values == pytest.approx({"omega": 2.8, "r": 0.8, "clock": 0.7}, abs=1e-10)


@pytest.mark.full
def test_where_no_orbit_is_at_the_start_others_are_drawn(two_one):
    off = PAIR.replace(r=0.449, beta=0.304)
    assert ci.find_orbits(off, "2:1") == []
    found = ci.fit(off, "2:1", measured(two_one), ["r", "beta"])
    assert found.values == pytest.approx({**TRUTH, "clock": 0.7}, abs=1e-10)
    assert "no 2:1 orbit was found at the starting values; begun at r = " in found.notes[-1]


@pytest.mark.full
@pytest.mark.full
def test_of_orbits_that_fit_equally_well_the_stable_one_comes_first():
    """With one impact in a period a damping below zero gives the same time and velocity."""
    model = ci.Oscillator(a=1.0, omega=1.47, c=0.2, k=1.0, sigma=0.1, r=0.7)
    orbit = next(o for o in ci.find_orbits(model, "1", parameter="sigma") if o.stable)
    k = np.arange(6)
    times = orbit.times[0] + k * orbit.period + 0.002 * (-1.0) ** k
    data = {"time": times, "velocity": orbit.velocities[0] + 0.003 * np.cos(k)}
    found = ci.fit(model.replace(c=0.25), "1", data, ["c"])
    assert found.state == "stable"
    assert found.values["c"] == pytest.approx(0.2, abs=3e-4)
    assert [one.state for one in found.others] == ["unstable"]
    c = found.others[0].values["c"]
    assert c < 0.0
    assert f"further: 1, unstable, c = {c:.4g}: misfit larger by 0" in repr(found)


@pytest.mark.full
def test_a_physical_orbit_comes_before_an_unphysical_one_that_fits_better():
    """Times alone: a third impact outside the capsule follows their scatter, too."""
    pair = ci.ImpactPair(beta="pi/4", r_B=0.45, r_T=0.35, M=0.05, omega=62.8, A=4.0, s=0.08)
    orbit = next(o for o in ci.find_orbits(pair, "1:1", "s") if o.stable and o.physical)
    noise = np.random.default_rng(0).normal(0.0, 0.002, (40, 2))
    times = (orbit.times + 2.0 * np.arange(40)[:, None] + noise).ravel() + 3.3
    start = pair.replace(s=0.075, r_B=0.5)
    found = ci.fit(start, ["1:1", "2:1"], {"time": times}, ["s", "r_B"])
    assert (found.orbit.notation, found.orbit.physical) == ("1:1", True)
    better = [one for one in found.others if one.misfit < found.misfit - 10.0]
    assert [one.state for one in better] == ["unphysical"]
    assert f": misfit smaller by {found.misfit - better[0].misfit:.3g}" in repr(found)


def test_which_word_is_nearest(two_one):
    """Data of the stable orbit prefer it to the unstable one and to other words."""
    data = measured(two_one, noise=NOISE)
    found = ci.fit(PAIR, ["1:1", "2:1", "3:1"], data, ["r", "beta"], deviations=NOISE)
    assert (found.orbit.notation, found.state) == ("2:1", "stable")
    assert 0.01 < found.p_value < 0.99
    assert found.others
    assert all(one.misfit > found.misfit + 100.0 for one in found.others)
    assert any("3:1" in note for note in found.notes)
    assert "further: 1:1" in repr(found)


def test_data_of_a_ghost_are_those_of_a_ghost():
    """The unstable 2:1 orbit is recognised, and said to be unstable."""
    orbit = orbit_of("2:1", stable=False)
    found = ci.fit(PAIR, "2:1", measured(orbit, noise=NOISE), ["r"], deviations=NOISE)
    assert found.state == "unstable"
    assert found.covers({"r": 0.3}, 0.999)


def test_the_wrong_word_has_no_probability(two_one):
    """And the second impact of each period on B is said to be one too many."""
    found = ci.fit(PAIR, "1:1", measured(two_one, noise=NOISE), ["r", "beta"], deviations=NOISE)
    assert found.p_value < 1e-10
    assert "20 rows have the impact and the period of another row" in found.notes


@pytest.mark.parametrize("given", [NOISE, None])
def test_a_wrong_parameter_has_no_probability(two_one, given):
    """Also without deviations, by the scatter of repeated impacts."""
    data = measured(two_one, noise=NOISE)
    found = ci.fit(PAIR.replace(beta=0.4), "2:1", data, ["r"], deviations=given)
    assert found.reason is None
    assert found.p_value < 1e-10


@pytest.mark.parametrize("given", [None, NOISE])
def test_a_number_that_is_far_off_is_named(two_one, given):
    """One velocity of 18 that is 0.3 too large, 60 deviations, went without a word. Of good data
    one fit in a thousand may name a number."""
    for rng in range(8):
        data = measured(two_one, laps=6, noise=NOISE, rng=rng)
        good = ci.fit(PAIR, two_one, data, ["r"], deviations=given)
        assert not any("is off by" in note for note in good.notes)
        data["velocity"][rng] += 0.3
        found = ci.fit(PAIR, two_one, data, ["r"], deviations=given)
        notes = [note for note in found.notes if "is off by" in note]
        assert notes
        assert all(note.startswith(f"data, row {rng + 1}: its ") for note in notes)
        if not any("may belong to another impact" in note for note in found.notes):
            assert len(notes) == 1
            assert "its velocity is off by" in notes[0]
            off = float(notes[0].split("off by ")[1].split(",")[0])
            assert off == pytest.approx(0.3, abs=0.02)
        else:
            assert given is None  # with these the row is of its own impact


def test_what_the_data_do_not_determine_is_named(two_one):
    """Only M/A enters the equations: A and M move together."""
    data = measured(two_one, noise=NOISE)
    found = ci.fit(PAIR, two_one, data, ["r", "A", "M"], deviations=NOISE)
    assert "do not determine A and M apart" in found.reason
    assert np.all(np.isnan(found.covariance))
    assert "nan" not in repr(found)
    assert not found.covers({"r": 0.3})


@pytest.mark.full
def test_a_limit_on_the_way_is_the_reason():
    """Impacts faster than any of these orbits has lead to a limit of r, and no further."""
    orbit = find_orbits(OSCILLATOR, "1", parameter="r")[0]
    found = ci.fit(OSCILLATOR, orbit, {"velocity": 3.0 * orbit.velocities}, ["r"])
    assert found.reason.startswith("no minimum was reached: r: ")
    assert min(found.values["r"], 1.0 - found.values["r"]) < 1e-6
    assert np.all(np.isnan(found.covariance))


def test_at_a_fold_errors_are_said_to_be_rough(two_one):
    branch = ci.continue_orbit(two_one, "s", range=(0.3, 0.4), events=["FB"])
    data = measured(branch.events[0].orbit(), noise=NOISE)
    found = ci.fit(PAIR, two_one, data, ["s"], deviations=NOISE)
    assert any("they are rough" in note for note in found.notes)


@pytest.mark.full
def test_long_records_take_memory_in_proportion(two_one, beside):
    """Of 60,000 rows, deviations are those of 60 over the square root of 1000."""
    long = measured(two_one, laps=20000, noise=NOISE)
    found = ci.fit(OFF, beside, long, ["r", "beta"], deviations=NOISE)
    short = ci.fit(OFF, beside, measured(two_one), ["r", "beta"], deviations=NOISE)
    for name, error in found.errors.items():
        assert error == pytest.approx(short.errors[name] / math.sqrt(1000.0), rel=1e-3)


def test_files(two_one, tmp_path):
    """A file gives what columns give, and comments and empty cells are admitted."""
    data = measured(two_one)
    rows = zip(*(map(repr, map(float, data[n])) for n in ("time", "velocity")), strict=True)
    lines = [f"{w}, {t}, {v}" for w, (t, v) in zip(data["wall"], rows, strict=True)]
    file = tmp_path / "data.csv"
    file.write_text("# a comment\nwall,time,velocity\n" + "\n".join(lines) + "\n,,0.6\n")
    read = read_impacts(file)
    assert read.walls[-1] == ""
    assert math.isnan(read.times[-1])
    assert np.array_equal(read.times[:-1], data["time"])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no rows"),
        ("time\n", "no times and no velocities"),
        ("tiem\n1\n", "'tiem'"),
        ("time,time\n1,1\n", "twice"),
        ("time,velocity\n1,2\n1\n", "line 3: 1 cells under 2 names"),
        ("time,velocity\n1,2\n\n,\n", "line 4: neither time nor velocity"),
        ("time,wall\n1,B\nx,B\n", "line 3, time: 'x'"),
        ("time,wall\ninf,B\n", "line 2, time: 'inf'"),
        ("time,wall\n1,B\n1e300,T\n", "line 3, time: '1e300'"),
        ("time,wall\n1,B\n1,Q\n", "line 3, wall: 'Q'"),
    ],
)
def test_bad_files_are_refused_with_their_lines(two_one, tmp_path, text, said):
    file = tmp_path / "data.csv"
    file.write_text(text)
    with pytest.raises(ci.InputError) as error:
        ci.fit(PAIR, two_one, file, ["r"])
    assert said in str(error.value)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"parameters": ["q"]}, "no parameter 'q'"),
        ({"parameters": []}, "name at least one"),
        ({"deviations": {"time": 0.1}}, "give velocity a number > 0"),
        ({"words": "7:7"}, "no 7:7 orbit was found"),
        ({"data": {"velocity": [0.6, 0.5], "wall": "BT"}}, "row 2, velocity: 0.5 on T"),
        ({"data": "no/such/file.csv"}, "cannot be read"),
        ({"data": {"time": [1.0], "wall": ["B", "T"]}}, "unlike lengths"),
    ],
)
@pytest.mark.full
def test_other_mistakes(two_one, changes, said):
    given = {"words": two_one, "data": measured(two_one), "parameters": ["r"]} | changes
    with pytest.raises(ci.InputError) as error:
        ci.fit(PAIR, **given)
    assert said in str(error.value)


def test_orbits_that_cannot_be_compared(two_one):
    with pytest.raises(ci.InputError, match="an orbit of impact-pair; give one of oscillator"):
        ci.fit(OSCILLATOR, two_one, {"time": [1.0]}, ["r"])
    with pytest.raises(ci.InputError, match="an orbit without impacts has nothing to compare"):
        ci.fit(OSCILLATOR.replace(sigma=5.0), "0", {"time": [1.0]}, ["r"])
    free = ci.VanDerPol(epsilon=1.0, sigma=1.0, r=0.8)
    with pytest.raises(ci.InputError, match="its period is free"):
        ci.fit(free, "1", {"time": [1.0]}, ["r"])
