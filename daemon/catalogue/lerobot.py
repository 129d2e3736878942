"""A LeRobot calibration taken over: ids, homing offsets, ranges of travel.

LeRobot keeps one JSON per arm: name of a motor → id, drive mode, homing offset, and the smallest
and the greatest raw position to which a hand has swept the joint, offset included. Its zero is
the middle of that sweep, and its degrees are 360/4095 of a count where a count is 360/4096.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

from pydantic import ConfigDict, Field, RootModel

from armd.daemon.catalogue.known import (
    KNOWN,
    Bus,
    arm_text,
    canonical,
    known_arm,
    with_joint,
)
from armd.errors import BadInput
from armd.files.schema import Strict, load_json

Raw = Annotated[int, Field(ge=0, le=4095)]
DEG_PER_COUNT = 360 / 4096
MIDDLE = 2048  # the raw position that armd counts as 0
#: What a homing offset may be, by kind: eleven bits beside the sign in a Feetech's register 31, and
#: what the e-Manual says of a Dynamixel's register 20.
MOST_OFFSET = {"feetech": (2047, 31), "dynamixel": (1_044_479, 20)}
#: A joint that nobody has swept has its zero anywhere. The least travel of a known servo arm is
#: 124° (Koch); a tenth of that is no sweep.
LEAST_SWEEP_COUNTS = 141
TOOLS = ("gripper", "trigger")  # motors that are no joint of the chain
#: LeKiwi's names: the arm's motors, and those of the wheels under it.
ON_WHEELS, WHEELS = "arm_", "base_"
SHADOW = "_shadow"  # the second servo of a joint that has two: the first one is read
#: LeRobot's names of an SO-100's, SO-101's, Koch's and OMX's joints, base to wrist.
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")


class Motor(Strict):
    id: Annotated[int, Field(ge=0, le=252)]
    drive_mode: Literal[0, 1]
    homing_offset: int
    range_min: Raw
    range_max: Raw


class CalibrationFile(RootModel[dict[str, Motor]]):
    model_config = ConfigDict(frozen=True)


@dataclass(frozen=True)
class TakenOver:
    """What became of the calibration."""

    text: str  # arm.toml
    bus: Bus
    motors: dict[str, Motor]  # in the order of the joints


def take_over(path: Path, name: str) -> TakenOver:
    """The known arm *name* with the zeros, limits and ids of the calibration at *path*.

    Raises `BadInput` for a file that is not LeRobot's or that is another arm's.
    """
    arm, bus = known_arm(name), _bus(name)
    motors = _base_to_wrist(_of_the_arm(load_json(path, CalibrationFile).root))
    chain = {key: motor for key, motor in motors.items() if key not in TOOLS}
    _check(path, motors, chain, arm.n_joints, name)
    _check_offsets(path, motors, bus.kind)
    text = arm_text(name)
    for k, (motor, joint) in enumerate(zip(chain.values(), arm.joint, strict=True), 1):
        # A Dynamixel turns its count round itself; LeRobot does it for a Feetech.
        turned = motor.drive_mode == 1 and bus.kind == "feetech"
        direction = -joint.direction if turned else joint.direction
        ends = [
            direction * (raw - MIDDLE) * DEG_PER_COUNT for raw in (motor.range_min, motor.range_max)
        ]
        values: dict[str, float | int] = {
            "theta_deg": joint.theta_deg - sum(ends) / 2,
            "direction": direction,
            "min_deg": round(min(ends), 3),
            "max_deg": round(max(ends), 3),
        }
        text = with_joint(text, k, values)
    offsets = ", ".join(f"{motor.id}: {motor.homing_offset}" for motor in motors.values())
    note = (
        f"# Zeros, limits and directions are of the LeRobot calibration {path.name}, whose zero\n"
        "# (the middle of the sweep) is assumed to be the drawing's. It holds while the servos\n"
        f"# have these homing offsets: {offsets}.\n"
    )
    ids = [motor.id for motor in chain.values()]
    return TakenOver(note.join(_parted(text)), _with_ids(bus, ids, motors, chain), motors)


def _of_the_arm(motors: dict[str, Motor]) -> dict[str, Motor]:
    """Without wheels and second servos, by the names that a joint has where there are none."""
    return {
        key.removeprefix(ON_WHEELS): motor
        for key, motor in motors.items()
        if not key.startswith(WHEELS) and not key.endswith(SHADOW)
    }


def _base_to_wrist(motors: dict[str, Motor]) -> dict[str, Motor]:
    """By the joints' names, whatever ids somebody gave their servos; where names are others, ids
    have to do."""
    if not set(motors) - set(TOOLS) <= set(JOINTS):
        return dict(sorted(motors.items(), key=lambda motor: motor[1].id))
    return {key: motors[key] for key in (*JOINTS, *TOOLS) if key in motors}


def _bus(name: str) -> Bus:
    bus = KNOWN[canonical(name)]
    if bus is None:
        raise BadInput("armd arm", "--arm", repr(name), "an arm with servos on a serial line")
    return bus


def _check(
    path: Path, motors: dict[str, Motor], chain: dict[str, Motor], n_joints: int, name: str
) -> None:
    if len(chain) != n_joints:
        expected = f"{n_joints}, as {name} has (and a gripper)"
        raise BadInput(path, "motors of joints", f"{len(chain)} ({', '.join(chain)})", expected)
    if len({motor.id for motor in motors.values()}) < len(motors):
        ids = ", ".join(str(motor.id) for motor in motors.values())
        raise BadInput(path, "id", ids, "ids that differ from each other")
    for key, motor in motors.items():
        if motor.range_min >= motor.range_max:
            expected = f"less than range_max, {motor.range_max}"
            raise BadInput(path, f"{key}.range_min", str(motor.range_min), expected)
    for key, motor in chain.items():
        sweep = motor.range_max - motor.range_min
        if sweep < LEAST_SWEEP_COUNTS:
            expected = f"a sweep of {LEAST_SWEEP_COUNTS} or more, from stop to stop"
            raise BadInput(path, f"{key}.range_max - {key}.range_min", f"{sweep} counts", expected)


def _check_offsets(path: Path, motors: dict[str, Motor], kind: str) -> None:
    most, register = MOST_OFFSET[kind]
    for key, motor in motors.items():
        if abs(motor.homing_offset) > most:
            expected = f"-{most} to {most}, which a {kind} servo can hold (register {register})"
            raise BadInput(path, f"{key}.homing_offset", str(motor.homing_offset), expected)


def _parted(text: str) -> tuple[str, str]:
    """Before and after the first line that is no comment."""
    head, blank, rest = text.partition("\n\n")
    return head + "\n", blank[1:] + rest


def _with_ids(bus: Bus, ids: list[int], motors: dict[str, Motor], chain: dict[str, Motor]) -> Bus:
    """The bus with the calibration's ids: link k is as warm as the next motor, tools included."""
    tools = [motor.id for key, motor in motors.items() if key not in chain]
    if tuple(ids) == bus.ids and tools[:1] == [bus.temperature_ids[-1]]:
        return bus
    return replace(bus, ids=tuple(ids), temperature_ids=(*ids[1:], (tools or ids[-1:])[0]))
