"""What a scene may ask for beside its branches: pictures, and curves in a second parameter."""

from __future__ import annotations

from dataclasses import dataclass

from ..continuation.settings import Settings

CURVE_SETTINGS = Settings(tolerance=1e-13, max_step=0.05, max_points=1000)
"""Numerics of curves in two parameters."""
FORMATS = ("svg", "png", "pdf")
SHOWN = ("period-1", "all", "none")
LABELS = ("all", "period-1", "real", "none")
QUANTITIES = ("velocity", "multipliers", "moduli", "energy", "U_I", "U_T", "gap", "period")
VOLTAGES = ("energy", "U_I", "U_T")
SCENE_SETTINGS = Settings(max_step=0.03)
"""Numerics of a scene that says nothing else; steps short enough for a smooth picture."""

MOST_BITS = 4096
"""Largest precision of proofs."""
LARGEST_TOLERANCE = 1e-3
LARGEST_SEED = 2**63 - 1
MOST_POINTS = 10**9
MOST_STARTS = 100_000
MOST_TRIES = 1000
"""Of corrector iterations, rounds of the search, and switches one after another."""
MOST_LINES = 1000
MOST_BRANCHES = 100_000


@dataclass(frozen=True)
class PlotOptions:
    """How the diagram is drawn: the parameter on the x axis, limits, on which branches unphysical
    orbits are shown (``period-1``, ``all``, ``none``), formats to write, which events are labelled
    (``all``, ``period-1``, ``real``, ``none``), whether the page is written, and the quantity on
    the y axis."""

    x: str
    xlim: tuple[float, float] | None = None
    ylim: tuple[float, float] | None = None
    unphysical: str = "period-1"
    formats: tuple[str, ...] = ("svg", "png")
    labels: str = "all"
    html: bool = False
    y: str = "velocity"


@dataclass(frozen=True)
class CurveOptions:
    """Which curves to follow in a second parameter.

    Attributes
    ----------
    parameter : str
    range : (low, high)
    kinds : sequence of str
        Kinds of the entries at which curves start.
    unphysical : sequence of str
        Kinds of which curves start also at entries of unphysical orbits.
    values : sequence of float
        Values of the second parameter to hit exactly.
    family : (name, values) or None
        A third parameter, and the values of it for which everything is repeated.
    settings : Settings
    start : sequence of float
        Further values of the second parameter at which curves start and are checked.
    cover : int
        How many lines in each direction must meet nothing new before a map is taken as complete;
        0 asks for none.
    third : (name, (low, high)) or None
        A parameter in which points of codimension two are followed.
    areas : bool
        Whether the rectangle is divided into areas by what ends the stable orbits.
    reach : int
        How many words away from the scene's the orbits may be whose curves start at points of
        codimension two.
    """

    parameter: str
    range: tuple[float, float]
    kinds: tuple[str, ...]
    unphysical: tuple[str, ...] = ()
    values: tuple[float, ...] = ()
    family: tuple[str, tuple[float, ...]] | None = None
    settings: Settings = CURVE_SETTINGS
    start: tuple[float, ...] = ()
    third: tuple[str, tuple[float, float]] | None = None
    cover: int = 0
    areas: bool = False
    reach: int = 1


@dataclass(frozen=True)
class CertifyOptions:
    """What ``contimpact certify`` proves.

    Attributes
    ----------
    bits : int
        Precision to begin with.
    max_bits : int
        Precision up to which it is doubled where a proof fails.
    branches : bool
        Whether branches are proven complete, besides their entries.
    events : sequence of str
        For which kinds of events; those the scene looks for.
    seconds : float
        Processor time that the proof of a branch may take; what is left then is unproven.
    """

    bits: int = 128
    max_bits: int = 512
    branches: bool = True
    events: tuple[str, ...] = ("FB", "PD", "G")
    seconds: float = 600.0
