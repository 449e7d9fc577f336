"""Motions of a stated system in small fixed steps, and the periodic ones among them.

It knows nothing of the package: the laws are written as C, and stepped by the Runge-Kutta method of
the fourth order; where a guard is met is found by halving the step.
"""

from __future__ import annotations

import ctypes
import hashlib
import re
import shutil
import subprocess
from typing import NamedTuple

import numpy as np

COMPILER = shutil.which("cc")
STEPS = 100
"""Steps in a period of the forcing."""
CLOSED, NEARLY = 1e-7, 1e-3
"""A motion repeats itself if its impacts do, in parts of a period and of the largest states; not if
it comes near a shorter one and has not reached it."""
LONGEST, MOST = 24, 4000
"""Impacts of a periodic motion, and of one run, at most."""

PROGRAM = """
#include <math.h>
#define pi 3.14159265358979323846
#define N {size}
#define CHATTER 8
static void rates(int mode, double t, const double *y_, const double *p_, double *d_)
{{ {states} {values} switch (mode) {{ {laws} }} }}
static double gap(int guard, double t, const double *y_, const double *p_)
{{ {states} {values} switch (guard) {{ {gaps} }} return 1.0; }}
static void reset(int guard, double t, const double *y_, const double *p_, double *z_)
{{ {states} {values} for (int i = 0; i < N; i++) z_[i] = y_[i]; switch (guard) {{ {resets} }} }}
static void step(int mode, double t, const double *y, const double *p, double h, double *z)
{{
    double a[N], b[N], c[N], d[N];
    rates(mode, t, y, p, a);
    for (int i = 0; i < N; i++) z[i] = y[i] + h / 2 * a[i];
    rates(mode, t + h / 2, z, p, b);
    for (int i = 0; i < N; i++) z[i] = y[i] + h / 2 * b[i];
    rates(mode, t + h / 2, z, p, c);
    for (int i = 0; i < N; i++) z[i] = y[i] + h * c[i];
    rates(mode, t + h, z, p, d);
    for (int i = 0; i < N; i++) z[i] = y[i] + h / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]);
}}
double first_gap(int guard, double *y, const double *p) {{ return gap(guard, y[N], y, p); }}
int run(double *y, int *mode, const double *p, double h, long steps, int most, int *met, double *at)
{{
    static const int of[] = {{{of}}}, to[] = {{{to}}}, past[] = {{{past}}}, for_[] = {{{for_}}};
    int count = 0, close = 0;
    double z[N], w[N], last = -1e300;
    while (steps-- > 0 && count < most) {{
        double least = h, t = y[N];
        int hit = -1;
        step(*mode, t, y, p, h, z);
        for (int g = 0; g < {guards}; g++) {{
            if (of[g] != *mode || past[g] >= 0 || gap(g, t + h, z, p) >= 0.0) continue;
            double low = 0.0, high = h;
            for (int k = 0; k < 46; k++) {{
                double middle = (low + high) / 2;
                step(*mode, t, y, p, middle, w);
                if (gap(g, t + middle, w, p) < 0.0) high = middle; else low = middle;
            }}
            if (high < least || hit < 0) least = high, hit = g;
        }}
        if (hit >= 0) {{
            step(*mode, t, y, p, least, w);
            y[N] = t + least;
            reset(hit, y[N], w, p, z);
            for (int g = 0; g < {guards}; g++)
                if (for_[g] == hit && gap(past[g], y[N], z, p) < 0.0) {{
                    reset(hit = g, y[N], w, p, z);
                    break;
                }}
            met[count] = hit, at[count * (N + 1)] = y[N];
            for (int i = 0; i < N; i++) at[count * (N + 1) + 1 + i] = w[i];
            count++, *mode = to[hit];
            close = y[N] - last < h ? close + 1 : 0, last = y[N];
            if (N == 2 && close > CHATTER) y[N] += h, close = 0;  /* the body sticks for a step */
        }} else y[N] = t + h;
        for (int i = 0; i < N; i++) y[i] = z[i];
    }}
    return count;
}}
"""


class Periodic(NamedTuple):
    """A motion that repeats itself: letters of its guards, times, and states before them."""

    letters: str
    turns: int
    """Periods of the forcing."""
    times: np.ndarray
    states: np.ndarray


class Motions:
    """Motions of a hybrid system, stated by a table as of a scene."""

    def __init__(self, model, folder):
        modes, guards = list(model["modes"]), model["guards"]
        self.names = sorted({name for laws in model["modes"].values() for name in laws})
        self.parameters, self.letters = sorted(model["parameters"]), list(guards)
        self.modes, self.period = modes, model["period"]
        place = {name: i for i, name in enumerate(self.names)}
        of = [modes.index(g.get("mode", modes[0])) for g in guards.values()]
        to = [modes.index(g.get("to", modes[m])) for g, m in zip(guards.values(), of, strict=True)]
        past = [self.letters.index(g["past"]) if "past" in g else -1 for g in guards.values()]
        held = [
            next(j for j in range(len(of)) if (of[j], to[j], past[j]) == (of[i], of[beyond], -1))
            if beyond >= 0
            else -1
            for i, beyond in enumerate(past)
        ]
        self.begun_at = [i for i, m in enumerate(of) if m == 0 and past[i] < 0]
        laws, gaps, resets = [], [], []
        for number, mode in enumerate(model["modes"].values()):
            each = (f"d_[{place[n]}] = {_c(mode.get(n, '0.0'))};" for n in self.names)
            laws.append(f"case {number}: {' '.join(each)} break;")
        for number, guard in enumerate(guards.values()):
            inside, order, limit = re.split("(<=|>=)", guard["within"])
            sign = "-" if order == "<=" else ""
            gaps.append(f"case {number}: return {sign}(({_c(inside)}) - ({_c(limit)}));")
            each = (f"z_[{place[n]}] = {_c(law)};" for n, law in guard.get("set", {}).items())
            resets.append(f"case {number}: {' '.join(each)} break;")
        text = PROGRAM.format(
            size=len(self.names),
            states="".join(f"double {n} = y_[{i}]; (void){n};" for n, i in place.items()),
            values="".join(
                f"double {n} = p_[{i}]; (void){n};" for i, n in enumerate(self.parameters)
            ),
            laws="\n".join(laws),
            gaps="\n".join(gaps),
            resets="\n".join(resets),
            guards=len(of),
            **{
                name: ", ".join(map(str, row))
                for name, row in (("of", of), ("to", to), ("past", past), ("for_", held))
            },
        )
        source = folder / f"{hashlib.sha256(text.encode()).hexdigest()[:16]}.c"
        if not source.with_suffix(".so").exists():
            source.write_text(text)
            built = str(source.with_suffix(".so")), str(source)
            subprocess.run([COMPILER, "-O2", "-shared", "-fPIC", "-o", *built, "-lm"], check=True)
        self.program = ctypes.CDLL(str(source.with_suffix(".so")))
        self.program.first_gap.restype = ctypes.c_double

    def forcing_period(self, values):
        known = {"pi": np.pi, **values}
        return float(eval(str(self.period), {"__builtins__": {}}, known))

    def begin(self, draw, size, values):
        """Time and state at random in the first mode, within its guards; None if none is found."""
        p = _pointer(np.array([values[name] for name in self.parameters]))
        for _ in range(200):
            y = np.append(draw.uniform(-size, size, len(self.names)), 0.0)
            if all(self.program.first_gap(g, _pointer(y), p) > 0.0 for g in self.begun_at):
                return y, ctypes.c_int(0)
        return None

    def run(self, y, mode, values, h, steps):
        """Move a motion on; returns the letters, and rows of the time and the state before each."""
        p = np.array([values[name] for name in self.parameters], dtype=float)
        met, at = np.zeros(MOST, dtype=np.int32), np.zeros((MOST, len(y)))
        count = self.program.run(
            _pointer(y), ctypes.byref(mode), _pointer(p), ctypes.c_double(h), ctypes.c_long(steps),
            MOST, met.ctypes.data_as(ctypes.c_void_p), _pointer(at),
        )  # fmt: skip
        return "".join(self.letters[k] for k in met[:count].tolist()), at[:count]

    def settle(self, begun, values, autonomous, periods, rounds):
        """The periodic motion that is reached, or why there is none, in a word."""
        y, mode = begun
        T = 2 * np.pi if autonomous else self.forcing_period(values)
        for number in range(rounds):
            letters, at = self.run(y, mode, values, T / STEPS, periods * STEPS)
            if not np.all(np.abs(y) < 1e6 * max(1.0, abs(y[-1]))):
                return "runs away"
            if len(letters) == MOST:
                continue  # impacts accumulate
            if not letters and number:
                before = y[:-1].copy()
                whole = np.ceil(y[-1] / T) * T - y[-1]
                self.run(y, mode, values, whole / STEPS, STEPS)
                first = y[:-1].copy()
                letters, _ = self.run(y, mode, values, T / STEPS, STEPS)
                if not letters and np.max(np.abs(y[:-1] - first)) < CLOSED * np.max(np.abs(before)):
                    rows = [n for n in ("x", "v", "y", "w") if n in self.names] or self.names
                    return Periodic("", 1, np.zeros(1), first[[self.names.index(n) for n in rows]])
            found = periodic_motion(letters, at, T, autonomous)
            if found:
                return found
        return "not periodic"


def _c(law):
    """An expression in C."""
    powers = re.sub(r"(\w+)\*\*(\d+)", r"pow(\1, \2.0)", str(law))
    return re.sub(r"(?<![\w.])(\d+)(?![\w.])", r"\1.0", powers)


def _pointer(row):
    return row.ctypes.data_as(ctypes.c_void_p)


def periodic_motion(letters, at, period, autonomous=False):
    """The motion that the last impacts repeat; None if they do not."""
    times, states = at[:, 0] / period, at[:, 1:]
    sizes = np.max(np.abs(states), axis=0, initial=0.0)
    sizes = np.maximum(sizes, 1e-3 * np.max(sizes))
    shorter = False
    for n in range(1, min(LONGEST, len(letters) // 3) + 1):
        if letters[-n:] != letters[-2 * n : -n] or letters[-n:] != letters[-3 * n : -2 * n]:
            continue
        away = np.max(np.abs(states[-n:] - states[-2 * n : -n]) / sizes)
        spans = times[-n:] - times[-2 * n : -n]
        turns = 0 if autonomous else round(float(spans[0]))
        away = max(away, np.max(np.abs(spans - (spans[0] if autonomous else turns))))
        if not turns and not autonomous:
            continue
        if away < CLOSED:
            return None if shorter else Periodic(letters[-n:], turns, at[-n:, 0], states[-n:])
        shorter |= bool(away < NEARLY)
    return None


def same_times(one, letters, turns, times, period, tolerance=1e-4):
    """Whether impacts are those of a motion, their word rotated perhaps, by their times."""
    if (len(letters), turns) != (len(one.letters), one.turns):
        return False
    if not letters:
        return True
    for k in range(len(letters)):
        if letters[k:] + letters[:k] == one.letters:
            turned = np.roll(times, -k)
            if turns:
                apart = (turned - one.times) / period
                apart -= np.round(apart)
            else:  # of a free period, the durations
                apart = np.diff(turned) - np.diff(one.times)
            if np.max(np.abs(apart), initial=0.0) < tolerance:
                return True
    return False


def distinct(found, period):
    """Periodic motions, each once."""
    kept = []
    for one in found:
        if not any(same_times(one, o.letters, o.turns, o.times, period) for o in kept):
            kept.append(one)
    return kept
