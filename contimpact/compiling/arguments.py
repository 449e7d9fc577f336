"""What a compiled program is called by: its entry, and the kinds of its arguments."""

INTEGERS, VECTOR, TABLE = "i", "f", "F"
"""Kinds of arguments of an entry function: integers, floats, and a table of floats."""

ENTRY = "contimpact_entry"
"""The entry's name in machine code."""
