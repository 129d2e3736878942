"""The columns that a correction adds to a table of readings."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from armd.arrays import F64

COLUMNS = ["x_mm", "y_mm", "z_mm", "u_x_mm", "u_y_mm", "u_z_mm", "flags"]
#: digits beyond these are far below the encoders' rounding
DECIMALS = 9


def make_point_columns(figures: F64, flags: npt.NDArray[np.uint32]) -> pa.Table:
    """Make the columns that a correction adds, from figures (n, 3) or (n, 6) and flags (n,)."""
    columns = np.ascontiguousarray(figures.T)
    np.round(columns, DECIMALS, out=columns)
    # Arrow's search for NaN (missing) takes longer than a sum, which shows a NaN as well.
    arrays = [pa.array(column, from_pandas=math.isnan(column.sum())) for column in columns]
    return pa.Table.from_arrays(
        [*arrays, pa.array(flags)], names=[*COLUMNS[: len(arrays)], COLUMNS[-1]]
    )
