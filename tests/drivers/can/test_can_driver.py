"""The CAN driver around a bus that breaks: what was received before is not lost with it."""

from collections import deque

from armd.drivers.can import objects as can
from armd.drivers.can.bus import BusFault
from armd.drivers.can.decoder import encode_note
from armd.drivers.can.driver import CanDriver
from armd.drivers.can.objects import CanFrame
from armd.drivers.config import CanConfig
from armd.drivers.identity import Expectation
from armd.drivers.sample import RawFrame

TURN = 1 << 20


class BreakingNetwork:
    """Delivers its frames, then breaks within the same burst."""

    def __init__(self, frames):
        self.sent, self.send_faults, self.garbled, self.closed = deque(), 0, 0, False
        self._frames = deque(frames)

    def receive(self, timeout_s):
        if not self._frames:
            raise BusFault("gone")
        return RawFrame(10**12, 10**18, "rx", self._frames.popleft().to_bytes(), "can")

    def notify(self, *_):
        pass

    def close(self):
        self.closed = True


def test_what_came_before_the_fault_is_delivered():
    config = CanConfig(kind="can", interface="virtual", sync="follower")
    driver = CanDriver(config, Expectation("SIM-0001", 1, 0, (TURN,)))
    driver._note(
        encode_note(
            note="configured", node=1, counts_per_turn=TURN, range_counts=TURN, serial_number=1
        )
    )
    emergency = CanFrame(can.EMCY_BASE + 1, can.EMCY.pack(0x5000, 1))
    network = BreakingNetwork([emergency])
    driver._network = network
    kinds = [event.kind for event in driver.read(0.0)]
    assert kinds == ["joint_invalid", "bus_fault"]
    assert network.closed
