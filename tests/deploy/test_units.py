"""The units say what they should, alike, and lock the daemon in."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from debian_packages import unpacked

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
UNITS = ["armd.service", "armd@.service"]
BRIDGE = "armd-bridge@.service"
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


@pytest.mark.parametrize("unit", [*UNITS, BRIDGE])
def test_exposure_is_at_most_two(analyze: list[str], unit: str) -> None:
    threshold = f"--threshold={EXPOSURE_AT_MOST}"
    check = [*analyze, "security", "--offline=true", threshold, str(DEPLOY / unit)]
    run = subprocess.run(check, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
    assert "Overall exposure level" in run.stdout


@pytest.mark.parametrize("unit", [*UNITS, BRIDGE])
def test_systemd_understands_every_line(analyze: list[str], unit: str, tmp_path: Path) -> None:
    # The program is not installed here; anything that can be executed stands for it.
    text = (DEPLOY / unit).read_text().replace("/opt/armd/bin/armd", shutil.which("true") or "")
    (tmp_path / unit).write_text(text)
    check = [*analyze, "verify", "--man=no", str(tmp_path / unit)]
    run = subprocess.run(check, capture_output=True, text=True)
    # It exits with 0 on keys it does not know and only says so.
    assert (run.returncode, run.stdout + run.stderr) == (0, "")


@pytest.mark.parametrize("unit", UNITS)
def test_what_was_written_is_not_executed_but_where_something_is_compiled(
    analyze: list[str], unit: str, tmp_path: Path
) -> None:
    """As systemd reads the unit, and the unit with the drop-in that install.sh puts there."""
    check = [*analyze, "security", "--offline=true", "--json=short", str(tmp_path / unit)]

    def allowed() -> bool:
        (line,) = (
            line
            for line in json.loads(subprocess.run(check, capture_output=True).stdout)
            if line["name"] == "MemoryDenyWriteExecute="
        )
        return not line["set"]

    shutil.copy(DEPLOY / unit, tmp_path)
    assert not allowed()
    (tmp_path / f"{unit}.d").mkdir()
    shutil.copy(DEPLOY / "compiles.conf", tmp_path / f"{unit}.d")
    assert allowed()


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


def test_a_bridge_has_no_device_no_network_and_no_more_than_the_daemon() -> None:
    bridge, daemon = set(settings(BRIDGE)), set(settings("armd.service"))
    for line in ("DynamicUser=yes", "PrivateDevices=yes", "Restart=always", "IPAddressDeny=any"):
        assert line in bridge
    assert not [line for line in bridge if line.startswith(("DeviceAllow", "LimitRTPRIO"))]
    # What fences the daemon in fences its bridges in, but for what the daemon alone needs.
    fences = {line for line in daemon if line.startswith(("Protect", "Private", "Restrict", "IP"))}
    fences |= {
        line for line in daemon if line.startswith(("SystemCall", "Socket", "Capab", "NoNew"))
    }
    own = {line for line in fences if "AF_CAN" in line or "sched_setscheduler" in line}
    own |= {"RestartPreventExitStatus=2"}
    assert fences - own <= bridge


@pytest.mark.parametrize("name", ["view", "ippdme", "ros2", "stream"])
def test_each_bridge_of_the_template_is_a_command(name: str) -> None:
    assert "ExecStart=/opt/armd/bin/armd %i $OPTIONS" in settings(BRIDGE)
    run = [sys.executable, "-m", "armd.daemon.cli", name, "--help"]
    assert "--endpoint" in subprocess.run(run, capture_output=True, text=True).stdout


def test_install_rejects_what_it_does_not_know() -> None:
    run = subprocess.run(["sh", DEPLOY / "install.sh", "--purgee"], capture_output=True, text=True)
    assert run.returncode == 2
    assert "--purgee" in run.stderr


def shipped_files() -> list[Path]:
    """Without what Python, and pip beside deploy/client/pyproject.toml, leave there."""
    built = {"build", "armd_client.egg-info", "__pycache__"}
    return [
        path
        for path in DEPLOY.rglob("*")
        if path.is_file() and not built & set(path.relative_to(DEPLOY).parts)
    ]


def test_install_takes_every_file_there_is() -> None:
    """A unit or rule that the installer forgets would lie here unused."""
    script = (DEPLOY / "install.sh").read_text()
    files = {path.relative_to(DEPLOY).as_posix() for path in shipped_files()}
    other = ("zenoh/", "debian/", "client/", "packaging/", "monitoring/")
    shipped = {name for name in files if not name.startswith(other) and not name.endswith(".sh")}
    assert shipped == set(re.findall(r'"\$here/([^"$.][^"$]*)"', script))


def test_every_installed_file_is_removed() -> None:
    script = (DEPLOY / "install.sh").read_text()
    uninstall = script.partition("uninstall() {")[2].partition("\n}\n")[0]
    assert 'system_files | while read -r file; do rm -f "$file"; done' in uninstall
    files = script.partition("system_files() {")[2].partition("\n}\n")[0]
    placed = set(re.findall(r'install -D -m 644 \S+ "(\$\w+/[^"]+)"', script))
    assert placed
    generated = {"$bash/armd", "$zsh/_armd", "$fish/armd.fish", "$man/armd.1"}
    assert placed | generated == set(re.findall(r'"(\$\w+/[^"]+)"', files))


def test_no_host_is_named() -> None:
    assert os.access(DEPLOY / "install.sh", os.X_OK)
    for path in shipped_files():
        assert "://" not in path.read_text(), path
