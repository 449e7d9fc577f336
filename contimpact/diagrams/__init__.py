"""Branches of periodic orbits, whole diagrams, and curves and maps in two parameters."""
