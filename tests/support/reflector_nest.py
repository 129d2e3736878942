"""A nest of reflectors on the simulator's arm, seen by a tracker: a session, and the truth."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from armd.arrays import F64
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.effects.effect import Conditions

#: Where the reflectors sit in the last frame, mm.
NEST = {
    "A": np.array([45.3, 0.2, 110.4]),
    "B": np.array([-60.0, 20.0, 90.0]),
    "C": np.array([10.0, 70.0, 60.0]),
}
#: Standard deviations of the tracker, per axis, and of the encoders.
TRACKER_MM, ENCODER_RAD = 0.01, 1e-5


def write_nest_session(
    folder: Path,
    true: TrueArm,
    rng: np.random.Generator,
    poses: int = 60,
    given: Sequence[str] = (),
    *,
    nest: Mapping[str, F64] = NEST,
    extra: str = "",
) -> None:
    """Write session.toml and readings.csv: each reflector seen in so many poses of its own;
    *given*: those whose place session.toml states."""
    low, high = nominal.get_limits_rad()
    turn = Rotation.random(random_state=3).as_matrix()
    where = np.array([2000.0, 300.0, 500.0])
    folder.mkdir(parents=True)
    with (folder / "readings.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        joints = [f"q{k + 1}" for k in range(6)]
        writer.writerow(
            ["time_s", "placement", "target", "reflector", *joints, "x_mm", "y_mm", "z_mm"]
        )
        for i in range(poses):
            for name, offset in nest.items():
                q = rng.uniform(low, high)
                arm = replace(true, tip_offset=np.asarray(offset))
                still = Conditions.at_rest(1, 6)
                tip = arm.tip(q[None], still)[0]
                seen = turn.T @ (tip - where) + rng.normal(0.0, TRACKER_MM, 3)
                read = arm.encoder_angles(q[None], still)[0] + rng.normal(0.0, ENCODER_RAD, 6)
                writer.writerow([10.0 * i, "T", "SMR", name, *read.tolist(), *seen.tolist()])
    places = {name: list(map(float, nest[name])) for name in given}
    tables = [f'[[reflector]]\nname = "{n}"\noffset_mm = {at}' for n, at in places.items()]
    head = [
        'schema = "armd.session/1"', f'arm = "{nominal.SERIAL_NUMBER}"',
        "started = 2026-03-01T09:00:00Z", *tables, extra, "[artefact]", 'name = "tracker"',
        "[[artefact.target]]", 'name = "SMR"',
    ]  # fmt: skip
    (folder / "session.toml").write_text("\n".join(head) + "\n", encoding="utf-8")
