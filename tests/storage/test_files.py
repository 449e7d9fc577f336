"""Files written whole, through no link; and whose process has ended."""

from __future__ import annotations

import lzma
import os
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

from contimpact.errors import InputError, NotWrittenError
from contimpact.storage import (
    ENDED,
    Process,
    append_line,
    is_there,
    put,
    read_bounded,
    read_plain,
    remove_leftovers,
    running,
    start_of,
    this_process,
    write,
    write_all,
    write_text,
)

links = pytest.mark.skipif(os.name != "posix", reason="links")


@links
@pytest.mark.parametrize("how", [put, write, write_text])
def test_a_link_is_replaced_and_not_followed(tmp_path, how):
    victim, path = tmp_path / "thesis.tex", tmp_path / "file"
    victim.write_text("kept")
    path.symlink_to(victim)
    how(path, b"new" if how is put else "new")
    assert (victim.read_text(), path.read_text(), path.is_symlink()) == ("kept", "new", False)


@links
def test_nothing_is_added_through_a_link(tmp_path):
    (tmp_path / "victim").write_text("kept")
    (tmp_path / "file").symlink_to(tmp_path / "victim")
    with pytest.raises(OSError, match="file"):
        append_line(tmp_path / "file", "more")
    assert (tmp_path / "victim").read_text() == "kept"
    append_line(tmp_path / "victim", " and more")
    assert (tmp_path / "victim").read_text() == "kept and more\n"


@links
def test_a_folder_that_became_a_link_is_not_written_through(tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "branches").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(NotWrittenError, match="branches is a link"):
        write_all(tmp_path, {"branches/b1.csv": lambda: "x"})
    assert list((tmp_path / "elsewhere").iterdir()) == []


def test_the_others_are_written_where_one_cannot_be(tmp_path):
    (tmp_path / "b").mkdir()
    contents = {name: lambda name=name: name for name in ("a", "b", "in/c")}
    with pytest.raises(NotWrittenError) as caught:
        write_all(tmp_path, contents)
    assert caught.value.written == ["a", "in/c"]
    assert list(caught.value.failed) == ["b"]
    assert isinstance(caught.value, InputError)
    assert "not written (Is a directory): b; written: a, in/c" in str(caught.value)
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["a", "b", "c", "in"]


@pytest.mark.skipif(os.name != "posix", reason="POSIX permissions")
def test_permissions(tmp_path):
    before = os.umask(0o027)
    try:
        put(tmp_path / "own", b"")
        write(tmp_path / "result", b"")
    finally:
        os.umask(before)
    modes = [stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("own", "result")]
    assert modes == [0o600, 0o640]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes")
def test_only_plain_files_are_read(tmp_path):
    """A pipe would be waited for."""
    os.mkfifo(tmp_path / "pipe")
    for name, found in (("pipe", "not a plain file"), (".", "a folder")):
        with pytest.raises(OSError, match=found):
            read_plain(tmp_path / name)
    with pytest.raises(FileNotFoundError):
        read_plain(tmp_path / "nothing")


def test_a_path_without_a_name_is_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for path in (Path("."), Path("/")):
        with pytest.raises(IsADirectoryError):
            read_plain(path)


def test_other_hidden_files_stay(tmp_path):
    for name in (".gitignore", ".thesis.tex.tmp", ".a.00000000-x-1-1.tmp", "b.00000000-1-1-1.tmp"):
        (tmp_path / name).write_text("kept")
        os.utime(tmp_path / name, (0, 0))
    remove_leftovers(tmp_path)
    assert len(list(tmp_path.iterdir())) == 4


def test_a_name_of_any_length_can_be_written(tmp_path):
    for name in ("a" * 250, "é" * 120, "😀" * 60):
        put(tmp_path / name, b"x")
        assert (tmp_path / name).read_bytes() == b"x"


def test_processes():
    me = this_process()
    assert me.running()
    assert me.here()
    assert not Process("elsewhere", me.pid, me.start).here()
    child = subprocess.Popen([sys.executable, "-c", ""])
    start = start_of(child.pid)
    if start:  # the system says when processes start, and which wait to be noticed
        limit = time.monotonic() + 30
        while start_of(child.pid) != ENDED and time.monotonic() < limit:
            time.sleep(0.01)
        assert not running(child.pid, start) or start == ENDED
    child.wait()
    assert not running(child.pid, start)


def test_a_compressed_file_is_read_in_place_of_a_plain_one(tmp_path):
    path, packed = tmp_path / "a.csv", tmp_path / "a.csv.xz"
    packed.write_bytes(lzma.compress(b"old"))
    assert (is_there(path), read_plain(path)[0]) == (True, b"old")
    path.write_bytes(b"new")
    assert read_plain(path)[0] == b"new"


@pytest.mark.full
def test_no_more_of_a_compressed_file_is_unpacked_than_admitted(tmp_path):
    (tmp_path / "a.csv.xz").write_bytes(lzma.compress(bytes(10**7)))
    with pytest.raises(ValueError, match="longer than 1000 bytes"):
        read_bounded(tmp_path / "a.csv", 1000)


@pytest.mark.parametrize("content", [b"no archive", lzma.compress(b"abc" * 99)[:-20]])
def test_a_damaged_compressed_file_is_no_silence(tmp_path, content):
    (tmp_path / "a.csv.xz").write_bytes(content)
    with pytest.raises(OSError, match="damaged"):
        read_plain(tmp_path / "a.csv")
