"""SIGTERM, as schedulers send it, loses nothing that was computed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from contimpact.cli import main
from contimpact.cli.console import Interruption, defer_interruptions

pytestmark = pytest.mark.skipif(os.name != "posix", reason="sends a POSIX signal")

SCENE = """
name = "long"
[model]
system = "impact-pair"
[model.parameters]
beta = "pi/6"
r = 0.3
A = 5.0
s = 0.45
[follow]
parameter = "s"
range = [0.3, 0.6]
orbits = ["1:1"]
[detect]
events = ["G"]
[simulate]
values = 100000
branches = true
"""


@pytest.mark.full
def test_what_a_simulation_found_is_written(tmp_path):
    file, folder = tmp_path / "long.toml", tmp_path / "out"
    file.write_text(SCENE, encoding="utf-8")
    command = [sys.executable, "-m", "contimpact", "simulate", str(file), "-o", str(folder)]
    with subprocess.Popen([*command, "--no-plot"], stderr=subprocess.PIPE, text=True) as process:
        rows, limit = folder / "rows.jsonl", time.monotonic() + 60.0
        while time.monotonic() < limit:
            if rows.exists() and rows.read_bytes().count(b"\n") > 3:
                break
            time.sleep(0.05)
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "interrupted (sweep)" in err
    names = {path.name for path in folder.iterdir()}
    assert {"sweep.csv", "catalogue.json", "manifest.json"} <= names


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_a_command_that_is_asked_to_end_says_that_it_was_interrupted(name, monkeypatch, capsys):
    number = getattr(signal, name)
    before = signal.getsignal(number)

    def ended(options):
        signal.raise_signal(number)

    monkeypatch.setattr("contimpact.cli.scenes.check", ended)
    assert main(["check", "scene.toml"]) == 1
    assert "interrupted" in capsys.readouterr().err
    assert signal.getsignal(number) is before


def test_writing_is_not_cut_short():
    interruption = Interruption()
    with defer_interruptions(interruption):
        signal.raise_signal(signal.SIGTERM)
        assert interruption.happened


def test_a_signal_that_is_ignored_stays_so_while_results_are_written(monkeypatch):
    """As after nohup, or in the background of a script."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    interruption = Interruption()
    try:
        with defer_interruptions(interruption):
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)
    assert not interruption.happened


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM"])
def test_a_signal_that_comes_when_all_is_done_changes_no_status(name):
    ending = f"import atexit, signal; atexit.register(signal.raise_signal, signal.{name});"
    command = "from contimpact import cli; cli.main = lambda: 0; cli.program()"
    assert (
        subprocess.run([sys.executable, "-c", f"{ending} {command}"], check=False).returncode == 0
    )
