"""Motion in time, and what it settles on."""
