"""One contract, every wire: the same arm in the same motion gives the same points, and every
fault shows in the samples as it does on any other wire.

Each wire is a class; the tests are inherited. The simulator runs in its own process, and knows
the truth.
"""

import socket
from contextlib import closing
from dataclasses import dataclass, field

import numpy as np
import pytest

from armd.drivers.config import CanConfig, SerialConfig, ServoConfig
from armd.drivers.identity import Expectation
from armd.drivers.sample import Event, Temperatures
from armd.drivers.table import open_driver
from armd.simulator.live.electronics import COUNTS_PER_TURN
from armd.simulator.servobus.arm import ServoArm
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.effects.effect import Conditions
from support.sampled import rows_of
from support.simulated_arm import simulated_arm

EXPECTED = Expectation("SIM-0001", 6, 6, (COUNTS_PER_TURN,) * 6)
FIRST_S = 5.0  # by then the driver listens, also on a busy machine
S = 1_000_000_000

#: Nearly half a turn: after a gap of 0.04 s the usual jump of 45° could as well be motion.
AMOUNT = {"count_jump": f", amount = {int(0.45 * COUNTS_PER_TURN)}"}
#: name: (seconds after FIRST_S, duration, joint)
FAULTS = {
    "joint_invalid": (0.0, 0.4, 2),
    "sensor_open": (0.3, 2.0, 1),
    "count_jump": (1.0, 0.0, 1),
    "silence": (2.5, 0.8, 1),
    "reboot": (4.8, 0.3, 1),
}
LAST_S = 7.0
LOST = 0.1  # the share of rows in which a busy machine may lose a servo's answer
BUSY = 100  # cycles left out, of some five thousand, and the machine is one


@dataclass
class Run:
    """Everything a driver said, and everything the simulator did."""

    samples: np.ndarray
    temperatures: list[Temperatures]
    events: list[Event]
    counters: dict[str, int]
    truth: np.ndarray
    truth_ns: np.ndarray  # the instant of each row of truth
    withheld: set[int]  # what the simulator never sent whole
    windows: dict[str, tuple[int, int]] = field(default_factory=dict)  # begin and end of faults

    def during(self, fault, margin_s=0.0):
        begin, end = self.windows[fault]
        instant = self.samples["monotonic_ns"]
        return self.samples[(instant >= begin - margin_s * S) & (instant <= end + margin_s * S)]

    def told(self, kind):
        return [event for event in self.events if event.kind == kind]


def windows(arm, instant_ns):
    """Begin and end of each fault that ended, by the instant of its lines in the fault log."""
    begins, ends = (
        {line["fault"]: instant_ns(line) for line in arm.events(what)} for what in ("begin", "end")
    )
    return {name: (begins[name], ends[name]) for name in begins.keys() & ends.keys()}


class EveryWire:
    """What must hold whatever carries the samples."""

    wire: tuple[str, ...]
    rate_hz = 500
    faults = FAULTS
    last_s = LAST_S

    @classmethod
    def config(cls, port: str):
        raise NotImplementedError

    @classmethod
    def expected(cls):
        return EXPECTED

    @classmethod
    def instants(cls, arm, truth):
        """When each row of *truth* was latched, and when each fault began and ended."""
        return truth["seq"].astype(np.int64), windows(arm, lambda line: line["monotonic_ns"])

    @pytest.fixture(scope="class")
    @classmethod
    def run(cls, tmp_path_factory):
        return cls.take(tmp_path_factory.mktemp(cls.__name__))

    @classmethod
    def take(cls, folder):
        """The driver's and the simulator's account of one run."""
        scenario = folder / "scenario.toml"
        faults = ", ".join(
            f'{{ name = "{name}", at_s = {FIRST_S + at}, duration_s = {lasts}, joint = {joint}'
            f"{AMOUNT.get(name, '')} }}"
            for name, (at, lasts, joint) in cls.faults.items()
        )
        scenario.write_text(f"fault = [{faults}]\n")
        options = ["--scenario", str(scenario)]
        seconds = FIRST_S + cls.last_s
        items = []
        with (
            simulated_arm(
                folder, *options, wire=cls.wire, rate_hz=cls.rate_hz, seconds=seconds
            ) as arm,
            closing(open_driver(cls.config(arm.port), cls.expected())) as driver,
        ):
            while arm.process.poll() is None:
                items += driver.read(0.05)
                driver.take_raw()
            counters = driver.counters
        truth = arm.truth()
        instants, windows = cls.instants(arm, truth)
        return Run(
            rows_of(items),
            [item for item in items if isinstance(item, Temperatures)],
            [item for item in items if isinstance(item, Event)],
            counters,
            truth,
            instants,
            arm.withheld() if arm.events("withheld") else set(),
            windows,
        )

    def test_the_points_are_where_the_tip_truly_was(self, run):
        good = run.samples[(run.samples["joint_invalid"] == 0) & run.samples["clock_mapped"]]
        nearest = np.searchsorted(run.truth_ns, good["monotonic_ns"])
        nearest = np.clip(nearest, 1, len(run.truth_ns) - 1)
        before = good["monotonic_ns"] - run.truth_ns[nearest - 1]
        nearest -= before < run.truth_ns[nearest] - good["monotonic_ns"]
        late_ns = np.abs(good["monotonic_ns"] - run.truth_ns[nearest])
        assert np.quantile(late_ns, 0.25) < 0.5e6  # of the rest a busy machine may be the cause
        assert np.median(late_ns) < S / self.rate_hz / 4  # or one latch is taken for another
        angles = good["count"] / COUNTS_PER_TURN * 2 * np.pi
        tips = TrueArm.default(1).tip(angles, Conditions.at_rest(len(good), 6, 20.0))
        error_mm = np.linalg.norm(tips - run.truth["position_mm"][nearest], axis=1)
        # Of two latches a period apart the nearer one is taken: rarely the wrong one.
        assert np.median(error_mm) < 0.02
        # And each is one latch of all joints, undamaged: some latch of that moment agrees with it.
        for i in np.flatnonzero(error_mm > 0.02):
            moment = slice(max(nearest[i] - self.rate_hz // 10, 0), nearest[i] + self.rate_hz // 10)
            off_mm = np.linalg.norm(tips[i] - run.truth["position_mm"][moment], axis=1)
            assert off_mm.min() < 0.03, good[i]

    def test_seq_rises_and_every_gap_is_marked(self, run):
        seq = run.samples["seq"]
        assert (seq[1:] > seq[:-1]).all()
        assert np.array_equal(run.samples["lost_before"][1:], np.diff(seq) != 1)
        assert not run.samples["lost_before"][0]

    def test_an_invalid_joint_is_invalid_for_as_long_as_it_says(self, run):
        during = run.during("joint_invalid", margin_s=-0.05)
        assert len(during) and (during["joint_invalid"] & 0b10 != 0).all()
        assert run.told("joint_invalid") and run.told("joint_valid")

    def test_a_jump_costs_its_sample_and_at_most_five_more(self, run):
        near = run.during("count_jump", margin_s=0.2)
        assert 1 <= np.count_nonzero(near["joint_invalid"] & 0b01) <= 6
        assert len(run.told("count_jump")) == 1

    def test_an_open_sensor_is_nan_and_the_others_are_not(self, run):
        begin, end = run.windows["sensor_open"]
        inside = [t for t in run.temperatures if begin + S * 0.6 < t.monotonic_ns < end]
        assert inside
        for reading in inside:
            assert np.isnan(reading.celsius[1])
            assert np.isfinite(np.delete(reading.celsius, 1)).all()

    def test_silence_is_told_and_so_is_the_recovery(self, run):
        _, end = run.windows["silence"]
        assert any(event.kind == "silence" for event in run.events)
        assert any(event.kind == "recovered" for event in run.events)
        after = run.samples[run.samples["monotonic_ns"] > end]
        assert len(after) > 100

    def test_after_a_reboot_the_samples_go_on(self, run):
        _, end = run.windows["reboot"]
        after = run.samples[run.samples["monotonic_ns"] > end + S]
        assert len(after) > 50 and (after["joint_invalid"][-20:] == 0).all()

    def test_every_sample_is_accounted_for(self, run):
        assert run.counters["samples"] == len(run.samples)
        assert run.counters.get("foreign", 0) == 0


class TestSerial(EveryWire):
    wire = ("--serial",)

    @classmethod
    def config(cls, port):
        return SerialConfig(kind="serial", port=port)

    @classmethod
    def instants(cls, arm, truth):
        """The device's own clock, boot by boot: `seq` carries the epoch. Faults begin and end at
        latches, whenever a busy machine wrote that down."""
        instants = np.zeros(len(truth), np.int64)
        for epoch, boot in enumerate(arm.events("boot")):
            own = (truth["seq"] >> np.uint64(32)) == epoch
            period_ns = 1e9 / (boot["rate_hz"] * (1 + boot["clock_ppm"] * 1e-6))
            seq = truth["seq"][own].astype(np.int64)
            instants[own] = boot["latch_monotonic_ns"] + (seq - boot["seq"]) * period_ns
        first = arm.events("boot")[0]

        def latch_ns(line):
            return arm.latch_ns(first["seq"] + line["at_s"] * first["rate_hz"])

        return instants, windows(arm, latch_ns)

    def test_every_sample_that_was_sent_whole_comes_exactly_once(self, run):
        got = run.samples["seq"]
        sent = run.truth["seq"]
        expected = set(sent[(sent >= got[0]) & (sent <= got[-1])].tolist()) - run.withheld
        assert got.tolist() == sorted(expected)

    def test_a_reboot_begins_an_epoch(self, run):
        assert run.samples["seq"][-1] >> 32 == 1 and len(run.told("reboot")) == 1


class EveryCan(EveryWire):
    """CAN has faults of its own."""

    faults = FAULTS | {
        "emcy": (6.5, 0.4, 1),
        "missing_tpdo": (7.6, 0.0, 3),
        "node_silent": (7.9, 0.8, 4),
        "node_reboot": (9.3, 0.3, 5),
        "heartbeat_loss": (10.2, 0.8, 6),
        "bus_down": (11.8, 0.8, 1),
    }
    last_s = 15.5

    def test_the_preset_is_never_written(self, run):
        assert "preset_written" not in run.windows

    @pytest.mark.parametrize(
        ("fault", "reason"),
        [
            ("emcy", "emergency 0x5000"),
            ("node_silent", ""),  # its heartbeat or its values, whichever is missed first
            ("node_reboot", ""),  # its silence or its boot-up, whichever is seen first
            ("heartbeat_loss", "its heartbeat is lost"),
        ],
    )
    def test_a_failing_node_is_invalid_with_its_reason_and_taken_back(self, run, fault, reason):
        joint = self.faults[fault][2]
        begin, end = run.windows[fault]
        told = [
            event
            for event in run.told("joint_invalid")
            if event.detail["joint"] == joint and begin <= event.monotonic_ns <= end + S
        ]
        assert any(reason in event.text for event in told), run.events
        assert any(
            event.detail["joint"] == joint and event.monotonic_ns > told[0].monotonic_ns
            for event in run.told("joint_valid")
        )

    def test_a_missing_answer_is_a_gap_and_nothing_more(self, run):
        near = run.during("missing_tpdo", margin_s=0.1)
        assert run.counters["incomplete"] >= 1
        assert (near["joint_invalid"] & 0b100 == 0).all() and near["lost_before"].any()

    def test_the_bus_comes_back(self, run):
        _, end = run.windows["bus_down"]
        after = run.samples[run.samples["monotonic_ns"] > end]
        assert len(after) > 20 and (after["joint_invalid"][-10:] == 0).all()


@pytest.mark.slow
class TestSocketcand(EveryCan):
    wire = ("--can", "socketcand")

    @classmethod
    def config(cls, port):
        host, number = port.split(":")
        return CanConfig(
            kind="can", interface="socketcand", channel="can0", rate_hz=cls.rate_hz,
            host=host, port=int(number),
        )  # fmt: skip


@pytest.mark.skipif(
    "vcan0" not in [name for _, name in socket.if_nameindex()], reason="this kernel has no vcan0"
)
class TestVcan(EveryCan):
    wire = ("--can", "socketcan")
    rate_hz = 200

    @classmethod
    def config(cls, port):
        return CanConfig(kind="can", interface="socketcan", channel=port, rate_hz=cls.rate_hz)


class EveryServoBus(EveryWire):
    """Servos: the same contract less the device clock. A joint is invalid by its servo's silence,
    a thermometer by the same; the arm is a printed one of five joints, and one count of it is half
    a millimetre.

    Servos are waited for by the millisecond, so a busy machine loses answers, and leaves cycles of
    a moving arm out. What must never be holds for each row here, whatever was lost; what a fault
    may cost besides, `mostly` and `came` say. To the row, test_servo_driver has it.
    """

    kind: str
    counts_of_one = np.ones(5)  # counts of 4096 a turn in one of each joint's encoder
    faults = {
        "joint_invalid": (0.0, 0.4, 2),
        "servo_silent": (0.9, 1.2, 3),
        "count_jump": (2.8, 0.0, 1),
        "flipped_bit": (3.1, 0.0, 4),
        "late_answer": (3.3, 0.0, 2),
        "stale_bytes": (3.5, 0.0, 1),
        "echo": (3.6, 0.4, 1),
        "multi_turn": (4.1, 0.4, 1),
        "silence": (4.8, 0.8, 1),
        "servo_alert": (6.9, 0.4, 5),
        "reboot": (8.2, 0.3, 1),
    }
    last_s = 10.5

    @pytest.fixture(scope="class", autouse=True)
    @classmethod
    def state(cls, tmp_path_factory):
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("STATE_DIRECTORY", str(tmp_path_factory.mktemp("state")))
            yield

    @classmethod
    def config(cls, port):
        return ServoConfig(
            kind=cls.kind, port=port, ids=[1, 2, 3, 4, 5], temperature_ids=[2, 3, 4, 5, 6],
            trigger={"id": 6, "pressed_below": 1900},
        )  # fmt: skip

    @classmethod
    def expected(cls):
        return Expectation("SIM-0001", 5, 5, (4096,) * 5)

    def test_the_points_are_where_the_tip_truly_was(self, run):
        """Here: each joint where its encoder was; what the encoder does not see is the arm's."""
        good = run.samples[run.samples["joint_invalid"] == 0][::7]
        arm = ServoArm(1, 20.0)
        began_ns = int(run.truth_ns[0])
        true = np.array(
            [
                [arm.raw(k, (int(t) - began_ns) * 1e-9) - 2048 for k in range(1, 6)]
                for t in good["monotonic_ns"]
            ]
        )
        counts = (good["count"] + 2048) % 4096 - 2048  # multi_turn begins another one
        error = (np.abs(counts - true) / self.counts_of_one).max(axis=1)
        assert np.median(error) <= 1.0 and np.quantile(error, 0.95) < 3.0
        assert error.max() < 60  # no neighbour's, no late, no damaged answer among them
        assert run.samples["clock_mapped"].all()

    @staticmethod
    def came(rows, run):
        """Whether there are rows; else this machine was too slow for them: the line went round
        seldom, and each round gave a row or was left out, counted and told."""
        if len(rows) > 20:
            return True
        if len(rows) == 0:
            return run.counters["untimed"] > BUSY and bool(run.told("untimed"))
        seq = run.samples["seq"].astype(np.int64)
        first, last = np.searchsorted(seq, rows["seq"][[0, -1]].astype(np.int64))
        around = seq[max(first - 1, 0) : last + 2]
        left_out = around[-1] - around[0] + 1 - len(around)
        return left_out <= run.counters["untimed"] and (left_out == 0 or bool(run.told("untimed")))

    @staticmethod
    def mostly(good):
        """But for the rows that a busy machine may cost."""
        return np.count_nonzero(~good) <= 2 + LOST * len(good)

    def test_an_invalid_joint_is_invalid_for_as_long_as_it_says(self, run):
        during = run.during("joint_invalid", margin_s=-0.05)
        assert (during["joint_invalid"] & 0b10 != 0).all() and self.came(during, run)
        assert run.told("joint_invalid") and run.told("joint_valid")

    def test_a_jump_costs_its_sample_and_at_most_five_more(self, run):
        """That no valid row has it, the test of the points says."""
        near = run.during("count_jump", margin_s=0.2)
        marked = np.count_nonzero(near["joint_invalid"] & 0b01)
        told = run.told("count_jump")
        if not told:  # nobody heard the one answer that jumped
            at = run.during("count_jump", margin_s=0.06)
            assert len(at) == 0 or (at["lost_before"] | (at["joint_invalid"] & 0b01 != 0)).any()
        assert len(told) <= 1 and len(told) <= marked <= 6 + LOST * len(near)

    def test_an_open_sensor_is_nan_and_the_others_are_not(self, run):
        begin, end = run.windows["servo_silent"]
        begin, end = begin + S * 0.1, end - S * 0.1
        inside = [t for t in run.temperatures if begin < t.monotonic_ns < end]
        assert inside
        assert all(np.isnan(reading.celsius[1]) for reading in inside)
        stands_s = np.diff([t.monotonic_ns for t in inside] + [end]) / S  # until the next one
        others = np.array([np.isfinite(np.delete(t.celsius, 1)).all() for t in inside])
        told_s = stands_s.sum()  # a starved machine hears little, and then not of all
        assert stands_s[others].sum() > (1 - LOST) * told_s or told_s < 0.5

    def test_a_servo_that_starts_anew_is_taken_back(self, run):
        begin, end = run.windows["servo_silent"]
        instant = run.samples["monotonic_ns"]
        while_away = run.samples[(instant > begin + S * 0.05) & (instant < end - S * 0.05)]
        assert (while_away["joint_invalid"] & 0b100 != 0).all()
        assert self.mostly(while_away["joint_invalid"] == 0b100) and self.came(while_away, run)
        after = run.samples[(instant > end + S * 0.3) & (instant < end + S * 0.6)]
        assert self.mostly(after["joint_invalid"] == 0) and self.came(after, run)

    def test_after_a_reboot_the_samples_go_on(self, run):
        _, end = run.windows["reboot"]
        after = run.samples[run.samples["monotonic_ns"] > end + S]
        assert self.mostly(after["joint_invalid"] == 0) and self.came(after, run)

    def test_silence_is_told_and_so_is_the_recovery(self, run):
        _, end = run.windows["silence"]
        assert run.told("silence") and run.told("recovered")
        assert self.came(run.samples[run.samples["monotonic_ns"] > end], run)

    def test_every_sample_is_accounted_for(self, run):
        """A late answer to a cycle may come while one servo is asked who it is: a foreign one."""
        assert run.counters["samples"] == len(run.samples)
        assert run.counters["foreign"] < LOST * len(run.samples)

    def test_damaged_late_and_foreign_bytes_cost_their_joint_one_cycle(self, run):
        for fault, joint in (("flipped_bit", 0b1000), ("late_answer", 0b10), ("stale_bytes", 0)):
            invalid = run.during(fault, margin_s=0.06)["joint_invalid"]
            others = np.count_nonzero(invalid & ~np.uint16(joint))
            assert np.count_nonzero(invalid) <= 4 + LOST * len(invalid), fault
            assert others <= 2 + LOST * len(invalid), fault
        assert run.counters["bad_sum"] >= 1 and run.counters["late"] >= 1
        assert run.counters["echoes"] > 5

    def test_positions_beyond_a_turn_are_the_same_positions(self, run):
        during = run.during("multi_turn", margin_s=-0.05)
        assert self.mostly(during["joint_invalid"] == 0) and self.came(during, run)

    def test_an_alert_warns_of_its_joint_while_it_stands(self, run):
        during = run.during("servo_alert", margin_s=-0.05)
        assert (during["joint_warning"] & ~np.uint16(0b10000) == 0).all()
        heard = during["joint_invalid"] & 0b10000 == 0
        assert self.mostly(heard) and (during["joint_warning"][heard] == 0b10000).all()
        assert self.came(during, run)
        assert any("servo 5 (joint 5)" in event.text for event in run.told("servo_warning"))
        assert not run.samples["joint_warning"][-20:].any()


@pytest.mark.slow
class TestFeetech(EveryServoBus):
    wire = ("--servo", "feetech")
    kind = "feetech"


@pytest.mark.slow  # the engine is the same; its codec has tests of its own
@pytest.mark.crowd
class TestDynamixel(EveryServoBus):
    wire = ("--servo", "dynamixel")
    kind = "dynamixel"


@pytest.mark.slow  # likewise; each servo is read alone, and two of them are AX-12
@pytest.mark.crowd
class TestDynamixel1(EveryServoBus):
    wire = ("--servo", "dynamixel1")
    kind = "dynamixel1"
    counts_of_one = np.array([1, 1, 1, 1, 10 / 3])
