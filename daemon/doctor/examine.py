"""Examine one port: whether it can be opened, and which device answers."""

from __future__ import annotations

import errno
import termios
import time
from pathlib import Path

from cobs import cobs

from armd.daemon.doctor.device import may_be_a_port
from armd.daemon.doctor.finding import PortReport
from armd.daemon.doctor.line import Line
from armd.daemon.doctor.machine import ThisMachine
from armd.daemon.doctor.servos import find_servos
from armd.drivers.microscribe import wire as microscribe
from armd.drivers.serial import wire as serial_wire

OWN_BAUDS = (2_000_000, 1_000_000, 921_600, 115_200)
HELLO_S = 0.25
SYNC_EVERY_S, SYNC_S, GREETING_S = 0.03, 0.4, 0.3


def diagnose_port(port: str, machine: ThisMachine) -> PortReport:
    """Return the devices and the obstacles on *port*; nothing is changed."""
    report = PortReport(port)
    if not (may_be_a_port(Path(port), report) and machine.examine(Path(port), report)):
        return report
    try:
        line = Line(port, OWN_BAUDS[0])
    except (OSError, ValueError, termios.error) as error:
        if getattr(error, "errno", None) in (errno.EAGAIN, errno.EBUSY):
            text = f"another program has {port} open, an `armd run` perhaps"
            report.find("port_held", text, f"sudo fuser -v {port} names it: end it")
        else:
            report.find("port", f"{port} cannot be opened: {error}", f"ls -l {port}")
        return report
    try:
        with line:
            if not (
                _examine_own_wire(line, report)
                or find_servos(line, report)
                or _examine_scribe(line, report)
            ):
                _report_nobody(line, report)
    except (OSError, termios.error) as error:
        text = f"{port} went away while it was asked: {error}"
        report.find("gone", text, "check the plug, the cable and the supply; then ask again")
    return report


def _report_nobody(line: Line, report: PortReport) -> None:
    port, remarks = report.name, ""
    mend = "switch the arm's supply on, check the cable and that the adapter is a bus adapter"
    if line.is_pseudo:
        remarks += "; it is a pseudo-terminal"
        mend = "start the program that is to speak at its other end, `armd simulate` perhaps"
    if line.echoes:
        remarks += "; the adapter hears what it says, so it works as far as the plug"
    elif line.heard_bytes:
        remarks += f"; {line.heard_bytes} bytes of something else came: another device?"
    report.find(
        "no_answer",
        "nobody answers: no servo (Feetech, Dynamixel 2.0), no MicroScribe, no arm that speaks"
        f" armd's own wire{remarks}",
        f"{mend}; then `armd doctor --port {port}` again",
    )


def _examine_own_wire(line: Line, report: PortReport) -> bool:
    """Look for an arm with armd's own protocol; return whether one is there.

    Such an arm streams without a request, and identifies itself on request.
    """
    for baud in OWN_BAUDS:
        if not line.set_baud(baud):
            continue
        splitter, deadline = serial_wire.CobsSplitter(), time.monotonic() + HELLO_S
        line.send(serial_wire.encode_identify())
        while heard := line.hear(deadline - time.monotonic()):
            for packet in splitter.push(heard):
                hello = _decode_hello(packet)
                if hello is not None:
                    report.protocol, report.baud = "serial", baud
                    report.say(
                        f"arm {hello.serial_number} at {baud} baud: {hello.n_joints} joints, "
                        f"{hello.n_sensors} sensors, {hello.rate_hz} samples a second"
                    )
                    return True
            if time.monotonic() > deadline:
                break
    return False


def _decode_hello(packet: bytes) -> serial_wire.Hello | None:
    try:
        data = serial_wire.unpack(packet)
    except cobs.DecodeError:
        return None
    if data is None or data[0] != serial_wire.Type.HELLO:
        return None
    return serial_wire.decode_hello(data)


def _examine_scribe(line: Line, report: PortReport) -> bool:
    for baud in microscribe.BAUDS:
        if line.set_baud(baud) and _greets(line):
            report.protocol, report.baud = "microscribe", baud
            report.say(
                f"a MicroScribe at {baud} baud; `armd arm microscribe --port {report.name} "
                "-o arm.toml` reads its geometry"
            )
            return True
    return False


def _greets(line: Line) -> bool:
    """Return whether a MicroScribe begins a session; end it, so that the next one may begin.

    The greeting differs from the request, so an adapter with an echo is not taken for a
    MicroScribe.
    """
    line.send(bytes([microscribe.END]))
    line.hear(0.015)
    deadline, synchronous = time.monotonic() + SYNC_S, False
    while not synchronous and time.monotonic() < deadline:
        line.send(microscribe.SYNC)
        synchronous = line.hears(microscribe.SYNC, SYNC_EVERY_S)
    if not synchronous:
        return False
    line.send(microscribe.BEGIN)
    greets = line.hears(microscribe.GREETING, GREETING_S)
    line.send(bytes([microscribe.END]))
    return greets
