"""A commented scene to start from, for each system of the package.

What a parameter means is told by its declaration. A scene asks for little, and shows in comments
what else could be asked for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ..errors import InputError, did_you_mean, explain_arguments, short_repr
from ..models.model import Model, Parameter
from ..systems import SYSTEMS, summary, system


@dataclass(frozen=True)
class _Start:
    """What a scene asks of a system: values, a parameter to follow with its range, orbits."""

    values: Mapping[str, float | str]
    parameter: str
    range: tuple[float, float]
    orbits: Sequence[str]
    second: tuple[str, float, float]
    """Another parameter for curves, with its range."""
    model: str = ""
    """Further lines of [model]."""
    more: Mapping[str, str] = field(default_factory=dict)
    """Further lines, by table."""


_LINEAR = """\
coordinates = ["x1", "x2"]           # M x'' + C x' + K x = f(t)
mass        = ["m1", "m2"]           # matrices: a list of rows, or of the diagonal
damping     = [["c", "-c"], ["-c", "c"]]
stiffness   = [["k1 + k2", "-k2"], ["-k2", "k2"]]
force       = ["a*cos(omega*t)", 0]  # expressions of t and the parameters
period      = "2*pi/omega"           # of the forcing

[model.guards]                       # rigid stops and impacts between bodies; a letter each
A = { within = "x1 <= sigma", restitution = "r" }
K = { within = "x2 - x1 <= gap", restitution = "r" }
"""
_HYBRID = """\
period = "2*pi/omega"                # of the forcing

[model.define]                       # names for expressions in laws and resets
force = "a*cos(omega*t) - c*v - k*x"

[model.modes.free]                   # rates of the state; a rate that is a variable is its velocity
x = "v"
v = "force"

[model.modes.contact]                # other laws hold while the spring behind x = e is touched
x = "v"
v = "force - k_b*(x - e)"

[model.guards.C]                     # where a mode ends, and which one follows
mode   = "free"
within = "x <= e"
to     = "contact"

[model.guards.R]
mode   = "contact"
within = "x >= e"
to     = "free"

[model.guards.S]                     # a rigid stop: the mode goes on, and the velocity jumps
mode   = "contact"
within = "x <= sigma"
set    = { v = "-r*v" }
"""

_STARTS = {
    "impact-pair": _Start(
        {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.34},
        "s",
        (0.2, 0.6),
        ["1:1", "2:1"],
        ("r", 0.1, 0.8),
        more={"plot": 'x = "d"                              # the dimensionless length\n'},
    ),
    "oscillator": _Start(
        {"a": 1.0, "omega": 1.0, "c": 0.1, "k": 1.0, "sigma": 1.0, "r": 0.8},
        "a",
        (0.05, 1.5),
        ["0", "1"],
        ("sigma", 0.5, 1.5),
    ),
    "bouncing-ball": _Start(
        {"a": 0.014, "omega": 50.0, "r": 0.5, "g": 9.8}, "a", (0.003, 0.02), ["1"], ("r", 0.1, 0.8)
    ),
    "soft-stop": _Start(
        {"a": 1.0, "omega": 2.0, "c": 0.1, "k": 1.0, "e": 0.5, "k_b": 20.0, "c_b": 0.3},
        "omega",
        (0.6, 2.0),
        ["0"],
        ("k_b", 5.0, 50.0),
    ),
    "soft-pair": _Start(
        {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.45, "k": 500.0},
        "s",
        (0.2, 0.6),
        ["BbTt"],
        ("k", 200.0, 2000.0),
        more={"plot": 'x = "d"                              # the dimensionless length\n'},
    ),
    "two-stops": _Start(
        {"a": 1.0, "omega": 1.7, "c": 0.1, "k": 0.0, "sigma": 0.5, "r": 0.7},
        "sigma",
        (0.1, 0.6),
        ["RL"],
        ("r", 0.4, 0.9),
    ),
    "two-masses": _Start(
        {"c1": 0.1, "c2": 0.05, "k1": 1.0, "k2": 0.6, "a1": 1.0, "omega": 1.8}
        | {"sigma_1": 1.0, "sigma_2": 1.0, "r": 0.8},
        "omega",
        (0.9, 2.0),
        ["A"],
        ("sigma_1", 0.5, 1.5),
    ),
    "coupled-by-impact": _Start(
        {"m2": 2.0, "c1": 0.1, "c2": 0.2, "k1": 1.0, "k2": 2.0, "a1": 1.0, "omega": 1.3}
        | {"gap": 0.2, "r": 0.7},
        "omega",
        (0.85, 1.5),
        ["K"],
        ("gap", 0.1, 0.4),
    ),
    "impact-damper": _Start(
        {"Omega": 1.0, "d": 20.0, "r": 0.8, "mu": 0.1, "zeta": 0.01},
        "d",
        (10.0, 40.0),
        ["RL"],
        ("mu", 0.05, 0.2),
    ),
    "pendulum": _Start(
        {"a": 1.0, "omega": 0.8, "c": 0.1, "sigma": 1.0, "r": 0.8},
        "omega",
        (0.55, 1.0),
        ["1"],
        ("sigma", 0.8, 1.2),
    ),
    "duffing": _Start(
        {"a": 0.5, "omega": 1.4, "c": 0.1, "alpha": 1.0, "beta": 1.0, "sigma": 0.8, "r": 0.8},
        "omega",
        (0.8, 2.5),
        ["0", "1"],
        ("sigma", 0.6, 1.0),
    ),
    "belt": _Start(
        {"a": 0.2, "omega": 1.3, "c": 0.1, "V": 0.3, "mu_0": 0.4},
        "V",
        (0.22, 0.5),
        ["SP"],
        ("mu_0", 0.3, 0.5),
    ),
    "van-der-pol": _Start(
        {"epsilon": 1.0, "sigma": 1.5, "r": 0.8}, "sigma", (1.0, 2.2), ["S"], ("epsilon", 0.5, 2.0)
    ),
    "linear": _Start(
        {"m1": 1.0, "m2": 0.5, "c": 0.1, "k1": 1.0, "k2": 0.6, "a": 1.0, "omega": 1.5}
        | {"sigma": 1.0, "gap": 0.8, "r": 0.7},
        "omega",
        (1.2, 1.8),
        ["A", "K"],
        ("gap", 0.5, 1.2),
        _LINEAR,
    ),
    "hybrid": _Start(
        {"a": 1.0, "omega": 1.5, "c": 0.1, "k": 1.0, "e": 0.5, "k_b": 20.0, "sigma": 0.7, "r": 0.7},
        "omega",
        (0.6, 2.0),
        ["0", "CR", "CSR"],
        ("sigma", 0.6, 0.9),
        _HYBRID,
    ),
}

_COLUMN = 36
"""Where comments begin."""


@explain_arguments
def new_scene(name: str) -> str:
    """Return a commented scene to start from.

    Parameters
    ----------
    name : str
        Of a system of the package, as scenes have it; see `list_systems`.

    Returns
    -------
    str
        A scene file.

    Raises
    ------
    InputError
        If the package has no such system.
    """
    if not isinstance(name, str) or name not in _STARTS:
        found = f"no system {short_repr(name)}{did_you_mean(str(name), list(SYSTEMS))}"
        raise InputError("SYSTEM", found, f"accepted are {', '.join(SYSTEMS)}")
    start, kind = _STARTS[name], system(name)
    return "\n".join(
        [
            "# `contimpact check FILE` validates this scene, `contimpact run FILE -o DIR` runs it.",
            '# Numbers may be expressions in quotes, such as "pi/6".',
            "",
            _line(f'name = "my {name}"'),
            "",
            *_model(name, kind, start),
            *_follow(start),
            *_further(start, kind.AUTONOMOUS),
        ]
    )


def _model(name: str, kind: type[Model], start: _Start) -> list[str]:
    lines = ["[model]", _line(f'system = "{name}"', summary(kind))]
    stated = [*start.model.splitlines()]
    options = [] if stated else [f'{n} = "{value}"' for n, value in kind.OPTIONS.items()]
    declared = {parameter.name: parameter for parameter in kind.PARAMETERS}
    wide = max(map(len, start.values))
    values = [
        _line(f"{n:<{wide}} = {_text(v)}", _meaning(declared.get(n)))
        for n, v in start.values.items()
    ]
    left = [
        _line(f"# {p.name:<{max(wide - 2, 1)}} = {p.default:.12g}", _meaning(p))
        for p in kind.PARAMETERS
        if p.name not in start.values and p.default is not None
    ]
    head = _line("[model.parameters]", "values at the start")
    return [*lines, *map(_line, options), *stated, "", head, *values, *left, ""]


def _follow(start: _Start) -> list[str]:
    low, high = start.range
    orbits = ", ".join(f'"{word}"' for word in start.orbits)
    mark = "" if start.model else "# "
    return [
        "[follow]",
        _line(f'parameter = "{start.parameter}"', "the parameter to follow"),
        _line(f"range     = [{low}, {high}]", "from where to where; the start lies within"),
        _line(f"orbits    = [{orbits}]", "words, or counts of impacts per period, to start from"),
        _line('switch    = ["G", "PD", "T"]', "kinds of events at which to follow what is born"),
        _line("# depth = 2", "how many switches deep; 1 otherwise"),
        _line("# survey = true", "looks for more orbits at nine values across the range"),
        _line(f"{mark}unphysical = false", "branches end where their orbits become unphysical"),
        "",
    ]


def _further(start: _Start, autonomous: bool) -> list[str]:
    name, low, high = start.second
    plot = start.more.get("plot", "").splitlines() or [
        _line('# y = "multipliers"', "velocities before impact otherwise")
    ]
    simulation = [
        _line("# [simulate]", "what motion settles on, by `contimpact simulate FILE -o DIR`"),
        "# values = 51",
    ]
    return [
        "[plot]",
        *plot,
        _line("# html = true", "also writes the page diagram.html"),
        "",
        _line("# [curves]", "bifurcations in a second parameter"),
        f'# parameter = "{name}"',
        f"# range = [{low}, {high}]",
        *([] if autonomous else ["", *simulation]),
    ]


def _line(text: str, comment: str = "") -> str:
    return f"{text:<{_COLUMN}} # {comment}" if comment else text


def _text(value: float | str) -> str:
    return f'"{value}"' if isinstance(value, str) else repr(value)


def _meaning(parameter: Parameter | None) -> str:
    """What a parameter is, its unit, and what is admitted."""
    if parameter is None:
        return ""
    unit = f" ({parameter.unit})" if parameter.unit else ""
    return f"{parameter.meaning}{unit}: {parameter.accepted}"
