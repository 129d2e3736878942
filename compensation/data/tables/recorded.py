"""Tables of points that an arm published, as `armd record --lake` writes them.

They hold joints and temperatures, so that they can be corrected again, and the published points.
A new correction replaces these; the flags that describe the sample itself are kept.
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
#: The first eight bytes of the calibration's SHA-256 as an integer, as a point has them.
CALIBRATION = "calibration"
FLAGS = "flags"
STAMP = "stamp_ns"
#: What is read of a recorded table besides the columns of readings.
RECORDED_TYPES: dict[str, pa.DataType] = {STAMP: pa.int64(), FLAGS: pa.uint32()}
#: Columns that a new correction replaces.
REPLACED = frozenset([*POSITION, *COVARIANCE, "u_x_mm", "u_y_mm", "u_z_mm", FLAGS])
#: Flags that describe the sample, whatever corrects it.
OF_SAMPLE = sum(flag for flag in Flag if flag.origin == "sample")


def is_recorded(header: Collection[str]) -> bool:
    """Whether a table with these columns holds points that an arm published."""
    return {"seq", STAMP, CALIBRATION, FLAGS, *POSITION} <= set(header)


def drop_published(table: pa.Table, identity: int) -> pa.Table:
    """Return a recorded table without what a correction replaces, and with the new *identity* as
    its calibration (0: none); any other table as it is."""
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
    """Return the published flags (n,) that describe the sample; none where missing."""
    flags = readings.number(FLAGS)
    return np.where(np.isnan(flags), 0.0, flags).astype(np.uint32) & np.uint32(OF_SAMPLE)
