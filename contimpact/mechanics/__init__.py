"""Impacting systems and their periodic orbits. Knows no continuation."""
