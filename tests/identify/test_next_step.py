"""What to do next where a certificate is refused: one step for each reason, with its command."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from armd.compensation.estimate.observations import Observations, collect_observations
from armd.compensation.identify.admission.reading_counts import count_certificate_readings
from armd.compensation.identify.next_step import CalibratedFiles, Objection, Why, choose_next_step
from armd.daemon.cli import make_parsers
from support import synthetic

ARM = synthetic.arm()
FILES = CalibratedFiles((Path("my arm/T20"), Path("my arm/more")), "my arm/arm.toml")


def artefact(placements: int = 1, readings: int = 24) -> Observations:
    rng = np.random.default_rng(1)
    truth = synthetic.disturbed(ARM, rng)
    session = synthetic.session(ARM, truth, rng, placements=placements, readings=readings)
    return collect_observations([session], ARM)


def tracked() -> Observations:
    rng = np.random.default_rng(2)
    return collect_observations([synthetic.tracked(ARM, synthetic.disturbed(ARM, rng), rng)], ARM)


def command_in(step: str) -> list[str]:
    (command,) = re.findall("`([^`]*)`", step)
    return shlex.split(command)


def fault(why: Why) -> Objection:
    return Objection(why, "words", "my arm/more", ("A", "B"))


BOTH = [(why, artefact) for why in Why]
BOTH += [(why, tracked) for why in Why if why is not Why.PLACEMENTS]  # a tracker needs no second


@pytest.mark.parametrize(("why", "kind"), BOTH)
def test_each_reason_has_one_step_whose_command_armd_takes(why, kind):
    observations = kind()
    step = choose_next_step([fault(why)], observations, FILES)
    program, name, *words = command_in(step)
    assert program == "armd"
    args = make_parsers([name])[0].parse_args([name, *words])  # exits where it does not take them
    sessions = [str(path) for path in FILES.sessions]
    if name in ("calibrate", "diagnose"):
        kept = sessions[:1] if why is Why.ODD_SESSION else sessions
        assert [str(path) for path in args.session] == kept
        assert str(args.arm) == "my arm/arm.toml"
    else:
        assert str(args.output) == "my arm/more1"


def test_each_reason_of_a_certificate_is_one_of_these():
    """No reason goes without: what refuses is an `Objection`, and each kind of it is raised."""
    path = Path(__file__).parents[2] / "compensation/identify/certificate.py"
    raised = set(re.findall(r"\bWhy\.([A-Z_]+)", path.read_text()))
    assert raised == {why.name for why in Why}


def test_a_fit_that_began_far_off_begins_again_from_a_better_drawing():
    step = choose_next_step([fault(Why.UNSETTLED)], artefact(), FILES, ["a_2", "tip_z"])
    assert step.startswith("put a_2, tip_z right in my arm/arm.toml")
    assert command_in(step)[:2] == ["armd", "calibrate"]


def test_of_several_reasons_the_first_cause_is_the_next_step():
    observations = artefact()
    alone = choose_next_step([fault(Why.READINGS)], observations, FILES)
    assert choose_next_step([fault(Why.FAR), fault(Why.READINGS)], observations, FILES) == alone
    assert choose_next_step([], observations, FILES) == ""


@pytest.mark.parametrize("placements", [1, 2])
def test_what_is_measured_as_told_is_enough(placements):
    observations = artefact(placements)
    step = choose_next_step([fault(Why.PLACEMENTS)], observations, FILES)
    args = make_parsers(["measure"])[0].parse_args(command_in(step)[1:])
    n_targets = len(np.unique(observations.target))
    assert len(args.placements) == 3 - placements
    more = len(args.placements) * n_targets * args.repeats
    needed = count_certificate_readings(ARM.n_joints, 3, 0)
    assert 0 <= observations.n + more - needed < len(args.placements) * n_targets


def test_the_joint_that_moved_least_is_named():
    observations = artefact()
    q = observations.states.q
    q[:, 3] = np.linspace(0.1, 0.1 + np.radians(12.0), len(q))
    step = choose_next_step([fault(Why.POSTURES)], observations, FILES)
    assert step.startswith("turn joint 4 farther, which moved least (12°)")


@pytest.mark.parametrize("why", [Why.READINGS, Why.POSTURES])
def test_a_tracker_sees_the_arm_everywhere(why):
    assert " in another place: `armd measure " in choose_next_step([fault(why)], artefact(), FILES)
    seen = choose_next_step([fault(why)], tracked(), FILES)
    assert "place" not in seen and ": `armd import " in seen


@pytest.mark.parametrize(
    ("objection", "words", "kept"),
    [
        (Objection(Why.OTHER_TIP, "words", folders=("my arm/more",)), "each tip's sessions", 1),
        (
            Objection(Why.OTHER_TIP, "words", rows="rows 61 to 120 of session more"),
            "delete rows",
            2,
        ),
        (Objection(Why.OTHER_PLACE, "words", rows="rows 5 to 9 of session more"), "placement", 2),
    ],
)
def test_two_tips_or_places_are_parted_by_session_or_by_row(objection, words, kept):
    step = choose_next_step([objection, fault(Why.FAR)], artefact(), FILES)
    assert words in step and objection.rows in step
    args = make_parsers(["calibrate"])[0].parse_args(command_in(step)[1:])
    assert [str(path) for path in args.session] == [str(path) for path in FILES.sessions][:kept]
