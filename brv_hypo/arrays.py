"""Array types shared by every layer."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
Values = TypeVar("Values", FloatArray, ComplexArray)  # real or complex, the same within one signature
