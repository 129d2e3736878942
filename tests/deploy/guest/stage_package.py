"""Another fresh controller: the same from the Debian package, by dpkg alone."""

from __future__ import annotations

from pathlib import Path

from controller import PAYLOAD, nothing_is_left, sh, show
from stage_install import takes_the_configuration, the_configuration_holds
from stage_live import live_again


def dpkg_installs_it() -> str:
    sh(f"dpkg -i {PAYLOAD}/*.deb")
    assert show("UnitFileState") == "enabled"
    return sh("dpkg-query -W armd")


def it_becomes_live() -> str:
    takes_the_configuration()
    the_configuration_holds()
    sh("systemctl daemon-reload && systemctl reset-failed")
    sh("systemctl restart arm cable listener armd")
    return live_again("the start")


def dpkg_upgrades_it_running() -> str:
    before = show("MainPID")
    sh(f"dpkg -i {PAYLOAD}/*.deb")
    assert show("MainPID") != before, "the old one still runs"
    return live_again("the upgrade")


def dpkg_removes_it_and_keeps_the_configuration() -> None:
    sh("dpkg -r armd")
    assert Path("/etc/armd/calibration.json").exists()
    assert not Path("/opt/armd").exists()
    assert show("ActiveState") == "inactive"


def dpkg_purges_everything() -> None:
    sh("rm -rf /etc/systemd/system/armd.service.d")  # the guest's own
    sh("dpkg -P armd")
    nothing_is_left()


CHECKS = [
    dpkg_installs_it,
    it_becomes_live,
    dpkg_upgrades_it_running,
    dpkg_removes_it_and_keeps_the_configuration,
    dpkg_purges_everything,
]
