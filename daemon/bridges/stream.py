"""Text lines over TCP for each client: one per measurement, or per point."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from armd import POINT, Arm, keys
from armd.daemon.bridges import lines
from armd.daemon.bridges.listening import Address, Client, open_listener
from armd.daemon.bridges.process import report_ready, run_in_thread
from armd.daemon.bridges.tips import Tips

POLL_S = 0.01


class Reader(Client):
    """A client that reads lines; data that it sends is discarded."""

    def __init__(self, readers: set[Reader], header: str | None) -> None:
        super().__init__()
        self._readers = readers
        self._header = header

    def begin(self) -> None:
        self._readers.add(self)
        if self._header is not None:
            self.send(f"{self._header}\n".encode())

    def end(self) -> None:
        self._readers.discard(self)

    def eof_received(self) -> bool:
        return True  # `nc < /dev/null` ends its input at once, but still reads


class LineStream:
    """The lines of one arm; a client gets those made after it has connected."""

    def __init__(
        self, arm: Arm, line: lines.LineFormat, header: str | None, hz: float | None
    ) -> None:
        """Prepare a stream; *hz* None: of measurements, else of at most *hz* points a second."""
        self._arm = arm
        self._line = line
        self._header = header
        self._hz = hz
        self._readers: set[Reader] = set()
        self._slot = -1  # of the last point sent, in periods of *hz*

    async def serve(self, address: Address) -> None:
        info = await run_in_thread(self._arm.info)
        self._tips = Tips(info)
        self._tip: str | None = info["tip"]
        server, endpoint = await open_listener(address, lambda: Reader(self._readers, self._header))
        async with server:
            if self._hz is None:
                await self._tell_measurements(endpoint)
            else:
                await self._tell_points(endpoint)

    async def _tell_measurements(self, endpoint: str) -> None:
        """Send measurements as they arrive; the subscription delivers no past ones."""
        arrived: asyncio.Queue[bytes] = asyncio.Queue()
        loop = asyncio.get_running_loop()
        with self._arm.calling(keys.MEASUREMENT, lambda data: _hand_over(loop, arrived, data)):
            report_ready("stream", endpoint)
            while True:
                measurement = json.loads(await arrived.get())
                self._send(lines.convert_measurement(measurement, self._tips, self._arm.serial))

    async def _tell_points(self, endpoint: str) -> None:
        with self._arm.stream(keys.POINT) as stream, self._arm.stream(keys.HEALTH) as health:
            report_ready("stream", endpoint)
            while True:
                await asyncio.sleep(POLL_S)
                for payload in health.take():
                    self._tip = json.loads(payload)["tip"]
                payloads = stream.take()
                if payloads and self._readers:
                    self._pass_on(np.frombuffer(b"".join(payloads), POINT))

    def _pass_on(self, points: np.ndarray[Any, np.dtype[np.void]]) -> None:
        """Send the first point of each period, by the points' own time."""
        assert self._hz is not None
        for point in points:
            slot = int(point["stamp_ns"] * (self._hz * 1e-9))
            if slot == self._slot:
                continue
            fields = lines.convert_point(point, self._tips, self._tip, self._arm.serial)
            if fields is not None:
                self._slot = slot
                self._send(fields)

    def _send(self, fields: Mapping[str, Any] | None) -> None:
        if fields is None:
            return
        data = f"{self._line(fields)}\n".encode()
        for reader in list(self._readers):
            reader.send(data)


def _hand_over(loop: asyncio.AbstractEventLoop, arrived: asyncio.Queue[bytes], data: bytes) -> None:
    """Pass data from Zenoh's thread to the event loop."""
    if not loop.is_closed():
        loop.call_soon_threadsafe(arrived.put_nowait, data)
