"""Every number of a scene, every list and the file itself have the bounds that the docs state."""

from __future__ import annotations

import copy
import os
import re
import time

import pytest
from zoo import ROOT, SMALL, scene_table

from contimpact.errors import LONGEST_MESSAGE, InputError
from contimpact.results.scene import load_scene, read_scene

DOCS = ROOT / "docs"

SCENE = scene_table(name="bounds", curves={"parameter": "r", "range": [0.1, 0.9]}, simulate={})


def documented():
    """Every whole number of the documented tables: (table, key, least, most)."""
    found = []
    for page, table in (("scene", ""), ("curves", "curves"), ("simulate", "simulate")):
        for line in (DOCS / f"{page}.md").read_text(encoding="utf-8").splitlines():
            if heading := re.match(r"#+ .*`\[([a-z.]+)\]`", line):
                table = heading[1]
            if row := re.match(r"\| `(\w+)` \| whole, ([^|]*?) to ([^|]*?) \|", line):
                found.append((table, row[1], value(row[2]), value(row[3])))
    return found


def value(text):
    """A whole number as the docs write it: 100 000, 10⁹, 2⁶³ - 1."""
    powers = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹", "0123456789")
    text = re.sub("([⁰¹²³⁴⁵⁶⁷⁸⁹]+)", lambda m: "**" + m[1].translate(powers), text)
    return eval(text.replace(" ", ""), {})


def changed(table, key, content):
    scene = copy.deepcopy(SCENE)
    place = scene
    for part in table.split(".") if table else ():
        place = place.setdefault(part, {})
    place[key] = content
    return scene


def refused(scene):
    with pytest.raises(InputError) as caught:
        read_scene(scene)
    assert len(str(caught.value)) <= LONGEST_MESSAGE + 20
    return caught.value


def test_the_reader_of_the_docs():
    """The test of the test: every whole number of a scene is documented with its bounds."""
    keys = {key for _, key, *_ in documented()}
    assert {
        "cover",
        "depth",
        "max_branches",
        "max_points",
        "max_iterations",
        "seed",
        "starts",
        "fraction_starts",
        "refine",
        "rounds",
        "values",
        "grid",
        "transient",
        "periods",
        "reach",
        "longest",
        "impacts",
    } == keys
    assert len(documented()) == 21
    assert value("2⁶³ - 1") == 2**63 - 1


@pytest.mark.parametrize(("table", "key", "least", "most"), documented())
def test_whole_numbers(table, key, least, most):
    for admitted in (least, most):
        read_scene(changed(table, key, admitted))
    for beyond in (least - 1, most + 1, 10**30, 10**5000, -(10**5000), 1 << 4_000_000):
        error = refused(changed(table, key, beyond))
        assert error.where == f"{table}.{key}"
        assert f"from {least} to {most}" in str(error)


@pytest.mark.parametrize(
    ("table", "key"),
    [
        ("model.parameters", "A"),
        ("numerics", "max_step"),
        ("simulate", "width"),
        ("plot", "xlim"),
        ("detect.values", "d"),
        ("curves", "values"),
    ],
)
def test_numbers(table, key):
    for number in (1.0000001e100, 10**101, 10**5000, "9**64*9**60", float("inf"), float("nan")):
        content = number if key in ("A", "max_step", "width") else [-1e100, number]
        assert refused(changed(table, key, content)).where.startswith(f"{table}.{key}")


@pytest.mark.parametrize(
    ("table", "key", "item"),
    [
        ("follow", "orbits", "1:1"),
        ("plot", "formats", "svg"),
        ("detect.values", "s", 0.3),
        ("curves", "values", 0.3),
        ("curves.family", "beta", 0.3),
        ("simulate", "portraits", 0.3),
    ],
)
def test_lists(table, key, item):
    read_scene(changed(table, key, [item] * 10_000))
    error = refused(changed(table, key, [item] * 10_001))
    assert (error.where, error.found) == (f"{table}.{key}", "a list of 10001")


def test_texts():
    read_scene(changed("", "source", "x" * 10_000))
    assert refused(changed("", "source", "x" * 10_001)).where == "source"
    read_scene(changed("", "name", "ä" * 100))
    assert refused(changed("", "name", "ä" * 101)).where == "name"


def loaded(tmp_path, text):
    """What reading a file ends with, and how long it takes."""
    path = tmp_path / "scene.toml"
    path.write_text(text, encoding="utf-8")
    began = time.process_time()
    with pytest.raises(InputError) as caught:
        load_scene(path)
    assert time.process_time() - began < 5.0
    return str(caught.value)


def test_size_of_the_file(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SMALL + "#" * (1_000_000 - len(SMALL)), encoding="utf-8")
    assert load_scene(path).name == "small"
    assert "longer than 1000000 bytes" in loaded(tmp_path, SMALL + "#" * (1_000_001 - len(SMALL)))


@pytest.mark.parametrize("name", ["a", '"a"', "'a b'", '"a\\"b"'])
@pytest.mark.parametrize("dot", [".", " . ", "\t.\t"])
def test_dotted_keys(tmp_path, name, dot):
    key = dot.join([name] * 20_000)
    assert "a key of more than 100 names" in loaded(tmp_path, SMALL + f"  {key} = 1\n")


def test_dotted_keys_as_they_are(tmp_path):
    """Numbers and texts with many dots are no keys; keys of fewer names are refused by name."""
    path = tmp_path / "scene.toml"
    dots = ".".join(["a"] * 200)
    listed = ", ".join(f"0.3{i:03d}" for i in range(500))
    given = f'source = "{dots}"\n' + SMALL + f"[detect.values]\ns = [\n{listed}]\n"
    path.write_text(given, encoding="utf-8")
    assert len(load_scene(path).values["s"]) == 500
    path.write_text(SMALL + ".".join(["a"] * 100) + " = 1\n", encoding="utf-8")
    with pytest.raises(InputError, match=r"^detect\.a: unknown key"):
        load_scene(path)


@pytest.mark.parametrize(
    "text",
    [
        "a" * 900_000,
        "a-" * 450_000,
        '"' * 900_000,
        "'a" * 450_000,
        "a." * 450_000 + "=",
        "seed = 0x" + "f" * 900_000,
        "seed = " + "9" * 900_000,
        "\n" * 900_000,
        "a=1\n" * 200_000,
        "".join(f"a{i}=1\n" for i in range(80_000)),
        "[" * 500_000,
        "[[a]]\n" * 150_000,
    ],
    ids=lambda text: text[:12],
)
@pytest.mark.quick(10)
def test_files_that_could_take_long(tmp_path, text):
    loaded(tmp_path, text)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "scene.toml")
    with pytest.raises(InputError, match="not a plain file"):
        load_scene(tmp_path / "scene.toml")


def test_a_device_without_end():
    with pytest.raises(InputError, match="longer than 1000000 bytes"):
        load_scene("/dev/zero")
