"""Find servos on a line: their ids and rate, their properties, the cycle rate."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from armd.daemon.doctor.finding import PortReport
from armd.daemon.doctor.line import Line
from armd.drivers.poll.protocol import dynamixel, feetech
from armd.drivers.poll.protocol.families import FAMILIES
from armd.drivers.poll.protocol.family import Family, Servo, find_model_name
from armd.drivers.poll.protocol.packet import Status
from armd.drivers.poll.protocol.rates import BAUDS

#: Likely ids are pinged at every rate; where one answers, all ids are pinged.
LIKELY_IDS, ALL_IDS, NOBODY = range(1, 17), range(253), 253
#: A servo answers within 0.5 ms; an adapter may delay that by 16 ms, and a simulated servo longer.
ANSWER_S = 0.025
RATE_S = 0.5
SLOW_US = 100  # a longer return delay takes more time than the answer itself


def find_servos(line: Line, report: PortReport) -> bool:
    """Look for servos of all kinds at all rates; return whether there are some."""
    line.detect_echo(feetech.make_ping(NOBODY))
    pinged: set[int] = set()  # rates with Feetech's ping, the same as Dynamixel 1.0's
    for kind, bauds in BAUDS.items():
        for baud in bauds:
            if (kind != "dynamixel" and baud in pinged) or not line.set_baud(baud):
                continue
            if kind != "dynamixel":
                pinged.add(baud)
            family = FAMILIES[kind]
            likely = _answering(line, family, LIKELY_IDS, ANSWER_S)
            if likely:
                unlikely_ids = [i for i in ALL_IDS if i not in LIKELY_IDS]
                wait_s = min(ANSWER_S, max(3 * likely[min(likely)], 0.003))
                ids = sorted([*likely, *_answering(line, family, unlikely_ids, wait_s)])
                if kind != "dynamixel":
                    family = _distinguish(line, ids)
                report.protocol, report.baud = family.name, baud
                _examine(line, family, ids, report)
                return True
    return False


def _answering(line: Line, family: Family, ids: Iterable[int], wait_s: float) -> dict[int, float]:
    """Return the ids that answer a ping, and the seconds until each answer."""
    ping = dynamixel.make_ping if family.name == "dynamixel" else feetech.make_ping
    answer_s = {}
    for servo in ids:
        began = time.monotonic()
        packets = line.ask(family, ping(servo), [servo], wait_s)
        if packets:
            answer_s[servo] = time.monotonic() - began
    return answer_s


def _distinguish(line: Line, ids: Sequence[int]) -> Family:
    """Distinguish Feetech's servos from those of Dynamixel's protocol 1.0.

    Their packets are the same. A known model and the id are in the registers of one or of the
    other.
    """
    old = FAMILIES["dynamixel1"]
    for servo in ids:
        data = read(line, old, servo, 0, old.identity_bytes)
        if data is not None:
            is_old = old.identity(data).model in old.models and data[old.id_register] == servo
            return old if is_old else FAMILIES["feetech"]
    return FAMILIES["feetech"]


def _examine(line: Line, family: Family, ids: Sequence[int], report: PortReport) -> None:
    report.say(f"{family.name} servos at {line.baud} baud: ids {', '.join(map(str, ids))}")
    if line.echoes:
        report.say("the adapter hears what it says, and armd passes over that")
    servos = {}
    for i in ids:
        data = read(line, family, i, 0, family.identity_bytes)
        if data is not None:
            servos[i] = family.identity(data)
    report.servos = [{"id": i} | servo.as_json() for i, servo in servos.items()]
    for i, servo in servos.items():
        report.say(
            f"servo {i}: {find_model_name(servo.model, family.models)}, firmware {servo.firmware}, "
            f"homing offset {servo.homing_offset}, return delay {servo.return_delay_us} µs, "
            f"torque {'on' if servo.torque else 'off'}"
        )
    _report_missing(line, family, ids, report)
    for i in ids:
        if i not in servos:
            text = f"servo {i} answers a ping, but not what it is"
            report.find("unreadable", text, "check its cable, and that no id is there twice")
    _judge(servos, family, report)
    readable = {i for i, servo in servos.items() if not family.refusal(servo)}
    _measure_rate(line, family, ids, readable, report)


def read(line: Line, family: Family, servo: int, address: int, length: int) -> bytes | None:
    """Read registers of one servo; use a sync read where a read is not answered.

    Returns None without an answer.
    """
    for request in (
        family.read(servo, address, length),
        family.sync_read([servo], address, length),
    ) * 2:
        for packet in line.ask(family, request, [servo], ANSWER_S + 10 * length / line.baud):
            for status in family.statuses(packet, length):
                if status.id == servo and _select_complete(family, [status], length):
                    return status.data
    return None


def _report_missing(line: Line, family: Family, ids: Sequence[int], report: PortReport) -> None:
    """Report gaps in the row of ids; look for such servos at other rates."""
    baud = line.baud
    first = min(ids) if min(ids) > 10 else 1  # some makers start at 11
    missing = [i for i in range(first, max(ids)) if i not in ids]
    for other_baud in BAUDS[family.name]:
        if other_baud == baud or not missing or not line.set_baud(other_baud):
            continue
        for servo in _answering(line, family, missing, ANSWER_S):
            missing.remove(servo)
            text = f"servo {servo} answers at {other_baud} baud, the others at {baud}"
            report.find("other_baud", text, f"set its rate to {baud} with the maker's tool")
    line.set_baud(baud)
    if missing:
        verb = "do" if len(missing) > 1 else "does"
        report.find(
            "missing_id",
            f"{_ids(missing)} {verb} not answer, and {max(ids)} is the last that does",
            "check the cable before it and its power; a servo with the factory's id is set anew "
            "with the maker's tool or lerobot-setup-motors",
        )


def _judge(servos: dict[int, Servo], family: Family, report: PortReport) -> None:
    for i, servo in servos.items():
        if why := family.refusal(servo):
            mend = (
                "none: armd reads servos of the STS and SMS series, and Dynamixels of the X, MX, "
                "AX, RX and DX series"
            )
            report.find("servo_refused", f"servo {i}: {why}", mend)
    by_model: dict[int, Counter[str]] = {}
    for servo in servos.values():
        by_model.setdefault(servo.model, Counter())[servo.firmware] += 1
    for model, firmwares in by_model.items():
        if len(firmwares) > 1:
            usual = firmwares.most_common(1)[0][0]
            mismatches = [
                f"servo {i} has {servo.firmware}"
                for i, servo in servos.items()
                if servo.model == model and servo.firmware != usual
            ]
            text = f"mixed {family.register('firmware')}: {', '.join(mismatches)}, the other "
            text += f"{find_model_name(model, family.models)} {usual}"
            report.find(
                "mixed_firmware", text, f"bring all to one version with {TOOL[family.name]}"
            )
    on = [i for i, servo in servos.items() if servo.torque]
    if on:
        text = f"{family.register('torque')} is on at {_ids(on)}: it holds the joint, or pushes it"
        mend = "torque_off = true under [driver] of armd.toml, or switch the supply off and on"
        report.find("torque_on", text, mend)
    slow = {i: s.return_delay_us for i, s in servos.items() if s.return_delay_us > SLOW_US}
    if slow:
        lost_ms = sum(slow.values()) / 1000
        waits = "wait" if len(slow) > 1 else "waits"
        text = f"{_ids(list(slow))} {waits} {max(slow.values())} µs before each answer: "
        text += f"{lost_ms:.1f} ms a cycle"
        mend = "return_delay_us = 0 under [driver] of armd.toml, and armd run"
        report.find("return_delay", text, mend)


def _measure_rate(
    line: Line, family: Family, ids: Sequence[int], readable: set[int], report: PortReport
) -> None:
    """Measure cycles a second of position and temperature, with the driver's requests.

    *readable*: servos that have answered a single read.
    """
    single_ids = [[servo] for servo in ids]
    cycles = _measure(line, family, [ids] if family.has_sync else single_ids)
    only_alone = [servo for servo in ids if servo in readable and not cycles.answered[servo]]
    how = "" if family.has_sync else ", read one by one"
    if only_alone and family.has_sync:  # the driver then reads all one by one
        cycles, how = _measure(line, family, single_ids), ", read one by one"
    report.rate_hz = round(cycles.rate_hz, 1)
    report.say(
        f"{cycles.rate_hz:.0f} whole cycles a second of {len(ids)} servos{how}, position and "
        f"temperature; the line alone would allow {1 / cycles.line_s:.0f}"
    )
    if only_alone and family.has_sync:
        pronoun = "each of them" if len(only_alone) > 1 else "it"
        text = f"{_ids(only_alone)}: no answer to a sync read, though {pronoun} answers when asked"
        text += " alone: not the cable, but the firmware or the adapter; armd reads the servos of"
        text += f" this line one by one, {cycles.rate_hz:.0f} cycles a second"
        mend = f"update the firmware with {TOOL[family.name]}, or try another adapter"
        report.find("no_sync_read", text, mend)
    for servo in ids:
        if cycles.answered[servo] < 0.95 * cycles.n:
            text = f"servo {servo} answered {cycles.answered[servo]} of {cycles.n} cycles"
            report.find("lost_answers", text, "check its cable and its supply voltage")
    for servo, error in sorted(cycles.alerts.items()):
        bits: bytes | None = bytes([error])
        if family.alarm is not None:
            bits = read(line, family, servo, family.alarm, 1)
        words = family.complaints(bits[0]) if bits else "something that it does not name"
        mend = "remove its cause (load, heat, supply), then switch the supply off and on"
        report.find("servo_alert", f"servo {servo} complains of: {words}", mend)


@dataclass
class _Cycles:
    """The result of requesting cycles for some time."""

    line_s: float  # duration of a cycle on the line
    n: int = 0
    rate_hz: float = 0.0  # of complete cycles
    answered: Counter[int] = field(default_factory=Counter)  # cycles, by servo
    alerts: dict[int, int] = field(default_factory=dict)  # error bytes


def _measure(line: Line, family: Family, parts: Sequence[Sequence[int]]) -> _Cycles:
    """Request cycles of *parts*, the ids of one request each: a sync read, or a read of one."""
    length, span = family.warm_bytes, (family.position, family.warm_bytes)
    is_sync = len(parts) == 1 and family.has_sync
    requests = [
        family.sync_read(ids, *span) if is_sync else family.read(ids[0], *span) for ids in parts
    ]
    bytes_each = len(feetech.make_status(1, 0, bytes(length)))
    if family.name == "dynamixel":
        bytes_each = dynamixel.compute_status_size(length)
    part_s = [
        10 * (len(request) + len(ids) * bytes_each) / line.baud
        for ids, request in zip(parts, requests, strict=True)
    ]
    cycles, complete_cycles, began = _Cycles(sum(part_s)), 0, time.monotonic()
    everyone = {servo for ids in parts for servo in ids}
    while time.monotonic() - began < RATE_S:
        heard: set[int] = set()
        for ids, request, line_s in zip(parts, requests, part_s, strict=True):
            for packet in line.ask(family, request, ids, line_s + ANSWER_S):
                for status in _select_complete(family, family.statuses(packet, length), length):
                    heard.add(status.id)
                    if family.alerts(status.error):
                        cycles.alerts[status.id] = status.error
        cycles.answered.update(heard)
        complete_cycles += heard >= everyone
        cycles.n += 1
    cycles.rate_hz = complete_cycles / (time.monotonic() - began)
    return cycles


def _select_complete(family: Family, statuses: list[Status], length: int) -> list[Status]:
    return [s for s in statuses if len(s.data) == length and not family.refuses(s.error)]


def _ids(ids: Sequence[int]) -> str:
    """Return the servos' names, with runs of three and more as 7 to 19."""
    runs: list[list[int]] = []
    for i in sorted(ids):
        if runs and i == runs[-1][-1] + 1:
            runs[-1].append(i)
        else:
            runs.append([i])
    words = [[f"{r[0]} to {r[-1]}"] if len(r) > 2 else [str(i) for i in r] for r in runs]
    return f"servo{'s' * (len(ids) > 1)} {', '.join(word for run in words for word in run)}"


WIZARD = "ROBOTIS's DYNAMIXEL Wizard"
TOOL = {"feetech": "Feetech's FD", "dynamixel": WIZARD, "dynamixel1": WIZARD}
