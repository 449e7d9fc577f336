"""Hostile input for the fuzzing suite: scenes, files and folders, changed at random from good ones.

Everything is drawn from one `random.Random`, so a case is known by its number.
"""

from __future__ import annotations

import copy
import hashlib
import json
import math
import os

TEXTS = (
    "",
    " ",
    "x",
    "..",
    "../../user",
    "/etc/passwd",
    "\x1b[31mred\x1b]0;title\x07",
    "a\0b",
    "a\nb",
    "=1+cmd|' /C calc'!A0",
    "@SUM(1)",
    "-1",
    "'",
    '"',
    "a,b",
    "a|b",
    "<script>x</script>",
    "&lt;",
    "[a](http://b)",
    "$\\frac{",
    "$a$b$",
    "\\",
    "{}",
    "%s",
    "\u202eabc",
    "\u2028",
    "é",
    "\U0001f600",
    "\ud800",
    "BT",
    "BBT/2T",
    "1:1",
    "0:0",
    "1:1/9T",
    "B" * 1500,
    "9" * 5000,
    "x" * 200_000,
    "nan",
    "inf",
    "1e400",
    "true",
    "null",
    "s",
    "d",
    "period-1",
    "PD",
    "contimpact.branch/1",
)
NUMBERS = (
    0,
    1,
    -1,
    2,
    7,
    0.5,
    -0.0,
    1e-9,
    1e-300,
    5e-324,
    1e16,
    1e99,
    1e100,
    1e308,
    -1e308,
    math.inf,
    -math.inf,
    math.nan,
    127,
    128,
    255,
    2**31,
    2**53 + 1,
    2**63 - 1,
    2**63,
    10**30,
)
EXPRESSIONS = (
    "pi/6",
    "2*sqrt(3)",
    "1/0",
    "log(-1)",
    "9**64",
    "(9**64)**64",
    "((9**9)**9)**9",
    "sqrt(-1)",
    "__import__('os').system('touch x')",
    "().__class__",
    "lambda: 1",
    "[x for x in ()]",
    "1if 1",
    "t",
    "pi()",
    "sin",
    "sin(1, 2)",
    "sin(x=1)",
    "0x" + "f" * 300,
    "1e999",
    "1_0",
    "1j",
    "True",
    "(" * 300,
    "-" * 1500 + "1",
    "+".join(["1"] * 900),
    "sin(" * 80 + "1" + ")" * 80,
    "1;2",
    "\n1",
    "f'{1}'",
    "a.b",
    "1 if pi else 2",
    "pi**pi**pi",
    "2**-64",
    "exp(700)",
    "exp(710)",
    "tan(pi/2)",
)
FORCINGS = (
    "cos(pi*t)",
    "sin(pi*t)",
    "t",
    "cos(t)",
    "1/(1-1)",
    "log(t)",
    "cos(pi*t)/0",
    "u",
    "cos(pi*t",
    "__import__('os')",
    "",
    "cos(pi*t)\0",
    "cos(1e400*t)",
    "sqrt(-1)",
    "1e308*cos(pi*t)*1e308",
)


def nested(depth):
    """A list in a list in a list."""
    value = []
    for _ in range(depth):
        value = [value]
    return value


def value(random):
    """Something that hardly anybody expects."""
    kind = random.randrange(8)
    if kind < 3:
        return random.choice(NUMBERS)
    if kind < 6:
        return random.choice(TEXTS)
    return random.choice((None, True, False, [], {}, [0], [[]], {"": None}, nested(30), [1, 2, 3]))


# Plain data


def places(data, path=()):
    """The paths of all that stands in plain data."""
    found = [path] if path else []
    if isinstance(data, dict):
        return found + [p for k, v in data.items() for p in places(v, (*path, k))]
    if isinstance(data, list):
        return found + [p for k, v in enumerate(data) for p in places(v, (*path, k))]
    return found


def holder(data, path):
    for key in path[:-1]:
        data = data[key]
    return data


def changed(data, random, changes=1):
    """Plain data with some of its values replaced, removed, renamed, doubled or exchanged."""
    data = copy.deepcopy(data)
    for _ in range(changes):
        known = places(data)
        if not known:
            return value(random)
        path = random.choice(known)
        within, key = holder(data, path), path[-1]
        match random.randrange(7):
            case 0:
                del within[key]
            case 1 if isinstance(within, dict):
                within[random.choice(TEXTS)] = within.pop(key)
            case 2:
                other = random.choice(known)
                within[key] = copy.deepcopy(holder(data, other)[other[-1]])
            case 3 if isinstance(within[key], float | int) and not isinstance(within[key], bool):
                within[key] = random.choice((-within[key], within[key] * 10, within[key] + 1))
            case 4 if isinstance(within[key], list):
                within[key] = within[key] * 2
            case 5 if isinstance(within[key], str):
                within[key] += random.choice(TEXTS)
            case _:
                within[key] = value(random)
    return data


def json_text(data):
    """JSON, also of what JSON does not have; halves of characters and big numbers as they are."""
    return json.dumps(data, ensure_ascii=True)


# Bytes


def damaged(content, random):
    """Bytes with a part of them removed, repeated, moved or replaced."""
    content = bytearray(content)
    if not content:
        return b"\xff"
    first = random.randrange(len(content))
    last = min(len(content), first + random.choice((1, 2, 10, 1000)))
    match random.randrange(6):
        case 0:
            content[first] ^= 1 << random.randrange(8)
        case 1:
            del content[first:last]
        case 2:
            del content[first:]
        case 3:
            content[first:first] = content[first:last] * random.choice((1, 3))
        case 4:
            content[first:last] = random.choice(TEXTS).encode(errors="replace")
        case _:
            content[first:last] = random.randbytes(last - first)
    return bytes(content)


# Scenes

SCENE = {
    "name": "fuzzed",
    "source": "a good scene",
    "model": {
        "system": "impact-pair",
        "parameters": {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.389},
    },
    "follow": {
        "parameter": "s",
        "range": [0.36, 0.4],
        "orbits": ["1:1"],
        "switch": ["PD"],
        "depth": 1,
        "max_branches": 3,
        "max_points": 60,
        "survey": False,
    },
    "detect": {"events": ["FB", "PD", "G", "UZ"], "values": {"s": [0.37]}},
    "numerics": {"step": 0.03, "max_step": 0.06, "starts": 16, "rounds": 2, "seed": 1},
    "plot": {"x": "d", "formats": [], "unphysical": "all"},
}
CURVES = {"parameter": "r", "range": [0.28, 0.32], "kinds": ["PD"], "max_points": 20}
SIMULATE = {
    "range": [0.38, 0.4],
    "values": 3,
    "transient": 10,
    "periods": 60,
    "impacts": 40,
    "longest": 16,
    "starts": 1,
    "direction": "both",
    "width": 1e-3,
}


def written(scene, path):
    """Write a scene; returns the path as a text."""
    path.write_text(toml(scene), encoding="utf-8")
    return str(path)


def toml(scene):
    """A scene as TOML; what TOML does not have is written all the same."""
    plain = {k: v for k, v in scene.items() if not isinstance(v, dict)}
    lines = [f"{_key(k)} = {_toml(v)}" for k, v in plain.items()]
    for name, table in scene.items():
        if isinstance(table, dict):
            inner = {k: v for k, v in table.items() if not isinstance(v, dict)}
            lines += [f"[{_key(name)}]", *(f"{_key(k)} = {_toml(v)}" for k, v in inner.items())]
            for key, deeper in table.items():
                if isinstance(deeper, dict):
                    lines.append(f"[{_key(name)}.{_key(key)}]")
                    lines += [f"{_key(k)} = {_toml(v)}" for k, v in deeper.items()]
    return "\n".join(lines) + "\n"


def _key(key):
    return key if str(key).isidentifier() and str(key).isascii() else json.dumps(str(key))


def _toml(item):
    if isinstance(item, bool):
        return str(item).lower()
    if isinstance(item, float | int):
        return repr(item)
    if isinstance(item, list):
        return f"[{', '.join(map(_toml, item))}]"
    if isinstance(item, dict):
        return f"{{{', '.join(f'{_key(k)} = {_toml(v)}' for k, v in item.items())}}}"
    return "none" if item is None else json.dumps(item, ensure_ascii=False)


LINES = (
    "a = 0x" + "f" * 100_000,
    "seed = " + "9" * 5000,
    ".".join(["a"] * 20_000) + " = 1",
    "[" * 3000,
    "[[follow]]",
    "[model]",
    "name = 1",
    "x = 1979-05-27",
    "\0",
    "\ufeff",
    "a = '''" + "x" * 90_000,
    "values = 1_000_000_000_000",
    "# " + "x" * 1_000_001,
)


def varied(scene, random):
    """A scene that may well be good: some of its numbers a little different."""
    scene = copy.deepcopy(scene)
    for path in places(scene):
        within, key = holder(scene, path), path[-1]
        number = isinstance(within[key], float | int) and not isinstance(within[key], bool)
        if number and random.randrange(3) == 0:
            factor = random.choice((0.0, 0.5, 0.9, 0.99, 1.01, 1.1, 2.0))
            within[key] = type(within[key])(within[key] * factor)
        elif isinstance(within[key], bool):
            within[key] = random.choice((True, False))
    return scene


def hostile_scene(scene, random):
    """The bytes of a scene file, changed from a good one."""
    if random.randrange(3) == 0:
        return toml(varied(scene, random)).encode()
    other = changed(scene, random, random.choice((1, 1, 2, 4)))
    if random.randrange(3) == 0 and isinstance(other.get("model"), dict):
        numbers = other["model"].get("parameters")
        if isinstance(numbers, dict) and numbers:
            numbers[random.choice(list(numbers))] = random.choice(EXPRESSIONS)
    if random.randrange(8) == 0 and isinstance(other.get("model"), dict):
        other["model"]["forcing"] = random.choice(FORCINGS)
    text = toml(other)
    if random.randrange(10) == 0:
        lines = text.split("\n")
        lines.insert(random.randrange(len(lines)), random.choice(LINES))
        text = "\n".join(lines)
    content = text.encode(errors="surrogatepass")
    return damaged(content, random) if random.randrange(5) == 0 else content


# Files of a result folder


def hostile_file(path, random):
    """Change one file of a folder: its data, its bytes, or what it is."""
    kind = random.randrange(20)
    if kind == 0:
        return replaced(path, random)
    content = path.read_bytes()
    try:
        changed_content = damaged(content, random) if kind < 5 else _edited(path, content, random)
    except (ValueError, LookupError, TypeError, RecursionError):  # damaged before
        changed_content = damaged(content, random)
    path.write_bytes(changed_content)


def _edited(path, content, random):
    """A file of results with its data changed."""
    text = content.decode()
    if path.suffix == ".json":
        return json_text(changed(json.loads(text), random, random.choice((1, 1, 3)))).encode()
    edit = _lines if path.suffix == ".jsonl" else _table
    return edit(text, random).encode(errors="surrogatepass")


def sealed(folder):
    """Write into a folder's manifest the digests of its files, as whoever changes them can do."""
    manifest = folder / "manifest.json"
    try:
        content = json.loads(manifest.read_bytes())
        for name in filter(lambda name: (folder / name).is_file(), content["sha256"]):
            digest = hashlib.sha256((folder / name).read_bytes()).hexdigest()
            content["sha256"][name] = digest
        text = json_text(content)
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return
    manifest.write_text(text, encoding="utf-8")


def replaced(path, random):
    """Put something else in a file's place: nothing, a folder, a pipe, a link."""
    path.unlink()
    match random.randrange(5):
        case 0:
            path.mkdir()
        case 1:
            os.mkfifo(path)
        case 2:
            path.symlink_to(random.choice(("../user/thesis.tex", "/dev/zero", path.name, "/")))
        case 3:
            path.write_bytes(b"")


def _lines(text, random):
    """A file of JSON lines with one of them changed."""
    lines = text.splitlines()
    place = random.randrange(len(lines))
    match random.randrange(5):
        case 0:
            lines[place] = "[" * 100_000 + "]" * 100_000
        case 1:
            lines.insert(place, random.choice(lines))
        case 2:
            lines.insert(place, json_text(value(random)))
        case _:
            lines[place] = json_text(changed(json.loads(lines[place]), random))
    return "\n".join(lines) + "\n"


def _table(text, random):
    """A table with its record, its header or its cells changed."""
    lines = text.split("\n")
    if lines[0].startswith("# ") and random.randrange(2):
        head = json.loads(lines[0][2:])
        lines[0] = "# " + json_text(changed(head, random, random.choice((1, 1, 3))))
        return "\n".join(lines)
    place = random.randrange(1, len(lines))
    match random.randrange(4):
        case 0:
            del lines[place]
        case 1:
            lines.insert(place, random.choice(lines[1:]))
        case _:
            cells = lines[place].split(",")
            cell = str(value(random)).replace('"', '""')
            cells[random.randrange(len(cells))] = random.choice((cell, f'"{cell}"'))
            lines[place] = ",".join(cells)
    return "\n".join(lines)
