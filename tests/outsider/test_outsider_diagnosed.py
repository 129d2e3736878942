"""Some cases of the outsider's generator, through the commands from files to verdict."""

from __future__ import annotations

from pathlib import Path

import pytest
from outsider.run import diagnosed

from support.known_regression import known_regression


@pytest.mark.slow
def test_nothing_wrong_is_told_as_nothing(tmp_path: Path) -> None:
    outcome = diagnosed("clean", 0, tmp_path)
    assert outcome.verdict == "right"
    assert outcome.before_um < 1.1 * outcome.truth.noise_um


@pytest.mark.slow
def test_a_disc_is_named_and_corrected(tmp_path: Path) -> None:
    outcome = diagnosed("disc", 0, tmp_path)
    assert outcome.verdict == "right"
    assert outcome.after_um < 0.7 * outcome.before_um
    assert outcome.after_um < 1.1 * outcome.truth.noise_um


def test_targets_counted_backwards_are_told_by_their_placement(tmp_path: Path) -> None:
    """Under such sessions seven causes were told, and the extended model erred by 132 µm of 13."""
    outcome = diagnosed("numbered", 60127001, tmp_path)
    assert (outcome.verdict, outcome.said) == ("right", "refused")


@pytest.mark.slow
def test_a_probe_that_one_operator_presses_is_a_tip_that_stands_otherwise(tmp_path: Path) -> None:
    """In one session of five, by 19 µm. It was told, surely, as an unknown structure in time and a
    temperature, and what comes after was predicted worse with it (10.09 → 10.50 µm)."""
    outcome = diagnosed("pressed", 60127000, tmp_path)
    assert outcome.verdict == "right"
    assert "tip_offset tip in time_s" in outcome.said
    assert outcome.after_um < 0.95 * outcome.before_um


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "seed", "named"),
    [
        pytest.param(
            "one_joint",
            271201007,
            ["joint_thermal joint 5", "encoder_slip joint 5 in time_s"],
            marks=known_regression("the place is right, a name is not"),
        ),
        ("crowd", 271201008, ["joint_thermal joint 2", "geometry_shift joint 2 in time_s"]),
    ],
)
def test_two_causes_in_time_are_not_a_value_for_each_session(
    kind: str, seed: int, named: list[str], tmp_path: Path
) -> None:
    """A zero that is another in each session fitted as well, and foretold nothing: 15.03 → 14.22
    and 5.81 → 6.00 µm on the further session."""
    outcome = diagnosed(kind, seed, tmp_path)
    assert outcome.verdict == "right"
    assert all(name in outcome.said for name in named)
    assert outcome.after_um < 1.1 * outcome.truth.noise_um
