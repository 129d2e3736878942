"""`[driver]` of armd.toml: one model per kind. An unknown key is an error, but for CAN, whose
further keys are those of python-can's interface."""

from __future__ import annotations

from difflib import get_close_matches
from typing import Annotated, Literal, Self

from pydantic import ConfigDict, Field, field_validator, model_validator
from pydantic_core import PydanticCustomError

from armd.drivers.unwrap import MAX_JOINT_RATE_DEG_S
from armd.files.schema import KEY_FAULT, Strict


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

    @model_validator(mode="after")
    def _python_can_knows_the_rest(self) -> Self:
        from armd.drivers.can.options import INTERFACES, options_of

        if self.interface not in INTERFACES:
            found, expected = repr(self.interface), f"one of {', '.join(INTERFACES)}"
            raise _wrong("interface", found, expected)
        options = options_of(self.interface)
        if options is None:
            return self
        given = self.model_extra or {}
        for key in given:
            if key not in options.known:
                ours = set(type(self).model_fields)
                near = get_close_matches(key, sorted(ours | options.known), 1, 0.5)
                hint = f"; {near[0]}?" if near else ""
                expected = f"a key of armd or of python-can's {self.interface}{hint}"
                raise _wrong(key, "an unknown key", expected)
        for key in options.required - set(given) - ({"channel"} if self.channel else set()):
            raise _wrong(key, "nothing", f"this key, which python-can's {self.interface} needs")
        return self


def _wrong(key: str, found: str, expected: str) -> PydanticCustomError:
    """See `armd.files.schema.KEY_FAULT`."""
    return PydanticCustomError(
        KEY_FAULT, "{found}", {"key": key, "found": found, "expected": expected}
    )


ServoId = Annotated[int, Field(ge=0, le=252)]


class Trigger(Strict):
    """A servo that is a button: bit 0 while its raw position (0…4095) is below."""

    id: ServoId
    pressed_below: Annotated[int, Field(ge=1, le=4095)]


class ServoConfig(Strict):
    kind: Literal["feetech", "dynamixel"]
    port: Annotated[str, Field(min_length=1)]  # a stable name: /dev/serial/by-id/…
    baud: Annotated[int, Field(gt=0)] = 1_000_000
    ids: Annotated[list[ServoId], Field(min_length=3, max_length=9)]  # joint k is ids[k-1]
    rate_hz: Annotated[float, Field(gt=0, le=2000)] | None = None  # None: what the line allows
    temperature_ids: list[ServoId] | None = None  # sensor k is this servo's; None: ids
    trigger: Trigger | None = None
    adapter_serial: Annotated[str, Field(min_length=1)] | None = None  # of the USB adapter
    # Nothing is ever written to a servo but by these two, at each connection:
    torque_off: bool = False
    return_delay_us: Annotated[int, Field(ge=0, le=508, multiple_of=2)] | None = None
    #: take changed homing offsets and other servos without `armd accept`
    accept_changed_offsets: bool = False
    max_joint_rate_deg_s: Annotated[float, Field(gt=0)] = MAX_JOINT_RATE_DEG_S

    @field_validator("ids", "temperature_ids")
    @classmethod
    def _once_each(cls, ids: list[int] | None) -> list[int] | None:
        if ids is not None and len(set(ids)) != len(ids):
            raise ValueError("each id once")
        return ids


class MicroScribeConfig(Strict):
    kind: Literal["microscribe"]
    port: Annotated[str, Field(min_length=1)]
    baud: Annotated[int, Field(gt=0)] | None = None  # found by trying
    stream: bool = True  # False: each reading is asked for, as from an arm that cannot stream
    max_joint_rate_deg_s: Annotated[float, Field(gt=0)] = MAX_JOINT_RATE_DEG_S


class ReplayConfig(Strict):
    kind: Literal["replay"]
    file: Annotated[str, Field(min_length=1)]  # MCAP, relative to armd.toml
    speed: Annotated[float, Field(ge=0)] = 1.0  # 0: as fast as it goes


DriverConfig = Annotated[
    SerialConfig | CanConfig | ServoConfig | MicroScribeConfig | ReplayConfig,
    Field(discriminator="kind"),
]
