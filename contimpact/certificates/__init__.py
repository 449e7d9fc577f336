"""Proofs by interval arithmetic: what a catalogue records exists, and nothing is missing."""
