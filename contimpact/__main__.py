"""``python -m contimpact``: the same door as the command ``contimpact``."""

from .cli import leave, main

if __name__ == "__main__":
    status = main()
    # After an interruption inside ``exec`` of a text, CPython ends ``python -m`` as by SIGINT, even
    # where the exception was handled. It forgets that when it runs another text.
    exec("")
    leave(status)
