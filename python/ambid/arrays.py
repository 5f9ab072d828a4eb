"""Types of the arrays that pass between rooms."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["ComplexArray", "FloatArray", "IndexArray"]

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IndexArray = NDArray[np.intp]
