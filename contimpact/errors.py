"""The one exception of the library: input that cannot be used."""

from __future__ import annotations


class InputError(ValueError):
    """Something the caller gave cannot be used.

    Parameters
    ----------
    where : str
        What was given: a key's path in a scene, an argument, a file.
    found : str
        What was found there.
    accepted : str
        What would be accepted instead.
    """

    def __init__(self, where: str, found: str, accepted: str) -> None:
        self.where, self.found, self.accepted = where, found, accepted
        super().__init__(f"{where}: {found}; {accepted}")

    def within(self, prefix: str) -> InputError:
        """Return the same error, its place seen from one level further out."""
        return InputError(f"{prefix}.{self.where}", self.found, self.accepted)
