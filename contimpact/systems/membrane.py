r"""The membranes of the inclined impact pair as an energy harvester: the voltage of an impact.

The ball deforms the dielectric membrane it hits; the voltage the membrane gives grows with the
square of its area. With an impact's velocity V, by Table A1 of the paper on vibro-impact pairs,

.. math:: \delta = \Bigl[\frac{\nu+1}{2K} m V^2\Bigr]^{1/(\nu+1)}, \quad
          U = \Bigl[\Bigl(\frac{A}{\pi R_c^2}\Bigr)^2 - 1\Bigr] U_{in},

written so that nothing cancels at low velocities. The paper does not give the mass m of the ball.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from ..errors import InputError, explain_arguments
from ..schema import documented, key

if TYPE_CHECKING:
    from ..arrays import Array

STEEL = 7850.0
"""Density of steel, kg/m^3; the ball is taken to be of steel where nothing else is said."""
RADIUS = 5.0e-3
SOFT = "delta_0"
"""A parameter that only the soft pair has."""


@explain_arguments
@documented
@dataclass(frozen=True)
class Membrane:
    """Membranes and ball of the energy harvester.

    Raises
    ------
    InputError
        If a value is not positive, or the ball not smaller than the membrane.
    """

    m: float = key(
        STEEL * 4.0 / 3.0 * math.pi * RADIUS**3,
        "mass of the ball, kg; not in the paper: by default that of a steel ball of its radius",
        shown="4.110e-3",
        above=0,
    )
    U_in: float = key(2000.0, "input voltage, V", above=0)
    R_c: float = key(6.3e-3, "radius of the undeformed membrane, m", above=0)
    R_b: float = key(RADIUS, "radius of the ball, m; smaller than `R_c`", above=0)
    K: float = key(
        4.0847e5, "coefficient of the membrane's elastic force K delta^nu, N/m^nu", above=0
    )
    nu: float = key(2.6, "its exponent", above=0)

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(field.name, f"found {value!r}", "give a number > 0")
        if not self.R_b < self.R_c:
            accepted = "give a ball smaller than the membrane"
            raise InputError("R_b", f"{self.R_b!r} is not below R_c = {self.R_c!r}", accepted)

    def scale(self, parameters: Mapping[str, Any]) -> Any:
        """Return the dimensional velocity of one unit of the impact pair's, m/s."""
        return velocity_scale(parameters)

    def slope(self, velocity: Any) -> Array:
        """Return the derivative of the voltage by the velocity, V s/m; arguments as `voltage`."""
        import numpy as np

        v = np.asarray(velocity, dtype=float)
        speed, power = np.abs(v), 1.0 / (self.nu + 1.0)
        depth = ((self.nu + 1.0) / (2.0 * self.K) * self.m * speed**2) ** power
        h = self.R_b - depth
        q = np.sqrt(self.R_c**2 - depth * (2.0 * self.R_b - depth))
        cosine = (self.R_b * h + self.R_c * q) / (self.R_c**2 + h**2)
        falling = (self.R_b + self.R_c * h / q - 2.0 * h * cosine) / (self.R_c**2 + h**2)
        missing = 1.0 - cosine  # its derivative by the depth is `falling`
        area = missing * (self.R_c**2 - self.R_b**2 * missing) / (self.R_c**2 * cosine)
        rate = (1.0 - 2.0 * (self.R_b / self.R_c) ** 2 * missing + area) / cosine * falling
        deepening = np.where(speed > 0.0, 2.0 * power * depth / np.where(v == 0.0, 1.0, v), 0.0)
        return np.asarray(2.0 * self.U_in * (1.0 + area) * rate * deepening)

    def voltage(self, velocity: Any) -> Array:
        """Return the net output voltage of impacts.

        Parameters
        ----------
        velocity : array_like
            Dimensional velocities before impact, m/s.

        Returns
        -------
        ndarray
            U_k in V, zero for an impact without velocity.
        """
        import numpy as np

        speed = np.asarray(velocity, dtype=float)
        depth = ((self.nu + 1.0) / (2.0 * self.K) * self.m * speed**2) ** (1.0 / (self.nu + 1.0))
        # with e = delta (2 R_b - delta), h = R_b - delta, q = sqrt(R_c^2 - e) the cone touches the
        # ball where sin alpha = e/(R_c R_b + h q), and the area exceeds that at rest by the factor
        # 1 + x, x = (1 - cos alpha)(R_c^2 - R_b^2 (1 - cos alpha))/(R_c^2 cos alpha)
        e = depth * (2.0 * self.R_b - depth)
        h = self.R_b - depth
        q = np.sqrt(self.R_c**2 - e)
        cosine = (self.R_b * h + self.R_c * q) / (self.R_c**2 + h**2)
        sine = (self.R_c * self.R_b - h * q) / (self.R_c**2 + h**2)
        shallow = h > 0.0
        divisor = np.where(shallow, self.R_c * self.R_b + h * q, 1.0)
        sine = np.where(shallow, e / divisor, sine)
        missing = np.where(cosine > 0.0, sine**2 / (1.0 + np.abs(cosine)), 1.0 - cosine)
        x = missing * (self.R_c**2 - self.R_b**2 * missing) / (self.R_c**2 * cosine)
        return np.asarray(self.U_in * x * (2.0 + x))


def velocity_scale(parameters: Mapping[str, Any]) -> Any:
    """Return A pi/(M omega), the dimensional velocity of one unit of the impact pair's, m/s.

    Raises InputError if the parameters are not those of an impact pair.
    """
    try:
        amplitude, mass, omega = (parameters[name] for name in ("A", "M", "omega"))
    except KeyError as error:
        found = f"the system has no parameter {error}"
        raise InputError("energy", found, "use the impact pair") from None
    if SOFT in parameters:  # it leaves its membranes at events of its own, which are no impacts
        found = f"a pair whose contacts last: it has a parameter {SOFT!r}"
        raise InputError("energy", found, "use the impact pair")
    return amplitude * math.pi / (mass * omega)
