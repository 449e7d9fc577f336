"""Attractors by simulation: sweeps, basins, transitions, coverage and the energy they give."""
