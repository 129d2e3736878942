"""The mess of a workshop and a desk, made by the simulator: it is told, and makes no cause."""

from __future__ import annotations

from pathlib import Path

import pytest
from cases import NOISES
from messy import DESIGN, run_mess

from armd.compensation.data.sessions.session import load_session
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.model.arm import load_arm
from armd.simulator.campaigns.hidden import Design
from armd.simulator.hidden import generate_case
from armd.simulator.measured.mess import KINDS
from support.selection import parametrize_default


@parametrize_default(
    ("seed", "design"), [(4404, Design(sessions=4, articulations=3, holdout=1)), (4406, DESIGN)]
)
def test_a_touched_artefact_is_no_step_of_the_arm(seed: int, design: Design) -> None:
    outcome = run_mess("touched", seed, design)
    assert [cause for cause, _, _ in outcome.found] == ["artefact_moved"]
    assert 0.9 < outcome.floor < 1.1


@pytest.mark.slow
def test_a_touched_artefact_is_told_beside_a_cause_that_differs_by_session() -> None:
    """A shift of joint 2, whose fit without the step had taken a part of it, made it a step of the
    base, with 1.00."""
    assert run_mess("touched", 881127130011).right


@pytest.mark.slow
@pytest.mark.parametrize("seed", [31337120002, 510012004])
def test_noise_that_lasts_is_no_drift_and_no_slip(seed: int) -> None:
    """A step of the base, with 0.99, and a slip of joint 1 where nothing was planted."""
    assert run_mess("correlated", seed).found == ()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [30112600, 30112610, 30112623])
def test_tails_that_last_are_no_step_and_no_slip(seed: int, tmp_path: Path) -> None:
    """Three of 40 sets in which noise of t₃, correlated by 0.6, was a slip or a step where either
    rests' own scatter or the noise's memory was not asked."""
    design = Design(sessions=6, articulations=4, holdout=0)
    case = generate_case(tmp_path, seed, [], design, NOISES["tails that last"])
    arm = load_arm(case.arm)
    assert diagnose([load_session(path, arm) for path in case.sessions], arm).findings == ()


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "most"), [(7373150001, 0.6), (7474150005, 1.0)])
def test_a_link_without_a_sensor_keeps_its_expansion(seed: int, most: float) -> None:
    """With its length free in each session nothing told how it expands, and what was written said
    28 µm a kelvin of 40 mm."""
    outcome = run_mess("dead", seed)
    assert outcome.right
    assert outcome.after_um < most * outcome.before_um


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_mess_is_told_and_a_cause_beside_it_named(kind: str) -> None:
    outcome = run_mess(kind, 4407)
    assert outcome.right
    numbered = [heading.partition(". ")[2] for heading in outcome.headings if heading[0].isdigit()]
    assert [one.partition(",")[0] for one in numbered] == [
        cause.replace("_", " ") for cause, _, _ in outcome.found if cause != "outliers"
    ]
    assert not outcome.sure_and_wrong
    assert not outcome.worse
    assert outcome.floor < 1.7  # noise correlated in time counts as wandering, too
