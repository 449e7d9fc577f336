"""``check`` on hybrid and linear scenes, and on studies, that are changed at random.

Each ends within ten seconds of work, with a line or with a mistake that is placed at a key of the
scene. Some run with the other tests. More of them:

    CONTIMPACT_FUZZ=10000 python -m pytest -m slow tests/cli/test_fuzz_stated.py

Failures name the case; ``CONTIMPACT_FUZZ_FIRST`` begins at one.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import io
import os
import re
import signal
import time
import tomllib
import traceback
import warnings
from random import Random

import mutations
import pytest

from contimpact.cli import scenes
from contimpact.errors import InputError, printable
from contimpact.studies.study_file import load_study

pytestmark = pytest.mark.skipif(
    not hasattr(signal, "SIGPROF"), reason="the time of a case is limited by signals"
)

ORDINARY, PER_TEST = 120, 15
TOO_LONG = 10.0
"""Seconds of work that a case may take."""

NUMERICS = {"starts": 8, "rounds": 1}
FOLLOW = {"parameter": "w", "range": [1.0, 1.6], "orbits": ["S"]}
DETECT = {"events": ["FB", "PD", "G", "V"]}
HYBRID = {
    "name": "fuzzed",
    "model": {
        "system": "hybrid",
        "period": "2*pi/w",
        "parameters": {"a": 0.5, "w": 1.3, "c": 0.15, "d": 0.5, "r": 0.8},
        "define": {"pull": "x1 - x2", "drive": "a*cos(w*t)"},
        "mass": {"x1": 1, "x2": 1},
        "modes": {
            "free": {"x1": "v1", "v1": "drive - x1 - c*v1 - pull", "x2": "v2", "v2": "pull - c*v2"}
        },
        "guards": {"S": {"within": "x1 <= d", "set": {"v1": "-r*v1"}}},
    },
    "follow": FOLLOW,
    "detect": DETECT,
    "numerics": NUMERICS,
}
FRICTION = copy.deepcopy(HYBRID)
FRICTION["model"] |= {
    "parameters": {"a": 0.5, "w": 1.3, "V": 0.4, "m": 0.4},
    "define": {"drive": "a*cos(w*t)"},
    "mass": {"x": 1},
    "modes": {"slip": {"x": "v", "v": "drive - x + m"}, "stick": {"x": "V", "f": "V - a"}},
    "guards": {
        "S": {"mode": "slip", "within": "v <= V", "to": "stick", "set": {"f": "x"}},
        "P": {"mode": "stick", "within": "f <= m", "to": "slip", "set": {"v": "V"}},
    },
}
FRICTION["follow"] = FOLLOW | {"orbits": ["SP"]}
CUBIC = copy.deepcopy(HYBRID)
CUBIC["model"] |= {
    "define": {"drive": "a*cos(w*t)"},
    "mass": {"x": 1},
    "modes": {"free": {"x": "v", "v": "drive - x - c*v - sqrt(2)*x**3"}},
    "guards": {"S": {"within": "x <= d", "set": {"v": "-r*v"}}},
}
LINEAR = {
    "name": "fuzzed",
    "model": {
        "system": "linear",
        "coordinates": ["x", "y"],
        "mass": [[1, 0], [0, "m"]],
        "damping": [["c", 0], [0, "c"]],
        "stiffness": [[2, -1], [-1, 1.1]],
        "force": ["a*cos(w*t)", 0],
        "period": "2*pi/w",
        "parameters": {"a": 0.5, "w": 1.3, "c": 0.15, "d": 0.5, "r": 0.8, "m": 0.7},
        "guards": {"S": {"within": "x - y <= d", "restitution": "r"}},
    },
    "follow": FOLLOW,
    "detect": DETECT,
    "numerics": NUMERICS,
}
STUDY = copy.deepcopy(LINEAR)
STUDY["study"] = {
    "keep": ["readings"],
    "budget": 5,
    "grid": {"r": {"from": 0.3, "to": 0.9, "count": 3}, "d": [0.4, 0.5]},
}
SCENES = (HYBRID, FRICTION, CUBIC, LINEAR, STUDY)
PARTS = (
    "x", "v", "x1", "v2", "t", "w", "a", "pi", "0", "1e-9", "1e300", "0.66666667", "1/0", "q",
    "free", "sqrt(x)", "exp(9*v)", "x**64", "cos(w*t)**3", "t**2", "log(t)", "tan(x)", "x*v",
    "(x - v)**0.3", "sinh(cosh(v))", "cos(3*w*t + d)", "sin(w*t/2)", "1e-300*x", "acos(x)",
    "x**-1", "(", ")", "<=", ">=", ",", "**", "*", "-", "0.1 + 0.2", "abs(x)", "1 if x else 2",
    "2**-64", "\u02bc", "lambda",
)  # fmt: skip
"""What expressions are changed by."""
NAME = re.compile(r"[A-Za-z_]\w*|\d+(\.\d+)?")


def rewritten(text, random):
    """An expression with one of its parts replaced, left out or doubled."""
    parts = list(NAME.finditer(text))
    if not parts or random.randrange(5) == 0:
        return random.choice((random.choice(PARTS), f"{text}{random.choice(PARTS)}", ""))
    part = random.choice(parts)
    new = random.choice((random.choice(PARTS), f"({part[0]})*{random.choice(PARTS)}", ""))
    return text[: part.start()] + new + text[part.end() :]


def changed(scene, random):
    """A scene with some of what it states changed."""
    scene = copy.deepcopy(scene)
    for _ in range(random.choice((1, 1, 2, 3))):
        paths = [path for path in mutations.places(scene["model"]) if path[0] != "system"]
        path = random.choice(paths)
        within, key = mutations.holder(scene["model"], path), path[-1]
        match random.randrange(8):
            case 0:
                del within[key]
            case 1 if isinstance(within, dict):
                within[random.choice((*PARTS[:9], *within))] = copy.deepcopy(within[key])
            case 2:
                within[key] = mutations.value(random)
            case 3:
                other = random.choice(paths)
                with contextlib.suppress(LookupError, TypeError):
                    source = mutations.holder(scene["model"], other)[other[-1]]
                    within[key] = copy.deepcopy(source)
            case _ if isinstance(within[key], str):
                within[key] = rewritten(within[key], random)
            case _ if isinstance(within[key], int | float):
                within[key] = random.choice((random.choice(mutations.NUMBERS), within[key] * 1.1))
    return scene


def content(index):
    """The bytes of the scene of a case, and whether it is a study."""
    random = Random(index)
    base = random.choice(SCENES)
    if random.randrange(4) == 0:
        return mutations.hostile_scene(base, random), "study" in base
    text = mutations.toml(changed(base, random))
    return text.encode(errors="surrogatepass"), "study" in base


def keys_of(data):
    """What places at keys at the top of a scene begin with."""
    try:
        given = tomllib.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError):
        return set()
    return {root_of(printable(key)) for key in given}


def root_of(where):
    """What a place begins with."""
    return re.split(r"[.\[ :]", where)[0]


@contextlib.contextmanager
def limited():
    """End what takes too long."""

    def end(*_):
        raise TimeoutError(f"more than {TOO_LONG:g} s of work")

    before = signal.signal(signal.SIGPROF, end)
    signal.setitimer(signal.ITIMER_PROF, TOO_LONG)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


TABLES = set("scene name source model follow detect numerics plot curves simulate energy".split())
TABLES |= {"certify", "study"}


def wrong(index, folder):
    """Check the scene of a case; returns what is wrong with how that went, or None."""
    data, study = content(index)
    path = folder / "scene.toml"
    path.write_bytes(data)
    began = time.process_time()
    try:
        with (
            limited(),
            warnings.catch_warnings(),
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(io.StringIO()),
        ):
            warnings.simplefilter("ignore")
            if study:
                load_study(path)
            scenes.check(argparse.Namespace(scene=str(path), system=[]))
    except InputError as error:
        if error.where != str(path) and root_of(error.where) not in TABLES | keys_of(data):
            return f"placed at {error.where!r}: {error}"
    except BaseException as error:
        return "".join(traceback.format_exception(error)[-8:])
    spent = time.process_time() - began
    return f"{spent:.1f} s of work" if spent > TOO_LONG else None


def failures(numbers, folder):
    """Check the scenes of some cases; returns what went wrong."""
    found = [(index, wrong(index, folder)) for index in numbers]
    return [f"case {index}: {what}" for index, what in found if what]


@pytest.mark.parametrize("first", range(0, ORDINARY, PER_TEST))
@pytest.mark.quick(1)
def test_mistakes_in_stated_systems_are_placed(first, tmp_path):
    assert failures(range(first, first + PER_TEST), tmp_path) == []


SLOW = (2009, 1000597, 1001428, 1001879, 1001980, 1002319, 1003701, 1007518, 1009582)
"""Cases that failed: a stop so far away that each flight takes thousands of steps; impacts without
end at one instant; forces of 1e99; a damping of 2e9; a key of two lines; velocities of 1e300,
after an impact, too; a force that has the logarithm of the time; a whole number of five thousand
digits."""


@pytest.mark.full
def test_slow_cases_end_in_time(tmp_path):
    assert failures(SLOW, tmp_path) == []


@pytest.mark.slow
def test_many_mistakes_in_stated_systems_are_placed(tmp_path):
    first = int(os.environ.get("CONTIMPACT_FUZZ_FIRST", ORDINARY))
    count = int(os.environ.get("CONTIMPACT_FUZZ", 500))
    assert failures(range(first, first + count), tmp_path) == []
