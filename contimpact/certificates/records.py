"""``certificates.json``: what is proven of a folder of results, written and read back."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from ..errors import InputError, printable
from ..results.result_folder import CATALOGUE, MANIFEST, WANTED, digests_of, read_json
from ..storage.files import append, write_text
from ..storage.texts import DAMAGE, Json, json_line, json_text, made
from .branch import BranchCertificate
from .event import EventCertificate

T = TypeVar("T")

SCHEMA = "contimpact.certificates/1"
FILE = "certificates.json"
ROWS = "certificates.jsonl"
"""What is proven as it is proven, to go on from after an interruption."""


@dataclass(frozen=True)
class Certificates:
    """What is proven of a catalogue.

    Attributes
    ----------
    scene : str
    catalogue : str
        Digest of what the catalogue says, see `digest`.
    entries : sequence of EventCertificate
    branches : sequence of BranchCertificate
    seconds : float
    versions : mapping
        Of the libraries the proof rests on.
    unconfirmed : sequence of str
        Branches whose stored certificates say more than is proven from them; of a verification.
    """

    scene: str
    catalogue: str
    entries: Sequence[EventCertificate]
    branches: Sequence[BranchCertificate] = ()
    seconds: float = 0.0
    versions: Mapping[str, str] = field(default_factory=dict)
    unconfirmed: Sequence[str] = ()

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
        return not (self.rejected or self.refuted or self.unconfirmed)

    def lines(self) -> list[str]:
        """Return what is proven, and what is not, in words."""
        radii = [c.certified_radius for c in self.entries if c.certified_radius is not None]
        count = len(self.entries) - len(self.rejected)
        within = f", radii below {max(radii):.1e}" if radii else ""
        return [
            f"{count} of {len(self.entries)} entries certified{within}",
            *([] if self.branches else ["no branch is looked at"]),
            *(f"  {c.id} rejected: {c.clause}: {c.found}" for c in self.rejected),
            *(line for c in self.branches for line in c.lines()),
            *(f"{name}: its stored certificate says more than that" for name in self.unconfirmed),
        ]

    def __repr__(self) -> str:
        return "\n".join(map(printable, [f"Certificates of {self.scene}:", *self.lines()]))

    def record(self) -> dict[str, Any]:
        """Return the certificates as plain data."""
        return {
            "schema": SCHEMA,
            "scene": self.scene,
            "catalogue": self.catalogue,
            "versions": dict(self.versions),
            "seconds": self.seconds,
            "entries": [c.record() for c in self.entries],
            "branches": [c.record() for c in self.branches],
        }


def digest(catalogue: Mapping[str, Any]) -> str:
    """Return a digest of what a catalogue says of branches and events, certified radii aside."""
    entries = [
        {k: v for k, v in entry.items() if k != "certified_radius"}
        for entry in catalogue["entries"]
    ]
    said = {"branches": catalogue["branches"], "entries": entries}
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()


def read_certificates(folder: Path) -> Certificates:
    """Read ``certificates.json``.

    Raises
    ------
    InputError
        If it is missing or damaged.
    """
    path = folder / FILE
    content = read_json(path, SCHEMA, "a folder that contimpact certify has written to")
    try:
        entries = [made(EventCertificate, record) for record in content["entries"]]
        branches = [made(BranchCertificate, record) for record in content["branches"]]
        return made(Certificates, {**content, "entries": entries, "branches": branches})
    except DAMAGE as error:
        raise InputError(str(path), f"damaged ({error})", f"give a file of {SCHEMA!r}") from None


def write_certificates(folder: Path, certificates: Certificates) -> list[str]:
    """Write ``certificates.json``, and the radii into the catalogue; return the files' names."""
    path = folder / "catalogue.json"
    catalogue = read_json(path, CATALOGUE, WANTED)
    radii = {c.id: c.certified_radius for c in certificates.entries if c.certified}
    catalogue["entries"] = [_with_radius(e, radii.get(e["id"])) for e in catalogue["entries"]]
    write_text(folder / FILE, json_text(certificates.record()))
    write_text(path, json_text(catalogue))
    _renew_manifest(folder)
    return [FILE, "catalogue.json"]


def _with_radius(entry: Mapping[str, Any], radius: float | None) -> dict[str, Any]:
    """An entry with its certified radius behind its error."""
    found: dict[str, Any] = {}
    for key, value in entry.items():
        if key != "certified_radius":
            found[key] = value
        if key == "error" and radius is not None:
            found["certified_radius"] = radius
    return found


def _renew_manifest(folder: Path) -> None:
    """The manifest belongs to the catalogue as it is now, and names the certificates."""
    path = folder / "manifest.json"
    if not path.exists():
        return
    manifest = read_json(path, MANIFEST, WANTED)
    manifest["files"] = sorted({*manifest["files"], FILE})
    manifest["sha256"] = manifest.get("sha256", {}) | digests_of(folder, ["catalogue.json"])
    write_text(path, json_text(manifest))


class Kept:
    """Certificates kept as they are found, to go on from after an interruption.

    Parameters
    ----------
    path : Path, optional
        Of the file, one line for each certificate. Without it nothing is kept.
    key : str
        What they belong to: the first line holds it, and rows of another one are not used.
    """

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
            return None if row is None else made(kind, row)
        except DAMAGE:  # proven again
            return None

    def add(self, certificate: EventCertificate | BranchCertificate) -> None:
        """Keep a certificate."""
        if self.path is not None:
            row: dict[str, Json] = {
                "of": type(certificate).__name__,
                "certificate": certificate.record(),
            }
            append(self.path, (json_line(row) + "\n").encode())

    def remove(self) -> None:
        """Remove the file: all is written elsewhere."""
        if self.path is not None:
            self.path.unlink(missing_ok=True)
