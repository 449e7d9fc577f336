"""Bounds of rounding errors by scalar code: those of `bounded`, kernel by kernel."""

from __future__ import annotations

import math

import numpy as np
import pytest

from contimpact import ImpactPair
from contimpact.segments.bounded import BOUNDED, BoundedNumber, bounded_kernel, bounds_of_kernel
from contimpact.segments.kernel import Setup, flat, refill
from contimpact.segments.kernels import Kernels
from contimpact.segments.segment import evaluate_in
from contimpact.systems.soft_stop import SoftStop

MODELS = {"impact pair": (ImpactPair(beta=math.pi / 3, r=0.55, A=9.0, s=0.5), "s")}
SOFT = {"a": 1.0, "omega": 2.0, "c": 0.1, "k": 1.0, "e": 0.5, "k_b": 20.0, "c_b": 0.3}
MODELS["soft stop"] = SoftStop(**SOFT), "omega"


def bounds_as_objects(kernel, arguments):
    """By numbers with errors, operation by operation."""
    found = evaluate_in(kernel, BOUNDED)(*map(BoundedNumber, arguments))
    parts = [BoundedNumber.of(x) for x in flat(found)]
    return [refill(found, [getattr(x, name) for x in parts]) for name in ("value", "error")]


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.full
def test_bounds_are_those_of_numbers_with_errors(name):
    model, parameter = MODELS[name]
    kernels = Kernels(model, parameter)
    values = list(model.values.values())
    random, walls = np.random.default_rng(5), model.letters
    for kernel in [kernels.flight(a, b) for a in walls for b in walls]:
        for _ in range(5):
            t0, v0, dt, v1 = random.uniform(0.1, 1.5, 4).tolist()
            arguments = [t0, v0, t0 + dt, v1, *values]
            found = flat(bounded_kernel(kernel)(*[(x, 0.0) for x in arguments]))
            numbers, errors = map(flat, bounds_as_objects(kernel, arguments))
            assert found[::2] == pytest.approx(numbers, rel=1e-14, abs=1e-300)
            assert found[1::2] == pytest.approx(errors, rel=1e-6, abs=1e-300)


def test_one_result_is_computed_alone():
    model, parameter = MODELS["soft stop"]
    setup, values = Kernels(model, parameter).setup, list(model.values.values())
    period = bounded_kernel(setup, Setup._fields.index("period"))
    assert "p_e, p_e" in bounded_kernel(setup).source
    assert "p_e, p_e" not in period.source
    number, error = bounds_as_objects(setup, values)
    assert bounds_of_kernel(setup, values) == (number, error)
    assert period(*[(x, 0.0) for x in values]) == (number.period, error.period)
