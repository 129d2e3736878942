"""The joints of one point: `armd.joints.v1`, little-endian, no padding.

Its length depends on the number of joints. It is published only while somebody subscribes.
"""

from __future__ import annotations

import numpy as np

JOINTS_ENCODING = "application/octet-stream;armd.joints.v1"


def joints_dtype(n_joints: int) -> np.dtype[np.void]:
    """Return the memory layout of one message: 24 bytes and 12 for each joint."""
    return np.dtype(
        [
            ("seq", "<u8"),  # seq of its point
            ("stamp_ns", "<i8"),  # stamp of its point
            ("n", "<u4"),
            ("reserved", "<u4"),
            ("angle_rad", "<f8", (n_joints,)),  # as read, signed, before θ0; NaN: joint invalid
            ("rate_rad_s", "<f4", (n_joints,)),  # its sign is the side of approach; NaN: unknown
        ]
    )
