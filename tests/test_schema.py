"""Tables of keys: a key is declared once, and everything else follows from its declaration."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import re
import typing

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from zoo import ROOT, tool

from contimpact.continuation.settings import Settings
from contimpact.errors import InputError
from contimpact.results.branch import Entry, column, same_data
from contimpact.results.options import CertifyOptions, CurveOptions, PlotOptions, SimulateOptions
from contimpact.results.scene import Scene, read_scene
from contimpact.schema import (
    Key,
    attribute,
    build_record,
    key,
    keys_of,
    read,
    record,
    table_columns,
    written,
)

LEAST = {
    "name": "a scene",
    "model": {
        "system": "impact-pair",
        "parameters": {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.34},
    },
    "follow": {"parameter": "s", "range": [0.08, 1.05], "orbits": ["1:1"]},
}


@dataclasses.dataclass(frozen=True, kw_only=True)
class Longer(Scene):
    """A scene with a further key, which is declared here and nowhere else."""

    patience: int = key(7, "how long to wait", table="follow", least=2, most=9)


def test_a_key_is_added_in_one_place():
    """It is read with its default and its bounds, written, documented, and named by refusals."""
    assert read(Longer, LEAST).patience == 7
    longer = {**LEAST, "follow": {**LEAST["follow"], "patience": 9}}
    scene = read(Longer, longer)
    assert written(scene)["follow"]["patience"] == scene.patience == 9
    assert read(Longer, written(scene)) == dataclasses.replace(scene, given={})
    for wrong in (1, 10, True, 2.0, "3", []):
        with pytest.raises(InputError, match="a whole number from 2 to 9") as caught:
            read(Longer, {**LEAST, "follow": {**LEAST["follow"], "patience": wrong}})
        assert caught.value.where == "follow.patience"
    with pytest.raises(InputError, match=r"unknown key \(did you mean 'patience'"):
        read(Longer, {**LEAST, "follow": {**LEAST["follow"], "patienc": 3}})
    row = "| `patience` | whole, 2 to 9 | 7 | how long to wait |"
    assert row in tool("key_tables").table(Longer, "follow")
    with pytest.raises(InputError, match="unknown key"):
        read_scene(longer)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Quieter(Scene):
    """A scene with keys that are written only where they say something."""

    eager: bool = key(True, "whether to hurry", table="follow", silent=True)
    delay: int = key(3, "how long to hesitate", table="follow", least=0, silent=True)


@pytest.mark.parametrize(
    ("eager", "delay", "said"),
    [(True, 3, {}), (False, 3, {"eager": False}), (True, 0, {"delay": 0})],
)
def test_a_silent_key_is_written_where_it_is_not_the_default(eager, delay, said):
    """Else the scene that was run could not be told from what a run has written."""
    given = {**LEAST, "follow": {**LEAST["follow"], "eager": eager, "delay": delay}}
    scene = read(Quieter, given)
    follow = written(scene)["follow"]
    assert {name: follow[name] for name in ("eager", "delay") if name in follow} == said
    assert read(Quieter, written(scene)) == dataclasses.replace(scene, given={})


@pytest.mark.parametrize("name", tool("key_tables").PAGES)
def test_tables_of_the_documentation_are_made_from_the_keys(name):
    """``python tools/key_tables.py`` writes them."""
    text = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
    assert tool("key_tables").page(text) == text
    assert re.search(r"<!-- (keys|record) of ", text)


KINDS = {"plot": PlotOptions, "curves": CurveOptions, "simulate": SimulateOptions}
KINDS |= {"certify": CertifyOptions, "numerics": Settings}
NEEDED = {"curves": {"parameter": "r", "range": [0.1, 0.9], "kinds": ["G"]}}
JUNK = [True, -1, 0, 2.5, 10**400, "x", [], ["x"], [1, 0], {}, {"a": 1}, float("nan"), "1/0"]


def fitting(hint, rule):
    """Values that a key admits, in the file."""
    rule = rule if isinstance(rule.least, int | None) else dataclasses.replace(rule, least=4096)
    if rule.choices:
        one = st.sampled_from(rule.choices)
        return st.lists(one, unique=True) if typing.get_origin(hint) is tuple else one
    if hint is int:
        return st.integers(1 if rule.least is None else rule.least, rule.most)
    return {bool: st.booleans()}.get(hint)


def keys():
    for table, kind in KINDS.items():
        for field, hint, rule in keys_of(kind):
            if not rule.inline:
                yield pytest.param(
                    table, rule.name or field.name, hint, rule, id=f"{table}.{field.name}"
                )


@pytest.mark.parametrize(("table", "name", "hint", "rule"), [*keys()])
def test_what_a_key_does_not_admit_is_refused_at_it(table, name, hint, rule):
    """What is neither refused at the key nor at one that it contradicts is read."""
    for junk in JUNK:
        scene = {**LEAST, table: {**NEEDED.get(table, {}), name: junk}}
        try:
            resolved = json.loads(json.dumps(read_scene(scene).resolved()))
        except InputError as error:
            refused = error
        else:
            refused = None
            assert read_scene(resolved).resolved() == resolved, junk
        assert refused is None or refused.where.startswith(f"{table}."), junk


@pytest.mark.parametrize(("table", "name", "hint", "rule"), [*keys()])
@settings(max_examples=8, deadline=None)
@given(data=st.data())
def test_what_a_key_admits_is_read_and_written(table, name, hint, rule, data):
    values = fitting(hint, rule)
    if values is None:
        return
    value = data.draw(values)
    more = {"branches": True} if (table, name) == ("simulate", "crises") else {}
    scene = {**LEAST, table: {**NEEDED.get(table, {}), **more, name: value}}
    assert read_scene(scene).resolved()[table].get(name, False) == value


NULLS = {"id": "e1", "kind": "G", "label": "G", "branch": "b1", "word": "B", "period": 1}
NULLS |= {"parameter": "s", "parameters": {"s": 0.5}, "impacts": [{"wall": "B", "time": 0.25}]}


@dataclasses.dataclass(frozen=True, kw_only=True)
class LongerEntry(Entry):
    """An entry with further keys, which are declared here and nowhere else."""

    strength: float | None = column("how hard it is")
    reserve: int | None = attribute("only where there is one", None, silent=True)


def test_a_key_of_a_record_is_added_in_one_place():
    """It is written, read back, a column of the table, and documented."""
    entry = build_record(LongerEntry, {**NULLS, "strength": 0.5, "reserve": 3}, ("id",))
    found = json.loads(json.dumps(record(entry)))
    assert (found["strength"], found["reserve"]) == (0.5, 3)
    assert same_data(
        build_record(LongerEntry, found, ("id",)), dataclasses.replace(entry, opens=[])
    )
    neither = record(dataclasses.replace(entry, strength=None, reserve=None))
    assert neither["strength"] is None
    assert "reserve" not in neither
    assert table_columns(LongerEntry) == [*table_columns(Entry), "strength"]
    rows = tool("key_tables").record_table(LongerEntry)
    assert "| `strength` | number or null | how hard it is |\n" in rows
    assert "| `reserve` | whole | only where there is one |\n" in rows
    assert "](mathematics.md#ghosts-and-labels)" in rows
    assert "ghost : bool\n    Whether it is a ghost.\n" in Entry.__doc__
    assert "](" not in Entry.__doc__


@pytest.mark.parametrize("name", [field.name for field, _, _ in keys_of(Entry)])
def test_junk_at_a_key_of_a_record_is_refused_or_read(name):
    read_back = 0
    for junk in JUNK:
        with contextlib.suppress(ValueError):
            entry = build_record(Entry, {**NULLS, name: junk}, ("id",))
            again = build_record(Entry, json.loads(json.dumps(record(entry))), ("id",))
            assert same_data(again, entry), junk
            read_back += 1
    assert read_back < len(JUNK)


def test_what_follows_from_a_rule():
    """A number above a bound, a choice, a list: in words where they are refused."""

    @dataclasses.dataclass
    class Small:
        width: float = key(1.0, above=0, most=5)
        way: str = key("up", choices=("up", "down"))
        at: tuple[float, ...] = key(())

    assert read(Small, {"width": "pi/2", "at": [1, 2]}).at == (1.0, 2.0)
    for name, wrong, words in (
        ("width", 0, "width: found 0.0; give a number above 0, at most 5"),
        ("way", "left", "way: found 'left'; accepted are up, down"),
        ("at", 3, "at: found 3; give a list of numbers"),
    ):
        with pytest.raises(InputError) as caught:
            read(Small, {name: wrong})
        assert str(caught.value) == words
    assert written(Small()) == {"width": 1.0, "way": "up", "at": []}
    assert Key().accepted == ""
