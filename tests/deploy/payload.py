"""What the guest is given: armd as wheels, its installer, a configuration, and the checks."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

from debian_packages import CACHE

from armd.simulator.truth.nominal import arm_toml

REPOSITORY = Path(__file__).resolve().parents[2]
GUEST = Path(__file__).with_name("guest")
GUEST_PYTHON = (3, 11)
ARMD_TOML = """\
schema = "armd.daemon/1"
arm = "arm.toml"
calibration = "calibration.json"

[driver]
kind = "serial"
port = "/dev/armd/SIM-0001"
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


def make_payload(folder: Path, scratch: Path) -> None:
    """Fill *folder* with everything the guest finds under /mnt."""
    shutil.copytree(REPOSITORY / "deploy", folder / "deploy")
    shutil.copy(REPOSITORY / "requirements.txt", folder)
    shutil.copytree(GUEST, folder / "guest", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(_wheelhouse(scratch), folder / "wheelhouse")
    config = folder / "config"
    config.mkdir()
    (config / "armd.toml").write_text(ARMD_TOML)
    _calibrate(scratch / "sessions", config)
    second = config / "CAN-0001"
    second.mkdir()
    (second / "armd.toml").write_text(CAN_ARMD_TOML)
    (second / "arm.toml").write_text(arm_toml("CAN-0001"))


def _wheelhouse(scratch: Path) -> Path:
    """armd and everything it needs as wheels; the dependencies' stay in the cache."""
    if sys.version_info[:2] != GUEST_PYTHON:
        wanted = ".".join(map(str, GUEST_PYTHON))
        raise RuntimeError(f"wheels for the guest want Python {wanted}, this is {sys.version}")
    source = scratch / "source"
    hidden = shutil.ignore_patterns(".*", "__pycache__", "build", "tests", "out", "*.egg-info")
    shutil.copytree(REPOSITORY, source, ignore=hidden)
    wheels = CACHE / "wheelhouse"
    pip = [sys.executable, "-m", "pip", "wheel", "-qq", "--disable-pip-version-check"]
    pip += ["--constraint", str(REPOSITORY / "requirements.txt"), "--wheel-dir", str(wheels)]
    subprocess.run([*pip, "--find-links", str(wheels), str(source)], check=True)
    return wheels


def _calibrate(sessions: Path, config: Path) -> None:
    """The calibration of the arm that the guest's simulator shows."""
    armd = [sys.executable, "-m", "armd.daemon.cli"]
    simulate = [*armd, "simulate", "--session", "demo", "--seed", "1", "-o", str(sessions)]
    subprocess.run(simulate, check=True)
    shutil.copy(sessions / "arm.toml", config)
    measured = [str(path.parent) for path in sorted(sessions.glob("*/session.toml"))]
    arm, result = str(config / "arm.toml"), str(config / "calibration.json")
    subprocess.run([*armd, "calibrate", *measured, "--arm", arm, "-o", result], check=True)
