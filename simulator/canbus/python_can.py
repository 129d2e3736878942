"""Buses that python-can connects at both ends: SocketCAN, and UDP multicast on loopback."""

from __future__ import annotations

import socket
import struct
import time
from contextlib import suppress

import can

from armd.errors import BadInput
from armd.simulator.canbus.wires import Frame, to_monotonic_ns

LOOPBACK = socket.inet_aton("127.0.0.1")


class PythonCanWire:
    """A bus of python-can's *interface* and *channel*; down means that the nodes have left it.

    The channel of `udp_multicast` is GROUP:PORT: groups that share a port receive each other.
    """

    def __init__(self, interface: str, channel: str) -> None:
        self._interface = interface
        self.address = channel
        self._bus: can.BusABC | None = None
        self.up()

    def up(self) -> None:
        if self._bus is None:
            try:
                self._bus = self._join()
            except (OSError, ValueError, can.CanError) as error:
                raise BadInput(
                    "command line", "--channel", self.address, f"a bus: {error}"
                ) from None

    def _join(self) -> can.BusABC:
        if self._interface != "udp_multicast":
            return can.Bus(interface=self._interface, channel=self.address)
        group, port = self.address.split(":")
        bus = can.Bus(interface=self._interface, channel=group, port=int(port))
        _keep_on_loopback(bus, group)
        return bus

    def down(self) -> None:
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None

    close = down

    def receive(self, timeout_s: float) -> list[Frame]:
        if self._bus is None:
            time.sleep(timeout_s)
            return []
        frames = []
        with suppress(can.CanError):  # a link that is down receives nothing
            message = self._bus.recv(timeout_s)
            while message is not None:
                if not (message.is_extended_id or message.is_error_frame):
                    arrival_ns = to_monotonic_ns(round(message.timestamp * 1e9))
                    frames.append(Frame(message.arbitration_id, bytes(message.data), arrival_ns))
                message = self._bus.recv(0)
        return frames

    def send(self, frames: list[Frame]) -> None:
        for can_id, data, _ in frames:
            if self._bus is not None:
                with suppress(can.CanError):  # a link that is down sends nothing
                    self._bus.send(
                        can.Message(arbitration_id=can_id, data=data, is_extended_id=False)
                    )


def _keep_on_loopback(bus: can.BusABC, group: str) -> None:
    """Move python-can's multicast from the default route to loopback."""
    multicast = socket.socket(fileno=socket.dup(bus.fileno()))
    with multicast:
        everywhere = struct.pack("=4sI", socket.inet_aton(group), socket.INADDR_ANY)
        multicast.setsockopt(socket.IPPROTO_IP, socket.IP_DROP_MEMBERSHIP, everywhere)
        membership = socket.inet_aton(group) + LOOPBACK
        multicast.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
        multicast.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, LOOPBACK)
