"""Kinds of events: their declarations and their files agree; one's own is one file."""

from __future__ import annotations

import json
import math
import subprocess
import sys

import numpy as np
import pytest
from zoo import example

from contimpact import InputError, continue_orbit, find_orbits, plot_diagram, write_auto
from contimpact.accuracy.reference import Reference
from contimpact.bifurcations.declarations import (
    CURVES,
    DECLARED,
    SECOND,
    SWITCHES,
    KindDeclaration,
    kinds_in,
)
from contimpact.bifurcations.kind import Kind, kind_of
from contimpact.results.diagram import Diagram, event_of


@pytest.mark.parametrize("declared", DECLARED, ids=lambda declared: declared.name)
def test_a_kind_is_what_its_declaration_says(declared, pair, monkeypatch):
    """What scenes are told of it without its file agrees with what the file defines."""
    name, kind = declared.name, kind_of(declared.name)
    assert kind.name == name
    assert type(kind).__module__ == f"contimpact.bifurcations.{declared.file}"
    assert (type(kind).born is not Kind.born) == (name in SWITCHES)
    here = find_orbits(pair(s=0.9), "1:1", parameter="s")[0].linearisation
    assert here.multipliers[0].imag != 0.0  # NS is of such a pair
    problem, asked = here.problem, []
    details = {"flight": 0, "wall": "B", "touch_time": 0.5, "impact": 0, "requested": {"s": 0.3}}
    system = kind.equations(problem, details)
    second = problem.second_along
    monkeypatch.setattr(problem, "second_along", lambda *at: asked.append(at) or second(*at))
    if system is not None:
        assert np.all(np.isfinite(system.assemble(here, system.start(here)).jacobian))
    assert bool(asked) == (name in SECOND)
    if name in CURVES:
        assert system is not None
        assert kind.codimension_two(problem.word)
    assert kind.test(problem, {"s": [0.3]}).kind == name


def test_a_file_declares_its_kinds(tmp_path):
    """One in several lines, too; what is no kind is not read as one."""
    (tmp_path / "swallowtail.py").write_text(
        "@declared(\n    place=3,\n    second=True,\n)\nclass SW(Kind):\n    name = 'SW'\n\n"
        "class Helper(Kind): ...\n@declared(place=2)\nclass AA(Kind): ...\n"
    )
    second, first = KindDeclaration("SW", "swallowtail", 3, second=True), ("AA", "swallowtail", 2)
    assert kinds_in([str(tmp_path)]) == (KindDeclaration(*first), second)


def test_no_two_kinds_have_one_marker():
    markers = [kind_of(declared.name).look.marker for declared in DECLARED]
    assert len(set(markers)) == len(markers)


def test_declarations_are_read_without_numerics():
    code = (
        "import json, sys, contimpact.bifurcations.declarations; print(json.dumps([*sys.modules]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "numpy" not in json.loads(done.stdout)


def test_a_kind_that_is_not_defined_is_refused(pair):
    orbit = find_orbits(pair(), "1:1", parameter="s")[0]
    with pytest.raises(InputError, match=r"no event kind 'XY'.*accepted are FB, BP.*, MU, MU 0.7"):
        continue_orbit(orbit, range=(0.3, 0.4), events=["XY"])


# A kind of one's own: a multiplier takes a given value.


MU = example("requested_multiplier").MU


class Contracting(MU):
    name, value = "MU 0.7", 0.7


class Alternating(MU):
    name, value = "MU -0.7", -0.7


class Expanding(MU):
    name, value = "MU 2", 2.0


OWN = (MU, Contracting, Alternating, Expanding)
R, OMEGA, G = 0.4, 50.0, 9.8


def amplitude(multiplier):
    """Where the ball's orbit of one impact per period has a multiplier: the trace is mu + r^2/mu,
    and 1 + r^2 - (1 + r)^2 Gamma cos(phase), with Gamma sin(phase) as at the fold."""
    fold = math.pi * (1.0 - R) / (1.0 + R)
    cosine = (1.0 + R**2 - multiplier - R**2 / multiplier) / (1.0 + R) ** 2
    return math.hypot(fold, cosine) * G / OMEGA**2


@pytest.fixture(scope="module")
def followed(kernel_cache):
    ball = example("bouncing_ball").BouncingBall(a=1.5 * G / OMEGA**2, omega=OMEGA, r=R, g=G)
    orbit = find_orbits(ball, "1", parameter="a")[0]
    span = (0.8 * amplitude(1.0), 1.1 * amplitude(-1.0))
    kinds = ["FB", *(kind.name for kind in OWN)]
    return orbit, continue_orbit(orbit, range=span, events=kinds)


@pytest.mark.parametrize("kind", OWN)
def test_a_kind_of_ones_own_is_located(followed, kind):
    """Measured: within 2e-18 m, as its error says; thirty digits confirm it."""
    orbit, branch = followed
    (entry,) = (e for e in branch.events if e.kind == kind.name)
    assert entry.method == "newton"
    assert abs(entry.value - amplitude(kind.value)) <= entry.error < 1e-15
    assert min(abs(complex(*mu) - kind.value) for mu in entry.multipliers) < 1e-9
    event = event_of(entry, orbit.model)
    exact = Reference(event.point.evaluation.problem, 30).event(
        entry.kind, event.point.unknowns, event.details
    )
    assert abs(exact.parameter_error(entry.value)) <= entry.error


def test_an_event_at_which_nothing_happens_sets_nothing_aside(followed):
    """Where a multiplier is 2 the orbit is unstable, and the event says so."""
    _, branch = followed
    ghosts = {entry.label: entry.ghost for entry in branch.events}
    assert ghosts == {"FB": False, **{kind.name: kind.value == 2.0 for kind in OWN}}
    assert not branch.missed


def test_a_kind_of_ones_own_is_drawn_and_exported(followed, tmp_path):
    _, branch = followed
    ax = plot_diagram(Diagram("ball", [branch]))
    labels = {handle.get_label(): handle.get_marker() for handle in ax.get_legend().legend_handles}
    assert labels["MU"] == labels["MU 2"] == "d"
    write_auto(branch, tmp_path / "b.ball")
    types = [line.split()[2] for line in (tmp_path / "b.ball").read_text().splitlines()[1:]]
    assert types.count("-4") == len(OWN)
    assert types.count("5") == 1
    assert np.all(np.isfinite(branch["a"]))


def test_the_double_multiplier_of_an_elastic_ball_is_the_events_own():
    """At r = 1 the multipliers have the product 1, so both are -1 where the trace is -2: at the
    acceleration g of the table. Rounding splits them by 2e-8."""
    ball = example("bouncing_ball").BouncingBall(a=0.5 * G / OMEGA**2, omega=OMEGA, r=1.0, g=G)
    orbit = next(o for o in find_orbits(ball, "1", parameter="a") if o.stable)
    branch = continue_orbit(orbit, range=(0.001, 0.008), events=["PD"])
    (entry,) = branch.events
    assert entry.value == pytest.approx(G / OMEGA**2, rel=1e-14)
    assert (entry.n_unstable, entry.ghost) == (0, False)
