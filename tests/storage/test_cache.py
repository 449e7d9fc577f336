"""The cache: what is executed from it is what this user alone can have written."""

from __future__ import annotations

import hashlib
import logging
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from contimpact import storage as files
from contimpact.segments.kernels import Kernels

posix = pytest.mark.skipif(os.name != "posix", reason="POSIX permissions")
as_root = pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() != 0, reason="gives files to another user"
)
FORGED = "raise SystemExit('executed')"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A cache of its own; every warning is said."""
    monkeypatch.setenv("CONTIMPACT_CACHE", str(tmp_path / "cache"))
    files._warn.cache_clear()
    return tmp_path / "cache"


def mode(path):
    return path.stat().st_mode & 0o777


def kernel_in(folder, pair):
    """A cached kernel."""
    Kernels(pair(), "s").kernel("setup")
    (path,) = folder.glob("*-setup-*.py")
    return path


@posix
@pytest.mark.parametrize("umask", [0, 0o002, 0o022, 0o077])
def test_the_folder_and_what_is_in_it_is_the_users_alone(folder, pair, monkeypatch, umask):
    monkeypatch.setenv("CONTIMPACT_CACHE", str(folder / "a" / "b"))
    before = os.umask(umask)
    try:
        path = kernel_in(folder / "a" / "b", pair)
    finally:
        os.umask(before)
    assert [mode(p) for p in (folder, folder / "a", folder / "a" / "b")] == [0o700] * 3
    assert mode(path) == 0o600


@posix
@pytest.mark.parametrize("permissions", [0o777, 0o775, 0o702])
def test_a_folder_that_others_can_write_is_not_used(folder, pair, caplog, permissions):
    path = kernel_in(folder, pair)
    head = path.read_text().split("\n")[0].split()
    body = FORGED + "\n"
    digest = hashlib.sha256(body.encode()).hexdigest()
    path.write_text(f"# {head[1]} {digest}\n{body}")
    folder.chmod(permissions)
    with caplog.at_level(logging.WARNING):
        kernels = Kernels(pair(), "s")
        kernels.kernel("setup")
    assert kernels.generated == ["setup"]
    assert f"{folder} may be written by others" in caplog.text
    assert "CONTIMPACT_CACHE" in caplog.text
    assert FORGED in path.read_text()  # nothing is written there


@posix
def test_a_file_that_others_can_write_is_made_anew(folder, pair, caplog):
    path = kernel_in(folder, pair)
    whole = path.read_bytes()
    path.chmod(0o666)
    with caplog.at_level(logging.WARNING):
        kernels = Kernels(pair(), "s")
        kernels.kernel("setup")
    assert kernels.generated == ["setup"]
    assert "may be written by others" in caplog.text
    assert (mode(path), path.read_bytes()) == (0o600, whole)


@as_root
def test_what_belongs_to_somebody_else_is_not_used(folder, pair, caplog):
    path = kernel_in(folder, pair)
    os.chown(path, 12345, 12345)
    with caplog.at_level(logging.WARNING):
        kernels = Kernels(pair(), "s")
        kernels.kernel("setup")
    assert kernels.generated == ["setup"]
    assert "belongs to another user (number 12345)" in caplog.text
    assert path.stat().st_uid == 0  # written anew
    os.chown(folder, 12345, 12345)
    assert files.cache_folder() is None
    assert f"{folder} belongs to another user" in caplog.text


@posix
@pytest.mark.parametrize("forged", [".so", ".so.sha256", ".o"])
def test_machine_code_that_others_can_write_is_not_loaded(folder, caplog, forged):
    folder.mkdir(mode=0o700)
    for kind in (".so", ".o"):
        files.put_with_digest(folder / f"compiled-x{kind}", b"code")
    path = folder / f"compiled-x{forged}"
    assert files.is_intact(folder / "compiled-x.so")
    path.chmod(0o622)
    assert not files.is_intact(folder / f"compiled-x{forged.removesuffix('.sha256')}")
    assert "may be written by others" in caplog.text


def test_a_digest_is_of_one_name(folder):
    """Machine code that was given another program's name is not loaded as that."""
    folder.mkdir()
    files.put_with_digest(folder / "compiled-one.so", b"code")
    for end in (".so", ".so.sha256"):
        (folder / f"compiled-one{end}").rename(folder / f"compiled-two{end}")
    assert not files.is_intact(folder / "compiled-two.so")


@pytest.mark.parametrize("named", [".", "cache", "-cache", "a/../b"])
def test_a_relative_folder_is_made_absolute(folder, tmp_path, monkeypatch, named):
    """Neither an option of the linker nor a library to be searched for."""
    tmp_path.chmod(0o700)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a").mkdir()
    monkeypatch.setenv("CONTIMPACT_CACHE", named)
    found = files.cache_folder()
    assert found.is_absolute()
    assert found.samefile(tmp_path / named)


def test_the_home_folder_is_known_by_its_sign(folder, tmp_path, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("USERPROFILE", str(tmp_path))
    monkeypatch.setenv("CONTIMPACT_CACHE", "~/kernels")
    assert files.cache_folder() == tmp_path / "kernels"
    assert not Path("~").exists()


@pytest.mark.parametrize("named", ["", "~nobody-of-this-name/cache"])
def test_without_a_home_nothing_is_cached(folder, pair, monkeypatch, caplog, named):
    def no_home(*_):
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setenv("CONTIMPACT_CACHE", named)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("LOCALAPPDATA", raising=False)
    monkeypatch.setattr(Path, "home", no_home)
    kernels = Kernels(pair(), "s")
    kernels.kernel("setup")
    kernels.kernel("harmonics")
    assert kernels.generated == ["setup", "harmonics"]
    (said,) = [r.message for r in caplog.records if r.levelno == logging.WARNING]
    assert "not cached: no folder for them is known" in said
    assert "CONTIMPACT_CACHE" in said


def test_a_relative_folder_of_the_platform_is_passed_over(folder, tmp_path, monkeypatch):
    """As the standard for these folders asks."""
    monkeypatch.delenv("CONTIMPACT_CACHE")
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert files.cache_folder() == tmp_path / ".cache" / "contimpact"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert files.cache_folder() == tmp_path / "xdg" / "contimpact"


@posix
def test_a_link_in_the_cache_is_replaced(folder, pair, tmp_path):
    path = kernel_in(folder, pair)
    victim = tmp_path / "thesis.tex"
    victim.write_text("kept")
    path.unlink()
    path.symlink_to(victim)
    Kernels(pair(), "s").kernel("setup")
    assert victim.read_text() == "kept"
    assert not path.is_symlink()


@posix
def test_what_a_killed_process_left_in_the_cache_is_removed(folder, pair):
    kernel_in(folder, pair)
    code = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from contimpact.storage import temporary_beside\n"
        "temporary = temporary_beside(Path(sys.argv[1]))\n"
        "temporary.write_text('half')\n"
        "temporary_beside(Path(sys.argv[1])).mkdir()\n"
        "os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    subprocess.run([sys.executable, "-c", code, folder / "kernel.py"], check=False)
    assert len(list(folder.glob(".*.tmp"))) == 2
    files._remove_leftovers.cache_clear()
    files.cache_folder()
    assert list(folder.glob(".*.tmp")) == []


def test_an_integrator_is_built_once(folder, monkeypatch):
    """A later process has it from the cache, with the same numbers, unless its file is damaged."""
    pytest.importorskip("heyoka", reason="needs contimpact[ode]")
    from contimpact.segments.integration import BatchIntegrator, Integrator

    def numbers():
        one = Integrator("w: w*cos(t) - x0**3", ("dt", "v0"), 0, 0)
        many = BatchIntegrator("w: w*cos(t) - x0**3", ())
        start = [1.5, 0.2, 0.1, 0.3, 0.7]
        return [*one(start), *many.each(np.array([start]))[0].tolist()]

    found, built = numbers(), []
    monkeypatch.setattr(Integrator, "_equations", lambda self: built.append(self))
    assert numbers() == found
    assert not built
    monkeypatch.undo()
    monkeypatch.setenv("CONTIMPACT_CACHE", str(folder))
    for path in folder.glob("integrator-*.pickle"):
        path.write_bytes(b"damaged")
    assert numbers() == found


def test_the_oldest_objects_leave_the_cache(folder, monkeypatch):
    monkeypatch.setattr(files, "MOST_KEPT", 2)
    for name in "abc":
        assert files.kept_object("thing", [name], lambda name=name: name) == name
    assert len(list(folder.glob("thing-*.pickle"))) == 2
    assert len(list(folder.glob("thing-*.sha256"))) == 2
