"""Every fault of the wire, injected once into one run; what subscribers then see.

Contract section 9: exactly once, seq, flag 6, invalid, temperatures, clock, recovery, events.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armd import Flag
from support.punctuality import Machine, Punctuality
from support.running_daemon import Heard, running_daemon
from support.simulated_arm import SimulatedArm, simulated_arm

RATE_HZ = 500  # a whole kilohertz costs twice the processor time, and no fault is another for it
FIRST_S = 5.0  # clock mapped, temperatures known
LATEST_S = 1.0  # after its limit, on a busy machine, an event is still that fault's
FAULTS = {
    "corrupted_byte": 0.0,
    "truncated_packet": 0.3,
    "lost_samples": 0.6,
    "repeated_packet": 0.9,
    "joint_invalid": 1.2,  # 0.5 s
    "count_jump": 2.2,
    "sensor_open": 2.7,  # 1.5 s
    "sensor_silent": 4.7,  # 6.5 s: stale from 5 s on
    "silence": 6.5,  # 0.8 s
    "unplug": 8.5,  # 1 s
    "temperature_step": 12.0,  # 1.5 s
    "reboot": 14.0,  # 0.3 s
}
DURATION_S = {"sensor_open": 1.5, "sensor_silent": 6.5, "temperature_step": 1.5}
LOSSES = {"silence": "silence", "unplug": "unplugged"}  # as `recovered` names them
SECONDS = FIRST_S + 16.0


@dataclass
class Run:
    arm: SimulatedArm
    heard: Heard
    points: np.ndarray
    machine: Machine

    def seqs(self, fault: str) -> tuple[int, int]:
        """The first latch of a fault and the first one after it."""
        at = {
            (line["event"], line["fault"]): line["seq"]
            for line in self.arm.events()
            if "fault" in line
        }
        return at["begin", fault], at["end", fault]

    def during(self, fault: str, after_s: float = 0.0, longer_s: float = 0.0) -> np.ndarray:
        """Which points were latched during a fault, from a while after its begin until a while
        after its end."""
        begin, end = self.seqs(fault)
        seq = self.points["seq"].astype(np.int64)
        return (seq >= begin + RATE_HZ * after_s) & (seq < end + RATE_HZ * longer_s)

    def flagged(self, flag: Flag) -> np.ndarray:
        return (self.points["flags"] & flag) != 0

    def event_in(self, kind: str, fault: str, patience_s: float) -> dict[str, Any]:
        """The event of a kind that a fault caused; in time, by what the machine gave."""
        begin, end = (int(self.arm.latch_ns(seq)) for seq in self.seqs(fault))
        found = [
            event
            for event in self.heard.events(kind)
            if begin - 1e7 <= event["monotonic_ns"] <= end + (patience_s + LATEST_S) * 1e9
            and (kind != "recovered" or event["detail"]["fault"] == LOSSES[fault])
        ]
        assert len(found) == 1, (kind, fault, self.heard.json("event"))
        late_s = (found[0]["monotonic_ns"] - end) * 1e-9
        self.machine.judge(late_s, patience_s, f"{kind} of {fault}")
        return found[0]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, punctuality: Punctuality) -> Run:
    with punctuality.watch() as machine:
        return take(tmp_path_factory.mktemp("faults"), machine)


def take(folder: Path, machine: Machine) -> Run:
    """Every fault of the list, in one run."""
    options = []
    for name, at_s in FAULTS.items():
        duration = f":{DURATION_S[name]}" if name in DURATION_S else ""
        options += ["--fault", f"{name}@{FIRST_S + at_s}{duration}"]
    with simulated_arm(folder, seconds=0.1) as arm:  # for its arm.toml
        arm.wait()
    # The daemon is up and waits before the arm lives, so that the faults' times hold on a busy
    # machine too.
    with (
        running_daemon(folder, str(folder / "port")) as daemon,
        daemon.listen() as heard,
        simulated_arm(folder, *options, rate_hz=RATE_HZ, seconds=SECONDS, link=True) as arm,
    ):
        arm.wait()
    return Run(arm, heard, heard.points(), machine)


def test_every_whole_sample_is_published_once_and_in_order(run: Run) -> None:
    seq = run.points["seq"].astype(np.int64)
    assert (np.diff(seq) > 0).all()
    withheld = run.arm.withheld()
    assert not withheld & set(seq.tolist())
    sent = set(run.arm.truth()["seq"].tolist()) - withheld
    # What lay in the port when it was pulled, or came before it was open again, nobody read.
    begin, end = run.seqs("unplug")
    unplugged = set(range(begin - 20, end + 2 * RATE_HZ))
    expected = {s for s in sent - unplugged if seq[0] <= s <= seq[-1]}
    published = set(seq.tolist()) - unplugged
    assert published <= expected
    assert len(expected) > 12 * RATE_HZ
    # That a loss is flagged is asserted below; a starved machine may lose some.
    run.machine.judge_lost(len(expected - published), "every fault in one run")


def test_flag_6_stands_exactly_where_seq_does_not_follow(run: Run) -> None:
    seq = run.points["seq"].astype(np.int64)
    gaps = np.diff(seq, prepend=seq[0] - 1) != 1
    np.testing.assert_array_equal(run.flagged(Flag.SAMPLES_LOST), gaps)
    assert gaps.sum() >= 5


def test_a_reboot_begins_an_epoch_and_keeps_the_device_number(run: Run) -> None:
    seq = run.points["seq"]
    rebooted = seq >> 32 == 1
    assert rebooted.any()
    assert (seq[rebooted][:1] & 0xFFFFFFFF)[0] < 1.5 * RATE_HZ
    assert run.heard.events("reboot")


def test_invalid_points_are_those_of_the_joint_and_the_jump(run: Run) -> None:
    invalid = run.flagged(Flag.INVALID)
    jump, _ = run.seqs("count_jump")
    seq = run.points["seq"].astype(np.int64)
    jumped = (seq >= jump) & (seq <= jump + 5)
    assert invalid[run.during("joint_invalid")].all()
    assert invalid[seq == jump].all()
    assert not invalid[~run.during("joint_invalid") & ~jumped].any()
    for name in ("position_mm", "orientation", "covariance_mm2"):
        assert np.isnan(run.points[name][invalid]).all()
    assert np.isfinite(run.points["position_mm"][~invalid]).all()
    run.event_in("joint_invalid", "joint_invalid", 0.1)
    run.event_in("count_jump", "count_jump", 0.1)


def test_valid_points_are_where_the_arm_is(run: Run) -> None:
    truth = run.arm.truth()
    _, ours, theirs = np.intersect1d(run.points["seq"], truth["seq"], return_indices=True)
    off = run.points["position_mm"][ours] - truth["position_mm"][theirs]
    valid = ~run.flagged(Flag.INVALID)[ours]
    # Nominal geometry: the true arm differs by a few tenths of a millimetre, never by more.
    assert np.linalg.norm(off[valid], axis=1).max() < 5.0


def test_flag_2_when_a_sensor_opens_and_when_none_is_heard_for_5_s(run: Run) -> None:
    stale = run.flagged(Flag.TEMPERATURE_STALE)
    # Temperatures come twice a second: an open sensor is known with the next one.
    assert stale[run.during("sensor_open", after_s=0.75)].all()
    assert stale[run.during("sensor_silent", after_s=5.25)].all()
    assert stale[run.during("sensor_silent", after_s=5.25)].size
    silent = run.during("sensor_silent", after_s=1.0) & ~run.during("sensor_silent", 4.2)
    start = run.points["seq"] < run.points["seq"][0] + 1.5 * RATE_HZ
    allowed = start | run.during("sensor_open", 0, 1.0) | run.during("sensor_silent", 4.2, 1.0)
    # A daemon that is starved hears of a temperature late, and flags what it meanwhile publishes.
    run.machine.judge_lost(int(stale[silent | ~allowed].sum()), "fresh temperatures")


def test_an_open_sensor_is_told_and_its_return(run: Run) -> None:
    missing = run.event_in("temperature_missing", "sensor_open", 0.0)
    assert missing["detail"] == {"sensor": "t2"}
    # The first reading comes within 0.5 s, and must have held for another 0.5 s.
    assert run.event_in("temperature_back", "sensor_open", 1.25)["detail"] == {"sensor": "t2"}


def test_flag_3_when_a_temperature_jumps(run: Run) -> None:
    fast = run.flagged(Flag.TEMPERATURE_RATE)
    assert fast[run.during("temperature_step", after_s=1.0)].all()
    before = run.points["seq"] < run.seqs("temperature_step")[0]
    assert not fast[before].any()


def test_silence_is_told_and_nothing_is_invented(run: Run) -> None:
    run.event_in("silence", "silence", 0.5)
    run.event_in("recovered", "silence", 2.0)
    assert not run.during("silence").any()
    _, end = run.seqs("silence")
    _assert_recovered(run, end, 1.0)
    states = [event["text"].split(":")[0] for event in run.heard.events("state")]
    assert "READY" in states and "NOT_READY" in states


def test_an_unplugged_arm_comes_back(run: Run) -> None:
    run.event_in("unplugged", "unplug", 0.5)
    run.event_in("recovered", "unplug", 2.0)
    _, end = run.seqs("unplug")
    _assert_recovered(run, end, 2.0)


def test_what_was_dropped_is_counted_in_health(run: Run) -> None:
    drops = run.heard.json("health")[-1]["drops"]
    damaged = {run.seqs(fault)[0] for fault in ("corrupted_byte", "truncated_packet")}
    damaged -= run.arm.withheld("nobody reads")  # a machine stood still: the port was full
    assert drops["bad_crc"] + drops["bad_cobs"] + drops["malformed"] >= len(damaged)
    assert drops["repeated"] == 1
    assert drops["lost"] >= 5 + 1 + 2 + 0.8 * RATE_HZ


def test_the_clock_is_mapped_within_3_s_and_right(run: Run) -> None:
    unmapped = run.flagged(Flag.CLOCK)
    first = run.points["monotonic_ns"] < run.points["monotonic_ns"][0] + 3_000_000_000
    calm = run.points["seq"] < run.seqs("silence")[0]
    run.machine.judge_lost(int(unmapped[~first & calm].sum()), "points with a mapped clock")
    mapped = run.points[calm & ~unmapped]
    error_ms = np.abs(mapped["monotonic_ns"] - run.arm.latch_ns(mapped["seq"])) / 1e6
    assert np.median(error_ms) < 0.5
    assert error_ms.max() < 5.0


def test_buttons_are_events_and_make_measurements(run: Run) -> None:
    presses = run.heard.events("button")
    measurements = run.heard.json("measurement")
    assert len(presses) == len(measurements) >= 3
    rested = 0
    for press, measurement in zip(presses, measurements, strict=True):
        assert measurement["seq"] == press["detail"]["seq"]
        assert measurement["trigger"] == "button"
        point = run.points[run.points["seq"] == measurement["seq"]]
        off = np.subtract(measurement["position_mm"], point["position_mm"][0])
        assert np.linalg.norm(off) < 0.05  # the operator rests when he presses
        if int(point["flags"][0]) & Flag.SAMPLES_LOST:
            assert measurement["count"] == 1  # down already when the arm came back
            continue
        if not int(point["flags"][0]) & Flag.AT_REST:  # samples came too late to show the rest
            continue
        rested += 1
        assert measurement["count"] > 0.1 * RATE_HZ
        assert max(measurement["standard_deviation_mm"]) < 0.02
    run.machine.judge_lost(max(0, 1 - rested), "one rest before a press")


def _assert_recovered(run: Run, end_seq: int, within_s: float) -> None:
    after = run.points["seq"][run.points["seq"] >= end_seq]
    assert after[0] < end_seq + within_s * RATE_HZ
