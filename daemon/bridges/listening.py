"""A TCP port for a bridge, and connections that never block it."""

from __future__ import annotations

import argparse
import asyncio
import socket
import ssl
from collections.abc import Callable
from typing import cast

from armd.errors import BadInput

#: Limit of unsent data of one client; a client that reads too slowly is disconnected.
WAITING_BYTES = 1 << 20
#: These detect a host that was switched off or unplugged within half a minute.
KEEPALIVE = {
    socket.TCP_KEEPIDLE: 10,
    socket.TCP_KEEPINTVL: 5,
    socket.TCP_KEEPCNT: 3,
    socket.TCP_USER_TIMEOUT: 25_000,  # ms
}

#: A connection that does not start TLS is closed after this; asyncio's default is a minute.
HANDSHAKE_S = 5.0

Address = tuple[str, int]


def parse_address(text: str) -> Address:
    """Parse `HOST:PORT` or `[IPV6]:PORT`; for argparse."""
    host, colon, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not (colon and host and port.isascii() and port.isdigit() and int(port) < 1 << 16):
        raise argparse.ArgumentTypeError(f"found {text!r}, expected HOST:PORT")
    return host, int(port)


def add_listen(parser: argparse.ArgumentParser, usual: str) -> None:
    """Add the option --listen."""
    parser.add_argument(
        "--listen",
        type=parse_address,
        default=parse_address(usual),
        metavar="HOST:PORT",
        help=f"({usual})",
    )


class Client(asyncio.Protocol):
    """One connection; `send` never waits."""

    def __init__(self) -> None:
        self._transport: asyncio.Transport | None = None

    @property
    def connected(self) -> bool:
        return self._transport is not None and not self._transport.is_closing()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.Transport, transport)
        connection = transport.get_extra_info("socket")
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, value in KEEPALIVE.items():
            connection.setsockopt(socket.IPPROTO_TCP, option, value)
        self.begin()

    def connection_lost(self, exc: Exception | None) -> None:
        self._transport = None
        self.end()

    def begin(self) -> None:
        """Handle a new connection."""

    def end(self) -> None:
        """Handle the end of the connection, whichever side closed it."""

    def send(self, data: bytes) -> None:
        """Queue *data*, or close the connection if its other side has stopped reading."""
        if self._transport is None or self._transport.is_closing():
            return
        if self._transport.get_write_buffer_size() + len(data) > WAITING_BYTES:
            self._transport.abort()  # a close would wait until the unsent data is read
            self._transport = None
        else:
            self._transport.write(data)

    def close(self) -> None:
        """Close the connection after the unsent data has been sent."""
        if self._transport is not None:
            self._transport.close()


async def open_listener(
    address: Address, client: Callable[[], asyncio.Protocol], tls: ssl.SSLContext | None = None
) -> tuple[asyncio.Server, str]:
    """Start a server; return it and its address; raises `BadInput` if it cannot listen."""
    host, port = address
    try:
        server = await asyncio.get_running_loop().create_server(
            client, host, port, ssl=tls, ssl_handshake_timeout=HANDSHAKE_S if tls else None
        )
    except OSError as error:
        problem = f"{host}:{port}: {error.strerror}"
        raise BadInput(
            "the command line", "--listen", problem, "an address to listen on"
        ) from error
    bound = server.sockets[0].getsockname()
    return server, f"[{bound[0]}]:{bound[1]}" if ":" in bound[0] else f"{bound[0]}:{bound[1]}"
