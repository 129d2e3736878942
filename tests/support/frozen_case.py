"""A frozen case of one encoder's scale, and the finding that is right; code in another process."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from hidden.frozen.case import Cause, Truth, write_truth

SCALE = {
    "cause": "encoder_scale", "location": "joint 3", "probability": 0.99, "depends_on": ["q3"],
}  # fmt: skip


def write_case(folder: Path) -> Path:
    """The folder, made, with its truth."""
    folder.mkdir(parents=True)
    cause = Cause("encoder_scale", "joint 3", 12.0, variables=("q3",))
    write_truth(folder, Truth("single", 1, "encoder_scale joint 3 -6.5", (cause,)))
    return folder


def run_in_another_process(code: str) -> None:
    """What is switched off stays off: run *code* in a process of its own, beside tests/hidden."""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=Path(__file__).parents[1], capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
