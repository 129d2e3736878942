"""What `make real` prints, held by tests: conversion, figures reached, a certificate refused."""

from __future__ import annotations

from pathlib import Path

import marks
import numpy as np
import pytest
from convert import ROBOTS, VENDORED

from armd.compensation.data.sessions.session import load_session
from armd.compensation.identify.calibrate import Options, calibrate
from armd.compensation.model.arm import load_arm
from armd.compensation.model.kinematics import compute_pose
from armd.daemon.catalogue.urdf.urdf import compute_denavit_hartenberg, read_chain
from support.selection import parametrize_default


@parametrize_default("series", list(marks.UR10_MM))
@pytest.mark.slow
def test_a_reflector_that_no_drawing_has_changes_no_verdict(converted: Path, series: str) -> None:
    """The tracker's reflector is 93 mm beyond the flange, as the other two series find, too."""
    arm = load_arm(converted / "ur10" / "arm.toml")
    assert arm.tip.offset_mm == (0.0, 0.0, 0.0)
    reflector = arm.tip.model_copy(update={"offset_mm": (0.0, 0.0, 93.0)})
    session = load_session(converted / "ur10" / f"{series}-train", arm)
    for tip, remarked in ((arm.tip, ["tip_z"]), (reflector, [])):
        drawing = arm.model_copy(update={"tip": tip})
        result = calibrate([session], drawing, Options(thermal_order=0))
        assert result.certificate.granted, result.certificate.reason
        assert [one.parameter for one in result.off_drawing] == remarked
        assert all(abs(one.difference - 93.0) < 1.0 for one in result.off_drawing)


@parametrize_default("robot", list(ROBOTS), default=2)
def test_seats_reach_their_mark_or_are_refused(converted: Path, robot: str) -> None:
    _, result, _, found = marks.seats(converted, robot)
    certificate = result.certificate
    (length,) = result.lengths
    assert abs(length.measured_mm - 50.0) < 0.2  # the calliper is good to 0.1 mm
    assert certificate.granted == (robot in marks.SEAT_MM), certificate.reason
    if robot in marks.SEAT_MM:
        assert round(marks.mean_mm(found), 3) <= marks.SEAT_MM[robot]
    else:
        assert "no set of constants describes this arm" in certificate.reason


def test_urdf_becomes_denavit_hartenberg(converted: Path) -> None:
    """The published table of the Panda, in Craig's form, gives the same distances."""
    urdf = VENDORED / "ball_in_socket" / "urdf" / "panda.urdf"
    rows, tip, _ = compute_denavit_hartenberg(read_chain(urdf, "panda_link8"))
    assert rows[2, 1:3] == pytest.approx([316.0, 82.5])
    assert rows[4, 1] == pytest.approx(384.0)
    assert np.linalg.norm(tip) == pytest.approx(107.0)
    arm = load_arm(converted / "panda_1" / "arm.toml")
    p = arm.nominal()
    p[35:38] = tip
    # At zero the flange stands 88 mm out and 333 + 316 + 384 − 107 mm up; here from joint 1's
    # frame, which lies in the shoulder at 333 mm.
    position = compute_pose(np.zeros((1, 7)), p)[0][0]
    assert np.linalg.norm(position) == pytest.approx(np.hypot(88.0, 316 + 384 - 107))
