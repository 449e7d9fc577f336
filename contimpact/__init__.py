"""Continuation of periodic orbits in impacting systems, ghosts included."""
