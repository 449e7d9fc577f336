"""Processes killed at random moments: what they leave is whole or recognised as unfinished.

A folder that is not recognised as unfinished holds exactly what an undisturbed run of one of the
scenes writes, and a rerun gives exactly that again, whatever was killed in it before.
"""

from __future__ import annotations

import functools
import importlib.util
import json
import os
import random
import subprocess
import sys
import time

import pytest

from contimpact import load_diagram
from contimpact.cli import main
from contimpact.errors import InputError
from contimpact.results.catalogue import simulation_remarks
from contimpact.results.result_folder import MARK, ROWS
from contimpact.storage import LOCK

pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="POSIX signals"),
    pytest.mark.usefixtures("compiled_where_it_pays"),
]

SCENE = """
name = "{name}"
[model]
system = "impact-pair"
parameters = {{ beta = "pi/6", r = {r}, A = 5.0, s = 0.34 }}
[follow]
parameter = "s"
range = [0.3, 0.4]
orbits = ["1:1"]
[detect]
events = ["PD", "G"]
[plot]
x = "d"
[simulate]
range = [0.33, 0.39]
values = 4
direction = "both"
periods = 200
impacts = 100
starts = 1
width = 1e-3
branches = true
"""
QUICK = {"together": 4, "simulate": 2}
MANY = {"run": 34, "together": 30, "simulate": 28, "compile": 8}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """``undisturbed(command, name)``: the scene's file, its folder, and the seconds it takes."""
    base = tmp_path_factory.mktemp("undisturbed")

    @functools.cache
    def result(command, name):
        path, folder = base / f"{name}.toml", base / command / name
        r = {"one": 0.3, "two": 0.35}[name]
        path.write_text(SCENE.format(name=name, r=r), encoding="utf-8")
        assert main([command, str(path), "-o", str(folder), "-q"]) == 0  # makes the kernels
        began = time.monotonic()
        assert finished(started(command, path, folder)) == 0
        return path, folder, time.monotonic() - began

    return result


def started(command, path, folder, *more, **environment):
    """A command in a process of its own."""
    return subprocess.Popen(
        [sys.executable, "-m", "contimpact", command, path, "-o", folder, "-q", *more],
        env=os.environ | environment,
        stderr=subprocess.DEVNULL,
    )


def finished(process):
    try:
        return process.wait(timeout=600)
    finally:
        process.kill()


def killed(rng, folder, seconds, *processes):
    """Kill processes at random moments; every other time, of the short while of writing."""
    if rng.random() < 0.5:
        limit = time.monotonic() + 60
        while not (folder / MARK).exists() and time.monotonic() < limit:
            if all(process.poll() is not None for process in processes):
                break
            time.sleep(0.0005)
        time.sleep(rng.uniform(0.0, 0.3 * seconds))
    else:
        time.sleep(rng.uniform(0.0, seconds))
    for process in processes:
        process.kill()
        process.wait()


def contents(folder):
    """Every file but the manifest, which holds times, and what a killed process leaves."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name not in ("manifest.json", LOCK) and path.suffix != ".tmp"
    }


def whole(folder):
    """Whether a folder's results are not recognised as unfinished."""
    if not (folder / "manifest.json").exists():
        return False
    if (folder / MARK).exists():
        with pytest.raises(InputError, match=MARK):
            load_diagram(folder)
        return False
    return load_diagram(folder) is not None


def ended_early(folder):
    """Whether a simulation was killed after its attractors had been written: that is said."""
    stopped = json.loads((folder / "manifest.json").read_text()).get("stopped")
    if stopped:
        assert any(stopped in remark for remark in simulation_remarks(folder))
    return bool(stopped)


def is_one_of(folder, references):
    """Whether a folder holds what one of these do, and the manifest that goes with it."""
    name = json.loads((folder / "manifest.json").read_text())["scene"]["resolved"]["name"]
    expected = contents(references[name])
    found = contents(folder)
    found[ROWS] = expected[ROWS] = b""  # kept as it is found, and says itself what it is of
    assert found == expected


def is_like_undisturbed(folder, reference):
    assert contents(folder) == contents(reference)
    assert not [path for path in folder.rglob("*") if path.suffix == ".tmp"]
    assert not (folder / LOCK).exists()


def kill_runs(undisturbed, tmp_path, rng, times, together):
    """Runs of two scenes, killed one after the other or at once, in one folder."""
    folder = tmp_path / "out"
    references = {name: undisturbed("run", name)[1] for name in ("one", "two")}
    for number in range(times):
        names = ["one", "two"] if together else [rng.choice(["one", "two"])]
        rng.shuffle(names)
        processes = [started("run", undisturbed("run", n)[0], folder) for n in names]
        killed(rng, folder, undisturbed("run", names[0])[2], *processes)
        if whole(folder):
            is_one_of(folder, references)
        if number % 4 == 3 or number == times - 1:
            path, reference, _ = undisturbed("run", names[0])
            assert finished(started("run", path, folder)) == 0
            is_like_undisturbed(folder, reference)


def kill_simulations(undisturbed, tmp_path, rng, times):
    """Simulations killed and resumed, over and over, sometimes two at once."""
    path, reference, seconds = undisturbed("simulate", "one")
    for number in range(times):
        folder = tmp_path / f"out{number // 4}"
        two = 1 + (rng.random() < 0.5)
        killed(
            rng,
            folder,
            seconds,
            *(started("simulate", path, folder, "--resume") for _ in range(two)),
        )
        if whole(folder) and not ended_early(folder):
            is_one_of(folder, {"one": reference})
        if number % 4 == 3 or number == times - 1:
            assert finished(started("simulate", path, folder, "--resume")) == 0
            is_like_undisturbed(folder, reference)


def kill_compiling(undisturbed, tmp_path, rng, times):
    """Killed while compiling into a cache of its own, two processes at once."""
    path, reference, _ = undisturbed("run", "one")
    settings = {"CONTIMPACT_CACHE": str(tmp_path / "cache"), "CONTIMPACT_COMPILED": "always"}
    for _ in range(times):
        places = [tmp_path / name for name in ("a", "b")]
        processes = [started("run", path, place, **settings) for place in places]
        time.sleep(rng.uniform(0.0, 25.0))
        for process in processes:
            process.kill()
            process.wait()
    assert finished(started("run", path, tmp_path / "out", **settings)) == 0
    is_like_undisturbed(tmp_path / "out", reference)
    assert not list((tmp_path / "cache").glob(".*.tmp"))


def kill(kind, undisturbed, tmp_path, times):
    rng = random.Random(f"{kind} {times}")
    if kind == "simulate":
        kill_simulations(undisturbed, tmp_path, rng, times)
    elif kind == "compile":
        kill_compiling(undisturbed, tmp_path, rng, times)
    else:
        kill_runs(undisturbed, tmp_path, rng, times, kind == "together")


@pytest.mark.parametrize("kind", QUICK)
@pytest.mark.full
def test_a_few_kills(undisturbed, tmp_path, kind):
    kill(kind, undisturbed, tmp_path, QUICK[kind])


@pytest.mark.slow
@pytest.mark.parametrize("kind", MANY)
def test_a_hundred_kills(undisturbed, tmp_path, kind):
    if kind == "compile" and importlib.util.find_spec("llvmlite") is None:
        pytest.skip("the extra 'fast' is not installed")
    kill(kind, undisturbed, tmp_path, MANY[kind])
