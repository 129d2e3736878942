"""A subscriber that stands still does not hold up the daemon's end (Zenoh's close would wait)."""

from __future__ import annotations

import signal
import subprocess
import time
from pathlib import Path

import pytest

from support.program import ARMD
from support.punctuality import Punctuality
from support.running_daemon import running_daemon
from support.simulated_arm import simulated_arm


@pytest.mark.serial
def test_the_end_does_not_wait_for_a_stopped_subscriber(
    tmp_path: Path, punctuality: Punctuality
) -> None:
    with (
        simulated_arm(tmp_path) as arm,
        running_daemon(tmp_path, arm.port) as daemon,
    ):
        watch = [*ARMD, "watch", "--json", "--endpoint", daemon.endpoint]
        with subprocess.Popen(watch, stdout=subprocess.PIPE) as other:
            try:
                assert other.stdout is not None
                assert other.stdout.readline().startswith(b"{")  # it does receive
                other.send_signal(signal.SIGSTOP)
                time.sleep(4.0)  # its buffers overflow within one or two
                with punctuality.limit(3.0, "armd run ends beside a stopped subscriber"):
                    code, _ = daemon.stop()
            finally:
                other.kill()
                other.stdout.close()
        assert code == 0
