"""Certificates of a folder's results, and their records."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import flint

from .. import __version__
from ..errors import (
    DAMAGE,
    InputError,
    NotInstalledError,
    count_text,
    explain_arguments,
    printable,
    short_repr,
)
from ..models.model import Model
from ..orbits.problem import Linearisation
from ..progress import Progress, ignore_progress
from ..results.branch import Branch, Entry, model_at, model_of, orbit_of
from ..results.catalogue import Results, open_results, table_remark
from ..results.diagram import Diagram
from ..results.options import CertifyOptions
from ..results.scene import Scene, load_scene
from ..schema import build_record, record
from ..segments.balls import INTEGRATED, without_enclosures
from ..segments.kernels import Kernels
from ..storage import Json, append_line, digests, json_line, json_text, read_json, write_text
from .branch import BranchCertificate, certify_branch, verify_branch, without_certificate
from .event import EventCertificate, NoEnclosuresError, certify_entry, verify_entry

# ``certificates.json``: what is proven of a folder of results, written and read back.

T = TypeVar("T")
Proven = TypeVar("Proven", EventCertificate, BranchCertificate)

SCHEMA = "contimpact.certificates/1"
FILE = "certificates.json"
ROWS = "certificates.jsonl"
"""File of what has been proven so far, from which an interrupted run continues."""


@dataclass(frozen=True)
class Certificates:
    """What is proven of a catalogue."""

    scene: str
    catalogue: str
    """Digest of what the catalogue says, see `Results.digest`."""
    entries: Sequence[EventCertificate]
    branches: Sequence[BranchCertificate] = ()
    seconds: float = 0.0
    versions: Mapping[str, str] = field(default_factory=dict)
    """Versions of the libraries on which the proof rests."""
    unconfirmed: Sequence[str] = ()
    """Branches whose stored certificates say more than is proven from them; of a verification."""
    table: str = ""
    """Where the table of events beside the catalogue says something else; of a verification."""

    @property
    def rejected(self) -> list[EventCertificate]:
        """The entries of which a clause could not be proven."""
        return [c for c in self.entries if not c.certified]

    @property
    def refuted(self) -> list[BranchCertificate]:
        """The branches on which an event is missing, or one is recorded that is not there."""
        return [c for c in self.branches if c.refuted]

    @property
    def certified(self) -> bool:
        """Whether every entry is certified, and no branch refutes the catalogue.

        A branch that is proven in part only does not; `complete` of its certificate tells. What is
        stored has to be confirmed where it is verified.
        """
        return not (self.rejected or self.refuted or self.unconfirmed or self.table)

    def lines(self) -> list[str]:
        """Return what is proven, and what is not, in words."""
        radii = [c.certified_radius for c in self.entries if c.certified_radius is not None]
        count = len(self.entries) - len(self.rejected)
        within = f", radii below {max(radii):.1e}" if radii else ""
        return [
            f"{count} of {count_text(len(self.entries), 'entry', 'entries')} certified{within}",
            *([] if self.branches else ["no branch is looked at"]),
            *(f"  {c.id} rejected: {c.clause}: {c.found}" for c in self.rejected),
            *(line for c in self.branches for line in c.lines()),
            *(f"{name}: its stored certificate says more than that" for name in self.unconfirmed),
            *([self.table] if self.table else []),
        ]

    def __repr__(self) -> str:
        return "\n".join(map(printable, [f"Certificates of {self.scene}:", *self.lines()]))

    def record(self) -> dict[str, Any]:
        """Return the certificates as plain data."""
        names = ("scene", "catalogue", "versions", "seconds", "entries")
        branches = [c.record() for c in self.branches]
        return {"schema": SCHEMA, **record(self, names), "branches": branches}


def read_certificates(folder: Path) -> Certificates:
    """Read ``certificates.json``.

    Raises InputError if it is missing or damaged.
    """
    path = folder / FILE
    content = read_json(path, SCHEMA, "a folder that contimpact certify has written to")
    try:
        return build_record(Certificates, content)
    except DAMAGE as error:
        raise InputError(str(path), f"damaged ({error})", f"give a file of {SCHEMA!r}") from None


def write_certificates(results: Results, certificates: Certificates) -> list[str]:
    """Write ``certificates.json``, and the radii into the catalogue, to which the manifest then
    belongs; return the files' names."""
    folder, manifest = results.folder, results.manifest
    radii = {c.id: c.certified_radius for c in certificates.entries if c.certified}
    entries = [_add_radius(e, radii.get(e["id"])) for e in results.catalogue["entries"]]
    write_text(folder / FILE, json_text(certificates.record()))
    write_text(folder / "catalogue.json", json_text({**results.catalogue, "entries": entries}))
    if manifest is not None:
        files = sorted({*manifest["files"], FILE})
        sealed = manifest.get("sha256", {}) | digests(folder, ["catalogue.json"])
        renewed = {**manifest, "files": files, "sha256": sealed}
        write_text(folder / "manifest.json", json_text(renewed))
    return [FILE, "catalogue.json"]


def _add_radius(entry: Mapping[str, Any], radius: float | None) -> dict[str, Any]:
    """An entry with its certified radius behind its error."""
    found: dict[str, Any] = {}
    for key, value in entry.items():
        if key != "certified_radius":
            found[key] = value
        if key == "error" and radius is not None:
            found["certified_radius"] = radius
    return found


class CertificateLog:
    """Certificates kept as they are found, to go on from after an interruption: one line for each
    in a file, if a path is given. The first line holds the key to which they belong; rows of
    another one are not used."""

    def __init__(self, path: Path | None, key: str) -> None:
        self.path = path
        self.rows: dict[tuple[str, str], dict[str, Any]] = {}
        if path is None:
            return
        lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
        if lines and lines[0] == self._head(key):
            self._read(lines[1:])
        else:
            write_text(path, self._head(key) + "\n")

    @staticmethod
    def _head(key: str) -> str:
        return json_line({"schema": SCHEMA, "of": key})

    def _read(self, lines: Sequence[str]) -> None:
        """All rows that are whole."""
        for line in lines:
            try:
                row = json.loads(line)
                self.rows[row["of"], row["certificate"]["id"]] = row["certificate"]
            except DAMAGE:
                return

    def get(self, kind: type[T], name: str) -> T | None:
        """Return what is kept of an entry or a branch."""
        row = self.rows.get((kind.__name__, name))
        try:
            return None if row is None else build_record(kind, row)
        except DAMAGE:  # proven again
            return None

    def add(self, certificate: EventCertificate | BranchCertificate) -> None:
        """Keep a certificate."""
        if self.path is not None:
            if isinstance(certificate, BranchCertificate):
                content = certificate.record()
            else:
                content = record(certificate)
            row: dict[str, Json] = {"of": type(certificate).__name__, "certificate": content}
            append_line(self.path, json_line(row))

    def remove(self) -> None:
        """Remove the file: all is written elsewhere."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)


NONE = "there is no certificate"
ROUNDING = 1e-9
"""Rounding error that shares may have."""
PRINTED = 0.95
"""Part of a radius that is left where the box it was told of is read back from its digits."""


class RecordedOrbits:
    """The orbits of entries as they are recorded; kernels of one system are loaded once."""

    def __init__(self, model: Model | None = None) -> None:
        self.model = model
        self._kernels: dict[Any, Kernels] = {}

    def of(self, entry: Entry) -> Linearisation:
        """Return the orbit of an entry.

        Raises InputError if the system is not known, or the entry is none of its orbits.
        """
        at = model_of(entry, self.model)
        return orbit_of(entry, at, self._shared(at, entry.parameter)).linearisation

    def kernels(self, branch: Branch) -> Kernels:
        """Return the kernels of a branch."""
        return self._shared(model_at(branch, 0, self.model), branch.parameter)

    def _shared(self, model: Model, parameter: str) -> Kernels:
        key = (model.identity, parameter)
        if key not in self._kernels:
            self._kernels[key] = enclosing_kernels(Kernels(model, parameter))
        return self._kernels[key]


def enclosing_kernels(kernels: Kernels) -> Kernels:
    """Return kernels of whose flights enclosures are known.

    Raises NoEnclosuresError where they are not.
    """
    model = kernels.model
    try:
        motions = [kernels.motion(wall.name) for wall in model.WALLS]
        found = next(filter(None, map(without_enclosures, motions)), None)
    except NotInstalledError:
        found = INTEGRATED
    if found is None:
        return kernels
    accepted = "proofs are for linear flights and closed forms with eight harmonics at most"
    raise NoEnclosuresError(f"system {model.SYSTEM}", found, accepted)


@explain_arguments
def certify(
    what: Diagram | Branch | Entry | Sequence[Entry] | Scene | str | Path,
    model: Model | None = None,
    *,
    options: CertifyOptions | None = None,
    progress: Progress = ignore_progress,
) -> Certificates:
    """Prove what is recorded: by interval arithmetic, rounding included.

    Parameters
    ----------
    what : Diagram, Branch, Entry, sequence of Entry, Scene, str or Path
        A path is that of a folder that ``contimpact run`` wrote, or of a scene. A scene is
        followed first; its ``[certify]`` holds where there are no options.
    model : Model, optional
        The system, where its name does not tell. Parameter values are taken from what is recorded.
    options : CertifyOptions, optional
        Precision, whether branches are proven, and for which kinds of events.
    progress : callable, optional
        Called with a line of text now and then.

    Returns
    -------
    Certificates

    Raises
    ------
    InputError
        If a folder is missing or damaged, or a system is not known or has flights without
        enclosures.
    """
    return _Proof(_recorded(what, options, progress), model, progress).certificates()


def certify_results(
    results: Results,
    options: CertifyOptions,
    model: Model | None = None,
    *,
    progress: Progress = ignore_progress,
    keep: bool = False,
) -> Certificates:
    """Prove the catalogue of a folder; see `certify`. Where it is asked to `keep`, certificates are
    kept in the folder as they are found, to go on from."""
    recorded = _recorded(results, options, progress)
    key = f"{recorded.digest} {options} {versions()}"
    kept = CertificateLog(results.folder / ROWS if keep else None, key)
    found = _Proof(recorded, model, progress, kept).certificates()
    kept.remove()
    return found


@dataclass(frozen=True)
class _Recorded:
    """What is to be proven, and how."""

    name: str
    entries: Sequence[Entry]
    branches: Sequence[Branch]
    options: CertifyOptions
    digest: str = ""
    """Of the catalogue, if it is that of a folder."""


def _recorded(what: object, options: CertifyOptions | None, progress: Progress) -> _Recorded:
    """What is recorded in anything that `certify` is given, or in a folder's results."""
    if isinstance(what, str | Path) and Path(what).suffix == ".toml":
        what = load_scene(what)
    if isinstance(what, Scene):
        from .. import follow

        options = options or what.certify
        what = follow(what, progress=progress)
    options = options or CertifyOptions()
    if isinstance(what, str | Path):
        what = open_results(Path(what))
    if isinstance(what, Results):
        diagram = what.diagram
        return _Recorded(diagram.name, what.entries, diagram.branches, options, what.digest)
    if isinstance(what, Branch):
        return _Recorded(what.id, list(what.events), [what], options)
    if isinstance(what, Diagram):
        return _Recorded(what.name, what.entries, list(what.branches), options)
    what = [what] if isinstance(what, Entry) else what
    entries = list(what) if isinstance(what, Iterable) else []
    if not entries or not all(isinstance(one, Entry) for one in entries):
        accepted = "give a diagram, a branch, events, a scene, or a folder of contimpact run"
        raise InputError("what", f"found {short_repr(what)}", accepted)
    return _Recorded("entries", entries, [], options)


NOT_KEPT = CertificateLog(None, "")


class _Proof:
    """What is done for one catalogue."""

    def __init__(
        self,
        recorded: _Recorded,
        model: Model | None,
        progress: Progress,
        kept: CertificateLog = NOT_KEPT,
    ) -> None:
        self.recorded, self.options = recorded, recorded.options
        self.model, self.progress, self.kept = model, progress, kept
        self.orbits = RecordedOrbits(model)

    def certificates(self) -> Certificates:
        began = time.perf_counter()
        name, said = self.recorded.name, self.recorded.digest
        entries, branches = self.recorded.entries, self.recorded.branches
        if 0 in (*(e.period for e in entries), *(b.period for b in branches)):
            accepted = "proofs are for orbits of the forcing's period"
            raise InputError(name, "its orbits have a free period", accepted)
        for branch in branches:
            self.orbits.kernels(branch)
        proven = []
        for number, entry in enumerate(entries, start=1):
            self.progress(
                f"certifying {entry.id}, {number} of {count_text(len(entries), 'entry', 'entries')}"
            )
            proven.append(self._entry(entry))
        found = reject_repeated(entries, proven)
        known = {c.id: c for c in found}
        long = [branch for branch in branches if len(branch) > 1 and self.options.branches]
        tubes = [self._branch(branch, entries, known) for branch in long]
        return Certificates(name, said, found, tubes, time.perf_counter() - began, versions())

    def _once(self, kind: type[Proven], name: str, prove: Callable[[], Proven]) -> Proven:
        """What is kept of an entry or a branch; else it is proven, and kept."""
        found = self.kept.get(kind, name)
        if found is None:
            found = prove()
            self.kept.add(found)
        return found

    def _entry(self, entry: Entry) -> EventCertificate:
        bits, orbit = (self.options.bits, self.options.max_bits), lambda: self.orbits.of(entry)
        prove = partial(certify_entry, entry, orbit, *bits)
        return self._once(EventCertificate, entry.id, prove)

    def _branch(
        self, branch: Branch, entries: Sequence[Entry], known: Mapping[str, EventCertificate]
    ) -> BranchCertificate:
        def tell(text: str) -> None:
            self.progress(f"certifying {branch.id}, {branch.notation}: {text}")

        about = self.options.events, self.model, self.orbits.kernels(branch)
        given = branch, entries, known, *about, tell, self.options.seconds
        return self._once(BranchCertificate, branch.id, partial(certify_branch, *given))


def reject_repeated(
    entries: Sequence[Entry], found: Sequence[EventCertificate]
) -> list[EventCertificate]:
    """Return certificates, those of an event that is recorded twice rejected."""
    kept: list[EventCertificate] = []
    for entry, one in zip(entries, found, strict=True):
        twin = next((c for c in kept if one.certified and _same_event(c, one, entries)), None)
        kept.append(
            one
            if twin is None
            else rejected_certificate(entry, "twice", f"it is the event {twin.id}")
        )
    return kept


def _same_event(one: EventCertificate, other: EventCertificate, entries: Sequence[Entry]) -> bool:
    """Whether two certificates are of one event of one branch."""
    a, b = (next(e for e in entries if e.id == c.id) for c in (one, other))
    if not one.certified or (one.kind, one.branch) != (other.kind, other.branch):
        return False
    if (a.flight, a.impact, a.wall) != (b.flight, b.impact, b.wall):
        return False
    pairs = zip(one.inner, other.inner, strict=True)
    return all(flint.arb(x).overlaps(flint.arb(y)) for x, y in pairs)


def verify_results(
    results: Results, model: Model | None = None, *, progress: Progress = ignore_progress
) -> Certificates:
    """Prove anew what ``certificates.json`` says of the catalogue beside it.

    The tests are made on boxes and tubes as they are recorded; nothing is searched for. An entry
    without a certificate is rejected, and so is a certificate whose entry is not there.

    Raises InputError if a file is missing or damaged.
    """
    began = time.perf_counter()
    entries, branches = results.entries, results.diagram.branches
    stored = read_certificates(results.folder)
    orbits, records = RecordedOrbits(model), {c.id: c for c in stored.entries}

    def prove(entry: Entry) -> EventCertificate:
        progress(f"verifying {entry.id}")
        record = records.get(entry.id)
        if record is None or not record.certified:
            return rejected_certificate(entry, "certificate", NONE)
        return verify_entry(entry, record, lambda: orbits.of(entry))

    found = reject_repeated(entries, [prove(entry) for entry in entries])
    known = {c.id: c for c in found}
    tubes, kept = [], {record.id: record for record in stored.branches}
    for branch in branches if kept else ():
        progress(f"verifying {branch.id}")
        if branch.id not in kept:
            tubes.append(without_certificate(branch, NONE))
            continue
        kernels = orbits.kernels(branch)
        try:
            one = verify_branch(branch, kept[branch.id], entries, known, model, kernels)
        except (ValueError, LookupError) as error:
            one = without_certificate(branch, f"its certificate is damaged ({error})")
        tubes.append(one)
    found += [
        EventCertificate(c.id, c.kind, c.branch, clause="entry", found="not in the catalogue")
        for c in stored.entries
        if c.id not in known
    ]
    there = {one.id: one for one in tubes}
    more = [entry.id for entry in entries if _claims_more(entry, records.get(entry.id), known)]
    more += [name for name, record in kept.items() if _says_more(record, there.get(name))]
    seconds = time.perf_counter() - began
    said, table = results.digest, table_remark(results.folder, entries)
    return Certificates(stored.scene, said, found, tubes, seconds, versions(), more, table)


def _claims_more(
    entry: Entry, record: EventCertificate | None, known: Mapping[str, EventCertificate]
) -> bool:
    """Whether an entry, or its certificate, tells another event or a smaller radius than is
    proven."""
    found = known[entry.id]
    if record is None or found.certified_radius is None:
        return False
    if (record.kind, record.branch) != (found.kind, found.branch):
        return True
    told = record.certified_radius, entry.certified_radius
    return any(one is not None and one < PRINTED * found.certified_radius for one in told)


def _says_more(record: BranchCertificate, found: BranchCertificate | None) -> bool:
    """Whether a certificate says more of a branch than is proven, or of one that is not there."""
    if found is None:
        return True
    kinds = set(record.kinds) <= set(found.kinds)
    return (
        (record.complete and not found.complete)
        or record.share > found.share + ROUNDING
        or not kinds
    )


def rejected_certificate(entry: Entry, clause: str, found: str) -> EventCertificate:
    """Return the certificate of an entry that is rejected."""
    return EventCertificate(entry.id, entry.kind, entry.branch, clause=clause, found=found)


def versions() -> dict[str, str]:
    """Return the versions of the libraries a proof rests on."""
    known = {"python-flint": flint.__version__, "flint": flint.__FLINT_VERSION__}
    return {"contimpact": __version__, **known}
