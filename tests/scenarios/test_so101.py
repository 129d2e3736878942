"""`make so101`: nominal, calibrated, diagnosed, verified."""

from pathlib import Path

import pytest
import so101


@pytest.mark.slow
def test_each_step_helps_on_readings_that_took_no_part(tmp_path: Path) -> None:
    figures = so101.run(tmp_path, 1)
    assert figures["calibrated"] < figures["nominal"] / 2
    assert figures["diagnosed"] < figures["calibrated"]
    assert figures["passed"]
