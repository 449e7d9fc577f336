"""Curves of FB and PD on which the end of a contact with a soft stop comes to rest.

Such an impact leaves no trace, so that all orbits with one solve the equations of the curve, too.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import fsolve
from zoo import between_soft_stops

from contimpact.bifurcations.extended_system import is_near, least_trace
from contimpact.diagrams.curves import follow_curve
from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.models.guards import Word
from contimpact.orbits.quiet import problem_of
from contimpact.orbits.search import orbit_at
from contimpact.segments.kernels import Kernels
from contimpact.systems.soft_stop import SoftStop

STIFFNESS, DAMPING, STOP = 1.0, 0.1, 50.0


def soft_stop(**values):
    given = {"a": 1.0, "c": DAMPING, "k": STIFFNESS, "e": 0.5, "k_b": STOP, "c_b": 0.0}
    return SoftStop(**given | values)


def branch_from(model, word, rows, parameter, limits, events):
    problem = problem_of(model, word, Kernels(model, parameter))
    orbit = orbit_at(problem, np.append(rows, model.values[parameter]))
    return continue_orbit(orbit, range=limits, events=events)


def doubling_of_soft_stop():
    """A ghost PD whose contact ends at 7e-5."""
    model = soft_stop(omega=2.314447761655539)
    rows = [0.9248876680755, -0.056405536413], [1.836022139534, 7.235476e-5]
    branch = branch_from(model, Word("CR", 1), rows, "omega", (2.3144, 2.315), ["PD"])
    return model, branch.events[0]


def motion(stiffness, omega, load, start, end, state):
    """The state at the end, by the closed form of a forced linear oscillator."""

    def steady(time):
        z = np.exp(1j * omega * time) / (stiffness - omega**2 + 1j * DAMPING * omega)
        return np.array([z.real + load / stiffness, (1j * omega * z).real])

    return steady(end) + flow(stiffness, end - start) @ (state - steady(start))


def flow(stiffness, time):
    return expm(np.array([[0.0, 1.0], [-stiffness, -DAMPING]]) * time)


def doubling_at_rest(unknowns):
    """Contact from tc to tr between x = e, ending at rest, with the multiplier -1: the vector field
    is continuous at the stop, so that the flows make the monodromy matrix."""
    tc, vc, tr, vr, omega, e = unknowns
    after = tc + 2.0 * np.pi / omega
    left = motion(STIFFNESS + STOP, omega, STOP * e, tc, tr, np.array([e, vc]))
    back = motion(STIFFNESS, omega, 0.0, tr, after, np.array([e, vr]))
    cycle = flow(STIFFNESS, after - tr) @ flow(STIFFNESS + STOP, tr - tc)
    return [
        left[0] - e,
        left[1] - vr,
        back[0] - e,
        back[1] - vc,
        vr,
        np.linalg.det(cycle + np.eye(2)),
    ]


def test_a_contact_that_ends_at_rest_on_a_curve_is_located_to_rounding():
    model, entry = doubling_of_soft_stop()
    curve = follow_curve(entry, model, "e", (2.2, 2.5), (0.49, 0.51))
    assert curve.missed == []
    (point,) = curve.points
    assert point.kind == "PD-V"
    assert "loses its velocity" in point.changes
    impacts = [value for i in point.impacts for value in (i["time"], i["velocity"])]
    start = [*impacts, point.parameters["omega"], point.parameters["e"]]
    beside = np.array(start) + 1e-6
    wanted, *_ = fsolve(doubling_at_rest, beside, xtol=1e-14, full_output=True)  # to rounding
    np.testing.assert_allclose(start[-2:], wanted[-2:], rtol=0, atol=1e-12)
    assert point.error < 1e-12


def test_where_a_contact_ends_at_rest_a_determinant_vanishes_without_the_multiplier():
    """A doubled branch turned there, with a multiplier of 1.0065, and a FB was located; the curve
    that starts there followed orbits at rest, with any multipliers."""
    model, entry = doubling_of_soft_stop()
    rows = [(impact["time"], impact["velocity"]) for impact in entry.impacts]
    problem = problem_of(model, Word("CR", 1), Kernels(model, "omega"))
    here = problem.evaluate(np.append(rows, entry.value))
    assert 1e-4 < least_trace(here) < 2e-4
    assert is_near(here, here.multipliers, -1.0)
    assert is_near(here, [1.0 + 1e-5], 1.0)
    assert not is_near(here, [1.0065], 1.0)


@pytest.mark.full
def test_a_curve_of_folds_ends_at_gpds_and_has_no_cusp_at_an_fb_v():
    model = soft_stop(omega=1.2890103952587075)
    rows = [1.9773718176591, -0.2476417731304], [3.8118632523920, -0.2447786105548]
    later = [6.9804325694037, -0.8313513020120], [8.7691014775987, -0.7461555033473]
    place = Word("CRCR", 2), [*rows, *later], "omega", (1.28, 1.3), ["FB"]
    folds = branch_from(model, *place).events
    entry = next(e for e in folds if abs(e.value - 1.2890103952587) < 1e-8)
    curve = follow_curve(entry, model, "e", (0.6, 4.0), (0.05, 1.0))
    assert [end.kind.name for end in curve.ends] == ["SHORTER", "SHORTER"]
    assert curve.missed == []  # the form of a cusp vanishes at its ends, too
    assert sorted(point.kind for point in curve.points) == ["CP", *["FB-V"] * 4]
    assert max(point.error for point in curve.points) < 1e-10


@pytest.mark.full
def test_a_curve_passes_contacts_of_next_to_no_duration_and_slow_doublings_that_turn():
    """Steps failed beside the first PD-V, and a GPD with an impact below 1e-4 was left out."""
    model = between_soft_stops(a=0.671121, w=0.77905970591649)
    rows = [7.783552745, 1.144071988], [8.229320239, -1.117570264]
    later = [9.909702838, 0.011227632], [9.872225587, -0.011362968]
    place = Word("ABLR", 1), [*rows, *later], "w", (0.7785, 0.7795), ["PD"]
    (entry,) = branch_from(model, *place).events
    curve = follow_curve(entry, model, "a", (0.5, 2.0), (0.5, 0.9))
    assert curve.missed == []
    assert {end.kind.name for end in curve.ends} == {"RANGE"}
    kinds = [point.kind for point in curve.points]
    assert kinds == ["GPD", "PD-V", "PD-G", "PD-V", "PD-G", "GPD"]
    assert max(point.error for point in curve.points) < 1e-9
    slowest = [min(abs(i["velocity"]) for i in point.impacts) for point in curve.points]
    assert max(slowest[0], slowest[-1]) < 1e-4
