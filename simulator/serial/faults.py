"""Applies faults to a latch, a temperature reading or a packet on the serial wire."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armd.arrays import F64
from armd.drivers.serial import wire
from armd.simulator.live.faults import Fault, Schedule


class SpoiltLine:
    """The line with the active faults.

    *torn* is set while the last packet lacks its delimiter; then the next packet is lost too.
    """

    def __init__(
        self, schedule: Schedule, rng: np.random.Generator, counts_per_turn: Sequence[int]
    ) -> None:
        self.torn = False
        self._turns = counts_per_turn
        self._schedule = schedule
        self._rng = rng

    @property
    def clear(self) -> bool:
        """Whether no fault affects the next packet."""
        return not (self._schedule.active or self.torn)

    def sample(self, row: np.void) -> tuple[bytes, str]:
        """Return the bytes of a SAMPLE on the line, and the fault that loses it.

        The fault is "" if the SAMPLE arrives.
        """
        row = row.copy()
        for fault in self._schedule.active:
            spoil_latch(fault, row, self._turns)
        intact_packet = packet = wire.pack(row.tobytes())
        lost_by = "truncated_packet" if self.torn else ""
        for fault in self._schedule.active:
            packet = spoil_packet(fault, packet, self._rng)
            if not packet.startswith(intact_packet):
                lost_by = fault.name
        if packet:
            self.torn = not packet.endswith(b"\0")
        return packet, lost_by

    def temperature(self, t_us: int, celsius: F64) -> bytes:
        """Return the TEMPERATURE packet of a reading (S,), which is spoilt in place."""
        for fault in self._schedule.active:
            spoil_sensors(fault, celsius)
        if self._schedule.is_on("sensor_silent"):
            return b""
        return self.pass_intact(wire.encode_temperature(t_us, celsius))

    def pass_intact(self, packet: bytes) -> bytes:
        """Return a packet that no fault spoils."""
        self.torn = False
        return packet


def spoil_latch(fault: Fault, sample: np.void, counts_per_turn: Sequence[int]) -> None:
    """Spoil a SAMPLE's body, in place; *counts_per_turn* (N,)."""
    joint = fault.joint - 1
    match fault.name:
        case "joint_invalid":
            sample["joint_status"] |= 1 << joint
        case "count_jump":
            sample["count"][joint] = (int(sample["count"][joint]) + fault.size) % counts_per_turn[
                joint
            ]


def spoil_sensors(fault: Fault, celsius: F64) -> None:
    """Spoil a temperature reading (S,), in place; NaN is an invalid channel."""
    match fault.name:
        case "sensor_open":
            celsius[fault.channel - 1] = np.nan
        case "temperature_step":
            celsius[fault.channel - 1] += fault.size


def spoil_packet(fault: Fault, packet: bytes, rng: np.random.Generator) -> bytes:
    """Return the bytes of a SAMPLE packet on the wire after a fault."""
    match fault.name:
        case "corrupted_byte":
            spoilt = bytearray(packet)
            spoilt[rng.integers(len(packet) - 1)] ^= int(rng.integers(1, 256))
            return bytes(spoilt)
        case "truncated_packet":
            return packet[: rng.integers(1, len(packet))]
        case "lost_samples":
            return b""
        case "repeated_packet":
            return packet + packet
    return packet
