"""Kinds of arrays that signatures name; a comment beside each array gives its shape, unit and frame."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
IndexArray: TypeAlias = NDArray[np.intp]  # what np.flatnonzero and np.argsort give
BoolArray: TypeAlias = NDArray[np.bool_]
ByteArray: TypeAlias = NDArray[np.uint8]
Vector: TypeAlias = tuple[float, float, float]  # three numbers of a value that can be hashed
