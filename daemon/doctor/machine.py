"""This machine's part of a port: permission, processes that hold it, latency."""

from __future__ import annotations

import grp
import os
import pwd
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path

from armd.daemon.doctor.finding import PortReport

#: Setting of USB serial chips whose driver delays bytes, by 16 ms as a default.
TIMER = "bus/usb-serial/devices/{name}/latency_timer"
MODEM_MANAGER = "ModemManager"


@dataclass(frozen=True)
class ThisMachine:
    """The machine's folders with information about ports; tests use other folders."""

    sys: Path = Path("/sys")
    proc: Path = Path("/proc")
    uid: int = field(default_factory=os.geteuid)
    groups: Collection[int] = field(default_factory=lambda: {os.getegid(), *os.getgroups()})

    def examine(self, port: Path, report: PortReport) -> bool:
        """Examine *port*, which exists, and return whether it can be opened.

        Facts and findings go to *report*.
        """
        device = port.resolve()
        if device != port:
            report.say(f"is {device}")
        return (
            self._permission(device, report)
            & self._latency(device, report)
            & self._holders(device, report)
        )

    def _permission(self, device: Path, report: PortReport) -> bool:
        status = device.stat()
        owner_bits = status.st_mode >> (
            6 if self.uid == status.st_uid else 3 if status.st_gid in self.groups else 0
        )
        if self.uid == 0 or owner_bits & 6 == 6:
            return True
        user, group = _name_user(self.uid), _name_group(status.st_gid)
        mend = f"sudo usermod -aG {group} {user}, then log out and in again"
        if user in _list_members(status.st_gid):
            mend = f"log out and in again: {user} is in {group}, this session is not yet"
        text = f"{user} may not read and write {device}, which belongs to group {group}"
        report.find("permission", text, mend)
        return False

    def _latency(self, device: Path, report: PortReport) -> bool:
        timer = self.sys / TIMER.format(name=device.name)
        try:
            milliseconds = int(timer.read_text())
        except (OSError, ValueError):
            return True  # a CDC-ACM adapter or a pty has no such timer
        report.say(f"latency timer {milliseconds} ms")
        if milliseconds > 1:
            text = f"the adapter holds bytes back for up to {milliseconds} ms (latency timer)"
            rule = 'ACTION=="add", SUBSYSTEM=="usb-serial", ATTR{latency_timer}="1"'
            report.find(
                "latency_timer",
                text,
                f"echo 1 | sudo tee {timer}; for good: echo '{rule}' | "
                "sudo tee /etc/udev/rules.d/99-latency-timer.rules",
            )
        return True

    def _holders(self, device: Path, report: PortReport) -> bool:
        if device.parent.name == "pts":  # the process at the other end of a pty holds this end, too
            return True
        is_held = False
        for process in self.proc.glob("[0-9]*"):
            if process.name == str(os.getpid()):
                continue
            try:
                links = [fd.readlink() for fd in (process / "fd").iterdir()]
                name = (process / "comm").read_text().strip()
            except OSError:
                continue  # the process has ended, or may not be inspected
            if name == MODEM_MANAGER:
                report.say("ModemManager runs; it tries every new serial port for a modem")
            if device not in links:
                continue
            is_held = True
            if name == MODEM_MANAGER:
                mend = "sudo systemctl disable --now ModemManager"
                report.find("modem_manager", f"ModemManager holds {device}", mend)
            else:
                text = f"{name} (process {process.name}) holds {device}"
                report.find("port_held", text, f"end it: kill {process.name}")
        return not is_held


def list_can_buses(sys: Path = Path("/sys")) -> list[PortReport]:
    """List the CAN interfaces of this machine."""
    reports = []
    for interface in sorted((sys / "class/net").glob("*")):
        try:
            if int((interface / "type").read_text()) != 280:  # ARPHRD_CAN
                continue
            up = int((interface / "flags").read_text(), 16) & 1
        except (OSError, ValueError):
            continue
        report = PortReport(interface.name)
        report.say("a CAN bus, up" if up else "a CAN bus")
        if not up:
            mend = f"sudo ip link set {interface.name} up type can bitrate 1000000"
            report.find("bus_down", f"{interface.name} is down", mend)
        reports.append(report)
    return reports


def _name_user(uid: int) -> str:
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return str(uid)


def _name_group(gid: int) -> str:
    try:
        return grp.getgrgid(gid).gr_name
    except KeyError:
        return str(gid)


def _list_members(gid: int) -> list[str]:
    try:
        return grp.getgrgid(gid).gr_mem
    except KeyError:
        return []
