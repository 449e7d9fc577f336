"""Continuation of periodic orbits: from an orbit to its branch."""
