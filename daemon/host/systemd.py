"""The messages of the daemon to systemd (sd_notify); without systemd none are sent."""

from __future__ import annotations

import os
import socket
import time


class Systemd:
    """Sends READY=1, STATUS=… and others to the socket that $NOTIFY_SOCKET names.

    It is a datagram socket.
    """

    def __init__(self) -> None:
        address = os.environ.get("NOTIFY_SOCKET", "")
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) if address else None
        watchdog_s = int(os.environ.get("WATCHDOG_USEC", "0")) / 1e6
        self._feed_every_s = watchdog_s / 3
        self._fed_s = 0.0
        self._status = ""

    def ready(self) -> None:
        self._send("READY=1")

    def reloading(self) -> None:
        """Report that a reload begins, as Type=notify-reload requires; `ready` ends it."""
        self._send(f"RELOADING=1\nMONOTONIC_USEC={time.monotonic_ns() // 1000}")

    def stopping(self) -> None:
        self._send("STOPPING=1")

    def status(self, text: str) -> None:
        """Set the line that `systemctl status` shows; it is sent when it changes."""
        if text != self._status:
            self._status = text
            self._send(f"STATUS={text}")

    def feed_watchdog(self, now_s: float) -> None:
        """Report to the watchdog that the daemon works; calling it often does no harm."""
        if self._feed_every_s and now_s - self._fed_s >= self._feed_every_s:
            self._fed_s = now_s
            self._send("WATCHDOG=1")

    def close(self) -> None:
        if self._socket is not None:
            self._socket.close()

    def _send(self, text: str) -> None:
        if self._socket is not None:
            try:
                self._socket.sendto(text.encode(), self._address)
            except OSError:
                return  # systemd does not listen any more
