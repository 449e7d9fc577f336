"""What a user would run: follow the branch once and write its points, as AUTO does.

python follow_once.py fixed|adaptive FILE
"""

from __future__ import annotations

import sys

from case import ALL, RANGE, STEPS, problem, start

from contimpact import continue_orbit
from contimpact.orbits.search import orbit_at
from contimpact.results.formats import write_auto


def main() -> None:
    steps, file = sys.argv[1:]
    orbit = orbit_at(problem(), start())
    branch = continue_orbit(orbit, "s", RANGE, events=ALL, settings=STEPS[steps])
    write_auto(branch, file)


if __name__ == "__main__":
    main()
