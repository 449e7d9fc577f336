"""The folder of a result: what it holds, who holds it, and its manifest.

A run locks its folder. What an earlier run left there stays as it is while the run computes. Then
the run marks the folder as unfinished, removes the earlier manifest and the earlier files, writes
its own, the manifest last, and removes the mark. So whatever moment a run is ended at, the folder
holds the files of one run, or is marked.
"""

from __future__ import annotations

import contextlib
import json
import os
import platform
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from .. import __version__
from ..errors import InputError, NotWrittenError, short_repr
from ..segments.compiling import count_loaded, mode, ran_plainly
from ..storage import (
    FOR_ALL,
    LOCK,
    PACKED,
    check_reading,
    hold_lock,
    is_there,
    json_text,
    put,
    read_json,
    read_plain,
    reason,
    remove_leftovers,
    sha256,
    write_all,
)

CATALOGUE = "contimpact.catalogue/1"
MANIFEST = "contimpact.manifest/1"
MARK = "contimpact.unfinished"
ROWS = "rows.jsonl"
"""File in which a simulation keeps its rows as it finds them. It names its scene, and is kept."""
WHOLE = ("catalogue.json", "sweep.csv")
"""Files of which there is one where results were written."""
TABLES = ("branches", "curves")
"""Folders of tables in a folder of results."""
SEALED = re.compile(rf"catalogue\.json|sweep\.csv|({'|'.join(TABLES)})/[^/]+\.csv")
"""The files that are read back: the manifest holds their digests."""

WRITTEN = {
    "run": (
        r"(catalogue|certificates)\.json|events\.csv",
        r"(diagram|curves|codim2)\.(svg|png|pdf)|diagram\.html",
    ),
    "simulate": (
        r"(sweep|energy|losses|fractions)\.csv|(transitions|crises|coverage)\.json",
        r"(attractors|exponents|energy|fractions|portrait\d+|basins\d+)\.(svg|png|pdf)",
    ),
}
"""Names of the files, and of the pictures, that each command writes besides tables. Certificates go
with the catalogue they belong to."""

WANTED = "a folder made by contimpact run"
LONGEST = 1 << 24
"""Bytes that the first line of a table may have."""


# Writing.


def prepare_folder(
    folder: str | Path, files: Sequence[str] = (), folders: Sequence[str] = ()
) -> Path:
    """Make a folder for output in which these files and folders are going to be written, and make
    sure that it can be written and nothing else is in the way.

    Raises InputError if it cannot.
    """
    import tempfile

    if not str(folder):
        raise InputError("output folder", "empty", "give the path of a folder")
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except (OSError, ValueError) as error:
        raise InputError(
            str(folder), f"cannot be written ({reason(error)})", "give another folder"
        ) from None
    for name in files:
        if (folder / name).is_dir():
            raise InputError(str(folder / name), "a folder", "move it: a file is to be written")
    for name in folders:
        if (folder / name).is_symlink():
            raise InputError(str(folder / name), "a link", "move it: a folder is to be made")
        if os.path.lexists(folder / name) and not (folder / name).is_dir():
            raise InputError(str(folder / name), "not a folder", "move it: a folder is to be made")
    return folder


@contextlib.contextmanager
def hold_folder(
    target: str | Path, files: Sequence[str] = (), folders: Sequence[str] = ()
) -> Iterator[Path]:
    """A folder for output that no other process writes to meanwhile.

    What had to be made for it is removed where the work inside fails and leaves it empty. Takes
    the arguments of `prepare_folder`.

    Raises InputError if the folder cannot be written, or another process writes to it.
    """
    above = (Path(target), *Path(target).parents)
    made = [folder for folder in above if not os.path.lexists(folder)]
    try:
        folder = prepare_folder(target, files, folders)
        with hold_lock(folder):
            for place in (folder, *(folder / name for name in folders)):
                remove_leftovers(place)
            yield folder
    except BaseException:
        for empty in made:
            with contextlib.suppress(OSError):
                empty.rmdir()
        raise


def kept_still(folder: Path, *, only_read: bool = False) -> contextlib.AbstractContextManager[None]:
    """Let nobody write to a folder meanwhile, if it is one of results or becomes one. One that is
    `only_read` need not be writable.

    Raises InputError if another process writes to it.
    """
    results = (LOCK, MARK, "manifest.json", "catalogue.json")
    ours = any((folder / name).exists() for name in results)
    if not ours or (only_read and not os.access(folder, os.W_OK)):
        return contextlib.nullcontext()
    return hold_lock(folder)


@contextlib.contextmanager
def renew_folder(
    folder: Path, commands: Sequence[str], scene: Mapping[str, Any] | None = None
) -> Iterator[list[str]]:
    """Replace what an earlier run left in a folder that is held; it is marked as unfinished
    meanwhile.

    The files of these commands, of those in `WRITTEN`, are to be written. What other commands have
    written stays only if it is of the same scene, given as resolved; the names of these files are
    given to the block.

    Raises NotWrittenError if nothing can be written.
    """
    same = scene is not None and _scene_in(folder) == json.loads(json.dumps(scene))
    gone = own_files(folder, commands if same else WRITTEN)
    kept = own_files(folder, WRITTEN.keys() - set(commands)) if same else []
    if same and "simulate" not in commands and _begins_as_ours(folder / ROWS):
        kept.append(ROWS)
    try:
        folder.mkdir(parents=True, exist_ok=True)  # it may have been removed during a long run
        put(folder / MARK, b"", FOR_ALL)
        for name in ("manifest.json", *gone):
            (folder / name).unlink(missing_ok=True)
    except OSError as error:
        raise NotWrittenError(str(folder), [], {"any file": reason(error)}) from None
    yield kept
    (folder / MARK).unlink(missing_ok=True)


def _scene_in(folder: Path) -> Any:
    """The scene that a folder's manifest holds; None without one."""
    try:
        return read_json(folder / "manifest.json", MANIFEST, WANTED)["scene"]["resolved"]
    except (InputError, KeyError, TypeError):
        return None


class Files:
    """The files of a folder `written` so far, among them those that were `kept`, and those that
    `failed`, each with the reason."""

    def __init__(self, folder: Path, kept: Sequence[str] = ()) -> None:
        self.folder = folder
        self.written = list(kept)
        self.failed: dict[str, str] = {}

    def add(self, write: Callable[[], Iterable[str]]) -> None:
        """Write files and record their names; go on if some cannot be written."""
        try:
            self.written += write()
        except NotWrittenError as error:
            self.written += error.written
            self.failed |= error.failed
        except InputError as error:  # a picture that cannot be drawn
            self.failed[error.where] = error.found

    def note(self, name: str, failure: str | None) -> None:
        """Record a file that was written elsewhere, or why it could not be."""
        if failure is None:
            self.written.append(name)
        else:
            self.failed[name] = failure

    def close(self, manifest: Callable[[], str]) -> None:
        """Write the manifest.

        Raises NotWrittenError if anything could not be written, or was removed meanwhile.
        """
        gone = [name for name in self.written if not os.path.lexists(self.folder / name)]
        self.written = [name for name in self.written if name not in gone]
        self.failed |= dict.fromkeys(gone, "removed meanwhile")
        self.add(lambda: write_all(self.folder, {"manifest.json": manifest}))
        if self.failed:
            raise NotWrittenError(str(self.folder), self.written, self.failed)

    def not_written(self) -> list[str]:
        """What could not be written, each with the reason."""
        return [f"{name}: {why}" for name, why in self.failed.items()]


# Which files are ours.


def branch_file(identity: str, word: str) -> str:
    """Return the name of a branch's table."""
    return f"branches/{_plain_part(identity)}-{_word_part(word)}.csv"


def curve_file(identity: str, kind: str, word: str) -> str:
    """Return the name of a curve's table."""
    return f"curves/{_plain_part(identity)}-{_plain_part(kind)}-{_word_part(word)}.csv"


def _word_part(word: str) -> str:
    """The part that names a word."""
    return _plain_part(word or "0")[:40]


def _plain_part(name: str) -> str:
    """A part of a file's name, if it leads to no other folder."""
    if not re.fullmatch(r"[\w-]+", name):
        raise ValueError(f"{short_repr(name)} in the name of a file")
    return name


def own_files(folder: Path, commands: Iterable[str]) -> list[str]:
    """Return the names of files in a folder that these commands have written.

    What a manifest or a catalogue says is not relied on: anybody may have written it. A file is
    one of ours if it has the name that we give it and begins as we begin it; a picture, if it has
    such a name and stands beside such a file.
    """
    found: list[str] = []
    known = (folder / MARK).exists() or _begins_as_ours(folder / "manifest.json")
    for command in commands:
        files, pictures = WRITTEN[command]
        for name in sorted(_names(folder)):
            if re.fullmatch(files, plain := name.removesuffix(PACKED)):
                found += [name] if _begins_as_ours(folder / plain) else []
            elif known and re.fullmatch(pictures, name):
                found.append(name)
    if "run" in commands:
        found += [name for place in TABLES for name in _tables(folder, place)]
    return found


def _names(folder: Path) -> list[str]:
    """The names of all but folders in a folder; none if it is a link."""
    if folder.is_symlink() and folder.name in TABLES:
        return []
    try:
        with os.scandir(folder) as entries:
            return [e.name for e in entries if not e.is_dir(follow_symlinks=False)]
    except OSError:
        return []


def _tables(folder: Path, place: str) -> list[str]:
    """The tables in a folder inside that carry the name their first line asks for."""
    names = [f"{place}/{name}" for name in sorted(_names(folder / place))]
    return [
        n for n in names if _table_name(folder / n.removesuffix(PACKED)) == n.removesuffix(PACKED)
    ]


def _table_name(path: Path) -> str | None:
    """The name that a table's first line asks for; None of what is no table of ours."""
    try:
        first = read_plain(path, LONGEST)[0].partition(b"\n")[0]
        head = json.loads(first.removeprefix(b"# "))
        if not head["schema"].startswith("contimpact."):
            return None
        named = [head[key] for key in ("id", "kind", "word") if key in head]
        return curve_file(*named) if "kind" in head else branch_file(*named)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


def _begins_as_ours(path: Path) -> bool:
    """Whether a file begins with one of our schemas, or as our list of events."""
    try:
        start = read_plain(path, 80)[0]
    except OSError:
        return False
    return b'"schema": "contimpact.' in start or start.startswith(b"id,kind,ghost,label,")


# Reading.


@contextlib.contextmanager
def reading(folder: Path) -> Iterator[Mapping[str, Any] | None]:
    """Make sure that the results in a folder are of one run, and stay so while they are read;
    gives the folder's manifest, if it has one.

    Raises InputError if a run was ended before it had written the folder, its manifest belongs to
    another catalogue or to another table, or it is rewritten meanwhile.
    """
    manifest, before = _state(folder)
    yield manifest
    if any(sha256(folder / name) != digest for name, digest in before.items()):
        raise InputError(str(folder), "written anew while it was read", "read it again")


@contextlib.contextmanager
def reading_catalogue(folder: Path) -> Iterator[tuple[Mapping[str, Any] | None, dict[str, Any]]]:
    """As `reading`; gives the manifest and the catalogue, and names what is wrong with that."""
    path = folder / "catalogue.json"
    with reading(folder) as manifest, check_reading(path, CATALOGUE):
        yield manifest, read_json(path, CATALOGUE, WANTED)


def sealed_names(files: Iterable[str]) -> list[str]:
    """Return the names of those files that are read back, in order."""
    return sorted({name for name in files if SEALED.fullmatch(name)})


def _state(folder: Path) -> tuple[Mapping[str, Any] | None, dict[str, str | None]]:
    """A folder's manifest, and the digests of it and of the files that it seals, if they belong to
    it; None for what cannot be read."""
    manifest = folder / "manifest.json"
    if os.path.lexists(folder / MARK):
        found = "a run is writing this folder, or ended before all was written"
        accepted = "run it again, or remove this file to use what is there"
        raise InputError(str(folder / MARK), found, accepted)
    if is_there(folder / ROWS) and not any(is_there(folder / name) for name in WHOLE):
        found = "a simulation is running, or ended before its results were written"
        accepted = f"go on with it: contimpact simulate SCENE -o {folder} --resume"
        raise InputError(str(folder / ROWS), found, accepted)
    content = read_json(manifest, MANIFEST, WANTED) if is_there(manifest) else None
    sealed = (content or {}).get("sha256")
    told = sealed if isinstance(sealed, dict) else {}
    names = sealed_names(["catalogue.json", *told])
    there = {name: sha256(folder / name) for name in names}
    for name, digest in there.items():
        if digest is not None and told.get(name, digest) != digest:
            accepted = "run it again, or remove manifest.json to use what is there as it is"
            where = str(folder / name)
            raise InputError(where, "not the one that manifest.json belongs to", accepted)
    return content, {"manifest.json": sha256(manifest), **there}


# The manifest of a folder of results: what was asked, what ran, its cost, what was left out.


def manifest_text(
    scene: Mapping[str, Any],
    given: Mapping[str, Any],
    left_out: Sequence[str],
    statistics: Mapping[str, Any],
    files: Sequence[str],
    digests: Mapping[str, str],
) -> str:
    """Return ``manifest.json``: what was asked, what ran, what it cost, what was left out.

    `digests` are those of the catalogue and the tables beside it.
    """
    versions = {"contimpact": __version__, "python": platform.python_version()}
    for name in ("numpy", "scipy", "sympy", "matplotlib"):
        if name in sys.modules:
            versions[name] = sys.modules[name].__version__
    own = [name for name in sys.modules if name.split(".")[0] == "contimpact"]
    libraries = ("numpy", "scipy", "sympy", "mpmath", "matplotlib", "llvmlite")
    return json_text(
        {
            "schema": MANIFEST,
            "versions": versions,
            "scene": {"given": given, "resolved": scene},
            **statistics,
            "compiled": {"mode": mode(), "programs": count_loaded(), "plainly": ran_plainly()},
            "modules": sorted(own) + [name for name in libraries if name in sys.modules],
            "left_out": list(left_out),
            "files": sorted(set(files)),
            "sha256": dict(digests),
        }
    )
