"""What the guest is given: armd as wheels, its installer, a configuration, and the checks."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from armd.simulator.truth.nominal import make_arm_toml

REPOSITORY = Path(__file__).resolve().parents[2]
GUEST = Path(__file__).with_name("guest")
ARMD_TOML = """\
schema = "armd.daemon/1"
arm = "arm.toml"
calibration = "calibration.json"

[driver]
kind = "serial"
port = "/dev/armd/SIM-0001"

[metrics]
port = 9464
"""
CAN_ARMD_TOML = """\
schema = "armd.daemon/1"
arm = "arm.toml"

[driver]
kind = "can"
interface = "socketcan"
channel = "can0"
rate_hz = 100

[zenoh]
listen = ["tcp/127.0.0.1:7448"]
"""


def make_payload(folder: Path, scratch: Path, python: str) -> None:
    """Fill *folder* with everything that a guest with that *python* finds under /mnt."""
    add_checks(folder)
    shutil.copy(REPOSITORY / "requirements.txt", folder)
    _make_package(folder, python, scratch / "unpacked")
    config = folder / "config"
    config.mkdir()
    (config / "armd.toml").write_text(ARMD_TOML)
    _calibrate(scratch / "sessions", config)
    second = config / "CAN-0001"
    second.mkdir()
    (second / "armd.toml").write_text(CAN_ARMD_TOML)
    (second / "arm.toml").write_text(make_arm_toml("CAN-0001"))


def add_checks(folder: Path) -> None:
    """What every guest is given: the files to install, and the checks of them."""
    shutil.copytree(REPOSITORY / "deploy", folder / "deploy")
    shutil.copytree(GUEST, folder / "guest", ignore=shutil.ignore_patterns("__pycache__"))


def _make_package(folder: Path, python: str, scratch: Path) -> None:
    """A package for that *python*, by the documented command, and the wheels it carries beside it:
    `wheelhouse.sh` made them, and it compiles for minutes."""
    command = [REPOSITORY / "deploy/package.sh", "--python", python, folder]
    subprocess.run(command, check=True, env={**os.environ, "PYTHON": sys.executable})
    (package,) = folder.glob("*.deb")
    subprocess.run(["dpkg-deb", "-x", package, scratch], check=True)
    shutil.move(scratch / "usr/lib/armd/wheelhouse", folder / "wheelhouse")


def _calibrate(sessions: Path, config: Path) -> None:
    """The calibration of the arm that the guest's simulator shows."""
    armd = [sys.executable, "-m", "armd.daemon.cli"]
    simulate = [*armd, "simulate", "--session", "demo", "--seed", "1", "-o", str(sessions)]
    subprocess.run(simulate, check=True)
    shutil.copy(sessions / "arm.toml", config)
    measured = [str(path.parent) for path in sorted(sessions.glob("*/session.toml"))]
    arm, result = str(config / "arm.toml"), str(config / "calibration.json")
    subprocess.run([*armd, "calibrate", *measured, "--arm", arm, "-o", result], check=True)
