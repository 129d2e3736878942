"""The findings of `armd doctor`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class Obstacle:
    """One obstacle, with its remedy."""

    kind: str  # "permission", "latency_timer", "missing_id", …: docs/how-to/doctor.md
    text: str  # a sentence
    mend: str  # the command, or what to do where no command does it


@dataclass
class PortReport:
    """A port or a bus of this machine, with facts and findings about it."""

    name: str
    facts: list[str] = field(default_factory=list)
    findings: list[Obstacle] = field(default_factory=list)
    servos: Sequence[dict[str, Any]] = ()  # as armd.drivers.poll.protocol.family.Servo, with "id"
    protocol: str = ""  # of the device that answers: a `kind` of [driver], or ""
    baud: int | None = None
    rate_hz: float | None = None  # measured cycles a second

    def say(self, fact: str) -> None:
        self.facts.append(fact)

    def find(self, kind: str, text: str, mend: str) -> None:
        self.findings.append(Obstacle(kind, text, mend))

    def as_json(self) -> dict[str, Any]:
        return asdict(self)
