"""The page as a file: what it admits, where it is written, what the commands say."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import html
import json
import re
import subprocess
import sys
import webbrowser
from pathlib import Path

import pytest

from contimpact import write_diagram
from contimpact.cli import main
from contimpact.errors import InputError
from contimpact.page.data import PageView, page_data
from contimpact.page.document import FOLDER, LIBRARY, page_text, view

TOML = """
name = "frugal"
model = { system = "impact-pair", parameters = { beta = "pi/6", r = 0.3, A = 5.0, s = 0.389 } }
follow = { parameter = "s", range = [0.3885, 0.3895], orbits = ["1:1"] }
numerics = { step = 0.1, max_step = 0.1 }
"""
SCRIPT = "<script>alert(1)</script>"


@pytest.fixture
def scene(tmp_path):
    def write(plot="formats = []"):
        path = tmp_path / "scene.toml"
        path.write_text(f"{TOML}plot = {{ {plot} }}\n", encoding="utf-8")
        return str(path)

    return write


@pytest.fixture(scope="module")
def text(small, small_scene):
    return page_text(page_data(small, small_scene.model, PageView("d")))


def digest(content):
    return base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()


def test_the_policy_admits_the_scripts_and_nothing_else(text):
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)[1]
    scripts = re.findall(r"<script>(.*?)</script>", text, re.S)
    styles = re.findall(r"<style>(.*?)</style>", text, re.S)
    assert (len(scripts), len(styles)) == (2, 1)
    parts = dict(part.split(" ", 1) for part in policy.split("; "))
    assert parts["default-src"] == "'none'"
    assert parts["script-src"].split() == [f"'sha256-{digest(one)}'" for one in scripts]
    assert parts["style-src"] == f"'sha256-{digest(styles[0])}'"
    assert "unsafe" not in policy
    assert "http" not in policy


def test_nothing_is_loaded_from_elsewhere(text):
    own = text.replace((FOLDER / LIBRARY).read_text(encoding="utf-8"), "")
    assert not re.search(r"""(src|href)\s*=\s*["'](?!data:,)""", own)
    assert not re.search(r"@import|url\((?!#)", own)
    assert set(re.findall(r"https?://[\w./]*", own)) == {"http://www.w3.org/2000/svg"}


def test_the_library_is_the_one_its_notice_names():
    notice = (FOLDER / "vendor" / "README.md").read_text(encoding="utf-8")
    library = (FOLDER / LIBRARY).read_bytes()
    assert hashlib.sha256(library).hexdigest() in notice
    version = re.match(rb"// https://d3js.org v([\d.]+) ", library)[1].decode()
    assert f"D3 {version}" in notice
    assert "Mike Bostock" in (FOLDER / "vendor" / "LICENSE").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", [SCRIPT, "--></title><h1>", '" onload="x', "\u202eabc\x00"])
def test_names_are_data(small, small_scene, name):
    entry = dataclasses.replace(small.branches[0].events[0], label=name, why=name)
    branch = dataclasses.replace(small.branches[0], events=[entry], missed=[name], notation=name)
    hostile = dataclasses.replace(small, name=name, branches=[branch])
    text = page_text(page_data(hostile, small_scene.model, PageView("d", source=name)))
    assert name not in text
    head, _, rest = text.partition('<script type="application/json" id="data">')
    data = json.loads(rest.partition("</script>")[0])
    shown = name.encode("unicode_escape").decode() if not name.isprintable() else name
    assert data["name"] == data["branches"][0]["missed"][0] == shown
    assert head.count("<script") == 0
    assert head.count("<h1") == 1


def test_a_run_writes_the_page_and_lists_it(scene, tmp_path):
    folder = tmp_path / "out"
    assert main(["run", scene(), "-o", str(folder), "-q", "--html"]) == 0
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    assert "diagram.html" in manifest["files"]
    assert manifest["seconds"]["page"] > 0.0
    assert "matplotlib" not in manifest["versions"] or "matplotlib" in sys.modules
    assert main(["run", scene(), "-o", str(folder), "-q"]) == 0
    assert not (folder / "diagram.html").exists()


def test_the_scene_may_ask_for_it(scene, tmp_path):
    path = scene("formats = [], html = true, x = 'd'")
    assert main(["run", path, "-o", str(tmp_path / "out"), "-q"]) == 0
    assert (tmp_path / "out" / "diagram.html").exists()


@pytest.mark.full
def test_a_page_costs_no_matplotlib(scene, tmp_path):
    code = (
        "import sys\nfrom contimpact.cli import main\nmain(sys.argv[1:])\n"
        "print(sorted({m.split('.')[0] for m in sys.modules}))"
    )
    given = ["run", scene("html = true"), "-o", str(tmp_path / "out"), "-q", "--no-plot"]
    done = subprocess.run(
        [sys.executable, "-c", code, *given], capture_output=True, text=True, check=True
    )
    assert not {"matplotlib", "scipy", "pandas"} & set(eval(done.stdout))
    assert (tmp_path / "out" / "diagram.html").exists()


def test_the_same_bytes_every_time(scene, tmp_path):
    first, second = tmp_path / "first", tmp_path / "second"
    for folder in (first, second):
        assert main(["run", scene(), "-o", str(folder), "-q", "--html"]) == 0
    assert main(["plot", str(second), "--html"]) == 0
    one, other = ((f / "diagram.html").read_bytes() for f in (first, second))
    assert one == other


def test_plot_writes_it_where_it_is_asked_to(scene, tmp_path, capsys):
    folder, other = tmp_path / "out", tmp_path / "other.html"
    assert main(["run", scene(), "-o", str(folder), "-q"]) == 0
    assert main(["plot", str(folder), "-o", str(other), "-x", "d", "--xlim", "0.2", "0.3"]) == 0
    shown = re.search(r'"shown":(\{[^}]*\})', other.read_text(encoding="utf-8"))[1]
    assert json.loads(shown)["x"] == "d"
    assert json.loads(shown)["xlim"] == [0.2, 0.3]
    assert main(["plot", str(folder), "--html", "-o", str(tmp_path / "x.png")]) == 2
    assert "give one that ends in .html" in capsys.readouterr().err
    assert main(["plot", str(folder), "--html", "-x", "nonsense"]) == 2


def test_a_folder_written_from_python_has_a_page(small, tmp_path):
    write_diagram(small, tmp_path / "out")
    assert main(["plot", str(tmp_path / "out"), "--html"]) == 0
    assert '"unknown":null' in (tmp_path / "out" / "diagram.html").read_text(encoding="utf-8")


def test_view_opens_a_page_of_its_own_making(scene, tmp_path, monkeypatch, capsys):
    """What lies in the folder under that name may be anybody's."""
    folder, opened = tmp_path / "out", []
    assert main(["run", scene(), "-o", str(folder), "-q"]) == 0
    (folder / "diagram.html").write_text(SCRIPT, encoding="utf-8")
    monkeypatch.setattr(webbrowser, "open", lambda address: opened.append(address) or True)
    assert main(["view", str(folder)]) == 0
    assert opened == [(folder / "diagram.html").resolve().as_uri()]
    assert SCRIPT not in (folder / "diagram.html").read_text(encoding="utf-8")
    monkeypatch.setattr(webbrowser, "open", lambda address: False)
    assert main(["view", str(folder)]) == 1
    assert "no browser could be started" in capsys.readouterr().err
    assert main(["view", str(tmp_path / "nowhere")]) == 2


def test_a_simulation_has_its_attractors_on_the_page(tmp_path):
    path = tmp_path / "scene.toml"
    simulated = "simulate = { values = 2, transitions = false, branches = false }\n"
    path.write_text(f"{TOML}plot = {{ html = true }}\n{simulated}", encoding="utf-8")
    given = ["simulate", str(path), "-o", str(tmp_path / "out"), "-q", "--no-plot"]
    assert main(given) == 0
    page = (tmp_path / "out" / "diagram.html").read_text(encoding="utf-8")
    assert '"direction":"down"' in page
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["files"].count("diagram.html") == 1
    assert main(["plot", str(tmp_path / "out"), "--html"]) == 0
    assert (tmp_path / "out" / "diagram.html").read_text(encoding="utf-8") == page


def test_a_scene_named_like_a_script_shows_its_name(scene, tmp_path, capsys):
    """In all that a run writes and says; its folder stands beside that of another scene."""
    path = Path(scene())
    text = path.read_text(encoding="utf-8")
    assert 'name = "frugal"' in text
    path.write_text(text.replace('name = "frugal"', f"name = '{SCRIPT}'"), encoding="utf-8")
    other = tmp_path / "other.toml"
    other.write_text(text, encoding="utf-8")
    out = tmp_path / "out"
    assert main(["run", str(path), str(other), "-o", str(out), "--html", "--no-plot"]) == 0
    assert sorted(p.name for p in out.iterdir()) == [
        "%3Cscript%3Ealert(1)%3C%2Fscript%3E",
        "frugal",
    ]
    folder = out / "%3Cscript%3Ealert(1)%3C%2Fscript%3E"
    page = (folder / "diagram.html").read_text(encoding="utf-8")
    assert "alert(1)" in page
    assert SCRIPT not in page
    assert "<title>&lt;script&gt;alert(1)&lt;/script&gt; - contimpact</title>" in page
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.S)[1])
    assert data["name"] == SCRIPT
    assert json.loads((folder / "catalogue.json").read_text(encoding="utf-8"))["scene"] == SCRIPT
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["scene"]["resolved"]["name"] == SCRIPT
    assert f"{SCRIPT} (1 of 2), " in capsys.readouterr().err
    assert main(["plot", str(folder), "--html"]) == 0
    assert SCRIPT not in (folder / "diagram.html").read_text(encoding="utf-8")


def test_scenes_with_one_folder_are_not_run(scene, tmp_path, capsys):
    text = Path(scene()).read_text(encoding="utf-8")
    paths = []
    for number, name in enumerate(["a: b", "A: B"]):
        paths.append(tmp_path / f"{number}.toml")
        paths[-1].write_text(text.replace('name = "frugal"', f"name = '{name}'"), encoding="utf-8")
    assert main(["run", *map(str, paths), "-o", str(tmp_path / "out"), "--no-plot"]) == 2
    assert "'a: b' and 'A: B' are one folder" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_notebook_is_given_the_page_in_a_frame(small, tmp_path):
    live = small.view(x="d", height=500)
    frame = live._repr_html_()
    assert frame.isascii()  # whatever encoding a notebook is written in
    assert html.unescape(re.search(r'srcdoc="([^"]*)"', frame)[1]) == live.text
    assert "height: 500px" in frame
    assert "allow-same-origin" not in frame
    live.save(tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == live.text
    assert json.loads(data_of(live.text))["shown"]["x"] == "d"
    assert json.loads(data_of(view(small["b1"]).text))["parameter"] == "s"
    with pytest.raises(InputError, match="x: no branch has 'y'"):
        small.view(x="y")


def test_a_page_without_a_known_system_says_so(small):
    """In a notebook, too; a diagram without anything has no page."""
    branch = dataclasses.replace(small["b1"], system="nobody")
    assert "nobody are not known" in json.loads(data_of(view(branch).text))["unknown"]
    with pytest.raises(InputError, match="there is nothing in it"):
        dataclasses.replace(small, branches=[]).view()


def data_of(text):
    """The data of a page."""
    return re.search(r'id="data">(.*?)</script>', text, re.S)[1]
