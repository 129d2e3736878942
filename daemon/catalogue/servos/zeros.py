"""Convert angles of other programs to servo counts: phosphobot's and GELLO's files.

phosphobot: (raw − servos_offsets)·servos_offsets_signs·2π/4095, as in `hardware/base.py` of
phospho-app/phosphobot (commit 0b4af25). GELLO: (raw·π/2048 − joint_offsets)·joint_signs, as in
`gello/robots/dynamixel.py` of wuphilipp/gello_software and in its driver (commits 18cc23a,
2888885). Both count 4096 a turn and list joints from base to wrist, the gripper last.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from armd.errors import BadInput
from armd.files.inputs import read_input
from armd.files.schema import load_json_data

COUNTS, MIDDLE = 4096, 2048
GELLO_SUFFIXES = (".yaml", ".yml")
#: phosphobot's arms with servos of 4096 counts a turn; its other arms report no counts.
PHOSPHOBOTS = ("so-100", "koch-v1.1", "wx-250s")
#: Limit of a count: more than any multi-turn servo reaches.
MOST_COUNTS = 1 << 20
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


@dataclass(frozen=True)
class ServoZeros:
    """The zero and sign of each joint, base to wrist.

    The formula is count = offset + sign · angle · counts per rad.
    """

    program: str
    offsets: Sequence[float]  # raw counts at angle 0
    signs: Sequence[int]
    counts_per_rad: float

    def counts(self, joint: int, angles_rad: Sequence[float]) -> list[float]:
        """Return the counts of *joint* (from 0), relative to the middle of a turn.

        Whole turns are subtracted so that the first finite count lies within one turn.
        """
        scale = self.signs[joint] * self.counts_per_rad
        counts = [self.offsets[joint] + scale * angle - MIDDLE for angle in angles_rad]
        reference = next((count for count in counts if math.isfinite(count)), 0.0)
        turns = math.floor((reference + MIDDLE) / COUNTS)
        return [count - COUNTS * turns for count in counts]


def read_servo_zeros(path: Path, n_joints: int) -> ServoZeros:
    """Read the zeros of at least *n_joints* joints from a file; raises `BadInput`."""
    content = read_input(path)
    if path.suffix.lower() in GELLO_SUFFIXES:
        zeros = _read_gello(path, content)
    else:
        zeros = _read_phosphobot(path, load_json_data(path, content))
    if len(zeros.offsets) < n_joints:
        problem = f"{len(zeros.offsets)} joints"
        raise BadInput(path, "the offsets", problem, f"{n_joints}, as the arm has")
    return zeros


def _read_phosphobot(path: Path, data: Any) -> ServoZeros:
    if not isinstance(data, dict) or "servos_offsets" not in data:
        expected = "phosphobot's calibration (servos_offsets, …), or GELLO's configuration, a .yaml"
        raise BadInput(path, "the file", "another kind of JSON", expected)
    if data.get("name") not in PHOSPHOBOTS:
        expected = f"an arm of servos: {', '.join(PHOSPHOBOTS)}"
        raise BadInput(path, "name", repr(data.get("name"))[:60], expected)
    offsets = _require_numbers(path, "servos_offsets", data["servos_offsets"])
    signs = _signs(path, "servos_offsets_signs", data.get("servos_offsets_signs"), len(offsets))
    return ServoZeros("phosphobot", _require_within(path, "servos_offsets", offsets), signs,
                      (COUNTS - 1) / math.tau)  # fmt: skip


def _read_gello(path: Path, content: bytes) -> ServoZeros:
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise BadInput(path, "the file", "bytes that are no UTF-8", "GELLO's .yaml") from error
    offsets = _require_numbers(path, "joint_offsets", _parse_list(path, text, "joint_offsets"))
    signs = _parse_list(path, text, "joint_signs")
    raw = [offset * COUNTS / math.tau for offset in offsets]
    return ServoZeros("GELLO", _require_within(path, "joint_offsets", raw),
                      _signs(path, "joint_signs", signs, len(raw)), COUNTS / math.tau)  # fmt: skip


def _parse_list(path: Path, text: str, key: str) -> list[str]:
    """Return the words of a YAML list, in brackets or one a line.

    No other part of YAML is needed here.
    """
    lines = [line.split(" #")[0].rstrip() for line in text.splitlines()]
    key_lines = [i for i, line in enumerate(lines) if re.match(rf"\s*{key}\s*:", line)]
    if len(key_lines) != 1:
        problem = "nothing" if not key_lines else f"it {len(key_lines)} times"
        expected = "one list of numbers, as in the configurations that GELLO writes"
        raise BadInput(path, key, problem, expected)
    value_text = "\n".join(lines[key_lines[0] :]).split(":", 1)[1].lstrip(" ")
    if value_text.startswith("["):
        inner, end, _ = value_text[1:].partition("]")
        if not end:
            raise BadInput(path, key, "a list without its end", "]")
        return [word.strip() for word in inner.split(",") if word.strip()]
    words = []
    for line in value_text.splitlines()[1:]:
        if line.strip() and not line.lstrip().startswith("-"):
            break
        words += [line.strip()[1:].strip()] if line.strip() else []
    return words


def _require_numbers(path: Path, key: str, values: Any) -> list[float]:
    if not isinstance(values, list) or not values:
        raise BadInput(path, key, repr(values)[:60], "a list of numbers")
    numbers = []
    for k, value in enumerate(values):
        is_text = isinstance(value, str) and NUMBER.fullmatch(value) is not None
        if not is_text and (isinstance(value, bool) or not isinstance(value, int | float)):
            raise BadInput(path, f"{key}[{k}]", repr(value)[:60], "a number")
        try:
            numbers.append(float(value))
        except OverflowError as error:
            raise BadInput(path, f"{key}[{k}]", "an endless number", "a number") from error
    return numbers


def _require_within(path: Path, key: str, raw: list[float]) -> list[float]:
    for k, count in enumerate(raw):
        if not abs(count) <= MOST_COUNTS:
            problem = f"{count:g} counts"
            raise BadInput(path, f"{key}[{k}]", problem, f"{-MOST_COUNTS} to {MOST_COUNTS}")
    return raw


def _signs(path: Path, key: str, values: Any, n: int) -> list[int]:
    signs = _require_numbers(path, key, values)
    if len(signs) != n:
        raise BadInput(path, key, f"{len(signs)} signs", f"{n}, one for each offset")
    for k, sign in enumerate(signs):
        if abs(sign) != 1.0:
            raise BadInput(path, f"{key}[{k}]", f"{sign:g}", "1 or -1")
    return [round(sign) for sign in signs]
