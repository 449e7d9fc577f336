"""One catalogue for several coefficients of restitution.

    python examples/catalogue_over_restitution.py [CATALOGUE.csv]

Follows the 1:1 orbit and what is born on it for each r, and prints where the 1:1 orbit loses
stability, where it grazes, and whether the grazing is a ghost. The catalogue has a row for each
event of each branch, with r among its columns.
"""

import csv
import sys

import contimpact as ci


def scene(r):
    """Return the scene of Fig. 7 with another r."""
    return ci.read_scene(
        {
            "name": f"r = {r}",
            "model": {
                "system": "impact-pair",
                "parameters": {"beta": "pi/6", "r": r, "A": 5.0, "s": 0.4},
            },
            "follow": {
                "parameter": "s",
                "range": [0.1, 1.0],
                "orbits": ["1:1"],
                "switch": ["G"],
                "depth": 1,
            },
            "detect": {"events": ["FB", "PD", "G"]},
        }
    )


rows = []
for r in (0.2, 0.25, 0.3, 0.35, 0.4):
    diagram = ci.follow(scene(r))
    rows += [entry.as_row() for entry in diagram.entries]
    first = diagram["b1"].events
    doubling = next(e for e in first if e.kind == "PD")
    grazing = next(e for e in first if e.kind == "G")
    print(
        f"r = {r}: {len(diagram.entries)} events; PD at s = {doubling.value:.9f}, "
        f"{grazing.label} at s = {grazing.value:.9f}"
    )

columns = list(dict.fromkeys(name for row in rows for name in row))
if len(sys.argv) > 1:
    with open(sys.argv[1], "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)
print(f"{len(rows)} events, {len(columns)} columns")
