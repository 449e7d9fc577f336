"""Long flights in pieces: what the whole flight is, where that can be told, and where it cannot."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import contimpact as ci
from contimpact.accuracy.reference import Reference
from contimpact.continuation.branch import EndKind
from contimpact.models.guards import Word
from contimpact.orbits.quiet import problem_of
from contimpact.orbits.search import orbit_at
from contimpact.results.branch import orbit_with
from contimpact.results.scene import read_scene
from contimpact.segments import kernel
from contimpact.segments.integrated_form import (
    MOST_PIECES,
    SIZE,
    IntegratedFlight,
    Shooting,
    SplitFailure,
    growth,
)
from contimpact.segments.kernel import CombinedBlocks
from contimpact.segments.kernels import Kernels
from contimpact.systems.duffing import Duffing
from contimpact.systems.pendulum import Pendulum

pytest.importorskip("heyoka", reason="needs contimpact[ode]")

VALUES = {"a": 1.0, "omega": 0.8, "c": 0.1, "sigma": 3.1, "r": 0.8}
NEAR = [3.6340, 0.1536, 0.8]


@pytest.fixture(scope="module")
def kernels():
    return Kernels(Pendulum(**VALUES), "omega")


def both(monkeypatch, kernels, ask):
    """What a segment answers as a whole, and in pieces."""
    segment, values = kernels.segment("S", "S"), list(VALUES.values())
    answers = []
    for long in (math.inf, 0.0):
        monkeypatch.setattr(kernel, "LONG", long)
        answers.append(ask(segment, values))
    return answers


def matrices(blocks):
    return [np.reshape(part, (2, -1)) for part in blocks]


def test_rows_are_combinations_of_those_of_the_whole_flight(monkeypatch, kernels):
    """At ends that a flight joins, of which the second is flown to."""
    whole, pieces = both(monkeypatch, kernels, lambda s, p: s.blocks(*joined(kernels), p))
    assert isinstance(pieces, CombinedBlocks)
    (r, *one), (q, *other) = matrices(whole), matrices(pieces)
    assert np.max(np.abs(r)) < 1e-12
    assert np.max(np.abs(q)) < 1e-14 * SIZE
    one, other = np.hstack(one), np.hstack(other)
    turned = np.linalg.lstsq(one.T, other.T, rcond=None)[0]
    assert np.linalg.det(turned) > 0.0
    assert one.T @ turned == pytest.approx(other.T, abs=1e-11 * SIZE)


def test_higher_derivatives_vanish_together(monkeypatch, kernels):
    """Along a direction in which the ends stay joined, second ones are those of the whole."""
    start, end = joined(kernels)
    blocks = kernels.segment("S", "S").blocks(start, end, list(VALUES.values()))
    _, *parts = matrices(blocks)
    null = np.linalg.svd(np.hstack(parts))[2][2:]
    along = (null[0] + 0.3 * null[1]).tolist()
    one, other = both(monkeypatch, kernels, lambda s, p: s.second(start, end, along, p))
    first = both(monkeypatch, kernels, lambda s, p: s.blocks(start, end, p))
    wholes, pieces = (np.hstack(matrices(each)[1:]) for each in first)
    turned = np.linalg.lstsq(wholes.T, pieces.T, rcond=None)[0].T
    (_, *changes), (_, *same) = matrices(one), matrices(other)
    size = np.max(np.abs(turned @ np.hstack(changes)))
    for e in null:  # the rows themselves turn, but by nothing where they vanish
        assert np.hstack(same) @ e == pytest.approx(
            turned @ np.hstack(changes) @ e, abs=1e-8 * size
        )


def joined(kernels):
    """Ends that a flight of the pendulum joins: those of a periodic one."""
    problem = problem_of(Pendulum(**VALUES), Word("S", 1), kernels)
    t, v, _ = orbit_at(problem, np.array(NEAR)).unknowns.tolist()
    return [t, v], [t + 2.0 * math.pi / VALUES["omega"], v]


def upright(omega):
    """A pendulum that is carried about its upright position; the flight takes a period."""
    model = Pendulum(a=0.3, omega=omega, c=0.1, sigma=4.5, r=0.8)
    problem = problem_of(model, Word(""), Kernels(model, "omega"))
    return orbit_at(problem, answer(omega))


def answer(omega, waves=24, points=96):
    """The same orbit as a sum of harmonics: its state at t = 0, by collocation."""
    t = np.arange(points) * 2.0 * np.pi / points
    orders = np.arange(1, waves + 1)
    columns = [np.ones(points), *np.cos(np.outer(orders, t)), *np.sin(np.outer(orders, t))]
    rates = np.concatenate([[0.0], orders, orders]) * omega
    basis = np.array(columns).T
    slopes = np.zeros_like(basis)
    slopes[:, 1 : waves + 1] = -np.sin(np.outer(t, orders)) * rates[1 : waves + 1]
    slopes[:, waves + 1 :] = np.cos(np.outer(t, orders)) * rates[waves + 1 :]
    linear = -basis * rates**2 + 0.1 * slopes
    found = np.zeros(2 * waves + 1)  # of the angle from upright
    for _ in range(20):
        off = linear @ found - np.sin(basis @ found) - 0.3 * np.cos(t)
        matrix = linear - np.cos(basis @ found)[:, None] * basis
        found -= np.linalg.lstsq(matrix, off, rcond=None)[0]
    return np.array([np.pi + basis[0] @ found, slopes[0] @ found, omega])


@pytest.mark.parametrize("omega", [0.3, 0.1])
@pytest.mark.quick(1)
def test_orbits_that_no_integration_from_their_start_returns(omega):
    """Their multipliers are 1e9 and 1e26: the state after a period is not that of the start."""
    orbit = upright(omega)
    assert orbit.unknowns[:2] == pytest.approx(answer(omega)[:2], abs=1e-13)
    assert orbit.residual < 1e-11
    assert orbit.physical
    large, small = np.abs(orbit.multipliers)
    assert large > 1e8
    span = 2.0 * math.pi / omega
    assert large * small == pytest.approx(math.exp(-0.1 * span), rel=1e-11)
    path = orbit.motion(9)
    assert path.x[[0, -1], 0] == pytest.approx(orbit.unknowns[0], abs=1e-12)
    assert np.max(np.abs(path.x - math.pi)) < 0.4


def test_states_between_are_those_of_least_squares(monkeypatch, kernels):
    """Against the whole matrix: -1 on the diagonal, the derivatives of the next piece below it."""
    _, split = both(monkeypatch, kernels, lambda s, p: s.pieces(*joined(kernels), p))
    pieces = split.pieces
    count = len(pieces.states)
    assert count > 3
    matrix = -np.eye(2 * count)[:, :-2]
    for j, factor in enumerate(pieces.factors[1:]):
        matrix[2 * j + 2 : 2 * j + 4, 2 * j : 2 * j + 2] = factor
    right = np.random.default_rng(0).normal(size=(count, 2))
    expected = np.linalg.lstsq(matrix, right.ravel(), rcond=None)[0]
    assert pieces.least(list(right)).ravel() == pytest.approx(expected, rel=1e-11)


def test_no_more_pieces_are_solved_for_than_there_may_be(monkeypatch, kernels):
    """Nothing is computed of a guess of too many: elimination would take minutes."""
    _, split = both(monkeypatch, kernels, lambda s, p: s.pieces(*joined(kernels), p))
    pieces, asked = split.pieces, []
    many = np.linspace(0.0, 1.0, MOST_PIECES + 2)
    states = np.tile(pieces.states[0], (MOST_PIECES + 1, 1))
    shooting = Shooting(pieces.flight, states[0], pieces.arrival, np.zeros(2))
    monkeypatch.setattr(Shooting, "_guess", lambda self: (many, states, True))
    monkeypatch.setattr(IntegratedFlight, "fly", lambda *place: asked.append(place))
    with pytest.raises(SplitFailure, match=f"more than {MOST_PIECES} pieces"):
        shooting.solve()
    assert not asked


@pytest.mark.slow
def test_multipliers_in_many_digits():
    """Of 1.4e5 and 2e-6, all digits of their own."""
    orbit = upright(0.5)
    reference = Reference(orbit.problem, 40)
    exact = reference.orbit(orbit.unknowns)
    assert exact.distance(orbit.unknowns) < 1e-15
    expected = [complex(m).real for m in reference.multipliers(exact.unknowns)]
    assert expected[0] > 1e5
    assert orbit.multipliers.real == pytest.approx(expected, rel=1e-13)


@pytest.mark.full
def test_branches_end_at_homoclinic_orbits():
    """Of a Duffing oscillator in one of its wells; the multiplier is r^2 exp(-c T)."""
    values = {"a": 0.0, "omega": 1.0, "alpha": -1.0, "beta": 1.0, "sigma": 1.2, "r": 0.8}
    model = Duffing(c=-0.05, **values, period="free")
    found = ci.find_orbits(model, "S", parameter="c", starts=16, rounds=1)
    orbit = next(o for o in found if o.physical)
    branch = ci.continue_orbit(orbit, "c", (-0.3, -0.04), events=[])
    (end,) = (end for end in branch.ends if end.kind is EndKind.FOR_EVER)
    assert "c changes no more" in end.message
    assert branch["period"].max() > 30.0
    expected = 0.64 * np.exp(-branch["c"] * branch["period"])
    assert branch["multiplier1_re"] == pytest.approx(expected, rel=1e-9)
    assert end.value == pytest.approx(homoclinic(), abs=1e-13)


def homoclinic():
    """The damping at which the way out of the saddle and the way into it meet at the stop."""

    def speed(c, way):
        """At the stop, of the way that leaves the saddle (1), or leads to it (-1)."""
        rate = 0.5 * (-c + way * math.sqrt(c * c + 4.0))
        small = 1e-8

        def stop(t, y):
            return y[0] - 1.2

        stop.terminal = True
        options = {"method": "DOP853", "rtol": 2.5e-14, "atol": 1e-22, "events": stop}
        law = lambda t, y: [y[1], y[0] - y[0] ** 3 - c * y[1]]  # noqa: E731
        found = solve_ivp(law, (0.0, way * 60.0), [small, small * rate], **options)
        return found.y[1, -1]

    return brentq(lambda c: 0.8 * speed(c, 1) + speed(c, -1), -0.1, -0.06, xtol=1e-15)


LIMIT_CYCLE = {
    "system": "hybrid",
    "period": "2*pi",
    "parameters": {"mu": 0.9},
    "define": {"pull": "x - x**3 - 0.5*(mu - x)*v"},
}
LARGEST = (1.3730187894, 5.79420984)
"""Largest x and period of the limit cycle at mu = 0.9, by DOP853."""


def branch_of_cycle(guards, modes, word, passages, tolerance):
    modes = {mode: {"x": "v", "v": "pull"} for mode in modes}
    table = LIMIT_CYCLE | {"modes": modes, "guards": guards}
    follow = {"parameter": "mu", "range": [0.5, 1.2], "orbits": ["0"]}
    model = read_scene({"name": "cycle", "model": table, "follow": follow}).model
    orbit = orbit_with(model, (word, 0), "mu", np.array([*passages, 0.9]))
    settings = ci.Settings(tolerance=tolerance)
    return ci.continue_orbit(orbit, "mu", (0.5, 0.95), events=[], settings=settings)


def pull(x, mu=0.9, v=0.0):
    return x - x**3 - 0.5 * (mu - x) * v


def test_a_long_orbit_without_impacts_says_what_would_divide_it():
    """It comes near to the saddle half way: differences decay, and then grow as much again. Points
    are as accurate as rounding lets so long a flight be."""
    guard = {"S": {"within": "x <= 3", "set": {"v": "-v"}}}
    branch = branch_of_cycle(guard, ["free"], "", LARGEST, 1e-10)
    (end,) = (end for end in branch.ends if end.kind is EndKind.FOR_EVER)
    assert "two modes of its law, with guards at v = 0, would divide it" in end.message
    assert end.value == pytest.approx(saddle_loop(), abs=2e-6)


@pytest.mark.slow
def test_guards_at_rest_divide_a_long_orbit():
    """The branch goes on to the homoclinic orbit, to 13 digits."""
    guards = {
        "A": {"mode": "right", "within": "v >= 0", "to": "left"},
        "B": {"mode": "left", "within": "v <= 0", "to": "right"},
    }
    x, period = LARGEST

    def turns(t, y):
        return y[1]

    turns.direction = 1.0
    law = lambda t, y: [y[1], pull(y[0], v=y[1])]  # noqa: E731
    half = solve_ivp(law, (0.0, period), [x, 0.0], "DOP853", rtol=1e-12, atol=1e-13, events=turns)
    time, least = half.t_events[0][-1], half.y_events[0][-1][0]
    passages = [-period, pull(x), x, 0.0, time - period, pull(least), least, 0.0]
    branch = branch_of_cycle(guards, ["right", "left"], "AB", passages, 1e-12)
    ends = [end for end in branch.ends if end.kind is EndKind.FOR_EVER]
    assert all("mu changes no more" in end.message for end in ends)
    assert [end.value for end in ends] == pytest.approx([saddle_loop()] * len(ends), abs=2e-13)
    assert ends
    assert branch["period"].max() > 38.0


def saddle_loop():
    """Where the ways out of the saddle and into it meet at rest."""

    def reached(mu, way):
        rate = 0.5 * (-0.5 * mu + way * math.sqrt(0.25 * mu * mu + 4.0))

        def turns(t, y):
            return y[1]

        turns.terminal = True
        options = {"method": "DOP853", "rtol": 2.5e-14, "atol": 1e-22, "events": turns}
        law = lambda t, y: [y[1], pull(y[0], mu, y[1])]  # noqa: E731
        return solve_ivp(law, (0.0, way * 60.0), [1e-7, 1e-7 * rate], **options).y[0, -1]

    return brentq(lambda mu: reached(mu, 1) - reached(mu, -1), 0.8, 0.87, xtol=1e-15)


@pytest.mark.slow
def test_a_branch_goes_on_where_flights_become_long():
    """A stop just short of upright: from whole flights to those in pieces."""
    orbits = ci.find_orbits(Pendulum(**VALUES), "S", parameter="omega", starts=20, rounds=1)
    start = min(orbits, key=lambda orbit: abs(orbit.velocities[0] - 0.1536))
    branch = ci.continue_orbit(start, "omega", (0.35, 0.82), events=["PD"])
    assert [end.kind for end in branch.ends] == [EndKind.RANGE] * 2
    assert np.max(np.abs(branch["multiplier1_re"])) > 1e4
    assert np.max(branch["residual"]) < 1e-11
    product = branch["multiplier1_re"] * branch["multiplier2_re"]
    expected = 0.64 * np.exp(-0.1 * 2.0 * math.pi / branch["omega"])
    long = np.abs(branch["multiplier1_re"]) > 2e3
    assert product[long] == pytest.approx(expected[long], rel=1e-9)


def test_growth_is_the_same_in_any_units_of_two_coordinates():
    """What one coordinate does to another's, in units of its own, is none."""
    factor = np.array([[0.9, 0, 0.3, 0], [1e4, 0.5, 0, 0.2], [-0.3, 0, 0.8, 0], [0, 0, 2e3, 0.4]])
    found = growth(factor)
    assert found < 2.0
    units = 2.0 ** np.array([0, 30, 10, 40])
    assert growth(factor * (units / units[:, None])) == pytest.approx(found, rel=0.5)
