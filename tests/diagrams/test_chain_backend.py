"""Orbits of several coordinates on block-cyclic elimination against dense linear algebra."""

from __future__ import annotations

import functools
import importlib.util
import math
from pathlib import Path

import numpy as np
import pytest

from contimpact.bifurcations.kind import test_functions as functions_of
from contimpact.continuation.corrector import DenseSystem, next_tangent, orientation
from contimpact.continuation.settings import Settings
from contimpact.continuation.step import HEAD
from contimpact.continuation.walk import walk
from contimpact.diagrams.chain_backend import ChainBackend
from contimpact.diagrams.orbit_walks import backend_of, walk_orbits
from contimpact.orbits.problem import CyclicBlocks, Linearisation
from contimpact.orbits.search import find_orbits
from contimpact.orbits.status import with_arrival_rates
from contimpact.results.catalogue import load_diagram
from contimpact.results.scene import load_scene

integrated = pytest.mark.skipif(
    importlib.util.find_spec("heyoka") is None, reason="needs contimpact[ode]"
)
needs_llvmlite = pytest.mark.skipif(
    importlib.util.find_spec("llvmlite") is None, reason="the extra 'fast' is not installed"
)
SHIPPED = Path(__file__).parents[2] / "branches"


@functools.cache
def shipped(name, word, **changes):
    scene = load_scene(SHIPPED / name / "scene.toml")
    model = scene.model.replace(**changes)
    return find_orbits(model, word, parameter=scene.parameter, starts=16, rounds=1)[0]


ORBITS = {
    "one mode, forced": ("impact_duffing", "UD", 1.5, True),
    "free period, lost directions": ("coco_piecewise", "LR", 1.3, True),
    "flights that leave their modes at once": ("coco_piecewise", "LR", 1.3, False),
    "jumps of the gap coordinate": ("coco_bang_bang", "NP", 0.95, True),
    "one coordinate, free period": ("belt_free", "SP", 1.0, True),
    "modes of different dimension": ("coco_stick_slip", "IR", 0.6, True),
}
"""Scenes, words, about which value of the scene's parameter their orbits are, and if physical."""


def exported(kind):
    """An orbit of an exported branch: it need not be searched for."""
    name, word, value, physical = ORBITS[kind]
    branches = load_diagram(SHIPPED / name).branches
    branch = next(b for b in branches if b.word == word and np.any(b.physical == physical))
    rows = np.flatnonzero((branch.physical == physical) & (branch["event"] == ""))
    return branch.orbit(int(rows[np.argmin(np.abs(branch[branch.parameter][rows] - value))]))


def observed(backend, z, row):
    """The tangent and the orientation of a point, and its block."""
    evaluate, solve, tangent_at, observe = backend.functions
    orbit, n = backend.lists, len(z)
    largest = evaluate(orbit, z.tolist())
    step, tangent = z.tolist(), [0.0] * n
    assert solve(orbit, row.tolist(), 0.3, step)
    scale = backend.problem.scale(z, 1.0).tolist()
    orientation = tangent_at(orbit, z.tolist(), row.tolist(), scale, tangent)
    head = [orientation, 0.0, 1.0]
    numbers = [*z.tolist(), *tangent, *head, *[0.0] * backend.recorded]
    observe(orbit, z.tolist(), tangent, orientation, numbers, 2 * n + HEAD)
    return largest, np.array(step), backend.block(np.array([numbers]))


def with_own_rates(here):
    """The same with the velocities of the orbit's own unknowns as the rates of arrivals."""
    end = with_arrival_rates(here.end, here.problem.arrivals, here.unknowns.tolist(), here.span)
    blocks = CyclicBlocks(here.residual, here.start, end, here.by_parameter)
    return Linearisation(here.problem, here.unknowns, blocks)


@integrated
@pytest.mark.full
@pytest.mark.parametrize("kind", ORBITS)
def test_points_against_dense_matrices(kind):
    orbit = exported(kind)
    problem, rng = orbit.problem, np.random.default_rng(0)
    backend = ChainBackend(problem, gaps=True, doubling=True)
    scale = problem.scale(orbit.unknowns, 1.0)
    backend.lists.units[:] = problem.residual_sizes(scale).tolist()
    for off in (0.0, 1e-3, 1e-2):
        z = orbit.unknowns + off * scale * rng.normal(size=len(scale))
        row = rng.normal(size=len(z)) / scale
        dense, step = DenseSystem(problem, scale), z.tolist()
        residual = dense.evaluate(z.tolist())
        assert dense.solve(row.tolist(), 0.3, step)
        here, sizes = dense.here, problem.scale(z, 1.0)
        largest, found, block = observed(backend, z, row)
        assert largest == pytest.approx(residual, rel=1e-12, abs=1e-15)
        assert (found - step) / scale == pytest.approx(0.0, abs=1e-9 * (1.0 + max(np.abs(step))))
        jacobian, near = with_own_rates(here).jacobian, {"rel": 1e-8, "abs": 1e-10}
        tangent = next_tangent(jacobian, row, sizes)
        sign = orientation(jacobian, tangent, sizes)
        assert block.tangents[0] / sizes == pytest.approx(tangent / sizes, **near)
        assert block.described[0] == pytest.approx(here.numbers, rel=1e-7, abs=1e-9, nan_ok=True)
        measured, stability = block.measured, here.stability
        assert measured.spans[0] == pytest.approx(here.span, rel=1e-15)
        assert measured.products[0] == pytest.approx(stability.products, rel=1e-7, abs=1e-9)
        scaled = (block.orientations[0], sign), (measured.doubling[0], stability.doubling)
        for one, other in scaled:  # by norms of rows, which beside the orbit have other rates
            assert one == pytest.approx(other, rel=1e-12) if off == 0.0 else one * other > 0.0
        gaps = [[math.nan if t is None else t.gap for t in flight.touches] for flight in here.gaps]
        assert measured.gaps[0] == pytest.approx(np.array(gaps), rel=1e-12, nan_ok=True)


@integrated
@pytest.mark.parametrize(("al", "ga"), [(1.0, 1.5), (0.3, 0.7)])
@pytest.mark.quick(1)
def test_the_circle_on_both_sides(al, ga):
    """With be = 1 both fields have the circle r = 1. On the left dr/dphi = (1 - r) r, on the right
    al (1 - r) r/(1 + ga - r): half a turn on each makes period and multiplier."""
    orbit = shipped("coco_piecewise", "LR", al=al, ga=ga, be=1.0)
    backend = backend_of(orbit.problem, functions_of(orbit.problem, ["PD"], {}))
    assert isinstance(backend.whole, ChainBackend)
    _, _, block = observed(backend.whole, orbit.unknowns, np.ones(len(orbit.unknowns)))
    assert block.measured.spans[0] == pytest.approx(math.pi * (1.0 + 1.0 / ga), rel=1e-13)
    here = block.point(0).evaluation
    assert len(here.multipliers) == 3
    assert here.multipliers[0] == pytest.approx(math.exp(-math.pi * (1.0 + al / ga)), rel=1e-11)
    assert not np.any(here.multipliers[1:])


def walked(orbit, walk, **about):
    """A walk across an orbit."""
    problem, value = orbit.problem, float(orbit.unknowns[-1])
    return walk(
        problem,
        orbit.unknowns,
        1,
        tests=functions_of(problem, ("FB", "BP", "PD", "NS", "G", "V"), {}),
        limits=(0.97 * value, 1.03 * value),
        settings=Settings(step=0.01, max_step=0.01, max_angle=1.0),
        **about,
    )


@functools.cache
def densely_walked(kind):
    orbit = exported(kind)
    return walked(orbit, walk, parameter=orbit.problem.parameter)


@integrated
@pytest.mark.full
@pytest.mark.parametrize("kind", ORBITS)
@pytest.mark.parametrize("compiled", ["never", pytest.param("always", marks=needs_llvmlite)])
def test_walks_against_dense_matrices(kind, compiled, monkeypatch):
    dense = densely_walked(kind)
    monkeypatch.setenv("CONTIMPACT_COMPILED", compiled)
    chain = walked(exported(kind), walk_orbits)
    assert chain.end == dense.end
    assert len(chain.points) == len(dense.points)
    for one, other in zip(chain.points, dense.points, strict=True):
        assert one.unknowns == pytest.approx(other.unknowns, rel=1e-9, abs=1e-9)
        assert one.evaluation.numbers == pytest.approx(
            other.evaluation.numbers, rel=1e-6, abs=1e-8, nan_ok=True
        )
    assert [e.kind for e in chain.events] == [e.kind for e in dense.events]
