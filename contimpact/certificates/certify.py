"""Certifying entries, branches and folders of results; verifying what was certified."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import flint

from .. import __version__
from ..errors import InputError, NotInstalledError
from ..models.model import Model
from ..orbits.problem import OrbitProblem
from ..progress import Progress, silent
from ..results.branch import Branch, Entry, model_at, model_of, orbit_of
from ..results.catalogue import load_diagram, load_entries
from ..results.diagram import Diagram
from ..results.options import CertifyOptions
from ..results.result_folder import CATALOGUE, WANTED, read_json, reading
from ..segments.balls import INTEGRATED, without_enclosures
from ..segments.kernels import Kernels, identity_of
from .branch import BranchCertificate, certified_branch, verified_branch, without_certificate
from .event import EventCertificate, NoEnclosuresError, certified, verified
from .records import ROWS, Certificates, Kept, digest, read_certificates

NONE = "there is no certificate"
ROUNDING = 1e-9
"""Of shares."""
QUIET = "proofs along branches are for orbits with impacts"


class Problems:
    """The orbit problems of entries; kernels of one system are loaded once."""

    def __init__(self, model: Model | None = None) -> None:
        self.model = model
        self._kernels: dict[Any, Kernels] = {}

    def of(self, entry: Entry) -> OrbitProblem:
        """Return the problem of an entry.

        Raises
        ------
        InputError
            If the system is not known, or the entry is none of its orbits.
        """
        at = model_of(entry, self.model)
        return orbit_of(entry, at, self._shared(at, entry.parameter)).problem

    def kernels(self, branch: Branch) -> Kernels:
        """Return the kernels of a branch."""
        return self._shared(model_at(branch, 0, self.model), branch.parameter)

    def _shared(self, model: Model, parameter: str) -> Kernels:
        key = (identity_of(model), parameter)
        if key not in self._kernels:
            self._kernels[key] = with_enclosures(Kernels(model, parameter))
        return self._kernels[key]


def with_enclosures(kernels: Kernels) -> Kernels:
    """Return kernels of whose flights enclosures are known.

    Raises
    ------
    NoEnclosuresError
        Where they are not.
    """
    model = kernels.model
    try:
        sources = [kernels.motion(wall.name).source for wall in model.WALLS]
        found = next(filter(None, map(without_enclosures, sources)), None)
    except NotInstalledError:
        found = INTEGRATED
    if found is None:
        return kernels
    accepted = "proofs are for linear flights and closed forms with eight harmonics at most"
    raise NoEnclosuresError(f"system {model.SYSTEM}", found, accepted)


def certify(
    what: Diagram | Branch | Entry | Sequence[Entry] | str | Path,
    model: Model | None = None,
    *,
    options: CertifyOptions | None = None,
    progress: Progress = silent,
) -> Certificates:
    """Prove what is recorded: by interval arithmetic, rounding included.

    Parameters
    ----------
    what : Diagram, Branch, Entry, sequence of Entry, str or Path
        A path is that of a folder that ``contimpact run`` wrote.
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
    options = options or CertifyOptions()
    if isinstance(what, str | Path):
        return certify_folder(Path(what), options, model, progress=progress)
    if isinstance(what, Entry):
        what = [what]
    if isinstance(what, Branch):
        name, entries, branches = what.id, list(what.events), [what]
    elif isinstance(what, Diagram):
        name, entries, branches = what.name, what.entries, list(what.branches)
    else:
        name, entries, branches = "entries", list(what), []
    return _Work(options, model, progress, Kept(None, "")).certificates(name, "", entries, branches)


def certify_folder(
    folder: Path,
    options: CertifyOptions,
    model: Model | None = None,
    *,
    progress: Progress = silent,
    keep: bool = False,
) -> Certificates:
    """Prove the catalogue in a folder that ``contimpact run`` wrote.

    Parameters
    ----------
    folder : Path
    options : CertifyOptions
    model, progress
        As in `certify`.
    keep : bool
        Whether to keep certificates in the folder as they are found, and to go on from those.
    """
    catalogue, entries, branches = _read(folder)
    said = digest(catalogue)
    kept = Kept(folder / ROWS if keep else None, f"{said} {options} {versions()}")
    found = _Work(options, model, progress, kept).certificates(
        catalogue["scene"], said, entries, branches
    )
    kept.remove()
    return found


def _read(folder: Path) -> tuple[dict[str, Any], list[Entry], list[Branch]]:
    """A folder's catalogue, its entries, and its branches with these for events."""
    with reading(folder):
        catalogue = read_json(folder / "catalogue.json", CATALOGUE, WANTED)
        return catalogue, load_entries(folder), list(load_diagram(folder).branches)


class _Work:
    """What is done for one catalogue."""

    def __init__(
        self, options: CertifyOptions, model: Model | None, progress: Progress, kept: Kept
    ) -> None:
        self.options, self.model, self.progress, self.kept = options, model, progress, kept
        self.problems = Problems(model)

    def certificates(
        self, name: str, said: str, entries: Sequence[Entry], branches: Sequence[Branch]
    ) -> Certificates:
        began = time.perf_counter()
        if 0 in (*(e.period for e in entries), *(b.period for b in branches)):
            accepted = "proofs are for orbits of the forcing's period"
            raise InputError(name, "its orbits have a free period", accepted)
        for branch in branches:
            self.problems.kernels(branch)
        found = proven_once(entries, self._each(entries))
        known = {c.id: c for c in found}
        tubes = self._branches(branches, entries, known) if self.options.branches else []
        seconds = time.perf_counter() - began
        return Certificates(name, said, found, tubes, seconds, versions())

    def _each(self, entries: Sequence[Entry]) -> list[EventCertificate]:
        found = []
        for number, entry in enumerate(entries, start=1):
            self.progress(f"certifying {entry.id}, {number} of {len(entries)} entries")
            one = self.kept.get(EventCertificate, entry.id)
            if one is None:
                one = self._entry(entry)
                self.kept.add(one)
            found.append(one)
        return found

    def _entry(self, entry: Entry) -> EventCertificate:
        options = self.options
        return certified(entry, lambda: self.problems.of(entry), options.bits, options.max_bits)

    def _branches(
        self,
        branches: Sequence[Branch],
        entries: Sequence[Entry],
        known: Mapping[str, EventCertificate],
    ) -> list[BranchCertificate]:
        found = []
        for branch in branches:
            if len(branch) < 2:
                continue
            if not branch.word:
                found.append(without_certificate(branch, QUIET))
                continue
            one = self.kept.get(BranchCertificate, branch.id)
            if one is None:
                one = self._branch(branch, entries, known)
                self.kept.add(one)
            found.append(one)
        return found

    def _branch(
        self,
        branch: Branch,
        entries: Sequence[Entry],
        known: Mapping[str, EventCertificate],
    ) -> BranchCertificate:
        def tell(text: str) -> None:
            self.progress(f"certifying {branch.id}, {branch.notation}: {text}")

        kernels = self.problems.kernels(branch)
        kinds, seconds = self.options.events, self.options.seconds
        return certified_branch(branch, entries, known, kinds, self.model, kernels, tell, seconds)


def proven_once(
    entries: Sequence[Entry], found: Sequence[EventCertificate]
) -> list[EventCertificate]:
    """Return certificates, those of an event that is recorded twice rejected."""
    kept: list[EventCertificate] = []
    for entry, one in zip(entries, found, strict=True):
        twin = next((c for c in kept if one.certified and _same(c, one, entries)), None)
        kept.append(one if twin is None else rejected(entry, "twice", f"it is the event {twin.id}"))
    return kept


def _same(one: EventCertificate, other: EventCertificate, entries: Sequence[Entry]) -> bool:
    """Whether two certificates are of one event of one branch."""
    a, b = (next(e for e in entries if e.id == c.id) for c in (one, other))
    if not one.certified or (one.kind, one.branch) != (other.kind, other.branch):
        return False
    if (a.flight, a.impact, a.wall) != (b.flight, b.impact, b.wall):
        return False
    pairs = zip(one.inner, other.inner, strict=True)
    return all(flint.arb(x).overlaps(flint.arb(y)) for x, y in pairs)


def verify_folder(
    folder: Path, model: Model | None = None, *, progress: Progress = silent
) -> Certificates:
    """Prove anew what ``certificates.json`` says of the catalogue beside it.

    The tests are made on boxes and tubes as they are recorded; nothing is searched for. An entry
    without a certificate is rejected, and so is a certificate whose entry is not there.

    Raises
    ------
    InputError
        If a file is missing or damaged.
    """
    began = time.perf_counter()
    catalogue, entries, branches = _read(folder)
    stored = read_certificates(folder)
    problems, records = Problems(model), {c.id: c for c in stored.entries}

    def prove(entry: Entry) -> EventCertificate:
        progress(f"verifying {entry.id}")
        record = records.get(entry.id)
        if record is None or not record.certified:
            return rejected(entry, "certificate", NONE)
        return verified(entry, record, lambda: problems.of(entry))

    found = proven_once(entries, [prove(entry) for entry in entries])
    known = {c.id: c for c in found}
    tubes, kept = [], {record.id: record for record in stored.branches}
    for branch in branches if kept else ():
        progress(f"verifying {branch.id}")
        if branch.id not in kept or not branch.word:
            tubes.append(without_certificate(branch, QUIET if not branch.word else NONE))
            continue
        kernels = problems.kernels(branch)
        try:
            one = verified_branch(branch, kept[branch.id], entries, known, model, kernels)
        except (ValueError, LookupError) as error:
            one = without_certificate(branch, f"its certificate is damaged ({error})")
        tubes.append(one)
    found += [
        EventCertificate(c.id, c.kind, c.branch, clause="entry", found="not in the catalogue")
        for c in stored.entries
        if c.id not in known
    ]
    there = {one.id: one for one in tubes}
    more = [name for name, record in kept.items() if _says_more(record, there.get(name))]
    seconds = time.perf_counter() - began
    said = digest(catalogue)
    return Certificates(stored.scene, said, found, tubes, seconds, versions(), more)


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


def rejected(entry: Entry, clause: str, found: str) -> EventCertificate:
    """Return the certificate of an entry that is rejected."""
    return EventCertificate(entry.id, entry.kind, entry.branch, clause=clause, found=found)


def versions() -> dict[str, str]:
    """Return the versions of the libraries a proof rests on."""
    known = {"python-flint": flint.__version__, "flint": flint.__FLINT_VERSION__}
    return {"contimpact": __version__, **known}
