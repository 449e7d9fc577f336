"""How long the proof of a branch may take: what is not looked at in that time is said."""

from __future__ import annotations

import math
import time


class Budget:
    """Seconds of processor time from now on: another load of the machine proves the same.

    Parameters
    ----------
    seconds : float
        Infinitely many unless set.
    """

    def __init__(self, seconds: float = math.inf) -> None:
        self.seconds, self._began = seconds, time.process_time()

    @property
    def spent(self) -> bool:
        """Whether they are over."""
        return time.process_time() - self._began > self.seconds

    @property
    def message(self) -> str:
        """What is said of what is left."""
        return f"not proven within {self.seconds:g} s; more are given by seconds in [certify]"
