"""Compare what normal forms say of 30 grazings with what simulations show.

    python docs/figures/grazings.py

Writes ``grazings.md`` beside this file; takes ten minutes. The grazings are those of 2:1 to 7:1 of
Fig. 7, and twelve each of impact pairs and of oscillators with one stop at random parameters.
"""

import math
from itertools import pairwise
from pathlib import Path

import numpy as np

import contimpact as ci
from contimpact.bifurcations.grazing import CHAOS, IMMEDIATE, JUMP, OVERLAP, windows
from contimpact.models.guards import Word
from contimpact.orbits.orbit import Orbit
from contimpact.orbits.search import solve_near
from contimpact.results.branch import orbit_with
from contimpact.results.options import Settling
from contimpact.simulation.attractor import Kind
from contimpact.simulation.run import State

HERE = Path(__file__).parent
NEAREST = 1e-9
"""Smallest distance from a grazing looked at, as part of its parameter value."""
TRANSIENT, IMPACTS = 3000, 4000
"""Periods before, and impacts in which, motion is looked at."""
LONGEST, CLOSE = 600, 1e-5
"""Most impacts of a periodic motion, and by which part of velocities it repeats."""
STEPS = 30
"""In which an orbit is followed to another distance."""
SETTLING = Settling(impacts=20000)
PAIRS, STOPS = 12, 12
EVENTS = ["G", "FB", "PD"]


# The grazings.


def fig7():
    """Yield the grazings of 2:1 to 7:1."""
    pair = ci.ImpactPair(beta="pi/6", r=0.3, A=5.0, s=0.3)
    orbit = next(o for o in ci.find_orbits(pair, "2:1", "s") if o.physical and o.stable)
    branch = ci.continue_orbit(orbit, "s", range=(0.05, 0.5), events=EVENTS)
    for _ in range(6):
        (entry,) = real(branch)
        yield entry
        branch = ci.continue_born(entry, range=(0.05, 0.5), events=EVENTS)


def pairs(rng):
    """Yield real grazings of impact pairs at random parameters, each once."""
    known = set()
    while True:
        beta, r, a = rng.uniform(0.0, 0.9), rng.uniform(0.2, 0.8), rng.uniform(2.0, 8.0)
        pair = ci.ImpactPair(beta=beta, r=r, A=a, s=0.3)
        for word in ("1:1", "2:1"):
            for orbit in ci.find_orbits(pair, word, "s"):
                branch = ci.continue_orbit(orbit, "s", range=(0.05, 1.0), events=EVENTS)
                yield from new(real(branch), known)


def stops(rng):
    """Yield real grazings of oscillators at random parameters: of the motion without impacts, and
    of the orbit with one impact in a period."""
    known = set()
    while True:
        c, omega = np.exp(rng.uniform(np.log([0.05, 0.4]), np.log([8.0, 8.0]))).tolist()
        size, r = 1.0 / math.hypot(1.0 - omega**2, c * omega), rng.uniform(0.2, 0.95)
        stop = ci.Oscillator(a=1.0 / size, omega=omega, c=c, k=1.0, sigma=1.02, r=r)
        for word, sigma in (("0", 1.02), ("1", 0.5)):
            for orbit in ci.find_orbits(stop.replace(sigma=sigma), word, "sigma"):
                branch = ci.continue_orbit(orbit, "sigma", range=(0.2, 1.1), events=EVENTS)
                yield from new(real(branch), known)


def real(branch):
    """The grazings of observable orbits on a branch."""
    return [entry for entry in branch.events if entry.kind == "G" and not entry.ghost]


def new(entries, known):
    """Yield those that were not found on another branch."""
    for entry in entries:
        key = entry.label, round(entry.value, 9)
        if key not in known:
            known.add(key)
            yield entry


def sample():
    """The 30 grazings."""
    one, other = pairs(np.random.default_rng(1)), stops(np.random.default_rng(2))
    return [*fig7(), *(next(one) for _ in range(PAIRS)), *(next(other) for _ in range(STOPS))]


# Motion beyond them.


class Beyond:
    """Motion beyond a grazing, at values of epsilon over the square of kappa."""

    def __init__(self, entry):
        self.entry, self.form = entry, entry.scenario
        self.model = entry.orbit().model
        self.walls = [wall.name for wall in self.model.WALLS]
        self.unit = self.form.coefficient**2 / self.form.rate
        away = self.form.coefficient > 0.0
        self.windows = dict(windows(self.form.trace, self.form.determinant, away))
        self.nearest = NEAREST * abs(entry.value / self.unit)

    def simulator(self, epsilon):
        """The system at a distance from the grazing."""
        return ci.Simulator(self.model.replace(**{self.entry.parameter: self.value(epsilon)}))

    def value(self, epsilon):
        """The value of the parameter there."""
        return self.entry.value - self.unit * epsilon

    def beside(self, epsilon):
        """What motion settles on that begins beside the grazing orbit."""
        simulator, entry = self.simulator(epsilon), self.entry
        if entry.word:
            first = entry.impacts[0]
            state = State(self.walls.index(first["wall"]), first["time"], first["velocity"])
        else:
            time = entry.touch_time % simulator.period
            state = State(self.walls.index(entry.wall), time, 1e-9 * self.model.WALLS[0].side)
        return Motion(simulator, state)

    def notation(self, n):
        """The orbit with one impact more in n cycles."""
        period = n * self.entry.period
        touching = Word(self.entry.word).insert(self.entry.flight, self.entry.wall).walls
        return Word(self.entry.word * (n - 1) + touching, period).notation(self.walls)

    def carried(self, n, epsilon):
        """What motion settles on that begins on the orbit of a window, followed to a distance."""
        middle = math.sqrt(math.prod(self.windows[n]))
        found = self.beside(middle)
        if found.notation != self.notation(n):
            return found.notation
        orbit = found.orbit(self.entry.parameter)
        for part in np.geomspace(middle, epsilon, STEPS).tolist():
            guess = np.append(orbit.unknowns[:-1], self.value(part))
            orbit = Orbit(orbit.problem, solve_near(orbit.problem, guess))
        first = self.walls.index(orbit.word.walls[0])
        time = float(orbit.times[0]) % found.simulator.period
        state = State(first, time, float(orbit.velocities[0]))
        return Motion(self.simulator(epsilon), state).notation

    def distance(self, motion):
        """How far impacts are from those of the grazing orbit, by times and velocities."""
        entry, period = self.entry, motion.simulator.period
        own = [(i["wall"], i["time"], i["velocity"]) for i in entry.impacts]
        own.append((entry.wall, entry.touch_time, 0.0))
        walls, times, velocities = zip(*own, strict=True)
        numbers = np.array([self.walls.index(wall) for wall in walls])
        late = (np.subtract.outer(motion.run.phases, times) / period + 0.5) % 1.0 - 0.5
        speed = np.max(np.abs(velocities)) or 1.0
        apart = np.hypot(late, np.subtract.outer(motion.run.velocities, velocities) / speed)
        apart[np.not_equal.outer(motion.run.walls, numbers)] = np.inf
        return float(np.max(np.min(apart, axis=1)))


class Motion:
    """What motion settles on.

    It is a periodic one if walls and velocities repeat. Where the soft impact turns the rounding of
    a gap into its root, that is more than `settle` admits. Where a shorter stable orbit
    is near, `settle` may return that one.
    """

    def __init__(self, simulator, state):
        self.simulator = simulator
        end = simulator.run(state, periods=TRANSIENT, record=False).end
        self.run = simulator.run(end, impacts=IMPACTS)
        self.count = self._repeats()
        self.notation = self._notation(end)

    def _repeats(self):
        """The number of impacts after which motion repeats, or None."""
        walls, velocities = self.run.walls, self.run.velocities
        near = CLOSE * np.max(np.abs(velocities))
        for n in range(1, LONGEST):
            same = np.array_equal(walls[n:], walls[:-n])
            if same and np.max(np.abs(velocities[n:] - velocities[:-n])) < near:
                return n
        return None

    def _notation(self, end):
        if self.count is None:
            exponents = ci.settle(self.simulator, end, SETTLING)
            return "chaos" if exponents.kind is Kind.COMPLEX else "not settled"
        return self._word().notation([wall.name for wall in self.simulator.model.WALLS])

    def _word(self):
        letters = [wall.name for wall in self.simulator.model.WALLS]
        walls = "".join(letters[k] for k in self.run.walls[: self.count])
        return Word(walls, int(self.run.turns[self.count] - self.run.turns[0]))

    def orbit(self, parameter):
        """The periodic orbit."""
        word, run, model = self._word(), self.run, self.simulator.model
        rows = slice(self.count)
        times = (run.turns[rows] - run.turns[0]) * self.simulator.period + run.phases[rows]
        unknowns = np.column_stack([times, run.velocities[rows]]).ravel()
        given = np.append(unknowns, model.values[parameter])
        near = orbit_with(model, (word.walls, word.period), parameter, given)
        return Orbit(near.problem, solve_near(near.problem, near.unknowns))


def probes(entry):
    """Yield what is predicted at places beyond a grazing, and what is seen there.

    Yields
    ------
    what : {"scenario", "end of the jump"}
    epsilon : float
    predicted, seen : str
    """
    beyond, name = Beyond(entry), entry.scenario.name
    if name == JUMP:
        yield from jump_probes(beyond)
    elif name == IMMEDIATE:
        for epsilon in np.geomspace(beyond.nearest, 1e4 * beyond.nearest, 5).tolist():
            yield "scenario", epsilon, "chaos", beyond.beside(epsilon).notation
    elif name in (CHAOS, OVERLAP):
        yield from adding_probes(beyond, name)


def adding_probes(beyond, name):
    """Yield what is in the middle of the three nearest windows, and between them."""
    windows = {n: ends for n, ends in beyond.windows.items() if n > 1 and ends[0] > beyond.nearest}
    near = list(windows)[-3:]
    for n in near:
        middle = math.sqrt(math.prod(windows[n]))
        yield "scenario", middle, beyond.notation(n), beyond.beside(middle).notation
    for n, m in pairwise(near):
        between = math.sqrt(windows[n][0] * windows[m][1])
        if name == CHAOS:
            yield "scenario", between, "chaos", beyond.beside(between).notation
        else:
            both = f"{beyond.notation(n)} and {beyond.notation(m)}"
            seen = " and ".join(beyond.carried(k, between) for k in (n, m))
            yield "scenario", between, both, seen


def jump_probes(beyond):
    """Yield whether the attractor shrinks to the grazing orbit, and what it is."""
    ends = {n: ends for n, ends in beyond.windows.items() if ends[0] < 0.0 < ends[1]}
    scale = min((-low for low, _ in ends.values()), default=1.0)
    far = max(1e-2 * scale, 100.0 * beyond.nearest)
    found = [beyond.beside(epsilon) for epsilon in (far, 1e-2 * far)]
    one, other = map(beyond.distance, found)
    yield "scenario", far, "it stays away", "it stays away" if other > 0.5 * one else "it shrinks"
    names, seen = [beyond.notation(n) for n in ends], found[1].notation
    yield "end of the jump", 1e-2 * far, seen if seen in names else " or ".join(names), seen


# The table.

COLUMNS = "| | grazing | at | tau | delta | kappa | scenario | seen | otherwise |"
OWN = {"impact-pair": ("beta", "r", "A", "s"), "oscillator": ("a", "omega", "c", "r", "sigma")}


def row(number, entry, found):
    """A grazing as a row of the table."""
    form = entry.scenario
    place = ", ".join(f"{name} {entry.parameters[name]:.9g}" for name in OWN[entry.system])
    numbers = f"{form.trace:.4g} | {form.determinant:.3g} | {form.coefficient:.4g}"
    right = [want == got for _, _, want, got in found]
    wrong = "; ".join(
        f"{what}: {want} predicted, {got} seen at epsilon = {epsilon:.2g} kappa^2"
        for what, epsilon, want, got in found
        if want != got
    )
    counted = f"{sum(right)} of {len(right)}"
    return f"| {number} | {entry.label} | {place} | {numbers} | {form.name} | {counted} | {wrong} |"


def main():
    """Write the table."""
    rows, right, ends = [], 0, []
    for number, entry in enumerate(sample(), 1):
        found = list(probes(entry))
        rows.append(row(number, entry, found))
        right += all(want == got for what, _, want, got in found if what == "scenario")
        ends += [want == got for what, _, want, got in found if what != "scenario"]
        print(rows[-1], flush=True)
    counted = f"Scenarios right at every place looked at: {right} of {len(rows)}; ends of jumps "
    counted += f"right: {sum(ends)} of {len(ends)}."
    head = ["---", "orphan: true", "---", "", "# Scenarios at 30 grazings"]
    lines = [*head, "", counted, "", COLUMNS, "|---" * 9 + "|", *rows]
    (HERE / "grazings.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
