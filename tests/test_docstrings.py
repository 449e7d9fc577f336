"""Docstrings of public names, read by numpydoc's linter where it is installed."""

from __future__ import annotations

import dataclasses
import inspect

import pytest

import contimpact as ci

validate = pytest.importorskip("numpydoc.validate").validate

NOT_ASKED = {"ES01", "EX01", "SA01", "PR04", "PR07", "RT03"}
"""Longer summaries, examples and references; types and words where a name says it all."""
OF_MEMBERS = NOT_ASKED | {"PR01", "RT01", "RT02", "YD01"}
"""Methods whose one line says what they take, return or yield."""
NAMED = {"PR01", "PR02", "PR08"}
"""Of systems: parameters are given by name, and the class lists them."""
SYSTEMS = {kind.__name__ for kind in ci.list_systems().values()}

PUBLIC = [name for name in ci.__all__ if not name.startswith("__")]


def members(kind):
    """The public functions and properties that a class defines itself."""
    return [
        name
        for name, value in vars(kind).items()
        if not name.startswith("_") and (inspect.isfunction(value) or isinstance(value, property))
    ]


def faults(path, allowed):
    return [error for error in validate(path)["errors"] if error[0] not in allowed]


@pytest.mark.parametrize("name", PUBLIC)
def test_a_public_name_is_documented(name):
    found = getattr(ci, name)
    path = f"{found.__module__}.{found.__qualname__}"
    allowed = NOT_ASKED | (NAMED if name in SYSTEMS else set())
    if dataclasses.is_dataclass(found):  # what they are made of stands under Attributes
        allowed |= {"PR01"}
    assert faults(path, allowed) == []
    if inspect.isclass(found):
        assert [f for m in members(found) for f in faults(f"{path}.{m}", OF_MEMBERS)] == []


def test_the_reference_has_them_all():
    from zoo import ROOT

    text = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    inside = {"Model", "Parameter", "Wall", "Formulas", "Symmetry"}
    inside |= {"certify"}  # described by hand: autodoc would have to import its extra
    wanted = {n for n in PUBLIC if n not in inside}
    assert sorted(n for n in wanted if f"contimpact.{n}\n" not in text) == []
