"""From measurements to tables and to a file of all numbers."""

from __future__ import annotations

import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import auto07p
import figure6
import simulation
import words
from agreement import Check
from contestant import MODES, Measured, Sample
from table import both, each, grid, middle, over, spread, whole

AGAINST = ("bare less start-up", "bare executable", "command @r", "@r with compiling")
BRANCHES = {
    "fixed": ("The branch in fixed steps", "per point", each),
    "adaptive": ("The branch in adaptive steps", "for the whole branch", whole),
}
"""Tables of the branch: heading, and what ratios are formed of."""


@dataclass
class Results:
    """All that was measured."""

    runs: int
    load: tuple[float, ...] = ()
    measured: Measured = field(default_factory=dict)
    first: dict[str, float] = field(default_factory=dict)
    checks: list[Check] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)

    def as_text(self) -> str:
        """Return the tables, in Markdown."""
        head = f"{machine_text()}. Rounds: {self.runs}; medians, and the least and the largest."
        if self.load:
            head += f" Load before and after: {', '.join(f'{x:.1f}' for x in self.load)}."
        return "\n\n".join(["# Benchmarks", head, *self.skipped, *self.sections()]) + "\n"

    def sections(self) -> list[str]:
        """Return headings and tables of what was measured."""
        measured, parts = self.measured, []
        for name in BRANCHES:
            if name in measured:
                parts += branch_section(name, measured[name])
        if self.first:
            rows = [[name, f"{t:.3g}"] for name, t in self.first.items()]
            parts += ["## First process, nothing cached (once)", grid(["", "s"], rows)]
        if "words" in measured:
            parts += words_section(measured)
        if "simulation" in measured:
            parts += simulation_section(measured["simulation"])
        if "figure6" in measured:
            parts += figure6_section(measured["figure6"])
        if self.checks:
            rows = [[c.what, c.found, "yes" if c.holds else "NO"] for c in self.checks]
            parts += ["## Agreement", grid(["", "found", "holds"], rows)]
        return parts

    def as_data(self) -> dict[str, Any]:
        """Return every measurement, and the ratios of every round."""
        return {
            "machine": machine(),
            "runs": self.runs,
            "load": self.load,
            "skipped": self.skipped,
            "samples": {
                table: {row: _plain(samples) for row, samples in rows.items()}
                for table, rows in self.measured.items()
            },
            "ratios": {
                name: auto_ratios(self.measured[name], BRANCHES[name][2])
                for name in BRANCHES
                if name in self.measured
            },
            "exponents": words.exponents(self.measured) if "words" in self.measured else {},
            "first": self.first,
            "checks": [check._asdict() for check in self.checks],
        }


def _plain(samples: Sequence[Sample]) -> dict[str, Any]:
    return {"count": samples[0].count, "seconds": whole(samples)}


def branch_section(name: str, rows: dict[str, list[Sample]]) -> list[str]:
    """Return the times of one kind of steps, and their ratios to AUTO."""
    title, of, values = BRANCHES[name]
    header = ["", "points", "ms", "us per point", "min to max"]
    lines = [
        [row, str(s[0].count), middle(_times(whole(s), 1e3)), *_micro(each(s))]
        for row, s in rows.items()
    ]
    parts = [f"## {title}", grid(header, lines)]
    ratios = auto_ratios(rows, values)
    for level in auto07p.LEVELS:
        columns = [auto07p.row(what, level) for what in AGAINST]
        lines = [
            [row, *(both(r[c]) for c in columns)] for row, r in ratios.items() if columns[0] in r
        ]
        if lines:
            parts += [f"Times {of}, as multiples of AUTO's with IID = {level}:"]
            parts += [grid(["", *AGAINST], lines)]
    return parts


def auto_ratios(
    rows: dict[str, list[Sample]], values: Callable[[Sequence[Sample]], list[float]]
) -> dict[str, dict[str, list[float]]]:
    """Return the ratios to AUTO's rows, by row, reference and round."""
    references = [
        name
        for what in AGAINST
        for level in auto07p.LEVELS
        if (name := auto07p.row(what, level)) in rows
    ]
    return {
        row: {name: over(values(samples), values(rows[name])) for name in references}
        for row, samples in rows.items()
        if not row.startswith("AUTO")
    }


def words_section(measured: Measured) -> list[str]:
    """Return the cost of a point by the length of the word, and the exponents."""
    rows, lines = measured["words"], []
    for impacts in words.LENGTHS:
        for mode in MODES:
            parts = [each(rows[words.row(mode, impacts, part)]) for part in words.PARTS]
            plain = each(rows[words.row("plain", impacts, words.PARTS[0])])
            cells = [both(_times(part, 1e6)) for part in parts]
            lines.append([f"contimpact {mode}, N = {impacts}", *cells, both(over(plain, parts[0]))])
    header = ["us per point", *words.PARTS, "plain over it"]
    fits = [[name, both(slopes)] for name, slopes in words.exponents(measured).items()]
    title = f"## Words of N impacts, {words.POINTS} points, all events"
    return [title, grid(header, lines), grid(["exponent of N", ""], fits)]


def simulation_section(rows: dict[str, list[Sample]]) -> list[str]:
    """Return the rates of the simulation."""
    header = ["", "impacts", "per second", "min to max", "s for 1e6", "plain over it"]
    lines = []
    for motion in simulation.MOTIONS:
        plain = each(rows[simulation.row("plain", motion)])
        for mode in MODES:
            samples = rows[simulation.row(mode, motion)]
            rates, gain = [1.0 / t for t in each(samples)], over(plain, each(samples))
            cells = [middle(rates), spread(rates), middle(_times(each(samples), 1e6)), both(gain)]
            lines.append([simulation.row(mode, motion), str(samples[0].count), *cells])
    scaled = f"Plain runs have {simulation.IMPACTS['plain']} impacts; their seconds are scaled."
    return ["## Simulation", grid(header, lines), scaled]


def figure6_section(rows: dict[str, list[Sample]]) -> list[str]:
    """Return the seconds of the scenes."""
    lines = []
    for scene in (*figure6.SCENES, "all four"):
        plain = whole(rows[figure6.row("plain", scene)])
        for mode in MODES:
            times = whole(rows[figure6.row(mode, scene)])
            gain = both(over(plain, times))
            lines.append([figure6.row(mode, scene), middle(times), spread(times), gain])
    runs = len(rows[figure6.row("plain", "all four")])
    header = ["", "s", "min to max", "plain over it"]
    return [f"## Fig. 6, whole scenes (rounds: {runs})", grid(header, lines)]


def _micro(values: Sequence[float]) -> list[str]:
    return [middle(_times(values, 1e6)), spread(_times(values, 1e6))]


def _times(values: Sequence[float], factor: float) -> list[float]:
    return [value * factor for value in values]


def machine() -> dict[str, str]:
    """Return what ran: the machine's kind and versions."""
    found = {"machine": platform.machine(), "system": platform.system()}
    found["python"] = platform.python_version()
    for name in ("contimpact", "numpy", "scipy", "llvmlite"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found


def machine_text() -> str:
    """Return the same in a line."""
    found = machine()
    where = f"{found.pop('system')} on {found.pop('machine')}"
    return ", ".join([where, *(f"{name} {value}" for name, value in found.items())])
