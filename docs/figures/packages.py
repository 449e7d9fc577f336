"""Draws packages.svg: the packages of contimpact, each above all that it may import.

    python docs/figures/packages.py

Packages and arrows are those of the table in docs/development/architecture.md.
"""

import math
import random
import re
from collections.abc import Mapping
from graphlib import TopologicalSorter
from pathlib import Path

from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

HERE = Path(__file__).parent
TRIES = 20_000
"""Arrangements tried."""

ROW = re.compile(r"^\| `(\w+)` \| (.*) \|$", re.MULTILINE)


def allowed(page: str) -> dict[str, set[str]]:
    """Return which packages each package may import, as the page says."""
    table = page.split("<!-- table of imports -->")[1].split("\n\n", 2)[1]
    return {name: set(re.findall(r"`(\w+)`", others)) for name, others in ROW.findall(table)}


def levels(packages: Mapping[str, set[str]]) -> dict[str, int]:
    """Return how many packages are below each, one on the other."""
    found: dict[str, int] = {}
    for name in TopologicalSorter(packages).static_order():
        found[name] = max((found[other] + 1 for other in packages[name]), default=0)
    return found


def reduced(packages: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """Return the arrows that do not follow from others."""
    below: dict[str, set[str]] = {}
    for name in TopologicalSorter(packages).static_order():
        below[name] = packages[name].union(*(below[other] for other in packages[name]))
    return {
        name: {o for o in others if not any(o in below[p] for p in others)}
        for name, others in packages.items()
    }


def spread(
    level: Mapping[str, int], arrows: Mapping[str, set[str]]
) -> dict[str, tuple[float, float]]:
    """Return places on the levels such that few arrows pass behind boxes that are not theirs."""
    chance, best, found = random.Random(3), math.inf, {}
    for _ in range(TRIES):
        moved = list(found) and chance.sample(list(found), 2)
        places = {
            name: (chance.uniform(-4.0, 4.0), 1.1 * height)
            if name in moved or not found
            else found[name]
            for name, height in sorted(level.items())
        }
        if (cost := disorder(places, arrows)) < best:
            best, found = cost, places
    return found


def disorder(places: Mapping[str, tuple[float, float]], arrows: Mapping[str, set[str]]) -> float:
    """Return how many boxes overlap or are in the way of arrows, and how far these lean."""
    cost = 0.0
    for name, (x, y) in places.items():
        for third, (a, b) in places.items():
            if third != name and b == y and abs(a - x) < 0.6 + 0.09 * (len(name) + len(third)):
                cost += 10.0
        for other in sorted(arrows[name]):
            u, v = places[other]
            cost += 0.02 * abs(u - x)
            for third, (a, b) in places.items():
                across = x + (u - x) * (y - b) / (y - v)
                cost += v < b < y and abs(across - a) < 0.5 + 0.11 * len(third)
    return cost


def draw(packages: Mapping[str, set[str]], path: Path) -> None:
    """Draw boxes on their levels, and an arrow from each to what it imports."""
    places = spread(levels(packages), reduced(packages))
    figure = Figure(figsize=(9.0, 6.4))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    for name, others in sorted(reduced(packages).items()):
        for other in sorted(others):
            (x, y), (u, v) = places[name], places[other]
            arrow = {"arrowstyle": "-|>", "color": "0.55", "shrinkA": 0, "shrinkB": 0}
            ax.annotate("", (u, v + 0.27), (x, y - 0.27), arrowprops=arrow)
    box = {"boxstyle": "round,pad=0.45", "facecolor": "white", "edgecolor": "0.2"}
    for name, (x, y) in places.items():
        ax.text(x, y, name, ha="center", va="center", family="monospace", bbox=box)
    across, up = zip(*places.values(), strict=True)
    ax.set(xlim=(min(across) - 1.4, max(across) + 1.4), ylim=(-0.6, max(up) + 0.6))
    ax.axis("off")
    FigureCanvasSVG(figure).print_svg(path, metadata={"Date": None})


if __name__ == "__main__":
    page = (HERE.parent / "development/architecture.md").read_text(encoding="utf-8")
    packages = allowed(page)
    packages.pop("mechanics")
    draw(packages, HERE / "packages.svg")
