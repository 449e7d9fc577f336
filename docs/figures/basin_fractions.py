"""Compare basin fractions with those of many more starts, counted by a program in C.

    python docs/figures/basin_fractions.py

Writes ``basin_fractions.md`` beside this file; needs a C compiler, and takes half an hour. The
program shares nothing with the package. The impact pair flies in steps that end before the largest
acceleration could lead to a wall; other systems are integrated by Runge and Kutta's method. After
the transient, motion that repeats itself is named by its impacts, other motion is complex.
"""

import math
import os
import subprocess
import tempfile
from collections import Counter
from pathlib import Path

from scipy.stats import binomtest

import contimpact as ci

HERE = Path(__file__).parent
MANY = 100_000
"""Starts of the program in C."""
STARTS = {"impact-pair": 2000}
"""Starts of the package; of other systems 400."""
TRANSIENT, LONGER = 300, {0.38: 3000}
"""Forcing periods before motion is looked at; beside a period doubling it closes slowly."""

PAIR = {"beta": math.pi / 6, "r": 0.3, "A": 5.0, "s": 0.5}
MASSES = {
    **{"c1": 0.1, "c2": 0.05, "k1": 1.0, "k2": 0.6, "a1": 1.0, "omega": 1.8},
    **{"sigma_1": 1.0, "sigma_2": 1.0, "r": 0.8},
}
SOFT = {"a": 1.0, "omega": 1.0, "c": 0.1, "k": 1.0, "e": 0.5, "k_b": 20.0, "c_b": 0.3}
FIG8 = (6.2, 7.05, 7.1, 7.2, 7.25, 9.0, 12.3, 12.86, 13.1, 16.0)
CASES = [
    *((ci.ImpactPair(**PAIR), "s", s, None) for s in (0.28, 0.3, 0.35, 0.3556, 0.3562)),
    *((ci.ImpactPair(**PAIR), "s", s, None) for s in (0.2565, 0.2791, 0.2793, 0.3566, 0.38)),
    *((ci.ImpactPair(**PAIR | {"r": 0.25}), "A", a, None) for a in FIG8),
    *(
        (ci.TwoMasses(**MASSES), "omega", w, {"position": [[-2, 1]] * 2, "velocity": [[-2, 2]] * 2})
        for w in (1.78, 1.8, 1.85)
    ),
    *(
        (ci.SoftStop(**SOFT), "omega", w, {"position": [-1.5, 0.5], "velocity": [-2, 2]})
        for w in (0.705, 0.712, 0.72)
    ),
]

PROGRAM = r"""
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { LONGEST = 9, MOST = 4, FINEST = 200 };
static double P[16], T;
static int size, hits[2], stuck[2];
static uint64_t state[2] = {0x9e3779b97f4a7c15u, 0xbf58476d1ce4e5b9u};

static double draw(double low, double high) { /* xorshift128+ */
  uint64_t a = state[0], b = state[1], sum = a + b;
  state[0] = b; a ^= a << 23; state[1] = a ^ b ^ (a >> 18) ^ (b >> 5);
  return low + (high - low) * (double)(sum >> 11) / 9007199254740992.0;
}

/* The pair: z = (x, v); P = half length, gravity, restitution. */
static double reach(double gap, double v, double most) { /* the soonest time, v towards the wall */
  double root = sqrt(v * v + 2 * most * fmax(gap, 0));
  return v > 0 ? 2 * fmax(gap, 0) / (v + root) : (root - v) / most;
}
static void pair(double t, double *z) {
  const double half = P[0], g = P[1], r = P[2], most = 1.0 + fabs(g), end = t + T;
  while (t < end) {
    double x = z[0], v = z[1], low = x + half, high = half - x;
    int near = high < 1e-13 ? 0 : low < 1e-13 ? 1 : -1;
    double side = near == 1 ? -1.0 : 1.0, turn = M_PI * t;
    if (near >= 0 && fabs(v) < 1e-7 && side * (g + cos(turn)) > 0) { /* it rests until that turns */
      stuck[near]++;
      z[1] = -side * 2e-7;
      if (fabs(g) >= 1) return;
      double leave = (near ? 2 * M_PI - acos(-g) : acos(-g)) / M_PI, now = fmod(t, 2.0);
      t += leave - now + (leave < now ? 2 : 0);
      if (t >= end) z[1] = 0;
      continue;
    }
    double dt = fmin(fmin(reach(high, v, most), reach(low, -v, most)), end - t);
    double s = turn, e = M_PI * (t + dt);
    z[0] = x + v * dt + 0.5 * g * dt * dt - (cos(e) - cos(s)) / (M_PI * M_PI) - sin(s) * dt / M_PI;
    z[1] = v + g * dt + (sin(e) - sin(s)) / M_PI;
    t += dt;
    int wall = half - z[0] < 1e-13 && z[1] > 0 ? 0 : z[0] + half < 1e-13 && z[1] < 0 ? 1 : -1;
    if (wall < 0) continue;
    z[0] = wall ? -half : half;
    hits[wall]++;
    z[1] *= -r;
  }
}

/* Two masses: z = (x1, x2, v1, v2); the soft stop: z = (x, v). */
static int several, contact;
static double force(double t) { return several ? P[4] * cos(P[5] * t) : P[0] * cos(P[1] * t); }
static void rates(double f, const double *z, double *d) {
  if (several) {
    d[0] = z[2]; d[1] = z[3];
    d[2] = f - P[0] * z[2] - P[1] * (z[2] - z[3]) - P[2] * z[0] - P[3] * (z[0] - z[1]);
    d[3] = -P[1] * (z[3] - z[2]) - P[3] * (z[1] - z[0]);
  } else {
    d[0] = z[1];
    d[1] = f - P[2] * z[1] - P[3] * z[0];
    if (contact) d[1] -= P[5] * (z[0] - P[4]) + P[6] * z[1];
  }
}
static void step_with(const double *f, const double *z, double h, double *to) {
  double k[4][MOST], y[MOST];
  rates(f[0], z, k[0]);
  for (int j = 1; j < 4; j++) {
    double part = j < 3 ? 0.5 * h : h;
    for (int i = 0; i < size; i++) y[i] = z[i] + part * k[j - 1][i];
    rates(f[(j + 1) / 2], y, k[j]);
  }
  for (int i = 0; i < size; i++)
    to[i] = z[i] + h / 6 * (k[0][i] + 2 * k[1][i] + 2 * k[2][i] + k[3][i]);
}
static void step(double t, const double *z, double h, double *to) {
  const double f[3] = {force(t), force(t + 0.5 * h), force(t + h)};
  step_with(f, z, h, to);
}
static double beyond(const double *z, int guard) {
  if (several) return z[guard] - P[6 + guard];
  return contact ? P[4] - z[0] : z[0] - P[4];
}
static void integrate(double t, double *z) {
  static double table[2 * FINEST + 1];
  static int known = 0;
  const double begin = t;
  const int count = several ? 40 : FINEST;
  if (!known || begin != table[2 * FINEST]) {
    for (int i = 0; i < 2 * count; i++) table[i] = force(begin + i * T / (2 * count));
    table[2 * FINEST] = begin;
    known = 1;
  }
  for (int k = 0; k < count;) {
    double next = begin + (k + 1) * T / count, h = next - t, to[MOST];
    if (t == begin + k * T / count) {
      const double f[3] = {table[2 * k], table[2 * k + 1], table[(2 * k + 2) % (2 * count)]};
      step_with(f, z, h, to);
    } else
      step(t, z, h, to);
    int guard = -1;
    double first = h;
    for (int j = 0; j <= several; j++) {
      if (beyond(to, j) <= 0) continue;
      double low = 0, high = h, mid[MOST];
      for (int i = 0; i < 50; i++) {
        double m = 0.5 * (low + high);
        step(t, z, m, mid);
        if (beyond(mid, j) > 0) high = m; else low = m;
      }
      if (guard < 0 || low < first) guard = j, first = low;
    }
    if (guard < 0) { memcpy(z, to, sizeof to); t = next; k++; continue; }
    step(t, z, first, to);
    memcpy(z, to, sizeof to);
    t += first;
    if (several) {
      hits[guard]++;
      z[guard] = P[6 + guard] - 1e-13;
      z[2 + guard] *= -P[8];
    } else {
      contact = !contact;
      hits[!contact]++;
      z[0] = P[4] + (contact ? 1e-13 : -1e-13);
    }
  }
}

int main(int count, char **given) {
  int kind = atoi(given[1]), starts = atoi(given[2]), transient = atoi(given[3]), n = 4;
  T = atof(given[n++]);
  int parameters = atoi(given[n++]);
  for (int i = 0; i < parameters; i++) P[i] = atof(given[n++]);
  size = kind == 1 ? 4 : 2;
  several = kind == 1;
  double box[2 * MOST];
  for (int i = 0; i < 2 * size; i++) box[i] = atof(given[n++]);
  for (int k = 0; k < starts; k++) {
    double z[MOST], t = draw(0, T), first[MOST];
    for (int i = 0; i < size; i++) z[i] = draw(box[2 * i], box[2 * i + 1]);
    contact = 0;
    void (*period)(double, double *) = kind ? integrate : pair;
    int p = LONGEST, done = 0;
    for (int wait = 40; p == LONGEST && done < transient; wait *= 2) {
      for (; done < wait && done < transient; done++) period(t, z);
      memcpy(first, z, sizeof z);
      hits[0] = hits[1] = stuck[0] = stuck[1] = 0;
      int begun = contact;
      double apart = 1, before = 1;
      for (p = 0; p < LONGEST && apart > (kind ? 1e-6 : 1e-8); p++, done++) {
        before = fmin(before, apart);
        period(t, z);
        apart = begun != contact;
        for (int i = 0; i < size; i++) apart = fmax(apart, fabs(z[i] - first[i]));
      }
      if (before < 1e-4 && done < transient) p = LONGEST; /* slow: it may close sooner */
    }
    if (p == LONGEST) printf("0 %d %d 0 0\n", hits[0], hits[1]);
    else printf("%d %d %d %d %d\n", p, hits[0], hits[1], stuck[0], stuck[1]);
  }
}
"""


def arguments(model, box):
    """Return kind, period, parameters and box of the program in C."""
    p = model.values
    if model.SYSTEM == "impact-pair":
        d, gravity, restitution = model["d"], model["gbar"], p["r"]
        fastest = 1.0 + abs(gravity)
        return 0, 2.0, [d / 2, gravity, restitution], [-d / 2, d / 2, -fastest, fastest]
    period = 2.0 * math.pi / p["omega"]
    if model.SYSTEM == "two-masses":
        names = ("c1", "c2", "k1", "k2", "a1", "omega", "sigma_1", "sigma_2", "r")
        sides = [x for pair in (*box["position"], *box["velocity"]) for x in pair]
        return 1, period, [p[name] for name in names], sides
    names = ("a", "omega", "c", "k", "e", "k_b", "c_b")
    return 2, period, [p[name] for name in names], [*box["position"], *box["velocity"]]


def counted(program, model, value, box):
    """Return how many starts lead to each motion, by the program in C."""
    kind, period, values, sides = arguments(model, box)
    given = [kind, MANY, LONGER.get(value, TRANSIENT), period, len(values), *values, *sides]
    done = subprocess.run([program, *map(repr, given)], capture_output=True, text=True, check=True)
    found = Counter()
    for line, count in Counter(done.stdout.splitlines()).items():
        found[notation(*map(int, line.split()))] += count
    return found


def notation(p, *numbers):
    """Return what the package calls a motion with these impacts and rests in p periods."""
    hits, rests = numbers[:2], numbers[2:]
    if not any(hits):
        return "no impact"
    if p == 0:
        return "complex"
    whole = all(n % p == 0 for n, stuck in zip(hits, rests, strict=True) if not stuck)
    each = [
        "inf" if stuck else str(n // p if whole else n)
        for n, stuck in zip(hits, rests, strict=True)
    ]
    text = ":".join(each)
    return text if p == 1 else f"{text}/{p}T" if whole else f"({text})/{p}T"


def seconds():
    """Return the processor time used until now, that of the program in C included."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


def main():
    """Write the table."""
    rows, wrong, compared = [], 0, 0
    with tempfile.TemporaryDirectory() as folder:
        source, program = Path(folder) / "starts.c", Path(folder) / "starts"
        source.write_text(PROGRAM)
        subprocess.run(["cc", "-O3", "-o", program, source, "-lm"], check=True)
        for number, (given, parameter, value, box) in enumerate(CASES):
            model = given.replace(**{parameter: value})
            clocks = [seconds()]
            starts = STARTS.get(model.SYSTEM, 400)
            all_starts = counted(program, model, value, box)
            clocks.append(seconds())
            kept = {"starts": starts, "box": box, "rng": number}
            found = ci.basin_fractions(model, parameter, [value], **kept)
            clocks.append(seconds())
            mine = Counter()
            for share, attractor in zip(found.shares, found.attractors[0].values(), strict=True):
                complex_ = attractor.kind.value in ("complex", "not settled")
                mine["complex" if complex_ else share.notation] += int(
                    found.counts[0, share.motion - 1]
                )
            for name in sorted({*mine, *all_starts}):
                low, high = binomtest(mine[name], starts).proportion_ci(method="exact")
                part = all_starts[name] / MANY
                inside = low <= part <= high
                wrong, compared = wrong + (not inside), compared + 1
                rows.append(
                    f"| {model.SYSTEM} | {parameter} = {value:g} | {name} | {100 * part:.3f} "
                    f"| {100 * low:.2f} to {100 * high:.2f} | {'' if inside else 'no'} "
                    f"| {clocks[1] - clocks[0]:.0f} | {clocks[2] - clocks[1]:.1f} |"
                )
            print(*rows[-len({*mine, *all_starts}) :], sep="\n", flush=True)
    head = "system | value | motion | % in C | % by the package | outside | s | s "
    text = (
        "---\norphan: true\n---\n\n# Basin fractions against many starts in C\n\n"
        "100,000 starts are counted in C; by the package 2,000 of the impact pair, of other "
        "systems 400, with other random numbers for each value. Inside the 95 % intervals: "
        f"{compared - wrong} of {compared}. "
        "At s = 0.38, beside a period doubling, motion has 3000 periods to close, elsewhere 300. "
        "Seconds are processor time of the program in C and of the package.\n\n"
        f"| {head}|\n|{'---|' * 8}\n" + "\n".join(rows) + "\n"
    )
    (HERE / "basin_fractions.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
