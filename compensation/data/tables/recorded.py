"""Tables of points that an arm published, as `armd record --lake` writes them.

They contain joints and temperatures, so that they can be corrected again, and the published points.
A new correction replaces these points; the flags that describe the sample itself are kept.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from armd import Flag
from armd.arrays import F64
from armd.compensation.data.tables.readings import Readings

POSITION = ["x_mm", "y_mm", "z_mm"]
COVARIANCE = ["xx_mm2", "xy_mm2", "xz_mm2", "yy_mm2", "yz_mm2", "zz_mm2"]
#: The first eight bytes of the calibration's SHA-256 as an integer, as in points.
CALIBRATION = "calibration"
FLAGS = "flags"
STAMP = "stamp_ns"
#: Columns that are read from a recorded table in addition to those of readings.
RECORDED_TYPES: dict[str, pa.DataType] = {STAMP: pa.int64(), FLAGS: pa.uint32()}
#: Columns that a new correction replaces.
REPLACED = frozenset([*POSITION, *COVARIANCE, "u_x_mm", "u_y_mm", "u_z_mm", FLAGS])
#: Flags that describe the sample, independent of its correction.
OF_SAMPLE = sum(flag for flag in Flag if flag.origin == "sample")


def is_recorded(header: Collection[str]) -> bool:
    """Return whether a table with these columns contains points that an arm published."""
    return {"seq", STAMP, CALIBRATION, FLAGS, *POSITION} <= set(header)


def drop_published(table: pa.Table, identity: int) -> pa.Table:
    """Return a recorded table without the columns that a correction replaces.

    Its calibration is the new *identity* (0: none). Any other table is returned unchanged.
    """
    if not is_recorded(table.column_names):
        return table
    unpublished = table.select([name for name in table.column_names if name not in REPLACED])
    place = unpublished.column_names.index(CALIBRATION)
    again = pa.array(np.full(len(unpublished), identity, np.uint64))
    return unpublished.set_column(place, CALIBRATION, again)


def read_instants_s(readings: Readings) -> F64:
    """Return the instants (n,) of recorded points, Unix seconds."""
    return readings.required(STAMP) * 1e-9


def read_flags(readings: Readings) -> npt.NDArray[np.uint32]:
    """Return the published flags (n,) that describe the sample; 0 where missing."""
    flags = readings.number(FLAGS)
    return np.where(np.isnan(flags), 0.0, flags).astype(np.uint32) & np.uint32(OF_SAMPLE)
