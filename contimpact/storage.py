"""Files: written as a whole or not at all, in folders that one process holds at a time.

Everything that contimpact writes goes through `put`: a new file beside the target takes the
target's name once it is whole. A link at the target is replaced, not followed.
"""

from __future__ import annotations

import contextlib
import csv
import errno
import functools
import hashlib
import io
import json
import lzma
import math
import os
import platform
import re
import stat
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias, cast

from .errors import DAMAGE, InputError, NotWrittenError, printable

# Which process wrote something, and whether it is still running.

ENDED = "ended"
"""Mark in place of the start of a process that has ended and waits for its parent to take
notice."""


@dataclass(frozen=True)
class Process:
    """A process: its host, its number, and when it started, in the system's own clock.

    The start tells a process from a later one with the same number. It is empty where the system
    does not say.
    """

    host: str
    pid: int
    start: str

    @property
    def name(self) -> str:
        """A short name for use in names of files."""
        return f"{digest_of(self.host)}-{self.pid}-{self.start or 0}"

    def here(self) -> bool:
        """Whether it runs, or ran, on this machine."""
        return self.host == host_name()

    def running(self) -> bool:
        """Whether it is running, if it is one of this machine; true where that cannot be told."""
        return running(self.pid, self.start)


def this_process() -> Process:
    """Return this process."""
    return _process(os.getpid())


@functools.cache
def _process(pid: int) -> Process:
    return Process(host_name(), pid, start_of(pid))


@functools.cache
def host_name() -> str:
    """Return the machine's name."""
    return platform.node()


def digest_of(name: str) -> str:
    """Return a machine's name as eight hexadecimal digits."""
    return hashlib.sha256(name.encode()).hexdigest()[:8]


def running(pid: int, start: str) -> bool:
    """Whether a process of this machine is running; true where that cannot be told."""
    if pid <= 0:
        return False
    if sys.platform == "win32":  # os.kill would end it there
        return True
    try:
        with contextlib.suppress(PermissionError):  # somebody else's
            os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    now = start_of(pid)
    return not (now and start) or now == start


def start_of(pid: int) -> str:
    """Return when a process started, in ticks since the machine did; empty if that is not told."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    fields = text.rpartition(")")[2].split()
    return ENDED if fields[0] in "ZX" else fields[19]


Content = Callable[[], str | bytes]
"""Makes the content of a file."""

FOR_ALL = 0o666
"""Permissions of results, before the user's umask."""

LEFT = re.compile(r"\..*\.([0-9a-f]{8})-(\d+)-(\w+)-\d+\.tmp", re.DOTALL)
PACKED = ".xz"
"""Ending of a file that is stored compressed: it is read in place of one without."""
LARGEST_RECORD = 2**28
"""Bytes of a JSON file, or of the record in a table's first line."""
DEEPEST = 64
"""How deep a JSON file may be nested."""
DAY = 86400.0
"""Seconds after which a temporary file of another machine is taken to be left behind."""


# Writing.


def put(path: Path, content: bytes, mode: int = 0o600, *, durable: bool = False) -> None:
    """Put a whole file in place at once: another process may be writing or reading it. `mode` is
    its permissions, before the umask; a `durable` one is on the disk before it takes its name, so
    that it survives a machine that stops.

    Raises OSError if it cannot be written.
    """
    temporary = temporary_beside(path)
    try:
        with open(os.open(temporary, _NEW, mode), "wb") as file:
            file.write(content)
            if durable:
                file.flush()
                os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


_NO_LINK = getattr(os, "O_NOFOLLOW", 0)
_SAFE = _NO_LINK | getattr(os, "O_BINARY", 0) | getattr(os, "O_NONBLOCK", 0)
_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | _SAFE


def temporary_beside(path: Path) -> Path:
    """Return a name for a temporary file of this process, see `remove_leftovers`."""
    own = f"{this_process().name}-{time.monotonic_ns()}"
    return path.with_name(f".{path.name[:40]}.{own}.tmp")


DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Errors of a disk, not of the place that was given."""


def write(path: Path, content: str | bytes) -> None:
    """Write a file whole or not at all.

    Raises InputError if it cannot be written.
    """
    with check_writing(path, "place"):
        _write(path, content)


@contextlib.contextmanager
def check_writing(path: Path, kind: str) -> Iterator[None]:
    """Turn what goes wrong with writing somewhere into `InputError`, or `NotWrittenError` where the
    disk is at fault; `kind` is what else to give, a place or a folder."""
    try:
        yield
    except OSError as error:
        if error.errno in DISK:
            raise NotWrittenError(str(path.parent), [], {path.name: reason(error)}) from None
        found = f"cannot be written ({reason(error)})"
        raise InputError(str(path), found, f"give another {kind}") from None


def append_line(path: Path, line: str) -> None:
    """Add a line to a file that is there.

    Raises OSError if it cannot be written, or is a link.
    """
    content = f"{line}\n".encode()
    with open(os.open(path, os.O_WRONLY | os.O_APPEND | _SAFE), "wb", buffering=0) as file:
        if file.write(content) != len(content):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all, in a folder that is made if need be.

    Raises InputError if it cannot be written.
    """
    with check_writing(path, "folder"):
        path.parent.mkdir(parents=True, exist_ok=True)
    write(path, text)


def write_all(folder: Path, contents: Mapping[str, Content]) -> list[str]:
    """Write files to a folder, each of them that can be written, and return their names. The
    contents are by the files' names relative to the folder; folders in them are made, but one that
    is a link is refused.

    Raises NotWrittenError in the end, if some could not be written.
    """
    written: list[str] = []
    failed: dict[str, str] = {}
    for name, content in contents.items():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            make_inside(folder, Path(name).parent)
            _write(folder / name, content())
        except OSError as error:
            failed[name] = reason(error)
        else:
            written.append(name)
    if failed:
        raise NotWrittenError(str(folder), written, failed)
    return written


def _write(path: Path, content: str | bytes) -> None:
    """Write a result; the records, which tell what is whole, are on the disk from then on."""
    data = content.encode() if isinstance(content, str) else content
    put(path, data, FOR_ALL, durable=path.suffix == ".json")


def make_inside(folder: Path, inner: Path) -> None:
    """Make a folder inside another one.

    Raises OSError if it cannot be made, or is a link: what is written there would land elsewhere.
    """
    for part in inner.parts:
        folder = folder / part
        if folder.is_symlink():
            raise NotADirectoryError(f"{folder.name} is a link")
        folder.mkdir(exist_ok=True)


# Reading.


def read_plain(path: Path, most: int = -1) -> tuple[bytes, os.stat_result]:
    """Return the content, at most so many bytes, and the status of a plain file: no folder, pipe or
    device.

    Raises OSError if it cannot be read.
    """
    with open_plain(path) as file:
        return file.read(most), os.fstat(file.fileno())


def sha256(path: Path) -> str | None:
    """Return a file's digest; None if it cannot be read."""
    try:
        return hashlib.sha256(read_plain(path)[0]).hexdigest()
    except OSError:
        return None


def digests(folder: Path, names: Iterable[str]) -> dict[str, str]:
    """Return the digests of those of a folder's files that can be read, by name."""
    return {name: found for name in names if (found := sha256(folder / name))}


def _packed(path: Path) -> Path:
    """The path of a file's compressed form; a path such as ``.`` has no name to change."""
    return Path(f"{path}{PACKED}")


def is_there(path: Path) -> bool:
    """Return whether a file can be read, as it is or from its compressed form."""
    return path.exists() or _packed(path).exists()


@contextlib.contextmanager
def open_plain(path: Path) -> Iterator[BinaryIO]:
    """Open a plain file, or where there is none its compressed form, for reading."""
    packed = _packed(path)
    if not os.path.lexists(path) and packed.exists():
        with open_plain(packed) as file, lzma.open(file) as content:
            try:
                yield cast(BinaryIO, content)
            except (lzma.LZMAError, EOFError) as error:
                raise OSError(f"damaged: {error}") from None
        return
    descriptor = os.open(path, os.O_RDONLY | _SAFE & ~_NO_LINK)
    if not stat.S_ISREG(mode := os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise IsADirectoryError("a folder") if stat.S_ISDIR(mode) else OSError("not a plain file")
    with open(descriptor, "rb") as file:
        yield file


def read_bounded(path: Path, most: int = LARGEST_RECORD) -> bytes:
    """Return the content of a plain file of at most `most` bytes.

    Raises OSError, ValueError if it is no such file or cannot be read; if it is too long.
    """
    return check_length(read_plain(path, most + 1)[0], most)


def check_length(content: bytes, most: int) -> bytes:
    """Return what was read, or raise `ValueError` if it is longer than admitted."""
    if len(content) > most:
        raise ValueError(f"longer than {most} bytes")
    return content


@contextlib.contextmanager
def check_reading(path: Path, *schemas: str) -> Iterator[None]:
    """Turn what goes wrong with a file of one of some schemas into `InputError`."""
    accepted = f"give a file of {' or '.join(map(repr, schemas))}"
    try:
        yield
    except InputError:
        raise
    except OSError as error:
        raise InputError(str(path), f"cannot be read ({reason(error)})", accepted) from None
    except (*DAMAGE, csv.Error) as error:
        found = f"damaged ({type(error).__name__}: {error})"
        raise InputError(str(path), found, accepted) from None


def read_json(path: Path, schema: str, wanted: str) -> dict[str, Any]:
    """Read a JSON file of a schema, or raise `InputError`."""
    try:
        content = json.loads(read_bounded(path).decode())
        _check_depth(content)
    except OSError as error:
        raise InputError(str(path), f"cannot be read ({reason(error)})", f"give {wanted}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(str(path), f"not JSON ({error})", f"give {wanted}") from None
    found = content.get("schema") if isinstance(content, dict) else None
    if found != schema:
        raise InputError(str(path), f"its schema is {found!r}", f"this version reads {schema!r}")
    return content


def _check_depth(content: Any, left: int = DEEPEST) -> None:
    """Raise `ValueError` if plain data are nested deeper than any of ours."""
    if not left:
        raise ValueError("nested too deeply")
    if isinstance(content, dict | list):
        for part in content.values() if isinstance(content, dict) else content:
            _check_depth(part, left - 1)


def reason(error: Exception) -> str:
    """Return why the system refused something, in its words."""
    return str(getattr(error, "strerror", None) or error)


# What killed processes leave behind.


def remove_leftovers(folder: Path) -> None:
    """Remove temporary files and folders of processes that have ended."""
    try:
        names = os.listdir(folder)
    except OSError:
        return
    for name in names:
        if (match := LEFT.fullmatch(name)) and _is_left_over(folder / name, *match.groups()):
            _remove(folder / name)


def _remove(path: Path) -> None:
    """Remove a file or a folder; what cannot be removed stays."""
    import shutil

    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
        return
    with contextlib.suppress(OSError):
        path.unlink()


def _is_left_over(path: Path, machine: str, pid: str, start: str) -> bool:
    """Whether a temporary file's process has ended."""
    if machine == digest_of(host_name()):
        return not running(int(pid), "" if start == "0" else start)
    try:
        return time.time() - path.lstat().st_mtime > DAY
    except OSError:
        return False


# One process at a time writes to a folder.
#
# The lock is a file in the folder. Where the system has locks on files, it is held by one of these,
# which ends with its process however that ends; the file's content only says who holds it.
# Elsewhere the content decides: a lock is stale if its process has ended, told from a later process
# of the same number by when it started.

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

LOCK = "contimpact.lock"
LONGEST = 4096
"""Bytes that are read of a lock."""


@contextlib.contextmanager
def hold_lock(folder: Path, name: str = LOCK) -> Iterator[None]:
    """Keep other processes from writing to a folder, or to what a lock of another name is for.

    Raises InputError if another one does, or the folder cannot be written.
    """
    path = folder / name
    with check_writing(path, "folder"):
        descriptor = _take_lock(path)
    try:
        yield
    finally:
        _give_back(path, descriptor)


def _take_lock(path: Path) -> int:
    """The lock's file, open and ours."""
    while True:
        descriptor = _open_lock(path)
        try:
            if not _take_if_free(descriptor):
                raise _busy_error(path, _record(descriptor))
            if _is_same_file(descriptor, path):
                _sign(descriptor, path)
                return descriptor
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)  # given back between opening and locking it


def _open_lock(path: Path) -> int:
    """The lock's file; a link, or anything that is no plain file, is refused."""
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | _SAFE, FOR_ALL)
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise OSError("not a plain file")
    return descriptor


def _take_if_free(descriptor: int) -> bool:
    """Take the lock; false if somebody else has it."""
    try:
        if fcntl is not None:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return True
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return not _is_held(_record(descriptor))
    return not _is_held(_record(descriptor))


def _is_held(record: dict[str, Any]) -> bool:
    """Whether the process that wrote a lock may be running."""
    try:
        holder = Process(str(record["host"]), int(record["pid"]), str(record["start"]))
    except (KeyError, TypeError, ValueError):
        return False
    return not holder.here() or holder.running()


def _is_same_file(descriptor: int, path: Path) -> bool:
    """Whether an open file is still the one of this name."""
    try:
        return os.path.samestat(os.fstat(descriptor), os.lstat(path))
    except FileNotFoundError:
        return False


def _sign(descriptor: int, path: Path) -> None:
    """Say in the lock who holds it."""
    me = this_process()
    since = time.strftime("%Y-%m-%d %H:%M:%S")
    text = json.dumps({"pid": me.pid, "host": me.host, "start": me.start, "since": since})
    try:
        os.ftruncate(descriptor, 0)
        os.lseek(descriptor, 0, os.SEEK_SET)
        os.write(descriptor, text.encode() + b"\n")
    except OSError:  # a full disk
        path.unlink()
        raise


def _record(descriptor: int) -> dict[str, Any]:
    """What a lock says; empty if that makes no sense."""
    os.lseek(descriptor, 0, os.SEEK_SET)
    try:
        record = json.loads(os.read(descriptor, LONGEST))
    except (ValueError, RecursionError):
        return {}
    return record if isinstance(record, dict) else {}


def _busy_error(path: Path, record: dict[str, Any]) -> InputError:
    who = ", ".join(f"{name} {record[name]}" for name in ("pid", "host", "since") if name in record)
    remedy = "wait until it has ended, or give another folder"
    if fcntl is None or record.get("host") != this_process().host:
        remedy += f" (if it has ended for certain, remove {path.name})"
    return InputError(str(path.parent), f"another contimpact is writing to it ({who})", remedy)


def _give_back(path: Path, descriptor: int) -> None:
    """Remove the lock's file while nobody else can hold it."""
    with contextlib.suppress(OSError):
        if fcntl is None:
            os.close(descriptor)
            path.unlink()
        else:
            path.unlink()
            os.close(descriptor)


# Plain data and their texts: JSON and CSV, written, and read with their mistakes named.
#
# Names and messages may come from files of others. They reach a reader as text: no control
# character comes to a terminal, no cell is a formula in a spreadsheet, no HTML and no further row
# stands in a table. What is read back is read back the same.

_INVISIBLE = re.compile(
    "[\x7f-\x9f\xad\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff\ufff9-\ufffb\ud800-\udfff]"
)
"""Characters that change how a text is shown, and halves of characters."""
_NUMBERS = re.compile(r"(?<=\[)\n *-?\d[^][{}\"tfn]*(?=\])")
"""List of numbers alone that is printed over several lines."""
_FORMULA = tuple("=+-@\t\r'")
"""How cells begin that a spreadsheet takes for formulas; and ``'``, the mark that they are none."""


def terminal_text(text: str, encoding: str | None = None) -> str:
    """Return lines of text as a terminal of an encoding can show them, all else as escapes."""
    lines, code = "\n".join(map(printable, text.split("\n"))), encoding or "utf-8"
    return lines.encode(code, "backslashreplace").decode(code)


# JSON.

Json: TypeAlias = bool | int | float | str | Sequence["Json"] | Mapping[str, "Json"] | None
"""Plain data as JSON holds them."""


def json_text(content: Json) -> str:
    """Return readable JSON with no number that is not finite; lists of numbers are in one line."""
    text = json.dumps(finite(content), indent=1, allow_nan=False, ensure_ascii=False)
    text = _NUMBERS.sub(lambda found: " ".join(found[0].split()), text)
    return f"{_visible(text)}\n"


def json_line(content: Json) -> str:
    """Return JSON in one line; numbers that are not finite are texts."""
    return _visible(json.dumps(finite(content, repr), allow_nan=False, ensure_ascii=False))


def _visible(text: str) -> str:
    """JSON with the characters that are not seen as escapes, which read back to the same."""
    return _INVISIBLE.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def finite(value: Any, instead: Callable[[float], Any] = lambda value: None) -> Any:
    """Plain data with every number that is not finite replaced."""
    if isinstance(value, float):
        return value if math.isfinite(value) else instead(value)
    if isinstance(value, Mapping):
        return {name: finite(v, instead) for name, v in value.items()}
    if isinstance(value, list | tuple):
        return [finite(v, instead) for v in value]
    return value


# CSV.


def csv_text(columns: Sequence[str], rows: Iterable[Iterable[Any]], *, exact: bool = False) -> str:
    """Return a table as CSV; numbers read back to the same bits, None is an empty cell.

    A text that would be a formula in a spreadsheet has ``'`` before it. Where it is `exact`,
    `unescape_text` gives texts back as they are; control characters are escapes otherwise.
    """
    shown = _escape_text if exact else printable
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(_cell(name, shown) for name in columns)
    writer.writerows([_cell(value, shown) for value in row] for row in rows)
    return buffer.getvalue()


def csv_of_records(rows: Sequence[Mapping[str, Any]], first: Sequence[str] = ()) -> str:
    """Return rows by column as CSV: the columns named first, then others as they come; cells that
    a row lacks are empty."""
    columns = list(dict.fromkeys([*first, *(name for row in rows for name in row)]))
    return csv_text(columns, ([row.get(name) for name in columns] for row in rows))


def _cell(value: Any, shown: Callable[[str], str]) -> Any:
    if isinstance(value, float):
        return float.__repr__(value)  # NumPy's own names its type
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, str) and value:
        text = shown(value)
        return f"'{text}" if text.startswith(_FORMULA) else text
    return value


def _escape_text(text: str) -> str:
    """A text as it is; halves of characters and \\r, which no table gives back, as escapes."""
    return text.encode(errors="backslashreplace").decode().replace("\r", "\\r")


def unescape_text(cell: str) -> str:
    """Return the text that an exact `csv_text` has written as a cell."""
    return cell.removeprefix("'")


# The folder of what is generated once and kept: kernels, and compiled code.
#
# What is in it is executed. So only what this user alone can have written is taken from it: the
# folder and every file must belong to the user, and nobody else may be allowed to write them.


def logger(name: str) -> Any:
    """Return a logger; `logging` is imported when there is something to say."""
    import logging

    return logging.getLogger(name)


def cache_folder() -> Path | None:
    """Return the folder, or None if it cannot be used or could be written by others.

    ``CONTIMPACT_CACHE`` names it; otherwise it is the platform's folder for caches.
    """
    try:
        folder = _absolute_folder()
    except (OSError, RuntimeError) as error:  # no home; a working folder that is gone
        _warn(f"no folder for them is known ({error}); name one by CONTIMPACT_CACHE")
        return None
    if fault := _fault(folder):
        _warn(f"{folder} {fault}; name another folder by CONTIMPACT_CACHE")
        return None
    _remove_leftovers(folder)
    return folder


def _fault(folder: Path) -> str | None:
    """Why a folder is not used; it is made if need be."""
    try:
        _make_folder(folder)
        return distrust_reason(folder.stat())
    except (OSError, ValueError) as error:
        return f"cannot be used ({reason(error)})"


def _absolute_folder() -> Path:
    """The folder's absolute path: a relative one could be taken for an option or a library."""
    if named := os.environ.get("CONTIMPACT_CACHE"):
        return Path(named).expanduser().absolute()
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home()) / "contimpact" / "cache"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "contimpact"
    given = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return (given if given.is_absolute() else Path.home() / ".cache") / "contimpact"


def _make_folder(folder: Path) -> None:
    """Make a folder, and those above it, for this user alone, whatever the umask."""
    if folder.is_dir():
        return
    _make_folder(folder.parent)
    try:
        folder.mkdir(0o700)
    except FileExistsError:  # another process was quicker, or it is a file
        if not folder.is_dir():
            raise
    else:
        folder.chmod(0o700)


def distrust_reason(status: os.stat_result) -> str | None:
    """Return why a file or folder is not relied on; None if only this user can have written it."""
    if not hasattr(os, "geteuid"):  # Windows: the user's folders are closed to others
        return None
    if status.st_uid != os.geteuid():
        return f"belongs to another user (number {status.st_uid})"
    if status.st_mode & 0o022:
        return "may be written by others, so empty it and take their permission away"
    return None


@functools.cache
def _warn(why: str) -> None:
    """Say once in a process why nothing is cached."""
    logger(__name__).warning("kernels and compiled code are not cached: %s", why)


def warn_uncached(folder: Path, error: OSError) -> None:
    """Say once in a process that a file could not be put into the cache, and what can be done."""
    remedy = "free disk space, or name another folder by CONTIMPACT_CACHE"
    _warn(f"{folder} cannot be written ({reason(error)}); {remedy}")


@functools.cache
def _remove_leftovers(folder: Path) -> None:
    """Remove, once in a process, what killed ones have left behind."""
    remove_leftovers(folder)


def store_file(path: Path, content: bytes) -> None:
    """Put a file into the cache, for this user alone.

    Raises OSError if it cannot be written.
    """
    put(path, content, 0o600)


def load_file(path: Path) -> bytes:
    """Return the content of a file in the cache.

    Raises OSError if it cannot be read, or somebody else could have written it.
    """
    content, status = read_plain(path)
    if fault := distrust_reason(status):
        raise PermissionError(f"it {fault}")
    return content


# What runs as machine code: files with digests, for damaged ones could crash.


def put_with_digest(path: Path, content: bytes) -> None:
    """Store a file and its digest."""
    store_file(path, content)
    store_file(digest_beside(path), _digest(path, content))


MOST_KEPT = 256
"""Objects that `kept_object` leaves in the cache; the oldest go first."""


def kept_object(kind: str, identity: Sequence[str], build: Callable[[], Any]) -> Any:
    """Return an object that holds machine code: from the cache, or built and stored there.

    The kind is the beginning of its file's name, the identity what it depends on besides the
    processor; what `build` makes can be pickled.
    """
    import pickle
    import zlib

    folder = cache_folder()
    if folder is None:
        return build()
    digest = hashlib.sha256("\0".join((*identity, platform.machine(), processor())).encode())
    path = folder / f"{kind}-{digest.hexdigest()[:24]}.pickle"
    if is_intact(path):
        try:
            return pickle.loads(zlib.decompress(load_file(path)))
        except Exception as error:  # of whatever kind: it can be built instead
            logger(__name__).warning("%s is not used: %s", path, reason(error))
    found = build()
    try:
        put_with_digest(path, zlib.compress(pickle.dumps(found), 1))
        _remove_oldest(folder, kind)
    except OSError as error:
        logger(__name__).info("%s is not stored: %s", path, reason(error))
    return found


def _remove_oldest(folder: Path, kind: str) -> None:
    """Remove all objects of a kind but the newest `MOST_KEPT`."""
    paths = sorted(folder.glob(f"{kind}-*.pickle"), key=lambda path: path.stat().st_mtime)
    for path in paths[:-MOST_KEPT]:
        for file in (path, digest_beside(path)):
            file.unlink(missing_ok=True)


def digest_beside(path: Path) -> Path:
    """The file that holds the digest of a file of machine code."""
    return path.with_name(f"{path.name}.sha256")


def _digest(path: Path, content: bytes) -> bytes:
    """Digest of a file with its name, so that a renamed file does not match."""
    return hashlib.sha256(path.name.encode() + b"\0" + content).hexdigest().encode()


def is_intact(path: Path) -> bool:
    """Whether a file is as this user wrote it; loading a damaged one could crash."""
    try:
        expected, found = load_file(digest_beside(path)), _digest(path, load_file(path))
    except FileNotFoundError:
        return False
    except OSError as error:
        logger(__name__).warning("%s is not used: %s", path, reason(error))
        return False
    if found != expected:
        logger(__name__).warning("%s is damaged and not used", path)
    return found == expected


def processor() -> str:
    """The processor's model and features as the system reports them."""
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return platform.processor()
    lines = [line for line in text.splitlines() if line.startswith(("model name", "flags"))]
    return "\n".join(lines[:2])
