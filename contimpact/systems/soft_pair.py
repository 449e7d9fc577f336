r"""The inclined impact pair with soft membranes at both ends, and a ball that is not weightless.

A force A f shakes the capsule of mass M and holds the weights of both bodies; with the membrane's
force F on the ball of mass m,

.. math:: \ddot Z = f(t) + \bar g - \frac{M}{A m_*} F, \qquad m_* = \frac{mM}{m+M}, \qquad
          \bar g = \frac{(m+M) g \sin\beta}{A},

in the units of the impact pair: Z alone is a coordinate, since the capsule is attached to nothing.
With the deflection delta beyond :math:`|Z| = d/2`, in metres,

.. math:: F = Y'(\delta)\Bigl(\frac{2k}{\nu+1}\,Y(\delta) + c\,\dot\delta\Bigr), \qquad
          Y = \delta\,(\delta^2 + \delta_0^2)^{(\nu-1)/4} :

a spring and a damper for nu = 1, else a force :math:`k\delta^\nu` that is linear below delta_0
(Table A1 of the paper on vibro-impact pairs has K and nu). As
:math:`m_* \dot\delta\,d\dot\delta/dY = -(2kY/(\nu+1) + c\dot\delta)` is that of a damped
oscillator, a ball under no other force leaves with r times its velocity, whatever that is, where

.. math:: c = 2\zeta\sqrt{2 k m_*/(\nu+1)}, \qquad r = e^{-\pi\zeta/\sqrt{1-\zeta^2}}.

Contact begins at B or T and ends, at b or t, where the membrane is flat again, as is usual for
these laws: at its end the damper pulls.

With dry friction on the incline, which presses on the ball with :math:`mg\cos\beta` whatever the
membranes do, :math:`\ddot Z` has the term :math:`-\phi\,\mathrm{sign}\,\dot Z`, in contact, too,

.. math:: \phi = \frac{M}{A m_*}\,\mu m g\cos\beta = \frac{\mu (m+M) g\cos\beta}{A},

and the ball sticks where :math:`\dot Z = 0` and no more than phi is needed to hold it: each of
the three laws has a surface on which it slides, in Filippov's sense.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar, Self, cast

from ..errors import InputError, short_repr
from ..models.model import (
    Acceleration,
    Example,
    Formulas,
    Guard,
    Harmonics,
    Jump,
    Mode,
    Parameter,
    Symmetry,
)
from ..models.switching import ABOVE, BELOW, SLIDING, switching_guards, switching_modes
from .impact_pair import ImpactPair
from .membrane import Membrane

LINEAR, POWER = "linear", "power"


class SoftPair(ImpactPair):
    """A ball between soft membranes in an inclined, shaken capsule; units of the impact pair.

    With nu = 1 all flights are in closed form; otherwise contacts are integrated, which takes the
    extra ``ode``.

    Parameters
    ----------
    beta, A, s, M, omega, g, forcing
        As of `ImpactPair`.
    r, or r_B and r_T : float
        Restitution of the membranes where no other force acts, above 0, at most 1: it sets their
        damping.
    k, or k_B and k_T : float
        Stiffness of the membranes at both ends, or at the bottom and the top, N/m^nu.
    m : float, default 4.11e-3
        Mass of the ball, kg.
    nu : float, default 1
        Exponent of the membranes' force.
    delta_0 : float, default 1e-4
        Deflection below which the force is linear, m.
    membrane : str
        ``"linear"`` or ``"power"``: the second unless nu is 1. To follow nu from 1 on, say
        ``"power"``.
    mu : float, default 0
        Coefficient of dry friction. Unless it is 0 the pair is a `FrictionalSoftPair`, which has
        more modes and letters.
    """

    SYSTEM = "soft-pair"
    MODES: ClassVar[tuple[Mode, ...]] = (Mode("free"), Mode("bottom"), Mode("top"))
    WALLS: ClassVar[tuple[Guard, ...]] = (
        Guard("B", side=+1, mode="free", to="bottom"),
        Guard("T", side=-1, mode="free", to="top"),
        Guard("b", side=-1, mode="bottom", to="free"),
        Guard("t", side=+1, mode="top", to="free"),
    )
    DERIVED_FROM: ClassVar = {**ImpactPair.DERIVED_FROM, "gbar": ("beta", "A", "M", "m", "g")}
    MEMBRANES = False
    OPTIONS: ClassVar = {**ImpactPair.OPTIONS, "membrane": LINEAR}
    PARAMETERS = (
        *(p for p in ImpactPair.PARAMETERS if p.name != "r"),
        Parameter("r", "", "the restitution of a membrane", None, 0, 1, True, split=("r_B", "r_T")),
        Parameter(
            "k", "N/m", "a membrane's stiffness", None, 0, above_lower=True, split=("k_B", "k_T")
        ),
        Parameter("m", "kg", "the ball's mass", Membrane().m, lower=0, above_lower=True),
        Parameter("nu", "", "the exponent of a membrane's force", 1.0, lower=1),
        Parameter("delta_0", "m", "the deflection of linear force", 1e-4, 0, above_lower=True),
    )
    EXAMPLE = Example(
        {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.45, "k": 500.0},
        ("s", 0.2, 0.6),
        ["BbTt"],
        ("k", 200.0, 2000.0),
        plot=('x = "d"', "the dimensionless length"),
    )

    def __new__(cls, /, **given: Any) -> Self:
        """Return a pair with friction where mu is given: it has other modes."""
        frictional = cls is SoftPair and given.get("mu", 0.0) != 0.0
        return object.__new__(FrictionalSoftPair if frictional else cls)  # type: ignore[return-value]

    def __init__(self, /, **given: Any) -> None:
        if type(self) is SoftPair and "mu" in given:
            del given["mu"]  # it is 0
        law = LINEAR if given.get("nu", 1.0) == 1.0 else POWER
        super().__init__(**{"membrane": law} | given)

    def validate(self) -> None:
        """Refuse a membrane that is stated to be linear and is not."""
        law, nu = self.options["membrane"], self.values["nu"]
        if law not in (LINEAR, POWER):
            accepted = f"give {LINEAR!r} or {POWER!r}"
            raise InputError("membrane", f"found {short_repr(law)}", accepted)
        if law == LINEAR and nu != 1.0:
            found = f"the membrane is stated to be linear, and nu is {nu!r}"
            raise InputError("nu", found, f"give membrane = {POWER!r}, which needs contimpact[ode]")
        if law == LINEAR:
            self._refuse_resonance()

    def _refuse_resonance(self) -> None:
        """Refuse an undamped membrane on which the ball swings with a harmonic of the forcing."""
        value = self.values
        for letter in "BT":
            r, k = (value[n if n in value else f"{n}_{letter}"] for n in "rk")
            ratio = math.sqrt(k * (1 / value["m"] + 1 / value["M"])) / value["omega"]
            if r == 1 and math.isclose(ratio, max(round(ratio), 1), rel_tol=1e-15):
                found = "undamped, a contact is at resonance: it has no periodic response"
                raise InputError("omega", found, "give r below 1 or another frequency")

    def symmetry(self, parameter: str, harmonics: Sequence[float]) -> Symmetry | None:
        """That of the pair, between equal membranes; `harmonics` are of no use, with three laws."""
        split = "k" not in self.values
        if split and (parameter in ("k_B", "k_T") or self.values["k_B"] != self.values["k_T"]):
            return None
        level = self.values["beta"] == 0 or self.values["g"] == 0
        if not (level and self._turns_after_half_a_period()):
            return None
        found = super().symmetry(parameter, (0.0,))
        return found and Symmetry({**found.walls, "b": "t", "t": "b"}, found.shift, found.sign)

    def _turns_after_half_a_period(self) -> bool:
        """Whether f(t + 1) = -f(t)."""
        import numpy as np

        from ..models.expressions import values_of

        own, t = {name: self.values[name] for name in self.own}, np.arange(256) / 256
        now, later = (
            values_of(self.options["forcing"], "forcing", {"t": t + half, **own}) for half in (0, 1)
        )
        return bool(np.max(abs(now + later)) <= 1e-12 * np.max(abs(now)))

    def formulas(self, symbols: Mapping[str, Any]) -> Formulas:
        """The pair's flight, with more gravity, and the motion against each membrane."""
        m, M = symbols["m"], symbols["M"]
        pair = super().formulas({**symbols, "g": symbols["g"] * (1 + m / M)})
        motions = {
            "free": (pair.flight, pair.acceleration),
            "bottom": self._contact(symbols, pair, "B"),
            "top": self._contact(symbols, pair, "T"),
        }
        return Formulas(
            period=pair.period,
            walls={**pair.walls, "b": pair.walls["B"], "t": pair.walls["T"]},
            derived=pair.derived,
            flight={mode: flight for mode, (flight, _) in motions.items()},
            acceleration={mode: acceleration for mode, (_, acceleration) in motions.items()},
        )

    def _contact(self, symbols: Mapping[str, Any], pair: Formulas, letter: str) -> Any:
        """The flight and the acceleration in contact, by the distance from the flat membrane."""
        import sympy

        r, k = (symbols.get(name, symbols.get(f"{name}_{letter}")) for name in "rk")
        m, M, A, omega, nu = (symbols[name] for name in ("m", "M", "A", "omega", "nu"))
        reduced, rest = m * M / (m + M), pair.walls[letter]
        free = cast(Acceleration, pair.acceleration)
        zeta = -sympy.log(r) / sympy.sqrt(sympy.pi**2 + sympy.log(r) ** 2)
        if self.options["membrane"] == LINEAR:
            from ..models.symbolic import driven_oscillator

            constant, harmonics = cast(Harmonics, pair.harmonics)
            waves = [(n * sympy.pi, a, b) for n, a, b in harmonics]
            stiffness = sympy.pi**2 * k / (reduced * omega**2)
            damping = 2 * zeta * sympy.sqrt(stiffness)
            return driven_oscillator(waves, damping, stiffness, rest, constant)
        from ..models.nonlinear import Nonlinear

        unit, per_time = A * sympy.pi**2 / (M * omega**2), omega / sympy.pi
        spring = 2 * k / (nu + 1)
        damper = 2 * zeta * sympy.sqrt(spring * reduced)

        def law(t: Any, x: Sequence[Any], v: Sequence[Any]) -> list[Any]:
            delta = unit * (x[0] - rest)
            size = delta**2 + symbols["delta_0"] ** 2
            root = size ** ((nu - 1) / 4)
            slope = root * (1 + (nu - 1) * delta**2 / (2 * size))
            force = slope * (spring * delta * root + damper * unit * per_time * v[0])
            return [free(t, x, v)[0] - M / (A * reduced) * force]

        motion = Nonlinear(law)
        return motion.flight, motion.acceleration


DOWN, STICK, UP = "down", "stick", "up"
MOTIONS = {BELOW: UP, SLIDING: STICK, ABOVE: DOWN}
"""What the modes of a surface are called where the velocity is the distance from it."""
ZONES = {"free": "SPARCD", "bottom": "sparcd", "top": "kmnluw"}
"""The letters at which the ball stops, or begins to move, where it is free and on each membrane: in
the place of those of `switching_guards`, in their order, S, P, A, B, C and D."""


def _zone(name: str, letters: str) -> tuple[list[Mode], list[Guard]]:
    """The modes and guards of a surface at the velocity zero, by other names."""
    modes = {m.name: replace(m, name=f"{name} {MOTIONS[m.name]}") for m in switching_modes(2)}
    own = {g.name: letter for g, letter in zip(switching_guards(1), letters, strict=True)}
    guards = [
        replace(
            guard,
            name=own[guard.name],
            mode=modes[guard.modes[0]].name,
            to=modes[guard.next_mode].name,
            past=own.get(guard.past, ""),
        )
        for guard in switching_guards(1)
    ]
    return list(modes.values()), guards


PARTS = [_zone(name, letters) for name, letters in ZONES.items()]


class FrictionalSoftPair(SoftPair):
    """A soft pair with dry friction on the incline, of coefficient mu > 0: the ball sticks and
    slips.

    `SoftPair` is this where it is given mu. Its coordinates are Z and its velocity, both of first
    order; in stick the second is what holds the ball, as a part of the greatest friction.
    """

    DEGREES_OF_FREEDOM = 2
    MODES = (*sorted(PARTS[0][0], key=lambda m: m.name), *PARTS[1][0], *PARTS[2][0])
    WALLS = (
        Guard("B", side=+1, mode=f"free {DOWN}", to=f"bottom {DOWN}"),
        Guard("T", side=-1, mode=f"free {UP}", to=f"top {UP}"),
        Guard("b", side=-1, mode=f"bottom {UP}", to=f"free {UP}"),
        Guard("t", side=+1, mode=f"top {DOWN}", to=f"free {DOWN}"),
        *(guard for _, guards in PARTS for guard in guards),
    )
    GEOMETRY = None
    PARAMETERS = (
        *SoftPair.PARAMETERS,
        Parameter(
            "mu",
            "",
            "the friction coefficient",
            None,
            0,
            above_lower=True,
            apart="0 where it is not followed: a pair without friction has other letters",
        ),
    )

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The names of the coordinates."""
        return "Z", "V"

    def validate(self) -> None:
        """Refuse a ball that does not press on the incline."""
        super().validate()
        if self.values["g"] == 0 or abs(self.values["beta"]) == math.pi / 2:
            found = "the ball does not press on the incline"
            raise InputError("mu", found, "leave it out: there is no friction")

    def symmetry(self, parameter: str, harmonics: Sequence[float]) -> Symmetry | None:
        """That of the pair, with up for down."""
        found = super().symmetry(parameter, harmonics)
        if found is None:
            return None
        free, bottom, top = ZONES.values()
        turned = {
            own: free["SPABCD".index(other)] for own, other in zip(free, "BAPSDC", strict=True)
        }
        there = dict(zip(free, top, strict=True))
        across = {own: there[turned[o]] for o, own in zip(free, bottom, strict=True)}
        back = {other: own for own, other in across.items()}
        return Symmetry({**found.walls, **turned, **across, **back}, found.shift, found.sign)

    def formulas(self, symbols: Mapping[str, Any]) -> Formulas:
        """The laws of the soft pair, each with friction either way, and sliding between."""
        import sympy

        from ..models.filippov import Filippov

        soft = super().formulas(symbols)
        laws = cast(Mapping[str, Acceleration], soft.acceleration)
        mu, m, M, g, beta, A = (symbols[name] for name in ("mu", "m", "M", "g", "beta", "A"))
        most = mu * (m + M) * g * sympy.cos(beta) / A

        def moving(law: Acceleration, friction: Any) -> Any:
            return lambda t, x: [x[1], law(t, x[:1], x[1:])[0] + friction]

        flights, accelerations = dict[str, Any](), dict[str, Any]()
        jumps = dict[str, tuple[Jump, str]]()
        walls = dict(soft.walls)
        for (zone, letters), law in zip(ZONES.items(), laws.values(), strict=True):
            sides = moving(law, most), moving(law, -most)
            found = Filippov(*sides, (0, 1), 0, soft.period).formulas()
            for stated, kept in ((found.flight, flights), (found.acceleration, accelerations)):
                laws_there = cast(Mapping[str, Any], stated)
                kept.update({f"{zone} {MOTIONS[n]}": law for n, law in laws_there.items()})
            there = cast(Jump, found.jump)
            jumps |= {own: (there, o) for own, o in zip(letters, found.walls, strict=True)}
            walls |= dict(zip(letters, found.walls.values(), strict=True))

        def jump(
            guard: str, x: Sequence[Any], v: Sequence[Any]
        ) -> tuple[Sequence[Any], Sequence[Any]]:
            if guard not in jumps:
                return x, []
            at, letter = jumps[guard]
            return at(letter, x, v)

        return Formulas(
            period=soft.period,
            walls=walls,
            derived=soft.derived,
            jump=jump,
            flight=flights,
            acceleration=accelerations,
        )
