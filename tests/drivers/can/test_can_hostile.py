"""Adapters, servers and nodes that say what they should not: nothing ends the driver, nothing is
waited for without end, and good frames go on being read."""

import os
import select
import socket
import threading
import time
import tty
from contextlib import closing, contextmanager, suppress

import can
import numpy as np
import pytest

from armd.drivers.can import bus as bus_module
from armd.drivers.can import objects
from armd.drivers.can.bus import GARBLED_MOST, BusFault, OwnNetwork, open_bus
from armd.drivers.can.decoder import CanDecoder, encode_note
from armd.drivers.can.driver import CanDriver
from armd.drivers.can.objects import CanFrame
from armd.drivers.can.setup import configure
from armd.drivers.can.setup.node_setup import NodeSetup
from armd.drivers.config import CanConfig
from armd.drivers.host_time import HostTime
from armd.drivers.identity import Expectation
from armd.drivers.sample import Event, RawFrame
from support.pty_link import open_line
from support.simulated_arm import simulated_arm

TURN = 1 << 20
ONE_JOINT = Expectation("SIM-0001", 1, 0, (TURN,))
#: Lines of an slcan adapter that python-can 4.6 trips over, each in its own way.
BAD_LINES = [
    b"t\r", b"t1\r", b"t18\r", b"t181\r", b"T00000181\r", b"r\r", b"R123\r", b"d181\r",
    b"t-016000000000000\r", b"tXYZ6000000000000\r", b"t1816zz0000000000\r", b"t18160000000000\r",
    b"t181600000000000\r", b"T1FFFFFFFF0\r", b"t9816000000000000\r", b"D00000181F00\r", b"\xff\r",
    b"t1818000000000000\r",
]  # fmt: skip
GOOD_LINE = b"t1816010000000000\r"
LAST_LINE, LAST = b"t1826010000000000\r", CanFrame(0x182, bytes([1, 0, 0, 0, 0, 0]))
PATIENCE_S = 60.0


@contextmanager
def slcan_network():
    with open_line() as (master, _, path):
        config = CanConfig(kind="can", interface="slcan", channel=path)
        with closing(OwnNetwork(open_bus(config), HostTime())) as network:
            yield master, network


def received(network, seconds=0.2):
    end_s = time.monotonic() + seconds
    frames = []
    while time.monotonic() < end_s:
        frame = network.receive(0.01)
        if frame is not None:
            frames.append(CanFrame.from_bytes(frame.data))
    return frames


def at_least(n, network):
    """So many frames, and what comes right after them."""
    frames = []
    end_s = time.monotonic() + PATIENCE_S
    while len(frames) < n and time.monotonic() < end_s:
        frames += received(network, 0.02)
    return frames + received(network, 0.1)


@pytest.mark.parametrize("line", BAD_LINES, ids=lambda line: line.decode("latin1").strip())
def test_a_cut_line_is_counted_and_the_next_frame_is_read(line):
    with slcan_network() as (master, network):
        os.write(master, GOOD_LINE + line)
        first = at_least(1, network)
        os.write(master, GOOD_LINE)
        frames = first + at_least(1, network)
    assert frames == [CanFrame(0x181, bytes([1, 0, 0, 0, 0, 0]))] * 2
    assert network.garbled == 1


def test_random_lines_never_raise_and_good_ones_come_through():
    rng = np.random.default_rng(3)
    with slcan_network() as (master, network):
        frames = []
        for _ in range(150):
            line = bytearray(rng.choice([*BAD_LINES, GOOD_LINE]))
            line[rng.integers(len(line))] = rng.integers(256)
            os.write(master, b"\r" + bytes(line) + b"\r" + GOOD_LINE)
            frames += received(network, 0.005)
        os.write(master, LAST_LINE)
        end_s = time.monotonic() + PATIENCE_S
        while LAST not in frames and time.monotonic() < end_s:
            frames += received(network, 0.1)
    good = frames.count(CanFrame(0x181, bytes([1, 0, 0, 0, 0, 0])))
    assert good > 140  # a CR that became another byte glues two lines together


def test_what_goes_on_making_no_sense_is_a_broken_bus():
    with slcan_network() as (master, network):
        os.write(master, b"t\r" * GARBLED_MOST)
        with pytest.raises(BusFault, match="in a row"):
            received(network, 5.0)


@pytest.mark.serial
def test_an_adapter_that_takes_nothing_more_is_a_broken_bus(punctuality):
    with slcan_network() as (_, network):
        with punctuality.limit(10.0, "an adapter that takes nothing is given up"):
            for _ in range(5000):
                network.send_message(0x601, bytes(8))
                if network.send_faults:
                    break
        assert network.send_faults == 1
        with pytest.raises(BusFault, match="nothing more can be sent"):
            network.receive(0.0)


class AnyFault(can.BusABC):
    """A bus library that raises whatever it is told to."""

    def __init__(self, faults):
        super().__init__(channel=None)
        self.channel_info = "any fault"
        self.faults = list(faults)

    def _recv_internal(self, timeout):
        if self.faults:
            raise self.faults.pop(0)
        return can.Message(arbitration_id=0x181, data=bytes(6), is_extended_id=False), True

    def send(self, msg, timeout=None):
        raise KeyError("no such thing")

    def shutdown(self):
        super().shutdown()
        raise AttributeError("half open")


@pytest.mark.parametrize(
    "error", [IndexError(), KeyError(), AttributeError(), TypeError(), AssertionError(), EOFError()]
)
def test_no_exception_of_a_bus_library_gets_out(error):
    network = OwnNetwork(AnyFault([error]), HostTime())
    assert network.receive(0.0) is None
    assert network.receive(0.0) is not None
    network.send_sync()
    network.close()
    assert (network.garbled, network.send_faults) == (1, 1)


@pytest.mark.parametrize("identifier", [1 << 32, 1 << 40, 0x7FFFFFFFF, -1, 0x2000_0000])
def test_an_identifier_that_no_frame_can_have(identifier):
    bus = AnyFault([])
    bus._recv_internal = lambda timeout: (
        can.Message(arbitration_id=identifier, data=b"", is_extended_id=True), True
    )  # fmt: skip
    network = OwnNetwork(bus, HostTime())
    assert network.receive(0.0) is None and network.garbled == 1
    with suppress(AttributeError):
        bus.shutdown()


# --- servers -------------------------------------------------------------------------------------


@contextmanager
def server(talk):
    """A TCP server; *talk* has each connection in a thread. Yields its configuration."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        connections = []

        def accept():
            with suppress(OSError):
                while True:
                    connection, _ = listener.accept()
                    connections.append(connection)
                    threading.Thread(target=run, args=(connection,), daemon=True).start()

        def run(connection):  # which closes it itself: its number may soon be another file's
            with connection, suppress(OSError):
                talk(connection)

        thread = threading.Thread(target=accept, daemon=True)
        thread.start()
        yield CanConfig(
            kind="can", interface="socketcand", channel="can0", host="127.0.0.1",
            port=listener.getsockname()[1],
        )  # fmt: skip
        listener.shutdown(socket.SHUT_RDWR)
        thread.join(5.0)
        for connection in connections:
            with suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)


def greet(connection):
    connection.sendall(b"< hi >")
    connection.recv(256)
    connection.sendall(b"< ok >")
    connection.recv(256)
    connection.sendall(b"< ok >")
    time.sleep(0.05)


@pytest.mark.serial
@pytest.mark.parametrize("words", [[], [b"< hi >"], [b"< hi >", b"< ok >"]])
def test_a_server_that_stops_answering_is_not_waited_for(words, punctuality):
    def talk(connection):
        for word in words:
            connection.sendall(word)
            connection.recv(256)
        time.sleep(5.0)

    with (
        server(talk) as config,
        punctuality.limit(3.0, "a server that stops answering is given up"),
        pytest.raises(BusFault, match="timed out"),
    ):
        open_bus(config)


def test_a_person_is_told_of_an_opening_that_takes_for_ever(monkeypatch):
    monkeypatch.setattr("armd.drivers.can.driver.OPENING_MOST_NS", 100_000_000)
    never = threading.Event()
    monkeypatch.setattr("armd.drivers.can.driver.open_bus", lambda config: never.wait(5.0))
    driver = CanDriver(CanConfig(kind="can", interface="virtual"), ONE_JOINT)
    events = [event for _ in range(5) for event in driver.read(0.1)]
    assert [event.kind for event in events] == ["bus_missing"]
    assert "still being waited for" in events[0].text


def test_random_talk_of_a_server_never_ends_the_driver():
    rng = np.random.default_rng(5)
    pieces = [
        b"< frame 181 1.0 010000000000 >", b"< frame ", b"181 ", b">", b"<", b" ", b"\xff",
        b"< frame FFFFFFFFFF 1.0 00 >", b"< frame -1 1.0 00 >", b"< error 0 0 >", b"< frame >",
        b"< frame 181 x 00 >", b"< frame 181 1.0 0 >", b"< frame 581 1.0 4300100000 >",
        b"< frame 581 1.0 >", b"< frame 701 1.0 05 >", b"< frame 081 1.0 00 >", b"x" * 300,
    ]  # fmt: skip

    def talk(connection):
        greet(connection)
        while True:
            connection.sendall(b"".join(rng.choice(pieces, 8)))
            time.sleep(0.002)
            if select.select([connection], [], [], 0)[0]:
                connection.recv(4096)

    with server(talk) as config, closing(CanDriver(config, ONE_JOINT)) as driver:
        kinds = {getattr(item, "kind", "samples") for _ in range(40) for item in driver.read(0.05)}
    assert kinds <= {
        "bus_fault", "bus_missing", "silence", "node_absent", "foreign_arm", "second_sync_producer",
        "recovered", "no_echo", "joint_invalid",
    }  # fmt: skip
    assert "bus_fault" in kinds and driver.counters["reconnects"] > 0


def test_random_frames_never_raise_in_the_decoder():
    rng = np.random.default_rng(7)
    decoder = CanDecoder(Expectation("SIM-0001", 6, 7, (TURN,) * 6), 500.0)
    for k in range(1, 7):
        decoder.feed(
            RawFrame(0, 0, "link", encode_note(
                note="configured", node=k, counts_per_turn=TURN, range_counts=TURN, serial_number=k
            ), "can")
        )  # fmt: skip
    bases = [0, 0x80, 0x180, 0x280, 0x380, 0x480, 0x580, 0x700]
    for n in range(20_000):
        identifier = int(rng.choice(bases)) + int(rng.integers(0, 40))
        identifier |= int(rng.choice([0, 0, 0, objects.EXTENDED, objects.REMOTE, objects.ERROR]))
        data = rng.bytes(int(rng.choice([0, 1, 6, 8, int(rng.integers(0, 65))])))
        frame = CanFrame(identifier, data).to_bytes()
        decoder.feed(RawFrame(10**12 + n * 500_000, 10**18, "rx", frame, "can"))
    assert decoder.counters["malformed"] > 100 and decoder.counters["unknown"] > 100


def test_an_extended_frame_is_no_word_of_a_node():
    decoder = CanDecoder(ONE_JOINT, 500.0)
    frame = CanFrame(0x701 | objects.EXTENDED, b"\x05").to_bytes()
    decoder.feed(RawFrame(10**12, 0, "rx", frame, "can"))
    assert decoder.last_heard_ns is None and decoder.counters["unknown"] == 1


# --- nodes ---------------------------------------------------------------------------------------


class Nodes:
    """A network of nodes that answer as *answer(number, request)* says."""

    def __init__(self, answer):
        self._answer = answer
        self.added = []

    def add_node(self, node):
        node.associate_network(self)
        self.added.append(node.id)
        return node

    def subscribe(self, *_):
        pass

    def send_message(self, can_id, data, remote=False):
        node = next((n for n in self.nodes if n.id == can_id - objects.SDO_REQUEST_BASE), None)
        reply = self._answer(node.id, bytes(data)) if node else None
        if reply is not None:
            node.sdo.on_response(0, reply, 0.0)

    @property
    def nodes(self):
        return self._nodes.values()


def visit_all(setup, network, wanting, seconds):
    network._nodes = setup._nodes
    notes = []
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s:
        network._nodes = setup._nodes
        notes += setup.step(network, wanting, time.monotonic_ns())
        time.sleep(0.005)
    return notes


@pytest.mark.slow
def test_an_upload_that_never_ends_holds_nothing_up(monkeypatch):
    monkeypatch.setattr(configure, "VISIT_S", 0.3)

    def answer(number, request):
        if request[0] == 0x40:  # upload: "segmented, without a size"
            return bytes([0x40]) + request[1:4] + bytes(4)
        return bytes([request[0] & 0x10]) + bytes(7) if request[0] & 0xE0 == 0x60 else None

    setup = NodeSetup(Expectation("SIM-0001", 2, 0, (TURN, TURN)), 500.0, None)
    notes = visit_all(setup, Nodes(answer), [1, 2], 1.6)
    told = b"".join(notes).decode()
    assert "CAN node 1: it is not done within 0.3 s" in told
    assert "CAN node 2: it is not done within 0.3 s" in told


def test_an_absent_node_does_not_keep_the_others_from_their_turn():
    network = Nodes(lambda number, request: None)
    setup = NodeSetup(Expectation("SIM-0001", 4, 0, (TURN,) * 4), 500.0, None)
    visit_all(setup, network, [1, 2, 3, 4], 2.0)
    assert sorted(network.added) == [1, 2, 3, 4, 5]


def test_a_visit_that_outlives_its_bus_leaves_no_node_to_the_next(monkeypatch):
    released, building = threading.Event(), threading.Event()

    def slowly(number):
        building.set()
        released.wait(60.0)
        return configure.make_remote_node(number)

    monkeypatch.setattr("armd.drivers.can.setup.node_setup.make_remote_node", slowly)
    setup = NodeSetup(ONE_JOINT, 500.0, None)
    old = Nodes(lambda number, request: None)
    old._nodes = {}
    setup.step(old, [1], time.monotonic_ns())
    _, job = setup._running
    assert building.wait(60.0)
    setup.restart()  # another bus
    released.set()
    job.wait(60.0)
    assert old.added and setup._nodes == {}


@pytest.mark.slow
def test_the_stream_goes_on_through_cut_lines(tmp_path):
    """A whole arm behind an adapter that cuts a line now and then."""
    with (
        simulated_arm(tmp_path, wire=("--can", "slcan"), rate_hz=100) as arm,
        open_line() as (master, _, path),
    ):
        adapter = os.open(arm.port, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(adapter)
        over = threading.Event()

        def carry():
            cuts = 0
            while not over.is_set():
                ready, _, _ = select.select([master, adapter], [], [], 0.1)
                for source in ready:
                    data = os.read(source, 4096)
                    if source == adapter:
                        cuts += 1
                        data += BAD_LINES[cuts // 20 % 12] if cuts % 20 == 0 else b""
                    os.write(master if source == adapter else adapter, data)

        thread = threading.Thread(target=carry)
        thread.start()
        turns = Expectation("SIM-0001", 6, 6, (1 << 23,) * 6)
        config = CanConfig(kind="can", interface="slcan", channel=path, rate_hz=100)
        with closing(CanDriver(config, turns)) as driver:
            items = []
            end_s = time.monotonic() + 30.0
            while time.monotonic() < end_s and driver.counters["samples"] < 200:
                items += driver.read(0.05)
        over.set()
        thread.join()
        os.close(adapter)
    assert driver.counters["samples"] >= 200 and driver.counters["garbled"] > 5
    # A line that a busy machine leaves silent for half a second is opened anew, and rightly so.
    assert [item for item in items if isinstance(item, Event) and item.kind == "bus_fault"] == []


def test_the_answer_of_a_bus_is_one_line():
    error = can.CanError("Failed to receive: x\nTraceback (most recent call last):\n  …")
    assert "\n" not in bus_module._say(error)
