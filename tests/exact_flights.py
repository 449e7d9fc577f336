"""Exact flights of the impact pair and of the oscillator, in many digits."""

from __future__ import annotations

import mpmath as mp

from contimpact.systems.impact_pair import ImpactPair


def _bessel_series():
    """exp(cos x)/3 = [I_0(1) + 2 sum of I_k(1) cos k x]/3."""
    return mp.besseli(0, 1) / 3, [(k, 2 * mp.besseli(k, 1) / 3, 0) for k in range(1, 40)]


FORCINGS = {
    "cos(pi*t)": lambda: (0, [(1, 1, 0)]),
    "sin(pi*t)": lambda: (0, [(1, 0, 1)]),
    "cos(pi*t)**3": lambda: (0, [(1, mp.mpf(3) / 4, 0), (3, mp.mpf(1) / 4, 0)]),
    "cos(pi*t+0.3)+sin(4*pi*t)/5-1/8": lambda: (
        -mp.mpf(1) / 8,
        [(1, mp.cos(mp.mpf(0.3)), -mp.sin(mp.mpf(0.3))), (4, 0, mp.mpf(1) / 5)],
    ),
    "cos(pi*t)*cos(2*pi*t)*sin(3*pi*t)": lambda: (0, [(k, 0, mp.mpf(1) / 4) for k in (2, 4, 6)]),
    "exp(cos(pi*t))/3": _bessel_series,
}
"""Forcing texts and, for each, mean and [(k, a_k, b_k), ...], known in closed form."""


def pair_flight(values, forcing, a, b, t0, v0, t1, v1):
    """Residual of an impact pair's flight and the sizes of its terms.

    Velocity and displacement from the integrals F1 and F2 of the forcing, as in equations (11) and
    (12) of the paper; the displacement is divided by the duration between impacts on one wall.
    """
    mean, series = FORCINGS[forcing]()
    length = values["M"] * values["omega"] ** 2 * values["s"] / (values["A"] * mp.pi**2)
    constant = values["M"] * values["g"] * mp.sin(values["beta"]) / values["A"] + mean
    wall = {"B": length / 2, "T": -length / 2}
    r = values["r"] if "r" in values else values[f"r_{a}"]
    after, dt = -r * v0, t1 - t0

    def once(t):
        return sum(
            (p * mp.sin(k * mp.pi * t) - q * mp.cos(k * mp.pi * t)) / (k * mp.pi)
            for k, p, q in series
        )

    def twice(t):
        return -sum(
            (p * mp.cos(k * mp.pi * t) + q * mp.sin(k * mp.pi * t)) / (k * mp.pi) ** 2
            for k, p, q in series
        )

    velocity = after + constant * dt + once(t1) - once(t0)
    shift = (after - once(t0)) * dt + constant * dt**2 / 2 + twice(t1) - twice(t0)
    position = shift / dt if a == b else wall[a] + shift - wall[b]
    pushes = [
        (mp.hypot(p, q) * min(dt / 2, 1 / (k * mp.pi)), mp.hypot(p, q) * min(dt, 2 / (k * mp.pi)))
        for k, p, q in series
    ]
    mean_size = abs(after) + abs(constant) * dt / 2 + sum(push[0] for push in pushes)
    position_size = mean_size if a == b else length + dt * mean_size
    velocity_size = abs(after) + abs(constant) * dt + sum(push[1] for push in pushes) + abs(v1)
    return [position, velocity - v1], [position_size, velocity_size]


def oscillator_flight(values, a, b, t0, v0, t1, v1):
    """Residual of an oscillator's flight (it has one wall) and the sizes of its terms.

    Steady response in complex amplitudes; the transient from the roots of s^2 + c s + k.
    """
    amplitude, w, c, k, sigma, r = (values[n] for n in ("a", "omega", "c", "k", "sigma", "r"))
    response = amplitude / mp.mpc(k - w**2, c * w)

    def steady(t):
        return mp.re(response * mp.expj(w * t)), mp.re(1j * w * response * mp.expj(w * t))

    dt = t1 - t0
    half = mp.sqrt(mp.mpc(c**2 / 4 - k))
    p0, rate0 = steady(t0)
    x, v = sigma - p0, -r * v0 - rate0
    decay = mp.exp(-c / 2 * dt)
    if half == 0:
        one, other = x, v + c / 2 * x
        now = decay * (one + other * dt)
        speed = decay * (other - c / 2 * (one + other * dt))
    else:
        one, other = x, (v + c / 2 * x) / half
        now = decay * (one * mp.cosh(half * dt) + other * mp.sinh(half * dt))
        speed = -c / 2 * now + decay * half * (
            one * mp.sinh(half * dt) + other * mp.cosh(half * dt)
        )
    p1, rate1 = steady(t1)
    position, velocity = mp.re(now) + p1, mp.re(speed) + rate1
    size = abs(x) + abs(v) + abs(response) * (1 + w) + abs(v1)
    return [(position - sigma) / dt, velocity - v1], [size / min(dt, 1), size]


def exact_flight(model, a, b, ends, changes=None):
    """Residual of a flight and the sizes of its terms, in mpmath, from the model's own doubles.

    Parameters
    ----------
    ends : (t0, v0, t1, v1)
    changes : dict, optional
        Parameter values to use in place of the model's.
    """
    values = {name: mp.mpf(value) for name, value in model.values.items()} | (changes or {})
    ends = [mp.mpf(end) for end in ends]
    if isinstance(model, ImpactPair):
        return pair_flight(values, model.options["forcing"], a, b, *ends)
    return oscillator_flight(values, a, b, *ends)
