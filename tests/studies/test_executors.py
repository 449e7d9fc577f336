"""Studies on a Dask scheduler and on MPI: real ones, where they are installed."""

from __future__ import annotations

import contextlib
import importlib.util
import shutil
import socket
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from small_studies import TOML, computed_here, contents, study_given

from contimpact.cli import main
from contimpact.studies import executors
from contimpact.studies.run import WorkersLostError, run_study
from contimpact.studies.store import Store
from contimpact.studies.study_file import read_study

COUNT = 5


def installed(name):
    return importlib.util.find_spec(name) is not None


with_dask = pytest.mark.skipif(not installed("distributed"), reason="Dask is not installed")
with_mpi = pytest.mark.skipif(
    not installed("mpi4py") or shutil.which("mpiexec") is None, reason="no MPI is installed"
)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    path = tmp_path_factory.mktemp("study") / "study.toml"
    path.write_text(TOML.format(name="small", count=COUNT))
    computed_here(path.with_name("whole.sqlite"), count=COUNT)
    return path


@pytest.mark.parametrize(
    ("module", "options", "extra"),
    [
        ("distributed", ["--scheduler", "tcp://127.0.0.1:1"], "dask"),
        ("mpi4py.futures", ["--mpi"], "mpi"),
    ],
)
def test_what_is_not_installed_is_named_with_what_brings_it(
    module, options, extra, study, tmp_path, monkeypatch, capsys
):
    monkeypatch.setitem(sys.modules, module, None)
    assert main(["study", str(study), "-o", str(tmp_path / "s.sqlite"), *options]) == 2
    assert f"pip install contimpact[{extra}]" in capsys.readouterr().err
    assert not (tmp_path / "s.sqlite").exists()


class Cluster:
    """A scheduler on the loopback address and two worker processes, as people start them."""

    def __init__(self, folder):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.folder, self.address = folder, f"tcp://127.0.0.1:{self.port}"
        self.processes = []
        self.start()

    def start(self):
        port = str(self.port)
        self.scheduler = self.spawn(
            "scheduler", "--host", "127.0.0.1", "--port", port, "--dashboard-address", "127.0.0.1:0"
        )
        self.workers = [
            self.spawn(
                "worker",
                self.address,
                "--nthreads",
                "1",
                "--no-nanny",
                "--no-dashboard",
                "--local-directory",
                str(self.folder),
            )
            for _ in range(2)
        ]

    def spawn(self, *command):
        log = open(self.folder / "log.txt", "a")  # noqa: SIM115
        process = subprocess.Popen(
            [sys.executable, "-m", "dask", *command], stdout=log, stderr=log, cwd=self.folder
        )
        log.close()
        self.processes.append(process)
        return process

    def stop(self):
        for process in self.processes:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            process.wait()


@pytest.fixture
def cluster(tmp_path):
    found = Cluster(tmp_path)
    yield found
    found.stop()


def study_on(cluster, study, store, **options):
    """The command in a process of its own."""
    command = [sys.executable, "-m", "contimpact", "study", str(study), "-o", str(store)]
    return subprocess.Popen([*command, "--scheduler", cluster.address], text=True, **options)


def wait_for(store, scenes):
    """Wait until a store holds so many scenes."""
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline:
        with contextlib.suppress(Exception):
            if len(contents(store)["scenes"]) >= scenes:
                return
        time.sleep(0.05)
    raise TimeoutError(scenes)


@with_dask
def test_a_worker_killed_under_dask_loses_nothing(cluster, study, tmp_path):
    store = tmp_path / "s.sqlite"
    process = study_on(cluster, study, store)
    wait_for(store, 2)
    cluster.workers[0].kill()
    assert process.wait(120) == 0
    assert contents(store) == contents(study.with_name("whole.sqlite"))


@with_dask
@pytest.mark.slow
def test_a_scheduler_restarted_loses_nothing(cluster, study, tmp_path):
    """What was on it is computed again on the new one, at this start or at the next."""
    store = tmp_path / "s.sqlite"
    process = study_on(cluster, study, store)
    wait_for(store, 2)
    cluster.stop()
    cluster.start()
    if process.wait(300) != 0:
        assert study_on(cluster, study, store).wait(120) == 0
    assert contents(store) == contents(study.with_name("whole.sqlite"))


def test_workers_without_the_package_end_the_study_and_leave_no_failures(tmp_path):
    class Bare(ThreadPoolExecutor):
        def submit(self, *given):
            return super().submit(importlib.import_module, "no_such_package_anywhere")

    path = tmp_path / "s.sqlite"
    with Bare(1) as bare, Store(path) as store, pytest.raises(WorkersLostError, match="install"):
        run_study(read_study(study_given()), store, executors.given(bare))
    assert contents(path)["scenes"] == []


@with_dask
def test_a_scheduler_that_is_not_there(study, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(executors, "PATIENCE", 0.5)
    store = str(tmp_path / "s.sqlite")
    assert main(["study", str(study), "-o", store, "--scheduler", "tcp://127.0.0.1:1"]) == 2
    assert "--scheduler: tcp://127.0.0.1:1 is not reached" in capsys.readouterr().err


@with_mpi
def test_a_study_on_mpi_gives_the_same(study, tmp_path):
    store = tmp_path / "s.sqlite"
    command = ["mpiexec", "-n", "2", sys.executable, "-m", "mpi4py.futures", "-m", "contimpact"]
    subprocess.run([*command, "study", str(study), "-o", str(store), "--mpi"], check=True)
    assert contents(store) == contents(study.with_name("whole.sqlite"))
