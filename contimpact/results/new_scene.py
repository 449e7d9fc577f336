"""A commented scene to start from, for each system that has an `EXAMPLE`.

What a parameter means is told by its declaration. A scene asks for little, and shows in comments
what else could be asked for.
"""

from __future__ import annotations

from ..errors import InputError, did_you_mean, explain_arguments, short_repr
from ..models.model import Example, Model, Parameter
from ..systems import find_system, list_systems, summary

_COLUMN = 36
"""Where comments begin."""


@explain_arguments
def new_scene(name: str) -> str:
    """Return a commented scene to start from.

    Parameters
    ----------
    name : str
        Of a system, as scenes have it; see `list_systems`.

    Returns
    -------
    str
        A scene file.

    Raises
    ------
    InputError
        If there is no such system, or it has no `EXAMPLE`.
    """
    kind = find_system(name) if isinstance(name, str) else None
    if kind is None or kind.EXAMPLE is None:
        names = [name for name, kind in list_systems().items() if kind.EXAMPLE]
        found = f"no system {short_repr(name)}{did_you_mean(str(name), names)}"
        raise InputError("SYSTEM", found, f"accepted are {', '.join(names)}")
    start = kind.EXAMPLE
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


def _model(name: str, kind: type[Model], start: Example) -> list[str]:
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


def _follow(start: Example) -> list[str]:
    name, low, high = start.follow
    orbits = ", ".join(f'"{word}"' for word in start.orbits)
    mark = "" if start.model else "# "
    return [
        "[follow]",
        _line(f'parameter = "{name}"', "the parameter to follow"),
        _line(f"range     = [{low}, {high}]", "from where to where; the start lies within"),
        _line(f"orbits    = [{orbits}]", "words, or counts of impacts per period, to start from"),
        _line('switch    = ["G", "PD", "T"]', "kinds of events at which to follow what is born"),
        _line("# depth = 2", "how many switches deep; 1 otherwise"),
        _line("# survey = true", "looks for more orbits at nine values across the range"),
        _line(f"{mark}unphysical = false", "branches end where their orbits become unphysical"),
        "",
    ]


def _further(start: Example, autonomous: bool) -> list[str]:
    name, low, high = start.second
    simulation = [
        _line("# [simulate]", "what motion settles on, by `contimpact simulate FILE -o DIR`"),
        "# values = 51",
    ]
    return [
        "[plot]",
        _line(*start.plot),
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
