"""A daemon that says it is ready, feeds its watchdog and does nothing: the test must notice."""

import os
import socket
import time

with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
    systemd.connect(os.environ["NOTIFY_SOCKET"])
    systemd.send(b"READY=1\nSTATUS=READY: measuring")
    while True:
        systemd.send(b"WATCHDOG=1")
        time.sleep(1)
