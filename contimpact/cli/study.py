"""``contimpact study``: compute the scenes of a study into a store."""

from __future__ import annotations

import argparse

from ..errors import InputError
from ..segments.compiling import mode
from ..studies.executors import Workshop, dask, mpi, processes
from ..studies.run import Tally, WorkersLostError, duration, run_study
from ..studies.store import Store
from ..studies.study_file import load_study
from ..telling import telling
from .terminal import complain, say


def command(options: argparse.Namespace) -> int:
    """Compute a study; returns the exit status."""
    mode()  # refused before anything is computed
    study, workshop = load_study(options.study), _workshop(options)

    def announce(text: str) -> None:
        if not options.quiet:
            say(f"{study.name}: {text}")

    try:
        with Store(options.output) as store, telling(study.name, options.quiet) as tell:
            tally = run_study(
                study, store, workshop, again=options.again, progress=tell, announce=announce
            )
    except WorkersLostError as error:
        complain(error)
        return 1
    except KeyboardInterrupt:
        complain(f"interrupted; the same command continues with what is in {options.output}")
        return 1
    announce(_summary(tally, options.output))
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
    text = f"{tally.before + tally.done} of {tally.total} scenes in {store}"
    if tally.failed:
        text += f", {tally.failed} of them failed: SELECT * FROM failures"
    if tally.done:
        text += f"; {tally.done} took {duration(tally.seconds)}"
    if tally.estimate:
        text += f" (estimate {duration(tally.estimate)})"
    if tally.limited:
        text += f"; limits cut {tally.limited} short: SELECT * FROM limits"
    return text
