"""What the tests of studies share: small studies, what a store holds, and workers that fail."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sqlite3
from concurrent.futures import ThreadPoolExecutor

from contimpact.studies import executors
from contimpact.studies.run import compute, run_study
from contimpact.studies.store import OF_SCENES, Store
from contimpact.studies.study_file import read_study

TOML = """
name = "{name}"

[model]
system = "impact-pair"
parameters = {{ A = 5.0, s = 0.389 }}

[follow]
parameter = "s"
range = [0.3, 0.41]
orbits = ["1:1"]

[detect]
events = ["FB", "PD", "G"]

[numerics]
starts = 16
rounds = 2

[study]
keep = ["catalogue", "readings"]
budget = 600

[study.grid]
beta = {{ from = "pi/9", to = "pi/6", count = {count} }}
r = [0.3, 0.35]
"""


def study_given(name="small", count=2, **study):
    """A study of 2 x count scenes as nested mappings; `study` replaces keys of its table."""
    import tomllib

    given = tomllib.loads(TOML.format(name="small", count=count)) | {"name": name}
    given["study"] |= study
    return given


def contents(path):
    """All that is in a store of its scenes, but for times; rows in the order of their keys."""
    with contextlib.closing(sqlite3.connect(path)) as connection:  # a table may not be there yet
        connection.row_factory = sqlite3.Row
        names = dict(connection.execute("SELECT study, name FROM studies"))
        held = {}
        for table in ("scenes", *OF_SCENES):
            rows = [dict(row) for row in connection.execute(f"SELECT * FROM {table}")]
            for row in rows:
                row["study"] = names[row["study"]]
                row.pop("seconds", None)
                row.pop("version", None)
            held[table] = sorted(rows, key=lambda row: json.dumps(row, default=repr))
    return held


def computed(path, given, workshop, **options):
    """What came of a study, and what was said of it."""
    said = []
    with Store(path) as store:
        tally = run_study(read_study(given), store, workshop, announce=said.append, **options)
    return tally, said


def computed_here(path, **given):
    """Compute a small study in this process."""
    with ThreadPoolExecutor(1) as executor:
        computed(path, study_given(**given), executors.given(executor))


def beta_of(task):
    return task.scene["model"]["parameters"]["beta"]


def deadly(task):
    """Compute a scene, unless its angle is the smallest one: that ends the worker."""
    if beta_of(task) < 0.35:
        os.kill(os.getpid(), signal.SIGKILL)
    return compute(task)


def killed_once(task):
    """Compute a scene; the first worker that has one is killed, as anybody may do."""
    mark = os.environ["KILLED_ONCE"]
    if not os.path.exists(mark):
        open(mark, "w").close()
        os.kill(os.getpid(), signal.SIGKILL)
    return compute(task)


def killed_at_once(begun):
    """Begin as a worker that is killed before it has begun."""
    os.kill(os.getpid(), signal.SIGKILL)
