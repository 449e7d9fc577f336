"""A continuation problem given by functions of the unknowns, for tests of the walk alone."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import pytest

from contimpact.continuation.branch import EndKind
from contimpact.continuation.settings import Settings
from contimpact.continuation.walk import walk

EPSILON = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Values:
    """An evaluation."""

    unknowns: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray


@dataclass
class Algebraic:
    """n equations in n + 1 unknowns, as functions of the unknowns; the parameter is last."""

    equations: object
    derivatives: object
    evaluations: int = 0

    def evaluate(self, unknowns):
        self.evaluations += 1
        return Values(
            unknowns,
            np.atleast_1d(np.array(self.equations(*unknowns.tolist()), dtype=float)),
            np.atleast_2d(np.array(self.derivatives(*unknowns.tolist()), dtype=float)),
        )

    def scale(self, unknowns, span):
        return np.ones(len(unknowns))

    def difference(self, one, other):
        return one - other


def follow(problem, start, direction=1, limits=(-2.0, 2.0), **options):
    """Walk, and check what holds on every walk."""
    found = walk(
        problem, np.array(start, dtype=float), direction, parameter="p", limits=limits, **options
    )
    check(found, options.get("settings") or Settings())
    return found


def check(found, settings):
    """Residuals, step lengths, angles, order of points and events, and bounded effort."""
    points = found.points
    closed = found.end.kind is EndKind.CLOSED
    assert len(points) <= settings.max_points
    for point in points:
        here = point.evaluation
        rounding = 8.0 * EPSILON * np.max(np.abs(here.jacobian) @ np.abs(here.unknowns))
        assert np.max(np.abs(here.residual)) <= settings.tolerance + rounding
        assert point.iterations <= settings.max_iterations
        assert np.linalg.norm(point.tangent) == pytest.approx(1.0, rel=1e-14)
    for one, other in itertools.pairwise(points):
        chord = np.linalg.norm(other.unknowns - one.unknowns)
        assert other.arclength - one.arclength == pytest.approx(chord, rel=1e-9, abs=1e-14)
        # the tangent step, lengthened by a correction perpendicular to it
        assert 0.0 < chord <= settings.max_step / math.cos(settings.max_angle)
        turned = np.clip(one.tangent @ other.tangent, -1.0, 1.0)
        assert math.acos(turned) <= settings.max_angle + 1e-7
    distinct = points[:-1] if closed else points
    if len(distinct) > 1:
        z = np.array([point.unknowns for point in distinct])
        apart = np.linalg.norm(z[:, None] - z[None], axis=2) + np.eye(len(z))
        assert np.min(apart) > 1e-9
    places = [event.point.arclength for event in found.events]
    assert places == sorted(places)
    if places:
        assert 0.0 <= places[0] <= places[-1] <= points[-1].arclength + 1e-12
