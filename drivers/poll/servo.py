"""What a servo says of itself, and which of that the arm's geometry rests on."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Servo:
    """Read from the servo's registers at each connection."""

    model: int
    firmware: str
    homing_offset: int  # counts, as the register has it
    reversed: bool  # it counts the other way round
    mode: int  # of operation, as the register has it
    torque: bool  # on: it holds the joint
    return_delay_us: int  # that it waits before it answers

    @property
    def geometry(self) -> dict[str, Any]:
        """What shifts or mirrors the joint's angle: with another value arm.toml no longer holds."""
        return {
            "model": self.model,
            "homing_offset": self.homing_offset,
            "reversed": self.reversed,
        }

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def differences(servo: Servo, remembered: dict[str, Any], models: dict[int, str]) -> list[str]:
    """One phrase per difference, `homing offset: found 12, expected 0`; empty for the same."""
    phrases = []
    for name, found in servo.geometry.items():
        expected = remembered.get(name, found)
        if found != expected:
            if name == "model":
                found, expected = (model_name(n, models) for n in (found, expected))
            phrases.append(f"{name.replace('_', ' ')}: found {found}, expected {expected}")
    return phrases


def model_name(model: int, models: dict[int, str]) -> str:
    return models.get(model, f"model {model}")
