"""A python-can bus with workarounds for its faults, and canopen on it without a Notifier."""

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
from can.interfaces.socketcand import SocketCanDaemonBus

from armd.drivers.can.descriptors import remove_descriptor_limit
from armd.drivers.can.objects import ERROR, EXTENDED, REMOTE, SYNC_ID, CanFrame
from armd.drivers.config import CanConfig
from armd.drivers.host_time import HostTime
from armd.drivers.sample import RawFrame

#: Replacements of python-can's defaults; all other interfaces must return own messages.
BETTER_DEFAULTS: dict[str, dict[str, Any]] = {
    "slcan": {"sleep_after_open": 0.0},  # not 2 s
    "socketcand": {"tcp_tune": True},  # no 40 ms of Nagle
    "udp_multicast": {"hop_limit": 0},  # does not leave this machine; own messages come anyway
}
#: The longest time for an answer of socketcand, and for an adapter to accept a frame.
ANSWER_S = 0.5
TAKES_S = 0.2
#: After this many invalid frames in a row, the bus counts as broken.
GARBLED_MOST = 32
STANDARD_MOST, EXTENDED_MOST = 0x7FF, 0x1FFF_FFFF  # identifiers

logging.getLogger("can").addHandler(logging.NullHandler())  # faults become events


class BusFault(Exception):
    """The bus cannot be opened or has broken; it must be rebuilt."""


def open_bus(config: CanConfig) -> can.BusABC:
    """Open the bus; blocks. Raises `BusFault` with the reason."""
    options: dict[str, Any] = dict(config.model_extra or {})
    if config.channel is not None:
        options["channel"] = config.channel
    for name, value in BETTER_DEFAULTS.get(
        config.interface, {"receive_own_messages": True}
    ).items():
        options.setdefault(name, value)
    try:
        if config.interface == "socketcand":
            bus: can.BusABC = PromptSocketcand(**options)
        else:
            bus = can.Bus(interface=config.interface, **options)
    except Exception as error:  # each of python-can's interfaces has exceptions of its own
        raise BusFault(_say(error)) from error
    remove_descriptor_limit(bus)
    return bus


def _say(error: Exception) -> str:
    """Return the error in one line: python-can puts whole tracebacks into its messages."""
    return f"{type(error).__name__}: {str(error).partition(chr(10))[0][:200]}"


class PromptSocketcand(SocketCanDaemonBus):
    """python-can's socketcand with a time-out of `ANSWER_S`.

    It bounds the connection to an absent server (python-can tries for 10 s at a full core), the
    wait for an answer, and later a server that accepts no more frames.
    """

    def __init__(self, channel: str, host: str, port: int, **options: Any) -> None:
        with socket.create_connection((host, port), timeout=ANSWER_S):
            pass
        super().__init__(channel, host, port, **options)  # type: ignore[no-untyped-call]

    def _expect_msg(self, msg: str) -> None:
        connection: socket.socket = self._SocketCanDaemonBus__socket  # type: ignore[attr-defined]
        connection.settimeout(ANSWER_S)
        try:
            super()._expect_msg(msg)  # type: ignore[no-untyped-call]
        except BaseException:
            connection.close()
            raise


class OwnNetwork(canopen.Network):  # type: ignore[misc]
    """canopen's network whose frames the driver's loop receives; sent frames are recorded."""

    def __init__(self, bus: can.BusABC, host_time: HostTime) -> None:
        super().__init__(bus)
        self._bus = bus
        self._time = host_time
        self._sending = threading.Lock()
        self.sent: deque[RawFrame] = deque()
        self.send_faults = 0
        self.garbled = 0
        # Other interfaces return at once without a time-out; slcan would wait for ever.
        self._send_s = TAKES_S if isinstance(bus, slcanBus) else None
        self._garbled_in_a_row = 0
        self._stuck: str | None = None  # why nothing more can be sent

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """Send a frame; both the loop and a configuring job call this.

        A frame that the interface does not take is counted. A missing answer is noticed elsewhere.
        """
        message = can.Message(
            arbitration_id=can_id, data=data, is_remote_frame=remote, is_extended_id=False
        )
        with self._sending:
            monotonic_ns, unix_ns = self._time.now()
            try:
                self._bus.send(message, self._send_s)
            except Exception as error:  # see `receive`
                self.send_faults += 1
                if time.monotonic_ns() - monotonic_ns > TAKES_S / 2 * 1e9:
                    self._stuck = f"nothing more can be sent: {_say(error)}"
                return
            raw = CanFrame(can_id, bytes(data)).to_bytes()
            self.sent.append(RawFrame(monotonic_ns, unix_ns, "tx", raw, "can"))

    def send_sync(self) -> None:
        self.send_message(SYNC_ID, b"")

    def receive(self, timeout_s: float) -> RawFrame | None:
        """Return the next frame, or None after *timeout_s* without one. Raises `BusFault`.

        python-can parses the text of an adapter or a server without checking it first. So a damaged
        line raises any error: `IndexError`, `ValueError`, `KeyError`, … Such a frame is counted and
        skipped. `GARBLED_MOST` of them in a row mean that the bus is broken.
        """
        if self._stuck is not None:
            raise BusFault(self._stuck)
        begun = time.monotonic()
        try:
            message = self._bus.recv(timeout_s)
        except Exception as error:
            poisoned = isinstance(self._bus, slcanBus) and isinstance(
                error.__cause__, UnicodeDecodeError
            )
            if isinstance(error, can.CanError | OSError) and not poisoned:
                raise BusFault(_say(error)) from error
            if isinstance(self._bus, slcanBus):  # `flush` would also drop the lines that wait
                self._bus._buffer.clear()
            self._note_garbled(_say(error))
            return None
        monotonic_ns, unix_ns = self._time.now()
        if message is None:
            # A closed socketcand returns at once, for ever: do not spin.
            pause_s = min(begun + timeout_s - time.monotonic(), 0.001)
            if pause_s > 0:
                time.sleep(pause_s)
            return None
        identifier = message.arbitration_id
        largest = EXTENDED_MOST if message.is_extended_id else STANDARD_MOST
        is_whole = message.is_remote_frame or len(message.data) == message.dlc
        if not 0 <= identifier <= largest or not is_whole:
            self._note_garbled(f"identifier {identifier:#x}, {len(message.data)} bytes")
            return None
        self._garbled_in_a_row = 0
        identifier |= EXTENDED if message.is_extended_id else 0
        identifier |= REMOTE if message.is_remote_frame else 0
        identifier |= ERROR if message.is_error_frame else 0
        raw = CanFrame(identifier, bytes(message.data)).to_bytes()
        return RawFrame(monotonic_ns, unix_ns, "rx", raw, "can")

    def _note_garbled(self, description: str) -> None:
        self.garbled += 1
        self._garbled_in_a_row += 1
        if self._garbled_in_a_row >= GARBLED_MOST:
            raise BusFault(
                f"{GARBLED_MOST} frames in a row that make no sense, the last: {description}"
            )

    def close(self) -> None:
        """Close the bus, and ignore its errors. A job that still sends counts a fault."""
        with suppress(Exception):
            self._bus.shutdown()
