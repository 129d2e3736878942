"""An arm as a measuring machine without network, and clients that type at it."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from armd import POINT
from armd.daemon.bridges.ippdme.commands_2_5 import VERSIONS
from armd.daemon.bridges.ippdme.csy import CoordinateSystems
from armd.daemon.bridges.ippdme.dialogue import Dialogue
from armd.daemon.bridges.ippdme.machine import Machine
from armd.daemon.bridges.ippdme.tools import Toolbox
from armd.daemon.bridges.tips import Tips

INFO = {
    "arm": {"tip": {"offset_mm": [0.0, 0.0, 100.0], "radius_mm": 3.0}},
    "configuration": {
        "tips": {
            "Ball3": {"offset_mm": [0.0, 0.0, 120.0], "radius_mm": 1.5},
            "long": {"offset_mm": [0.0, 50.0, 0.0], "radius_mm": None},
        }
    },
}
MEASUREMENT: dict[str, Any] = {
    "trigger": "button", "seq": 7, "position_mm": [1.5, 2.5, 3.5], "tip": "Ball3", "flags": 512,
    "orientation": [0.0, 0.0, 0.0, 1.0], "approach": [0.0, 0.0, -1.0],
}  # fmt: skip
RESPONSE = re.compile(r"(\d{5}|E\d{4}) (&|%|# .+|! Error\(\d, \d{4}, \"[^\"]+\", \"[^\"]+\"\))")


class Bench:
    """A machine, and clients that type."""

    def __init__(self, folder: Path, version: str = "1.4.3", tip: str | None = "Ball3") -> None:
        self.now_s = 100.0
        self.version = version
        self.asked: list[tuple[str, Callable[[bool], None]]] = []
        tips = Tips(INFO)
        self.machine = Machine(
            tips,
            Toolbox(tips, {"PROBE1.TIP1A0B0": "long"}, tip),
            CoordinateSystems(folder / "state" / "ippdme-S.json"),
            lambda name, settle: self.asked.append((name, settle)),
            reach_mm=1000.0,
            clock=lambda: self.now_s,
        )
        self.said: list[str] = []
        self.session = self.client(self.said)
        self.move(99.93, 17.148, -5.0)

    def client(self, said: list[str]) -> Dialogue:
        def send(line: str) -> None:
            assert RESPONSE.fullmatch(line), line
            said.append(line)

        return Dialogue(self.machine, VERSIONS[self.version], self.version, send)

    def move(self, *position_mm: float, flags: int = 0) -> None:
        point = np.zeros(1, POINT)[0]
        point["position_mm"], point["orientation"] = position_mm, (0, 0, 0, 1)
        point["flags"] = flags
        self.machine.note_point(point)

    def type(self, *lines: str) -> list[str]:
        """What is said from the first of these lines on."""
        before = len(self.said)
        for line in lines:
            self.session.receive(line)
        return self.said[before:]

    def press(self, **changes: Any) -> list[str]:
        before = len(self.said)
        self.session.take_measurement(MEASUREMENT | changes)
        return self.said[before:]

    def error(self, line: str) -> tuple[int, int]:
        """Severity and number of the one error that a command is answered with; then cleared."""
        said = self.type(line)
        tag = line[:5]
        found = [re.match(r"\S+ ! Error\((\d), (\d{4}), ", text) for text in said]
        (error,) = [match for match in found if match]
        if said[0].startswith(tag):
            assert said[0] == f"{tag} &"
            assert said[-1] == f"{tag} %"
        self.session.receive("99999 ClearAllErrors()")
        return int(error[1]), int(error[2])
