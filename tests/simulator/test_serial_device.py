"""The simulated arm on its pty, read by a bare reader: what leaves is what its truth log says."""

from __future__ import annotations

import os
import select
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from cobs import cobs

from armd.drivers.serial import wire
from armd.simulator.live.electronics import COUNTS_PER_TURN
from armd.simulator.live.faults import FAULTS
from support.program import run_armd
from support.simulated_arm import SimulatedArm, simulated_arm

SCENARIO = """
schema = "armd.scenario/1"
seed = 3
fault = [
    { name = "corrupted_byte", at_s = 0.6 },
    { name = "truncated_packet", at_s = 0.8 },
    { name = "lost_samples", at_s = 1.0, duration_s = 0.02 },
    { name = "repeated_packet", at_s = 1.2 },
    { name = "joint_invalid", at_s = 1.4, duration_s = 0.1, joint = 3 },
    { name = "count_jump", at_s = 1.6, joint = 5, amount = 2000000 },
    { name = "silence", at_s = 1.8, duration_s = 0.3 },
    { name = "sensor_open", at_s = 2.3, duration_s = 0.6, channel = 4 },
    { name = "temperature_step", at_s = 3.0, duration_s = 0.6, channel = 1, amount = -7.5 },
    { name = "sensor_silent", at_s = 3.8, duration_s = 1.2 },
    { name = "unplug", at_s = 5.2, duration_s = 0.4 },
    { name = "reboot", at_s = 6.0, duration_s = 0.3 },
]
"""


@dataclass
class Heard:
    """Everything a reader got, in order, with the host's time of each packet."""

    samples: list[np.void] = field(default_factory=list)
    temperatures: list[wire.TemperatureReading] = field(default_factory=list)
    hellos: list[wire.Hello] = field(default_factory=list)
    pongs: list[tuple[wire.Pong, int]] = field(default_factory=list)
    bad: int = 0

    def packet(self, packet: bytes, at_ns: int) -> None:
        try:
            data = wire.unpack(packet)
        except cobs.DecodeError:
            data = None
        if data is None:
            self.bad += 1
        elif data[0] == wire.Type.SAMPLE:
            self.samples.append(wire.decode_samples([data], 6)[0])
        elif data[0] == wire.Type.TEMPERATURE:
            self.temperatures.append(wire.decode_temperature(data))
        elif data[0] == wire.Type.HELLO:
            self.hellos.append(wire.decode_hello(data))
        elif data[0] == wire.Type.PONG:
            self.pongs.append((wire.decode_pong(data), at_ns))

    @property
    def seq(self) -> np.ndarray:
        """As published: a counter that falls is a new epoch."""
        low = np.array([sample["seq"] for sample in self.samples], dtype=np.int64)
        return low + (np.cumsum(np.diff(low, prepend=0) < 0) << 32)


def listen(arm: SimulatedArm, ask: bytes = b"", ask_every_s: float = 0.1) -> Heard:
    """Read until the simulator has ended, opening the port again whenever it is gone.

    Packets are decoded afterwards, so that a busy machine's reader keeps up.
    """
    arrived: list[tuple[bytes, int]] = []  # no bytes: the port went
    port = -1
    next_ask = 0.0
    while True:
        if port < 0:
            try:
                port = os.open(arm.port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            except OSError:
                if arm.process.poll() is not None:
                    return decode(arrived)
                time.sleep(0.01)
                continue
        if ask and time.monotonic() >= next_ask:
            os.write(port, ask)
            next_ask = time.monotonic() + ask_every_s
        try:
            ready, _, _ = select.select([port], [], [], 0.05)
            data = os.read(port, 65536) if ready else None
        except OSError:
            data = b""
        if data is not None:
            arrived.append((data, time.monotonic_ns()))
        if data == b"":
            os.close(port)
            port = -1


def decode(arrived: list[tuple[bytes, int]]) -> Heard:
    heard = Heard()
    splitter = wire.CobsSplitter()
    for data, at_ns in arrived:
        if not data:
            splitter.reset()
        for packet in splitter.push(data):
            heard.packet(packet, at_ns)
    return heard


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[SimulatedArm, Heard]:
    folder = tmp_path_factory.mktemp("arm")
    (folder / "scenario.toml").write_text(SCENARIO)
    options = ("--scenario", str(folder / "scenario.toml"))
    with simulated_arm(folder, *options, seconds=7.0, link=True) as arm:
        heard = listen(arm)
        assert arm.wait() == 0
    return arm, heard


def at(arm: SimulatedArm, fault: str) -> tuple[int, int]:
    """First seq of a fault and first after it."""
    first, last = (
        next(line["seq"] for line in arm.events(event) if line["fault"] == fault)
        for event in ("begin", "end")
    )
    return first, last


@pytest.mark.slow
@pytest.mark.serial
def test_exactly_what_the_books_say_arrives(run: tuple[SimulatedArm, Heard]) -> None:
    arm, heard = run
    truth = arm.truth()["seq"].astype(np.int64)
    assert np.all(np.diff(truth) > 0)
    assert len(truth) == 7000 - 300  # nothing is latched while it reboots
    expected = sorted(set(truth.tolist()) - arm.withheld())
    got = heard.seq.tolist()
    repeated, _ = at(arm, "repeated_packet")
    assert got.count(repeated) == 2
    got.remove(repeated)
    # What is in the port's buffers when it is unplugged is lost too, as with any port.
    missing = sorted(set(expected) - set(got))
    assert not set(got) - set(expected)
    assert all(5100 < seq <= 5200 for seq in missing), missing
    assert got == sorted(got)


@pytest.mark.slow
def test_each_damage_costs_its_packets(run: tuple[SimulatedArm, Heard]) -> None:
    arm, heard = run
    lost = {}
    for line in arm.events("withheld"):
        count = line["last_seq"] - line["first_seq"] + 1
        lost[line["reason"]] = lost.get(line["reason"], 0) + count
    assert lost.pop("truncated_packet") == 2  # itself, and the one it ran into
    assert lost.pop("corrupted_byte") == 1
    assert lost.pop("lost_samples") == 20
    assert lost.pop("silence") == 300
    assert lost.pop("unplug") == 400
    assert set(lost) <= {"nobody reads"}  # which a starved reader brings about
    assert heard.bad >= 2


def test_joint_status_and_jump(run: tuple[SimulatedArm, Heard]) -> None:
    arm, heard = run
    seq = heard.seq
    status = np.array([sample["joint_status"] for sample in heard.samples])
    first, end = at(arm, "joint_invalid")
    assert np.array_equal(status != 0, (seq >= first) & (seq < end))
    assert set(status[status != 0]) == {1 << 2}
    counts = np.array([sample["count"] for sample in heard.samples], dtype=np.int64)
    jump = int(np.flatnonzero(seq == at(arm, "count_jump")[0])[0])
    steps = np.diff(counts[jump - 1 : jump + 2, 4])
    half = COUNTS_PER_TURN // 2
    steps = (steps + half) % COUNTS_PER_TURN - half
    assert abs(steps[0] - 2000000) < 50000
    assert abs(steps[1] + 2000000) < 50000
    assert np.all(counts < COUNTS_PER_TURN)


def test_sensors(run: tuple[SimulatedArm, Heard]) -> None:
    arm, heard = run
    first_boot = [t for t in heard.temperatures if t.t_us < 7e6][:-2]
    at_s = np.array([t.t_us for t in first_boot]) / 1e6
    celsius = np.array([t.celsius for t in first_boot])
    opened = (at_s >= 2.3) & (at_s < 2.9)
    assert opened.any() or arm.withheld("nobody reads")
    assert np.array_equal(np.isnan(celsius[:, 3]), opened)
    assert not np.isnan(np.delete(celsius, 3, axis=1)).any()
    stepped = (at_s >= 3.0) & (at_s < 3.6)
    assert stepped.any() or arm.withheld("nobody reads")
    assert np.all(np.abs(celsius[stepped, 0] - 12.5) < 0.2)
    assert np.all(np.abs(celsius[~stepped, 0] - 20.0) < 0.2)
    assert not np.any((at_s >= 3.8) & (at_s < 5.0))
    periods = np.diff(at_s[at_s < 1.8]) / 0.5
    assert periods == pytest.approx(np.rint(periods)) and (periods > 0.5).all()


def test_reboot_starts_counter_and_clock_anew(run: tuple[SimulatedArm, Heard]) -> None:
    arm, heard = run
    assert len({hello.boot_id for hello in heard.hellos}) == 2
    assert [line["boot_id"] for line in arm.events("boot")][-1] == heard.hellos[-1].boot_id
    second = [sample for sample, seq in zip(heard.samples, heard.seq, strict=True) if seq >> 32]
    seq = np.array([sample["seq"] for sample in second], dtype=np.int64)
    assert seq[0] < 1000 and (np.diff(seq) > 0).all()
    assert [sample["t_us"] for sample in second] == (1000 * seq).tolist()
    assert heard.hellos[-1].serial_number == "SIM-0001"
    assert heard.hellos[-1].bits == (23,) * 6


@pytest.mark.slow
def test_answers_with_its_clock(tmp_path: Path) -> None:
    ask = wire.encode_ping(77) + wire.encode_identify() + b"junk\0"
    with simulated_arm(tmp_path, "--serial-number", "OTHER-7", rate_hz=200, seconds=2) as arm:
        heard = listen(arm, ask)
        boot = arm.events("boot")[0]
    assert len(heard.pongs) >= 5
    assert len(heard.hellos) >= 5
    assert {hello.serial_number for hello in heard.hellos} == {"OTHER-7"}
    assert {hello.rate_hz for hello in heard.hellos} == {200}
    late_ns = []
    for pong, received_ns in heard.pongs:
        assert pong.nonce == 77
        late_ns.append(received_ns - boot["latch_monotonic_ns"] - pong.t_us * 1000 / (1 + 35e-6))
    assert min(late_ns) > -2000
    assert np.median(late_ns) < 1e9  # by its clock, and not by another's


@pytest.mark.slow
def test_drops_whole_packets_when_nobody_reads(tmp_path: Path) -> None:
    with simulated_arm(tmp_path, rate_hz=5000, seconds=4) as arm:
        time.sleep(1.5)
        heard = listen(arm)
    dropped = [line for line in arm.events("withheld") if line["reason"] == "nobody reads"]
    assert dropped
    truth = set(arm.truth()["seq"].tolist())
    assert len(truth) == 20000
    # What nobody has read half a second after the end goes with the port.
    seqs = heard.seq.tolist()  # made anew at each call
    sent = {seq for seq in truth - arm.withheld() if seq <= seqs[-1]}
    assert set(seqs) == sent and seqs[-1] > 1.5 * 5000
    assert heard.bad == 0


@pytest.mark.slow
def test_counter_wraps(tmp_path: Path) -> None:
    (tmp_path / "scenario.toml").write_text(f"first_seq = {(1 << 32) - 100}\n")
    with simulated_arm(tmp_path, "--scenario", str(tmp_path / "scenario.toml"), seconds=0.5) as arm:
        heard = listen(arm)
    truth = arm.truth()["seq"]
    assert truth[0] == (1 << 32) - 100
    assert truth[-1] == (1 << 32) + 399
    sent = sorted(set(truth.tolist()) - arm.withheld())
    assert heard.seq.tolist() == sent[: len(heard.seq)]  # its last are lost as the port goes
    assert len(heard.seq) > 100  # on both sides of the wrap


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--rate", "5001"], "rate_hz: found 5001, expected"),
        (["--fault", "flood@1"], "name: found 'flood', expected one of corrupted_byte"),
        (["--fault", "silence"], "--fault: found silence, expected NAME@SECONDS"),
        (["--scenario", "absent.toml"], "absent.toml: the file: found nothing"),
        (["--truth", "absent/truth.bin"], "absent: the folder: found nothing"),
    ],
)
def test_bad_usage_is_named(
    options: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    from armd.simulator.__main__ import main

    assert main(["--serial", *options]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert message in captured.err


@pytest.mark.slow
def test_armd_simulate_is_the_simulator() -> None:
    """Its own help, its own exit codes, also through `armd`."""
    shown = run_armd("simulate", "--help")
    assert shown.returncode == 0
    assert shown.stdout.startswith("usage: armd simulate")
    wrong = run_armd("simulate", "--serial", "--rate", "0")
    assert wrong.returncode == 2
    assert wrong.stderr.startswith("armd: command line: rate_hz: found 0, expected")


def test_help_lists_every_fault(capsys: pytest.CaptureFixture[str]) -> None:
    from armd.simulator.__main__ import main

    with pytest.raises(SystemExit):
        main(["--help"])
    printed = capsys.readouterr().out
    assert all(f"  {name}" in printed for name in FAULTS)
