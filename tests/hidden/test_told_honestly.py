"""What a diagnosis says is no more than the readings bear."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session
from armd.compensation.design.conditions import draw_poses
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.compensation.diagnose.report.result import as_json
from armd.compensation.diagnose.report.sizes import is_size_known
from armd.compensation.diagnose.report.verdict import write_verdict
from armd.compensation.diagnose.search.findings import as_reported
from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.estimate.observations import collect_observations
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import ArtefactCorrection, Calibration
from armd.compensation.model.kinematics import compute_frames
from armd.errors import BadInput
from armd.simulator.campaigns.hidden import Design
from armd.simulator.plants.plant import Plant
from support.made_case import make_case
from support.planting import planted, slip, wave
from support.selection import parametrize_default


@dataclass(frozen=True)
class Measured:
    arm: Arm
    sessions: list[Session]
    calibration: Calibration  # of the same arm, before


@pytest.fixture(scope="module")
def measured() -> Measured:
    made = make_case(621, (), Design(sessions=5, articulations=3, before=6, holdout=0))
    calibration = made.calibrate_before()
    assert calibration is not None
    return Measured(made.arm, made.sessions, calibration)


@pytest.fixture(scope="module")
def found(measured: Measured) -> Diagnosis:
    sick = planted(measured.sessions, wave(2, 12.0))
    return diagnose(sick, measured.arm, measured.calibration)


def first(session: Session, n: int) -> Session:
    return session.rows(np.arange(session.n) < n)


@pytest.mark.slow
@parametrize_default("n", [1, 2])
def test_readings_that_their_placement_explains_are_refused(measured: Measured, n: int) -> None:
    arm, calibration = measured.arm, measured.calibration
    few = first(measured.sessions[0], n)
    with pytest.raises(BadInput, match=f"readings: found {n} at rest in 1 placement, expected"):
        diagnose([few], arm, calibration)
    with pytest.raises(BadInput, match=f"found {n} at rest"):
        diagnose(measured.sessions[1:3], arm, calibration, holdout=[few])


def test_many_copies_of_one_reading_are_one(measured: Measured) -> None:
    session = measured.sessions[0]
    copies = session.rows(np.zeros(session.n, dtype=np.int64))
    with pytest.raises(BadInput, match="found 1 at rest"):
        diagnose([copies], measured.arm, measured.calibration)


@pytest.mark.slow
def test_silence_of_few_readings_is_no_comfort(measured: Measured) -> None:
    few = diagnose([first(measured.sessions[0], 5)], measured.arm, measured.calibration)
    assert not few.findings
    assert "hardly any cause could have shown" in write_verdict(few)


@pytest.mark.slow
def test_silence_says_what_would_have_shown(measured: Measured) -> None:
    clean = diagnose(measured.sessions, measured.arm, measured.calibration)
    assert not clean.findings
    shown = clean.search.would_show
    # A slip of 15 arc seconds is found in these (10 were, elsewhere); nothing is seen of a force.
    assert shown["encoder_slip"] > 10.0
    hidden = [cause for cause, snr in shown.items() if snr < 5.0]
    assert hidden
    assert all(cause in write_verdict(clean) for cause in hidden)


@pytest.mark.slow
def test_no_p_value_is_nothing(found: Diagnosis) -> None:
    assert all(finding["p_value"] > 0.0 for finding in as_json(found, None)["findings"])


@pytest.mark.slow
def test_a_size_within_its_own_uncertainty_is_told_as_such(found: Diagnosis) -> None:
    assert is_size_known(found, 0)
    last = found.search.last
    wide = tuple(1e4 * c for c in last.covariances)
    unsure = replace(found, search=replace(found.search, last=replace(last, covariances=wide)))
    assert not is_size_known(unsure, 0)
    assert "within its own uncertainty" in as_json(unsure, None)["findings"][0]["reading"]
    assert "The size of 1 is within its own uncertainty." in write_verdict(unsure)


@pytest.mark.slow
def test_what_has_no_name_has_no_causes_parameters(found: Diagnosis) -> None:
    (one,) = found.findings
    nameless = replace(one, candidate=replace(one.candidate, cause="unknown"))
    last = as_reported(found.search.last, [nameless])
    (candidate,) = last.findings
    assert candidate.cause == "unknown"
    columns = {column.name for column in candidate.columns}
    assert columns == {"theta_2 × function 1", "theta_2 × function 2"}


def test_a_correction_of_one_artefact_is_not_anothers(measured: Measured) -> None:
    session = measured.sessions[0]
    other = replace(session, artefact=session.artefact.model_copy(update={"name": "another"}))
    correction = ArtefactCorrection(artefacts=[session.artefact.name], scale=1.001)
    stretch = collect_observations([session, other], measured.arm, correction).stretch
    assert stretch[: session.n] == pytest.approx(1.001, abs=2e-4)
    assert stretch[session.n :] == pytest.approx(1.0, abs=2e-4)


@pytest.mark.slow
def test_what_is_found_on_an_artefact_is_written_with_its_name(measured: Measured) -> None:
    sessions = [_expanding(session, 20e-6) for session in measured.sessions]
    diagnosis = diagnose(sessions, measured.arm, measured.calibration)
    assert [f.candidate.cause for f in diagnosis.findings] == ["artefact_expansion"]
    correction = diagnosis.extended.artefact
    assert correction is not None
    assert correction.artefacts == [sessions[0].artefact.name]


def _expanding(session: Session, more_per_k: float) -> Session:
    """The certificate states an expansion that is too small by so much."""
    certified = session.artefact.expansion_per_k - more_per_k
    artefact = session.artefact.model_copy(update={"expansion_per_k": certified})
    return replace(session, artefact=artefact)


@pytest.mark.slow
def test_without_limits_poses_stay_where_the_arm_was_seen(measured: Measured) -> None:
    joints = [j.model_copy(update={"min_deg": None, "max_deg": None}) for j in measured.arm.joint]
    arm = measured.arm.model_copy(update={"joint": joints})
    sessions = planted(measured.sessions[:2], slip(3, 20.0, 0.0))
    diagnosis = diagnose(sessions, arm, measured.calibration)
    poses = draw_poses(diagnosis, 1)
    seen = np.concatenate([session.states.q for session in sessions])
    assert (poses.q >= seen.min(axis=0) - 1e-3).all()
    assert (poses.q <= seen.max(axis=0) + 1e-3).all()
    constants = measured.calibration.vector(arm.n_joints)
    lowest = min(0.0, float(compute_frames(seen, constants)[0][:, :, 2].min()))
    assert compute_frames(poses.q, constants)[0][:, :, 2].min() > lowest - 0.5


@pytest.mark.slow
def test_a_walk_is_not_told_where_two_causes_do_the_same() -> None:
    """A link expands more than it did and its sensor is off: each session's mean and slope. Alone
    its walk in time explains both at once, and was sure."""
    plants = [
        Plant("link_expansion", "link 4", 9.0),
        Plant("sensor_offset", "sensor t4", -1.1),
    ]
    made = make_case(807, plants, Design(before=6, holdout=0))
    told = diagnose(made.sessions, made.arm, made.calibrate_before()).findings
    assert ("link_expansion", "link 4") in [finding.candidate.place for finding in told]
    assert not any(
        finding.candidate.cause == "geometry_shift" and finding.probability >= 0.95
        for finding in told
    )


def test_every_cause_names_bounds_or_is_an_accident() -> None:
    accidents = {cause for cause, effect in CATALOGUE.items() if effect.accident}
    assert accidents == {
        "encoder_slip", "geometry_shift", "mount_drift", "tip_offset", "artefact_length",
    }  # fmt: skip
