"""A report as files: ``report.json``, ``report.md`` with its tables, and the plots."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..storage.files import write_all
from .report import SAMPLES
from .report import SECONDS_OF_EVENTS as EVENTS_SECONDS
from .shooting import EVALUATIONS, MOST_EVALUATIONS, SECONDS, SHOT


def write_report(data: Mapping[str, Any], folder: Path, formats: Sequence[str]) -> list[str]:
    """Write ``report.json``, ``report.md`` and the plots; returns the files' names."""
    text = json.dumps(_finite(data), indent=1, allow_nan=False) + "\n"
    names = [f"work-precision.{kind}" for kind in formats]
    files = {"report.json": lambda: text, "report.md": lambda: markdown(data, names[-1:])}
    written = write_all(folder, files)
    if names:
        from ..plots.report import save_report

        written += save_report(data, folder, formats)
    return written


def _finite(value: Any) -> Any:
    """The same data with null where a number is not finite."""
    if isinstance(value, Mapping):
        return {key: _finite(v) for key, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


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
    rows = [r for r in method["rows"] if r.get("places", SAMPLES) < min(SAMPLES, r["orbits"])]
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
            f" {left} were not compared: the others had taken longer than {EVENTS_SECONDS:.0f} s. "
            "A scene with a smaller range or depth has fewer."
        )
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
