"""What compiled functions compute is what Python computes, operation by operation."""

from __future__ import annotations

import importlib.util
import math
from collections import namedtuple

import numpy as np
import pytest

from contimpact.arrays import tail
from contimpact.segments import compiling
from contimpact.segments.llvm_ir import Translation
from contimpact.segments.machine_code import Program

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("llvmlite") is None, reason="the extra 'fast' is not installed"
)

TABLE = ((1.5, 2), (-0.25, 3), (4.0, -1))
PLACES = (3, 1, 2)
Pair = namedtuple("Pair", "first second")


def arithmetic(n, x, table, out):
    a, b = x[0], x[1]
    out[0] = a % b
    out[1] = a / b - 3 * a + -b
    out[2] = math.sqrt(abs(a)) + math.copysign(1.5, b) + a**3
    out[3] = n[0] // 3 + n[1] % 7 - n[0] % n[2]
    out[4] = math.floor(a) + int(b) + math.ceil(0.5 * a)
    out[5] = max(a, b, 0.5) - min(a, n[0], b)
    out[6] = math.sin(a) * math.exp(-b * b) + math.atan2(a, b) + math.log(1.0 + a * a)
    out[7] = (n[0] & 6) + (n[1] | 1)


def choices(n, x, table, out):
    a, b = x[0], x[1]
    out[0] = a if a > b else n[0]
    out[1] = n[0] or 7
    out[2] = (n[0] - n[0]) or b
    out[3] = n[0] and b
    out[4] = 1.0 if -1.0 < a <= b < 2.0 or not n[1] > 0 else 0.0
    out[5] = 1.0 if n[1] > 0 and x[n[1] % 2] > 0.0 else -1.0
    if a != b:
        out[6] = 2.0
        if b > 0:
            out[6] = 3.0
    elif a > 0:
        out[6] = 4.0
    else:
        out[6] = 5.0
    out[7] = out[6] == 3.0


def loops(n, x, table, out):
    total, last = 0, 0
    for i in range(8, 0, -2):
        if i == 4:
            continue
        total += i * abs(x[0])
        last = i
    while total < 100.0:
        total = 2.0 * total + 10
        if total > 50.0:
            break
    out[0], out[1] = total, last
    for row in table[1:]:
        for number in row[:-1]:
            out[2] += number
    for weight, power in TABLE:
        out[3] += weight * power
    for i in range(len(PLACES)):
        out[4] += x[PLACES[i] % 2] * TABLE[i][0]
    out[5] = len(table) + len(x[5:]) + len(x[-2:]) + len(tail(out, 3)) * tail(out, 2)[2]
    out[6] += x[-1]
    out[7] = i


def sizes(items):
    found = 0.0
    for item in items:
        found += abs(item)
    return found


def apply(function, *items):
    return function(items)


def both(pair):
    return pair.second, Pair(pair.first + pair.second, (pair.first, 1))


def tuples(n, x, table, out):
    pair = Pair(x[0], n[0])
    swapped, nested = both(pair)
    out[0], out[1], out[2] = swapped, nested.first, nested.second[0]
    joined = (x[0],) + (x[1], 2.0) + (0.5,) * 2
    out[3] = sizes(joined) + sizes(x)
    out[4] = joined[-1] + joined[1:3][0]
    first, second = table[0][:2]
    second, first = first, second
    out[5], out[6] = first, second
    table[1, 0] += 1
    out[7] = table[1][0]


CASES = [arithmetic, choices, loops, tuples]


@pytest.mark.parametrize("function", CASES)
def test_the_same_as_python_to_the_last_bit(function, monkeypatch, kernel_cache):
    monkeypatch.setenv("CONTIMPACT_COMPILED", "always")
    program = Program({})
    program.glue(
        "def entry(n, x, table, out):\n    run(n, x, table, out)\n    return 1", run=function
    )
    fast = compiling.load((program.text,), "ifFf", lambda: program)
    rng = np.random.default_rng(1)
    for _ in range(200):
        n = rng.integers(-9, 10, 3)
        n[2] = abs(n[2]) + 1
        x, table = rng.normal(size=4), rng.normal(size=(3, 4))
        x[1] = rng.choice([x[0], x[1], 0.5])
        expected, found, written = np.zeros(8), np.zeros(8), table.copy()
        function([int(i) for i in n], x.tolist(), Rows(written), expected)
        assert fast(n, x, table, found) == 1
        assert found.tolist() == expected.tolist()
        assert table.tolist() == written.tolist()


class Rows:
    """A table as compiled code knows it: rows are views."""

    def __init__(self, rows):
        self.rows = rows

    def __len__(self):
        return len(self.rows)

    def __getitem__(self, index):
        return Rows(self.rows[index]) if isinstance(index, slice) else self.rows[index]

    def __setitem__(self, index, value):
        self.rows[index] = value

    def __iter__(self):
        return iter(self.rows)


@pytest.mark.parametrize(
    "body",
    [
        "raise ValueError",
        "return [1]",
        "return x[::2][0]",
        "return unknown",
        "return math.gamma(x[0])",
        "y = 1\n    y = (1, 2)\n    return 1",
        "return x",
    ],
)
def test_what_is_not_in_the_subset_is_refused(body):
    program = Program({})
    program.glue(f"def entry(x):\n    {body}\n")
    with pytest.raises(NotImplementedError, match=r"entry|variable"):
        Translation(program).modules("f")
