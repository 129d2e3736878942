"""An artefact that grows: about its certified origin, or, where nothing is certified of it, about
the middle of its seats, wherever the frame that nobody chose may lie."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armd.compensation.diagnose.problem.linear import Linear, ModelState
from armd.compensation.diagnose.problem.linearise import linearise
from armd.compensation.diagnose.problem.rests import collect_rests
from armd.compensation.effects.effect import ArtefactChange
from armd.compensation.estimate.placements.poses import Poses
from armd.compensation.model.calibration import ArtefactCorrection
from support import synthetic

EXPANSION, SCALE = ArtefactChange("expansion"), ArtefactChange("scale")


def measured(targets: int, *, known: bool) -> Linear:
    """Targets of one artefact, whose temperature is read with noise, in three placements."""
    arm, rng = synthetic.arm(), np.random.default_rng(targets)
    truth = synthetic.disturbed(arm, rng, 0.1)
    one = synthetic.session(arm, truth, rng, targets=targets, known=known, readings=60)
    one = replace(one, artefact_c=rng.normal(24.0, 0.02, one.n))
    model = ModelState(truth, (), 20.0, ArtefactCorrection())
    return linearise(collect_rests([one], arm), model, arm)


def seen_from(linear: Linear, turn: Rotation, shift_mm: np.ndarray) -> Linear:
    """The same where the artefact's frame lies elsewhere in it: no target moves."""
    poses, q = linear.poses, turn.as_matrix()
    return replace(
        linear,
        poses=Poses(
            poses.rotation @ q.T,
            poses.translation_mm - poses.rotation @ q.T @ shift_mm,
            poses.target_mm @ q.T + shift_mm,
        ),
    )


@pytest.mark.parametrize("change", [EXPANSION, SCALE])
@pytest.mark.parametrize("targets", [1, 3])
def test_how_seats_grow_does_not_depend_on_a_frame_that_nobody_chose(
    targets: int, change: ArtefactChange
) -> None:
    linear = measured(targets, known=False)
    elsewhere = seen_from(linear, Rotation.from_rotvec([0.3, -1.0, 2.0]), np.array([900.0, 0, -80]))
    observations = linear.rests.observations
    np.testing.assert_allclose(
        elsewhere.poses.compute_target_points(observations),
        linear.poses.compute_target_points(observations),
        atol=1e-9,
    )
    np.testing.assert_allclose(
        elsewhere.artefact_column(change), linear.artefact_column(change), atol=1e-9
    )


def test_a_single_seat_does_not_move_as_it_grows() -> None:
    """Exactly: a column of rounding would be taken for a direction that something is known of."""
    linear = measured(1, known=False)
    assert not linear.artefact_column(EXPANSION).any()


def test_certified_targets_move_away_from_their_origin_by_a_plain_difference() -> None:
    linear = measured(4, known=True)
    rise, observations = linear.rests.artefact_rise_c, linear.rests.observations
    larger = replace(observations, stretch=observations.stretch + 1e-3 * rise)
    moved = linear.poses.compute_target_points(larger) - linear.poses.compute_target_points(
        observations
    )
    np.testing.assert_allclose(1e-3 * linear.artefact_column(EXPANSION), -moved.ravel(), atol=1e-9)
