"""Where the scenes of a study are computed: a `concurrent.futures.Executor` of any kind.

A `Workshop` opens executors: a new one where the last one has broken. It knows nothing of scenes.
"""

from __future__ import annotations

import contextlib
import functools
import importlib
import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

from ..errors import InputError
from ..segments.compiling import cores

Opening = Callable[[int | None], contextlib.AbstractContextManager[Executor]]

THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMEXPR_NUM_THREADS",
)
"""Environment variables that set the number of threads of linear algebra; several processes need
one each."""
UNKNOWN = 16
"""Scenes given at once to an executor that does not say how many workers it has."""


@dataclass(frozen=True)
class Workshop:
    """A way to executors."""

    name: str
    opening: Opening
    """``opening(workers)`` returns a context manager that gives an executor, with so many workers
    if it can choose; None for all."""
    workers: Callable[[Executor], int | None]
    """How many workers an executor has; None where it does not say."""
    reopens: bool = True
    """Whether a broken executor can be replaced by a new one."""
    joined: bool = False
    """Whether workers join it, so that there may be none for a while."""
    own: bool = False
    """Whether the workers are processes started by this one."""


def processes(workers: int | None = None) -> Workshop:
    """Return processes of this machine, by default one for each core it may use."""
    count = workers or cores()

    def opening(asked: int | None) -> contextlib.AbstractContextManager[Executor]:
        return _pool(asked or count)

    return Workshop("processes", opening, lambda executor: count, own=True)


@contextlib.contextmanager
def _pool(workers: int) -> Iterator[Executor]:
    """Processes started afresh, with one thread each; they end if this one does.

    Raises InputError if they cannot load the script that asks for them.
    """
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    context = get_context("spawn")
    begun = context.Event()
    with _one_thread_each():
        pool = ProcessPoolExecutor(workers, context, _start_worker, (begun,))
        started = pool._processes
        try:
            yield pool
            if pool._broken and not begun.is_set() and _ended_by_themselves(pool, started):
                found = "its workers run this script again, and end before they begin"
                accepted = 'write what calls it below the line  if __name__ == "__main__":'
                raise InputError("run_study", found, accepted)
        except BaseException:
            _end_processes(pool)
            raise
        finally:
            pool.shutdown(cancel_futures=True)


def _ended_by_themselves(pool: Any, started: Mapping[int, Any]) -> bool:
    """Whether a worker of a broken pool has ended by itself, not by a signal."""
    pool.shutdown(cancel_futures=True)
    return any(process.exitcode == 1 for process in started.values())


def refuse_to_start_again() -> None:
    """End a worker that runs its parent's script again, which is about to start workers itself."""
    from multiprocessing import current_process

    if getattr(current_process(), "_inheriting", False):  # until the script is loaded
        os._exit(1)


def _end_processes(pool: Any) -> None:
    """End the processes of a pool at once; what they are at is not wanted any more."""
    for process in list((pool._processes or {}).values()):
        process.terminate()


@contextlib.contextmanager
def _one_thread_each() -> Iterator[None]:
    """What processes started within the block find in their environment, unless the user says."""
    added = [name for name in THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(added, "1"))
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)


def _start_worker(begun: Any) -> None:
    """In a new process: leave the terminal to its parent, and end when the parent does."""
    begun.set()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    from multiprocessing import connection, parent_process

    if parent := parent_process():
        connection.wait([parent.sentinel])
        os._exit(1)


def given(executor: Executor) -> Workshop:
    """Return an executor that somebody else has opened, and will close."""
    count = getattr(executor, "_max_workers", None)
    return Workshop(
        type(executor).__name__,
        lambda workers: contextlib.nullcontext(executor),
        lambda executor: count,
        reopens=False,
    )


def dask(address: str) -> Workshop:
    """Return the workers of a Dask scheduler.

    Raises InputError if Dask is not installed.
    """
    _module("distributed", "dask", "--scheduler")
    return Workshop("dask", functools.partial(_dask_client, address), _dask_workers, joined=True)


def _dask_workers(executor: Any) -> int | None:
    return sum(executor.client.nthreads().values()) or None


@contextlib.contextmanager
def _dask_client(address: str, workers: int | None) -> Iterator[Executor]:
    distributed = _module("distributed", "dask", "--scheduler")
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        accepted = "give the address that dask scheduler prints, such as tcp://host:8786"
        raise InputError("--scheduler", f"{address} is not reached ({error})", accepted) from None
    with client:
        executor = client.get_executor(pure=False)
        executor.client = client
        yield executor


PATIENCE = 60.0
"""Seconds to wait for a scheduler."""


def mpi() -> Workshop:
    """Return the processes of an MPI run.

    Raises InputError if mpi4py is not installed.
    """
    futures = _module("mpi4py.futures", "mpi", "--mpi")

    def opening(workers: int | None) -> contextlib.AbstractContextManager[Executor]:
        executor: contextlib.AbstractContextManager[Executor] = futures.MPIPoolExecutor(workers)
        return executor

    return Workshop("mpi", opening, lambda executor: getattr(executor, "num_workers", None))


def _module(name: str, extra: str, where: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        found = f"{name} cannot be imported ({error})"
        raise InputError(where, found, f"pip install contimpact[{extra}]") from None
