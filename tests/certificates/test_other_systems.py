"""Proofs of other systems than the impact pair: linear flights of one and of two degrees of
freedom, free fall on a table, an oscillator that comes to rest at its stop."""

from __future__ import annotations

import dataclasses
import functools

import pytest
from zoo import ROOT

import contimpact
from contimpact import load_entries, load_scene
from contimpact.models.word import Word
from contimpact.scenes.options import CertifyOptions
from contimpact.studies.explore import follow

pytest.importorskip("flint", reason="needs contimpact[certify]")

from contimpact.certificates import touches
from contimpact.certificates.branch import verified_branch
from contimpact.certificates.certify import QUIET
from contimpact.certificates.event import certified

ENTRIES_ALONE = CertifyOptions(branches=False)

KINDS = {
    "bouncing_ball": {"FB", "PD", "G", "V"},
    "stop": {"FB", "PD", "V"},
    "two_stops": {"BP", "PD", "G"},
    "impact_damper": {"BP", "NS", "PD", "G"},
}
"""Of the entries that come with the package, by the folder of their scene."""

SMALLER = {
    "bouncing_ball": {"range": (0.008, 0.015), "orbits": (Word("P", 2),), "switch": ()},
    "two_stops": {"range": (0.4, 0.5)},
    "impact_damper": {"range": (19.9, 20.3), "switch": ()},
}
"""A part of each scene."""


@functools.cache
def entries_of(name):
    return load_entries(ROOT / "branches" / name)


@functools.cache
def diagram_of(name):
    whole = load_scene(ROOT / "branches" / name / "scene.toml")
    return follow(dataclasses.replace(whole, **SMALLER[name]))


@functools.cache
def proven(name):
    return contimpact.certify(diagram_of(name))


@pytest.mark.parametrize("name", KINDS)
def test_every_entry_is_certified(name):
    found = contimpact.certify(entries_of(name), options=ENTRIES_ALONE)
    assert found.certified, found
    assert {c.kind for c in found.entries} == KINDS[name]
    assert all(c.certified_radius < 1e-30 for c in found.entries)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["two_masses", "coupled_by_impact"])
def test_every_entry_of_two_degrees_of_freedom_is_certified(name):
    found = contimpact.certify(entries_of(name), options=ENTRIES_ALONE)
    assert found.certified, found


def test_contacts_with_a_soft_stop_are_certified():
    """Their flights are of two modes, and a contact vanishes as a whole."""
    found = contimpact.certify(entries_of("soft_stop"), options=ENTRIES_ALONE)
    assert [c.kind for c in found.entries if c.certified] == ["PD", "PD", "V", "G", "V", "FB", "FB"]
    assert [(c.clause, c.found) for c in found.rejected] == [("word", QUIET)]


def test_branches_of_long_flights_are_complete():
    found = proven("bouncing_ball")
    assert found.branches
    assert all(branch.complete for branch in found.branches), found


def test_branches_of_linear_flights_are_complete_but_where_they_cross():
    found = proven("two_stops")
    (crossing,) = (c for c in found.entries if c.kind == "BP")
    for branch in found.branches:
        assert not branch.refuted
        assert branch.share > 0.9998
        for piece in branch.unproven:
            assert piece.what == f"branches cross there, at {crossing.id}"
            assert abs(piece.end - piece.start) < 2e-5


def test_branches_of_two_degrees_of_freedom_are_proven():
    branch = proven("impact_damper").branches[0]
    assert not branch.refuted
    assert branch.complete, branch.lines()


def test_long_flights_take_few_cells(monkeypatch):
    """A ball that flies over two periods: rates enclosed on a whole flight are far too large."""
    diagram, calls = diagram_of("bouncing_ball"), []
    real = touches.Flying.local
    monkeypatch.setattr(
        touches.Flying, "local", lambda self, s, u: calls.append(u) or real(self, s, u)
    )
    (branch,) = contimpact.certify(diagram).branches
    assert len(calls) < 150 * branch.tubes  # 4700 of them when tubes were cut first


# It can fail.


@pytest.mark.parametrize("name", KINDS)
def test_wrong_statements_are_rejected_where_they_are(name):
    for entry in entries_of(name)[:3]:
        shifted = {**entry.parameters, entry.parameter: entry.value + 1e-9}
        wrong = dataclasses.replace(entry, parameters=shifted)
        assert certified(wrong).clause in ("value", "existence")
        assert certified(dataclasses.replace(entry, ghost=not entry.ghost)).clause == "ghost"
        more = dataclasses.replace(entry, n_unstable=entry.n_unstable + 1)
        assert certified(more).clause == "stability"


@pytest.mark.parametrize("name", ["bouncing_ball", "two_stops"])
def test_deleted_and_invented_events_are_found(name):
    diagram, found = diagram_of(name), proven(name)
    certificates = {c.id: c for c in found.entries}
    for branch, record in zip(diagram.branches, found.branches, strict=True):
        for gone in [e for e in branch.events if e.kind in record.kinds]:
            others = [e for e in branch.events if e.id != gone.id]
            (piece,) = verified_branch(branch, record, others, certificates).missing
            low, high = sorted((piece.start, piece.end))
            assert low - 1e-3 <= gone.value <= high + 1e-3
            away = {**gone.parameters, gone.parameter: 0.999 * gone.value}
            invented = dataclasses.replace(gone, id="e99", parameters=away)
            assert not certified(invented).certified
