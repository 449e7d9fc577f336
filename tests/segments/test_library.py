"""Compiled and plain runs are the same; the cache, and who decides."""

from __future__ import annotations

import contextlib
import importlib.util
import logging
import math
import os
import re
import shutil
import subprocess
import sys
from collections import defaultdict

import numpy as np
import pytest

from contimpact import ImpactPair, continue_orbit
from contimpact import storage as files
from contimpact.arrays import VECTOR
from contimpact.bifurcations.kind import test_functions as functions_of
from contimpact.continuation.branch import EndKind
from contimpact.continuation.settings import Settings
from contimpact.diagrams.orbit_program import program_of
from contimpact.diagrams.orbit_walks import backend_of, walk_orbits
from contimpact.errors import InputError
from contimpact.models.guards import parse_word
from contimpact.orbits.problem import OrbitProblem
from contimpact.orbits.search import find_orbits
from contimpact.segments import compiling as module
from contimpact.segments import machine_code
from contimpact.segments.kernels import Kernels
from contimpact.segments.machine_code import Program
from contimpact.systems.soft_stop import SoftStop

EVENTS = ("FB", "BP", "PD", "NS", "G", "V", "T")
needs_llvmlite = pytest.mark.skipif(
    importlib.util.find_spec("llvmlite") is None, reason="the extra 'fast' is not installed"
)


@pytest.fixture
def cache(kernel_cache):
    """The tests' own cache, in which each program is compiled once."""
    return kernel_cache


def same(plain, fast):
    """Points and events of two walks are the same, to the last bit."""
    assert fast.end == plain.end
    assert len(fast.points) == len(plain.points)
    for one, other in zip(plain.points, fast.points, strict=True):
        assert np.array_equal(one.unknowns, other.unknowns)
        assert np.array_equal(one.tangent, other.tangent)
        assert (one.arclength, one.iterations) == (other.arclength, other.iterations)
        assert np.array_equal(one.orientation, other.orientation, equal_nan=True)
        assert np.array_equal(
            one.evaluation.multipliers, other.evaluation.multipliers, equal_nan=True
        )
        assert one.evaluation.verdict.reason == other.evaluation.verdict.reason
        pair = (one.evaluation.verdict.smallest_gap, other.evaluation.verdict.smallest_gap)
        assert np.array_equal(pair[0], pair[1], equal_nan=True)
    kinds = [(event.kind, event.parameter) for event in plain.events]
    assert [(event.kind, event.parameter) for event in fast.events] == kinds
    assert fast.missed == plain.missed
    assert fast.corrector_iterations == plain.corrector_iterations
    assert fast.rejected_steps == plain.rejected_steps


def walks(model, word, parameter, limits, settings=None, events=EVENTS):
    """Walks both ways from every orbit of a word."""

    def go(orbit, direction):
        return walk_orbits(
            orbit.problem,
            orbit.unknowns,
            direction,
            limits=limits,
            tests=functions_of(orbit.problem, events, {}),
            settings=settings or Settings(),
        )

    orbits = find_orbits(model, word, parameter=parameter)
    return [go(orbit, direction) for orbit in orbits for direction in (1, -1)]


@needs_llvmlite
@pytest.mark.parametrize("predictor", ["tangent", "secant"])
@pytest.mark.parametrize("word", ["BT", "BBT", "BTBT", "BBTT", "B", "BBBTBBT"])
@pytest.mark.quick(1)
def test_compiled_walks_are_the_same_to_the_last_bit(plain_and_compiled, word, predictor):
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
    settings = Settings(predictor=predictor)
    plain, fast = plain_and_compiled(lambda: walks(model, word, "s", (0.08, 1.05), settings))
    assert len(plain) == len(fast)
    for one, other in zip(plain, fast, strict=True):
        same(one, other)


@needs_llvmlite
@pytest.mark.parametrize("seed", range(12))
@pytest.mark.full
def test_compiled_walks_are_the_same_for_random_parameters(plain_and_compiled, seed):
    rng = np.random.default_rng(seed)
    beta, r, s = rng.uniform(-1.5, 1.5), rng.choice([0.0, 1.0, rng.uniform()]), rng.uniform(0.1, 1)
    model = ImpactPair(beta=float(beta), r=float(r), A=5.0, s=float(s))
    word = ["BT", "BBT", "TTB", "BTBT"][seed % 4]
    plain, fast = plain_and_compiled(lambda: walks(model, word, "s", (0.05, 1.5)))
    for one, other in zip(plain, fast, strict=True):
        same(one, other)


@needs_llvmlite
@pytest.mark.full
def test_compiled_walks_where_the_zeros_of_the_acceleration_move(plain_and_compiled):
    """Along A the zeros of a single harmonic change, and vanish where gravity outweighs it."""
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
    plain, fast = plain_and_compiled(lambda: walks(model, "BT", "A", (0.4, 30.0)))
    assert plain[0].events
    for one, other in zip(plain, fast, strict=True):
        same(one, other)


@needs_llvmlite
@pytest.mark.slow
@pytest.mark.parametrize(
    "forcing", ["cos(pi*t)**3", "cos(pi*t+0.3)+sin(4*pi*t)/5-1/8", "exp(cos(pi*t))/3"]
)
def test_compiled_walks_with_other_forcings(plain_and_compiled, forcing):
    model = ImpactPair(beta=0.4, r=0.4, A=5.0, s=0.4, forcing=forcing)
    for word in ("BT", "BBT"):
        plain, fast = plain_and_compiled(lambda word=word: walks(model, word, "s", (0.1, 1.0)))
        for one, other in zip(plain, fast, strict=True):
            same(one, other)


@needs_llvmlite
@pytest.mark.full
def test_a_branch_and_its_events_are_the_same(plain_and_compiled):
    """The paper's 1:1 branch: a thousand points at a fixed step, with what is tabulated."""
    orbit = find_orbits(ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.7), "1:1")[0]
    settings = Settings(step=0.001, max_step=0.001, max_points=2000)

    def branch():
        return continue_orbit(orbit, "s", (0.08, 0.72), settings=settings)

    plain, fast = plain_and_compiled(branch)
    assert len(plain) > 1000
    assert list(plain.columns) == list(fast.columns)
    for name, column in plain.columns.items():
        equal_nan = column.dtype.kind == "f"
        assert np.array_equal(column, fast.columns[name], equal_nan=equal_nan), name
    assert fast.events == plain.events
    d = [entry.parameters["d"] for entry in fast.events if entry.kind in ("PD", "G")]
    assert d == pytest.approx([0.204454926485485, 0.238506821494], abs=1e-12)


@needs_llvmlite
@pytest.mark.parametrize("stop_at", [1, 2, 3, 5, 40, 200])
def test_a_callback_sees_every_point_of_a_compiled_walk_and_may_stop(plain_and_compiled, stop_at):
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.7)
    orbit = find_orbits(model, "1:1", parameter="s")[0]
    settings = Settings(step=0.001, max_step=0.001)

    def run():
        seen = []

        def watch(point):
            seen.append(point.parameter)
            return len(seen) == stop_at

        walk = walk_orbits(
            orbit.problem,
            orbit.unknowns,
            -1,
            limits=(0.08, 0.72),
            settings=settings,
            tests=functions_of(orbit.problem, EVENTS, {}),
            callback=watch,
        )
        assert walk.end.kind is EndKind.STOPPED
        assert [point.parameter for point in walk.points[1:]] == seen
        return seen

    plain, fast = plain_and_compiled(run)
    assert fast == plain
    assert len(fast) == stop_at


@needs_llvmlite
@pytest.mark.full
def test_compiled_walks_of_flights_that_depend_on_the_state(plain_and_compiled, oscillator):
    """The oscillator against a rigid stop, below and above critical damping."""
    for given, word in (({}, "SS/3T"), ({"c": 3.0, "sigma": -0.1}, "S")):
        model = oscillator(**{"omega": 1.0, "c": 0.1, "sigma": 0.4} | given)

        def go(model=model, word=word):
            return walks(model, word, "a", (0.05, 1.5))

        plain, fast = plain_and_compiled(go)
        assert any(walk.events for walk in plain)
        for one, other in zip(plain, fast, strict=True):
            same(one, other)


@needs_llvmlite
@pytest.mark.slow
@pytest.mark.parametrize("word", ["CR", "CRCR/2T"])
def test_compiled_walks_through_two_modes(plain_and_compiled, word):
    model = SoftStop(a=1.0, omega=1.3, c=0.1, k=1.0, e=0.5, k_b=20.0, c_b=0.3)
    plain, fast = plain_and_compiled(lambda: walks(model, word, "k_b", (1.0, 1e6)))
    assert plain
    for one, other in zip(plain, fast, strict=True):
        same(one, other)


@needs_llvmlite
@pytest.mark.slow
def test_flights_too_stiff_for_compiled_code_go_on_plainly(plain_and_compiled, oscillator, caplog):
    """With c = 800 a flight would take more steps than there is room for."""
    model = oscillator(c=800.0, omega=1.0, sigma=0.0)
    caplog.set_level(logging.INFO)
    plain, fast = plain_and_compiled(lambda: walks(model, "S", "a", (0.95, 1.05)))
    assert fast
    for one, other in zip(plain, fast, strict=True):
        same(one, other)
    assert "too stiff for compiled code" in caplog.text


@pytest.mark.full
def test_what_cannot_be_compiled_runs_plainly_and_says_so(monkeypatch):
    """Along A the zeros of the sum of two harmonics move."""
    monkeypatch.setattr(module, "_PLAINLY", {})
    monkeypatch.setenv("CONTIMPACT_COMPILED", "always")
    model = ImpactPair(beta=0.4, r=0.4, A=5.0, s=0.4, forcing="cos(pi*t) + sin(3*pi*t)/5")
    orbit = find_orbits(model, "BT", parameter="A")[0]
    low, high = 0.97 * orbit.unknowns[-1], 1.03 * orbit.unknowns[-1]
    assert len(continue_orbit(orbit, range=(low, high))) > 3
    assert module.ran_plainly() == ["a forcing whose harmonics change along a branch"]


# Who decides


def problem_of():
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
    return OrbitProblem(model, parse_word("BT", "BT"), Kernels(model, "s"))


def test_an_unknown_mode_is_refused(monkeypatch):
    monkeypatch.setenv("CONTIMPACT_COMPILED", "sometimes")
    with pytest.raises(InputError, match=r"CONTIMPACT_COMPILED.*'sometimes'.*auto, always, never"):
        module.mode()


@pytest.mark.full
def test_always_without_llvmlite_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setenv("CONTIMPACT_COMPILED", "always")
    monkeypatch.setenv("CONTIMPACT_CACHE", str(tmp_path))
    monkeypatch.setattr(module, "_LOADED", {})
    monkeypatch.setattr(module, "_MISSING", set())
    monkeypatch.setattr(module, "available", lambda: False)
    with pytest.raises(InputError, match=r"install contimpact\[fast\]"):
        backend_of(problem_of(), ()).compiled()


def test_compiling_waits_until_it_pays(monkeypatch):
    monkeypatch.setenv("CONTIMPACT_COMPILED", "auto")
    monkeypatch.setattr(module, "_SPENT", defaultdict(float))
    monkeypatch.setattr(module, "_EXPECTED", [0.0])
    monkeypatch.setattr(module, "available", lambda: True)
    assert not module.compiling_pays(("one",))
    module._SPENT["one",] += module.PAYS_AFTER
    assert module.compiling_pays(("one",))
    assert not module.compiling_pays(("another",))
    module.expect_plain_time(module.PAYS_AFTER)
    assert module.compiling_pays(("another",))
    monkeypatch.setattr(module, "available", lambda: False)
    assert not module.compiling_pays(("one",))


def test_the_time_of_plain_steps_is_counted_for_their_program(monkeypatch):
    monkeypatch.setenv("CONTIMPACT_COMPILED", "never")
    monkeypatch.setattr(module, "_SPENT", defaultdict(float))
    backend = backend_of(problem_of(), ())
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
    walks(model, "BT", "s", (0.08, 1.05), events=())
    assert module._SPENT[backend.program] > 0.0


# The cache

RUN = """
import math, sys
from contimpact import ImpactPair, continue_orbit, find_orbits
from contimpact.continuation.settings import Settings
orbit = find_orbits(ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.7), "1:1")[0]
branch = continue_orbit(orbit, "s", (0.3, 0.72), settings=Settings(step=0.001, max_step=0.001))
print(len(branch), *sorted({"llvmlite", "sympy"} & set(sys.modules)))
"""


def run_with(cache, mode):
    environment = os.environ | {"CONTIMPACT_CACHE": str(cache), "CONTIMPACT_COMPILED": mode}
    done = subprocess.run(
        [sys.executable, "-c", RUN], env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout.split()


@needs_llvmlite
@pytest.mark.full
def test_a_later_process_loads_compiled_code_without_llvmlite(plain_and_compiled, cache):
    problem = problem_of()
    plain_and_compiled(lambda: backend_of(problem, ()).compiled())
    run_with(cache, "always")  # kernels and programs are there now
    assert run_with(cache, "always")[1:] == []
    assert run_with(cache, "auto")[1:] == []


@needs_llvmlite
def test_without_a_linker_machine_code_is_loaded_through_llvm(plain_and_compiled, monkeypatch):
    problem = problem_of()
    plain_and_compiled(lambda: backend_of(problem, ()).compiled())
    intact = module.is_intact
    monkeypatch.setattr(module, "_LOADED", {})
    monkeypatch.setattr(module, "is_intact", lambda path: path.suffix != ".so" and intact(path))
    monkeypatch.setattr(module, "_link", lambda parts, library: None)
    run_again(plain_and_compiled)


@pytest.fixture
def copied(plain_and_compiled, cache, tmp_path, monkeypatch):
    """A copy of the cache for one test, with compiled code that no other test has loaded."""
    problem = problem_of()
    plain_and_compiled(lambda: backend_of(problem, ()).compiled())
    folder = tmp_path / "cache"

    def copy(source, target):
        with contextlib.suppress(FileNotFoundError):  # others write to it, and remove what is old
            shutil.copy2(source, target)

    shutil.copytree(cache, folder, ignore=shutil.ignore_patterns("*.tmp"), copy_function=copy)
    monkeypatch.setenv("CONTIMPACT_CACHE", str(folder))
    monkeypatch.setattr(module, "_LOADED", {})
    monkeypatch.setattr(module, "_MISSING", set())
    return folder


def run_again(plain_and_compiled):
    """Compiled code is there, and does what it should."""
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
    plain, fast = plain_and_compiled(lambda: walks(model, "BT", "s", (0.3, 0.4)))
    for one, other in zip(plain, fast, strict=True):
        same(one, other)
    assert backend_of(problem_of(), ()).compiled() is not None


def libraries(folder):
    return sorted(folder.glob("compiled-*.so"))


@needs_llvmlite
@pytest.mark.skipif(shutil.which("cc") is None, reason="no linker")
@pytest.mark.parametrize("damage", ["lost", "cut", "digest"])
@pytest.mark.full
def test_a_lost_or_damaged_library_is_linked_again(copied, plain_and_compiled, damage):
    for library in libraries(copied):
        if damage == "lost":
            library.unlink()
        elif damage == "cut":
            library.write_bytes(library.read_bytes()[:1000])
        else:
            files.digest_beside(library).write_bytes(b"\xff\xfe")
    run_again(plain_and_compiled)
    assert any(module.is_intact(library) for library in libraries(copied))


@needs_llvmlite
def test_what_models_share_is_compiled_once(copied, monkeypatch):
    """The functions of each file of the package are one module, those of a model another."""
    made = []
    compiled = machine_code.object_code
    monkeypatch.setattr(machine_code, "object_code", lambda m: made.append(m) or compiled(m))
    monkeypatch.setenv("CONTIMPACT_COMPILED", "always")
    model = ImpactPair(beta=0.3, r=0.3, A=5.0, s=0.34, forcing="cos(pi*t) + cos(3*pi*t)/9")
    problem = OrbitProblem(model, parse_word("BT", "BT"), Kernels(model, "s"))
    assert backend_of(problem, ()).compiled() is not None
    (text,) = made
    assert re.search(r"^define .* @f_flight_B_T_0\(", text, re.MULTILINE)
    assert re.search(r"^declare .* @f_take_steps_0\(", text, re.MULTILINE)


@needs_llvmlite
@pytest.mark.skipif(sys.platform == "win32", reason="a script as linker")
@pytest.mark.parametrize("script", ["no script", "#!/bin/sh\nexit 0\n", "#!/bin/sh\nexit 1\n"])
def test_a_broken_linker_does_no_harm(copied, plain_and_compiled, tmp_path, monkeypatch, script):
    linker = tmp_path / "bin" / "cc"
    linker.parent.mkdir()
    linker.write_text(script)
    linker.chmod(0o755)
    monkeypatch.setenv("PATH", str(linker.parent))
    for library in libraries(copied):
        library.unlink()
    run_again(plain_and_compiled)
    assert libraries(copied) == []


@needs_llvmlite
@pytest.mark.full
def test_a_cache_that_cannot_be_written(copied, plain_and_compiled, monkeypatch, caplog):
    """The code is kept for the process, in a place of its own."""
    before = sorted(copied.iterdir())
    intact = files.store_file

    def refuse(path, content):
        if path.parent == copied:
            raise PermissionError("read-only")
        intact(path, content)

    monkeypatch.setattr(files, "store_file", refuse)
    monkeypatch.setenv("CONTIMPACT_COMPILED", "always")
    with caplog.at_level(logging.WARNING):
        assert load_small() is not None
    assert "cannot be written (read-only)" in caplog.text
    assert sorted(copied.iterdir()) == before


@pytest.mark.full
def test_what_cannot_be_compiled_runs_plainly_on(empty_cache, monkeypatch, caplog):
    def fail(*given):
        raise RuntimeError("this LLVM does not know how")

    monkeypatch.setattr("contimpact.segments.machine_code.object_code", fail)
    monkeypatch.setenv("CONTIMPACT_COMPILED", "auto")
    module.expect_plain_time(module.PAYS_AFTER)
    with caplog.at_level(logging.WARNING):
        assert backend_of(problem_of(), ()).compiled() is None
    assert "RuntimeError: this LLVM does not know how" in caplog.text
    assert not module.compiling_pays(("any",))  # not tried again
    monkeypatch.setenv("CONTIMPACT_COMPILED", "always")
    with pytest.raises(RuntimeError, match="does not know how"):
        backend_of(problem_of(), ()).compiled()


@pytest.fixture
def empty_cache(tmp_path, monkeypatch):
    """An empty cache for one test, as if llvmlite were installed."""
    monkeypatch.setenv("CONTIMPACT_CACHE", str(tmp_path / "empty"))
    monkeypatch.setattr(module, "available", lambda: True)
    begin_process(monkeypatch)


def begin_process(monkeypatch):
    """As in a process that has not spent any time yet."""
    monkeypatch.setattr(module, "_LOADED", {})
    monkeypatch.setattr(module, "_MISSING", set())
    monkeypatch.setattr(module, "_SPENT", defaultdict(float))
    monkeypatch.setattr(module, "_KEPT", {})
    monkeypatch.setattr(module, "_EXPECTED", [0.0])


IDENTITY = ("adds one",)


def load_small():
    program = Program({})
    program.glue("def entry(x):\n    x[0] += 1.0\n    return 1")
    return module.load(IDENTITY, VECTOR, lambda: program)


def run_plainly(monkeypatch, seconds):
    """One process after another, each of which spends so much on a program; returns whether they
    had compiled code."""
    compiled = []
    for each in seconds:
        begin_process(monkeypatch)
        compiled.append(load_small() is not None)
        module._SPENT[IDENTITY] += each
        module.keep_plain_time()
    return compiled


@needs_llvmlite
def test_what_is_run_again_and_again_is_compiled(empty_cache, monkeypatch):
    monkeypatch.setenv("CONTIMPACT_COMPILED", "auto")
    part = 0.6 * module.PAYS_AFTER
    assert run_plainly(monkeypatch, [part, part, part]) == [False, False, True]
    (kept,) = module.cache_folder().glob("plain-*")
    kept.unlink()  # machine code is found first
    assert run_plainly(monkeypatch, [0.0]) == [True]


@needs_llvmlite
def test_a_program_is_compiled_sooner_where_others_of_its_kind_are(empty_cache, monkeypatch):
    monkeypatch.setenv("CONTIMPACT_COMPILED", "auto")
    module._are_known.cache_clear()
    assert run_plainly(monkeypatch, [module.PAYS_SOON, 0.0]) == [False, False]
    monkeypatch.setenv("CONTIMPACT_COMPILED", "always")
    begin_process(monkeypatch)
    program = Program({})
    program.glue("def entry(x):\n    return 2")
    module.load(("another",), VECTOR, lambda: program)
    monkeypatch.setenv("CONTIMPACT_COMPILED", "auto")
    assert run_plainly(monkeypatch, [0.0]) == [True]


@needs_llvmlite
@pytest.mark.parametrize("lost", ["*.parts", "part-*.o"])
def test_lost_parts_are_made_again(empty_cache, monkeypatch, lost):
    monkeypatch.setenv("CONTIMPACT_COMPILED", "always")
    for _ in range(2):
        begin_process(monkeypatch)
        assert load_small() is not None
        folder = module.cache_folder()
        (made,) = folder.glob(lost)
        assert module.is_intact(made)
        for path in (made, *libraries(folder)):
            path.unlink()


def test_little_time_is_not_kept(empty_cache, monkeypatch):
    monkeypatch.setenv("CONTIMPACT_COMPILED", "auto")
    assert run_plainly(monkeypatch, [0.9 * module.WORTH_KEEPING] * 40) == [False] * 40


@pytest.mark.parametrize("content", ["", "soon", "nan", "inf", "-1e9"])
def test_a_kept_time_that_is_none_is_nothing(empty_cache, monkeypatch, content):
    monkeypatch.setenv("CONTIMPACT_COMPILED", "auto")
    run_plainly(monkeypatch, [0.1])
    (kept,) = module.cache_folder().glob("plain-*")
    kept.write_text(content)
    assert run_plainly(monkeypatch, [0.1]) == [False]
    assert float(kept.read_text()) == pytest.approx(0.1)


def test_a_cache_that_is_gone_keeps_no_time(empty_cache, monkeypatch):
    monkeypatch.setenv("CONTIMPACT_COMPILED", "auto")
    begin_process(monkeypatch)
    assert load_small() is None
    module._SPENT[IDENTITY] += 1.0
    folder = module.cache_folder()
    shutil.rmtree(folder)
    module.keep_plain_time()
    assert not folder.exists()


def test_what_could_not_be_compiled_is_not_tried_in_every_process(empty_cache, monkeypatch):
    monkeypatch.setenv("CONTIMPACT_COMPILED", "auto")
    tried = []

    def fail(*given):
        tried.append(given)
        raise RuntimeError

    monkeypatch.setattr("contimpact.segments.machine_code.object_code", fail)
    assert run_plainly(monkeypatch, [module.PAYS_AFTER] * 3) == [False] * 3
    assert len(tried) == 1


def test_damaged_code_is_not_loaded(tmp_path, caplog):
    damaged = tmp_path / "damaged.so"
    damaged.write_bytes(b"no machine code")
    files.digest_beside(damaged).write_text("0" * 64)
    with caplog.at_level(logging.WARNING):
        assert not module.is_intact(damaged)
    assert "damaged and not used" in caplog.text


def test_a_program_holds_all_it_calls():
    """Its text runs on its own, with nothing of the package around it."""
    problem = problem_of()
    text = program_of(problem.kernels, "fixed").text
    namespace = {}
    exec(text, namespace)
    assert callable(namespace["entry"])
    z = [0.1, 0.6, 1.5, -0.4]
    values = list(problem.model.values.values())
    expected = problem.kernels.flight("B", "T")(*z, *values)
    assert namespace["any_flight"](1, *z, values) == expected


@needs_llvmlite
@pytest.mark.parametrize("said", ["auto", "always"])
def test_what_is_not_in_the_subset_ends_compiling_alone(said, monkeypatch, tmp_path, caplog):
    monkeypatch.setenv("CONTIMPACT_COMPILED", said)
    monkeypatch.setattr(module, "_EXPECTED", [1e9])
    program = Program({})
    program.glue("def entry(x):\n    if x[0] == 0.0:\n        raise ValueError\n    return 1")
    if said == "always":
        with pytest.raises(NotImplementedError, match="raise ValueError in entry"):
            module.load((str(tmp_path),), VECTOR, lambda: program)
        return
    assert module.load((str(tmp_path),), VECTOR, lambda: program) is None
    assert any("nothing is compiled" in record.getMessage() for record in caplog.records)
