"""The known arms: `NAME.toml` beside this file is the arm.toml, `KNOWN` has the wiring."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files

import numpy as np

from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import compute_pose
from armd.daemon.catalogue.axes import format_point
from armd.errors import BadInput
from armd.files.schema import load_toml
from armd.terminal.suggest import suggest


@dataclass(frozen=True)
class Bus:
    """The `[driver]` section of armd.toml for an arm with its factory settings."""

    kind: str  # "feetech" or "dynamixel"
    baud: int
    ids: tuple[int, ...]  # joint k is servo ids[k-1]
    temperature_ids: tuple[int, ...]  # sensor k of arm.toml is in this servo


#: name → its bus; None where armd has no driver
KNOWN: dict[str, Bus | None] = {
    "so101": Bus("feetech", 1_000_000, (1, 2, 3, 4, 5), (2, 3, 4, 5, 6)),
    "so100": Bus("feetech", 1_000_000, (1, 2, 3, 4, 5), (2, 3, 4, 5, 6)),
    "koch": Bus("dynamixel", 1_000_000, (1, 2, 3, 4, 5), (2, 3, 4, 5, 6)),
    "vx300s": Bus("dynamixel", 1_000_000, (1, 2, 4, 6, 7, 8), (2, 4, 6, 7, 8, 9)),
    "wx250s": Bus("dynamixel", 1_000_000, (1, 2, 4, 6, 7, 8), (2, 4, 6, 7, 8, 9)),
    "omx": Bus("dynamixel", 1_000_000, (11, 12, 13, 14, 15), (12, 13, 14, 15, 16)),
    "omx-leader": Bus("dynamixel", 1_000_000, (1, 2, 3, 4, 5), (2, 3, 4, 5, 6)),
    "gello-yam": Bus("dynamixel", 57_600, (1, 2, 3, 4, 5, 6), (2, 3, 4, 5, 6, 7)),
    "openarm": None,
}


def find_spelling(name: str) -> str:
    """Return the table's spelling of *name*, such as SO-100.

    Raises `BadInput` for an arm that is not in the table.
    """
    key = name.lower().replace("_", "-")
    by_letters = {arm.replace("-", ""): arm for arm in KNOWN}
    key = by_letters.get(key.replace("-", "").replace(" ", ""), key)
    if key not in KNOWN:
        names = [*KNOWN, "microscribe"]
        expected = f"one of {', '.join(names)}{suggest(key, names)}"
        raise BadInput("armd arm", "NAME", repr(name), expected)
    return key


def read_arm_text(name: str) -> str:
    """Return the arm.toml of a known arm as text, with its comments."""
    return (files(__package__) / f"{find_spelling(name)}.toml").read_text(encoding="utf-8")


def load_known_arm(name: str) -> Arm:
    """Return the arm.toml of a known arm, parsed and checked."""
    return load_toml(str(files(__package__) / f"{find_spelling(name)}.toml"), Arm)


def read_title(text: str) -> str:
    """Return the first line of an arm.toml's comment, which names the arm."""
    return text.splitlines()[0].removeprefix("# ").removesuffix(".")


def set_serial_number(text: str, serial_number: str) -> str:
    line = f"serial_number = {_quote(serial_number)}"
    return re.sub(r"(?m)^serial_number = .*$", lambda _: line, text, count=1)


def set_joint(text: str, k: int, values: Mapping[str, float | int]) -> str:
    """Replace keys of joint *k* (from 1) in *text*; a missing key is added."""
    head, *joints = re.split(r"(?m)^(?=\[\[joint\]\]$)", text)
    block, end, others_text = joints[k - 1].partition("\n\n")
    for key, value in values.items():
        line = f"{key} = {value!r}"
        block, n_replaced = re.subn(rf"(?m)^{key} = .*$", lambda _, line=line: line, block)
        block += "" if n_replaced else f"\n{line}"
    joints[k - 1] = block + end + others_text
    return head + "".join(joints)


def write_daemon_text(arm_file: str, bus: Bus, port: str) -> str:
    """Return an armd.toml that runs the arm on *port*."""
    return f"""\
schema = "armd.daemon/1"
arm = {_quote(arm_file)}
# calibration = "calibration.json"     # of armd calibrate; without it points carry flag 7

[driver]
kind = {_quote(bus.kind)}
port = {_quote(port)}
baud = {bus.baud}
ids = {list(bus.ids)}
temperature_ids = {list(bus.temperature_ids)}

[measurement]
trigger = "rest"                       # such an arm has no button: hold the tip still for a second
"""


def _quote(text: str) -> str:
    """Return a TOML string, which is JSON's in UTF-8."""
    return json.dumps(text, ensure_ascii=False)


def describe_geometry(text: str) -> str:
    """Describe the convention of an arm.toml's rows, and its tip at zero angles.

    A person compares this with the arm on the bench.
    """
    arm = Arm.model_validate(tomllib.loads(text))
    tip_mm = compute_pose(np.zeros((1, arm.n_joints)), arm.nominal())[0][0]
    return (
        "rows are in the standard convention, Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta); the tip at"
        f" zero angles: {format_point(tip_mm)} mm in the base frame"
    )
