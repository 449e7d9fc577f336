"""What reaches the terminal: lines of text, with nothing in them that it would obey."""

from __future__ import annotations

import sys
from typing import TextIO

from ..storage.texts import terminal_text


def say(text: str, stream: TextIO | None = None) -> None:
    """Print lines of text, to standard output if nothing else is said."""
    stream = stream or sys.stdout
    print(terminal_text(text, getattr(stream, "encoding", None)), file=stream, flush=True)


def complain(message: object) -> None:
    """Write a message to standard error."""
    say(f"contimpact: {message}", sys.stderr)
