"""Arrays by what stands in them; their shapes are said where they are used."""

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]  # real numbers, NaN missing
F32 = npt.NDArray[np.float32]  # real numbers of which seven digits are enough
I64 = npt.NDArray[np.int64]  # numbers of rows, places, groups
Mask = npt.NDArray[np.bool_]  # which of them
Vector = tuple[float, float, float]  # of one point, where an array would be more than it takes
