"""The table `[driver]` of armd.toml: one model per kind of driver.

An unknown key is an error, except for CAN, whose further keys are those of python-can's interface.
"""

from __future__ import annotations

from difflib import get_close_matches
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, ConfigDict, Field, field_validator, model_validator
from pydantic_core import PydanticCustomError

from armd.drivers.microscribe import wire as microscribe
from armd.drivers.poll.protocol.rates import BAUDS
from armd.drivers.unwrap import MAX_JOINT_RATE_DEG_S
from armd.files.schema import KEY_FAULT, Strict

#: The range of rates of UARTs that arms use; adapters end at 12 Mbaud.
LEAST_BAUD, MOST_BAUD = 9_600, 12_000_000


def _name(text: str) -> str:
    if not text.strip() or not text.isprintable():
        raise ValueError("a name of printable characters")
    return text


def _return_delay(delay_us: int) -> int:
    if delay_us not in range(0, 509, 2):
        raise ValueError("an even number, 0 to 508")
    return delay_us


Printable = Annotated[str, AfterValidator(_name)]  # of a port, file or adapter
#: Cycles a second. At fewer than 5 the line would count as silent, and the state as not READY.
RateHz = Annotated[float, Field(ge=5, le=2000)]
#: The lowest is slower than a hand moves, the highest faster than any arm: half a turn in 9 ms.
JointRate = Annotated[float, Field(ge=1, le=20_000)]


class SerialConfig(Strict):
    kind: Literal["serial"]
    port: Printable  # a stable name: /dev/serial/by-id/…
    baud: Annotated[int, Field(ge=LEAST_BAUD, le=MOST_BAUD)] = 2_000_000
    max_joint_rate_deg_s: JointRate = MAX_JOINT_RATE_DEG_S


class CanConfig(Strict):
    model_config = ConfigDict(extra="allow")  # bitrate, host, port, …: passed to python-can

    kind: Literal["can"]
    interface: str  # "socketcan", "socketcand", "slcan", …
    channel: str | int | None = None
    rate_hz: RateHz = 500.0
    sync: Literal["producer", "follower"] = "producer"
    #: object 1018:4 of nodes 1…N, in this order; in CiA 301, 0 means no number
    encoder_serial_numbers: list[Annotated[int, Field(ge=1, le=0xFFFF_FFFF)]] | None = None
    max_joint_rate_deg_s: JointRate = MAX_JOINT_RATE_DEG_S

    @field_validator("channel", mode="before")
    @classmethod
    def _a_name_or_a_number(cls, channel: object) -> object:
        if isinstance(channel, str):
            return _name(channel)
        if channel is None or (type(channel) is int and channel >= 0):
            return channel
        raise ValueError("a name, or a number of 0 or more")

    @field_validator("encoder_serial_numbers")
    @classmethod
    def _once_each(cls, numbers: list[int] | None) -> list[int] | None:
        if numbers is not None and len(set(numbers)) != len(numbers):
            raise ValueError("each number once")
        return numbers

    @model_validator(mode="after")
    def _python_can_knows_the_rest(self) -> Self:
        from armd.drivers.can.options import INTERFACES, find_options

        if self.interface not in INTERFACES:
            actual, expected = repr(self.interface), f"one of {', '.join(INTERFACES)}"
            raise _wrong("interface", actual, expected)
        options = find_options(self.interface)
        if options is None:
            return self
        extra = self.model_extra or {}
        for key in extra:
            if key not in options.names:
                ours = set(type(self).model_fields)
                matches = get_close_matches(key, sorted(ours | options.names), 1, 0.5)
                hint = f"; {matches[0]}?" if matches else ""
                expected = f"a key of armd or of python-can's {self.interface}{hint}"
                raise _wrong(key, "an unknown key", expected)
            if expected := options.expected(key, extra[key]):
                raise _wrong(key, repr(extra[key]), expected)
        named = set() if self.channel is None else {"channel"}
        for key in sorted(options.required - set(extra) - named):
            raise _wrong(key, "nothing", f"this key, which python-can's {self.interface} needs")
        return self


def _wrong(key: str, actual: str, expected: str) -> PydanticCustomError:
    """Return the error of *key*; see `armd.files.schema.KEY_FAULT`."""
    return PydanticCustomError(
        KEY_FAULT, "{found}", {"key": key, "found": actual, "expected": expected}
    )


ServoId = Annotated[int, Field(ge=0, le=252)]


class Trigger(Strict):
    """A servo that serves as button 0: pressed while its raw position (0…4095) is below a limit."""

    id: ServoId
    pressed_below: Annotated[int, Field(ge=1, le=4095)]


class ServoConfig(Strict):
    kind: Literal["feetech", "dynamixel", "dynamixel1"]
    port: Printable  # a stable name: /dev/serial/by-id/…
    baud: int = 1_000_000
    ids: Annotated[list[ServoId], Field(min_length=3, max_length=9)]  # joint k is ids[k-1]
    rate_hz: RateHz | None = None  # the highest rate; None: what the line allows
    temperature_ids: list[ServoId] | None = None  # the servos of the sensors; None: ids
    trigger: Trigger | None = None
    adapter_serial: Printable | None = None  # serial number of the USB adapter
    # Only these two keys cause writes to a servo, at each connection:
    torque_off: bool = False
    return_delay_us: Annotated[int, AfterValidator(_return_delay)] | None = None
    #: accept changed homing offsets and exchanged servos without `armd accept`
    accept_changed_offsets: bool = False
    max_joint_rate_deg_s: JointRate = MAX_JOINT_RATE_DEG_S

    @field_validator("ids")
    @classmethod
    def _once_each(cls, ids: list[int]) -> list[int]:
        if len(set(ids)) != len(ids):
            raise ValueError("each id once")
        return ids

    @model_validator(mode="after")
    def _servos_have_such_a_rate(self) -> Self:
        bauds = BAUDS[self.kind]
        if self.baud not in bauds:
            raise _wrong("baud", str(self.baud), f"a rate of {self.kind} servos: {_listed(bauds)}")
        return self


def _listed(bauds: tuple[int, ...]) -> str:
    return ", ".join(map(str, sorted(bauds)))


def _microscribe_baud(baud: int) -> int:
    if baud not in microscribe.BAUDS:
        raise ValueError(f"a rate of the arm: {_listed(microscribe.BAUDS)}")
    return baud


class MicroScribeConfig(Strict):
    kind: Literal["microscribe"]
    port: Printable
    baud: Annotated[int, AfterValidator(_microscribe_baud)] | None = None  # None: found by trial
    stream: bool = True  # False: request each reading, as from an arm that cannot stream
    max_joint_rate_deg_s: JointRate = MAX_JOINT_RATE_DEG_S


def _speed(speed: float) -> float:
    if speed != 0 and not 0.001 <= speed <= 1000:
        raise ValueError("0, or 0.001 to 1000")
    return speed


class ReplayConfig(Strict):
    kind: Literal["replay"]
    file: Printable  # MCAP, relative to armd.toml
    speed: Annotated[float, AfterValidator(_speed)] = 1.0  # 0: as fast as possible


DriverConfig = Annotated[
    SerialConfig | CanConfig | ServoConfig | MicroScribeConfig | ReplayConfig,
    Field(discriminator="kind"),
]
