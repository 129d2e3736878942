"""`[driver]` of armd.toml: one model per kind. An unknown key is an error, but for CAN, whose
further keys are python-can's own."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from armd.drivers.unwrap import MAX_JOINT_RATE_DEG_S
from armd.schema import Strict


class SerialConfig(Strict):
    kind: Literal["serial"]
    port: Annotated[str, Field(min_length=1)]  # a stable name: /dev/serial/by-id/…
    baud: Annotated[int, Field(gt=0)] = 2_000_000
    max_joint_rate_deg_s: Annotated[float, Field(gt=0)] = MAX_JOINT_RATE_DEG_S


class CanConfig(Strict):
    model_config = ConfigDict(extra="allow")  # bitrate, host, port, …: passed to python-can

    kind: Literal["can"]
    interface: Annotated[str, Field(min_length=1)]  # "socketcan", "socketcand", "slcan", …
    channel: str | int | None = None
    rate_hz: Annotated[float, Field(gt=0, le=2000)] = 500.0
    sync: Literal["producer", "follower"] = "producer"
    encoder_serial_numbers: list[int] | None = None  # 1018:4 of nodes 1…N, in this order
    max_joint_rate_deg_s: Annotated[float, Field(gt=0)] = MAX_JOINT_RATE_DEG_S


class ReplayConfig(Strict):
    kind: Literal["replay"]
    file: Annotated[str, Field(min_length=1)]  # MCAP, relative to armd.toml
    speed: Annotated[float, Field(ge=0)] = 1.0  # 0: as fast as it goes


DriverConfig = Annotated[SerialConfig | CanConfig | ReplayConfig, Field(discriminator="kind")]
