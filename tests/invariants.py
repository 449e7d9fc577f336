"""What holds on every branch of periodic orbits, whatever was asked of it.

`watch` has it checked wherever a test follows one, at a few milliseconds a branch. A test that
corrupts what it follows on purpose says ``@pytest.mark.corrupting``.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

from contimpact.bifurcations.kind import Change, kind_of, places_with_status
from contimpact.continuation.branch import EndKind, Points
from contimpact.continuation.corrector import EPSILON
from contimpact.diagrams import orbit_walks
from contimpact.orbits.problem import Summary, rounding
from contimpact.orbits.status import PHYSICAL, count_unstable

EVENT_RESIDUAL = 1e-10
"""The residual an event may have at most, however it was located."""

EVENT_ROUNDING = 1e-14
"""The error, beside the parameter, of an event whose residual is one of rounding though larger, as
where a stiff contact turns its derivatives within 1e-6 of a period."""

ROUNDING = 1e-6
"""A restitution below this is one of rounding."""

ON_LIMIT = 1e-9
"""How far beyond the last point, by rounding, an event on a limit of the range may lie."""

watched = Counter()
"""How many walks and branches were checked."""


class Watch:
    """Whether branches are being checked."""

    on = True


def watch(patch):
    """Have every walk and every table checked from now on, as long as a monkeypatch lasts."""
    explained, branch = orbit_walks.explain_changes, orbit_walks.Run.branch

    def checked_walk(problem, walk, tests, settings, switched):
        found = explained(problem, walk, tests, settings, switched)
        if Watch.on and len(found.points):
            evaluations = problem.kernel_evaluations
            check_walk(problem, found, [test.kind for test in tests], settings, switched)
            problem.kernel_evaluations = evaluations  # checking is none of the walk's effort
        return found

    def checked_branch(run, *arguments, **options):
        found = branch(run, *arguments, **options)
        if Watch.on:
            check_branch(found)
        return found

    patch.setattr(orbit_walks, "explain_changes", checked_walk)
    patch.setattr(orbit_walks.Run, "branch", checked_branch)


# A walk.


def check_walk(problem, walk, asked, settings, switched):
    """Check the points of a walk, its events, and its changes of status."""
    points = Points(walk.points)
    watched["walks"] += 1
    check_residuals(points, settings)
    check_way(points, walk, switched)
    check_events(points, walk)
    check_changes(points, walk, asked, settings, switched)


def check_residuals(points, settings):
    """Residuals are within the tolerance; where that is below rounding, within that, of the
    equations and of the unknowns: of these all together, as Newton's steps are judged."""
    residuals = Summary.of(points.numbers).largest_residual
    span = np.ptp(points.unknowns[:, -1]) or 1.0
    assert np.all(np.isfinite(residuals))
    for i in np.nonzero(residuals > settings.tolerance)[0].tolist():
        here = points[i].evaluation
        units = here.problem.scale(here.unknowns, span)
        step = 4.0 * EPSILON * np.linalg.norm(here.unknowns / units)
        moved = step * np.abs(here.jacobian) @ units
        for before in ([0, i], range(i + 1)):  # those of the walk, which may have grown on the way
            scales = [here.problem.scale(points[k].unknowns, 1.0) for k in before]
            sizes = here.problem.residual_sizes(np.max(scales, axis=0))
            allowed = 4.0 * settings.tolerance * sizes + rounding(here).residual + moved
            if np.all(np.abs(here.residual) <= allowed):
                break
        assert np.all(np.abs(here.residual) <= allowed)


def check_way(points, walk, switched):
    """Arclength increases, and the orientation keeps its sign but where branches cross."""
    places = points.arclengths
    assert places[0] == 0.0
    assert np.all(np.diff(places) > 0.0)
    assert np.all(np.isfinite(points.unknowns))
    signs = np.array([point.orientation for point in points]) >= 0.0
    flips = np.nonzero(signs[1:] != signs[:-1])[0]
    looked_for = any(kind_of(event.kind).crossing for event in walk.events)
    for i in flips[1:] if switched and len(flips) and flips[0] == 0 else flips:
        assert not looked_for or explained_by(points, walk, i, lambda kind: kind.crossing)


BLURRED = 1e-8
"""Points nearer to each other are in no order: that is a hundred times what residuals may be."""

UPRIGHT = 1e-12
"""A parameter's rate below this is that of a branch that turns at the point: its sign is rounding,
as where a contact vanishes."""


def check_events(points, walk):
    """Events are in order, between the points they lie between, and solve their equations."""
    places, values = points.arclengths, points.unknowns[:, -1]
    own = [event.point.arclength for event in walk.events]
    assert own == sorted(own)
    for event, place in zip(walk.events, own, strict=True):
        assert places[0] - ON_LIMIT <= place <= places[-1] + ON_LIMIT
        problem = event.point.evaluation.problem
        sizes = problem.residual_sizes(problem.scale(event.point.unknowns, 1.0))
        rounds = event.method == "newton" and event.error <= EVENT_ROUNDING * abs(event.parameter)
        most = EVENT_RESIDUAL * max(1.0, np.max(sizes))
        assert event.residual <= (4.0 * most if rounds else most)  # 1.005 times, at k_b = 1e6
        assert np.isfinite(event.error)
        assert event.error >= 0.0
        after = min(max(int(np.searchsorted(places, place)), 1), len(places) - 1)
        left, right = points[after - 1], points[after]
        rates = left.tangent[-1], right.tangent[-1]
        folds = [there for fold, there in zip(walk.events, own, strict=True) if fold.kind == "FB"]
        folded = any(left.arclength <= there <= right.arclength for there in folds)
        apart = right.arclength - left.arclength > BLURRED
        if rates[0] * rates[1] > 0.0 and min(map(abs, rates)) > UPRIGHT and apart and not folded:
            low, high = sorted(values[after - 1 : after + 1])
            slack = event.error + 1e-9 * (high - low) + 1e-12 * abs(high)
            assert low - slack <= event.parameter <= high + slack


def check_changes(points, walk, asked, settings, switched):
    """Between points of another status lies an event that changes it, or it is said what is
    missing."""
    told = places_with_status(walk, settings)
    summary = Summary.of(points.numbers)
    unstable = count_unstable(summary.multipliers)[told]
    findings = summary.findings[told, 0]
    explaining = [kind_of(name) for name in asked]
    for k in np.nonzero(unstable[1:] != unstable[:-1])[0].tolist():
        kinds = [kind for kind in explaining if kind.explains(Change.STABILITY)]
        passed = passing(summary.multipliers[told[k : k + 2]])
        turns = turns_between(points, told[k], told[k + 1])
        unasked = ("FB" if turns else "BP") not in asked and (turns or (passed and passed > 0.0))
        asked_for = any(kind.passed(passed) for kind in kinds) and not unasked
        if asked_for and not (switched and told[k] == 0):
            assert explained_by(
                points, walk, told[k], lambda kind: kind.explains(Change.STABILITY), told[k + 1]
            )
    unphysical = findings != PHYSICAL
    for k in np.nonzero(unphysical[1:] != unphysical[:-1])[0].tolist():
        finding = max(findings[k : k + 2], key=lambda found: found != PHYSICAL)
        if any(kind.finding == finding for kind in explaining) and not (switched and told[k] == 0):
            assert explained_by(
                points, walk, told[k], lambda kind: kind.explains(Change.PHYSICALITY), told[k + 1]
            )


def turns_between(points, i, j):
    """Whether the branch turns back in its parameter between two points: a fold lies there."""
    rates = points[int(i)].tangent[-1], points[int(j)].tangent[-1]
    return rates[0] * rates[1] < 0.0 or min(map(abs, rates)) < UPRIGHT


def passing(multipliers):
    """The multiplier outside the unit circle that has passed it through 1 or -1; None for pairs."""
    counts = count_unstable(multipliers)
    outside = multipliers[int(np.argmax(counts))]
    real = [m.real for m in outside.tolist() if abs(m) > 1.0 and m.imag == 0.0]
    return min(real, key=abs, default=None) if (counts[0] - counts[1]) % 2 else None


def explained_by(points, walk, i, fits, j=None):
    """Whether a fitting event, or the note that one was missed, lies between two points."""
    left, right = points[int(i)], points[int(i + 1 if j is None else j)]
    slack = 1e-9 * (right.arclength - left.arclength)
    low, high = sorted((left.parameter, right.parameter))
    turn = points[-1].arclength if walk.end.kind is EndKind.CLOSED else 0.0
    return any(
        fits(kind_of(event.kind))
        and left.arclength - slack <= event.point.arclength + way <= right.arclength + slack
        for event in walk.events
        for way in {0.0, turn, -turn}
    ) or any(
        (min(missed.parameters) <= high and low <= max(missed.parameters))
        or left.arclength <= missed.arclength <= right.arclength  # beyond both where it turns
        for missed in walk.missed
    )


# A table.


def check_branch(branch):
    """Check that a table is whole, and that entries say of ghosts what follows from verdicts."""
    watched["branches"] += 1
    lengths = {name: len(column) for name, column in branch.columns.items()}
    assert set(lengths.values()) == {len(branch)}, lengths
    assert np.all(np.diff(branch["arclength"]) > 0.0)
    unphysical = np.array([bool(reason) for reason in branch["reason"]], dtype=bool)
    assert np.array_equal(branch.physical, ~unphysical)
    names = [name for name in branch["event"] if name]
    assert len(names) == len(set(names))
    assert {*names} <= {entry.id for entry in branch.events}
    for entry in branch.events:
        check_entry(branch, entry)
    if branch.system == "impact-pair":
        check_product(branch)


def check_entry(branch, entry):
    """A ghost is unstable or unphysical for another reason than the event."""
    assert entry.stable == (entry.n_unstable == 0)
    assert entry.physical == (entry.reason is None)
    assert entry.ghost == (not entry.stable or not entry.physical)
    assert entry.ghost == (entry.why is not None)
    assert entry.label.startswith("~") == (entry.ghost and kind_of(entry.kind).tilde)
    assert branch["arclength"][0] <= entry.arclength <= branch["arclength"][-1]


def check_product(branch):
    """The product of an impact pair's multipliers is that of r squared over all impacts.

    Next to a zero velocity one of them is so large that the other is lost in rounding, and so it
    is where r itself is as small as rounding. An orbit is one up to its residual, by which
    velocities are off, and the product by as large a part as that is of the smallest after an
    impact: of r times that before. Where no digit of it, or of the lesser multiplier, is known,
    none of the product is.
    """
    restitution = {w: branch[f"r_{w}" if f"r_{w}" in branch.columns else "r"] for w in "BT"}
    if min(np.min(r) for r in restitution.values()) < ROUNDING:
        return
    exact = np.prod([restitution[wall] ** 2 for wall in branch.word], axis=0)
    known = np.all(np.isfinite(branch.multipliers), axis=1)
    known &= np.min(np.abs(branch.velocities), axis=1) > branch["residual"]
    lost = 64.0 * np.finfo(float).eps * np.max(np.abs(branch.multipliers), axis=1)
    known &= lost < 0.1
    multipliers, exact = branch.multipliers[known], exact[known]
    slack = 1e-9 + lost[known]
    slowest = np.min(np.abs(branch.velocities[known]), axis=1)
    slowest *= np.min(list(restitution.values()), axis=0)[known]
    off = branch["residual"][known] + 64.0 * np.finfo(float).eps
    slack += off / np.maximum(slowest, np.finfo(float).tiny)
    assert np.all(np.abs(np.prod(multipliers, axis=1) - exact) <= slack * exact)
