"""Types of the arrays that pass between rooms."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["ComplexArray", "FloatArray"]

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
