"""The columns that a correction adds to a table of readings."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from armd.arrays import F64

COLUMNS = ["x_mm", "y_mm", "z_mm", "u_x_mm", "u_y_mm", "u_z_mm", "flags"]
#: nanometres and below are the encoders' rounding, many times over
DECIMALS = 9


def make_point_columns(figures: F64, flags: npt.NDArray[np.uint32]) -> pa.Table:
    """The columns that a correction adds, of figures (n, 3) or (n, 6) and flags (n,)."""
    columns = [pa.array(np.round(column, DECIMALS), from_pandas=True) for column in figures.T]
    return pa.Table.from_arrays(
        [*columns, pa.array(flags)], names=[*COLUMNS[: len(columns)], COLUMNS[-1]]
    )
