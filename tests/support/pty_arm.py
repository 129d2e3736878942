"""A little arm on a pty, for tests of the serial transport: talks in a thread, fails on demand."""

import os
import threading
import time
from contextlib import suppress
from pathlib import Path

from armd.drivers.serial import wire
from support.pty_link import PtyLink


class PtyArm(PtyLink):
    """Streams samples with joint k at `10·seq + k` counts; `link` is its stable name."""

    def __init__(self, folder: Path, rate_hz: int = 500, **hello):
        self.rate_hz = rate_hz
        fields = {"serial_number": "SIM-0001", "n_joints": 3, "n_sensors": 2, "boot_id": 1}
        fields |= hello
        bits = (20,) * fields["n_joints"]
        self.hello = wire.Hello(protocol=1, rate_hz=rate_hz, bits=bits, **fields)
        self.sent: list[int] = []
        self.silent = self.mute = False
        self._boot()
        super().__init__(folder / "arm")
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _boot(self):
        self.boot_ns = time.monotonic_ns()
        self.seq = 0

    def reboot(self, boot_id=None):
        """Without one: a boot id of its own."""
        self.hello = wire.Hello(
            **{name: getattr(self.hello, name) for name in wire.Hello.__slots__}
            | {"boot_id": self.hello.boot_id + 1 if boot_id is None else boot_id}
        )
        self._boot()
        self.write(wire.encode_hello(self.hello))

    def close(self):
        self._stop.set()
        self._thread.join()
        if self.master >= 0:
            self.unplug()

    def write(self, data: bytes) -> bool:
        try:
            return os.write(self.master, data) == len(data)
        except OSError:
            return False

    def device_us(self):
        return (time.monotonic_ns() - self.boot_ns) // 1000

    def _run(self):
        splitter = wire.CobsSplitter()
        due = time.monotonic()
        while not self._stop.wait(0.0005):
            with suppress(OSError):
                for packet in splitter.push(os.read(self.master, 4096)):
                    self._answer(wire.unpack(packet))
            while time.monotonic() >= due:
                due += 1 / self.rate_hz
                self._latch()

    def _answer(self, data):
        if self.mute or self.silent:
            return
        if data[0] == wire.Type.IDENTIFY:
            self.write(wire.encode_hello(self.hello))
        elif data[0] == wire.Type.PING:
            self.write(wire.encode_pong(wire.decode_ping(data), self.device_us()))

    def _latch(self):
        seq, self.seq = self.seq, self.seq + 1
        if self.silent:
            return
        counts = [10 * seq + k for k in range(self.hello.n_joints)]
        self.sent.append(seq)  # before it can be received
        if not self.write(wire.encode_sample(seq, self.device_us(), counts)):
            self.sent.remove(seq)
