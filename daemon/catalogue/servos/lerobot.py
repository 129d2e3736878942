"""Import a LeRobot calibration: ids, homing offsets, ranges of travel.

LeRobot's zero is the middle of a joint's sweep. Its degrees are 360/4095 of a count where a count
is 360/4096. The middle of a sweep that is not the joint's travel is not a zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from armd.compensation.model.arm import Joint
from armd.daemon.catalogue.known_arms import (
    KNOWN,
    Bus,
    find_spelling,
    load_known_arm,
    read_arm_text,
    set_joint,
)
from armd.daemon.catalogue.servos.lerobot_file import (
    COUNTS,
    DEG_PER_COUNT,
    MIDDLE,
    TOOLS,
    Motor,
    order_base_to_wrist,
    read_motors,
    select_motors,
)
from armd.errors import BadInput
from armd.terminal.suggest import format_names

#: Largest homing offset and its register, by kind: a Feetech's register 31 has eleven bits and a
#: sign; the limit of a Dynamixel's register 20 is the e-Manual's.
MOST_OFFSET = {"feetech": (2047, 31), "dynamixel": (1_044_479, 20)}
#: A joint that was not swept has an arbitrary zero. The least travel of a known servo arm is
#: 124° (Koch); a tenth of that is not a sweep.
LEAST_SWEEP_COUNTS = 141
#: A sweep of less than this share of the nominal travel was stopped early: its middle, LeRobot's
#: zero, is off by an eighth of the travel or more.
LEAST_SHARE = 0.75
#: A sweep outside of these shares gets a remark: whole arms have 0.97 to 1.12 of the nominal one.
USUAL_SHARES = (0.92, 1.25)
#: A joint with stops that was swept across the encoder's seam seems to have a whole turn, because
#: LeRobot keeps the least and the greatest raw position. More travel means hardly any stops.
SEAM_DEG, STOPS_DEG = 330.0, 300.0


@dataclass(frozen=True)
class TakenOver:
    """The imported calibration."""

    text: str  # arm.toml
    bus: Bus
    motors: dict[str, Motor]  # in the order of the joints
    remarks: list[str] = field(default_factory=list)


def take_over(
    path: Path, name: str, prefix: str | None = None, short: Sequence[str] = ()
) -> TakenOver:
    """Return the known arm *name* with the zeros, limits and ids of the calibration at *path*.

    *prefix* is that of the arm's motors, where the file has several arms. *short* lists joints that
    turn less than the drawing states. Raises `BadInput` for a file that is not LeRobot's or is
    another arm's.
    """
    arm, bus = load_known_arm(name), _choose_bus(name)
    motors = order_base_to_wrist(select_motors(path, read_motors(path), prefix))
    chain = {key: motor for key, motor in motors.items() if key not in TOOLS}
    _check(path, motors, chain, arm.n_joints, name)
    _check_offsets(path, motors, bus.kind)
    chain = {key: _move_within_turn(path, key, motor, bus.kind) for key, motor in chain.items()}
    remarks = _check_sweeps(path, chain, arm.joint, short)
    text = read_arm_text(name)
    for k, (motor, joint) in enumerate(zip(chain.values(), arm.joint, strict=True), 1):
        # A Dynamixel reverses its count itself; LeRobot does it for a Feetech.
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
        text = set_joint(text, k, values)
    offsets = ", ".join(f"{motor.id}: {motor.homing_offset}" for motor in motors.values())
    note = (
        "# Zeros, limits and directions are of the LeRobot calibration "
        f"{_to_comment(path.name)},\n"
        "# whose zero (the middle of the sweep) is assumed to be the drawing's. It holds while\n"
        f"# the servos have these homing offsets: {offsets}.\n"
    )
    ids = [motor.id for motor in chain.values()]
    return TakenOver(
        note.join(_split_heading(text)), _with_ids(bus, ids, motors, chain), motors, remarks
    )


def _to_comment(text: str) -> str:
    return "".join(letter if letter.isprintable() else "?" for letter in text)


def _choose_bus(name: str) -> Bus:
    bus = KNOWN[find_spelling(name)]
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


def _move_within_turn(path: Path, key: str, motor: Motor, kind: str) -> Motor:
    """Return the motor with the middle of its range within one encoder turn.

    A Dynamixel counts on beyond that turn. Raises `BadInput` for a range outside a Feetech's turn.
    """
    if (motor.range_min, motor.range_max) == (0, COUNTS):  # a whole turn, as some programs write it
        return motor.model_copy(update={"range_max": COUNTS - 1})
    if kind == "feetech":
        if motor.range_min < 0:
            expected = "0 or more, which a Feetech servo counts: calibrate it anew with LeRobot"
            raise BadInput(path, f"{key}.range_min", str(motor.range_min), expected)
        if motor.range_max >= COUNTS:
            problem = str(motor.range_max)
            raise BadInput(path, f"{key}.range_max", problem, f"less than {COUNTS}")
        return motor
    turns = (motor.range_min + motor.range_max) // 2 // COUNTS
    low, high = (end - turns * COUNTS for end in (motor.range_min, motor.range_max))
    return motor.model_copy(update={"range_min": low, "range_max": high})


def _check_sweeps(
    path: Path, chain: dict[str, Motor], joints: Sequence[Joint], short: Sequence[str]
) -> list[str]:
    """Compare sweeps with the nominal travel, and return remarks.

    Raises `BadInput` for a sweep whose middle cannot be the zero.
    """
    remarks = []
    for key in short:
        if key not in chain:
            raise BadInput(path, "--short-sweep", repr(key), f"one of {format_names(chain)}")
    for (key, motor), joint in zip(chain.items(), joints, strict=True):
        location = f"{key}.range_min … range_max"
        swept = f"a sweep of {motor.sweep_deg:.0f}° ({motor.range_min} … {motor.range_max})"
        sweep = motor.range_max - motor.range_min
        if sweep < LEAST_SWEEP_COUNTS:
            expected = f"a sweep of {LEAST_SWEEP_COUNTS} or more, from stop to stop"
            raise BadInput(path, f"{key}.range_max - {key}.range_min", f"{sweep} counts", expected)
        travel = _get_travel_deg(joint)
        if travel is None:
            continue
        if motor.sweep_deg > SEAM_DEG and travel < STOPS_DEG:
            expected = (
                f"{travel:.0f}°, its travel: it was swept across the encoder's seam; move it to the"
                " middle of its travel when LeRobot asks for that, and calibrate anew"
            )
            raise BadInput(path, location, swept, expected)
        share = motor.sweep_deg / travel
        if share < LEAST_SHARE and key not in short:
            expected = (
                f"{travel:.0f}°, its travel: calibrate anew with LeRobot from stop to stop, or say"
                f" --short-sweep {key} if this joint of yours turns no farther"
            )
            raise BadInput(path, location, swept, expected)
        if not USUAL_SHARES[0] <= share <= USUAL_SHARES[1]:
            remarks.append(
                f"{key}: {swept}, and the drawing's travel is {travel:.0f}°;"
                " the middle of the sweep is taken as the drawing's zero"
            )
    return remarks


def _get_travel_deg(joint: Joint) -> float | None:
    """Return the nominal travel between the stops; None for a joint without stops."""
    if joint.min_deg is None or joint.max_deg is None:
        return None
    travel = joint.max_deg - joint.min_deg
    return None if travel > 350.0 else travel


def _check_offsets(path: Path, motors: dict[str, Motor], kind: str) -> None:
    limit, register = MOST_OFFSET[kind]
    for key, motor in motors.items():
        if abs(motor.homing_offset) > limit:
            expected = f"-{limit} to {limit}, which a {kind} servo can hold (register {register})"
            raise BadInput(path, f"{key}.homing_offset", str(motor.homing_offset), expected)


def _split_heading(text: str) -> tuple[str, str]:
    """Split a text at its first empty line, which ends the heading of comments."""
    head, blank, body = text.partition("\n\n")
    return head + "\n", blank[1:] + body


def _with_ids(bus: Bus, ids: list[int], motors: dict[str, Motor], chain: dict[str, Motor]) -> Bus:
    """Return the bus with the calibration's ids.

    Each link has the temperature of the next motor, tools included.
    """
    tools = [motor.id for key, motor in motors.items() if key not in chain]
    if tuple(ids) == bus.ids and tools[:1] == [bus.temperature_ids[-1]]:
        return bus
    return replace(bus, ids=tuple(ids), temperature_ids=(*ids[1:], (tools or ids[-1:])[0]))
