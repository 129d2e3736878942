"""How faults spoil a latch, a temperature reading or a packet on the serial wire."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from armd.simulator.electronics import COUNTS_PER_TURN
from armd.simulator.faults import Fault


def at_latch(fault: Fault, sample: np.void) -> None:
    """Spoil a SAMPLE's body, in place."""
    joint = fault.joint - 1
    match fault.name:
        case "joint_invalid":
            sample["joint_status"] |= 1 << joint
        case "count_jump":
            sample["count"][joint] = (int(sample["count"][joint]) + fault.size) % COUNTS_PER_TURN


def in_sensors(fault: Fault, celsius: npt.NDArray[np.float64]) -> None:
    """Spoil a temperature reading (S,), in place; NaN is an invalid channel."""
    match fault.name:
        case "sensor_open":
            celsius[fault.channel - 1] = np.nan
        case "temperature_step":
            celsius[fault.channel - 1] += fault.size


def on_wire(fault: Fault, packet: bytes, rng: np.random.Generator) -> bytes:
    """What is left of a SAMPLE packet on the wire."""
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
