"""The identity of the arm: compares what arm.toml expects with what the wire reports."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Expectation:
    """The identity that arm.toml states; a driver delivers nothing valid from any other arm."""

    serial_number: str
    n_joints: int
    n_sensors: int
    counts_per_turn: tuple[int | None, ...]  # one per joint; None is not checked

    def mismatches(
        self, serial_number: str, n_joints: int, counts_per_turn: Sequence[int]
    ) -> list[str]:
        """List the differences, each as `serial number: found X, expected Y`; empty for the
        expected arm.
        """
        faults = []
        if serial_number != self.serial_number:
            faults.append(f"serial number: found {serial_number}, expected {self.serial_number}")
        if n_joints != self.n_joints:
            faults.append(f"joints: found {n_joints}, expected {self.n_joints}")
        else:
            faults += [
                f"joint {k} counts per turn: found {reported}, expected {expected}"
                for k, (reported, expected) in enumerate(
                    zip(counts_per_turn, self.counts_per_turn, strict=True), start=1
                )
                if expected is not None and reported != expected
            ]
        return faults
