"""Draws rooms.svg: the rooms of the package, each above all that it may import.

    python docs/figures/rooms.py

Rooms and arrows are those of the table in docs/architecture.md.
"""

import re
from collections.abc import Mapping
from graphlib import TopologicalSorter
from pathlib import Path

from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

HERE = Path(__file__).parent
ROW = re.compile(r"^\| `(\w+)` \| (.*) \|$", re.MULTILINE)


def allowed(page: str) -> dict[str, set[str]]:
    """Return which rooms each room may import, as the page says."""
    table = page.split("<!-- table of rooms -->")[1].split("\n\n", 2)[1]
    return {name: set(re.findall(r"`(\w+)`", others)) for name, others in ROW.findall(table)}


def floors(rooms: Mapping[str, set[str]]) -> dict[str, int]:
    """Return how many rooms stand below each, one on the other."""
    found: dict[str, int] = {}
    for name in TopologicalSorter(rooms).static_order():
        found[name] = max((found[other] + 1 for other in rooms[name]), default=0)
    return found


def reduced(rooms: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """Return the arrows that no way round says already."""
    below: dict[str, set[str]] = {}
    for name in TopologicalSorter(rooms).static_order():
        below[name] = rooms[name].union(*(below[other] for other in rooms[name]))
    return {
        name: {o for o in others if not any(o in below[p] for p in others)}
        for name, others in rooms.items()
    }


def draw(rooms: Mapping[str, set[str]], path: Path) -> None:
    """Draw boxes on their floors, and an arrow from each to what it stands on."""
    floor = floors(rooms)
    places = {}
    for level in range(max(floor.values()) + 1):
        here = sorted(name for name in rooms if floor[name] == level)
        for i, name in enumerate(here):
            places[name] = (2.4 * (i - (len(here) - 1) / 2) + 0.5 * (level % 2), 1.1 * level)
    figure = Figure(figsize=(9.0, 6.4))
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    for name, others in reduced(rooms).items():
        for other in others:
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
    page = (HERE.parent / "architecture.md").read_text(encoding="utf-8")
    rooms = allowed(page)
    rooms.pop("mechanics")
    draw(rooms, HERE / "rooms.svg")
