"""Whole diagrams: the orbits of a scene, their branches, and those born on them."""
