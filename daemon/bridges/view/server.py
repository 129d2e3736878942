"""The page's server: files, the stream of news, tables to download, and commands."""

from __future__ import annotations

import asyncio
import json
import socket
import ssl
from collections.abc import Awaitable, Callable
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import parse_qs

from armd import Arm
from armd.daemon.bridges.listening import Address, open_listener
from armd.daemon.bridges.process import report_ready, run_in_thread
from armd.daemon.bridges.tips import Tips
from armd.daemon.bridges.view import page_messages, sessions
from armd.daemon.bridges.view.access import Access
from armd.daemon.bridges.view.board import Board
from armd.daemon.bridges.view.feed import LIVE_HZ, Feed
from armd.daemon.bridges.view.files import Files
from armd.daemon.bridges.view.http import (
    MOST_HEAD_BYTES,
    NotServed,
    Request,
    format_answer,
    format_head,
    read_request,
)
from armd.daemon.files.tip_history import read_history, use_tip
from armd.errors import ArmdError

if TYPE_CHECKING:
    from armd.daemon.bridges.view.guided import Guided

TEXT = "text/plain; charset=utf-8"
JSON = "application/json"
#: Limit of open pages; a further one is refused with the reason.
MOST_LOOKING = 64
MOST_CONNECTIONS = 2 * MOST_LOOKING
#: Unsent data for one page; a page that does not read misses live points meanwhile.
SEND_BUFFER_BYTES = 1 << 16
#: A page that has not read for this long is disconnected; it reconnects by itself.
STALLED_S = 20.0
#: Period of a comment on a silent stream, so that each side notices when the other is gone.
HEARTBEAT_S = 5.0
#: Delay after a wrong token, so that nobody can try many.
WRONG_TOKEN_S = 1.0
#: The page lists the last tip calibrations, at most so many.
TIPS_TOLD = 50
#: Suffix → content type.
TABLES = {
    ".csv": "text/csv; charset=utf-8",
    ".xyz": TEXT,
    ".ply": TEXT,
    ".qif": "application/xml",
}
COMMANDS = {"reload": (), "tip": ("name",), "keep_tip": ("name",)}

Do = Callable[[Request], Awaitable[object]]
"""Does what a POST asks for; its answer is sent as JSON. Raises `ArmdError`, `NotServed`."""


def _obeyed(arm: Arm, name: str, parameters: dict[str, str]) -> str:
    if name == "keep_tip":  # with the offset of its last calibration
        return use_tip(arm, **parameters)
    return arm.command(name, **parameters)


def _table(arm: Arm, suffix: str) -> str:
    from armd.daemon.bridges.export import formats, source  # pydantic, only when needed

    measurements = source.from_arm(arm)
    return formats.as_text(
        suffix, measurements.measurements, Tips(measurements.info or {}), measurements.serial
    )


class PageServer:
    """Serves one board to many browsers; none of them waits for another."""

    def __init__(
        self, access: Access, serial: str | None, endpoint: str, folder: Path | None
    ) -> None:
        """Prepare the server.

        *folder* is where guided measurements are written; None: no browser may write anything.
        """
        self._access = access
        self._board = Board()
        self._feed = Feed(self._board, serial, endpoint, lambda: bool(self.transports))
        self._files = Files()
        self._connections = 0
        self._silent: dict[asyncio.StreamWriter, None] = {}  # no request yet; oldest first
        self.transports: set[asyncio.WriteTransport] = set()
        """Of the browsers that look."""
        self._deeds: dict[str, Do] = {}
        self._guided: Guided | None = None
        self._sessions = folder
        if folder is not None:
            from armd.daemon.bridges.view.guided import Guided  # the arm's mathematics need 200 MB

            self._guided = Guided(self._board, folder, self._feed)
            self._deeds = {"command": self._command, "guided": self._guided.do}

    async def serve(self, address: Address, context: ssl.SSLContext | None = None) -> None:
        """Serve until cancelled; raises `BadInput` if it cannot listen at *address*."""
        server, endpoint = await open_listener(address, self._connection, context)
        async with server:
            report_ready("view", endpoint)
            try:
                async with asyncio.TaskGroup() as tasks:
                    tasks.create_task(self._feed.run())
                    if self._guided is not None:
                        tasks.create_task(self._guided.run())
            finally:
                if self._guided is not None:
                    self._guided.close()

    def _connection(self) -> asyncio.StreamReaderProtocol:
        reader = asyncio.StreamReader(limit=MOST_HEAD_BYTES)
        return asyncio.StreamReaderProtocol(reader, self._answer)

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self._connections >= MOST_CONNECTIONS and not self._make_room():
            writer.transport.abort()
            return
        self._connections += 1
        self._silent[writer] = None
        try:
            try:
                request = await read_request(reader)
                self._silent.pop(writer, None)
                self._access.check_host(request)
                if request.path == "/events" and request.method == "GET":
                    await self._tell(request, writer)
                else:
                    await self._reply(writer, await self._served(request))
            except NotServed as refused:
                text = f"armd view: {refused}\n".encode()
                await self._reply(writer, format_answer(refused.status, TEXT, text))
        except (OSError, TimeoutError, EOFError):  # the client is gone, or sends nothing
            pass
        except asyncio.CancelledError:  # the server ends; before 3.12 asyncio prints a traceback
            pass
        finally:
            self._connections -= 1
            self._silent.pop(writer, None)
            writer.transport.abort()

    def _make_room(self) -> bool:
        """Close the oldest connection that has sent no request; return whether there was one."""
        oldest = next(iter(self._silent), None)
        if oldest is None:
            return False
        del self._silent[oldest]
        oldest.transport.abort()
        return True

    async def _reply(self, writer: asyncio.StreamWriter, data: bytes) -> None:
        async with asyncio.timeout(STALLED_S):
            writer.write(data)
            await writer.drain()
            writer.close()
            await writer.wait_closed()

    async def _served(self, request: Request) -> bytes:
        """Return the whole answer to any request but that for the stream."""
        if request.method == "POST":
            return await self._done(request)
        if request.method not in ("GET", "HEAD"):
            raise NotServed(HTTPStatus.METHOD_NOT_ALLOWED, f"found {request.method[:20]!r}")
        path = request.path
        if path == "/" and not self._access.knows(request):
            path = "/login.html"
        if self._files.get(path) is not None:
            return self._file(request, path)
        self._access.check_token(request)
        if path == "/temperatures":
            return format_answer(HTTPStatus.OK, JSON, self._feed.history.text().encode())
        if path == "/feature":
            return await self._feature(request)
        if path == "/guided" and self._guided is not None:
            choices = await run_in_thread(self._guided.choices)
            return format_answer(HTTPStatus.OK, JSON, json.dumps(choices).encode())
        if path == "/tips":
            serial = self._feed.serial
            tips = [] if serial is None else await run_in_thread(lambda: read_history(serial))
            return format_answer(HTTPStatus.OK, JSON, json.dumps(tips[-TIPS_TOLD:]).encode())
        if path.startswith(sessions.PREFIX) and (folder := self._sessions) is not None:
            kind, data = await run_in_thread(lambda: sessions.read(folder, path))
            return format_answer(HTTPStatus.OK, kind, data, sessions.GUARDS)
        if path.startswith("/measurements."):
            return await self._table(path)
        raise NotServed(HTTPStatus.NOT_FOUND, f"found nothing at {path[:100]!r}")

    def _file(self, request: Request, path: str) -> bytes:
        file = self._files.get(path)
        assert file is not None
        # The browser keeps the file and checks it each time, so that an upgrade shows at once.
        headers = {"Cache-Control": "no-cache", "ETag": file.tag, "Vary": "Accept-Encoding"}
        if request.headers.get("if-none-match") == file.tag:
            return format_head(
                HTTPStatus.NOT_MODIFIED, file.kind, headers | {"Connection": "close"}
            )
        if "gzip" in request.headers.get("accept-encoding", ""):
            return format_answer(
                HTTPStatus.OK, file.kind, file.packed, headers | {"Content-Encoding": "gzip"}
            )
        return format_answer(HTTPStatus.OK, file.kind, file.data, headers)

    async def _table(self, path: str) -> bytes:
        """Return all measurements that the daemon still has, as `armd export` writes them."""
        suffix = path.removeprefix("/measurements")
        if suffix not in TABLES:
            raise NotServed(HTTPStatus.NOT_FOUND, f"found {suffix[:20]!r}, expected {list(TABLES)}")
        arm = self._feed.arm
        if arm is None:
            raise NotServed(HTTPStatus.SERVICE_UNAVAILABLE, "found no daemon to ask")
        try:
            text = await run_in_thread(lambda: _table(arm, suffix))
        except ArmdError as error:
            raise NotServed(HTTPStatus.SERVICE_UNAVAILABLE, str(error)) from error
        name = "".join(c if c.isalnum() or c in "-_" else "_" for c in arm.serial)
        headers = {"Content-Disposition": f'attachment; filename="{name}{suffix}"'}
        return format_answer(HTTPStatus.OK, TABLES[suffix], text.encode(), headers)

    async def _feature(self, request: Request) -> bytes:
        """Fit a feature to the picked measurements; nothing is changed."""
        measurements = dict(self._feed.measurements)

        def fitted() -> object:
            from armd.daemon.bridges.view.features import fit_feature  # scipy, only when needed

            return fit_feature(measurements, request.query)

        try:
            return format_answer(
                HTTPStatus.OK, JSON, json.dumps(await run_in_thread(fitted)).encode()
            )
        except ArmdError as error:
            content = json.dumps({"error": str(error)}).encode()
            return format_answer(HTTPStatus.CONFLICT, JSON, content)

    async def _done(self, request: Request) -> bytes:
        self._access.check_origin(request)
        if request.path == "/login":
            return await self._login(request)
        self._access.check_token(request)
        deed = self._deeds.get(request.path.split("/")[1])
        if deed is None:
            raise NotServed(
                HTTPStatus.FORBIDDEN, "found a command, expected none: this page may look"
            )
        if request.headers.get("content-type") != JSON:  # a form of another site cannot send it
            raise NotServed(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, f"expected {JSON}")
        try:
            content = json.dumps(await deed(request)).encode()
        except (ArmdError, OSError) as error:
            content = json.dumps({"error": str(error)}).encode()
            return format_answer(HTTPStatus.CONFLICT, JSON, content)
        return format_answer(HTTPStatus.OK, JSON, content)

    async def _login(self, request: Request) -> bytes:
        """Check the token once, and set a cookie that replaces it afterwards."""
        token = parse_qs(request.body.decode("utf-8", "replace")).get("token", [""])[0]
        if not self._access.is_token(token):
            await asyncio.sleep(WRONG_TOKEN_S)
            return format_answer(HTTPStatus.SEE_OTHER, TEXT, b"", {"Location": "/login.html#wrong"})
        cookie = {"Location": "/", "Set-Cookie": self._access.cookie_header()}
        return format_answer(HTTPStatus.SEE_OTHER, TEXT, b"", cookie)

    async def _command(self, request: Request) -> object:
        """Carry out `/command/reload`, `/command/tip` or `/command/keep_tip`.

        The daemon carries it out, if its commands are enabled.
        """
        name = request.path.removeprefix("/command/")
        if name not in COMMANDS:
            raise NotServed(HTTPStatus.NOT_FOUND, f"found {name[:40]!r}, expected {list(COMMANDS)}")
        try:
            parameters = {key: str(request.json()[key]) for key in COMMANDS[name]}
        except KeyError as error:
            raise NotServed(HTTPStatus.BAD_REQUEST, f"found no key {error}") from error
        arm = self._feed.arm
        if arm is None:
            raise ArmdError("the daemon is not there")
        return {"done": await run_in_thread(lambda: _obeyed(arm, name, parameters))}

    async def _tell(self, request: Request, writer: asyncio.StreamWriter) -> None:
        """Send Server-Sent Events until the page is closed."""
        self._access.check_token(request)
        if len(self.transports) >= MOST_LOOKING:
            raise NotServed(
                HTTPStatus.SERVICE_UNAVAILABLE, f"found {MOST_LOOKING} browsers already"
            )
        transport = writer.transport
        connection = transport.get_extra_info("socket")
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        hello = {
            "version": self._files.version, "writing": bool(self._deeds),
            "flags": page_messages.describe_flags(),
        }  # fmt: skip
        writer.write(format_head(HTTPStatus.OK, "text/event-stream", {"Connection": "close"}))
        writer.write(f"retry: 1000\nevent: hello\ndata: {json.dumps(hello)}\n\n".encode())
        loop = asyncio.get_running_loop()
        read, spoke_s = 0, loop.time()
        self.transports.add(transport)
        try:
            while not transport.is_closing():
                now_s = loop.time()
                if transport.get_write_buffer_size() == 0:  # the page reads: send the news at once
                    data, read = self._board.since(read)
                    if not data and now_s - spoke_s > HEARTBEAT_S:
                        data = b": still here\n\n"
                    if data:
                        writer.write(data)
                        spoke_s = now_s
                elif now_s - spoke_s > STALLED_S:
                    return
                await asyncio.sleep(1 / LIVE_HZ)
        finally:
            self.transports.discard(transport)
