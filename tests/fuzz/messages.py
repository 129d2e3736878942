"""Payloads on an arm's Zenoh keys: through the client's door into every bridge's hands."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from bridges.dme_bench import INFO, Bench
from fuzz.doors import Door

from armd import keys
from armd.daemon.bridges import lines
from armd.daemon.bridges.fleet import Fleet
from armd.daemon.bridges.ros2.bridge import Bridge
from armd.daemon.bridges.tips import Tips
from armd.daemon.bridges.view import page_messages
from armd.received import is_sound, parse_object
from support.careless_network import EVENT, HEALTH, MEASUREMENT, fleet_of

WHOLE = MEASUREMENT | {
    "trigger": "button", "angles_rad": [0.1] * 6, "covariance_mm2": [1e-4, 0, 0, 1e-4, 0, 1e-4],
    "standard_deviation_mm": [0.001] * 3, "tip_offset_mm": [0, 0, 100.0], "tip_radius_mm": 3.0,
    "approach": [0, 0, -1], "temperatures_c": {"t1": 20.1, "t2": None}, "duration_s": 0.5,
}  # fmt: skip
TIP = {
    "kind": "tip", "text": "now measuring with long", "stamp_ns": 1, "severity": "warning",
    "detail": {"tip": "long", "offset_mm": [0, 0, 120.0], "radius_mm": 1.5},
}  # fmt: skip


class _Publisher:
    def put(self, data: bytes) -> None:
        assert isinstance(data, bytes)


def ros2() -> Bridge:
    """The bridge without its network."""
    settings = SimpleNamespace(
        rate_hz=100.0, namespace="arm", frame="arm_base", router="", domain=0
    )
    bridge = Bridge(SimpleNamespace(serial="S"), settings)  # type: ignore[arg-type]
    for name in ("_point", "_pose", "_measurement", "_joints", "_tf", "_diagnostics"):
        setattr(bridge, name, _Publisher())
    return bridge


def received(
    name: str, key: str, seeds: list[dict[str, Any]], take: Callable[[dict[str, Any]], object]
) -> Door:
    """Messages on a *key*, those that are sound in the hands of *take*."""

    def enter(data: bytes) -> None:
        content = parse_object(key, data)
        if content is not None:
            take(content)

    return Door(name, [json.dumps(seed).encode() for seed in seeds], enter)


def message_doors(folder: Path) -> Iterator[Door]:
    tips = Tips(INFO)
    machine = Bench(folder / "messages")
    machine.type("00001 StartSession()", "00002 EnableUser()",
                 "00003 OnPtMeasReport(X(),Y(),Z(),IJK(),ER(),Q())")  # fmt: skip
    table = lines.parse_template(
        "{x:.3f};{sd_x_um};{u_x_um};{tip};{calibration};{count};{flag_names}"
    )

    def measurement(content: dict[str, Any]) -> None:
        page_messages.format_measurement(content)
        fields = lines.convert_measurement(content, tips, "S")
        for form in (*lines.PRESETS.values(), table):
            if fields is not None:
                form(fields)
        machine.session.take_measurement(content)
        ros2()._tell_measurement(content)

    def health(content: dict[str, Any]) -> None:
        json.dumps(fleet_of(content).rows(), allow_nan=False)
        ros2()._tell_health(content)

    def event(content: dict[str, Any]) -> None:
        Fleet().note_event("S", content)
        page_messages.format_event(content)

    def joints(data: bytes) -> None:
        if is_sound(keys.JOINTS, data):
            ros2()._tell_joints(data)

    whole = INFO | {"tip": None}
    whole["arm"] = whole["arm"] | {"serial_number": "S", "joint": [{"a_mm": 1.0, "d_mm": 2.0}]}
    angles = np.zeros(3).tobytes() + np.zeros(3, "<f4").tobytes()
    yield received("measurement", keys.MEASUREMENT, [WHOLE, MEASUREMENT], measurement)
    yield received("health", keys.HEALTH, [HEALTH], health)
    yield received("event", keys.EVENT, [EVENT, TIP], event)
    yield Door("joints", [bytes(16) + (3).to_bytes(4, "little") + bytes(4) + angles], joints)
    yield received("info", keys.INFO, [whole], Tips)
