"""The type of all arrays: NumPy's, of any shape and kind of number."""

from __future__ import annotations

from typing import Any

import numpy as np

Array = np.ndarray[Any, Any]
