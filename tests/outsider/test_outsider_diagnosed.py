"""Two easy cases of the outsider's generator, through the commands from files to verdict."""

from __future__ import annotations

from pathlib import Path

import pytest
from outsider.run import diagnosed


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
