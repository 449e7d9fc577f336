"""The command line on hostile scenes, result folders and files of unfinished simulations.

Whatever it is given, it ends within ten seconds of work with a documented exit status; what it
prints steers no terminal; nothing is written outside the output folder, and no file that it did not
write is touched. A few hundred cases run with the other tests. More of them:

    CONTIMPACT_FUZZ=20000 python -m pytest -m slow tests/test_fuzz.py

Failures name the case; ``CONTIMPACT_FUZZ_FIRST`` begins at one.
"""

from __future__ import annotations

import contextlib
import copy
import hashlib
import io
import os
import shutil
import signal
import sys
import traceback
import warnings
from pathlib import Path
from random import Random

import mutations
import pytest
from mutations import CURVES, SCENE, SIMULATE, written

from contimpact import cli
from contimpact.errors import InputError
from contimpact.models.expressions import check_expression, number

pytestmark = pytest.mark.skipif(
    not hasattr(signal, "SIGPROF"), reason="the time of a case is limited by signals"
)

ORDINARY = 240
PER_TEST = 20
INTERRUPTED, TOO_LONG, WALL = 3.0, 10.0, 60.0
"""Seconds: of work after which a computation is interrupted, as from the keyboard; of work that a
case may take in all; by the clock on the wall."""


class TooLongError(BaseException):
    """A case that does not end."""


@pytest.fixture(scope="module")
def good(tmp_path_factory, kernel_cache):
    """Folders of good results, by name, from which hostile ones are made."""
    base = tmp_path_factory.mktemp("good")
    simulated = SCENE | {"simulate": SIMULATE}
    scenes = {"run": SCENE, "curves": SCENE | {"curves": CURVES}, "simulate": simulated}
    for name, scene in scenes.items():
        path = written(scene, base / f"{name}.toml")
        command = "simulate" if name == "simulate" else "run"
        assert cli.main([command, path, "-o", str(base / name), "-q"]) == 0
    return base


def case(index, good, folder):
    """Make the files of a case in a folder; returns the arguments of the command line."""
    random = Random(index)
    user, out = folder / "user", folder / "out"
    for place in (user, out):
        place.mkdir(parents=True)
        (place / "thesis.tex").write_text("years of work")
    kind = random.choices(list(KINDS), [weight for weight, _ in KINDS.values()])[0]
    return KINDS[kind][1](random, good, folder, out)


def hostile_folder(random, good, folder, names=("run", "curves")):
    """A result folder with one or two of its files changed."""
    target = folder / os.fsdecode(
        random.choice((b"in", b"in", b"in", b"\xff\x1b[31m", "é".encode()))
    )
    shutil.copytree(good / random.choice(names), target)
    files = sorted(path for path in target.rglob("*") if path.is_file())
    important = [p for p in files if p.suffix in (".json", ".jsonl") or p.parent != target]
    for path in random.sample(important, random.choice((1, 1, 2))):
        mutations.hostile_file(path, random)
    if random.randrange(8) and all(path.is_file() for path in important):
        mutations.sealed(target)
    return target


def check_case(random, good, folder, out):
    scene = copy.deepcopy(SCENE)
    scene |= random.choice(({}, {"curves": CURVES}, {"simulate": SIMULATE, "energy": {"m": 0.004}}))
    (folder / "scene.toml").write_bytes(mutations.hostile_scene(scene, random))
    if random.randrange(100) == 0:
        mutations.replaced(folder / "scene.toml", random)
    return ["check", str(folder / "scene.toml")]


def run_case(random, good, folder, out):
    scene = copy.deepcopy(SCENE) | ({"curves": CURVES} if random.randrange(6) == 0 else {})
    (folder / "scene.toml").write_bytes(mutations.hostile_scene(scene, random))
    return ["run", str(folder / "scene.toml"), "-o", str(out), *random.choice(([], ["-q"]))]


def simulate_case(random, good, folder, out):
    scene = mutations.hostile_scene(SCENE | {"simulate": SIMULATE}, random)
    (folder / "scene.toml").write_bytes(scene)
    return ["simulate", str(folder / "scene.toml"), "-o", str(out)]


def resume_case(random, good, folder, out):
    """Resume files, the scene being the one that was begun."""
    target = hostile_folder(random, good, folder, ("simulate",))
    rows = target / "rows.jsonl"
    if rows.is_file() and rows.stat().st_size and random.randrange(4):
        mutations.hostile_file(rows, random)
    shutil.copy(good / "simulate.toml", folder / "scene.toml")
    for path in target.iterdir():
        path.rename(out / path.name)
    return ["simulate", str(folder / "scene.toml"), "-o", str(out), "--resume"]


def rerun_case(random, good, folder, out):
    """A good scene run into a folder of hostile results."""
    target = hostile_folder(random, good, folder)
    shutil.copy(good / "run.toml", folder / "scene.toml")
    for path in target.iterdir():
        path.rename(out / path.name)
    return ["run", str(folder / "scene.toml"), "-o", str(out), "-q"]


def plot_case(random, good, folder, out):
    target = hostile_folder(random, good, folder)
    extra = ([], ["-x", random.choice(mutations.TEXTS[1:])], ["--xlim", "0", "1e300"], ["-x", "s"])
    kind = random.choice(("png", "png", "svg"))
    given = random.choice((extra[0], *extra)) if random.randrange(3) == 0 else []
    return ["plot", str(target), "-o", str(out / f"diagram.{kind}"), *given]


def page_case(random, good, folder, out):
    target = hostile_folder(random, good, folder, ("run", "curves", "simulate"))
    table = target / "sweep.csv"
    if table.is_file() and random.randrange(3):
        mutations.hostile_file(table, random)
    return ["plot", str(target), "-o", str(out / "diagram.html")]


def catalogue_case(random, good, folder, out):
    folders = [str(hostile_folder(random, good, folder)), str(good / "run")]
    return ["catalogue", *folders[: random.choice((1, 2))], "-o", str(out)]


KINDS = {
    "check": (30, check_case),
    "run": (10, run_case),
    "simulate": (6, simulate_case),
    "resume": (12, resume_case),
    "rerun": (4, rerun_case),
    "plot": (20, plot_case),
    "page": (14, page_case),
    "catalogue": (18, catalogue_case),
}
"""Kinds of cases: how often, and what makes one."""


@contextlib.contextmanager
def limited():
    """Interrupt what takes long, as from the keyboard, and end what does not end then."""

    def interrupt(*_):
        signal.raise_signal(signal.SIGINT)

    def end(*_):
        raise TooLongError

    limits = (
        (signal.ITIMER_VIRTUAL, signal.SIGVTALRM, INTERRUPTED, interrupt),
        (signal.ITIMER_PROF, signal.SIGPROF, TOO_LONG, end),
        (signal.ITIMER_REAL, signal.SIGALRM, WALL, end),
    )
    before = [signal.signal(sign, handler) for _, sign, _, handler in limits]
    try:
        for timer, _, seconds, _ in limits:
            signal.setitimer(timer, seconds)
        yield
    finally:
        for (timer, sign, *_), handler in zip(limits, before, strict=True):
            signal.setitimer(timer, 0)
            signal.signal(sign, handler)


def state(folder, besides):
    """What stands in a folder, one part of it left out: names, and digests of files."""
    found = {}
    for here, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if Path(here) / name != besides]
        for name in files:
            path = Path(here) / name
            plain = path.is_file() and not path.is_symlink()
            found[str(path)] = hashlib.md5(path.read_bytes()).digest() if plain else None
    return found


def outcome(arguments, folder, out):
    """Run the command line; returns what is wrong with how it went, or None."""
    before, written, errors = state(folder, out), Written(), Written()
    try:
        with (
            limited(),
            contextlib.chdir(folder),
            warnings.catch_warnings(),
            contextlib.redirect_stdout(written),
            contextlib.redirect_stderr(errors),
        ):
            warnings.simplefilter("ignore")
            try:
                status = cli.main(arguments)
            except SystemExit as error:
                status = error.code
    except BaseException as error:
        return "".join(traceback.format_exception(error)[-6:])
    said = written.text + errors.text
    if status not in (0, 1, 2):
        return f"exit status {status}"
    if status == 2 and not errors.text:
        return "refused without a word"
    if odd := [c for c in said if not c.isprintable() and c != "\n"]:
        return f"prints {odd[:5]}"
    if state(folder, out) != before:
        return "files outside the output folder differ"
    if (out / "thesis.tex").read_text() != "years of work":
        return "a file of the user's differs"
    return None


class Written(io.TextIOWrapper):
    """What is printed, on a terminal that knows ASCII alone."""

    def __init__(self):
        super().__init__(io.BytesIO(), "ascii")

    @property
    def text(self):
        self.flush()
        return self.buffer.getvalue().decode("ascii")


def failures(numbers, good, folder):
    """Run cases; returns what went wrong."""
    found = []
    for index in numbers:
        place = folder / str(index)
        place.mkdir()
        arguments = case(index, good, place)
        if wrong := outcome(arguments, place, place / "out"):
            found.append(f"case {index}, {arguments[0]}: {wrong}")
            print(found[-1], file=sys.stderr, flush=True)
        else:
            shutil.rmtree(place)
    return found


@pytest.mark.parametrize("first", range(0, ORDINARY, PER_TEST))
@pytest.mark.full
def test_hostile_input(first, good, tmp_path):
    assert failures(range(first, first + PER_TEST), good, tmp_path) == []


@pytest.mark.slow
def test_much_hostile_input(good, tmp_path):
    first = int(os.environ.get("CONTIMPACT_FUZZ_FIRST", ORDINARY))
    count = int(os.environ.get("CONTIMPACT_FUZZ", 2000))
    assert failures(range(first, first + count), good, tmp_path) == []


def random_expression(random, depth=0):
    """An expression, or something near to one."""
    if depth > 4 or random.randrange(4) == 0:
        return random.choice((*mutations.EXPRESSIONS, "1", "2.5", "pi", "t", "0"))
    one, other = (random_expression(random, depth + 1) for _ in range(2))
    forms = ("({}+{})", "{}-{}", "({})*({})", "({})/({})", "({})**({})", "sin({})+{}", "{}{}")
    return random.choice(forms).format(one, other)


@pytest.mark.parametrize("first", range(0, 1000, 250))
def test_hostile_expressions(first):
    """Numbers, and what is checked of expressions before they are derived."""
    for index in range(first, first + 250):
        text = random_expression(Random(index))
        for read in (lambda t: number(t, "x"), lambda t: check_expression(t, "x", ("t",))):
            with limited(), contextlib.suppress(InputError), warnings.catch_warnings():
                warnings.simplefilter("ignore")
                read(text)
