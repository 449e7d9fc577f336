"""SymPy building blocks from which systems write flights that do not cancel.

Importing this module imports SymPy: systems do so inside `Model.formulas`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np
import sympy
from sympy import Expr, I, Integer, pi

from ..errors import InputError, short_repr
from .expressions import check_expression, sympy_expression, values_of
from .symbols import over_harmonics as over_harmonics
from .symbols import whole_quotient

MOST_HARMONICS = 64
MOST_TERMS = 300
MOST_DENOMINATOR = 10**6
"""Largest denominator of a rational number that a coefficient may be without looking like one."""
_SAMPLES = 1024


class Stumpff(sympy.Function):
    """The Stumpff function c_k(q); see `contimpact.segments.transients`."""

    nargs = 2

    def fdiff(self, argindex: int = 2) -> sympy.Expr:
        k, q = self.args
        return (k * Stumpff(k + 2, q) - Stumpff(k + 1, q)) / 2


class Transient(sympy.Function):
    r"""A free motion of :math:`\ddot x + c\dot x + kx = 0` at the time t, as ``(n, b, c, k, t)``.

    The inverse Laplace transform of :math:`s^n/(s^2 + cs + k)^b`, without impulses at t = 0: for
    b = 1, n = 0 is the motion from unit velocity, n = 1 its velocity, and k times n = -1 the fall
    from unit displacement. Neither these nor their derivatives cancel, whatever the damping.
    """

    nargs = 5

    def fdiff(self, argindex: int = 5) -> sympy.Expr:
        n, b, c, k, t = self.args
        if argindex == 5:
            return Transient(n + 1, b, c, k, t)
        return -b * Transient(n + 1 if argindex == 3 else n, b + 1, c, k, t)


class MeanTransient(sympy.Function):
    """The same divided by its power of the time, t^(2b-1-n): a mean over the motion so far."""

    nargs = 5

    def fdiff(self, argindex: int = 5) -> sympy.Expr:
        n, b, c, k, t = self.args
        by_c = -b * MeanTransient(n + 1, b + 1, c, k, t)
        by_k = -b * MeanTransient(n, b + 1, c, k, t)
        return {3: t * by_c, 4: t**2 * by_k, 5: c * by_c + 2 * k * t * by_k}[argindex]


def harmonic_means(
    a: Expr, b: Expr, w: Expr, t0: sympy.Expr, dt: sympy.Expr
) -> tuple[sympy.Expr, sympy.Expr]:
    r"""Integrate f(t) = a cos(w t) + b sin(w t) once and twice over a flight.

    Returns :math:`\frac{1}{\Delta}\int_0^\Delta f(t_0+s)\,ds` and
    :math:`\frac{1}{\Delta^2}\int_0^\Delta (\Delta-s) f(t_0+s)\,ds`. With x = w dt/2 and the phase
    taken at the middle of the flight these are P c_1(x^2) and [P c_1 + Q x (c_2 - c_3)]/2, the
    last factor being (sin x - x cos x)/x^2; no term cancels for short flights.
    """
    x = w * dt / 2
    middle = w * (t0 + dt / 2)
    p = a * sympy.cos(middle) + b * sympy.sin(middle)
    q = a * sympy.sin(middle) - b * sympy.cos(middle)
    c1, c2, c3 = (Stumpff(Integer(k), x**2) for k in (1, 2, 3))
    return p * c1, (p * c1 + q * x * (c2 - c3)) / 2


def driven_oscillator(
    waves: Sequence[tuple[Expr, Expr, Expr]],
    c: Expr,
    k: Expr,
    rest: Expr | float = 0,
    load: Expr | float = 0,
) -> tuple[Callable[..., Any], Callable[..., Any]]:
    r"""State the motion of an oscillator under harmonics (omega, a, b), as in
    `models.model.Formulas`.

    .. math:: \ddot x + c\dot x + k(x - x_r) = l + \sum_i a_i\cos\omega_i t + b_i\sin\omega_i t.

    It is a steady response plus a transient, for any damping, but not at undamped resonance. The
    load l is a constant force; where the motion begins at x_r, nothing is lost to the difference of
    x and x_r however large k is. Returns the flight and the acceleration.
    """
    response = []
    for w, a, b in waves:
        denominator = (k - w**2) ** 2 + (c * w) ** 2
        in_phase = (a * (k - w**2) - b * c * w) / denominator
        response.append((w, in_phase, (b * (k - w**2) + a * c * w) / denominator))

    def steady(t: Expr) -> Expr:
        return sum(p * sympy.cos(w * t) + q * sympy.sin(w * t) for w, p, q in response)

    def steady_rate(t: Expr) -> Expr:
        return sum(w * (q * sympy.cos(w * t) - p * sympy.sin(w * t)) for w, p, q in response)

    def flight(
        t0: Expr, x0: Sequence[Expr], v0: Sequence[Expr], dt: Expr
    ) -> tuple[list[Expr], list[Expr]]:
        # With A, B the free motions from unit displacement and from unit velocity,
        #   x1 - x0 = [p(t1) - p(t0)] + (x0 - p0)(A - 1) + (v0 - p0') B,
        # each bracket divided by dt in closed form. 1 - A is k times the integral of B.
        def motion(kind: type[sympy.Function], n: int) -> Expr:
            return kind(Integer(n), Integer(1), c, k, dt)

        middle = t0 + dt / 2
        steady_mean = sum(
            Stumpff(Integer(1), (w * dt / 2) ** 2)
            * (w * (q * sympy.cos(w * middle) - p * sympy.sin(w * middle)))
            for w, p, q in response
        )
        offset, rate = x0[0] - rest - load / k - steady(t0), v0[0] - steady_rate(t0)
        fall = k * dt * motion(MeanTransient, -1)  # (1 - A)/dt
        mean = steady_mean - offset * fall + rate * motion(MeanTransient, 0)
        # A' = -k B
        speed = (
            steady_rate(t0 + dt) - offset * k * motion(Transient, 0) + rate * motion(Transient, 1)
        )
        return [mean], [speed]

    def acceleration(t: Expr, x: Sequence[Expr], v: Sequence[Expr]) -> list[Expr]:
        drive = sum(a * sympy.cos(w * t) + b * sympy.sin(w * t) for w, a, b in waves)
        return [load + drive - c * v[0] - k * (x[0] - rest)]

    return flight, acceleration


def fourier_series(
    text: str, where: str, period: sympy.Expr, parameters: Mapping[str, Expr] | None = None
) -> tuple[Expr, list[tuple[int, Expr, Expr]]]:
    """Expand a periodic function of ``t`` into a finite sum of harmonics: the mean and (k, a_k,
    b_k) of f(t) = mean + sum of a_k cos(2 pi k t/period) + b_k sin(2 pi k t/period).

    Sums and products of sines and cosines are expanded exactly, unless that makes more than about
    `MOST_TERMS` terms; only they may have parameters in them. Any other smooth function is sampled;
    its series must have died out to rounding within `MOST_HARMONICS` terms.

    Raises InputError if the text cannot be read, is not periodic, not finite or not smooth enough.
    """
    coefficients = None
    symbols = dict(parameters or {})
    if check_expression(text, where, ("t", *symbols)) <= MOST_TERMS:
        t = sympy.Dummy("t", real=True)
        expression = sympy_expression(text, where, {"t": t, **symbols})
        if expression.has(sympy.oo, -sympy.oo, sympy.zoo, sympy.nan):
            raise InputError(where, f"{text!r} is not finite", "use a function that is finite")
        held: dict[Expr, Expr] = {}
        coefficients = _exact_coefficients(
            _hold_parameters(expression, t, held), t, text, where, period
        )
        let_go = {dummy: e for e, dummy in held.items()}
        if coefficients is not None:
            coefficients = [(k, a.xreplace(let_go), b.xreplace(let_go)) for k, a, b in coefficients]
    if coefficients is None and symbols:
        found = f"{short_repr(text)} is no sum of harmonics for all values of {', '.join(symbols)}"
        raise InputError(where, found, "use sums and products of sines and cosines, with numbers")
    if coefficients is None:
        coefficients = _sampled_coefficients(text, where, period)
    if max((k for k, a, b in coefficients), default=0) > MOST_HARMONICS:
        raise InputError(
            where, f"{text!r} has harmonics above order {MOST_HARMONICS}", "use fewer harmonics"
        )
    mean = sum((a for k, a, b in coefficients if k == 0), Integer(0))
    return mean, [(k, a, b) for k, a, b in coefficients if k > 0]


def _hold_parameters(e: Expr, t: Expr, held: dict[Expr, Expr]) -> Expr:
    """An expression whose parts in parameters alone are symbols, which expanding leaves alone."""
    if e.has(t):
        return e.func(*(_hold_parameters(a, t, held) for a in e.args)) if e.args else e
    if e.is_Symbol or not e.free_symbols:
        return e
    return held.setdefault(e, sympy.Dummy(real=True))


def _exact_coefficients(
    expression: sympy.Expr, t: sympy.Symbol, text: str, where: str, period: sympy.Expr
) -> list[tuple[int, Expr, Expr]] | None:
    """(k, a_k, b_k) of a trigonometric polynomial; None if the expression is not one."""
    amplitudes: dict[int, Expr] = {}
    for term in sympy.Add.make_args(sympy.expand(expression.rewrite(sympy.exp))):
        factor, moving = sympy.powsimp(term).as_independent(t)
        if moving != 1 and not isinstance(moving, sympy.exp):
            return None
        exponent = sympy.expand(moving.args[0]) if moving != 1 else Integer(0)
        if not exponent.is_polynomial(t) or sympy.degree(exponent, t) > 1:
            return None
        rate, still = exponent.coeff(t, 1), exponent.coeff(t, 0)
        k = whole_quotient(rate * period / (2 * pi * I))
        if k is None:
            accepted = (
                f"use harmonics such as cos({sympy.sstr(2 * pi / period)}*t), "
                f"cos({sympy.sstr(4 * pi / period)}*t)"
            )
            raise InputError(where, f"{text!r} does not have the period {period}", accepted)
        amplitudes[k] = amplitudes.get(k, 0) + factor * sympy.exp(still)
    _require_real(amplitudes, text, where)
    orders = sorted({abs(k) for k in amplitudes})
    result = []
    for k in orders:
        positive, negative = amplitudes.get(k, 0), amplitudes.get(-k, 0)
        cosine = positive + negative if k else positive
        sine = I * (positive - negative) if k else Integer(0)
        result.append((k, _exact_number(cosine), _exact_number(sine)))
    return [(k, a, b) for k, a, b in result if (a, b) != (0, 0)]


def _require_real(amplitudes: Mapping[int, Expr], text: str, where: str) -> None:
    """Refuse what is not finite, or not real for real t: c_-k has to be the conjugate of c_k."""
    free = sorted(
        set().union(*(sympy.sympify(c).free_symbols for c in amplitudes.values())), key=str
    )
    some = {symbol: sympy.Float(0.37 + 0.11 * i, 30) for i, symbol in enumerate(free)}
    numbers = {k: complex(sympy.sympify(c).subs(some).evalf(30)) for k, c in amplitudes.items()}
    size = max(map(abs, numbers.values()), default=0.0)
    if not math.isfinite(size):
        raise InputError(where, f"{text!r} is not finite", "use a function that is finite")
    if any(abs(numbers.get(-k, 0) - c.conjugate()) > 1e-12 * size for k, c in numbers.items()):
        raise InputError(where, f"{text!r} is not real", "use a function that is real for real t")


def _exact_number(value: Expr) -> Expr:
    """A number as a rational if it is one, else as a 53-bit float; with parameters as it is."""
    if value.free_symbols:
        return sympy.simplify(sympy.expand_complex(value).as_real_imag()[0])
    number = sympy.re(value.evalf(30))
    near = Fraction(str(number)).limit_denominator(MOST_DENOMINATOR)
    if abs(number - sympy.Rational(near)) <= 1e-25 * max(1, abs(number)):
        value = sympy.simplify(sympy.expand_complex(value))
    return value if value.is_Rational else sympy.Float(number, 17)


def _sampled_coefficients(
    text: str, where: str, period: sympy.Expr
) -> list[tuple[int, Expr, Expr]]:
    length = float(period)
    times = length * np.arange(_SAMPLES) / _SAMPLES
    with np.errstate(all="ignore"):
        values = values_of(text, where, {"t": times}) + 0.0 * times
        later = values_of(text, where, {"t": times + length}) + 0.0 * times
    if values.dtype.kind != "f" or not np.all(np.isfinite(values)):
        raise InputError(
            where, f"{text!r} is not finite and real over a period", "use a smooth function"
        )
    size = float(np.max(np.abs(values)))
    differs = np.abs(values - later) > 1e-11 * max(size, 1.0)
    if np.any(differs):
        if np.all(np.abs(values[differs]) > 1e9 * np.median(np.abs(values))):
            found = f"{text!r} is not finite near t = {times[differs][0]:.6g}"
            raise InputError(where, found, "use a smooth function")
        accepted = (
            f"use a function of sin({sympy.sstr(2 * pi / period)}*t) and "
            f"cos({sympy.sstr(2 * pi / period)}*t)"
        )
        raise InputError(where, f"{text!r} does not have the period {period}", accepted)
    spectrum = np.fft.rfft(values) / _SAMPLES
    if np.max(np.abs(spectrum[MOST_HARMONICS + 1 :])) > 1e-15 * max(size, 1e-300):
        raise InputError(
            where,
            f"the Fourier series of {text!r} has not died out after {MOST_HARMONICS} harmonics",
            "use a smoother function or a sum of harmonics",
        )
    kept = [k for k in range(MOST_HARMONICS + 1) if abs(spectrum[k]) > 1e-16 * size]
    doubled = {k: 1 if k == 0 else 2 for k in kept}
    waves = ((k, doubled[k] * spectrum[k].real, -doubled[k] * spectrum[k].imag) for k in kept)
    return [(k, sympy.Float(float(a), 17), sympy.Float(float(b), 17)) for k, a, b in waves]
