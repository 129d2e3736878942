"""Types of arrays by their content; shapes are stated where arrays are used."""

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]  # real numbers; NaN: missing
F32 = npt.NDArray[np.float32]  # real numbers with seven digits
I64 = npt.NDArray[np.int64]  # indices of rows, positions, groups
Mask = npt.NDArray[np.bool_]  # a selection
Vector = tuple[float, float, float]  # one point, where an array is not needed
