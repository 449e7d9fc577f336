"""``python -m contimpact``: the same door as the command ``contimpact``."""

import sys

from .cli import main

if __name__ == "__main__":
    status = main()
    # After an interruption inside ``exec`` of a text, CPython ends ``python -m`` as by SIGINT, even
    # where the exception was handled. It forgets that when it runs another text.
    exec("")
    sys.exit(status)
