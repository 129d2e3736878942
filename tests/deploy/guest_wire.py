"""Run qemu with a wire between two of its devices: `python guest_wire.py COMMAND…`.

In COMMAND, {arm} and {adapter} stand for its ends, for `-chardev socket,fd=…`. The wire takes what
it is given at once and drops what the other end does not take, as wires do: qemu writes to a USB
adapter's far end with everything else at a standstill, and joined to itself would wait for ever.
"""

from __future__ import annotations

import contextlib
import select
import socket
import subprocess
import sys

#: The least that Linux grants, a handful of packets: no adapter remembers seconds.
BUFFER_BYTES = 1


def main(command: list[str]) -> int:
    arm, arm_far = socket.socketpair()
    adapter, adapter_far = socket.socketpair()
    fds = {"arm": arm_far.fileno(), "adapter": adapter_far.fileno()}
    words = [word.format(**fds) for word in command]
    with subprocess.Popen(words, pass_fds=list(fds.values())) as machine:
        arm_far.close()
        adapter_far.close()
        carry({arm: adapter, adapter: arm})
    return machine.returncode


def carry(across: dict[socket.socket, socket.socket]) -> None:
    """Until an end is closed."""
    for end in across:
        end.setblocking(False)
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
    while True:
        for end in select.select(list(across), [], [])[0]:
            try:
                data = end.recv(4096)
            except ConnectionResetError:
                data = b""
            if not data:
                return
            with contextlib.suppress(BlockingIOError, BrokenPipeError):
                across[end].send(data)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
