"""The points of studies, and study files that are none."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import qmc
from small_studies import study_given

from contimpact.errors import InputError
from contimpact.studies.study_file import load_study, read_study

BETA = {"from": 0.2, "to": 0.4, "count": 3}


def test_a_grid_has_all_combinations_the_last_axis_fastest():
    study = read_study(study_given(grid={"beta": BETA, "r": [0.3, 0.5]}))
    numbers, values = study.points
    assert study.design.names == ("beta", "r")
    assert numbers.tolist() == [*range(6)]
    expected = [[b, r] for b in (0.2, 0.3, 0.4) for r in (0.3, 0.5)]
    np.testing.assert_allclose(values, expected, rtol=1e-15)


def test_values_at_equal_ratios():
    spaced = {"from": 0.1, "to": 0.4, "count": 3, "spacing": "log"}
    study = read_study(study_given(grid={"r": spaced, "beta": [0.3]}))
    np.testing.assert_allclose(study.points[1][:, 0], [0.1, 0.2, 0.4], rtol=1e-14)


@pytest.mark.parametrize("method", ["random", "sobol"])
def test_a_sample_fills_its_ranges_and_depends_on_the_seed_alone(method):
    def points(seed):
        sample = {
            "method": method,
            "count": 100,
            "seed": seed,
            "range": {"beta": [0.2, 0.4], "r": [0.3, 0.5]},
        }
        given = study_given(sample=sample)
        del given["study"]["grid"]
        return read_study(given).points[1]

    unit = (points(1) - [0.2, 0.3]) / 0.2
    assert unit.shape == (100, 2)
    assert np.all((unit >= 0) & (unit <= 1))
    np.testing.assert_array_equal(points(1), points(1))
    assert np.any(points(1) != points(2))
    if method == "sobol":  # far more even than points drawn at random
        drawn = np.random.default_rng(0).random((100, 2))
        assert qmc.discrepancy(unit) < 0.3 * qmc.discrepancy(drawn)


def test_a_grid_of_samples():
    sample = {"method": "random", "count": 5, "range": {"r": [0.3, 0.5]}}
    study = read_study(study_given(grid={"beta": [0.3, 0.4]}, sample=sample))
    values = study.points[1]
    assert len(study) == 10
    np.testing.assert_array_equal(values[:5, 1], values[5:, 1])


@pytest.mark.parametrize(
    "constraint", ["1/(r - 0.3) > 0", "r/(r - 0.3) >= 1", "sqrt(r - 0.35) >= 0", "log(r - 0.3) < 1"]
)
def test_constraints_leave_points_out_at_which_they_have_no_value(constraint):
    given = study_given(grid={"r": [0.3, 0.4], "beta": [0.3]}, constraints=[constraint])
    assert read_study(given).points[0].tolist() == [1]


def test_constraints_leave_points_out_and_their_numbers_too():
    grid = {"r_B": [0.3, 0.4, 0.5], "r_T": [0.3, 0.4, 0.5], "beta": [0.3]}
    given = study_given(grid=grid, constraints=["r_T <= r_B", "0.35 < r_B*A/5 <= sqrt(0.25)"])
    numbers, values = read_study(given).points
    assert values[:, :2].tolist() == [[0.4, 0.3], [0.4, 0.4], [0.5, 0.3], [0.5, 0.4], [0.5, 0.5]]
    assert numbers.tolist() == [3, 4, 6, 7, 8]


def test_scenes_have_the_studys_values_and_no_table_study():
    study = read_study(study_given())
    scene = study.scene_at(study.points[1][1], 1)
    assert scene["model"]["parameters"] == {"A": 5.0, "s": 0.389, "beta": math.pi / 9, "r": 0.35}
    assert "study" not in scene
    assert scene["name"] == "small-1"


def of_study(**changes):
    return {"study": study_given()["study"] | changes}


WRONG = [
    (of_study(grid={}), "study", "no parameter differs"),
    (of_study(grid={"beta": []}), "study.grid.beta", "empty"),
    (
        of_study(grid={"beta": {"from": 0.3, "to": 0.3, "count": 2}}),
        "study.grid.beta",
        "a value twice",
    ),
    (of_study(grid={"beta": {**BETA, "cuont": 3}}), "study.grid.beta.cuont", "did you mean"),
    (of_study(grid={"beta": {**BETA, "spacing": "cubic"}}), "study.grid.beta.spacing", "cubic"),
    (of_study(grid={"beta": {**BETA, "from": 0, "spacing": "log"}}), "study.grid.beta", "from 0"),
    (of_study(grid={"beta": [0.3], "r": [0.3, 1.5]}), "study.grid.r", "at r = 1.5"),
    (of_study(grid={"beta": [0.3], "r": [0.3], "s": [0.3]}), "model.parameters.s", "differs"),
    (of_study(grid={"beta": [0.3], "rho": [0.3]}), "study.grid.rho", "no such parameter"),
    (of_study(keep=["everything"]), "study.keep[0]", "everything"),
    (of_study(keep=["attractors"]), "study.keep[0]", "no [simulate]"),
    (of_study(keep=["curves"]), "study.keep[0]", "no [curves]"),
    (of_study(budget=0), "study.budget", "0"),
    (of_study(constraints=["r"]), "study.constraints[0]", "'r'"),
    (of_study(constraints=["r < 0.1"]), "study.constraints", "admit none of 4 points"),
    (of_study(constraints=["rho < 1"]), "study.constraints[0]", "rho"),
    (of_study(constraints=["().__class__ < 1"]), "study.constraints[0]", "__class__"),
    (of_study(sample={"method": "latin", "count": 2, "range": {}}), "study.sample.method", "latin"),
    (
        of_study(sample={"method": "random", "count": 2, "range": {"r": [0.1, 0.2]}}),
        "study.sample.range.r",
        "in the grid already",
    ),
    (
        of_study(grid={n: {"from": 0, "to": 1, "count": 10**4} for n in ("beta", "r")}),
        "study",
        "100000000 scenes",
    ),
    (
        of_study(grid={n: {"from": 0, "to": 1, "count": 10**7} for n in ("beta", "r", "A")}),
        "study",  # before values are made
        "1000000000000000000000 scenes",
    ),
    (of_study(gird={}), "study.gird", "unknown key"),
]


@pytest.mark.parametrize(("changes", "where", "found"), WRONG)
def test_what_is_no_study_is_refused_with_its_place(changes, where, found):
    with pytest.raises(InputError) as caught:
        read_study(study_given() | changes)
    assert caught.value.where == where
    assert found in caught.value.found


def test_a_choice_that_is_missing_is_named():
    with pytest.raises(InputError) as caught:
        read_study(study_given() | of_study(sample={"count": 2, "range": {}}))
    assert (caught.value.where, caught.value.found) == ("study.sample.method", "missing")
    assert caught.value.accepted == 'give "random" or "sobol"'


def test_a_scene_is_no_study_and_a_study_no_scene(tmp_path):
    from small_studies import TOML

    from contimpact import load_scene

    text = TOML.format(name="small", count=2)
    (tmp_path / "study.toml").write_text(text)
    (tmp_path / "scene.toml").write_text(text.partition("[study]")[0])
    assert len(load_study(tmp_path / "study.toml")) == 4
    with pytest.raises(InputError, match=r"no table \[study\]; .*contimpact run"):
        load_study(tmp_path / "scene.toml")
    with pytest.raises(InputError, match="contimpact study"):
        load_scene(tmp_path / "study.toml")
