"""First boot: a fresh controller gets armd by the documented command."""

from __future__ import annotations

import grp
import pwd
import shutil
from pathlib import Path

from controller import PAYLOAD, UNIT, sh, show
from plug import PseudoTerminal, plug

INSTALL = f"sh {PAYLOAD}/deploy/install.sh --wheelhouse {PAYLOAD}/wheelhouse"


def installs_from_a_wheelhouse() -> str:
    return sh(INSTALL).splitlines()[-1]


def installing_twice_changes_nothing() -> None:
    def files() -> set[str]:
        return set(sh("find /usr/local /etc /opt/armd/ -not -name '*.pyc'").splitlines())

    before = files()
    sh(INSTALL)
    assert files() == before, sorted(files() ^ before)


def has_a_user_of_its_own() -> str:
    user = pwd.getpwnam("armd")
    assert user.pw_shell.endswith("nologin"), user
    assert not Path(user.pw_dir).exists() or user.pw_dir == "/", user
    others = [group.gr_name for group in grp.getgrall() if "armd" in group.gr_mem]
    assert not others, others
    return f"uid {user.pw_uid}"


def gives_least_permission() -> None:
    assert sh("stat -c '%U:%G %a' /etc/armd") == "root:armd 750"
    assert sh("stat -L -c '%U:%G %a' /opt/armd") == "root:root 755"
    unsafe = sh("find /opt/armd/ /usr/local/lib -not -type l '(' -perm /022 -o -not -user root ')'")
    assert not unsafe, unsafe


def waits_for_a_configuration() -> None:
    assert show("UnitFileState") == "enabled"
    assert show("ActiveState") == "inactive"


def takes_the_configuration() -> None:
    """What the integrator does next, and what makes the simulated arm be there at the next boot."""
    shutil.copytree(PAYLOAD / "config", "/etc/armd", dirs_exist_ok=True)
    Path("/etc/armd/SIM-0001").touch()
    sh("chgrp -R armd /etc/armd && chmod -R u=rwX,g=rX,o= /etc/armd")
    units = Path("/etc/systemd/system")
    for unit in (PAYLOAD / "guest/units").iterdir():
        shutil.copy(unit, units)
    (units / f"{UNIT}.d").mkdir()
    if isinstance(plug(), PseudoTerminal):
        shutil.copy(PAYLOAD / "guest/armd-guest.conf", units / f"{UNIT}.d")
        shutil.copy(PAYLOAD / "guest/60-arm-test.rules", "/etc/udev/rules.d")
    else:  # a machine in software: it compiles for minutes, and has no time for such rates
        (units / f"{UNIT}.d/slow.conf").write_text("[Service]\nTimeoutStartSec=1h\n")
        (units / "arm.service.d").mkdir(exist_ok=True)
        (units / "arm.service.d/slow.conf").write_text(f"[Unit]\nAfter={UNIT}\n")
        sh(f"sed -i 's/--rate 200/--rate 50/; s/--rate 100/--rate 10/' {units}/*arm.service")
        sh("sed -i 's/^rate_hz.*/rate_hz = 10/' /etc/armd/CAN-0001/armd.toml")
    if (PAYLOAD / "broken").exists():
        broken = f"[Service]\nExecStart=\nExecStart=python3 {PAYLOAD}/guest/broken_daemon.py\n"
        (units / f"{UNIT}.d/broken.conf").write_text(broken)
    sh("systemctl enable arm.service cable.service listener.service")


def the_configuration_holds() -> None:
    sh(
        "armd check /etc/armd/armd.toml /etc/armd/arm.toml /etc/armd/calibration.json "
        "/etc/armd/CAN-0001/armd.toml"
    )


CHECKS = [
    installs_from_a_wheelhouse,
    installing_twice_changes_nothing,
    has_a_user_of_its_own,
    gives_least_permission,
    waits_for_a_configuration,
    takes_the_configuration,
    the_configuration_holds,
]
