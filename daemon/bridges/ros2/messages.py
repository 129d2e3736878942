"""ROS messages as XCDR1, little-endian; lengths in metres, angles in radians."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field


@dataclass(frozen=True)
class MessageType:
    """A message type: its DDS name, and the hash of its description (one from Iron to Lyrical)."""

    dds: str
    hash: str


POINT_STAMPED = MessageType(
    "geometry_msgs::msg::dds_::PointStamped_",
    "RIHS01_4c0296af86e01e562e9e0405d138a01537247580076c58ea38d7923ac1045897",
)
POSE_WITH_COVARIANCE_STAMPED = MessageType(
    "geometry_msgs::msg::dds_::PoseWithCovarianceStamped_",
    "RIHS01_26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e",
)
JOINT_STATE = MessageType(
    "sensor_msgs::msg::dds_::JointState_",
    "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
)
TF_MESSAGE = MessageType(
    "tf2_msgs::msg::dds_::TFMessage_",
    "RIHS01_e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
)
DIAGNOSTIC_ARRAY = MessageType(
    "diagnostic_msgs::msg::dds_::DiagnosticArray_",
    "RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
)
OK, WARN, ERROR, STALE = range(4)
HEADER = b"\x00\x01\x00\x00"


def has_ros_time(stamp_ns: int) -> bool:
    """Return whether the seconds of a ROS time, 32 bits and signed, can hold the stamp."""
    return abs(stamp_ns) < 10**9 << 31


@dataclass
class Cdr:
    """Appends fields; alignment counts from the end of the header's four bytes."""

    data: bytearray = field(default_factory=lambda: bytearray(HEADER))

    def put(self, letter: str, *values: float) -> None:
        """Append numbers of one kind (`struct`'s letter), each aligned to its own size."""
        size = struct.calcsize(f"<{letter}")
        self.data += bytes(-(len(self.data) - len(HEADER)) % size)
        self.data += struct.pack(f"<{len(values)}{letter}", *values)

    def string(self, text: str) -> None:
        encoded = text.encode() + b"\0"
        self.put("I", len(encoded))
        self.data += encoded

    def doubles(self, values: Sequence[float]) -> None:
        """Append an unbounded sequence; an empty one has no padding behind its count."""
        self.put("I", len(values))
        if values:
            self.put("d", *values)

    def header(self, stamp_ns: int, frame: str) -> None:
        seconds, nanoseconds = divmod(stamp_ns, 10**9)
        self.put("i", seconds)
        self.put("I", nanoseconds)
        self.string(frame)


def encode_point(stamp_ns: int, frame: str, position_m: Sequence[float]) -> bytes:
    cdr = Cdr()
    cdr.header(stamp_ns, frame)
    cdr.put("d", *position_m)
    return bytes(cdr.data)


def encode_pose(
    stamp_ns: int,
    frame: str,
    position_m: Sequence[float],
    orientation: Sequence[float],
    covariance_m2: Sequence[float] | None,
) -> bytes:
    """Encode a pose; *covariance_m2* is xx xy xz yy yz zz.

    None writes −1 as the first element, which is ROS's mark for an unknown covariance.
    """
    matrix = [0.0] * 36
    if covariance_m2 is None:
        matrix[0] = -1.0
    else:
        xx, xy, xz, yy, yz, zz = covariance_m2
        matrix[0:3], matrix[6:9], matrix[12:15] = [xx, xy, xz], [xy, yy, yz], [xz, yz, zz]
    cdr = Cdr()
    cdr.header(stamp_ns, frame)
    cdr.put("d", *position_m, *orientation, *matrix)
    return bytes(cdr.data)


def encode_joint_state(
    stamp_ns: int, names: Sequence[str], angles_rad: Sequence[float], rates: Sequence[float]
) -> bytes:
    """Encode joint angles and *rates* (rad/s, or none at all)."""
    cdr = Cdr()
    cdr.header(stamp_ns, "")
    cdr.put("I", len(names))
    for name in names:
        cdr.string(name)
    cdr.doubles(angles_rad)
    cdr.doubles(rates)
    cdr.doubles(())
    return bytes(cdr.data)


def encode_transform(
    stamp_ns: int,
    frame: str,
    child: str,
    position_m: Sequence[float],
    orientation: Sequence[float],
) -> bytes:
    """Encode a TFMessage of one transform."""
    cdr = Cdr()
    cdr.put("I", 1)
    cdr.header(stamp_ns, frame)
    cdr.string(child)
    cdr.put("d", *position_m, *orientation)
    return bytes(cdr.data)


def encode_diagnostics(
    stamp_ns: int, level: int, name: str, message: str, hardware: str, values: Mapping[str, str]
) -> bytes:
    """Encode a DiagnosticArray of one status."""
    cdr = Cdr()
    cdr.header(stamp_ns, "")
    cdr.put("I", 1)
    cdr.put("B", level)
    for text in (name, message, hardware):
        cdr.string(text)
    cdr.put("I", len(values))
    for key, value in values.items():
        cdr.string(key)
        cdr.string(value)
    return bytes(cdr.data)
