"""A small Debian with systemd and udev on a disk image, made of packages; it boots in seconds."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

from debian_packages import CACHE, sources, unpacked

PACKAGES = [
    *("systemd", "systemd-sysv", "udev", "dbus", "kmod", "procps", "iproute2"),
    *("python3", "python3-venv"),
]
#: What a machine without screen, seat or network needs not start.
MASKED = [
    *("getty@.service", "serial-getty@.service", "console-getty.service", "getty-static.service"),
    *("systemd-logind.service", "modprobe@.service", "proc-sys-fs-binfmt_misc.automount"),
    *("systemd-firstboot.service", "systemd-timesyncd.service", "e2scrub_reap.service"),
    *("apt-daily.timer", "apt-daily-upgrade.timer", "dpkg-db-backup.timer", "fstrim.timer"),
]
#: The subsystems whose devices, there before udev, it is told of: with them all a boot takes twice
#: as long. Behind pci, virtio and usb lies what qemu has.
TRIGGERED = ["block", "net", "pci", "virtio", "usb"]
#: Says that this machine can run programs at all, before anything depends on it.
HELLO = "armd-guest-runs"
#: Brings in the payload before anything else of the test starts.
PAYLOAD_UNIT = """\
[Unit]
DefaultDependencies=no
After=local-fs.target
Before=basic.target
[Service]
Type=oneshot
RemainAfterExit=yes
ExecStart=mount -o ro LABEL=payload /mnt
[Install]
WantedBy=sysinit.target
"""
#: The test is a service like any other; what it prints goes to the console and so to our caller.
TEST_UNIT = """\
[Service]
Type=exec
Environment=PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1
ExecStart=python3 /mnt/guest/main.py
ExecStopPost=systemctl --no-block --force poweroff
StandardOutput=journal+console
StandardError=journal+console
[Install]
WantedBy=multi-user.target
"""
_WITH_SBIN = {**os.environ, "PATH": f"{os.environ['PATH']}:/usr/sbin:/sbin"}
UNITS = {"payload.service": PAYLOAD_UNIT, "armd-system-test.service": TEST_UNIT}


def build_image(modules: Path) -> Path:
    """The image with the kernel *modules* (a folder named by the kernel's release) in it.

    Kept in the cache under a name made of everything it depends on.
    """
    recipe = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()[:12]
    image = CACHE / f"debian-{modules.name}-{recipe}.img"
    if image.exists():
        return image
    for old in CACHE.glob(f"debian-{modules.name}-*"):
        old.unlink()
    root = Path(tempfile.mkdtemp(dir=CACHE))
    root.chmod(0o755)
    _bootstrap(root)
    _prepare(root, modules)
    part = image.with_suffix(".part")
    make_filesystem(part, root, "root", "3000M")
    shutil.rmtree(root)
    part.rename(image)
    return image


def python_of(image: Path) -> str:
    """The version of the Python on an image, e.g. "3.11"."""
    ask = ["debugfs", "-R", "stat /usr/bin/python3", str(image)]
    answer = subprocess.run(ask, check=True, env=_WITH_SBIN, capture_output=True, text=True).stdout
    found = re.search(r'Fast link dest: "python([0-9.]+)"', answer)
    assert found, answer
    return found[1]


def make_filesystem(image: Path, content: Path, label: str, size: str) -> None:
    """An ext4 file system holding the folder *content*; its free space costs no disk."""
    image.unlink(missing_ok=True)
    make = ["mke2fs", "-q", "-t", "ext4", "-O", "^has_journal", "-m", "0", "-L", label]
    subprocess.run(
        [*make, "-d", content, image, size],
        check=True,
        env=_WITH_SBIN,
        stdout=subprocess.DEVNULL,
    )


def _bootstrap(root: Path) -> None:
    """Unpack and configure the packages under *root* with mmdebstrap."""
    tool = unpacked("user-mode-linux", "mmdebstrap") / "usr/bin/mmdebstrap"
    release = dict(
        line.split("=", 1) for line in Path("/etc/os-release").read_text().splitlines() if line
    )
    mode = "root" if os.geteuid() == 0 else "unshare"
    subprocess.run(
        [
            *("perl", tool, "--quiet", f"--mode={mode}", "--variant=apt"),
            *("--include=" + ",".join(PACKAGES), release["VERSION_CODENAME"], root, "-"),
        ],
        input=sources(),
        text=True,
        check=True,
    )


def _prepare(root: Path, modules: Path) -> None:
    """Make the fresh system boot fast, the same way every time, and run the test."""
    units = root / "etc/systemd/system"
    for unit in MASKED:
        _link(units / unit, "/dev/null")
    for name, text in UNITS.items():
        (units / name).write_text(text)
        wants = units / f"{text.split('WantedBy=')[1].strip()}.wants"
        wants.mkdir(exist_ok=True)
        _link(wants / name, f"../{name}")
    _link(units / "default.target", "/usr/lib/systemd/system/multi-user.target")
    trigger = units / "systemd-udev-trigger.service.d"
    trigger.mkdir()
    (trigger / "fast.conf").write_text(
        "[Service]\nExecStart=\nExecStart=-udevadm trigger --type=devices --action=add "
        + " ".join(f"--subsystem-match={subsystem}" for subsystem in TRIGGERED)
        + "\n"
    )
    hello = root / "sbin/hello"
    hello.write_text(f"#!/bin/sh\necho {HELLO}\n")
    hello.chmod(0o755)
    (root / "etc/fstab").write_text("/dev/root / ext4 defaults 0 0\n")
    (root / "etc/hostname").write_text("controller\n")
    (root / "etc/machine-id").write_text("0123456789abcdef0123456789abcdef\n")
    shutil.copytree(modules, root / "usr/lib/modules" / modules.name, symlinks=True)
    for folder in ("etc", "var"):
        (root / folder / ".updated").touch()


def _link(path: Path, target: str) -> None:
    path.unlink(missing_ok=True)
    path.symlink_to(target)
