"""The types of arrays: NumPy's, and what compiled functions take."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

Array: TypeAlias = np.ndarray[Any, Any]
"""NumPy's arrays, of any shape and kind of number."""

Number: TypeAlias = Any
"""A number of some arithmetic: a float, an array of them, one with bounds, one of many digits."""

Vector: TypeAlias = Any
"""A list, tuple or array of numbers, for functions that run plainly and compiled."""

Table: TypeAlias = Any
"""A list of rows, or an array of two dimensions, for the same."""
