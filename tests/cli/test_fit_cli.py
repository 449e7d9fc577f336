"""``contimpact fit`` on files of synthetic data, and the picture of residuals."""

from __future__ import annotations

import numpy as np
import pytest
from zoo import SMALL

import contimpact as ci
from contimpact.cli import main

GIVEN = ["--deviation", "time=0.002", "--deviation", "velocity=0.005"]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A scene, and a file of the impacts of its stable 1:1 orbit in ten periods, with noise."""
    folder = tmp_path_factory.mktemp("fit")
    (folder / "scene.toml").write_text(SMALL)
    scene = ci.load_scene(folder / "scene.toml")
    orbit = next(o for o in ci.find_orbits(scene.model, "1:1") if o.physical)
    rng, lines = np.random.default_rng(3), ["time,velocity,wall"]
    for lap in range(10):
        for wall, t, v in zip(orbit.word.walls, orbit.times, orbit.velocities, strict=True):
            t, v = t + 2.0 * lap + 0.3, v + 0.005 * rng.standard_normal()
            lines.append(f"{t + 0.002 * rng.standard_normal():.17g},{v:.17g},{wall}")
    (folder / "data.csv").write_text("\n".join(lines) + "\n")
    return folder


def called(files, *options):
    return main(["fit", str(files / "scene.toml"), str(files / "data.csv"), *options])


@pytest.mark.full
def test_a_fit_is_printed_and_drawn(files, capsys):
    target = files / "fit.png"
    assert called(files, "--parameter", "r", *GIVEN, "-o", str(target)) == 0
    told = capsys.readouterr().out
    assert "Fit of 1:1 (BT), " in told
    assert "  r = " in told
    assert "  clock = " in told
    assert target.read_bytes()[:4] == b"\x89PNG"


def test_a_file_that_cannot_be_read_is_told_in_words(files, capsys):
    scene, missing = str(files / "scene.toml"), str(files / "none.csv")
    assert main(["fit", scene, missing, "--parameter", "r"]) == 2
    told = capsys.readouterr().err
    assert "none.csv: it cannot be read (No such file or directory); give a CSV file" in told


@pytest.mark.full
def test_nothing_is_printed_where_that_is_asked_for(files, capsys):
    assert called(files, "--parameter", "r", *GIVEN, "-q") == 0
    assert capsys.readouterr() == ("", "")
    assert called(files, "--parameter", "A", "--parameter", "M", "--orbit", "1:1", "-q") == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert "do not determine A and M apart" in err


@pytest.mark.full
def test_what_is_not_determined_is_a_failure(files, capsys):
    assert called(files, "--parameter", "A", "--parameter", "M", "--orbit", "1:1") == 1
    assert "do not determine A and M apart" in capsys.readouterr().out


@pytest.mark.parametrize("text", ["time", "time=x", "time=-1", "phase=1", "time=nan"])
def test_deviations_are_numbers_of_what_is_measured(files, capsys, text):
    assert called(files, "--parameter", "r", "--deviation", text) == 2
    assert "give time=NUMBER or velocity=NUMBER" in capsys.readouterr().err


def test_a_format_that_is_none_is_refused_first(files, capsys):
    assert called(files, "--parameter", "r", "-o", "fit.txt") == 2
    assert "'txt'; accepted are svg, png, pdf" in capsys.readouterr().err


@pytest.mark.full
def test_the_picture_has_a_point_for_each_number(files):
    scene = ci.load_scene(files / "scene.toml")
    found = ci.fit(scene.model, "1:1", files / "data.csv", ["r"])
    for ax in found.plot():
        assert sum(len(line.get_xdata()) for line in ax.lines if line.get_marker() in "o^") == 20
    impacts = {"velocity": found.data.velocities, "wall": list(found.data.walls)}
    (ax,) = ci.plot_fit(ci.fit(scene.model, "1:1", impacts, ["r"]))
    assert ax.get_xlabel() == "row"
    assert "standard deviation" in found.summary().columns
