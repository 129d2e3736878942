"""The udev rules on FTDI adapters in USB sockets, driven by the kernel's own ftdi_sio."""

from __future__ import annotations

from pathlib import Path

from controller import PAYLOAD, journal, sh, show, wait_for
from plug import Usb

ARM = Path("/dev/armd/SIM-0001")
AWAKE = Path("/dev/cpu_dma_latency")
FTDI_MS = "16"  # as a real adapter starts


def adapter(serial: str) -> str:
    """The name of the port of the adapter with this serial number, e.g. ttyUSB0; "" without."""
    for port in Path("/sys/bus/usb-serial/devices").glob("*"):
        if (port.resolve().parents[1] / "serial").read_text().strip() == serial:
            return port.name
    return ""


def latency_timer(serial: str) -> Path:
    return Path(f"/sys/class/tty/{adapter(serial)}/device/latency_timer")


def latency_ms(serial: str) -> str:
    return latency_timer(serial).read_text().strip()


def owner(path: Path | str) -> str:
    return sh(f"stat -L -c '%U:%G %a' {path}")


def adapters_come_without_the_rules() -> str:
    wait_for(lambda: bool(adapter("SIM-0001") and adapter("OTHER")), 60, "two adapters")
    sh("udevadm settle")
    for serial in ("SIM-0001", "OTHER"):  # qemu's adapters start with 0; they keep what is set
        latency_timer(serial).write_text(FTDI_MS)
    assert not ARM.exists()
    return f"{adapter('SIM-0001')} and {adapter('OTHER')}, {FTDI_MS} ms"


def udev_takes_the_rules() -> None:
    sh("groupadd --system armd && mkdir /etc/armd && touch /etc/armd/SIM-0001")
    sh(f"install -D -m 644 -t /usr/local/lib/udev/rules.d {PAYLOAD}/deploy/udev/*.rules")
    sh("udevadm control --reload")
    assert "-armd" not in journal("systemd-udevd"), journal("systemd-udevd")


def plugging_in_sends_at_once() -> str:
    Usb().put(False)
    assert not adapter("SIM-0001"), "still there when pulled"
    Usb().put(True)
    assert latency_ms("SIM-0001") == "1", latency_ms("SIM-0001")
    assert owner(ARM) == "root:armd 660", owner(ARM)
    properties = sh(f"udevadm info -q property {ARM}")
    assert "SYSTEMD_WANTS=armd.service" in properties, properties
    assert "ID_MM_DEVICE_IGNORE=1" in properties, properties
    return f"{ARM.resolve()}, {latency_ms('SIM-0001')} ms"


def installing_after_plugging_in_does_too() -> None:
    """What install.sh triggers, on an adapter that was there before the rules."""
    latency_timer("SIM-0001").write_text(FTDI_MS)
    sh("udevadm trigger --subsystem-match=tty --subsystem-match=usb-serial --action=add")
    sh("udevadm settle")
    assert latency_ms("SIM-0001") == "1"


def processors_may_be_kept_awake() -> str:
    """By the daemon's group too, unless the rule is masked."""
    trigger = "udevadm trigger --subsystem-match=misc --sysname-match=cpu_dma_latency --action=add"
    mask = "/etc/udev/rules.d/71-armd-awake.rules"
    sh(f"ln -s /dev/null {mask} && udevadm control --reload && {trigger} && udevadm settle")
    assert owner(AWAKE) == "root:root 600", owner(AWAKE)
    sh(f"rm {mask} && udevadm control --reload && {trigger} && udevadm settle")
    assert owner(AWAKE) == "root:armd 620", owner(AWAKE)
    return owner(AWAKE)


def a_driver_that_comes_after_the_service_is_no_hindrance() -> str:
    """The service's own device rules, while nothing has yet told the kernel of serial ports."""
    unit = (PAYLOAD / "deploy/armd.service").read_text().splitlines()
    rules = [line for line in unit if line.startswith("Device")]
    sh("modprobe -r ftdi_sio usbserial")
    assert "ttyUSB" not in Path("/proc/devices").read_text()
    opened = f"until [ -e {ARM} ]; do sleep 0.1; done; exec 3<>{ARM}"
    options = " ".join(f"--property='{rule}'" for rule in rules)
    sh(f"systemd-run --unit=late --remain-after-exit {options} sh -c '{opened}'")
    sh("modprobe ftdi_sio")
    wait_for(lambda: show("SubState", "late") in ("exited", "failed"), 60, "the opening")
    assert show("Result", "late") == "success", journal("late")
    return ", ".join(rules)


def another_adapter_is_left_alone() -> str:
    port = f"/dev/{adapter('OTHER')}"
    assert latency_ms("OTHER") == FTDI_MS, latency_ms("OTHER")
    assert owner(port) == "root:dialout 660", owner(port)
    assert "SYSTEMD_WANTS" not in sh(f"udevadm info -q property {port}")
    return port


CHECKS = [
    adapters_come_without_the_rules,
    udev_takes_the_rules,
    plugging_in_sends_at_once,
    installing_after_plugging_in_does_too,
    another_adapter_is_left_alone,
    processors_may_be_kept_awake,
    a_driver_that_comes_after_the_service_is_no_hindrance,
]
