"""An artefact of steel whose temperature nobody read, in a room that is not at its reference."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.problem.linear import ModelState
from armd.compensation.diagnose.problem.linearise import linearise
from armd.compensation.diagnose.problem.rests import collect_rests
from armd.compensation.effects.effect import ArtefactChange
from armd.compensation.identify.calibrate import calibrate
from armd.compensation.model.calibration import ArtefactCorrection
from support import synthetic
from support.selection import parametrize_default

ARM = synthetic.arm()
STEEL_PER_K, REFERENCE_C = 11.5e-6, 20.0
WARMTH = ArtefactChange("warmth")


def session(rng: np.random.Generator, number: int, celsius: float, per_k: float) -> Session:
    """Of an ideal arm that does not grow; the certified points stand as far apart as they do at
    the reference."""
    made = synthetic.session(
        ARM, ARM.nominal(), rng, targets=6, placements=2, readings=60, encoder_rad=8e-6,
        temperature_c=celsius, scatter_k=0.05, name=f"session-{number}",
    )  # fmt: skip
    grown = 1.0 + per_k * (celsius - REFERENCE_C)
    targets = [
        target.model_copy(update={"position_mm": (np.array(target.position_mm) / grown).tolist()})
        for target in made.artefact.targets
    ]
    return replace(
        made,
        artefact=made.artefact.model_copy(update={"targets": targets}),
        states=replace(made.states, time_s=made.states.time_s + 7200.0 * number),
    )


def test_it_grows_by_the_arms_temperature_where_its_own_was_not_read() -> None:
    rng = np.random.default_rng(3)
    unread, read = (session(rng, k, 24.0, 0.0) for k in range(2))
    read = replace(read, artefact_c=np.full(read.n, 24.0))
    rests = collect_rests([unread, read], ARM)
    linear = linearise(rests, ModelState(ARM.nominal(), (), 20.0, ArtefactCorrection()), ARM)
    observations = rests.observations
    rise = observations.states.temperature_c.mean(axis=1) - REFERENCE_C
    larger = replace(observations, stretch=observations.stretch + 1e-3 * rise)
    moved = linear.poses.compute_target_points(larger) - linear.poses.compute_target_points(
        observations
    )
    moved[observations.session == 1] = 0.0
    np.testing.assert_allclose(1e-3 * linear.artefact_column(WARMTH), -moved.ravel(), atol=1e-9)


@pytest.mark.slow
@parametrize_default("read", [False, True])
def test_steel_is_told_as_the_artefacts_expansion(read: bool) -> None:
    """Unread, it was the expansion of five links, of three of them surely. The calibration knows
    how the links grow: one made at one temperature could not tell theirs from the artefact's."""
    rng = np.random.default_rng(5)
    made_c = (15.0, 18.0, 22.0, 25.0)
    calibration = calibrate(
        [session(rng, k, c, 0.0) for k, c in enumerate(made_c)], ARM
    ).calibration
    later = [session(rng, 9 + k, c, STEEL_PER_K) for k, c in enumerate((16.0, 19.0, 23.0, 26.0))]
    if read:
        later = [
            replace(s, artefact_c=np.full(s.n, float(s.states.temperature_c.mean()))) for s in later
        ]
    found = diagnose(later, ARM, calibration)
    assert [f.candidate.place for f in found.findings] == [("artefact_expansion", "artefact")]
    assert found.findings[0].probability > 0.95
    (per_k,), ((variance,),) = (
        part[0] for part in (found.search.last.amplitudes, found.search.last.covariances)
    )
    assert per_k == pytest.approx(STEEL_PER_K, abs=4 * np.sqrt(variance))
    assert found.written == ((0,) if read else ())  # no calibration can hold what was not read
