"""Reads and writes one object of a node by SDO; errors name the object."""

from __future__ import annotations

from typing import Any

from canopen.sdo.exceptions import SdoAbortedError


class NodeRefused(Exception):
    """The node answers, but is not the one that arm.toml (or this session so far) expects."""


class NodeAbsent(Exception):
    """The node does not answer, or its answer makes no sense."""


class ObjectRefused(NodeAbsent):
    """The node aborted the transfer of one object."""

    def __init__(self, index: int, sub: int, error: SdoAbortedError) -> None:
        super().__init__(f"object {name_object(index, sub)}: it refuses: {error}")


def name_object(index: int, sub: int) -> str:
    """Return the name of an object: `1018:4`, or `6503` if it has no other sub-index."""
    return f"{index:04X}:{sub}" if sub or 0x1018 <= index < 0x2000 else f"{index:04X}"


def read_object(sdo: Any, index: int, sub: int, size: int) -> int:
    """Read an unsigned integer of *size* bytes.

    Raises `NodeAbsent`, or canopen's time-out error.
    """
    try:
        data = bytes(sdo.upload(index, sub))
    except SdoAbortedError as error:
        raise ObjectRefused(index, sub, error) from error
    if len(data) < size:
        location = f"object {name_object(index, sub)}"
        raise NodeAbsent(f"{location}: found {len(data)} bytes, expected {size}")
    return int.from_bytes(data[:size], "little")


def read_optional(sdo: Any, index: int, sub: int, size: int) -> int | None:
    """Read an object; return None where the node lacks it or refuses to send it."""
    try:
        return read_object(sdo, index, sub, size)
    except ObjectRefused:
        return None


def write_object(sdo: Any, index: int, sub: int, size: int, value: int) -> None:
    """Write an object. Raises `ObjectRefused`, or canopen's time-out error."""
    try:
        sdo.download(index, sub, value.to_bytes(size, "little"))
    except SdoAbortedError as error:
        raise ObjectRefused(index, sub, error) from error
