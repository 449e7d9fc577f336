"""Manifolds against direct simulation, other arithmetic, and the crisis of Fig. 7."""

from __future__ import annotations

import functools
import math

import numpy as np
import pytest
from scipy.optimize import brentq

from contimpact.errors import InputError
from contimpact.orbits.search import find_orbits
from contimpact.simulation.manifolds import Grower, grow_manifold
from contimpact.simulation.simulator import Simulator
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

FIG7 = 0.355220528250598985031742370212
"""s of the crisis of Fig. 7, in 45 digits; see test_crises."""


def saddle(s=0.3556, word="2:1"):
    """An unstable orbit of the impact pair at Fig. 7's values."""
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=s)
    return next(o for o in find_orbits(model, word, parameter="s") if o.physical and not o.stable)


def oscillating():
    """An unstable orbit of the oscillator, whose acceleration depends on its state."""
    model = Oscillator(a=1.0, omega=2.6, c=0.1, k=1.0, sigma=0.3, r=0.8)
    found = find_orbits(model, "S/2T", parameter="omega")
    return next(o for o in found if o.physical and o.multipliers[0].real > 1.0)


ORBITS = {"2:1": saddle, "1:1, flipping": lambda: saddle(word="1:1"), "oscillator": oscillating}


CASES = [
    pytest.param(make, id=name, marks=[pytest.mark.full] if name != "2:1" else [])
    for name, make in ORBITS.items()
]


@pytest.fixture(scope="module", params=CASES)
def orbit(request):
    return request.param()


@pytest.fixture(scope="module")
def length(orbit):
    """To which manifolds are grown; flights of the oscillator take a millisecond."""
    return 0.1 if isinstance(orbit.model, Oscillator) else 0.6


@pytest.fixture(scope="module")
def grown(orbit, length):
    """``grown(stable)``, each manifold of an orbit once."""

    @functools.cache
    def grow(stable):
        return grow_manifold(orbit, stable=stable, length=length, spacing=length / 150.0)

    return grow


@pytest.fixture(scope="module", params=[False, True], ids=["unstable", "stable"])
def manifold(request, grown):
    return grown(request.param)


def test_points_are_as_dense_and_the_curve_as_long_as_asked_for(manifold, length):
    sides = {(impact, side) for impact in range(len(manifold.orbit.word)) for side in (1, -1)}
    for impact, side in sides:
        own = [p for p in manifold.pieces if (p.impact, p.side) == (impact, side)]
        chords = [np.hypot(np.diff(p.times), np.diff(p.velocities)) for p in own]
        assert max(np.max(c) for c in chords) <= manifold.spacing
        named = f"impact {impact + 1}, side {side:+d}"
        short = [text for text in manifold.shortfalls if named in text]
        assert short or sum(p.length for p in own) >= length
        first = own[0]
        at = manifold.orbit.times[impact] - first.times[0]
        assert math.remainder(at, manifold.grower.period) == pytest.approx(0.0, abs=1e-12)
        assert first.velocities[0] == pytest.approx(manifold.orbit.velocities[impact], abs=1e-12)


def test_the_expansion_is_of_second_order(orbit):
    """What it leaves out is of the third: eight times less at half the distance."""
    for stable in (False, True):
        grower = Grower(orbit, stable)
        end = 1e-3
        ratio = grower._left_out(end) / grower._left_out(0.5 * end)
        assert ratio == pytest.approx(8.0, rel=0.1)


@pytest.mark.full
def test_simulated_motion_leaves_along_the_unstable_manifold(orbit, length, grown):
    """From 1e-7 beside the orbit, along its tangent."""
    found = grown(False)
    grower, simulator = found.grower, Simulator(orbit.model)
    rng, far = np.random.default_rng(1), []
    while len(far) < 8:
        time, velocity = rng.choice([-1e-7, 1e-7]) * grower.growth ** rng.uniform() * grower._along
        laps = math.log(length / 6e-7) / math.log(grower.growth)
        start = simulator.state(
            orbit.word.walls[0], orbit.times[0] + time, orbit.velocities[0] + velocity
        )
        run = simulator.run(start, impacts=int(rng.uniform(0.5, 1.0) * laps) * grower._lap)
        far.append(found.distance(run.word[-1], run.times[-1], run.velocities[-1]))
    assert max(far) < 1e-10


def test_simulated_motion_arrives_along_the_stable_manifold(orbit, length):
    """Where it does not pass a grazing closely, at which the map has no derivative."""
    found = grow_manifold(orbit, stable=True, length=length, spacing=length / 60.0)
    grower, simulator = found.grower, Simulator(orbit.model)
    carried = 0
    for piece in found.pieces:
        for k in range(1, len(piece), 5):
            sigma = float(piece.parameters[k])
            count = int(piece.laps[k]) * grower._lap + -piece.impact % len(orbit.word)
            speeds = [abs(at[3]) for at in grower._paths[sigma][: count + 1]]
            if min(speeds) < 0.02 * max(speeds) or not count:
                continue
            start = simulator.state(piece.wall, piece.times[k], piece.velocities[k])
            run = simulator.run(start, impacts=count)
            _, _, phase, velocity = grower._local(sigma)
            assert math.remainder(run.phases[-1] - phase, run.period) == pytest.approx(0, abs=1e-8)
            assert run.velocities[-1] == pytest.approx(velocity, abs=1e-8)
            carried += 1
    assert carried > 10


def test_flights_backwards_are_the_inverse(orbit):
    grower = Grower(orbit, True)
    rng = np.random.default_rng(2)
    sides = Simulator(orbit.model).sides
    for _ in range(30):
        wall = int(rng.integers(len(sides)))
        at = (wall, 0, rng.uniform(0, grower.period), sides[wall] * rng.uniform(0.2, 0.6))
        before = grower._backward(at)
        if before is None:  # the oscillator may come from farther back than is looked at
            continue
        again = grower._forward(before)
        assert again[:2] == at[:2]
        assert again[2:] == pytest.approx(at[2:], abs=1e-10)


def beyond(s):
    """How far the first corner of the unstable manifold is from the stable one, beside the orbit:
    the image of the motions that just miss the wall, three laps after they come near."""
    orbit = saddle(s)
    leaves, arrives = grow_manifold(orbit, length=0.16), Grower(orbit, True)
    pieces = [p for p in leaves.pieces if (p.impact, p.side) == (1, 1)]
    ends = [
        (p.laps[k], p.parameters[k], p.velocities[k]) for p, k in zip(pieces, (-1, 0), strict=False)
    ]
    assert min(abs(v) for *_, v in ends) < 1e-4  # one of them has just hit
    lap, sigma, _ = max(ends, key=lambda end: abs(end[2]))
    path = leaves.grower._paths[sigma][: int(lap) * 3 + 2]
    for _ in range(24):
        path.append(leaves.grower._forward(path[-1]))
    word = "".join("BT"[at[0]] for at in path)
    first = word.index("BTBTBBTBBTBBT", len(word) - 26) + 10
    _, _, phase, velocity = path[first]
    at = np.array([math.remainder(phase - orbit.times[0], 2.0), velocity - orbit.velocities[0]])
    sigma = at @ arrives._along
    (a, b), (c, d) = arrives._along, at - sigma**2 * arrives._bend
    return float(a * d - b * c)


@pytest.mark.full
def test_the_tangency_of_fig_7_is_the_crisis():
    found = brentq(beyond, 0.35521, 0.35524, xtol=1e-14)
    assert found == pytest.approx(FIG7, abs=1e-11)


@pytest.mark.full
def test_pictures(orbit, length):
    pytest.importorskip("matplotlib")
    ax = grow_manifold(orbit, length=0.5 * length).plot()
    grow_manifold(orbit, stable=True, length=0.5 * length).plot(ax)
    names = [text.get_text() for text in ax.get_legend().get_texts()]
    assert [name.split(" manifold")[0] for name in names] == ["unstable", "stable"]


@pytest.mark.full
def test_the_end_of_a_curve_is_reported():
    """One side of 2:1 leads to the stable 2:1, in which it ends."""
    found = grow_manifold(saddle(), length=0.5)
    assert len(found.shortfalls) == 3
    assert "it ends after" in found.shortfalls[0]


@pytest.mark.full
def test_refusals():
    orbit = saddle()
    for given in ({"length": 0.0}, {"spacing": math.nan}, {"length": "3"}):
        with pytest.raises(InputError, match=next(iter(given))):
            grow_manifold(orbit, **given)
    stable = next(o for o in find_orbits(orbit.model, "2:1", parameter="s") if o.stable)
    with pytest.raises(InputError, match="outside the unit circle"):
        grow_manifold(stable)
    with pytest.raises(InputError, match="no wall 'X'; the walls are"):
        grow_manifold(orbit, length=0.1).distance("X", 0.0, 0.0)
    with pytest.raises(InputError, match="give an orbit of find_orbits"):
        grow_manifold("2:1")
