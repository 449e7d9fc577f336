"""Pseudo-arclength continuation with events. Knows no mechanics."""
