"""What an arm.toml must not say, in words that name the place."""

from __future__ import annotations

from pathlib import Path

import pytest

from armd.compensation.model.arm import load_arm
from armd.errors import BadInput

THREE_JOINTS = """schema = "armd.arm/1"
serial_number = "S"
[[temperature_sensor]]
name = "{sensor}"
[[joint]]
a_mm = 100.0
temperature = {temperature}
[[joint]]
a_mm = 100.0
[[joint]]
a_mm = 100.0
"""


def arm_file(folder: Path, sensor: str, temperature: str) -> Path:
    path = folder / "arm.toml"
    path.write_text(THREE_JOINTS.format(sensor=sensor, temperature=temperature))
    return path


@pytest.mark.parametrize("name", ["q1", "w3", "time_s", "target", "artefact_c", "x_mm"])
def test_a_sensor_is_no_other_column(tmp_path: Path, name: str) -> None:
    """Otherwise the joint's angle would be read as its temperature."""
    with pytest.raises(BadInput, match=f"not '{name}'"):
        load_arm(arm_file(tmp_path, name, f'"{name}"'))


@pytest.mark.parametrize("weight", [0.7, 100.0, -1.0])
def test_weights_make_a_mean(tmp_path: Path, weight: float) -> None:
    """A joint all of whose sensors are at 20 °C is at 20 °C."""
    with pytest.raises(BadInput, match=r"joint\[1\].temperature with weights that sum to 1"):
        load_arm(arm_file(tmp_path, "t1", f"{{ t1 = {weight} }}"))


def test_other_names_and_rounded_weights_are_taken(tmp_path: Path) -> None:
    arm = load_arm(arm_file(tmp_path, "q 1", '{ "q 1" = 0.99 }'))
    assert arm.used_sensors == ["q 1"]
