"""The report of error against run time of a scene.

Methods on the same axes, for one branch: the library with its tolerance varied and with its step
varied, each with both predictors, and what a user would write without it: SciPy's `solve_ivp` with
events, shooting, and a Jacobian by finite differences. Evaluations do not depend on the machine;
seconds do, so repetitions, their median and their spread are kept.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import json
import os
import platform
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import mpmath
import numpy as np

from .. import __version__
from ..arrays import Array
from ..bifurcations.declarations import KINDS
from ..continuation.branch import Point, Walk
from ..continuation.corrector import DENSE_UP_TO, border_jacobian, solve
from ..continuation.settings import PREDICTORS, Settings
from ..continuation.walk import reraise_interruption
from ..diagrams.explore import follow
from ..diagrams.orbit_walks import walk_orbits
from ..diagrams.starting_orbits import orbits_at_start
from ..errors import InputError, require_whole
from ..models.guards import Word
from ..orbits.orbit import Orbit
from ..orbits.problem import OrbitProblem
from ..orbits.status import multipliers
from ..results.branch import Entry, details_of, orbit_of
from ..results.diagram import INTERRUPTED, Diagram
from ..results.scene import Scene
from ..segments.kernels import Kernels
from ..storage import finite, write_all
from .reference import (
    EVALUATIONS,
    EXPLICIT,
    MOST_EVALUATIONS,
    SECONDS,
    SHOT,
    Exact,
    Reference,
    measure_shooting,
    measure_simulation,
    spread,
    spread_sample,
    take_within_budget,
    time_task,
)

# What proofs cost: seconds for each entry, and for each tube of a branch.


def measure_certificates(
    scene: Scene, diagram: Diagram, progress: Callable[[str], None]
) -> dict[str, Any] | None:
    """Return what it costs to certify a scene's diagram; None where it has no [certify].

    Raises InputError if what proofs are made with is not installed.
    """
    if scene.certify is None:
        return None
    if importlib.util.find_spec("flint") is None:
        lacking = "python-flint, which proofs are made with, is not installed"
        raise InputError("certify", lacking, "pip install contimpact[certify]")
    from ..certificates.certify import certify

    found = certify(diagram, options=scene.certify, progress=progress)
    return {
        "entries": len(found.entries),
        "certified": len(found.entries) - len(found.rejected),
        "radius": max((c.certified_radius or 0.0 for c in found.entries), default=0.0),
        "per_entry": spread([c.seconds for c in found.entries]) if found.entries else None,
        "branches": [
            {
                "id": c.id,
                "word": c.word,
                "period": c.period,
                "complete": c.complete,
                "share": c.share,
                "tubes": c.tubes,
                "per_tube": c.seconds / max(c.tubes, 1),
            }
            for c in found.branches
        ],
    }


# Events of a scene against many digits: their true errors, and how honest the estimates are.

DIGITS = 30

SECONDS_OF_EVENTS = 120.0
"""After which no further event is compared."""


def measure_events(
    scene: Scene, kernels: Kernels, diagram: Diagram | None = None
) -> list[dict[str, Any]]:
    """Return every event of the scene's diagram with its true error and its estimate.

    An event of a family's member is compared at that member's parameter values. Those that there
    is no time for are not ``compared``.
    """
    references: dict[Any, Reference] = {}
    entries = [e for e in (diagram or follow(scene)).entries if e.kind in KINDS]
    rows = []
    for entry in take_within_budget(entries, SECONDS_OF_EVENTS):
        here = orbit_of(entry, scene.model, kernels)
        problem = here.problem
        fixed = [v for n, v in problem.model.values.items() if n != scene.parameter]
        key = (entry.word, entry.period, *fixed)
        exact = references.setdefault(key, Reference(problem, DIGITS))
        found = exact.event(entry.kind, here.unknowns, details_of(entry))
        rows.append(_event_row(entry, here.unknowns, found, True))
        if found is None:
            details = entry.kind, here.unknowns, details_of(entry)
            rows[-1]["unconfirmed"] = NOT_SOLVED if exact.has_event(*details) else NO_EQUATIONS
    return [*rows, *(_event_row(entry, None, None, False) for entry in entries[len(rows) :])]


NO_EQUATIONS = "the reference has no equations for what defines it"
NOT_SOLVED = f"the reference's iteration does not converge to {DIGITS} digits"
"""Why an event is not confirmed."""


def _event_row(
    entry: Entry, unknowns: Array | None, found: Exact | None, compared: bool
) -> dict[str, Any]:
    true = abs(found.parameter_error(entry.value)) if found else None
    return {
        **{name: getattr(entry, name) for name in ("id", "label", "branch", "value")},
        "compared": compared,
        "digits": mpmath.nstr(found.parameter, DIGITS) if found else None,
        "true_error": true,
        "estimated_error": entry.error,
        "ratio": None if true is None else _ratio(true, entry.error),
        "moved": found.distance(unknowns) if found and unknowns is not None else None,
        "condition": found.condition if found else None,
        "method": entry.method,
        "unconfirmed": None,
    }


def _ratio(true: float, estimated: float) -> float:
    """The true error over its estimate; an event that is exact, and says so, is within it."""
    if estimated == 0.0:
        return 0.0 if true == 0.0 else np.inf
    return true / estimated


def compare_estimates(events: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return how true errors compare with their estimates."""
    ratios = [e["ratio"] for e in events if e["ratio"] is not None]
    return {
        "events": len(events),
        "compared": sum(e["compared"] for e in events),
        "confirmed": sum(e["true_error"] is not None for e in events),
        "within_estimate": sum(ratio <= 1.0 for ratio in ratios),
        "median_ratio": median(ratios) if ratios else None,
        "largest_ratio": max(ratios, default=None),
        "largest_true_error": max(
            (e["true_error"] for e in events if e["true_error"] is not None), default=None
        ),
    }


# What a corrector iteration and the multipliers cost against the number of impacts.

WORD_LENGTHS = (10, 20, 50, 100, 150, 200)


def long_words(orbit: Orbit, repetitions: int) -> dict[str, Any]:
    """Return what a corrector iteration and the multipliers cost against the number of impacts.

    The words are the scene's own, run several times.
    """
    rows = []
    own = len(orbit.word)
    for length in WORD_LENGTHS:
        times = max(1, round(length / own))
        problem, unknowns = _repeat_orbit(orbit, times)
        here = problem.evaluate(unknowns)
        matrix = border_jacobian(here.jacobian, np.ones(problem.n + 1))
        right = np.ones(problem.n + 1)
        loops = max(1, 200 // (own * times))
        parts: dict[str, Callable[[], Any]] = {
            "residual and blocks": partial(problem.evaluate, unknowns),
            "Jacobian": partial(_jacobian, problem, unknowns),
            "bordered solve": partial(solve, matrix, right),
            "multipliers": partial(multipliers, here.start, here.end),
        }
        row: dict[str, Any] = {"impacts": own * times}
        for name, part in parts.items():
            _, row[name] = time_task(partial(_repeat, part, loops), repetitions, loops)
        rows.append(row)
    exponents = {name: _exponent(rows, name) for name in parts}
    return {"rows": rows, "exponents": exponents, "dense_up_to": DENSE_UP_TO}


def _jacobian(problem: OrbitProblem, unknowns: Array) -> Array:
    return problem.evaluate(unknowns).jacobian


def _repeat(part: Callable[[], Any], times: int) -> None:
    for _ in range(times):
        part()


def _repeat_orbit(orbit: Orbit, times: int) -> tuple[OrbitProblem, Array]:
    problem, word = orbit.problem, orbit.word
    span = problem.span(orbit.unknowns)
    rows = np.vstack([problem.impacts(orbit.unknowns)] * times)
    rows[:, 0] += span * np.repeat(np.arange(times), len(word))
    longer = Word(word.walls * times, word.period * times)
    return OrbitProblem(problem.model, longer, problem.kernels), np.append(
        rows.ravel(), orbit.unknowns[-1]
    )


def _exponent(rows: Sequence[Mapping[str, Any]], name: str) -> float:
    """The slope of log seconds over log impacts, over the longer half of the words."""
    longer = rows[len(rows) // 2 - 1 :]
    logs = np.log([[row["impacts"], row[name]["median"]] for row in longer])
    return float(np.polyfit(logs[:, 0], logs[:, 1], 1)[0])


SCHEMA = "contimpact.report/1"
TOLERANCES = tuple(10.0**-k for k in range(4, 15))
STEPS = (0.2, 0.1, 0.05, 0.025, 0.0125, 0.00625, 0.003125)
SAMPLES = 40
"""Orbits or places between points at which a method's error is measured, as far as the budget of a
row allows."""

POINTS = 400


def report(
    scene: Scene, repetitions: int = 5, progress: Callable[[str], None] | None = None
) -> dict[str, Any]:
    """Measure error against run time for a scene, each timing repeated; returns plain data, as
    written to ``report.json``.

    Raises InputError if the scene's first orbit with impacts does not exist at its start, it has
    none, or `repetitions` is below 1.
    """
    require_whole(repetitions, "repetitions")
    progress = progress or (lambda text: None)
    kernels = Kernels(scene.model, scene.parameter)
    progress("the scene's diagram")
    diagram = follow(scene)
    if diagram.statistics["failure"] == INTERRUPTED:
        raise KeyboardInterrupt
    orbit = _orbit(scene, kernels, diagram)
    task = _Task(scene, orbit, repetitions, progress)
    methods = task.walked()
    methods += task.shooting()
    progress("events")
    events = measure_events(scene, kernels, diagram)
    progress("simulation")
    simulation = measure_simulation(scene, TOLERANCES, repetitions, DIGITS)
    proofs = measure_certificates(scene, diagram, progress)
    progress("long words")
    return {
        "schema": SCHEMA,
        "scene": scene.name,
        "orbit": str(orbit.word),
        "digits": DIGITS,
        "repetitions": repetitions,
        "machine": machine(),
        "methods": methods,
        "events": events,
        "honesty": compare_estimates(events),
        "simulation": simulation,
        "certificates": proofs,
        "long_words": long_words(orbit, repetitions),
    }


def _orbit(scene: Scene, kernels: Kernels, diagram: Diagram) -> Orbit:
    """The orbit whose branch a report compares: the first with impacts of those that the scene
    names, a physical one if it can be, or of those that were found from them, half way along its
    branch."""
    word = next((word for word in scene.orbits if word.walls), None)
    if word is not None:
        found = orbits_at_start(scene, kernels, word)
        return next((orbit for orbit in found if orbit.physical), found[0])
    for branch in diagram.branches:
        if branch.word and branch.parameter == scene.parameter:
            return branch.orbit(len(branch) // 2, scene.model)
    accepted = "name one with impacts besides: a report compares times and velocities of impacts"
    raise InputError("follow.orbits", "no word but 0, and none was born on it", accepted)


def machine() -> dict[str, Any]:
    """Return what the timings depend on, in general terms."""
    import scipy

    return {
        "processors": os.cpu_count(),
        "system": sys.platform,
        "architecture": platform.machine(),
        "python": platform.python_version(),
        "contimpact": __version__,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "mpmath": mpmath.__version__,
    }


_Place = tuple[Array, int]


@dataclasses.dataclass
class _Task:
    """What all methods do: orbits of the branch through the scene's first orbit."""

    scene: Scene
    orbit: Orbit
    repetitions: int
    progress: Callable[[str], None]

    def __post_init__(self) -> None:
        self.problem = self.orbit.problem
        self.exact = Reference(self.problem, DIGITS)

    def walks(self, settings: Settings) -> list[Walk]:
        start, limits = (self.problem, self.orbit.unknowns), self.scene.range
        walks = [
            walk_orbits(*start, direction, gaps=False, limits=limits, settings=settings)
            for direction in (-1, +1)
        ]
        reraise_interruption(walk.end for walk in walks)
        return walks

    def settings(self, **changes: Any) -> Settings:
        base = dataclasses.replace(self.scene.settings, max_points=POINTS, min_step=1e-7)
        return dataclasses.replace(base, **changes)

    def walked(self) -> list[dict[str, Any]]:
        """The branch at every tolerance and at every largest step, with both predictors.

        Repetitions go around all of them, so that what else the machine does meets all alike.
        """
        methods = []
        for predictor in PREDICTORS:
            methods.append(self.tolerances(predictor))
            methods.append(self.steps(predictor))
        rows = [row for method in methods for row in method["rows"]]
        settings = [row.pop("settings") for row in rows]
        firsts = [row.pop("first") for row in rows]
        seconds = [[first] if first > SECONDS else [] for first in firsts]
        for number in range(self.repetitions):
            self.progress(f"timings, repetition {number + 1}")
            for own, chosen in zip(seconds, settings, strict=True):
                if sum(own) <= SECONDS:
                    began = time.process_time()
                    self.walks(chosen)
                    own.append(time.process_time() - began)
        for row, own in zip(rows, seconds, strict=True):
            row["seconds"] = spread(own)
        return methods

    def tolerances(self, predictor: str) -> dict[str, Any]:
        """Errors of the points, at every tolerance."""
        rows = [
            self.row(
                tolerance,
                self.settings(tolerance=tolerance, predictor=predictor),
                _places_at_points,
            )
            for tolerance in TOLERANCES
        ]
        return _method(f"tolerance, {predictor} predictor", "tolerance", "points", rows)

    def steps(self, predictor: str) -> dict[str, Any]:
        """Errors of the curve half way between points, at every largest step."""
        rows = []
        for step in STEPS:
            least = min(step, self.scene.settings.step)
            steps = {"max_step": step, "step": least, "max_angle": step * 2.0}
            settings = self.settings(
                **steps, predictor=predictor, tolerance=1e-13, max_points=20 * POINTS
            )
            rows.append(self.row(step, settings, _places_between_points))
        return _method(f"step, {predictor} predictor", "max_step", "curve between points", rows)

    def row(
        self, value: float, settings: Settings, places: Callable[[Walk], list[_Place]]
    ) -> dict[str, Any]:
        """Error and evaluations; the seconds are measured afterwards."""
        self.progress(f"a branch with the setting {value:.0e}")
        before, began = self.problem.kernel_evaluations, time.process_time()
        walks = self.walks(settings)
        evaluations = self.problem.kernel_evaluations - before
        first = time.process_time() - began
        guesses = _spread_order(
            spread_sample([guess for w in walks for guess in places(w)], SAMPLES)
        )
        errors = [self.error(*place) for place in take_within_budget(guesses)]
        return {
            "setting": value,
            "error": max(errors, default=None),
            "places": len(errors),
            "places_asked": len(guesses),
            "evaluations": evaluations,
            "orbits": sum(len(w.points) for w in walks),
            "failed": 0,
            "settings": settings,
            "first": first,
        }

    def error(self, unknowns: Array, held: int = -1) -> float:
        """The distance from the exact branch, where it has the same value of one unknown."""
        found = self.exact.orbit(unknowns, held)
        return found.distance(unknowns) if found else float("inf")

    def shooting(self) -> list[dict[str, Any]]:
        """What a user would write: nothing for systems it has no simple form for."""
        walks = self.walks(self.settings())
        found = measure_shooting(self.problem, walks, TOLERANCES, self.repetitions, self.progress)
        methods = []
        for integrator, rows in found.items():
            for row in rows:
                row["error"] = max(map(self.error, row.pop("reached")), default=None)
            name = "shooting, solve_ivp" + (f" ({integrator})" if integrator != EXPLICIT else "")
            methods.append(_method(name, "rtol", "points", rows))
        return methods


def _method(name: str, varied: str, measure: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    return {"name": name, "varied": varied, "error_of": measure, "rows": rows}


def _spread_order(items: list[Any]) -> list[Any]:
    """The same items in an order in which the first few are spread over all."""
    order = sorted(range(len(items)), key=lambda i: f"{i:010b}"[::-1])
    return [items[i] for i in order]


def _places_at_points(walked: Walk) -> list[_Place]:
    return [(point.unknowns, _fastest(point)) for point in walked.points]


def _places_between_points(walked: Walk) -> list[_Place]:
    """The cubic through neighbouring points with their tangents, half way."""
    places = []
    for a, b in zip(walked.points, walked.points[1:], strict=False):
        bend = 0.125 * (b.arclength - a.arclength) * (a.tangent - b.tangent)
        places.append((0.5 * (a.unknowns + b.unknowns) + bend, _fastest(a)))
    return places


def _fastest(point: Point) -> int:
    """The unknown by which the branch is best told along its way: not the parameter at a fold."""
    return int(np.argmax(np.abs(point.tangent)))


# A report as files: ``report.json``, ``report.md`` with its tables, and the plots.


def write_report(data: Mapping[str, Any], folder: Path, formats: Sequence[str]) -> list[str]:
    """Write ``report.json``, ``report.md`` and the plots; returns the files' names."""
    text = json.dumps(finite(data), indent=1, allow_nan=False) + "\n"
    names = [f"work-precision.{kind}" for kind in formats]
    files = {"report.json": lambda: text, "report.md": lambda: markdown(data, names[-1:])}
    written = write_all(folder, files)
    if names:
        from ..plots.report import save_report

        written += save_report(data, folder, formats)
    return written


NO_SHOOTING = (
    "Not tried: it is for flights of one coordinate, and orbits of this branch that are physical, "
    "not at a fold, and have no slow impact."
)


def markdown(data: Mapping[str, Any], figures: Sequence[str] = ()) -> str:
    """Return a report as text with tables."""
    machine, fair = data["machine"], data["honesty"]
    about = ", ".join(f"{name} {value}" for name, value in machine.items())
    text = f"""\
# Error against run time: {data["scene"]}

The branch of the orbit {data["orbit"]}, without events. Errors are those of impact
times and velocities against {data["digits"]} digits, at up to {SAMPLES} places.
Seconds are those of the processor: medians of {data["repetitions"]} repetitions, least and most.
Shooting solves for {SHOT} orbits of the branch, at most 3 times, from guesses good to
three digits; its cost is scaled to all orbits of the branch. Evaluations are of flight
kernels; of shooting, of the equations of motion. What has taken {SECONDS:.0f} s is not repeated.

Machine: {about}.
"""
    lines = text.split("\n")
    lines += [*(f"![Error against seconds and evaluations]({name})" for name in figures), ""]
    for method in data["methods"]:
        lines += _method_table(method)
    if not any("shooting" in method["name"] for method in data["methods"]):
        lines += ["## shooting", "", NO_SHOOTING, ""]
    lines += _event_table(data["events"], fair)
    if data["simulation"] is not None:
        lines += _simulation_table(data["simulation"])
    if data.get("certificates") is not None:
        lines += _proof_table(data["certificates"])
    lines += _word_table(data["long_words"])
    return "\n".join(lines) + "\n"


def _number(value: float | None) -> str:
    return "" if value is None or not np.isfinite(value) else f"{value:.1e}"


def _method_table(method: Mapping[str, Any]) -> list[str]:
    rows = [
        f"| {_number(r['setting'])} | {_number(r['error']) or 'failed'} "
        f"| {_number(r['seconds']['median'])} | {_number(r['seconds']['low'])} to "
        f"{_number(r['seconds']['high'])} | {r['evaluations']:.0f} | {r['orbits']} "
        f"| {r['failed'] or ''} |"
        for r in method["rows"]
    ]
    head = [f"## {method['name']}", "", f"Largest error of {method['error_of']}.", ""]
    columns = "error | seconds | spread | evaluations | orbits | failed"
    table = _table(f"{method['varied']} | {columns}", rows)
    return [*head, *table, *_fewer_places(method), *_budget_note(method["rows"]), ""]


def _fewer_places(method: Mapping[str, Any]) -> list[str]:
    """What is said where the truth took so long that an error was measured at few places."""
    rows = [r for r in method["rows"] if r.get("places", 0) < r.get("places_asked", 0)]
    if not rows:
        return []
    least = min(r["places"] for r in rows)
    said = f"In {len(rows)} rows the truth takes longer than {SECONDS:.0f} s at {SAMPLES} places; "
    return ["", f"{said}errors are those at {least} at least."]


def _budget_note(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """What is said of rows that have spent their budget, and what would do instead."""
    late = [r for r in rows if r.get("unfinished")]
    if not late:
        return []
    several = ", ".join(f"{r['unfinished']} at {_number(r['setting'])}" for r in late)
    return [
        "",
        f"Not ended within {EVALUATIONS} evaluations a row and {MOST_EVALUATIONS} a flight: "
        f"{several}. Errors are of those that have ended, costs there the least they can be; where "
        "nothing has ended, smaller tolerances are not tried. An explicit integrator takes many "
        "steps where motion is stiff, an implicit one for small tolerances; larger ones end.",
    ]


def _event_table(events: Sequence[Mapping[str, Any]], fair: Mapping[str, Any]) -> list[str]:
    rows = [
        f"| {e['id']} | `{e['label']}` | {e['value']:.15g} | {_number(e['true_error'])} "
        f"| {_number(e['estimated_error'])} | {_number(e['ratio'])} | {_number(e['condition'])} |"
        for e in events
    ]
    summary = (
        f"{fair['confirmed']} of {fair['events']} events confirmed; the true error is within the "
        f"estimate for {fair['within_estimate']} of them, and at most "
        f"{_number(fair['largest_ratio'])} of it (median {_number(fair['median_ratio'])})."
    )
    if left := fair["events"] - fair["compared"]:
        summary += (
            f" {left} were not compared: the others had taken longer than {SECONDS_OF_EVENTS:.0f} "
            "s. A scene with a smaller range or depth has fewer."
        )
    for why in (NO_EQUATIONS, NOT_SOLVED):
        if names := [e["id"] for e in events if e["unconfirmed"] == why]:
            summary += f" Not confirmed, as {why}: {', '.join(names)}."
    columns = "id | event | value | true error | estimate | ratio | condition"
    return ["## Events", "", summary, "", *_table(columns, rows), ""]


def _simulation_table(found: Mapping[str, Any]) -> list[str]:
    methods = [("closed form", found["simulator"])]
    methods += [("solve_ivp", row) for row in found["solve_ivp"]]
    methods += [("solve_ivp, Radau", row) for row in found["radau"]]
    rows = [
        f"| {name} | {_number(r['setting'])} | {_number(r['error']) or 'failed'} "
        f"| {_number(r['seconds']['median'])} | {_number(r['evaluations'])} | {r['failed'] or ''} |"
        for name, r in methods
    ]
    along, energy = found["along"], found["energy"]
    said = [
        f"Along the motion, from its first impact, the error is at most "
        f"{_number(max(along, default=None))} at the first {len(along)} impacts."
    ]
    if energy is not None:
        said.append(
            f"Voltages of these impacts are off by at most {_number(energy['formula'])} for the "
            f"simulated velocities, and {_number(energy['along'])} altogether, relative to them."
        )
    head = (
        f"A run of {found['impacts']} impacts after the transient. Errors are the largest of "
        f"{found['flights']} flights, each from the impact before it; seconds and evaluations are "
        "those of a flight."
    )
    table = _table("method | rtol | error | seconds | evaluations | failed", rows)
    late = [*_budget_note(found["solve_ivp"]), *_budget_note(found["radau"])]
    return ["## Simulation", "", head, "", *table, *late, "", *said, ""]


def _proof_table(proofs: Mapping[str, Any]) -> list[str]:
    rows = [
        f"| {c['id']} | {c['word']}/{c['period']}T | {'yes' if c['complete'] else 'no'} "
        f"| {c['share']:.4%} | {c['tubes']} | {_number(c['per_tube'])} |"
        for c in proofs["branches"]
    ]
    head = (
        f"{proofs['certified']} of {proofs['entries']} entries certified, radii up to "
        f"{_number(proofs['radius'])}"
    )
    if proofs["per_entry"] is not None:
        own = (_number(proofs["per_entry"][name]) for name in ("median", "low", "high"))
        head += ", seconds each: median {}, from {} to {}".format(*own)
    table = _table("branch | word | complete | proven | tubes | seconds per tube", rows)
    return ["## Certificates", "", head + ".", "", *table, ""]


def _word_table(words: Mapping[str, Any]) -> list[str]:
    names = list(words["exponents"])
    rows = [
        f"| {row['impacts']} | " + " | ".join(_number(row[n]["median"]) for n in names) + " |"
        for row in words["rows"]
    ]
    slopes = " | ".join(f"{words['exponents'][n]:.2f}" for n in names)
    head = (
        "Seconds against the number of impacts; the last row is the exponent over the longer words."
    )
    table = _table(" | ".join(["impacts", *names]), [*rows, f"| exponent | {slopes} |"])
    return ["## Long words", "", head, "", *table]


def _table(columns: str, rows: Sequence[str]) -> list[str]:
    """A table in Markdown: names of columns between bars, and its rows."""
    return [f"| {columns} |", "|" + "---|" * (columns.count(" | ") + 1), *rows]
