"""Real measured data, as others published them, turned into armd's sessions.

    python tests/real/convert.py OUT [SOURCE]

SOURCE has the folders ur10_laser_tracker and ball_in_socket; by default those beside this file.
Makes OUT/ur10/{A,B,C}-{train,heldout} and OUT/{panda_1,panda_3,kuka_14,dinova_1}/seats, each with
the arm's nominal arm.toml beside them.
"""

from __future__ import annotations

import csv
import datetime
import sys
from pathlib import Path

import numpy as np

from armd.compensation.data.sessions.writing import write_session
from armd.daemon.catalogue.urdf.urdf import compute_denavit_hartenberg, read_chain

VENDORED = Path(__file__).parent / "data"
#: Series measured by the tracker, and when.
SERIES = {"A": (2020, 7, 14), "B": (2020, 11, 11), "C": (2020, 11, 11)}
UR10_ROWS = [  # θ°, d mm, a mm, α°: the maker's public table
    [0.0, 127.3, 0.0, 90.0],
    [0.0, 0.0, -612.0, 0.0],
    [0.0, 0.0, -572.3, 0.0],
    [0.0, 163.941, 0.0, 90.0],
    [0.0, 115.7, 0.0, -90.0],
    [0.0, 92.2, 0.0, 0.0],
]
ROBOTS = {
    "panda_1": "panda.urdf",
    "panda_3": "panda.urdf",
    "kuka_14": "iiwa14.urdf",
    "dinova_1": "gen3lite.urdf",
}
HOLES_APART_MM, CALLIPER_MM = 50.0, 0.1


def convert(out: Path, source: Path = VENDORED) -> None:
    """Write every set's sessions and nominal arm under *out*."""
    ur10(source / "ur10_laser_tracker", out / "ur10")
    for robot in ROBOTS:
        ball_in_socket(source / "ball_in_socket", robot, out / robot)


def ur10(source: Path, out: Path) -> None:
    """Poses of a UR10 seen by a laser tracker: one placement, truth row by row.

    Half of the rows, drawn at random, are held out. Angles are those commanded.
    """
    out.mkdir(parents=True, exist_ok=True)
    # The tracker's target on the flange; where it sits is fitted with the tip's offset.
    _write_arm(out / "arm.toml", "UR10", np.array(UR10_ROWS), np.zeros(3), sensors=["ambient"])
    for series, date in SERIES.items():
        with (source / f"series_{series}.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        heldout = np.random.default_rng(0).permutation(len(rows)) < len(rows) // 2
        for name, chosen in (("train", ~heldout), ("heldout", heldout)):
            picked = [row for row, take in zip(rows, chosen, strict=True) if take]
            _write_ur10(out / f"{series}-{name}", date, picked)


def _write_ur10(folder: Path, date: tuple[int, int, int], rows: list[dict[str, str]]) -> None:
    joints = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]

    def column(name: str) -> list[float]:
        return [float(row[name]) for row in rows]

    columns: dict[str, list[float] | list[str]] = {
        # Time stamps of two series are rounded to hours; row order is time, about 20 s a pose.
        "time_s": [20.0 * row for row in column("row")],
        "placement": ["tracker"] * len(rows),
        "target": ["T-Mac"] * len(rows),
    }
    columns |= {f"q{k}": column(f"{name}_joint") for k, name in enumerate(joints, 1)}
    columns["ambient"] = column("measurement_temperature")
    columns |= {f"{axis}_mm": column(f"measurement_{axis}") for axis in "xyz"}
    artefact = {"name": "laser tracker", "target": [{"name": "T-Mac"}]}
    write_session(folder, _session("UR10", date, artefact), columns)


def ball_in_socket(source: Path, robot: str, out: Path) -> None:
    """A ball on the flange, seated in two sockets 50 mm apart, at several places of the table."""
    out.mkdir(parents=True, exist_ok=True)
    chain = read_chain(source / "urdf" / ROBOTS[robot], "ball_link")
    rows, tip, _ = compute_denavit_hartenberg(chain)
    _write_arm(out / "arm.toml", robot, rows[:, :4], tip)  # β of printed quarter turns: 2e-4°
    angles, placements, targets = [], [], []
    for place in sorted((source / robot).iterdir()):
        for hole in (0, 1):
            seated = np.loadtxt(place / f"hole_{hole}.csv", delimiter=",", ndmin=2)
            angles.append(seated)
            placements += [place.name] * len(seated)
            targets += [f"hole_{hole}"] * len(seated)
    q = np.concatenate(angles)
    # Nobody recorded when: causes that only time tells are not to be claimed from these data.
    columns = {"time_s": np.full(len(q), np.nan), "placement": placements, "target": targets}
    columns |= {f"q{k}": column for k, column in enumerate(q.T, 1)}
    artefact = {
        "name": "two sockets",
        "target": [{"name": "hole_0"}, {"name": "hole_1"}],
        "distance": [
            {
                "between": ["hole_0", "hole_1"],
                "length_mm": HOLES_APART_MM,
                "standard_uncertainty_mm": CALLIPER_MM,
            }
        ],
    }
    write_session(out / "seats", _session(robot, (2024, 1, 1), artefact), columns)


def _session(
    arm: str, date: tuple[int, int, int], artefact: dict[str, object]
) -> dict[str, object]:
    started = datetime.datetime(*date, tzinfo=datetime.UTC)
    return {
        "schema": "armd.session/1",
        "arm": arm,
        "started": started,
        "angle_unit": "rad",
        "artefact": artefact,
    }


def _write_arm(
    path: Path, serial: str, rows: np.ndarray, tip: np.ndarray, sensors: list[str] | None = None
) -> None:
    lines = ['schema = "armd.arm/1"', f'serial_number = "{serial}"']
    lines += [f'[[temperature_sensor]]\nname = "{name}"' for name in sensors or []]
    for row in rows:
        lines.append("\n[[joint]]")
        for name, value in zip(("theta_deg", "d_mm", "a_mm", "alpha_deg"), row, strict=True):
            lines.append(f"{name} = {float(value)!r}")
    lines += ["\n[tip]", f"offset_mm = {[float(value) for value in tip]}"]
    path.write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    convert(*map(Path, sys.argv[1:3]))
