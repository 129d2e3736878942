"""The serial transport on a real pty: whatever is pulled, samples come back or are accounted for.

Times are generous: what is tested is what happens, not how fast this machine is today.
"""

import time

import numpy as np
import pytest

from armd.drivers.config import SerialConfig
from armd.drivers.identity import Expectation
from armd.drivers.serial.decoder import SerialDecoder
from armd.drivers.table import open_driver
from support.pty_arm import PtyArm
from support.sampled import Heard, rows_of

EXPECTED = Expectation("SIM-0001", 3, 2, (1 << 20,) * 3)
PATIENCE_S = 60


class Reader(Heard):
    """A driver and everything it has said."""

    def __init__(self, driver):
        self.driver = driver
        self.items, self.raw = [], []

    def until(self, done):
        deadline = time.monotonic() + PATIENCE_S
        while not done():
            assert time.monotonic() < deadline, f"not in {PATIENCE_S} s; {self.events}"
            self.items += self.driver.read(0.05)
            self.raw += self.driver.take_raw()
        return self

    def more_samples(self, n=50):
        have = len(self.seqs)
        return self.until(lambda: len(self.seqs) >= have + n)

    def event(self, kind):
        return self.until(lambda: kind in self.events)


@pytest.fixture
def arm(tmp_path):
    arm = PtyArm(tmp_path)
    yield arm
    arm.close()


@pytest.fixture
def reader(arm):
    driver = open_driver(SerialConfig(kind="serial", port=str(arm.link)), EXPECTED)
    yield Reader(driver)
    driver.close()


@pytest.mark.serial
def test_silence_is_told_once_and_so_is_the_recovery(arm, reader):
    reader.more_samples()
    arm.silent = True
    reader.event("silence")
    assert not reader.driver.connected and reader.driver.stale
    reader.until(lambda: reader.driver.counters["reconnects"] >= 2)  # it opens the port afresh
    before = len(reader.seqs)
    arm.silent = False
    reader.event("recovered").more_samples()
    assert reader.events.count("silence") == reader.events.count("recovered") == 1
    assert reader.samples["lost_before"][before] and reader.driver.connected
    assert reader.samples["lost_before"].sum() == 1


@pytest.mark.serial
@pytest.mark.parametrize("says_hello", [True, False])
def test_a_reboot_with_the_boot_id_it_had_is_seen_within_a_second_and_a_half(
    arm, reader, says_hello, punctuality
):
    """A device that draws no boot id: clock and counter run through the same numbers again."""
    reader.more_samples()
    arm.reboot()  # while the driver listens, so that it hears this life from its beginning
    reader.event("reboot").more_samples(600)
    if says_hello:
        arm.reboot(boot_id=arm.hello.boot_id)
    else:
        arm._boot()
    lost = reader.driver.counters["lost"]
    with punctuality.limit(1.5, "a reboot is seen"):
        reader.until(lambda: reader.seqs[-1] >> 32 == 2)
    reader.more_samples(100)
    assert reader.events.count("reboot") == 2
    later = [seq & 0xFFFFFFFF for seq in reader.seqs if seq >> 32 == 2]
    assert later == list(range(len(later))) and reader.driver.counters["lost"] == lost
    assert reader.driver.counters["repeated"] == 0


def test_a_port_that_is_not_there_yet(tmp_path):
    config = SerialConfig(kind="serial", port=str(tmp_path / "arm"))
    reader = Reader(open_driver(config, EXPECTED)).event("port_missing")
    arm = PtyArm(tmp_path)
    try:
        reader.event("recovered")
        assert reader.events.count("port_missing") == 1
    finally:
        reader.driver.close()
        arm.close()


def test_a_foreign_arm_replaced_by_ours(tmp_path):
    foreign = PtyArm(tmp_path, serial_number="OTHER")
    config = SerialConfig(kind="serial", port=str(tmp_path / "arm"))
    reader = Reader(open_driver(config, EXPECTED)).event("foreign_arm")
    reader.until(lambda: reader.driver.counters["foreign"] > 50)
    assert reader.seqs == [] and not reader.driver.connected
    foreign.close()
    reader.event("unplugged")
    ours = PtyArm(tmp_path)
    try:
        reader.more_samples()
        assert set(reader.seqs) <= set(ours.sent)
    finally:
        reader.driver.close()
        ours.close()


def test_an_arm_that_does_not_say_who_it_is(arm, reader):
    arm.mute = True
    reader.event("unidentified")
    assert reader.seqs == [] and not reader.driver.connected
    arm.mute = False
    reader.more_samples()
    seq = np.array(reader.seqs)
    lost = np.diff(seq) != 1  # which a starved machine does, and flags
    assert (np.diff(seq) > 0).all()
    np.testing.assert_array_equal(reader.samples["lost_before"][1:] != 0, lost)


def test_a_plug_and_a_reboot_repeat_no_sample_and_are_replayed_bit_by_bit(arm, reader):
    reader.more_samples(200)
    arm.unplug()
    reader.event("unplugged")
    assert not reader.driver.connected
    arm.plug()
    reader.event("recovered").more_samples(200)
    seqs = reader.seqs
    assert seqs == sorted(set(seqs)) and set(seqs) <= set(arm.sent)
    lost = reader.samples["lost_before"].sum()
    arm.reboot()
    reader.event("reboot").more_samples(200)
    assert reader.seqs[-1] >> 32 == 1
    assert reader.samples["lost_before"].sum() == lost + 1
    decoder = SerialDecoder(EXPECTED)
    again = [item for frame in reader.raw for item in decoder.feed(frame)]
    assert rows_of(again).tobytes() == reader.samples.tobytes()
