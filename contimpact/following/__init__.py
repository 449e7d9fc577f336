"""Orbits followed along a parameter: from an orbit to its branch."""
