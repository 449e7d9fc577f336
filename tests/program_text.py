"""The text of a compiled program, run as it stands in the place of machine code.

Compiling one takes ten to twenty seconds; so quick tests compare texts with plain runs, on the
arrays that compiled code is given, and slow ones compile.
"""

from __future__ import annotations

import numpy as np

from contimpact.diagrams import orbit_backend


class Text:
    def __init__(self, program):
        self.names = {"compile": lambda function: function}
        exec(program.text, self.names)

    def __call__(self, *arrays):
        with np.errstate(all="ignore"):
            return self.names["entry"](*arrays)


def run_as_texts(monkeypatch):
    """Let walks run on the texts of programs; returns those that were made."""
    monkeypatch.setenv("CONTIMPACT_COMPILED", "always")
    made = {}

    def load(identity, arguments, build, worth=True):
        return made.setdefault(identity, Text(build()))

    monkeypatch.setattr(orbit_backend, "load", load)
    return made
