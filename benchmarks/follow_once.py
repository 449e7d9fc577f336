"""What a user would run: follow the branch once and write its points.

python follow_once.py fixed|adaptive TABLE.csv
"""

from __future__ import annotations

import sys
from pathlib import Path

from case import ALL, RANGE, STEPS, problem, start

from contimpact import continue_orbit
from contimpact.catalogue import branch_text
from contimpact.mechanics.search import orbit_at


def main() -> None:
    steps, table = sys.argv[1:]
    orbit = orbit_at(problem(), start())
    branch = continue_orbit(orbit, "s", RANGE, events=ALL, settings=STEPS[steps])
    Path(table).write_text(branch_text(branch), encoding="utf-8")


if __name__ == "__main__":
    main()
