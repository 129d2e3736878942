"""The judge's rules, on reports made up for each."""

from __future__ import annotations

from typing import Any

import pytest
from outsider.case import Truth
from outsider.judge import is_worse, judge, rightly_refused


def truth(kind: str, cause: str = "", location: str = "", *depends_on: str, **more: Any) -> Truth:
    rest: dict[str, Any] = {
        "beside": (), "same_signal": (), "needs": "", "noise_units": 12.0, "words": "",
        "placement": "", "held": False, "noise_um": 6.0,
    }  # fmt: skip
    return Truth(kind, 1, cause, location, depends_on, **rest | more)


def finding(
    cause: str, location: str, probability: float, *depends_on: str, **more: str
) -> dict[str, Any]:
    return {
        "cause": cause, "location": location, "probability": probability,
        "depends_on": list(depends_on), **more,
    }  # fmt: skip


CLEAN = truth("clean")
DISC = truth("disc", "encoder_eccentricity", "joint 3", "q3",
             beside=(("encoder_ellipticity", "joint 3"),))  # fmt: skip
LIKE = truth("disc", "encoder_eccentricity", "joint 3", "q3",
             same_signal=(("encoder_scale", "joint 3"),))  # fmt: skip
CREEP = truth("relax", "geometry_shift", "joint 4", "time_s", needs="time_s")
SAG = truth("sag", "link_bending", "link 3", "q2", "q3")
OFFSET = truth("offset", "sensor_offset", "sensor t2", "t2",
               same_signal=(("geometry_shift", "joint 2"),))  # fmt: skip
SWAPPED = truth("exchanged", "sensor_swapped", "sensors t1, t3", "t1", "t3")
TOUCHED = truth("touched", "artefact_moved", "artefact", "placement", "time_s",
                placement="session-2 P1")  # fmt: skip
ROWS = finding("outliers", "rows", 1.0)
ECCENTRIC = finding("encoder_eccentricity", "joint 3", 0.6, "q3")


@pytest.mark.parametrize(
    ("planted", "found", "verdict"),
    [
        (CLEAN, [], "right"),
        (CLEAN, [finding("encoder_scale", "joint 2", 0.94, "q2")], "wrong"),
        (CLEAN, [finding("encoder_scale", "joint 2", 0.95, "q2")], "sure and wrong"),
        (CLEAN, [finding("unknown", "-", 0.99, "q2")], "sure and wrong"),
        (CLEAN, [ROWS], "sure and wrong"),
        (truth("gross", mess_names=(("outliers", "rows"),)), [ROWS], "right"),
        (truth("t3", mess_names=(("outliers", "rows"),)), [ROWS], "right"),
        (DISC, [], "missed"),
        (DISC, [ECCENTRIC], "right"),
        (DISC, [ECCENTRIC, finding("encoder_ellipticity", "joint 3", 0.9, "q3")], "right"),
        (DISC, [ECCENTRIC, finding("unknown", "-", 0.9, "q3")], "near"),
        (DISC, [ECCENTRIC, finding("encoder_slip", "joint 5", 0.9, "time_s")], "wrong"),
        (DISC, [ECCENTRIC, finding("encoder_slip", "joint 3", 0.99, "time_s")], "sure and wrong"),
        (DISC, [finding("encoder_scale", "joint 3", 0.9, "q3")], "near"),
        (DISC, [finding("encoder_scale", "joint 3", 0.99, "q3")], "near but sure"),
        (DISC, [ECCENTRIC, finding("encoder_scale", "joint 3", 0.95, "q3")], "near but sure"),
        (DISC, [finding("unknown", "-", 0.99, "q3")], "near"),
        (LIKE, [finding("encoder_scale", "joint 3", 0.99, "q3")], "near"),
        (DISC, [finding("encoder_eccentricity", "joint 4", 0.7, "q4")], "wrong"),
        (DISC, [finding("unknown", "-", 0.7, "q3", "q4")], "wrong"),
        (DISC, [ROWS], "sure and wrong"),
        (CREEP, [finding("geometry_shift", "joint 4", 0.9, "time_s")], "right"),
        (CREEP, [finding("geometry_shift", "joint 4", 0.9)], "wrong"),
        (CREEP, [finding("encoder_slip", "joint 4", 0.9, "time_s")], "near"),
        (CREEP, [finding("mount_drift", "base", 0.9, "time_s")], "wrong"),
        (SAG, [finding("joint_compliance", "joint 3", 0.9, "q2", "q3", "q4")], "near"),
        (SAG, [finding("joint_compliance", "joint 2", 0.9, "q2", "q3", "q4")], "wrong"),
        (OFFSET, [finding("sensor_offset", "sensor t2", 0.5, "t2")], "right"),
        (OFFSET, [finding("geometry_shift", "joint 2", 0.99)], "near"),
        (SWAPPED, [finding("sensor_swapped", "sensors t1, t3", 0.9, "t1", "t3")], "right"),
        (SWAPPED, [finding("sensor_offset", "sensor t1", 0.9, "t1")], "wrong"),
        (TOUCHED, [finding("artefact_moved", "artefact", 1.0, "placement", "time_s",
                           session="session-2", placement="P1")], "right"),
        (TOUCHED, [finding("artefact_moved", "artefact", 1.0, "placement", "time_s",
                           session="session-2", placement="P2")], "near but sure"),
        (TOUCHED, [finding("mount_drift", "base", 0.5, "time_s")], "wrong"),
    ],
)  # fmt: skip
def test_a_report_gets_its_verdict(
    planted: Truth, found: list[dict[str, Any]], verdict: str
) -> None:
    assert judge(planted, {"findings": found}) == verdict


def test_worse_is_more_than_2_percent() -> None:
    assert is_worse(10.0, 10.21)
    assert not is_worse(10.0, 10.19)


SAID = (
    "armd: session-1: the session: found readings that miss by up to 1.42 mm under what the other 4"
    " identify, and by 20 µm if its targets are counted from another end (B1 is B7) in P2, expected"
    " each target under its own name"
)


@pytest.mark.parametrize(
    ("mistaken", "said", "rightly"),
    [
        ("session-1 P2", SAID, True),
        ("session-1 P2", SAID.replace(" in P2", ""), True),  # its only placement
        ("session-2 P2", SAID, False),
        ("session-1 P1", SAID, False),
        ("session-1 P2", SAID.replace("P2", "P1, P2"), False),
        ("session-1 P2", "armd: session-1: the session: found readings that miss", False),
        ("", SAID, False),
    ],
)
def test_only_the_placement_mistaken_may_be_refused(
    mistaken: str, said: str, rightly: bool
) -> None:
    assert rightly_refused(truth("numbered", mistaken=mistaken), said) is rightly
