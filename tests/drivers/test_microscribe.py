"""MicroScribe: the codec against captured bytes, and the driver against the simulated arm."""

from __future__ import annotations

import os
import select
import threading
from contextlib import closing
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armd.compensation.model.arm import load_arm
from armd.compensation.model.kinematics import compute_pose
from armd.daemon import cli
from armd.drivers.config import MicroScribeConfig
from armd.drivers.identity import Expectation
from armd.drivers.microscribe import wire
from armd.drivers.microscribe.conversation import Conversation, Phase
from armd.drivers.microscribe.decoder import MicroScribeDecoder
from armd.drivers.microscribe.geometry import compute_rows_and_tip
from armd.drivers.microscribe.homing import Homing
from armd.drivers.sample import Event, Item, RawFrame
from armd.drivers.table import open_driver
from armd.simulator.__main__ import main as simulate
from armd.simulator.microscribe.arm import compute_tip_mm
from support.microscribe import (
    EXPECTED,
    PARAMETERS,
    TURNS,
    held_against_truth,
    nominal,
    read_until_end,
)
from support.pty_link import open_line
from support.punctuality import Punctuality
from support.sampled import events_of, rows_of
from support.simulated_arm import simulated_arm

# As captured from the arm with serial number 40937; the replies in DanielBetancourt1's notes.
POSE = bytes.fromhex("8300 6C4F 305E 3554 2002 1879 4160")
MAXIMA = bytes.fromhex("C6 03 3FFF 000000000000000000 3FFF 3FFF 1FFF 0FFF 0FFF 0000")
S = 1_000_000_000

#: The table of the facts: d, a, α, β
ROWS = (
    (210.82, 24.384, 89.939575195, 0),
    (-22.3012, 260.5024, -0.038452148, 0.016479492),
    (-0.0762, 13.5382, 89.851684570, 0),
    (234.7976, -10.1854, -89.989013672, 0),
    (8.128, 10.1346, -89.934082031, 0),
)


# --- the wire --------------------------------------------------------------------------------


def test_a_captured_pose() -> None:
    packet, rest = wire.take(0x03, b"\x12\x34" + POSE + b"\x83")
    assert packet == POSE and rest == b"\x83"
    reading = wire.decode_standard(packet)
    assert reading.counts == (13903, 6238, 6868, 4098, 3193, 8416)
    assert reading.buttons == 0 and reading.ticks is None
    # In that client's emulator it follows the acknowledgement of CF, the arm's own streaming.
    assert wire.take(0x03, b"\xcf" + POSE) == (POSE, b"")


def test_the_sizes_of_replies() -> None:
    sizes = {0x03: 14, 0x23: 16, 0x21: 14, 0x22: 18, 0x0F: 2 + 9 + 12}
    assert {command: wire.get_standard_size(command) for command in sizes} == sizes


@given(
    st.sampled_from([0x01, 0x03, 0x21, 0x23, 0x22, 0x2F]),
    st.integers(0, 127),
    st.integers(0, 0x3FFF),
    st.lists(st.integers(0, 0x3FFF), min_size=5, max_size=7),
    st.binary(max_size=30),
)
def test_a_reply_is_found_behind_junk(
    command: int, buttons: int, ticks: int, counts: list[int], junk: bytes
) -> None:
    junk = junk.replace(bytes([command | 0x80]), b"")
    packet = wire.encode_standard(command, wire.StandardReply(buttons, ticks, tuple(counts)))
    found, rest = wire.take(command, junk + packet + b"\x01")
    assert found == packet and rest == b"\x01"
    reading = wire.decode_standard(packet)
    asked = {1: 5, 3: 6, 2: 7}[command & 3]
    assert reading.counts[: len(counts)] == tuple(counts)[:asked]
    assert reading.buttons == buttons
    assert reading.ticks == (ticks if command & 0x20 else None)
    for cut in range(len(packet)):
        assert wire.take(command, packet[:cut])[0] is None


@pytest.mark.parametrize("at", range(1, 15))
def test_a_reply_with_a_byte_too_many_is_not_believed(at: int) -> None:
    """Inserted on the line, anywhere: what follows it has moved by a byte."""
    conversation = Conversation()
    conversation.phase = Phase.POLL
    good = wire.encode_standard(0x21, wire.StandardReply(0, 77, (13903, 6238, 6868, 4098, 3193)))

    def asked(reply: bytes) -> list[bytes]:
        assert not list(conversation.sent(RawFrame(0, 0, "tx", b"\x21")))
        return [packet for packet, _ in conversation.received(RawFrame(1, 1, "rx", reply))]

    assert asked(good) == [good]
    assert asked(good[:at] + b"\x2a" + good[at:]) == [] and conversation.malformed == 1
    assert asked(good) == [good] and conversation.malformed == 1


def test_a_reply_cut_short_by_the_next_is_not_taken_for_one() -> None:
    packet, _ = wire.take(0x03, POSE[:9] + POSE)
    assert packet == POSE


def test_texts_end_with_zero_or_with_silence() -> None:
    assert wire.take(0xCB, b"\xcb40937\0\x83") == (b"\xcb40937\0", b"\x83")
    assert wire.take(0xCB, b"\xcb40937")[0] is None
    packet, _ = wire.take(0xCB, b"\xcb40937", complete=True)
    assert packet is not None and wire.decode_text(packet) == "40937"


def test_what_the_factory_wrote() -> None:
    packet, _ = wire.take(wire.MAXIMA, MAXIMA)
    assert packet is not None and wire.decode_counts_per_turn(packet) == TURNS
    block, _ = wire.take(wire.PARAMETERS, PARAMETERS)
    assert block is not None
    rows, tip = compute_rows_and_tip(wire.decode_words(block), 3)
    for row, expected in zip(rows, ROWS, strict=True):
        found = (row.d_mm, row.a_mm, row.alpha_deg, row.beta_deg)
        assert found == pytest.approx(expected, abs=1e-9)
    assert tip == pytest.approx((0, 0, -133.9596))
    assert compute_rows_and_tip(wire.decode_words(block), 3, ball=True)[1][2] == pytest.approx(
        -127.8128
    )


def test_geometry_in_another_form_is_refused() -> None:
    with pytest.raises(ValueError, match="17 parameters, not 18"):
        compute_rows_and_tip([0] * 17)
    with pytest.raises(ValueError, match="a base displaced by alpha 1 and A 0"):
        compute_rows_and_tip([1] + [0] * 17)


# --- homing ----------------------------------------------------------------------------------


def _press(homing: Homing, at_s: float, counts: tuple[int, ...] = (10,) * 5) -> str:
    homing.watch(counts, 0, round((at_s - 0.01) * S))
    return homing.watch(counts, 1, round(at_s * S))


def test_only_a_press_at_rest_asks_for_home() -> None:
    homing = Homing(TURNS)
    homing.watch((10,) * 5, 1, 0)  # held down since before: no press
    assert not homing.is_due(1)
    assert _press(homing, 0.3) == "it had not been at rest for 0.5 s"
    assert not homing.is_due(round(0.3 * S))
    assert _press(homing, 0.7) == "" and homing.is_due(round(0.8 * S))
    assert not homing.homed  # not before the arm has said so
    assert "moved" in homing.watch((40,) * 5, 1, round(0.9 * S))
    assert not homing.is_due(round(0.9 * S))


def test_home_that_is_not_acknowledged_is_given_up() -> None:
    homing = Homing(TURNS)
    homing.watch((4095,) * 5, 0, 0)
    assert _press(homing, 0.6, (0, 0, 0, 4095, 0)) == "it had not been at rest for 0.5 s"
    homing = Homing(TURNS)
    homing.watch((10,) * 5, 0, 0)
    assert _press(homing, 0.6, (11, 9, 10, 10, 10)) == ""  # a count of noise is rest
    assert "acknowledge" in homing.watch((10,) * 5, 0, round(1.2 * S))
    assert not homing.homed


# --- the driver and the simulated arm ----------------------------------------------------------


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(True, id="streamed"),
        pytest.param(False, id="asked", marks=pytest.mark.slow),
    ],
)
def run(
    request: pytest.FixtureRequest,
    tmp_path_factory: pytest.TempPathFactory,
    punctuality: Punctuality,
):
    folder = tmp_path_factory.mktemp("microscribe")
    MicroScribeDecoder(EXPECTED).warm_up()  # before the arm's seconds begin to run
    faults = ("--fault", "silence@5:0.7", "--fault", "reboot@7.5:0.3")
    with (
        punctuality.watch() as machine,
        simulated_arm(folder, *faults, wire=("--microscribe",), seconds=10.5) as arm,
    ):
        items, raw, counters = read_until_end(arm, stream=request.param)
    return arm, items, raw, counters, machine


def test_factory_rows_are_the_makers_chain() -> None:
    angles = np.random.default_rng(3).uniform(-np.pi, np.pi, (300, 5))
    ours = compute_pose(angles, nominal().nominal())[0]
    assert np.abs(ours - [compute_tip_mm(pose) for pose in angles]).max() < 1e-11
    captured = np.array([13903, 6238, 6868, 4098, 3193]) / TURNS * 2 * np.pi
    tip = compute_pose(captured[None], nominal().nominal())[0][0]
    assert tip == pytest.approx((54.19662, -51.84271, 212.20047), abs=1e-5)


def test_nothing_is_valid_before_the_press_and_the_truth_is_met_after_it(run) -> None:
    arm, items, raw, *_ = run
    rows = rows_of(items)
    homed_ns = next(i.monotonic_ns for i in items if isinstance(i, Event) and i.kind == "homed")
    before = rows[rows["monotonic_ns"] < homed_ns]
    assert len(before) > 100 and (before["joint_invalid"] == 0b11111).all()
    reboot_ns = arm.events("begin")[1]["monotonic_ns"]
    good = rows[(rows["monotonic_ns"] > homed_ns) & (rows["monotonic_ns"] < reboot_ns)]
    good = good[good["joint_invalid"] == 0]  # a starved machine may cost some
    assert len(good) > 100
    true_mm, error_mm, late_ms = held_against_truth(arm, good)
    assert np.ptp(true_mm, axis=0).max() > 50  # it was moved, and met the truth to its resolution
    assert error_mm.max() < 0.5 and np.sqrt((error_mm**2).mean()) < 0.25
    # Within its tick, where that was bounded by readings asked for.
    assert np.quantile(np.abs(late_ms), 0.25) < (1.111 + _turn_round_ms(raw)) / 2


def _turn_round_ms(raw: list[RawFrame]) -> float:
    """From a request for a reading to its reply's begin; a busy machine's are long."""
    took = [
        b.monotonic_ns - a.monotonic_ns
        for a, b in pairwise(raw)
        if a.data == b"\x21" and b.direction == "rx"
    ]
    return float(np.median(took)) / 1e6 - 15 * 10 / 115.2


def test_pedals_are_buttons(run) -> None:
    rows = rows_of(run[1])
    assert set(np.unique(rows["buttons"]).tolist()) == {0, 1, 2}


def test_a_silence_costs_its_cycles_and_a_restart_the_homing(run) -> None:
    arm, items, _, counters, machine = run
    rows, events = rows_of(items), events_of(items)
    # Once more each, where a machine stood still for longer than an arm is silent.
    assert events.count("identified") == events.count("not_homed") >= 2
    assert events.count("homed") == 1  # nobody presses a pedal at rest after the restart
    unrecovered = events.count("silence") - events.count("recovered")
    assert unrecovered in (0, 1) and events.count("silence") >= 2
    machine.judge_lost(unrecovered, "the end of the last silence")
    assert (np.diff(rows["seq"].astype(np.int64)) > 0).all()
    assert np.array_equal(rows["lost_before"][1:], np.diff(rows["seq"].astype(np.int64)) != 1)
    assert counters["samples"] == len(rows) and counters["lost"] > 0
    begin, end = arm.events("begin")[1], arm.events("end")[1]
    after = rows[rows["monotonic_ns"] > end["monotonic_ns"]]
    assert (after["joint_invalid"] == 0b11111).all()
    machine.judge_lost(max(0, 100 - len(after)), "rows after the restart")
    during = (rows["monotonic_ns"] > begin["monotonic_ns"] + 50_000_000) & (
        rows["monotonic_ns"] < end["monotonic_ns"]
    )
    machine.judge_lost(int(during.sum()), "rows read so late that the restart had begun")


def test_a_replay_gives_the_same_samples_bit_by_bit(run) -> None:
    _, items, raw, *_ = run
    decoder = MicroScribeDecoder(EXPECTED)
    again = [item for frame in raw for item in decoder.feed(frame)]
    assert np.array_equal(rows_of(again), rows_of(items))
    assert events_of(again) == [
        e for e in events_of(items) if e not in ("silence", "recovered", "unplugged")
    ]


def test_a_recording_begun_later_goes_on(run) -> None:
    _, items, raw, *_ = run
    first, fresh = MicroScribeDecoder(EXPECTED), MicroScribeDecoder(EXPECTED)
    at = next(i for i, f in enumerate(raw) if f.data == bytes([wire.HOME])) + 200
    for frame in raw[:at]:
        first.feed(frame)
    while raw[at].direction == "rx" and first.conversation.pending is not None:  # a request begins
        first.feed(raw[at])
        at += 1
    for frame in first.preamble():
        fresh.feed(frame)
    later = rows_of([item for frame in raw[at : at + 2000] for item in fresh.feed(frame)])
    rows = rows_of(items)
    same = rows[np.isin(rows["seq"], later["seq"])].copy()
    for part in (same, later):  # which turn a joint is in, a recording's begin does not tell
        part["count"] %= TURNS
    assert len(later) > 300
    assert np.array_equal(same, later)


@pytest.mark.slow
def test_the_baud_rate_is_found(tmp_path: Path) -> None:
    """And kept, once the fastest has been tried with the arm there."""
    with simulated_arm(tmp_path, "--baud", "57600", wire=("--microscribe",), seconds=5.0) as arm:
        items, _, _ = read_until_end(arm)
    assert rates_found(items) == [57600, 57600]
    assert len(rows_of(items)) > 100


@pytest.mark.slow
@pytest.mark.serial
def test_an_arm_that_is_switched_on_late_is_read_at_the_fastest_rate(tmp_path: Path) -> None:
    """It takes the rate at which it is first spoken to, and the slow ones are being tried then."""
    late = ("--fault", "silence@0:2.4")
    with simulated_arm(tmp_path, *late, wire=("--microscribe",), seconds=5.0) as arm:
        items, _, _ = read_until_end(arm)
    first, last = rates_found(items)
    assert first < last == 115200


def rates_found(items: list[Item]) -> list[int]:
    found = [i for i in items if isinstance(i, Event) and i.kind == "identified"]
    return [event.detail["baud"] for event in found]


@pytest.mark.slow
def test_a_foreign_arm_gives_no_sample(tmp_path: Path) -> None:
    other = Expectation("40938", 5, 0, TURNS)
    with simulated_arm(tmp_path, wire=("--microscribe",), seconds=2.0) as arm:
        config = MicroScribeConfig(kind="microscribe", port=arm.port)
        items: list[Item] = []
        with closing(open_driver(config, other)) as driver:
            while arm.process.poll() is None:
                items += driver.read(0.05)
            assert not driver.connected
    assert not [item for item in items if isinstance(item, np.ndarray)]
    assert "serial number: found 40937, expected 40938" in str(items)


# --- armd arm microscribe ------------------------------------------------------------------------


def test_the_factorys_geometry_becomes_an_arm_toml(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "arm.toml"
    with simulated_arm(tmp_path, wire=("--microscribe",), seconds=60.0) as arm:
        drawn = load_arm(path)  # by --arm-out
        path.unlink()
        command = ["arm", "microscribe", "--port", arm.port, "-o", str(path)]
        assert cli.main(command) == 0
        assert cli.main(command) == 0  # the same once more takes nothing away
        told = f"{tmp_path / 'armd.toml'}: left as it is; its [driver] for this arm:"
        assert f'{told}\n  kind = "microscribe"\n' in capsys.readouterr().out
        written = path.read_bytes()
        path.write_text("# mine\n")
        assert cli.main(command) == 2
        refused = f"armd: {path}: the file: found an arm.toml with another content, expected"
        assert capsys.readouterr().err.startswith(refused)
        assert path.read_text() == "# mine\n"
        assert cli.main([*command, "--force"]) == 0
        assert path.read_bytes() == written
        assert cli.main([*command[:-1], str(tmp_path / "none" / "arm.toml")]) == 2
        arm.stop()
    assert cli.main(["check", str(path), str(tmp_path / "armd.toml")]) == 0
    found = load_arm(path)
    assert found.joint == drawn.joint and found.tip == drawn.tip
    assert found.serial_number == drawn.serial_number == "40937"
    assert tuple(joint.counts_per_turn for joint in found.joint) == TURNS
    assert np.allclose(found.nominal(), nominal().nominal(), rtol=0, atol=1e-9)


def test_the_simulated_one_has_its_own_number(capsys: pytest.CaptureFixture[str]) -> None:
    assert simulate(["--microscribe", "--serial-number", "MINE"]) == 2
    assert "--serial-number: found MINE, expected none: it has its own" in capsys.readouterr().err


def test_an_arm_that_closes_no_text_and_has_no_extended_parameters(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A device of our own on a pty: it answers what the manual says, and nothing else."""
    answers = {
        b"IMMC": b"IMMC",
        b"BEGIN": b"MSCR\0",
        b"\xcb": b"\xcb123",
        b"\xca": b"\xcaG2",
        b"\xcc": b"\xccStandard",
        b"\xcd": b"\xcdFormat DH0.5",
        b"\xce": b"\xceHCI 2.0",
        b"\xc6": MAXIMA,
        b"\xc0": PARAMETERS,
    }
    stop = threading.Event()

    def serve() -> None:
        while not stop.is_set():
            if select.select([master], [], [], 0.05)[0]:
                heard = os.read(master, 100)
                for question, answer in answers.items():
                    if heard.endswith(question):
                        os.write(master, answer)

    with open_line() as (master, _, port):
        thread = threading.Thread(target=serve)
        thread.start()
        try:
            assert cli.main(["arm", "microscribe", "--port", port]) == 0
        finally:
            stop.set()
            thread.join()
    said = capsys.readouterr().out
    assert 'serial_number = "123"' in said and "beta_deg = 0.016" not in said


@pytest.mark.serial
def test_a_port_without_a_microscribe_is_told(
    capsys: pytest.CaptureFixture[str], punctuality: Punctuality
) -> None:
    with open_line() as (_, _, port), punctuality.limit(10.0, "armd arm microscribe gives up"):
        assert cli.main(["arm", "microscribe", "--port", port, "--baud", "115200"]) == 2
    assert 'found no answer, expected a MicroScribe that echoes "IMMC"' in capsys.readouterr().err
    assert cli.main(["arm", "microscribe", "--port", "/dev/nothing"]) == 2
