"""The units say what they should, alike, and lock the daemon in."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from debian_packages import unpacked

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
UNITS = ["armd.service", "armd@.service"]
EXPOSURE_AT_MOST = "20"  # tenths


def settings(unit: str) -> list[str]:
    lines = (DEPLOY / unit).read_text().splitlines()
    return [line for line in lines if line and not line.startswith("#")]


@pytest.fixture(scope="session")
def analyze() -> list[str]:
    """`systemd-analyze`: this machine's, else from a Debian package in the cache."""
    if tool := shutil.which("systemd-analyze"):
        return [tool]
    root = unpacked("systemd")
    libraries = ":".join(str(path.parent) for path in root.rglob("libsystemd-shared-*.so"))
    units = root / "lib/systemd/system"
    environment = [f"LD_LIBRARY_PATH={libraries}", f"SYSTEMD_UNIT_PATH={units}"]
    return ["env", *environment, str(root / "usr/bin/systemd-analyze")]


@pytest.mark.parametrize("unit", UNITS)
def test_exposure_is_at_most_two(analyze: list[str], unit: str) -> None:
    threshold = f"--threshold={EXPOSURE_AT_MOST}"
    check = [*analyze, "security", "--offline=true", threshold, str(DEPLOY / unit)]
    run = subprocess.run(check, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
    assert "Overall exposure level" in run.stdout


@pytest.mark.parametrize("unit", UNITS)
def test_systemd_understands_every_line(analyze: list[str], unit: str, tmp_path: Path) -> None:
    # The program is not installed here; anything that can be executed stands for it.
    text = (DEPLOY / unit).read_text().replace("/opt/armd/bin/armd", shutil.which("true") or "")
    (tmp_path / unit).write_text(text)
    check = [*analyze, "verify", "--man=no", str(tmp_path / unit)]
    run = subprocess.run(check, capture_output=True, text=True)
    # It exits with 0 on keys it does not know and only says so.
    assert (run.returncode, run.stdout + run.stderr) == (0, "")


def test_verify_would_notice(analyze: list[str], tmp_path: Path) -> None:
    """The test above can fail."""
    (tmp_path / "bad.service").write_text("[Service]\nExecStart=/bin/true\nNoSuchKey=1\n")
    check = [*analyze, "verify", "--man=no", str(tmp_path / "bad.service")]
    run = subprocess.run(check, capture_output=True, text=True)
    assert "NoSuchKey" in run.stdout + run.stderr


def test_the_template_says_the_same() -> None:
    def general(line: str) -> str:
        return line.replace("/%i", "").replace(" %i", "")

    assert [general(line) for line in settings("armd@.service")] == settings("armd.service")


@pytest.mark.parametrize("unit", UNITS)
def test_the_daemon_is_watched_and_nobody(unit: str) -> None:
    lines = settings(unit)
    for line in ("Type=notify", "WatchdogSec=5s", "Restart=on-failure", "User=armd"):
        assert line in lines
    assert [line for line in lines if line.startswith("DeviceAllow=")] == [
        "DeviceAllow=char-188 rw",
        "DeviceAllow=char-166 rw",
        "DeviceAllow=/dev/cpu_dma_latency w",
    ]


def test_install_rejects_what_it_does_not_know() -> None:
    run = subprocess.run(["sh", DEPLOY / "install.sh", "--purgee"], capture_output=True, text=True)
    assert run.returncode == 2
    assert "--purgee" in run.stderr


def test_install_takes_every_file_there_is() -> None:
    """A unit or rule that the installer forgets would lie here unused."""
    script = (DEPLOY / "install.sh").read_text()
    files = {path.relative_to(DEPLOY).as_posix() for path in DEPLOY.rglob("*") if path.is_file()}
    other = ("zenoh/", "debian/")
    shipped = {name for name in files if not name.startswith(other) and not name.endswith(".sh")}
    assert shipped == set(re.findall(r'"\$here/([^"$.][^"$]*)"', script))


def test_every_installed_file_is_removed() -> None:
    script = (DEPLOY / "install.sh").read_text()
    uninstall = script.partition("uninstall() {")[2].partition("\n}\n")[0]
    placed = set(re.findall(r'install -D -m 644 \S+ "(\$\w+/[^"]+)"', script))
    assert placed
    assert placed == set(re.findall(r'"(\$\w+/[^"]+)"', uninstall))


def test_no_host_is_named() -> None:
    assert os.access(DEPLOY / "install.sh", os.X_OK)
    for path in DEPLOY.rglob("*"):
        if path.is_file():
            assert "://" not in path.read_text(), path
