"""Maps the TPDOs of a node, as far as the node permits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from armd.drivers.can import objects as can
from armd.drivers.can.objects import EncoderLayout
from armd.drivers.can.setup.sdo import (
    NodeAbsent,
    NodeRefused,
    ObjectRefused,
    read_object,
    write_object,
)

Mapping = Sequence[tuple[int, int, int]]  # index, sub-index, bits


def set_tpdo(
    sdo: Any, node: int, pdo: int, mappings: Sequence[Mapping], every_sync: int
) -> list[int]:
    """Switch TPDO *pdo* off, map it and switch it on, in the order that CiA 301 demands.

    *mappings*: the suitable mappings, best first. A node whose mapping is fixed keeps its own.
    Returns the entries of the resulting mapping, read back. Raises `NodeRefused`, `NodeAbsent`, or
    canopen's time-out error.
    """
    communication, index = can.TPDO_COMMUNICATION + pdo - 1, can.TPDO_MAPPING + pdo - 1
    cob_id = can.TPDO_BASE[pdo - 1] + node
    cob_id = _switch_off(sdo, communication, cob_id)
    _set_kind(sdo, communication, every_sync)
    refusal: ObjectRefused | None = None
    for mapping in mappings:
        try:
            _write_mapping(sdo, index, mapping)
            break
        except ObjectRefused as error:
            refusal = refusal or error
    _write_unless(sdo, communication, 1, 4, cob_id)
    entries = read_mapping(sdo, index)
    if refusal is not None and entries not in [_entries(mapping) for mapping in mappings]:
        raise NodeAbsent(f"{refusal}; it keeps the mapping {_hex(entries)}")
    kind = read_object(sdo, communication, 2, 1)
    if kind != every_sync:
        raise NodeRefused(
            f"object {communication:04X}:2, transmission type: found {kind}, expected {every_sync}"
        )
    return entries


def check_mapping(pdo: int, entries: list[int], mapping: Mapping) -> None:
    """Raise `NodeRefused` if *entries* are not those of *mapping*."""
    if entries != _entries(mapping):
        index = can.TPDO_MAPPING + pdo - 1
        raise NodeRefused(
            f"object {index:04X}, mapping of TPDO{pdo}: found {_hex(entries)}, expected"
            f" {_hex(_entries(mapping))}"
        )


def find_layout(entries: list[int]) -> EncoderLayout:
    """Find the bytes of position and alarms in TPDO1 of an encoder. Raises `NodeRefused`."""
    places: dict[int, int] = {}
    bit = 0
    for entry in entries:
        places.setdefault(entry, bit)
        bit += entry & 0xFF
    position = places.get(can.POSITION << 16 | 32)
    alarms = places.get(can.ALARMS << 16 | 16)
    if position is None or bit > 64 or any(place % 8 for place in (position, alarms or 0, bit)):
        raise NodeRefused(
            f"object {can.TPDO_MAPPING:04X}, mapping of TPDO1: found {_hex(entries)}, expected"
            f" {can.POSITION:04X} of 32 bits in it"
        )
    return EncoderLayout(bit // 8, position // 8, None if alarms is None else alarms // 8)


def read_mapping(sdo: Any, index: int) -> list[int]:
    n_entries = read_object(sdo, index, 0, 1)
    if n_entries > 64:
        raise NodeRefused(f"object {index:04X}:0: found {n_entries}, expected 64 at the most")
    return [read_object(sdo, index, sub, 4) for sub in range(1, n_entries + 1)]


def _switch_off(sdo: Any, communication: int, cob_id: int) -> int:
    """Switch the PDO off; return the COB-ID with which to switch it on.

    The node decides whether remote frames are allowed: CiA 301 lets it refuse the other setting.
    """
    before = read_object(sdo, communication, 1, 4)
    cob_id |= before & can.NO_REMOTE_FRAMES
    try:
        write_object(sdo, communication, 1, 4, cob_id | can.PDO_OFF)
    except ObjectRefused:
        if before == cob_id:  # the COB-ID is fixed, and correct
            return cob_id
        cob_id ^= can.NO_REMOTE_FRAMES
        write_object(sdo, communication, 1, 4, cob_id | can.PDO_OFF)
    return cob_id


def _set_kind(sdo: Any, communication: int, every_sync: int) -> None:
    _write_unless(sdo, communication, 2, 1, every_sync)


def _write_unless(sdo: Any, index: int, sub: int, size: int, value: int) -> None:
    """Write an object; ignore a refusal if it has that value already."""
    try:
        write_object(sdo, index, sub, size, value)
    except ObjectRefused:
        if read_object(sdo, index, sub, size) != value:
            raise


def _write_mapping(sdo: Any, index: int, mapping: Mapping) -> None:
    write_object(sdo, index, 0, 1, 0)
    for sub, entry in enumerate(_entries(mapping), start=1):
        write_object(sdo, index, sub, 4, entry)
    write_object(sdo, index, 0, 1, len(mapping))


def _entries(mapping: Mapping) -> list[int]:
    return [index << 16 | sub << 8 | bits for index, sub, bits in mapping]


def _hex(entries: list[int]) -> str:
    return " ".join(f"{entry:08x}" for entry in entries) or "none"
