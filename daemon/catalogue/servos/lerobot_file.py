"""LeRobot's calibration files: the motors of one arm, and its normalised positions.

LeRobot keeps one JSON file per robot. It maps a motor's name to id, drive mode, homing offset, and
the smallest and the greatest raw position to which a person has swept the joint, offset included.
"""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, RootModel

from armd.compensation.data.foreign.words import find_joint_name
from armd.errors import BadInput
from armd.files.inputs import MOST_JSON_BYTES, read_input
from armd.files.schema import Strict, load_json_data, validate
from armd.terminal.suggest import format_names

COUNTS = 4096
DEG_PER_COUNT = 360 / COUNTS
MIDDLE = 2048  # the raw position that armd counts as 0
TOOLS = ("gripper", "trigger")  # motors that are not joints of the chain
WHEELS = "base_"  # LeKiwi's wheels, under its arm
SHADOW = "_shadow"  # the second of a joint's two servos: only the first is read
#: LeRobot's names of the joints of SO-100, SO-101, Koch and OMX, base to wrist.
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
#: LeRobot's names of the joints of ViperX and WidowX.
OTHER_JOINTS = (
    "waist", "shoulder", "elbow", "forearm_roll", "wrist_angle", "wrist_rotate",
)  # fmt: skip


class Motor(Strict):
    model_config = ConfigDict(extra="ignore", frozen=True)

    id: Annotated[int, Field(ge=0, le=252)]
    drive_mode: Literal[0, 1]
    homing_offset: int
    range_min: Annotated[int, Field(ge=-(1 << 20), le=1 << 20)]
    range_max: Annotated[int, Field(ge=-(1 << 20), le=1 << 20)]

    @property
    def sweep_deg(self) -> float:
        """The angle from the least to the greatest position of the sweep."""
        return (self.range_max - self.range_min) * DEG_PER_COUNT


class CalibrationFile(RootModel[dict[str, Motor]]):
    model_config = ConfigDict(frozen=True)


class Normalised:
    """Converts LeRobot's -100 to 100 of a joint's sweep to the servo's positions."""

    def __init__(self, path: Path, headers: dict[str, str], prefix: str | None = None) -> None:
        """Find the motor of each column.

        *headers* maps q1 to the column of a log, whose name contains the motor's. *prefix* is that
        of the arm's motors, where the calibration has several arms. Raises `BadInput` for a joint
        that the calibration does not have.
        """
        motors = read_motors(path)
        if prefix is not None and any(key.startswith(prefix.rstrip("_")) for key in motors):
            motors = select_motors(path, motors, prefix)
        self._motors = {}
        for name, header in headers.items():
            exact = [m for key, m in motors.items() if _is_same_name(key, header)]
            alike = [
                m for key, m in motors.items() if find_joint_name(key) == find_joint_name(header)
            ]
            if len(exact or alike) != 1:
                raise BadInput(
                    path, f"the motor of {header!r}", format_names(motors), "one of its name"
                )
            self._motors[name] = (exact or alike)[0]

    def count(self, name: str, value: float) -> float:
        """Return the position from raw 2048, as the servo counts.

        LeRobot negates the value of a reversed motor.
        """
        motor = self._motors[name]
        turned = -value if motor.drive_mode == 1 else value
        sweep = motor.range_max - motor.range_min
        return motor.range_min + (turned + 100.0) / 200.0 * sweep - MIDDLE

    def degrees(self, name: str, value: float) -> float:
        """Return the angle from the middle of the sweep, with LeRobot's sign."""
        return value / 200.0 * self._motors[name].sweep_deg


def _is_same_name(key: str, header: str) -> bool:
    """Return whether the log's column *header* is exactly the motor *key*'s."""
    return re.fullmatch(rf"(?:observation\.state\.)?{re.escape(key)}(?:\.pos)?", header) is not None


def read_motors(path: Path) -> dict[str, Motor]:
    """Return every motor of a calibration; raises `BadInput`.

    The message names the other program whose file it is, if it is known.
    """
    data = load_json_data(path, read_input(path, MOST_JSON_BYTES))
    if isinstance(data, dict) and isinstance(data.get("homing_offset"), list):
        problem = "LeRobot's format of before June 2025, whose zero is another"
        raise BadInput(path, "the file", problem, "a calibration made anew by LeRobot of today")
    if isinstance(data, dict) and any(str(key).startswith("servos_") for key in data):
        problem = "phosphobot's calibration"
        raise BadInput(
            path,
            "the file",
            problem,
            "LeRobot's: calibrate the arm with lerobot-calibrate; `armd import` takes this one as"
            " --servo-zeros",
        )
    if not isinstance(data, dict) or not any(_is_motor(value) for value in data.values()):
        expected = "a LeRobot calibration: motors, each with id, range_min, range_max, …"
        raise BadInput(path, "the file", "another kind of JSON", expected)
    return validate(path, data, CalibrationFile).root


def _is_motor(value: Any) -> bool:
    return isinstance(value, dict) and bool(
        {"range_min", "range_max", "homing_offset"} & set(value)
    )


def select_motors(path: Path, motors: dict[str, Motor], prefix: str | None) -> dict[str, Motor]:
    """Return the motors of one arm, without wheels, heads, second servos and other arms.

    They are recognised by names that only joints and tools have. Raises `BadInput` where *prefix*
    does not name one arm, or where there are several and no *prefix*.
    """
    motors = {
        key: motor
        for key, motor in motors.items()
        if not key.endswith(SHADOW) and not key.startswith(WHEELS)
    }
    arms: dict[str, dict[str, Motor]] = defaultdict(dict)
    for key, motor in motors.items():
        for name in sorted((*JOINTS, *OTHER_JOINTS, *TOOLS), key=len, reverse=True):
            if key == name or key.endswith(f"_{name}"):
                arms[key.removesuffix(name)][name] = motor
                break
    arms = {begin: arm for begin, arm in arms.items() if not set(arm) <= set(TOOLS)}
    begins = sorted(arms)
    if prefix is not None:
        begins = [begin for begin in begins if begin.rstrip("_") == prefix.rstrip("_")]
        if len(begins) != 1:
            raise BadInput(path, "--prefix", repr(prefix), f"one of {format_names(sorted(arms))}")
    if len(begins) > 1:
        problem = f"those of {len(begins)} arms ({format_names(begins)})"
        expected = f"one arm: {' or '.join(f'--prefix {begin}' for begin in begins)}"
        raise BadInput(path, "the motors", problem, expected)
    return arms[begins[0]] if begins and (begins[0] or prefix is not None) else motors


def order_base_to_wrist(motors: dict[str, Motor]) -> dict[str, Motor]:
    """Order motors by their joints' names, or by ids where the names are unknown.

    Names come first, because people give their servos any ids.
    """
    for joints in (JOINTS, OTHER_JOINTS):
        if set(motors) - set(TOOLS) <= set(joints):
            return {key: motors[key] for key in (*joints, *TOOLS) if key in motors}
    return dict(sorted(motors.items(), key=lambda motor: motor[1].id))
