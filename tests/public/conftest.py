"""A synthetic arm's files and a session of it, for tests of the public functions."""

from __future__ import annotations

import pytest

import armd
from support.measured_arm import MeasuredArm, measured_arm


@pytest.fixture(scope="session")
def measured(tmp_path_factory: pytest.TempPathFactory) -> MeasuredArm:
    return measured_arm(tmp_path_factory.mktemp("measured"))


@pytest.fixture(scope="session")
def session(measured: MeasuredArm) -> armd.Session:
    made = armd.make_session(
        measured.columns, measured.arm_file, artefact=measured.artefact,
        started="2026-03-01T09:00:00Z",
    )  # fmt: skip
    made.save(measured.arm_file.parent / "A")
    return made
