"""Sums over many harmonics, which kernels make in a loop, against the same written out."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest

from contimpact import ImpactPair, continue_orbit, find_orbits
from contimpact.models import symbols
from contimpact.segments import codegen, segment
from contimpact.segments.bounded import bounds_of_kernel, many_digits
from contimpact.segments.kernel import flat
from contimpact.segments.kernels import Kernels
from contimpact.segments.segment import ARRAYS, evaluate_in

MANY = "+".join(f"cos({k}*pi*t+{k})*{0.6**k}" for k in range(1, 10))
KINDS = ["BB", "BT"]
P0 = [0.3, 0.7, 1.9, -0.4]


@pytest.fixture(scope="module")
def written_out(tmp_path_factory):
    """Kernels of the same model with their sums written out."""

    @functools.cache
    def kernels(*parameters):
        with pytest.MonkeyPatch.context() as m:
            m.setenv("CONTIMPACT_CACHE", str(tmp_path_factory.mktemp("cache")))
            m.setattr(symbols, "WRITTEN_OUT", 100)
            found = Kernels(rich(), *parameters)
            for kind in KINDS:
                assert "waves(" not in found.flight(*kind).text
            found.motion("B")
        return found

    return kernels


def rich():
    return ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.36, forcing=MANY)


def looped(*parameters):
    kernels = Kernels(rich(), *parameters)
    assert kernels.flight("B", "T").text.count("waves(") == 1
    return kernels


def close(one, other, tolerance=1e-14):
    one, other = (np.array(flat(x), dtype=float) for x in (one, other))
    np.testing.assert_allclose(one, other, rtol=0, atol=tolerance * max(1.0, np.max(np.abs(other))))


@pytest.mark.parametrize("parameters", [("s",), ("omega", "r")])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.full
def test_a_loop_is_the_sum(written_out, parameters, kind):
    one, other = looped(*parameters), written_out(*parameters)
    p = list(one.model.values.values())
    along = [0.3, -0.2, 0.9, 0.4, *(0.7 for _ in parameters)]
    for late in (0.0, 40.0, 1e3):
        ends = [P0[0] + late, P0[1], P0[2] + late, P0[3]]
        close(one.flight(*kind)(*ends, *p), other.flight(*kind)(*ends, *p), 1e-11)
        close(one.second(*kind)(*ends, *along, *p), other.second(*kind)(*ends, *along, *p), 1e-10)
    close(one.motion("B")(0.2, 0.7, 1.3, *p), other.motion("B")(0.2, 0.7, 1.3, *p))
    close(one.third("B", "B")(*P0, *along[:4], *p), other.third("B", "B")(*P0, *along[:4], *p))


@pytest.mark.parametrize("large", [0, codegen.LARGE])
@pytest.mark.full
def test_a_loop_on_a_tape(written_out, monkeypatch, tmp_path, large):
    """Where formulas are long, derivatives are taken step by step."""
    monkeypatch.setenv("CONTIMPACT_CACHE", str(tmp_path / "tape"))
    monkeypatch.setattr(codegen, "LARGE", large)
    one, p = looped("omega"), list(rich().values.values())
    close(one.flight("B", "T")(*P0, *p), written_out("omega").flight("B", "T")(*P0, *p))


@pytest.mark.parametrize("at_once", [segment.AT_ONCE, 100])
def test_a_loop_over_arrays_of_any_shape(monkeypatch, at_once):
    """Several harmonics at once, or one after the other where the arrays are large."""
    monkeypatch.setattr(segment, "AT_ONCE", at_once)
    kernels = looped("s")
    p = list(kernels.model.values.values())
    dt = np.linspace(0.01, 3.0, 24)
    track = kernels.motion("B")
    plain = np.array([track(0.2, 0.7, t, *p) for t in dt.tolist()]).T
    for shape in ((24,), (4, 6), (1, 24), (2, 3, 4)):
        found = evaluate_in(track, ARRAYS)(0.2, 0.7, dt.reshape(shape), *p)
        assert [x.shape for x in found] == [shape] * 3
        np.testing.assert_allclose(np.reshape(found, (3, -1)), plain, rtol=0, atol=1e-14)
    assert np.shape(evaluate_in(track, ARRAYS)(0.2, 0.7, 1.3, *p)[0]) == ()


def test_small_arrays_take_all_harmonics_in_one_pass():
    rows = tuple((float(k), 0.0, 1.0) for k in range(1, 38))
    passes = list(ARRAYS.names["waves"](rows, np.zeros(64), np.ones(64)))
    assert len(passes) == 1
    assert [row.shape for row in passes[0]] == [(37, 1)] * 3


def test_a_loop_in_many_digits_and_within_its_bounds():
    import mpmath

    ctx = mpmath.mp.clone()
    ctx.dps = 40
    kernel = looped("s").flight("B", "T")
    p = list(rich().values.values())
    given = [ctx.mpf(x) for x in (*P0, *p)]
    exact = flat(evaluate_in(kernel, many_digits(ctx))(*given))
    values, errors = (flat(part) for part in bounds_of_kernel(kernel, [*P0, *p]))
    for value, error, true in zip(values, errors, exact, strict=True):
        assert abs(float(value - true)) <= error < 1e-12


@pytest.mark.full
def test_derivatives_of_a_loop():
    """Against differences of the residual in many digits."""
    import mpmath

    ctx = mpmath.mp.clone()
    ctx.dps = 40
    kernel = evaluate_in(looped("A").flight("T", "B"), many_digits(ctx))
    values = rich().values
    given = [ctx.mpf(x) for x in (*P0, *values.values())]
    _, start, end, free = kernel(*given)
    h = ctx.mpf(10) ** -13
    columns = [0, 1, 2, 3, 4 + list(values).index("A")]
    for i in range(2):
        for place, column in enumerate(columns):
            moved = [x + h * (j == column) for j, x in enumerate(given)]
            back = [x - h * (j == column) for j, x in enumerate(given)]
            slope = (kernel(*moved)[0][i] - kernel(*back)[0][i]) / (2 * h)
            row = [*start[2 * i : 2 * i + 2], *end[2 * i : 2 * i + 2], free[i]]
            assert abs(slope - row[place]) < 1e-20 * max(1, abs(slope)) + 1e-20


@pytest.mark.slow
def test_a_branch_with_many_harmonics_compiled_and_plain(monkeypatch):
    pytest.importorskip("llvmlite")
    found = {}
    for mode in ("never", "always"):
        monkeypatch.setenv("CONTIMPACT_COMPILED", mode)
        orbit = find_orbits(rich(), "1:1", parameter="s")[0]
        found[mode] = continue_orbit(orbit, "s", (0.35, 0.37), events=["FB", "PD", "G"])
    plain, compiled = found["never"], found["always"]
    assert len(plain) == len(compiled)
    np.testing.assert_allclose(plain["s"], compiled["s"], rtol=1e-12)
    assert [e.kind for e in plain.events] == [e.kind for e in compiled.events]


@pytest.mark.full
def test_a_rich_forcing_is_derived_as_fast_as_few_harmonics(pair):
    """The text does not grow but for the table of harmonics."""
    few, many = (
        Kernels(pair(forcing=f), "s").flight("B", "T").text
        for f in ("+".join(f"cos({k}*pi*t)/{k}" for k in range(1, n)) for n in (10, 60))
    )
    assert many.count("\n") - few.count("\n") == 50
    assert len(many.splitlines()) < 130
    assert many.count("stumpffs5") == 1
