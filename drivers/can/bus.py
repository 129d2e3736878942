"""A python-can bus with its measured traps closed, and canopen on it without a Notifier."""

from __future__ import annotations

import logging
import socket
import threading
import time
from collections import deque
from contextlib import suppress
from typing import Any

import can
import canopen
from can.interfaces.slcan import slcanBus

from armd.drivers.can.objects import ERROR, EXTENDED, REMOTE, SYNC_ID, CanFrame
from armd.drivers.config import CanConfig
from armd.drivers.host_time import HostTime
from armd.drivers.sample import RawFrame

#: Where python-can's own defaults do not suit us; all others are asked for own messages.
BETTER_DEFAULTS: dict[str, dict[str, Any]] = {
    "slcan": {"sleep_after_open": 0.0},  # not 2 s
    "socketcand": {"tcp_tune": True},  # no 40 ms of Nagle
    "udp_multicast": {"hop_limit": 0},  # does not leave this machine; own messages come anyway
}
CONNECT_S = 0.5

logging.getLogger("can").addHandler(logging.NullHandler())  # faults become events


class BusFault(Exception):
    """The bus cannot be opened or has broken; it is to be built anew."""


def open_bus(config: CanConfig) -> can.BusABC:
    """Blocking. Raises `BusFault` with the reason."""
    options: dict[str, Any] = dict(config.model_extra or {})
    if config.channel is not None:
        options["channel"] = config.channel
    for name, value in BETTER_DEFAULTS.get(
        config.interface, {"receive_own_messages": True}
    ).items():
        options.setdefault(name, value)
    try:
        if config.interface == "socketcand":
            _knock(options)
        return can.Bus(interface=config.interface, **options)
    except Exception as error:  # each of python-can's interfaces has exceptions of its own
        raise BusFault(f"{type(error).__name__}: {error}") from error


def _knock(options: dict[str, Any]) -> None:
    """python-can tries a socketcand that is not there for 10 s at a full core."""
    address = (options["host"], options["port"])
    with socket.create_connection(address, timeout=CONNECT_S):
        pass


class OwnNetwork(canopen.Network):  # type: ignore[misc]
    """canopen's network, received for by the driver's loop; whatever is sent is recorded."""

    def __init__(self, bus: can.BusABC, host_time: HostTime) -> None:
        super().__init__(bus)
        self._bus = bus
        self._time = host_time
        self._sending = threading.Lock()
        self.sent: deque[RawFrame] = deque()
        self.send_faults = 0

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """From the loop and from a configuring job alike. A frame that the interface does not
        take is counted; that nobody answers shows by itself."""
        message = can.Message(
            arbitration_id=can_id, data=data, is_remote_frame=remote, is_extended_id=False
        )
        with self._sending:
            monotonic_ns, unix_ns = self._time.now()
            try:
                self._bus.send(message)
            except (can.CanError, OSError):
                self.send_faults += 1
                return
            raw = CanFrame(can_id, bytes(data)).to_bytes()
            self.sent.append(RawFrame(monotonic_ns, unix_ns, "tx", raw, "can"))

    def send_sync(self) -> None:
        self.send_message(SYNC_ID, b"")

    def receive(self, timeout_s: float) -> RawFrame | None:
        """The next frame; None after *timeout_s* without one. Raises `BusFault`."""
        begun = time.monotonic()
        try:
            message = self._bus.recv(timeout_s)
        except UnicodeDecodeError:  # slcan: one such byte would poison every later call
            if isinstance(self._bus, slcanBus):
                self._bus.flush()
            return None
        except (can.CanError, OSError, ValueError) as error:
            raise BusFault(f"{type(error).__name__}: {error}") from error
        monotonic_ns, unix_ns = self._time.now()
        if message is None:
            # A closed socketcand returns at once, for ever: do not spin.
            rest = min(begun + timeout_s - time.monotonic(), 0.001)
            if rest > 0:
                time.sleep(rest)
            return None
        identifier = message.arbitration_id
        identifier |= EXTENDED if message.is_extended_id else 0
        identifier |= REMOTE if message.is_remote_frame else 0
        identifier |= ERROR if message.is_error_frame else 0
        raw = CanFrame(identifier, bytes(message.data)).to_bytes()
        return RawFrame(monotonic_ns, unix_ns, "rx", raw, "can")

    def close(self) -> None:
        """What is broken need not be closed well. A job that still sends counts a fault."""
        with suppress(can.CanError, OSError, ValueError, TypeError):
            self._bus.shutdown()
