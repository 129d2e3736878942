"""A small socketcand server: CAN frames as ASCII over TCP, for python-can's `socketcand`."""

from __future__ import annotations

import select
import socket
import struct
import time
from dataclasses import dataclass, field

from armd.simulator.canbus.wires import Frame, to_monotonic_ns

BUS = "can0"
#: python-can expects only "< ok >" in one read: a new client's frames wait this long.
SETTLE_NS = 20_000_000
SO_TIMESTAMPNS, TIMESPEC = 35, struct.Struct("@ll")  # Linux's, which `socket` does not name
BACKLOG_BYTES = 1 << 16  # the most bytes that wait for a client; more are lost


@dataclass
class _Client:
    connection: socket.socket
    received: bytearray = field(default_factory=bytearray)
    unsent: bytearray = field(default_factory=bytearray)
    raw_from_ns: int | None = None  # when frames may be sent; None before raw mode

    def push(self, text: bytes) -> None:
        if len(self.unsent) < BACKLOG_BYTES:
            self.unsent += text
        self.flush()

    def flush(self) -> None:
        if self.raw_from_ns is not None and time.monotonic_ns() < self.raw_from_ns:
            return
        try:
            del self.unsent[: self.connection.send(self.unsent)]
        except BlockingIOError:
            pass
        except OSError:  # gone; `receive` will remove it
            self.unsent.clear()


class SocketcandWire:
    """Serves the bus `can0` on loopback; clients also receive each other's frames."""

    def __init__(self, port: int = 0) -> None:
        self._port = port
        self._server: socket.socket | None = None
        self._clients: list[_Client] = []
        self.up()
        self.address = f"127.0.0.1:{self._port}"

    def up(self) -> None:
        if self._server is not None:
            return
        self._server = socket.create_server(("127.0.0.1", self._port))
        self._server.setblocking(False)
        self._port = self._server.getsockname()[1]

    def down(self) -> None:
        for client in self._clients:
            client.connection.close()
        self._clients.clear()
        if self._server is not None:
            self._server.close()
            self._server = None

    close = down

    def receive(self, timeout_s: float) -> list[Frame]:
        if self._server is None:
            time.sleep(timeout_s)
            return []
        sockets = [self._server, *(client.connection for client in self._clients)]
        ready, _, _ = select.select(sockets, [], [], timeout_s)
        for client in self._clients:
            if client.unsent:
                client.flush()
        frames: list[Frame] = []
        for client in [client for client in self._clients if client.connection in ready]:
            frames += self._read(client)
        if self._server in ready:
            connection, _ = self._server.accept()
            connection.setblocking(False)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
            self._clients.append(_Client(connection))
            self._clients[-1].push(b"< hi >")
        return frames

    def send(self, frames: list[Frame]) -> None:
        self._broadcast(frames, None)

    def _broadcast(self, frames: list[Frame], sender: _Client | None) -> None:
        now = time.time()
        text = b"".join(
            b"< frame %03X %.6f %s >" % (can_id, now, data.hex().upper().encode())
            for can_id, data, _ in frames
        )
        for client in self._clients:
            if client is not sender and client.raw_from_ns is not None:
                client.push(text)

    def _read(self, client: _Client) -> list[Frame]:
        try:
            data, notes, _, _ = client.connection.recvmsg(65536, 128)
        except OSError:
            data, notes = b"", []
        if not data:
            client.connection.close()
            self._clients.remove(client)
            return []
        # A node latches in hardware: at the arrival, not when this process wakes up.
        stamps = [TIMESPEC.unpack(note) for _, kind, note in notes if kind == SO_TIMESTAMPNS]
        arrived_ns = time.monotonic_ns()
        if stamps:
            arrived_ns = to_monotonic_ns(stamps[-1][0] * 1_000_000_000 + stamps[-1][1])
        client.received += data
        frames = []
        while (end := client.received.find(b">")) >= 0:
            words = bytes(client.received[:end]).decode("ascii", "replace").strip("< ").split()
            del client.received[: end + 1]
            match words:
                case ["open", name]:
                    client.push(b"< ok >" if name == BUS else b"< error no such bus >")
                case ["rawmode"]:
                    client.push(b"< ok >")
                    client.raw_from_ns = time.monotonic_ns() + SETTLE_NS
                case ["echo"]:
                    client.push(b"< echo >")
                case ["send", can_id, length, *octets] if len(octets) == int(length, 16):
                    octets_sent = bytes(int(x, 16) for x in octets)
                    frames.append(Frame(int(can_id, 16), octets_sent, arrived_ns))
                case _:
                    client.push(b"< error unknown command >")
        self._broadcast(frames, client)
        return frames
