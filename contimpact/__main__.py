"""``python -m contimpact``: the same door as the command ``contimpact``."""

from .cli import program

if __name__ == "__main__":
    program()
