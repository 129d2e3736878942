"""`make so101`: nominal, calibrated, diagnosed, verified."""

from pathlib import Path

import pytest
import so101
import so101_live


@pytest.mark.slow
def test_each_step_helps_on_readings_that_took_no_part(tmp_path: Path) -> None:
    figures = so101.run(tmp_path, 1)
    assert figures["calibrated"] < figures["nominal"] / 2
    assert figures["diagnosed"] < figures["calibrated"]
    assert figures["passed"]


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)  # where the machine is busy, the hand measures again what was refused
def test_the_same_over_the_wire(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fewer readings than `make so101-live`; what a diagnosis adds to so few is left open."""
    monkeypatch.setattr(so101_live, "PLACES", {"calibrate": 4, "check": 2})
    monkeypatch.setattr(so101_live, "ROUNDS", {"calibrate": 3, "check": 2})
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    figures = so101_live.run(tmp_path, 1)
    assert figures["calibrated"] < figures["nominal"] / 2
    assert figures["passed"]


@pytest.mark.parametrize(
    ("figures", "code"),
    [
        ({"nominal": 9.0, "calibrated": 3.0, "diagnosed": 2.0, "passed": 1.0}, 0),
        ({"nominal": 9.0, "calibrated": 9.5, "diagnosed": 2.0, "passed": 1.0}, 1),
        ({"nominal": 9.0, "calibrated": 3.0, "diagnosed": 3.5, "passed": 1.0}, 1),
        ({"nominal": 9.0, "calibrated": 3.0, "diagnosed": 2.0, "passed": 0.0}, 1),
    ],
)
def test_a_step_that_does_not_help_ends_with_1(
    monkeypatch: pytest.MonkeyPatch, figures: dict[str, float], code: int
) -> None:
    monkeypatch.setattr("sys.argv", ["so101"])
    assert so101.main(lambda folder, seed: figures) == code
