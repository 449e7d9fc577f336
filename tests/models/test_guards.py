"""Modes and guards as a system's class declares them."""

from __future__ import annotations

import pytest

from contimpact.errors import InputError
from contimpact.models.guards import following_letters, graph, reachable_letters
from contimpact.models.model import Guard, Mode, Model, Parameter, Wall

MODES = (Mode("free"), Mode("contact"))
CONTACT = Guard("C", +1, mode="free", to="contact")
RELEASE = Guard("R", -1, mode="contact", to="free")
LOST = Guard("L", +1, mode="lost", to="free")


def stop(**attributes):
    """A class that declares a soft stop, with other attributes."""
    body = {
        "SYSTEM": "soft",
        "MODES": MODES,
        "WALLS": (CONTACT, RELEASE),
        "PARAMETERS": (Parameter("e", "", "the position"),),
        "formulas": lambda self, symbols: None,
    }
    return type("Soft", (Model,), body | attributes)


def test_words_are_paths():
    guards = (CONTACT, RELEASE, Wall("S", +1, mode="contact"))
    assert [following_letters(guards, guard.name) for guard in guards] == ["RS", "C", "RS"]
    assert reachable_letters(guards, "free") == "C"
    assert graph(guards) == {"C": "RS", "R": "C", "S": "RS"}


def test_a_guard_may_end_several_modes():
    guard = Guard("K", +1, mode=("one", "two"), to="two")
    assert guard.modes == ("one", "two")
    assert not guard.rigid
    assert Wall("S", +1).rigid


@pytest.mark.parametrize(("coordinate", "row"), [(0, (1, 0)), (1, (0, 1)), ((1, -1), (1, -1))])
def test_the_gap_coordinate_as_a_combination(coordinate, row):
    assert Wall("K", +1, coordinate=coordinate).row(2) == row


SMALLER = {"MODES": (MODES[0], Mode("contact", 1)), "DEGREES_OF_FREEDOM": 2}


@pytest.mark.parametrize(
    ("attributes", "says"),
    [
        ({"MODES": ()}, r"Soft\.WALLS: 'C' has the mode 'free'; declare modes in MODES"),
        ({"MODES": (Mode("free"),)}, r"'C' has the mode 'contact'; the modes are free"),
        ({"MODES": (Mode("free"), Mode("free"))}, r"Soft\.MODES: found \['free', 'free'\]"),
        ({"MODES": ("free",)}, r"Soft\.MODES: .*give a tuple of Mode"),
        ({"MODES": (Mode("free"), Mode("contact", 0))}, r"mode 'contact' has 0; give a whole"),
        (
            {"MODES": (Mode("free"), Mode("contact", 2))},
            r"mode 'contact' has 2 degrees of freedom, the system 1; declare DEGREES_OF_FREEDOM",
        ),
        (
            {"MODES": (Mode("free"), Mode("contact", first_order=(1,)))},
            r"mode 'contact' has the coordinates of first order \(1,\); .*from 0 to 0",
        ),
        (
            {"WALLS": (CONTACT, RELEASE, Guard("K", 1, "free", "contact", past="Z"))},
            r"'K' leads on past 'Z'; give a guard on the same surface",
        ),
        (
            {**SMALLER, "WALLS": (CONTACT, Guard("R", -1, "contact", "free", coordinate=1))},
            r"'R' lies on a coordinate that the mode 'contact' does not have",
        ),
        (
            {**SMALLER, "WALLS": (CONTACT, Guard("R", -1, ("free", "contact"), "free"))},
            r"'R' ends modes of different coordinates; give a guard for each",
        ),
        ({"MODES": (*MODES, Mode("lost"))}, r"mode 'lost' is ended by no guard"),
        (
            {"MODES": (*MODES, Mode("lost")), "WALLS": (CONTACT, RELEASE, LOST)},
            r"mode 'lost' is reached by no guard",
        ),
        (
            {"WALLS": (CONTACT, RELEASE, Wall("S", 1, mode="contact", to="free"))},
            r"wall 'S' leads from 'contact' to 'free'; give a Guard",
        ),
        (
            {"WALLS": (CONTACT, RELEASE, Wall("S", 1, mode=("free", "contact")))},
            r"wall 'S' leads from \('free', 'contact'\) to 'free'; give a Guard, or a wall",
        ),
        (
            {"WALLS": (CONTACT, RELEASE, Guard("K", 1, mode=("free", "contact")))},
            r"'K' ends 2 modes; say which mode it leads to",
        ),
        ({"WALLS": (CONTACT, RELEASE, Wall("S", 1))}, r"'S' has the mode ''; the modes are free"),
        (
            {"WALLS": (CONTACT, Guard("R", -1, "contact", "free", coordinate=1))},
            r"'R' has the coordinate 1; give a number from 0 to 0",
        ),
        (
            {"WALLS": (CONTACT, Guard("R", -1, "contact", "free", coordinate=(1.0, 0.0)))},
            r"'R' has the coordinate \(1\.0, 0\.0\); give the number .* or 1 coefficients",
        ),
        (
            {"WALLS": (CONTACT, Guard("R", -1, "contact", "free", coordinate=(0.0,)))},
            r"coordinate \(0\.0,\)",
        ),
    ],
)
def test_a_graph_that_cannot_work_is_refused_when_it_is_declared(attributes, says):
    with pytest.raises(InputError, match=says):
        stop(**attributes)
