"""Folders of results: nothing of the user's is touched, nothing of two runs is mixed."""

from __future__ import annotations

import contextlib
import json
import lzma
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from zoo import ROOT, SMALL

from contimpact import load_diagram, load_scene, write_diagram
from contimpact.cli import main
from contimpact.cli import run as commands
from contimpact.errors import InputError, NotWrittenError
from contimpact.results.catalogue import load_entries
from contimpact.results.diagram import Diagram
from contimpact.results.formats import write_auto, write_mat
from contimpact.results.result_folder import MARK, ROWS, hold_folder, own_files, renew_folder
from contimpact.storage import LOCK, hold_lock, sha256, temporary_beside, this_process

BRANCHES = ROOT / "branches"
SCENE = f"""{SMALL}[plot]
x = "d"
formats = ["png"]
"""
SIMULATE = """
[simulate]
range = [0.33, 0.36]
values = 3
periods = 200
impacts = 100
transitions = false
"""
links = pytest.mark.skipif(os.name != "posix", reason="links")


@pytest.fixture
def scene(tmp_path):
    """``scene(text)``: the path of a scene."""

    def write(text=SCENE, name="scene.toml"):
        (tmp_path / name).write_text(text, encoding="utf-8")
        return str(tmp_path / name)

    return write


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("folder")
    (folder / "scene.toml").write_text(SCENE, encoding="utf-8")
    assert run("run", folder / "scene.toml", "-o", folder / "out", "-q") == 0
    return folder / "out"


@pytest.fixture
def out(results, tmp_path):
    return Path(shutil.copytree(results, tmp_path / "out"))


def run(*arguments):
    return main([str(argument) for argument in arguments])


def names(folder):
    return {p.relative_to(folder).as_posix() for p in folder.rglob("*") if not p.is_dir()}


def manifest_of(folder):
    return json.loads((folder / "manifest.json").read_text(encoding="utf-8"))


# Links


@pytest.mark.full
@links
def test_files_that_are_links_are_replaced_and_not_followed(scene, out, tmp_path):
    victim = tmp_path / "thesis.tex"
    victim.write_text("kept")
    for name in names(out):
        (out / name).unlink()
        (out / name).symlink_to(victim)
    assert run("run", scene(), "-o", out, "-q") == 0
    assert victim.read_text() == "kept"
    assert not any(path.is_symlink() for path in out.rglob("*"))
    assert load_diagram(out).name == "small"


@links
@pytest.mark.parametrize("inside", [True, False])
@pytest.mark.full
def test_a_picture_that_is_a_link_is_replaced(out, tmp_path, inside):
    victim, target = tmp_path / "thesis.tex", out / "diagram.png" if inside else tmp_path / "a.png"
    victim.write_text("kept")
    target.unlink(missing_ok=True)
    target.symlink_to(victim)
    assert run("plot", out, *(() if inside else ("-o", target))) == 0
    assert victim.read_text() == "kept"
    assert target.read_bytes().startswith(b"\x89PNG")


@links
@pytest.mark.parametrize("write", [write_auto, write_mat])
def test_exports_do_not_follow_links(out, tmp_path, write):
    victim, target = tmp_path / "thesis.tex", tmp_path / "b.branch"
    victim.write_text("kept")
    target.symlink_to(victim)
    write(load_diagram(out).branches[0], target)
    assert victim.read_text() == "kept"
    assert target.stat().st_size > 100


@links
@pytest.mark.parametrize("command", ["run", "simulate"])
def test_a_linked_folder_in_a_result_folder_is_refused(scene, out, tmp_path, capsys, command):
    elsewhere = tmp_path / "elsewhere"
    (out / "branches").rename(elsewhere)
    (out / "branches").symlink_to(elsewhere)
    before = {name: (elsewhere / name).read_bytes() for name in names(elsewhere)}
    assert run(command, scene(SCENE + SIMULATE), "-o", out, "-q") == 2
    assert f"{out / 'branches'}: a link; move it" in capsys.readouterr().err
    assert {name: (elsewhere / name).read_bytes() for name in names(elsewhere)} == before
    with pytest.raises(InputError, match="branches: a link"):
        write_diagram(load_diagram(out), out)


@links
@pytest.mark.full
def test_a_mark_does_not_follow_links(scene, out, tmp_path):
    (tmp_path / "victim").write_text("kept")
    (out / MARK).symlink_to(tmp_path / "victim")
    assert run("run", scene(), "-o", out, "-q") == 0
    assert (tmp_path / "victim").read_text() == "kept"
    assert not (out / MARK).is_symlink()


# What is removed


@pytest.mark.parametrize("named", ["thesis.tex", "branches/mine.csv", "energy.csv", "../up.txt"])
def test_a_manifest_does_not_have_files_removed(scene, tmp_path, named):
    folder = tmp_path / "out"
    (folder / "branches").mkdir(parents=True)
    (folder / named).write_text("kept")
    record = {"schema": "contimpact.manifest/1", "files": [named], "branches": []}
    (folder / "manifest.json").write_text(json.dumps(record))
    assert run("run", scene(), "-o", folder, "-q", "--no-plot") == 0
    assert (folder / named).read_text() == "kept"


def test_only_tables_with_the_name_they_ask_for_are_removed(out):
    """A copy under another name, and other files of the same name, are the user's."""
    table = out / "branches" / "b1-BT.csv"
    shutil.copy(table, out / "branches" / "b1-old.csv")
    (out / "branches" / "b9-BBT.csv").write_text("1,2,3\n")
    (out / "events.csv").write_text("my events\n")
    found = own_files(out, ["run"])
    assert {"branches/b1-BT.csv", "catalogue.json", "diagram.png"} <= set(found)
    assert not {"branches/b1-old.csv", "branches/b9-BBT.csv", "events.csv"} & set(found)


@pytest.mark.full
def test_a_folder_with_compressed_tables_is_read_and_renewed_as_any_other(out, scene):
    """Its digests are of what is read, and a new run leaves no compressed table behind."""
    before = load_diagram(out)
    for path in [*out.glob("branches/*.csv"), out / "catalogue.json", out / "events.csv"]:
        path.with_name(f"{path.name}.xz").write_bytes(lzma.compress(path.read_bytes()))
        path.unlink()
    assert repr(load_diagram(out)) == repr(before)
    assert run("plot", out) == 0
    assert run("run", scene(), "-o", out, "-q", "--no-plot") == 0
    assert not list(out.glob("**/*.xz"))


@pytest.mark.full
def test_a_folder_without_a_manifest_is_drawn_by_its_scene_file(scene, tmp_path):
    """As the folders of ``branches/`` are committed."""
    folder = tmp_path / "out"
    assert run("run", scene(), "-o", folder, "-q") == 0
    with_manifest = (folder / "diagram.png").read_bytes()
    shutil.copy(scene(), folder / "scene.toml")
    (folder / "manifest.json").unlink()
    assert run("plot", folder) == 0
    assert (folder / "diagram.png").read_bytes() == with_manifest


def test_pictures_of_a_folder_that_is_not_ours_stay(scene, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "diagram.pdf").write_text("kept")
    assert run("run", scene(), "-o", tmp_path / "out", "-q", "--no-plot") == 0
    assert (tmp_path / "out" / "diagram.pdf").read_text() == "kept"


# Results of one run


def test_the_manifest_is_tied_to_its_catalogue(out, tmp_path, capsys):
    sealed = {"catalogue.json", *(f"branches/{path.name}" for path in out.glob("branches/*"))}
    assert manifest_of(out)["sha256"] == {name: sha256(out / name) for name in sealed}
    content = json.loads((out / "catalogue.json").read_text(encoding="utf-8"))
    (out / "catalogue.json").write_text(json.dumps(content | {"scene": "other"}))
    for command in (["plot", out], ["catalogue", out, "-o", tmp_path / "merged"]):
        assert run(*command) == 2
        said = capsys.readouterr().err
        assert f"{out / 'catalogue.json'}: not the one that manifest.json belongs to" in said
        assert "run it again" in said
    for read in (load_diagram, load_entries):
        with pytest.raises(InputError, match="not the one"):
            read(out)


def test_a_changed_table_is_refused(out, capsys):
    """A branch whose unphysical orbits were made physical, and the other way round."""
    table = next(out.glob("branches/*.csv"))
    head, names, *rows = table.read_text(encoding="utf-8").splitlines()
    place = names.split(",").index("physical")
    turned = [row.split(",") for row in rows]
    for cells in turned:
        cells[place] = str(1 - int(cells[place]))
    table.write_text("\n".join([head, names, *map(",".join, turned), ""]), encoding="utf-8")
    for command in (["plot", out], ["certify", out], ["certify", out, "--verify"]):
        assert run(*command) == 2
        assert f"{table}: not the one that manifest.json belongs to" in capsys.readouterr().err
    for read in (load_diagram, load_entries):
        with pytest.raises(InputError, match="not the one"):
            read(out)
    (out / "manifest.json").unlink()
    found = next(b for b in load_diagram(out).branches if table.name.startswith(f"{b.id}-"))
    assert found["physical"].tolist() == [int(cells[place]) for cells in turned]


def test_an_unfinished_folder_is_recognised(out, tmp_path, capsys):
    (out / MARK).touch()
    (out / "manifest.json").unlink()
    for command in (["plot", out], ["catalogue", out, "-o", tmp_path / "merged"]):
        assert run(*command) == 2
        said = capsys.readouterr().err
        assert f"{out / MARK}: a run is writing this folder, or ended before all was" in said
        assert "remove this file to use what is there" in said
    with pytest.raises(InputError, match="ended before"):
        load_diagram(out)
    (out / MARK).unlink()
    assert load_diagram(out).name == "small"


@pytest.mark.full
def test_a_run_over_an_unfinished_folder_makes_it_whole(scene, out, results):
    (out / MARK).touch()
    (out / "manifest.json").unlink()
    text = (out / "branches" / "b1-BT.csv").read_text().replace('"id": "b1"', '"id": "b7"')
    (out / "branches" / "b7-BT.csv").write_text(text)  # of another scene that was killed
    assert run("run", scene(), "-o", out, "-q") == 0
    assert names(out) == names(results)


def test_shipped_catalogues_need_no_manifest(tmp_path):
    for name in ("fig7", "stop"):
        shutil.copytree(BRANCHES / name, tmp_path / name)
        (tmp_path / name / "manifest.json").unlink(missing_ok=True)
        assert load_entries(tmp_path / name)
    assert run("catalogue", tmp_path / "fig7", tmp_path / "stop", "-o", tmp_path / "merged") == 0


def test_an_exported_diagram_is_whole_without_a_manifest(out, tmp_path):
    diagram = load_diagram(out)
    write_diagram(diagram, tmp_path / "export")
    assert names(tmp_path / "export") <= names(out)
    assert load_diagram(tmp_path / "export") == diagram


def test_an_export_over_a_run_leaves_no_manifest_of_it(out):
    """It would be one of another catalogue."""
    diagram = load_diagram(out)
    write_diagram(Diagram("other", diagram.branches), out)
    assert not (out / "manifest.json").exists()
    assert load_diagram(out).name == "other"


def test_a_folder_written_anew_while_it_is_read(out, monkeypatch):
    from contimpact.results import catalogue

    original = catalogue.read_branch

    def slow(path):
        (out / "manifest.json").write_text(json.dumps(manifest_of(out) | {"seconds": {}}))
        return original(path)

    monkeypatch.setattr(catalogue, "read_branch", slow)
    with pytest.raises(InputError, match="written anew while it was read"):
        load_diagram(out)


# Two commands, one folder


@pytest.mark.full
def test_run_and_simulate_of_one_scene_share_a_folder(scene, tmp_path):
    path, folder = scene(SCENE + SIMULATE), tmp_path / "out"
    for order in (("run", "simulate"), ("simulate", "run")):
        for command in order:
            assert run(command, path, "-o", folder, "-q") == 0
        found = names(folder)
        assert {"catalogue.json", "diagram.png", "sweep.csv", "attractors.png"} <= found
        assert set(manifest_of(folder)["files"]) == found - {"manifest.json"}
        assert load_diagram(folder).name == "small"
        shutil.rmtree(folder)


@pytest.mark.parametrize("order", [("run", "simulate"), ("simulate", "run")])
def test_results_of_two_scenes_are_not_mixed(scene, tmp_path, order):
    """What the first has left is of another scene and goes; rows say themselves what they are."""
    folder = tmp_path / "out"
    first = scene(SCENE + SIMULATE, "first.toml")
    second = scene(SCENE.replace("r = 0.3", "r = 0.4") + SIMULATE, "second.toml")
    assert run(order[0], first, "-o", folder, "-q", "--no-plot") == 0
    assert run(order[1], second, "-o", folder, "-q", "--no-plot") == 0
    mine = {"run": {"catalogue.json", "events.csv"}, "simulate": {"sweep.csv"}}
    assert mine[order[1]] <= names(folder)
    assert not mine[order[0]] & names(folder)


@pytest.mark.full
def test_simulated_twice_with_branches(scene, tmp_path):
    """The second run removes the files of the first and not its own."""
    path = scene(SCENE + SIMULATE + "branches = true\n")
    assert run("simulate", path, "-o", tmp_path / "out", "-q", "--no-plot") == 0
    first = names(tmp_path / "out")
    assert run("simulate", path, "-o", tmp_path / "out", "-q", "--no-plot") == 0
    assert names(tmp_path / "out") == first
    assert {"sweep.csv", "coverage.json", "rows.jsonl", "catalogue.json"} <= first


# Locks


@contextlib.contextmanager
def holder(folder):
    """A process that holds the lock of a folder and is killed in the end."""
    code = (
        "import sys, time\nfrom pathlib import Path\n"
        "from contimpact.storage import hold_lock\n"
        "with hold_lock(Path(sys.argv[1])):\n    print('held', flush=True)\n    time.sleep(600)\n"
    )
    with subprocess.Popen([sys.executable, "-c", code, folder], stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout.readline() == b"held\n"
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize("command", ["run", "simulate", "catalogue"])
@pytest.mark.full
def test_a_folder_that_another_process_writes_is_refused(scene, out, capsys, command):
    before = names(out)
    with holder(out) as process:
        given = out if command == "catalogue" else scene(SCENE + SIMULATE)
        assert run(command, given, "-o", out) == 2
        said = capsys.readouterr().err
        assert f"{out}: another contimpact is writing to it (pid {process.pid}, host " in said
        assert "wait until it has ended, or give another folder" in said
        with pytest.raises(InputError, match="another contimpact"):
            write_diagram(load_diagram(out), out)
    assert (out / LOCK).exists()  # nobody could take it away
    assert run("run", scene(), "-o", out, "-q") == 0
    assert names(out) == before


@pytest.mark.full
def test_a_picture_is_not_put_into_a_folder_that_another_process_writes(out, tmp_path, capsys):
    """Nor into the folder of a run that has written nothing yet; elsewhere it is drawn."""
    before, begun = names(out), tmp_path / "begun"
    begun.mkdir()
    for folder, target in ((out, "diagram.png"), (begun, "new.svg")):
        with holder(folder) as process:
            assert run("plot", out, "-o", folder / target) == 2
            said = capsys.readouterr().err
            assert f"{folder}: another contimpact is writing to it (pid {process.pid}, " in said
            assert run("plot", out, "-o", tmp_path / "elsewhere.png") == 0
        assert not (begun / target).exists()
    assert run("plot", out, "-o", out / "diagram.png") == 0
    assert names(out) == before | {"diagram.png"}  # the lock is given back


def test_a_lock_is_given_back(tmp_path):
    with hold_lock(tmp_path), pytest.raises(InputError, match="another"), hold_lock(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ZeroDivisionError), hold_lock(tmp_path):
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def without_locks(monkeypatch):
    """As on a file system, or a platform, that has no locks on files."""
    from contimpact import storage as locks

    monkeypatch.setattr(locks, "fcntl", None)


STALE = {
    "ended": lambda me: {"pid": 2**22 - 3},
    "recycled": lambda me: {"pid": me.pid, "start": "1"},
    "empty": lambda me: None,
    "forged": lambda me: {"pid": "rm -rf", "host": []},
    "negative": lambda me: {"pid": -1},
    "huge": lambda me: {"pid": 10**30},
}


@pytest.mark.parametrize("case", STALE)
def test_a_stale_lock_is_recognised_without_locks_of_the_system(without_locks, tmp_path, case):
    me = this_process()
    if case == "recycled" and not me.start:
        pytest.skip("this system does not say when a process started")
    changes = STALE[case](me)
    record = {"host": me.host, "pid": me.pid, "start": me.start} | (changes or {})
    (tmp_path / LOCK).write_text("" if changes is None else json.dumps(record))
    with hold_lock(tmp_path):
        assert json.loads((tmp_path / LOCK).read_text())["pid"] == me.pid
    assert not (tmp_path / LOCK).exists()


@pytest.mark.parametrize("elsewhere", [True, False])
def test_a_lock_that_may_be_held_is_respected_without_locks_of_the_system(
    without_locks, tmp_path, elsewhere
):
    me = this_process()
    record = {"host": "another" if elsewhere else me.host, "pid": me.pid, "start": me.start}
    (tmp_path / LOCK).write_text(json.dumps(record))
    with pytest.raises(InputError, match=f"remove {LOCK}"), hold_lock(tmp_path):
        pass
    assert json.loads((tmp_path / LOCK).read_text()) == record


@links
def test_a_lock_that_is_no_plain_file(tmp_path):
    (tmp_path / "victim").write_text("kept")
    (tmp_path / LOCK).symlink_to(tmp_path / "victim")
    with pytest.raises(InputError, match="cannot be written"), hold_lock(tmp_path):
        pass
    assert (tmp_path / "victim").read_text() == "kept"
    (tmp_path / LOCK).unlink()
    os.mkfifo(tmp_path / LOCK)
    with pytest.raises(InputError, match="not a plain file"), hold_lock(tmp_path):
        pass


# Temporary files


@pytest.mark.full
def test_temporary_files_of_processes_that_have_ended_are_removed(scene, out, results):
    mine = temporary_beside(out / "catalogue.json")
    name = this_process().name
    gone = [mine.with_name(mine.name.replace(name, f"{name.split('-')[0]}-4194301-7"))]
    gone.append(out / "branches" / gone[0].name)
    old = mine.with_name(mine.name.replace(name, "00000000-1-7"))
    young = mine.with_name(mine.name.replace(name, "00000000-2-7"))
    for path in (mine, old, young, *gone):
        path.write_text("half")
    os.utime(old, (0, 0))
    assert run("run", scene(), "-o", out, "-q") == 0
    assert [path.exists() for path in (mine, young)] == [True, True]
    assert not any(path.exists() for path in (old, *gone))


# A full disk

FULL = """
import os, resource, sys
from contimpact.cli import main
from contimpact.cli import run as commands
limit = int(sys.argv[1])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
sys.exit(main(sys.argv[2:]))
"""


@pytest.mark.full
@pytest.mark.skipif(sys.platform == "win32", reason="limits of POSIX")
@pytest.mark.parametrize("limit", [12_000, 20_000])
def test_what_can_be_written_is_written(scene, tmp_path, results, limit):
    """Files above a size cannot be written, as on a full disk."""
    folder = tmp_path / "out"
    command = [sys.executable, "-c", FULL, str(limit), "run", scene(), "-o", str(folder), "-q"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    sizes = {name: (results / name).stat().st_size for name in names(results)}
    small = {name for name, size in sizes.items() if size <= limit} - {"manifest.json"}
    large = set(sizes) - small - {"manifest.json"}
    assert "events.csv" in small
    assert "diagram.png" in large
    # the manifest's own size depends on what was in the cache
    assert names(folder) - {"manifest.json"} == small | {MARK}
    for name in small:
        assert (folder / name).read_bytes() == (results / name).read_bytes()
    (said,) = done.stderr.splitlines()
    assert said.startswith(f"contimpact: {folder}: not written (File too large): ")
    assert all(name in said for name in sizes)
    manifest = manifest_of(folder)
    assert {text.split(":")[0] for text in manifest["not_written"]} == large
    assert set(manifest["files"]) == small


def full_after(monkeypatch, budget):
    """A disk that takes so many more bytes."""
    from contimpact import storage as files

    original, left = files.put, [budget]

    def limited(path, content, *arguments, **options):
        if len(content) > left[0]:
            raise OSError(28, "No space left on device")
        left[0] -= len(content)
        original(path, content, *arguments, **options)

    monkeypatch.setattr(files, "put", limited)


@pytest.mark.full
def test_the_catalogue_is_written_first(scene, tmp_path, results, monkeypatch, capsys):
    room = (results / "catalogue.json").stat().st_size + (results / "events.csv").stat().st_size
    full_after(monkeypatch, room + 100)
    folder = tmp_path / "out"
    assert run("run", scene(), "-o", folder, "-q") == 1
    assert names(folder) == {"catalogue.json", "events.csv", MARK}
    said = capsys.readouterr().err
    assert "No space left on device" in said
    assert "written: catalogue.json, events.csv" in said
    assert run("catalogue", folder, "-o", tmp_path / "merged") == 2
    (folder / MARK).unlink()  # as the message says
    monkeypatch.undo()
    assert run("catalogue", folder, "-o", tmp_path / "merged") == 0


def test_the_other_scenes_of_a_run_are_written(scene, tmp_path, monkeypatch, results):
    paths = [scene(SCENE.replace("small", name), f"{name}.toml") for name in ("one", "two")]
    full_after(monkeypatch, 3000)
    assert run("run", *paths, "-o", tmp_path / "out", "-q", "--no-plot") == 1
    assert (tmp_path / "out" / "two" / MARK).exists()


def test_tables_are_kept_where_a_picture_cannot_be_drawn(scene, tmp_path, monkeypatch, capsys):
    def refuse(*_, **__):
        raise InputError("x", "no such column", "give another")

    monkeypatch.setattr("contimpact.plots.diagram.plot_diagram", refuse)
    assert run("run", scene(), "-o", tmp_path / "out", "-q") == 1
    assert "not written (no such column): x; written: catalogue.json" in capsys.readouterr().err
    assert {"catalogue.json", "branches/b1-BT.csv", "manifest.json"} <= names(tmp_path / "out")


def test_an_empty_name_is_no_folder(results):
    with pytest.raises(InputError, match="empty"):
        write_diagram(load_diagram(results), "")


def test_a_simulation_on_a_disk_that_gets_full(scene, tmp_path, monkeypatch, capsys):
    """It goes on, and writes its tables."""
    path, folder = scene(SCENE + SIMULATE), tmp_path / "out"
    assert run("simulate", path, "-o", tmp_path / "whole", "-q", "--no-plot") == 0

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("contimpact.simulation.files.append_line", full)
    assert run("simulate", path, "-o", folder, "-q", "--no-plot") == 1
    assert "not written (No space left on device): rows.jsonl" in capsys.readouterr().err
    whole = (tmp_path / "whole" / "sweep.csv").read_bytes()
    assert (folder / "sweep.csv").read_bytes() == whole
    monkeypatch.undo()
    assert run("simulate", path, "-o", folder, "-q", "--no-plot", "--resume") == 0
    assert (folder / "sweep.csv").read_bytes() == whole
    assert not (folder / MARK).exists()


def test_a_mark_that_cannot_be_made_leaves_everything_as_it_is(out, monkeypatch):
    before = names(out)

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("contimpact.results.result_folder.put", full)
    with (
        pytest.raises(NotWrittenError, match="No space left"),
        hold_folder(out),
        renew_folder(out, ["run"]),
    ):
        pass
    assert names(out) == before


# Going on with rows


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """A scene, and the folder of its finished simulation."""
    folder = tmp_path_factory.mktemp("simulated")
    text = SCENE + SIMULATE + 'direction = "both"\nstarts = 2\n'
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    order = ["simulate", folder / "scene.toml", "-o", folder / "out", "-q", "--no-plot"]
    assert run(*order) == 0
    return folder


@pytest.fixture
def rows(simulated, tmp_path):
    """Copies of that scene and of its rows."""
    copied = Path(shutil.copytree(simulated, tmp_path / "simulated"))
    return str(copied / "scene.toml"), copied / "out" / ROWS


def resumed(path, file):
    return run("simulate", path, "-o", file.parent, "-q", "--no-plot", "--resume")


DAMAGE = {
    "two runs": lambda lines: [lines[0], *[line for line in lines[1:] for _ in range(2)]],
    "twice": lambda lines: [*lines, *lines[1:]],
    "a hole": lambda lines: [lines[0], *lines[2:]],
    "another order": lambda lines: [lines[0], lines[2], lines[1], *lines[3:]],
    "another value": lambda lines: [line.replace("0.345", "0.346") for line in lines],
    "another direction": lambda lines: [line.replace('"up"', '"left"') for line in lines],
    "no object": lambda lines: [*lines, "[1]"],
    "deep": lambda lines: [*lines, "[" * 100_000],
    "not UTF-8": lambda lines: [*lines, "\udcff"],
    "another version": lambda lines: [
        lines[0].replace('"version": "', '"version": "x'),
        *lines[1:],
    ],
}


@pytest.mark.parametrize("how", DAMAGE)
def test_rows_that_are_not_of_one_run_are_refused(rows, capsys, how):
    path, file = rows
    lines = file.read_text(encoding="utf-8").splitlines()
    changed = DAMAGE[how](lines)
    assert changed != lines
    file.write_bytes("".join(f"{line}\n" for line in changed).encode(errors="surrogateescape"))
    before = file.read_bytes()
    assert resumed(path, file) == 2
    said = capsys.readouterr().err
    assert str(file) in said
    assert "leave --resume out" in said
    assert file.read_bytes() == before


@pytest.mark.full
def test_any_beginning_of_the_rows_is_gone_on_with(rows):
    path, file = rows
    whole = file.read_bytes()
    table = (file.parent / "sweep.csv").read_bytes()
    for part in (0.0, 0.3, 0.62, 0.9):
        file.write_bytes(whole[: max(int(part * len(whole)), whole.index(b"\n") + 1)])
        assert resumed(path, file) == 0
        assert file.read_bytes() == whole
        assert (file.parent / "sweep.csv").read_bytes() == table


def test_resolved_scenes_compare_after_a_round_trip():
    """What a manifest says of a scene is what the scene says again."""
    for name in ("fig7", "fig6a", "stop"):
        scene = load_scene(BRANCHES / name / "scene.toml")
        assert json.loads(json.dumps(scene.resolved())) == json.loads(json.dumps(scene.resolved()))


# Folders that others remove, or that cannot be written


def removing(monkeypatch, folder, name):
    """The folder is removed when a function of the command is called."""
    original = getattr(commands, name)

    def removed(*given):
        shutil.rmtree(folder)
        return original(*given)

    monkeypatch.setattr(commands, name, removed)


def test_a_folder_that_is_removed_during_a_run_is_made_again(scene, results, tmp_path, monkeypatch):
    removing(monkeypatch, tmp_path / "out", "_write_run")
    assert run("run", scene(), "-o", tmp_path / "out", "-q") == 0
    assert names(tmp_path / "out") == names(results)
    assert load_diagram(tmp_path / "out").entries == load_diagram(results).entries


def test_files_that_are_removed_while_others_are_written_are_named(
    scene, tmp_path, monkeypatch, capsys
):
    removing(monkeypatch, tmp_path / "out", "_save_plots")
    assert run("run", scene(), "-o", tmp_path / "out", "-q") == 1
    assert "not written (removed meanwhile): catalogue.json, events.csv" in capsys.readouterr().err
    assert manifest_of(tmp_path / "out")["files"] == ["diagram.png"]


def test_what_only_reads_a_folder_needs_not_write_to_it(out, monkeypatch, capsys):
    monkeypatch.setattr("contimpact.results.result_folder.os.access", lambda *given: False)
    monkeypatch.setattr("contimpact.results.result_folder.hold_lock", None)
    assert run("range", out) == 0
    assert "1:1 on b1" in capsys.readouterr().out
