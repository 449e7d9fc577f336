"""Curves of bifurcations in two parameters, and where they compete."""
