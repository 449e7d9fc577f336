"""``contimpact study``, ``export``, ``atlas``: compute a study, and write what its store holds."""

from __future__ import annotations

import argparse
import collections
from pathlib import Path

import numpy as np

from ..errors import InputError, count_text
from ..models.expressions import number
from ..progress import telling
from ..segments.compiling import mode
from ..storage import csv_text, write_text
from ..studies.executors import Workshop, dask, mpi, processes
from ..studies.run import Tally, WorkersLostError, duration, run_study
from ..studies.store import Store
from ..studies.study import COUNT, QUANTITIES, Map, Study, quantity_of, shortfall, studies
from ..studies.study_file import load_study
from . import complain, say

FORMATS = ("png", "svg", "pdf")
"""Of maps."""


def study(options: argparse.Namespace) -> int:
    """Compute a study; returns the exit status."""
    mode()  # refused before anything is computed
    asked, workshop = load_study(options.study, options.system), _workshop(options)

    def announce(text: str) -> None:
        if not options.quiet:
            say(f"{asked.name}: {text}")

    try:
        with Store(options.output) as store, telling(asked.name, options.quiet) as tell:
            tally = run_study(
                asked, store, workshop, again=options.again, progress=tell, announce=announce
            )
    except WorkersLostError as error:
        complain(error)
        return 1
    except KeyboardInterrupt:
        complain(f"interrupted; the same command continues with what is in {options.output}")
        return 1
    announce(_summary(tally, options.output))
    if options.quiet and (lacking := _lacking(tally)):
        complain(f"{asked.name}: of {count_text(tally.total, 'scene')} {lacking}")
    return 0


def _workshop(options: argparse.Namespace) -> Workshop:
    if options.scheduler and options.mpi:
        raise InputError("--mpi", "--scheduler is given too", "give one of them")
    if options.workers is not None and options.workers < 1:
        raise InputError("--workers", f"found {options.workers}", "give a number above 0")
    if options.scheduler:
        return dask(options.scheduler)
    return mpi() if options.mpi else processes(options.workers)


def _summary(tally: Tally, store: str) -> str:
    text = f"{tally.before + tally.done} of {count_text(tally.total, 'scene')} in {store}"
    if lacking := _lacking(tally):
        text += f", {lacking}"
    if tally.done:
        text += f"; {tally.done} took {duration(tally.seconds)}"
    if tally.estimate:
        text += f" (estimate {duration(tally.estimate)})"
    if tally.limited:
        text += f"; limits cut {tally.limited} short: SELECT * FROM limits"
    return text


def _lacking(tally: Tally) -> str:
    """How many scenes in the store have failed or ended early, and what can be done."""
    counts = [f"{n} {status}" for status, n in tally.statuses.items() if status != "done"]
    if not counts:
        return ""
    return f"{' and '.join(counts)}: SELECT * FROM failures; --again tries them once more"


def export(options: argparse.Namespace) -> int:
    """Write the tables of a store as files; returns the exit status."""
    from ..studies.export import export as write_tables

    with telling("export", options.quiet, patient=True) as tell:
        tell("writing tables")
        written = write_tables(
            options.store,
            options.output,
            options.format,
            names=options.study,
            tables=options.table,
            columns=options.columns,
            digits=options.digits,
        )
    if not options.quiet:
        for name, count in written.items():
            say(f"{name}: {count_text(count, 'row')}")
    return 0


ORBIT = "1:1"
"""Orbit of which maps are drawn where none is named."""


def atlas(options: argparse.Namespace) -> int:
    """Draw maps of the studies in a store over two of their axes; returns the exit status."""
    given = [_axis_value(text) for text in options.at]
    at = dict(given)
    if len(at) < len(given):
        raise InputError("--at", "two values of one axis", "give one")
    names = options.study or studies(options.store)
    folder, drawn, mapped = Path(options.output), False, False
    with telling("atlas", options.quiet, patient=True) as tell:
        for name in names:
            with Study(options.store, name, options.system) as study:
                if not options.study and len(study.axes) < 2:
                    continue  # nothing of two axes, and nobody has asked for it
                mapped = True
                if lacking := shortfall(study):
                    complain(f"{name}: {lacking}; values are missing there, or may be wrong")
                for quantity in options.quantity or QUANTITIES:
                    tell(f"{name}: {quantity}")
                    shown = study.map(
                        quantity, axes=options.axes, orbit=options.orbit or ORBIT, at=at
                    )
                    if options.quantity or _is_known(shown).any():
                        _write_map(shown, study, folder, options)
                        of_orbit = "{orbit}" in quantity_of(quantity).text
                        drawn |= of_orbit or bool(options.quantity) or not options.orbit
    if not mapped:
        accepted = "give a store of a study with two names in [study.grid] or [study.sample]"
        raise InputError(options.store, "no study has two axes", accepted)
    if not drawn:
        found = f"no map over two axes has a value of {options.orbit or ORBIT}"
        raise InputError(options.store, found, "name an orbit of its scenes with --orbit")
    return 0


def _axis_value(text: str) -> tuple[str, float]:
    name, sign, value = text.partition("=")
    if not sign:
        raise InputError("--at", f"found {text!r}", "give a value such as A=5")
    return name.strip(), number(value, "--at")


def _is_known(shown: Map) -> np.ndarray:
    """Where there is a value."""
    if shown.named:
        return np.array([value is not None for value in shown.values])
    return np.isfinite(shown.values)


def _write_map(shown: Map, study: Study, folder: Path, options: argparse.Namespace) -> None:
    rows = zip(shown.x.tolist(), shown.y.tolist(), shown.values.tolist(), strict=True)
    write_text(folder / f"{shown.stem}.csv", csv_text([*shown.axes, shown.quantity], rows))
    formats = tuple(options.format or FORMATS[:1])
    if not options.no_plot:
        from ..plots.lines import units_of
        from ..plots.maps import save_map

        save_map(shown, folder, formats, units_of(study.given["model"]["system"]))
    if not options.quiet:
        say(f"{shown.title}: {shown.text}: {_describe(shown)}{_why_none(shown, study)}")
        for line in _compare_zeros(shown):
            say(f"  {line}")


def _describe(shown: Map) -> str:
    known = _is_known(shown)
    if not known.any():
        return "no values"
    if shown.named:
        counts = collections.Counter(str(v) for v in shown.values[known])
        return ", ".join(f"{name} {count}" for name, count in counts.most_common())
    low, high = shown.values[known].min(), shown.values[known].max()
    return f"{low:.6g} to {high:.6g} in {known.sum()} of {count_text(len(known), 'scene')}"


def _why_none(shown: Map, study: Study) -> str:
    """What a map without values lacks, and the labels there are where one occurs nowhere."""
    if shown.quantity.startswith(COUNT) and not shown.values.any():
        query = "SELECT DISTINCT label FROM events WHERE study = ? ORDER BY label"
        known = ", ".join(label for (label,) in study.rows(query, [study.number]))
        return f"; labels are {known}" if known else ""
    kept = {"energy": "energies", "bound": "attractors"}.get(shown.quantity)
    if _is_known(shown).any():
        return ""
    if shown.quantity == "margin" and study.file.first.margins is None:
        return ": state [margins]"
    return f": add {kept!r} to study.keep" if kept and kept not in study.file.keep else ""


def _compare_zeros(shown: Map) -> list[str]:
    """How far the map's zeros are from curves of codimension two."""
    if shown.named or shown.grid() is None or not len(shown.zeros()):
        return []
    y = shown.axes[1]
    known = {kind: shown.departure(kind) for kind in shown.curves}
    return [
        f"changes its sign at {count_text(len(shown.zeros()), 'place')} along {y}",
        *(
            f"at most {far:.2g} in {y} from {kind} computed directly"
            for kind, far in known.items()
            if far is not None
        ),
    ]
