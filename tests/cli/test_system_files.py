"""Systems of one's own in scenes: files named on the command line, and plugins."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys

import pytest
from zoo import ROOT

from contimpact import InputError, load_scene, read_scene
from contimpact.cli import main
from contimpact.studies.study import Study
from contimpact.systems import system

SCENE = """
name = "ball"
[model]
system = "my-ball"
[model.parameters]
a = "1.3*9.8/50**2"
omega = 50
r = 0.5
[follow]
parameter = "a"
range = [0.004, 0.0062]
orbits = ["1"]
[detect]
events = ["FB", "PD"]
[simulate]
range = [0.0045, 0.006]
values = 3
"""
BALL = (ROOT / "examples" / "bouncing_ball.py").read_text(encoding="utf-8")
BALL = BALL.replace('SYSTEM = "bouncing-ball"', 'SYSTEM = "my-ball"')


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the scene and the system's file; modules made here are forgotten."""
    (tmp_path / "scene.toml").write_text(SCENE)
    (tmp_path / "my_ball.py").write_text(BALL)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.full
def test_every_command_takes_a_system_file(folder, capsys):
    own = ["--system", "my_ball.py"]
    assert main(["check", "scene.toml", *own]) == 0
    said = capsys.readouterr().out
    assert "checked  derived parameters, period, flight from P, reset at P" in said
    assert main(["run", "scene.toml", "-o", "out", "-q", "--no-plot", *own]) == 0
    assert main(["plot", "out", "-o", "out.svg", "-x", "Gamma", *own]) == 0
    assert main(["simulate", "scene.toml", "-o", "sim", "-q", "--no-plot", *own]) == 0
    assert main(["report", "scene.toml", "-o", "rep", "-q", "-n", "0", *own]) == 2
    said = capsys.readouterr().err.splitlines()[-1]  # a slow machine tells its progress before
    assert said.startswith("contimpact: repetitions: ")  # the scene is read
    assert (folder / "out.svg").exists()
    assert ",FB," in (folder / "out" / "events.csv").read_text()


def test_without_it_the_scene_is_refused(folder, capsys):
    assert main(["check", "scene.toml"]) == 2
    error = capsys.readouterr().err
    assert "no system 'my-ball'; accepted are belt, bouncing-ball" in error
    assert "and a system of your own by --system FILE.py" in error


MU = (ROOT / "examples" / "requested_multiplier.py").read_text(encoding="utf-8")
HALF = MU.replace('name = "MU"', 'name = "HALF"')
HALF_AT = math.hypot(math.pi / 3, (1.25 - 0.5 - 0.25 / 0.5) / 2.25) * 9.8 / 50**2
"""The amplitude at which a multiplier of the ball's orbit is 0.5, where r = 0.5; see `amplitude` in
tests/bifurcations/test_kinds.py."""


def test_a_kind_of_ones_own_in_a_scene(folder, capsys):
    """It is located and drawn; without its file it is refused."""
    (folder / "half.py").write_text(HALF)
    scene = SCENE.replace('"PD"]', '"HALF"]\n[plot]\nhtml = true')
    (folder / "scene.toml").write_text(scene)
    ball, half = ["--system", "my_ball.py"], ["--system", "half.py"]
    alone = subprocess.run(
        [sys.executable, "-m", "contimpact", "check", "scene.toml", *ball],
        capture_output=True,
        text=True,
    )
    assert alone.returncode == 2
    assert "no event kind 'HALF'" in alone.stderr
    assert "UZ, and a kind of your own by --system FILE.py" in alone.stderr
    assert main(["run", "scene.toml", "-o", "out", "-q", *ball, *half]) == 0
    entries = json.loads((folder / "out" / "catalogue.json").read_text())["entries"]
    (found,) = (entry for entry in entries if entry["kind"] == "HALF")
    assert found["method"] == "newton"
    assert abs(found["parameters"]["a"] - HALF_AT) <= found["error"] < 1e-15
    assert '"HALF":{"marker":"d"' in (folder / "out" / "diagram.html").read_text()


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("own.py", MU.replace('name = "MU"', 'name = "G"'), "MU.name is 'G' as in the package"),
        ("none.py", None, "none.py: no such file"),
        ("scene.toml", SCENE, "scene.toml: no Python file; give a file that ends in .py"),
        ("own.py", "import nothing_of_that_name", "(ModuleNotFoundError: No module named"),
        ("own.py", "\n\nx = 1/0", "(ZeroDivisionError: division by zero, line 3)"),
        ("own.py", "def f(:", "(SyntaxError: "),
        ("own.py", "import sys; sys.exit(3)", "(SystemExit: 3, line 1)"),
        ("own.py", "open('nothing.csv')", "own.py: it cannot be run ("),
        ("own.py", "from contimpact import Model", "own.py: it defines no system; define a sub"),
        ("own.py", BALL.replace('"P", side', '"PP", side'), "own.py: BouncingBall.WALLS: a wall"),
        ("own.py", BALL.replace("my-ball", "oscillator"), "SYSTEM is 'oscillator' as in the pack"),
        ("own.py", BALL, "SYSTEM is 'my-ball' as in another file or class"),
    ],
)
def test_files_that_are_refused(folder, capsys, name, text, says):
    if text is not None:
        (folder / name).write_text(text)
    given = ["--system", "my_ball.py", "--system", "my_ball.py", "--system", name]
    assert main(["run", "scene.toml", "-o", "out", *given]) == 2
    assert says in capsys.readouterr().err
    assert not (folder / "out").exists()


def test_from_python_classes_are_given(folder):
    namespace = {"__name__": "mine"}
    exec(BALL, namespace)
    own = {"my-ball": namespace["BouncingBall"]}
    scene = load_scene("scene.toml", own)
    assert type(scene.model) is namespace["BouncingBall"]
    assert read_scene(scene.resolved(), own).model.values == scene.model.values


USES_A_HELPER = BALL.replace("import math\n", "import math\nfrom helper import GAIN, Base\n")
USES_A_HELPER = USES_A_HELPER.replace("class BouncingBall(Model)", "class BouncingBall(Base)")
USES_A_HELPER = USES_A_HELPER.replace("force / g}", "GAIN * self.more() * force / g}")
HELPER = """
from contimpact import Model

def closed_over(x):
    return lambda: x

GAIN = {gain}

class Base(Model):
    def more(self):
        return {base} * CLOSURE()

CLOSURE = closed_over({closure})
"""


@pytest.mark.full
def test_kernels_follow_what_a_file_is_made_of(folder):
    """A helper module, a base class, a closure: each edited, in processes with one cache."""
    (folder / "my_ball.py").write_text(USES_A_HELPER)

    def gamma(**numbers):
        (folder / "helper.py").write_text(HELPER.format(**numbers))
        command = [sys.executable, "-m", "contimpact", "check", "scene.toml"]
        done = subprocess.run(
            [*command, "--system", "my_ball.py"],
            check=True,
            capture_output=True,
            text=True,
            env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1", "PYTHONPATH": str(ROOT)},
        )
        line = next(line for line in done.stdout.splitlines() if "Gamma" in line)
        return float(line.rpartition("=")[2])

    assert gamma(gain=1, base=1, closure=1) == pytest.approx(1.3)
    assert gamma(gain=2, base=1, closure=1) == pytest.approx(2.6)
    assert gamma(gain=2, base=3, closure=1) == pytest.approx(7.8)
    assert gamma(gain=2, base=3, closure=5) == pytest.approx(39.0)


@pytest.fixture
def plugin(tmp_path, monkeypatch):
    """``plugin(entry, text)``: a distribution that is installed for as long as the test runs."""

    def install(entry, text=BALL):
        (tmp_path / "balls.py").write_text(text)
        info = tmp_path / "balls-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: balls\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[contimpact.systems]\n{entry}\n")
        monkeypatch.syspath_prepend(tmp_path)
        monkeypatch.delitem(sys.modules, "balls", raising=False)

    yield install
    sys.modules.pop("balls", None)


@pytest.mark.full
def test_a_plugin_is_a_system_like_the_packages_own(folder, plugin):
    plugin("my-ball = balls:BouncingBall")
    assert system("my-ball").__module__ == "balls"
    assert main(["run", "scene.toml", "-o", "out", "-q", "--no-plot"]) == 0
    assert main(["plot", "out", "-o", "out.svg"]) == 0
    with pytest.raises(InputError, match=r"accepted are belt, bouncing-ball, .*, my-ball, and"):
        system("your-ball")


@pytest.mark.parametrize(
    ("entry", "text", "says"),
    [
        ("my-ball = balls:Nothing", BALL, r"^plugin balls:Nothing: it cannot be loaded \(Attrib"),
        ("my-ball = balls:x", "x = 1", "^plugin balls:x: found 1; it has to be a subclass"),
        ("your-ball = balls:BouncingBall", BALL, "its SYSTEM is 'my-ball'; .*called 'your-ball'"),
        ("my-ball = balls:x", "1/0", r"cannot be loaded \(ZeroDivisionError"),
    ],
)
def test_plugins_that_are_refused(plugin, entry, text, says):
    plugin(entry, text)
    with pytest.raises(InputError, match=says):
        system(entry.split(" ")[0])


def test_a_study_of_a_system_and_a_kind_of_ones_own(folder, capsys):
    """Its workers run the files; a changed file is another study."""
    (folder / "half.py").write_text(HALF)
    text = SCENE.replace('"PD"]', '"HALF"]').replace("omega = 50\n", "")
    text = text[: text.index("[simulate]")] + "[study]\n[study.grid]\nomega = [49, 50]\n"
    (folder / "study.toml").write_text(text)
    study = ["study", "study.toml", "-o", "store.sqlite", "-q", "--workers", "1"]
    own = ["--system", "my_ball.py", "--system", "half.py"]
    assert main(study) == 2
    assert "a system of your own by --system FILE.py" in capsys.readouterr().err
    assert main([*study, *own]) == 0
    with Study("store.sqlite", systems=own[1::2]) as found:
        events = [event for event in found.events() if event["kind"] == "HALF"]
        assert found.file.first.model.SYSTEM == "my-ball"
    places = [HALF_AT * (50 / omega) ** 2 for omega in (49, 50)]
    assert [event["value"] for event in events] == pytest.approx(places, rel=1e-13)
    with (folder / "my_ball.py").open("a") as file:
        file.write("# changed\n")
    assert main([*study, *own]) == 2
    assert "another study called 'ball' is in it" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_an_interruption_while_a_text_is_executed_has_its_exit_status(folder):
    """CPython ends ``python -m`` as by SIGINT otherwise, though the interruption was handled."""
    text = "exec('import os, signal; os.kill(os.getpid(), signal.SIGINT); [i for i in range(9)]')"
    (folder / "my_ball.py").write_text(f"{BALL}\n{text}\n")
    command = [sys.executable, "-m", "contimpact", "check", "scene.toml", "--system", "my_ball.py"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (1, "contimpact: interrupted\n")
