"""Segments closed into periodic orbits: equations, multipliers, physicality, search."""
