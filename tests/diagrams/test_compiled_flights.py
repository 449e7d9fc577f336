"""Walks on which compiled code integrates, beside plain ones by heyoka and a closed form."""

from __future__ import annotations

import importlib.util
import logging

import numpy as np
import pytest
from integrated import Integrated

import contimpact as ci
from contimpact.diagrams.orbit_walks import SwitchingBackend
from contimpact.models.guards import Word
from contimpact.orbits.quiet import problem_of
from contimpact.orbits.search import orbit_at
from contimpact.segments import compiling
from contimpact.segments.kernels import Kernels
from contimpact.systems.duffing import Duffing
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.pendulum import Pendulum

pytest.importorskip("heyoka", reason="needs contimpact[ode]")
pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("llvmlite") is None, reason="the extra 'fast' is not installed"
)

DUFFING = {"a": 0.5, "omega": 1.4, "c": 0.1, "alpha": 1.0, "beta": 1.0, "sigma": 0.8, "r": 0.8}
OSCILLATOR = {"a": 1.0, "omega": 1.3, "c": 0.1, "k": 1.0, "sigma": 0.5, "r": 0.8}
UPRIGHT = {"a": 1.0, "omega": 0.8, "c": 0.1, "sigma": 3.1, "r": 0.8}
EVENTS = ["FB", "PD", "G", "V", "BP", "T"]


def branch_of(model, parameter, limits, **given):
    orbits = ci.find_orbits(model, "S", parameter=parameter, starts=10, rounds=1)
    orbit = next((orbit for orbit in orbits if orbit.physical), orbits[0])
    return ci.continue_orbit(orbit, parameter, limits, events=EVENTS, **given)


def close(one, other):
    """The same branches, but for rounding: tables, events within their errors, ends."""
    assert len(one) == len(other) > 5
    for name, column in one.columns.items():
        if column.dtype.kind == "f" and name != "residual":
            assert other.columns[name] == pytest.approx(column, rel=1e-8, abs=1e-8, nan_ok=True)
        elif name not in ("residual", "iterations"):
            assert np.array_equal(column, other.columns[name]), name
    assert [event.label for event in other.events] == [event.label for event in one.events]
    for found, truth in zip(other.events, one.events, strict=True):
        assert abs(found.value - truth.value) <= found.error + truth.error
    assert [end.kind for end in other.ends] == [end.kind for end in one.ends]


@pytest.mark.full
@pytest.mark.parametrize(
    ("model", "limits"),
    [
        (Duffing(**DUFFING), (1.1, 1.5)),
        (Pendulum(a=1.0, omega=0.8, c=0.1, sigma=1.0, r=0.8), (0.7, 1.0)),
    ],
    ids=["duffing", "pendulum"],
)
def test_compiled_branches_are_plain_ones(plain_and_compiled, model, limits):
    plain, fast = plain_and_compiled(lambda: branch_of(model, "omega", limits))
    assert plain.events
    close(plain, fast)
    assert "flights whose equations are not linear" not in " ".join(compiling.ran_plainly())


@pytest.mark.full
def test_compiled_events_are_those_of_the_closed_form(kernel_cache, monkeypatch):
    monkeypatch.setenv("CONTIMPACT_COMPILED", "always")
    branch, same = (
        branch_of(kind(**OSCILLATOR), "omega", (0.7, 3.0)) for kind in (Oscillator, Integrated)
    )
    assert {event.kind for event in same.events} >= {"FB", "PD", "G", "V"}
    close(branch, same)


@pytest.mark.full
def test_where_flights_become_long_they_are_computed_in_pieces(kernel_cache, monkeypatch):
    """At the same point as plainly: a stop just short of upright."""
    model = Pendulum(**UPRIGHT)
    problem = problem_of(model, Word("S", 1), Kernels(model, "omega"))
    orbit = orbit_at(problem, np.array([3.6340, 0.1536, 0.8]))
    switched, advance = [], SwitchingBackend.advance

    def noted(backend, position, most):
        before, made = backend.long, advance(backend, position, most)
        if backend.long != before:
            switched.append((position.points, position.here.parameter))
        return made

    monkeypatch.setattr(SwitchingBackend, "advance", noted)
    for mode in ("never", "always"):
        monkeypatch.setenv("CONTIMPACT_COMPILED", mode)
        ci.continue_orbit(orbit, "omega", (0.35, 0.82), events=[], settings={"max_points": 40})
    half = len(switched) // 2
    assert half > 0
    for plain, fast in zip(switched[:half], switched[half:], strict=True):
        assert fast == pytest.approx(plain, rel=1e-10)


@pytest.mark.slow
def test_flights_of_more_pieces_than_there_is_room_for_go_on_plainly(plain_and_compiled, caplog):
    caplog.set_level(logging.INFO)
    model = Integrated(a=1.0, omega=1.0, c=4e3, k=1.0, sigma=0.0, r=0.8)
    plain, fast = plain_and_compiled(lambda: branch_of(model, "a", (0.99, 1.01)))
    close(plain, fast)
    assert "too stiff for compiled code" in caplog.text
