"""Events of periodic orbits: test functions, exact systems, ghosts, and the branches born there."""
