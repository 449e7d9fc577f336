"""Proofs by interval arithmetic: what a catalogue records exists, and nothing is missing."""

import importlib.util

if importlib.util.find_spec("flint") is None:
    lacking = "python-flint, which proofs are made with, is not installed"
    raise ModuleNotFoundError(f"{lacking}: pip install contimpact[certify]", name="flint")
